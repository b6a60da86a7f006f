"""Job files with some keys changed; everything else stays as it was written, with its comments."""

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
from armcontour.core.yaml_layout import Loader, load_with_node
from armcontour.files.job_arm import ARM_FILES
from armcontour.files.problems import place
from armcontour.files.yaml_text import Shared, Splice, YamlText, same
from armcontour.files.yaml_values import flow_text

Key: TypeAlias = str | int
Keys: TypeAlias = tuple[Key, ...]
# Keys whose values are names of files, relative to the folder of the job file.
FILES = ("file", "files", "joint_limits", "srdf", "packages")


class Remove(Enum):
    """Stands for the value of a key that is removed."""

    REMOVE = "remove"


REMOVE: Final = Remove.REMOVE


@dataclass(frozen=True, slots=True)
class Change:
    """A change of one key of a job file: a value that is set, inserted into a list, or removed.

    Args:
        keys: The keys that lead there, from the outermost; a number is a position in a list, from
            0, or the key of a mapping.
        value: The new value; `REMOVE` removes the key or the item, if it is there.
        insert: Whether the value becomes a new item of a list, before the one that is there now;
            one behind the last is allowed.
    """

    keys: Keys
    value: Any = REMOVE
    insert: bool = False


def change_text(text: str, changes: Sequence[Change], source: str = "job") -> str:
    """A YAML text with some keys changed; all other lines stay as they were written.

    Args:
        text: The text; a mapping.
        changes: The changes, one after the other.
        source: Name of the text in messages.

    Raises:
        InvalidInput: Not YAML, a position that its list does not have, or a key that cannot be
            changed alone, because an alias repeats it or stands for it.
    """
    data, root = _parsed(text, source)
    for these in _together(data, changes):
        written = YamlText(text, root)
        try:
            text = _spliced(text, [y for x in these for y in _splices(written, data, x)])
            wanted = change_data(data, these)
            # What is no YAML any more had an anchor that is still used.
            data, root = _parsed(text, source)
            if not same(data, wanted):
                raise Shared
        except (Shared, InvalidInput):
            raise _shared(source, these[-1]) from None
    return text


def change_data(data: Any, changes: Sequence[Change]) -> Any:
    """The data of a job file with some keys changed; the given data stay as they are.

    Args:
        data: The data.
        changes: The changes, one after the other.

    Raises:
        InvalidInput: A position that its list does not have.
    """
    for x in changes:
        data = _changed(data, x.keys, x)
    return data


def move_files(text: str, folder: FilePath, to: FilePath) -> str:
    """A job file that names the same files from another folder.

    Args:
        text: The job file.
        folder: Its folder.
        to: The other folder.
    """
    root = yaml.compose(text, Loader=Loader)
    edits = []
    for node in _file_names(root):
        there = folder / node.value
        if not FilePath(node.value).is_absolute() and there.exists():
            name = FilePath(os.path.relpath(there.resolve(), to.resolve())).as_posix()
            edits.append(Splice(node.start_mark.index, node.end_mark.index, flow_text(name)))
    return _spliced(text, edits)


def file_names(text: str, source: str = "job") -> list[str]:
    """The files and folders that a job file names.

    Args:
        text: The job file.
        source: Name of the text in messages.

    Raises:
        InvalidInput: Not YAML.
    """
    return [x.value for x in _file_names(_parsed(text, source)[1])]


