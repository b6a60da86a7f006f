"""The section on shaped paths: what it draws is the path, its tolerance and its motion."""

from __future__ import annotations

import dataclasses
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import yaml
from tests.report.shaped_paths import shaped_by_hand, study_of_shaped
from tests.report.test_report_in_space import UR
from tests.report.test_report_of_programs import GCODE

import armcontour as ac
from armcontour.geometry import Demand, Line, Outcome, Path, ShapedPath
from armcontour.io import parse_job
from armcontour.io.cell import read_cell
from armcontour.jobs import Study, run
from armcontour.program import Contour
from armcontour.report import render_report, sections
from armcontour.report.sections.corners import corners, replaced_paths
from armcontour.report.sections.shape_comparison import without_jumps
from armcontour.report.sections.tolerance import tube_outline, tube_pieces

TOLERANCE = 5e-3
PAPER = [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]
PLANE = {
    "name": "paper",
    "arm": "pmk3s",
    "path": {"points": PAPER},
    "limits": {"speed": 0.15, "centripetal_acceleration": 0.09},
    "corners": {"tolerance": TOLERANCE},
    "servo": {"kp": 25, "kv": 150},
    "runs": {"one": {}},
}


@pytest.fixture(scope="module")
def study() -> Study:
    return study_of_shaped(parse_job(yaml.safe_dump(PLANE)), TOLERANCE)


@pytest.fixture(scope="module")
def figures(study: Study) -> tuple[Any, ...]:
    section = sections.shaping(study)
    assert section is not None
    ((_, found),) = section.choices
    return found


def shaped_path(study: Study) -> ShapedPath:
    path = study.runs["one"].path.path
    assert isinstance(path, ShapedPath)
    return path


def traces(figure: Any, name: str) -> list[Any]:
    return [x for x in figure.data if x.name == name]


def points(trace: Any) -> np.ndarray:
    at = np.stack([trace.x, trace.y], axis=1).astype(float)
    return at[np.isfinite(at).all(axis=1)] / 1e3


def test_a_study_without_shaped_paths_has_no_such_section() -> None:
    rounded = run(parse_job(yaml.safe_dump(PLANE)))
    assert sections.shaping(rounded) is None
    assert replaced_paths(rounded) == "the rounded path"
    assert '<div class="figures choice"' not in render_report(rounded)


def test_the_section_stands_after_the_path(study: Study) -> None:
    page = render_report(study)
    keys = "overview paths shaping joint-space speed".split()
    places = [page.index(f'<section id="{key}">') for key in keys]
    assert places == sorted(places)
    # One contour needs no selector.
    assert "<select" not in page


def test_the_table_has_the_outcome_and_the_largest_distances(study: Study) -> None:
    section, path = sections.shaping(study), shaped_path(study)
    assert section is not None
    (table,) = section.tables
    (row,) = table.rows
    found = dict(zip(table.header, row, strict=True))
    assert (
        found["arcs [s]"] == "5.000"
        and found["stops [s]"] == "5.100"
        and not found["parabolas [s]"]
    )
    assert found["shaped [s]"] == "4.500" and found["best start"] == "arcs"
    assert found["gain"] == "10.00%" and found["iterations"] == "2"
    dense = path(np.linspace(0, path.length, 20_000))
    nearest = path.objective.project(dense).distance.max()
    own = np.interp(np.linspace(0, path.length, 20_000), path.places[:, 1], path.places[:, 0])
    off = np.linalg.norm(dense - path.objective(own), axis=1).max()
    assert nearest <= off <= 1.2 * nearest
    assert float(found["distance [mm]"]) == pytest.approx(off * 1e3, rel=5e-3)
    corner = path.objective.vertices[1:-1]
    missed = max(np.linalg.norm(dense - x, axis=1).min() for x in corner)
    assert float(found["missed [mm]"]) == pytest.approx(missed * 1e3, abs=2e-4)


def test_corners_show_the_paths_and_the_tolerance(study: Study, figures: tuple[Any, ...]) -> None:
    path, figure = shaped_path(study), figures[0]
    drawn = np.concatenate([points(x) for x in traces(figure, "shaped path")])
    assert path.project(drawn).distance.max() < 1e-7
    for corner, arc in zip(
        path.objective.vertices[1:-1], traces(figure, "arcs of the same tolerance"), strict=True
    ):
        nearest = np.linalg.norm(points(arc) - corner, axis=1).min()
        assert nearest == pytest.approx(TOLERANCE, rel=5e-3)
    for tube in traces(figure, "tolerance"):
        off = path.objective.project(points(tube)).distance
        assert off.max() == pytest.approx(TOLERANCE, rel=1e-3)


