"""What takes longer than a preview."""

import zipfile
from io import BytesIO

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour.io import parse_job
from armcontour.jobs import run, teach
from armcontour.studio.tasks import OTHER_CONFIGURATION, TASKS, do, work
from armcontour.studio.wire import Frame

GASKET = """
name: gasket
arm: {name: ur5e, work: {position: [400 mm, -100 mm, 100 mm]}}
path:
  file: gasket.dxf
  names: [handle 31, handle 33]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 0.2 m/s}
corners: {tolerance: 0.5 mm}
servo: {kp: 25, kv: 150}
command_interval: 8 ms
runs: {cut: {}}
"""


def quiet(step):
    """Hears nothing."""


def ask(task, data, run, drawings, **options):
    text = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
    request = {"text": text, "folder": str(drawings), "run": run, "options": options}
    return do(task, request, quiet)


@pytest.fixture(scope="module")
def drawings():
    from pathlib import Path

    return Path(__file__).parents[2] / "examples" / "drawings"


@pytest.fixture
def coarse(paper):
    """The paper's job with fewer set-points and runs."""
    for key in ("experiment", "published"):
        del paper[key]
    paper["runs"] = {x: paper["runs"][x] for x in ("uncompensated", "optimal")}
    for x in paper["runs"].values():
        x["command_interval"] = "2 ms"
    return paper


@pytest.fixture
def short(coarse):
    """The same with a short path."""
    return coarse | {"path": {"points": [[0.35, 0.1], [0.37, 0.12], [0.36, 0.13]]}}


@pytest.fixture
def line(square):
    """The square's job with a short line."""
    return square | {"path": square["path"] | {"points": [[0, 0, 0], [0.01, 0, 0]]}}


