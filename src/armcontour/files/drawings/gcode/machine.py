"""Machine state that executes the blocks of a G-code program."""

from __future__ import annotations

import math
from collections.abc import Collection

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.codes import AXES, PLANES
from armcontour.files.drawings.gcode.cutter_compensation import Compensation
from armcontour.files.drawings.gcode.draft import ProgramDraft
from armcontour.files.drawings.gcode.modes import Extruder, Modes, Offsets, Switches, unit_of
from armcontour.files.drawings.gcode.motions import Cycles, ProgrammedTool
from armcontour.files.drawings.gcode.words import (
    LASER,
    MILLIMETRE,
    Block,
    Dialect,
    Fault,
    Notes,
    whole_number,
)
from armcontour.files.drawings.read_options import ReadOptions

# Rotary axes, and linear axes other than X, Y and Z.
OTHER_AXES = "ABCUVW"
# Words that cause no motion: offsets of tools, pockets, values of skipped codes.
IDLE = "DEHLOT"
# Positions of such an axis up to this are zero [degrees or units].
TURNED = 1e-9
# Words of an unknown M code on a line with a motion.
OF_M = "DEHLOPQST"


class Unknown:
    """Skips codes and words that are not executed, with notes, or refuses them."""

    def __init__(self, notes: Notes, skip: Collection[str], lenient: bool) -> None:
        self.notes, self.skipped, self.lenient = notes, frozenset(skip), lenient

    def screen(self, block: Block) -> None:
        """Remove from a line the codes and words that are not executed."""
        words = block.words.keys()
        if "I" in words and math.isnan(block.words["I"]) and not LASER.isdisjoint(block.m):
            block.drop("I")
            self.notes.count("I of M3, M4 or M5 (power of a laser that changes with moves)")
        if (
            codes.SHIFT in block.g
            and words.isdisjoint("XYZES")
            and not words.isdisjoint(OTHER_AXES)
        ):
            block.g.remove(codes.SHIFT)
            block.drop(OTHER_AXES)
            self.notes.count("G92 of other axes")
        if self.skipped:
            self._skip_words(block)
        strange_m = [x for x in block.m if x not in codes.UNDERSTOOD_M]
        if strange_m:
            self._leave_m(block, strange_m)
        if codes.SHIFT in block.g and "S" in words and words.isdisjoint("XYZE"):
            # The largest spindle speed of lathes.
            block.g.remove(codes.SHIFT)
            block.drop("S")
            self.notes.count("G92 S")
        for code in [x for x in block.g if x not in codes.UNDERSTOOD_G]:
            self._leave_g(block, code)
        if not block.words.keys().isdisjoint(OTHER_AXES):
            self._check_axes(block)

    def _leave_m(self, block: Block, strange: list[float]) -> None:
        """Skip M codes of other machines; RepRap's M201 and M203 have parameters X, Y and Z."""
        for code in strange:
            if code in codes.CALLS:
                raise Fault(f"M{code:g}: subprograms are not read; {codes.PLAIN_MOVES}")
            if code == codes.RESTORE and block.words.keys().isdisjoint("PRS"):
                raise Fault(f"M72, which restores saved modes, is not read; {codes.PLAIN_MOVES}")
            block.m.remove(code)
            self.notes.count(f"M{code:g}")
        alone = block.motion is None and not any(x in codes.OWN_THE_LINE for x in block.g)
        parameters = list(block.words)[block.before_m :]
        block.drop(x for x in parameters if alone or x in OF_M)

    def _leave_g(self, block: Block, code: int) -> None:
        name, moves = codes.g_name(code), not block.words.keys().isdisjoint("XYZ")
        if code in codes.REFUSED_G:
            raise Fault(f"{name}, {codes.REFUSED_G[code]}")
        if code in codes.NEVER_SKIPPED_G:
            raise Fault(
                f"{name}, which this reader does not carry out and does not skip either, because "
                "the moves after it would be elsewhere: write G0, G1, G2 and G3"
            )
        if moves:
            raise Fault(
                f"{name} with coordinates, which this reader does not know: write G0, G1, G2 and "
                f"G3, or skip it with its words (unknown: {{skip: [{name}]}}, or --skip "
                f"{name})"
            )
        if code not in codes.HARMLESS_G and not self.lenient:
            raise Fault(
                f"{name}, which this reader does not know: remove it, or skip it "
                f"(unknown: {{skip: [{name}]}}, or --skip {name})"
            )
        block.g.remove(code)
        if block.motion == code:
            block.motion = None
        self.notes.count(name)
        block.drop([x for x, y in block.words.items() if x in "IJKR" + OF_M or math.isnan(y)])

    def _skip_words(self, block: Block) -> None:
        """Skip the codes and words that the options list, with their parameters."""
        for code in [x for x in block.g if codes.g_name(x) in self.skipped]:
            name = codes.g_name(code)
            if code in codes.NEVER_SKIPPED_G or codes.G_GROUP.get(code) == codes.MOTION:
                raise Fault(f"{name}, a motion, which cannot be skipped: write it otherwise")
            block.g.remove(code)
            self.notes.count(name)
            strange = code not in codes.UNDERSTOOD_G and block.motion is None
            owns_line = strange or code in codes.OWN_THE_LINE
            block.drop(OTHER_AXES + "XYZIJKR" + OF_M if owns_line else "DHL")
        for number in [x for x in block.m if f"M{x:g}" in self.skipped]:
            self._leave_m(block, [number])
        for letter in [x for x in block.words if x in self.skipped]:
            del block.words[letter]
            self.notes.count(f"the word {letter}")

    def _check_axes(self, block: Block) -> None:
        """Check positions of axes other than X, Y and Z: only zero is skipped."""
        for letter in [x for x in OTHER_AXES if x in block.words]:
            value = block.words.pop(letter)
            if abs(value) > TURNED:
                raise Fault(
                    f"{letter}{value:g}, a move of the axis {letter}, which this reader does not "
                    "have: it reads X, Y and Z (to skip the word: unknown: "
                    f"{{skip: [{letter}]}}, or --skip {letter})"
                )
            if not math.isnan(value):
                self.notes.count(f"the word {letter} of zero")

    def leave_idle(self, block: Block) -> None:
        """Remove the remaining words of a line that cause no motion."""
        for letter in list(block.words):
            if letter in "PQ" and not self._has_modes(block):
                with_what = {"P": "G4, G64, G2, G3", "Q": "G64"}[letter]
                raise Fault(
                    f"the word {letter}, which belongs to nothing here: it goes with {with_what}"
                )
            if letter in "IJKR":
                raise Fault(
                    f"the word {letter}, which belongs to nothing here: it goes with G2 and G3"
                )
            if letter not in IDLE + "PQ":
                raise Fault(f"the word {letter}, which belongs to nothing here: remove it")
            del block.words[letter]
            self.notes.count(f"the word {letter}")

    @staticmethod
    def _has_modes(block: Block) -> bool:
        """True if P and Q may belong to a mode of another controller, such as G8 P1 or M0 P500."""
        return bool(block.m) or 80 in block.g


