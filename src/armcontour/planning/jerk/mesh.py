"""Sections of a path between rests, and their cells for plans with limits of jerk."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.sampled_data import number_parts
from armcontour.motion import JointPath, PathLaw
from armcontour.planning.constraints import JointMotion, limits_on
from armcontour.planning.path_grid import Grid
from armcontour.planning.timing_options import Task
from armcontour.planning.topp.limit_forms import combine_forms, largest_u
from armcontour.planning.topp.sampled_joint_path import SampledJointPath

# Share of the cells that is distributed evenly in time.
OVER_TIME = 0.5
# Share of the cells that is distributed evenly in arc length.
OVER_LENGTH = 0.3
# Share of the cells that is distributed like the grid of the plan without limits of jerk, which is
# finer where the joints turn.
OVER_TURNS = 0.2
# Length of the cell at a rest, as a fraction of the build-up distance, in which acceleration builds
# up
FIRST_CELL = 0.3
# Up to this multiple of the build-up distance from a rest, cells have equal durations.
EQUAL_DURATION_RANGE = 8.0
# Farther away, the length of a cell increases by this fraction of the distance from the rest.
CELL_GROWTH = 0.3
# Largest length of the first cell, as a fraction of a section.
LONGEST_FIRST = 0.02
# Smallest length of the first cell, as a fraction of a section.
SHORTEST_FIRST = 1e-9
# Smallest length of other cells, as a fraction of a section; below it the slope is a rounding
# error.
SHORTEST_CELL = 1e-9
# The number of cells per duration of the cell at a rest is the number of all cells divided by
# CELLS_PER_RAMP_CELL, but from FEWEST_PER_RAMP to MOST_PER_RAMP.
CELLS_PER_RAMP_CELL = 50
FEWEST_PER_RAMP = 8
MOST_PER_RAMP = 20
# Number of points at which the cumulative number of cells next to a rest is computed
RAMP_SAMPLES = 200
# A break of the joint path is an end of cells, unless it is closer to the previous end than this
# fraction of a cell; then it only divides the cell into parts.
NEAR_KNOT = 0.3
# A node closer to a break than this fraction of the shorter adjacent cell is moved to the break.
SNAP_TO_BREAK = 0.2
# A jump of d2q_ds2 requires a stop if it exceeds this fraction of the sum of the values on both
# sides, and if the change of acceleration also takes long enough (TOO_SHORT).
KINK = 1e-6
# A jump of d2q_ds2 requires no stop if, at the speed of the plan and with the jerk limit, the
# change of acceleration takes less than this fraction of the duration.
TOO_SHORT = 1e-8
# Time that replaces the fraction TOO_SHORT in a long plan [s]: half of the time that `check`
# tolerates as rounding
ROUNDING_TIME = 5e-6
# Largest change of direction over the length `End.even` [rad].
EVEN_BEND = 5e-4
# dq_ds vanishes at an end if it is below this fraction of dq_ds nearby.
VANISHING_SLOPE = 0.1
# Largest length of the first cell at an end where dq_ds vanishes, as a fraction of the section.
FIRST_AT_VANISHED = 5e-4
# Distance from an end at which acceleration and jerk are evaluated, as a fraction of the section
NEAR_REST = 5e-3


@dataclass(frozen=True, slots=True)
class End:
    """Scales for the cells near an end of a section, at which the motion rests."""

    acceleration: float  # Largest path acceleration near this end [m/s²]
    jerk: float  # Largest path jerk near this end [m/s³]
    speed: float  # Largest path speed of the section [m/s]
    even: float  # Length over which the joint path is nearly straight near this end [m]

    def first_cell(self, length: float) -> float:
        """Return the length of the uniform-jerk cell at this end of a section [m].

        - `length`: length of the section [m].
        """
        shortest = SHORTEST_FIRST * length
        longest = min(LONGEST_FIRST * length, self.even)
        longest = max(shortest, longest)
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            time = min(
                self.acceleration / self.jerk,
                np.sqrt(self.speed / self.jerk),
                np.cbrt(length / 2 / self.jerk),
            )
            distance = FIRST_CELL * self.jerk * time**3 / 6 if np.isfinite(self.jerk) else 0.0
        return float(np.clip(np.nan_to_num(distance, nan=longest), shortest, longest))


@dataclass(frozen=True, slots=True)
class JerkMesh:
    """Cells of a path and parts of these cells, in sections between rests."""

    # ds² is one parabola on each cell, and the joint path one polynomial on each part.

    grid: Grid
    nodes: FloatArray  # Ends of the n cells [m], (n + 1,)
    cell: IntArray  # The cell of each part, (m,)
    sections: IntArray  # First cell of each section, and the number of all cells, (sections + 1,)

    @property
    def width(self) -> FloatArray:
        """Lengths of the cells [m], (n,)."""
        return np.asarray(np.diff(self.nodes))

    @property
    def ramps(self) -> IntArray:
        """Uniform jerk: 1 for cells from a rest, -1 for cells to a rest, 0 for others, (n,)."""
        signs = np.zeros(len(self.nodes) - 1, dtype=np.intp)
        signs[self.sections[:-1]] = 1
        signs[self.sections[1:] - 1] = -1
        return signs

    @classmethod
    def through(cls, joint_path: JointPath, nodes: FloatArray, sections: IntArray) -> JerkMesh:
        """Make the mesh of given cells; breaks of the joint path are additional ends of parts.

        - `nodes`: ends of the cells [m], (n + 1,).
        - `sections`: first cell of each section, and the number of all cells, (sections + 1,).
        """
        s = np.union1d(nodes, joint_path.breaks)
        middle = (s[:-1] + s[1:]) / 2
        grid = Grid(joint_path, s, joint_path.locate(middle))
        return cls(grid, nodes, np.searchsorted(nodes, middle) - 1, sections)

    def split(self, parts: FloatArray) -> JerkMesh:
        """Split each cell into equal cells, as many as the largest `parts` on it, (m,)."""
        # Cells of uniform jerk are not split.
        largest = np.ones(len(self.nodes) - 1)
        np.maximum.at(largest, self.cell, parts)
        count = np.where(self.ramps != 0, 1, np.ceil(largest)).astype(np.intp)
        cells, number = number_parts(count)
        before = np.concatenate([[0], np.cumsum(count)])
        share = number / count[cells]
        nodes = np.append(self.nodes[cells] + self.width[cells] * share, self.nodes[-1])
        # A new node that differs from a break by rounding would leave an empty part.
        snapped = _snap(nodes, self.grid.joint_path.breaks)
        new = np.append(number > 0, False)
        nodes = np.where(new, snapped, nodes)
        return JerkMesh.through(self.grid.joint_path, nodes, before[self.sections])


@dataclass(frozen=True, slots=True)
class _CellDistribution:
    """Distribution of the cells along the path."""

    law: PathLaw
    turns: FloatArray  # Arc lengths from start to end, denser where the joints turn [m]

    def before(self, s: FloatArray) -> FloatArray:
        """Return the fraction of the cells before arc lengths s [m], (n,)."""
        law = self.law
        _, t = law.reach(s)
        length = (s - law.s[0]) / (law.s[-1] - law.s[0])
        turned = np.interp(s, self.turns, np.linspace(0, 1, len(self.turns)))
        return np.asarray(
            OVER_TIME * t / law.breaks[-1] + OVER_LENGTH * length + OVER_TURNS * turned
        )


def place_mesh(
    law: PathLaw,
    turns: FloatArray,  # Arc lengths from start to end, denser where the joints turn [m]
    cells: int,  # Approximate number of cells, without the cells next to rests
    section_ends: FloatArray,  # Arc lengths of the ends of the sections [m], (sections + 1,)
    ends: list[tuple[End, End]],  # Start and stop of the motion in each section
) -> JerkMesh:
    """Place the cells for a plan that will be close to the plan `law`."""
    node_rows = []
    first = [0]
    share = _CellDistribution(law, turns)
    per_ramp = float(np.clip(cells / CELLS_PER_RAMP_CELL, FEWEST_PER_RAMP, MOST_PER_RAMP))
    for begin, end, both in zip(section_ends[:-1], section_ends[1:], ends, strict=True):
        nodes = _place_nodes(share, cells, (float(begin), float(end)), both, per_ramp)
        node_rows.append(nodes[:-1])
        first.append(first[-1] + len(nodes) - 1)
    nodes = np.concatenate([*node_rows, section_ends[-1:]])
    return JerkMesh.through(law.joint_path, nodes, np.array(first))


def _place_nodes(
    share: _CellDistribution,
    cells: int,
    limits: tuple[float, float],
    ends: tuple[End, End],
    per_ramp: float,
) -> FloatArray:
    """Place the ends of the cells of one section [m], dense at both ends.

    - `share`: distribution of the cells along the whole path.
    - `cells`: approximate number of cells of the whole path.
    - `limits`: arc lengths of the ends of the section [m].
    - `ends`: scales at these ends.
    - `per_ramp`: number of cells per duration of the cell at a rest.
    """
    begin, end = limits
    length = end - begin
    firsts = [x.first_cell(length) for x in ends]
    inner = np.concatenate([x[(x > begin) & (x < end)] for x in (share.law.s, share.turns)])
    knots = share.law.joint_path.breaks
    knots = knots[(knots > begin) & (knots < end)]
    s = np.unique(np.concatenate([[begin, end], inner, knots, _sample_ends(limits, firsts)]))
    # Number of cells up to each arc length s; the ends of the cells are where it is whole.
    cell_count = cells * share.before(s)
    for first, away, sign in zip(firsts, (s - begin, end - s), (1, -1), strict=True):
        cell_count += sign * _count_cells(first, away, per_ramp)
    start = begin + firsts[0]
    stop = end - firsts[1]
    low, high = np.interp([start, stop], s, cell_count)
    targets = [low]
    last = low
    count_at_knots = np.interp(knots, s, cell_count)
    while (k := int(np.searchsorted(count_at_knots, last + NEAR_KNOT))) < len(knots):
        if count_at_knots[k] > high - NEAR_KNOT:
            break
        targets.append(count_at_knots[k])
        last = count_at_knots[k]
    needed = np.array([*targets, high])
    count = np.maximum(1, np.ceil(np.diff(needed))).astype(np.intp)
    intervals, number = number_parts(count)
    positions = needed[intervals] + np.diff(needed)[intervals] * number / count[intervals]
    nodes = np.append(np.interp(positions, cell_count, s), stop)
    nodes[0] = start
    nodes = _snap(_drop_close_nodes(nodes, SHORTEST_CELL * length), knots)
    return np.concatenate([[begin], nodes, [end]])


def _drop_close_nodes(nodes: FloatArray, spacing: float) -> FloatArray:
    """Remove inner nodes until all distances are at least `spacing` [m]."""
    steps = np.floor((nodes - nodes[0]) / spacing)
    mask = np.append(True, np.diff(steps) > 1)
    mask[-1] = True
    mask[1:-1] &= nodes[-1] - nodes[1:-1] > spacing
    return np.asarray(nodes[mask])


def _snap(nodes: FloatArray, knots: FloatArray) -> FloatArray:
    """Move inner nodes to breaks of the joint path that are much closer than the adjacent nodes."""
    if not len(knots) or len(nodes) < 3:
        return nodes
    i = np.clip(np.searchsorted(knots, nodes[1:-1]), 1, max(len(knots) - 1, 1))
    before = knots[i - 1]
    after = knots[np.minimum(i, len(knots) - 1)]
    inner = nodes[1:-1]
    nearest = np.where(inner - before < after - inner, before, after)
    room = np.minimum(np.diff(nodes)[:-1], np.diff(nodes)[1:])
    snapped = nodes.copy()
    snapped[1:-1] = np.where(np.abs(nearest - inner) < SNAP_TO_BREAK * room, nearest, inner)
    return snapped


def _sample_ends(limits: tuple[float, float], firsts: list[float]) -> FloatArray:
    """Return the arc lengths at which cells next to the ends of a section are counted [m]."""
    length = limits[1] - limits[0]
    first, last = (np.geomspace(x, length, RAMP_SAMPLES)[:-1] for x in firsts)
    return np.concatenate([limits[0] + first, limits[1] - last])


def _count_cells(first: float, away: FloatArray, per_ramp: float) -> FloatArray:
    """Count the cells from the first one to points at distances `away` from an end [m], (n,).

    `per_ramp` is the number of cells per duration of the first cell.
    """
    last = first * EQUAL_DURATION_RANGE / FIRST_CELL
    near = per_ramp * (np.cbrt(np.clip(away, first, last) / first) - 1)
    width = 3 / per_ramp * np.cbrt(first) * np.cbrt(last) ** 2
    beyond = np.log1p(CELL_GROWTH * np.maximum(away - last, 0) / width) / CELL_GROWTH
    return np.asarray(near + beyond)


def find_sections(law: PathLaw, task: Task) -> FloatArray:
    """Find the ends of the sections of a path between rests [m], (sections + 1,)."""
    path = law.joint_path
    inner = law.s[1:-1]
    stops = np.union1d(path.stops, _find_jumps(law, task))
    stops = stops[(stops > law.s[0]) & (stops < law.s[-1])]
    if len(inner):
        stops = np.union1d(stops, inner[law.rates.ds[1:] == 0])
    return np.concatenate([law.s[:1], stops, law.s[-1:]])


def _find_jumps(law: PathLaw, task: Task) -> FloatArray:
    """Find the breaks [m] where accelerations with a jerk limit jump at the planned speed."""
    path = law.joint_path
    inner = np.arange(1, len(law.joint_path.breaks) - 1)
    breaks = path.breaks[inner]
    before, after = (path.on_interval(inner - side, breaks, 2) for side in (1, 0))
    jump = np.abs(after - before)
    size = np.abs(before) + np.abs(after)
    square = square_at(law, np.clip(breaks, law.s[0], law.s[-1]))[:, None]
    soon = min(TOO_SHORT * law.breaks[-1], ROUNDING_TIME) * task.jerk
    return np.asarray(breaks[((jump > KINK * size) & (jump * square > soon)).any(axis=1)])


def find_ends(law: PathLaw, task: Task, section_ends: FloatArray) -> list[tuple[End, End]]:
    """Compute the scales at the start and the stop of each section from a plan."""
    inset = NEAR_REST * np.diff(section_ends)
    last = len(law.s) - 2
    # Intervals of the plan near the starts and the stops of the sections, and those at their ends
    near = [
        _interval_at(law.s, section_ends[:-1] + inset, last),
        _interval_at(law.s, section_ends[1:] - inset, last),
    ]
    edges = [
        _interval_at(law.s, section_ends[:-1], last),
        np.maximum(_interval_at(law.s, section_ends[1:], len(law.s) - 1) - 1, 0),
    ]
    # Only these intervals are evaluated. Intervals between them belong to no end, but each of them
    # must be inside one polynomial of the joint path.
    needed = np.unique(np.concatenate([*near, *edges]))
    at_breaks = np.searchsorted(law.s, law.joint_path.breaks[:-1])
    s = law.s[np.unique(np.concatenate([needed, needed + 1, at_breaks]))]
    grid = Grid(law.joint_path, s, law.joint_path.locate((s[:-1] + s[1:]) / 2))
    path = SampledJointPath(grid)
    (first, second), (third, _) = path.derivatives
    acceleration = largest_u(limits_on(path, task.active))
    for constraint in task.active:
        if isinstance(constraint, JointMotion) and len(constraint.low):
            acceleration = np.minimum(
                acceleration, largest_u(combine_forms([constraint.rows(path)], len(path)))
            )
    with np.errstate(divide="ignore"):
        jerk = (task.jerk / np.abs(first).max(axis=1)).min(axis=1)
    speed = np.maximum.reduceat(
        np.append(law.speeds, 0.0), np.searchsorted(law.s, section_ends, side="right")
    )[:-1]
    size = np.linalg.norm(first, axis=2).max(axis=1)
    curvature = np.linalg.norm(second, axis=2).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        even = np.fmin(EVEN_BEND * size / curvature, np.sqrt(EVEN_BEND * size / third.max(axis=1)))

    def ends_on_side(side: int) -> list[End]:
        """Return the scales of all sections at their starts or at their stops."""
        i = np.searchsorted(s, law.s[near[side]])
        j = np.searchsorted(s, law.s[edges[side]])
        straight = np.nan_to_num(np.fmin(even[i], even[j]), nan=np.inf)
        # If dq_ds vanishes at the end, `even` is not defined there, and a fraction of the section
        # is used.
        standing = size[j] < VANISHING_SLOPE * size[i]
        straight = np.where(standing, FIRST_AT_VANISHED * np.diff(section_ends), straight)
        rows = zip(acceleration[i], jerk[i], speed, straight, strict=True)
        return [End(float(x), float(y), float(v), float(e)) for x, y, v, e in rows]

    return list(zip(ends_on_side(0), ends_on_side(1), strict=True))


def _interval_at(s: FloatArray, places: FloatArray, last: int) -> IntArray:
    """Return the index of the interval that contains each place, at most `last`, (n,).

    - `s`: ends of the intervals [m].
    """
    return np.asarray(np.clip(np.searchsorted(s, places, side="right") - 1, 0, last))


def square_at(law: PathLaw, s: FloatArray) -> FloatArray:
    """Return ds² of a plan at arc lengths [m²/s²], (n,)."""
    return np.asarray(law.path_position(*law.reach(s), 1) ** 2)
