"""The order of contours, and where closed ones begin for the sake of the order."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import angle_between, exp, log, shortest
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.geometry.cutting import cut_path, join_paths
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.program.moves import Contour, Event, Program, contour_called
from armcontour.program.process import AUTO, DRAWN, TOOL_SIDES, Process

# What makes the contour of an option, and its first and last point [m], (2, dimension).
Option = tuple[Callable[[], Contour], FloatArray]

# Places at which a closed contour may begin; fewer where all contours have more than MOST_PLACES.
PLACES, FEWEST_PLACES, MOST_PLACES = 24, 4, 20_000
# Neighbours of a contour that moves of the search bring next to it.
NEIGHBOURS = 10
# Exchanges from which the search goes on: per contour, at least, and the most of exchanges times
# contours, which bounds the time of the search to a few seconds.
# Without exchanges, tours of 6 to 100 random contours are 0.6 to 15 % longer on average.
TRIES, LEAST_TRIES, MOST_WORK = 3, 200, 1_000_000
# Orientations at both ends of a contour that differ by less than this count as equal: summed turns
# have rounding errors [rad].
SAME_HOLD = 1e-6
# Largest number of segments of a contour with its overlap, which repeats the contour's segments.
MOST_SEGMENTS = 1_000_000


def direct_contours(program: Program, process: Process) -> Program:
    """The program with its closed contours in the direction of travel of the process.

    Raises:
        InvalidInput: A contour that would run backwards has events on its way.
    """
    contours = program.contours
    wanted = [process.of_layer(x.layer).direction if x.closed else DRAWN for x in contours]
    if all(x == DRAWN for x in wanted):
        return program
    from armcontour.program.kerf import waste_sides
    from armcontour.program.nesting import nest

    areas, sides = nest(contours, process.up).areas, waste_sides(contours, process)
    turned: dict[Contour, Contour] = {}
    for i, (x, how) in enumerate(zip(contours, wanted, strict=True)):
        if how in TOOL_SIDES:
            back = sides[i] != TOOL_SIDES[how]
        else:
            back = how != DRAWN and (areas[i] > 0) != (how == "counterclockwise")
        if not back:
            continue
        inner = [y for y in x.events if REPEATED_POINT < y.s < x.path.length - REPEATED_POINT]
        if inner:
            raise InvalidInput(
                f"{contour_called(x, i)} cannot run backwards for the direction {how}, because it "
                f"switches {inner[0].name} on its way: give direction drawn, for its layer too."
            )
        turned[x] = _backwards(x)
    moves = tuple(turned.get(x, x) if isinstance(x, Contour) else x for x in program.moves)
    return dataclasses.replace(program, moves=moves)


def order_contours(program: Program, process: Process) -> Program:
    """The program with its contours in the order of the process.

    Contours that begin elsewhere or run backwards for a shorter way are changed accordingly, and
    keep this start. A note says how long the ways between contours are, and which contour is cut
    before one that it holds.

    Raises:
        InvalidInput: A given order for a program with rapids, dwells or events.
    """
    order = process.order
    if order == "auto":
        drawing = all(isinstance(x, Contour) for x in program.moves)
        order = "inside_first" if process.cuts and drawing else "drawn"
    if order == "drawn":
        return _with_warning(program, process)
    for x in program.moves:
        if not isinstance(x, Contour):
            raise InvalidInput(
                f"The order {order!r} is for drawings: this program has rapids, dwells or events "
                "between its contours, whose order has a meaning."
            )
    contours = program.contours
    if len(contours) == 1:
        return program
    from armcontour.program.nesting import nest

    inner_first = order == "inside_first" or process.cuts
    parents = nest(contours, process.up).parents if inner_first else np.full(len(contours), -1)
    if order == "inside_first":
        moves = [contours[i] for i in _inside_first(parents)]
        return dataclasses.replace(program, moves=tuple(moves))
    choices = _Choices.of(contours, process, free=order == "shortest")
    if order == "nearest":
        return dataclasses.replace(program, moves=choices.taken(*choices.nearest(parents)))
    tour, option = choices.shortest(parents)
    remarks = (*program.remarks, choices.describe(tour, option))
    return dataclasses.replace(program, moves=choices.taken(tour, option), remarks=remarks)


def _with_warning(program: Program, process: Process) -> Program:
    """The program as it is; with a note if a contour is cut before one that it holds."""
    contours = program.contours
    if not process.cuts or len(contours) == 1:
        return program
    from armcontour.program.nesting import nest

    parents = nest(contours, process.up).parents
    late = [i for i, x in enumerate(parents.tolist()) if 0 <= x < i]
    if not late:
        return program
    i = late[0]
    more = f"; so are {len(late) - 1} more" if len(late) > 1 else ""
    outer = int(parents[i])
    note = (
        f"{contour_called(contours[outer], outer)} is cut before "
        f"{contour_called(contours[i], i)}, which lies in it and may have dropped out or moved by "
        f"then{more}: the order inside_first cuts what lies inside first."
    )
    return dataclasses.replace(program, notes=(*program.notes, note))


def _inside_first(parents: IntArray) -> list[int]:
    """The drawn order, but each contour directly after all that it holds."""
    held: dict[int, list[int]] = {}
    for i, x in enumerate(parents.tolist()):
        held.setdefault(x, []).append(i)
    found: list[int] = []
    open_ones = list(held.get(-1, ()))[::-1]
    while open_ones:
        i = open_ones.pop()
        inner = held.pop(i, None)
        if inner is None:
            found.append(i)
        else:
            open_ones += [i, *inner[::-1]]
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Choices:
    """Where each contour may begin and end.

    Args:
        contours: The contours as they are drawn.
        made: Makes the contour of each option.
        ends: First and last points of the options [m], (m, 2, 3).
        first: Index of the first option of every contour, and m, (n + 1,).
    """

    contours: tuple[Contour, ...]
    made: list[Callable[[], Contour]]
    ends: FloatArray
    first: IntArray

    @classmethod
    def of(cls, contours: tuple[Contour, ...], process: Process, *, free: bool) -> _Choices:
        """The options of contours; `free` contours may begin at several places."""
        count = int(np.clip(MOST_PLACES // len(contours), FEWEST_PLACES, PLACES))
        made: list[Callable[[], Contour]] = []
        ends: list[FloatArray] = []
        first = [0]
        for x in contours:
            found = _options(x, process, count if free else 1)
            made += [option[0] for option in found]
            ends += [option[1] for option in found]
            first.append(len(made))
        table = np.zeros((len(ends), 2, 3))
        table[:, :, : contours[0].path.dimension] = ends
        return cls(contours=contours, made=made, ends=table, first=np.array(first))

    def nearest(self, parents: IntArray) -> tuple[IntArray, IntArray]:
        """The tour that begins as drawn and goes on to the nearest contour."""
        from scipy.spatial.distance import cdist

        n, (exits, entries, first) = len(self.contours), self._options
        owners = np.repeat(np.arange(n), np.diff(first))
        waits = np.bincount(parents[parents >= 0], minlength=n)
        # Entries of contours that may come next.
        near = np.where((waits == 0)[owners, None], entries, np.inf)
        tour, option = np.empty(n, dtype=np.intp), first[:-1].copy()
        for k in range(n):
            if k:
                last = option[tour[k - 1]]
                nearest = int(np.argmin(cdist(exits[last : last + 1], near, "sqeuclidean")))
                option[owners[nearest]] = nearest
            c = tour[k] = owners[nearest] if k else np.argmin(waits)
            near[first[c] : first[c + 1]] = np.inf
            parent = parents[c]
            if parent >= 0:
                waits[parent] -= 1
                if not waits[parent]:
                    own = slice(first[parent], first[parent + 1])
                    near[own] = entries[own]
        return tour, option

    def shortest(self, parents: IntArray) -> tuple[IntArray, IntArray]:
        """A short tour: 2-opt and Or-opt moves, repeated from many exchanges of parts."""
        from armcontour.program._tours import Options, search

        tour, _ = self.nearest(parents)
        n, option = len(tour), self._best_options(tour)
        tries = min(max(TRIES * n, LEAST_TRIES), MOST_WORK // n)
        # Numbers of a fixed sequence, so that the same program has the same order.
        numbers = (np.random.PCG64(0).random_raw((tries, 4)) >> np.uint64(32)).astype(np.intp)
        search(Options(*self._options), parents, self._neighbours(), tour, option, numbers)
        return tour, self._best_options(tour)

    def _best_options(self, tour: IntArray) -> IntArray:
        """The options with which a tour is the shortest in its order, by dynamic programming."""
        from scipy.spatial.distance import cdist

        exits, entries, first = self._options
        own = [slice(first[c], first[c + 1]) for c in tour]
        length, before = np.zeros(own[0].stop - own[0].start), []
        for last, now in itertools.pairwise(own):
            lengths = length[:, None] + cdist(exits[last], entries[now])
            before.append(np.argmin(lengths, axis=0))
            length = lengths.min(axis=0)
        chosen = [int(np.argmin(length))]
        for k in reversed(before):
            chosen.append(int(k[chosen[-1]]))
        option = np.empty(len(tour), np.intp)
        option[tour] = first[tour] + chosen[::-1]
        return option

    @property
    def _options(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Exits and entries of all options, and the first option of every contour."""
        entries, exits = (np.ascontiguousarray(self.ends[:, k]) for k in (0, 1))
        return exits, entries, self.first

    def _neighbours(self) -> IntArray:
        """The nearest contours of every contour, by their ends, (n, k)."""
        from armcontour.geometry.near_points import nearest_points

        n = len(self.contours)
        k = min(NEIGHBOURS, n - 1)
        owners = np.repeat(np.arange(n), np.diff(self.first) * 2)
        points = self.ends.reshape(-1, 3)
        centers = np.array([points[owners == i].mean(axis=0) for i in range(n)])
        most_places = int(np.diff(self.first).max()) * 2
        near = owners[nearest_points(centers, points, min(len(points), most_places * (k + 1)))]
        # Where too few contours are near, the first ones of all.
        found = (dict.fromkeys([*row, *range(k + 1)]) for row in near.tolist())
        return np.array([[x for x in row if x != i][:k] for i, row in enumerate(found)])

    def describe(self, tour: IntArray, option: IntArray) -> str:
        """A sentence on the length of a tour."""

        def length_of(options: IntArray) -> float:
            links = self.ends[options[1:], 0] - self.ends[options[:-1], 1]
            return float(np.linalg.norm(links, axis=1).sum())

        length, drawn = length_of(option[tour]), length_of(self.first[:-1])
        return (
            "In the order shortest, the straight ways between contours have "
            f"{number(length, 'm')} in all ({number(drawn, 'm')} in the order of the file)."
        )

    def taken(self, tour: IntArray, option: IntArray) -> tuple[Contour, ...]:
        """The contours of a tour."""
        return tuple(self.made[option[i]]() for i in tour)


