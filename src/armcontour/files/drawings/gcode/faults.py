"""What is wrong with a line, and notes on how lines are read."""

from __future__ import annotations

from armcontour.core.describing import count_noun
from armcontour.core.text import list_some

MILLIMETRE, INCH = 1e-3, 0.0254
IDLE = "Left out, because it moves nothing: {}."
# Largest number of kinds that a note names.
MOST_KINDS = 12


class Fault(Exception):
    """What is wrong with a line, as the second half of a sentence that names the line.

    Args:
        text: The words, with `{}` in place of each length.
        lengths: The lengths [m], which are told in the unit of the program.
        line: The line, if it is not the one that is carried out.
    """

    def __init__(self, text: str, *lengths: float, line: int = 0) -> None:
        super().__init__(text)
        self.lengths, self.line = lengths, line

    def told(self, *, inch: bool) -> str:
        """The words with the lengths, in inches or in millimetres."""
        text = str(self)
        if not self.lengths:
            return text
        unit, name = (INCH, "inch") if inch else (MILLIMETRE, "mm")
        return text.format(*(f"{x / unit:.6g} {name}" for x in self.lengths))


class Notes:
    """Notes on what was left out and how lines are read, with the line that is carried out."""

    def __init__(self) -> None:
        self.line = 0
        # Count and first line of each kind, by the sentence; first lines by the sentence.
        self.counts: dict[str, dict[str, list[int]]] = {IDLE: {}}
        self.firsts: dict[str, int] = {}

    def count(self, kind: str, sentence: str = IDLE) -> None:
        """Note that something was left out; `{}` in the sentence stands for all kinds."""
        self.counts.setdefault(sentence, {}).setdefault(kind, [0, self.line])[0] += 1

    def once(self, sentence: str) -> None:
        """Note how the line is read; `{}` in the sentence stands for the first such line."""
        self.firsts.setdefault(sentence, self.line)

    def sentences(self) -> list[str]:
        """All notes."""
        listed = {
            sentence: list_some(
                [
                    f"{x} ({count_noun(n, 'time')}, first in line {i})"
                    for x, (n, i) in kinds.items()
                ],
                MOST_KINDS,
            )
            for sentence, kinds in self.counts.items()
        }
        counted = [sentence.format(x) for sentence, x in listed.items() if x]
        return counted + [sentence.format(line) for sentence, line in self.firsts.items()]
