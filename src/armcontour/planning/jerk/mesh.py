"""Cells of a path for a plan with limits of jerk: finer next to rests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampling import number_parts
from armcontour.motion import JointPath, PathLaw
from armcontour.planning.grid import Grid

# Cells are spread over time, over arc length, and as the grid of the plan without jerk, which is
# finer where the joints turn, in these shares.
OVER_TIME, OVER_LENGTH, OVER_TURNS = 0.5, 0.3, 0.2
# The cell at a rest is this share of the way in which the acceleration would build up.
FIRST_CELL = 0.3
# Up to so many such ways from a rest, cells take one K-th of the first cell's time each.
RAMPS = 8.0
# Farther away they may grow by this share of their distance.
GROWTH = 0.3
# The first cell is at most and at least this share of a section.
LONGEST_FIRST, SHORTEST_FIRST = 0.02, 1e-9
# No other cell is shorter than this share of a section: its slope would be a rounding error.
SHORTEST = 1e-9
# The mass of cells next to a rest is computed at so many places.
PLACES = 200
# Breaks of the joint path nearer to another one than this share of a cell end parts, not cells.
NEAR_KNOT = 0.3
# Nodes nearer to a break than this share of the next cell are moved there.
SNAP = 0.2


@dataclass(frozen=True, slots=True)
class End:
    """How motion may start at an end of a section, or stop there.

    Args:
        rest: Whether it rests there.
        square: ds² there [m²/s²].
        acceleration: Largest path acceleration near it [m/s²].
        jerk: Largest path jerk near it [m/s³].
        speed: Largest path speed of the section [m/s].
        even: Length over which the joint path hardly bends near it [m].
    """

    rest: bool
    square: float
    acceleration: float
    jerk: float
    speed: float
    even: float

    def first_cell(self, length: float) -> float:
        """Length of the cell of uniform jerk next to a rest [m], in a section of a given length.

        Next to another end it is the length over which ds² may change much.
        """
        shortest, longest = SHORTEST_FIRST * length, min(LONGEST_FIRST * length, self.even)
        longest = max(shortest, longest)
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            if not self.rest:
                way = self.square / self.acceleration
            else:
                time = min(
                    self.acceleration / self.jerk,
                    np.sqrt(self.speed / self.jerk),
                    np.cbrt(length / 2 / self.jerk),
                )
                way = FIRST_CELL * self.jerk * time**3 / 6 if np.isfinite(self.jerk) else 0.0
        return float(np.clip(np.nan_to_num(way, nan=longest), shortest, longest))


@dataclass(frozen=True, slots=True)
class Mesh:
    """Cells of a path, in sections between rests or other ends, and their parts.

    ds² is one parabola on each cell, and the joint path one polynomial on each part.

    Args:
        grid: The m parts.
        nodes: Ends of the n cells [m], (n + 1,).
        cell: The cell of each part, (m,).
        sections: First cell of each section, and the number of all cells, (sections + 1,).
        at_rest: Whether the motion rests at the start and at the end of each section,
            (sections, 2).
    """

    grid: Grid
    nodes: FloatArray
    cell: IntArray
    sections: IntArray
    at_rest: BoolArray

    @property
    def width(self) -> FloatArray:
        """Lengths of the cells [m], (n,)."""
        return np.asarray(np.diff(self.nodes))

    @property
    def ramps(self) -> IntArray:
        """1 for cells of uniform jerk from a rest, -1 for those to a rest, else 0, (n,)."""
        found = np.zeros(len(self.nodes) - 1, dtype=np.intp)
        found[self.sections[:-1][self.at_rest[:, 0]]] = 1
        found[self.sections[1:][self.at_rest[:, 1]] - 1] = -1
        return found

    @classmethod
    def through(
        cls, joint_path: JointPath, nodes: FloatArray, sections: IntArray, at_rest: BoolArray
    ) -> Mesh:
        """The mesh of given cells, with the breaks of the joint path as further ends of parts."""
        s = np.union1d(nodes, joint_path.breaks)
        middle = (s[:-1] + s[1:]) / 2
        grid = Grid(joint_path, s, joint_path.locate(middle))
        return cls(grid, nodes, np.searchsorted(nodes, middle) - 1, sections, at_rest)

    def split(self, parts: FloatArray) -> Mesh:
        """Split cells, but those of uniform jerk, into the largest number of their parts, (m,)."""
        most = np.ones(len(self.nodes) - 1)
        np.maximum.at(most, self.cell, parts)
        count = np.where(self.ramps != 0, 1, np.ceil(most)).astype(np.intp)
        of, number = number_parts(count)
        before = np.concatenate([[0], np.cumsum(count)])
        share = number / count[of]
        nodes = np.append(self.nodes[of] + self.width[of] * share, self.nodes[-1])
        # A new node that misses a break by a rounding error would leave a part without a size.
        snapped, new = _snap(nodes, self.grid.joint_path.breaks), np.append(number > 0, False)
        nodes = np.where(new, snapped, nodes)
        return Mesh.through(self.grid.joint_path, nodes, before[self.sections], self.at_rest)


@dataclass(frozen=True, slots=True)
class _Share:
    """Which share of the cells lies where.

    Args:
        law: A plan.
        turns: Arc lengths that are denser where the joints turn [m], from start to end.
    """

    law: PathLaw
    turns: FloatArray

    def before(self, s: FloatArray) -> FloatArray:
        """Share of the cells before arc lengths, (n,)."""
        law = self.law
        _, t = law.reach(s)
        length = (s - law.s[0]) / (law.s[-1] - law.s[0])
        turned = np.interp(s, self.turns, np.linspace(0, 1, len(self.turns)))
        return np.asarray(
            OVER_TIME * t / law.breaks[-1] + OVER_LENGTH * length + OVER_TURNS * turned
        )


def place_mesh(
    law: PathLaw,
    turns: FloatArray,
    cells: int,
    places: FloatArray,
    ends: list[tuple[End, End]],
) -> Mesh:
    """Make cells for a plan near another one.

    Args:
        law: The other plan.
        turns: Arc lengths that are denser where the joints turn [m], from start to end.
        cells: About so many cells, without those next to rests.
        places: Arc lengths of the ends of the sections [m], (sections + 1,).
        ends: How the motion starts and stops in each section.
    """
    found, first, share = [], [0], _Share(law, turns)
    per_ramp = float(np.clip(cells / 50, 8, 20))
    for begin, end, both in zip(places[:-1], places[1:], ends, strict=True):
        nodes = _nodes(share, cells, (float(begin), float(end)), both, per_ramp)
        found.append(nodes[:-1])
        first.append(first[-1] + len(nodes) - 1)
    nodes = np.concatenate([*found, places[-1:]])
    at_rest = np.array([[x.rest, y.rest] for x, y in ends])
    return Mesh.through(law.joint_path, nodes, np.array(first), at_rest)


def _nodes(
    share: _Share,
    cells: int,
    places: tuple[float, float],
    ends: tuple[End, End],
    per_ramp: float,
) -> FloatArray:
    """Ends of the cells of one section [m]."""
    begin, end = places
    length = end - begin
    firsts = [x.first_cell(length) for x in ends]
    inner = np.concatenate([x[(x > begin) & (x < end)] for x in (share.law.s, share.turns)])
    knots = share.law.joint_path.breaks
    knots = knots[(knots > begin) & (knots < end)]
    at = np.unique(np.concatenate([[begin, end], inner, knots, _near_ends(places, firsts)]))
    mass = cells * share.before(at)
    for first, away, sign, x in zip(firsts, (at - begin, end - at), (1, -1), ends, strict=True):
        mass += sign * _mass_near(first, away, per_ramp if x.rest else 0.0)
    start, stop = (begin + firsts[0] * ends[0].rest, end - firsts[1] * ends[1].rest)
    low, high = np.interp([start, stop], at, mass)
    kept, last = [low], low
    of_knots = np.interp(knots, at, mass)
    while (k := int(np.searchsorted(of_knots, last + NEAR_KNOT))) < len(knots):
        if of_knots[k] > high - NEAR_KNOT:
            break
        kept.append(of_knots[k])
        last = of_knots[k]
    needed = np.array([*kept, high])
    count = np.maximum(1, np.ceil(np.diff(needed))).astype(np.intp)
    of, number = number_parts(count)
    wanted = needed[of] + np.diff(needed)[of] * number / count[of]
    nodes = np.append(np.interp(wanted, mass, at), stop)
    nodes[0] = start
    nodes = _snap(_apart(nodes, SHORTEST * length), knots)
    before, after = [begin] * ends[0].rest, [end] * ends[1].rest
    return np.concatenate([before, nodes, after])


def _apart(nodes: FloatArray, least: float) -> FloatArray:
    """Leave out inner nodes until all are at least so far apart [m]."""
    steps = np.floor((nodes - nodes[0]) / least)
    kept = np.append(True, np.diff(steps) > 1)
    kept[-1] = True
    kept[1:-1] &= nodes[-1] - nodes[1:-1] > least
    return np.asarray(nodes[kept])


def _snap(nodes: FloatArray, knots: FloatArray) -> FloatArray:
    """Move inner nodes onto breaks of the joint path that are much nearer than the next node."""
    if not len(knots) or len(nodes) < 3:
        return nodes
    i = np.clip(np.searchsorted(knots, nodes[1:-1]), 1, max(len(knots) - 1, 1))
    left, right = knots[i - 1], knots[np.minimum(i, len(knots) - 1)]
    inner = nodes[1:-1]
    nearest = np.where(inner - left < right - inner, left, right)
    room = np.minimum(np.diff(nodes)[:-1], np.diff(nodes)[1:])
    found = nodes.copy()
    found[1:-1] = np.where(np.abs(nearest - inner) < SNAP * room, nearest, inner)
    return found


def _near_ends(places: tuple[float, float], firsts: list[float]) -> FloatArray:
    """Arc lengths at which the mass of cells next to ends of a section is computed [m]."""
    length = places[1] - places[0]
    first, last = (np.geomspace(x, length, PLACES)[:-1] for x in firsts)
    return np.concatenate([places[0] + first, places[1] - last])


def _mass_near(first: float, away: FloatArray, per_ramp: float) -> FloatArray:
    """Number of cells between the first one and places at a distance from an end, (n,).

    Args:
        first: Length of the first cell [m].
        away: The distances [m], (n,).
        per_ramp: Cells per time of the first cell next to a rest; 0 next to another end.
    """
    if per_ramp == 0:
        return np.asarray(np.log1p(GROWTH * away / first) / GROWTH)
    last = first * RAMPS / FIRST_CELL
    near = per_ramp * (np.cbrt(np.clip(away, first, last) / first) - 1)
    width = 3 / per_ramp * np.cbrt(first) * np.cbrt(last) ** 2
    beyond = np.log1p(GROWTH * np.maximum(away - last, 0) / width) / GROWTH
    return np.asarray(near + beyond)
