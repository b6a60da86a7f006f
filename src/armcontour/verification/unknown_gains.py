"""Contour error of the worst robot whose gains differ slightly from those of a simulated servo.

To first order in the gains, the joint positions of a robot with other gains deviate by

    δq_j(t) = Σ_g σ_gj ∂q_j/∂g_j δg_j

with the gains g (K_p and K_v) of joint j, each of which differs by the same share in all joints, up
or down (σ = ±1). The joints of a servo model are independent, so one simulation per gain, in which
this gain of all joints is larger, gives all these deviations. The tool then leaves the path by the
part of

    Σ_j J_j δq_j(t)

normal to the tool's motion, with the column J_j of the Jacobian. In a direction d, it is largest if
each sign agrees with that of d·J_j δq_j. The worst robot is that of the worst direction and time.
If joints saturate, the deviations are not proportional to those of the gains. Then the robot that
is worst to first order, and the one with opposite deviations, are simulated as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import number
from armcontour.motion.execution import Execution
from armcontour.verification.error_profile import ErrorProfile

# Share by which the gains of each joint differ, unless a servo states their spread.
UNKNOWN_SHARE = 0.01
# Largest number of times at which the errors are computed.
MAX_TIMES = 20_000
# Number of directions normal to the motion; others differ by 4 degrees at most.
DIRECTIONS = 24
# Below this speed of the tool [m/s], its motion has no direction.
RESTING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class UnknownGains:
    """Contour error of the worst robot whose gains differ, to first order.

    Args:
        shares: Share by which each gain differs in each joint, up or down, by the gain's name.
        measured: True if the shares are the measured spread of the servo.
        max: Largest contour error of the worst such robot [m]; an estimate, not a bound.
        t_max: Its time [s].
        signs: Signs of the deviations of that robot's gains, (gains, dof).
        saturates: True if a joint saturates in one of the simulations.
    """

    shares: Mapping[str, float]
    measured: bool
    max: float
    t_max: float
    signs: FloatArray
    saturates: bool

    @property
    def words(self) -> str:
        """By how much the gains differ, such as "gains 1 % off"."""
        if not self.measured:
            return f"gains {number(UNKNOWN_SHARE, '1')} off"
        listed = ", ".join(f"{name} {number(x, '1')}" for name, x in self.shares.items())
        return f"gains off by {listed}"


def worst_with_other_gains(
    executed: Execution,
    others: Sequence[Execution],
    error: ErrorProfile,
    shares: Mapping[str, float],
    measured: bool,
) -> UnknownGains | None:
    """Estimate the contour error of the worst robot with other gains.

    None if no time of the executions is on a contour, because all contours are shorter than a
    cycle.

    Args:
        executed: The execution by the known servo.
        others: Executions of the same set-points, at common times; in each, one gain of all joints
            is larger by its share.
        error: Contour error of `executed`.
        shares: As in `UnknownGains`, in the order of `others`.
        measured: As in `UnknownGains`.
    """
    times = others[0].t
    # Before, between and after the contours, there is no contour error.
    known = np.interp(times, error.t, error.values, left=np.nan, right=np.nan)
    judged = np.flatnonzero(np.isfinite(known))
    if not len(judged):
        return None
    judged = judged[:: -(-len(judged) // MAX_TIMES)]
    t = times[judged]
    q = _at(executed, executed.q, t)
    jacobian = executed.arm.tool_jacobian(q)
    velocity = (jacobian @ _at(executed, executed.dq, t)[:, :, None])[:, :, 0]
    moved = np.concatenate([jacobian * (_at(x, x.q, t) - q)[:, None, :] for x in others], axis=2)
    added, directions = _largest_sums(moved, velocity)
    worst = known[judged] + added
    k = int(worst.argmax())
    signs = np.where(directions[k] @ moved[k] < 0.0, -1.0, 1.0)
    return UnknownGains(
        shares=shares,
        measured=measured,
        max=float(worst[k]),
        t_max=float(t[k]),
        signs=signs.reshape(len(others), -1),
        saturates=any(x.saturated_time.any() for x in (executed, *others)),
    )


def _at(execution: Execution, values: FloatArray, t: FloatArray) -> FloatArray:
    """Interpolate a column per joint of an execution at times [s], (n, dof)."""
    return np.column_stack([np.interp(t, execution.t, x) for x in values.T])


def _largest_sums(moved: FloatArray, velocity: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the largest lengths of sums of vectors with any signs, normal to the motion, (n,).

    Also return the unit vectors in whose directions these sums are, (n, dimension).

    - `moved`: vectors [m], (n, dimension, vectors).
    - `velocity`: velocities of the tool [m/s], (n, dimension).
    """
    largest = np.zeros(len(moved))
    directions = np.zeros_like(velocity)
    for direction in _directions(velocity):
        sums = np.abs(np.einsum("ni,nij->nj", direction, moved)).sum(axis=1)
        larger = sums > largest
        largest[larger] = sums[larger]
        directions[larger] = direction[larger]
    return largest, directions


def _directions(velocity: FloatArray) -> Iterator[FloatArray]:
    """Yield unit vectors normal to velocities, (n, dimension) each, all around the motion.

    At rest, they are normal to an axis.
    """
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    resting = np.zeros(velocity.shape[1])
    resting[0] = 1.0
    tangent = np.where(speed > RESTING, velocity / np.maximum(speed, RESTING), resting)
    if velocity.shape[1] == 2:
        yield tangent[:, ::-1] * (-1.0, 1.0)
        return
    upright = np.abs(tangent[:, 2:]) < np.sqrt(0.5)
    first = np.cross(tangent, np.where(upright, (0.0, 0.0, 1.0), (1.0, 0.0, 0.0)))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(tangent, first)
    for angle in np.linspace(0.0, np.pi, DIRECTIONS, endpoint=False):
        yield np.cos(angle) * first + np.sin(angle) * second
