"""Reading G-code: lines, the frame of percent signs, and the end of the program."""

from __future__ import annotations

import io
import re
from collections.abc import Iterable
from functools import partial
from pathlib import Path as FilePath

from armcontour._files import read_bytes
from armcontour._progress import Progress, Step, under
from armcontour.errors import InvalidInput
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.flow import Flow
from armcontour.io.drawings.gcode.machine import Machine
from armcontour.io.drawings.gcode.parameters import Parameters
from armcontour.io.drawings.gcode.sources import PROGRAM, Source
from armcontour.io.drawings.gcode.state import state_of
from armcontour.io.drawings.gcode.words import COMMENTS, Block, parse
from armcontour.io.drawings.mending import mend, printed_in_gcode
from armcontour.io.drawings.reading import LARGEST, Reading
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
# Lines that loops and calls may add to those of the files.
MOST_LINES = 500_000
# Their characters: a microsecond each.
MOST_CHARACTERS = 20_000_000
# Lines of loops and calls one after the other that move nothing.
MOST_IDLE_LINES = 100_000
LINE_END = re.compile(rb"\r\n|\r|\n")
WHITE = " \t\r\n"
PROGRAM_NUMBER = re.compile(r":[0-9]+ *(?:\([^()]*\))?")
# Messages, versions and labels of objects of printers: the rest of the line is text.
MESSAGE = re.compile(r"[ \t]*(?:[nN][0-9]+[ \t]*)?[mM](11[578]|486)(?![0-9])")
# Macros of Klipper and similar firmware: START_PRINT BED_TEMP=60.
MACRO = re.compile(r"[ \t]*([A-Za-z]{2,}[0-9]*_\w+|[A-Za-z]{2,}(?=[ \t]+[A-Za-z]{2,}\w*=))")
# Macros that place the moves after them elsewhere.
SHIFTING = ("SET_GCODE_OFFSET", "SET_KINEMATIC_POSITION", "RESTORE_GCODE_STATE")
# Comments of slicers: a layer, with its number or without, and the type of what follows.
SLICER = re.compile(
    r"[ \t]*;[ \t]*(?:(?:LAYER_CHANGE|CHANGE_LAYER|LAYER[: ][ \t]*(-?[0-9]{1,9}))(?![\w.])"
    r"|(?:TYPE|FEATURE):[ \t]*(\S[^\r\n]*))",
    re.IGNORECASE,
)
# Codes and words that only programs of printers have: extrusion, and its temperatures.
EXTRUSION = re.compile(r"[gG]0?[123](?![0-9.])[^mM;(]*(?<![a-zA-Z])[eE]-?[0-9.]")
PRINTER = re.compile(rf"[mM](?:8[23]|1[04][49]|140|190)(?![0-9.])|{EXTRUSION.pattern}")
TOOL_CHANGE = re.compile(r"[mM][ \t]*0*6(?![0-9.])")
# Files of subprograms have such names (LinuxCNC manual, "Calling Files").
FILE_NAME = re.compile(r"[a-z0-9_-]{1,80}")


def read_gcode(
    data: bytes,
    *,
    source: str,
    reading: Reading,
    folder: FilePath | None = None,
    progress: Progress | None = None,
) -> Program:
    """The program that G-code says, RS274/NGC as the LinuxCNC manual has it.

    Feed moves without a rapid or a dwell between them are one contour, named after their first
    line; every segment has the speed F and the tolerance G64 P, or 0 under G61. Rapids keep their
    points. Spindle, coolant, tool, outputs and extruder are events. See docs/guides/gcode.md for
    every word.

    Args:
        data: What the file holds.
        source: What it is called.
        reading: How to read it; its unit holds until G20 or G21, millimetres by default.
        folder: Where files with subprograms are looked for; None looks for none.
        progress: Called from time to time with the name of the source and the share of it that is
            read.

    Raises:
        InvalidInput: Something that cannot be read or carried out, with its line; `index` is the
            line's, from 0.
    """
    lines = _lines(data, source)
    main = Source(source, lines, 0)
    machine = Machine(
        reading,
        lambda: _has(TOOL_CHANGE, (x for x in lines if "6" in x)),
        lambda: _has(PRINTER, lines),
        lambda: _has(EXTRUSION, (x for x in lines if "E" in x or "e" in x)),
    )
    parameters = Parameters(state_of(machine))
    suffixes = (FilePath(source).suffix, ".ngc", ".nc")
    flow = Flow(main, machine, parameters, partial(_beside, folder, suffixes))
    tell = None if progress is None else under(progress, source)
    runner = _Runner(flow, parameters, tell)
    runner.run()
    if not machine.draft.begun:
        _refuse_nothing(main)
    notes = [*machine.notes(flow.where), *runner.notes()]
    program = machine.draft.program(source, tuple(notes), flow.place)
    printed = printed_in_gcode(data, machine.modes.unit)
    program = mend(program, lambda _: printed, reading)
    if tell is not None:
        tell(Step((), 1.0))
    return program


