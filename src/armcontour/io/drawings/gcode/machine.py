"""The modal state of a machine that runs G-code, and the execution of single lines.

The words of a line are executed in the order of the LinuxCNC manual ("G-code Order of
Execution"): feed, spindle, coolant, dwell, plane, units, path control, distance mode, motion, stop.
"""

from __future__ import annotations

import math

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.arc_words import (
    PLANES,
    by_radius,
    center_letters,
    turns_of,
)
from armcontour.io.drawings.gcode.arcs import (
    Circle,
    around,
    chords_of,
    pieces_of,
    point_of,
    with_radius,
)
from armcontour.io.drawings.gcode.arcs import Point as InPlane
from armcontour.io.drawings.gcode.draft import Draft, Point
from armcontour.io.drawings.gcode.switches import Switches
from armcontour.io.drawings.gcode.unknown import Unknown
from armcontour.io.drawings.gcode.words import Block, Fault
from armcontour.io.drawings.reading import Reading

MILLIMETRE, INCH = 1e-3, 0.0254
# Largest coordinate [m] and feed rate [m/s]: a double does not resolve a nanometre beyond it.
FARTHEST = 1e6
AXES = "XYZ"
# Heights that differ by less than this [m] are equal, and so are units that differ by less than
# this fraction.
CLOSE = 1e-9


