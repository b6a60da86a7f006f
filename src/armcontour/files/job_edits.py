"""Edits of keys of job files, which keep all other text and the comments."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any, Final, TypeAlias

import yaml

from armcontour.core.errors import InvalidInput
from armcontour.core.yaml_loader import Loader, load_with_node
from armcontour.files.job_arm import ARM_FILES
from armcontour.files.problems import key_text
from armcontour.files.yaml_text import Shared, Splice, YamlText, equal_data, flow_text

Key: TypeAlias = str | int
Keys: TypeAlias = tuple[Key, ...]
# Keys whose values are names of files, relative to the folder of the job file.
FILES = ("file", "files", "joint_limits", "srdf", "packages")


class Remove(Enum):
    """Marker for the value of a key that is removed."""

    REMOVE = "remove"


REMOVE: Final = Remove.REMOVE


@dataclass(frozen=True, slots=True)
class Change:
    """A change of one key of a job file: a value that is set, inserted into a list, or removed."""

    # The keys of the value, from the outermost; a number is a position in a list, from 0, or the
    # key of a mapping.
    keys: Keys
    value: Any = REMOVE  # The new value; `REMOVE` removes the key or the item, if it exists
    # Whether the value becomes a new item of a list, before the item at this position; the position
    # after the last item is allowed.
    insert: bool = False


def change_text(text: str, changes: Sequence[Change], source: str = "job") -> str:
    """A YAML text with some keys changed; all other lines stay as they were written."""
    data, root = _parsed(text, source)
    for group in _together(data, changes):
        written = YamlText(text, root)
        try:
            text = _spliced(text, [y for x in group for y in _splices(written, data, x)])
            changed = change_data(data, group)
            # If the text is no YAML any more, the change removed an anchor that is still used.
            data, root = _parsed(text, source)
            if not equal_data(data, changed):
                raise Shared
        except (Shared, InvalidInput):
            raise _shared(source, group[-1]) from None
    return text


def change_data(data: Any, changes: Sequence[Change]) -> Any:
    """The data of a job file with some keys changed; the given data stay as they are."""
    for change in changes:
        data = _changed(data, change.keys, change)
    return data


def move_files(text: str, folder: FilePath, to: FilePath) -> str:
    """A job file that names the same files from another folder."""
    root = yaml.compose(text, Loader=Loader)
    edits = []
    for node in _file_names(root):
        location = folder / node.value
        if not FilePath(node.value).is_absolute() and location.exists():
            name = FilePath(os.path.relpath(location.resolve(), to.resolve())).as_posix()
            edits.append(Splice(node.start_mark.index, node.end_mark.index, flow_text(name)))
    return _spliced(text, edits)


def file_names(text: str, source: str = "job") -> list[str]:
    """The files and folders that a job file names."""
    return [x.value for x in _file_names(_parsed(text, source)[1])]


def _file_names(root: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    """The values of a job file that are names of files or folders."""
    if not isinstance(root, yaml.MappingNode):
        return
    for key, value in root.value:
        values = value.value if isinstance(value, yaml.SequenceNode) else [value]
        if key.value == "packages" and isinstance(value, yaml.MappingNode):
            values = [x for _, x in value.value]
        for node in values:
            if not isinstance(node, yaml.ScalarNode):
                yield from _file_names(node)
            elif key.value in FILES or (
                key.value == "arm" and node.value.lower().endswith(ARM_FILES)
            ):
                yield node


@lru_cache(maxsize=1)
def _parsed(text: str, source: str) -> tuple[Any, yaml.Node | None]:
    """Data and nodes of a text, read-only; the last text is cached, as it is often edited next."""
    return load_with_node(text, source)


def _changed(data: Any, keys: Keys, change: Change) -> Any:
    """Data with a change, whose keys start there; what is no mapping or list becomes one."""
    key, *inner = keys
    last, removing = not inner, change.value is REMOVE
    if isinstance(data, list) and isinstance(key, int):
        return _changed_list(data, key, tuple(inner), change)
    if last and change.insert:
        return _changed_list([], _position(key, change), (), change)
    if removing and not (isinstance(data, dict) and key in data):
        return data
    copy = dict(data) if isinstance(data, dict) else {}
    if last and removing:
        del copy[key]
    else:
        copy[key] = change.value if last else _changed(copy.get(key), tuple(inner), change)
    return copy


def _changed_list(data: list[Any], index: int, inner: Keys, change: Change) -> list[Any]:
    """A list with a change at one of its positions, or inside it."""
    adding = change.insert and not inner
    if not 0 <= index < len(data) + adding:
        raise InvalidInput(
            f"{key_text(change.keys)} cannot be changed: the list there has {len(data)} "
            f"item{'' if len(data) == 1 else 's'}."
        )
    if adding:
        return [*data[:index], change.value, *data[index:]]
    if not inner and change.value is REMOVE:
        return [*data[:index], *data[index + 1 :]]
    new = change.value if not inner else _changed(data[index], inner, change)
    return [*data[:index], new, *data[index + 1 :]]


def _position(key: Key, change: Change) -> int:
    """The position in a list that a key names."""
    if not isinstance(key, int):
        raise InvalidInput(f"{key_text(change.keys)} is no position in a list.")
    return key


def _together(data: Any, changes: Sequence[Change]) -> Iterator[list[Change]]:
    """The changes in groups whose locations in the text are independent."""
    group: list[Change] = []
    for change in changes:
        alone = (
            change.insert or change.value is REMOVE or value_at(data, change.keys, REMOVE) is REMOVE
        )
        if group and (alone or any(overlap(change.keys, y.keys) for y in group)):
            yield group
            group = []
        data = change_data(data, [change])
        group.append(change)
        if alone:
            yield group
            group = []
    if group:
        yield group


def key_in(sentence: str) -> str:
    """The key that an error message of a job names, such as "limits.speed"; "" without a key."""
    named = re.search(r": (?:unknown key )?([\w-]+(?:\.[\w-]+)*)", sentence)
    return named[1] if named else ""


def line_of(text: str, sentence: str) -> int | None:
    """The line of a job file, from 1, to which an error message refers; None if it names no key."""
    node, line = yaml.compose(text, Loader=Loader), None
    for key in key_in(sentence).split("."):
        if not isinstance(node, yaml.MappingNode):
            break
        entries = [(k, v) for k, v in node.value if k.value == key]
        if not entries:
            break
        line, node = entries[0][0].start_mark.line + 1, entries[0][1]
    return line


def value_at(data: Any, keys: Keys, default: Any = None) -> Any:
    """The value of data at some keys."""
    for key in keys:
        if isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data):
            data = data[key]
        elif isinstance(data, Mapping) and key in data:
            data = data[key]
        else:
            return default
    return data


def overlap(one: Keys, other: Keys) -> bool:
    """True if one of two locations in data is inside the other, or they are the same."""
    shared = min(len(one), len(other))
    return one[:shared] == other[:shared]


def _splices(text: YamlText, data: Any, change: Change) -> list[Splice]:
    """The splices of a text that make a change."""
    part = text.root
    for depth, key in enumerate(change.keys):
        inner_keys = change.keys[depth + 1 :]
        if not part.holds(key):
            removing = change.value is REMOVE
            return (
                [] if removing else part.replace(data, _changed(data, (key, *inner_keys), change))
            )
        if change.insert and not inner_keys and isinstance(data, list):
            assert isinstance(key, int)
            return part.insert(key, change.value)
        inner = part.part(key)
        if inner is None:
            removing = change.value is REMOVE
            return [] if removing else part.add(key, _changed({}, (key, *inner_keys), change)[key])
        if not inner_keys and change.value is REMOVE:
            return part.remove(key)
        if not inner_keys:
            return inner.replace(data[key], change.value)
        part, data = inner, data[key]
    return []


def _spliced(text: str, splices: Sequence[Splice]) -> str:
    """A text with parts replaced."""
    for splice in sorted(splices, key=lambda x: (x.begin, x.end), reverse=True):
        text = text[: splice.begin] + splice.text + text[splice.end :]
    return text


def _shared(source: str, change: Change) -> InvalidInput:
    """The error for a change that would also change other keys."""
    name = key_text(change.keys)
    by_hand = f"write {name}: {flow_text(change.value)}"
    if change.value is REMOVE:
        by_hand = f"remove {name}"
    return InvalidInput(
        f"{source}: {name} is shared with other keys, so it is not changed: {by_hand} by hand."
    )
