"""Checking a continuous law: random places between all breaks, and both sides of every break."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.errors import InvalidInput
from armcontour.evaluation.tally import STILL, States, Tally
from armcontour.motion import Trajectory

# Places that are judged at a time.
CHUNK = 200_000
# Accelerations may jump at a break by what a limit of jerk covers in this time [s], which no
# controller resolves: jumps by rounding are smaller, those of plans without such a limit larger.
AT_ONCE = 1e-5
# Limits of jerk, with the jumps at breaks that break them.
JUMPS = {
    "joint_jerk": "acceleration_step",
    "tool_jerk": "tool_acceleration_step",
    "path_jerk": "path_acceleration_step",
}
ORDERS = ("positions", "velocities", "accelerations", "jerks")
# Joint positions may jump by this much at a break [rad]: rounding, not motion.
POSITION_STEP = 1e-9


class Law(Protocol):
    """Joint positions over time as a law, such as a `Trajectory`."""

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""

    @property
    def breaks(self) -> FloatArray:
        """Times between which the law is smooth, its start and end included [s]."""

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Joint positions, velocities, accelerations or jerks, (n, dof).

        Of a law that refuses the order 3, jerk is not judged.
        """


def judge_law(law: Law, tally: Tally, *, points: int, seed: int, velocity_step: float) -> int:
    """Offer the law's states to the tally; returns how many.

    Args:
        law: The law.
        tally: Where findings go.
        points: Random places per interval.
        seed: Of the random places.
        velocity_step: Largest jump of a joint's velocity at a break [rad/s].

    Raises:
        InvalidInput: Breaks that do not increase, or a value that is not finite.
    """
    breaks = np.asarray(law.breaks, dtype=np.float64)
    if breaks.ndim != 1 or len(breaks) < 2 or not (np.diff(breaks) > 0).all():
        raise InvalidInput("The breaks of a law must be at least two times that increase.")
    random = np.random.default_rng(seed)
    jerks = find_known_jerks(law, tally.limits, breaks[:1])
    size = max(1, CHUNK // (points + 2))
    count = 0
    for first in range(0, len(breaks) - 1, size):
        ends = breaks[first : first + size + 1]
        inner = ends[:-1, None] + random.random((len(ends) - 1, points)) * np.diff(ends)[:, None]
        right = np.concatenate([ends[:-1], inner.ravel()])
        left = ends[1:]
        states = offer_states(law, tally, right, left, jerks)
        count += len(states.t)
        tally.pose(states.t, states.q, states.errors[0])
        if "path_jerk" in jerks:
            offer_path_jerk(law, tally, right, left, states)
        _acceleration_steps(
            law, ends if first == 0 else left, tally, jerks, (breaks[0], breaks[-1])
        )
        _steps(
            law, ends[1:] if first + size < len(breaks) - 1 else ends[1:-1], tally, velocity_step
        )
    return count


def offer_states(
    law: Law, tally: Tally, right: FloatArray, left: FloatArray, jerks: Collection[str]
) -> States:
    """Offer what joints and tool do at some times to a tally.

    Args:
        law: The law.
        tally: Where findings go.
        right: Times at which a break belongs to the interval after it [s], (n,).
        left: Times at which a break belongs to the interval before it [s], (m,).
        jerks: The limits of jerk that are judged.

    Returns:
        The states, (n + m, dof).

    Raises:
        InvalidInput: A value is not finite, or the law has another number of joints.
    """
    # Of joints and tool the third derivative is asked for only where it is judged.
    order = 3 if set(jerks) - {"path_jerk"} else 2
    states = _states(law, right, left, tally.arm.dof, order)
    tally.states(states)
    return states


def offer_path_jerk(
    law: Law, tally: Tally, right: FloatArray, left: FloatArray, states: States
) -> None:
    """Offer the path jerk at some times to a tally; arguments as of `offer_states`."""
    along = cast("Any", law)
    rate = np.concatenate([along.s(right, 3), along.s(left, 3, side="left")])
    tally.offer("path_jerk", states.t, np.abs(rate), _limit(tally, "path_jerk"), states.q)


def _states(law: Law, right: FloatArray, left: FloatArray, dof: int, order: int) -> States:
    t = np.concatenate([right, left])
    if isinstance(law, Trajectory):
        # All derivatives at once.
        after, before = law.motion(right, order), law.motion(left, order, side="left")
    else:
        after, before = (
            tuple(law(at, k, side=side) for k in range(order + 1))
            for at, side in ((right, "right"), (left, "left"))
        )
    columns = []
    for name, *sides in zip(ORDERS[: order + 1], after, before, strict=True):
        values = np.concatenate(sides)
        if values.shape != (len(t), dof):
            raise InvalidInput(
                f"The law gives {values.shape[-1]} joints, but the arm has {dof}: "
                "give the arm that the law was made for."
            )
        if not np.isfinite(values).all():
            at = float(t[~np.isfinite(values).all(axis=1)][0])
            raise InvalidInput(f"The law's {name} are not finite at t = {at:.9g} s.", t=at)
        columns.append(values)
    q, dq, ddq, *dddq = columns
    none = np.zeros(dof)
    return States(t=t, q=q, dq=dq, ddq=ddq, errors=(none,) * 3, dddq=dddq[0] if dddq else None)


def _steps(law: Law, t: FloatArray, tally: Tally, velocity_step: float) -> None:
    """Offer the jumps at breaks, which no acceleration at either side would show."""
    if not len(t):
        return
    q = law(t)
    tally.offer("position_step", t, np.abs(q - law(t, side="left")), POSITION_STEP, q)
    limits = tally.limits
    derived = (limits.joint_acceleration, limits.joint_torque, limits.joint_jerk)
    if any(x is not None for x in derived):
        jump = np.abs(law(t, 1) - law(t, 1, side="left"))
        tally.offer("velocity_step", t, jump, velocity_step, q)


def _acceleration_steps(
    law: Law, t: FloatArray, tally: Tally, names: Collection[str], ends: tuple[float, float]
) -> None:
    """Offer the jumps of accelerations at breaks, which no jerk at either side would show.

    Before a motion that starts at rest, and after one that ends at rest, accelerations are zero.

    Args:
        law: The law.
        t: Breaks [s], (n,).
        tally: Where findings go.
        names: The limits of jerk that are judged.
        ends: The first and the last break [s].
    """
    if not names:
        return
    q = law(t)
    resting = np.abs(law(t, 1)).max(axis=1) <= STILL
    for name in names:
        before, after = (_accelerations(law, t, tally, name, side) for side in ("left", "right"))
        before[resting & (t == ends[0])] = 0.0
        after[resting & (t == ends[1])] = 0.0
        jump = np.abs(after - before)
        size = jump if name == "joint_jerk" else np.linalg.norm(jump, axis=1)
        tally.offer(JUMPS[name], t, size, AT_ONCE * _limit(tally, name), q)


def _limit(tally: Tally, name: str) -> FloatArray:
    return np.asarray(getattr(tally.limits, name))


def _accelerations(law: Law, t: FloatArray, tally: Tally, name: str, side: str) -> FloatArray:
    """The accelerations whose rate a limit of jerk bounds, at one side of times, (n, columns)."""
    if name == "path_jerk":
        return np.array(cast("Any", law).s(t, 2, side=side))[:, None]
    q, dq, ddq = (law(t, order, side=side) for order in range(3))
    return np.array(ddq if name == "joint_jerk" else tally.arm.tool_acceleration(q, dq, ddq))


def find_known_jerks(law: Law, limits: Limits, start: FloatArray) -> tuple[str, ...]:
    """Find the limits of jerk that can be judged of a law: of joints and tool, along a path.

    Args:
        law: The law.
        limits: The limits.
        start: Its first time [s], (1,).
    """
    limited = (x for x in JUMPS if getattr(limits, x) is not None)
    return tuple(x for x in limited if _knows_jerk(law, start, along=x == "path_jerk"))


def _knows_jerk(law: Law, start: FloatArray, *, along: bool) -> bool:
    """Whether a law has a third derivative, of its joints or `along` its tool path."""
    # Of a law without a tool path s is the value of any parameter.
    if along and getattr(law, "path", None) is None:
        return False
    try:
        _ = cast("Any", law).s(start, 3) if along else law(start, 3)
    except (InvalidInput, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return False
    return True
