"""The command `place`."""

import json
from pathlib import Path

import pytest

from armcontour.cli.placing import read_axis
from armcontour.errors import InvalidInput

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
OVER = ("--over", "x: -30 mm .. 30 mm, 3", "--over", "yaw: 0 deg .. 30 deg, 2")


@pytest.fixture
def job(tmp_path: Path) -> Path:
    (tmp_path / "part.svg").write_text(PART, encoding="utf-8")
    file = tmp_path / "job.yaml"
    file.write_text(JOB, encoding="utf-8")
    return file


def test_place_writes_maps_a_table_and_a_job_that_runs(command, job, tmp_path) -> None:
    out = tmp_path / "placed"
    code, shown, errors = command("place", job, "--out", out, *OVER)
    assert code == 0, errors
    assert "6 places" in shown and "best of the grid" in shown
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert set(data["files"]) == {"report.html", "placement.csv", "job.yaml", "summary.json"}
    page = (out / "report.html").read_text(encoding="utf-8")
    assert 'id="placement"' in page and "Places by duration" in page
    text = (out / "job.yaml").read_text(encoding="utf-8")
    assert "# stays" in text and "../part.svg" in text
    code, shown, errors = command(
        "run", out / "job.yaml", "--no-simulation", "--out", tmp_path / "run"
    )
    assert code == 0, errors
    assert f"{data['best']['duration']:.4f} s" in shown


def test_place_takes_a_drawing_and_a_cell(command, job, tmp_path) -> None:
    out = tmp_path / "placed"
    drawn = (tmp_path / "part.svg", "--cell", job, "--speed", "0.1 m/s", "--no-refine")
    code, _, errors = command("place", *drawn, "--out", out, "--over", "x: 0 mm .. 30 mm, 2")
    assert code == 0, errors
    text = (out / "job.yaml").read_text(encoding="utf-8")
    assert "name: part" in text and "speed: 0.1" in text
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    code, shown, errors = command(
        "run", out / "job.yaml", "--no-simulation", "--out", tmp_path / "run"
    )
    assert code == 0, errors
    assert f"{data['best']['duration']:.4f} s" in shown


def test_a_job_without_a_key_for_an_option_is_not_written(command, job, tmp_path) -> None:
    out = tmp_path / "placed"
    options = ("--continuity", "tangent", "--no-refine", "--uncertainty", "x: 2 mm")
    over = ("--over", "x: 0 mm .. 30 mm, 2")
    code, shown, errors = command("place", job, "--out", out, *over, *options)
    assert code == 0, errors
    assert "--continuity is of the runs" in " ".join(shown.split())
    assert not (out / "job.yaml").exists() and (out / "report.html").exists()


def test_an_axis_is_read_with_its_units() -> None:
    assert read_axis("x: -300 mm .. 0.3 m, 25") == ("x", (-0.3, 0.3, 25))
    assert read_axis("yaw:0..1 rad,2") == ("yaw", (0.0, 1.0, 2))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x", "such as 'x: -300 mm"),
        ("x: 0 mm .. 1 mm", "such as 'x: -300 mm"),
        ("x: 0 mm, 3", "such as 'x: -300 mm"),
        ("x: 0 mm .. 1 mm, many", "such as 'x: -300 mm"),
        ("w: 0 mm .. 1 mm, 2", "no axis 'w': axes are x, y, z, yaw, tilt"),
        ("x: 0 mm .. 1, 2", "'1' has no unit"),
        ("yaw: 0 .. 10 mm, 2", "--over yaw"),
    ],
)
def test_wrong_axes_are_refused(text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        read_axis(text)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((), "place needs --over for each axis"),
        (("--over", "x: 1 mm .. 0 mm, 2"), "range of --over x from 1 mm to 0 mm is empty"),
        (("--over", "x: 0 mm .. 1 mm, 0"), "number of places along x"),
        (("--over", "x: 0 mm .. 1 mm, 2", "--over", "x: 0 mm .. 2 mm, 2"), "an axis twice"),
        ((*OVER, "--objective", "beauty"), "objective must be one of"),
        ((*OVER, "--uncertainty", "x"), "such as 'x: 2 mm'"),
        ((*OVER, "--about", "1 mm, 2 mm"), "--about takes 3 values"),
        (("--over", "x: 3 m .. 4 m, 2"), "None of 2 places is feasible"),
    ],
)
def test_wrong_options_write_nothing(command, job, tmp_path, options, words: str) -> None:
    out = tmp_path / "no"
    code, _, errors = command("place", job, "--out", out, *options)
    assert code in (2, 3) and words in " ".join(errors.split())
    assert not out.exists()


