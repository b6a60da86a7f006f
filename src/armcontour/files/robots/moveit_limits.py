"""Joint limits as a table, and their replacement by a `joint_limits.yaml` of MoveIt."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import file_access, yaml_loader
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import linear_unit
from armcontour.core.text import plain_number, show
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, UNITS, Limits, or_unlimited

# Values of each limit by name, one per joint: a number, or a lower and an upper bound; None if the
# joint has no such limit.
Table = dict[str, list[Any]]

# Kinds of limits that a file can enable and disable. The names of the limits of each kind are
# listed by key of the file.
KINDS = {
    "position": {"min_position": "joint_lower", "max_position": "joint_upper"},
    "velocity": {"max_velocity": "joint_velocity"},
    "acceleration": {"max_acceleration": "joint_acceleration"},
    "jerk": {"max_jerk": "joint_jerk"},
    "effort": {"max_effort": "joint_torque"},
}
# Keys for accelerations and decelerations.
ACCELERATION_KEYS = {
    "has_acceleration_limits",
    "max_acceleration",
    "has_deceleration_limits",
    "max_deceleration",
}
# Keys that are accepted, but not used.
IGNORED = {"angle_wraparound", "k_position", "k_velocity", "min_velocity"}
SOFT = ("soft_lower_limit", "soft_upper_limit")
KNOWN = {"has_soft_limits", *SOFT}
KNOWN |= {f"has_{kind}_limits" for kind in KINDS}
KNOWN |= set(chain.from_iterable(KINDS.values()))
KNOWN |= ACCELERATION_KEYS
# Outer keys in files for the parameter server of ROS.
OUTER_KEYS = ("/**", "ros__parameters", "robot_description_planning")
NAMES = (*JOINT_LIMITS, *JOINT_RANGE)


def table_of(limits: Limits, dof: int) -> Table:
    """Return the table of limits with one value per joint."""
    table: Table = {}
    for name in NAMES:
        values = getattr(limits, name)
        table[name] = [None] * dof if values is None else or_unlimited(values, dof).tolist()
    return table


def override_limits(table: Table, joints: Sequence[str], file: str | FilePath) -> None:
    """Replace limits in a table by the limits of a `joint_limits.yaml`.

    A kind of limit that the file disables (`has_velocity_limits: false`) is removed; a kind that is
    not in the file does not change. Soft limits narrow the range. `max_deceleration` may be
    positive or, as in MoveIt, negative. The smaller absolute value of `max_deceleration` and
    `max_acceleration` becomes the acceleration limit in both directions, so that both are
    satisfied. The default scaling factors are not applied, because they are defaults of requests to
    MoveIt, not limits.
    """
    content = file_access.read_bytes(file, "file of joint limits")
    data = yaml_loader.load(content, str(file))
    for wrapper in OUTER_KEYS:
        if isinstance(data, Mapping) and wrapper in data:
            data = data[wrapper]
    entries = data.get("joint_limits") if isinstance(data, Mapping) else None
    if not isinstance(entries, Mapping):
        raise InvalidInput(
            f"{file} has no joint limits. It must have the key joint_limits, a mapping by the "
            "names of the joints."
        )
    if not set(map(str, entries)) & set(joints):
        raise InvalidInput(
            f"{file} has no limits for joints of the arm. It names "
            f"{', '.join(map(str, entries)) or 'none'}, but the arm has {', '.join(joints)}."
        )
    for k, joint in enumerate(joints):
        if joint in entries:
            _override_joint(table, k, f"{file}, joint {joint}", entries[joint])


def make_limits(table: Table, joints: Sequence[str], source: str, slides: Sequence[bool]) -> Limits:
    """`Limits` of a table, infinite where a joint has no limit; checks values and ranges.

    `slides`: whether each joint is prismatic, for the units of messages.
    """
    limits: dict[str, Any] = {}

    def unit(name: str, k: int) -> str:
        return linear_unit(UNITS[name]) if slides[k] else UNITS[name]

    for name, values in table.items():
        none = -math.inf if name == JOINT_RANGE[0] else math.inf
        limits[name] = [none if x is None else x for x in values]
        for k, (joint, value) in enumerate(zip(joints, limits[name], strict=True)):
            if name in JOINT_LIMITS and isinstance(value, int | float) and not value > 0:
                raise InvalidInput(
                    f"{source}: the {name} of joint {joint} must be positive, but is "
                    f"{value:g} {unit(name, k)}. Specify the correct value in the file or with "
                    "joint_limits.",
                    limit=name,
                )
        # If one joint has a lower and an upper bound, all need both.
        if any(isinstance(x, list) for x in values):
            limits[name] = [x if isinstance(x, list) else [-x, x] for x in limits[name]]
    ranges = zip(joints, *(limits[x] for x in JOINT_RANGE), strict=True)
    for k, (joint, low, high) in enumerate(ranges):
        if low >= high:
            raise InvalidInput(
                f"{source}: the lower end of the range of joint {joint} must be less than the "
                f"upper end, but the range is from {low:g} to {high:g} "
                f"{unit(JOINT_RANGE[0], k)}."
            )
    return Limits(**{name: x for name, x in limits.items() if np.isfinite(x).any()})


def _override_joint(table: Table, k: int, location: str, entry: Any) -> None:
    """Replace the limits of joint k by an entry of the file."""
    if not isinstance(entry, Mapping):
        raise InvalidInput(
            f"{location} must be a mapping of limits, such as max_velocity, but is {entry!r}."
        )
    for key in entry:
        if key not in KNOWN | IGNORED:
            raise InvalidInput(
                f"{location} has the unknown key {key!r}. The known keys are "
                f"{', '.join(sorted(KNOWN))}."
            )
    for kind, values in KINDS.items():
        for key, name in values.items():
            if _is_enabled(location, entry, kind) is False:
                table[name][k] = None
            else:
                value = _limit_value(location, entry, kind, key)
                table[name][k] = table[name][k] if value is None else value
    _override_acceleration(table, k, location, entry)
    if _is_enabled(location, entry, "soft") is not False:
        low, high = (_limit_value(location, entry, "soft", key) for key in SOFT)
        if low is not None and high is not None:
            narrow_range(table, k, low, high)


def narrow_range(table: Table, k: int, low: float, high: float) -> None:
    """Narrow the range of joint k [rad] to soft limits."""
    for name, value, inner in zip(JOINT_RANGE, (low, high), (max, min), strict=True):
        current = table[name][k]
        table[name][k] = value if current is None else inner(current, value)


def _override_acceleration(table: Table, k: int, location: str, entry: Mapping[Any, Any]) -> None:
    """Set the acceleration limit of joint k to the smaller of acceleration and deceleration."""
    if not ACCELERATION_KEYS & set(entry):
        return
    slowing = None
    if _is_enabled(location, entry, "deceleration") is not False:
        slowing = _limit_value(location, entry, "deceleration", "max_deceleration")
    if slowing is not None:
        speeding = table["joint_acceleration"][k]
        if speeding is None:
            raise InvalidInput(
                f"{location} has max_deceleration but no max_acceleration. Add max_acceleration."
            )
        table["joint_acceleration"][k] = float(np.abs([slowing, *np.atleast_1d(speeding)]).min())


def _is_enabled(location: str, entry: Mapping[Any, Any], kind: str) -> bool | None:
    """Return whether an entry enables a kind of limit, False if it disables it, None if neither."""
    switch = entry.get(f"has_{kind}_limits")
    if switch is None or isinstance(switch, bool):
        return switch
    raise InvalidInput(f"{location}: has_{kind}_limits must be true or false, but is {switch!r}.")


def _limit_value(location: str, entry: Mapping[Any, Any], kind: str, key: str) -> float | None:
    """Return the value of a limit in an entry of the file; None if the entry has no such limit."""
    if key in entry:
        value = plain_number(entry[key])
        if value is None:
            raise InvalidInput(
                f"{location}: {key} must be a number, but is {show(entry[key])}. Expressions are "
                "not supported, but an angle may be written as !degrees 90."
            )
        return value
    if _is_enabled(location, entry, kind):
        raise InvalidInput(f"{location} has has_{kind}_limits: true, but no {key}. Add {key}.")
    return None
