"""Time laws of the paper's method and of the conventional method, and what both require."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.motion import JointPath, LapLaw, Law, LawAlongPath, PathLaw, Rates
from armcontour.planning.law_checks import law_states
from armcontour.robot import Arm, Limits

# Number of bisections in the search for the time at which a law reaches an arc length, enough
# for rounding precision.
BISECTIONS = 50


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineLaw(LapLaw, LawAlongPath):
    """Laps along a straight line of the tool path.

    Between knots, uniform joint accelerations leave the line slightly; s is then the arc length of
    the nearest point of the line.

    Args:
        arm: The arm, whose tool follows the line.
        ends: Arc lengths at the first and the last knot [m].
        point: Point of the line at the first knot [m], (dimension,).
        direction: Unit vector along the line, (dimension,).
    """

    arm: Arm
    ends: tuple[float, float]
    point: FloatArray
    direction: FloatArray
    s: FloatArray = field(init=False)

    def _check_together(self) -> None:
        # `super` without arguments does not work in a dataclass with slots.
        LapLaw._check_together(self)
        # The knots of a traced path are on the line, except for rounding errors.
        s = np.maximum.accumulate(np.clip(self._along(self.q), *self.ends))
        s[0], s[-1] = self.ends
        object.__setattr__(self, "s", checks.frozen_array(s))

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """Return the arc length at `t` [s] of interval `i`, or the derivative `order`, (n,).

        It is the component of the tool's motion along the line.
        """
        q = self.on_interval(i, t, 0)
        if order == 0:
            return np.clip(self._along(q), self.s[i], self.s[i + 1])
        dq = self.on_interval(i, t, 1)
        if order == 1:
            return np.asarray(self.arm.tool_velocity(q, dq) @ self.direction)
        ddq = self.on_interval(i, t, 2)
        return np.asarray(self.arm.tool_acceleration(q, dq, ddq) @ self.direction)

    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        """Return the times at which intervals `i` reach arc lengths inside them [s], (n,).

        The arc length increases within an interval, so the times are found by bisection.
        """
        low = self.breaks[i]
        high = self.breaks[i + 1]
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            too_early = self._along(self.on_interval(i, middle, 0)) < s
            low = np.where(too_early, middle, low)
            high = np.where(too_early, high, middle)
        return high

    def _along(self, q: FloatArray) -> FloatArray:
        """Return the arc lengths of the tool positions projected onto the line [m], (n,).

        - `q`: joint positions [rad], (n, dof).
        """
        return np.asarray(self.ends[0] + (self.arm.tool_position(q) - self.point) @ self.direction)


def path_law(joint_path: JointPath, s: FloatArray, start: FloatArray, end: FloatArray) -> PathLaw:
    """Make the time law with constant path acceleration on each interval.

    With the speeds v0 and v1 at its ends, an interval of length l takes 2 l / (v0 + v1).

    - `s`: arc lengths of the interval ends [m], (n + 1,).
    - `start`: tool speed at the start of each interval [m/s], (n,).
    - `end`: tool speed at the end of each interval [m/s], (n,).
    """
    lengths = np.diff(s)
    durations = 2 * lengths / (start + end)
    zeros = np.zeros_like(lengths)
    rates = Rates(ds=start, dds=(end - start) / durations, slope=zeros, jerk=zeros)
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    return PathLaw(joint_path=joint_path, breaks=breaks, s=s, rates=rates)


def law_peaks(laws: Sequence[Law], arm: Arm) -> dict[str, Any]:
    """Return the peak values of consecutive laws, by the names of the fields of `LawPhase`.

    `demand` contains the largest acceleration of each joint [rad/s²], (dof,), and `speed` the
    largest tool speed [m/s].
    """
    states_by_law = [law_states(law, arm) for law in laws]
    accelerations = [np.abs(states.ddq).max(axis=0) for states in states_by_law]
    speeds = [float(states.measure("speed")[0].max()) for states in states_by_law]
    return {"demand": np.max(accelerations, axis=0), "speed": max(speeds)}


def tool_path_of(joint_path: JointPath, method: str) -> Path:
    """Return the tool path of a joint path; raise InvalidInput if it has none.

    - `method`: name of the planning method, for the message.
    """
    if joint_path.tool_path is None:
        raise InvalidInput(
            f"The method {method} plans along a tool path, but this joint path has none. Pass "
            "a Path to plan, or the joint path that trace returns for it."
        )
    return joint_path.tool_path


def require_speed(limits: Limits, method: str) -> float:
    """Return the assigned velocity [m/s]; raise InvalidInput if the limits have none.

    - `method`: name of the planning method, for the message.
    """
    if limits.speed is None:
        raise InvalidInput(
            f"The method {method} needs an assigned velocity, but no limit speed is specified. "
            "Specify the limit speed [m/s]."
        )
    return limits.speed