def _options(contour: Contour, process: Process, count: int) -> list[Option]:
    """The options of a contour; a closed one has at most `count`."""
    path = contour.path

    as_drawn = partial(_same, contour)
    if not contour.closed:
        found: list[Option] = [(as_drawn, path([0.0, path.length]))]
        if process.reverse_open and not contour.keep_start and not contour.events:
            found.append((partial(_backwards, contour), found[0][1][::-1]))
        return found
    if count == 1 or process.begin != "auto" or keeps_drawn_start(contour, led=False):
        places = [find_start(contour, process, led=False)]
        makers: Sequence[Callable[[], Contour]] = [as_drawn]
    else:
        places = begin_places(path, count).tolist()
        makers = [partial(_begun_at, contour, s) for s in places]
    overlap = process.of_layer(contour.layer).overlap
    return [
        (maker, path([s, (s + overlap) % path.length]))
        for maker, s in zip(makers, places, strict=True)
    ]


def _same(contour: Contour) -> Contour:
    """The contour as it is drawn."""
    return contour


def _begun_at(contour: Contour, start: float) -> Contour:
    """A closed contour that begins at an arc length [m], and keeps this start."""
    return dataclasses.replace(begin_at(contour, start), keep_start=True)


def _backwards(contour: Contour) -> Contour:
    """A contour without events on its way, run from its end."""
    work = contour.work
    if work is not None:
        work = contour.path.length - work[1], contour.path.length - work[0]
    return dataclasses.replace(contour, path=contour.path.reversed(), work=work)


