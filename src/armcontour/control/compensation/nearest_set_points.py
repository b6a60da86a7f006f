"""Nearest set-points within command limits, and the resulting error."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from armcontour.control.compensation.set_point_times import LONGEST_TAIL
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import CompensationError
from armcontour.motion import LimitCost, SetPoints
from armcontour.motion.nearest_commands import JointResponse, find_excess, nearest_commands
from armcontour.motion.set_point_rule import ACCELERATION, USER, intersection
from armcontour.robot import Arm
from armcontour.robot.arm import unit_of
from armcontour.robot.limits import LIMITS
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import ServoSimulation

# Limited set-points begin earlier and end later by 2 time constants of the slowest servo, and by
# 4 jerk-limited ramps from zero to the acceleration limit.
TIME_CONSTANTS = 2.0
RAMPS = 4.0
# Set-points are changed to satisfy a limit of velocity or acceleration that the plan exceeds by at
# most this fraction. A plan with a larger excess is rejected.
SMOOTHED_SHARE = 0.01
# Saturation is harmful if it multiplies a joint's largest error by more than this.
HARMFUL_FACTOR = 1.5
UNLIMITED = np.array([[-np.inf], [np.inf]])


class _Motion(NamedTuple):
    """Simulated motion of all joints."""

    positions: FloatArray  # [rad], (n, dof)
    saturates: BoolArray  # (dof,)


def limit_set_points(
    set_points: SetPoints,
    servo: ServoModel,
    arm: Arm | None = None,
    *,
    saturates: bool = True,
) -> SetPoints:
    """Replace set-points by near ones within their rule.

    They are the nearest ones, except for joints whose own acceleration is bounded, too; see
    `_avoid_saturation`. Limits are tried in this order:

    1. all limits, at the controller's cycle
    2. an assumed limit of the acceleration at the set-points' cycle only
    3. no assumed limit

    If no set-points are found, and neither the user nor a controller limits them, the set-points
    stay as they are.

    - `servo`: nominal servo, with which the resulting errors are estimated.
    - `arm`: arm for the contour errors; by default the arm of the plan.
    - `saturates`: whether joints saturate at the accelerations of the plan.

    Raises:
        CompensationError: The plan exceeds a limit of the user or a controller by more than
            SMOOTHED_SHARE, or no set-points within it are found.
    """
    rule = set_points.rule
    without_assumed = rule.without_assumed().at_cycle(set_points.cycle)
    at_set_points = without_assumed.copy()
    at_set_points[ACCELERATION] = intersection(
        without_assumed[ACCELERATION], rule.bounds[ACCELERATION]
    )
    for bounds in (rule.at_cycle(set_points.cycle), at_set_points):
        with suppress(CompensationError):
            return _limit(set_points, bounds, servo, arm, saturates=saturates)
    try:
        return _limit(set_points, without_assumed, servo, arm, saturates=saturates)
    except CompensationError:
        if rule.has_own_limits:
            raise
        return set_points


def _limit(
    set_points: SetPoints,
    bounds: FloatArray,
    servo: ServoModel,
    arm: Arm | None,
    *,
    saturates: bool,
) -> SetPoints:
    """Replace set-points by near ones within bounds; see `limit_set_points`."""
    if find_excess(set_points.q, set_points.cycle, bounds) is None:
        return set_points
    _check_plan(set_points, bounds[:3], SMOOTHED_SHARE)
    unlimited, nearest = _find_nearest(set_points, bounds, servo)
    limited = replace(unlimited, q=nearest)
    saturation = UNLIMITED
    if saturates:
        saturation = np.stack(servo.saturate(*unlimited.rule.plan[ACCELERATION]))
    limited, errors, bounded = _avoid_saturation(unlimited, limited, bounds, servo, saturation)
    cost = _estimate_errors(limited, limited.q - unlimited.q, errors, arm)
    return replace(limited, limit_cost=replace(cost, bounded=bounded))


def _find_nearest(
    set_points: SetPoints, bounds: FloatArray, servo: ServoModel
) -> tuple[SetPoints, FloatArray]:
    """Find the nearest set-points within bounds.

    At a limit, set-points begin earlier and end later, because a compensated command accelerates
    and decelerates faster than its joint. A short extension is tried first, then the longest one.

    Returns the extended set-points without limits, and the nearest ones [rad], (n, dof).

    Raises:
        CompensationError: No set-points are found. If the plan itself exceeds the bounds, the
            message says so.
    """
    cycle = set_points.cycle
    failed = 0
    for extension in (extension_of(servo, bounds), LONGEST_TAIL):
        extra = int(np.ceil(extension / cycle))
        q = np.pad(set_points.q, ((extra, extra), (0, 0)), mode="edge")
        unlimited = replace(set_points, q=q, start_time=set_points.start_time - extra * cycle)
        nearest, joint = _nearest_between_waits(unlimited, bounds)
        if joint is None:
            return unlimited, nearest
        failed = joint
    is_failed = np.arange(set_points.q.shape[1]) == failed
    _check_plan(set_points, np.where(is_failed, bounds, UNLIMITED))
    sources = ", ".join(dict.fromkeys(filter(None, set_points.rule.sources)))
    raise CompensationError(
        f"No set-points of joint {failed + 1} were found within their limits ({sources}) that "
        f"reach the ends of the plan, even with {LONGEST_TAIL:g} s more before and after the "
        "plan. Plan a slower motion.",
        joint=failed,
    )


def _nearest_between_waits(
    set_points: SetPoints,
    bounds: FloatArray,
    otherwise: FloatArray | None = None,
    responses: Sequence[JointResponse] | None = None,
) -> tuple[FloatArray, int | None]:
    """Return the nearest set-points, which rest at waits for inputs if they can.

    Those between two waits are found as those of a motion from rest to rest. If this is impossible,
    the whole motion is one, and moves at the waits; exports refuse this.

    Returns the set-points [rad], (n, dof), and the joint without a solution, or None.

    - `set_points`: extended set-points.
    - `otherwise`, `responses`: as in `nearest_commands`.
    """
    q = set_points.q
    cycle = set_points.cycle
    # A wait also keeps the following set-point, so that the set-points rest there for a cycle.
    waits = {round((x.t - set_points.start_time) / cycle) + 1 for x in set_points.trajectory.waits}
    ends = [0, *sorted(x for x in waits if 0 < x < len(q)), len(q)]
    nearest = q.copy()
    joint = None
    for first, last in pairwise(ends):
        piece = slice(first, last)
        other = None if otherwise is None else otherwise[piece]
        nearest[piece], joint = nearest_commands(
            q[piece], cycle, bounds, other, responses=responses
        )
        if joint is not None:
            break
    if joint is None and find_excess(nearest, cycle, bounds) is None:
        return nearest, None
    return nearest_commands(q, cycle, bounds, otherwise, responses=responses)


def _avoid_saturation(
    unlimited: SetPoints,
    nearest: SetPoints,
    bounds: FloatArray,
    servo: ServoModel,
    saturation: FloatArray,
) -> tuple[SetPoints, FloatArray, BoolArray | None]:
    """Where saturation increases a joint's error, bound the joint's own acceleration as well.

    Limited set-points begin a change earlier and end it later, so that the joint deviates from the
    plan and can need more than the plan's acceleration. Then it saturates, and its position loop
    winds up. Each joint gets the set-points with the smaller error.

    Only servos of second order without friction, integrator and acceleration feed-forward have a
    response that can be bounded; other set-points stay the nearest ones.

    Returns the set-points, the difference of their motion from that of the unlimited ones without
    saturation [rad], (n, dof), as simulated with the servo model, and `LimitCost.bounded`.

    - `unlimited`: set-points without limits, with which the joints follow the plan.
    - `nearest`: the nearest set-points within bounds.
    - `bounds`: bounds of the set-points and their derivatives, (4, 2, dof).
    - `saturation`: lower and upper bound of each joint's acceleration [rad/s²], (2, dof).
    """
    lower, upper = np.broadcast_to(saturation, (2, unlimited.q.shape[1]))
    planned = _simulate(unlimited, servo).positions
    executed = _simulate(nearest, servo, lower, upper)
    errors = executed.positions - planned
    if not executed.saturates.any() or not _is_linear_second_order(servo):
        return nearest, errors, None
    largest = np.abs(errors).max(axis=0)
    unsaturated_errors = _simulate(nearest, servo).positions - planned
    is_harmful = largest > HARMFUL_FACTOR * np.abs(unsaturated_errors).max(axis=0)
    joints = np.flatnonzero(is_harmful).tolist()
    if not joints:
        return nearest, errors, None
    bounds_of_joints = zip(joints, lower[joints], upper[joints], strict=True)
    responses = [_joint_response(servo, nearest.cycle, *x) for x in bounds_of_joints]
    q = nearest.q.copy()
    part = replace(unlimited, q=unlimited.q[:, joints])
    q[:, joints], _ = _nearest_between_waits(part, bounds[:, :, joints], q[:, joints], responses)
    candidate = replace(nearest, q=q)
    candidate_errors = _simulate(candidate, servo, lower, upper).positions - planned
    is_better = np.abs(candidate_errors).max(axis=0) < largest
    chosen = replace(nearest, q=np.where(is_better, q, nearest.q))
    errors = np.where(is_better, candidate_errors, errors)
    return chosen, errors, is_better if is_better.any() else None


def _simulate(
    set_points: SetPoints,
    servo: ServoModel,
    lower: FloatArray | None = None,
    upper: FloatArray | None = None,
) -> _Motion:
    """Simulate joints that rest at the first set-point; see `ServoSimulation`."""
    q = set_points.q
    simulation = ServoSimulation(q, set_points.cycle, servo, lower, upper)
    motions = simulation.run(0, len(q) - 1, q[0], np.zeros_like(q[0]))
    positions = np.concatenate([q[:1], motions.states[:, :, 0].T])
    return _Motion(positions, motions.saturated > 0)


def _is_linear_second_order(servo: ServoModel) -> bool:
    """Return whether every joint responds to set-points as `_joint_response` computes it."""
    has_more = servo.ki.any() or servo.acceleration_feedforward.any()
    return servo.is_plain("second") and not has_more and servo.interpolation == "linear"


def _joint_response(
    servo: ServoModel, cycle: float, joint: int, lower: float, upper: float
) -> JointResponse:
    """Return a joint's response to set-points that are joined by lines.

    Its transfer function is `(f kv s + kp kv) / (s² + kv s + kp kv)` with velocity feed-forward f,
    see docs/concepts/servo.md. A dead time shifts the response.

    - `lower`, `upper`: bounds of the joint's acceleration [rad/s²].
    """
    from scipy.signal import cont2discrete

    assert servo.kv is not None
    kv = servo.kv[joint]
    stiffness = servo.kp[joint] * kv
    lead = servo.velocity_feedforward[joint] * kv
    system = [lead, stiffness] if lead else [stiffness], [1.0, kv, stiffness]
    numerator, denominator, _ = cont2discrete(system, cycle, method="foh")
    return JointResponse(numerator.ravel(), denominator, lower * cycle**2, upper * cycle**2)


def extension_of(servo: ServoModel, bounds: FloatArray) -> float:
    """Return the time by which limited set-points begin earlier and end later [s].

    - `servo`: servo with one value per joint.
    - `bounds`: bounds of the set-points and their derivatives, (4, 2, dof).
    """
    limited = np.isfinite(bounds[2, 1])
    ramp = float((bounds[2, 1, limited] / bounds[3, 1, limited]).max(initial=0.0))
    return min(TIME_CONSTANTS / servo.slowest + RAMPS * ramp, LONGEST_TAIL)


def _check_plan(set_points: SetPoints, bounds: FloatArray, share: float = 0.0) -> None:
    """Raise an error if the plan exceeds bounds.

    - `bounds`: as from `command_bounds`, or its first orders.
    - `share`: fraction by which bounds of derivatives are widened.
    """
    plan = set_points.trajectory
    cycle = set_points.cycle
    # The times extend to the end of the plan, because set-points with a time advance end earlier.
    t = set_points.times(int((plan.duration - set_points.start_time) / cycle) + 3, cycle)
    excess = find_excess(plan.with_rests(t), cycle, bounds, share)
    if excess is None:
        return
    # The plan exceeds the bounds, so set-points within the bounds would leave its path.
    name = excess.name
    joint = excess.joint
    unit = unit_of(plan.arm, LIMITS[name].unit, joint)
    time = float(t[excess.row])
    limit = f"{excess.allowed:.6g} {unit}"
    source = set_points.rule.sources[excess.order]
    increase = ", or increase the command limit" if USER in source else ""
    read = set_points.rule.cycle
    if excess.order == ACCELERATION and read is not None and read < cycle:
        source = f"because the controller reads the lines between them every {read * 1e3:g} ms"
        increase = f", or use a cycle of {read * 1e3:g} ms"
    raise CompensationError(
        f"The plan must stay within the limit {name} of its set-points, {limit} ({source}), but "
        f"joint {joint + 1} has {excess.needed:.6g} {unit} at t = {time:.6g} s. Set-points within "
        f"the limit would leave the path. Plan with limits.{name} of {limit}{increase}.",
        t=time,
        joint=joint,
        limit=name,
        needed=excess.needed,
        allowed=excess.allowed,
    )


def _estimate_errors(
    set_points: SetPoints, change: FloatArray, joint_errors: FloatArray, arm: Arm | None
) -> LimitCost:
    """Estimate the errors due to a change of the set-points.

    - `set_points`: the changed set-points.
    - `change`: changed less original set-points [rad], (n, dof).
    - `joint_errors`: the joints' deviations due to the change [rad], (n, dof).
    - `arm`: arm for the contour errors; by default the arm of the plan.
    """
    deviation = np.abs(change).max(axis=0)
    plan = set_points.trajectory
    arm = plan.arm if arm is None else arm
    times = set_points.t
    paths = plan.paths_at(times)
    if arm is None or not paths:
        return LimitCost(deviation=deviation, arm=arm)
    tool = arm.tool_position(plan.with_rests(times) + joint_errors)
    distances = np.concatenate([path.project(tool[samples]).distance for path, samples in paths])
    return LimitCost(
        deviation=deviation,
        contour_rms=float(np.sqrt(np.mean(distances**2))),
        contour_max=float(distances.max()),
        arm=arm,
    )
