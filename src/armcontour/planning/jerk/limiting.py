"""Limits of jerk: a plan without them becomes the fastest plan with them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import PathLaw, Rates, interval_times
from armcontour.planning.end_speeds import END as END_SPEED
from armcontour.planning.end_speeds import START as START_SPEED
from armcontour.planning.end_speeds import raise_too_fast
from armcontour.planning.jerk._interior_point import (
    DURATION,
    END,
    START,
    Section,
    improve,
    least_slacks,
    limit_steps,
)
from armcontour.planning.jerk.mesh import End, Mesh, place_mesh
from armcontour.planning.jerk.rows import Rows
from armcontour.planning.jerk.sections import (
    find_ends,
    find_sections,
    square_at,
)
from armcontour.planning.options import MOST_ITERATIONS, Task
from armcontour.planning.topp._kernel import Bounds

# Cells of a plan by default: so many while an acceleration builds up, but at least as many as the
# fewest, to which each polynomial of the joint path adds.
PER_BUILD_UP, FEWEST_CELLS, FEWEST_PER_PIECE = 2.0, 1000, 3
# Where more cells than the most are wanted, jerk is so large that fewer resolve its effect. Each
# polynomial adds to these, and each section as much as several, for the cells at its ends.
MOST_CELLS, MANY_CELLS, MANY_PER_PIECE, PIECES_OF_SECTION = 20_000, 4000, 8, 10
# Motion is even below this share of the largest path acceleration.
EVEN = 0.01
# The first pass has this share of the cells, and at least so many.
COARSER, FEWEST = 5, 60
# Shares of the optimum within which the passes end.
ROUGH, EXACT = 1e-2, 1e-4
# The second pass starts from this share of ds² of the first plan.
INSIDE = 0.9
# A start is lowered next to broken rows by factors between these, at most so often. Away from them
# it rises with this share of the slopes that jerk and acceleration allow, which INSIDE leaves free.
LESS, MORE, MOST_LESS = 0.5, 0.95, 400
ROOM = 0.1
# A start must be this far from every bound, as a share of the bound.
CLEAR = 1e-4
# Margins are computed for so many times the ds², dds and slope of the first pass, and for ds² down
# to LEAST of it where rows ask for that.
HEADROOM, HEADROOM_RATE, HEADROOM_SLOPE = 1.5, 2.0, 4.0
LEAST = 0.3
# Bounds of dds are at least this share of the largest dds.
LEAST_RATE = 0.02
# A plan is made again with wider bounds if those that it comes nearer to than this share may cost
# more than this share of the duration. Distances below the last number are rounding errors.
TOO_NEAR, WIDER, WIDEST, LEAST_GAIN, TINY = 0.02, 2.0, 16.0, 1e-5, 1e-9
# Cells whose margins take more than this share of a limit are split.
LARGEST_MARGIN, MOST_PARTS, MOST_SPLITS = 1e-2, 10, 6
# The largest share of a limit that margins may take on cells of uniform jerk.
MOST_AT_RAMPS = 0.5
# A start or end speed that is the limit is lower than the limit by half of this share: no row of an
# interior point is met exactly.
CLOSE_TO_LIMIT = 1e-7
# What a start or end speed counts against the duration, one after the other, until it is reached.
WEIGHTS = (0.0, 1.0, 10.0, 100.0)


def limit_jerk(law: PathLaw, task: Task) -> PathLaw:
    """Plan the fastest motion with limits of jerk.

    Args:
        law: The fastest motion without them.
        task: The limits.

    Raises:
        NotRealizable: The limits do not allow the start or end speed, or no motion at a point.
    """
    places, at_rest = find_sections(law, task)
    ends = find_ends(law, task, places, at_rest)
    cells = _default_cells(law, ends) if task.cells is None else task.cells
    # Rows are as many as the polynomials of the joint path, however few the cells.
    coarse = max(cells // COARSER, FEWEST, len(law.joint_path.breaks) // 2)
    mesh = place_mesh(law, law.s, coarse, places, ends)
    rough = _rows(task, mesh, law)
    found = _solve(rough, (law, 1.0), task, ROUGH)
    mesh = place_mesh(found, law.s, cells, places, find_ends(found, task, places, at_rest))
    if rough.exact:
        return _solve(_rows(task, mesh, found), (found, INSIDE), task, EXACT)
    return _solve_with_margins(mesh, found, task)


def _solve_with_margins(mesh: Mesh, near: PathLaw, task: Task) -> PathLaw:
    """The second pass, where limits need margins between the ends of cells.

    Raises:
        NotRealizable: Margins leave no room however small the cells, or as `limit_jerk`.
    """
    curved = any(x.curved for x in task.active)
    splits, wider, best = 0, 1.0, None
    while True:
        bounds = _bounds(mesh, near, wider, curved)
        rows = _rows(task, mesh, near, bounds)
        narrow = (rows.lost > LARGEST_MARGIN) & (mesh.ramps[mesh.cell] == 0)
        if splits < MOST_SPLITS and narrow.any() and len(mesh.grid) < MOST_CELLS:
            parts = np.where(narrow, np.sqrt(rows.lost / LARGEST_MARGIN), 1)
            mesh, splits = mesh.split(np.clip(parts, 1, MOST_PARTS)), splits + 1
            continue
        rows = _with_slow_ramps(rows, task, near)
        try:
            found = _solve(rows, (near, INSIDE), task, EXACT)
        except NotRealizable as error:
            if error.limit in (START_SPEED, END_SPEED) or not curved:
                if best is None:
                    raise
                return best
            # Rows that hold for any ds² down to rest always leave room for slow motion.
            curved = False
            continue
        if best is None or found.breaks[-1] < best.breaks[-1]:
            best = found
        if wider >= WIDEST or _gain(rows, bounds, found) < LEAST_GAIN:
            return best
        near, wider = found, wider * WIDER


def _with_slow_ramps(rows: Rows, task: Task, near: PathLaw) -> Rows:
    """The rows, with lower bounds on cells of uniform jerk of which margins take too much.

    Such cells are not split; the bounds hold the plan, and margins fall with them.
    """
    for _ in range(MOST_SPLITS):
        bounds, mesh = rows.bounds, rows.mesh
        tight = (rows.lost > MOST_AT_RAMPS) & (mesh.ramps[mesh.cell] != 0)
        if bounds is None or not tight.any():
            break
        share = np.where(tight, MOST_AT_RAMPS / np.maximum(rows.lost, 1), 1.0)
        bounds = bounds._replace(x=share * bounds.x, u=share * bounds.u)
        rows = _rows(task, mesh, near, bounds)
    return rows


def _rows(task: Task, mesh: Mesh, near: PathLaw, bounds: Bounds | None = None) -> Rows:
    """The rows of all cells for a plan near another one."""
    return Rows(mesh, task.active, task.jerk, bounds, _squares(near, mesh), task.arm)


def _default_cells(law: PathLaw, ends: list[tuple[End, End]]) -> int:
    """Number of cells by default: by the time without even motion, over that of a build-up."""
    acceleration, jerk = np.median([(x.acceleration, x.jerk) for y in ends for x in y], axis=0)
    times, (_, dds, slope, _) = np.diff(law.breaks), law.rates
    largest = np.maximum(np.abs(dds), np.abs(dds + slope * np.diff(law.s)))
    active = float(times[largest > EVEN * acceleration].sum())
    with np.errstate(divide="ignore"):
        wanted = PER_BUILD_UP * active * np.divide(jerk, acceleration)
    pieces = len(law.joint_path.breaks) - 1
    found = max(np.nan_to_num(wanted), FEWEST_CELLS + FEWEST_PER_PIECE * pieces)
    if found > MOST_CELLS:
        pieces += PIECES_OF_SECTION * (len(ends) - 1)
        found = min(MANY_CELLS + MANY_PER_PIECE * pieces, MOST_CELLS)
    return int(found)


def _squares(law: PathLaw, mesh: Mesh) -> FloatArray:
    """ds² of a plan in the middles of cells [m²/s²], (n,)."""
    return square_at(law, (mesh.grid.s[:-1] + mesh.grid.s[1:]) / 2)


def _bounds(mesh: Mesh, near: PathLaw, wider: float, curved: bool) -> Bounds:
    """Bounds of ds², dds and its slope on every cell, around a plan."""
    ds, dds, slope, _ = near.rates
    width = np.diff(near.s)
    speed = near.speeds
    x = np.maximum(speed[:-1], speed[1:]) ** 2
    last = near.path_position(np.arange(len(width)), near.breaks[1:], 2)
    u = np.maximum(np.abs(dds), np.abs(last))
    # Even motion has no rates, and a bound of zero would leave no room.
    u = np.maximum(u, LEAST_RATE * u.max())
    change = np.maximum(np.abs(slope), u / width)
    least = np.minimum(speed[:-1], speed[1:]) ** 2
    # Cells of the other plan that each cell touches, and their neighbours.
    s = mesh.grid.s
    first = np.searchsorted(near.s, s[:-1], side="right") - 2
    count = np.searchsorted(near.s, s[1:], side="left") + 1
    first, count = np.clip(first, 0, len(width) - 1), np.clip(count, 1, len(width))
    around = np.stack([first, np.maximum(count, first + 1)], axis=1).ravel()

    def largest(values: FloatArray) -> FloatArray:
        padded = np.append(values, -np.inf)
        return np.asarray(np.maximum.reduceat(padded, around)[::2])

    most = largest(x)
    lowest = -largest(-least) * LEAST / wider if curved else np.zeros(len(mesh.grid))
    # Cells of uniform jerk are bounded by ds² and dds at their moving end, which are the largest.
    ramps = mesh.ramps[mesh.cell] != 0
    return Bounds(
        x=HEADROOM * wider * most,
        u=HEADROOM_RATE * wider * largest(u),
        k=np.where(ramps, 0.0, HEADROOM_SLOPE * wider * largest(change)),
        least=np.where(ramps, 0.0, lowest),
    )


def _gain(rows: Rows, bounds: Bounds, law: PathLaw) -> float:
    """The share of the duration that wider bounds of a plan may save.

    At the end of the search the product of each slack and its multiplier is the same share of the
    duration, and the multiplier times the bound is the gain of a bound that is twice as wide.
    """
    inner = rows.mesh.ramps[rows.mesh.cell] == 0
    square, (_, dds, slope, _) = law.speeds**2, law.rates
    low = np.minimum(square[:-1], square[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        left = np.stack(
            [
                1 - np.maximum(square[:-1], square[1:]) / bounds.x,
                np.where(bounds.least > 0, low / bounds.least - 1, 1.0),
                1 - np.abs(dds) / bounds.u,
                1 - np.abs(slope) / bounds.k,
            ]
        )[:, inner]
    near = left[left < TOO_NEAR]
    return float(0.5 * EXACT / rows.count * (1 / np.maximum(near, TINY)).sum())


def _solve(rows: Rows, near: tuple[PathLaw, float], task: Task, tolerance: float) -> PathLaw:
    """The fastest motion within the rows.

    Args:
        rows: The rows of all sections.
        near: A plan to start from, and the share of its ds², as in `_start`.
        task: The problem.
        tolerance: Share of the optimum.

    Raises:
        NotRealizable: As `limit_jerk`.
    """
    mesh, found = rows.mesh, []
    speeds = np.square([task.start_speed, task.end_speed])
    for k, at_rest in enumerate(mesh.at_rest):
        p = rows.of_section(k)
        s = mesh.nodes[mesh.sections[k] : mesh.sections[k + 1] + 1]
        targets = np.where(at_rest, 0.0, speeds)
        d = _start(p, s, at_rest, near, targets, rows.steep(k))
        for goal, end, target in ((START, 0, targets[0]), (END, -1, targets[1])):
            most = float(p.high[end, 0 if end == 0 else 2])
            if (1 - CLOSE_TO_LIMIT) * target <= most:
                target = min(target, (1 - CLOSE_TO_LIMIT) * most)
            for weight in WEIGHTS:
                if d[end] < target:
                    improve(p, d, goal, target, weight, ROUGH, MOST_ITERATIONS)
            if d[end] < target:
                name = "start" if goal == START else "end"
                raise_too_fast(name, target, float(d[end]), float(s[end]))
        improve(p, d, DURATION, 0.0, 0.0, tolerance, task.iterations)
        found.append(d)
    return _law(rows, found)


def _start(
    p: Section,
    s: FloatArray,
    at_rest: BoolArray,
    near: tuple[PathLaw, float],
    targets: FloatArray,
    steep: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Control points of ds² of one section that keep every row, with its ends.

    A start is the given plan, lowered where it breaks rows. `ds^1.5` of a motion of uniform jerk
    from a rest is a line, so a slope that it may have everywhere bounds how fast a start rises.

    Args:
        p: The rows.
        s: Ends of the cells of the section [m].
        at_rest: Whether the motion rests at its ends.
        near: A plan, and the share of its ds² to begin with.
        targets: ds² at both ends [m²/s²].
        steep: The slope of ds^1.5, and that of ds², on every cell, (n,) each.

    Raises:
        NotRealizable: No motion keeps the rows, however slow.
    """
    law, share = near
    inner = s[int(at_rest[0]) : len(s) - int(at_rest[1])]
    middle = (inner[:-1] + inner[1:]) / 2
    way = np.diff(middle)
    d = np.empty(len(middle) + 2)
    whole = share * square_at(law, middle)
    if share == 1:
        power = whole**0.75
        for end in (0, -1):
            away = abs(middle[end] - s[end]) if at_rest[end] else 0.0
            least = steep[0][end] * away + targets[end] ** 0.75
            power[end] = min(power[end], least)
        limit_steps(power, np.minimum(steep[0][1:], steep[0][:-1]) * way)
        whole = power ** (4 / 3)
        limit_steps(whole, np.minimum(steep[1][1:], steep[1][:-1]) * way)
    ratio = ROOM * np.minimum(steep[0] / whole**0.75, steep[1] / whole)
    steps, doubled = np.minimum(ratio[1:], ratio[:-1]) * way, np.ones(len(way))
    part = np.ones(len(middle))
    for _ in range(MOST_LESS):
        # Where ds² more than doubles from cell to cell, the tangent may be negative at any scale.
        height = np.log2(whole * part ** (4 / 3))
        limit_steps(height, doubled)
        d[1:-1] = 2**height
        d[[0, -1]] = np.where(at_rest, 0.0, np.minimum(d[[1, -2]], targets))
        room = least_slacks(p, d)
        if (room > CLEAR).all():
            return d
        room[1:-1] = np.minimum(room[1:-1], np.minimum(room[:-2], room[2:]))
        part *= np.where(room > CLEAR, 1.0, np.clip(1 + room, LESS, MORE))
        limit_steps(part, steps)
    where = float(inner[int(p.cell[int(np.argmin(p.high.min(axis=1)))])])
    raise NotRealizable(
        f"At {where:.6g} m along the path the limits allow no motion at all, however slow.", s=where
    )