def begin_places(path: Path, count: int) -> FloatArray:
    """Arc lengths at which a closed path may begin [m], away from its corners.

    Between two corners these lie in the middle half, so that both corners can be rounded.

    Args:
        path: The closed path.
        count: Largest number of places.
    """
    length = path.length
    closing = np.linalg.norm(path(0.0, 1) - path(length, 1, side="left")) > TANGENT_TOLERANCE
    corners = path.breaks[1:-1][path.turns > TANGENT_TOLERANCE]
    corners = np.concatenate([[0.0], corners]) if closing else corners
    if not len(corners):
        return np.linspace(0.0, length, count, endpoint=False)
    smooth = np.diff(np.append(corners, corners[0] + length))
    longest = np.sort(np.argsort(-smooth, kind="stable")[:count])
    found = []
    for i in longest.tolist():
        parts = max(1, int(count * smooth[i] / length))
        shares = 0.25 + 0.5 * (np.arange(parts) + 0.5) / parts
        found.append(corners[i] + shares * smooth[i])
    return np.concatenate(found) % length


def close_contour(contour: Contour, process: Process, *, led: bool) -> Contour:
    """A closed contour with the start point, the laps and the overlap of the process.

    An automatic start keeps the drawn start point if the contour's `keep_start` is true, a rapid,
    dwell or event leads to the contour, the contour has events, or its end orientations differ.

    Args:
        contour: The contour, which ends at its start point.
        process: Start point, passes and overlap.
        led: Whether a rapid, dwell or event of the program leads to the start of the contour.

    Raises:
        InvalidInput: A new start point or an overlap, though the tool orientations at the ends
            differ; a new start point that changes what is switched on along the contour; a start
            point of another dimension; or an overlap with too many segments.
    """
    start = find_start(contour, process, led=led)
    lap = contour.path.length
    more = (process.passes - 1) * lap + process.overlap
    if more > REPEATED_POINT:
        _refuse_turned_end(contour)
    contour = begin_at(contour, start)
    longer = _add_overlap(contour.path, more)
    events = (
        *_move_last_events(contour.events, lap, longer.length),
        *_repeat_events(contour.events, lap, process.passes),
    )
    return dataclasses.replace(contour, path=longer, events=events, ring=True)


