"""A machine that runs G-code, and what it does with a line.

A line's words are carried out in the order of the LinuxCNC manual ("G-code Order of Execution"):
feed, spindle, tool, outputs, coolant, dwell, plane, units, coordinate system, path control,
distance mode, references and offsets, motion, stop.
"""

from __future__ import annotations

import math

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.codes import AXES, PLANES
from armcontour.files.drawings.gcode.compensation import Compensation
from armcontour.files.drawings.gcode.cycles import Cycles
from armcontour.files.drawings.gcode.draft import Draft
from armcontour.files.drawings.gcode.faults import MILLIMETRE, Fault, Notes
from armcontour.files.drawings.gcode.modes import Modes, unit_of
from armcontour.files.drawings.gcode.motions import Tool
from armcontour.files.drawings.gcode.offsets import Offsets
from armcontour.files.drawings.gcode.switches import Extruder, Switches
from armcontour.files.drawings.gcode.unknown import Unknown
from armcontour.files.drawings.gcode.words import Block, Dialect, whole
from armcontour.files.drawings.options import ReadOptions

# Codes and words of lines that only move the tool.
SIMPLE_CODES = (codes.RAPID, codes.LINE, *codes.ARCS)
SIMPLE_WORDS = frozenset("XYZIJKFE")
# A dwell this long [s] may be meant in milliseconds.
LONG_DWELL = 60.0


