"""Limits of jerk, as explanations need them: how far a plan uses them on every interval.

Plans keep them by `timing.jerk`, not by rows of u and x: jerk is not linear in those. Inside an
interval jerk is `q''' ds³ + 3 q'' ds dds + q' s'''`, which may be largest between the ends.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.arms.limits import JERK_LIMITS, or_unlimited
from armcontour.timing.constraints.base import Constraint, IntervalEnds


class _Jerk(Constraint):
    """A limit of jerk; a plan's use of it is the largest one at places of an interval.

    Args:
        limit_name: A field of `Limits`.
        limit: The limit; infinite for joints without one.
    """

    def __init__(self, limit_name: str, limit: float | FloatArray) -> None:
        self.limit_name, self.limit = limit_name, limit
        self.joints = limit_name == "joint_jerk"
        self.name = limit_name.removeprefix("joint_").replace("_", " ")

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Largest used share on every interval, at its ends and inside it."""
        if self.limit_name == "path_jerk":
            found = ends.law.path_position(*ends.places, 3)
        else:
            found, _ = ends.inside.bound(self.limit_name)
        found = np.abs(found).reshape(-1, len(ends.grid), np.size(self.limit))
        return np.asarray((found / self.limit).max(axis=0))


def jerks_of(limits: Limits, dof: int) -> list[Constraint]:
    """The constraints that limits of jerk mean; none without such a limit."""
    given = {x: getattr(limits, x) for x in JERK_LIMITS}
    return [
        _Jerk(x, or_unlimited(limit, dof) if x == "joint_jerk" else limit)
        for x, limit in given.items()
        if limit is not None
    ]
