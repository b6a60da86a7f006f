"""Edits of keys in the text of job files; all other text and the comments do not change."""

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
from armcontour.core.text import show
from armcontour.core.yaml_loader import Loader, load_with_node
from armcontour.files.job_arm import ARM_FILES
from armcontour.files.key_errors import key_text
from armcontour.files.yaml_text import SharedValue, Splice, YamlText, equal_data, flow_text

Key: TypeAlias = str | int
Keys: TypeAlias = tuple[Key, ...]
# Keys whose values are file names relative to the folder of the job file.
FILE_NAME_KEYS = ("file", "files", "joint_limits", "srdf")


class Remove(Enum):
    """Type of `REMOVE`, the value of a change that removes a key."""

    REMOVE = "remove"


REMOVE: Final = Remove.REMOVE


@dataclass(frozen=True, slots=True)
class Change:
    """Change of one key of a job file: set a value, insert it into a list, or remove the key."""

    # Key path of the value, from the outermost key; a number is a list index, from 0, or the key of
    # a mapping
    keys: Keys
    value: Any = REMOVE  # New value; `REMOVE` removes the key or the item if it exists
    # Whether the value is inserted into a list, before the item with the index at the end of
    # `keys`; the length of the list is allowed as an index
    insert: bool = False


def change_text(text: str, changes: Sequence[Change], source: str = "job") -> str:
    """Apply changes to YAML text; all other lines do not change."""
    data, root = _parse(text, source)
    for group in _group_changes(data, changes):
        written = YamlText(text, root)
        try:
            text = _apply_splices(text, [y for x in group for y in _splices(written, data, x)])
            changed = change_data(data, group)
            # Parsing fails if the change removed an anchor that an alias still uses.
            data, root = _parse(text, source)
            if not equal_data(data, changed):
                raise SharedValue
        except (SharedValue, InvalidInput):
            raise _shared_error(source, group[-1]) from None
    return text


def change_data(data: Any, changes: Sequence[Change]) -> Any:
    """Copy of the data of a job file with changes."""
    for change in changes:
        data = _change_value(data, change.keys, change)
    return data


def move_files(text: str, folder: FilePath, to: FilePath) -> str:
    """Text of a job file whose relative file names are converted from `folder` to `to`."""
    root = yaml.compose(text, Loader=Loader)
    edits = []
    for node in _file_names(root):
        location = folder / node.value
        if not FilePath(node.value).is_absolute() and location.exists():
            name = FilePath(os.path.relpath(location.resolve(), to.resolve())).as_posix()
            edits.append(Splice(node.start_mark.index, node.end_mark.index, flow_text(name)))
    return _apply_splices(text, edits)


def file_names(text: str, source: str = "job") -> list[str]:
    """Names of the files and folders in a job file."""
    return [x.value for x in _file_names(_parse(text, source)[1])]