class Machine:
    """The modal state, and the draft of the program of the lines so far.

    Args:
        reading: Settings of the reader.

    Attributes:
        draft: The program of the lines so far.
        unknown: Codes and words that were skipped.
        chord_tolerance: Largest distance between a helix and its chords [m].
        unit: Length of the program's unit [m].
        inch: Whether the unit is the inch (G20).
        plane: The active plane (G17, G18, G19).
        absolute: Whether coordinates are absolute (G90).
        arc_absolute: Whether centres of arcs are absolute (G90.1).
        motion: The active motion code; None if there is none.
        per_minute: Whether F is a feed per minute (G94).
        speed: Feed rate [m/s]; None before the first F.
        tolerance: Corner tolerance [m] (G64 P); 0 for exact path (G61), NaN if not given.
        at: Programmed position [m].
        switches: State of spindle and coolant.
        line: Number of the current line, from 1.
    """

    def __init__(self, reading: Reading) -> None:
        self.draft = Draft()
        self.unknown = Unknown(reading.unknown)
        self.chord_tolerance = reading.chord_tolerance
        self.unit = MILLIMETRE if reading.unit is None else reading.unit
        self.inch = False
        self.plane = codes.XY
        self.absolute, self.arc_absolute = True, False
        self.motion: int | None = None
        self.per_minute = True
        self.speed: float | None = None
        self.tolerance = math.nan
        self.at = [0.0, 0.0, 0.0]
        self.switches = Switches(self.draft)
        self.line = 0

    @property
    def plain(self) -> bool:
        """Whether a line of only X, Y, Z and F is a straight feed move to that point."""
        return self.motion == codes.LINE and self.absolute and self.per_minute and self.unit <= 0.1

    def feed_to(self, x: str | None, y: str | None, z: str | None, f: str | None) -> None:
        """Execute a line of only these words while the machine is `plain`.

        Args:
            x: Number after X, None if the line has no X.
            y: Number after Y, None if the line has no Y.
            z: Number after Z, None if the line has no Z.
            f: Number after F, None if the line has no F.

        Raises:
            Fault: The feed rate is out of range or missing.
        """
        if f is not None:
            self._set_feed(float(f))
        if x is None and y is None and z is None:
            return
        at, unit = self.at, self.unit
        if x is not None:
            at[0] = float(x) * unit
        if y is not None:
            at[1] = float(y) * unit
        if z is not None:
            at[2] = float(z) * unit
        speed = self.speed or self._feed()
        self.draft.feed(at[0], at[1], at[2], speed, self.tolerance, self.line)

    def execute(self, block: Block) -> bool:
        """Execute a line.

        Returns:
            Whether the line ends the program.

        Raises:
            Fault: The line cannot be executed.
        """
        skipped = self.unknown.screen(block, self.line)
        arc = not skipped.owns_axes and self._is_arc(block)
        if not skipped.owns_words:
            self._refuse_strays(block, arc)
        if skipped.owns_s:
            block.words.pop("S", None)
        self._set_rates(block)
        self.switches.apply(block)
        if codes.DWELL in block.g:
            self._dwell(block)
        self._set_modes(block)
        self._move(block, arc, skipped.owns_axes)
        return self._stop(block)

    def _refuse_strays(self, block: Block, arc: bool) -> None:
        """Refuse words that no code of the line uses.

        Args:
            block: The line.
            arc: Whether the line is an arc.

        Raises:
            Fault: A word is not used, or more than one code could use it.
        """
        words = block.words
        users = [codes.g_name(x) for x in (codes.DWELL, codes.BLEND) if x in block.g]
        users += ["the arc"] if arc else []
        if "P" in words and not users:
            raise Fault("the word P, which no code here uses: it belongs to G4, G64, G2 and G3")
        if "P" in words and len(users) > 1:
            raise Fault(f"the word P, which may belong to {' or '.join(users)}: write two lines")
        if "Q" in words and codes.BLEND not in block.g:
            raise Fault("the word Q, which no code here uses: it belongs to G64")
        for letter in "IJKR":
            if letter in words and not arc:
                raise Fault(f"the word {letter}, which no code here uses: it belongs to G2 and G3")

    def _is_arc(self, block: Block) -> bool:
        """Whether a line programs an arc."""
        explicit = _motion_of(block)
        if explicit is not None:
            return explicit in codes.ARCS
        return self.motion in codes.ARCS and not block.words.keys().isdisjoint("XYZIJKR")

    def _set_rates(self, block: Block) -> None:
        """Set the feed mode and the feed rate.

        Raises:
            Fault: The feed rate is out of range, or its unit is ambiguous.
        """
        if codes.PER_MINUTE in block.g and not self.per_minute:
            self.per_minute, self.speed = True, None
        elif codes.INVERSE_TIME in block.g or codes.PER_TURN in block.g:
            self.per_minute = False
        if "F" not in block.words or not self.per_minute:
            return
        new_unit = self._unit_of(block)
        if new_unit is not None and abs(new_unit - self.unit) > CLOSE * self.unit:
            raise Fault(
                "F on the line that changes the unit of length, which some machines read in the "
                "old unit and some in the new: write F on a line of its own"
            )
        self._set_feed(block.words["F"])

    def _set_feed(self, value: float) -> None:
        """Set the feed rate from the value of F, in units per minute.

        Raises:
            Fault: The feed rate is out of range.
        """
        speed = value * self.unit / 60
        if speed < 0 or speed > FARTHEST:
            raise Fault(
                f"a feed rate F of {value:g} per minute, which is not from 0 to {FARTHEST:g} m/s"
            )
        self.speed = speed

    def _feed(self) -> float:
        """Speed of a feed move [m/s]; NaN in a feed mode other than feed per minute.

        Raises:
            Fault: No feed rate was given.
        """
        if not self.per_minute:
            return math.nan
        if not self.speed:
            raise Fault(
                "no feed rate for G1, G2 or G3: give F above zero, in units per minute, here or "
                "before"
            )
        return self.speed

    def _dwell(self, block: Block) -> None:
        """Execute G4.

        Raises:
            Fault: The duration is missing or negative.
        """
        duration = block.words.get("P")
        if duration is None or duration < 0:
            given = "none" if duration is None else f"{duration:g}"
            raise Fault(f"G4 needs its time P in seconds, zero or above, but has {given}")
        self.draft.dwell(duration)

    def _unit_of(self, block: Block) -> float | None:
        """Length of the unit that a line sets [m]; None if it sets none."""
        if codes.INCH in block.g:
            return INCH
        return MILLIMETRE if codes.MILLIMETRE in block.g else None

    def _set_modes(self, block: Block) -> None:
        """Set unit, plane, distance modes and path control.

        Raises:
            Fault: The tolerance of G64 is not above zero.
        """
        unit = self._unit_of(block)
        if unit is not None:
            self.unit, self.inch = unit, unit == INCH
        for code in block.g:
            if code in PLANES:
                self.plane = code
            elif code in (codes.ABSOLUTE, codes.RELATIVE):
                self.absolute = code == codes.ABSOLUTE
            elif code in (codes.ARC_ABSOLUTE, codes.ARC_RELATIVE):
                self.arc_absolute = code == codes.ARC_ABSOLUTE
            elif code in (codes.EXACT_PATH, codes.EXACT_STOP):
                self.tolerance = 0.0
            elif code == codes.BLEND:
                self.tolerance = self._blend(block.words.get("P"))

    def _blend(self, largest: float | None) -> float:
        """The corner tolerance of G64 [m] from its word P; NaN without P.

        Raises:
            Fault: P is not above zero.
        """
        if largest is None:
            return math.nan
        if largest <= 0:
            raise Fault(
                f"G64 with P{largest:g}, which must be above zero: G61 follows corners exactly, "
                "G64 without P sets no tolerance"
            )
        return largest * self.unit

    def _move(self, block: Block, arc: bool, owned: bool) -> None:
        """Execute the motion of a line.

        Args:
            block: The line.
            arc: Whether the line is an arc.
            owned: Whether the line's coordinates belong to a skipped code.

        Raises:
            Fault: No motion is active, or the motion cannot be executed.
        """
        explicit = _motion_of(block)
        if explicit is not None:
            self.motion = None if explicit == codes.CANCEL_MOTION else explicit
        if owned or (not arc and block.words.keys().isdisjoint(AXES)):
            return
        if self.motion is None:
            raise Fault("coordinates without an active motion: write G0, G1, G2 or G3 before")
        target = self._target(block)
        if self.motion == codes.RAPID:
            self.draft.go(*target)
        elif self.motion == codes.LINE:
            self.draft.feed(*target, self._feed(), self.tolerance, self.line)
        else:
            self._arc(block, target)
        self.at = list(target)

    def _target(self, block: Block) -> Point:
        """The end point of a motion [m].

        Raises:
            Fault: A coordinate is too large.
        """
        x, y, z = (
            self._length(letter, block.words[letter], 0.0 if self.absolute else self.at[i])
            if letter in block.words
            else self.at[i]
            for i, letter in enumerate(AXES)
        )
        return x, y, z

    def _length(self, letter: str, value: float, origin: float) -> float:
        """The value of a word as a length from an origin [m].

        Raises:
            Fault: The length is too large.
        """
        length = origin + value * self.unit
        if abs(length) > FARTHEST:
            raise Fault(
                f"{letter}{value:g} leads to {length:g} m, beyond the {FARTHEST:g} m that are read"
            )
        return length

    def _arc(self, block: Block, target: Point) -> None:
        """Execute an arc or, if the height changes, a helix as chords.

        Raises:
            Fault: The words do not define an arc, or there are too many segments.
        """
        a, b, c = axes = PLANES[self.plane]
        speed, turns = self._feed(), turns_of(block)
        last = self.draft.last
        start, end = (last[a], last[b]), (target[a], target[b])
        circle = self._circle(block, start, end)
        if abs(target[c] - last[c]) <= CLOSE:
            self.draft.room_for(turns - 1)
            for piece in pieces_of(circle, turns):
                self.draft.bend(piece, axes, speed, self.tolerance, self.line)
            return
        n = chords_of(circle, turns, self.chord_tolerance)
        self.draft.room_for(n)
        point = list(last)
        for i in range(1, n + 1):
            share = i / n
            point[a], point[b] = point_of(circle, turns, share) if i < n else end
            point[c] = last[c] + share * (target[c] - last[c]) if i < n else target[c]
            x, y, z = point
            self.draft.feed(x, y, z, speed, self.tolerance, self.line)

    def _circle(self, block: Block, start: InPlane, end: InPlane) -> Circle:
        """The arc of a line in the active plane.

        Raises:
            Fault: The words do not define an arc.
        """
        turn = 1 if self.motion == codes.COUNTER_CLOCKWISE else -1
        if by_radius(block, self.plane):
            radius = self._length("R", block.words["R"], 0.0)
            return with_radius(start, end, radius, turn)
        letters = center_letters(block, self.plane, self.arc_absolute)
        x, y = (
            self._length(letter, block.words.get(letter, 0.0), 0.0 if self.arc_absolute else origin)
            for letter, origin in zip(letters, start, strict=True)
        )
        return around(start, end, (x, y), turn, "inch" if self.inch else "mm")

    def _stop(self, block: Block) -> bool:
        """Execute a pause or the end of the program; returns whether the program ends."""
        for code, value in ((0, True), (1, "optional")):
            if code in block.m:
                self.draft.rest()
                self.draft.event("pause", value)
        if 2 not in block.m and 30 not in block.m:
            return False
        self.switches.off()
        return True


def _motion_of(block: Block) -> int | None:
    """The motion code of a line; None if it has none."""
    return next((x for x in block.g if codes.G_GROUP.get(x) == "motion"), None)