def test_distances_are_magnified_about_the_objective(
    study: Study, figures: tuple[Any, ...]
) -> None:
    path, figure = shaped_path(study), figures[1]
    (menu,) = figure.layout.updatemenus
    shown = menu.buttons[menu.active]
    factors = {x.label: x.args[0] for x in menu.buttons}
    assert list(factors)[0] == "1×" and shown.label == "5×"
    moved, which = shown.args
    assert [figure.data[i].name for i in which] == [
        "tolerance",
        "arcs of the same tolerance",
        "shaped path",
    ]
    for k, i in enumerate(which):
        assert np.allclose(figure.data[i].x, moved["x"][k], atol=1e-3, equal_nan=True)
    near, far = (np.stack([factors[x][a][2] for a in "xy"], 1) / 1e3 for x in ("1×", "5×"))
    assert path.project(near).distance.max() < 1e-6
    base = far - 5 / 4 * (far - near)
    assert path.objective.project(base).distance.max() < 1e-6
    largest = np.linalg.norm(near - base, axis=1).max()
    assert 0.3 * TOLERANCE < largest < TOLERANCE


def test_speed_and_time_gained_are_those_of_the_fastest_motions(
    study: Study, figures: tuple[Any, ...]
) -> None:
    path, figure = shaped_path(study), figures[2]
    job = study.job
    arcs = ac.round_corners(path.objective, tolerance=TOLERANCE)
    plans = [ac.plan(x, job.arm, job.runs[0].limits) for x in (arcs, path)]
    for name, motion in zip(("fastest start: arcs", "shaped path"), plans, strict=True):
        off, speed = traces(figure, name)
        assert (off.xaxis, speed.xaxis) == ("x", "x2")
        assert max(speed.y) == pytest.approx(motion.s(motion.breaks, 1).max() * 1e3, rel=1e-6)
        assert np.abs(off.y).max() <= TOLERANCE * 1e3
    (gained,) = traces(figure, "time gained")
    saved = plans[0].duration - plans[1].duration
    assert gained.y[-1] == pytest.approx(saved * 1e3, abs=1e-3)
    # The arc passes on the left of a turn to the left, at the distance of its lines.
    turn = path.objective.turns[0]
    off = traces(figure, "fastest start: arcs")[0]
    peak = off.y[np.argmin(np.abs(np.array(off.x) - path.objective.breaks[1] * 1e3))]
    assert peak == pytest.approx(TOLERANCE * 1e3 * np.cos(turn / 2), rel=1e-3)
    lines = [x for x in figure.layout.shapes if x.type == "line"]
    assert [x.x0 for x in lines] == pytest.approx(path.objective.breaks[1:-1] * 1e3)


def test_executed_corners_show_the_shaped_path(study: Study) -> None:
    (figure,) = corners(study)
    assert [len(traces(figure, x)) for x in ("shaped path", "tolerance", "one")] == [2, 2, 2]
    assert replaced_paths(study) == "the shaped path"
    rounded = run(study.job)
    both = Study(job=study.job, runs={"arcs": rounded.runs["one"], **study.runs})
    (figure,) = corners(both)
    assert traces(figure, "rounded path") and traces(figure, "shaped path")
    assert replaced_paths(both) == "the rounded and the shaped path"


def test_a_point_inside_a_corner_belongs_to_the_corner_in_figures() -> None:
    objective = Path.polyline([(0, 0), (0.1, 0), (0.1, 0.1)])
    s = np.array([0.0, 0.08, 0.085, 0.096, 0.104, 0.11, 0.13, 0.2])
    places = np.stack([s, [0.0, 0.08, 0.084, 0.094, 0.094, 0.1, 0.12, 0.19]], axis=1)
    found = without_jumps(places, objective)
    assert found[:, 0].tolist() == [0.0, 0.08, 0.1, 0.13, 0.2]
    assert found[:, 1].tolist() == [0.0, 0.08, 0.094, 0.12, 0.19]
    assert without_jumps(found, objective).tolist() == found.tolist()


def test_a_tube_is_what_is_within_the_tolerance() -> None:
    corner = Path.polyline([(0, 0), (0.1, 0), (0.05, 0.08), (0.15, 0.08)])
    shaped = shaped_by_hand(corner, 8e-3)
    s, radius = tube_pieces(shaped)
    outline = tube_outline(corner(s), radius)
    rng = np.random.default_rng(3)
    at = rng.uniform((0.01, -0.02), (0.14, 0.1), (4000, 2))
    distance = corner.project(at).distance
    clear = np.abs(distance - 8e-3) > 2e-4  # circles are polygons
    assert ((_windings(outline, at) > 0) == (distance < 8e-3))[clear].all()
    assert 500 < (distance[clear] < 8e-3).sum() < 3500


