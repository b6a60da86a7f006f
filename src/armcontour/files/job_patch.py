"""Patches, which replace values of keys in a job file.

Options of the command line, edits of the Studio, batches and placements change jobs by patches.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.guesses import suggest
from armcontour.core.text import Keys, key_text, show
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import Patch as Patch
from armcontour.files.job_arm import ARM_FILES
from armcontour.files.job_model import JobModel, RunModel
from armcontour.files.job_text_edits import REMOVE, Change, change_data, value_at, write_data
from armcontour.files.servo_presets import preset_keys
from armcontour.jobs.job import ARC, FREE
from armcontour.jobs.methods import COMPENSATIONS, TIMINGS
from armcontour.motion import Method

# Top-level keys of a job.
IN_JOB = {x.name for x in fields(JobModel)}
# Keys of a run.
IN_RUN = {x.name for x in fields(RunModel)}
# For these keys, the mapping of a run is merged with the mapping of the job. For other keys, the
# value of a run replaces the value of the job.
MERGED = ("limits", "command_limits")
# Largest number of parts of a key path, and of characters of an index.
LONGEST_KEY = 50
LONGEST_INDEX = 10
# Position of the part, of which a patch can set x and y only.
PART_POSITION: Keys = ("path", "frame", "position")
SERVO: Keys = ("servo",)
SERVO_SOURCE: Keys = ("servo", "source")


def _options_of(methods: Mapping[Any, Any]) -> dict[str, str]:
    """Return the keys that are valid only with one of the methods, with the name of this method."""
    options = dict[str, str]()
    for kind in methods.values():
        options |= dict.fromkeys(kind.__annotations__, str(kind.method))
    return options


# Keys of a timing that are valid only with one method, with the name of this method.
TIMING_OPTIONS = _options_of(TIMINGS)
# Keys of a compensation that are valid only with one method, with the name of this method.
COMPENSATION_OPTIONS = _options_of(COMPENSATIONS)
# Keys that are valid only with one method or shape, with the name of this method or shape, by the
# last two keys of the key path of their method or shape.
CHOICES: dict[Keys, dict[str, str]] = {
    ("timing", "method"): TIMING_OPTIONS,
    ("compensation", "method"): COMPENSATION_OPTIONS,
    ("corners", "shape"): {"continuity": ARC},
}


def parse_set(text: str) -> Patch:
    """Parse a text such as `corners.tolerance=0.2 mm` to a patch.

    Args:
        text: A key path with dots, an equals sign, and a value as in a job file (YAML).

    Raises:
        InvalidInput: The text has another form.
    """
    key, equals, value = text.partition("=")
    if not equals:
        raise InvalidInput(
            f"{show(text)} sets no key. Write KEY=VALUE, such as limits.speed=0.2 m/s."
        )
    return {key_of(key.strip()): load(value, key.strip())}


def key_of(key: Any) -> Keys:
    """Convert a text such as `limits.speed`, or a list, to a key path; digits are an index."""
    parts = key
    if isinstance(key, str):
        parts = [int(x) if x.isdecimal() and len(x) <= LONGEST_INDEX else x for x in key.split(".")]
    listed = isinstance(parts, list | tuple) and all(type(part) in (str, int) for part in parts)
    if not listed or not parts or "" in parts:
        raise InvalidInput(f"{show(key)} is not a key. Write a key such as limits.speed.")
    if len(parts) > LONGEST_KEY:
        raise InvalidInput(
            f"The key {show(key)} has {len(parts)} parts, but a key has at most {LONGEST_KEY}. "
            "Write a key such as limits.speed."
        )
    return tuple(parts)


def full_key(keys: Keys) -> Keys:
    """Return the key path from the root; for a key that only runs have, in an unnamed run."""
    return ("runs", "", *keys) if keys[0] in IN_RUN - IN_JOB else keys


def locate_key(keys: Keys, data: Any, run: str | None = None) -> Keys:
    """Return the key path at which a value is set.

    The value is set in the run if the run overrides the key, else in the job.

    Args:
        keys: Key path.
        data: Data of the job file.
        run: Name of the run; None for the job.

    Raises:
        InvalidInput: The key path names a run that does not exist.
    """
    runs = value_at(data, ("runs",))
    if keys[0] == "runs" and isinstance(runs, Mapping) and (len(keys) < 2 or keys[1] not in runs):
        names = [str(x) for x in runs]
        hint = suggest("".join(map(str, keys[1:2])), names, f"the runs are {', '.join(names)}.")
        raise InvalidInput(f"{'.'.join(map(str, keys))} names no run of the job: {hint}", key=keys)
    if run is not None and keys[0] in IN_RUN:
        value = value_at(data, ("runs", run, keys[0]))
        merged = keys[0] in MERGED and len(keys) > 1
        hides = isinstance(value, Mapping) and keys[1] in value if merged else value is not None
        if hides or keys[0] not in IN_JOB:
            keys = ("runs", run, *keys)
    numbered: list[Any] = []
    for part in keys:
        # A number is a list index, unless the mapping has it as a text key.
        named = isinstance(data, Mapping) and part not in data and str(part) in data
        numbered.append(str(part) if named else part)
        data = value_at(data, (numbered[-1],))
    return tuple(numbered)


def resolve_patch(data: Any, patch: Patch, run: str | None = None) -> list[Change]:
    """Return the changes of a job file that apply a patch.

    Args:
        data: Data of the job file.
        patch: The patch.
        run: Run that the patch changes; None for the job and the runs that override a key.

    Raises:
        InvalidInput: A key of the patch cannot be set.
    """
    return _resolve(data, patch, run)[1]


def apply_patch(data: Any, patch: Patch) -> Any:
    """Copy the data of a job file, and apply a patch."""
    return _resolve(data, patch, None)[0]


def write_patch(text: str, patch: Patch, source: str = "job") -> str:
    """Write the text of a job file with a patch applied; comments do not change.

    Args:
        text: Text of the job file.
        patch: The patch.
        source: Name of the file, for messages.

    Raises:
        InvalidInput: The text is not YAML, or a key of the patch cannot be set.
    """
    return write_data(text, apply_patch(load(text, source), patch), source)


def arm_keys(arm: str) -> dict[str, str]:
    """Return the mapping of the key `arm` for its short form, a built-in name or a file name."""
    return {"file" if arm.lower().endswith(ARM_FILES) else "name": arm}


def _resolve(data: Any, patch: Patch, run: str | None) -> tuple[Any, list[Change]]:
    """Return the data with a patch applied, and the changes that apply it."""
    changes: list[Change] = []
    values = {key_of(keys): value for keys, value in patch.items()}
    for keys in sorted(values, key=_sort_key):
        added = list(_changes_of_value(keys, values[keys], data, run))
        data = change_data(data, added)
        changes += added
    return data, changes


def _sort_key(keys: Keys) -> tuple[bool, bool, int]:
    """Sort key for the order of changes; keys that others depend on, such as methods, are first."""
    *_, outer, key = ("", *keys)
    depends = any(key in names for (x, _), names in CHOICES.items() if x == outer)
    return len(keys) > 1, outer == "corners", 2 * depends + (keys[-2:] in CHOICES)


def _changes_of_value(keys: Keys, value: Any, data: Any, run: str | None) -> Iterator[Change]:
    """Yield the changes that set one value of a patch, in the job and in its runs."""
    runs = value_at(data, ("runs",))
    if run is not None or keys[0] not in IN_RUN or not isinstance(runs, Mapping):
        yield from _set_value(locate_key(keys, data, run), value, data)
    elif keys in (("corners", "shape"), ("corners", "continuity")):
        yield from _set_corner_option(keys, value, data, runs)
    else:
        if keys[0] in IN_JOB:
            yield from _set_value(locate_key(keys, data), value, data)
        for name in runs:
            keys_of_run = locate_key(keys, data, name)
            replaces = keys_of_run[0] == "runs" and value_at(data, keys_of_run) is not None
            if replaces or keys[0] not in IN_JOB:
                yield from _set_value(keys_of_run, value, data)


def _set_corner_option(
    keys: Keys, value: Any, data: Any, runs: Mapping[str, Any]
) -> Iterator[Change]:
    """Yield the changes that set the corner shape or an option of it in all runs that allow it."""
    refused = True
    for name in runs:
        inherited = locate_key(("corners",), data, name)
        corners = value_at(data, inherited)
        method = value_at(data, ("runs", name, "timing", "method"), Method.OPTIMAL)
        if not isinstance(corners, Mapping) or method != Method.OPTIMAL:
            continue
        if keys[1] == "continuity" and corners.get("shape") == FREE:
            continue
        refused = False
        keys_of_run = ("runs", name, "corners")
        if inherited != keys_of_run:
            copy = Change(keys_of_run, dict(corners))
            yield copy
            data = change_data(data, [copy])
        yield from _set_value((*keys_of_run, *keys[1:]), value, data)
    if refused:
        raise InvalidInput(
            f"{'.'.join(map(str, keys))} requires a run with rounded corners and the timing "
            "method optimal, but the job has no such run. Write timing: {method: optimal} in a "
            "run, or set corners.tolerance if only the corners are missing.",
            key=keys,
        )


def _height(position: Any) -> Any:
    """Return z of the part's written position, which a new x and y do not change."""
    if isinstance(position, list) and len(position) == 3:
        return position[2]
    raise InvalidInput(
        f"{key_text(PART_POSITION)} requires x, y and z, because the job has no position whose z "
        "would stay. Write three lengths, such as '300 mm, 0 mm, 100 mm'.",
        key=PART_POSITION,
    )


