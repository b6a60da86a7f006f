"""Kerf: judge offsets of random contours by distances, and parts that tool paths cut out.

The judge of offsets samples the contours, and has its own distances to lines and arcs. For each
offset it asks: Does every point have the distance d from the contour? Does the offset cover every
point at the distance d on its side to which no other part of the contour is nearer? Does it wind
around exactly those random points that are on this side and farther away than d?

The judge of parts cuts drawings with the planned tool path and compares the parts with the
drawings. It writes its own plates of lines and arcs to DXF files and samples them itself. It has
its own kinematics of a two-link arm, its own distances and its own inside test.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.program import Lead
from soak import Outcome
from soak.corners import Piece

# Largest difference between an offset's distance and the required one [m].
OFFSET = 1e-6
# Steps along a contour between samples, as a share of its length.
STEPS = 200
POINTS = 60


def shape(rng: np.random.Generator, scale: float, centre: ArrayLike = (0.0, 0.0)) -> ac.Path:
    """Draw a random closed contour of lines and arcs, within a circle of radius scale."""
    n = int(rng.integers(3, 11))
    angles = (
        np.sort(rng.uniform(0, 2 * np.pi, n))
        if rng.random() < 0.5
        else (np.arange(n) * 2 * np.pi / n)
    )
    knots = (
        scale * rng.uniform(0.1, 1, n)[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    )
    knots = centre + (knots[::-1] if rng.random() < 0.5 else knots)
    segments: list[ac.Line | ac.Arc] = []
    for a, b in zip(knots, np.roll(knots, -1, axis=0), strict=True):
        if rng.random() < 0.5:
            segments.append(ac.Line(start=a, end=b))
        else:
            across = np.array([a[1] - b[1], b[0] - a[0]])
            middle = (a + b) / 2 + rng.choice([-1, 1]) * rng.uniform(0.02, 0.25) * across
            segments.append(ac.Arc.through(a, middle, b))
    path = ac.Path(segments=segments)
    if rng.random() < 0.4:
        path = ac.round_corners(path, tolerance=scale * rng.uniform(0.001, 0.05))
    return path


def distances(points: np.ndarray, path: ac.Path) -> np.ndarray:
    """Return the distances of points to a path, segment by segment."""
    rows = zip(path.starts, path.tangents, path.normals, path.curvatures, path.lengths, strict=True)
    return np.min([Piece(*x).distance(points) for x in rows], axis=0)


def samples(path: ac.Path) -> tuple[np.ndarray, np.ndarray]:
    """Return points along a path and unit normals to its left; around corners all normals."""
    places = np.union1d(np.linspace(0, path.length, STEPS), path.breaks)
    points = []
    normals = []
    for side in ("left", "right"):
        tangents = path(places, 1, side=side)
        points.append(path(places))
        normals.append(np.column_stack([-tangents[:, 1], tangents[:, 0]]))
    before, after = normals
    for share in np.linspace(0.1, 0.9, 5):
        mixed = before * (1 - share) + after * share
        size = np.linalg.norm(mixed, axis=1)
        bent = size < 1 - 1e-9
        points.append(path(places[bent]))
        normals.append(mixed[bent] / size[bent, None])
    # The vertex at which a closed path begins.
    first = path(0.0, 1)
    last = path(path.length, 1, side="left")
    for share in np.linspace(0, 1, 7):
        t = first * (1 - share) + last * share
        points.append(path([0.0]))
        normals.append(np.array([[-t[1], t[0]]]) / np.linalg.norm(t))
    return np.concatenate(points), np.concatenate(normals)


def windings(points: np.ndarray, path: ac.Path) -> np.ndarray:
    """Return the winding numbers of a closed path around points, by a polygon of many sides."""
    fine = path(np.union1d(np.linspace(0, path.length, 5 * STEPS), path.breaks))
    angles = np.arctan2(fine[:, 1] - points[:, 1:], fine[:, 0] - points[:, :1])
    steps = (np.diff(angles, axis=1) + np.pi) % (2 * np.pi) - np.pi
    return np.round(steps.sum(axis=1) / (2 * np.pi)).astype(int)


def comes_back(path: ac.Path) -> bool:
    """Return whether two samples are nearer to each other than along a closed path."""
    n = 3 * STEPS
    points = path(np.linspace(0, path.length, n, endpoint=False))
    apart = np.abs(np.arange(n)[:, None] - np.arange(n))
    apart = np.minimum(apart, n - apart)
    near = np.linalg.norm(points[:, None] - points, axis=2) <= path.length / n
    return bool((near & (apart > 3)).any())


def judge_offset(rng: np.random.Generator, source: ac.Path, side: str, kerf: float) -> str:
    """Classify an offset: "offset", "parts", "vanished", "crossing"; else AssertionError."""
    d = kerf / 2
    scale = float(np.abs(source.vertices).max())
    program = ac.Program(moves=(ac.Contour(path=source, name="c", keep_start=True),))
    process = ac.Process(begin="drawn", kerf=kerf, kerf_side=side)
    try:
        contours = [x.path for x in ac.prepare(program, process).contours]
    except InvalidInput as error:
        if "crosses" in str(error):
            assert comes_back(source), "does not cross itself"
            return "crossing"
        assert "removes the whole contour" in str(error), str(error)
        assert error.allowed is not None and error.allowed < kerf
        contours = []
    sign = 1 if side == "left" else -1
    places = rng.uniform(-1.1 * scale - 1.1 * d, 1.1 * scale + 1.1 * d, (POINTS, 2))
    away = distances(places, source)
    turns = windings(places, source)
    # The direction of the contour, by its area.
    x, y = source(np.linspace(0, source.length, 5 * STEPS)).T
    about = 1 if np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]) > 0 else -1
    held = (turns != 0) == (about * sign > 0)
    # Nearer than that, the chords of the windings decide.
    sure = (np.abs(away - d) > 1e-4 * scale) & (away > 1e-3 * scale)
    expected = held & (away > d)
    around = sum((windings(places, x) for x in contours), np.zeros(POINTS, dtype=int))
    inside = around != 0 if about * sign > 0 else around == 0
    if contours or about * sign > 0:
        assert (inside == expected)[sure].all(), "another area"
    for x in contours:
        on = x(np.linspace(0, x.length, STEPS))
        worst = np.abs(distances(on, source) - d).max()
        assert worst <= OFFSET, f"{worst:.3g} m off"
        assert np.linalg.norm(x(0.0) - x(x.length)) <= 1e-9, "open"
    points, normals = samples(source)
    targets = points + sign * d * normals
    targets = targets[distances(targets, source) >= d - 1e-12]
    if len(targets) and contours:
        missed = np.min([distances(targets, x) for x in contours], axis=0).max()
        assert missed <= OFFSET, f"{missed:.3g} m missed"
    elif len(targets):
        # If the offset shrinks to a point, rounding may leave this point.
        apart = np.linalg.norm(targets - targets[0], axis=1).max()
        assert apart <= OFFSET, "vanished, but should not"
    return ("vanished", "offset")[len(contours)] if len(contours) < 2 else "parts"


def run_offset(seed: int) -> str:
    """Judge the problem of a seed."""
    rng = np.random.default_rng(seed)
    outcome = "crossing"
    # Shapes that cross are drawn anew.
    while outcome == "crossing":
        scale = 10 ** rng.uniform(-2.5, -0.5)
        side = "left" if rng.random() < 0.5 else "right"
        share = rng.uniform(0.1, 0.6) if seed % 5 == 3 else 10 ** rng.uniform(-3, 0.2)
        outcome = judge_offset(rng, shape(rng, scale), side, scale * share)
    return outcome


# Largest deviation of the part from the drawing, beside the tolerance of corners [m].
ALLOWED = 1e-7
# Largest distance of chords between sampled points from arcs of the drawing [m].
SAGITTA = 5e-9
# Largest spacing of sampled points [m].
SPACING = 1e-4
# Corner tolerance of the plan [m].
CORNERS = 1e-4
# Time between points of its tool path [s].
STEP = 2e-4
# Lengths of both links [m].
LINKS = (0.5, 0.5)
# Where plates lie [m].
PLACE = (0.45, 0.2)
# Largest size of a drawing [m]; larger drawings are scaled down.
LARGEST = 0.3
# Length of a program up to which it is planned [m]; of a longer one the path alone is judged.
LONGEST = 10.0
LAYERS = ("CUT", "HOLES", "PARTS", "0")


@dataclass
class Part:
    """What is drawn: dense polylines [m], closed ones with equal ends."""

    closed: list[np.ndarray] = field(default_factory=list)
    opened: list[np.ndarray] = field(default_factory=list)

    @property
    def waste(self) -> list[bool]:
        """Whether the waste is inside of each closed polyline."""
        flags = []
        for i, x in enumerate(self.closed):
            others = [y for k, y in enumerate(self.closed) if k != i]
            around = sum(inside(x[:1], y)[0] for y in others)
            flags.append(around % 2 == 1)
        return flags


@dataclass
class Verdict:
    """Deviations of a part from its drawing."""

    cut_into: float
    left_over: float
    reached: float
    open_error: float


def inside(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """Return whether points are inside of a closed polyline, by crossings of a ray."""
    ax, ay = polygon[:-1].T
    bx, by = polygon[1:].T
    parity = np.zeros(len(points), dtype=bool)
    for i, (x, y) in enumerate(points):
        cross = (ay > y) != (by > y)
        crossing_x = ax[cross] + (y - ay[cross]) / (by[cross] - ay[cross]) * (bx[cross] - ax[cross])
        parity[i] = np.count_nonzero(crossing_x > x) % 2 == 1
    return parity


class Distances:
    """Distances to dense polylines: to both segments at each of the nearest points."""

    def __init__(self, lines: list[np.ndarray]) -> None:
        self.a = np.concatenate([x[:-1] for x in lines])
        self.b = np.concatenate([x[1:] for x in lines])
        self.tree = cKDTree(np.concatenate([self.a, self.b]))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Return the distance of each point from the nearest polyline."""
        n = len(self.a)
        nearest = np.full(len(points), np.inf)
        for near in self.tree.query(points, k=min(6, 2 * n))[1].T:
            a, b = self.a[near % n], self.b[near % n]
            along = np.einsum("ij,ij->i", points - a, b - a)
            share = np.clip(along / np.einsum("ij,ij->i", b - a, b - a), 0, 1)
            away = np.linalg.norm(points - a - share[:, None] * (b - a), axis=1)
            nearest = np.minimum(nearest, away)
        return nearest


