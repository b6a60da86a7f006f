"""Codes and words that the reader does not execute: refused, or skipped and counted."""

from __future__ import annotations

from dataclasses import dataclass

from armcontour.io.drawings.gcode import codes
from armcontour.io.drawings.gcode.words import Block, Fault
from armcontour.io.drawings.reading import SKIP

# Words that are used only by codes that the reader does not execute.
OTHER_LETTERS = "ABCDEHLTUVW"


@dataclass(frozen=True, slots=True, kw_only=True)
class Skipped:
    """Which words of a line belong to codes that were skipped.

    Args:
        owns_words: Whether I, J, K, P, Q or R may belong to a skipped code.
        owns_s: Whether S belongs to a skipped code, for example as a temperature.
        owns_axes: Whether X, Y and Z belong to a skipped code.
    """

    owns_words: bool
    owns_s: bool
    owns_axes: bool


NOTHING = Skipped(owns_words=False, owns_s=False, owns_axes=False)


class Unknown:
    """Counts the codes and words that were skipped.

    Args:
        policy: "refuse" or "skip".

    Attributes:
        counts: For each skipped code or word its number of occurrences and its first line.
    """

    def __init__(self, policy: str) -> None:
        self.policy = policy
        self.counts: dict[str, list[int]] = {}

    def screen(self, block: Block, line: int) -> Skipped:
        """Skip or refuse the codes and words of a line that the reader does not execute.

        Raises:
            Fault: A code or word is refused by the policy, or is never skipped.
        """
        letters = [x for x in block.words if x in OTHER_LETTERS]
        g = [x for x in block.g if x not in codes.UNDERSTOOD_G]
        m = [x for x in block.m if x not in codes.UNDERSTOOD_M]
        if not (letters or g or m):
            return NOTHING
        axes = not block.words.keys().isdisjoint("XYZ")
        owns = False
        for code in g:
            self._refuse_motion(code, axes)
            owns = owns or code in codes.OWN_THE_LINE
            self.skip(codes.g_name(code), line)
        for code in m:
            if code in codes.NEVER_SKIPPED_M:
                raise Fault(f"M{code}, a call of a subprogram, which this reader does not follow")
            self.skip(f"M{code}", line)
        for letter in letters:
            self.skip(f"the word {letter}", line)
        own_m = not codes.TAKE_NO_WORDS_M.issuperset(m)
        return Skipped(
            owns_words=own_m or not codes.TAKE_NO_WORDS_G.issuperset(g),
            owns_s=own_m or codes.SURFACE_SPEED in g,
            owns_axes=owns,
        )

    def _refuse_motion(self, code: int, axes: bool) -> None:
        """Refuse a code without which the moves after it would be at other positions.

        Args:
            code: The G code.
            axes: Whether its line has coordinates.

        Raises:
            Fault: The code is such a code.
        """
        name = codes.g_name(code)
        if code in codes.NEVER_SKIPPED_G:
            raise Fault(
                f"{name}, which this reader does not carry out and does not skip either, because "
                "the moves after it would be at other positions: write G0, G1, G2 and G3"
            )
        known = code in codes.NO_USE_FOR_AXES or code in codes.OWN_THE_LINE
        if axes and not known:
            raise Fault(
                f"{name} with coordinates, which this reader does not know: write G0, G1, G2 and G3"
            )

    def skip(self, kind: str, line: int) -> None:
        """Count a skipped code or word, or refuse it.

        Args:
            kind: Name of the code or word.
            line: Number of its line.

        Raises:
            Fault: The policy is to refuse.
        """
        if self.policy == "refuse":
            raise Fault(f"{kind}, which this reader does not carry out: remove it, or {SKIP}")
        self.counts.setdefault(kind, [0, line])[0] += 1

    def notes(self) -> list[str]:
        """One sentence for each kind of code or word that was skipped."""
        return [
            f"{kind[0].upper()}{kind[1:]} was skipped {count} time{'s' if count > 1 else ''}, "
            f"first in line {line}."
            for kind, (count, line) in self.counts.items()
        ]
