"""Tool path offset from contours by half the width of the cut, and the side of the waste."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from armcontour.core.checks import LONGEST_NAME, BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp
from armcontour.core.text import count_noun
from armcontour.geometry import Path
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.prescribed_orientation import tangent_rates
from armcontour.geometry.projection import find_nearest
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program.corner_rounding import draw_with_arcs
from armcontour.program.moves import (
    Contour,
    Dwell,
    Event,
    Move,
    Program,
    Rapid,
    contour_called,
    find_departing_rapids,
    last_end,
    reroute,
)
from armcontour.program.nesting import (
    MAX_SLOPE,
    Nesting,
    find_nesting,
    perpendicular_axes,
    project_along_up,
)
from armcontour.program.offset_curves import (
    SLACK,
    OffsetPart,
    find_crossing_paths,
    find_self_crossing,
    has_no_area,
    offset_segments,
    turns_between,
)
from armcontour.program.process import WASTE, Process

# What to do about a contour whose kerf has no side.
CORRECT = "Correct the drawing, or set kerf: 0 mm for this contour to cut along it"
# Number of bisections in the search for the largest kerf that fits (relative error 0.0001).
KERF_BISECTIONS = 14


def cut_parts(program: Program, process: Process) -> list[tuple[Path, float, float, float]]:
    """List the parts of contours along which the tool separates material.

    Each part is the path of its contour, the first and the last arc length [m], and the kerf [m].
    `process` is the process for which the program was prepared.
    """
    parts = []
    for contour in program.contours:
        contour_process = process.of_contour(contour)
        begin, end = contour.at_work
        if not contour_process.kerf:
            continue
        if contour_process.begins_on:
            # The line down from the height of the pierce does not separate material.
            begin = 0.0 if contour_process.pierce is None else contour_process.pierce.height
        if contour_process.ends_on:
            end = contour.path.length
        parts.append((contour.path, begin, end, contour_process.kerf))
    return parts


def idle_parts(program: Program, process: Process) -> list[tuple[int, float, float]]:
    """List the parts of contours on which the process is off, such as leads and tabs.

    Each is the index of the contour, and the first and last arc length [m].
    """
    if not process.leads and all(x.switch is None for x in process.variants):
        return []
    parts = []
    for k, contour in enumerate(program.contours):
        contour_process = process.of_contour(contour)
        work_start, work_end = contour.at_work
        length = contour.path.length
        switch_name = contour_process.switch and contour_process.switch.name
        on = 0.0 if contour_process.begins_on else work_start
        off = length if contour_process.ends_on else work_end
        changes = [(x.s, bool(x.value)) for x in contour.events if x.name == switch_name]
        changes = changes or [(on, True), (off, False)]
        for (start, is_on), (end, _) in pairwise(((0.0, False), *changes, (length, True))):
            if not is_on and end - start > REPEATED_POINT:
                parts.append((k, start, end))
    return parts


def apply_kerf(program: Program, process: Process) -> Program:
    """Offset the contours of a program by half the kerf.

    - `program`: the program as it is drawn.
    - `process`: kerf, its side, and the upward direction.
    """
    contours = program.contours
    kerfs = [process.of_contour(x).kerf or 0.0 for x in contours]
    if not any(kerfs):
        return program
    sides = _kerf_sides(contours, kerfs, process)
    contours = tuple(draw_with_arcs(x) if sides[i] else x for i, x in enumerate(contours))
    flat = [_flatten(x, i, process) if sides[i] else None for i, x in enumerate(contours)]
    problems = _find_problems(program, contours, flat)
    flat = [None if i in problems else x for i, x in enumerate(flat)]
    parts: list[list[OffsetPart]] = [
        [] if x is None else _offset(x, contours[i], i, kerfs[i], sides[i])
        for i, x in enumerate(flat)
    ]
    if process.kerf_side == WASTE:
        _check_distances(contours, flat, parts, kerfs)
    made = [
        [] if i in problems else _make_contours(x, i, offset, process.up)
        for i, (x, offset) in enumerate(zip(contours, parts, strict=True))
    ]
    moves = _replace_contours(program.moves, made)
    skipped = [contour_called(x, i) for i, x in enumerate(contours) if kerfs[i] and not sides[i]]
    notes = (
        *(f"{x}, so it is left out. {CORRECT}." for x in problems.values()),
        *_notes_on_nesting(program, sides, process),
        *_notes_on_open(skipped),
    )
    return replace(
        program,
        moves=tuple(moves),
        notes=(*program.notes, *notes),
        left_out=(*program.left_out, *(contours[i] for i in problems)),
    )


def _find_problems(
    program: Program, contours: Sequence[Contour], flat: Sequence[Segments | None]
) -> dict[int, str]:
    """Find the contours whose kerf has no side; returns {index: reason}.

    Such contours are left out. The program is refused if none remains, or if it has rapids, events
    or dwells, which may belong to such a contour.
    """
    problems: dict[int, str] = {}
    for i, rows in enumerate(flat):
        if rows is None:
            continue
        called = contour_called(contours[i], i)
        crossing = find_self_crossing(rows, closed=contours[i].closed)
        if crossing is not None:
            x, y = (1e3 * crossing).tolist()
            problems[i] = (
                f"{called} crosses or touches itself at ({x:.6g}, {y:.6g}) mm, and its kerf has no "
                "side"
            )
        elif contours[i].closed and has_no_area(rows):
            problems[i] = f"{called} has no area, and its kerf has no side"
    switches = any(isinstance(x, Event | Dwell) for x in program.moves) or any(
        contours[i].events for i in problems
    )
    if problems and (switches or len(problems) == len(contours)):
        raise InvalidInput(f"{next(iter(problems.values()))}. {CORRECT}.")
    return problems


def _kerf_sides(contours: Sequence[Contour], kerfs: Sequence[float], process: Process) -> list[str]:
    """Return the side of each contour's kerf; "" for contours without offset."""
    waste = process.kerf_side == WASTE
    sides = waste_sides(contours, process) if waste else [process.kerf_side] * len(contours)
    return [
        side if kerf and (contour.closed or not waste) else ""
        for contour, side, kerf in zip(contours, sides, kerfs, strict=True)
    ]


