"""Edits of values in YAML text that do not change comments and layout."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import yaml

from armcontour.core.yaml_loader import INT, Loader

# Maximum length of a line [characters]; a longer mapping or list is written in block style.
WIDTH = 100
# Indentation of blocks [characters].
INDENT = 2
# YAML tag of texts.
TEXT_TAG = "tag:yaml.org,2002:str"


class Dumper(yaml.SafeDumper):
    """Dumper whose text `Loader` reads unchanged; `Loader` has other number formats than PyYAML."""

    def ignore_aliases(self, data: Any) -> bool:
        """True, so that repeated values are written in full, without anchors and aliases."""
        return True


def _represent_text(dumper: Dumper, text: str) -> yaml.ScalarNode:
    """YAML node of a text; a text with line breaks is quoted, so that it stays on one line."""
    lines = any(x in text for x in "\r\n\x85\u2028\u2029")
    return dumper.represent_scalar(TEXT_TAG, text, style='"' if lines else None)


Dumper.add_representer(str, _represent_text)
# The resolvers of both loaders are used, so that a text is quoted if one of the loaders would read
# it as a number.
Dumper.yaml_implicit_resolvers = {
    first: [
        *Loader.yaml_implicit_resolvers.get(first, []),
        *yaml.SafeDumper.yaml_implicit_resolvers.get(first, []),
    ]
    for first in {*Loader.yaml_implicit_resolvers, *yaml.SafeDumper.yaml_implicit_resolvers}
}


def flow_text(value: Any, style: str | None = None) -> str:
    """Text of a value on one line in flow style; `style` is the quote character of a text."""
    quoted = style if isinstance(value, str) else None
    text = yaml.dump(
        [value],
        Dumper=Dumper,
        default_style=quoted,
        default_flow_style=True,
        sort_keys=False,
        width=float("inf"),
        allow_unicode=True,
    )
    return str(text).strip().removeprefix("[").removesuffix("]")


def entry_text(value: Any, column: int, eol: str, *, in_list: bool) -> str:
    """Text of a value after a key or dash in a column: on the same line if it fits, or a block."""
    line = flow_text(value)
    if not (isinstance(value, dict | list) and value and column + len(line) > WIDTH):
        return f" {line}"
    inner = column + INDENT
    start = " " if in_list else eol + " " * inner
    return start + block_text(value, inner, eol)


def block_text(value: dict[Any, Any] | list[Any], column: int, eol: str) -> str:
    """Text of a mapping or list in block style; its first line is not indented."""
    if isinstance(value, dict):
        lines = [
            flow_text(key) + ":" + entry_text(x, column, eol, in_list=False)
            for key, x in value.items()
        ]
    else:
        lines = ["-" + entry_text(x, column, eol, in_list=True) for x in value]
    return (eol + " " * column).join(lines)


COMMENT = re.compile(r"#[^\r\n]*")
ALIAS = re.compile(r"\*[^\s,\[\]{}]+")
LINE_BREAK = re.compile(r"\r\n|\r|\n")
# Matches blanks that align a comment to a column.
ALIGNMENT = re.compile(r" {4,}(?=#)")
BLANKS = " \t\r\n"


class SharedValue(Exception):  # noqa: N818
    """Error if the value to change is an alias, or has an anchor that an alias uses."""


class Splice(NamedTuple):
    """Replacement of the characters from `begin` to before `end` by `text`."""

    begin: int
    end: int
    text: str


def equal_data(one: Any, other: Any) -> bool:
    """True if data are equal, where NaN equals NaN, and booleans do not equal numbers."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one.keys() == other.keys() and all(
            equal_data(x, other[key]) for key, x in one.items()
        )
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(equal_data, one, other))
    if isinstance(one, bool) != isinstance(other, bool):
        return False
    return bool(one == other or (one != one and other != other))


