"""Limited set-points at full acceleration: the joints themselves stay within their limits."""

import dataclasses

import clarabel
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.signal import cont2discrete, lfilter

import armcontour as ac

CYCLE = 2e-3
FAST = ac.ServoModel(kp=25.0, kv=150.0)
# Measured at a UR5e.
SLOW = ac.ServoModel(kp=9.72, kv=28.8)
UNLIMITED = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
# Arm, corner [m], speed [m/s] and corner tolerance [m]
CORNERS = {
    "pmk3s": ([(0.30, 0.20), (0.34, 0.20), (0.34, 0.23)], 0.1, 2e-3),
    "ur5e": ([(0.40, -0.08, 0.2), (0.44, -0.08, 0.2), (0.44, -0.05, 0.2)], 0.25, 5e-4),
}


def planned(name, reserve):
    """Return the arm, the rounded corner, and its time-optimal plan."""
    points, speed, tolerance = CORNERS[name]
    arm = ac.load_arm(name)
    path = ac.Path.polyline(points)
    if name == "ur5e":
        path = path.pointing((0, 0, -1))
    path = ac.round_corners(path, tolerance=tolerance)
    return (
        arm,
        path,
        ac.plan(path, arm, arm.limits.replace(speed=speed), ac.Optimal(reserve=reserve)),
    )


def executed(set_points, arm, servo, path):
    """Return the largest contour error [m], and the largest demand over the limit."""
    motion = ac.simulate(set_points, ac.ServoPlant(arm, servo))
    limit = np.abs(set_points.trajectory.limits.acceleration_bounds(arm.dof)).min(axis=0)
    error = ac.evaluate(motion, path).contour_error.max
    return error, (np.abs(motion.demand) / limit).max()


def accelerations(set_points, arm, servo):
    """Accelerations between set-points of joints that do not saturate, over their limits."""
    plant = ac.ServoPlant(arm, servo, saturation="none")
    q = ac.simulate(set_points, plant, resolution=CYCLE).q
    limit = np.abs(set_points.trajectory.limits.acceleration_bounds(arm.dof)).min(axis=0)
    return np.abs(np.diff(q, 2, axis=0)).max(axis=0) / CYCLE**2 / limit


@pytest.mark.parametrize("servo", [FAST, SLOW], ids=["fast", "slow"])
@pytest.mark.parametrize("name", CORNERS)
def test_joints_do_not_wind_up_without_a_reserve(name, servo):
    """Set-points that are only nearest cost 20 to 62 times the raw error, and demand up to 5.4."""
    arm, path, plan = planned(name, 0.0)
    limited = ac.compensate(plan, servo, cycle=CYCLE)
    assert not limited.use.excesses
    error, demand = executed(limited, arm, servo, path)
    assert demand < 1.1
    if servo is FAST:
        raw = ac.compensate(plan, servo, UNLIMITED, cycle=CYCLE)
        assert error < 5 * executed(raw, arm, servo, path)[0]
    else:
        # A plan with a reserve, whose set-points need no further bound
        _, _, slower = planned(name, 0.1)
        spared = ac.compensate(slower, servo, cycle=CYCLE)
        assert spared.limit_cost.bounded is None
        assert error < 4 * executed(spared, arm, servo, path)[0]
    bounded = limited.limit_cost.bounded
    assert bounded.any()
    assert accelerations(limited, arm, servo)[bounded].max() < 1 + 1e-6
    # The stated cost includes saturation.
    assert limited.limit_cost.contour_max == pytest.approx(error, rel=0.03)


@pytest.mark.parametrize("name", CORNERS)
def test_set_points_without_harmful_saturation_are_the_nearest_ones(name):
    """Drives that never saturate get the same set-points; at full acceleration others."""
    strong = FAST.replace(acceleration_limit=1e3)
    for reserve, is_same in ((0.1, True), (0.0, False)):
        _, _, plan = planned(name, reserve)
        q = [ac.compensate(plan, servo, cycle=CYCLE).q for servo in (FAST, strong)]
        assert np.array_equal(*q) is is_same


@pytest.mark.parametrize("feedforward", [0.0, 0.5])
def test_bounded_set_points_are_the_nearest_ones_by_another_solver(feedforward):
    servo = ac.ServoModel(kp=25.0, kv=150.0, velocity_feedforward=feedforward)
    arm, _, plan = planned("pmk3s", 0.0)
    limits = ac.Limits(joint_acceleration=1.5 * np.abs(plan.limits.joint_acceleration))
    options = ac.Inverse(command_limits=limits)
    limited = ac.compensate(plan, servo, options, cycle=CYCLE)
    bounded = limited.limit_cost.bounded
    assert bounded.any()
    free = ac.compensate(dataclasses.replace(plan, limits=None), servo, cycle=CYCLE)
    more = round((free.start_time - limited.start_time) / CYCLE)
    after = len(limited.q) - len(free.q) - more
    q = np.pad(free.q, ((more, after), (0, 0)), mode="edge")
    own = np.abs(plan.limits.acceleration_bounds(arm.dof)).min(axis=0)
    sent = np.broadcast_to(limits.joint_acceleration, arm.dof)
    for j in np.flatnonzero(bounded):
        nearest = nearest_by_clarabel(q[:, j], servo, sent[j], own[j])
        np.testing.assert_allclose(limited.q[:, j], nearest, atol=2e-7)


def nearest_by_clarabel(q, servo, sent, own):
    """Minimum of |C x| with bounds of the accelerations of q + C x, and of the joint's response."""
    kp, kv = float(servo.kp), float(servo.kv)
    lead = [float(servo.velocity_feedforward) * kv] if servo.has_feedforward else []
    system = [*lead, kp * kv], [1.0, kv, kp * kv]
    numerator, denominator, _ = cont2discrete(system, CYCLE, method="foh")
    numerator = numerator.ravel()
    count = len(q)
    size = count - 4

    def filtered(taps):
        """Matrix from x to the changes of all values, (count, size)."""
        diagonals = [np.full(count, tap) for tap in taps]
        offsets = [-1 - k for k in range(len(taps))]
        return sp.diags_array(diagonals, offsets=offsets, shape=(count, size)).tocsc()

    second = sp.diags_array([1.0, -2.0, 1.0], offsets=[-1, 0, 1], shape=(count, count)).tolil()
    second[0, 0] = second[-1, -1] = -1.0
    second = second.tocsc()
    change = filtered(denominator)
    response = filtered(numerator)
    positions = lfilter(numerator, denominator, q - q[0])
    scale = 1e4
    parts = []
    sides = []
    for matrix, values, limit in ((change, q, sent), (response, positions, own)):
        bound = limit * CYCLE**2
        for sign in (1.0, -1.0):
            parts.append(sign * second @ matrix / (bound * scale))
            sides.append(1 - sign * second @ values / bound)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-10
    rows = sum(map(len, sides))
    solved = clarabel.DefaultSolver(
        sp.triu(change.T @ change, format="csc"),
        np.zeros(size),
        sp.vstack(parts, format="csc"),
        np.concatenate(sides),
        [clarabel.NonnegativeConeT(rows)],
        settings,
    ).solve()
    return q + change @ np.array(solved.x) / scale
