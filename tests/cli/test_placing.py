"""The command `place`, and command lines that once failed."""

import re

import pytest
from tests.cli.helpers import summary

from armcontour.core.render import number

JOB = """\
name: corner
arm: pmk3s
path: {file: part.svg, units: mm, frame: {position: [0.3, 0.2, 0]}}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}  # stays
runs: {only: {compensation: {method: pole_placement}}}
"""
PART = """<svg xmlns="http://www.w3.org/2000/svg" width="50mm" height="50mm" viewBox="0 0 50 50">
<path d="M0 0 L40 0 L40 30" fill="none"/></svg>"""
GRID = ("--x", "-30 mm .. 30 mm, 3", "--yaw", "0 deg .. 30 deg, 2")


@pytest.fixture
def job(tmp_path):
    (tmp_path / "part.svg").write_text(PART, encoding="utf-8")
    file = tmp_path / "job.yaml"
    file.write_text(JOB, encoding="utf-8")
    return file


@pytest.fixture
def placed(done, tmp_path):
    """Place and run the job of the answer: output, summary, page, text of the job."""

    def call(*arguments, out="placed"):
        folder = tmp_path / out
        shown = done("place", *arguments, "--out", folder)
        data = summary(folder)
        ran = done("run", folder / "job.yaml", "--no-simulation", "--out", folder / "run")
        assert number(data["best"]["duration"], "s") in ran
        text = (folder / "job.yaml").read_text(encoding="utf-8")
        return shown, data, (folder / "report.html").read_text(encoding="utf-8"), text

    return call


def test_place_writes_a_map_and_a_table_and_a_valid_job(job, tmp_path, placed):
    shown, data, page, text = placed(job, *GRID)
    assert data["places"] == 6 and number(data["best"]["duration"], "s") in shown
    assert number(data["own_place"]["duration"], "s") in shown
    assert set(data["files"]) == {"report.html", "placement.csv", "job.yaml", "summary.json"}
    assert data["axes"]["x"] == [-0.03, 0.0, 0.03]
    best = f": {number(data['best']['duration'], 's')}"
    cells = re.findall("<g><title>(.*?)</title><rect", page)
    assert len(cells) == 6 and sum(x.endswith(best) for x in cells) == 1
    assert "# stays" in text and "../part.svg" in text
    # A drawing in a cell.
    drawn = (tmp_path / "part.svg", "--cell", job, "--speed", "0.1 m/s")
    *_, text = placed(*drawn, "--x", "0 mm .. 30 mm, 2", out="drawn")
    assert "name: part" in text and "speed: 0.1" in text


def test_a_placement_grid_out_of_reach_has_a_map_and_an_exit_code(job, tmp_path, command):
    ended = command("place", job, "--x", "1 m .. 2 m, 2", "--out", tmp_path / "far")
    assert ended.code == 1 and "No position of the grid is feasible." in ended.out
    data = summary(tmp_path / "far")
    assert data["refused"] == {"reach": 2} and "job.yaml" not in data["files"]
    page = (tmp_path / "far" / "report.html").read_text(encoding="utf-8")
    assert "out of reach" in page and "No place is feasible" in page


def test_wrong_options_of_place_write_nothing(job, tmp_path, refused):
    rows = [
        ((), ["place requires an axis of the grid"]),
        (("--x", "x"), ["--x requires a range", "such as '-300 mm"]),
        (("--x", "0 mm, 2"), ["--x requires a range", "such as '-300 mm"]),
        (("--x", "0 mm .. 1 mm, 0"), ["--x requires a range and a number"]),
        (("--x", "0 mm .. 1, 2"), ["--x requires a unit"]),
        (("--yaw", "0 .. 10 mm, 2"), ["--yaw: "]),
        ((*GRID, "--move", "table"), ["move must be one of part, base"]),
    ]
    assert refused(tmp_path, rows, begin=("place", job, "--out", "no")) == []
