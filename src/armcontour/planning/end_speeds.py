"""Errors for infeasible start and end speeds, with a speed that is feasible.

The planner's value at an end is only an estimate, because margins change with the speed and the
feasible speed at one end depends on the other. Therefore the reported speed is one that was
planned.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from armcontour.core.errors import NotRealizable

START, END = "start speed", "end speed"
# Significant digits of the reported speed. The planner tests the rounded speed.
DIGITS = 6
# Largest number of estimates. After a failed estimate, the speed is reduced by at least the share
# MIN_REDUCTION.
MAX_ESTIMATES = 8
# Relative rounding error of a speed; the planner tolerates it, see END_TOLERANCE in
# `topp/kernels.py`.
ROUNDING = 1e-9
MIN_REDUCTION = 1e-3
# Number of bisections of the speed if the estimates fail.
BISECTIONS = 12


@dataclass(frozen=True, slots=True)
class EndSpeeds:
    """Requested speeds at both ends of a path, and the planner that tests other speeds."""

    # Function that plans with a start and an end speed [m/s]; raises NotRealizable if infeasible
    plan: Callable[[float, float], object]
    start: float  # The requested start speed [m/s]
    end: float  # The requested end speed [m/s]

    def refuse(self, error: NotRealizable) -> NotRealizable:
        """Return an error that states a feasible speed, or `error` if no speed is feasible."""
        # The feasible speed is searched in three steps: first at the end that the error names, with
        # the requested speed at the other end; then at the other end, with the requested speed at
        # the named end; then at the named end, with rest at the other end.
        blamed = START if error.limit == START else END
        other = END if blamed == START else START
        for name in (blamed, other):
            if (allowed := self._find_feasible(name, at_rest=False)) is not None:
                return self._make_error(name, allowed, error, "")
        allowed = self._find_feasible(blamed, at_rest=True)
        if allowed is None:
            return error
        requested = self.end if blamed == START else self.start
        condition = f" with rest at the other end, where {requested:.6g} m/s is also too high"
        return self._make_error(blamed, allowed, error, condition)

    def _find_feasible(self, name: str, *, at_rest: bool) -> float | None:
        """Feasible speed at one end [m/s], close to the largest; None if no speed is feasible."""
        # `at_rest` means that the speed at the other end is zero instead of the requested one.
        requested = self.start if name == START else self.end
        speed = requested
        for _ in range(MAX_ESTIMATES):
            failed = self._plan_error(name, speed, at_rest)
            if failed is None:
                return speed
            if failed.limit != name or failed.allowed is None:
                break
            speed = _round_down(min(float(failed.allowed), speed * (1 - MIN_REDUCTION)))
        if requested == 0 or self._plan_error(name, 0.0, at_rest) is not None:
            return None
        low, high = 0.0, requested
        for _ in range(BISECTIONS):
            middle = _round_down((low + high) / 2)
            low, high = (
                (middle, high) if self._plan_error(name, middle, at_rest) is None else (low, middle)
            )
        return low

    def _plan_error(self, name: str, speed: float, at_rest: bool) -> NotRealizable | None:
        """Error of the planner for a speed at one end; None if the speed is feasible."""
        start = speed if name == START else 0.0 if at_rest else self.start
        end = speed if name == END else 0.0 if at_rest else self.end
        try:
            self.plan(start, end)
        except NotRealizable as error:
            return error
        return None

    def _make_error(
        self, name: str, allowed: float, error: NotRealizable, condition: str
    ) -> NotRealizable:
        requested = self.start if name == START else self.end
        s = error.s if error.limit == name else None
        position = "" if s is None else f"at {s:.6g} m along the path "
        return NotRealizable(
            f"The {name} of {requested:.6g} m/s is too high: {position}the limits allow "
            f"{allowed:.{DIGITS}g} m/s{condition}.",
            s=s,
            limit=name,
            needed=requested,
            allowed=allowed,
        )


def raise_too_fast(name: str, x: float, allowed: float, s: float) -> NoReturn:
    """Raise the error for a start or end speed; `x` and `allowed` are squared speeds [m²/s²]."""
    raise NotRealizable(
        f"The {name} speed of {np.sqrt(x):.6g} m/s is too high: at {s:.6g} m along the path the "
        f"limits allow {np.sqrt(max(allowed, 0.0)):.6g} m/s.",
        s=s,
        limit=f"{name} speed",
        needed=float(np.sqrt(x)),
        allowed=float(np.sqrt(max(allowed, 0.0))),
    )


def _round_down(speed: float) -> float:
    """Round a speed, increased by its rounding error, down to DIGITS significant digits."""
    if speed <= 0:
        return 0.0
    speed *= 1 + ROUNDING
    digit = 10.0 ** (np.floor(np.log10(speed)) - DIGITS + 1)
    rounded = float(f"{np.floor(speed / digit) * digit:.{DIGITS}g}")
    return rounded if rounded <= speed else float(f"{rounded - digit:.{DIGITS}g}")