def _windings(outline: np.ndarray, at: np.ndarray) -> np.ndarray:
    """How often closed polygons, with gaps between them, wind round points."""
    ends = np.flatnonzero(np.isnan(outline[:, 0]))
    found = np.zeros(len(at))
    for polygon in np.split(outline, ends + 1)[:-1]:
        v = polygon[:-1] - at[:, None]
        angle = np.arctan2(v[..., 1], v[..., 0])
        turn = (np.diff(angle, axis=1) + np.pi) % (2 * np.pi) - np.pi
        found += turn.sum(axis=1) / (2 * np.pi)
    return np.round(found)


def test_the_tolerance_is_that_of_zones_and_segments() -> None:
    path = Path.from_segments(
        [
            Line(start=(0, 0), end=(0.1, 0)),
            Line(start=(0.1, 0), end=(0.1, 0.1), demand=Demand(tolerance=1e-3)),
        ]
    )
    whole = np.array([[0, 0], [path.length, path.length]])
    shaped = ShapedPath(
        segments=path.segments,
        objective=path,
        places=whole,
        tolerance=5e-3,
        line_tolerance=2e-3,
        zone=0.02,
        outcome=Outcome(start="stops", durations={"stops": 1.0, "shaped": 1.0}),
    )
    places, radius = tube_pieces(shaped)
    assert places.tolist() == pytest.approx([0.0, 0.08, 0.1, 0.12, 0.2])
    assert radius.tolist() == [2e-3, 5e-3, 1e-3, 1e-3]


def test_a_path_in_space_and_one_that_stops_everywhere() -> None:
    one = {key: x for key, x in UR.items() if key != "experiment"} | {"runs": {"one": {}}}
    study = study_of_shaped(parse_job(yaml.safe_dump(one)), 1e-3)
    section = sections.shaping(study)
    assert section is not None
    ((_, (enlarged, motion)),) = section.choices
    (shaped,) = traces(enlarged, "shaped path")
    path = shaped_path(study)
    miss = path.project(path.objective.vertices[1:2]).distance[0]
    # The corner stands in the origin of its own plane.
    assert np.hypot(shaped.x, shaped.y).min() == pytest.approx(miss * 1e3, rel=2e-2)
    (off, _) = traces(motion, "shaped path")
    assert min(off.y) >= 0 and max(off.y) < 1
    result = study.runs["one"]
    still = ac.shape(path.objective, study.job.arm, result.run.limits, tolerance=0.0)
    (contour,) = result.path.contours
    program = dataclasses.replace(result.path, moves=(dataclasses.replace(contour, path=still),))
    stopped = dataclasses.replace(result, path=program)
    section = sections.shaping(Study(job=study.job, runs={"one": stopped}))
    assert section is not None
    ((_, (motion,)),) = section.choices
    assert section.tables[0].rows[0][-1] == "0.0000"
    assert section.notes == (f"run one: {still.outcome.note}.",)


def test_contours_that_gain_most_come_first(tmp_path: FilePath) -> None:
    file = tmp_path / "program.ngc"
    file.write_text(GCODE, encoding="utf-8")
    study = study_of_shaped(read_cell("pmk3s", file), 1e-3)
    (result,) = study.runs.values()
    page, section = render_report(study), sections.shaping(study)
    assert section is not None
    assert [x for x, _ in section.choices] == ["contour 1, line 4", "contour 2, line 10"]
    assert page.count("<option>") == 2 and page.count('<div class="figures choice" hidden>') == 1
    moves = tuple(
        _with_gain(x, i) if isinstance(x, Contour) else x for i, x in enumerate(result.path.moves)
    )
    program = dataclasses.replace(result.path, moves=moves)
    section = sections.shaping(
        Study(job=study.job, runs={"one": dataclasses.replace(result, path=program)})
    )
    assert section is not None
    assert [x for x, _ in section.choices] == ["contour 2, line 10", "contour 1, line 4"]
    assert [x[0] for x in section.tables[0].rows] == [x for x, _ in section.choices]


def _with_gain(contour: Contour, seconds: float) -> Contour:
    """The contour as if its shape had gained some seconds."""
    assert isinstance(contour.path, ShapedPath)
    outcome = Outcome(start="arcs", durations={"arcs": 9.0, "shaped": 9.0 - seconds})
    return dataclasses.replace(contour, path=dataclasses.replace(contour.path, outcome=outcome))
