"""Joint paths of contours on which some joints stay still, at positions chosen for each contour.

The positions are those about which the joints would move if their motion were very expensive. The
joints are then held there, and the contour is traced with the other joints.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, ArmMismatch, Unreachable
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.motion import JointPath
from armcontour.planning.tracing.posture_cost import PostureCost
from armcontour.robot import SerialArm
from armcontour.robot.preferred_chain import ROUNDING

# Weight of a still joint while its position is sought, relative to joints of the weight 1.
STILL_WEIGHT = 1e3
# Number of points of a joint path at which the positions of still joints and postures are compared
SAMPLES = 200
# Number of positions of a single still joint that are tried if no other position completes a path
TRIED_POSITIONS = 9
# A joint leaves the position at which it is only if the cost of its postures there exceeds that at
# another position by this fraction, and this value.
WORSE = 0.01
LEAST_COST = 1e-6

Trace = Callable[..., list[JointPath]]


def trace_still(
    path: Path,
    arm: SerialArm,
    seed: FloatArray | None,
    max_count: int | None,
    trace: Trace,
) -> list[JointPath]:
    """Trace a path while the arm's still joints do not move.

    Near a seed, they stay at the positions of the seed unless the arm cannot complete the path
    there, or only near the ends of its ranges or near a singularity.

    - `seed`, `max_count`: as of `trace_all`.
    - `trace`: `trace_all` with its tolerance.

    Raises:
        Unreachable: No position of the still joints completes the path.
    """
    if seed is None:
        return _trace_at_best(path, arm, max_count, trace)
    staying = None
    try:
        staying = trace(path, arm.hold_still(seed), seed=seed)[:1]
    except Unreachable:
        # The joints move to another position.
        pass
    if staying is not None and posture_cost(arm, staying[0]) <= LEAST_COST:
        return staying
    try:
        others = _trace_at_best(path, arm, None, trace)
    except ArmContourError:
        if staying is None:
            raise
        return staying
    nearest = min(others, key=lambda x: _distance(arm, x, seed))
    if staying is not None:
        limit = (1 + WORSE) * posture_cost(arm, nearest) + LEAST_COST
        if posture_cost(arm, staying[0]) <= limit:
            return staying
    return [nearest]


def release_still(arm: SerialArm) -> SerialArm:
    """Return the arm whose still joints may move, although their motion is very expensive."""
    weights = np.array(arm.chain.weights)
    weights[list(arm.chain.still)] = STILL_WEIGHT
    return arm.holding({}).weighting(weights)


def posture_cost(arm: SerialArm, joint_path: JointPath) -> float:
    """Return the cost of postures near ends of joint ranges and singularities, without motion."""
    return _costs(arm, joint_path)[1]


def cost_of(arm: SerialArm, joint_path: JointPath) -> float:
    """Return the cost of a joint path's motion and of its postures."""
    return sum(_costs(arm, joint_path))


def _costs(arm: SerialArm, joint_path: JointPath) -> tuple[float, float]:
    """Return the costs of a joint path's motion and of its postures; their sum is `PostureCost`."""
    s = np.linspace(0.0, joint_path.length, SAMPLES)
    q = joint_path(s)[None]
    cost = PostureCost(arm, s, q, arm.poses(q[0])[:, :, 2])
    motion = float((((q[:, 1:] - q[:, :-1]) * cost.weights) ** 2).sum())
    return motion, float(cost.values(q)[0]) - motion


def _trace_at_best(
    path: Path, arm: SerialArm, max_count: int | None, trace: Trace
) -> list[JointPath]:
    """Trace a path at the best positions of the still joints, in all configurations."""
    relaxed_paths = trace(path, release_still(arm))
    found: list[JointPath] = []
    refusal: ArmContourError | None = None
    for relaxed in relaxed_paths:
        if len(found) == max_count:
            break
        for start in _starts(arm, relaxed):
            try:
                found += trace(path, arm.hold_still(start), seed=start, max_count=1)
                break
            except (Unreachable, ArmMismatch) as error:
                refusal = refusal or _explained(arm, relaxed, start, error)
    if not found:
        assert refusal is not None
        raise refusal
    return sorted(found, key=lambda x: cost_of(arm, x))


def _starts(arm: SerialArm, relaxed: JointPath) -> Iterator[FloatArray]:
    """Yield joint positions at the start of a path, with positions at which joints may be still.

    - `relaxed`: joint path on which the still joints move a little [rad], (dof,).
    """
    still = list(arm.chain.still)
    q = relaxed(np.linspace(0.0, relaxed.length, SAMPLES))
    low = q[:, still].min(axis=0)
    high = q[:, still].max(axis=0)
    start = q[0].copy()
    start[still] = (low + high) / 2
    yield start
    if len(still) > 1 or (high - low <= ROUNDING).all():
        return
    # One joint that moves although this is expensive: other positions along its motion.
    for position in np.linspace(low[0], high[0], TRIED_POSITIONS):
        other = start.copy()
        other[still] = position
        yield other


def _distance(arm: SerialArm, joint_path: JointPath, q: FloatArray) -> float:
    """Return the largest difference of a joint that is not still from its position in q [rad]."""
    difference = np.abs(joint_path(0.0) - q)
    return float(np.delete(difference, list(arm.chain.still)).max(initial=0.0))


def _explained(
    arm: SerialArm, relaxed: JointPath, start: FloatArray, error: ArmContourError
) -> ArmContourError:
    """Return the error of a path that needs motion of joints that should be still."""
    q = relaxed(np.linspace(0.0, relaxed.length, SAMPLES))
    needs = []
    held = []
    for k in arm.chain.still:
        name = arm.joint_names[k]
        unit = arm.chain.unit("rad", k)
        held.append(f"{name} stays at {number(float(start[k]), unit)}")
        ends = (number(float(x), unit) for x in (q[:, k].min(), q[:, k].max()))
        needs.append(f"{name} from {' to '.join(ends)}")
    return error.with_location(
        f"while {' and '.join(held)} (still; the planner would move {' and '.join(needs)})"
    )
