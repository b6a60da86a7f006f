"""`armcontour certify`."""

import json
from functools import reduce
from operator import getitem
from pathlib import Path as FilePath

import pytest
from tests.cli.helpers import summary
from tests.corner_job import CORNER_JOB

from armcontour.core.render import number

GASKET = FilePath(__file__).parents[2] / "examples" / "drawings" / "gasket.dxf"


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    file = tmp_path_factory.mktemp("job") / "corner.yaml"
    file.write_text(CORNER_JOB, encoding="utf-8")
    return file


def test_certify_writes_everything_that_repeats_it(command, job, tmp_path, done):
    out = tmp_path / "certified"
    shown = done("certify", job, "--out", out)
    data = summary(out)
    assert "independent joint servos" in shown
    page = (out / "report.html").read_text(encoding="utf-8")
    for name in ("off_drawing", "duration", "cost", "budget.left", "budget.executed"):
        value = reduce(getitem, name.split("."), data["certificate"])
        figure = number(value, data["units"][name])
        assert figure in shown and figure in page
    written = {str(x.relative_to(out)) for x in out.rglob("*") if x.is_file()}
    assert set(data["files"]) == written - {".armcontour.json"}
    assert data["certificate"]["repeat"]["derating"] == "derating.csv"
    assert data["certificate"]["budget"]["total"] <= 2.1e-3
    assert data["runs"]["only"]["contour_error"]["max"] <= 1e-4
    assert 'id="certificate"' in page
    code, _, errors = command("certify", job, "--out", out)
    assert code == 2 and "--force" in errors


def test_options_replace_the_keys_of_the_job(job, refused, tmp_path, done):
    shown = done("certify", job, "--servo-error", "0.05 mm", "--json")
    assert json.loads(shown)["certificate"]["goal"]["servo_error"] == 5e-5
    rows = [
        (("--servo-error", "5 kg"), ["--servo-error"]),
        (
            ("--servo-error", "-0.5 mm"),
            ["--servo-error: ", "certificate.servo_error: must be above zero, but is -0.5 mm."],
        ),
    ]
    assert refused(tmp_path, rows, codes=(2,), begin=("certify", job)) == []
    rows = [
        (("certify", GASKET, "--cell", "pmk3s"), ["requires a tolerance"]),
        (("certify", GASKET, "--servo-error", "0.1 mm"), ["--cell"]),
    ]
    assert refused(tmp_path, rows, codes=(2,)) == []


def test_a_refusal_has_its_exit_code_and_writes_nothing(job, refused, tmp_path):
    text = CORNER_JOB.replace("pole_placement", "none").replace("0.1 mm", "0.01 um")
    (tmp_path / "slow.yaml").write_text(text, encoding="utf-8")
    rows = [("certify slow.yaml --out certified", ["largest contour error must be"])]
    assert refused(tmp_path, rows, codes=(4,)) == []


def test_a_drawing_of_several_contours_is_certified_in_one_command(tmp_path, done):
    out = tmp_path / "gasket"
    # A line and an arc; `python -m soak certificates` certifies the drawings as they are.
    some = [x for name in ("31", "3A") for x in ("--contour", f"handle {name}")]
    options = ("--cell", "pmk3s", "--servo-error", "0.1 mm", *some)
    shown = done("certify", GASKET, *options, "--out", out)
    data = summary(out)
    certificate, run = data["certificate"], data["runs"]["compensated"]
    assert len(certificate["contours"]) == 2
    moves = [x for x in run["moves"] if x["kind"] == "contour"]
    for x, row in zip(certificate["contours"], moves, strict=True):
        assert x["name"] in shown
        assert x["contour_error"]["max"] == row["contour_error"]["max"] <= 1e-4
        # The larger one of the contour error and of what the tool leaves out of the path.
        executed = sum(x["budget"][part] for part in ("servo", "sampling", "box"))
        assert x["contour_error"]["max"] <= executed * (1 + 1e-9) < 1e-6
        assert x["budget"]["left"] == pytest.approx(1e-4 - executed, rel=1e-9)
    assert max(run["demand_ratio"]) <= 1 + 1e-6 and not any(run["saturated"])
    # 1 % at most, of which rapids take most.
    assert 0 < certificate["cost"] < 0.01 * certificate["duration"]


def test_the_motion_of_a_program_can_be_checked(command, tmp_path, done):
    points = "contour,x [mm],y [mm]\na,0,0\na,30,0\nb,30,30\nb,0,30\n"
    (tmp_path / "parts.csv").write_text(points, encoding="utf-8")
    text = CORNER_JOB.replace(
        "path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}",
        "path: {file: parts.csv, frame: {position: [0.3, 0.1, 0]}}\n"
        "process: {lead_in: {length: 3 mm}, lead_out: {length: 3 mm}}",
    )
    job, out = tmp_path / "parts.yaml", tmp_path / "out"
    job.write_text(text, encoding="utf-8")
    done("run", job, "--out", out, "--no-simulation")
    motion = out / "only" / "planned.csv"
    shown = done("check", motion, "--path", job, "--json")
    assert json.loads(shown)["path_deviation"]["distance"] < 1e-6
    # Without its last contour the motion is not that of the job.
    rows = motion.read_text(encoding="utf-8").splitlines(keepends=True)
    motion.write_text("".join(rows[: 2 * len(rows) // 3]), encoding="utf-8")
    code, _, errors = command("check", motion, "--path", job)
    assert code == 2 and "contour b" in errors
