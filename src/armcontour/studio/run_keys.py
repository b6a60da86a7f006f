"""Keys in which the runs of a job differ, for the table that compares them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from armcontour.core.text import Keys
from armcontour.files.file_keys import in_si
from armcontour.files.job_model import RunModel
from armcontour.files.job_patch import IN_RUN, MERGED
from armcontour.motion import Method

# Methods of a run without such keys.
DEFAULTS: dict[tuple[str, str], str] = {
    ("timing", "method"): Method.OPTIMAL.value,
    ("compensation", "method"): "default",
    ("corners", "shape"): "sharp",
}
# Shape of corners that have other keys only.
ROUNDED = "arc"


def differing_keys(data: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the keys in which runs differ: each with its value in every run that has one.

    >>> differing_keys({"runs": {"slow": {"cycle": "8 ms"}, "fast": {"cycle": "4 ms"}}})
    [{'key': 'cycle', 'values': {'slow': '8 ms', 'fast': '4 ms'}}]

    Args:
        data: Data of the job, as written. Values of the job apply to runs without their own.
    """
    runs = data.get("runs")
    if not isinstance(runs, Mapping):
        return []
    written = {str(name): dict(_leaves((), _keys_of(run, data))) for name, run in runs.items()}
    # Equal quantities can be written with different units.
    si = {name: in_si(_keys_of(run, data), RunModel) for name, run in runs.items()}
    compared = {str(name): dict(_leaves((), keys)) for name, keys in si.items()}
    rows = []
    for keys in dict.fromkeys(keys for leaves in written.values() for keys in leaves):
        values = [leaves.get(keys) for leaves in compared.values()]
        if any(x != values[0] for x in values):
            texts = {name: _text(x[keys]) for name, x in written.items() if keys in x}
            rows.append({"key": ".".join(map(str, keys)), "values": texts})
    return rows


def values_of(data: Mapping[str, Any], run: str) -> dict[str, str]:
    """Return the texts of all keys that apply to a run, by key, as `differing_keys` has them.

    >>> values_of({"cycle": "4 ms", "runs": {"own": {}}}, "own")["cycle"]
    '4 ms'

    Args:
        data: Data of the job, as written.
        run: Name of the run.
    """
    runs = data.get("runs")
    own = runs.get(run) if isinstance(runs, Mapping) else None
    leaves = _leaves((), _keys_of(own, data))
    return {".".join(map(str, keys)): _text(value) for keys, value in leaves}


def _keys_of(run: Any, data: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keys that apply to a run: its own, and those of the job."""
    own = run if isinstance(run, Mapping) else {}
    keys: dict[str, Any] = {}
    for name in sorted(IN_RUN):
        value = own.get(name)
        shared = data.get(name)
        if name in MERGED and isinstance(value, Mapping) and isinstance(shared, Mapping):
            value = {**shared, **value}
        keys[name] = shared if value is None else value
    for (section, inner), default in DEFAULTS.items():
        value = keys[section]
        if isinstance(value, Mapping):
            keys[section] = {inner: ROUNDED if section == "corners" else default, **value}
        else:
            keys[section] = {inner: default if value is None else value}
    return {name: x for name, x in keys.items() if x is not None}


def _leaves(keys: Keys, value: Any) -> Iterator[tuple[Keys, Any]]:
    """Yield the values inside nested mappings, with their keys."""
    if not isinstance(value, Mapping):
        yield keys, value
        return
    for key, inner in value.items():
        yield from _leaves((*keys, key), inner)


def _text(value: Any) -> str:
    """Write a value as it is in the file."""
    if isinstance(value, bool):
        return "on" if value else "off"
    if value is None:
        return "none"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