class TestFigures:
    @pytest.mark.parametrize("which", ["coarse", "square", "gasket"])
    def test_they_are_those_of_a_run_of_the_saved_job(self, which, drawings, request):
        data = GASKET if which == "gasket" else request.getfixturevalue(which)
        text = data if isinstance(data, str) else yaml.safe_dump(data, sort_keys=False)
        study = run(parse_job(text, folder=drawings))
        for name, result in study.runs.items():
            found, e = ask("figures", text, name, drawings).header, result.evaluation
            for key, value in (
                ("duration", e.duration),
                ("settled", e.settled),
                ("rms", e.contour_error.rms),
                ("max", e.contour_error.max),
                ("objective_max", e.objective_error.max),
                ("missed", e.missed.max),
            ):
                assert found[key] == pytest.approx(value, abs=1e-9), key
            assert found["warnings"] == result.warnings
            executed = result.execution
            held = zip(executed.arm.joint_names, executed.saturated_time.tolist(), strict=True)
            told = [(x["joint"], x["time"]) for x in found["saturated"]]
            assert told == [x for x in held if x[1] > 0]
            if result.clearance is not None:
                least = result.clearance.least
                assert found["clearance"]["least"] == pytest.approx(least.high, abs=1e-9)

    def test_a_collision_is_a_refusal_where_it_is(self, square, drawings):
        box = {"name": "post", "size": [0.02, 0.02, 0.1], "at": [0.1, 0.1, 0.0]}
        square["scene"] = {"boxes": [box | {"fixed_to": "part"}]}
        square["start"] = [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
        frame = ask("figures", square, "optimal", drawings)
        assert (frame.kind, frame.header["tier"]) == ("refusal", 3)
        assert frame.header["error"] == "Collision" and frame.header["exit"] == 8
        assert "post" in frame.header["sentence"]
        assert abs(frame.header["at"]["uv"] - np.array([0.1, 0.1])).max() < 0.02
        assert frame.header["at"]["t"] >= 0

    def test_data_that_make_no_job_are_refused(self, square, drawings):
        del square["servo"]
        frame = ask("figures", square, "optimal", drawings)
        assert frame.kind == "refusal" and "servo" in frame.header["sentence"]

    def test_another_configuration_is_said(self, line, drawings):
        start = np.array(ask("figures", line, "optimal", drawings).header["start"])
        for more, says in ((0.0, False), (0.5, True)):
            found = ask("figures", line, "optimal", drawings, start=(start + more).tolist())
            assert (OTHER_CONFIGURATION in found.header["notes"]) is says


class TestAnswers:
    def test_a_check_has_a_row_per_limit(self, coarse, drawings):
        found = ask("check", coarse, "optimal", drawings).header
        assert found["verdict"] == "kept" and found["sentence"].startswith("All limits are kept.")
        rows = {x["limit"]: x for x in found["rows"]}
        assert rows["speed"]["ratio"] == pytest.approx(1, abs=1e-6)
        assert rows["speed"]["unit"] == "m/s"

    def test_a_sweep_is_the_duration_over_a_key(self, coarse, drawings):
        speeds = [0.05, 0.1, 0.15]
        found = ask("sweep", coarse, "optimal", drawings, key="limits.speed", values=speeds)
        for speed, duration in zip(speeds, found.arrays["duration"], strict=True):
            data = coarse | {"limits": coarse["limits"] | {"speed": speed}}
            job = parse_job(yaml.safe_dump(data))
            planned = teach(job)["optimal"].trajectory
            assert duration == pytest.approx(planned.duration, abs=1e-9)
        assert (found.arrays["rms"] > 0).all() and found.header["refusals"] == [None] * 3

    def test_values_of_a_sweep_that_are_refused_are_not_numbers(self, coarse, drawings):
        options = {"key": "corners.tolerance", "min": -1e-3, "max": 1e-3, "count": 2}
        found = ask("sweep", coarse, "optimal", drawings, **options)
        assert np.isnan(found.arrays["duration"]).tolist() == [True, False]
        assert "tolerance" in found.header["refusals"][0]

    def test_a_place_that_is_better_is_found_in_the_plane(self, coarse, drawings):
        over = {"x": [-0.02, 0.02, 3], "y": [-0.02, 0.02, 3]}
        found = ask("place", coarse, "optimal", drawings, over=over, refined=False)
        assert found.arrays["by"].shape == (9, 2)
        durations = found.arrays["duration"]
        best = int(np.nanargmin(durations))
        by = found.header["best"]["by"]
        np.testing.assert_allclose(by, found.arrays["by"][best])
        frame = {"position": [float(by[0]), float(by[1]), 0.0]}
        moved = coarse | {"path": coarse["path"] | {"frame": frame}}
        taught = teach(parse_job(yaml.safe_dump(moved)))["optimal"]
        assert taught.trajectory.duration == pytest.approx(durations[best], rel=1e-4)

    def test_clearance_over_time_is_not_below_what_is_proven(self, square, drawings):
        found = ask("clearance", square, "optimal", drawings)
        assert found.header["kept"]
        least = min(x["least"] for x in found.header["nearest"])
        assert found.header["kinds"] == ["own"]
        assert found.arrays["own"].min() >= least - 1e-3

    def test_an_unknown_task_is_refused(self, coarse, drawings):
        frame = Frame.unpack(work(("a", "bake", {"text": ""}), lambda data: None))
        assert frame.kind == "failed" and frame.header["id"] == "a"
        assert frame.header["sentence"].startswith("There is no task 'bake': there are figures, ")


class TestFiles:
    @pytest.mark.parametrize(
        ("options", "ending", "begins"),
        [
            ({"format": "csv"}, ".csv", b"t [s],q"),
            ({"format": "csv", "of": "planned", "period": 0.01}, ".csv", b"t [s],q"),
            ({"format": "npz"}, ".npz", b"PK"),
            ({"format": "parquet"}, ".parquet", b"PAR1"),
            ({"format": "ros-yaml"}, ".yaml", b""),
            ({"format": "mcap"}, ".mcap.zip", b"PK"),
            ({"format": "urscript"}, ".script", b""),
            ({"format": "template", "template": "kuka"}, ".src", b""),
            ({"format": "template", "template": "abb"}, ".mod", b"MODULE"),
        ],
    )
    def test_every_format_is_exported(self, line, drawings, options, ending, begins):
        found = ask("export", line, "optimal", drawings, **options)
        content = found.arrays["content"].tobytes()
        assert found.header["name"] == f"square-optimal{ending}"
        assert found.header["bytes"] == len(content) > 100
        assert begins in content[:100]

    def test_a_bag_is_an_archive_of_its_folder(self, line, drawings):
        found = ask("export", line, "optimal", drawings, format="mcap")
        with zipfile.ZipFile(BytesIO(found.arrays["content"].tobytes())) as archive:
            assert any(x.endswith(".mcap") for x in archive.namelist())

    def test_files_of_templates_are_not_read(self, line, drawings):
        with pytest.raises(ac.InvalidInput, match="There is no template '/etc/passwd'"):
            ask("export", line, "optimal", drawings, format="template", template="/etc/passwd")

    def test_a_report_is_a_page(self, short, drawings):
        found = ask("report", short, "optimal", drawings)
        assert found.header["type"] == "text/html"
        assert b"optimal" in found.arrays["content"].tobytes()

    def test_a_certificate_has_a_report(self, short, drawings):
        found = ask("certify", short, "optimal", drawings, tolerance=5.5e-3)
        assert found.header["sentence"].startswith("Certified: ")
        assert found.header["left"] >= 0
        assert found.header["name"] == "paper-certificate.html"

    def test_learning_tells_what_it_would_gain(self, short, drawings):
        found = ask("learn", short, "optimal", drawings, runs=1, seed=1)
        assert found.header["rms"][1] < found.header["rms"][0]
        assert "simulated runs" in found.header["sentence"]


def test_the_plan_of_a_full_run_has_a_picture(coarse, drawings):
    found = ask("plan", coarse, "optimal", drawings)
    assert found.kind == "picture" and found.header["planned"]
    assert set(TASKS) >= {"figures", "check", "certify", "sweep", "place", "learn", "export"}