def _refuse_nothing(main: Source) -> None:
    """A file that defines subprograms and moves nothing itself."""
    names = [x.label for x in main.statements.values() if x.keyword == "SUB"]
    if names:
        shown = ", ".join(f"o<{x}>" for x in names[:3]) + (", ..." if len(names) > 3 else "")
        raise InvalidInput(
            f"{main.name} has no contour to follow: it only defines subprograms ({shown}), and "
            "none of its own lines moves the tool. Give the program that calls them."
        )


def _lines(data: bytes, source: str) -> list[str]:
    """Lines that end with any of the three ends of line.

    Raises:
        InvalidInput: A byte that no text has.
    """
    at = data.find(b"\0")
    if at >= 0:
        line = 1 + sum(1 for _ in LINE_END.finditer(data, 0, at))
        raise InvalidInput(
            f"{source}, line {line}: a byte of value 0, so that this is no G-code as text: save it "
            "as plain text (ASCII, Latin-1 or UTF-8).",
            index=line - 1,
        )
    text = io.TextIOWrapper(io.BytesIO(data), encoding="latin-1", newline=None)
    if data.startswith(b"\xef\xbb\xbf"):
        text.read(3)
    return text.readlines()


def _has(pattern: re.Pattern[str], lines: Iterable[str]) -> bool:
    """Whether a pattern occurs in a line, outside of comments."""
    return any(
        pattern.search(COMMENTS.sub("", x)) is not None for x in lines if len(x) <= LONGEST_LINE
    )


def _beside(
    folder: FilePath | None, suffixes: tuple[str, ...], name: str
) -> tuple[str, list[str]] | None:
    """Name and lines of the file of a subprogram: in the program's folder, by a plain name."""
    if folder is None or FILE_NAME.fullmatch(name) is None:
        return None
    for suffix in dict.fromkeys(suffixes):
        file = folder / f"{name}{suffix}"
        if file.is_file():
            return file.name, _lines(read_bytes(file, "subprogram", most=LARGEST), file.name)
    return None


class _Runner:
    """Carries out lines in their order.

    Args:
        flow: Which line comes next.
        parameters: Values of parameters.
        progress: Called now and then with the share of the program that is read.
    """

    def __init__(self, flow: Flow, parameters: Parameters, progress: Progress | None) -> None:
        self.flow, self.machine, self.parameters = flow, flow.machine, parameters
        self.frame = _Frame()
        self.progress, self.shown = progress, 0.0
        self.executed = self.idle = self.characters = 0
        self.last = self.machine.draft.last

    def run(self) -> None:
        """Carries out all lines up to the end of the program.

        Raises:
            InvalidInput: What cannot be carried out, with its line.
        """
        flow = self.flow
        try:
            while self._run_on():
                pass
            self.machine.finish()
        except Fault as fault:
            name, number = flow.place(max(self.machine.tool.line, 1))
            told = fault.told(inch=self.machine.modes.inch)
            raise InvalidInput(f"{name}, line {number}: {told}.", index=number - 1) from None
        frame = self.frame
        if frame.framed and not frame.ended:
            number = len(flow.main.lines)
            raise InvalidInput(
                f"{flow.main.name}, line {number}: the file ends without a second % that its "
                "first line asks for, and without M2 or M30: it may have been cut off.",
                index=number - 1,
            )

    def _run_on(self) -> bool:
        """Carries out lines one after the other, up to a jump; whether there are more."""
        flow, machine, tool = self.flow, self.machine, self.machine.tool
        self.last = machine.draft.last
        source, first = flow.source, flow.index
        lines, base = source.lines, source.base + 1
        plain = machine.ready()
        for i in range(first, len(lines)):
            line = lines[i]
            tool.line = base + i
            if not i % LINES_BETWEEN_REPORTS:
                self._report(i)
            found = PLAIN.fullmatch(line) if plain else None
            if found is not None:
                machine.feed_to(*found.groups())
                continue
            flow.index = i + 1
            if self._run_line(line):
                return False
            if flow.index != i + 1 or flow.source is not source:
                self._count(i + 1 - first)
                return True
            plain = machine.ready()
        if flow.calls:
            raise Fault("the end of the file within a subprogram: end it with endsub, or M99")
        return False

    def _run_line(self, line: str) -> bool:
        """Carries out a line; whether the program ends with it.

        Raises:
            Fault: What cannot be carried out.
        """
        self.characters += len(line)
        if not self.frame.passes(line, self.flow):
            return self.frame.ended
        if self.flow.run(line):
            self.frame.seen = True
            return False
        if self._is_text(line):
            return False
        if ";" in line and (found := SLICER.match(line)) is not None:
            self.machine.draft.set_layer(found[1], found[2])
        block = parse(line, self.parameters)
        for key, value in block.assignments:
            self.parameters.set(key, value)
        self.frame.seen = self.frame.seen or bool(block.g or block.m or block.words)
        called = 98 in block.m or 99 in block.m
        self.frame.ended = self._call(block) if called else self.machine.execute(block)
        return self.frame.ended

    def _is_text(self, line: str) -> bool:
        """Whether a line is a message or a macro of a printer, which is skipped with a note.

        Raises:
            Fault: A macro that places the moves after it elsewhere.
        """
        found = MESSAGE.match(line)
        name = found and f"M{found[1]}"
        if found is None and (found := MACRO.match(line)) is not None:
            name = found[1].upper()
            if name in SHIFTING:
                raise Fault(
                    f"the macro {name}, which places the moves after it elsewhere: write the moves "
                    "without it"
                )
        if name is not None:
            self.machine.unknown.count(name, self.machine.line)
        return name is not None

    def _call(self, block: Block) -> bool:
        """Carries out the words of a line with M98 or M99, then the call or the return."""
        call = 98 in block.m
        own = {x: block.words.pop(x) for x in "PL" if x in block.words}
        block.m = [x for x in block.m if x not in (98, 99)]
        if self.machine.execute(block):
            return True
        block.words = own
        if call:
            self.flow.call_number(block)
            return False
        if "P" in own:
            raise Fault("M99 with P, a jump to a line number, which this reader does not follow")
        return self.flow.return_from_number()

    def _count(self, lines: int) -> None:
        """Counts lines that were carried out up to a jump.

        Raises:
            Fault: More than a program may have.
        """
        self.executed += lines + self.flow.passed
        self.flow.passed = 0
        self.idle = self.idle + lines if self.last is self.machine.draft.last else 0
        most = MOST_LINES + sum(len(x.lines) for x in self.flow.sources)
        if self.idle > most - MOST_LINES + MOST_IDLE_LINES:
            raise Fault(
                f"a loop without end: more than {MOST_IDLE_LINES} lines were carried out that move "
                "nothing"
            )
        if self.characters > MOST_CHARACTERS + sum(x.size for x in self.flow.sources):
            raise Fault(
                f"more than {MOST_CHARACTERS} characters carried out by loops and calls: a loop "
                "without end, or shorter lines are needed"
            )
        if self.executed > most:
            raise Fault(
                f"more than {most} lines carried out, with those that loops and calls repeat: a "
                "loop without end, or a program to be split"
            )

    def _report(self, index: int) -> None:
        """Tells the share of the program that is read, which never falls."""
        if self.progress is not None and index and self.flow.source is self.flow.main:
            self.shown = max(self.shown, index / len(self.flow.main.lines))
            self.progress(Step((), self.shown))

    def notes(self) -> list[str]:
        """Sentences on lines that were left out, and on values that nothing has set."""
        found = self.frame.notes(self.flow)
        if self.parameters.unset is not None:
            found.append(
                f"#{self.parameters.unset} is used before anything sets it, and is 0, as in "
                "LinuxCNC."
            )
        if self.flow.endless:
            found.append(
                f"M99 in {self.flow.where(self.flow.endless)} starts the program again without "
                "end: it is read once."
            )
        return found


