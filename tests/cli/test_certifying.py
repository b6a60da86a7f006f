"""`armcontour certify` and `armcontour sweep`."""

import json
from pathlib import Path as FilePath

import pytest
from soak.corner_job import CORNER_JOB


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    file = tmp_path_factory.mktemp("job") / "corner.yaml"
    file.write_text(CORNER_JOB, encoding="utf-8")
    return file


def test_certify_writes_everything_that_repeats_it(command, job, tmp_path):
    out = tmp_path / "certified"
    code, shown, errors = command("certify", job, "--out", out)
    assert code == 0, errors
    assert "Holds for: independent joint servos" in shown and "rounding" in shown
    assert "Valid for independent joint servos only: " in shown
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    written = {str(x.relative_to(out)) for x in out.rglob("*") if x.is_file()}
    assert set(data["files"]) == written - {".armcontour.json"}
    assert data["certificate"]["repeat"]["derating"] == "derating.csv"
    assert data["certificate"]["budget"]["total"] <= 2.1e-3
    assert data["runs"]["only"]["contour_error"]["max"] <= 1e-4
    assert 'id="certificate"' in (out / "report.html").read_text(encoding="utf-8")
    code, _, errors = command("certify", job, "--out", out)
    assert code == 2 and "--force" in errors


def test_options_take_the_place_of_the_jobs_keys(command, job):
    code, shown, errors = command("certify", job, "--servo", "0.05 mm", "--json")
    assert code == 0, errors
    assert json.loads(shown)["certificate"]["goal"]["servo"] == 5e-5
    code, _, errors = command("certify", job, "--servo", "5 kg")
    assert code == 2 and "--servo" in errors
    for option in ("--servo", "--total-tolerance"):
        code, _, errors = command("certify", job, option, "-0.5 mm")
        assert code == 2 and errors == f"Error: {option}: must be above zero, but is -0.5 mm.\n"
    code, _, errors = command("certify", job, "--plant", "robot")
    assert code == 2 and "plant must be one of" in errors and "rigid_body" in errors
    code, _, errors = command("certify", job, "--plant", "rigid_body")
    assert code == 2 and "saturation" in errors


def test_a_refusal_has_its_exit_code_and_writes_nothing(command, job, tmp_path):
    out = tmp_path / "certified"
    file = tmp_path / "slow.yaml"
    text = CORNER_JOB.replace("pole_placement", "none").replace("0.1 mm", "1 um, slowest: 1.1")
    file.write_text(text, encoding="utf-8")
    code, shown, errors = command("certify", file, "--out", out)
    assert code == 4
    assert errors.startswith("Error: ") and "contour error comes down to" in errors
    assert not out.exists()


def test_a_drawing_of_many_contours_is_certified_in_one_command(command, tmp_path):
    out = tmp_path / "gasket"
    drawing = FilePath(__file__).parents[2] / "examples" / "drawings" / "gasket.dxf"
    # One contour of each kind; `python -m soak.certificates` certifies the drawings as they are.
    some = [x for name in ("31", "34", "38", "3A") for x in ("--contour", f"handle {name}")]
    given = ("--cell", "pmk3s", "--servo", "0.1 mm", *some)
    code, shown, errors = command("certify", drawing, *given, "--out", out)
    assert code == 0, errors
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    found, run = data["certificate"], data["runs"]["taught"]
    assert len(found["contours"]) == 4 and "whole program" in shown
    moves = [x for x in run["moves"] if x["kind"] == "contour"]
    for x, row in zip(found["contours"], moves, strict=True):
        assert x["name"] in shown
        assert x["contour_error"]["max"] == row["contour_error"]["max"] <= 1e-4
        # The larger one of the contour error and of what the tool leaves out of the path.
        executed = sum(x["budget"][part] for part in ("servo", "sampling", "box"))
        assert x["contour_error"]["max"] <= executed * (1 + 1e-9) < 1e-6
        assert x["budget"]["left"] == pytest.approx(1e-4 - executed, rel=1e-9)
    assert max(run["demand_ratio"]) <= 1 + 1e-6 and not any(run["saturated"])
    # 1 % at most, of which rapids take most.
    assert 0 < found["cost"] < 0.01 * found["duration"]


