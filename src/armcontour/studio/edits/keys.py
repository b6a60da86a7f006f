"""Edits that set or remove keys and runs; values are written with the unit of the old value."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import Quantity, linear_unit, read_plain, unit_of, write_like
from armcontour.core.render import scale
from armcontour.core.text import Keys, plain_number, show
from armcontour.files.file_keys import quantity_of
from armcontour.files.job_model import JobModel
from armcontour.files.job_patch import IN_RUN, MERGED, arm_keys, key_of, locate_key, resolve_patch
from armcontour.files.job_text_edits import REMOVE, Change, change_data, value_at
from armcontour.jobs import Job, Run
from armcontour.jobs.job import FIRST_TOLERANCE
from armcontour.studio.handles import EditState

SHARP = "sharp"
# Mappings of values that apply to all contours; others are in `process`.
SHARED = {"speed": "limits", "tolerance": "corners"}
# Outputs of exports, which are numbers or names.
OUTPUTS: Keys = ("export", "outputs")
# Keys of external axes, whose lengths, angles and rates have the units of results: mm and deg. The
# page shows them in these units, and numbers without a unit that a user types have them.
EXTERNAL_AXES: tuple[Keys, ...] = (("arm", "rail"), ("arm", "positioner"))
# Required mappings of a job: they stay even if they become empty.
REQUIRED_LIBRARIES: tuple[Keys, ...] = (("arm",), ("path",), ("servo",), ("runs",))


def set_value(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that set a key: with `run` in this run only; with `insert` as an item."""
    keys = _keys_of_edit(edit, state)
    value = edit["value"]
    if edit.get("run") is True and keys[0] in IN_RUN:
        return _set_in_run(keys, value, state)
    *outer, last = keys
    values = value_at(state.data, tuple(outer))
    now = value_at(state.data, keys)
    if edit.get("insert") is True:
        return [Change(keys, value, insert=True)]
    if isinstance(value, dict) and isinstance(now, dict):
        # The keys are changed one by one, so that comments in the text stay.
        formatted = {k: format_value(x, now.get(k), (*keys, k)) for k, x in value.items()}
        return [Change((*keys, k), formatted.get(k, REMOVE)) for k in {**now, **formatted}]
    if keys == ("arm",) and isinstance(value, str) and isinstance(now, Mapping):
        # Only the model changes; other keys of the arm, such as its tool, stay.
        new = {"name": REMOVE, "file": REMOVE, **arm_keys(value)}
        return [Change(("arm", key), x) for key, x in new.items()]
    if keys[-2:] == ("corners", "shape"):
        # For sharp corners, the file has `corners: sharp` instead of a shape and a tolerance.
        if value == SHARP or not isinstance(values, Mapping):
            arcs = {"shape": value, "tolerance": FIRST_TOLERANCE}
            keys = tuple(outer)
            value = SHARP if value == SHARP else arcs
    elif isinstance(last, int) and not isinstance(values, list | dict):
        value = _list_joint_values(keys, value, values, state)
        keys = tuple(outer)
    else:
        if now is None and keys[:2] == ("path", "contours"):
            # A number without a unit has that of the value which applies to all contours.
            shared = (SHARED.get(str(keys[-1]), "process"), *keys[3:])
            now = value_at(state.data, locate_key(shared, state.data, state.run))
        value = _format_joint_value(value, now, keys, state)
    return resolve_patch(state.data, {keys: value}, state.run)