def _file_names(root: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    """Yield the nodes of a job file that are names of files or folders."""
    if not isinstance(root, yaml.MappingNode):
        return
    for key, value in root.value:
        values = value.value if isinstance(value, yaml.SequenceNode) else [value]
        for node in values:
            if not isinstance(node, yaml.ScalarNode):
                yield from _file_names(node)
            elif key.value in FILE_NAME_KEYS or (
                key.value == "arm" and node.value.lower().endswith(ARM_FILES)
            ):
                yield node


@lru_cache(maxsize=1)
def _parse(text: str, source: str) -> tuple[Any, yaml.Node | None]:
    """Data and root node of a text, read-only; the last text is cached for the next edit."""
    return load_with_node(text, source)


def _change_value(data: Any, keys: Keys, change: Change) -> Any:
    """Copy of data with a change at `keys`; creates missing mappings and lists."""
    key, *inner = keys
    last, removing = not inner, change.value is REMOVE
    if isinstance(data, list) and isinstance(key, int):
        return _change_list(data, key, tuple(inner), change)
    if last and change.insert:
        return _change_list([], _check_index(key, change), (), change)
    if removing and not (isinstance(data, dict) and key in data):
        return data
    copy = dict(data) if isinstance(data, dict) else {}
    if last and removing:
        del copy[key]
    else:
        copy[key] = change.value if last else _change_value(copy.get(key), tuple(inner), change)
    return copy


def _change_list(data: list[Any], index: int, inner: Keys, change: Change) -> list[Any]:
    """Copy of a list with a change of the item at an index, or inside this item."""
    adding = change.insert and not inner
    if not 0 <= index < len(data) + adding:
        raise InvalidInput(
            f"{key_text(change.keys)} cannot be changed, because its list has only {len(data)} "
            f"item{'' if len(data) == 1 else 's'}."
        )
    if adding:
        return [*data[:index], change.value, *data[index:]]
    if not inner and change.value is REMOVE:
        return [*data[:index], *data[index + 1 :]]
    new = change.value if not inner else _change_value(data[index], inner, change)
    return [*data[:index], new, *data[index + 1 :]]


def _check_index(key: Key, change: Change) -> int:
    """Check that a key is an index of a list, and return the index."""
    if not isinstance(key, int):
        raise InvalidInput(
            f"{key_text(change.keys)} cannot be inserted, because {show(key)} is not a list index."
        )
    return key


def _group_changes(data: Any, changes: Sequence[Change]) -> Iterator[list[Change]]:
    """Yield the changes in groups; the changes of one group affect separate parts of the text."""
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
    """Key in the error message of a job, such as "limits.speed"; empty if it has no key."""
    named = re.search(r": (?:unknown key )?([\w-]+(?:\.[\w-]+)*)", sentence)
    return named[1] if named else ""


def line_of(text: str, sentence: str) -> int | None:
    """Number of the line, from 1, of the key in an error message; None if the key is not found."""
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
    """Value at a key path in data; `default` if the path does not exist."""
    for key in keys:
        if isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data):
            data = data[key]
        elif isinstance(data, Mapping) and key in data:
            data = data[key]
        else:
            return default
    return data


def overlap(one: Keys, other: Keys) -> bool:
    """True if two key paths are equal or one contains the other."""
    shared = min(len(one), len(other))
    return one[:shared] == other[:shared]


def _splices(text: YamlText, data: Any, change: Change) -> list[Splice]:
    """Splices of the text that apply a change."""
    part = text.root
    for depth, key in enumerate(change.keys):
        inner_keys = change.keys[depth + 1 :]
        if not part.can_contain(key):
            removing = change.value is REMOVE
            return (
                []
                if removing
                else part.replace(data, _change_value(data, (key, *inner_keys), change))
            )
        if change.insert and not inner_keys and isinstance(data, list):
            assert isinstance(key, int)
            return part.insert(key, change.value)
        inner = part.part(key)
        if inner is None:
            removing = change.value is REMOVE
            return (
                []
                if removing
                else part.add(key, _change_value({}, (key, *inner_keys), change)[key])
            )
        if not inner_keys and change.value is REMOVE:
            return part.remove(key)
        if not inner_keys:
            return inner.replace(data[key], change.value)
        part, data = inner, data[key]
    return []


def _apply_splices(text: str, splices: Sequence[Splice]) -> str:
    """Text after the replacement of all splices, from the end to the start."""
    for splice in sorted(splices, key=lambda x: (x.begin, x.end), reverse=True):
        text = text[: splice.begin] + splice.text + text[splice.end :]
    return text


def _shared_error(source: str, change: Change) -> InvalidInput:
    """Error for a change that would also change other keys, because of YAML anchors."""
    name = key_text(change.keys)
    by_hand = f"write {name}: {flow_text(change.value)}"
    if change.value is REMOVE:
        by_hand = f"remove {name}"
    return InvalidInput(
        f"{source}: {name} is not changed, because other keys share its value (a YAML anchor). "
        f"Edit the file by hand: {by_hand}."
    )
