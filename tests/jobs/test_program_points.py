"""Programs whose controllers plan the motion between the points are judged by what is sent.

The oracle reads the points and times from the text of the program. Its lines, its splines (scipy),
its kinematics and its distances share no code with the judge.
"""

import json

import numpy as np
import pytest
import yaml
from docs.pages import run_command
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree
from tests.files.exports.robot_programs import ENDING, RUN, Robot, tool_poses
from tests.studio.test_tasks import ask

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files.exports import TemplateFormat
from armcontour.files.job_file import parse_job

TOOL = 0.12
JOB = """\
name: part
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
path:
  file: part.ngc
  frame: {position: [400 mm, -80 mm, 100 mm]}
  orientation: {axis: [0, 0, -1]}
process:
  approach: 8 mm
  retract: 8 mm
  lead_in: {length: 2 mm, shape: arc, active: true}
  pierce: {time: 120 ms, height: 3 mm}
  switch: {name: laser}
limits: {speed: 120 mm/s}
corners: {tolerance: 0.3 mm}
runs: {one: {}}
export: {formats: [kuka]}
"""
# Fraction by which a stated distance may differ from that of the oracle.
STATED = 0.03
# Steps of the oracle along the plan and along the motions of the controller [s].
PLAN_STEP = 2e-5
STEP = 1e-4


def gcode(seed):
    """Write contours: a closed quadrangle and an open line, with a rapid between them."""
    random = np.random.default_rng(seed)
    corners = random.uniform(0.0, 12.0, (4, 2)) + [[0, 0], [45, 0], [45, 35], [0, 35]]
    line = random.uniform(0.0, 20.0, (3, 2)) + [[70, 0], [90, 10], [70, 30]]
    words = ["G21 G90 G17 F3000"]
    for contour in (np.vstack([corners, corners[:1]]), line):
        words.append("G0 X{:.3f} Y{:.3f}".format(*contour[0]))
        words += ["G1 X{:.3f} Y{:.3f}".format(*x) for x in contour[1:]]
    return "\n".join([*words, "M2", ""])


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "part.ngc").write_text(gcode(1))
    return tmp_path


def run_job(folder, export, *options, **changes):
    """Run a job by the command line; return the exit code, the run's data and the programs."""
    keys = yaml.safe_load(JOB) | changes | {"export": export}
    job = folder / "job.yaml"
    job.write_text(yaml.safe_dump({k: v for k, v in keys.items() if v is not None}))
    out = folder / "out"
    code, printed, failed = run_command(
        ["run", str(job), "--out", str(out), "--force", "--no-changes", *options]
    )
    assert code in (0, 1), failed
    summary = json.loads((out / "summary.json").read_text())
    return code, summary["runs"]["one"], out / "one" / "export"


def distance(points, line, tree):
    """Return the largest distance of points from a polyline, (n, 3) each [m]."""
    nearest = tree.query(points)[1]
    best = np.full(len(points), np.inf)
    for step in (-1, 0):
        i = np.clip(nearest + step, 0, len(line) - 2)
        chord = line[i + 1] - line[i]
        size2 = (chord * chord).sum(axis=1)
        along = ((points - line[i]) * chord).sum(axis=1) / np.where(size2 > 0, size2, 1.0)
        gap = points - line[i] - np.clip(along, 0.0, 1.0)[:, None] * chord
        best = np.minimum(best, np.linalg.norm(gap, axis=1))
    return best.max()


def own_distances(robot, plan):
    """Return the largest distances of lines and of splines through points from a plan [m]."""
    count = int(plan.duration / PLAN_STEP)
    path = tool_poses(plan(np.linspace(0.0, plan.duration, count)), TOOL)[0]
    tree = cKDTree(path)
    t = np.array(robot.times)
    q = np.array(robot.points)
    # The robot rests while it waits: the points before and after it are of two splines.
    rests = [int(abs(t - x.t).argmin()) for x in robot.actions if x.kind == "wait"]
    ends = sorted({0, *rests, len(t) - 1})
    lines = []
    splines = []
    for first, last in zip(ends[:-1], ends[1:], strict=True):
        part = slice(first, last + 1)
        fine = np.linspace(t[first], t[last], int((t[last] - t[first]) / STEP))
        lines.append(np.column_stack([np.interp(fine, t[part], q[part, k]) for k in range(6)]))
        splines.append(CubicSpline(t[part], q[part], bc_type="clamped")(fine))
    motions = (np.concatenate(lines), np.concatenate(splines))
    return [distance(tool_poses(x, TOOL)[0], path, tree) for x in motions]


@pytest.mark.parametrize(
    "seed, kind, input", [(3, "kuka", None), (4, "abb", None), (5, "kuka", 5), (6, "abb", "diArc")]
)
@pytest.mark.parametrize("cycle", ["40 ms", None])
def test_stated_distances_are_those_of_the_sent_points(tmp_path, seed, kind, input, cycle):
    (tmp_path / "part.ngc").write_text(gcode(seed))
    export = {"formats": [kind]} | ({} if cycle is None else {"cycle": cycle})
    process = yaml.safe_load(JOB)["process"]
    if input is not None:
        export["inputs"] = {"arc": input}
        process["wait"] = {"input": "arc", "within": "1 s", "at": "switched_on"}
    code, data, exported = run_job(tmp_path, export, process=process)
    program = (exported / f"reference.{ENDING[kind]}").read_text()
    robot = RUN[kind](program, Robot(inputs={str(input): lambda _: True}))
    job = ac.read_job(tmp_path / "job.yaml")
    result = ac.run(job).runs["one"]
    lines, spline = own_distances(robot, result.trajectory)
    stated = data["between_points"]
    assert stated["lines"] == pytest.approx(lines, rel=STATED)
    assert stated["spline"] == pytest.approx(spline, rel=STATED)
    assert stated["max"] == max(stated["lines"], stated["spline"])
    # Python gives the same, and the verdict is that of the distances.
    assert result.program.between.max == stated["max"]
    allowed = data["contour_error_allowed"]
    assert allowed == pytest.approx(0.03e-3)
    is_near = bool(max(lines, spline) <= allowed)
    assert data["kept"] is result.kept is is_near is (cycle is None)
    assert code == int(not is_near)