class YamlText:
    """A YAML text and the positions of its values."""

    def __init__(self, text: str, node: yaml.Node | None) -> None:
        self.text = text
        line_break = LINE_BREAK.search(text)
        self.eol = "\n" if line_break is None else line_break[0]
        self.root = YamlPart(document=self, node=node, begin=0, end=len(text), outer=None, key=None)
        if node is not None:
            begin = node.start_mark.index
            end = _value_end(self, node, begin)
            self.root = YamlPart(
                document=self, node=node, begin=begin, end=end, outer=None, key=None
            )

    def line_start(self, position: int) -> int:
        """Position of the first character in the line of a position."""
        return max(self.text.rfind("\n", 0, position), self.text.rfind("\r", 0, position)) + 1

    def line_end(self, position: int) -> int:
        """Position of the end of the line of a position, before the line break."""
        line_break = LINE_BREAK.search(self.text, position)
        return len(self.text) if line_break is None else line_break.start()

    def is_first(self, position: int) -> bool:
        """True if only blanks are before a position in its line."""
        return not self.text[self.line_start(position) : position].strip(BLANKS)

    def cut(self, begin: int, end: int) -> Splice:
        """Splice that removes a part of the text, and its lines if they have no other content."""
        stop = self.line_end(end)
        if self.is_first(begin) and not self.text[end:stop].strip(BLANKS):
            return self.cut_lines(begin, end)
        return Splice(begin, end, "")

    def cut_lines(self, begin: int, end: int) -> Splice:
        """Splice that removes all lines of a part, including comments at their ends."""
        start, stop = self.line_start(begin), self.line_end(end)
        after = LINE_BREAK.match(self.text, stop)
        if after is not None:
            return Splice(start, after.end(), "")
        # The text does not end with a line break, so the line break before the lines is removed.
        return Splice(len(self.text[:start].rstrip("\r\n")), stop, "")


