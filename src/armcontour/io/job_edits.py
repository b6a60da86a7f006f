"""Job files with some keys changed; everything else stays as it was written, with its comments."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path as FilePath
from typing import Any, TypeAlias

import yaml

from armcontour._yaml import Loader, load
from armcontour.errors import InvalidInput
from armcontour.io.job_arm import ARM_FILES

Keys: TypeAlias = tuple[str, ...]
# Keys whose values are names of files, relative to the folder of the job file.
FILES = ("file", "joint_limits")


def set_keys(text: str, changes: Mapping[Keys, Any], source: str = "job") -> str:
    """A YAML text with some values set, and the rest of the text as it was.

    Args:
        text: The text; a mapping.
        changes: New values by their keys, from the outermost to the innermost.
        source: Name of the text in messages.

    Raises:
        InvalidInput: A value cannot be set without changing others, as with aliases.
    """
    for keys, value in changes.items():
        wanted = _unshared(load(text, source))
        _set_in(wanted, keys, value)
        text = _set(text, keys, value)
        if load(text, source) != wanted:
            raise InvalidInput(
                f"{source}: {'.'.join(keys)} is shared with other keys, so it is not changed: "
                f"write {'.'.join(keys)}: {_flow(value)} by hand."
            )
    return text


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
            edits.append((node.start_mark.index, node.end_mark.index, _flow(name)))
    for begin, end, name in sorted(edits, reverse=True):
        text = text[:begin] + name + text[end:]
    return text


def _file_names(root: yaml.Node | None) -> Iterator[yaml.ScalarNode]:
    """The values of a job file that are names of files or folders."""
    if not isinstance(root, yaml.MappingNode):
        return
    for key, value in root.value:
        if isinstance(value, yaml.ScalarNode):
            named = key.value == "arm" and value.value.lower().endswith(ARM_FILES)
            if key.value in FILES or named:
                yield value
        elif key.value == "packages" and isinstance(value, yaml.MappingNode):
            yield from (x for _, x in value.value if isinstance(x, yaml.ScalarNode))
        elif isinstance(value, yaml.SequenceNode):
            for x in value.value:
                yield from _file_names(x)
        else:
            yield from _file_names(value)


def _unshared(data: Any) -> Any:
    """The same data, where what aliases repeat are parts of their own."""
    if isinstance(data, dict):
        return {key: _unshared(x) for key, x in data.items()}
    return [_unshared(x) for x in data] if isinstance(data, list) else data


def _set_in(data: dict[str, Any], keys: Keys, value: Any) -> None:
    """Set a value in nested mappings; what is no mapping on the way becomes one."""
    for key in keys[:-1]:
        if not isinstance(data.get(key), dict):
            data[key] = {}
        data = data[key]
    data[keys[-1]] = value


def _set(text: str, keys: Keys, value: Any) -> str:
    """Set one value in a text."""
    node: Any = yaml.compose(text, Loader=Loader)
    for depth, key in enumerate(keys):
        rest = value
        for x in reversed(keys[depth + 1 :]):
            rest = {x: rest}
        known = next((pair for pair in node.value if pair[0].value == key), None)
        if known is None:
            return _insert(text, node, key, rest)
        name, old = known
        if depth + 1 == len(keys) or not isinstance(old, yaml.MappingNode) or not old.value:
            begin = text.index(":", name.end_mark.index) + 1
            return f"{text[:begin]} {_flow(rest)}{text[max(_end(old), begin) :]}"
        node = old
    return text


def _insert(text: str, node: yaml.MappingNode, key: str, value: Any) -> str:
    """Add a key to a mapping, before its first one."""
    entry = f"{key}: {_flow(value)}"
    if node.flow_style:
        at = node.start_mark.index + 1
        return f"{text[:at]}{entry}{', ' if node.value else ''}{text[at:]}"
    first = node.value[0][0].start_mark
    return f"{text[: first.index]}{entry}\n{' ' * first.column}{text[first.index :]}"


def _end(node: yaml.Node) -> int:
    """Where the text of a value ends, without the comments after it."""
    if not isinstance(node, yaml.CollectionNode) or node.flow_style:
        return int(node.end_mark.index)
    inner: list[Any] = list(node.value)
    return max(_end(x[1] if isinstance(x, tuple) else x) for x in inner)


def _flow(value: Any) -> str:
    """A value on one line."""
    text = yaml.safe_dump(
        value, default_flow_style=True, sort_keys=False, width=1_000_000, allow_unicode=True
    )
    return text.removesuffix("...\n").strip()