class _Frame:
    """Where a program begins and ends, and lines that are left out because a slash says so."""

    def __init__(self) -> None:
        self.framed = False
        self.seen = False
        self.ended = False
        self.last = 0
        self.deleted: set[int] = set()

    def passes(self, line: str, flow: Flow) -> bool:
        """Whether a line is to be carried out.

        Raises:
            Fault: A line that is too long.
        """
        machine = flow.machine
        self.last = machine.line
        if len(line) > LONGEST_LINE:
            raise Fault(
                f"more than {LONGEST_LINE} characters in one line, which G-code does not have: "
                "check what the file is"
            )
        text = line.strip(WHITE)
        if text.startswith("%"):
            if flow.source is flow.main and not flow.calls:
                self._meet_percent(text, flow)
            return False
        if text.startswith("/"):
            self.deleted.add(machine.line)
            return False
        # A colon and a number is a program's name on some controllers.
        return bool(text) and PROGRAM_NUMBER.fullmatch(text) is None

    def _meet_percent(self, text: str, flow: Flow) -> None:
        """The start or the end of the program; a name may follow the first."""
        if text != "%" and (self.framed or self.seen):
            flow.machine.unknown.count("what follows % on its line", flow.machine.line)
        self.ended = self.framed or self.seen
        self.framed = True

    def notes(self, flow: Flow) -> list[str]:
        """Sentences on lines that were left out."""
        found = []
        if self.deleted:
            many = len(self.deleted) > 1
            found.append(
                f"{len(self.deleted)} line{'s' if many else ''} with a slash (block delete) "
                f"{'were' if many else 'was'} left out, first "
                f"{flow.where(min(self.deleted))}."
            )
        name, number = flow.place(self.last) if self.last else ("", 0)
        if self.ended and name == flow.main.name and not _only_subprograms(flow.main, number):
            found.append(f"Lines after the end of the program, line {number}, were not read.")
        return found


def _only_subprograms(main: Source, number: int) -> bool:
    """Whether nothing but subprograms and empty lines follows a line."""
    for i in range(number, len(main.lines)):
        if main.lines[i].strip(WHITE + "%"):
            x = main.statements.get(i)
            return x is not None and x.keyword in ("SUB", PROGRAM)
    return True
