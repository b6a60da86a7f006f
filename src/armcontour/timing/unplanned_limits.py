"""Check of the laws of a method for limits that the method does not plan for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.arms import Arm, Limits
from armcontour.arms.limits import UNITS
from armcontour.errors import NotRealizable
from armcontour.motion import LawAlongPath
from armcontour.timing.common import law_states, sample_times
from armcontour.timing.limit_use import States, allowed, quantity

# A law may exceed a limit by rounding only.
ROUNDING = 1e-6
# Words after a unit that does not name the quantity by itself.
OF = {"angular_speed": " of turning", "angular_acceleration": " of turning"}


def refuse_broken(
    laws: Sequence[LawAlongPath],
    arm: Arm,
    limits: Limits,
    names: Sequence[str],
    *,
    where: str,
    t: float,
    mends: str,
) -> None:
    """Refuse laws that break one of the named limits at a sample.

    Args:
        laws: The laws, one after the other.
        arm: The arm.
        limits: The limits. A named limit that is None is not checked.
        names: Fields of `Limits` to check.
        where: First words of the error message; the arc length follows.
        t: Start time of the first law [s].
        mends: Last words of the error message: what would help.

    Raises:
        NotRealizable: With position and time, the joint, the value it would need, and the limit.
        InvalidInput: A torque limit for an arm without masses, or a limit of angular motion for a
            tool without orientation.
    """
    given = [name for name in names if getattr(limits, name) is not None]
    start = t
    for law in laws if given else ():
        states = law_states(law, arm)
        for name in given:
            _refuse_in_law(law, states, limits, name, where, start, mends)
        start += float(law.breaks[-1])


def _refuse_in_law(
    law: LawAlongPath,
    states: States,
    limits: Limits,
    name: str,
    where: str,
    start: float,
    mends: str,
) -> None:
    """Refuse a law that starts at the time `start` [s] and breaks one limit.

    Raises:
        NotRealizable: With position and time, the joint, the value it would need, and the limit.
    """
    found = quantity(name, states)
    most = np.broadcast_to(allowed(name, limits, states), found.shape)
    over = found / most
    if over.max() <= 1 + ROUNDING:
        return
    at = np.unravel_index(int(np.argmax(over)), found.shape)
    joint = int(at[1]) + 1 if len(at) == 2 else None
    needed, limit = abs(float(found[at])), abs(float(most[at]))
    who = "the tool" if joint is None else f"joint {joint}"
    intervals, times = sample_times(law)
    s = float(law.path_position(intervals[at[0]], times[at[0]]))
    raise NotRealizable(
        f"{where}, at {s:.4g} m, {who} would need {needed:.4g} {UNITS[name]}{OF.get(name, '')}, "
        f"but its limit is {limit:.4g} {UNITS[name]}: {mends}.",
        s=s,
        t=start + float(times[at[0]]),
        joint=joint,
        limit=name,
        needed=needed,
        allowed=limit,
    )
