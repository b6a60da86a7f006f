"""Start and end speeds that cannot be had: the refusal names one that can.

What a pass of the planner finds at an end is an estimate only: margins change with the speed, and
what one end allows depends on the other. So the speed that is named was planned with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from armcontour.core.errors import NotRealizable

START, END = "start speed", "end speed"
# A speed is named with this many digits, and planned with as it is named.
DIGITS = 6
# Estimates that are followed; each that fails is lowered by at least the share LOWER.
MOST_ESTIMATES = 8
# Relative rounding error of a speed that a plan allows; it counts as allowed, see `PLAY`.
ROUNDING = 1e-9
LOWER = 1e-3
# Where estimates lead nowhere, the interval of speeds is halved so often.
HALVINGS = 12


@dataclass(frozen=True, slots=True)
class Ends:
    """Speeds at the ends of a path.

    Args:
        plan: Plans with a start and an end speed [m/s], or raises NotRealizable.
        start: The start speed that was asked for [m/s].
        end: The end speed that was asked for [m/s].
    """

    plan: Callable[[float, float], object]
    start: float
    end: float

    def refuse(self, error: NotRealizable) -> NotRealizable:
        """The refusal of the speeds, with a speed that can be had.

        It is the speed at the blamed end with that at the other end as asked for, or else the
        other way round. If either speed is too high whatever the other is, the blamed one with rest
        at the other end.

        Args:
            error: What the planner raised.
        """
        blamed = START if error.limit == START else END
        other = END if blamed == START else START
        for name in (blamed, other):
            if (allowed := self._allowed(name, at_rest=False)) is not None:
                return self._refusal(name, allowed, error, "")
        allowed = self._allowed(blamed, at_rest=True)
        if allowed is None:
            return error
        asked = self.end if blamed == START else self.start
        when = f" and rest at the other end, where {asked:.6g} m/s is too high as well"
        return self._refusal(blamed, allowed, error, when)

    def _allowed(self, name: str, *, at_rest: bool) -> float | None:
        """A speed near the largest at one end, or None if there is none below the given one.

        Args:
            name: START or END.
            at_rest: Whether the other speed is zero, not as asked for.
        """
        given = self.start if name == START else self.end
        speed = given
        for _ in range(MOST_ESTIMATES):
            failed = self._failure(name, speed, at_rest)
            if failed is None:
                return speed
            if failed.limit != name or failed.allowed is None:
                break
            speed = _round_down(min(float(failed.allowed), speed * (1 - LOWER)))
        if given == 0 or self._failure(name, 0.0, at_rest) is not None:
            return None
        low, high = 0.0, given
        for _ in range(HALVINGS):
            middle = _round_down((low + high) / 2)
            low, high = (
                (middle, high) if self._failure(name, middle, at_rest) is None else (low, middle)
            )
        return low

    def _failure(self, name: str, speed: float, at_rest: bool) -> NotRealizable | None:
        """Why a speed at one end cannot be had; None if it can."""
        start = speed if name == START else 0.0 if at_rest else self.start
        end = speed if name == END else 0.0 if at_rest else self.end
        try:
            self.plan(start, end)
        except NotRealizable as error:
            return error
        return None

    def _refusal(self, name: str, allowed: float, error: NotRealizable, when: str) -> NotRealizable:
        given = self.start if name == START else self.end
        s = error.s if error.limit == name else None
        place = "" if s is None else f"at {s:.6g} m along the path "
        return NotRealizable(
            f"The {name} of {given:.6g} m/s is too high: {place}the limits allow "
            f"{allowed:.{DIGITS}g} m/s{when}.",
            s=s,
            limit=name,
            needed=given,
            allowed=allowed,
        )


def raise_too_fast(name: str, x: float, allowed: float, s: float) -> NoReturn:
    """Refuse a start or end speed; `x` and `allowed` are squares of speeds [m²/s²].

    Raises:
        NotRealizable: Always.
    """
    raise NotRealizable(
        f"The {name} speed of {np.sqrt(x):.6g} m/s is too high: at {s:.6g} m along the path the "
        f"limits allow {np.sqrt(max(allowed, 0.0)):.6g} m/s.",
        s=s,
        limit=f"{name} speed",
        needed=float(np.sqrt(x)),
        allowed=float(np.sqrt(max(allowed, 0.0))),
    )


def _round_down(speed: float) -> float:
    """A speed with DIGITS digits that is higher by rounding errors at most."""
    if speed <= 0:
        return 0.0
    speed *= 1 + ROUNDING
    digit = 10.0 ** (np.floor(np.log10(speed)) - DIGITS + 1)
    found = float(f"{np.floor(speed / digit) * digit:.{DIGITS}g}")
    return found if found <= speed else float(f"{found - digit:.{DIGITS}g}")
