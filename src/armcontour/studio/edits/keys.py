"""Edits of values: where a key is set for the run that is shown, and how its value is written."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armcontour import _checks, compensation, timing
from armcontour._checks import FloatArray
from armcontour._quantities import Quantity
from armcontour._text import plain_number, show
from armcontour.errors import InvalidInput
from armcontour.io.job_edits import Change, Key, Keys, value_at
from armcontour.io.job_model import JobModel
from armcontour.io.si_data import quantity_of
from armcontour.io.units import unit_of, write_like
from armcontour.jobs import Job, Run
from armcontour.studio.edits.state import EditState

SHARP = "sharp"
# The tolerance of corners that were sharp before.
FIRST_TOLERANCE = "1 mm"
# Keys that a run has in the place of the job's; all others of a run are its own alone.
OF_BOTH = ("limits", "command_limits", "corners", "command_interval")
OF_RUN = ("timing", "compensation", "until", "duration")


def place_of(key: str | Sequence[Key], data: Mapping[str, Any], run: str) -> Keys:
    """The keys at which a value of the job is set, for the run that is shown.

    A key of the run goes to the run. Limits, corners and the command interval go to the run if it
    has them itself, else to the job.

    Args:
        key: The key, such as "limits.speed" or "timing.method".
        data: The data of the job file, as written.
        run: The name of the run.

    Raises:
        InvalidInput: It is no key.
    """
    parts: Any = key.split(".") if isinstance(key, str) else key
    known = isinstance(parts, list) and all(type(x) in (str, int) for x in parts)
    if not known or not parts or "" in parts:
        raise InvalidInput(f"{show(key)} is no key: write one such as limits.speed.")
    first = parts[0]
    if first in OF_RUN or (first in OF_BOTH and _is_own(parts, data, run)):
        parts = ["runs", run, *parts]
    return _with_positions(parts, data)


def _is_own(parts: Sequence[Key], data: Mapping[str, Any], run: str) -> bool:
    """Whether a run has a value of its own in the place of the job's."""
    own = (data["runs"].get(run) or {}).get(parts[0])
    if parts[0] in ("limits", "command_limits") and len(parts) > 1:
        return isinstance(own, dict) and parts[1] in own
    return own is not None


def _with_positions(parts: Sequence[Key], data: Any) -> Keys:
    """Keys of which those that are numbers are so, unless the data have such a text as a key."""
    found: list[Key] = []
    for x in parts:
        named = isinstance(data, dict) and x in data
        key = int(x) if isinstance(x, str) and x.isdecimal() and not named else x
        found.append(key)
        inside = isinstance(data, dict) and key in data
        if isinstance(data, list):
            inside = isinstance(key, int) and 0 <= key < len(data)
        data = data[key] if inside else None
    return tuple(found)


def set_value(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Set a key, to a text as typed, a number in SI units, or null."""
    keys, value = place_of(edit["key"], state.data, state.run), edit["value"]
    if keys[-2:] == ("corners", "shape"):
        return _set_shape(keys, value, state)
    joint, of = keys[-1], value_at(state.data, keys[:-1])
    if isinstance(joint, int) and not isinstance(of, list | dict):
        return [Change(keys[:-1], _for_joints(keys, value, of, state))]
    changes = [Change(keys, written(value, value_at(state.data, keys), keys))]
    for name, methods in (("timing", timing.METHODS), ("compensation", compensation.METHODS)):
        if keys[-2:] == (name, "method") and value in methods:
            # What goes with another method would be refused.
            own = {"method", *(x.name for x in dataclasses.fields(methods[value]))}
            there = value_at(state.data, keys[:-1]) or {}
            changes += [Change((*keys[:-1], x)) for x in there if x not in own]
    return changes


def unset_value(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Remove a key."""
    return [Change(place_of(edit["key"], state.data, state.run))]


def _set_shape(keys: Keys, shape: Any, state: EditState) -> list[Change]:
    """Set the shape of the corners, of which sharp ones are no shape in the file."""
    own = value_at(state.data, keys[:-1])
    if shape == SHARP:
        return [Change(keys[:-1], SHARP)]
    if isinstance(own, dict):
        return [Change(keys, shape)]
    return [Change(keys[:-1], {"shape": shape, "tolerance": FIRST_TOLERANCE})]


def _for_joints(keys: Keys, value: Any, old: Any, state: EditState) -> list[Any]:
    """One value per joint, where there was one for all: one of them is new.

    Raises:
        InvalidInput: The key has no values of joints, or there is no such joint.
    """
    *outer, joint = keys
    now = joint_values(tuple(outer), state.handles.job, state.run)
    if now is None:
        raise InvalidInput(f"{'.'.join(map(str, outer))} has no values of single joints.")
    _checks.whole("number of the joint", joint, 0, len(now) - 1)
    si = [value if k == joint else float(x) for k, x in enumerate(now)]
    return [written(x, old, (*outer, k)) for k, x in enumerate(si)]


def joint_values(keys: Keys, job: Job, run: str) -> FloatArray | None:
    """The values of all joints for limits and gains of a run in SI units, (dof,); None for others.

    Args:
        keys: The keys, such as limits and joint_velocity, or servo and kp.
        job: The job.
        run: The name of the run.
    """
    sources: dict[Key, Any] = {"limits": run_of(job, run).limits, "servo": job.servo}
    found = getattr(sources.get(keys[-2]), str(keys[-1]), None) if len(keys) > 1 else None
    return found if isinstance(found, np.ndarray) and found.shape == (job.arm.dof,) else None


def run_of(job: Job, name: str) -> Run:
    """The run of a job with a name.

    Raises:
        InvalidInput: There is no such run.
    """
    for x in job.runs:
        if x.name == name:
            return x
    raise InvalidInput(f"The job has no run {show(name)}.")


def written(value: Any, old: Any, keys: Keys) -> Any:
    """A value of a key, in the form in which the old one is written.

    A number without a unit that somebody typed has the unit of the old value.

    Args:
        value: The value: as typed, a number in SI units, or a list of these.
        old: The old value as written; None if there is none.
        keys: The keys of the value.
    """
    if isinstance(value, list):
        olds = old if isinstance(old, list) and len(old) == len(value) else [old] * len(value)
        pairs = enumerate(zip(value, olds, strict=True))
        return [written(x, was, (*keys, k)) for k, (x, was) in pairs]
    kind = quantity_of(JobModel, keys)
    if kind is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        number = plain_number(value)
        return value if number is None else _typed(value.strip(), old, kind)
    if isinstance(value, int | float):
        _checks.number(".".join(map(str, keys)), value, kind.unit)
        like = old if isinstance(old, int | float | str) and not isinstance(old, bool) else None
        return write_like(float(value), like, kind)
    return value


def _typed(number: str, old: Any, kind: Quantity) -> Any:
    """A number that was typed without a unit, with the unit that the old value has."""
    if isinstance(old, int | float) and not isinstance(old, bool):
        return float(number)
    return f"{number} {unit_of(old, kind)[0]}"
