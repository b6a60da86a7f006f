"""A speed factor slows everything along the same joint path, through job files and in Python."""

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_job
from armcontour.files.exports.export_checks import check_exports
from armcontour.jobs import analog_outputs
from armcontour.motion import dwell_law
from armcontour.planning import at_speed

PLANE = """
name: plane
arm: pmk3s
limits: {speed: 0.10 m/s, centripetal_acceleration: 0.09 m/s²}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
"""
BEND = "path: {points: [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]}\n"
SPACE = """
name: space
arm: {name: ur5e, tool: {position: [0, 0, 120 mm]}}
seed: [0.2, -1.7, -2.4, -0.6, 1.6, 2.5]
limits: {speed: 60 mm/s, centripetal_acceleration: 1 m/s²}
corners: {tolerance: 0.25 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
"""
FRAME = "frame: {position: [380 mm, -70 mm, 50 mm]}, orientation: {axis: [0, 0, -1]}"
SEAM = f"path: {{points: [[0, 0, 0], [30 mm, 0, 0], [30 mm, 20 mm, 0]], {FRAME}}}\n"
PROGRAM = """G21 G90
G0 X0 Y0 Z5
G1 Z0 F300
M3 S500
G1 X20 F600
G4 P0.3
G1 Y15 F1200
M5
G0 Z5
M2
"""
LAYERS = """<svg xmlns="http://www.w3.org/2000/svg" width="60mm" height="40mm" viewBox="0 0 60 40">
<g id="cut"><path d="M0 0H20V15H0Z"/></g><g id="mark"><path d="M30 0L45 10"/></g></svg>
"""
# Jobs in which different things determine the speed.
JOBS = {
    "paper": PLANE + BEND + "runs: {one: {timing: {method: paper}}}\n",
    "conventional": PLANE + BEND + "runs: {one: {timing: {method: conventional}}}\n",
    "duration": PLANE + BEND + "runs: {one: {duration: 3 s}}\n",
    "shaped": PLANE.replace("{tolerance: 2 mm}", "{shape: free, tolerance: 2 mm}")
    + BEND
    + "runs: {one: {timing: {reserve: 2 %}}}\n",
    "torque": SPACE.replace("speed: 60 mm/s", "joint_torque: [40, 60, 30, 8, 8, 8]")
    + SEAM
    + "runs: {one: {}}\n",
    "jerk": PLANE.replace("limits: {", "limits: {joint_jerk: 20, ") + BEND + "runs: {one: {}}\n",
    "segments": PLANE
    + "path: {start: [0.30, 0.20], segments: [{to: [0.33, 0.20], speed: 30 mm/s}, "
    "{to: [0.33, 0.23], speed: 70 mm/s}]}\n"
    + "runs: {one: {}}\n",
    "weave": SPACE
    + SEAM
    + "process: {weave: {width: 4 mm, frequency: 2 Hz, speed: 6 mm/s}}\nruns: {one: {}}\n",
    "layers": SPACE.replace("speed: 60 mm/s, ", "")
    + f"path: {{file: part.svg, {FRAME}, "
    "layers: {cut: {speed: 40 mm/s}, mark: {speed: 90 mm/s}}}\n"
    + "process: {approach: 10 mm, retract: 10 mm, switch: {name: laser, on_lead: 20 ms}, "
    "rapid_speed: 150 mm/s, lead_in: {length: 5 mm}}\nruns: {one: {}}\n",
    "G-code": SPACE.replace("speed: 60 mm/s, ", "")
    + f"path: {{file: part.ngc, {FRAME}}}\nruns: {{one: {{}}}}\n",
    "pierce": SPACE
    + f"path: {{file: part.svg, {FRAME}, layers: [cut]}}\n"
    + "process: {pierce: {time: 0.4 s, height: 3 mm}, switch: {name: laser}, dwell: 0.2 s, "
    "analog: [{name: power, rest: 20 %}]}\nruns: {one: {}}\n",
    "rail": SPACE.replace(
        "arm: {name: ur5e,",
        "arm: {name: ur5e, rail: {axis: [0, 1, 0], lower: -0.5, upper: 0.5, velocity: 0.8, "
        "acceleration: 1.5},",
    ).replace("seed: [0.2,", "seed: [0, 0.2,")
    + SEAM
    + "runs: {one: {}}\n",
}  # fmt: skip
FACTOR = 0.1


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    files = tmp_path_factory.mktemp("drawings")
    (files / "part.ngc").write_text(PROGRAM)
    (files / "part.svg").write_text(LAYERS)
    return files


def planned(text, folder, **keys):
    """The only run of a job, which is not simulated; `keys` are added to the job."""
    lines = "".join(f"{key}: {value}\n" for key, value in keys.items())
    return ac.run(parse_job(text + lines, folder=folder), simulate=False).runs["one"]


