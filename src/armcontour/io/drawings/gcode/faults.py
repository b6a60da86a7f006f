"""What is wrong with a line."""

from __future__ import annotations

from armcontour.io.drawings.gcode.modes import INCH, MILLIMETRE


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
