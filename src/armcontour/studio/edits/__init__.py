"""Convert the page's edits to changes of keys in the job file.

The functions for edits return changes; the document applies them as one step of undo.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

from armcontour.core.errors import InvalidInput
from armcontour.core.text import show
from armcontour.files.job_text_edits import Change
from armcontour.studio.edits.edges import pick, unpick
from armcontour.studio.edits.keys import add_run, order_contours, set_value, unset_value
from armcontour.studio.edits.layout import place, tilt
from armcontour.studio.edits.obstacles import allow, obstacle
from armcontour.studio.edits.waypoints import (
    draw,
    insert_waypoint,
    move_waypoint,
    remove_waypoint,
    set_waypoint,
)
from armcontour.studio.handles import EditState

# Keys of edits whose values must be text.
TEXTS = ("name", "action", "kind")


def changes_of(edit: Mapping[str, Any], state: EditState) -> tuple[Change, ...]:
    """Convert an edit to changes of job keys; its key `do` selects the function."""
    do = edit.get("do")
    if not isinstance(do, str) or do not in EDITS:
        raise InvalidInput(f"do must be one of {', '.join(EDITS)}, but is {show(do)}.")
    for name in TEXTS:
        if not isinstance(edit.get(name, ""), str):
            raise InvalidInput(
                f"The value of {name} in the edit {do} must be text, but is {show(edit[name])}."
            )
    try:
        return tuple(EDITS[do](edit, state))
    except KeyError as error:
        raise InvalidInput(f"The edit {do} requires {error.args[0]}.") from None


EditFunction: TypeAlias = Callable[[Mapping[str, Any], EditState], Sequence[Change]]
EDITS: dict[Any, EditFunction] = {
    "set": set_value,
    "unset": unset_value,
    "add_run": add_run,
    "order": order_contours,
    "tilt": tilt,
    "move_waypoint": move_waypoint,
    "set_waypoint": set_waypoint,
    "insert_waypoint": insert_waypoint,
    "remove_waypoint": remove_waypoint,
    "place": place,
    "obstacle": obstacle,
    "allow": allow,
    "draw": draw,
    "pick": pick,
    "unpick": unpick,
}