# Codes and words of simple motions.
SIMPLE_CODES = (codes.RAPID, codes.LINE, *codes.ARCS)
SIMPLE_WORDS = frozenset("XYZIJKFE")
# A dwell this long [s] may be meant in milliseconds.
LONG_DWELL = 60.0


class Machine:
    """Modal state of a program, and the draft of its moves."""

    def __init__(self, options: ReadOptions, dialect: Dialect) -> None:
        stated = options.unit is not None
        self.modes = Modes(unit=options.unit or MILLIMETRE, stated=stated)
        self.draft = ProgramDraft()
        self.offsets = Offsets()
        self.compensation = Compensation(self.draft, options.fit_tolerance)
        self.tools = options.unscaled_tools
        self.notes = Notes()
        self.tool = ProgrammedTool(
            self.compensation, self.notes, self.modes, self.offsets, options.fit_tolerance
        )
        self.unknown = Unknown(self.notes, options.words, options.skips)
        self.switches = Switches(self.compensation, dialect)
        self.extruder = Extruder(self.switches)
        self.cycles = Cycles(self.tool, self.modes)
        self.shift = [0.0] * 3
        self.dialect = dialect

    def ready(self) -> bool:
        """True if a line with only X, Y, Z and F is a straight feed move to that point."""
        modes = self.modes
        plain = (
            modes.motion == codes.LINE
            and modes.absolute
            and not modes.inverse_time
            and modes.unit <= 0.1
            and self.draft.begun
            and self.compensation.inactive
            and not self.tool.away
            and not self.extruder.active
            and self.offsets.plain
        )
        if plain:
            self.shift = [x or 0.0 for x in self.offsets.shift]
        return plain

    def feed_to(self, x: str | None, y: str | None, z: str | None, f: str | None) -> None:
        """Execute a line with only these words; the machine must be `ready`."""
        modes, tool = self.modes, self.tool
        if f is not None:
            modes.feed_per_minute(float(f))
        if x is None and y is None and z is None:
            return
        position, unit, shift = tool.position, modes.unit, self.shift
        if x is not None:
            position[0] = float(x) * unit + shift[0]
        if y is not None:
            position[1] = float(y) * unit + shift[1]
        if z is not None:
            position[2] = float(z) * unit + shift[2]
        feed = (modes.feed, modes.tolerance, self.notes.line) if modes.feed else tool.feed_of(0.0)
        self.draft.feed(position[0], position[1], position[2], feed)

    def execute(self, block: Block) -> bool:
        """Execute a line; True if it ends the program."""
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
        self._check_single_p(block)
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
        """True if a line has only a motion and its words, as nearly all lines."""
        g = block.g
        return (
            (not g or (len(g) == 1 and g[0] in SIMPLE_CODES))
            and SIMPLE_WORDS.issuperset(block.words)
            and not self.unknown.skipped
        )

    def _check_single_p(self, block: Block) -> None:
        """Check that a word P belongs to one code of its line."""
        users = [codes.g_name(x) for x in (codes.DWELL, codes.BLEND) if x in block.g]
        if self._turns_on(block):
            users.append("the arc")
        if "P" in block.words and len(users) > 1:
            raise Fault(f"the word P, which may belong to {' or '.join(users)}: write two lines")

    def _turns_on(self, block: Block) -> bool:
        """True if a line draws an arc."""
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
        """G41, G42: offset the tool from the contour, starting with the next move."""
        code = next((x for x in block.g if x in codes.COMPENSATION), None)
        if code is None:
            return
        name = codes.g_name(code)
        if self.modes.plane != codes.XY:
            raise Fault(f"{name} in the plane {codes.g_name(self.modes.plane)}: it is read in G17")
        if self.tool.away:
            raise Fault(f"{name} at a position that the file does not give: go on by G0 before")
        diameter = self._diameter(block, code)
        offset = -diameter / 2 if code in codes.ON_THE_RIGHT else diameter / 2
        self.compensation.start(code, offset)

    def _diameter(self, block: Block, code: int) -> float:
        """The tool's diameter for G41 or G42 of a line [m]; removes its words from the line."""
        in_spindle = self.switches.tool
        name, word = codes.g_name(code), block.words.pop("D", None)
        if code in codes.BY_DIAMETER:
            if block.words.pop("L", 0.0) != 0.0:
                raise Fault(f"{name} with L, the orientation of a lathe's tool, which is not read")
            if word is None:
                raise Fault(f"{name} without D, the tool's diameter")
            return word * self.modes.unit
        if not word and not in_spindle and 0 not in self.tools:
            raise Fault(
                f"{name} without D, while no tool is in the spindle (T, M6): give D, the number of "
                f"a tool, and {_explain_tool(1)}"
            )
        # D0 is the tool in the spindle, as in LinuxCNC.
        number = whole_number(word or 0.0, f"{name} with a tool D") or in_spindle
        if number not in self.tools:
            raise Fault(
                f"{name}, cutter radius compensation by the tool {number}, whose diameter is in "
                f"the table of the controller and not in the file: give {_explain_tool(number)}, "
                "or let the post-processor write the path of the tool's centre"
            )
        return self.tools[number]

    def _compensate_length(self, block: Block, code: int) -> None:
        """G43: the programmed point is the tip of the tool, as for a calibrated tool."""
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
        """Execute a code that uses the coordinates of its line; returns False if there is none."""
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
                "G10 that sets offsets or tools of the controller is not supported: let the CAM "
                "system write the program without it, or skip it if it has no effect on this "
                "program (unknown: {skip: [G10]}, or --skip G10)"
            )
        block.drop("PRS")
        self.notes.count("G10")

    def _set_position(self, block: Block) -> None:
        """G92: the tool is at these coordinates, and E at this one."""
        words, unit = block.words, self.modes.unit
        fed = words.pop("E", None)
        if fed is not None:
            self.extruder.position = fed
        values = {i: words.pop(x) * unit for i, x in enumerate(AXES) if x in words}
        if not values and fed is None:
            raise Fault("G92 without coordinates: name the axes that it sets, such as G92 X0 Y0 Z0")
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
        """Move the tool; `feeds` is true if the move feeds material."""
        motion, target = self.modes.motion, self.tool.target(block)
        if motion == codes.RAPID:
            self.tool.go(target)
        elif motion != codes.LINE:
            self.tool.arc(block, target)
        elif not feeds and self.tool.lost and self.dialect.printer:
            self.tool.pass_by(target)
        elif not feeds and not self.draft.begun and self.dialect.extrudes:
            # Before the first extrusion the tool only moves to the start of the print.
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
        self.switches.switch_off()
        return True

    def finish(self) -> None:
        """End the program, and with it the compensation."""
        self.compensation.stop()


def _explain_tool(number: int) -> str:
    return (
        f"its diameter (tools: {{{number}: 3 mm}} under path, or --tool-diameter '{number}: 3 mm', "
        "with the tool's own diameter)"
    )
