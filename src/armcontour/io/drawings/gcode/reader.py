"""The function `read_gcode`: lines, percent signs and the end of a G-code program."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator

from armcontour._progress import Progress, Step
from armcontour.errors import InvalidInput
from armcontour.io.drawings.gcode.machine import Machine
from armcontour.io.drawings.gcode.words import Fault, parse
from armcontour.io.drawings.reading import Reading
from armcontour.program import Program

# A line of only coordinates and feed, as nearly all lines of long programs are. All other lines
# are split into words, which is slower and has the same result.
_NUMBER = r"([+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})) ?"
PLAIN = re.compile(
    r"(?:N[0-9]{1,9} ?)?(?:G0?1 ?)?"
    rf"(?:X{_NUMBER})?(?:Y{_NUMBER})?(?:Z{_NUMBER})?(?:F{_NUMBER})?\n?"
)
# Longest line [characters]: usual lines have tens of characters, comments hundreds.
LONGEST_LINE = 65_536
LINES_BETWEEN_REPORTS = 4096
LINE_END = re.compile(rb"\r\n|\r|\n")
WHITE = " \t\r\n"


def read_gcode(
    data: bytes,
    *,
    source: str,
    reading: Reading,
    progress: Progress | None = None,
) -> Program:
    """Read a program in G-code (RS274/NGC as in the LinuxCNC manual).

    Feed moves without a rapid or a dwell between them are one contour, named after its first line.
    Each segment has the speed F and the corner tolerance of G64 P, or 0 after G61. Rapids keep
    their points. Changes of spindle and coolant are events. docs/guides/gcode.md lists all words.

    Args:
        data: Content of the file.
        source: Name of the file.
        reading: Settings of the reader; its unit, by default millimetres, is used until G20 or G21.
        progress: Called from time to time with the name of the source and the fraction of the file
            that is read.

    Raises:
        InvalidInput: A line cannot be read or executed; `index` is the number of the line, from 0.
    """
    _refuse_binary(data, source)
    machine = Machine(reading)
    notes = _run(_lines(data), machine, source, _line_reporter(data, source, progress))
    program = machine.draft.program(source, tuple(machine.unknown.notes() + notes))
    if progress is not None:
        progress(Step((source,), 1.0))
    return program


def _refuse_binary(data: bytes, source: str) -> None:
    """Refuse a file that contains a byte of value 0.

    Raises:
        InvalidInput: The file does.
    """
    at = data.find(b"\0")
    if at >= 0:
        line = 1 + sum(1 for _ in LINE_END.finditer(data, 0, at))
        raise InvalidInput(
            f"{source}, line {line}: a byte of value 0, which G-code does not have: save the file "
            "as plain text (ASCII, Latin-1 or UTF-8).",
            index=line - 1,
        )


def _lines(data: bytes) -> Iterator[str]:
    r"""The lines of a file, with \n, \r\n or \r as line ends."""
    text = io.TextIOWrapper(io.BytesIO(data), encoding="latin-1", newline=None)
    if data.startswith(b"\xef\xbb\xbf"):
        text.read(3)
    return iter(text)


def _line_reporter(
    data: bytes, source: str, progress: Progress | None
) -> Callable[[int], None] | None:
    """A function that reports the progress for the number of a line; None if none is wanted."""
    if progress is None:
        return None
    total = max(data.count(b"\n"), data.count(b"\r")) + 1
    return lambda line: progress(Step((source,), min(line / total, 1.0)))


def _run(
    lines: Iterator[str], machine: Machine, source: str, report: Callable[[int], None] | None
) -> list[str]:
    """Execute all lines up to the end of the program; returns notes on lines left out.

    Raises:
        InvalidInput: A line cannot be read or executed, or the closing percent sign is missing.
    """
    frame = _Frame()
    plain = machine.plain
    number = 0
    try:
        for number, line in enumerate(lines, 1):
            machine.line = number
            if report is not None and not number % LINES_BETWEEN_REPORTS:
                report(number)
            found = PLAIN.fullmatch(line) if plain else None
            if found is not None:
                machine.feed_to(*found.groups())
                continue
            if frame.run_line(line, machine):
                break
            plain = machine.plain
    except Fault as fault:
        raise InvalidInput(f"{source}, line {number}: {fault}.", index=number - 1) from None
    if frame.framed and not frame.ended:
        raise InvalidInput(
            f"{source}, line {number}: the file starts with % and ends without a second %, M2 or "
            "M30: it may have been cut off.",
            index=number - 1,
        )
    return frame.notes(number, lines)


class _Frame:
    """The start and end of a program, marked by percent signs or M2 and M30, and deleted lines.

    Attributes:
        framed: Whether the program started with a percent sign.
        seen: Whether a line with words was executed.
        ended: Whether the program has ended.
        deleted: Number of lines with a slash (block delete), which are not executed.
        first_deleted: Number of the first of these lines.
    """

    def __init__(self) -> None:
        self.framed = False
        self.seen = False
        self.ended = False
        self.deleted = 0
        self.first_deleted = 0

    def run_line(self, line: str, machine: Machine) -> bool:
        """Execute a line; returns whether the program ends with it.

        Raises:
            Fault: The line cannot be read or executed.
        """
        if len(line) > LONGEST_LINE:
            raise Fault(
                f"more than {LONGEST_LINE} characters in one line, which G-code does not have: "
                "check what the file is"
            )
        text = line.strip(WHITE)
        if text.startswith("%"):
            if text != "%":
                machine.unknown.skip("what follows % on its line", machine.line)
            self.ended = self.framed or self.seen
            self.framed = True
        elif text.startswith("/"):
            self.first_deleted = self.first_deleted or machine.line
            self.deleted += 1
        elif text:
            block = parse(line)
            self.seen = self.seen or bool(block.g or block.m or block.words)
            self.ended = machine.execute(block)
        return self.ended

    def notes(self, last: int, rest: Iterator[str]) -> list[str]:
        """Sentences on the lines that were left out.

        Args:
            last: Number of the last line that was read.
            rest: The lines after it.
        """
        found = []
        if self.deleted:
            found.append(
                f"{self.deleted} line{'s' if self.deleted > 1 else ''} with a slash (block delete) "
                f"{'were' if self.deleted > 1 else 'was'} left out, first line "
                f"{self.first_deleted}."
            )
        if self.ended and any(x.strip(WHITE + "%") for x in rest):
            found.append(f"Lines after the end of the program, line {last}, were not read.")
        return found
