"""Order and direction of contours, and start points of closed contours."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import angle_between, exp, log, shortest
from armcontour.core.text import count_noun
from armcontour.geometry import Path
from armcontour.geometry.path import cut_path, start_at
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.program.moves import Contour, Event, Program, Value, contour_called
from armcontour.program.process import AUTO, DRAWN, TOOL_SIDES, Process

# A function that makes the contour of an option, and its first and last point [m], (2, dimension).
ContourOption = tuple[Callable[[], Contour], FloatArray]

# Number of start points that are tried per closed contour, unless the program has many contours.
MAX_STARTS = 24
# Smallest number to which the possible start points of a closed contour are reduced.
MIN_STARTS = 4
# If all contours together would have more start points than this, each has fewer than MAX_STARTS.
MAX_TOTAL_STARTS = 20_000
# The search for a short tour tries several first contours. This limits their number times the
# square of the contour count, and with it the time to about 0.5 s.
MAX_WORK = 20_000
# Smallest reduction of a tour that is no rounding error [m].
NO_GAIN = 1e-12
# Orientations at both ends of a contour that differ by less than this angle [rad] count as equal,
# because summed turns have rounding errors.
SAME_END_ORIENTATION = 1e-6
# Largest number of segments in a contour with its overlap, which repeats the contour's segments.
MAX_SEGMENTS = 1_000_000


def direct_contours(program: Program, process: Process) -> Program:
    """Reverse closed contours that run against the process's direction of travel."""
    contours = program.contours
    directions = [process.of_contour(x).direction if x.closed else DRAWN for x in contours]
    if all(x == DRAWN for x in directions):
        return program
    from armcontour.program.kerf import waste_sides
    from armcontour.program.nesting import find_nesting

    areas = find_nesting(contours, process.up).areas
    sides = waste_sides(contours, process)
    reversed_contours: dict[Contour, Contour] = {}
    for i, (contour, direction) in enumerate(zip(contours, directions, strict=True)):
        if direction in TOOL_SIDES:
            must_reverse = sides[i] != TOOL_SIDES[direction]
        else:
            is_counterclockwise = direction == "counterclockwise"
            must_reverse = direction != DRAWN and (areas[i] > 0) != is_counterclockwise
        if not must_reverse:
            continue
        end = contour.path.length - REPEATED_POINT
        inner_events = [event for event in contour.events if REPEATED_POINT < event.s < end]
        if inner_events:
            raise InvalidInput(
                f"{contour_called(contour, i)} cannot run backwards for the direction {direction}, "
                f"because its event {inner_events[0].name} is not at an end. Specify direction: "
                "drawn, also for its layer."
            )
        reversed_contours[contour] = _reverse_contour(contour)
    moves = tuple(
        reversed_contours.get(x, x) if isinstance(x, Contour) else x for x in program.moves
    )
    return replace(program, moves=moves)


def order_contours(program: Program, process: Process) -> Program:
    """Sort the contours of a program by the order of the process.

    For a shorter tour, a contour can start at another point or run backwards; later steps do not
    change this start. A note reports a contour that is cut before a contour inside it.
    """
    order = process.order
    contours = program.contours
    if order == "auto":
        drawing = all(isinstance(x, Contour) for x in program.moves)
        order = "inside_first" if process.cuts and drawing else "drawn"
    orders = sorted({x.order for x in contours})
    if order == "drawn" and len(orders) == 1:
        return _add_order_note(program, process)
    for move in program.moves:
        if not isinstance(move, Contour):
            raise InvalidInput(
                f"The order {order if len(orders) == 1 else orders[-1]!r} is for drawings only. "
                "This program has rapids, dwells or events between its contours, so its order must "
                "not change. Specify order: drawn, and remove the order of single contours."
            )
    if len(contours) == 1:
        return program
    if len(orders) > 1:
        groups = [[x for x in contours if x.order == number] for number in orders]
        arranged = [order_contours(replace(program, moves=tuple(x)), process) for x in groups]
        sorted_contours = itertools.chain.from_iterable(x.contours for x in arranged)
        joined = replace(program, moves=tuple(sorted_contours))
        return _add_order_note(joined, process)
    from armcontour.program.nesting import find_nesting

    parents = find_nesting(contours, process.up).parents
    if order == "inside_first":
        moves = [contours[i] for i in _order_inside_first(parents)]
        return replace(program, moves=tuple(moves))
    choices = _Choices.from_contours(contours, process, free=order == "shortest")
    tour, option = (choices.nearest if order == "nearest" else choices.shortest)(parents)
    return replace(program, moves=tuple(choices.makers[option[i]]() for i in tour))


