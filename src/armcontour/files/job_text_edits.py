"""Edits of keys in the text of job files; all other text and the comments do not change."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from math import inf
from pathlib import Path as FilePath
from typing import Any, Final, NamedTuple, TypeAlias

import yaml

from armcontour.core.errors import InvalidInput
from armcontour.core.text import Keys, key_text
from armcontour.core.yaml_loader import TAG, Loader, load
from armcontour.files.job_arm import ARM_FILES

Key: TypeAlias = str | int
# Replacement of the characters from a begin to before an end by a text.
Splice: TypeAlias = tuple[int, int, str]
# Keys whose values are file names relative to the folder of the job file.
FILE_NAME_KEYS = ("file", "files", "joint_limits", "srdf")
# Maximum length of a line [characters]; a longer mapping or list is written in block style.
WIDTH = 100
# The key that merges another mapping.
MERGE = "<<"
# Maximum number of passes over a text; a pass removes or adds keys of each mapping.
MAX_PASSES = 50
# The dash of the next item in a list, after an anchor or comments.
DASH = re.compile(r"(?:&\S++|\s|#.*+)*+-")
ALIAS = re.compile(r"(?:[\s,\[-]|#.*+)*+(\*[^\s,\[\]{}]+)")
# Rest of the line after the last value of the line.
REST = re.compile(r"[ \t]*,?[ \t]*(?:#.*)?(?:\r?\n|\Z)")


class Remove(Enum):
    """Type of `REMOVE`, the value of a change that removes a key."""

    REMOVE = "remove"


REMOVE: Final = Remove.REMOVE


class Change(NamedTuple):
    """Change of one key of a job file: set a value, insert it into a list, or remove the key."""

    # Key path of the value, from the outermost key; a number is a list index, from 0, or the key of
    # a mapping
    keys: Keys
    value: Any = REMOVE  # New value; `REMOVE` removes the key or the item if it exists
    # Whether the value is inserted into a list, before the item with the index at the end of
    # `keys`; the length of the list is allowed as an index
    insert: bool = False


class Dumper(yaml.SafeDumper):
    """Dumper that quotes texts which `Loader` would read as other values."""

    yaml_implicit_resolvers = Loader.yaml_implicit_resolvers

    def ignore_aliases(self, data: Any) -> bool:
        """True, so that repeated values are written in full, without anchors and aliases."""
        return True

    def increase_indent(self, flow: bool = False, indentless: bool = False) -> None:
        """Indent lists in mappings."""
        super().increase_indent(flow, False)


class Part(NamedTuple):
    """A value in a YAML text, with its key or dash; positions are in characters."""

    key: Any  # Key of the value, or its index in a list
    head: int  # Start of the key or dash; of the value in a list in flow style
    name_end: int  # End of the key with its colon, or of the dash
    begin: int  # Start of the value
    end: int  # End of the value; of a block, the end of its last line
    node: yaml.Node | None  # None for an alias, or in an empty text


def write_data(text: str, new: Any, source: str = "job") -> str:
    """Change YAML text so that it has new data; the lines of equal values stay.

    Args:
        text: The text.
        new: The new data.
        source: Name of the file, for messages.

    Raises:
        InvalidInput: A change cannot be made in the text, for example because of a YAML anchor.
    """
    data = load(text, source)
    changed = [x for x in {**(data or {}), **new} if value_at(data, (x,)) != new.get(x)]
    for _ in range(MAX_PASSES):
        if data == new:
            return text
        root = yaml.compose(text, Loader=Loader)
        begin, end = (len(text), len(text)) if root is None else _span(text, root)
        splices = _splices(text, Part(None, begin, begin, begin, end, root), data, new)
        for begin, end, written in sorted(splices, reverse=True):
            text = text[:begin] + written + text[end:]
        try:
            data = load(text, source)
        except InvalidInput:
            break
    raise InvalidInput(
        f"{source}: {', '.join(map(str, changed))} cannot be changed in the text, for example "
        "because other keys share a value (a YAML anchor). Edit the file by hand."
    )


def change_data(data: Any, changes: Sequence[Change]) -> Any:
    """Copy the data of a job file, and apply changes."""
    for change in changes:
        if change.value is not REMOVE or value_at(data, change.keys, REMOVE) is not REMOVE:
            data = _change_value(data, change.keys, change)
    return data


def _change_value(data: Any, keys: Keys, change: Change) -> Any:
    """Copy of data with a change at `keys`; creates missing mappings and lists."""
    key = keys[0]
    inner = keys[1:]
    copy: Any = dict(data) if isinstance(data, dict) else {}
    inserting = change.insert and not inner
    if inserting or (isinstance(data, list) and isinstance(key, int)):
        copy = list(data) if isinstance(data, list) else []
        if not isinstance(key, int) or not 0 <= key < len(copy) + inserting:
            raise InvalidInput(
                f"{key_text(change.keys)} cannot be changed, because its list has only "
                f"{len(copy)} item{'' if len(copy) == 1 else 's'}."
            )
    if inserting:
        copy.insert(key, change.value)
    elif inner:
        copy[key] = _change_value(value_at(copy, (key,)), inner, change)
    elif change.value is REMOVE:
        del copy[key]
    else:
        copy[key] = change.value
    return copy


def move_files(text: str, folder: FilePath, to: FilePath) -> str:
    """Convert the relative file names in the text of a job file for another folder.

    Args:
        text: The text.
        folder: Folder to which the names are relative.
        to: Folder to which the returned names are relative.
    """
    changes = []
    data = load(text, "job")
    for keys, name in _file_names(data):
        if not FilePath(name).is_absolute() and (folder / name).exists():
            moved = os.path.relpath((folder / name).resolve(), to.resolve())
            changes.append(Change(keys, FilePath(moved).as_posix()))
    return write_data(text, change_data(data, changes))


def _file_names(data: Any, keys: Keys = (), name: Any = None) -> Iterator[tuple[Keys, str]]:
    """Yield the names of files or folders in data, with their keys; `name`: key of the data."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _file_names(value, (*keys, key), key)
    elif isinstance(data, list):
        for k, value in enumerate(data):
            yield from _file_names(value, (*keys, k), name)
    elif isinstance(data, str) and (
        name in FILE_NAME_KEYS or (name == "arm" and data.lower().endswith(ARM_FILES))
    ):
        yield keys, data


