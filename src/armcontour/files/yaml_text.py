"""Where the values of a YAML text are written, and what replaces them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import yaml

from armcontour.core.yaml_layout import INT
from armcontour.files.yaml_values import TEXT, WIDTH, behind, block_text, flow_text

COMMENT = re.compile(r"#[^\r\n]*")
ALIAS = re.compile(r"\*[^\s,\[\]{}]+")
BREAK = re.compile(r"\r\n|\r|\n")
# Blanks that put a comment into a column.
GAP = re.compile(r" {4,}(?=#)")
BLANK = " \t\r\n"


class Shared(Exception):  # noqa: N818
    """An alias stands for what has to change."""


class Splice(NamedTuple):
    """A part of a text, from `begin` to `end`, and what replaces it."""

    begin: int
    end: int
    text: str


def same(one: Any, other: Any) -> bool:
    """Whether data are the same; what is not a number is the same as itself."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(same(x, other[key]) for key, x in one.items())
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, bool) != isinstance(other, bool):
        return False
    return bool(one == other or (one != one and other != other))


class YamlText:
    """A YAML text and the places of its values.

    Args:
        text: The text.
        node: Its root; None if it has no document.
    """

    def __init__(self, text: str, node: yaml.Node | None) -> None:
        self.text = text
        found = BREAK.search(text)
        self.eol = "\n" if found is None else found[0]
        self.root = Part(of=self, node=node, begin=0, end=len(text), outer=None, key=None)
        if node is not None:
            begin = node.start_mark.index
            end = _end(self, node, begin)
            self.root = Part(of=self, node=node, begin=begin, end=end, outer=None, key=None)

    def line_start(self, at: int) -> int:
        """Where the line of a place begins."""
        return max(self.text.rfind("\n", 0, at), self.text.rfind("\r", 0, at)) + 1

    def line_end(self, at: int) -> int:
        """Where the line of a place ends, before its line break."""
        found = BREAK.search(self.text, at)
        return len(self.text) if found is None else found.start()

    def is_first(self, at: int) -> bool:
        """Whether only blanks are before a place in its line."""
        return not self.text[self.line_start(at) : at].strip(BLANK)

    def cut(self, begin: int, end: int) -> Splice:
        """Remove a part of the text, and its lines where nothing else is left on them."""
        stop = self.line_end(end)
        if self.is_first(begin) and not self.text[end:stop].strip(BLANK):
            return self.cut_lines(begin, end)
        return Splice(begin, end, "")

    def cut_lines(self, begin: int, end: int) -> Splice:
        """Remove whole lines, with the comments behind the last one."""
        start, stop = self.line_start(begin), self.line_end(end)
        after = BREAK.match(self.text, stop)
        if after is not None:
            return Splice(start, after.end(), "")
        # Without a line break at the end of the text, the one before goes.
        return Splice(len(self.text[:start].rstrip("\r\n")), stop, "")