def _notes_on_open(names: Sequence[str]) -> list[str]:
    """Return a note on open contours that are not offset; empty without such contours.

    - `names`: names of these contours.
    """
    if not names:
        return []
    more = count_noun(len(names) - 1, "more open contour")
    suffix = f" and {more} are" if len(names) > 1 else " is"
    return [
        f"{names[0]}{suffix} not offset, because an open contour has no waste side. Set kerf_side "
        "to left or right to also offset open contours."
    ]


def _flatten(contour: Contour, number: int, process: Process) -> Segments:
    """Return a contour's segments in the plane, seen from above.

    Raises InvalidInput if the contour has leads or is not perpendicular to `up`, because its kerf
    then has no side.

    - `number`: index of the contour, for messages.
    """
    called = contour_called(contour, number)
    up = process.up
    rows = contour.path.segments
    if contour.work is not None:
        raise InvalidInput(
            f"{called} already has leads, but a kerf can only offset contours without leads."
        )
    if rows.dimension == 3:
        slopes = np.abs([rows.tangents @ up, rows.normals @ up])
        if slopes.max() > MAX_SLOPE:
            raise InvalidInput(
                f"{called} leaves the plane perpendicular to the upward direction, so its kerf has "
                "no side there. Remove the kerf, or ignore the z of the drawing."
            )
        rows = rows.replace(
            starts=project_along_up(rows.starts, up),
            tangents=project_along_up(rows.tangents, up),
            normals=project_along_up(rows.normals, up),
        )
    return rows