def judge(part: Part, tools: list[np.ndarray], leads: list[np.ndarray], kerf: float) -> Verdict:
    """Return how the cut part deviates from the drawing.

    Raises:
        AssertionError: The tool is on the wrong side of a contour.
    """
    half = kerf / 2
    drawn = Distances(part.closed)
    rings = [x for x in tools if (x[0] == x[-1]).all()]
    lines = [x for x in tools if (x[0] != x[-1]).any()]
    for x in (*rings, *leads):
        depth = sum(inside(x[:: max(1, len(x) // 3)], y).astype(int) for y in part.closed)
        assert (depth % 2 == 0).all(), "wrong side"
    cut_into = max(float((half - drawn(x)).max()) for x in (*rings, *leads))
    cut = Distances(rings)
    left_over = 0.0
    reachable = 0
    edges = 0
    for x, waste_inside in zip(part.closed, part.waste, strict=True):
        step = np.diff(x, axis=0)
        middle = (x[:-1] + x[1:]) / 2
        normal = np.column_stack([-step[:, 1], step[:, 0]])
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        area = np.sum(x[:-1, 0] * x[1:, 1] - x[1:, 0] * x[:-1, 1]) / 2
        centers = middle + half * normal * (1 if (area > 0) == waste_inside else -1)
        reached = drawn(centers) >= half - 1e-8
        edges = edges + len(reached)
        reachable = reachable + int(reached.sum())
        if reached.any():
            left_over = max(left_over, float((cut(middle[reached]) - half).max()))
    open_error = 0.0
    if part.opened or lines:
        part_distance = Distances(part.opened)
        contour_distance = Distances(lines)
        open_error = max(float(part_distance(np.concatenate(lines)).max()), 0.0)
        open_error = max(open_error, float(contour_distance(np.concatenate(part.opened)).max()))
    return Verdict(cut_into, left_over, reachable / edges, open_error)


# A vertex with the bulge of DXF on the way to the next vertex [mm].
Vertices = list[tuple[float, float, float]]


def sampled(vertices: Vertices, closed: bool) -> np.ndarray:
    """Sample a polyline with bulges densely, in its unit, given in mm."""
    sagitta = 1e3 * SAGITTA
    spacing = 1e3 * SPACING
    ends = [*vertices[1:], vertices[0]] if closed else vertices[1:]
    points = []
    for (ax, ay, bulge), (bx, by, _) in zip(vertices, ends, strict=False):
        a = np.array([ax, ay])
        b = np.array([bx, by])
        size = float(np.linalg.norm(b - a))
        if bulge == 0:
            share = np.linspace(0, 1, max(2, int(size / spacing) + 2))[:-1, None]
            points.append(a + share * (b - a))
            continue
        turn = 4 * np.arctan(bulge)
        radius = size / 2 / np.sin(abs(turn) / 2)
        # The centre lies to the left of the chord for an arc to the left of up to half a circle.
        normal = np.array([ay - by, bx - ax]) / size
        center = (a + b) / 2 + normal * np.sign(turn) * radius * np.cos(turn / 2)
        step = min(np.sqrt(8 * sagitta / radius), spacing / radius)
        angles = np.linspace(0, turn, int(abs(turn) / step) + 2)[:-1, None]
        x, y = (a - center)[0], (a - center)[1]
        points.append(
            center + np.cos(angles) * np.array([x, y]) + np.sin(angles) * np.array([-y, x])
        )
    last = points[0][:1] if closed else np.array([vertices[-1][:2]])
    return np.concatenate([*points, last])


def _blob(rng: np.random.Generator, radius: float, kerf: float) -> Vertices:
    """Draw a random closed shape around the origin within a radius [mm]."""
    kind = rng.integers(4)
    if kind == 0 or radius < 2:
        r = radius * rng.uniform(0.6, 1)
        return [(r, 0, 1), (-r, 0, 1)]
    if kind == 1:
        r = radius * rng.uniform(0.25, 0.45)
        half = radius / 2
        return [(-half, -r, 0), (half, -r, 1), (half, r, 0), (-half, r, 1)]
    n = int(rng.integers(3, 8))
    angles = 2 * np.pi * (np.arange(n) + rng.uniform(0, 0.4, n)) / n
    radii = radius * (rng.uniform(0.6, 1, n) if n > 3 else np.ones(n)) * (0.95 if n > 3 else 1)
    bulges = rng.uniform(-0.15, 0.1, n) if kind == 3 and n > 4 else np.zeros(n)
    return [
        (r * np.cos(a), r * np.sin(a), b) for r, a, b in zip(radii, angles, bulges, strict=True)
    ]


def _turned(vertices: Vertices) -> Vertices:
    """Return a closed shape in the other direction."""
    points = [x[:2] for x in vertices[::-1]]
    bulges = [-x[2] for x in vertices[-2::-1]] + [-vertices[-1][2]]
    return [(x, y, b) for (x, y), b in zip(points, bulges, strict=True)]


def plate(rng: np.random.Generator, kerf: float) -> tuple[bytes, Part]:
    """Draw a DXF file of a random plate (holes, islands, blocks, open contours) and its part."""
    import ezdxf

    document = ezdxf.new("R2010")
    document.header["$INSUNITS"] = 4
    space = document.modelspace()
    part = Part()

    def add(vertices: Vertices, position: np.ndarray, closed: bool = True) -> None:
        layer = str(rng.choice(LAYERS))
        vertices = _turned(vertices) if closed and rng.random() < 0.5 else vertices
        angle = rng.uniform(0, 2 * np.pi) if closed and rng.random() < 0.7 else 0.0
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        line = sampled(vertices, closed) @ turn.T + position
        (part.closed if closed else part.opened).append(1e-3 * line + PLACE)
        # A block that is inserted, or a polyline in its place.
        if rng.random() < 0.4:
            block = document.blocks.new(f"B{len(document.blocks)}")
            block.add_lwpolyline(vertices, format="xyb", close=closed, dxfattribs={"layer": layer})
            space.add_blockref(block.name, position, dxfattribs={"rotation": np.degrees(angle)})
            return
        moved = [(*(turn @ x[:2] + position), x[2]) for x in vertices]
        space.add_lwpolyline(moved, format="xyb", close=closed, dxfattribs={"layer": layer})

    columns = int(rng.integers(1, 4))
    rows = int(rng.integers(1, 3))
    cell = 24.0
    x, y = columns * cell + 4, rows * cell + 4
    r = rng.choice([0.0, 3.0])
    q = np.tan(np.pi / 8)
    if r:
        outline = [(r, 0, 0), (x - r, 0, q), (x, r, 0), (x, y - r, q), (x - r, y, 0)]
        outline += [(r, y, q), (0, y - r, 0), (0, r, q)]
    else:
        outline = [(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)]
    line = sampled(outline, True)
    part.closed.append(1e-3 * line + PLACE)
    layer = {"layer": str(rng.choice(LAYERS))}
    space.add_lwpolyline(outline, format="xyb", close=True, dxfattribs=layer)
    for column in range(columns):
        for row in range(rows):
            center = np.array([2 + cell * (column + 0.5), 2 + cell * (row + 0.5)])
            kind = rng.integers(5)
            if kind < 2:
                add(_blob(rng, rng.uniform(max(3.0, 2.2 * kerf), 10), kerf), center)
            elif kind < 4:
                add([(10, 0, 1), (-10, 0, 1)], center)
                inner = 9.5 - 1.05 * kerf
                add(_blob(rng, inner, kerf), center)
                deepest = 0.3 * inner - 0.3
                if deepest > 0.6 * kerf and rng.random() < 0.5:
                    add([(deepest / 2, 0, 1), (-deepest / 2, 0, 1)], center)
            else:
                points = rng.uniform(-8, 8, (3, 2))
                add([(*p, 0.0) for p in points], center, closed=False)
    with tempfile.NamedTemporaryFile("w+", suffix=".dxf") as file:
        document.write(file)
        file.flush()
        return Path(file.name).read_bytes(), part


def tool_path(program: ac.Program) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Return the planned tool path along each contour, and its leads, from the joints of a plan."""
    limits = ac.Limits.only(joint_acceleration=20.0, speed=0.1, centripetal_acceleration=0.5)
    arm = ac.PlanarTwoLink(name="two links", base=0.0, links=LINKS, limits=limits)
    planned = ac.plan(program, arm, limits)
    samples = planned.sample(STEP)
    first = samples.q[:, 0]
    both = samples.q.sum(axis=1)
    points = LINKS[0] * np.column_stack([np.sin(first), np.cos(first)])
    points += LINKS[1] * np.column_stack([np.sin(both), np.cos(both)])
    tools = []
    leads = []
    for contour, span in zip(program.contours, planned.contour_spans, strict=True):
        assert span.work is not None
        cuts = np.searchsorted(samples.t, [span.t[0], *span.work, span.t[1]])
        before, work, after = (points[a:b] for a, b in zip(cuts, cuts[1:], strict=False))
        if contour.closed:
            # Work begins and ends between two samples.
            tools.append(np.concatenate([work, work[:1]]))
            leads += [x for x in (before, after) if len(x)]
        else:
            tools.append(work)
    return tools, leads


def check_part(verdict: Verdict) -> None:
    """Refuse a part that deviates from its drawing.

    Raises:
        AssertionError: A deviation exceeds what is allowed.
    """
    assert verdict.cut_into <= ALLOWED, f"cut {verdict.cut_into:.3g} m into the part"
    assert verdict.left_over <= ALLOWED + CORNERS, f"{verdict.left_over:.3g} m are left over"
    assert verdict.open_error <= ALLOWED + CORNERS, f"open contour {verdict.open_error:.3g} m off"


def points_on(path: ac.Path, begin: float, end: float) -> np.ndarray:
    """Sample a path densely between two arc lengths [m]."""
    steps = np.minimum(SPACING, np.sqrt(8 * SAGITTA / np.maximum(path.curvatures, 1e-9)))
    ends = zip(path.breaks, path.lengths / steps, np.roll(path.breaks, -1), strict=False)
    s = np.concatenate([np.linspace(a, b, int(n) + 2) for a, n, b in ends])
    return path(np.unique(np.clip(s, begin, end)))


def run_file(file: Path, kerf: float) -> tuple[str, Verdict | None]:
    """Cut the drawing of a file, which the package reads, and judge the part.

    Drawings of more than LONGEST are judged by the path that would be planned.
    """
    corners = np.concatenate(
        [x.path.vertices for x in ac.read_path(file, ac.ReadOptions(ignore_z=True)).contours]
    )
    scale = min(1.0, LARGEST / float(np.ptp(corners, axis=0).max()))
    position = np.array(PLACE) - scale * corners.min(axis=0)
    drawing = ac.read_path(
        file, ac.ReadOptions(ignore_z=True, scale=scale), frame=ac.Frame(position=(*position, 0))
    )
    part = Part()
    for x in drawing.contours:
        (part.closed if x.closed else part.opened).append(points_on(x.path, 0.0, x.path.length))
    process = ac.Process(kerf=kerf, order="drawn")
    program = ac.round_corners(ac.prepare(drawing, process), tolerance=CORNERS)
    if program.length <= LONGEST:
        tools, leads = tool_path(program)
    else:
        tools = [points_on(x.path, *x.at_work) for x in program.contours]
        leads = []
    verdict = judge(part, tools, leads, kerf)
    check_part(verdict)
    return "part", verdict


def run_plate(seed: int) -> tuple[str, Verdict | None]:
    """Cut the plate of a seed and judge it; "refused" if its kerf or its leads do not fit.

    In the place of leads that are refused, the longest that are said to fit are judged.
    """
    rng = np.random.default_rng([seed, 17])
    kerf = float(np.exp(rng.uniform(np.log(0.2), np.log(3))))
    data, part = plate(rng, kerf)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "plate.dxf"
        file.write_bytes(data)
        drawing = ac.read_path(file, frame=ac.Frame(position=(*PLACE, 0)))
    length: float | None = 1e-3 * rng.uniform(0.3, 4) if rng.random() < 0.5 else None
    begin = str(rng.choice(["auto", "drawn"]))
    while True:
        lead = None if length is None else Lead(length=length, shape="arc")
        process = ac.Process(kerf=1e-3 * kerf, begin=begin, lead_in=lead, lead_out=lead)
        try:
            prepared = ac.prepare(drawing, process)
            tools, leads = tool_path(ac.round_corners(prepared, tolerance=CORNERS))
        except InvalidInput as error:
            assert error.allowed is not None, str(error)
            if "lead-" not in str(error):
                return "refused kerf", None
            if not error.allowed:
                return "refused lead", None
            length = error.allowed
        else:
            break
    verdict = judge(part, tools, leads, 1e-3 * kerf)
    check_part(verdict)
    return "part with leads" if leads else "part", verdict


def run(seed: int) -> Outcome:
    """Judge an offset, and every tenth time a part."""
    try:
        if seed % 10:
            return Outcome(kind="offset", result=run_offset(seed))
        return Outcome(kind="part", result=run_plate(seed)[0])
    except AssertionError as error:
        return Outcome(result="wrong", notes=[str(error)])
