"""Changes of the override stay on the path and within the plan's limits, less half of its reserve.

The limits are judged by the positions of the motion and by samples of it between all breaks.
"""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion.time_scaling import TimeScaling
from armcontour.planning.override_ramps import override_of

CYCLE = 4e-3
RESERVE = 0.05


def planar() -> ac.Trajectory:
    """The paper's path, with limits of joints and tool."""
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
    rounded = ac.round_corners(path, tolerance=5e-3)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09, tool_acceleration=0.12)
    return ac.plan(rounded, arm, limits, ac.Optimal(reserve=RESERVE, for_play=True))


def spatial(**limits) -> ac.Trajectory:
    """A path with a corner and a turning tool, in space."""
    arm = ac.load_arm("ur5e")
    points = [(0.40, -0.10, 0.2), (0.50, 0.0, 0.2), (0.40, 0.10, 0.25)]
    path = ac.Path.polyline(points).oriented(np.diag([1, -1, -1]))
    rounded = ac.round_corners(path, tolerance=5e-3, continuity="curvature")
    return ac.plan(
        rounded,
        arm,
        arm.limits.replace(speed=0.15, **limits),
        ac.Optimal(reserve=RESERVE, for_play=True),
    )


@pytest.fixture(scope="module")
def plans() -> dict[str, ac.Trajectory]:
    acceleration = np.full(6, 8.0)
    return {
        "planar": planar(),
        "spatial": spatial(joint_acceleration=acceleration, angular_acceleration=5.0),
        "jerk": spatial(joint_acceleration=acceleration, joint_jerk=np.full(6, 150.0)),
    }


def executed(plan: ac.Trajectory, targets) -> TimeScaling:
    """Time of a plan whose override follows the targets, one per interval, then 100 %."""
    override = override_of(plan, CYCLE, for_play=True)
    interval = 0.1
    pace = override.begin(targets[0])
    t = 0.0
    for target in targets[1:]:
        t += interval
        pace = override.change(pace, t, target)
    while not pace.is_complete:
        t += interval
        pace = override.change(pace, t, 1.0)
    return pace.scaling


def uses(motion: ac.Trajectory, plan: ac.Trajectory, seed: int) -> dict[str, float]:
    """Largest used fraction of each limit, by samples of the motion and by its positions."""
    rng = np.random.default_rng(seed)
    breaks = motion.breaks
    inside = breaks[:-1] + rng.uniform(size=len(breaks) - 1) * np.diff(breaks)
    t = np.concatenate([inside, rng.uniform(0.0, motion.duration, 20_000)])
    q, dq, ddq, dddq = motion.motion(t, 3)
    limits = plan.limits
    arm = plan.arm
    acceleration = np.broadcast_to(limits.joint_acceleration, plan.dof)
    step = 1e-3
    positions = motion(np.arange(0.0, motion.duration, step))
    second = np.diff(positions, 2, axis=0) / step**2
    found = {
        "acceleration": np.abs(ddq) / acceleration,
        "acceleration by positions": np.abs(second) / acceleration,
    }
    if limits.tool_acceleration is not None:
        tool = np.linalg.norm(arm.tool_acceleration(q, dq, ddq), axis=1)
        found["tool acceleration"] = tool / limits.tool_acceleration
    if limits.angular_acceleration is not None:
        turning = np.linalg.norm(arm.tool_twist_rate(q, dq, ddq)[:, 3:], axis=1)
        found["angular acceleration"] = turning / limits.angular_acceleration
    if limits.joint_jerk is not None:
        found["jerk"] = np.abs(dddq) / limits.joint_jerk
    if limits.joint_torque is not None and arm.has_bodies:
        found["torque"] = np.abs(arm.torque(q, dq, ddq)) / limits.joint_torque
    return {name: float(np.max(values)) for name, values in found.items()}


def profile(seed: int) -> list[float]:
    """Wanted overrides with pauses, which last several intervals each."""
    rng = np.random.default_rng(seed)
    chosen = rng.choice([0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.0], 12)
    return np.repeat(chosen, rng.integers(1, 5, 12)).tolist()


@pytest.mark.parametrize("name", ["planar", "spatial", "jerk"])
@pytest.mark.parametrize("seed", [0, 1])
def test_changes_use_half_of_the_reserve(plans, name, seed):
    plan = plans[name]
    scaling = executed(plan, profile(seed))
    motion = scaling.trajectory(plan)
    found = uses(motion, plan, seed)
    assert max(found.values()) <= 1 - RESERVE / 2 + 1e-4, found
    assert max(found.values()) > 1 - RESERVE, "a change that needs no reserve is no test"
    # The joints are where the plan is, and are never faster.
    t = np.linspace(0.0, motion.duration, 5001)
    np.testing.assert_allclose(motion(t), plan(scaling(t)), atol=1e-12)
    rate = scaling(t, 1)
    assert rate.min() >= -1e-12 and rate.max() <= 1 + 1e-9
    np.testing.assert_array_equal(motion(motion.duration), plan(plan.duration))


@pytest.mark.parametrize("name", ["planar", "spatial", "jerk"])
def test_a_constant_override_stretches_the_plan(plans, name):
    plan = plans[name]
    full = executed(plan, [1.0])
    assert full.end == pytest.approx(plan.duration, abs=1e-9)
    half = executed(plan, [0.5] * round(20 * plan.duration + 2))
    assert half.end == pytest.approx(2 * plan.duration, abs=1e-9)