class Machine:
    """What is in force, and the draft of what was done so far.

    Args:
        options: How the file is to be read.
        dialect: Properties of the whole program.
    """

    def __init__(self, options: ReadOptions, dialect: Dialect) -> None:
        stated = options.unit is not None
        self.modes = Modes(unit=options.unit or MILLIMETRE, stated=stated)
        self.draft = Draft()
        self.offsets = Offsets()
        self.compensation = Compensation(self.draft, options.fit_tolerance)
        self.tools = options.unscaled_tools
        self.notes = Notes()
        self.tool = Tool(
            self.compensation, self.notes, self.modes, self.offsets, options.fit_tolerance
        )
        self.unknown = Unknown(self.notes, options.words, options.skips)
        self.switches = Switches(self.compensation, dialect)
        self.extruder = Extruder(self.switches)
        self.cycles = Cycles(self.tool, self.modes)
        self.shift = [0.0] * 3
        self.dialect = dialect

    def ready(self) -> bool:
        """Whether a line of nothing but X, Y, Z and F is a straight feed move to that point."""
        modes = self.modes
        plain = (
            modes.motion == codes.LINE
            and modes.absolute
            and not modes.inverse_time
            and modes.unit <= 0.1
            and self.draft.begun
            and self.compensation.off
            and not self.tool.away
            and not self.extruder.on
            and self.offsets.plain
        )
        if plain:
            self.shift = [x or 0.0 for x in self.offsets.shift]
        return plain

    def feed_to(self, x: str | None, y: str | None, z: str | None, f: str | None) -> None:
        """A line of nothing but those words, where the machine is `ready`."""
        modes, tool = self.modes, self.tool
        if f is not None:
            modes.feed_per_minute(float(f))
        if x is None and y is None and z is None:
            return
        at, unit, shift = tool.at, modes.unit, self.shift
        if x is not None:
            at[0] = float(x) * unit + shift[0]
        if y is not None:
            at[1] = float(y) * unit + shift[1]
        if z is not None:
            at[2] = float(z) * unit + shift[2]
        feed = (modes.feed, modes.tolerance, self.notes.line) if modes.feed else tool.feed_of(0.0)
        self.draft.feed(at[0], at[1], at[2], feed)

    def execute(self, block: Block) -> bool:
        """Carries out a line.

        Returns:
            Whether it ends the program.

        Raises:
            Fault: What cannot be carried out.
        """
        if not block.m and self._is_simple(block):
            if "F" in block.words:
                self.modes.set_feed(block)
            elif self.modes.inverse_time:
                self.modes.feed = None
            self._move(block)
            if block.words:
                self.unknown.leave_idle(block)
            return False
        self.unknown.screen(block)
        self._refuse_two_users(block)
        self.modes.set_feed(block)
        dwell = self._dwell(block) if codes.DWELL in block.g else None
        self.switches.apply(block)
        self.extruder.set_mode(block)
        if dwell is not None:
            self.compensation.dwell(dwell)
        if codes.NO_COMPENSATION in block.g:
            self.compensation.stop()
        self._set_modes(block)
        self._compensate_radius(block)
        if self._move_once(block):
            self._set_motion(block)
        else:
            self._move(block)
        self.unknown.leave_idle(block)
        return self._stop(block)

    def _is_simple(self, block: Block) -> bool:
        """Whether a line has nothing but a motion and its words, as nearly all lines have."""
        g = block.g
        return (
            (not g or (len(g) == 1 and g[0] in SIMPLE_CODES))
            and SIMPLE_WORDS.issuperset(block.words)
            and not self.unknown.wanted
        )

    def _refuse_two_users(self, block: Block) -> None:
        """A word P that may belong to two codes of its line."""
        users = [codes.g_name(x) for x in (codes.DWELL, codes.BLEND) if x in block.g]
        if self._turns_on(block):
            users.append("the arc")
        if "P" in block.words and len(users) > 1:
            raise Fault(f"the word P, which may belong to {' or '.join(users)}: write two lines")

    def _turns_on(self, block: Block) -> bool:
        """Whether a line asks for an arc."""
        explicit = block.motion
        if explicit is not None:
            return explicit in codes.ARCS
        once = codes.DWELL in block.g or any(x in codes.OWN_THE_LINE for x in block.g)
        letters = "XYZ" if once else "XYZIJKR"
        return self.modes.motion in codes.ARCS and not block.words.keys().isdisjoint(letters)

    def _dwell(self, block: Block) -> float:
        """The time of G4 in seconds, from P, or from S, X or U of other controllers."""
        words = block.words
        letter = next((x for x in "PSXU" if x in words), None)
        if letter is None:
            # Marlin: wait until all moves are done.
            self.notes.count("G4 without a time, a stop of 0 s")
            return 0.0
        duration = words.pop(letter)
        if duration < 0:
            raise Fault(f"G4 needs a time of zero or above, but has {letter}{duration:g}")
        if letter == "P" and duration and self.dialect.printer:
            self.notes.once(
                "G4 P, first in line {}, is read in milliseconds, because the program is a "
                "printer's (extrusion, temperatures)."
            )
            return duration * 1e-3
        if duration >= LONG_DWELL:
            self.notes.once(
                f"Dwells of {LONG_DWELL:g} s and above, first in line {{}}, are read in seconds, "
                "as LinuxCNC and grbl read G4 P; some controllers mean milliseconds."
            )
        return duration

    def _set_modes(self, block: Block) -> None:
        modes = self.modes
        unit = unit_of(block)
        if unit is not None:
            modes.unit, modes.stated = unit, True
        for code in block.g:
            if code in PLANES:
                if code != modes.plane:
                    self.compensation.refuse(f"another plane ({codes.g_name(code)})")
                modes.plane = code
            elif code in (codes.ABSOLUTE, codes.RELATIVE):
                modes.absolute = code == codes.ABSOLUTE
            elif code in (codes.ARC_ABSOLUTE, codes.ARC_RELATIVE):
                modes.arc_absolute = code == codes.ARC_ABSOLUTE
            elif code in (codes.EXACT_PATH, codes.EXACT_STOP):
                modes.tolerance = 0.0
            elif code == codes.BLEND:
                block.words.pop("Q", None)
                modes.tolerance = self._blend(block.words.pop("P", None))
            elif code in (codes.RETURN_TO_START, codes.RETURN_TO_R):
                modes.return_to_r = code == codes.RETURN_TO_R
            elif code in codes.SYSTEMS:
                self.offsets.system = code
            elif code in codes.TOOL_LENGTH:
                self._compensate_length(block, code)

    def _compensate_radius(self, block: Block) -> None:
        """G41, G42: the tool beside the contour from the next move on."""
        code = next((x for x in block.g if x in codes.COMPENSATION), None)
        if code is None:
            return
        name = codes.g_name(code)
        if self.modes.plane != codes.XY:
            raise Fault(f"{name} in the plane {codes.g_name(self.modes.plane)}: it is read in G17")
        if self.tool.away:
            raise Fault(f"{name} at a position that the file does not give: go on by G0 before")
        diameter = self._diameter(block, code)
        left = -diameter / 2 if code in codes.ON_THE_RIGHT else diameter / 2
        self.compensation.start(code, left)

    def _diameter(self, block: Block, code: int) -> float:
        """The tool's diameter for G41 or G42 of a line [m]; takes its words from the line.

        Raises:
            Fault: A diameter that nothing gives.
        """
        in_spindle = self.switches.tool
        name, given = codes.g_name(code), block.words.pop("D", None)
        if code in codes.BY_DIAMETER:
            if block.words.pop("L", 0.0) != 0.0:
                raise Fault(f"{name} with L, the orientation of a lathe's tool, which is not read")
            if given is None:
                raise Fault(f"{name} without D, the tool's diameter")
            return given * self.modes.unit
        if not given and not in_spindle and 0 not in self.tools:
            raise Fault(
                f"{name} without D, while no tool is in the spindle (T, M6): give D, the number of "
                f"a tool, and {_explain_tool(1)}"
            )
        # D0 is the tool in the spindle, as in LinuxCNC.
        number = whole(given or 0.0, f"{name} with a tool D") or in_spindle
        if number not in self.tools:
            raise Fault(
                f"{name}, cutter radius compensation by the tool {number}, whose diameter is in "
                f"the table of the controller and not in the file: give {_explain_tool(number)}, "
                "or let the post-processor write the path of the tool's centre"
            )
        return self.tools[number]

    def _compensate_length(self, block: Block, code: int) -> None:
        """G43: the programmed point is the tip of the tool, as a calibrated tool has it anyway."""
        block.words.pop("H", None)
        if code != codes.TOOL_LENGTH[-1]:
            self.notes.once(
                "Tool length compensation, first in line {}, is read so that the programmed point "
                "is the tip of the tool: calibrate the robot's tool to its tip."
            )

    def _blend(self, largest: float | None) -> float:
        if largest == 0:
            self.notes.once(
                "G64 P0 in line {} sets no tolerance, as in LinuxCNC; G61 keeps to corners exactly."
            )
        if not largest:
            return math.nan
        if largest < 0:
            raise Fault(
                f"G64 with P{largest:g}, which must not be negative: G61 keeps to corners exactly"
            )
        return largest * self.modes.unit

    def _move_once(self, block: Block) -> bool:
        """Codes that take the coordinates of their line for themselves; whether there is one."""
        g = block.g
        for code in codes.OWN_THE_LINE.intersection(g):
            self.compensation.refuse(codes.g_name(code))
        reference = next(iter(codes.REFERENCE_MOVES.intersection(g)), None)
        if reference is not None:
            self.tool.go_to_reference(block, reference)
        elif codes.MACHINE in g:
            motion = self.modes.motion if block.motion is None else block.motion
            self.tool.go_in_machine(block, motion)
        elif 431 in g or 432 in g:
            # Lengths of tools, which move nothing here.
            block.drop(AXES)
        elif codes.SET_DATA in g:
            self._retract(block)
        elif codes.SHIFT in g:
            self._set_position(block)
        else:
            if not codes.NO_SHIFT.isdisjoint(g):
                self.offsets.clear()
            return False
        return True

    def _retract(self, block: Block) -> None:
        """G10 of printers, which retracts filament or sets temperatures."""
        words = block.words
        if not words.keys().isdisjoint("LXYZ"):
            raise Fault(
                "G10, which sets offsets or tools of the controller, is not read: let the CAM "
                "system write the program without it, or, if it changes nothing, leave it out "
                "(unknown: {skip: [G10]}, or --skip G10)"
            )
        block.drop("PRS")
        self.notes.count("G10")

    def _set_position(self, block: Block) -> None:
        """G92: the tool is at these coordinates, and E at this one."""
        words, unit = block.words, self.modes.unit
        fed = words.pop("E", None)
        if fed is not None:
            self.extruder.at = fed
        values = {i: words.pop(x) * unit for i, x in enumerate(AXES) if x in words}
        if not values and fed is None:
            raise Fault("G92 without coordinates: say which axes it sets, such as G92 X0 Y0 Z0")
        self.tool.set_position(values)

    def _set_motion(self, block: Block) -> None:
        explicit = block.motion
        if explicit is not None:
            self.modes.motion = None if explicit == codes.CANCEL_MOTION else explicit
            if explicit not in codes.CYCLES:
                self.cycles.end()

    def _move(self, block: Block) -> None:
        arc = self._turns_on(block)
        self._set_motion(block)
        modes = self.modes
        fed = self.extruder.advance(block, self.notes) if modes.motion is not None else 0.0
        feeds = fed > 0
        if not arc and block.words.keys().isdisjoint(AXES):
            if fed:
                speed = modes.feed if modes.feed and not modes.inverse_time else 0.0
                self.extruder.feed_alone(fed * modes.unit, speed)
            return
        if modes.motion is None:
            raise Fault("coordinates without an active motion: write G0, G1, G2 or G3 before")
        if modes.motion in codes.CYCLES:
            self.compensation.refuse(f"the cycle {codes.g_name(modes.motion)}")
            self.cycles.run(block)
            return
        self.extruder.switch(feeds)
        self._travel(block, feeds)
        block.drop(AXES)

    def _travel(self, block: Block, feeds: bool) -> None:
        """Moves the tool; `feeds` is true if it feeds material."""
        motion, target = self.modes.motion, self.tool.target(block)
        if motion == codes.RAPID:
            self.tool.go(target)
        elif motion != codes.LINE:
            self.tool.arc(block, target)
        elif not feeds and self.tool.lost and self.dialect.printer:
            self.tool.pass_by(target)
        elif not feeds and not self.draft.begun and self.dialect.extrudes:
            # Nothing is printed yet: the tool only goes to where the print begins.
            self.notes.once(
                "Feed moves before the first extrusion, first in line {}, are read as rapids: the "
                "program begins where material flows."
            )
            self.tool.go(target)
        else:
            self.tool.feed(target)

    def _stop(self, block: Block) -> bool:
        for code, value in ((0, True), (60, True), (1, "optional")):
            if code in block.m:
                self.compensation.rest()
                self.compensation.event("pause", value)
        if 2 not in block.m and 30 not in block.m:
            return False
        self.switches.off()
        return True

    def finish(self) -> None:
        """The end of the program, which ends compensation too."""
        self.compensation.stop()


def _explain_tool(number: int) -> str:
    return (
        f"its diameter (tools: {{{number}: 3 mm}} under path, or --tool '{number}: 3 mm', with "
        "the tool's own diameter)"
    )
