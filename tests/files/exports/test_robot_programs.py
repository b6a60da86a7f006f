"""Lifted, waiting and resumed programs, executed by independent interpreters."""

import numpy as np
import pytest
from docs.pages import run_command
from tests.files.exports.robot_programs import ENDING, RUN, Robot, off_polyline, tool_poses

# A part that is tilted by 20 degrees about x; its G-code links two contours by rapids above it.
TILT = np.radians(20.0)
ORIGIN = np.array([0.40, -0.08, 0.10])
ROTATION = np.array([[1, 0, 0], [0, np.cos(TILT), -np.sin(TILT)], [0, np.sin(TILT), np.cos(TILT)]])
# Length of the tool [m].
TOOL = 0.12
GCODE = """G21 G90
G0 X0 Y0 Z10
G0 Z0
G1 X40 F3600
G1 Y30
G0 Z10
G0 X60 Y0
G0 Z0
G1 X60 Y30
G0 Z10
M2
"""
JOB = """
name: part
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
path:
  file: part.ngc
  frame: {position: [400 mm, -80 mm, 100 mm], rpy: [20 deg, 0, 0]}
  orientation: {axis: [0, 0, -1]}
process: PROCESS
limits: {speed: 60 mm/s}
corners: {tolerance: 0.5 mm}
servo: {kp: 25 1/s, kv: 150 1/s, dead_time: 20 ms}
cycle: 2 ms
runs: {one: {timing: {reserve: 5 %}}}
export:
  formats: [urscript, kuka, abb]
  cycle: 16 ms
  outputs:
    torch: {urscript: 0, kuka: 17, abb: doTorch}
"""
# Further outputs, and inputs, of a job that waits.
SIGNALS = """\
    power: {urscript: AO0, kuka: 2, abb: aoPower}
  inputs:
    clamp: {urscript: 2, kuka: 5, abb: diClamp}
    arc: {urscript: 3, kuka: 6, abb: diArc}
"""
SWITCHED = "{switch: {name: torch}, pierce: {time: 100 ms}}"
WAITING = (
    "{switch: {name: torch}, pierce: {time: 50 ms}, "
    "analog: [{name: power, rest: 0.25, off: 0.125}], "
    "wait: [{input: clamp, within: 2 s}, {input: arc, within: 500 ms, at: switched_on}]}"
)
TORCH = {"urscript": "0", "kuka": "17", "abb": "doTorch"}
POWER = {"urscript": "analog 0", "kuka": "analog 2", "abb": "analog aoPower"}
CLAMP = {"urscript": "2", "kuka": "5", "abb": "diClamp"}
ARC = {"urscript": "3", "kuka": "6", "abb": "diArc"}
FILES = {
    "reference": ("urscript", "reference"),
    "set-points": ("urscript", "set_points"),
    "kuka": ("kuka", "reference"),
    "abb": ("abb", "reference"),
}
# Largest distance of a point from the polyline through the points of another program [m]: sagitta
# of 2 ms at 60 mm/s in a rounded corner (1.2 um at a radius of 1.2 mm), and the last digits.
ON_POLYLINE = 2e-6
# Last digits of a joint of 1e-7 rad, at 1 m [m].
LAST_DIGIT = 2e-7
# Speed on the contours [m/s].
SPEED = 60e-3


def write_programs(folder, process, *options):
    """Run the job by the command line; return the texts of its programs by name."""
    folder.mkdir(exist_ok=True)
    (folder / "part.ngc").write_text(GCODE)
    signals = SIGNALS if "wait" in process else ""
    (folder / "job.yaml").write_text(JOB.replace("PROCESS", process) + signals)
    words = ["run", str(folder / "job.yaml"), "--out", str(folder / "out"), "--force", *options]
    code, _, failed = run_command(words)
    assert code == 0, failed
    return {
        name: (folder / f"out/one/export/{stem}.{ENDING[kind]}").read_text()
        for name, (kind, stem) in FILES.items()
    }


def execute(programs, name, inputs=None):
    """Execute a program with inputs by their names in the job; all are on by default."""
    kind, _ = FILES[name]
    given = {"clamp": lambda _: True, "arc": lambda _: True, **(inputs or {})}
    robot = Robot(inputs={CLAMP[kind]: given["clamp"], ARC[kind]: given["arc"]})
    return RUN[kind](programs[name], robot)


def in_part(points):
    """Transform points from the base to the part frame [m], (n, 3)."""
    return (points - ORIGIN) @ ROTATION


def positions(robot):
    """Return the tool's positions in the part frame at all points of a program [m], (n, 3)."""
    return in_part(tool_poses(robot.points, TOOL)[0])


