"""The order of contours, and where closed ones begin for the sake of the order."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.geometry.cutting import reverse_path
from armcontour.geometry.near_points import nearest_points
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.program.closed_contours import begin_at, find_start, keeps_drawn_start
from armcontour.program.moves import Contour, Program, contour_called
from armcontour.program.nesting import nest
from armcontour.program.process import Process

# What makes the contour of an option, and its first and last point [m], (2, dimension).
Option = tuple[Callable[[], Contour], FloatArray]

# Places at which a closed contour may begin; fewer where all contours have more than MOST_PLACES.
PLACES, FEWEST_PLACES, MOST_PLACES = 24, 4, 20_000
# Neighbours of a contour that moves of the search bring next to it.
NEIGHBOURS = 10
# Exchanges from which the search goes on: per contour, at least, and the most of exchanges times
# contours, which bounds the time of the search to a few seconds.
# Without exchanges, tours of 6 to 100 random contours are 0.6 to 15 % longer on average.
TRIES, LEAST_TRIES, MOST_WORK = 3, 100, 1_000_000


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

    @property
    def tables(self) -> tuple[FloatArray, FloatArray, IntArray]:
        """Exits and entries of all options, and the first option of every contour."""
        entries, exits = (np.ascontiguousarray(self.ends[:, k]) for k in (0, 1))
        return exits, entries, self.first

    def nearest(self, parents: IntArray) -> tuple[IntArray, IntArray]:
        """The tour that begins as drawn and goes on to the nearest contour."""
        from armcontour.program._tours import nearest_tour

        return nearest_tour(*self.tables, parents, 0)

    def shortest(self, parents: IntArray) -> tuple[IntArray, IntArray]:
        """A short tour: 2-opt and Or-opt moves, repeated from many exchanges of parts."""
        from armcontour.program._tours import choose_options, search

        tour, option = self.nearest(parents)
        choose_options(*self.tables, tour, option)
        n = len(self.contours)
        tries = min(max(TRIES * n, LEAST_TRIES), MOST_WORK // n)
        search(*self.tables, parents, self._neighbours(), tour, option, tries)
        return tour, option

    def _neighbours(self) -> IntArray:
        """The nearest contours of every contour, by their ends, (n, k)."""
        n = len(self.contours)
        k = min(NEIGHBOURS, n - 1)
        owners = np.repeat(np.arange(n), np.diff(self.first) * 2)
        points = self.ends.reshape(-1, 3)
        found = np.empty((n, k), dtype=np.intp)
        centers = np.array([points[owners == i].mean(axis=0) for i in range(n)])
        several = int(np.diff(self.first).max()) * 2
        near = owners[nearest_points(centers, points, min(len(points), several * (k + 1)))]
        for i in range(n):
            others = near[i][near[i] != i]
            chosen = others[np.sort(np.unique(others, return_index=True)[1])][:k]
            missing = k - len(chosen)
            spare = np.setdiff1d(np.arange(n), [*chosen, i])[:missing] if missing else chosen[:0]
            found[i] = np.concatenate([chosen, spare])
        return found

    def describe(self, tour: IntArray, option: IntArray) -> str:
        """A sentence on the length of a tour."""
        from armcontour.program._tours import tour_length

        exits, entries, _ = self.tables
        length = tour_length(exits, entries, tour, option)
        drawn = tour_length(exits, entries, np.arange(len(tour)), self.first[:-1])
        return (
            f"In the order shortest, the straight ways between contours have {length:.4g} m in all "
            f"({drawn:.4g} m in the order of the file)."
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
    """An open contour without events, run from its end."""
    work = contour.work
    if work is not None:
        work = contour.path.length - work[1], contour.path.length - work[0]
    return dataclasses.replace(contour, path=reverse_path(contour.path), work=work)


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
