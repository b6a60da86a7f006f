"""Edits of single corners, which have their tolerances by the numbers of waypoints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.files.job_edits import Change, Keys, value_at
from armcontour.files.patch import locate_key
from armcontour.studio.edits.keys import written
from armcontour.studio.edits.state import EditState

# Largest number of a waypoint.
MOST_POINTS = 10_000_000


def corner_tolerance(edit: Mapping[str, Any], state: EditState) -> list[Change]:
    """Set the tolerance of one corner; null takes it away."""
    if edit["index"] is None:
        raise InvalidInput(
            "This corner is at no waypoint of a path of one contour, so that it cannot have a "
            "tolerance of its own: set that of all corners."
        )
    index = checks.check_int("number of the waypoint", edit["index"], 0, MOST_POINTS)
    keys = locate_key(("corners", "at"), state.data, state.run)
    key: Keys = (*keys, index + 1)
    given = value_at(state.data, keys)
    if edit["value"] is None:
        alone = isinstance(given, dict) and set(given) == {index + 1}
        return [Change(keys if alone else key)]
    return [Change(key, written(edit["value"], value_at(state.data, key), key))]


def renumbered(index: int, by: int, state: EditState) -> list[Change]:
    """The tolerances of single corners, by the new numbers of waypoints from one on.

    Args:
        index: Index of the first waypoint that has another number, or of the one that is removed.
        by: By how much numbers change.
        state: What the edit is made on.
    """
    changes = []
    last = len(state.handles.ends) - 1
    # Without an end of the path, the first and the last of the other points have no corner.
    ends = {1, last} if by < 0 and index in (0, last) else set()
    runs = (("runs", name, "corners", "at") for name in state.data["runs"])
    for keys in (("corners", "at"), *runs):
        given = value_at(state.data, keys)
        if not isinstance(given, dict):
            continue
        # The waypoint that is removed has the number index + 1.
        kept = {k: x for k, x in given.items() if by > 0 or k != index + 1}
        moved = {k + by if k > index else k: x for k, x in kept.items()}
        new = {k: x for k, x in moved.items() if k not in ends}
        if new != given:
            changes.append(Change(keys, new) if new else Change(keys))
    return changes
