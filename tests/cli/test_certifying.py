"""The command `certify`: its files and its refusals."""

import json
from functools import reduce
from operator import getitem

import pytest
from tests.cli.helpers import summary
from tests.corner_job import CORNER_JOB

from armcontour.core.render import number


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    file = tmp_path_factory.mktemp("job") / "corner.yaml"
    file.write_text(CORNER_JOB, encoding="utf-8")
    return file


def test_certify_writes_all_files_that_reproduce_its_result(command, job, tmp_path, done):
    out = tmp_path / "certified"
    shown = done("certify", job, "--out", out)
    data = summary(out)
    assert "independent joint servos" in shown
    page = (out / "report.html").read_text(encoding="utf-8")
    for name in ("off_drawing", "duration", "cost", "budget.left", "budget.executed"):
        value = reduce(getitem, name.split("."), data["certificate"])
        figure = number(value, data["units"][name])
        # On pages, small lengths have three decimals, as the tiny ones beside them.
        small = figure.endswith(" mm") and abs(value) < 1e-5
        on_page = f"{1e3 * value:.3f} mm" if small else figure
        assert figure in shown and on_page in page
    written = {str(x.relative_to(out)) for x in out.rglob("*") if x.is_file()}
    assert set(data["files"]) == written - {".armcontour.json"}
    assert data["certificate"]["budget"]["total"] <= 2.1e-3
    assert data["runs"]["only"]["contour_error"]["max"] <= 1e-4
    assert 'id="certificate"' in page
    code, _, errors = command("certify", job, "--out", out)
    assert code == 2 and "--force" in errors


def test_a_refused_certificate_has_an_exit_code_and_writes_nothing(job, refused, tmp_path):
    text = CORNER_JOB.replace("pole_placement", "none").replace("0.1 mm", "0.01 um")
    (tmp_path / "slow.yaml").write_text(text, encoding="utf-8")
    rows = [("certify slow.yaml --out certified", ["largest contour error must be"])]
    assert refused(tmp_path, rows, codes=(4,)) == []


def test_the_written_joint_positions_of_a_certificate_can_be_checked(command, tmp_path, done):
    points = "contour,x [mm],y [mm]\na,0,0\na,30,0\nb,30,30\nb,0,30\n"
    (tmp_path / "parts.csv").write_text(points, encoding="utf-8")
    text = CORNER_JOB.replace(
        "path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.24]]}",
        "path: {file: parts.csv, frame: {position: [0.3, 0.1, 0]}}\n"
        "process: {lead_in: {length: 3 mm}, lead_out: {length: 3 mm}}",
    )
    job = tmp_path / "parts.yaml"
    out = tmp_path / "out"
    job.write_text(text, encoding="utf-8")
    done("run", job, "--out", out, "--no-simulation")
    motion = out / "only" / "planned.csv"
    # Samples of several moves show the limits of the joints only.
    code, shown, _ = command("check", motion, "--path", job, "--json")
    data = json.loads(shown)
    assert code == 7 and data["verdict"] == "cannot tell" and "speed" in data["missing"]
    assert all(x["name"].startswith("joint_") for x in data["limits"])