def _offset(
    rows: Segments, contour: Contour, number: int, kerf: float, side: str
) -> list[OffsetPart]:
    """Return the parts of a contour's offset by half the kerf; InvalidInput if it does not fit.

    - `rows`: segments of the contour in the plane.
    - `number`: index of the contour, for messages.
    - `kerf`: width of the cut [m].
    - `side`: side of the kerf, "left" or "right".
    """
    called = contour_called(contour, number)
    sign = 1 if side == "left" else -1

    def offset_parts_with(width: float) -> list[OffsetPart]:
        """Return the parts of the offset for a kerf of this width [m]."""
        parts = offset_segments(rows, sign * width / 2, closed=contour.closed)
        # A closed part of an open contour's offset lies where the contour curls around an area, and
        # is discarded.
        return parts if contour.closed else [x for x in parts if not x.closed]

    offset_parts = offset_parts_with(kerf)
    if not offset_parts:
        fits = 0.0
        too_wide = kerf
        for _ in range(KERF_BISECTIONS):
            middle = (fits + too_wide) / 2
            fits, too_wide = (middle, too_wide) if offset_parts_with(middle) else (fits, middle)
        result = "removes the whole contour" if contour.closed else "does not fit next to it"
        raise InvalidInput(
            f"{called}: a kerf of {1e3 * kerf:.6g} mm {result}. The largest kerf that fits is "
            f"{1e3 * fits:.4g} mm.",
            needed=kerf,
            allowed=fits,
        )
    if len(offset_parts) > 1 and (contour.events or not contour.closed):
        reason = "has events on it" if contour.events else "is open"
        raise InvalidInput(
            f"{called} {reason}, and a kerf of {1e3 * kerf:.6g} mm divides it into "
            f"{len(offset_parts)} pieces. Specify a smaller kerf."
        )
    return offset_parts


def _check_distances(
    contours: Sequence[Contour],
    flat: Sequence[Segments | None],
    parts: Sequence[Sequence[OffsetPart]],
    kerfs: Sequence[float],
) -> None:
    """Raise InvalidInput if the cut along one contour cuts into another contour.

    - `flat`: segments of each contour in the plane; None for contours without offset.
    - `parts`: parts of each contour's offset.
    - `kerfs`: kerf of each contour [m].
    """
    indices = [i for i, x in enumerate(flat) if x is not None]
    if len(indices) < 2:
        return
    sources = [x for x in flat if x is not None]
    paths = [Segments.join([x.segments for x in parts[i]]) for i in indices]
    pair = find_crossing_paths(sources) or find_crossing_paths(paths)
    if pair is None:
        # Compare the distance of each offset segment's middle from all contours with half its kerf.
        owner = np.repeat(np.arange(len(indices)), [len(x) for x in paths])
        path = Segments.join(paths)
        source = Segments.join(sources)
        nearest = find_nearest(source, path.evaluate(slice(None), path.lengths / 2))
        half_kerfs = np.array([kerfs[i] for i in indices])[owner] / 2
        margins = nearest.distance - half_kerfs
        k = int(np.argmin(margins))
        if margins[k] >= -SLACK:
            return
        row = int(np.searchsorted(source.breaks, nearest.s[k], side="right")) - 1
        row_ends = np.cumsum([len(x) for x in sources])
        pair = int(owner[k]), int(np.searchsorted(row_ends, row, side="right"))
    first, second = (indices[k] for k in pair)
    kerf = max(kerfs[first], kerfs[second])
    raise InvalidInput(
        f"{_name_with_layer(contours, first)} and {_name_with_layer(contours, second)} cross, or "
        f"are nearer to each other than the kerf of {1e3 * kerf:.6g} mm, so the cut along one "
        "cuts into the other. Move them apart, specify a smaller kerf, or set kerf: null in "
        "process.by_layer for a layer that is not cut through."
    )


def _name_with_layer(contours: Sequence[Contour], number: int) -> str:
    """Return a contour's name for messages, with its layer if there are several layers."""
    called = contour_called(contours[number], number)
    layer = contours[number].layer
    return f"{called} (layer {layer})" if len({x.layer for x in contours}) > 1 else called