def keeps_drawn_start(contour: Contour, *, led: bool) -> bool:
    """Whether an automatic start of a closed contour is the drawn one, as in `close_contour`."""
    return (
        contour.keep_start
        or led
        or bool(contour.events)
        or not _has_equal_end_orientations(contour.path)
    )


def find_start(contour: Contour, process: Process, *, led: bool) -> float:
    """Arc length at which a closed contour begins [m], as in `close_contour`."""
    keeps = process.begin == AUTO and keeps_drawn_start(contour, led=led)
    return _find_start(contour.path, DRAWN if keeps else process.begin)


def begin_at(contour: Contour, start: float) -> Contour:
    """A closed contour that begins at an arc length [m] of the drawn one.

    Raises:
        InvalidInput: As in `close_contour`.
    """
    path = contour.path
    if start <= REPEATED_POINT or path.length - start <= REPEATED_POINT:
        return contour
    _refuse_turned_end(contour)
    _refuse_cut_switching(contour, start)
    return dataclasses.replace(
        contour,
        path=join_paths([cut_path(path, start, path.length), cut_path(path, 0.0, start)]),
        events=tuple(_move_event(x, start, path.length) for x in contour.events),
    )


def _refuse_turned_end(contour: Contour) -> None:
    """Refuse a closed contour that ends with another tool orientation than it begins with."""
    if not _has_equal_end_orientations(contour.path):
        raise InvalidInput(
            f"{contour_called(contour, 0) if contour.name else 'A closed contour'} ends at its "
            "start point with another tool orientation, so that the tool cannot continue there: "
            "give both ends the same orientation, or leave out begin and overlap."
        )