SPACE = """\
name: line
arm: ur5e  # or another
path:
  points: [[0.5, 0.0, 0.2], [0.56, 0.0, 0.2]]
  orientation: {quaternion: [1, 0, 0, 0]}
limits: {speed: 0.25 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {taught: {compensation: {method: inverse}}}
"""


def test_arms_and_tools_are_compared(command, tmp_path) -> None:
    job, tools, out = (tmp_path / x for x in ("job.yaml", "tools.yaml", "placed"))
    job.write_text(SPACE, encoding="utf-8")
    tools.write_text("short: [0, 0, 50 mm]\nlong: [0, 0, 900 mm]\n", encoding="utf-8")
    options = ("--over", "z: 0 mm .. 0 mm, 1", "--arms", "ur5e, ur10e", "--tools", tools)
    code, shown, errors = command("place", job, "--out", out, *options, "--no-refine")
    assert code == 0, errors
    assert "Which is enough" in shown and "ur5e, long: The place z 0 mm is refused" in shown
    data = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    known = {x["name"]: x["best"] for x in data["compared"]}
    assert list(known) == ["ur5e, short", "ur5e, long", "ur10e, short", "ur10e, long"]
    assert known["ur5e, long"] is None
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Which is enough" in page
    run = (out / "job.yaml", "--no-simulation", "--out", tmp_path / "run")
    code, shown, errors = command("run", *run)
    assert code == 0, errors
    best = min(x["duration"] for x in known.values() if x is not None)
    assert f"{best:.4f} s" in shown
    code, _, errors = command("place", job, "--out", tmp_path / "no", *options[:2], "--arms", "x9")
    assert code == 2 and "x9" in errors


ASKED = """\
placement:
  over:
    x: {from: -30 mm, to: 30 mm, places: 3}  # of the table
    yaw: {from: 0 deg, to: 30 deg, places: 2}
  uncertainty: {x: 1 mm}
  refine: false
  run: only
"""


def test_the_job_holds_the_question_and_options_replace_its_keys(command, job, tmp_path) -> None:
    (tmp_path / "asked.yaml").write_text(JOB + ASKED, encoding="utf-8")
    found = {}
    for name, file, options in (
        ("own", "asked.yaml", ()),
        ("options", "job.yaml", (*OVER, "--uncertainty", "x: 1 mm", "--no-refine")),
        ("one", "asked.yaml", ("--over", "x: 0 mm .. 0 mm, 1", "--uncertainty", "x: 0 mm")),
        ("other", "asked.yaml", ("--objective", "manipulability", "--refine")),
    ):
        out = tmp_path / name
        code, _, errors = command("place", tmp_path / file, "--out", out, *options)
        assert code == 0, errors
        found[name] = json.loads((out / "summary.json").read_text(encoding="utf-8"))
        found[name].pop("armcontour")
    assert found["own"] == found["options"]
    assert [(x["name"], x["places"]) for x in found["one"]["axes"]] == [("x", 1), ("yaw", 2)]
    assert found["one"]["uncertainty"] == {} and found["own"]["uncertainty"] == {"x": 1e-3}
    assert found["other"]["objective"] == "manipulability" and found["other"]["places"] == 6
    # The answer is the job in that place, which asks no more.
    text = (tmp_path / "own" / "job.yaml").read_text(encoding="utf-8")
    assert "placement:" not in text and "# stays" in text