def _set_value(keys: Keys, value: Any, data: Any) -> Iterator[Change]:
    """Yield the changes that set a value at a key path and remove keys that it makes invalid."""
    for k in range(1, len(keys)):
        outer_value = value_at(data, keys[:k])
        inner = keys[k:]
        # A short form, such as `arm: ur5e`, is replaced by a mapping that has the new key.
        if keys[:k] == ("arm",) and isinstance(outer_value, str):
            yield Change(keys[:k], change_data(arm_keys(outer_value), [Change(inner, value)]))
            return
        if keys[:k] == SERVO and isinstance(outer_value, str):
            servo = preset_keys(outer_value)
            servo.pop("source")
            yield Change(keys[:k], change_data(servo, [Change(inner, value)]))
            return
        if keys[:k] == ("path", "layers") and isinstance(outer_value, list):
            layers: dict[str, Any] = {str(name): {} for name in outer_value}
            yield Change(keys[:k], change_data(layers, [Change(inner, value)]))
            return
        listed = isinstance(outer_value, list) and isinstance(keys[k], int)
        if not (
            outer_value is None
            or outer_value == "sharp"
            or isinstance(outer_value, Mapping)
            or listed
        ):
            outer = ".".join(map(str, keys[:k]))
            raise InvalidInput(
                f"{outer} is {show(outer_value)}, which has no key {keys[k]}. Set the whole value "
                f"of {outer}.",
                key=keys,
            )
    old = value_at(data, keys)
    if keys == PART_POSITION and isinstance(value, list | tuple) and len(value) == 2:
        value = [*value, _height(old)]
    if keys == ("path", "layers") and isinstance(old, Mapping) and isinstance(value, list):
        # Selected layers keep their speeds and tolerances.
        value = {name: old.get(name) or {} for name in map(str, value)}
    yield Change(keys, value)
    is_servo_value = keys[:1] == SERVO and keys not in (SERVO, SERVO_SOURCE)
    if is_servo_value and value_at(data, SERVO_SOURCE) is not None:
        # With another value, the servo is not the one of this source.
        yield Change(SERVO_SOURCE, REMOVE)
    siblings = value_at(data, keys[:-1])
    for name, choice in CHOICES.get(keys[-2:], {}).items():
        if choice != value and isinstance(siblings, Mapping) and name in siblings:
            yield Change((*keys[:-1], name), REMOVE)