def test_a_drawing_needs_what_is_to_be_held(command):
    drawing = FilePath(__file__).parents[2] / "examples" / "drawings" / "gasket.dxf"
    code, _, errors = command("certify", drawing, "--cell", "pmk3s")
    assert code == 2 and "needs a tolerance" in errors
    code, _, errors = command("certify", drawing, "--servo", "0.1 mm")
    assert code == 2 and "--cell" in errors


def test_what_a_run_of_a_program_writes_can_be_checked(command, tmp_path):
    points = "contour,x [mm],y [mm]\na,0,0\na,30,0\nb,30,30\nb,0,30\n"
    (tmp_path / "parts.csv").write_text(points, encoding="utf-8")
    text = CORNER_JOB.replace(
        "path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}",
        "path: {file: parts.csv, frame: {position: [0.3, 0.1, 0]}}\n"
        "process: {lead_in: {length: 3 mm}, lead_out: {length: 3 mm}}",
    )
    job, out = tmp_path / "parts.yaml", tmp_path / "out"
    job.write_text(text, encoding="utf-8")
    code, _, errors = command("run", job, "--out", out, "--no-simulation")
    assert code == 0, errors
    motion = out / "only" / "planned.csv"
    code, shown, errors = command("check", motion, "--path", job, "--json")
    assert code == 0, errors
    found = json.loads(shown)
    assert found["path_deviation"]["distance"] < 1e-6
    # Without its last contour the motion is not that of the job.
    rows = motion.read_text(encoding="utf-8").splitlines(keepends=True)
    motion.write_text("".join(rows[: 2 * len(rows) // 3]), encoding="utf-8")
    code, _, errors = command("check", motion, "--path", job)
    assert code == 2 and "contour b" in errors


def test_sweep_writes_its_points_and_their_plot(command, job, tmp_path):
    out = tmp_path / "swept"
    asked = ("--tolerances", "2 mm", "--speeds", "50 mm/s, 0.15 m/s")
    code, _, errors = command("sweep", job, "--out", out, *asked)
    assert code == 0, errors
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert [x["speed"] for x in data["speeds"]] == [pytest.approx(0.05), 0.15]
    assert [x["tolerance"] for x in data["tolerances"]] == [2e-3]
    assert all(x["duration"] is not None for x in data["speeds"])
    assert 'id="sweep"' in (out / "report.html").read_text(encoding="utf-8")
    code, _, errors = command("sweep", job, "--out", tmp_path / "no", "--speeds", "0.1 m/s, fast")
    assert code == 2 and "--speeds" in errors


def test_sweep_compares_arcs_and_shapes(command, job, tmp_path):
    out = tmp_path / "swept"
    free = ("--corner-shape", "free", "--iterations", "2", "--tolerances", "2 mm")
    code, shown, errors = command("sweep", job, "--out", out, *free, "--speeds", "0.15 m/s")
    assert code == 0, errors
    assert "arc" in shown and "free" in shown and "at most 2 iterations per point" in shown
    header, *rows = (out / "sweep.csv").read_text(encoding="utf-8").splitlines()
    assert header.startswith("line,shape,tolerance [m],speed [m/s],optimum [s],certified [s]")
    assert [x.split(",")[:2] for x in rows] == [
        ["tolerance", "arc"], ["tolerance", "free"], ["speed", "free"]
    ]  # fmt: skip
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "arcs, certified" in page and "shaped, certified" in page
    code, _, errors = command("sweep", job, "--out", tmp_path / "no", "--shapes", "arc, round")
    assert code == 2 and "must be one of arc, free, not 'round'" in errors
