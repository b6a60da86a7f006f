"""Tabs: places of closed contours where the process is off, so that a part stays in its sheet."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.program.moves import Contour, Event, contour_called
from armcontour.program.process import MOST_TABS, Process, Tabs

# Free length between a tab and a corner, the start point or another tab, in widths of a tab.
CLEAR = 1.0
# Smaller turns are those of curves that are drawn as polylines, on which tabs may lie [rad].
CORNER = np.radians(20)


def add_tabs(contour: Contour, process: Process, lap: float) -> Contour:
    """A closed contour whose process is switched off at tabs, at the same places of every lap.

    Args:
        contour: The contour from its start point, with laps and overlap.
        process: Tabs and switch; a process without tabs leaves the contour as it is.
        lap: Length of one lap [m].

    Raises:
        InvalidInput: The contour has no room for its tabs.
    """
    if process.tabs is None:
        return contour
    assert process.switch is not None
    switch, width = process.switch, process.tabs.width
    end = contour.path.length
    events = list(contour.events)
    own = [x for x in events if x.name == switch.name]
    first = find_tabs(contour, process.tabs, lap)
    laps = np.arange(int(np.ceil(end / lap))) * lap
    for s in (laps[:, None] + first).ravel().tolist():
        off, on = s - width / 2, min(s + width / 2, end)
        events = [x for x in events if x.name != switch.name or not off <= x.s < on]
        for place, lead in ((off, switch.off_lead), (on, switch.on_lead)):
            # The output stays off in gaps of the program that begin or end on the tab.
            value = next((x.value for x in reversed(own) if x.s <= place), False)
            if value and place < end:
                value = value if place == on else False
                events.append(Event(name=switch.name, value=value, s=place, lead_time=lead))
    return dataclasses.replace(contour, events=tuple(events))


def find_tabs(contour: Contour, tabs: Tabs, lap: float) -> FloatArray:
    """Arc lengths of the middles of tabs on the first lap [m], (tabs,).

    Tabs are as far from each other as corners and the start point allow: those that would lie on
    one of them are moved beside it.

    Raises:
        InvalidInput: The contour has no room for its tabs.
    """
    width = tabs.width
    count = tabs.count or _count(contour, tabs.spacing or lap, lap)
    wanted = (np.arange(count) + 0.5) * lap / count
    corners = _corners(contour.path, lap)
    margin = (0.5 + CLEAR) * width
    low, high = corners[:-1] + margin, corners[1:] - margin
    free = low <= high
    moved = np.clip(wanted[:, None], low[free], high[free])
    places = np.empty(0)
    if free.any():
        nearest = np.argmin(np.abs(moved - wanted[:, None]), axis=1)
        places = np.sort(moved[np.arange(count), nearest])
    if not free.any() or (np.diff(places) < (1 + CLEAR) * width).any():
        raise InvalidInput(
            f"{_called(contour)} of {lap * 1e3:.4g} mm "
            f"has no room for {count} tab{'s' if count > 1 else ''} of {width * 1e3:.4g} mm, which "
            "keep a width free to corners, to the start point and to each other: take fewer or "
            "narrower ones, or leave them out with by_layer.",
            allowed=lap,
            needed=2 * count * width,
        )
    return places


def _count(contour: Contour, spacing: float, lap: float) -> int:
    """The number of tabs of a lap with a spacing [m].

    Raises:
        InvalidInput: There are more than MOST_TABS.
    """
    count = max(1, round(lap / spacing))
    if count > MOST_TABS:
        raise InvalidInput(
            f"{_called(contour)} of {lap * 1e3:.4g} mm would have {count:.4g} tabs with a spacing "
            f"of {spacing * 1e3:.4g} mm, more than {MOST_TABS}: take a larger spacing.",
            needed=count,
            allowed=MOST_TABS,
        )
    return count


def _called(contour: Contour) -> str:
    """What messages call a contour."""
    return contour_called(contour, 0) if contour.name else "A contour"


def _corners(path: Path, lap: float) -> FloatArray:
    """Arc lengths of start, corners and end of the first lap of a path [m]."""
    inner = path.breaks[1:-1][path.turns > CORNER]
    return np.concatenate([[0.0], inner[inner < lap], [lap]])