@pytest.mark.parametrize("name", ["planar", "spatial", "jerk"])
def test_a_pause_rests_on_the_path_until_the_motion_goes_on(plans, name):
    plan = plans[name]
    scaling = executed(plan, [1.0] * 3 + [0.0] * 14)
    t = np.arange(0.0, scaling.end, CYCLE)
    is_resting = scaling(t, 1) == 0.0
    paused = t[is_resting]
    # The stop takes less than 0.9 s of the 1.3 s until the motion may go on.
    assert 0.4 < len(paused) * CYCLE <= 1.6
    assert np.ptp(scaling(paused[5:-5])) == 0.0
    assert scaling.end < plan.duration + 6.0


@pytest.mark.parametrize("name", ["planar", "spatial", "jerk"])
def test_every_motion_ends_at_rest_on_the_path(plans, name):
    """Whatever follows, or not: the sender may end at any time."""
    plan = plans[name]
    override = override_of(plan, CYCLE, for_play=True)
    pace = override.begin(1.0)
    for k in range(1, 12):
        motion = pace.scaling.trajectory(plan)
        assert np.abs(motion(motion.duration, 1, side="left")).max() < 1e-6
        assert pace.is_complete or pace.scaling.end < pace.brake_time + 1.0
        pace = override.change(pace, 0.1 * k, 1.0 if k % 3 else 0.3)


def fastest_stop(plan: ac.Trajectory, t: float) -> float:
    """Duration of the fastest stop within the limits of accelerations, without reserve [s]."""
    limit = np.broadcast_to(plan.limits.joint_acceleration, plan.dof)
    step = 5e-4
    tau = t
    rate = 1.0
    elapsed = 0.0
    while rate > 0.0:
        factor = plan(tau, 1)
        value = plan(tau, 2) * rate**2
        bounds = np.where(factor > 0, -limit - value, limit - value) / factor
        slope = min(float(bounds.max()), 0.0)
        tau += step * rate
        rate += step * slope
        elapsed += step
    return elapsed


def test_a_pause_is_hardly_slower_than_the_fastest_stop(tight):
    """At the worst times, at which a joint brakes at its limit."""
    plan = tight["line"]
    ratios = []
    for t in np.linspace(0.1, 0.8, 15) * plan.duration:
        override = override_of(plan, CYCLE, for_play=True)
        pace = override.begin(1.0, delay=float(t))
        paused = override.change(pace, float(t), 0.0)
        ratios.append((paused.scaling.end - t) / fastest_stop(plan, float(t)))
    assert max(ratios) < 1.2, ratios


def changed(plan: ac.Trajectory, place: float, pauses: int, target: float) -> TimeScaling:
    """Time of a plan that pauses for some intervals at a place, then follows a target [s]."""
    override = override_of(plan, CYCLE, for_play=True)
    interval = 0.1
    pace = override.begin(1.0, delay=place)
    t = place
    for wanted in [0.0] * pauses + [target] * 400:
        pace = override.change(pace, t, wanted)
        t += interval
        if pace.is_complete and wanted:
            break
    return pace.scaling


@pytest.fixture(scope="module")
def tight() -> dict[str, ac.Trajectory]:
    """Lines on which a joint is at a limit nearly always, with and without a limit of jerk."""
    planar_arm = ac.load_arm("pmk3s")
    line = ac.Path.polyline([(0.30, 0.08), (0.30, 0.33)])
    planar_limits = planar_arm.limits.replace(speed=0.5)
    options = ac.Optimal(reserve=0.02, for_play=True)
    jerk = spatial(joint_acceleration=np.full(6, 2.0), joint_jerk=np.full(6, 20.0))
    return {"line": ac.plan(line, planar_arm, planar_limits, options), "jerk": jerk}


@pytest.mark.parametrize("name", ["line", "jerk"])
@pytest.mark.parametrize("pauses", [1, 3, 12])
def test_no_lower_override_resumes_faster(tight, name, pauses):
    """After a pause at any place, also one that ends before the motion is at rest."""
    plan = tight[name]
    for share in (0.2, 0.45):
        place = share * plan.duration
        scaling = changed(plan, place, pauses, 1.0)
        lower = min(changed(plan, place, pauses, x).end for x in (0.95, 0.8))
        begin = place + 0.1 * pauses
        assert scaling.end - begin <= 1.05 * (lower - begin)
        found = uses(scaling.trajectory(plan), plan, 0)
        assert max(found.values()) <= 1 + 1e-6, found


def test_a_pause_that_is_taken_back_does_not_end_at_rest(plans):
    """With limits of jerk, too: the motion goes on although its stop has begun."""
    override = override_of(plans["jerk"], CYCLE, for_play=True)
    pace = override.begin(1.0, delay=0.5)
    pace = override.change(pace, 0.5, 0.0)
    assert pace.scaling.state_at(0.54).rate < 0.8
    scaling = override.change(pace, 0.54, 1.0).cruise
    assert scaling(np.linspace(0.5, 1.0, 2000), 1).min() > 0.2


def test_the_first_time_of_a_plan_is_found_in_a_time_scaling():
    ones = np.ones(2)
    zeros = np.zeros(2)
    scaling = TimeScaling.hermite(
        np.array([0.0, 1.0, 2.0]),
        (np.array([0.0, 0.7]), ones, zeros),
        (np.array([0.7, 1.0]), np.array([1.0, 0.0]), zeros),
    )
    tau = np.array([0.0, 0.3, 0.7, 0.9, 1.0])
    np.testing.assert_allclose(scaling(scaling.times_of(tau)), tau, atol=1e-12)
    later = scaling.since(0.5)
    t = np.linspace(0.0, 1.5, 31)
    np.testing.assert_allclose(later(t), scaling(t + 0.5), atol=1e-12)
    np.testing.assert_allclose(later(t, 2), scaling(t + 0.5, 2), atol=1e-9)
    rested = scaling.until(3.0)
    assert rested(3.0) == pytest.approx(1.0) and rested.state_at(2.5).rate == 0.0
