"""The function `read_gcode`, which splits a file into lines and executes them."""

from __future__ import annotations

import io
import re
from functools import partial

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Progress
from armcontour.files.drawings.gcode.machine import Machine
from armcontour.files.drawings.gcode.words import (
    MAX_LINE_LENGTH,
    Fault,
    changes_tools,
    named_arc_turns,
    parse,
)
from armcontour.files.drawings.read_options import (
    ReadOptions,
    ReportFraction,
    fraction_reporter,
    repair_vertices,
)
from armcontour.program import Program

# Matches a line that has only coordinates and a feed, like nearly all lines of long programs. Other
# lines are parsed word by word.
_NUMBER = r"([+-]?(?:[0-9]{1,6}(?:\.[0-9]{0,12})?|\.[0-9]{1,12})) ?"
PLAIN = re.compile(
    r"(?:N([0-9]{1,9}) ?)?(?:G0?1 ?)?"
    rf"(?:X{_NUMBER})?(?:Y{_NUMBER})?(?:Z{_NUMBER})?(?:F{_NUMBER})?\n?"
)
LINES_BETWEEN_REPORTS = 4096
LINE_END = re.compile(rb"\r\n|\r|\n")
WHITE = " \t\r\n"


def read_gcode(
    data: bytes, *, source: str, options: ReadOptions, progress: Progress | None = None
) -> Program:
    """Read a program in G-code: the subset of RS274/NGC that CAM posts write.

    Feed moves without a rapid or a dwell between them are one contour, named after its first
    line. Every segment has the speed F and the tolerance G64 P, or 0 under G61. Changes of
    spindle, coolant, tool and outputs are events. docs/guides/gcode.md lists all words.
    """
    lines = _lines(data, source)
    machine = Machine(
        options,
        changes_tools=changes_tools(lines),
        named_arc_turns=partial(named_arc_turns, lines),
    )
    report_fraction = fraction_reporter(progress, source)
    _Runner(lines, source, machine).run(report_fraction)
    program = machine.draft.program(source, tuple(machine.notes.sentences()))
    program = repair_vertices(program, options)
    report_fraction(1.0)
    return program


def _lines(data: bytes, source: str) -> list[str]:
    """Return the lines of a file; a line may end with CR, LF or both."""
    position = data.find(b"\0")
    if position >= 0:
        line = 1 + sum(1 for _ in LINE_END.finditer(data, 0, position))
        raise InvalidInput(
            f"{source}, line {line}: the file is not plain text, because it contains a byte of "
            "value 0. Save it as plain text (ASCII, Latin-1 or UTF-8).",
            index=line - 1,
        )
    text = io.TextIOWrapper(io.BytesIO(data), encoding="latin-1", newline=None)
    if data.startswith(b"\xef\xbb\xbf"):
        text.read(3)
    return text.readlines()


class _Runner:
    """Executes the lines of a program in sequence on a machine."""

    def __init__(self, lines: list[str], source: str, machine: Machine) -> None:
        self.lines = lines
        self.source = source
        self.machine = machine
        # Whether a percent sign opened the program, a word was read, and the program has ended.
        self.framed = self.has_words = self.ended = False

    def run(self, report_fraction: ReportFraction) -> None:
        """Execute all lines up to the end of the program."""
        machine = self.machine
        notes = self.machine.notes
        lines = self.lines
        plain = machine.accepts_plain_line()
        try:
            for i, line in enumerate(lines):
                notes.line = i + 1
                notes.block_number = None
                if not i % LINES_BETWEEN_REPORTS:
                    report_fraction(i / len(lines))
                match = PLAIN.fullmatch(line) if plain else None
                if match is not None:
                    block_number, x, y, z, f = match.groups()
                    if block_number is not None:
                        notes.block_number = int(block_number)
                    machine.execute_plain_line(x, y, z, f)
                    continue
                self._run_line(line)
                if self.ended:
                    if any(x.strip(WHITE + "%") for x in lines[i + 1 :]):
                        notes.add_once("Lines after the end of the program, line {}, are ignored.")
                    break
                plain = machine.accepts_plain_line()
            machine.finish()
        except Fault as fault:
            number = notes.line
            raise InvalidInput(
                f"{self.source}, line {number}: {fault}.", index=number - 1
            ) from None
        if self.framed and not self.ended:
            raise InvalidInput(
                f"{self.source}, line {len(lines)}: a program that starts with % must end with a "
                "second %, M2 or M30. The file ends without a second % and may have been cut off.",
                index=len(lines) - 1,
            )

    def _run_line(self, line: str) -> None:
        """Execute a line, and determine whether the program ends."""
        machine = self.machine
        if len(line) > MAX_LINE_LENGTH:
            raise Fault(
                f"the line has more than the permitted {MAX_LINE_LENGTH} characters. Check that "
                "the file is G-code"
            )
        text = line.strip(WHITE)
        if text.startswith("%"):
            # A percent sign starts or ends the program; a name may follow the first one.
            if text != "%" and (self.framed or self.has_words):
                machine.notes.skip("text after % on its line")
            self.ended = self.framed or self.has_words
            self.framed = True
        elif text.startswith("/"):
            machine.notes.skip("lines with a slash (block delete)", "Skipped: {}.")
        elif text:
            block = parse(line, machine.notes, machine.declared)
            self.has_words |= bool(block.g or block.m or block.words or block.declared)
            self.ended = machine.execute(block)
