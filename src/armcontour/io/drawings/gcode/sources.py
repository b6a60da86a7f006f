"""Lines of a program and of files with its subprograms, and the O words in them."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import cached_property

from armcontour.io.drawings.gcode.faults import Fault
from armcontour.io.drawings.gcode.words import COMMENTS, COMPACT

# A line that starts with an O word, and its parts in compact text.
STARTS_WITH_O = re.compile(r"[ \t]*(?:[nN][ \t]*[0-9 \t]*)?[oO]")
O_WORD = re.compile(r"(?:N[0-9]+)?O(?:([0-9]+)(?:\.0*)?|<([^>]*)>|(?=[#\[]))(.*)", re.DOTALL)
KEYWORD = re.compile(
    r"(SUB|ENDSUB|RETURN|CALL|IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|DO|REPEAT|ENDREPEAT|BREAK"
    r"|CONTINUE)(.*)",
    re.DOTALL,
)
PROGRAM = "program"
CALL_OF_NUMBER = re.compile(r"[mM]0*98[ \t]*(?:[lL][ \t]*[0-9]+[ \t]*)?[pP][ \t]*([0-9]+)")
RETURN_OF_NUMBER = re.compile(r"^[ \t]*(?:[nN][ \t]*[0-9]+[ \t]*)?[^(;]*[mM]0*99(?![0-9])")
OPENS = {"IF": "if", "WHILE": "while", "DO": "do", "REPEAT": "repeat", "SUB": "sub"}
# Which blocks an O word continues or ends.
BELONGS_TO = {
    "ELSEIF": ("if",),
    "ELSE": ("if",),
    "ENDIF": ("if",),
    "ENDWHILE": ("while",),
    "ENDREPEAT": ("repeat",),
    "BREAK": ("while", "do", "repeat"),
    "CONTINUE": ("while", "do", "repeat"),
    "ENDSUB": ("sub",),
}


@dataclass(slots=True)
class Group:
    """O words of one label that belong together, such as if, else and endif.

    Attributes:
        kind: What the first one says.
        members: They, without break and continue, which end nothing.
        closed: Whether the last one is there.
    """

    kind: str
    members: list[Statement] = field(default_factory=list)
    closed: bool = False


@dataclass(slots=True)
class Statement:
    """A line with an O word.

    Attributes:
        index: The line, from 0.
        keyword: What it says; `PROGRAM` for a number alone.
        label: Its number or name; None where it is computed.
        rest: What follows the keyword, compact.
        computed: The text of a computed label and what follows it, from the # or [ on.
        group: What it belongs to.
        position: Its place in the group.
    """

    index: int
    keyword: str
    label: str | None
    rest: str
    computed: str = ""
    group: Group | None = None
    position: int = 0


class Source:
    """Lines of a file.

    Args:
        name: Name of the file.
        lines: Its lines.
        base: How many lines come before in all files together.
    """

    def __init__(self, name: str, lines: list[str], base: int) -> None:
        self.name, self.lines, self.base = name, lines, base
        self._ends: dict[int, int] = {}

    @cached_property
    def statements(self) -> dict[int, Statement]:
        """The O words, by their lines."""
        return _link(self.lines)

    @cached_property
    def size(self) -> int:
        """Characters of all lines."""
        return sum(map(len, self.lines))

    @cached_property
    def _starts(self) -> dict[tuple[str, str | None], Statement]:
        """Where subprograms start: the first O word of every keyword and label."""
        found: dict[tuple[str, str | None], Statement] = {}
        for x in self.statements.values():
            found.setdefault((x.keyword, x.label), x)
        return found

    @cached_property
    def _called(self) -> frozenset[str]:
        """Numbers that an M98 of this file calls, also without the repetitions before them."""
        calls = (
            CALL_OF_NUMBER.search(COMMENTS.sub("", line)) for line in self.lines if "98" in line
        )
        numbers = [x[1].lstrip("0") for x in calls if x is not None]
        return frozenset(numbers) | frozenset(x[-4:].lstrip("0") for x in numbers)

    def sub(self, label: str) -> Statement | None:
        """Where a subprogram of O words starts."""
        return self._starts.get(("SUB", label))

    def program(self, label: str) -> Statement | None:
        """Where a numbered subprogram starts, which M98 calls."""
        return self._starts.get((PROGRAM, label))

    def calls(self, label: str) -> bool:
        """Whether an M98 of this file calls a number."""
        return label in self._called

    def end_of_program(self, index: int) -> int:
        """The line of the M99 that ends a numbered subprogram.

        Raises:
            Fault: There is none.
        """
        if index not in self._ends:
            self._ends[index] = self._find_end(index)
        return self._ends[index]

    def _find_end(self, index: int) -> int:
        for i in range(index + 1, len(self.lines)):
            if "99" in self.lines[i] and RETURN_OF_NUMBER.match(self.lines[i]):
                return i
        raise Fault("a numbered subprogram without M99 at its end")


def statement_of(line: str, index: int) -> Statement | None:
    """The O word of a line, None if it has none.

    Raises:
        Fault: An O word that says nothing that is known.
    """
    if STARTS_WITH_O.match(line) is None:
        return None
    text = COMMENTS.sub("", line).translate(COMPACT)
    found = O_WORD.fullmatch(text)
    if found is None:
        raise Fault("an O word without a number or a name: write o100 or o<name>")
    number, name, rest = found.groups()
    if number is None and name is None:
        return Statement(index, "CALL", None, "", computed=rest)
    label = (number.lstrip("0") or "0") if number is not None else name.lower()
    if not rest and number is not None:
        return Statement(index, PROGRAM, label, "")
    word = KEYWORD.fullmatch(rest)
    if word is None:
        raise Fault(
            "an O word with something else than sub, call, if, while, do, repeat and their ends "
            "after its number or name"
        )
    return Statement(index, word[1], label, word[2])


def _link(lines: list[str]) -> dict[int, Statement]:
    """All O words of a file, with those that belong together in one group.

    What does not belong to anything stays without a group, and is refused when it is carried out.
    """
    found: dict[int, Statement] = {}
    blocks: dict[str, Group] = {}
    for i, line in enumerate(lines):
        try:
            x = statement_of(line, i)
        except Fault:
            continue
        if x is None:
            continue
        found[i] = x
        if x.label is None:
            continue
        if x.keyword in ("SUB", "ENDSUB"):
            # Labels of loops and conditions are a subprogram's own.
            blocks = {k: v for k, v in blocks.items() if v.kind == "sub"}
        _join(x, x.label, blocks)
    return found


def _join(x: Statement, label: str, blocks: dict[str, Group]) -> None:
    """Puts an O word into the group that it opens, continues or ends."""
    block = blocks.get(label)
    ends_do = x.keyword == "WHILE" and block is not None and block.kind == "do"
    if ends_do or (block is not None and block.kind in BELONGS_TO.get(x.keyword, ())):
        assert block is not None
        if x.keyword not in ("BREAK", "CONTINUE"):
            x.position = len(block.members)
            block.members.append(x)
        x.group = block
        if ends_do or x.keyword.startswith("END"):
            block.closed = True
            del blocks[label]
    elif x.keyword in OPENS:
        x.group = blocks[label] = Group(OPENS[x.keyword], [x])