def _make_contours(
    contour: Contour, number: int, parts: Sequence[OffsetPart], up: FloatArray
) -> list[Contour]:
    """Make contours along an offset's parts, the part nearest to the start point first.

    Without parts, the original contour is returned.
    """
    if not parts:
        return [contour]
    source = contour.path
    paths = [_path_of_part(x, source, up) for x in parts]
    if len(paths) == 1:
        return [_put_on_part(contour, paths[0], ring=parts[0].closed)]
    distances = [float(x.project(source(0.0)[None]).distance[0]) for x in paths]
    order = np.argsort(distances, kind="stable").tolist()
    name = contour.name or f"contour {number + 1}"
    suffixes = [f"/{k + 1}" for k in range(len(paths))]
    return [
        replace(contour, path=paths[i], ring=True, name=name[: LONGEST_NAME - len(x)] + x)
        for i, x in zip(order, suffixes, strict=True)
    ]


def _put_on_part(contour: Contour, path: Path, *, ring: bool) -> Contour:
    """Move a contour and its events to the only part of its offset."""
    source = contour.path
    event_s = [float(path.project(source(x.s)[None]).s[0]) for x in contour.events]
    events = tuple(
        # On a closed path, the end is projected to the start.
        replace(x, s=path.length if x.s >= source.length - REPEATED_POINT else s)
        for x, s in zip(contour.events, event_s, strict=True)
    )
    return replace(contour, path=path, events=events, ring=ring)


def _path_of_part(part: OffsetPart, source: Path, up: FloatArray) -> Path:
    """Return the path of an offset part, with its source's limits, tags and orientation."""
    rows = part.segments.replace(**source.segments[part.rows].limit_columns)
    if source.dimension == 3:
        axes = perpendicular_axes(up)
        height = float(source.starts[0] @ up) * up
        rows = rows.replace(
            starts=rows.starts @ axes.T + height,
            tangents=rows.tangents @ axes.T,
            normals=rows.normals @ axes.T,
        )
    if part.closed:
        # The path starts with the segment whose start is nearest to the start of the source.
        distances = np.linalg.norm(rows.starts - source(0.0), axis=1)
        order: IntArray = np.roll(np.arange(len(rows)), -int(np.argmin(np.round(distances, 9))))
        rows = rows[order]
    path = Path(segments=rows)
    if source.orientation is None:
        return path
    return replace(path, orientation=_orient(path, source, source.orientation, up))


def _orient(path: Path, source: Path, orientation: Orientation, up: FloatArray) -> Orientation:
    """Orient the tool along an offset, constantly or at the same angle to the tangent.

    - `path`: the offset.
    - `source`: path of the contour, with the orientation `orientation`.
    """
    rows = path.segments
    start = orientation(0.0)
    is_constant = orientation.fixed and all(
        np.abs(x - start).max() <= REPEATED_POINT for x in orientation.starts
    )
    rates = np.zeros((len(rows), 3))
    starts = np.repeat(start[None], len(rows), axis=0)
    if orientation.follows:
        source_tangent = project_along_up(source.tangents[:1], up)
        tangents = project_along_up(rows.tangents, up)
        starts = exp(turns_between(source_tangent, tangents)[:, None] * up) @ start
        rates = tangent_rates(rows)
    elif not is_constant:
        raise InvalidInput(
            "A kerf needs a tool orientation that is constant or follows the tangent. Change the "
            "orientation, or remove the kerf."
        )
    offset = Orientation.even(
        rows.lengths, starts, rates, axis_only=orientation.axis_only, follows=orientation.follows
    )
    return offset.with_cone(orientation.cone)


