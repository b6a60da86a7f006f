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
CORNER_TURN = np.radians(20)


def add_tabs(contour: Contour, process: Process, lap: float) -> Contour:
    """Return a closed contour on whose tabs the process is off, at the same place in every lap.

    The contour is unchanged if the process has no tabs.

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
    first_lap_tabs = find_tabs(contour, process.tabs, lap)
    lap_starts = np.arange(int(np.ceil(end / lap))) * lap
    for middle in (lap_starts[:, None] + first_lap_tabs).ravel().tolist():
        off_s = middle - width / 2
        on_s = min(middle + width / 2, end)
        events = [x for x in events if x.name != switch.name or not off_s <= x.s < on_s]
        for s, lead_time in ((off_s, switch.off_lead), (on_s, switch.on_lead)):
            # If the output is already off at this position, it stays off.
            value = next((x.value for x in reversed(switch_events) if x.s <= s), False)
            if value and s < end:
                value = value if s == on_s else False
                events.append(Event(name=switch.name, value=value, s=s, lead_time=lead_time))
    return replace(contour, events=tuple(events))


def find_tabs(contour: Contour, tabs: Tabs, lap: float) -> FloatArray:
    """Return the arc lengths of the tabs' middles on the first lap [m], (tabs,).

    Tabs are evenly spaced. A tab at a corner or at the start point is moved next to this point.
    """
    width = tabs.width
    count = tabs.count or _count_tabs(contour, tabs.spacing or lap, lap)
    even_positions = (np.arange(count) + 0.5) * lap / count
    inner = contour.path.breaks[1:-1][contour.path.turns > CORNER_TURN]
    corners = np.concatenate([[0.0], inner[inner < lap], [lap]])
    margin = (0.5 + TAB_CLEARANCE) * width
    low = corners[:-1] + margin
    high = corners[1:] - margin
    free = low <= high
    nearest_free = np.clip(even_positions[:, None], low[free], high[free])
    positions = np.empty(0)
    if free.any():
        nearest = np.argmin(np.abs(nearest_free - even_positions[:, None]), axis=1)
        positions = np.sort(nearest_free[np.arange(count), nearest])
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
    """Return the number of tabs per lap for a spacing [m]; raise InvalidInput for too many."""
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
    """Return the name of a contour for messages."""
    return contour_called(contour, 0) if contour.name else "A contour"
