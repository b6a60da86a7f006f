"""Taught data: what the controller is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.motion.trajectory import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TaughtData:
    """Joint set-points at regular times.

    Args:
        period: Command interval [s].
        q: Set-points [rad], (n, dof); the k-th holds at k periods, the last from then on.
        trajectory: The realizable trajectory they are to bring about.
        method: Name of the compensation that made them.

    Raises:
        InvalidInput: Not one finite set-point per time and joint.
    """

    period: float
    q: FloatArray
    trajectory: Trajectory
    method: str

    def __post_init__(self) -> None:
        _checks.positive("command interval", self.period, "s")
        values = _checks.numbers("set-points", self.q, "rad")
        if values.ndim != 2 or len(values) == 0:
            raise InvalidInput("Taught data needs at least one row of set-points, one per joint.")
        object.__setattr__(self, "q", _checks.locked(values))

    @property
    def t(self) -> FloatArray:
        """Times of the set-points [s], (n,)."""
        return np.arange(len(self.q), dtype=np.float64) * self.period