def switchings(robot, kind):
    """Return the actions of the torch."""
    return [x for x in robot.actions if x.name == TORCH[kind] and x.kind == "set"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return write_programs(tmp_path_factory.mktemp("whole"), SWITCHED)


@pytest.fixture(scope="module")
def off(tmp_path_factory):
    return write_programs(tmp_path_factory.mktemp("off"), SWITCHED, "--process-off")


@pytest.fixture(scope="module")
def lifted(tmp_path_factory):
    options = ("--process-off", "--lift", "20 mm")
    return write_programs(tmp_path_factory.mktemp("lifted"), SWITCHED, *options)


@pytest.fixture(scope="module")
def waiting(tmp_path_factory):
    return write_programs(tmp_path_factory.mktemp("waiting"), WAITING)


# Path of the tool in the part frame, as it is drawn [m].
DRAWN = 1e-3 * np.array(
    [
        *([0, 0, 10], [0, 0, 0], [40, 0, 0], [40, 30, 0], [40, 30, 10]),
        *([60, 0, 10], [60, 0, 0], [60, 30, 0], [60, 30, 10]),
    ]
)


@pytest.mark.parametrize("name", ["reference", "kuka", "abb"])
def test_programs_follow_the_drawing_with_the_torch_on(whole, name):
    kind, _ = FILES[name]
    robot = execute(whole, name)
    assert robot.ended == "end" and not robot.message
    # Only the first corner is rounded, within its tolerance.
    assert off_polyline(positions(robot), DRAWN)[0].max() < 0.5e-3
    actions = switchings(robot, kind)
    assert [x.value for x in actions] == [True, False, True, False]
    places = in_part(tool_poses([x.q for x in actions], TOOL)[0])
    # RAPID switches at the last point before the event.
    np.testing.assert_allclose(places, DRAWN[[1, 3, 6, 7]], atol=16e-3 * SPEED)


@pytest.mark.parametrize("name", ["reference", "kuka", "abb"])
def test_every_pose_of_a_lifted_program_is_above_the_part_by_one_vector(off, lifted, name):
    low = execute(off, "reference")
    high = execute(lifted, name)
    vertices, rotations = tool_poses(low.points, TOOL)
    points, turned = tool_poses(high.points, TOOL)
    up = 20e-3 * ROTATION[:, 2]
    distances, places = off_polyline(points - up, vertices)
    assert distances.max() < ON_POLYLINE
    # The whole path is passed once, from its start to its end.
    assert (np.diff(places) >= -1e-9).all()
    np.testing.assert_allclose(points[[0, -1]] - up, vertices[[0, -1]], atol=LAST_DIGIT)
    # The tool axis is the same, and nothing is switched.
    np.testing.assert_allclose(turned[:, :, 2], np.tile(rotations[0, :, 2], (len(turned), 1)),
                               atol=LAST_DIGIT)  # fmt: skip
    assert not low.actions and not high.actions


def test_other_direction_of_the_lift_comparison_finds_no_gap(off, lifted):
    low = execute(off, "reference")
    high = execute(lifted, "reference")
    up = 20e-3 * ROTATION[:, 2]
    points = tool_poses(low.points, TOOL)[0] + up
    assert off_polyline(points, tool_poses(high.points, TOOL)[0])[0].max() < ON_POLYLINE


@pytest.mark.parametrize("name", list(FILES))
def test_robot_waits_at_rest_at_the_start_of_each_contour(waiting, name):
    kind, _ = FILES[name]

    def clamped(robot):
        # The part is clamped after 0.7 s, and stays so.
        return robot.t > 0.7

    def arc(robot):
        # The arc burns 0.1 s after the torch is switched on.
        on = [x for x in switchings(robot, kind) if x.value]
        return robot.outputs[TORCH[kind]] and robot.t - on[-1].t > 0.1

    robot = execute(waiting, name, {"clamp": clamped, "arc": arc})
    assert robot.ended == "end" and not robot.message
    wanted = [x for x in robot.actions if x.kind == "wait" or x.name == TORCH[kind]]
    order = [(x.kind, x.name, x.value) for x in wanted]
    contour = [
        ("wait", CLAMP[kind], True),
        ("set", TORCH[kind], True),
        ("wait", ARC[kind], True),
        ("set", TORCH[kind], False),
    ]
    assert order == contour * 2
    waits = [x for x in wanted if x.kind == "wait"]
    assert all(x.stands for x in waits)
    places = in_part(tool_poses([x.q for x in waits], TOOL)[0])
    np.testing.assert_allclose(places, DRAWN[[1, 1, 6, 6]], atol=LAST_DIGIT)
    # The first clamp comes after 0.7 s, the second is there; each arc comes 0.1 s after the torch.
    assert waits[0].t == pytest.approx(0.7, abs=0.03) and waits[2].waited == pytest.approx(0.0)
    torch = [x.t for x in wanted if x.kind == "set" and x.value]
    for switched, wait in zip(torch, waits[1::2], strict=True):
        assert wait.t - switched == pytest.approx(0.1, abs=0.04)
    # The tool rests from the wait for the fixture until the piercing is over.
    times = np.array(robot.times)
    points = positions(robot)
    for clamp, burning, start in zip(waits[::2], waits[1::2], DRAWN[[1, 6]], strict=True):
        resting = (times >= clamp.t - clamp.waited) & (times <= burning.t + 0.05)
        np.testing.assert_allclose(
            points[resting], np.tile(start, (resting.sum(), 1)), atol=LAST_DIGIT
        )
    # The power has its value at rest while the robot waits for the arc.
    levels = [x for x in robot.actions if x.name == POWER[kind]]
    last = [x.value for x in levels if x.t <= waits[1].t][-1]
    assert last == pytest.approx(0.25)


@pytest.mark.parametrize("name", list(FILES))
@pytest.mark.parametrize(("missing", "within"), [("clamp", 2.0), ("arc", 0.5)])
def test_program_ends_with_all_outputs_off_if_an_input_does_not_come(
    waiting, name, missing, within
):
    kind, _ = FILES[name]

    def until_second(robot):
        # The input is on at the first contour only.
        return not any(not x.value for x in switchings(robot, kind))

    robot = execute(waiting, name, {missing: until_second})
    assert robot.ended == "halt" and missing in robot.message
    wait = [x for x in robot.actions if x.kind == "wait"][-1]
    assert wait.name == {"clamp": CLAMP, "arc": ARC}[missing][kind] and not wait.value
    assert wait.stands and wait.waited == pytest.approx(within, abs=0.03)
    # The tool stands at the start of the second contour, with all outputs off.
    np.testing.assert_allclose(positions(robot)[-1], DRAWN[6], atol=LAST_DIGIT)
    assert robot.outputs[TORCH[kind]] is False
    assert robot.outputs[POWER[kind]] == pytest.approx(0.125)
    assert [
        x for x in robot.actions if x.t > wait.t - 1e-9 and x.kind == "set" and x.value is True
    ] == []


@pytest.mark.parametrize(
    # Arc length at which the job is resumed, and overlap; where the rest begins, and where the
    # finished part ended, in the plane of the part [mm].
    ("resume_at", "rejoin", "begin", "stopped"),
    [
        (25, 3, (22, 0), (25, 0)),
        (25, 0, (25, 0), (25, 0)),
        (55, 3, (40, 12), (40, 15)),
        (80, 3, (60, 7), (60, 10)),
        # The overlap ends at the start of the contour.
        (71, 3, (60, 0), (60, 1)),
    ],
)
def test_resumed_programs_begin_with_the_overlap(
    whole, tmp_path, resume_at, rejoin, begin, stopped
):
    options = ["--resume-at", f"{resume_at} mm", "--rejoin", f"{rejoin} mm"]
    programs = write_programs(tmp_path / "rest", SWITCHED, *options)
    start, end = (1e-3 * np.array([*x, 0.0]) for x in (begin, stopped))
    path = positions(execute(whole, "reference"))
    for name, (kind, _) in FILES.items():
        robot = execute(programs, name)
        points = positions(robot)
        # Outputs that were switched before are switched again, so the torch can be off first.
        torch = switchings(robot, kind)
        on = next(x for x in torch if x.value)
        # The torch is switched on at the place, before the tool moves.
        np.testing.assert_allclose(in_part(tool_poses([on.q], TOOL)[0])[0], start, atol=LAST_DIGIT)
        np.testing.assert_allclose(points[0], start, atol=LAST_DIGIT)
        np.testing.assert_allclose(points[-1], path[-1], atol=LAST_DIGIT)
        if name == "set-points":
            # In corners, set-points are beside the path.
            continue
        distances, places = off_polyline(points, path)
        assert distances.max() < ON_POLYLINE and (np.diff(places) >= -1e-9).all()
        # The torch stays on until the tool is where the finished part ended, and beyond it.
        length = off_polyline(end[None], path)[1][0]
        overlap = np.linalg.norm(end - start)
        assert length - places[0] == pytest.approx(overlap, abs=1e-6)
        passed = float(np.interp(length + 1e-3, places, robot.times))
        assert all(x.value for x in torch[torch.index(on) :] if x.t <= passed)


def test_resumed_program_with_a_lead_in_is_at_speed_where_the_overlap_begins(tmp_path):
    led = "{switch: {name: torch}, lead_in: {length: 8 mm}}"
    options = ["--resume-at", "25 mm", "--rejoin", "3 mm"]
    programs = write_programs(tmp_path / "rest", led, *options)
    for name in ("reference", "kuka"):
        kind, _ = FILES[name]
        robot = execute(programs, name)
        points = positions(robot)
        # The lead-in is on the finished part.
        np.testing.assert_allclose(points[0], [14e-3, 0, 0], atol=LAST_DIGIT)
        on = switchings(robot, kind)[0]
        x = np.interp(on.t, robot.times, points[:, 0])
        # In URScript, half a cycle of 2 ms, and the cycle in which `servoj` moves to its target. A
        # trigger of KRL has the exact time.
        assert x == pytest.approx(22e-3, abs=SPEED * (3.1e-3 if name == "reference" else 2e-4))
