"""When the parts of a command reach a joint: dead time is a shift in continuous time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray, IntArray

# An instant this close to a set-point, in periods, is that of the set-point.
SNAP = 1e-9


def values(pieces: FloatArray, period: float, dead_time: FloatArray, t: FloatArray) -> FloatArray:
    """What the joints' servos see of `servo.command.polynomials`, (len(t), dof) [rad].

    Args:
        pieces: The command of every joint, (dof, n + 1, 4).
        period: Command interval [s].
        dead_time: Of every joint, (dof,) [s].
        t: Times since the first set-point [s].
    """
    found = np.empty((len(t), len(pieces)))
    for j, own in enumerate(pieces):
        at = (t - dead_time[j]) / period
        k = np.clip(np.floor(at + SNAP), -1, len(own) - 2).astype(np.intp)
        # Nothing moves in the first interval, nor in the last.
        x = np.where((k < 0) | (k > len(own) - 3), 0.0, np.maximum(at - k, 0.0) * period)
        a = own[k + 1]
        found[:, j] = a[:, 0] + x * (a[:, 1] + x * (a[:, 2] + x * a[:, 3]))
    return found


@dataclass(frozen=True, slots=True)
class Pattern:
    """How results and the set-points that a joint sees divide each command interval.

    Set-points arrive every period, as results do; so the pattern is the same in all intervals.

    Args:
        width: Lengths of the parts [s], (m,).
        source: Which interval of the command holds in each, next to that of the same number, (m,).
        local: Time since that one's first set-point at the part's beginning [s], (m,).
        result: Whether a result is due at the part's end, (m,).
    """

    width: FloatArray
    source: IntArray
    local: FloatArray
    result: npt.NDArray[np.bool_]


def pattern(period: float, steps: int, dead_time: float) -> Pattern:
    """The parts of one command interval for a joint whose command comes `dead_time` late."""
    whole = int(np.floor(dead_time / period + SNAP))
    late = max(dead_time - whole * period, 0.0)
    span = period / steps
    ends = np.arange(1, steps + 1) * span
    ends[-1] = period
    due = np.ones(steps, dtype=np.bool_)
    near = int(np.floor(late / span + 0.5))
    if abs(late - near * span) < SNAP * period:
        late = near * span if near < steps else period
    else:
        place = int(np.searchsorted(ends, late))
        ends, due = np.insert(ends, place, late), np.insert(due, place, False)
    begins = np.append(0.0, ends[:-1])
    before = begins < late * (1 - 1e-12)
    return Pattern(
        width=ends - begins,
        source=np.where(before, -whole - 1, -whole),
        local=np.where(before, begins + (period - late), np.maximum(begins - late, 0.0)),
        result=due,
    )