@dataclass(kw_only=True, eq=False)
class Part:
    """A value in a text.

    Args:
        of: The text.
        node: Its node; None for an alias, or in a text without a document.
        begin, end: Where the value is written, without the comments after it.
        outer: The mapping or list that it is in; None for the root.
        key: Its key or its position.
        head: Where the key begins, or the dash of an item; in a list on one line the value.
        name_end: Where key and colon end, or the dash.
        column: The column of the key or the dash.
    """

    of: YamlText
    node: yaml.Node | None
    begin: int
    end: int
    outer: Part | None
    key: Any
    head: int = 0
    name_end: int = 0
    column: int = 0

    @property
    def flow(self) -> bool:
        """Whether the value is a mapping or list between braces or brackets, or in one."""
        own = isinstance(self.node, yaml.CollectionNode) and bool(self.node.flow_style)
        return own or (self.outer is not None and self.outer.flow)

    @property
    def is_block(self) -> bool:
        """Whether the value is a mapping or list in lines of their own."""
        return isinstance(self.node, yaml.CollectionNode) and not self.flow

    @cached_property
    def parts(self) -> list[Part]:
        """The values in a mapping or a list, in their order."""
        if isinstance(self.node, yaml.MappingNode):
            return _values(self, self.node)
        return _items(self, self.node) if isinstance(self.node, yaml.SequenceNode) else []

    def holds(self, key: Any) -> bool:
        """Whether the value is a list for a position, or a mapping for another key.

        Raises:
            Shared: The value is an alias.
        """
        if self.node is None and self.outer is not None:
            raise Shared
        if isinstance(self.node, yaml.SequenceNode):
            return isinstance(key, int)
        return isinstance(self.node, yaml.MappingNode)

    def part(self, key: Any) -> Part | None:
        """The value of a key or a position."""
        if isinstance(self.node, yaml.SequenceNode):
            return self.parts[int(key)]
        return next((x for x in self.parts if type(x.key) is type(key) and x.key == key), None)

    def replace(self, old: Any, new: Any) -> list[Splice]:
        """Replace the value; lists of the same length and mappings of the same keys keep theirs.

        Args:
            old: The value that is there.
            new: The new one.

        Raises:
            Shared: An alias stands for the value.
        """
        if same(old, new):
            return []
        if self.node is None and self.outer is not None:
            raise Shared
        keys = _keys(old)
        alike = type(old) is type(new) and set(keys) == set(_keys(new))
        if keys and alike and [x.key for x in self.parts] == keys:
            return [y for x in self.parts for y in x.replace(old[x.key], new[x.key])]
        return self._write(new)

    def add(self, key: Any, value: Any) -> list[Splice]:
        """Add a key to a mapping, as its last one."""
        name = flow_text(key)
        if self.flow:
            return [self._append_inline(f"{name}: {flow_text(value)}")]
        column = self.parts[0].column
        return [self._append_line(self.parts[-1], column, name + ":", value)]

    def insert(self, at: int, value: Any) -> list[Splice]:
        """Insert an item into a list."""
        if at == len(self.parts) and self.flow:
            return [self._append_inline(flow_text(value))]
        if self.flow:
            head = self.parts[at].begin
            gap = " "
            if self.of.is_first(head):
                gap = self.of.eol + self.of.text[self.of.line_start(head) : head]
            return [Splice(head, head, f"{flow_text(value)},{gap}")]
        if at > 0:
            return [self._append_line(self.parts[at - 1], self.parts[0].column, "-", value)]
        first = self.parts[0]
        line = "-" + self.child(value, first.column) + self.of.eol + " " * first.column
        return [Splice(first.head, first.head, line)]

    def remove(self, key: Any) -> list[Splice]:
        """Remove a key, or an item of a list."""
        gone = self.part(key)
        assert gone is not None
        k = self.parts.index(gone)
        if len(self.parts) == 1:
            return self._empty()
        following = self.parts[k + 1].head if k + 1 < len(self.parts) else None
        if self.flow and following is None and not self.of.is_first(gone.head):
            return [Splice(self.parts[k - 1].end, gone.end, "")]
        if self.flow and following is None:
            comma = _skip(self.of.text, gone.end, ",")
            rest = self.of.text[comma : self.of.line_end(comma)].strip(BLANK)
            if rest.startswith("#"):
                return [self.of.cut_lines(gone.head, comma)]
            return [self.of.cut(gone.head, comma)]
        if following is not None and (self.flow or not self.of.is_first(gone.head)):
            return [Splice(gone.head, following, "")]
        return [self.of.cut_lines(gone.head, gone.end)]

    def _empty(self) -> list[Splice]:
        """Remove all that is in a mapping or a list, with the comments behind it."""
        empty: Any = {} if isinstance(self.node, yaml.MappingNode) else []
        found = self._write(empty)
        if len(found) > 1:
            found[1] = self.of.cut_lines(self.begin, self.end)
        return found

    def _write(self, new: Any) -> list[Splice]:
        """Write another value in the place of this one."""
        if self.outer is None:
            return self._write_root(new)
        style = self.node.style if isinstance(self.node, yaml.ScalarNode) else None
        line = flow_text(new, style if style in ("'", '"') else None)
        long = isinstance(new, dict | list) and self.column + len(line) > WIDTH
        if self.is_block and long:
            column = _column(self.of, self.begin)
            return [Splice(self.begin, self.end, block_text(new, column, self.of.eol))]
        if long and not self.outer.flow:
            return [Splice(self.name_end, self.end, self.outer.child(new, self.column))]
        if self.begin == self.end:
            of_mapping = isinstance(self.outer.node, yaml.MappingNode)
            colon = ":" if of_mapping and self.of.text[self.name_end - 1] != ":" else ""
            return [Splice(self.name_end, self.end, f"{colon} {line}")]
        if not self.is_block:
            return [self._in_column(line)]
        if BREAK.search(self.of.text, self.name_end, self.begin) is None:
            return [Splice(self.begin, self.end, line)]
        return [
            Splice(self.name_end, self.name_end, f" {line}"),
            self.of.cut(self.begin, self.end),
        ]

    def _in_column(self, line: str) -> Splice:
        """Write a value on its line; a comment behind it stays in its column if it can."""
        gap = GAP.match(self.of.text, self.end)
        if gap is None:
            return Splice(self.begin, self.end, line)
        blanks = len(gap[0]) - len(line) + self.end - self.begin
        return Splice(self.begin, gap.end(), line + " " * max(blanks, 2))

    def _write_root(self, new: Any) -> list[Splice]:
        """Write another document; comments before it stay."""
        if self.node is None:
            gap = self.of.eol if self.of.text and not self.of.text.endswith(("\r", "\n")) else ""
            return [Splice(self.end, self.end, gap + block_text(new, 0, self.of.eol) + self.of.eol)]
        text = block_text(new, 0, self.of.eol) if new else flow_text(new)
        return [Splice(self.begin, self.end, text)]

    def _append_inline(self, entry: str) -> Splice:
        """Add an entry at the end of a mapping or list between braces or brackets."""
        if self.parts:
            return Splice(self.parts[-1].end, self.parts[-1].end, f", {entry}")
        return Splice(self.end - 1, self.end - 1, entry)

    def _append_line(self, after: Part, column: int, name: str, value: Any) -> Splice:
        """Add a line, or several, after those of a part."""
        at = self.of.line_end(after.end)
        line = self.of.eol + " " * column + name + self.child(value, column)
        return Splice(at, at, line)

    def child(self, value: Any, column: int) -> str:
        """A value after a key or a dash in a column."""
        return behind(value, column, self.of.eol, in_list=isinstance(self.node, yaml.SequenceNode))


