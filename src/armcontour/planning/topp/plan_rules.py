"""Parameters and results of the planner on a grid."""

from __future__ import annotations

from typing import NamedTuple

from armcontour.core.checks import FloatArray

FOUND, FINER, STUCK, START, END, UNLIMITED = range(6)


class Rules(NamedTuple):
    """Parameters of the planner on a grid."""

    start: float = 0.0  # ds² at the start [m²/s²]; infinite for the largest feasible value
    end: float = 0.0  # ds² at the end [m²/s²]; infinite for the largest feasible value
    max_margin: float = 1e-2  # Largest fraction of a limit that margins may take
    # If margins exceed `max_margin`, slopes are first set to zero on intervals whose margins exceed
    # this share
    steady: float = 0.999
    headroom: float = 1.05  # Factor of the bounds of x and u relative to the plan without margins
    close: float = 1.02  # The same factor relative to a proven plan
    # U, the bound of |u|, includes this many neighbours on each side, because switching points move
    window: int = 1
    # Smallest U: this fraction of the largest |u| on the path, or of x divided by the width of the
    # interval if that is less, because |u| is unbounded where dq_ds vanishes
    floor: float = 1e-3
    tangents: int = 2  # Largest number of plans without margins in which friction is linearized
    near: float = 1e-2  # Relative change of x below which the linearization of friction is accepted
    tries: int = 30  # Largest number of plans on a grid
    # With more intervals, a plan that fails with margins is an error instead of FINER
    enough: int = 20_000
    # Bounds are tightened while this reduces the duration by more than this share
    gain: float = 1e-6
    # True if the time that the plan loses is estimated
    estimates_loss: bool = False


class PlanArrays(NamedTuple):
    """Arrays of a plan on n intervals, which the planner writes."""

    x: FloatArray  # ds² at the ends of the intervals [m²/s²], (n + 1,)
    k: FloatArray  # Derivatives of dds in s [1/s²], (n,)
    lost: FloatArray  # Fraction of limits that margins take, (n,)
    breaks: FloatArray  # Times at the ends of the intervals [s], (n + 1,)
    ds: FloatArray  # Path speeds at the starts of the intervals [m/s], (n,)
    dds: FloatArray  # Path accelerations at the starts of the intervals [m/s²], (n,)
    # Time that is lost on each interval [s], (n,), if `Rules.estimates_loss` is true
    loss: FloatArray
    # Point in each interval at which a new grid point saves most [m], (n,), or the start of the
    # interval
    point: FloatArray