def test_interval_is_the_longest_that_keeps_the_allowed_error(folder):
    _, data, exported = run_job(folder, {"formats": ["kuka"]})
    points = data["between_points"]
    assert data["kept"] is True
    count = (exported / "reference.src").read_text().count("SPTP")
    assert count == pytest.approx(data["duration"] / points["interval"], abs=1)
    longer = f"{1.5e3 * points['interval']} ms"
    assert run_job(folder, {"formats": ["kuka"], "cycle": longer})[1]["kept"] is False
    # With a wider tolerance, fewer points suffice.
    wide = run_job(folder, {"formats": ["kuka"]}, corners={"tolerance": "2 mm"})[1]
    assert wide["kept"] is True
    assert wide["between_points"]["interval"] > 1.5 * points["interval"]


@pytest.mark.parametrize("servo", [None, {"order": "unknown"}, {"kp": "2 1/s", "kv": "900 1/s"}])
def test_a_program_is_not_judged_by_a_servo(folder, servo):
    code, data, _ = run_job(folder, {"formats": ["abb"]}, servo=servo)
    assert code == 0
    assert data["kept"] is True
    assert list(data["judged_by"]) == ["between points"]
    assert "contour_error" not in data
    assert data["compensation"] == "none"


def test_set_points_need_a_servo(folder):
    keys = yaml.safe_load(JOB) | {"export": {"formats": ["kuka", "csv"]}}
    with pytest.raises(InvalidInput, match="servo") as raised:
        parse_job(yaml.safe_dump(keys), folder=folder)
    assert raised.value.key == ("servo",)


@pytest.mark.parametrize(
    "kp, cycle, kept",
    [
        ("25 1/s", None, (True, True)),
        ("25 1/s", "40 ms", (True, False)),
        ("2 1/s", None, (False, True)),
    ],
)
def test_a_job_with_both_kinds_has_a_verdict_for_each(folder, kp, cycle, kept):
    export = {"formats": ["csv", "kuka"]} | ({} if cycle is None else {"cycle": cycle})
    servo = {"kp": kp, "kv": "150 1/s"}
    # Without compensation, a slow servo lags.
    lags = {"compensation": {"method": "none" if kp == "2 1/s" else "inverse"}}
    code, data, _ = run_job(folder, export, servo=servo, runs={"one": lags}, accuracy="0.36 mm")
    assert (data["kept_set_points"], data["kept_programs"]) == kept
    assert data["kept"] is all(kept)
    assert code == int(not all(kept))
    assert data["contour_error"]["max"] > 0


def test_changes_shorten_an_interval_that_is_too_long(folder):
    export = {"formats": ["kuka"], "cycle": "40 ms"}
    assert run_job(folder, export, "--changes")[1]["kept"] is False
    summary = json.loads((folder / "out" / "summary.json").read_text())
    (change,) = [x for x in summary["runs"]["one"]["changes"] if "interval" in x["change"]]
    ((key, value),) = change["edits"]
    assert key == "export.cycle"
    assert change["kept"] is True
    repaired = run_job(folder, export | {"cycle": value})[1]
    assert repaired["kept"] is True


def test_python_exports_points_within_a_tolerance(folder, tmp_path):
    (folder / "job.yaml").write_text(JOB)
    plan = ac.run(ac.read_job(folder / "job.yaml")).runs["one"].trajectory
    file = tmp_path / "part.src"
    kuka = TemplateFormat(template="kuka", outputs={"laser": 17})
    ac.export(plan, file, kuka, tolerance=0.1e-3)
    lines, spline = own_distances(RUN["kuka"](file.read_text(), Robot()), plan)
    assert 0.04e-3 < max(lines, spline) <= 0.1e-3
    with pytest.raises(InvalidInput, match="cycle") as raised:
        ac.export(plan, file, kuka, cycle=0.04, tolerance=0.1e-3)
    assert raised.value.needed > raised.value.allowed == 0.1e-3
    with pytest.raises(InvalidInput, match="tolerance"):
        ac.export(plan, tmp_path / "part.csv", tolerance=0.1e-3)


def test_a_stored_result_says_that_its_points_are_not_judged(folder):
    run_job(folder, {"formats": ["kuka"]})
    code, printed, _ = run_command(["export", str(folder / "out"), str(folder / "again.src")])
    assert code == 0
    assert "not judged" in " ".join(printed.split())


def test_the_studio_has_the_same_distances_and_points():
    keys = yaml.safe_load(JOB)
    keys["path"] |= {"points": [[0, 0, 0], [0.04, 0, 0], [0.04, 0.03, 0]]}
    del keys["path"]["file"]
    result = ac.run(parse_job(yaml.safe_dump(keys))).runs["one"]
    rows = {x["name"]: x["value"] for x in ask("figures", keys, "one").header["rows"]}
    assert rows["between_points.max"] == result.program.between.max
    assert rows["kept"] is True
    # The file of a job without exports has the same points.
    del keys["export"]
    keys["servo"] = {"kp": "25 1/s", "kv": "150 1/s"}
    sent = ask("export", keys, "one", format="abb")
    text = sent.arrays["content"].tobytes().decode()
    assert text.count("MoveAbsJ") == len(result.program.between.t)