@dataclass(kw_only=True, eq=False)
class YamlPart:
    """A value in a YAML text, with its position."""

    document: YamlText  # Text that contains the value
    node: yaml.Node | None  # Node of the value; None for an alias, or in an empty text
    # begin, end: range of the value in the text [characters], without comments after the value
    begin: int
    end: int
    outer: YamlPart | None  # Mapping or list that contains the value; None for the root
    key: Any  # Key of the value in its mapping, or index in its list
    head: int = 0  # Start of the key, or of the dash of an item; in a flow list start of the value
    name_end: int = 0  # End of the key with its colon, or of the dash
    column: int = 0  # Column of the key or the dash

    @property
    def flow(self) -> bool:
        """True if the value is a mapping or list in flow style, or is inside one."""
        is_flow = isinstance(self.node, yaml.CollectionNode) and bool(self.node.flow_style)
        return is_flow or (self.outer is not None and self.outer.flow)

    @property
    def is_block(self) -> bool:
        """True if the value is a mapping or list in block style."""
        return isinstance(self.node, yaml.CollectionNode) and not self.flow

    @cached_property
    def parts(self) -> list[YamlPart]:
        """Values in the mapping or list, in the order of the text; empty for other values."""
        if isinstance(self.node, yaml.MappingNode):
            return _values(self, self.node)
        return _items(self, self.node) if isinstance(self.node, yaml.SequenceNode) else []

    def can_contain(self, key: Any) -> bool:
        """True if the value is a mapping, or if it is a list and the key is an index."""
        if self.node is None and self.outer is not None:
            raise SharedValue
        if isinstance(self.node, yaml.SequenceNode):
            return isinstance(key, int)
        return isinstance(self.node, yaml.MappingNode)

    def part(self, key: Any) -> YamlPart | None:
        """Value of a key, or of an index of a list; None if the key does not exist."""
        if isinstance(self.node, yaml.SequenceNode):
            return self.parts[int(key)]
        return next((x for x in self.parts if type(x.key) is type(key) and x.key == key), None)

    def replace(self, old: Any, new: Any) -> list[Splice]:
        """Splices that replace the value `old` of this part by `new`; unchanged items remain."""
        if equal_data(old, new):
            return []
        if self.node is None and self.outer is not None:
            raise SharedValue
        keys = _keys(old)
        alike = type(old) is type(new) and set(keys) == set(_keys(new))
        if keys and alike and [x.key for x in self.parts] == keys:
            return [y for x in self.parts for y in x.replace(old[x.key], new[x.key])]
        return self._replace_value(new)

    def add(self, key: Any, value: Any) -> list[Splice]:
        """Splices that add a key at the end of the mapping."""
        name = flow_text(key)
        if self.flow:
            return [self._append_inline(f"{name}: {flow_text(value)}")]
        column = self.parts[0].column
        return [self._append_line(self.parts[-1], column, name + ":", value)]

    def insert(self, index: int, value: Any) -> list[Splice]:
        """Splices that insert an item into the list before an index."""
        if index == len(self.parts) and self.flow:
            return [self._append_inline(flow_text(value))]
        if self.flow:
            head = self.parts[index].begin
            gap = " "
            if self.document.is_first(head):
                gap = self.document.eol + self.document.text[self.document.line_start(head) : head]
            return [Splice(head, head, f"{flow_text(value)},{gap}")]
        if index > 0:
            return [self._append_line(self.parts[index - 1], self.parts[0].column, "-", value)]
        first = self.parts[0]
        line = "-" + self.child_text(value, first.column) + self.document.eol + " " * first.column
        return [Splice(first.head, first.head, line)]

    def remove(self, key: Any) -> list[Splice]:
        """Splices that remove a key, or the item at an index of the list."""
        gone = self.part(key)
        assert gone is not None
        k = self.parts.index(gone)
        if len(self.parts) == 1:
            return self._remove_only_item()
        following = self.parts[k + 1].head if k + 1 < len(self.parts) else None
        if self.flow and following is None and not self.document.is_first(gone.head):
            return [Splice(self.parts[k - 1].end, gone.end, "")]
        if self.flow and following is None:
            comma = _skip_mark(self.document.text, gone.end, ",")
            trailing = self.document.text[comma : self.document.line_end(comma)].strip(BLANKS)
            if trailing.startswith("#"):
                return [self.document.cut_lines(gone.head, comma)]
            return [self.document.cut(gone.head, comma)]
        if following is not None and (self.flow or not self.document.is_first(gone.head)):
            return [Splice(gone.head, following, "")]
        return [self.document.cut_lines(gone.head, gone.end)]

    def _remove_only_item(self) -> list[Splice]:
        """Splices that remove the only item of the mapping or list, with comments after it."""
        empty: Any = {} if isinstance(self.node, yaml.MappingNode) else []
        splices = self._replace_value(empty)
        if len(splices) > 1:
            splices[1] = self.document.cut_lines(self.begin, self.end)
        return splices

    def _replace_value(self, new: Any) -> list[Splice]:
        """Splices that write another value in place of this value."""
        if self.outer is None:
            return self._write_root(new)
        style = self.node.style if isinstance(self.node, yaml.ScalarNode) else None
        line = flow_text(new, style if style in ("'", '"') else None)
        long = isinstance(new, dict | list) and self.column + len(line) > WIDTH
        if self.is_block and long:
            column = _column(self.document, self.begin)
            return [Splice(self.begin, self.end, block_text(new, column, self.document.eol))]
        if long and not self.outer.flow:
            return [Splice(self.name_end, self.end, self.outer.child_text(new, self.column))]
        if self.begin == self.end:
            of_mapping = isinstance(self.outer.node, yaml.MappingNode)
            colon = ":" if of_mapping and self.document.text[self.name_end - 1] != ":" else ""
            return [Splice(self.name_end, self.end, f"{colon} {line}")]
        if not self.is_block:
            return [self._in_column(line)]
        if LINE_BREAK.search(self.document.text, self.name_end, self.begin) is None:
            return [Splice(self.begin, self.end, line)]
        return [
            Splice(self.name_end, self.name_end, f" {line}"),
            self.document.cut(self.begin, self.end),
        ]

    def _in_column(self, line: str) -> Splice:
        """Splice that writes a value on its line; a comment after it stays in its column."""
        gap = ALIGNMENT.match(self.document.text, self.end)
        if gap is None:
            return Splice(self.begin, self.end, line)
        blanks = len(gap[0]) - len(line) + self.end - self.begin
        return Splice(self.begin, gap.end(), line + " " * max(blanks, 2))

    def _write_root(self, new: Any) -> list[Splice]:
        """Splices that replace the whole document, but not comments before it."""
        if self.node is None:
            gap = (
                self.document.eol
                if self.document.text and not self.document.text.endswith(("\r", "\n"))
                else ""
            )
            return [
                Splice(
                    self.end,
                    self.end,
                    gap + block_text(new, 0, self.document.eol) + self.document.eol,
                )
            ]
        text = block_text(new, 0, self.document.eol) if new else flow_text(new)
        return [Splice(self.begin, self.end, text)]

    def _append_inline(self, entry: str) -> Splice:
        """Splice that adds an entry at the end of the mapping or list in flow style."""
        if self.parts:
            return Splice(self.parts[-1].end, self.parts[-1].end, f", {entry}")
        return Splice(self.end - 1, self.end - 1, entry)

    def _append_line(self, after: YamlPart, column: int, name: str, value: Any) -> Splice:
        """Splice that adds a key or dash with its value in a new line after a part."""
        position = self.document.line_end(after.end)
        line = self.document.eol + " " * column + name + self.child_text(value, column)
        return Splice(position, position, line)

    def child_text(self, value: Any, column: int) -> str:
        """Text of a value after a key or dash in a column of this mapping or list."""
        return entry_text(
            value, column, self.document.eol, in_list=isinstance(self.node, yaml.SequenceNode)
        )