def unset_value(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that remove a key and the mappings that become empty."""
    keys = _keys_of_edit(edit, state)
    while len(keys) > 1 and keys[:-1] not in REQUIRED_LIBRARIES:
        outer = value_at(state.data, keys[:-1])
        # The mapping of a run or layer stays, because it may be empty.
        stays = keys[0] == "runs" and len(keys) == 3 or keys[:2] == ("path", "layers")
        if stays or not isinstance(outer, Mapping) or set(outer) != {keys[-1]}:
            break
        keys = keys[:-1]
    if keys[0] == "servo":
        # The servo then is not the one of its source.
        return resolve_patch(state.data, {keys: REMOVE})
    return [Change(keys)]


def _keys_of_edit(edit: Mapping[str, Any], state: EditState) -> Keys:
    """Return the keys that an edit changes, in the shown run if the run has them."""
    return locate_key(key_of(edit["key"]), state.data, state.run)


def _set_in_run(keys: Keys, value: Any, state: EditState) -> list[Change]:
    """Return the changes that set a key of the job for the shown run only."""
    changes = list[Change]()
    run_keys = ("runs", state.run, str(keys[0]))
    shared = value_at(state.data, keys[:1])
    if len(keys) > 1 and keys[0] not in MERGED and isinstance(shared, Mapping):
        # The mapping of the run replaces the mapping of the job, so all its keys are copied first.
        changes = [Change(run_keys, deepcopy(shared))]
    run_state = replace(state, data=change_data(state.data, changes))
    # The page displays the unit of the job's value, so a number without a unit has this unit.
    value = format_value(value, value_at(state.data, keys), keys)
    return changes + set_value({"key": [*run_keys, *keys[1:]], "value": value}, run_state)


def _list_joint_values(keys: Keys, value: Any, old: Any, state: EditState) -> list[Any]:
    """List of joint values that replaces a common value, with a new value for one joint."""
    *outer, joint = keys
    now = joint_values(tuple(outer), state.handles.job, state.run)
    if now is None:
        raise InvalidInput(f"{'.'.join(map(str, outer))} cannot have a value per joint.")
    checks.check_int("number of the joint", joint, 0, len(now) - 1)
    si = [value if k == joint else float(x) for k, x in enumerate(now)]
    return [_format_joint_value(x, old, (*outer, k), state) for k, x in enumerate(si)]


def _format_joint_value(value: Any, old: Any, keys: Keys, state: EditState) -> Any:
    """Format a value as `format_value` does, but that of a prismatic joint as a number in SI units.

    Raises:
        InvalidInput: A text is not a quantity of a prismatic joint.
    """
    kind = quantity_of(JobModel, keys)
    joint = keys[-1]
    if kind is None or not isinstance(joint, int) or not isinstance(value, str | int | float):
        return format_value(value, old, keys)
    unit = joint_unit(kind, joint, state.handles.job)
    is_limit = joint_values(keys[:-1], state.handles.job, state.run) is not None
    if not is_limit or unit == kind.unit:
        return format_value(value, old, keys)
    if not isinstance(value, str):
        return float(value)
    # The page shows the value with this unit, so a number without a unit has it.
    typed = value if plain_number(value) is None else f"{value} {scale(unit)[0]}"
    try:
        return read_plain(typed, replace(kind, unit=unit))
    except ValueError as error:
        raise InvalidInput(f"{'.'.join(map(str, keys))} {error}.") from error


def joint_unit(kind: Quantity, joint: int, job: Job) -> str:
    """Return the SI unit of a joint's value, given the quantity for revolute joints."""
    prismatic = job.arm.chain.prismatic or ()
    slides = joint < len(prismatic) and prismatic[joint]
    return linear_unit(kind.unit) if slides else kind.unit


def joint_values(keys: Keys, job: Job, run: str) -> FloatArray | None:
    """Limit or gain of each joint in a run [SI], (dof,); None if the key has no joint values."""
    values = value_of(keys[-2:], job, run_of(job, run))
    return values if isinstance(values, np.ndarray) and values.shape == (job.arm.dof,) else None


def value_of(keys: Keys, job: Job, run: Run) -> Any:
    """Return a run's value of a key such as ("servo", "kp") [SI]; None if it has none."""
    owners = {"corners": run.rounding, "servo": job.servo, "cycle": run.cycle}
    name = str(keys[0])
    value = owners.get(name, getattr(run, name, None))
    return getattr(value, str(keys[1]), None) if len(keys) > 1 else value


def run_of(job: Job, name: str) -> Run:
    """Find the run of a job by its name."""
    for candidate in job.runs:
        if candidate.name == name:
            return candidate
    raise InvalidInput(f"The job has no run {show(name)}.")


def format_value(value: Any, old: Any, keys: Keys) -> Any:
    """Format a value with the unit of the old value.

    Numbers are in SI units. Text without a unit is in the unit of the old value.
    """
    if isinstance(value, list):
        olds = old if isinstance(old, list) and len(old) == len(value) else [old] * len(value)
        pairs = enumerate(zip(value, olds, strict=True))
        return [format_value(x, was, (*keys, k)) for k, (x, was) in pairs]
    kind = quantity_of(JobModel, keys)
    if keys[:2] == OUTPUTS and isinstance(value, str) and value.strip().isdecimal():
        # An output that is typed as a number is one; names of signals begin with a letter.
        return int(value)
    if kind is None or isinstance(value, bool):
        return value
    if isinstance(value, str) and (unit := shown_unit(keys, kind)):
        return _format_shown(value.strip(), unit, old, kind)
    if isinstance(value, str):
        number = plain_number(value)
        if number is None or not kind.unit:
            # Text with a unit, or a pure number, such as a component of a direction.
            return value if number is None else number
        return _format_typed(value.strip(), old, kind)
    if not kind.unit:
        return value
    if isinstance(value, int | float):
        checks.check_number(".".join(map(str, keys)), value, kind.unit)
        like = old if isinstance(old, int | float | str) and not isinstance(old, bool) else None
        return write_like(float(value), like, kind)
    return value


def shown_unit(keys: Keys, kind: Quantity) -> str:
    """Return the unit in which the page shows a value of an external axis; empty if as written."""
    unit, factor = scale(kind.unit)
    return unit if keys[:2] in EXTERNAL_AXES and factor != 1 else ""


def _format_shown(text: str, unit: str, old: Any, kind: Quantity) -> Any:
    """Format text whose number has the shown unit, unless it has another one, like the old value.

    Text that is no quantity is unchanged; the reader of the keys refuses it.
    """
    typed = text if plain_number(text) is None else f"{text} {unit}"
    try:
        value = read_plain(typed, kind)
    except ValueError:
        return text
    is_number = isinstance(old, int | float) and not isinstance(old, bool)
    same_unit = isinstance(old, str) and unit_of(old, kind) == unit_of(typed, kind)
    if same_unit or not isinstance(old, str) and not is_number:
        return typed
    return write_like(value, old, kind)


def _format_typed(number: str, old: Any, kind: Quantity) -> Any:
    """Format a number typed without a unit: with the unit of the old value."""
    if isinstance(old, int | float) and not isinstance(old, bool):
        return float(number)
    return f"{number} {unit_of(old, kind)[0]}"


def add_run(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that add a copy of the shown run."""
    name = edit["name"]
    runs = state.data["runs"]
    if name in runs:
        raise InvalidInput(f"The job already has a run {name}. Choose another name.")
    return [Change(("runs", name), deepcopy(runs[state.run]))]


def order_contours(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Return the changes that set the order of contours: `orders`, pairs of contour and order.

    A contour is given by its name or number, as in the key `path.contours`.
    """
    patch: dict[Keys, Any] = {}
    for pair in checks.check_sequence("orders", edit["orders"], list, "lists"):
        if len(pair) != 2 or not isinstance(pair[0], str | int):
            raise InvalidInput(
                "Each item of orders must be a contour and its order, such as [CUT-1, 3], but is "
                f"{show(pair)}."
            )
        contour, order = pair
        patch["path", "contours", contour, "order"] = checks.check_int("order", order)
    return resolve_patch(state.data, patch, state.run)
