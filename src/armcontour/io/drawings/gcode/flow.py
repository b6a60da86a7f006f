"""In which order the lines of a program are carried out: O words, calls, loops and conditions.

Source: LinuxCNC manual, "O Codes".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import islice

from armcontour.io.drawings.gcode.expressions import read_value
from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.machine import Machine
from armcontour.io.drawings.gcode.modes import Modes
from armcontour.io.drawings.gcode.parameters import ARGUMENTS, Parameters
from armcontour.io.drawings.gcode.sources import (
    PROGRAM,
    STARTS_WITH_O,
    Source,
    Statement,
    statement_of,
)
from armcontour.io.drawings.gcode.words import Block, whole

# Calls within calls.
DEEPEST = 100
# Repetitions of a block.
MOST_REPEATS = 1e9
# Gives the lines of a file with a subprogram, by its name; None where there is none.
Beside = Callable[[str], "tuple[str, list[str]] | None"]


@dataclass(slots=True)
class Call:
    """A call that is not finished: where to go on, and how often to repeat it."""

    source: Source
    index: int
    target: int
    own_scope: bool
    again: int = 0
    counts: dict[int, int] = field(default_factory=dict)
    saved: tuple[Modes, int, tuple[int, float]] | None = None
    restores: bool = False


class Flow:
    """Which line comes next.

    Args:
        main: The program.
        machine: What the lines are carried out by.
        parameters: Values of parameters.
        beside: Gives files with subprograms.
    """

    def __init__(
        self, main: Source, machine: Machine, parameters: Parameters, beside: Beside
    ) -> None:
        self.main = self.source = main
        self.index = 0
        self.machine, self.parameters, self.beside = machine, parameters, beside
        self.calls: list[Call] = []
        self.counts: dict[int, int] = {}
        self.files: dict[str, Source] = {}
        self.sources = [main]
        self.endless = 0
        # Branches that were passed over, each as much work as a line.
        self.passed = 0

    def place(self, line: int) -> tuple[str, int]:
        """The file of a line that is counted through all files, and its number there."""
        source = next(x for x in reversed(self.sources) if line > x.base)
        return source.name, line - source.base

    def where(self, line: int) -> str:
        """How sentences call a line."""
        name, number = self.place(line)
        return f"line {number}" if name == self.main.name else f"line {number} of {name}"

    def run(self, line: str) -> bool:
        """Carries out the O word of the line before `index`, if it has one; whether it has.

        The next line is then that of `source` at `index`.

        Raises:
            Fault: What cannot be carried out.
        """
        if STARTS_WITH_O.match(line) is None:
            return False
        found = self.source.statements.get(self.index - 1)
        if found is None:
            found = statement_of(line, self.index - 1)
        if found is None:
            return False
        RUNS[found.keyword](self, found)
        return True

    def call_number(self, block: Block) -> None:
        """M98 P L: calls a numbered subprogram."""
        if "P" not in block.words:
            raise Fault("M98 without P, the number of the subprogram")
        number = whole(block.words.pop("P"), "M98 P")
        repeats = whole(block.words.pop("L", 1.0), "M98 L")
        found = self._numbered(str(number))
        if found is None and number > 9999:
            # Fanuc: the digits before the last four are the repetitions.
            repeats, number = repeats * (number // 10_000), number % 10_000
            found = self._numbered(str(number))
        if found is None:
            found = self._file(str(number)), self._file(str(number)).program(str(number))
        source, start = found
        if start is None:
            raise Fault(f"M98 P{number}, but the file {source.name} has no O{number}")
        if repeats > 0:
            self._enter(source, start.index + 1, own_scope=False, again=repeats - 1)

    def _numbered(self, label: str) -> tuple[Source, Statement | None] | None:
        """A numbered subprogram of the file that is carried out, or of the program."""
        for source in (self.source, self.main):
            start = source.program(label)
            if start is not None:
                return source, start
        return None

    def return_from_number(self) -> bool:
        """M99: back to the call; in the program itself its end. Whether it is that."""
        if not self.calls:
            self.endless = self.machine.line
            return True
        call = self.calls[-1]
        if call.own_scope:
            raise Fault("M99 in a subprogram of O words, which ends with o<name> endsub")
        if call.again > 0:
            call.again -= 1
            self.counts = {}
            self.index = call.target
        else:
            self._leave()
        return False

    def _enter(self, source: Source, index: int, *, own_scope: bool, again: int = 0) -> None:
        if len(self.calls) >= DEEPEST:
            raise Fault(
                f"more than {DEEPEST} calls within each other: a subprogram that calls itself has "
                "to return before"
            )
        machine = self.machine
        call = Call(self.source, self.index, index, own_scope, again, self.counts)
        call.saved, call.restores = machine.saved, machine.restores_at_return
        machine.saved, machine.restores_at_return = None, False
        self.calls.append(call)
        self.source, self.index, self.counts = source, index, {}

    def _leave(self) -> None:
        call = self.calls.pop()
        machine = self.machine
        if machine.restores_at_return:
            machine.restore()
        machine.saved, machine.restores_at_return = call.saved, call.restores
        if call.own_scope:
            self.parameters.leave()
        self.source, self.index, self.counts = call.source, call.index, call.counts

    def _file(self, name: str) -> Source:
        """The file of a subprogram, in the folder of the program."""
        if name not in self.files:
            found = self.beside(name)
            if found is None:
                raise Fault(
                    f"a call of {name}, which is neither in this file nor in one of this name "
                    "beside it: put the subprogram into the file"
                )
            last = self.sources[-1]
            source = Source(found[0], found[1], last.base + len(last.lines))
            self.sources.append(source)
            self.files[name] = source
        return self.files[name]

    def _value(self, text: str, what: str) -> float:
        """The value of an expression that is all there is."""
        value, end = read_value(text, 0, self.parameters)
        if end != len(text):
            raise Fault(f"{what} with something after its value: write it in brackets [ ]")
        return value

    def _holds(self, x: Statement) -> bool:
        return self._value(x.rest, f"o{x.label} {x.keyword.lower()}") != 0

    def _sub(self, x: Statement) -> None:
        self.index = self._end(x).index + 1

    def _end_sub(self, x: Statement) -> None:
        if not self.calls or not self.calls[-1].own_scope:
            raise Fault(f"o{x.label} {x.keyword.lower()} outside of a subprogram that was called")
        value = self._value(x.rest, "a return") if x.rest else None
        self._leave()
        self.parameters.assign("_value", 0.0 if value is None else value)
        self.parameters.assign("_value_returned", float(value is not None))

    def _call(self, x: Statement) -> None:
        label, text = x.label, x.rest
        if label is None:
            label, text = self._computed_label(x.computed)
        arguments, at = [], 0
        while at < len(text):
            if text[at] != "[":
                raise Fault(f"o{label} call with an argument that is not in brackets [ ]")
            value, at = read_value(text, at, self.parameters)
            arguments.append(value)
        if len(arguments) > ARGUMENTS:
            raise Fault(f"o{label} call with more than {ARGUMENTS} arguments")
        source = next((s for s in (self.source, self.main) if s.sub(label)), None)
        if source is None:
            source = self._file(label)
        found = source.sub(label)
        if found is None:
            raise Fault(f"o{label} call: the file {source.name} has no o<{label}> sub")
        self._enter(source, found.index + 1, own_scope=True)
        self.parameters.enter(arguments)
        self.parameters.assign("_value", 0.0)
        self.parameters.assign("_value_returned", 0.0)

    def _computed_label(self, text: str) -> tuple[str, str]:
        value, at = read_value(text, 0, self.parameters)
        if not text.startswith("CALL", at):
            raise Fault("an O word with a computed number, which only call can have")
        return str(whole(value, "an O word")), text[at + 4 :]

    def _if(self, x: Statement) -> None:
        if self._holds(x):
            return
        group = self._group(x)
        for y in islice(group, x.position + 1, None):
            self.passed += 1
            self.machine.tool.line = self.source.base + y.index + 1
            if y.keyword != "ELSEIF" or self._holds(y):
                self.index = y.index + 1
                return

    def _else(self, x: Statement) -> None:
        """Comes after a branch that was carried out."""
        self.index = self._end(x).index + 1

    def _while(self, x: Statement) -> None:
        group = self._group(x)
        holds = self._holds(x)
        if group[0].keyword == "DO":
            if holds:
                self.index = group[0].index + 1
        elif not holds:
            self.index = group[-1].index + 1

    def _end_while(self, x: Statement) -> None:
        self.index = self._group(x)[0].index

    def _do(self, x: Statement) -> None:
        self._end(x)

    def _repeat(self, x: Statement) -> None:
        count = self._value(x.rest, f"o{x.label} repeat")
        if not abs(count) <= MOST_REPEATS:
            raise Fault(f"o{x.label} repeat {count:g} times: give fewer")
        self.counts[x.index] = max(round(count), 0)
        if not self.counts[x.index]:
            self.index = self._end(x).index + 1

    def _end_repeat(self, x: Statement) -> None:
        first = self._group(x)[0].index
        left = self.counts.get(first, 0) - 1
        self.counts[first] = left
        if left > 0:
            self.index = first + 1

    def _break(self, x: Statement) -> None:
        self.index = self._end(x).index + 1

    def _continue(self, x: Statement) -> None:
        self.index = self._end(x).index

    def _program(self, x: Statement) -> None:
        """A number alone: the program's name, or a subprogram of M98, which is passed over."""
        if self.source.calls(x.label or ""):
            self.index = self.source.end_of_program(x.index) + 1

    def _group(self, x: Statement) -> list[Statement]:
        if x.group is None or not x.group.closed:
            raise Fault(
                f"o{x.label} {x.keyword.lower()}, to which no other o{x.label} belongs that "
                "starts or ends the block"
            )
        return x.group.members

    def _end(self, x: Statement) -> Statement:
        return self._group(x)[-1]


RUNS: dict[str, Callable[[Flow, Statement], None]] = {
    "SUB": Flow._sub,
    "ENDSUB": Flow._end_sub,
    "RETURN": Flow._end_sub,
    "CALL": Flow._call,
    "IF": Flow._if,
    "ELSEIF": Flow._else,
    "ELSE": Flow._else,
    "ENDIF": lambda flow, x: None,
    "WHILE": Flow._while,
    "ENDWHILE": Flow._end_while,
    "DO": Flow._do,
    "REPEAT": Flow._repeat,
    "ENDREPEAT": Flow._end_repeat,
    "BREAK": Flow._break,
    "CONTINUE": Flow._continue,
    PROGRAM: Flow._program,
}