def line_of(text: str, keys: Sequence[Key]) -> int | None:
    """Return the line number, from 1, of the value at a key path, or of its nearest outer key.

    None if the text has no such key.
    """
    node = yaml.compose(text, Loader=Loader)
    line = None
    for key in keys:
        part = next((x for x in _parts(text, node) if str(x.key) == str(key)), None)
        if part is None:
            break
        node = part.node
        line = text.count("\n", 0, part.head) + 1
    return line


def value_at(data: Any, keys: Keys, default: Any = None) -> Any:
    """Return the value at a key path in data; `default` if the path does not exist."""
    for key in keys:
        if isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data):
            data = data[key]
        elif isinstance(data, Mapping) and key in data:
            data = data[key]
        else:
            return default
    return data


def _splices(text: str, part: Part, old: Any, new: Any, flow: bool = False) -> Iterator[Splice]:
    """Yield replacements that change a value; keys of a mapping may need further passes."""
    if old == new:
        return
    parts = _parts(text, part.node) if type(old) is type(new) else []
    values, added, place = _align(old, new, parts) if parts else ({}, [], 0)
    stays = [x.key in values for x in parts]
    if not any(stays):
        yield from _replace(text, part, new, flow)
        return
    flow = flow or bool(getattr(part.node, "flow_style", False))
    for x in parts:
        if x.key in values and x.key != MERGE:
            yield from _splices(text, x, old[x.key], values[x.key], flow)
    if not all(stays):
        yield _remove(text, parts, stays)
    elif added:
        yield _add(text, parts, place, added, flow)


def _align(old: Any, new: Any, parts: Sequence[Part]) -> tuple[dict[Any, Any], list[Any], int]:
    """Match the items of an old and a new mapping or list.

    Returns:
        values: New values of the parts that stay, by their keys.
        added: New items, each as a mapping or list with one item.
        place: Index of the part before which the new items are.
    """
    if isinstance(new, list):
        start = _count_equal(old, new)
        end = _count_equal(old[start:][::-1], new[start:][::-1])
        stop = len(old) - end
        new_stop = len(new) - end
        values = dict(enumerate(new[: min(stop, new_stop)])) | dict(enumerate(new[new_stop:], stop))
        return values, [[x] for x in new[stop:new_stop]], stop
    written = {x.key for x in parts}
    values = {MERGE: None} | {key: new[key] for key in written if key in new}
    missing = {key: x for key, x in new.items() if key not in written}
    added = [{k: x} for k, x in missing.items() if old.get(k, REMOVE) != x]
    return values, added, len(parts)


