"""The command `place`, and command lines that once went wrong."""

import pytest
from tests.cli.helpers import summary

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
ASKED = """\
placement:
  over:
    x: {from: -30 mm, to: 30 mm, places: 3}  # of the table
    yaw: {from: 0 deg, to: 30 deg, places: 2}
  uncertainty: {x: 1 mm}
  refine: false
  run: only
"""
OVER = ("--over", "x: -30 mm .. 30 mm, 3", "--over", "yaw: 0 deg .. 30 deg, 2")


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
        assert f"{data['best']['duration']:.4f} s" in ran
        text = (folder / "job.yaml").read_text(encoding="utf-8")
        return shown, data, (folder / "report.html").read_text(encoding="utf-8"), text

    return call


def test_place_writes_maps_a_table_and_a_job_that_runs(job, tmp_path, placed, done):
    shown, data, page, text = placed(job, *OVER)
    assert data["places"] == 6 and f"{data['best']['duration']:.4f} s" in shown
    assert f"{data['own_place']['duration']:.4f} s" in shown
    assert set(data["files"]) == {"report.html", "placement.csv", "job.yaml", "summary.json"}
    assert 'id="placement"' in page and "Places by motion" in page
    assert "# stays" in text and "../part.svg" in text
    # A drawing in a cell.
    drawn = (tmp_path / "part.svg", "--cell", job, "--speed", "0.1 m/s", "--no-refine")
    *_, text = placed(*drawn, "--over", "x: 0 mm .. 30 mm, 2", out="drawn")
    assert "name: part" in text and "speed: 0.1" in text
    # The cell holds the question.
    job.write_text(JOB + ASKED, encoding="utf-8")
    done("place", tmp_path / "part.svg", "--cell", job, "--out", tmp_path / "asked")
    text = (tmp_path / "asked" / "job.yaml").read_text(encoding="utf-8")
    assert summary(tmp_path / "asked")["places"] == 6 and "placement:" not in text


def test_wrong_options_write_nothing(job, tmp_path, refused):
    rows = [
        ((), ["place requires --over for each axis"]),
        (("--over", "x"), ["--over requires", "such as 'x: -300 mm"]),
        (("--over", "x: 0 mm, 2"), ["--over requires", "such as 'x: -300 mm"]),
        (("--over", "w: 0 mm .. 1 mm, 2"), ["--over: ", "unknown key placement.over.w"]),
        (("--over", "x: 0 mm .. 1, 2"), ["--over: ", "'1' has no unit"]),
        (("--over", "yaw: 0 .. 10 mm, 2"), ["--over: ", "placement.over.yaw.to"]),
        (("--over", "x: 1 mm .. 0 mm, 2"), ["placement", "range of x", "is empty"]),
        ((*OVER, *OVER), ["--over specifies 'x' twice"]),
        ((*OVER, "--uncertainty", "x"), ["--uncertainty requires", "such as 'x: 2 mm'"]),
    ]
    assert refused(tmp_path, rows, begin=("place", job, "--out", "no")) == []


SPACE = """\
name: line
arm: ur5e  # or another
path:
  points: [[0.5, 0.0, 0.2], [0.56, 0.0, 0.2]]
  orientation: {quaternion: [1, 0, 0, 0]}
limits: {speed: 0.25 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {compensated: {compensation: {method: inverse}}}
"""


def test_the_job_holds_the_question_and_options_replace_its_keys(job, tmp_path, done):
    (tmp_path / "asked.yaml").write_text(JOB + ASKED, encoding="utf-8")
    summaries = {}
    for name, file, options in (
        ("own", "asked.yaml", ()),
        ("options", "job.yaml", (*OVER, "--uncertainty", "x: 1 mm", "--no-refine")),
        ("one", "asked.yaml", ("--over", "x: 0 mm .. 0 mm, 1", "--uncertainty", "x: 0 mm")),
        ("other", "asked.yaml", ("--objective", "manipulability", "--refine")),
    ):
        out = tmp_path / name
        done("place", tmp_path / file, "--out", out, *options)
        summaries[name] = summary(out)
        summaries[name].pop("armcontour")
    assert summaries["own"] == summaries["options"]
    assert [(x["name"], x["places"]) for x in summaries["one"]["axes"]] == [("x", 1), ("yaw", 2)]
    assert summaries["one"]["uncertainty"] == {} and summaries["own"]["uncertainty"] == {"x": 1e-3}
    assert summaries["other"]["objective"] == "manipulability" and summaries["other"]["places"] == 6
    # The answer is the job in that place, which asks no more.
    text = (tmp_path / "own" / "job.yaml").read_text(encoding="utf-8")
    assert "placement:" not in text and "# stays" in text
