"""Requirements of a process on its contours: start points, overlap, leads, approach, switching."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields, replace
from itertools import chain
from types import MappingProxyType
from typing import Annotated, Any, Literal

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.quantities import (
    NO_KEY,
    AtLeast,
    Choice,
    Convert,
    Direction,
    Distance,
    Duration,
    Factor,
    Items,
    Key,
    Length,
    Name,
    NeededName,
    PartialFields,
    Ratio,
    Rest,
    Size,
    Speed,
    Time,
)
from armcontour.core.render import number
from armcontour.core.text import Keys
from armcontour.geometry import SegmentLimits
from armcontour.geometry.weave import Weave
from armcontour.program.moves import SWITCHED_ON, Contour, Event, Value, Wait

# In a file, "auto" is the length of a lead that the arm needs.
LEAD_LENGTH = Key(
    hint=Annotated[Literal["auto"] | Distance, Convert(lambda x: None if x == "auto" else x)],
    default="auto",
)
BEGIN = Key(hint=Literal["auto", "drawn"] | Distance | Annotated[list[Length], Items(2, 3)])
# In a file, contours may also have numbers.
ONLY = Key(hint=Annotated[list[int | NeededName], Convert(lambda x: tuple(map(str, x)))])
# Usual values of what a message says is missing.
SWITCH: dict[Keys, Any] = {("switch", "name"): "torch"}
TABS: tuple[dict[Keys, Any], ...] = ({("count",): 3}, {("spacing",): "50 mm"})
SHAPES = ("line", "arc")
SIDES = ("left", "right")
# The waste side of a contour.
WASTE = "waste"
UP = checks.frozen_array([0.0, 0.0, 1.0])
NO_LAYERS: Mapping[str, SegmentLimits] = MappingProxyType({})
# Values for null in a layer, for fields of the process that cannot be None.
NULL_VALUES: Mapping[str, Any] = {
    "overlap": 0.0,
    "dwell": 0.0,
    "wait": (),
    "events": (),
    "analog": (),
}
# Start point of a closed contour that is moved away from a corner.
AUTO = "auto"
# Start point or direction of a contour that is kept as it is drawn.
DRAWN = "drawn"
# Largest number of laps per contour; a larger number is a mistake in a unit or digit.
MAX_PASSES = 1000
# Largest number of tabs per contour; a larger number is a mistake in a unit or digit.
MAX_TABS = 1000
ORDERS = ("auto", "drawn", "inside_first", "nearest", "shortest")
# Side of the tool in the direction of travel, for a spindle that turns clockwise (M3).
TOOL_SIDES = {"climb": "left", "conventional": "right"}
DIRECTIONS = (DRAWN, *TOOL_SIDES, "clockwise", "counterclockwise")


@declared()
class Lead(Checked):
    """A part of the path before or after a contour, on which the tool accelerates or decelerates.

    Args:
        length: Length of the lead [m]; None for the length that the arm needs to reach the
            assigned velocity.
        shape: "line", along the tangent, or "arc", a quarter circle that touches the tangent.
        side: Side of the contour on which an arc lies: "left" or "right" in the direction of
            travel, or "waste": inside of holes, outside of outer contours, left of open contours.
        active: Whether the process is on along the lead, as in cutting.
    """

    length: Annotated[Size | None, LEAD_LENGTH] = field(default=None, kw_only=False)
    shape: Annotated[str, Choice(SHAPES)] = "line"
    side: Annotated[str, Choice((*SIDES, WASTE))] = WASTE
    active: bool = False


@declared()
class Switch(Checked):
    """Events that switch the process on at the start of a contour, and off at its end.

    Args:
        name: Name of the output.
        value: Value of the output while it is on, such as a power.
        on_lead: Time by which the output is switched on before the piercing, or else before the
            tool passes the start or departs from it after a rest [s]; after it if negative.
        off_lead: Time by which the output is switched off before the tool reaches the end [s];
            after it if negative.
    """

    name: NeededName = field(default="tool", kw_only=False)
    value: Value = field(default=True, kw_only=False)
    on_lead: Time = 0.0
    off_lead: Time = 0.0

    def _check_together(self) -> None:
        if self.value is False:
            raise InvalidInput(
                f"The switch {self.name} has the value false, which is its value while the process "
                "is off. Specify the value that switches the process on, such as true."
            )


@declared()
class Pierce(Checked):
    """Piercing of the material before every contour, with the process on.

    Args:
        time: Time at rest with the process on [s].
        height: Height above the start of the lead-in, or of the contour, at which the tool pierces
            [m]; from there it moves straight down, stops, and starts along the lead-in.
    """

    time: Rest = field(kw_only=False)
    height: Distance = 0.0


@declared()
class Analog(Checked):
    """An analog output, such as a power or a flow, that follows the planned tool speed.

    Its value is linear in the speed, from `rest` for a tool at rest to `full` at the full speed,
    and is constant above it. Exports have a column for it.

    Args:
        name: Name of the output.
        rest: Value for a tool at rest on a contour, also during a pierce.
        full: Value at the full speed.
        speed: The full speed [m/s]; None means the assigned velocity at the tool's position.
        off: Value while the process is off: in rapids, dwells, leads that are not active, and after
            an event that switches the process off.
        lead_time: Time by which the output leads the tool [s]; after it if negative.
        full_s: Word S of G-code at which the output has its full value, such as 1000 for a laser.
            The value on a contour is multiplied by S / `full_s`. None ignores S.
        follows: Name of the on/off output of the process. By default the process is off while any
            on/off output of the program or of `switch` is off, except coolant.
    """

    name: NeededName = field(kw_only=False)
    rest: Ratio = 0.0
    full: Ratio = 1.0
    speed: Speed | None = None
    off: Ratio = 0.0
    lead_time: Time = 0.0
    full_s: Factor | None = None
    follows: Name = ""


@declared()
class Tabs(Checked):
    """Parts of closed contours that are not cut, because the switch of the process is off there.

    Args:
        width: Length along the contour over which the process is off [m].
        count: Number of tabs per contour.
        spacing: Approximate length of the contour per tab [m]; specify this or the count.
    """

    width: Size = field(kw_only=False)
    count: Annotated[int, AtLeast(1, MAX_TABS)] | None = None
    spacing: Size | None = None

    def _check_together(self) -> None:
        if (self.count is None) == (self.spacing is None):
            raise InvalidInput(
                "Tabs need exactly one of count and spacing.",
                remedies=TABS if self.count is None else (),
            )


@declared(eq=False)
class LayerProcess:
    """Values for one layer's contours, which replace those of the process.

    Args:
        lead_in, lead_out, pierce, switch, tabs, weave: As in the process; None to remove it from
            the layer.
        overlap, dwell, wait, events, analog: As in the process; None to remove it from the layer.
        passes, direction: As in the process.
        kerf: As in the process; None for a layer that is not cut through, such as marks.
    """

    overlap: Distance = 0.0
    lead_in: Lead | None = None
    lead_out: Lead | None = None
    dwell: Duration = 0.0
    wait: Wait | tuple[Wait, ...] = ()
    pierce: Pierce | None = None
    switch: Switch | None = None
    events: tuple[Event, ...] = ()
    analog: tuple[Analog, ...] = ()
    passes: Annotated[int, AtLeast(1, MAX_PASSES)] = 1
    tabs: Tabs | None = None
    weave: Weave | None = None
    kerf: Distance | None = None
    direction: Annotated[str, Choice(DIRECTIONS)] = DRAWN


@declared()
class ContourProcess(LayerProcess):
    """Values for one contour, which replace those of its layer and of the process.

    Args:
        speed: Assigned velocity of the contour, also instead of velocities in the drawing [m/s].
        tolerance: Largest corner error of the contour, also instead of those in the drawing [m].
        order: Contours with smaller values run first; 0 by default. `process.order` applies to
            contours with the same value.
    """

    speed: Speed | None = None
    tolerance: Distance | None = None
    order: int = 0


@declared(eq=False)
class Process(Checked, LayerProcess):
    """Requirements of a process that are added to the contours of a program.

    >>> cut = ac.Process(overlap=1e-3, order="inside_first")
    >>> cut.overlap
    0.001

    Args:
        begin: Start point of closed contours. "drawn" keeps it. "auto" keeps it unless it is a
            corner; then it is moved to the middle of the longest segment, so all corners are
            rounded. It stays if a rapid, dwell or event leads to the contour or the contour has
            events. A number is an arc length [m], modulo the length of the contour. A point means
            the nearest point of the contour.
        overlap: Length of a closed contour that is repeated after its end [m].
        lead_in: Lead before every contour.
        lead_out: Lead after every contour.
        approach: Distance from which the tool approaches every contour along its axis, or along
            `up` if no tool axis is required [m].
        retract: Distance to which the tool retracts from every contour, in the same way [m].
        approach_speed: Largest tool speed of approaches and retracts [m/s]; by default that of
            rapids.
        rapid_speed: Largest tool speed of rapids [m/s]; by default only the limits of the joints
            apply.
        up: Upward direction in space; left and right of leads are defined about it, (3,).
        dwell: Time at rest before every contour [s], for events with a time advance.
        wait: Wait for an input of the robot at the start of every contour, or several waits in
            their order. Only programs for robots wait.
        pierce: Time with the process on before every contour, at rest above its start.
        switch: Events at both ends of every contour, or of its active leads.
        off_between: Names of outputs, such as a laser, that are switched off during rapids: off at
            the end of a contour, and on again at the start of the next one.
        events: Events on every contour; an event past the end of a contour raises an error.
        analog: Analog outputs that follow the planned tool speed.
        passes: Number of passes per contour. Closed contours run in laps without a stop; open
            contours run again from their start, as separate contours.
        tabs: Parts of closed contours that are not cut.
        weave: Weaving along contours; speeds are along the seam.
        by_layer: Values for a layer's contours, named as the fields of `LayerProcess`.
        by_contour: Values for single contours, by their number in the drawing; `by_layer` does not
            apply to these contours.
        layers: Speed and tolerance of contours by layer, for segments that have none.
        order: Order of a drawing's contours. "drawn" keeps it. "inside_first" runs each contour
            after all contours inside it. "nearest" continues with the nearest contour. "shortest"
            minimizes the total distance between contours; if `begin` is "auto", it also chooses the
            start points of closed contours. In the last two orders, contours also run after all
            contours inside them. "auto" is "inside_first" for drawings that are cut (with a kerf,
            or an arc lead in the waste), else "drawn".
        kerf: Width of the cut [m]; the tool path is offset from the contour by half of it. None for
            a process that does not cut. All closed contours determine which of them are holes,
            except for marks: contours whose layer, or own value, sets the kerf to None.
        kerf_side: Side of the cut: "waste", which does not offset open contours, or "left" or
            "right" in the direction of travel.
        direction: Direction of travel along closed contours, seen from `up`: "drawn", "clockwise",
            "counterclockwise", or for a spindle that turns clockwise "climb", with the tool to the
            left of the part's edge, or "conventional". The tool is on the waste side.
        off: Whether the process stays off, for a first run on the robot: the tool moves along the
            same path, but no output is switched, no analog output has a value, pierces take no
            time, and the robot waits for no input.
        lift: Distance of the tool above the part, along `up`, for a first run on the robot with
            `off` [m]: every contour, rapid and approach is moved by one constant vector.
        resume_at: Arc length at which to resume the program, over all contours from their start
            points, with overlaps and without leads or rounding [m]. A job keeps the configuration
            of the whole job. Contours that `only` leaves out count, too.
        rejoin: Length before `resume_at` that is processed again, so that the rest joins the
            finished part; not beyond the start of the contour [m]. Without `resume_at`, it has no
            effect.
        only: Contours that are executed, in the order of the whole program: their names, their
            numbers from 1, or layers; empty for all. Leads, kerf and the configuration are those of
            the whole program. If a layer has the same name as a contour, write `contour 3` or
            `layer 3`.

    Raises:
        InvalidInput: A value is not valid.
    """

    begin: Annotated[str | float | Sequence[float], BEGIN] = AUTO
    approach: Distance = 0.0
    retract: Distance = 0.0
    up: Annotated[Direction, NO_KEY] = field(default_factory=lambda: UP)
    off_between: tuple[Name, ...] = ()
    by_layer: Mapping[str, Annotated[Mapping[str, Any], PartialFields(LayerProcess, null=True)]] = (
        field(default_factory=dict)
    )
    by_contour: Annotated[Mapping[int, Mapping[str, Any]], NO_KEY] = field(default_factory=dict)
    layers: Annotated[Mapping[str, SegmentLimits], NO_KEY] = field(
        default_factory=lambda: NO_LAYERS
    )
    order: Annotated[str, Choice(ORDERS)] = "auto"
    kerf_side: Annotated[str, Choice((*SIDES, WASTE))] = WASTE
    rapid_speed: Speed | None = None
    approach_speed: Speed | None = None
    off: bool = False
    lift: Distance = 0.0
    resume_at: Distance = 0.0
    rejoin: Distance = 0.0
    only: Annotated[tuple[str, ...], ONLY] = ()
    _parts: Mapping[str | int, Process] = field(init=False, repr=False)

    def _check_together(self) -> None:
        side = TOOL_SIDES.get(self.direction, self.kerf_side)
        if self.kerf_side not in (WASTE, side):
            raise InvalidInput(
                f"direction {self.direction} requires the tool to the {side} of the contour, but "
                f"kerf_side is {self.kerf_side}. Remove direction or kerf_side.",
                remedies=({("direction",): None}, {("kerf_side",): None}),
            )
        if self.lift and not self.off:
            raise InvalidInput(
                f"lift moves the tool {number(self.lift, 'm')} above the part, where the process "
                "must stay off. Also set off: true (--process-off), or remove lift.",
                remedies=({("off",): True}, {("lift",): None}),
            )
        object.__setattr__(self, "begin", _checked_begin(self.begin))
        waits = (self.wait,) if isinstance(self.wait, Wait) else self.wait
        object.__setattr__(self, "wait", checks.check_sequence("wait", waits, Wait, "waits"))
        names = [x.name for x in self.analog]
        if len(set(names)) < len(names):
            name = next(x for x in names if names.count(x) > 1)
            raise InvalidInput(
                f"Two analog outputs have the same name, {name}. Their names must differ."
            )
        length = np.linalg.norm(self.up)
        checks.raise_if(length == 0, "up must be a direction in space, but is zero.")
        object.__setattr__(self, "up", checks.frozen_array(self.up / length))
        self._check_switch()
        self._make_parts()

    def _check_switch(self) -> None:
        """Raise InvalidInput for tabs or a pierce on which the switch has no effect."""
        leads_off = self.lead_in is not None and not self.lead_in.active
        is_off = self.pierce is not None and leads_off
        active: dict[Keys, Any] = {("lead_in", "active"): True} if is_off else {}
        if self.switch is None and (self.tabs or self.pierce):
            use = "A pierce needs an output"
            key = "pierce"
            if self.tabs is not None:
                use = "Tabs need an output that is off on each tab"
                key = "tabs"
            raise InvalidInput(
                f"{use}. Specify switch.name, or remove {key}.", remedies=(SWITCH | active,)
            )
        if is_off:
            raise InvalidInput(
                "The tool pierces at the start of the lead-in, but the process is off along the "
                "lead-in. Set active: true in lead_in.",
                remedies=(active, {("pierce",): None}),
            )
        self._check_waits(leads_off)

    def _check_waits(self, leads_off: bool) -> None:
        """Raise InvalidInput for a wait after switching on, if the tool moves or nothing switches.

        `leads_off`: whether the process is off along the lead-in.
        """
        late = [x.input for x in self.waits_at(SWITCHED_ON)]
        if not late:
            return
        if self.switch is None:
            raise InvalidInput(
                f"The robot waits for {late[0]} after the process is switched on, but no output is "
                "switched. Specify switch.name, or set at: start in wait.",
                remedies=(SWITCH,),
            )
        if leads_off:
            raise InvalidInput(
                f"The robot waits for {late[0]} at rest after the process is switched on, but the "
                "process is switched on at the end of the lead-in, where the tool moves. Set "
                "active: true in lead_in.",
                remedies=({("lead_in", "active"): True}, {("wait",): None}),
            )

    def _make_parts(self) -> None:
        """Make the processes of the layers in `by_layer`, and of the contours in `by_contour`."""
        allowed = tuple(x.name for x in fields(LayerProcess))
        made: dict[str | int, Process] = {}
        for key in ("by_layer", "by_contour"):
            values_by_part: Mapping[str | int, Mapping[str, Any]] = getattr(self, key)
            for part, values in values_by_part.items():
                location = f"by_layer.{part}" if isinstance(part, str) else ""
                with error_context(location, key, part):
                    for name in values:
                        checks.check_choice("name of a value", name, allowed)
                    part_values: dict[str, Any] = {
                        name: NULL_VALUES.get(name) if x is None else x
                        for name, x in values.items()
                    }
                    try:
                        made[part] = replace(self, by_layer={}, by_contour={}, **part_values)
                    except InvalidInput as error:
                        remedies = (self._remedy_of_part(x, values) for x in error.remedies)
                        error.remedies = tuple(filter(None, remedies))
                        raise
            object.__setattr__(self, key, checks.frozen_mapping(values_by_part))
        object.__setattr__(self, "_parts", MappingProxyType(made))

    def _remedy_of_part(
        self, remedy: Mapping[Keys, Any], values: Mapping[str, Any]
    ) -> dict[Keys, Any]:
        """Return the remedy with a part's values; empty if it would change all contours."""
        part_remedy: dict[Keys, Any] = {}
        for keys, x in remedy.items():
            if keys[0] in values or not getattr(self, str(keys[0]), None):
                # The switch has the same name in all parts, so the remedy reuses it.
                parts = *self.by_layer.values(), *self.by_contour.values()
                names = (part["switch"].name for part in parts if part.get("switch"))
                part_remedy[keys] = next(names, x) if keys in SWITCH else x
            elif self.lead_in is not None and keys == ("lead_in", "active"):
                length, shape, side, _ = astuple(self.lead_in)
                text = "auto" if length is None else f"{1e3 * length:.12g} mm"
                lead = {"active": x, "length": text, "shape": shape, "side": side}
                part_remedy |= {("lead_in", name): x for name, x in lead.items()}
            else:
                return {}
        return part_remedy

    @checked
    def of_contour(self, contour: Contour) -> Process:
        """Return a contour's process, with the values of the contour or of its layer.

        Args:
            contour: The contour.
        """
        return self._parts.get(contour.number) or self._parts.get(contour.layer, self)

    @property
    def variants(self) -> tuple[Process, ...]:
        """The process, and the processes of `by_layer` and `by_contour`."""
        return (self, *self._parts.values())

    @property
    def analog_names(self) -> tuple[str, ...]:
        """Names of all contours' analog outputs."""
        outputs = chain.from_iterable(variant.analog for variant in self.variants)
        return tuple(dict.fromkeys(x.name for x in outputs))

    def waits_at(self, place: str) -> tuple[Wait, ...]:
        """Return the waits at a place, in their order.

        Args:
            place: "start" or "switched_on".
        """
        assert isinstance(self.wait, tuple)
        return tuple(x for x in self.wait if x.at == place)

    @property
    def waits(self) -> tuple[Wait, ...]:
        """The waits of all contours; empty if the process stays off."""
        if self.off:
            return ()
        every = chain.from_iterable(x.wait for x in self.variants if isinstance(x.wait, tuple))
        return tuple(dict.fromkeys(every))

    @property
    def leads(self) -> tuple[Lead, ...]:
        """The leads of all contours."""
        pairs = ((x.lead_in, x.lead_out) for x in self.variants)
        return tuple(lead for lead in chain.from_iterable(pairs) if lead is not None)

    @property
    def is_partial(self) -> bool:
        """True if only a part of the program is executed."""
        return self.resume_at > 0 or bool(self.only)

    @property
    def begins_on(self) -> bool:
        """True if the process is on from the start of the lead-in."""
        return self.pierce is not None or (self.lead_in is not None and self.lead_in.active)

    @property
    def ends_on(self) -> bool:
        """True if the process stays on until the end of the lead-out."""
        return self.lead_out is not None and self.lead_out.active

    @property
    def automatic(self) -> bool:
        """True if a lead has no specified length."""
        return any(x.length is None for x in self.leads)

    @property
    def cuts(self) -> bool:
        """True if the process cuts: a layer has a kerf, or an arc lead lies in the waste."""
        return any(x.kerf is not None for x in self.variants) or any(
            x.shape == "arc" and x.side == WASTE for x in self.leads
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Leads(Checked):
    """Lead lengths of one contour.

    Args:
        before: Length of the lead-in [m].
        after: Length of the lead-out [m].
    """

    before: Distance = 0.0
    after: Distance = 0.0


def _checked_begin(begin: str | float | Sequence[float]) -> str | float | tuple[float, ...]:
    """Return the start of closed contours: a name, an arc length [m], or a point [m].

    Raises InvalidInput for other values.
    """
    if isinstance(begin, str):
        checks.check_choice("begin", begin, (AUTO, DRAWN))
        return begin
    coordinates = checks.check_numbers("begin", begin, "m")
    if coordinates.ndim > 1:
        raise InvalidInput(
            "begin must be one arc length or one point in m, but is an array of shape "
            f"{coordinates.shape}."
        )
    return tuple(coordinates.tolist()) if coordinates.ndim else float(coordinates)
