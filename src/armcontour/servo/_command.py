"""Compiled cubic commands of a joint."""

from __future__ import annotations

from typing import NamedTuple

from armcontour._kernels import FUSED, compiled


class Cubic(NamedTuple):
    """Coefficients of a command that is a cubic in time [rad, rad/s, rad/s², rad/s³]."""

    value: float
    rate: float
    second: float
    third: float


@compiled(inner=True, fastmath=FUSED)
def evaluate(u: Cubic, t: float) -> float:
    """Value of the command at time t [rad]."""
    return u.value + t * (u.rate + t * (u.second + t * u.third))


@compiled(inner=True, fastmath=FUSED)
def shift(u: Cubic, t: float) -> Cubic:
    """The same command, with time counted from t."""
    rate = u.rate + t * (2 * u.second + t * 3 * u.third)
    return Cubic(evaluate(u, t), rate, u.second + 3 * u.third * t, u.third)
