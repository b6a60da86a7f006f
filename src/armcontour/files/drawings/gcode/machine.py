"""The machine that executes the lines of a G-code program, and rejects or skips unknown words."""

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
    LASER_CODES,
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
# Letters of words that cause no motion: tool offsets, pockets, values of skipped codes.
IDLE_LETTERS = "DEHLOT"
# Largest position of another axis that counts as zero [degrees or units].
ZERO_POSITION = 1e-9
# Letters of words that belong to an unknown M code on a line with a motion.
M_PARAMETERS = "DEHLOPQST"


class UnknownWords:
    """Removes from lines the codes and words that are not executed, with notes, or refuses them."""

    def __init__(self, notes: Notes, skip: Collection[str], lenient: bool) -> None:
        self.notes, self.skipped, self.lenient = notes, frozenset(skip), lenient

    def remove_unknown(self, block: Block) -> None:
        """Remove from a line the codes and words that are not executed."""
        words = block.words.keys()
        if "I" in words and math.isnan(block.words["I"]) and not LASER_CODES.isdisjoint(block.m):
            block.drop("I")
            self.notes.count("I of M3, M4 or M5 (inline laser power)")
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
            self._skip_m(block, strange_m)
        if codes.SHIFT in block.g and "S" in words and words.isdisjoint("XYZE"):
            # On lathes, G92 S is the maximum spindle speed.
            block.g.remove(codes.SHIFT)
            block.drop("S")
            self.notes.count("G92 S")
        for code in [x for x in block.g if x not in codes.UNDERSTOOD_G]:
            self._skip_g(block, code)
        if not block.words.keys().isdisjoint(OTHER_AXES):
            self._check_axes(block)

    def _skip_m(self, block: Block, strange: list[float]) -> None:
        """Skip unknown M codes and their parameters, which can be X, Y and Z (RepRap's M201)."""
        for code in strange:
            if code in codes.CALLS:
                raise Fault(f"M{code:g} (subprograms) is not supported: {codes.PLAIN_MOVES}")
            if code == codes.RESTORE and block.words.keys().isdisjoint("PRS"):
                raise Fault(f"M72 (restore saved modes) is not supported: {codes.PLAIN_MOVES}")
            block.m.remove(code)
            self.notes.count(f"M{code:g}")
        alone = block.motion is None and not any(x in codes.OWN_THE_LINE for x in block.g)
        parameters = list(block.words)[block.before_m :]
        block.drop(x for x in parameters if alone or x in M_PARAMETERS)

    def _skip_g(self, block: Block, code: int) -> None:
        """Skip an unknown G code and its words, or refuse it."""
        name, moves = codes.g_name(code), not block.words.keys().isdisjoint("XYZ")
        if code in codes.REFUSED_G:
            meaning, advice = codes.REFUSED_G[code]
            raise Fault(f"{name} is not supported ({meaning}): {advice}")
        if code in codes.NEVER_SKIPPED_G:
            raise Fault(
                f"{name} is not supported, and cannot be skipped because it may displace the "
                "following moves: write G0, G1, G2 and G3 instead"
            )
        if moves:
            raise Fault(
                f"{name} with coordinates is not supported: write G0, G1, G2 and G3 instead, or "
                f"skip the code with its words (unknown: {{skip: [{name}]}}, or --skip {name})"
            )
        if code not in codes.HARMLESS_G and not self.lenient:
            raise Fault(
                f"the code {name} is unknown: remove it, or skip it (unknown: {{skip: [{name}]}}, "
                f"or --skip {name})"
            )
        block.g.remove(code)
        if block.motion == code:
            block.motion = None
        self.notes.count(name)
        block.drop(
            [x for x, y in block.words.items() if x in "IJKR" + M_PARAMETERS or math.isnan(y)]
        )

    def _skip_words(self, block: Block) -> None:
        """Skip the codes and words that the options list, with their parameters."""
        for code in [x for x in block.g if codes.g_name(x) in self.skipped]:
            name = codes.g_name(code)
            if code in codes.NEVER_SKIPPED_G or codes.G_GROUP.get(code) == codes.MOTION:
                raise Fault(
                    f"{name} cannot be skipped, because it is a motion or displaces the following "
                    "moves: write G0, G1, G2 and G3 instead"
                )
            block.g.remove(code)
            self.notes.count(name)
            strange = code not in codes.UNDERSTOOD_G and block.motion is None
            owns_line = strange or code in codes.OWN_THE_LINE
            block.drop(OTHER_AXES + "XYZIJKR" + M_PARAMETERS if owns_line else "DHL")
        for number in [x for x in block.m if f"M{x:g}" in self.skipped]:
            self._skip_m(block, [number])
        for letter in [x for x in block.words if x in self.skipped]:
            del block.words[letter]
            self.notes.count(f"the word {letter}")

    def _check_axes(self, block: Block) -> None:
        """Skip positions of zero on axes other than X, Y and Z; refuse other positions."""
        for letter in [x for x in OTHER_AXES if x in block.words]:
            value = block.words.pop(letter)
            if abs(value) > ZERO_POSITION:
                raise Fault(
                    f"{letter}{value:g} is a move of the axis {letter}, but only X, Y and Z are "
                    f"supported: remove the word {letter}, or skip it (unknown: {{skip: "
                    f"[{letter}]}}, or --skip {letter})"
                )
            if not math.isnan(value):
                self.notes.count(f"the word {letter} with the value 0")

    def drop_idle(self, block: Block) -> None:
        """Remove the remaining words of a line if they cause no motion; refuse other words."""
        for letter in list(block.words):
            if letter in "PQ" and not self._may_use_p_or_q(block):
                users = {"P": "G4, G64, G2 and G3", "Q": "G64"}[letter]
                raise Fault(
                    f"no code on this line uses the word {letter}, which belongs to {users}: "
                    "remove the word, or add the code"
                )
            if letter in "IJKR":
                raise Fault(
                    f"no code on this line uses the word {letter}, which belongs to G2 and G3: "
                    "remove the word, or add the code"
                )
            if letter not in IDLE_LETTERS + "PQ":
                raise Fault(f"no code on this line uses the word {letter}: remove the word")
            del block.words[letter]
            self.notes.count(f"the word {letter}")

    @staticmethod
    def _may_use_p_or_q(block: Block) -> bool:
        """True if the line has an M code or G8, to which P and Q can belong (G8 P1, M0 P500)."""
        return bool(block.m) or 80 in block.g


