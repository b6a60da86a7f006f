"""Plans with limits of jerk, computed from a plan without limits of jerk."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain, pairwise

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import PathLaw, Rates, interval_times
from armcontour.planning.constraints import JointMotion
from armcontour.planning.jerk.interior_point import JerkSection, improve, least_slacks, limit_steps
from armcontour.planning.jerk.mesh import (
    End,
    JerkMesh,
    find_ends,
    find_sections,
    place_mesh,
    square_at,
)
from armcontour.planning.jerk.mesh_rows import MeshRows
from armcontour.planning.timing_options import Task
from armcontour.planning.topp.limit_forms import MotionBounds

# Default number of cells per build-up time of the acceleration, during non-uniform motion.
PER_BUILD_UP = 2.0
# Smallest default number of cells, in addition to FEWEST_CELLS_PER_PIECE for each polynomial.
FEWEST_CELLS = 1000
# Smallest default number of cells for each polynomial of the joint path, in addition to
# FEWEST_CELLS.
FEWEST_CELLS_PER_PIECE = 3
# Largest default number of cells. If the constants above give more, the jerk is so large that fewer
# cells resolve its effect: MANY_CELLS plus MANY_PER_PIECE for each polynomial.
MAX_CELLS = 20_000
# Default number of cells with so large a jerk, in addition to MANY_PER_PIECE for each polynomial.
MANY_CELLS = 4000
# Default number of cells for each polynomial with so large a jerk, in addition to MANY_CELLS.
MANY_PER_PIECE = 8
# With so large a jerk, each further section counts as this many more polynomials, because of the
# cells at its ends.
PIECES_OF_SECTION = 10
# Motion is uniform if its path acceleration is below this fraction of the largest path
# acceleration.
UNIFORM = 0.01
# The first pass has fewer cells than the second pass by this factor.
COARSER = 5
# Smallest number of cells of the first pass.
FEWEST_FIRST_CELLS = 60
# Tolerance of the first pass: relative duality gap at which its search ends.
COARSE_GAP = 1e-2
# Tolerance of the second pass, which gives the plan: relative duality gap at which its search ends.
FINE_GAP = 1e-4
# The second pass starts from ds² of the first plan times this factor.
FIRST_PLAN_SHARE = 0.9
# Smallest factor by which a start, the initial ds² of a search, is reduced near violated rows.
MIN_FACTOR = 0.5
# Largest factor by which a start is reduced near violated rows.
MAX_FACTOR = 0.95
# Largest number of reductions of a start.
MAX_REDUCTIONS = 400
# The factor of a start rises with the distance from violated rows by at most this fraction of the
# slopes that jerk and acceleration allow.
RISE_SHARE = 0.1
# Smallest relative slack of a start.
CLEAR = 1e-4
# Margins are valid for ds² up to this multiple of its value in the previous plan.
HEADROOM = 1.5
# Margins are valid for |dds| up to this multiple of its value in the previous plan.
HEADROOM_RATE = 2.0
# Margins are valid for slopes of dds up to this multiple of their values in the previous plan.
HEADROOM_SLOPE = 4.0
# If rows need a lower bound of ds², it is this fraction of ds² in the previous plan.
LEAST_SQUARE = 0.3
# Smallest bound of dds, as a fraction of the largest dds.
LEAST_RATE = 0.02
# Relative distance from the plan below which a bound of the second pass may cost time.
TOO_NEAR = 0.02
# If bounds may cost time, the second pass is repeated with bounds that are wider by this factor.
WIDER = 2.0
# Largest total factor by which bounds are widened.
WIDEST_BOUNDS = 16.0
# The second pass is repeated only if wider bounds may save at least this fraction of the duration.
LEAST_BOUND_GAIN = 1e-5
# Relative distances of bounds from the plan below this are rounding errors.
BOUND_DISTANCE_ROUNDING = 1e-9
# Cells whose margins take more than this fraction of a limit are split.
LARGEST_CELL_MARGIN = 1e-2
# Largest number of parts into which a cell is split at once.
MAX_CELL_PARTS = 10
# Largest number of times that cells are split, or that bounds on cells of uniform jerk are reduced.
MAX_CELL_SPLITS = 6
# Largest fraction of a limit that margins may take on cells of uniform jerk.
MAX_AT_RAMPS = 0.5


def limit_jerk(law: PathLaw, task: Task) -> PathLaw:
    """Plan the fastest motion with limits of jerk, from a plan without limits of jerk."""
    section_ends = find_sections(law, task)
    ends = find_ends(law, task, section_ends)
    cells = _default_cells(law, ends) if task.cells is None else task.cells
    if all(isinstance(x, JointMotion) for x in task.active):
        # Rows of joint motion are exact, so that they need no bounds from a first pass.
        mesh = place_mesh(law, law.s, cells, section_ends, ends)
        return _solve(_make_rows(task, mesh, law), (law, 1.0), task, FINE_GAP)
    # Each polynomial of the joint path has rows of its own, so fewer cells would save little time.
    coarse = max(cells // COARSER, FEWEST_FIRST_CELLS, len(law.joint_path.breaks) // 2)
    mesh = place_mesh(law, law.s, coarse, section_ends, ends)
    coarse_law = _solve(_make_rows(task, mesh, law), (law, 1.0), task, COARSE_GAP)
    mesh = place_mesh(
        coarse_law, law.s, cells, section_ends, find_ends(coarse_law, task, section_ends)
    )
    return _solve_with_margins(mesh, coarse_law, task)


def _solve_with_margins(mesh: JerkMesh, near: PathLaw, task: Task) -> PathLaw:
    """Make the second pass for limits that need margins inside cells.

    - `near`: plan of the first pass.
    """
    curved = any(x.curved for x in task.active)
    splits = 0
    wider = 1.0
    best = None
    while True:
        bounds = _make_bounds(mesh, near, wider, curved)
        rows = _make_rows(task, mesh, near, bounds)
        narrow = (rows.lost > LARGEST_CELL_MARGIN) & (mesh.ramps[mesh.cell] == 0)
        if splits < MAX_CELL_SPLITS and narrow.any() and len(mesh.grid) < MAX_CELLS:
            parts = np.where(narrow, np.sqrt(rows.lost / LARGEST_CELL_MARGIN), 1)
            mesh = mesh.split(np.clip(parts, 1, MAX_CELL_PARTS))
            splits = splits + 1
            continue
        rows = _reduce_ramp_bounds(rows, task, near)
        try:
            law = _solve(rows, (near, FIRST_PLAN_SHARE), task, FINE_GAP)
        except NotRealizable:
            if not curved:
                if best is None:
                    raise
                return best
            # Rows that are valid down to rest always allow slow motion.
            curved = False
            continue
        if best is None or law.breaks[-1] < best.breaks[-1]:
            best = law
        if wider >= WIDEST_BOUNDS or _estimate_gain(rows, bounds, law) < LEAST_BOUND_GAIN:
            return best
        near = law
        wider = wider * WIDER


def _reduce_ramp_bounds(rows: MeshRows, task: Task, near: PathLaw) -> MeshRows:
    """Reduce bounds on cells of uniform jerk whose margins are too large."""
    # Cells of uniform jerk are not split. Their bounds limit the plan, and the margins decrease
    # with the bounds.
    for _ in range(MAX_CELL_SPLITS):
        bounds = rows.bounds
        mesh = rows.mesh
        tight = (rows.lost > MAX_AT_RAMPS) & (mesh.ramps[mesh.cell] != 0)
        if bounds is None or not tight.any():
            break
        share = np.where(tight, MAX_AT_RAMPS / np.maximum(rows.lost, 1), 1.0)
        bounds = bounds._replace(x=share * bounds.x, u=share * bounds.u)
        rows = _make_rows(task, mesh, near, bounds)
    return rows


def _make_rows(
    task: Task, mesh: JerkMesh, near: PathLaw, bounds: MotionBounds | None = None
) -> MeshRows:
    """Make the rows of all limits on a mesh, with curved limits linearized about `near`."""
    about = square_at(near, (mesh.grid.s[:-1] + mesh.grid.s[1:]) / 2)
    return MeshRows(mesh, task.active, task.jerk, bounds, about)


def _default_cells(law: PathLaw, ends: list[tuple[End, End]]) -> int:
    """Return the default number of cells: in proportion to non-uniform time over build-up time."""
    scales = [(x.acceleration, x.jerk) for x in chain.from_iterable(ends)]
    acceleration, jerk = np.median(scales, axis=0)
    times = np.diff(law.breaks)
    _, dds, slope, _ = law.rates
    largest = np.maximum(np.abs(dds), np.abs(dds + slope * np.diff(law.s)))
    active = float(times[largest > UNIFORM * acceleration].sum())
    with np.errstate(divide="ignore"):
        resolved = PER_BUILD_UP * active * np.divide(jerk, acceleration)
    pieces = len(law.joint_path.breaks) - 1
    count = max(np.nan_to_num(resolved), FEWEST_CELLS + FEWEST_CELLS_PER_PIECE * pieces)
    if count > MAX_CELLS:
        pieces += PIECES_OF_SECTION * (len(ends) - 1)
        count = min(MANY_CELLS + MANY_PER_PIECE * pieces, MAX_CELLS)
    return int(count)


def _make_bounds(mesh: JerkMesh, near: PathLaw, wider: float, curved: bool) -> MotionBounds:
    """Make the bounds within which margins are valid: multiples of the plan `near`.

    - `wider`: factor of all bounds.
    - `curved`: true if rows also need a lower bound of ds².
    """
    ds, dds, slope, _ = near.rates
    width = np.diff(near.s)
    speed = near.speeds
    x = np.maximum(speed[:-1], speed[1:]) ** 2
    last = near.path_position(np.arange(len(width)), near.breaks[1:], 2)
    u = np.maximum(np.abs(dds), np.abs(last))
    # Uniform motion has dds = 0, but a bound of zero would exclude any other motion.
    u = np.maximum(u, LEAST_RATE * u.max())
    change = np.maximum(np.abs(slope), u / width)
    smallest = np.minimum(speed[:-1], speed[1:]) ** 2
    # The bounds of a cell are taken from the cells of the plan `near` that overlap it, and from the
    # neighbours of these cells.
    s = mesh.grid.s
    first = np.searchsorted(near.s, s[:-1], side="right") - 2
    count = np.searchsorted(near.s, s[1:], side="left") + 1
    first = np.clip(first, 0, len(width) - 1)
    count = np.clip(count, 1, len(width))
    touched = np.stack([first, np.maximum(count, first + 1)], axis=1).ravel()

    def largest(values: FloatArray) -> FloatArray:
        padded = np.append(values, -np.inf)
        return np.asarray(np.maximum.reduceat(padded, touched)[::2])

    largest_square = largest(x)
    lowest = -largest(-smallest) * LEAST_SQUARE / wider if curved else np.zeros(len(mesh.grid))
    # Cells of uniform jerk are bounded by ds² and dds at their moving end, which are the largest.
    ramps = mesh.ramps[mesh.cell] != 0
    return MotionBounds(
        x=HEADROOM * wider * largest_square,
        u=HEADROOM_RATE * wider * largest(u),
        k=np.where(ramps, 0.0, HEADROOM_SLOPE * wider * largest(change)),
        x_min=np.where(ramps, 0.0, lowest),
    )


def _estimate_gain(rows: MeshRows, bounds: MotionBounds, law: PathLaw) -> float:
    """Estimate the fraction of the duration that wider bounds of a plan may save."""
    # At the end of the search, the product of slack and multiplier is the same fraction of the
    # duration for all bounds. The multiplier times the bound is the time that a bound of twice the
    # width saves.
    inner = rows.mesh.ramps[rows.mesh.cell] == 0
    square = law.speeds**2
    _, dds, slope, _ = law.rates
    low = np.minimum(square[:-1], square[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.stack(
            [
                1 - np.maximum(square[:-1], square[1:]) / bounds.x,
                np.where(bounds.x_min > 0, low / bounds.x_min - 1, 1.0),
                1 - np.abs(dds) / bounds.u,
                1 - np.abs(slope) / bounds.k,
            ]
        )[:, inner]
    close = distance[distance < TOO_NEAR]
    return float(
        0.5 * FINE_GAP / rows.count * (1 / np.maximum(close, BOUND_DISTANCE_ROUNDING)).sum()
    )


def _solve(rows: MeshRows, near: tuple[PathLaw, float], task: Task, tolerance: float) -> PathLaw:
    """Find the fastest motion within the rows of all sections.

    - `near`: as in `_find_start`.
    - `tolerance`: relative duality gap at which the search of a section ends.
    """
    mesh = rows.mesh
    solutions = []
    for k, (first, last) in enumerate(pairwise(mesh.sections)):
        p = rows.select_section(k)
        d = _find_start(p, mesh.nodes[first : last + 1], near, rows.allowed_slopes(k))
        improve(p, d, tolerance, task.iterations)
        solutions.append(d)
    return _make_law(rows, solutions)


def _find_start(
    p: JerkSection,
    s: FloatArray,
    near: tuple[PathLaw, float],
    allowed_slopes: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Find a section's control points of ds², including its ends, that satisfy all rows [m²/s²].

    The start is ds² of the plan in `near` times the factor in `near`, reduced near violated rows.
    With uniform jerk from a rest, ds^1.5 is linear in s, so the allowed slope of ds^1.5 limits the
    rise of a start.

    `allowed_slopes` are the allowed slopes of ds^1.5 and of ds² on every cell, (n,) each.
    """
    law, share = near
    inner = s[1:-1]
    middle = (inner[:-1] + inner[1:]) / 2
    spacing = np.diff(middle)
    d = np.zeros(len(middle) + 2)
    profile = share * square_at(law, middle)
    if share == 1:
        power = profile**0.75
        for end in (0, -1):
            power[end] = min(power[end], allowed_slopes[0][end] * abs(middle[end] - s[end]))
        limit_steps(power, np.minimum(allowed_slopes[0][1:], allowed_slopes[0][:-1]) * spacing)
        profile = power ** (4 / 3)
        limit_steps(profile, np.minimum(allowed_slopes[1][1:], allowed_slopes[1][:-1]) * spacing)
    ratio = RISE_SHARE * np.minimum(allowed_slopes[0] / profile**0.75, allowed_slopes[1] / profile)
    steps = np.minimum(ratio[1:], ratio[:-1]) * spacing
    doubled = np.ones(len(spacing))
    part = np.ones(len(middle))
    for _ in range(MAX_REDUCTIONS):
        # If ds² more than doubles between cells, the tangent may be negative at any scale.
        height = np.log2(profile * part ** (4 / 3))
        limit_steps(height, doubled)
        d[1:-1] = 2**height
        room = least_slacks(p, d)
        if (room > CLEAR).all():
            return d
        room[1:-1] = np.minimum(room[1:-1], np.minimum(room[:-2], room[2:]))
        part *= np.where(room > CLEAR, 1.0, np.clip(1 + room, MIN_FACTOR, MAX_FACTOR))
        limit_steps(part, steps)
    s_blocked = float(inner[int(p.cell[int(np.argmin(p.high.min(axis=1)))])])
    raise NotRealizable(
        f"At {s_blocked:.6g} m along the path the limits allow no motion, even at the lowest "
        "speed. Raise the limits, or change the path.",
        s=s_blocked,
    )


