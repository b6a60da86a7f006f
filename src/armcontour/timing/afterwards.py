"""Limits that a method does not plan for, looked at along its law."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.arms.limits import JOINT_LIMITS, TOOL_LIMITS
from armcontour.errors import InvalidInput, NotRealizable
from armcontour.motion import LawAlongPath
from armcontour.timing.common import law_places, law_states
from armcontour.timing.constraints.angular import require_orientation

# A law may exceed a limit by rounding only.
ROUNDING = 1e-6
UNITS = JOINT_LIMITS | TOOL_LIMITS


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
    """Refuse laws that break one of the named limits at a place that is looked at.

    Args:
        laws: The laws, one after the other.
        arm: The arm.
        limits: The limits; of those named, what is not given is not limited.
        names: Fields of `Limits`.
        where: Begins the sentence; what follows it is the place along the path.
        t: When they begin [s].
        mends: Ends the sentence.

    Raises:
        NotRealizable: With place and time, the joint, what it would need, and the limit.
        InvalidInput: Torques of an arm without masses, or turning of a tool without orientation.
    """
    given = [name for name in names if getattr(limits, name) is not None]
    begun = t
    for law in laws if given else ():
        states = law_states(law)
        for name in given:
            found = amounts(name, arm, *states)
            allowed = np.broadcast_to(getattr(limits, name), found.shape[1:])
            over = found / allowed
            if over.max() <= 1 + ROUNDING:
                continue
            at = np.unravel_index(int(np.argmax(over)), found.shape)
            joint = int(at[1]) + 1 if len(at) == 2 else None
            needed, limit = float(found[at]), float(allowed[at[1:]])
            who = "the tool" if joint is None else f"joint {joint}"
            intervals, times = law_places(law)
            local = float(times[at[0]])
            s = float(law.path_position(intervals[at[0]], times[at[0]]))
            raise NotRealizable(
                f"{where}, at {s:.4g} m, {who} would need {needed:.4g} {UNITS[name]}{_of(name)}, "
                f"but its limit is {limit:.4g} {UNITS[name]}: {mends}.",
                s=s,
                t=begun + local,
                joint=joint,
                limit=name,
                needed=needed,
                allowed=limit,
            )
        begun += float(law.breaks[-1])


def amounts(name: str, arm: Arm, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """How much of a limited quantity there is, (n, dof) for joints or (n,) for the tool."""
    if name == "joint_velocity":
        return np.abs(dq)
    if name == "joint_acceleration":
        return np.abs(ddq)
    if name == "joint_torque":
        return np.abs(arm.torque(q, dq, ddq))
    turning = require_orientation(arm)
    if name == "angular_speed":
        found = turning.tool_twist(q, dq)
    elif name == "angular_acceleration":
        found = turning.tool_twist_rate(q, dq, ddq)
    else:
        raise InvalidInput(f"There is no limit of the name {name!r} to look at along a law.")
    return np.asarray(np.linalg.norm(found[:, 3:], axis=1))


def _of(name: str) -> str:
    """What a unit alone does not tell."""
    return {"angular_speed": " of turning", "angular_acceleration": " of turning"}.get(name, "")