# G codes and letters of lines that have only a motion.
SIMPLE_CODES = (codes.RAPID, codes.LINE, *codes.ARCS)
SIMPLE_WORDS = frozenset("XYZIJKFE")
# Dwells of at least this time [s] get a note, because the program may be in milliseconds.
LONG_DWELL = 60.0


class Machine:
    """Executes lines: changes the modal state, and drafts the moves and events."""

    def __init__(self, options: ReadOptions, dialect: Dialect) -> None:
        unit_specified = options.unit is not None
        self.modes = Modes(unit=options.unit or MILLIMETRE, unit_specified=unit_specified)
        self.draft = ProgramDraft()
        self.offsets = Offsets()
        self.compensation = Compensation(self.draft, options.fit_tolerance)
        self.tools = options.unscaled_tools
        self.notes = Notes()
        self.tool = ProgrammedTool(
            self.compensation, self.notes, self.modes, self.offsets, options.fit_tolerance
        )
        self.unknown = UnknownWords(self.notes, options.words, options.skips)
        self.switches = Switches(self.compensation, dialect)
        self.extruder = Extruder(self.switches)
        self.cycles = Cycles(self.tool, self.modes)
        self.shift = [0.0] * 3
        self.dialect = dialect

    def accepts_plain_line(self) -> bool:
        """True if `execute_plain_line` can execute the next line; prepares the execution."""
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
            and self.offsets.is_shift_known
        )
        if plain:
            self.shift = [x or 0.0 for x in self.offsets.shift]
        return plain

    def execute_plain_line(
        self, x: str | None, y: str | None, z: str | None, f: str | None
    ) -> None:
        """Execute a line with only X, Y, Z and F, after `accepts_plain_line` returned true."""
        modes, tool = self.modes, self.tool
        if f is not None:
            modes.set_feed_per_minute(float(f))
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
        self.draft.add_line(position[0], position[1], position[2], feed)

    def execute(self, block: Block) -> bool:
        """Execute a line; True if it ends the program."""
        if not block.m and self._is_simple(block):
            if "F" in block.words:
                self.modes.set_feed(block)
            elif self.modes.inverse_time:
                self.modes.feed = None
            self._move(block)
            if block.words:
                self.unknown.drop_idle(block)
            return False
        self.unknown.remove_unknown(block)
        self._check_single_p(block)
        self.modes.set_feed(block)
        dwell = self._dwell(block) if codes.DWELL in block.g else None
        self.switches.apply(block)
        self.extruder.set_mode(block)
        if dwell is not None:
            self.compensation.add_dwell(dwell)
        if codes.NO_COMPENSATION in block.g:
            self.compensation.stop()
        self._set_modes(block)
        self._compensate_radius(block)
        if self._execute_non_modal(block):
            self._set_motion(block)
        else:
            self._move(block)
        self.unknown.drop_idle(block)
        return self._stop(block)

    def _is_simple(self, block: Block) -> bool:
        """True if a line has only a motion and its words, like nearly all lines of a program."""
        g = block.g
        return (
            (not g or (len(g) == 1 and g[0] in SIMPLE_CODES))
            and SIMPLE_WORDS.issuperset(block.words)
            and not self.unknown.skipped
        )

    def _check_single_p(self, block: Block) -> None:
        """Check that at most one code of the line uses the word P."""
        users = [codes.g_name(x) for x in (codes.DWELL, codes.BLEND) if x in block.g]
        if self._draws_arc(block):
            users.append("the arc")
        if "P" in block.words and len(users) > 1:
            raise Fault(
                f"the word P can belong to {' or '.join(users)}: write these in separate lines"
            )

    def _draws_arc(self, block: Block) -> bool:
        """True if a line draws an arc."""
        explicit = block.motion
        if explicit is not None:
            return explicit in codes.ARCS
        once = codes.DWELL in block.g or any(x in codes.OWN_THE_LINE for x in block.g)
        letters = "XYZ" if once else "XYZIJKR"
        return self.modes.motion in codes.ARCS and not block.words.keys().isdisjoint(letters)

    def _dwell(self, block: Block) -> float:
        """Time of G4 [s], from the word P, or from S, X or U (other controllers)."""
        words = block.words
        letter = next((x for x in "PSXU" if x in words), None)
        if letter is None:
            # In Marlin, G4 without a time waits until all moves are done.
            self.notes.count("G4 without a time (a stop of 0 s)")
            return 0.0
        duration = words.pop(letter)
        if duration < 0:
            raise Fault(f"the time of G4 must not be negative, but is {letter}{duration:g}")
        if letter == "P" and duration and self.dialect.printer:
            self.notes.add_once(
                "G4 P, first in line {}, is interpreted in milliseconds, because the program is "
                "for a 3D printer (extrusion, temperatures)."
            )
            return duration * 1e-3
        if duration >= LONG_DWELL:
            self.notes.add_once(
                f"Dwells of {LONG_DWELL:g} s and above, first in line {{}}, are interpreted in "
                "seconds, as in LinuxCNC and grbl. Some controllers use milliseconds."
            )
        return duration

    def _set_modes(self, block: Block) -> None:
        """Set units, plane, distance modes, path control and offsets that a line selects."""
        modes = self.modes
        unit = unit_of(block)
        if unit is not None:
            modes.unit, modes.unit_specified = unit, True
        for code in block.g:
            if code in PLANES:
                if code != modes.plane:
                    self.compensation.refuse(f"a change of the plane to {codes.g_name(code)}")
                modes.plane = code
            elif code in (codes.ABSOLUTE, codes.RELATIVE):
                modes.absolute = code == codes.ABSOLUTE
            elif code in (codes.ARC_ABSOLUTE, codes.ARC_RELATIVE):
                modes.arc_absolute = code == codes.ARC_ABSOLUTE
            elif code in (codes.EXACT_PATH, codes.EXACT_STOP):
                modes.tolerance = 0.0
            elif code == codes.BLEND:
                block.words.pop("Q", None)
                modes.tolerance = self._blend_tolerance(block.words.pop("P", None))
            elif code in (codes.RETURN_TO_START, codes.RETURN_TO_R):
                modes.return_to_r = code == codes.RETURN_TO_R
            elif code in codes.SYSTEMS:
                self.offsets.active_system = code
            elif code in codes.TOOL_LENGTH:
                self._compensate_length(block, code)

    def _compensate_radius(self, block: Block) -> None:
        """G41, G42: start the offset of the tool from the contour with the next move."""
        code = next((x for x in block.g if x in codes.COMPENSATION), None)
        if code is None:
            return
        name = codes.g_name(code)
        if self.modes.plane != codes.XY:
            raise Fault(
                f"{name} needs the plane G17, but the plane is {codes.g_name(self.modes.plane)}"
            )
        if self.tool.away:
            raise Fault(
                f"{name} is not possible here, because the file does not define the position of "
                "the tool: write a G0 with absolute coordinates before"
            )
        diameter = self._diameter(block, code)
        offset = -diameter / 2 if code in codes.ON_THE_RIGHT else diameter / 2
        self.compensation.start(code, offset)

    def _diameter(self, block: Block, code: int) -> float:
        """The tool's diameter for G41 or G42 [m], negative for the other side; removes D and L."""
        in_spindle = self.switches.tool
        name, word = codes.g_name(code), block.words.pop("D", None)
        if code in codes.BY_DIAMETER:
            if block.words.pop("L", 0.0) != 0.0:
                raise Fault(
                    f"{name} with L (orientation of a lathe tool) is not supported: remove L"
                )
            if word is None:
                raise Fault(f"{name} needs D, the diameter of the tool")
            return word * self.modes.unit
        if not word and not in_spindle and 0 not in self.tools:
            raise Fault(
                f"{name} needs the number of a tool, D, because no tool is in the spindle (T, M6): "
                f"write D, and specify {_explain_tool(1)}"
            )
        # D0 means the tool in the spindle, as in LinuxCNC.
        number = whole_number(word or 0.0, f"the tool number D of {name}") or in_spindle
        if number not in self.tools:
            raise Fault(
                f"{name} (cutter radius compensation) needs the diameter of tool {number}, which "
                f"is not in the file: specify {_explain_tool(number)}, or post-process the "
                "program to the path of the tool's centre"
            )
        return self.tools[number]

    def _compensate_length(self, block: Block, code: int) -> None:
        """G43: note that the programmed point is the tip of the tool; removes H from the line."""
        block.words.pop("H", None)
        if code != codes.TOOL_LENGTH[-1]:
            self.notes.add_once(
                "With tool length compensation, first in line {}, the programmed point is the tip "
                "of the tool: calibrate the tool of the robot to its tip."
            )

    def _blend_tolerance(self, tolerance: float | None) -> float:
        """Permitted corner error [m] of G64 for its word P; NaN without P or with P0."""
        if tolerance == 0:
            self.notes.add_once(
                "G64 P0 in line {} sets no tolerance, as in LinuxCNC. G61 allows no corner error."
            )
        if not tolerance:
            return math.nan
        if tolerance < 0:
            raise Fault(
                f"the tolerance P of G64 must not be negative, but is {tolerance:g}: write G61 to "
                "allow no corner error"
            )
        return tolerance * self.modes.unit

    def _execute_non_modal(self, block: Block) -> bool:
        """Execute a non-modal code that uses the words of its line; False if there is none."""
        g = block.g
        for code in codes.OWN_THE_LINE.intersection(g):
            self.compensation.refuse(codes.g_name(code))
        reference = next(iter(codes.REFERENCE_MOVES.intersection(g)), None)
        if reference is not None:
            self.tool.move_to_reference(block, reference)
        elif codes.MACHINE in g:
            motion = self.modes.motion if block.motion is None else block.motion
            self.tool.move_in_machine(block, motion)
        elif 431 in g or 432 in g:
            # G43.1 and G43.2: the coordinates are tool lengths, which cause no motion.
            block.drop(AXES)
        elif codes.SET_DATA in g:
            self._skip_g10(block)
        elif codes.SHIFT in g:
            self._set_position(block)
        else:
            if not codes.NO_SHIFT.isdisjoint(g):
                self.offsets.clear()
            return False
        return True

    def _skip_g10(self, block: Block) -> None:
        """G10 of printers, which retracts filament or sets temperatures; it is skipped."""
        words = block.words
        if not words.keys().isdisjoint("LXYZ"):
            raise Fault(
                "G10 that sets offsets or tools of the controller is not supported: post-process "
                "the program in the CAM system without G10. If G10 has no effect on this program, "
                "skip it (unknown: {skip: [G10]}, or --skip G10)"
            )
        block.drop("PRS")
        self.notes.count("G10")

    def _set_position(self, block: Block) -> None:
        """G92: assign the coordinates of the line to the current position, E to the extruder."""
        words, unit = block.words, self.modes.unit
        fed = words.pop("E", None)
        if fed is not None:
            self.extruder.position = fed
        values = {i: words.pop(x) * unit for i, x in enumerate(AXES) if x in words}
        if not values and fed is None:
            raise Fault("G92 needs at least one coordinate, such as G92 X0 Y0 Z0")
        self.tool.set_position(values)

    def _set_motion(self, block: Block) -> None:
        """Set the modal motion; a motion other than a cycle ends the series of cycles."""
        explicit = block.motion
        if explicit is not None:
            self.modes.motion = None if explicit == codes.CANCEL_MOTION else explicit
            if explicit not in codes.CYCLES:
                self.cycles.end()

    def _move(self, block: Block) -> None:
        """Execute the motion of a line, and the extrusion along it."""
        arc = self._draws_arc(block)
        self._set_motion(block)
        modes = self.modes
        fed = self.extruder.advance(block, self.notes) if modes.motion is not None else 0.0
        feeds = fed > 0
        if not arc and block.words.keys().isdisjoint(AXES):
            if fed:
                speed = modes.feed if modes.feed and not modes.inverse_time else 0.0
                self.extruder.feed_at_rest(fed * modes.unit, speed)
            return
        if modes.motion is None:
            raise Fault(
                "the line has coordinates, but no motion is active: write G0, G1, G2 or G3 before"
            )
        if modes.motion in codes.CYCLES:
            self.compensation.refuse(f"the cycle {codes.g_name(modes.motion)}")
            self.cycles.run(block)
            return
        self.extruder.switch(feeds)
        self._move_tool(block, feeds)
        block.drop(AXES)

    def _move_tool(self, block: Block, feeds: bool) -> None:
        """Move the tool to the point of a line; `feeds` is true if the move feeds material."""
        motion, target = self.modes.motion, self.tool.target(block)
        if motion == codes.RAPID:
            self.tool.move_rapid(target)
        elif motion != codes.LINE:
            self.tool.move_arc(block, target)
        elif not feeds and self.tool.undefined_axes and self.dialect.printer:
            self.tool.skip_move(target)
        elif not feeds and not self.draft.begun and self.dialect.extrudes:
            self.notes.add_once(
                "Feed moves before the first extrusion, first in line {}, are interpreted as "
                "rapids, so that the program begins with the first extrusion."
            )
            self.tool.move_rapid(target)
        else:
            self.tool.move_line(target)

    def _stop(self, block: Block) -> bool:
        """Record the pauses M0, M1 and M60; True if M2 or M30 ends the program."""
        for code, value in ((0, True), (60, True), (1, "optional")):
            if code in block.m:
                self.compensation.add_stop()
                self.compensation.add_event("pause", value)
        if 2 not in block.m and 30 not in block.m:
            return False
        self.switches.switch_off()
        return True

    def finish(self) -> None:
        """End the program, including an active compensation."""
        self.compensation.stop()


def _explain_tool(number: int) -> str:
    """Text for messages on how to specify the diameter of a tool."""
    return (
        f"its diameter, for example 3 mm (tools: {{{number}: 3 mm}} under path, or "
        f"--tool-diameter '{number}: 3 mm')"
    )