def test_a_cell_holds_the_question_for_drawings(command, job, tmp_path) -> None:
    job.write_text(JOB + ASKED, encoding="utf-8")
    out = tmp_path / "placed"
    code, shown, errors = command("place", tmp_path / "part.svg", "--cell", job, "--out", out)
    assert code == 0, errors
    assert "6 places" in shown and "placement:" not in (out / "job.yaml").read_text("utf-8")


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("{}", "the key placement.over of the job"),
        ("{objective: torque}", "the key placement.over of the job"),
        ("{over: {w: {from: 0, to: 1, places: 2}}}", "unknown key placement.over.w"),
        ("{over: {x: {from: 0, to: 1}}}", "placement.over.x.places is missing"),
        ("{over: {x: {from: 0, to: 1 deg, places: 2}}}", "placement.over.x.to"),
        ("{over: {x: {from: 1, to: 0, places: 2}}}", "placement: The range of x"),
        ("{over: {x: {from: 0, to: 1, places: 0}}}", "placement.over.x.places"),
        ("{over: {z: {from: 0, to: 1, places: 2}}}", "over has no axis 'z' for an arm in the"),
        ("{uncertainty: {x: -1 mm}}", "placement.uncertainty.x"),
        ("{about: [0, 0]}", "placement.about"),
        (
            "{over: {x: {from: 0, to: 1, places: 2}}, run: other}",
            "placement.run names the run other",
        ),
        ("{move: table}", "placement.move"),
        (
            "{over: {x: {from: 0, to: 0, places: 1}}, "
            "tools: {a: {rpy: [0, 0, 0], quaternion: [0, 0, 0, 1]}}}",
            "job.yaml: placement.tools.a takes either rpy or quaternion",
        ),
        ("{tools: {}}", "placement.tools"),
        ("{arms: []}", "placement.arms"),
        ("{workers: 3}", "unknown key placement.workers"),
    ],
)
def test_a_wrong_question_is_refused_by_its_key(command, job, tmp_path, keys, words: str) -> None:
    job.write_text(f"{JOB}placement: {keys}\n", encoding="utf-8")
    code, _, errors = command("place", job, "--out", tmp_path / "no")
    assert code == 2 and words in " ".join(errors.split())
    assert not (tmp_path / "no").exists()


def test_the_job_names_arms_and_tools_to_compare(command, tmp_path) -> None:
    mine = "name: mine\nkind: derived\nsource: a test\narm: {name: ur5e}\n"
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "mine.yaml").write_text(mine, encoding="utf-8")
    job = tmp_path / "cell" / "job.yaml"
    asked = """\
placement:
  over: {z: {from: 0, to: 0, places: 1}}
  refine: false
  arms: [ur10e, mine.yaml]
  tools: {short: [0, 0, 50 mm], turned: {position: [0, 0, 50 mm], rpy: [0, 0, 90 deg]}}
"""
    job.write_text(SPACE + asked, encoding="utf-8")
    code, shown, errors = command("place", job, "--out", tmp_path / "placed")
    assert code == 0, errors
    data = json.loads((tmp_path / "placed" / "summary.json").read_text(encoding="utf-8"))
    names = ["ur10e, short", "ur10e, turned", "mine.yaml, short", "mine.yaml, turned"]
    assert [x["name"] for x in data["compared"]] == names
    assert "compared by the command" not in shown
    # No arms are the job's own.
    code, _, errors = command("place", job, "--out", tmp_path / "own", "--arms", "")
    assert code == 0, errors
    data = json.loads((tmp_path / "own" / "summary.json").read_text(encoding="utf-8"))
    assert [x["name"] for x in data["compared"]] == ["short", "turned"]
    run = (tmp_path / "own" / "job.yaml", "--no-simulation", "--out", tmp_path / "run")
    code, _, errors = command("run", *run)
    assert code == 0, errors


def test_what_is_wrong_with_a_tool_to_compare_is_said_with_its_name(command, tmp_path) -> None:
    job = tmp_path / "job.yaml"
    body = "{name: cap, radius: 1 cm, at: [0, 0, 0], margin: 1 mm}"
    asked = f"""\
placement:
  over: {{z: {{from: 0, to: 0, places: 1}}}}
  tools: {{short: {{shapes: {{spheres: [{body}]}}}}}}
"""
    job.write_text(SPACE + asked, encoding="utf-8")
    code, _, errors = command("place", job, "--out", tmp_path / "placed")
    assert code == 2 and "short: job.yaml: arm.tool.shapes.spheres" in " ".join(errors.split())