def _values(outer: YamlPart, node: yaml.MappingNode) -> list[YamlPart]:
    """Parts of the values of a mapping, in the order of the text."""
    text, parts = outer.document.text, []
    for name, value in node.value:
        name_end = name.end_mark.index
        colon = _skip_mark(text, name_end, ":")
        begin, value_node = value.start_mark.index, value
        if begin < name_end:
            begin, end, value_node = *_find_alias(text, colon), None
        else:
            end = _value_end(outer.document, value, begin)
        # A missing value starts at the end of its key.
        begin, end = max(begin, colon), max(end, colon)
        part = YamlPart(
            document=outer.document,
            node=value_node,
            begin=begin,
            end=end,
            outer=outer,
            key=_data_key(name),
        )
        part.head, part.name_end = name.start_mark.index, colon
        part.column = name.start_mark.column
        parts.append(part)
    return parts


def _keys(value: Any) -> list[Any]:
    """Keys of a mapping, or indices of a list; empty for other values."""
    if isinstance(value, list):
        return list(range(len(value)))
    return list(value) if isinstance(value, dict) else []


def _items(outer: YamlPart, node: yaml.SequenceNode) -> list[YamlPart]:
    """Parts of the items of a list."""
    text, parts, position = outer.document, [], outer.begin
    for k, value in enumerate(node.value):
        begin, value_node = value.start_mark.index, value
        if begin < position:
            begin, end, value_node = *_find_alias(text.text, position), None
        else:
            end = _value_end(text, value, begin)
        part = YamlPart(
            document=text, node=value_node, begin=begin, end=end, outer=outer, key=k, head=begin
        )
        part.name_end, part.column = begin, _column(text, begin)
        if not node.flow_style:
            masked = COMMENT.sub(lambda x: " " * len(x[0]), text.text[position:begin])
            part.head = position + masked.rindex("-")
            part.name_end, part.column = part.head + 1, _column(text, part.head)
        parts.append(part)
        position = max(end, part.name_end)
    return parts


def _data_key(node: yaml.Node) -> Any:
    """Key of a node as in the data; None if it is neither a text nor an integer."""
    if node.tag == INT:
        return int(node.value)
    return node.value if node.tag == TEXT_TAG else None


def _value_end(text: YamlText, node: yaml.Node, begin: int) -> int:
    """Position of the end of a value, before blanks and comments after it."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style:
        part = YamlPart(document=text, node=node, begin=begin, end=begin, outer=None, key=None)
        return part.parts[-1].end
    end = node.end_mark.index
    return begin + len(text.text[begin:end].rstrip(BLANKS))


def _find_alias(text: str, position: int) -> tuple[int, int]:
    """Start and end positions of the next alias after a position."""
    masked = COMMENT.sub(lambda x: " " * len(x[0]), text[position:])
    match = ALIAS.search(masked)
    assert match is not None
    return position + match.start(), position + match.end()


def _skip_mark(text: str, position: int, mark: str) -> int:
    """Position after `mark` if it is the next character except blanks, else `position`."""
    stop = position
    while stop < len(text) and text[stop] in BLANKS:
        stop += 1
    return stop + 1 if text.startswith(mark, stop) else position


def _column(text: YamlText, position: int) -> int:
    """Column of a position, from 0."""
    return position - text.line_start(position)
