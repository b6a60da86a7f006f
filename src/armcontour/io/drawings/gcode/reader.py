"""Reading G-code: lines, the frame of percent signs, and the end of the program."""

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

# A line of nothing but coordinates and feed, as nearly all lines of long programs are. Whatever it
# does not match is taken apart word by word, to the same effect.
_NUMBER = r"([+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})) ?"
PLAIN = re.compile(
    r"(?:N[0-9]{1,9} ?)?(?:G0?1 ?)?"
    rf"(?:X{_NUMBER})?(?:Y{_NUMBER})?(?:Z{_NUMBER})?(?:F{_NUMBER})?\n?"
)
# A program has lines of some ten characters, and comments of some hundred.
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
    """The program that G-code says, RS274/NGC as the LinuxCNC manual has it.

    Feed moves without a rapid or a dwell between them are one contour, named after their first
    line; every segment has the speed F and the tolerance G64 P, or 0 under G61. Rapids keep their
    points.
    Spindle and coolant are events. See docs/guides/gcode.md for every word.

    Args:
        data: What the file holds.
        source: What it is called.
        reading: How to read it; its unit holds until G20 or G21, millimetres by default.
        progress: Called now and then with the share that is read, under the name of the source.

    Raises:
        InvalidInput: Something that cannot be read or carried out, with its line; `index` is the
            line's, from 0.
    """
    _refuse_binary(data, source)
    machine = Machine(reading)
    notes = _run(_lines(data), machine, source, _reporting(data, source, progress))
    program = machine.draft.program(source, tuple(machine.unknown.notes() + notes))
    if progress is not None:
        progress(Step((source,), 1.0))
    return program


def _refuse_binary(data: bytes, source: str) -> None:
    at = data.find(b"\0")
    if at >= 0:
        line = 1 + sum(1 for _ in LINE_END.finditer(data, 0, at))
        raise InvalidInput(
            f"{source}, line {line}: a byte of value 0, so that this is no G-code as text: save it "
            "as plain text (ASCII, Latin-1 or UTF-8).",
            index=line - 1,
        )


def _lines(data: bytes) -> Iterator[str]:
    """Lines that end with any of the three ends of line, one at a time."""
    text = io.TextIOWrapper(io.BytesIO(data), encoding="latin-1", newline=None)
    if data.startswith(b"\xef\xbb\xbf"):
        text.read(3)
    return iter(text)


def _reporting(data: bytes, source: str, progress: Progress | None) -> Callable[[int], None] | None:
    if progress is None:
        return None
    total = max(data.count(b"\n"), data.count(b"\r")) + 1
    return lambda line: progress(Step((source,), min(line / total, 1.0)))


def _run(
    lines: Iterator[str], machine: Machine, source: str, report: Callable[[int], None] | None
) -> list[str]:
    """Carries out all lines up to the end of the program; gives notes on lines left out."""
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
            f"{source}, line {number}: the file ends without the second % that its first line asks "
            "for, and without M2 or M30: it may have been cut off.",
            index=number - 1,
        )
    return frame.notes(number, lines)


class _Frame:
    """Where a program begins and ends, and lines that are left out because a slash says so."""

    def __init__(self) -> None:
        self.framed = False
        self.seen = False
        self.ended = False
        self.deleted = 0
        self.first_deleted = 0

    def run_line(self, line: str, machine: Machine) -> bool:
        """Carries out a line; whether the program ends with it.

        Raises:
            Fault: What cannot be carried out.
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
        """Sentences on lines that were left out."""
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
