"""What a process asks for around its contours: where they begin, leads, overlaps, approaches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._quantities import Choice, Distance, Duration, Length
from armcontour.errors import InvalidInput
from armcontour.geometry import Demand
from armcontour.program.leads import SHAPES, SIDES, WASTE
from armcontour.program.moves import Event

UP = _checks.lock_floats([0.0, 0.0, 1.0])
NO_LAYERS: Mapping[str, Demand] = MappingProxyType({})
# Where a closed contour begins: "auto" goes off a corner, "drawn" stays.
AUTO, DRAWN = "auto", "drawn"
ORDERS = ("drawn", "nearest")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lead:
    """A piece of path before or after a contour, along which the tool is off.

    Args:
        length: Its length [m]; by default as long as the arm needs for the assigned velocity.
        shape: "line", along the tangent, or "arc", a quarter of a circle that touches it.
        side: On which an arc lies: "left" or "right", seen along the contour; or "waste", which is
            inside of holes and outside of what they are in, and "left" of open contours.
    """

    length: Length | None = None
    shape: Annotated[str, Choice(SHAPES)] = "line"
    side: Annotated[str, Choice((*SIDES, WASTE))] = WASTE

    def __post_init__(self) -> None:
        if self.length is not None:
            _checks.positive("length of a lead", self.length, "m")
        _checks.choice("shape", self.shape, SHAPES)
        _checks.choice("side", self.side, (*SIDES, WASTE))


@dataclass(frozen=True, slots=True, kw_only=True)
class Switch:
    """Events that turn the process on where a contour begins, and off where it ends.

    Args:
        name: What is switched.
        on_lead: On so much earlier than the tool gets there [s].
        off_lead: Off so much earlier [s].
    """

    name: str = "tool"
    on_lead: Duration = 0.0
    off_lead: Duration = 0.0

    def __post_init__(self) -> None:
        # Refused here, and not where a contour gets them.
        for lead in (self.on_lead, self.off_lead):
            Event(name=self.name, lead_time=lead)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Process:
    """What is added to the contours of a program.

    Args:
        begin: Where closed contours begin: "auto" leaves the place where it is drawn, but off a
            corner, in the middle of the longest segment, so that every corner is rounded alike,
            unless the program leads there by a rapid, a dwell or an event between contours, or
            has events on the contour; "drawn" leaves it; a number is an arc length [m], which may
            go round; a point, the place nearest to it.
        overlap: How far closed contours are gone on with after their end [m].
        lead_in: Before every contour.
        lead_out: After every contour.
        approach: Straight down to every contour from so high [m].
        retract: Straight up from every contour so high [m].
        up: Which way is up, and about which arcs of leads turn, in space, (3,).
        dwell: Standing still for so long before every contour [s], for an event that leads.
        switch: Events at both ends of every contour.
        off_between: Names of what is on over rapids in the program and shall not be, such as a
            laser: switched off where a contour ends, and on again where the next one begins.
        events: On every contour; a place beyond its end is refused.
        layers: Speed and tolerance of contours by their layer, where segments have none.
        order: "drawn", or "nearest": each time the contour that begins nearest.
        from_s: Where to resume the program: arc length of all contours together, from where they
            begin, with their overlaps and without leads or rounding [m].

    Raises:
        InvalidInput: Values that are none.
    """

    begin: str | float | Sequence[float] = AUTO
    overlap: Distance = 0.0
    lead_in: Lead | None = None
    lead_out: Lead | None = None
    approach: Distance = 0.0
    retract: Distance = 0.0
    up: FloatArray = field(default_factory=lambda: UP)
    dwell: Duration = 0.0
    switch: Switch | None = None
    off_between: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()
    layers: Mapping[str, Demand] = field(default_factory=lambda: NO_LAYERS)
    order: Annotated[str, Choice(ORDERS)] = "drawn"
    from_s: Distance = 0.0

    def __post_init__(self) -> None:
        for name in ("overlap", "approach", "retract", "from_s"):
            _checks.not_negative(name, getattr(self, name), "m")
        _checks.not_negative("dwell", self.dwell, "s")
        object.__setattr__(self, "off_between", tuple(self.off_between))
        for x in self.off_between:
            _checks.check_name("name in off_between", x)
        _checks.choice("order", self.order, ORDERS)
        if isinstance(self.begin, str):
            _checks.choice("begin", self.begin, (AUTO, DRAWN))
        else:
            begin = _checks.numbers("begin", self.begin, "m")
            if begin.ndim > 1:
                raise InvalidInput("begin must be one arc length or one point in m.")
            listed = begin.tolist()
            object.__setattr__(self, "begin", tuple(listed) if begin.ndim else listed)
        object.__setattr__(self, "events", tuple(self.events))
        up = _checks.numbers("up", self.up)
        if up.shape != (3,) or not np.linalg.norm(up) > 0:
            raise InvalidInput("up must be a direction in space.")
        object.__setattr__(self, "up", _checks.lock_floats(up / np.linalg.norm(up)))

    @property
    def automatic(self) -> bool:
        """Whether a lead is to be as long as it needs."""
        return any(x is not None and x.length is None for x in (self.lead_in, self.lead_out))


@dataclass(frozen=True, slots=True, kw_only=True)
class Leads:
    """Lengths of the leads of one contour [m]."""

    before: float = 0.0
    after: float = 0.0

    def __post_init__(self) -> None:
        _checks.not_negative("lead before a contour", self.before, "m")
        _checks.not_negative("lead after a contour", self.after, "m")