def _file_names(root: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    """The values of a job file that are names of files or folders."""
    if not isinstance(root, yaml.MappingNode):
        return
    for key, value in root.value:
        values = value.value if isinstance(value, yaml.SequenceNode) else [value]
        if key.value == "packages" and isinstance(value, yaml.MappingNode):
            values = [x for _, x in value.value]
        for x in values:
            if not isinstance(x, yaml.ScalarNode):
                yield from _file_names(x)
            elif key.value in FILES or (key.value == "arm" and x.value.lower().endswith(ARM_FILES)):
                yield x


@lru_cache(maxsize=1)
def _parsed(text: str, source: str) -> tuple[Any, yaml.Node | None]:
    """Data and nodes of a text; those of the last one are kept, which is likely to be changed next.

    Nobody may change them.
    """
    return load_with_node(text, source)


def _changed(data: Any, keys: Keys, change: Change) -> Any:
    """Data with a change, whose keys start there; what is no mapping or list becomes one."""
    key, *rest = keys
    last, removing = not rest, change.value is REMOVE
    if isinstance(data, list) and isinstance(key, int):
        return _changed_list(data, key, tuple(rest), change)
    if last and change.insert:
        return _changed_list([], _position(key, change), (), change)
    if removing and not (isinstance(data, dict) and key in data):
        return data
    own = dict(data) if isinstance(data, dict) else {}
    if last and removing:
        del own[key]
    else:
        own[key] = change.value if last else _changed(own.get(key), tuple(rest), change)
    return own


def _changed_list(data: list[Any], at: int, rest: Keys, change: Change) -> list[Any]:
    """A list with a change at one of its positions, or inside it."""
    adding = change.insert and not rest
    if not 0 <= at < len(data) + adding:
        raise InvalidInput(
            f"{place(change.keys)} cannot be changed: the list there has {len(data)} "
            f"item{'' if len(data) == 1 else 's'}."
        )
    if adding:
        return [*data[:at], change.value, *data[at:]]
    if not rest and change.value is REMOVE:
        return [*data[:at], *data[at + 1 :]]
    new = change.value if not rest else _changed(data[at], rest, change)
    return [*data[:at], new, *data[at + 1 :]]


def _position(key: Key, change: Change) -> int:
    """The position in a list that a key names."""
    if not isinstance(key, int):
        raise InvalidInput(f"{place(change.keys)} is no position in a list.")
    return key


def _together(data: Any, changes: Sequence[Change]) -> Iterator[list[Change]]:
    """The changes in groups whose places in the text do not depend on each other."""
    group: list[Change] = []
    for x in changes:
        alone = x.insert or x.value is REMOVE or value_at(data, x.keys, REMOVE) is REMOVE
        if group and (alone or any(meet(x.keys, y.keys) for y in group)):
            yield group
            group = []
        data = change_data(data, [x])
        group.append(x)
        if alone:
            yield group
            group = []
    if group:
        yield group


def key_in(sentence: str) -> str:
    """The key that a refusal of a job names, such as "limits.speed"; "" if there is none."""
    named = re.search(r": (?:unknown key )?([\w-]+(?:\.[\w-]+)*)", sentence)
    return named[1] if named else ""


def line_of(text: str, sentence: str) -> int | None:
    """The line of a job file, from 1, that a refusal of it names by its keys; None if none.

    Args:
        text: The text of the job file.
        sentence: The refusal, such as "job.yaml: limits.speed: must be above 0".
    """
    node, line = yaml.compose(text, Loader=Loader), None
    for key in key_in(sentence).split("."):
        if not isinstance(node, yaml.MappingNode):
            break
        found = [(k, v) for k, v in node.value if k.value == key]
        if not found:
            break
        line, node = found[0][0].start_mark.line + 1, found[0][1]
    return line


def value_at(data: Any, keys: Keys, default: Any = None) -> Any:
    """The value of data at some keys.

    Args:
        data: Data as parsed.
        keys: The keys, from the outside in.
        default: What is returned if there is none.
    """
    for key in keys:
        if isinstance(data, list) and isinstance(key, int) and 0 <= key < len(data):
            data = data[key]
        elif isinstance(data, Mapping) and key in data:
            data = data[key]
        else:
            return default
    return data


def meet(one: Keys, other: Keys) -> bool:
    """Whether one of two places in data lies inside the other, or they are the same."""
    shared = min(len(one), len(other))
    return one[:shared] == other[:shared]


def _splices(text: YamlText, data: Any, change: Change) -> list[Splice]:
    """What changes in a text with a change.

    Raises:
        Shared: An alias stands for what has to change.
    """
    here = text.root
    for depth, key in enumerate(change.keys):
        rest = change.keys[depth + 1 :]
        if not here.holds(key):
            removing = change.value is REMOVE
            return [] if removing else here.replace(data, _changed(data, (key, *rest), change))
        if change.insert and not rest and isinstance(data, list):
            assert isinstance(key, int)
            return here.insert(key, change.value)
        inner = here.part(key)
        if inner is None:
            removing = change.value is REMOVE
            return [] if removing else here.add(key, _changed({}, (key, *rest), change)[key])
        if not rest and change.value is REMOVE:
            return here.remove(key)
        if not rest:
            return inner.replace(data[key], change.value)
        here, data = inner, data[key]
    return []


def _spliced(text: str, splices: Sequence[Splice]) -> str:
    """A text with parts replaced."""
    for x in sorted(splices, key=lambda x: (x.begin, x.end), reverse=True):
        text = text[: x.begin] + x.text + text[x.end :]
    return text


def _shared(source: str, change: Change) -> InvalidInput:
    """The refusal of a change that would change other keys, too."""
    name = place(change.keys)
    by_hand = f"write {name}: {flow_text(change.value)}"
    if change.value is REMOVE:
        by_hand = f"remove {name}"
    return InvalidInput(
        f"{source}: {name} is shared with other keys, so it is not changed: {by_hand} by hand."
    )