def _law(rows: Rows, found: Sequence[FloatArray]) -> PathLaw:
    """The time law of control points of ds² of all sections, with both ends of each."""
    mesh, begin, end = rows.mesh, rows.section.begin, rows.section.end
    grid, width, ramps = mesh.grid, mesh.width, mesh.ramps
    square = np.zeros((3, len(width)))  # control points of ds² on each cell
    for d, first, last, (start, stop) in zip(
        found, mesh.sections[:-1], mesh.sections[1:], mesh.at_rest, strict=True
    ):
        cells = slice(first + int(start), last - int(stop))
        around = np.stack([d[:-2], d[1:-1], d[2:]], axis=1)
        square[0, cells], square[2, cells] = (
            np.sum(x[cells] * around, axis=1) for x in (begin, end)
        )
        square[1, cells] = d[1:-1]
        # At the moving end of a cell of uniform jerk.
        if start:
            square[2, first] = square[0, first + 1]
        if stop:
            square[0, last - 1] = square[2, last - 2]
    i, n = mesh.cell, len(grid)
    x, y = (np.clip((s - mesh.nodes[i]) / width[i], 0, 1) for s in (grid.s[:-1], grid.s[1:]))
    first, last = ((square[1] - square[0]) / width)[i], ((square[2] - square[1]) / width)[i]
    slope = ((square[0] - 2 * square[1] + square[2]) / width**2)[i]
    dds = first + (last - first) * x
    ds, left = (np.sqrt(_parabola(square[:, i], z)) for z in (x, y))
    times, jerk = interval_times(grid.width, ds, left, slope), np.zeros(n)
    for sign, moving in ((1, 2), (-1, 0)):
        parts = np.flatnonzero(ramps[i] == sign)
        h = width[i[parts]]
        # Uniform jerk: the way is a third of the larger speed times the time from or to the rest.
        whole = 3 * h / np.sqrt(square[moving, i[parts]])
        jerk[parts] = 6 * h / whole**3
        since, until = (whole * np.cbrt(z[parts] if sign > 0 else 1 - z[parts]) for z in (x, y))
        ds[parts], dds[parts] = jerk[parts] * since**2 / 2, sign * jerk[parts] * since
        slope[parts], times[parts] = 0.0, np.abs(until - since)
    return PathLaw(
        joint_path=grid.joint_path,
        breaks=np.concatenate([[0.0], np.cumsum(times)]),
        s=grid.s,
        rates=Rates(ds=ds, dds=dds, slope=slope, jerk=jerk),
    )


def _parabola(points: FloatArray, x: FloatArray) -> FloatArray:
    """Parabolas of three control points at places from 0 to 1, (m,)."""
    return np.asarray(((1 - x) * points[0] + 2 * x * points[1]) * (1 - x) + x * x * points[2])
