"""The tool's path beside contours by half the width of the cut."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from armcontour._checks import LONGEST_NAME, FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import exp
from armcontour.geometry import Path
from armcontour.geometry.nearest import find_nearest
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.orienting import tangent_rates
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program.leads import WASTE
from armcontour.program.moves import Contour, Move, Program, Rapid, contour_called
from armcontour.program.nesting import PARALLEL, axes_across, seen_from_above
from armcontour.program.offsetting import (
    SLACK,
    OffsetPart,
    crosses_itself,
    crossing_owners,
    offset_segments,
)
from armcontour.program.process import Process
from armcontour.program.rapids import last_end, leading_away, reroute
from armcontour.program.rounding import draw_with_arcs
from armcontour.program.scrap_side import waste_sides

# Halvings in the search for the largest kerf that fits: a share of 0.0001 of what does not.
HALVINGS = 14


def cut_parts(program: Program, process: Process) -> list[tuple[Path, float, float, float]]:
    """Parts of the tool path that separate material: path, first and last arc length, kerf [m].

    Args:
        program: The program with leads.
        process: The process that it was prepared for.
    """
    found = []
    for x in program.contours:
        own, (begin, end) = process.of_layer(x.layer), x.at_work
        if not own.kerf:
            continue
        if own.begins_on:
            # The way down from the height of the pierce comes first.
            begin = 0.0 if own.pierce is None else own.pierce.height
        found.append((x.path, begin, x.path.length if own.ends_on else end, own.kerf))
    return found


def apply_kerf(program: Program, process: Process) -> Program:
    """The program with the tool beside its contours by half the kerf.

    Args:
        program: The program as it is drawn.
        process: Kerf, its side, and the upward direction.

    Raises:
        InvalidInput: A contour that is not in a plane across `up`, crosses itself, has leads, or
            vanishes; an offset in several parts of a contour with events; an open one in several
            parts; or two contours that are nearer than the kerf.
    """
    contours = program.contours
    kerfs = [process.of_layer(x.layer).kerf or 0.0 for x in contours]
    if not any(kerfs):
        return program
    sides = [process.kerf_side] * len(contours)
    if process.kerf_side == WASTE:
        sides = [
            side if x.closed else ""
            for x, side in zip(contours, waste_sides(contours, process), strict=True)
        ]
    sides = [side if kerf else "" for side, kerf in zip(sides, kerfs, strict=True)]
    contours = tuple(draw_with_arcs(x) if sides[i] else x for i, x in enumerate(contours))
    flat = [_flatten(x, i, process) if sides[i] else None for i, x in enumerate(contours)]
    parts: list[list[OffsetPart]] = [
        [] if x is None else _offset(x, contours[i], i, kerfs[i], sides[i])
        for i, x in enumerate(flat)
    ]
    if process.kerf_side == WASTE:
        _refuse_near_ones(contours, flat, parts, kerfs)
    made = [
        [x] if not own else _contours_of(x, i, own, process.up)
        for i, (x, own) in enumerate(zip(contours, parts, strict=True))
    ]
    moves = _replaced(program.moves, made)
    left = [contour_called(x, i) for i, x in enumerate(contours) if kerfs[i] and not sides[i]]
    notes = program.notes
    if left:
        more = f" and {len(left) - 1} more open contours stay" if len(left) > 1 else " stays"
        note = f"{left[0]}{more} where drawn, because an open contour has no waste side: "
        notes = (*notes, note + "kerf_side left or right puts the cut beside open contours too.")
    return dataclasses.replace(program, moves=tuple(moves), notes=notes)


def _flatten(contour: Contour, number: int, process: Process) -> Segments:
    """The segments of a contour seen from above.

    Raises:
        InvalidInput: As in `apply_kerf`.
    """
    called, up, rows = contour_called(contour, number), process.up, contour.path.segments
    if contour.work is not None:
        raise InvalidInput(f"{called} has leads already: a kerf is for contours without them.")
    if rows.dimension == 3:
        slopes = np.abs([rows.tangents @ up, rows.normals @ up])
        if slopes.max() > PARALLEL:
            raise InvalidInput(
                f"{called} leaves the plane across the upward direction, so that a kerf has no "
                "side there: leave out the kerf, or the z of the drawing."
            )
        rows = rows.replace(
            starts=seen_from_above(rows.starts, up),
            tangents=seen_from_above(rows.tangents, up),
            normals=seen_from_above(rows.normals, up),
        )
    crossing = crosses_itself(rows, closed=contour.closed)
    if crossing is not None:
        x, y = (1e3 * crossing).tolist()
        raise InvalidInput(
            f"{called} crosses or touches itself at ({x:.6g}, {y:.6g}) mm, so that its kerf has no "
            "side: mend the drawing, or leave out the kerf."
        )
    return rows


def _offset(
    rows: Segments, contour: Contour, number: int, kerf: float, side: str
) -> list[OffsetPart]:
    """The parts of a contour's offset.

    Raises:
        InvalidInput: Nothing is left, or an open contour falls apart.
    """
    called, sign = contour_called(contour, number), 1 if side == "left" else -1

    def parts_of(width: float) -> list[OffsetPart]:
        found = offset_segments(rows, sign * width / 2, closed=contour.closed)
        # Beside an open contour, closed parts are what it curls around.
        return found if contour.closed else [x for x in found if not x.closed]

    found = parts_of(kerf)
    if not found:
        fits, too_wide = 0.0, kerf
        for _ in range(HALVINGS):
            middle = (fits + too_wide) / 2
            fits, too_wide = (middle, too_wide) if parts_of(middle) else (fits, middle)
        result = "leaves nothing of it" if contour.closed else "has no room beside it"
        raise InvalidInput(
            f"{called}: a kerf of {1e3 * kerf:.6g} mm {result}; the largest kerf that fits is "
            f"{1e3 * fits:.4g} mm.",
            needed=kerf,
            allowed=fits,
        )
    if len(found) > 1 and (contour.events or not contour.closed):
        why = "has events on it" if contour.events else "is open"
        raise InvalidInput(
            f"{called} {why}, and a kerf of {1e3 * kerf:.6g} mm parts it into {len(found)} pieces: "
            "give a smaller kerf."
        )
    return found


def _refuse_near_ones(
    contours: Sequence[Contour],
    flat: Sequence[Segments | None],
    parts: Sequence[Sequence[OffsetPart]],
    kerfs: Sequence[float],
) -> None:
    """Refuse contours of which one is cut into along the other.

    Raises:
        InvalidInput: There are such contours.
    """
    own = [i for i, x in enumerate(flat) if x is not None]
    if len(own) < 2:
        return
    sources = [x for x in flat if x is not None]
    paths = [Segments.join([x.segments for x in parts[i]]) for i in own]
    pair = crossing_owners(sources) or crossing_owners(paths)
    if pair is None:
        owner = np.repeat(np.arange(len(own)), [len(x) for x in paths])
        path = Segments.join(paths)
        source = Segments.join(sources)
        nearest = find_nearest(source, path.at(slice(None), path.lengths / 2))
        room = nearest.distance - np.array([kerfs[i] for i in own])[owner] / 2
        k = int(np.argmin(room))
        if room[k] >= -SLACK:
            return
        row = int(np.searchsorted(source.breaks, nearest.s[k], side="right")) - 1
        ends = np.cumsum([len(x) for x in sources])
        pair = int(owner[k]), int(np.searchsorted(ends, row, side="right"))
    first, second = (own[k] for k in pair)
    kerf = max(kerfs[first], kerfs[second])
    raise InvalidInput(
        f"{_called_on_layer(contours, first)} and {_called_on_layer(contours, second)} cross, or "
        f"are nearer to each other than the kerf of {1e3 * kerf:.6g} mm, so that the cut along one "
        "goes into the other: move them apart, give a smaller kerf, or give a layer that is not "
        "cut through the kerf null in process.by_layer."
    )


def _called_on_layer(contours: Sequence[Contour], number: int) -> str:
    """Name of a contour for messages, with its layer if there are several layers."""
    called, layer = contour_called(contours[number], number), contours[number].layer
    return f"{called} (layer {layer})" if len({x.layer for x in contours}) > 1 else called


def _contours_of(
    contour: Contour, number: int, parts: Sequence[OffsetPart], up: FloatArray
) -> list[Contour]:
    """The contours that the parts of an offset make, the first one the nearest to the start."""
    source = contour.path
    paths = [_lift(x, source, up) for x in parts]
    if len(paths) == 1:
        (path,) = paths
        places = [float(path.project(source(x.s)[None]).s[0]) for x in contour.events]
        events = tuple(
            # The end of a closed path is the place of its start.
            dataclasses.replace(x, s=path.length if _is_end(x.s, source) else s)
            for x, s in zip(contour.events, places, strict=True)
        )
        return [dataclasses.replace(contour, path=path, events=events, ring=parts[0].closed)]
    apart = [float(x.project(source(0.0)[None]).distance[0]) for x in paths]
    order = np.argsort(apart, kind="stable").tolist()
    name = contour.name or f"contour {number + 1}"
    called = [f"/{k + 1}" for k in range(len(paths))]
    return [
        dataclasses.replace(
            contour, path=paths[i], ring=True, name=name[: LONGEST_NAME - len(x)] + x
        )
        for i, x in zip(order, called, strict=True)
    ]


def _is_end(s: float, path: Path) -> bool:
    """Whether an arc length is the end of a path."""
    return s >= path.length - REPEATED_POINT


def _lift(part: OffsetPart, source: Path, up: FloatArray) -> Path:
    """The path of a part, with speeds, tolerances, tags and orientation of its source."""
    rows = part.segments
    own = source.segments[part.rows]
    columns = {x: getattr(own, x) for x in ("speeds", "tolerances", "tags")}
    if source.dimension == 3:
        axes = axes_across(up)
        height = float(source.starts[0] @ up) * up
        columns["starts"] = rows.starts @ axes.T + height
        columns |= {x: getattr(rows, x) @ axes.T for x in ("tangents", "normals")}
    rows = rows.replace(**columns)
    if part.closed:
        rows = _from_start(rows, source(0.0))
    path = Path(segments=rows)
    if source.orientation is None:
        return path
    return dataclasses.replace(path, orientation=_orient(path, source, source.orientation, up))


def _from_start(rows: Segments, start: FloatArray) -> Segments:
    """A closed table of segments that begins with the one whose start is nearest to a point."""
    first = int(np.argmin(np.round(np.linalg.norm(rows.starts - start, axis=1), 9)))
    order: IntArray = np.roll(np.arange(len(rows)), -first)
    return rows[order]


def _orient(path: Path, source: Path, given: Orientation, up: FloatArray) -> Orientation:
    """The tool orientation along an offset: the same as along its source, relative to the tangent.

    Raises:
        InvalidInput: An orientation that neither is constant nor follows the tangent.
    """
    rows, start = path.segments, given(0.0)
    same = given.fixed and all(np.abs(x - start).max() <= REPEATED_POINT for x in given.starts)
    rates = np.zeros((len(rows), 3))
    turned = np.repeat(start[None], len(rows), axis=0)
    if given.follows:
        a, b = seen_from_above(source.tangents[:1], up), seen_from_above(rows.tangents, up)
        angle = np.arctan2(
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1]
        )
        turned = exp(angle[:, None] * up) @ start
        rates = tangent_rates(rows)
    elif not same:
        raise InvalidInput(
            "A kerf is for contours along which the tool orientation is constant or follows the "
            "tangent: leave out the kerf."
        )
    return Orientation.even(
        rows.lengths, turned, rates, axis_only=given.axis_only, follows=given.follows
    )


def _replaced(moves: Sequence[Move], made: Sequence[Sequence[Contour]]) -> list[Move]:
    """The moves with other contours; rapids that lead away from one start at its new end."""
    away, number = leading_away(moves), 0
    result: list[Move] = []
    for x in moves:
        if isinstance(x, Contour):
            result += made[number]
            number += 1
        else:
            result.append(
                reroute(x, start=last_end(result)) if isinstance(x, Rapid) and x in away else x
            )
    return result