def _move_last_events(events: tuple[Event, ...], drawn: float, end: float) -> tuple[Event, ...]:
    """Move events at the drawn end of a contour [m] to the end of its overlap [m]."""
    return tuple(
        dataclasses.replace(x, s=end) if x.s >= drawn - REPEATED_POINT else x for x in events
    )


def _repeat_events(events: tuple[Event, ...], lap: float, passes: int) -> list[Event]:
    """Events along the first lap of a contour [m], on the laps after it."""
    along = [x for x in events if REPEATED_POINT < x.s < lap - REPEATED_POINT]
    return [dataclasses.replace(x, s=x.s + k * lap) for k in range(1, passes) for x in along]


def _has_equal_end_orientations(path: Path) -> bool:
    """Whether the tool orientations at both ends of a closed path are equal."""
    orientation = path.orientation
    if orientation is None:
        return True
    if orientation.fixed and len(orientation) == 1 and not orientation.follows:
        return True
    end, start = orientation(path.length, side="left"), orientation(0.0)
    if orientation.follows:
        # At a corner the tool turns with the tangent.
        corner = shortest(path(path.length, 1, side="left"), path(0.0, 1))
        end = exp(corner) @ end
    if orientation.axis_only:
        return bool(angle_between(end[:, 2], start[:, 2]) <= SAME_HOLD)
    return bool(np.linalg.norm(log(start @ end.T)) <= SAME_HOLD)


def _add_overlap(path: Path, overlap: float) -> Path:
    """A closed path continued past its end by the overlap [m], several times around if needed.

    Raises:
        InvalidInput: The path gets more than MOST_SEGMENTS segments.
    """
    rounds = overlap / path.length
    if rounds * len(path) > MOST_SEGMENTS:
        raise InvalidInput(
            f"Overlap and further passes of {overlap:g} m go {rounds:.3g} times around a contour "
            f"of {path.length:.4g} m, which makes more than {MOST_SEGMENTS} segments: take a "
            "shorter overlap or fewer passes."
        )
    parts, rest = [path], overlap
    while rest > REPEATED_POINT:
        more = min(rest, path.length)
        parts.append(path if more == path.length else cut_path(path, 0.0, more))
        rest -= more
    return join_paths(parts)


def _refuse_cut_switching(contour: Contour, start: float) -> None:
    """Refuse a new start point that would change where an output is switched on along a contour.

    Raises:
        InvalidInput: An output has another value at the drawn start or the new start than at the
            drawn end.
    """
    inner = {x.name for x in contour.events if 0 < x.s < contour.path.length - REPEATED_POINT}
    for name in sorted(inner):
        own = [x for x in contour.events if x.name == name]
        before = [x for x in own if x.s <= start]
        # Events that set the values at the drawn end, the drawn start and the new start.
        at_ends = [own[-1], *(x for x in own[:1] if x.s <= REPEATED_POINT), *before[-1:]]
        if any(x.value != own[-1].value for x in at_ends):
            raise InvalidInput(
                f"{contour_called(contour, 0) if contour.name else 'A closed contour'} switches "
                f"{name} along its path, and would switch it at other places than drawn if it "
                f"started at {start:g} m: leave out begin, or start at a place where {name} has "
                "the same value as at the end.",
                s=start,
            )


def _move_event(event: Event, start: float, length: float) -> Event:
    """An event after the contour got a new start point; events at the ends stay at the ends."""
    if event.s <= REPEATED_POINT or event.s >= length - REPEATED_POINT:
        return dataclasses.replace(event, s=0.0 if event.s <= REPEATED_POINT else length)
    return dataclasses.replace(event, s=(event.s - start) % length)


def _find_start(path: Path, begin: str | float | Sequence[float]) -> float:
    """Arc length of the start point that `Process.begin` means on a closed path [m]."""
    if begin == DRAWN:
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
    end = path.segments.at(last, path.lengths[last], 1)
    if np.linalg.norm(path.tangents[0] - end[0]) <= TANGENT_TOLERANCE:
        return 0.0
    longest = int(np.argmax(path.lengths))
    return float(path.breaks[longest] + path.lengths[longest] / 2)