def samples_of_moves(trajectory):
    """Joint positions and velocities of each move at the same fractions of its time."""
    spans = trajectory.spans or trajectory.contour_spans
    for span in spans:
        if span.trajectory is not None:
            t = np.linspace(*span.t, 301)
            yield span, trajectory(t, side="left"), trajectory(t, 1, side="left")


@pytest.mark.parametrize(
    "name", [pytest.param(x, marks=[needs_dynamics] if x == "torque" else []) for x in JOBS]
)
def test_speed_factor_scales_velocities_of_all_moves(name, folder):
    fast = planned(JOBS[name], folder)
    slow = planned(JOBS[name], folder, speed_factor="10 %")
    arm = fast.arm
    pairs = zip(samples_of_moves(fast.trajectory), samples_of_moves(slow.trajectory), strict=True)
    largest = np.zeros((2, arm.dof + 1))
    for (span, q, dq), (slow_span, slow_q, slow_dq) in pairs:
        assert span.kind == slow_span.kind and span.name == slow_span.name
        np.testing.assert_allclose(slow_q, q, atol=1e-12)
        np.testing.assert_allclose(slow_dq, FACTOR * dq, atol=1e-12)
        for row, positions, velocities in ((0, q, dq), (1, slow_q, slow_dq)):
            tool = np.linalg.norm(arm.tool_velocity(positions, velocities), axis=1).max()
            speeds = np.append(np.abs(velocities).max(axis=0), tool)
            largest[row] = np.maximum(largest[row], speeds)
    moving = largest[0] > 1e-9
    np.testing.assert_allclose(largest[1][moving] / largest[0][moving], FACTOR, atol=1e-9)
    # Dwells keep their durations.
    dwells = [
        [x.t[1] - x.t[0] for x in plan.trajectory.spans if x.kind == "dwell"]
        for plan in (fast, slow)
    ]
    np.testing.assert_allclose(dwells[1], dwells[0])
    waiting = sum(dwells[0])
    moved = fast.trajectory.duration - waiting
    assert slow.trajectory.duration == pytest.approx(waiting + moved / FACTOR)
    # Set-points move the arm from and to the same positions.
    np.testing.assert_allclose(slow.set_points.q[[0, -1]], fast.set_points.q[[0, -1]], atol=1e-6)


def test_events_keep_their_places_and_lead_times(folder):
    fast = planned(JOBS["layers"], folder).trajectory
    slow = planned(JOBS["layers"], folder, speed_factor="10 %").trajectory
    assert len(fast.events) == len(slow.events) == 4
    for event, slow_event in zip(fast.events, slow.events, strict=True):
        assert (event.name, event.value, event.s) == (
            slow_event.name,
            slow_event.value,
            slow_event.s,
        )
        assert slow_event.due - slow_event.t == pytest.approx(event.due - event.t)
        np.testing.assert_allclose(slow(slow_event.due), fast(event.due), atol=1e-9)
    assert fast.events[0].due - fast.events[0].t == pytest.approx(0.02)


def test_analog_outputs_follow_the_slower_tool(folder):
    powers = []
    for factor in ("100 %", "10 %"):
        job = parse_job(JOBS["pierce"] + f"speed_factor: {factor}\n", folder=folder)
        done = ac.run(job, simulate=False).runs["one"]
        (power,) = analog_outputs(done.path, done.trajectory, job.process, done.run.limits).values()
        begin, end = done.trajectory.contour_spans[0].work
        powers.append(power(np.linspace(begin, end, 2001)).max())
    # The output goes from 20 % at rest to 100 % at the assigned velocity.
    assert powers == [pytest.approx(1.0, abs=2e-3), pytest.approx(0.2 + 0.8 * 0.1, abs=2e-3)]


def test_largest_speeds_at_work_and_in_rapids_agree_with_and_without_simulation(folder):
    # Limited set-points would round the peaks of the speed.
    text = JOBS["layers"] + "command_limits: {joint_acceleration: inf}\n"
    speeds = []
    for simulate, factor in ((False, "100 %"), (True, "100 %"), (False, "10 %"), (True, "10 %")):
        job = parse_job(f"{text}speed_factor: {factor}\n", folder=folder)
        data = ac.run(job, simulate=simulate).runs["one"].to_data()
        speeds.append([data[name].value for name in ("speed", "rapid_speed")])
    work, rapids = speeds[0]
    assert work == pytest.approx(0.09, rel=2e-3) and 0.13 < rapids <= 0.15
    np.testing.assert_allclose(speeds[1], speeds[0], rtol=0.02)
    np.testing.assert_allclose(speeds[2:], [[0.1 * work, 0.1 * rapids]] * 2, rtol=0.02)


