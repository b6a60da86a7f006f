"""Checking a continuous law: random places between all breaks, and both sides of every break."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.evaluation.tally import States, Tally

# Places that are judged at a time.
CHUNK = 200_000
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
        """Joint positions, velocities or accelerations, (n, dof)."""


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
    size = max(1, CHUNK // (points + 2))
    count = 0
    for first in range(0, len(breaks) - 1, size):
        ends = breaks[first : first + size + 1]
        inner = ends[:-1, None] + random.random((len(ends) - 1, points)) * np.diff(ends)[:, None]
        right = np.concatenate([ends[:-1], inner.ravel()])
        left = ends[1:]
        states = _states(law, right, left, tally.arm.dof)
        count += len(states.t)
        tally.states(states)
        tally.pose(states.t, states.q, states.errors[0])
        _steps(
            law, ends[1:] if first + size < len(breaks) - 1 else ends[1:-1], tally, velocity_step
        )
    return count


def _states(law: Law, right: FloatArray, left: FloatArray, dof: int) -> States:
    t = np.concatenate([right, left])
    columns = []
    for order, name in enumerate(("positions", "velocities", "accelerations")):
        values = np.concatenate([law(right, order), law(left, order, side="left")])
        if values.shape != (len(t), dof):
            raise InvalidInput(
                f"The law gives {values.shape[-1]} joints, but the arm has {dof}: "
                "give the arm that the law was made for."
            )
        bad = ~np.isfinite(values).all(axis=1)
        if bad.any():
            at = float(t[bad][0])
            raise InvalidInput(f"The law's {name} are not finite at t = {at:.9g} s.", t=at)
        columns.append(values)
    none = np.zeros(dof)
    return States(t=t, q=columns[0], dq=columns[1], ddq=columns[2], errors=(none, none, none))


def _steps(law: Law, t: FloatArray, tally: Tally, velocity_step: float) -> None:
    """Offer the jumps at breaks, which no acceleration at either side would show."""
    if not len(t):
        return
    q = law(t)
    tally.offer("position_step", t, np.abs(q - law(t, side="left")), POSITION_STEP, q)
    limits = tally.limits
    if limits.joint_acceleration is not None or limits.joint_torque is not None:
        jump = np.abs(law(t, 1) - law(t, 1, side="left"))
        tally.offer("velocity_step", t, jump, velocity_step, q)