def _make_law(rows: MeshRows, solutions: Sequence[FloatArray]) -> PathLaw:
    """Make the time law from the control points of ds² of all sections, including their ends."""
    mesh = rows.mesh
    begin = rows.section.begin
    end = rows.section.end
    grid = mesh.grid
    width = mesh.width
    ramps = mesh.ramps
    # Control points of ds² on each cell [m²/s²], (3, cells)
    square = np.zeros((3, len(width)))
    for d, (first, last) in zip(solutions, pairwise(mesh.sections), strict=True):
        cells = slice(first + 1, last - 1)
        around = np.stack([d[:-2], d[1:-1], d[2:]], axis=1)
        square[0, cells], square[2, cells] = (
            np.sum(x[cells] * around, axis=1) for x in (begin, end)
        )
        square[1, cells] = d[1:-1]
        # ds² at the moving end of a cell of uniform jerk equals ds² at the end of the adjacent
        # cell.
        square[2, first] = square[0, first + 1]
        square[0, last - 1] = square[2, last - 2]
    i = mesh.cell
    n = len(grid)
    x, y = (np.clip((s - mesh.nodes[i]) / width[i], 0, 1) for s in (grid.s[:-1], grid.s[1:]))
    first = ((square[1] - square[0]) / width)[i]
    last = ((square[2] - square[1]) / width)[i]
    slope = ((square[0] - 2 * square[1] + square[2]) / width**2)[i]
    dds = first + (last - first) * x
    ds, end_speed = (np.sqrt(_parabola(square[:, i], z)) for z in (x, y))
    times = interval_times(grid.width, ds, end_speed, slope)
    jerk = np.zeros(n)
    for sign, moving in ((1, 2), (-1, 0)):
        parts = np.flatnonzero(ramps[i] == sign)
        h = width[i[parts]]
        # With uniform jerk, the length of the cell is a third of the speed at its moving end times
        # the time from or to the rest.
        ramp_time = 3 * h / np.sqrt(square[moving, i[parts]])
        jerk[parts] = 6 * h / ramp_time**3
        # Times between the rest and both ends of each part.
        begin_time, end_time = (
            ramp_time * np.cbrt(z[parts] if sign > 0 else 1 - z[parts]) for z in (x, y)
        )
        ds[parts] = jerk[parts] * begin_time**2 / 2
        dds[parts] = sign * jerk[parts] * begin_time
        slope[parts] = 0.0
        times[parts] = np.abs(end_time - begin_time)
    return PathLaw(
        joint_path=grid.joint_path,
        breaks=np.concatenate([[0.0], np.cumsum(times)]),
        s=grid.s,
        rates=Rates(ds=ds, dds=dds, slope=slope, jerk=jerk),
    )


def _parabola(points: FloatArray, x: FloatArray) -> FloatArray:
    """Return the parabolas with three control points each, (3, n), at fractions x, (n,)."""
    return np.asarray(((1 - x) * points[0] + 2 * x * points[1]) * (1 - x) + x * x * points[2])
