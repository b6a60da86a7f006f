"""Tabs: parts of a closed contour on which the process is off, so that the part stays in place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.program.moves import Contour, Event, contour_called
from armcontour.program.process import MAX_TABS, Process, Tabs

# Smallest distance from a tab to a corner, the start point or another tab [widths of a tab].
TAB_CLEARANCE = 1.0
# Smallest turn of a corner [rad]. Smaller turns occur in curves that are drawn as polylines.
CORNER = np.radians(20)


def add_tabs(contour: Contour, process: Process, lap: float) -> Contour:
    """Switch the process off at a closed contour's tabs, at the same place in every lap.

    Returns the contour unchanged if the process has no tabs.

    - `contour`: the contour from its start point, with laps and overlap.
    - `process`: the process with tabs and switch.
    - `lap`: length of one lap [m].
    """
    if process.tabs is None:
        return contour
    assert process.switch is not None
    switch = process.switch
    width = process.tabs.width
    end = contour.path.length
    events = list(contour.events)
    switch_events = [x for x in events if x.name == switch.name]
    first = find_tabs(contour, process.tabs, lap)
    laps = np.arange(int(np.ceil(end / lap))) * lap
    for s in (laps[:, None] + first).ravel().tolist():
        off_s = s - width / 2
        on = min(s + width / 2, end)
        events = [x for x in events if x.name != switch.name or not off_s <= x.s < on]
        for position, lead in ((off_s, switch.off_lead), (on, switch.on_lead)):
            # If the output is already off at this position, it stays off.
            value = next((x.value for x in reversed(switch_events) if x.s <= position), False)
            if value and position < end:
                value = value if position == on else False
                events.append(Event(name=switch.name, value=value, s=position, lead_time=lead))
    return replace(contour, events=tuple(events))


def find_tabs(contour: Contour, tabs: Tabs, lap: float) -> FloatArray:
    """Return the arc lengths of the tabs' middles on the first lap [m], (tabs,).

    Tabs are evenly spaced. A tab at a corner or at the start point is moved next to this point.
    """
    width = tabs.width
    count = tabs.count or _count_tabs(contour, tabs.spacing or lap, lap)
    even = (np.arange(count) + 0.5) * lap / count
    inner = contour.path.breaks[1:-1][contour.path.turns > CORNER]
    corners = np.concatenate([[0.0], inner[inner < lap], [lap]])
    margin = (0.5 + TAB_CLEARANCE) * width
    low = corners[:-1] + margin
    high = corners[1:] - margin
    free = low <= high
    moved = np.clip(even[:, None], low[free], high[free])
    positions = np.empty(0)
    if free.any():
        nearest = np.argmin(np.abs(moved - even[:, None]), axis=1)
        positions = np.sort(moved[np.arange(count), nearest])
    if not free.any() or (np.diff(positions) < (1 + TAB_CLEARANCE) * width).any():
        raise InvalidInput(
            f"{_name_contour(contour)} of {lap * 1e3:.4g} mm "
            f"has no room for {count} tab{'s' if count > 1 else ''} of {width * 1e3:.4g} mm. Tabs "
            "must be at least one width away from corners, the start point and each other. "
            "Specify fewer or narrower tabs, or remove them with by_layer.",
            allowed=lap,
            needed=2 * count * width,
        )
    return positions


def _count_tabs(contour: Contour, spacing: float, lap: float) -> int:
    """Number of tabs per lap for a spacing [m]."""
    count = max(1, round(lap / spacing))
    if count > MAX_TABS:
        raise InvalidInput(
            f"{_name_contour(contour)} of {lap * 1e3:.4g} mm would have {count:.4g} tabs with a "
            f"spacing of {spacing * 1e3:.4g} mm, but at most {MAX_TABS} are supported. Specify a "
            "larger spacing.",
            needed=count,
            allowed=MAX_TABS,
        )
    return count


def _name_contour(contour: Contour) -> str:
    """Name a contour in messages."""
    return contour_called(contour, 0) if contour.name else "A contour"
