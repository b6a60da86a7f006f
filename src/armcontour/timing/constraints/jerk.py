"""Limits of jerk, as explanations need them: how far a plan uses them on every interval.

Plans keep them by `timing.jerk`, not by rows of u and x: jerk is not linear in those. Inside an
interval jerk is `q''' ds³ + 3 q'' ds dds + q' s'''`, which may be largest between the ends.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.arms.limits import or_unlimited
from armcontour.timing.constraints.base import Constraint, IntervalEnds
from armcontour.timing.limit_use import quantity


class _Jerk(Constraint):
    """A limit of jerk; a plan's use of it is the largest one at places of an interval.

    Args:
        limit: The limit.
    """

    def __init__(self, limit: float | FloatArray) -> None:
        self.limit = limit

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Largest used share on every interval, at its ends and inside it."""
        found = np.abs(self._values(ends)).reshape(-1, len(ends.grid), np.size(self.limit))
        return np.asarray((found / self.limit).max(axis=0))

    def _values(self, ends: IntervalEnds) -> FloatArray:
        return quantity(self.limit_name, ends.inside)


class JointJerk(_Jerk):
    """`|dddq| <= limit` for every joint [rad/s³], infinite where there is none."""

    name = "jerk"
    limit_name = "joint_jerk"
    joints = True


class ToolJerk(_Jerk):
    """Largest jerk of the tool, as a vector's length [m/s³]."""

    name = "tool jerk"
    limit_name = "tool_jerk"


class PathJerk(_Jerk):
    """Largest third derivative of the arc length over time, either way [m/s³]."""

    name = "path jerk"
    limit_name = "path_jerk"

    def _values(self, ends: IntervalEnds) -> FloatArray:
        return ends.law.path_position(*ends.places, 3)


def jerks_of(limits: Limits, dof: int) -> list[Constraint]:
    """The constraints that limits of jerk mean; none without such a limit."""
    found: list[Constraint] = []
    if limits.joint_jerk is not None:
        found.append(JointJerk(or_unlimited(limits.joint_jerk, dof)))
    if limits.tool_jerk is not None:
        found.append(ToolJerk(limits.tool_jerk))
    if limits.path_jerk is not None:
        found.append(PathJerk(limits.path_jerk))
    return found
