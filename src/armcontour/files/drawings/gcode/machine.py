"""The machine that executes the lines of a G-code program: modal state, moves and outputs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armcontour.core.text import count_noun
from armcontour.files.drawings.gcode import words as codes
from armcontour.files.drawings.gcode.arcs import (
    ProgrammedArc,
    arc_around,
    arc_parts,
    arc_with_radius,
    helix_knots,
)
from armcontour.files.drawings.gcode.program_draft import Feed, ProgramDraft
from armcontour.files.drawings.gcode.words import (
    INCH,
    MILLIMETRE,
    Block,
    Fault,
    Notes,
    g_name,
    unsupported,
    whole_number,
)
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.program.moves import SPINDLE_SPEED, Value

# Letters of coordinates.
AXES = "XYZ"
# Letters of the offsets from the start of an arc to its centre.
OFFSETS = "IJK"
# Letters of the other axes, which may only have the value 0.
OTHER_AXES = "ABCUVW"
ARCS = (codes.CLOCKWISE, codes.COUNTER_CLOCKWISE)
# Indices of the first and second axis of each plane, and of the axis normal to the plane. Seen from
# the positive end of the normal, the second axis is 90° counter-clockwise from the first.
PLANES = {codes.XY: (0, 1, 2), codes.ZX: (2, 0, 1), codes.YZ: (1, 2, 0)}
# Codes whose line has no motion, so that I, J, K and R without an end do not draw an arc.
OWN_THE_LINE = (codes.REFERENCE, codes.SECOND_REFERENCE, codes.MACHINE, codes.SHIFT)
SPINDLE: dict[int, Value] = {3: True, 4: "reverse", 5: False}
COOLANT: dict[int, Value] = {7: "mist", 8: "flood", 9: False}
BOTH = "mist and flood"
DIGITAL = {62: True, 63: False, 64: True, 65: False}
ANALOG = (67, 68)
# Largest coordinate [m]. Above this value a double does not resolve a nanometre.
FARTHEST = 1e6
# Largest feed rate [m/s].
FASTEST = 1e6
# Two heights are equal if their difference is at most this [m].
SAME_HEIGHT = 1e-9
# Largest position of another axis that counts as zero [degrees or units].
ZERO_POSITION = 1e-9
# Dwells of at least this time [s] get a note, because the program may be in milliseconds.
LONG_DWELL = 60.0
# Largest number of turns of one arc.
MAX_TURNS = 10_000
REFERENCE_NOTE = (
    "Moves to a reference position are replaced by a stop, because the file does not define the "
    "position: {}. From the stop the tool moves straight to the next point that the file defines. "
    "Make sure that there is no obstacle between these points."
)
FEED_FROM_REFERENCE = (
    "Feed moves from a reference position to the next G0, first in line {}, are read as rapids, "
    "because the file does not define where they start."
)


class Machine:
    """Executes lines: changes the modal state, and drafts the moves and events."""

    def __init__(
        self,
        options: ReadOptions,
        *,
        changes_tools: bool,
        named_arc_turns: Callable[[], str | None],
    ) -> None:
        self.draft = ProgramDraft()
        self.notes = Notes()
        self.outputs = Outputs(self.draft, t_changes_tool=not changes_tools)
        self.declared = codes.read_declared(options.words or {})
        self.arc_turns = options.arc_turns
        self.named_arc_turns = named_arc_turns
        self.chord_tolerance = options.chord_tolerance
        self.unit = options.unit or MILLIMETRE  # Length of the program's unit [m]
        self.unit_specified = options.unit is not None
        self.plane = codes.XY
        self.motion: int | None = None  # Code of the active motion, None after G80
        self.absolute = True
        self.arc_absolute = False
        self.tolerance = math.nan  # Maximum permitted corner error [m]; NaN if not specified
        self.feed = math.nan  # F [m/s]; NaN if not specified
        self.position = [0.0, 0.0, 0.0]  # Programmed point [m]
        # The active coordinate system.
        self.system = codes.SYSTEMS[0]
        # The coordinate system of the first coordinates; None before them.
        self.drawing_system: int | None = None
        # Axes on which the tool moved to a position that the file does not define.
        self.undefined_axes: set[int] = set()
        # First line with a feed move from such a position that no G0 has followed yet; 0 for none.
        self.undefined_feed = 0
        # Whether the tool is away from the end of the last drafted move.
        self.away = False

    @property
    def inch(self) -> bool:
        """True if the unit is the inch, so that tolerances for programs in inches apply."""
        return self.unit == INCH

    def accepts_plain_line(self) -> bool:
        """Return whether `execute_plain_line` can execute the next line."""
        return (
            self.motion == codes.LINE
            and self.absolute
            and self.unit <= 0.1
            and self.draft.begun
            and not self.away
            and self.system == self.drawing_system
        )

    def execute_plain_line(
        self, x: str | None, y: str | None, z: str | None, f: str | None
    ) -> None:
        """Execute a line with only X, Y, Z and F, after `accepts_plain_line` returned true."""
        position = self.position
        unit = self.unit
        if f is not None:
            self._set_feed(float(f), unit)
        if x is None and y is None and z is None:
            return
        if x is not None:
            position[0] = float(x) * unit
        if y is not None:
            position[1] = float(y) * unit
        if z is not None:
            position[2] = float(z) * unit
        self.draft.add_line(position[0], position[1], position[2], self._feed())

    def execute(self, block: Block) -> bool:
        """Execute a line; return whether it ends the program."""
        g = block.g
        words = block.words
        self._drop_words_without_motion(block)
        if "P" in words and codes.DWELL in g and codes.BLEND in g:
            raise Fault("the word P can belong to several codes of the line. Write separate lines")
        if "F" in words:
            self._set_feed(words.pop("F"), self._unit_of_feed(block))
        dwell = self._dwell(block) if codes.DWELL in g else None
        self.outputs.apply(block)
        self._switch_declared(block)
        if dwell is not None:
            self.draft.add_dwell(dwell)
        self._set_modes(block)
        if codes.REFERENCE in g:
            self._move_to_reference(block, codes.REFERENCE)
        elif codes.SECOND_REFERENCE in g:
            self._move_to_reference(block, codes.SECOND_REFERENCE)
        elif codes.MACHINE in g:
            self._move_in_machine(block)
        else:
            self._move(block)
        if block.declared:
            block.drop(codes.DECLARED_WORDS)
        for letter in words:
            raise Fault(f"no code on this line uses the word {letter}. Remove the word")
        return self._stop(block)

    def _switch_declared(self, block: Block) -> None:
        """Set the states of the codes that the options declare."""
        for name in block.declared:
            if name[0] == "G" and not block.words.keys().isdisjoint(codes.COORDINATES):
                raise Fault(
                    f"{name} switches outputs (path.words), so its line must not have coordinates. "
                    "Write the motion on a line of its own"
                )
            for output, value in self.declared[name].items():
                self.outputs.set(output, value)
            if not self.declared[name]:
                self.notes.skip(name)

    def _drop_words_without_motion(self, block: Block) -> None:
        """Leave out E and other axes at zero, with notes."""
        words = block.words
        if "E" in words and not any(x in ANALOG for x in block.m):
            del words["E"]
            self.notes.add_once(
                "The word E, first in line {}, is ignored, because the program has no output for "
                "the extruder. Feed moves without E are also part of the contours."
            )
        elif codes.SHIFT in block.g:
            raise unsupported("G92 without E")
        for letter in OTHER_AXES:
            if letter in words:
                value = words.pop(letter)
                if abs(value) > ZERO_POSITION:
                    raise unsupported(f"{letter}{value:g}, a move of the axis {letter},")
                self.notes.skip(f"the word {letter} with the value 0")

    def _draws_arc(self, block: Block) -> bool:
        """Return whether a line draws an arc."""
        if block.motion is not None:
            return block.motion in ARCS
        once = any(x in (codes.DWELL, *OWN_THE_LINE) for x in block.g)
        letters = "XYZ" if once else "XYZIJKR"
        return self.motion in ARCS and not block.words.keys().isdisjoint(letters)

    def _unit_of_feed(self, block: Block) -> float:
        """Return the length unit of F on a line [m]; refuse an ambiguous unit."""
        # On a line that changes the unit, controllers differ: they interpret F in the old or in the
        # new unit. If no unit was specified before, only the new unit is possible.
        unit = _selected_unit(block)
        if unit is None or math.isclose(unit, self.unit) or not self.unit_specified:
            return unit or self.unit
        raise Fault(
            "the line changes the unit of length and has an F, which some controllers interpret "
            "in the old unit and some in the new unit. Write F on a separate line"
        )

    def _set_feed(self, value: float, unit: float) -> None:
        """Set the feed rate to the word F, in units of length (`unit` [m]) per minute."""
        self.feed = value * unit / 60
        if not 0 <= self.feed <= FASTEST:
            maximum = FASTEST * 60 / unit
            name = "inch" if unit == INCH else "mm"
            raise Fault(
                f"the feed rate F must be from 0 to {maximum:.3g} {name} per minute, but is "
                f"{value:g}"
            )

    def _feed(self) -> Feed:
        """Return the speed, tolerance and origin of a feed move; notes a missing feed rate."""
        if self.feed == 0:
            raise Fault(
                "there is no feed rate for G1, G2 or G3. Write F above zero, in units per minute, "
                "on this line or before it"
            )
        if math.isnan(self.feed):
            self.notes.add_once(
                "Feed moves without a feed rate, first in line {}, have no programmed speed; only "
                "the limits of the job apply."
            )
        return self.feed, self.tolerance, self.notes.origin

    def _dwell(self, block: Block) -> float:
        """Return the time of G4 [s], from the word P, or from S or X (other controllers)."""
        words = block.words
        letter = next((x for x in "PSX" if x in words), None)
        if letter is None:
            # In Marlin, G4 without a time waits until all moves are done.
            self.notes.skip("G4 without a time (a stop of 0 s)")
            return 0.0
        duration = words.pop(letter)
        if duration < 0:
            raise Fault(f"the time of G4 must not be negative, but is {letter}{duration:g}")
        if duration >= LONG_DWELL:
            self.notes.add_once(
                f"Dwells of {LONG_DWELL:g} s and above, first in line {{}}, are interpreted in "
                "seconds, as in LinuxCNC and grbl. Some controllers use milliseconds."
            )
        return duration

    def _set_modes(self, block: Block) -> None:
        """Set units, plane, distance modes, path control and offsets that a line selects."""
        unit = _selected_unit(block)
        if unit is not None:
            self.unit = unit
            self.unit_specified = True
        for code in block.g:
            if code in PLANES:
                self.plane = code
            elif code in (codes.ABSOLUTE, codes.RELATIVE):
                self.absolute = code == codes.ABSOLUTE
            elif code in (codes.ARC_ABSOLUTE, codes.ARC_RELATIVE):
                self.arc_absolute = code == codes.ARC_ABSOLUTE
            elif code in (codes.EXACT_PATH, codes.EXACT_STOP):
                self.tolerance = 0.0
                if code == codes.EXACT_STOP:
                    self.notes.add_once(
                        "G61.1, first in line {}, has the effect of G61: the tool stops at "
                        "corners, but not where moves are tangent."
                    )
            elif code == codes.BLEND:
                block.drop("Q")
                tolerance = block.words.pop("P", math.nan)
                if tolerance < 0:
                    raise Fault(f"P of G64 must not be negative, but is {tolerance:g}")
                if tolerance == 0:
                    self.notes.add_once(
                        "G64 P0 in line {} sets no tolerance, as in LinuxCNC. G61 allows no corner "
                        "error."
                    )
                self.tolerance = tolerance * self.unit or math.nan
            elif code in codes.SYSTEMS:
                self.system = code
            elif code == codes.TOOL_LENGTH:
                block.drop("H")
                self.notes.add_once(
                    "With tool length compensation, first in line {}, the programmed point is the "
                    "tip of the tool. Calibrate the tool of the robot to its tip."
                )

    def _length(self, letter: str, value: float) -> float:
        """Return the length [m] of a word."""
        length = value * self.unit
        if not abs(length) <= FARTHEST:
            raise Fault(
                f"lengths must be within {FARTHEST:g} m, but {letter}{value:g} is {length:g} m"
            )
        return length

    def _coordinates(self, block: Block) -> dict[int, float]:
        """Return the coordinates of a line [m] by axis index; removes them from the line."""
        words = block.words
        return {i: self._length(x, words.pop(x)) for i, x in enumerate(AXES) if x in words}

    def _move(self, block: Block) -> None:
        """Execute the motion of a line."""
        arc = self._draws_arc(block)
        if block.motion is not None:
            self.motion = None if block.motion == codes.CANCEL_MOTION else block.motion
        coordinates = self._coordinates(block)
        if not arc and not coordinates:
            return
        if self.motion is None:
            raise Fault(
                "the line has coordinates, but no motion is active. Write G0, G1, G2 or G3 before"
            )
        target = self._target(coordinates)
        if self.motion == codes.RAPID:
            self._move_rapid(target)
            return
        if self.away:
            if self.motion != codes.LINE or not self.undefined_axes:
                raise self._undefined_start()
            # Posts of free CAM programs write rapids as feed moves, so a G0 may still follow.
            self.undefined_feed = self.undefined_feed or self.notes.line
            self.position = target
            return
        self.drawing_system = self.drawing_system or self.system
        if self.motion == codes.LINE:
            self.draft.add_line(target[0], target[1], target[2], self._feed())
        else:
            self._draw_arc(block, target, coordinates)
        self.position = target

    def _undefined_start(self) -> Fault:
        """Return the error for a feed move that starts at a reference position."""
        names = ", ".join(AXES[i] for i in sorted(self.undefined_axes)) or "X, Y and Z"
        return Fault(
            "a feed move cannot start at a reference position (G28, G30, G53), because the file "
            f"does not define the position. Write a G0 with absolute {names} before"
        )

    def finish(self) -> None:
        """Check at the end of the program that a G0 followed the feed moves from a reference."""
        if self.undefined_feed:
            self.notes.line = self.undefined_feed
            raise self._undefined_start()

    def _target(self, coordinates: dict[int, float]) -> list[float]:
        """Return the point of the drawing [m] that the coordinates of a line define."""
        if self.absolute and coordinates:
            self.drawing_system = self.drawing_system or self.system
            if self.drawing_system != self.system:
                second = g_name(self.system)
                first = g_name(self.drawing_system)
                raise Fault(
                    f"the program has a coordinate {AXES[min(coordinates)]} in {second} after "
                    f"coordinates in {first}, but must have one coordinate system only, because "
                    "the offsets between systems are in the controller. Post-process the program "
                    "with one system"
                )
            self.undefined_axes -= coordinates.keys()
        point = [
            coordinates.get(i, x) if self.absolute else x + coordinates.get(i, 0.0)
            for i, x in enumerate(self.position)
        ]
        if max(map(abs, point)) > FARTHEST:
            raise Fault(f"coordinates must be within {FARTHEST:g} m, but the move ends beyond")
        return point

    def _move_rapid(self, target: list[float]) -> None:
        """Make a rapid move to a point [m]."""
        if not self.away:
            self.draft.add_rapid(target[0], target[1], target[2], self.notes.origin)
        elif not self.undefined_axes:
            self.draft.resume_at(target)
            self.away = False
            if self.undefined_feed:
                self.notes.add_once(FEED_FROM_REFERENCE, self.undefined_feed)
                self.undefined_feed = 0
        self.position = target

    def _move_to_reference(self, block: Block, code: int) -> None:
        """G28, G30: move through the point of the line to a reference position."""
        # The axes of the line move to the reference position; without coordinates, all axes move.
        coordinates = self._coordinates(block)
        if coordinates:
            self._move_rapid(self._target(coordinates))
        self._lose_position(g_name(code), set(coordinates) or {0, 1, 2})

    def _move_in_machine(self, block: Block) -> None:
        """G53: make a rapid move to machine coordinates; the position is undefined afterwards."""
        self.motion = self.motion if block.motion is None else block.motion
        if block.words.keys().isdisjoint(AXES):
            self.notes.skip("G53 without coordinates")
            return
        if self.motion != codes.RAPID:
            raise Fault(
                "only a rapid move can have machine coordinates (G53), because their offset is in "
                "the controller and not in the file. Write the move in coordinates of the program"
            )
        self._lose_position("G53", set(self._coordinates(block)))

    def _lose_position(self, name: str, axes: set[int]) -> None:
        """Stop, and mark the position of some axes as undefined; `name` is the code for the note.

        The draft continues at the next defined point. Before the first contour, the axes are set
        to zero of the program instead.
        """
        self.notes.skip(name, REFERENCE_NOTE)
        self.draft.add_stop()
        if self.draft.begun:
            self.undefined_axes |= axes
            self.away = True
            return
        self.position = [0.0 if i in axes else x for i, x in enumerate(self.position)]
        self.draft.resume_at(self.position)

    def _draw_arc(self, block: Block, target: list[float], coordinates: dict[int, float]) -> None:
        """Make an arc or helix in the active plane; remove its words from the line."""
        a, b, c = axes = PLANES[self.plane]
        last = self.draft.last
        feed = self._feed()
        start = complex(last[a], last[b])
        end = complex(target[a], target[b])
        circles = self._circles(block.words.pop("P")) if "P" in block.words else 0
        arc = self._read_arc(block, start, end, bool({a, b} & coordinates.keys()))
        arc = replace(arc, circles=circles)
        rise = target[c] - last[c]
        if abs(rise) <= SAME_HEIGHT:
            for piece in arc_parts(arc):
                self.draft.add_arc(piece, axes, feed)
            return
        knots = helix_knots(arc, self.chord_tolerance, self.draft.count_segments)
        count = len(knots.point) - 1
        rows = np.zeros((3, count + 1, 3))
        for row, values in zip(rows, (knots.point, knots.first, knots.second), strict=True):
            row[:, a] = np.real(values)
            row[:, b] = np.imag(values)
        rows[0, :, c] = np.linspace(last[c], target[c], count + 1)
        rows[1, :, c] = rise
        middles = np.full((count, 3), rise)
        middles[:, a] = np.real(knots.middle)
        middles[:, b] = np.imag(knots.middle)
        self.draft.add_helix(rows, middles, feed)

    def _circles(self, value: float) -> int:
        """Return the number of full circles before an arc, by the word P."""
        turns = whole_number(value, "the number of turns P of an arc")
        meaning = self.arc_turns or self.named_arc_turns()
        if meaning is None:
            raise Fault(
                f"P{turns} of an arc has two meanings: in LinuxCNC and FluidNC "
                f"{count_noun(turns, 'turn')} in all, in Marlin {count_noun(turns, 'full circle')} "
                "before the arc. No comment names one of them. State which one you mean with "
                "path.arc_turns: total or extra (on the command line --arc-turns)"
            )
        fewest = 1 if meaning == "total" else 0
        if not fewest <= turns <= MAX_TURNS:
            raise Fault(f"P of an arc must be from {fewest} to {MAX_TURNS}, but is {turns}")
        if self.arc_turns is None:
            controllers = "LinuxCNC and FluidNC" if meaning == "total" else "Marlin"
            self.notes.add_once(
                "The word P of arcs, first in line {}, counts "
                + ("all turns" if meaning == "total" else "the full circles before the arc")
                + f", as in {controllers}, because a comment names this controller."
            )
        return turns - fewest

    def _read_arc(self, block: Block, start: complex, end: complex, has_end: bool) -> ProgrammedArc:
        """Return the arc of a line; `has_end`: whether the line has a coordinate in the plane."""
        words = block.words
        turn = 1 if self.motion == codes.COUNTER_CLOCKWISE else -1
        a, b, c = PLANES[self.plane]
        both = f"{OFFSETS[min(a, b)]} and {OFFSETS[max(a, b)]}"
        # Some post-processors write all three offsets; a zero offset normal to the plane is valid.
        if words.get(OFFSETS[c], 0.0) != 0:
            raise Fault(
                f"the word {OFFSETS[c]} is not valid for an arc in the plane "
                f"{g_name(self.plane)}. Write the centre as {both}"
            )
        block.drop(OFFSETS[c])
        letters = [x for x in OFFSETS if x in words]
        if "R" in words:
            if letters or not has_end:
                raise Fault(
                    "an arc with the radius R needs an end point and no centre. Write "
                    f"{AXES[min(a, b)]} and {AXES[max(a, b)]}, and remove {both}"
                )
            return arc_with_radius(start, end, self._length("R", words.pop("R")), turn)
        if not letters:
            raise Fault(f"an arc needs its centre ({both}) or its radius (R)")
        if self.arc_absolute and len(letters) < 2:
            raise Fault(
                f"an absolute centre of an arc (G90.1) needs {both}, but the line has only "
                f"{letters[0]}"
            )
        offset = complex(*(self._length(x, words.pop(x, 0.0)) for x in (OFFSETS[a], OFFSETS[b])))
        center = offset if self.arc_absolute else start + offset
        return arc_around(start, end, center, turn, "inch" if self.inch else "mm")

    def _stop(self, block: Block) -> bool:
        """Record the pauses M0 and M1; True if M2 or M30 ends the program."""
        for code, value in ((0, True), (1, "optional")):
            if code in block.m:
                self.draft.add_stop()
                self.draft.add_event("pause", value)
        if 2 not in block.m and 30 not in block.m:
            return False
        self.outputs.switch_off()
        return True


class Outputs:
    """States of spindles, coolant, tool and outputs; each change becomes an event."""

    def __init__(self, draft: ProgramDraft, *, t_changes_tool: bool) -> None:
        self.draft = draft
        self.t_changes_tool = t_changes_tool
        self.states: dict[str, Value] = {}
        self.spindles = {0: "spindle"}
        self.selected: int | None = None

    def apply(self, block: Block) -> None:
        """Switch outputs as a line commands, in the order of the manual; removes the words used."""
        m = block.m
        words = block.words
        spindles = self._spindles(block)
        if "S" in words:
            speed = words.pop("S")
            if speed < 0:
                raise Fault(f"the spindle speed S must not be negative, but is {speed:g}")
            for name in spindles:
                self.set(SPINDLE_SPEED.replace("spindle", name), speed)
        if "T" in words:
            self.selected = whole_number(words.pop("T"), "the number of a tool T")
            if self.t_changes_tool:
                self._change_tool()
        for code in m:
            if code in DIGITAL:
                self.set(f"output {_number(block, 'P', code)}", DIGITAL[code])
            elif code in ANALOG:
                self.set(f"analog output {_number(block, 'E', code)}", words.pop("Q", 0.0))
        if codes.TOOL_CHANGE_CODE in m:
            self._change_tool()
        for code in m:
            for name in spindles if code in SPINDLE else ():
                self.set(name, SPINDLE[code])
        for code in m:
            if code in COOLANT:
                value = COOLANT[code]
                current = self.states.get("coolant")
                self.set("coolant", BOTH if value and current and current != value else value)

    def _spindles(self, block: Block) -> list[str]:
        """Return names of the spindles that M3, M4, M5 and S address with $; $-1 addresses all."""
        if "S" not in block.words and SPINDLE.keys().isdisjoint(block.m):
            return []
        number = whole_number(block.words.pop("$", 0.0), "the number of a spindle $")
        if number < -1:
            raise Fault(f"the number of a spindle $ must not be below -1, but is {number}")
        if number == -1:
            return list(self.spindles.values())
        return [self.spindles.setdefault(number, f"spindle {number}")]

    def _change_tool(self) -> None:
        """Stop, and record an event for the selected tool."""
        self.draft.add_stop()
        value: Value = True if self.selected is None else float(self.selected)
        if self.states.get("tool") != value or value is True:
            self.draft.add_event("tool", value)
            self.states["tool"] = value

    def switch_off(self) -> None:
        """End of the program: switch off spindles and coolant.

        Source: LinuxCNC manual, M Codes, "M2, M30".
        """
        for name in (*self.spindles.values(), "coolant"):
            if self.states.get(name):
                self.set(name, False)

    def set(self, name: str, value: Value) -> None:
        """Set a state; records an event if it changes."""
        if name not in self.states or self.states[name] != value:
            self.draft.add_event(name, value)
            self.states[name] = value


def _selected_unit(block: Block) -> float | None:
    """Return the unit of length that a line selects [m]; None if it selects no unit."""
    if codes.INCHES in block.g:
        return INCH
    return MILLIMETRE if codes.MILLIMETRES in block.g else None


def _number(block: Block, letter: str, code: int) -> int:
    """Return the output number of an M code; removes it from the line."""
    if letter not in block.words:
        raise Fault(f"M{code} needs the number of its output, {letter}")
    return whole_number(block.words.pop(letter), f"the number of an output {letter}")