def _count_equal(one: Sequence[Any], other: Sequence[Any]) -> int:
    """Return the number of equal items at the starts of two lists."""
    pairs = enumerate(zip(one, other, strict=False))
    return next((k for k, (x, y) in pairs if x != y), min(len(one), len(other)))


def _remove(text: str, parts: Sequence[Part], stays: Sequence[bool]) -> Splice:
    """Removal of the first part that does not stay, and of those that follow it directly."""
    first = stays.index(False)
    stop = next((k for k in range(first, len(parts)) if stays[k]), len(parts))
    head = parts[first].head
    end = parts[stop - 1].end
    rest = REST.match(text, end)
    line = text.rfind("\n", 0, head) + 1
    if rest is not None and not text[line:head].strip():
        return (line, rest.end(), "")
    if stop < len(parts):
        return (head, parts[stop].head, "")
    return (parts[first - 1].end, end, "")


def _add(text: str, parts: Sequence[Part], place: int, added: Sequence[Any], flow: bool) -> Splice:
    """Insertion of items before the part with the index `place`."""
    gap = _gap(text, parts[0].head)
    items = [_item_text(x, gap, flow) for x in added]
    if place < len(parts) and (flow or place == 0):
        head = parts[place].head
        if flow:
            first = not text[text.rfind("\n", 0, head) + 1 : head].strip()
            gap = f",{gap}" if first else ", "
        return (head, head, "".join(x + gap for x in items))
    end = parts[place - 1].end
    if not flow:
        end += len(text[end:].partition("\n")[0].rstrip("\r"))
    return (end, end, "".join((", " if flow else gap) + x for x in items))


def _replace(text: str, part: Part, new: Any, flow: bool) -> Iterator[Splice]:
    """Yield text replacements that change the value of a part."""
    value = _item_text({"k": new}, _gap(text, part.head), flow).removeprefix("k:")
    rest = REST.match(text, part.end)
    if rest is not None and "\n" in text[part.name_end : part.begin]:
        # The value is below its key; a comment after the key stays.
        yield (part.name_end, part.name_end, value)
        yield (text.rfind("\n", 0, part.begin) + 1, rest.end(), "")
    elif part.begin == part.end or "\n" in value:
        yield (part.name_end, part.end, value)
    else:
        yield (part.begin, part.end, value.lstrip())


def _item_text(item: dict[Any, Any] | list[Any], gap: str, flow: bool) -> str:
    """Return the text of a mapping or list with one item: on one line if it fits, or as a block."""
    line = _dump(item, default_flow_style=True, width=inf)[1:-1]
    if flow:
        return line
    dash = "- " if isinstance(item, list) else ""
    if len(gap) + len(line) <= WIDTH:
        return dash + line
    return _dump(item, default_flow_style=None, width=WIDTH).replace("\n", gap)


def _dump(value: Any, **style: Any) -> str:
    text = yaml.dump(value, Dumper=Dumper, sort_keys=False, allow_unicode=True, **style)
    return str(text).rstrip()


def _gap(text: str, position: int) -> str:
    """Return the line break and indentation to the column of a position."""
    eol = "\r\n" if "\r\n" in text else "\n"
    return eol + " " * (position - text.rfind("\n", 0, position) - 1)


def _parts(text: str, node: Any) -> list[Part]:
    """Return the values in a mapping or list, in the order of the text; empty for other values."""
    parts = []
    end = 0 if node is None else node.start_mark.index
    for k, item in enumerate(node.value if isinstance(node, yaml.CollectionNode) else ()):
        key = k
        value = item
        after = end
        if isinstance(node, yaml.MappingNode):
            name, value = item
            key = int(name.value) if name.tag == f"{TAG}int" else name.value
            head = name.start_mark.index
            after = text.find(":", name.end_mark.index) + 1
        elif not node.flow_style:
            dash = DASH.match(text, end)
            after = end if dash is None else dash.end()
            head = after - 1
        if value.start_mark.index < after:
            alias = ALIAS.match(text, after)
            value = None
            begin, end = alias.span(1) if alias is not None else (after, after)
        else:
            begin, end = _span(text, value)
        if isinstance(node, yaml.SequenceNode) and node.flow_style:
            head = after = begin
        parts.append(Part(key, head, after, begin, end, value))
    return parts


def _span(text: str, node: yaml.Node) -> tuple[int, int]:
    """Return the start and end of a value, without blanks and lines of comments after it."""
    begin = node.start_mark.index
    body = text[begin : node.end_mark.index].rstrip()
    while body.rpartition("\n")[2].lstrip().startswith("#"):
        body = body.rpartition("\n")[0].rstrip()
    return begin, begin + len(body)
