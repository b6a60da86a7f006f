"""Parameters that tell the state of the machine, such as `#<_x>` or `#5420`.

Source: LinuxCNC manual, "Numbered Parameters" and "Predefined Named Parameters".
"""

from __future__ import annotations

import math
from collections.abc import Callable

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.machine import Machine
from armcontour.io.drawings.gcode.parameters import Key

Of = Callable[[Machine], float | None]


def _switched(name: str, *values: object) -> Of:
    return lambda m: float(m.switches.states.get(name, False) in values)


def _position(axis: int) -> Of:
    def value(machine: Machine) -> float:
        machine.tool.refuse_lost((axis,), "the tool's position")
        machine.compensation.refuse("a parameter of the tool's position")
        return machine.systems.to_program(machine.tool.at)[axis] / machine.modes.unit

    return value


def _shift(axis: int) -> Of:
    return lambda m: m.systems.shift[axis] / m.modes.unit


def _diameter(machine: Machine) -> float | None:
    """That of the tool in the spindle; None where nothing gives it."""
    found = machine.table.diameters.get(machine.switches.tool, math.nan)
    return None if math.isnan(found) else found / machine.modes.unit


NAMED: dict[str, Of] = {
    "_motion_mode": lambda m: float(-1 if m.modes.motion is None else m.modes.motion),
    "_plane": lambda m: float(m.modes.plane),
    "_ccomp": lambda m: float(m.compensation.code),
    "_metric": lambda m: float(not m.modes.inch),
    "_imperial": lambda m: float(m.modes.inch),
    "_absolute": lambda m: float(m.modes.absolute),
    "_incremental": lambda m: float(not m.modes.absolute),
    "_inverse_time": lambda m: float(m.modes.feed_mode == codes.INVERSE_TIME),
    "_units_per_minute": lambda m: float(m.modes.feed_mode == codes.PER_MINUTE),
    "_units_per_rev": lambda m: float(m.modes.feed_mode == codes.PER_TURN),
    "_coord_system": lambda m: float(codes.SYSTEMS[m.systems.active]),
    "_tool_offset": lambda m: float(m.modes.compensated),
    "_retract_r_plane": lambda m: float(not m.modes.return_to_r),
    "_retract_old_z": lambda m: float(m.modes.return_to_r),
    "_spindle_rpm_mode": lambda m: float(not m.surface_speed),
    "_spindle_css_mode": lambda m: float(m.surface_speed),
    "_ijk_absolute_mode": lambda m: float(m.modes.arc_absolute),
    "_lathe_diameter_mode": lambda m: 0.0,
    "_lathe_radius_mode": lambda m: 1.0,
    "_spindle_on": _switched("spindle", True, "reverse"),
    "_spindle_cw": _switched("spindle", True),
    "_mist": _switched("coolant", "mist", "mist and flood"),
    "_flood": _switched("coolant", "flood", "mist and flood"),
    "_feed": lambda m: (m.modes.feed or 0.0) * 60 / m.modes.unit,
    "_rpm": lambda m: float(m.switches.states.get("spindle speed", 0.0)),
    "_x": _position(0),
    "_y": _position(1),
    "_z": _position(2),
    "_current_tool": lambda m: float(m.switches.tool),
    "_selected_tool": lambda m: float(-1 if m.switches.selected is None else m.switches.selected),
    "_line": lambda m: float(m.line),
    # Nothing runs while a file is read: the manual's preview.
    "_task": lambda m: 0.0,
    "_value": lambda m: 0.0,
    "_value_returned": lambda m: 0.0,
}
# Axes that are not read stay at zero.
NAMED.update({f"_{x}": lambda m: 0.0 for x in "abcuvw"})
NUMBERED: dict[int, Of] = {
    5210: lambda m: float(any(m.systems.shift)),
    5220: lambda m: float(m.systems.active + 1),
    5400: NAMED["_current_tool"],
    5410: _diameter,
    **{5211 + i: _shift(i) for i in (0, 1, 2)},
    **{5420 + i: _position(i) for i in (0, 1, 2)},
    **{5423 + i: NAMED["_a"] for i in range(6)},
}


def state_of(machine: Machine) -> Callable[[Key], float | None]:
    """Gives the value of a parameter that tells the state of a machine, None for any other."""

    def value(key: Key) -> float | None:
        found = NUMBERED.get(key) if isinstance(key, int) else NAMED.get(key)
        if found is not None:
            return found(machine)
        return _origin_of(machine, key) if isinstance(key, int) else None

    return value


def _origin_of(machine: Machine, key: int) -> float | None:
    """#5221 to #5390: origins of coordinate systems, where the program has set them."""
    system, axis = divmod(key - 5221, 20)
    if not (0 <= system < len(codes.SYSTEMS) and axis < 3):
        return None
    systems = machine.systems
    origin, zero = systems.origins[system][axis], systems.machine[axis]
    return None if origin is None or zero is None else (origin - zero) / machine.modes.unit
