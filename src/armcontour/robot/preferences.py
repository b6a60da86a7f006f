"""Preferences for the motion of single joints: held, still within a contour, light or heavy."""

from __future__ import annotations

from typing import Annotated, Literal

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import PlainNumber, Quantity

Weight = Annotated[float, Quantity("", sign="positive")]
# What the planner prefers if the joints can follow a path in several ways
Prefer = Literal["fastest", "least motion"]


@declared()
class JointPreference(Checked):
    """How one joint of an arm should move, if the path leaves a choice.

    >>> from armcontour.robot import JointPreference
    >>> arm = ac.load_arm("fr3").with_preferences({"fr3_joint3": JointPreference(hold=0.1)})
    >>> arm.chain.held
    {2: 0.1}

    Args:
        hold: Position at which the joint stays for the whole job [rad]; by default it moves.
        weight: Cost of its motion relative to the other joints. A joint with a larger weight moves
            less.
        range: Lower and upper end of a range that is narrower than the joint's own [rad]; by
            default its own.
        still: Whether the joint stays still within each contour, and moves between contours only.

    Raises:
        InvalidInput: The range is empty, or `hold` is combined with another value, which would have
            no effect.
    """

    hold: PlainNumber | None = None
    weight: Weight = 1.0
    range: tuple[PlainNumber, PlainNumber] | None = None
    still: bool = False

    def _check_together(self) -> None:
        if self.range is not None and not self.range[0] < self.range[1]:
            lower, upper = self.range
            raise InvalidInput(
                f"The range of a joint preference is empty: its lower end ({lower:g}) must be less "
                f"than its upper end ({upper:g})."
            )
        others = {"weight": self.weight != 1.0, "range": self.range is not None}
        others["still"] = self.still
        useless = [name for name, is_set in others.items() if is_set]
        if self.hold is not None and useless:
            raise InvalidInput(
                f"A joint that is held does not move, so {' and '.join(useless)} would have no "
                f"effect. Remove {' and '.join(useless)}, or remove hold."
            )
        if self.still and self.weight != 1.0:
            raise InvalidInput(
                "A joint that is still does not move within a contour, so weight would have no "
                "effect. Remove weight or still."
            )
