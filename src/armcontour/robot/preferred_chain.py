"""Chains and joint ranges with the preferences for their joints."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.robot.chain import Chain
from armcontour.robot.limits import Limits
from armcontour.robot.preferences import JointPreference, Prefer

# Positions beyond the end of a range by at most this [rad] are at the end, apart from rounding.
ROUNDING = 1e-9


def index_of(chain: Chain, arm: str, name: str) -> int:
    """Return the index of a joint of `chain` by its name; `arm` is the arm's name for messages."""
    if name not in chain.joints:
        raise InvalidInput(
            f"There is a preference for the joint {name!r}, but the joints of the arm {arm} are "
            f"{', '.join(chain.joints)}. Write one of these names.",
            key=(name,),
        )
    return chain.joints.index(name)


def apply_preferences(
    chain: Chain,
    limits: Limits,
    arm: str,
    preferences: Mapping[str, JointPreference],
    prefer: Prefer | None,
) -> Chain:
    """Return the chain with preferences for some joints.

    Args:
        chain: The chain. Its preferences for other joints do not change.
        limits: The arm's limits, which contain the joints' own ranges.
        arm: The arm's name, for messages.
        preferences: Preferences by the names of the joints.
        prefer: What the planner prefers.

    Raises:
        InvalidInput: A joint does not exist, all joints are held, or a held position or a range is
            outside the joint's own range.
    """
    weights = np.array(chain.weights)
    held = dict(chain.held)
    still = set(chain.still)
    ranges = dict(chain.ranges)
    lower, upper = limits.joint_range(len(chain))
    for name, preference in preferences.items():
        k = index_of(chain, arm, name)
        _check_inside(chain, k, preference, lower[k], upper[k])
        weights[k] = preference.weight
        held.pop(k, None)
        still.discard(k)
        if preference.hold is not None:
            held[k] = preference.hold
        if preference.still:
            still.add(k)
        if preference.range is not None:
            ranges[k] = preference.range
    if len(held) == len(chain):
        raise InvalidInput(
            f"The preferences hold all {len(chain)} joints of the arm {arm}, so it could not move. "
            "Remove hold from at least one joint.",
            key=tuple(preferences)[:1],
        )
    return chain.replace(
        weights=weights, held=held, still=tuple(sorted(still)), ranges=ranges, prefer=prefer
    )


def _check_inside(
    chain: Chain, joint: int, preference: JointPreference, lower: float, upper: float
) -> None:
    """Check the held position and the range of a preference against the joint's own range."""
    name = chain.joints[joint]
    unit = chain.unit("rad", joint)
    own = f"but its own range is from {lower:g} to {upper:g} {unit}"
    hold = preference.hold
    lower -= ROUNDING
    upper += ROUNDING
    if hold is not None and not lower <= hold <= upper:
        raise InvalidInput(
            f"hold of the joint {name} is {hold:g} {unit}, {own}. Hold it inside this range.",
            key=(name, "hold"),
            value=hold,
            joint=joint,
        )
    if preference.range is not None:
        low, high = preference.range
        if not lower <= low < high <= upper:
            raise InvalidInput(
                f"range of the joint {name} is from {low:g} to {high:g} {unit}, {own}. A "
                "preference can only narrow the range: specify both ends inside it.",
                key=(name, "range"),
                joint=joint,
            )


def narrow_ranges(limits: Limits, chain: Chain) -> Limits:
    """Return limits whose joint ranges are also within the ranges that are preferred.

    - `limits`: limits with one value per joint.

    Raises:
        InvalidInput: A preferred range has no part in common with that of the limits.
    """
    if not chain.ranges:
        return limits
    lower, upper = (x.copy() for x in limits.joint_range(len(chain)))
    for k, (low, high) in chain.ranges.items():
        if max(low, lower[k]) >= min(high, upper[k]):
            unit = chain.unit("rad", k)
            raise InvalidInput(
                f"The limits allow the joint {chain.joints[k]} from {lower[k]:g} to {upper[k]:g} "
                f"{unit}, and its preference from {low:g} to {high:g} {unit}, so no position is "
                "left. Change joint_lower and joint_upper, or the range of the preference.",
                joint=k,
            )
        lower[k] = max(low, lower[k])
        upper[k] = min(high, upper[k])
    own = limits.joint_range(len(chain))
    ends = {"joint_lower": (lower, own[0]), "joint_upper": (upper, own[1])}
    changes = {name: new for name, (new, old) in ends.items() if (new != old).any()}
    return limits.replace(**changes) if changes else limits


def list_held(chain: Chain) -> str:
    """Write the joints that are held, with their positions, such as "rail at 0.3 m"."""
    return ", ".join(
        f"{chain.joints[k]} at {position:g} {chain.unit('rad', k)}"
        for k, position in chain.held.items()
    )
