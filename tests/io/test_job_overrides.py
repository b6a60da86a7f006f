"""Values in the place of a job's own, such as those of a command line."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml

from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.io import parse_job
from armcontour.io.cell import read_cell
from armcontour.io.job_overrides import JobOverrides
from armcontour.jobs import Rounding, Run

POINTS = [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]
JOB: dict[str, Any] = {
    "name": "plane",
    "arm": "pmk3s",
    "path": {"points": POINTS},
    "limits": {"speed": "100 mm/s", "joint_velocity": 2.0, "centripetal_acceleration": 0.09},
    "corners": {"tolerance": "2 mm", "angular_tolerance": "1 deg"},
    "servo": {"kp": 25, "kv": 150},
    "runs": {
        "plain": {},
        "sharp": {"corners": "sharp"},
        "own": {
            "limits": {"speed": "10 mm/s", "joint_velocity": 1.0},
            "corners": {"tolerance": "1 mm"},
        },
        "lifted": {"limits": {"speed": None}},
        "slow": {"corners": {"speed": "30 mm/s", "acceleration": "0.05 m/s^2"}},
    },
}


def runs(x: JobOverrides, **changes: Any) -> dict[str, Run]:
    job = parse_job(yaml.safe_dump({**JOB, **changes}), overrides=x)
    return {run.name: run for run in job.runs}


def tolerance(run: Run) -> float | None:
    return None if run.rounding is None else run.rounding.tolerance


def test_without_values_a_job_is_as_it_is() -> None:
    found, plain = runs(JobOverrides()), parse_job(yaml.safe_dump(JOB)).runs
    assert {x.name: (x.limits.speed, x.rounding) for x in found.values()} == {
        x.name: (x.limits.speed, x.rounding) for x in plain
    }
    assert found["own"].limits.speed == 0.01 and tolerance(found["own"]) == 1e-3


def test_a_speed_goes_before_those_of_the_job_and_of_its_runs() -> None:
    found = runs(JobOverrides(speed=0.05))
    assert {x.limits.speed for x in found.values()} == {0.05}
    # What else a run has of its own stays.
    np.testing.assert_array_equal(found["own"].limits.joint_velocity, [1, 1])
    np.testing.assert_array_equal(found["plain"].limits.joint_velocity, [2, 2])
    assert tolerance(found["own"]) == 1e-3


def test_a_tolerance_goes_before_others_but_rounds_no_sharp_corner() -> None:
    found = runs(JobOverrides(corner_tolerance=2e-4))
    known = {name: tolerance(x) for name, x in found.items()}
    assert known == {"plain": 2e-4, "sharp": None, "own": 2e-4, "lifted": 2e-4, "slow": None}
    plain, slow = found["plain"].rounding, found["slow"].rounding
    assert plain is not None and plain.angular_tolerance == pytest.approx(np.radians(1))
    assert slow is not None and slow.speed == 0.03
    # A job with sharp corners is rounded, where its runs do not say otherwise.
    assert tolerance(runs(JobOverrides(corner_tolerance=2e-4), corners="sharp")["plain"]) == 2e-4


def test_a_shape_goes_to_every_run_that_can_have_it() -> None:
    values = {"corner_shape": "free", "line_tolerance": 1e-4, "zone": 0.01, "iterations": 4}
    of_job = {**JOB["runs"], "paper": {"timing": {"method": "mac"}}}
    of_job.pop("slow")
    found = runs(JobOverrides(**values), runs=of_job)
    free = {"shape": "free", "line_tolerance": 1e-4, "zone": 0.01, "iterations": 4}
    own = found["own"].rounding
    assert own == Rounding(tolerance=1e-3, **free)
    plain = found["plain"].rounding
    assert plain is not None and plain.free and plain.tolerance == 2e-3
    assert plain.angular_tolerance == pytest.approx(np.radians(1))
    assert found["sharp"].rounding is None
    paper = found["paper"].rounding
    assert paper is not None and not paper.free and paper.zone is None
    # Without corners of the job there are those of --tolerance.
    both = JobOverrides(corner_shape="free", corner_tolerance=3e-4)
    assert runs(both, corners="sharp", runs=of_job)["plain"].rounding == Rounding(
        shape="free", tolerance=3e-4
    )


def test_a_free_shape_becomes_arcs_again() -> None:
    free = {"shape": "free", "tolerance": "1 mm", "line_tolerance": "0.1 mm", "zone": "9 mm"}
    found = runs(JobOverrides(corner_shape="arc"), runs={"one": {"corners": free}})
    assert found["one"].rounding == Rounding(tolerance=1e-3)
    same = runs(JobOverrides(corner_shape="free"), runs={"one": {"corners": free}})["one"].rounding
    assert same is not None and same.free and same.zone == pytest.approx(9e-3)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"corner_shape": "round"}, "--corner-shape must be one of arc, free, not 'round'"),
        ({"corner_shape": "free"}, "runs.slow.corners.speed sets the radius of arcs"),
        ({"zone": 0.01}, "runs.lifted.corners.zone is for the shape free"),
    ],
)
def test_a_shape_that_does_not_fit_is_refused(values: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        runs(JobOverrides(**values))


def test_a_shape_for_no_run_is_refused() -> None:
    with pytest.raises(InvalidInput, match="No run has both rounded corners and the timing"):
        runs(JobOverrides(corner_shape="free"), corners="sharp", runs={"one": {}})


def test_a_continuity_goes_to_every_run_that_can_have_it() -> None:
    of_job = {
        "plain": {},
        "paper": {"timing": {"method": "mac"}},
        "free": {"corners": {"shape": "free", "tolerance": "1 mm"}},
        "sharp": {"corners": "sharp"},
    }
    found = runs(JobOverrides(continuity="curvature"), runs=of_job)
    assert {name: x.continuity for name, x in found.items()} == {
        "plain": "curvature",
        "paper": "tangent",
        "free": None,
        "sharp": None,
    }
    # A free shape has no corners that go on with a tangent or a curvature.
    curved = {"tolerance": "1 mm", "continuity": "curvature"}
    free = runs(JobOverrides(corner_shape="free"), corners=curved, runs={"one": {}})["one"]
    assert free.rounding == Rounding(shape="free", tolerance=1e-3)
    for words, values in (
        ("--continuity must be one of tangent, curvature, not 'G2'", {"continuity": "G2"}),
        ("No run has both corners rounded with arcs", {"continuity": "curvature"}),
    ):
        with pytest.raises(InvalidInput, match=words):
            runs(JobOverrides(**values), corners="sharp", runs={"one": {}})


def test_memory_and_where_to_resume() -> None:
    job = parse_job(yaml.safe_dump(JOB), overrides=JobOverrides(memory=3e9, from_s=0.01))
    assert job.memory == 3e9
    assert job.objective is not None and job.objective.length == pytest.approx(0.06)
    with pytest.raises(InvalidInput, match="memory must be from"):
        parse_job(yaml.safe_dump(JOB), overrides=JobOverrides(memory=1.0))


def test_a_drawing_is_placed_and_its_layers_keep_what_the_job_says_of_them(
    tmp_path: FilePath,
) -> None:
    (tmp_path / "part.csv").write_text("x,y,layer\n0,0,a\n40,0,a\n0,9,b\n40,9,b\n")
    own = {"frame": {"position": [0.3, 0.2, 0]}, "layers": {"a": {"speed": 0.02}, "b": {}}}
    cell = {**JOB, "path": {**own, "units": "mm"}}
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump(cell))

    def read(**changes: Any) -> Path:
        x = JobOverrides(layers=("a",), **changes)
        return read_cell(tmp_path / "cell.yaml", tmp_path / "part.csv", overrides=x).single_path

    np.testing.assert_allclose(read().vertices, [[0.3, 0.2], [0.34, 0.2]])
    assert read().speeds.tolist() == [0.02]
    turned = read(turn=(0.0, 0.0, np.pi / 2))
    np.testing.assert_allclose(turned.vertices, [[0.3, 0.2], [0.3, 0.24]], atol=1e-15)
    moved = read(position=(0.28, 0.25, 0.0), scale=0.5)
    np.testing.assert_allclose(moved.vertices, [[0.28, 0.25], [0.3, 0.25]], atol=1e-15)
    with pytest.raises(InvalidInput, match="scale must be above zero, but is 0"):
        read(scale=0.0)
    with pytest.raises(InvalidInput, match="units must be a unit of length such as mm, not 'kg'"):
        read(units="kg")
