"""Cells of a path for a plan with limits of jerk: finer next to rests, and at each break."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.motion import JointPath, PathLaw
from armcontour.timing.grid import Grid, split

# Cells are spread over time and over arc length in these shares.
OVER_TIME, OVER_LENGTH = 0.6, 0.4
# The cell at a rest is this share of the way in which the acceleration would build up.
FIRST_CELL = 0.3
# Up to so many such ways from a rest, cells take one K-th of the first cell's time each.
RAMPS = 8.0
# Farther away they may grow by this share of their distance.
GROWTH = 0.3
# The first cell is at most and at least this share of a section.
LONGEST_FIRST, SHORTEST_FIRST = 0.02, 1e-9
# The mass of cells next to a rest is computed at so many places.
PLACES = 200
# No cell is shorter than this share of the path: positions on it would be rounding errors.
SHORTEST = 1e-13


@dataclass(frozen=True, slots=True)
class Rest:
    """How motion starts at a rest.

    Args:
        acceleration: Largest path acceleration near it [m/s²].
        jerk: Largest path jerk near it [m/s³].
    """

    acceleration: float
    jerk: float

    def first_cell(self, length: float) -> float:
        """Length of the cell of uniform jerk next to it [m], in a section of a given length."""
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            way = self.acceleration * (self.acceleration / self.jerk) ** 2 / 6
        shortest, longest = SHORTEST_FIRST * length, LONGEST_FIRST * length
        return float(np.clip(FIRST_CELL * np.nan_to_num(way, nan=longest), shortest, longest))


@dataclass(frozen=True, slots=True)
class Mesh:
    """Cells of a path, in sections between rests or other ends.

    Args:
        grid: The cells.
        sections: First cell of each section, and the number of all cells, (sections + 1,).
        at_rest: Whether the motion rests at the start and at the end of each section,
            (sections, 2).
    """

    grid: Grid
    sections: IntArray
    at_rest: BoolArray

    @property
    def ramps(self) -> BoolArray:
        """Whether a cell has uniform jerk from or to a rest, (n,)."""
        found = np.zeros(len(self.grid), dtype=bool)
        found[self.sections[:-1][self.at_rest[:, 0]]] = True
        found[self.sections[1:][self.at_rest[:, 1]] - 1] = True
        return found


def place_mesh(
    law: PathLaw,
    cells: int,
    ends: FloatArray,
    at_rest: BoolArray,
    rests: list[tuple[Rest, Rest]],
) -> Mesh:
    """Make cells for a plan near another one.

    Args:
        law: The other plan.
        cells: About so many cells, without those next to rests.
        ends: Arc lengths of the ends of the sections [m], (sections + 1,).
        at_rest: Whether the motion rests at the start and end of each section, (sections, 2).
        rests: How it starts there.
    """
    s, first = [], [0]
    per_ramp = float(np.clip(cells / 50, 8, 20))
    for k, (begin, end) in enumerate(zip(ends[:-1], ends[1:], strict=True)):
        nodes = _nodes(law, cells, (float(begin), float(end)), at_rest[k], rests[k], per_ramp)
        s.append(nodes[:-1])
        first.append(first[-1] + len(nodes) - 1)
    joined = np.concatenate([*s, ends[-1:]])
    middle = (joined[:-1] + joined[1:]) / 2
    grid = Grid(law.joint_path, joined, law.joint_path.locate(middle))
    return Mesh(grid, np.array(first), at_rest)


def _nodes(
    law: PathLaw,
    cells: int,
    ends: tuple[float, float],
    at_rest: BoolArray,
    rests: tuple[Rest, Rest],
    per_ramp: float,
) -> FloatArray:
    """Ends of the cells of one section [m]."""
    begin, end = ends
    length = end - begin
    joint_path: JointPath = law.joint_path
    breaks = joint_path.breaks
    knots = breaks[(breaks > begin) & (breaks < end)]
    firsts = [x.first_cell(length) if y else 0.0 for x, y in zip(rests, at_rest, strict=True)]
    # The cells at rests lie within the first and last piece of the joint path.
    near, far = (knots[0], knots[-1]) if len(knots) else (end, begin)
    firsts = [min(firsts[0], (near - begin) / 2), min(firsts[1], (end - far) / 2)]
    needed = np.unique(np.concatenate([[begin, begin + firsts[0]], knots, [end - firsts[1], end]]))
    inner = law.s[(law.s > begin) & (law.s < end)]
    places = np.unique(np.concatenate([needed, inner, _near_rests(ends, firsts)]))
    mass = cells * _share_of_plan(law, places)
    for first, away, sign in zip(firsts, (places - begin, end - places), (1, -1), strict=True):
        if first > 0:
            mass += sign * _ramp_mass(first, np.maximum(away, first), per_ramp)
    at = np.searchsorted(places, needed)
    shortest = SHORTEST * float(np.abs(breaks).max())
    count = np.minimum(np.ceil(np.diff(mass[at])), np.diff(needed) / shortest)
    count = np.maximum(1, count).astype(np.intp)
    for first, cell in zip(firsts, (0, -1), strict=True):
        if first > 0:
            count[cell] = 1
    of = np.repeat(np.arange(len(count)), count)
    number = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    low, high = mass[at[:-1]][of], mass[at[1:]][of]
    found = np.interp(low + (high - low) * number / count[of], mass, places)
    found[number == 0] = needed[:-1]
    return np.append(found, end)


def _share_of_plan(law: PathLaw, s: FloatArray) -> FloatArray:
    """Share of the plan before arc lengths, over time and over length, (n,)."""
    _, t = law.reach(s)
    length = law.s[-1] - law.s[0]
    return np.asarray(OVER_TIME * t / law.breaks[-1] + OVER_LENGTH * (s - law.s[0]) / length)


def _near_rests(ends: tuple[float, float], firsts: list[float]) -> FloatArray:
    """Arc lengths at which the mass of cells next to rests is computed [m]."""
    length = ends[1] - ends[0]
    away = [np.geomspace(x, length, PLACES)[1:-1] if x > 0 else np.empty(0) for x in firsts]
    return np.concatenate([ends[0] + away[0], ends[1] - away[1]])


def _ramp_mass(first: float, away: FloatArray, per_ramp: float) -> FloatArray:
    """Number of cells between the first one at a rest and places at a distance from it, (n,)."""
    last = first * RAMPS / FIRST_CELL
    near = per_ramp * (np.cbrt(np.minimum(away, last) / first) - 1)
    width = 3 / per_ramp * np.cbrt(first) * np.cbrt(last) ** 2
    beyond = np.log1p(GROWTH * np.maximum(away - last, 0) / width) / GROWTH
    return np.asarray(near + beyond)


def split_mesh(mesh: Mesh, parts: FloatArray) -> Mesh:
    """Split cells into equal parts, but those of uniform jerk; `parts` has their numbers, (n,)."""
    count = np.where(mesh.ramps, 1, np.maximum(1, parts)).astype(np.intp)
    before = np.concatenate([[0], np.cumsum(count)])
    return Mesh(split(mesh.grid, count.astype(np.float64)), before[mesh.sections], mesh.at_rest)