def _add_order_note(program: Program, process: Process) -> Program:
    """Add a note to the program if a contour is cut before a contour inside it."""
    contours = program.contours
    if not process.cuts or len(contours) == 1:
        return program
    from armcontour.program.nesting import find_nesting

    parents = find_nesting(contours, process.up).parents
    misordered = [i for i, x in enumerate(parents.tolist()) if 0 <= x < i]
    if not misordered:
        return program
    i = misordered[0]
    count = len(misordered) - 1
    suffix = f" (likewise {count_noun(count, 'more inner contour')})" if count else ""
    outer = int(parents[i])
    note = (
        f"{contour_called(contours[outer], outer)} is cut before {contour_called(contours[i], i)}, "
        f"which lies inside it and may drop out or move before it is cut{suffix}. The order "
        "inside_first cuts inner contours first."
    )
    return replace(program, notes=(*program.notes, note))


def _order_inside_first(parents: IntArray) -> list[int]:
    """Return indices in drawn order, but each contour after all contours inside it."""
    children: dict[int, list[int]] = {}
    for i, parent in enumerate(parents.tolist()):
        children.setdefault(parent, []).append(i)
    order: list[int] = []
    pending = list(children.get(-1, ()))[::-1]
    while pending:
        i = pending.pop()
        inner = children.pop(i, None)
        if inner is None:
            order.append(i)
        else:
            pending += [i, *inner[::-1]]
    return order


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Choices:
    """The m options of n contours: start points of closed contours, directions of open ones."""

    makers: list[Callable[[], Contour]]  # Functions that make the contour of each option
    ends: FloatArray  # First and last points of the options [m], (m, 2, 3)
    first: IntArray  # Index of the first option of every contour, followed by m, (n + 1,)
    swapped: IntArray  # Index of the option with swapped ends, or of the same option, (m,)

    @classmethod
    def from_contours(
        cls, contours: tuple[Contour, ...], process: Process, *, free: bool
    ) -> _Choices:
        """Make the options of contours; with `free`, a closed contour has several start points."""
        start_count = int(np.clip(MAX_TOTAL_STARTS // len(contours), MIN_STARTS, MAX_STARTS))
        makers: list[Callable[[], Contour]] = []
        ends: list[FloatArray] = []
        first = [0]
        swapped = list[int]()
        for contour in contours:
            options = _options(contour, process, start_count if free else 1)
            makers += [option[0] for option in options]
            ends += [option[1] for option in options]
            indices = range(first[-1], len(makers))
            swapped += indices if contour.closed else indices[::-1]
            first.append(len(makers))
        table = np.zeros((len(ends), 2, 3))
        table[:, :, : contours[0].path.dimension] = ends
        return cls(
            makers=makers,
            ends=table,
            first=np.array(first),
            swapped=np.array(swapped),
        )

    def nearest(self, parents: IntArray, start: int = 0) -> tuple[IntArray, IntArray]:
        """Return the order of a tour through the nearest contours, and its options, (n,) each.

        The tour starts with the first permitted contour from the index `start` on, and continues
        with the nearest permitted one. A contour is permitted after all contours inside it. The
        second result is the option of each contour, by the index of the contour.

        - `parents`: index of the smallest contour around each contour, -1 for outer ones, (n,).
        """
        from scipy.spatial.distance import cdist

        n = len(self.first) - 1
        first = self.first
        entries, exits = self.ends.swapaxes(0, 1)
        owners = np.repeat(np.arange(n), np.diff(first))
        # Number of contours inside each contour that are not yet in the tour.
        open_children = np.bincount(parents[parents >= 0], minlength=n)
        # Entries of the contours that may be next; infinite for other contours.
        permitted_entries = np.where((open_children == 0)[owners, None], entries, np.inf)
        tour = np.empty(n, dtype=np.intp)
        option = first[:-1].copy()
        for k in range(n):
            if k:
                last = option[tour[k - 1]]
                distances = cdist(exits[last : last + 1], permitted_entries, "sqeuclidean")
                nearest = int(np.argmin(distances))
                contour = owners[nearest]
                option[contour] = nearest
            else:
                contour = (np.argmin(np.roll(open_children, -start)) + start) % n
            tour[k] = contour
            permitted_entries[first[contour] : first[contour + 1]] = np.inf
            parent = parents[contour]
            if parent >= 0:
                open_children[parent] -= 1
                if not open_children[parent]:
                    rows = slice(first[parent], first[parent + 1])
                    permitted_entries[rows] = entries[rows]
        return tour, option

    def shortest(self, parents: IntArray) -> tuple[IntArray, IntArray]:
        """Return the order and the options of a short tour, (n,) each; see `nearest`.

        Tours through the nearest contours from several first contours are improved by 2-opt.
        """
        best = (np.array([]), np.array([]))
        shortest = np.inf
        n = len(self.first) - 1
        for start in range(max(1, min(n, MAX_WORK // n**2))):
            tour, option = self.nearest(parents, start)
            length = np.inf
            while (reduced := self._length(tour, option)) < length - NO_GAIN:
                length = reduced
                self._reverse_parts(tour, option, parents)
                option = self._best_options(tour)
            if length < shortest - NO_GAIN:
                best = (tour, option)
                shortest = length
        return best

    def _reverse_parts(self, tour: IntArray, option: IntArray, parents: IntArray) -> None:
        """Reverse parts of a tour in place until no reversal makes it shorter (2-opt).

        - `option`: option of each contour, changed in place, (n,).
        - `parents`: as in `nearest`.
        """
        n = len(tour)
        i = 0
        failures = 0
        position = np.empty(n, np.intp)
        while failures < n:
            if not failures:
                # Ends of the contours in the tour and, in reversed parts, with swapped ends. A part
                # may be reversed if no contour in it lies inside another one in it.
                start, end = self.ends[option[tour]].swapaxes(0, 1)
                start_back, end_back = self.ends[self.swapped[option[tour]]].swapaxes(0, 1)
                gaps = np.append(np.linalg.norm(start[1:] - end[:-1], axis=1), 0.0)
                ahead = np.append(0.0, np.cumsum(gaps[:-1]))
                back = np.linalg.norm(start_back[:-1] - end_back[1:], axis=1)
                back = np.append(0.0, np.cumsum(back))
                position[tour] = np.arange(n)
                outer = np.where(parents[tour] >= 0, position[parents[tour]], n)
                last = np.minimum.accumulate(outer[::-1])[::-1]
            # Reduction of the tour's length for each part that starts at i.
            part = slice(i, last[i])
            gain = ahead[part] - ahead[i] - back[part] + back[i] + gaps[part]
            after = np.linalg.norm(start[i + 1 : last[i] + 1] - end_back[i], axis=1)
            gain[: len(after)] -= after
            if i:
                gain += gaps[i - 1] - np.linalg.norm(start_back[part] - end[i - 1], axis=1)
            j = i + int(np.argmax(gain))
            if gain[j - i] > NO_GAIN:
                option[tour[i : j + 1]] = self.swapped[option[tour[i : j + 1]]]
                tour[i : j + 1] = tour[i : j + 1][::-1].copy()
                failures = 0
            else:
                failures += 1
            i = (i + 1) % n

    def _length(self, tour: IntArray, option: IntArray) -> float:
        """Return the length of a tour's straight links between contours [m]."""
        ends = self.ends[option[tour]]
        return float(np.linalg.norm(ends[1:, 0] - ends[:-1, 1], axis=1).sum())

    def _best_options(self, tour: IntArray) -> IntArray:
        """Choose the option of each contour for the shortest tour, by dynamic programming, (n,)."""
        from scipy.spatial.distance import cdist

        first = self.first
        entries, exits = self.ends.swapaxes(0, 1)
        slices = [slice(first[c], first[c + 1]) for c in tour]
        length = np.zeros(slices[0].stop - slices[0].start)
        # Best option of the previous contour for each option of the next one.
        best_previous = []
        for previous, current in itertools.pairwise(slices):
            lengths = length[:, None] + cdist(exits[previous], entries[current])
            best_previous.append(np.argmin(lengths, axis=0))
            length = lengths.min(axis=0)
        chosen = [int(np.argmin(length))]
        for previous_option in reversed(best_previous):
            chosen.append(int(previous_option[chosen[-1]]))
        option = np.empty(len(tour), np.intp)
        option[tour] = first[tour] + chosen[::-1]
        return option


def _options(contour: Contour, process: Process, count: int) -> list[ContourOption]:
    """List the options of a contour; a closed contour has at most `count`."""
    path = contour.path

    if not contour.closed:
        return [(lambda: contour, path([0.0, path.length]))]
    if count == 1 or process.begin != "auto" or keeps_drawn_start(contour, led=False):
        starts = [find_start(contour, process, led=False)]
        makers: Sequence[Callable[[], Contour]] = [lambda: contour]
    else:
        starts = find_start_candidates(path, count).tolist()
        makers = [partial(_fix_start, contour, s) for s in starts]
    overlap = process.of_contour(contour).overlap
    return [
        (maker, path([s, (s + overlap) % path.length]))
        for maker, s in zip(makers, starts, strict=True)
    ]


def _fix_start(contour: Contour, start: float) -> Contour:
    """Start a closed contour at an arc length [m], and keep this start."""
    return replace(move_start(contour, start, {}), keep_start=True)


def _reverse_contour(contour: Contour) -> Contour:
    """Reverse the path of a contour without inner events; the events keep their arc lengths."""
    work = contour.work
    if work is not None:
        work = contour.path.length - work[1], contour.path.length - work[0]
    return replace(contour, path=contour.path.reversed(), work=work)


def find_start_candidates(path: Path, count: int) -> FloatArray:
    """Return arc lengths at which a closed path may start [m], away from its corners.

    Between two corners, all candidates lie in the middle half, so both corners can be rounded.
    """
    length = path.length
    closing = np.linalg.norm(path(0.0, 1) - path(length, 1, side="left")) > TANGENT_TOLERANCE
    corners = path.breaks[1:-1][path.turns > TANGENT_TOLERANCE]
    corners = np.concatenate([[0.0], corners]) if closing else corners
    if not len(corners):
        return np.linspace(0.0, length, count, endpoint=False)
    smooth = np.diff(np.append(corners, corners[0] + length))
    longest = np.sort(np.argsort(-smooth, kind="stable")[:count])
    starts = []
    for i in longest.tolist():
        parts = max(1, int(count * smooth[i] / length))
        shares = 0.25 + 0.5 * (np.arange(parts) + 0.5) / parts
        starts.append(corners[i] + shares * smooth[i])
    return np.concatenate(starts) % length


def close_contour(
    contour: Contour, process: Process, *, led: bool, outputs: Mapping[str, Value]
) -> Contour:
    """Add the start point, the laps and the overlap of the process to a closed contour.

    An automatic start keeps the drawn start point if the contour's `keep_start` is true, a rapid,
    dwell or event leads to the contour, the contour has events, or its end orientations differ.

    - `contour`: the contour, which ends at its start point.
    - `led`: true if a rapid, dwell or event of the program leads to the start of the contour.
    - `outputs`: values before the contour.
    """
    start = find_start(contour, process, led=led)
    lap = contour.path.length
    extra_length = (process.passes - 1) * lap + process.overlap
    if extra_length > REPEATED_POINT:
        _check_end_orientations(contour)
    contour = move_start(contour, start, outputs)
    longer = _add_overlap(contour.path, extra_length)
    slack = REPEATED_POINT
    last = longer.length
    # Events at the drawn end move to the end of the overlap.
    moved = [replace(x, s=last) if x.s >= lap - slack else x for x in contour.events]
    # Events between both ends are repeated in every lap.
    along = [x for x in contour.events if slack < x.s < lap - slack]
    repeated: list[Event] = []
    for k in range(1, process.passes):
        repeated += [replace(x, s=x.s + k * lap) for x in along]
    events = (*moved, *repeated)
    return replace(contour, path=longer, events=events, ring=True)


def keeps_drawn_start(contour: Contour, *, led: bool) -> bool:
    """Return whether a closed contour automatically starts at its drawn start (`close_contour`)."""
    return (
        contour.keep_start
        or led
        or bool(contour.events)
        or not _has_equal_end_orientations(contour.path)
    )


def find_start(contour: Contour, process: Process, *, led: bool) -> float:
    """Find the arc length at which a closed contour starts [m]; see `close_contour`."""
    path = contour.path
    begin = process.begin
    if begin == DRAWN or (begin == AUTO and keeps_drawn_start(contour, led=led)):
        return 0.0
    if isinstance(begin, tuple):
        point = np.array(begin)
        if len(point) != path.dimension:
            raise InvalidInput(
                f"begin is a point of {len(point)} coordinates, but contours have {path.dimension}."
            )
        return float(path.project(point[None]).s[0])
    if isinstance(begin, float):
        return begin % path.length
    last = slice(len(path) - 1, None)
    end_tangent = path.segments.evaluate(last, path.lengths[last], 1)[0]
    if np.linalg.norm(path.tangents[0] - end_tangent) <= TANGENT_TOLERANCE:
        return 0.0
    longest = int(np.argmax(path.lengths))
    return float(path.breaks[longest] + path.lengths[longest] / 2)


def move_start(contour: Contour, start: float, outputs: Mapping[str, Value]) -> Contour:
    """Move the start point of a closed contour to an arc length of the drawn contour [m].

    - `outputs`: values of the outputs before the contour.
    """
    path = contour.path
    if start <= REPEATED_POINT or path.length - start <= REPEATED_POINT:
        return contour
    _check_end_orientations(contour)
    _check_switching(contour, start, outputs)
    return replace(
        contour,
        path=start_at(path, start),
        events=tuple(_move_event(x, start, path.length) for x in contour.events),
    )


def _check_end_orientations(contour: Contour) -> None:
    """Raise InvalidInput if the tool orientations at both ends of a closed contour differ."""
    if not _has_equal_end_orientations(contour.path):
        raise InvalidInput(
            f"{contour_called(contour, 0) if contour.name else 'A closed contour'} ends at its "
            "start point with another tool orientation, so the tool cannot continue there. Specify "
            "the same orientation at both ends, or remove begin and overlap."
        )


def _has_equal_end_orientations(path: Path) -> bool:
    """Return whether the tool orientations at both ends of a closed path are equal."""
    orientation = path.orientation
    if orientation is None:
        return True
    if orientation.fixed and len(orientation) == 1 and not orientation.follows:
        return True
    end = orientation(path.length, side="left")
    start = orientation(0.0)
    if orientation.follows:
        # At a corner the tool turns with the tangent.
        turn = shortest(path(path.length, 1, side="left"), path(0.0, 1))
        end = exp(turn) @ end
    if orientation.axis_only:
        return bool(angle_between(end[:, 2], start[:, 2]) <= SAME_END_ORIENTATION)
    return bool(np.linalg.norm(log(start @ end.T)) <= SAME_END_ORIENTATION)


def _add_overlap(path: Path, overlap: float) -> Path:
    """Continue a closed path past its end by the overlap [m], with several laps if needed."""
    rounds = overlap / path.length
    if rounds * len(path) > MAX_SEGMENTS:
        raise InvalidInput(
            f"Overlap and further passes of {overlap:g} m are {rounds:.3g} laps of a contour of "
            f"{path.length:.4g} m and need more than {MAX_SEGMENTS} segments. Specify a shorter "
            "overlap or fewer passes."
        )
    parts = list[Path]()
    remaining = overlap
    while remaining > REPEATED_POINT:
        step = min(remaining, path.length)
        parts.append(path if step == path.length else cut_path(path, 0.0, step))
        remaining -= step
    return path.joined(*parts)


def _check_switching(contour: Contour, start: float, outputs: Mapping[str, Value]) -> None:
    """Raise InvalidInput if an output differs between the new start point and the drawn ends."""
    inner = {x.name for x in contour.events if 0 < x.s < contour.path.length - REPEATED_POINT}
    for name in sorted(inner):
        events = [x for x in contour.events if x.name == name]
        # An output that the program has not switched before is off, unless it is switched off.
        initial = outputs.get(name, not events[0].value)
        values = {events[-1].value}
        for s in (REPEATED_POINT, start):
            values.add(next((x.value for x in reversed(events) if x.s <= s), initial))
        if len(values) > 1:
            raise InvalidInput(
                f"{contour_called(contour, 0) if contour.name else 'A closed contour'} switches "
                f"{name} along its path. If it started at {start:g} m, parts of the path would "
                f"have another value of {name} than drawn. Remove begin.",
                s=start,
            )


def _move_event(event: Event, start: float, length: float) -> Event:
    """Move an event to its contour's new start point; events at the ends stay there."""
    if event.s <= REPEATED_POINT or event.s >= length - REPEATED_POINT:
        return replace(event, s=0.0 if event.s <= REPEATED_POINT else length)
    return replace(event, s=(event.s - start) % length)