def _values(outer: Part, node: yaml.MappingNode) -> list[Part]:
    """The values of a mapping."""
    text, found = outer.of.text, []
    for name, value in node.value:
        at = name.end_mark.index
        colon = _skip(text, at, ":")
        begin, own = value.start_mark.index, value
        if begin < at:
            begin, end, own = *_alias(text, colon), None
        else:
            end = _end(outer.of, value, begin)
        # A value that is not there begins where its key ends.
        begin, end = max(begin, colon), max(end, colon)
        part = Part(of=outer.of, node=own, begin=begin, end=end, outer=outer, key=_key(name))
        part.head, part.name_end = name.start_mark.index, colon
        part.column = name.start_mark.column
        found.append(part)
    return found


def _keys(value: Any) -> list[Any]:
    """The keys of a mapping, or the positions in a list; none of another value."""
    if isinstance(value, list):
        return list(range(len(value)))
    return list(value) if isinstance(value, dict) else []


def _items(outer: Part, node: yaml.SequenceNode) -> list[Part]:
    """The items of a list."""
    of, found, at = outer.of, [], outer.begin
    for k, value in enumerate(node.value):
        begin, own = value.start_mark.index, value
        if begin < at:
            begin, end, own = *_alias(of.text, at), None
        else:
            end = _end(of, value, begin)
        part = Part(of=of, node=own, begin=begin, end=end, outer=outer, key=k, head=begin)
        part.name_end, part.column = begin, _column(of, begin)
        if not node.flow_style:
            masked = COMMENT.sub(lambda x: " " * len(x[0]), of.text[at:begin])
            part.head = at + masked.rindex("-")
            part.name_end, part.column = part.head + 1, _column(of, part.head)
        found.append(part)
        at = max(end, part.name_end)
    return found


def _key(node: yaml.Node) -> Any:
    """A key as data have it; None if it is neither text nor a whole number."""
    if node.tag == INT:
        return int(node.value)
    return node.value if node.tag == TEXT else None


def _end(of: YamlText, node: yaml.Node, begin: int) -> int:
    """Where the text of a value ends, without blanks and comments after it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        part = Part(of=of, node=node, begin=begin, end=begin, outer=None, key=None)
        return part.parts[-1].end
    end = node.end_mark.index
    return begin + len(of.text[begin:end].rstrip(BLANK))


def _alias(text: str, at: int) -> tuple[int, int]:
    """Where the next alias is written."""
    masked = COMMENT.sub(lambda x: " " * len(x[0]), text[at:])
    found = ALIAS.search(masked)
    assert found is not None
    return at + found.start(), at + found.end()


def _skip(text: str, at: int, mark: str) -> int:
    """The place behind a mark that is next, or the same place if something else is."""
    stop = at
    while stop < len(text) and text[stop] in BLANK:
        stop += 1
    return stop + 1 if text.startswith(mark, stop) else at


def _column(of: YamlText, at: int) -> int:
    """The column of a place."""
    return at - of.line_start(at)