def test_a_run_has_the_factor_of_the_job_or_its_own(folder):
    text = JOBS["duration"].replace(
        "{one: {duration: 3 s}}", "{one: {speed_factor: 50 %}, two: {}}"
    )
    runs = ac.run(parse_job(text + "speed_factor: 20 %\n"), simulate=False).runs
    fast = runs["one"].trajectory.duration * 0.5
    assert runs["two"].trajectory.duration * 0.2 == pytest.approx(fast)
    with pytest.raises(InvalidInput, match="speed_factor"):
        parse_job(text + "speed_factor: 200 %\n")


def test_disabled_process_does_not_change_motion(folder):
    for name in ("pierce", "layers", "G-code"):
        on = planned(JOBS[name], folder)
        text = JOBS[name]
        if "process: {" in text:
            text = text.replace("process: {", "process: {off: true, ")
        else:
            text += "process: {off: true}\n"
        job = parse_job(text, folder=folder)
        off = ac.run(job, simulate=False).runs["one"]
        assert on.trajectory.events and not off.trajectory.events
        assert not analog_outputs(off.path, off.trajectory, job.process, off.run.limits)
        pairs = zip(samples_of_moves(on.trajectory), samples_of_moves(off.trajectory), strict=True)
        for (_, q, dq), (_, off_q, off_dq) in pairs:
            np.testing.assert_allclose(off_q, q, atol=1e-12)
            np.testing.assert_allclose(off_dq, dq, atol=1e-12)
        # Only pierces take less time.
        saved = 0.4 if name == "pierce" else 0.0
        assert on.trajectory.duration - off.trajectory.duration == pytest.approx(saved)


def test_outputs_need_no_events_if_the_process_is_off(folder):
    text = JOBS["layers"].replace("process: {", "process: {off: true, ")
    job = parse_job(text + "export: {formats: [urscript], outputs: {laser: 0}}\n", folder=folder)
    check_exports(job)
    assert not job.export.outputs


def test_stretching_twice_multiplies_the_factors_and_a_rest_of_laws_is_a_motion():
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([[0.30, 0.20], [0.34, 0.20]])
    plan = ac.plan(path, arm, arm.limits.replace(speed=0.1))
    twice = plan.stretched(0.5).stretched(0.4)
    assert twice.speed_factor == pytest.approx(0.2)
    once = plan.stretched(0.2)
    t = np.linspace(0.0, once.duration, 100)
    np.testing.assert_allclose(twice(t), once(t), atol=1e-12)
    np.testing.assert_allclose(once.s(t), plan.s(t * 0.2), atol=1e-12)
    assert plan.stretched(1.0) is plan
    with pytest.raises(InvalidInput, match="stretched"):
        ac.explain(once)
    # A trajectory without spans is one motion.
    rest = ac.Trajectory(laws=(dwell_law(np.zeros(2), 0.5),), method="rest")
    assert rest.stretched(0.1).duration == pytest.approx(5.0)
    for factor in (0.0, 1.5):
        with pytest.raises(InvalidInput):
            plan.stretched(factor)


def test_laws_of_other_kinds_are_stretched():
    class Swing(ac.motion.Law):
        breaks = np.array([0.0, 1.0, 2.0])

        def on_interval(self, i, t, order):
            phase = np.sin(t + order * np.pi / 2)
            return np.stack([phase, 2 * phase], axis=1)

    swing = ac.Trajectory(laws=(Swing(),), method="own")
    slow = swing.stretched(0.25)
    t = np.linspace(0.0, 8.0, 33)
    for order in range(4):
        np.testing.assert_allclose(slow(t, order), 0.25**order * swing(t / 4, order), atol=1e-12)


@needs_dynamics
def test_torques_of_an_arm_with_viscous_friction_are_checked_at_the_lower_speed():
    """Unlike other limits, they need not be satisfied by a slower motion."""
    arm = ac.load_arm("ur5e")
    path = ac.JointPath.spline([(0, 1.2, 0, 0, 0, 0), (0, -1.2, 0, 0, 0, 0)])
    planned = ac.plan(path, arm)
    holding = float(np.abs(arm.torque(*planned.stretched(1e-3).motion(0.0))).max())
    limits = planned.limits.replace(joint_torque=holding * 1.2)
    assert at_speed(planned.limited(limits), 0.1).speed_factor == 0.1
    rubbing = planned.limited(limits, arm=arm.with_dynamics(viscous=200.0))
    with pytest.raises(ac.NotRealizable) as refused:
        at_speed(rubbing, 0.5)
    assert refused.value.limit == "joint_torque" and refused.value.needed > holding * 1.2
    slow = planned.stretched(0.5)
    t = np.linspace(0.0, slow.duration, 2001)
    torque = np.abs(rubbing.arm.torque(*slow.motion(t))).max()
    assert refused.value.needed == pytest.approx(torque, rel=1e-3)


def test_a_certificate_refuses_a_speed_factor():
    job = parse_job(JOBS["duration"].replace("duration: 3 s", "speed_factor: 10 %"))
    with pytest.raises(InvalidInput, match="speed_factor"):
        ac.certify(job, goal=ac.CertificateGoal(tolerance=1e-3))