def _replace_contours(moves: Sequence[Move], made: Sequence[Sequence[Contour]]) -> list[Move]:
    """Replace the contours among moves; rapids away from a contour start at its new end.

    - `made`: contours that replace each contour, in the order of the contours among `moves`.
    """
    departing_rapids = find_departing_rapids(moves)
    number = 0
    result: list[Move] = []
    left_out = False
    for move in moves:
        if isinstance(move, Contour):
            result += made[number]
            left_out = not made[number]
            number += 1
            continue
        # Rapids still pass the point at which a contour that is left out starts and ends.
        reroutes = isinstance(move, Rapid) and move in departing_rapids and not left_out
        result.append(reroute(move, start=last_end(result)) if reroutes else move)
    return result


def cut_contours(contours: Sequence[Contour], process: Process) -> BoolArray:
    """Return the mask of contours that are cut through, (n,): all but marks (kerf None)."""
    return np.array([not _is_mark(x, process) for x in contours], dtype=bool)


def _is_mark(contour: Contour, process: Process) -> bool:
    """Return whether a contour's values, or its layer's, state that it is not cut through."""
    # A contour without a value, of a process without kerf, can be the outline of a part whose other
    # contours have a kerf. Only None as a value states that it is a mark.
    values = process.by_contour.get(contour.number)
    if values is None:
        values = process.by_layer.get(contour.layer, {})
    return "kerf" in values and values["kerf"] is None


def waste_sides(contours: Sequence[Contour], process: Process) -> list[str]:
    """Return the waste side of every contour in its direction of travel, "left" or "right".

    A closed contour inside an odd number of other contours that are cut is a hole, on any layer and
    whichever of them has a kerf. The waste side of open contours is "left".

    - `contours`: the contours in their direction of travel.
    - `process`: kerfs of the layers, and the direction from which the contours are viewed.
    """
    nesting = find_nesting(contours, process.up)
    holes = _find_holes(nesting, cut_contours(contours, process))
    on_left = (holes == (nesting.areas > 0)) | (nesting.areas == 0)
    return ["left" if x else "right" for x in on_left.tolist()]


def _find_holes(nesting: Nesting, edges: BoolArray) -> BoolArray:
    """Return the mask of contours inside an odd number of edges, (n,).

    - `edges`: mask of the contours that count as edges, (n,).
    """
    return np.asarray(nesting.contains[edges].sum(axis=0) % 2 == 1)


def _notes_on_nesting(program: Program, sides: Sequence[str], process: Process) -> list[str]:
    """Return notes on contours whose offset side depends on those without a kerf.

    `sides` has a side for each of the program's contours; "" for contours without offset.
    """
    contours = (*program.contours, *program.left_out)
    is_run = np.arange(len(contours)) < len(program.contours)
    with_kerf = np.array([process.of_contour(x).kerf is not None for x in contours])
    if process.kerf_side != WASTE or (with_kerf & is_run).all():
        return []
    nesting = find_nesting(contours, process.up)
    cut = is_run & cut_contours(contours, process)
    holes = _find_holes(nesting, cut)
    offset = np.array([x != "" for x in sides] + [False] * len(program.left_out))
    notes = []
    for others, text in (
        (cut & ~with_kerf, "has no kerf, but counts as cut. If it is a mark, set its kerf to null"),
        (is_run & ~cut, "is a mark (kerf: null) and does not count. If it is cut, set kerf: 0 mm"),
        (~is_run, "is not run and does not count. If it should, run it with kerf: 0 mm"),
    ):
        changed = np.flatnonzero(offset & (_find_holes(nesting, cut ^ others) != holes))
        if not len(changed):
            continue
        first = int(changed[0])
        outer = int(np.flatnonzero(nesting.contains[:, first] & others)[0])
        side = "inside" if holes[first] else "outside"
        more = count_noun(len(changed) - 1, "more contour")
        likewise = f" (likewise {more})" if len(changed) > 1 else ""
        notes.append(
            f"{contour_called(contours[first], first)} is cut {side}{likewise}: "
            f"{contour_called(contours[outer], outer)} around it {text}."
        )
    return notes
