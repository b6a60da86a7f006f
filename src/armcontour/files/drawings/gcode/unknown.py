"""What the reader does not carry out: left out with a note where it moves nothing, or refused."""

from __future__ import annotations

import math
from collections.abc import Collection

from armcontour.files.drawings.gcode import codes
from armcontour.files.drawings.gcode.faults import Fault, Notes
from armcontour.files.drawings.gcode.words import LASER, Block

# Rotary axes, which turn the part or the tool, and axes beside X, Y and Z.
OTHER_AXES = "ABCUVW"
# Words that move nothing alone: offsets of tools, pockets, values of codes that are left out.
IDLE = "DEHLOT"
# Positions of such an axis up to this are zero [degrees or units].
TURNED = 1e-9
# Words of an M code that is not known, where it shares its line with a motion.
OF_M = "DEHLOPQST"


class Unknown:
    """What is left out, with notes, or refused.

    Args:
        notes: Takes the notes.
        skip: Words and codes that a user wants left out, such as "M6" or "T"; `read_path` refuses
            words of coordinates.
        lenient: Whether codes that nobody knows are left out if they have no coordinates.
    """

    def __init__(self, notes: Notes, skip: Collection[str], lenient: bool) -> None:
        self.notes, self.wanted, self.lenient = notes, frozenset(skip), lenient

    def screen(self, block: Block) -> None:
        """Takes from a line what is not carried out.

        Raises:
            Fault: Something without which the rest of the program would be elsewhere.
        """
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
        if self.wanted:
            self._skip_wanted(block)
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
        """M codes of other machines. RepRap's M201, M203 and so on have X, Y and Z of their own."""
        for code in strange:
            if code in codes.CALLS:
                raise Fault(f"M{code:g}: subprograms are not read; {codes.PLAIN_MOVES}")
            if code == codes.RESTORE and block.words.keys().isdisjoint("PRS"):
                raise Fault(f"M72, which restores saved modes, is not read; {codes.PLAIN_MOVES}")
            block.m.remove(code)
            self.notes.count(f"M{code:g}")
        alone = block.motion is None and not any(x in codes.OWN_THE_LINE for x in block.g)
        own = list(block.words)[block.before_m :]
        block.drop(x for x in own if alone or x in OF_M)

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
                f"G3, or have it left out with its words (unknown: {{skip: [{name}]}}, or --skip "
                f"{name})"
            )
        if code not in codes.HARMLESS_G and not self.lenient:
            raise Fault(
                f"{name}, which this reader does not know: remove it, or have it left out "
                f"(unknown: {{skip: [{name}]}}, or --skip {name})"
            )
        block.g.remove(code)
        if block.motion == code:
            block.motion = None
        self.notes.count(name)
        block.drop([x for x, y in block.words.items() if x in "IJKR" + OF_M or math.isnan(y)])

    def _skip_wanted(self, block: Block) -> None:
        """What a user wants left out, with the words that belong to it."""
        for code in [x for x in block.g if codes.g_name(x) in self.wanted]:
            name = codes.g_name(code)
            if code in codes.NEVER_SKIPPED_G or codes.G_GROUP.get(code) == codes.MOTION:
                raise Fault(f"{name}, a motion, which cannot be left out: write it otherwise")
            block.g.remove(code)
            self.notes.count(name)
            strange = code not in codes.UNDERSTOOD_G and block.motion is None
            own = strange or code in codes.OWN_THE_LINE
            block.drop(OTHER_AXES + "XYZIJKR" + OF_M if own else "DHL")
        for found in [x for x in block.m if f"M{x:g}" in self.wanted]:
            self._leave_m(block, [found])
        for letter in [x for x in block.words if x in self.wanted]:
            del block.words[letter]
            self.notes.count(f"the word {letter}")

    def _check_axes(self, block: Block) -> None:
        """Axes beside X, Y and Z: at zero they may be left out."""
        for letter in [x for x in OTHER_AXES if x in block.words]:
            value = block.words.pop(letter)
            if abs(value) > TURNED:
                raise Fault(
                    f"{letter}{value:g}, a move of the axis {letter}, which this reader does not "
                    "have: it reads X, Y and Z (to have the word left out all the same: unknown: "
                    f"{{skip: [{letter}]}}, or --skip {letter})"
                )
            if not math.isnan(value):
                self.notes.count(f"the word {letter} of zero")

    def leave_idle(self, block: Block) -> None:
        """Takes words from a line that move nothing and that nothing on the line has taken.

        Raises:
            Fault: Words that belong to a motion, on a line without one that takes them.
        """
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
        """Whether P and Q may belong to a mode of another controller, such as G8 P1 or M0 P500."""
        return bool(block.m) or 80 in block.g
