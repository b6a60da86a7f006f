"""The tool's path beside contours by half the width of the cut, and the side of the scrap."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import LONGEST_NAME, BoolArray, FloatArray, IntArray
from armcontour.core.describing import count_noun
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp
from armcontour.geometry import Path
from armcontour.geometry.nearest import find_nearest
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.orienting import tangent_rates
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program._crossings import LENGTH, crossings
from armcontour.program.leads import lead_path
from armcontour.program.moves import (
    Contour,
    Move,
    Program,
    Rapid,
    contour_called,
    last_end,
    leading_away,
    reroute,
)
from armcontour.program.nesting import PARALLEL, axes_across, chords_of, nest, seen_from_above
from armcontour.program.offsetting import (
    SLACK,
    OffsetPart,
    crosses_itself,
    crossing_owners,
    offset_segments,
)
from armcontour.program.process import WASTE, Lead, Process
from armcontour.program.rounding import draw_with_arcs

# Halvings in the search for the largest kerf that fits: a share of 0.0001 of what does not.
HALVINGS = 14
# Share of a lead beside the contour that it touches, along which contact is not judged.
CONTACT = 0.01
# Halvings in the search for the longest lead that fits: a share of 0.0001 of what does not.
SIDE_HALVINGS = 14


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
    sides = _kerf_sides(contours, kerfs, process)
    contours = tuple(draw_with_arcs(x) if sides[i] else x for i, x in enumerate(contours))
    flat = [_flatten(x, i, process) if sides[i] else None for i, x in enumerate(contours)]
    parts: list[list[OffsetPart]] = [
        [] if x is None else _offset(x, contours[i], i, kerfs[i], sides[i])
        for i, x in enumerate(flat)
    ]
    if process.kerf_side == WASTE:
        _refuse_near_ones(contours, flat, parts, kerfs)
    made = [
        _contours_of(x, i, own, process.up)
        for i, (x, own) in enumerate(zip(contours, parts, strict=True))
    ]
    moves = _replaced(program.moves, made)
    left = [contour_called(x, i) for i, x in enumerate(contours) if kerfs[i] and not sides[i]]
    return dataclasses.replace(
        program, moves=tuple(moves), notes=(*program.notes, *_notes_on_open(left))
    )


def _kerf_sides(contours: Sequence[Contour], kerfs: Sequence[float], process: Process) -> list[str]:
    """The side of each contour on which its kerf lies; "" for contours that stay where drawn."""
    sides = [process.kerf_side] * len(contours)
    if process.kerf_side == WASTE:
        waste = waste_sides(contours, process)
        sides = [side if x.closed else "" for x, side in zip(contours, waste, strict=True)]
    return [side if kerf else "" for side, kerf in zip(sides, kerfs, strict=True)]


def _notes_on_open(left: Sequence[str]) -> list[str]:
    """A note on open contours, by their names, that a kerf in the waste leaves where drawn."""
    if not left:
        return []
    more = f" and {len(left) - 1} more open contours stay" if len(left) > 1 else " stays"
    return [
        f"{left[0]}{more} where drawn, because an open contour has no waste side: "
        "kerf_side left or right puts the cut beside open contours too."
    ]


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
    """The contours that the parts of an offset make, the first one the nearest to the start.

    Without parts it is the contour itself.
    """
    if not parts:
        return [contour]
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


def cut_contours(contours: Sequence[Contour], process: Process) -> BoolArray:
    """Contours at which material is separated: those with a kerf; all if no layer has a kerf."""
    found = np.array([process.of_layer(x.layer).kerf is not None for x in contours])
    return found if found.any() else ~found


def waste_sides(contours: Sequence[Contour], process: Process) -> list[str]:
    """The scrap side of every contour in its direction of travel, "left" or "right".

    Closed contours inside an odd number of other contours that are cut are holes, whatever their
    layers. The scrap side of open contours is "left".

    Args:
        contours: The contours in their direction of travel.
        process: Kerfs of the layers, and the direction from which the contours are viewed.
    """
    found = nest(contours, process.up)
    depths = found.holds[cut_contours(contours, process)].sum(axis=0)
    left = ((depths % 2 == 1) == (found.areas > 0)) | (found.areas == 0)
    return ["left" if x else "right" for x in left.tolist()]


class LeadPlacement:
    """Leads of the contours of a program, in the scrap and clear of all contours that are cut.

    Args:
        contours: The contours before they get overlaps and leads.
        process: The process.
    """

    def __init__(self, contours: Sequence[Contour], process: Process) -> None:
        self._contours, self._process = contours, process
        needed = any(x.side == WASTE for x in process.leads)
        self._sides = waste_sides(contours, process) if needed else ["left"] * len(contours)
        self._cut = cut_contours(contours, process)
        self._around: tuple[FloatArray, FloatArray] | None = None
        # Leads that are shorter than asked: share of the length, and a description.
        self._shortened: list[tuple[float, str]] = []

    def lay(self, number: int, path: Path, lead: Lead, length: float, *, after: bool) -> Path:
        """The lead-in or the lead-out of contour `number`.

        Args:
            number: The contour.
            path: Its path, with overlap.
            lead: Shape and side.
            length: Length of the lead [m]; one of automatic length is shortened to what fits.
            after: True for the lead-out.

        Raises:
            InvalidInput: An arc in the scrap crosses a contour that is cut, or begins in the part.
        """
        contour = self._contours[number]
        side = self._sides[number] if lead.side == WASTE else lead.side
        beyond = self._beyond(contour, path, after)

        def lead_of(length: float) -> Path:
            return lead_path(
                path, length, lead.shape, side, self._process.up, after=after, beyond=beyond
            )

        found = lead_of(length)
        judged = lead.shape == "arc" and lead.side == WASTE and contour.closed and self._cut[number]
        if not judged or self._process.of_layer(contour.layer).weave is not None:
            return found
        if self._fits(found, after):
            return found
        fits, too_long = 0.0, length
        for _ in range(SIDE_HALVINGS):
            middle = (fits + too_long) / 2
            in_scrap = self._fits(lead_of(middle), after)
            fits, too_long = (middle, too_long) if in_scrap else (fits, middle)
        called, kind = contour_called(contour, number), "lead-out" if after else "lead-in"
        where = f"{called} (layer {contour.layer})" if contour.layer else called
        if not fits:
            raise InvalidInput(
                f"{where}: no {kind} in the shape of an arc lies in the scrap where the contour "
                f"{'ends' if after else 'begins'}: choose another start point (process.begin).",
                needed=length,
                allowed=0.0,
            )
        if lead.length is not None:
            raise InvalidInput(
                f"{where}: a {kind} of {1e3 * length:.4g} mm crosses a contour or leaves the "
                f"scrap; the longest that fits is {1e3 * fits:.4g} mm.",
                needed=length,
                allowed=fits,
            )
        said = f"the {kind} of {where}: {1e3 * fits:.4g} in place of {1e3 * length:.4g} mm"
        self._shortened.append((fits / length, said))
        return lead_of(fits)

    @property
    def notes(self) -> tuple[str, ...]:
        """A sentence on leads that are shorter than the tool needs to reach its speed, if any."""
        if not self._shortened:
            return ()
        count = count_noun(len(self._shortened), "lead")
        return (
            "Leads are shorter than the tool needs to reach its speed, because longer ones cross a "
            f"contour or leave the scrap: {count}, most {min(self._shortened)[1]}.",
        )

    def _beyond(self, contour: Contour, path: Path, after: bool) -> FloatArray | None:
        """Unit tangent of a closed contour at the other side of the vertex that a lead touches."""
        own = contour.path
        # A contour with an overlap does not end at its start.
        if np.linalg.norm(own.end - own.starts[0]) > REPEATED_POINT:
            return None
        nearest = own.project(path(path.length if after else 0.0)[None])
        if nearest.distance[0] > 2 * REPEATED_POINT:
            return None
        s = float(own.breaks[np.argmin(np.abs(own.breaks - nearest.s[0]))])
        if abs(s - nearest.s[0]) > 2 * REPEATED_POINT:
            return None
        if after:
            return own(0.0 if s == own.length else s, 1)
        return own(s or own.length, 1, side="left")

    def _fits(self, lead: Path, after: bool) -> bool:
        """Whether a lead crosses no contour that is cut, and its free end lies in the scrap."""
        lead, up = lead.reversed() if after else lead, self._process.up
        cut = [x for x, kept in zip(self._contours, self._cut, strict=True) if kept]
        if self._around is None:
            tables = [_pieces(x.path, up) for x in cut]
            self._around = np.concatenate(tables), np.array([_box(x) for x in tables])
        pieces, boxes = self._around
        own = _pieces(lead, up)
        tip = own[0, :2]
        # No part of a piece or of the lead is farther from its start than its length.
        apart = np.linalg.norm(pieces[:, :2] - tip, axis=1)
        near = pieces[apart <= pieces[:, LENGTH] + lead.length + REPEATED_POINT]
        which, places = crossings(np.concatenate([own, near]))
        first = np.argmin(which, axis=1)[:, None]
        meets = (which.min(axis=1) < len(own)) & (which.max(axis=1) >= len(own))
        begins = np.cumsum(own[:, LENGTH]) - own[:, LENGTH]
        at = np.take_along_axis(places, first, 1)[meets, 0] + begins[which.min(axis=1)[meets]]
        if (at < (1 - CONTACT) * lead.length).any():
            return False
        held = np.nonzero(((boxes[:, 0] <= tip) & (tip <= boxes[:, 1])).all(axis=1))[0]
        holds = nest([*(cut[i] for i in held), Contour(path=lead)], up).holds
        return bool(holds[:, -1].sum() % 2 == 0)


def _box(pieces: FloatArray) -> FloatArray:
    """Corners of a box around pieces, (2, 2)."""
    starts, lengths = pieces[:, :2], pieces[:, LENGTH:]
    return np.stack([(starts - lengths).min(axis=0), (starts + lengths).max(axis=0)])


def _pieces(path: Path, up: FloatArray) -> FloatArray:
    """The table of pieces of `_crossings` of a path seen from above, (n, 6)."""
    chords = chords_of(path, up)
    a, chord, bent = chords[:, :2], chords[:, 2:4] - chords[:, :2], chords[:, 7] != 0
    curvatures = np.where(bent, chords[:, 7] / np.where(bent, chords[:, 6], 1.0), 0.0)
    out = (a - chords[:, 4:6]) * curvatures[:, None]
    lengths = np.linalg.norm(chord, axis=1)
    tangents = np.column_stack([-out[:, 1], out[:, 0]])
    tangents = np.where(bent[:, None], tangents, chord / lengths[:, None])
    half = np.arcsin(np.minimum(lengths * np.abs(curvatures) / 2, 1.0))
    return np.column_stack([a, tangents, curvatures, lengths / np.sinc(half / np.pi)])
