"""An error over time, with its root mean square and its maximum."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, Value
from armcontour._describing import brief, place_and_time
from armcontour.evaluation.peaks import Peak


@dataclass(frozen=True, slots=True, kw_only=True)
class Missed:
    """The largest distance from a place of the path to the tool.

    Args:
        max: The distance [m].
        t_max: Time at which the tool passes that place [s].
        s_max: Arc length of the place [m].
    """

    max: float
    t_max: float
    s_max: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ErrorProfile(Value):
    """An error over time: a distance [m], or an angle [rad].

    Between the contours of a program nothing is judged: there, all columns except `t` are NaN.

    Args:
        t: Times [s], (n,).
        values: Errors [m or rad], (n,).
        signed: Errors in the plane with a sign: positive to the left of the path, negative to its
            right, (n,); None in space and for errors without a side.
        s: Arc length of the nearest point of the path [m], (n,).
        rms: Root mean square over time [m or rad].
        max: Largest value [m or rad].
        t_max: Time of the largest value [s].
        s_max: Arc length of the largest value [m].
    """

    t: FloatArray
    values: FloatArray
    signed: FloatArray | None
    s: FloatArray
    rms: float
    max: float
    t_max: float
    s_max: float

    def __post_init__(self) -> None:
        for name in ("t", "values", "s"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        if self.signed is not None:
            object.__setattr__(self, "signed", _checks.lock_floats(self.signed))

    def __str__(self) -> str:
        """RMS and largest value in SI units, with time and place."""
        where = place_and_time(self.t_max, self.s_max)
        return f"Error profile: RMS {self.rms:.4g}, largest {self.max:.4g} at {where} (m or rad)"

    __repr__ = brief

    @classmethod
    def over_time(
        cls,
        t: FloatArray,
        values: FloatArray,
        s: FloatArray,
        until: float,
        side: FloatArray | None = None,
        peak: Peak | None = None,
        rms_until: float | None = None,
    ) -> ErrorProfile:
        """Make the profile from the first time to `until`; the last value is kept to the end.

        Args:
            t: Times [s], (n,).
            values: Errors [m or rad], (n,).
            s: Arc length of the nearest point of the path [m], (n,).
            until: End of the profile [s].
            side: 1 to the left of the path, -1 to its right, (n,); None for errors without a side.
            peak: A higher value between the times, which becomes one of the values, but does not
                count for the RMS; or None.
            rms_until: End of the time over which the RMS is taken [s]; by default `until`.
        """
        times, (weighted,) = _cut(t, until if rms_until is None else rms_until, values)
        t, (values, s) = _cut(t, until, values, s)
        span = float(times[-1] - times[0])
        # A profile without duration has one value.
        square = np.trapezoid(weighted**2, times) / span if span > 0 else weighted[-1] ** 2
        if peak is not None:
            # One peak of many: it would count for more than its share of the mean.
            k = int(np.searchsorted(t, peak.t))
            t, values, s = (np.insert(x, k, y) for x, y in zip((t, values, s), peak, strict=True))
            if side is not None:
                side = np.insert(side, k, side[max(k - 1, 0)])
        worst = int(np.argmax(values))
        return cls(
            t=t,
            values=values,
            signed=None if side is None else values * np.append(side, side[-1:])[: len(values)],
            s=s,
            rms=float(np.sqrt(square)),
            max=float(values[worst]),
            t_max=float(t[worst]),
            s_max=float(s[worst]),
        )

    @classmethod
    def join(cls, profiles: Sequence[ErrorProfile]) -> ErrorProfile:
        """Join profiles that follow each other in time, with a gap of NaN between them."""
        if len(profiles) == 1:
            return profiles[0]
        worst = max(profiles, key=lambda x: x.max)
        times = [float(x.t[-1] - x.t[0]) for x in profiles]
        if not sum(times) > 0:
            times = [1.0] * len(profiles)
        squares = sum(x.rms**2 * time for x, time in zip(profiles, times, strict=True))
        signed = [x.signed for x in profiles if x.signed is not None]
        return cls(
            t=np.concatenate([np.append(x.t, x.t[-1]) for x in profiles]),
            values=_with_gaps([x.values for x in profiles]),
            s=_with_gaps([x.s for x in profiles]),
            signed=_with_gaps(signed) if len(signed) == len(profiles) else None,
            rms=float(np.sqrt(squares / sum(times))),
            max=worst.max,
            t_max=worst.t_max,
            s_max=worst.s_max,
        )


def _with_gaps(columns: Sequence[FloatArray]) -> FloatArray:
    """Join columns, with NaN after each."""
    return np.concatenate([np.append(x, np.nan) for x in columns])


def _cut(t: FloatArray, end: float, *columns: FloatArray) -> tuple[FloatArray, list[FloatArray]]:
    """Times up to `end` and the columns there; after the last time its values hold."""
    inside = t < end
    return np.append(t[inside], end), [np.append(x[inside], np.interp(end, t, x)) for x in columns]
