"""Pairs of bodies for clearance checks, and their distances by the library coal."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import combinations
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray, kernel_array
from armcontour.core.errors import InvalidInput
from armcontour.robot import Arm, Chain
from armcontour.robot.chain import joint_frames, link_poses, link_table
from armcontour.robot.kernels import frames_of
from armcontour.robot.scene import (
    BASE,
    PART,
    TOOL,
    ArmShapes,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    LeftOut,
    LinkShape,
    Mesh,
    Scene,
    Shape,
    Sphere,
)
from armcontour.verification.clearance.flat_faces import face_distances

# Kind of the pairs of an obstacle with a link or with another obstacle.
ENVIRONMENT = "environment"
# Kind of the pairs of two links of the arm.
OWN = "own"
# Kind of the pairs of links with the mounting plane of the base.
MOUNTING = "mounting"
# Index of the first link whose height can change, relative to `Chain.floor_link`.
FIRST_RAISED = 2
# Depth from which a link counts as below the mounting plane [m].
BELOW = 1e-3
# A prismatic joint slides along a plane if the sine of its angle to the plane is below this.
ALONG_PLANE = 1e-6
# Uncertainty of distances, due to the tolerance of the library's iteration [m].
UNCERTAINTY = 2e-6
# Reason to exclude a pair of links that touch in all tried postures.
REASON = "touching with all joints at 0, and in every other posture that was tried"
# Number of sampled postures in addition to the posture with all joints at 0.
POSTURES = 15
# Distances from flat faces are computed in closed form for at least this number of places of a
# pair. The library is faster for fewer places.
PLACES_OF_PAIR = 16
# Cache of the library objects of meshes, because computing a hull takes milliseconds.
MESHES: WeakKeyDictionary[Mesh, Any] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """Two bodies whose distance is checked."""

    # first, second: the bodies. The second one moves with the later link.
    first: LinkShape
    second: LinkShape
    kind: str  # "environment", "own" or "tool"
    margin: float  # Smallest allowed distance [m]
    # Name of the pairs of which the smallest distance is computed: the kind, and for a pair with
    # the cell whether its body is a plane or another obstacle
    group: str
    # Bounds on the approach speed per joint speed with prismatic joints at 0 [m/rad], (dof,); 1 for
    # a prismatic joint
    radii: FloatArray

    def radii_at(self, farthest: FloatArray, slides: BoolArray) -> FloatArray:
        """Return `radii` while prismatic joints are at most `farthest` from 0 [m], (dof,).

        - `farthest`: largest distance of each joint from 0 [m or rad], (dof,).
        - `slides`: True for prismatic joints, (dof,).
        """
        # Prismatic joints between a revolute joint and the moving body move the body away from the
        # axis of the revolute joint.
        joints = np.arange(len(slides))
        between = (self.first.link <= joints) & (joints < self.second.link)
        travel = np.where(slides & between, farthest, 0.0)
        before = np.cumsum(travel) - travel
        first_moves = isinstance(self.second.shape, HalfSpace)
        away = before if first_moves else travel.sum() - travel - before
        return np.asarray(self.radii + away * (self.radii > 0) * ~slides)


def pairs_of(arm: Arm, scene: Scene) -> tuple[tuple[Pair, ...], tuple[LeftOut, ...]]:
    """Return the body pairs of an arm and its cell: those to check, and those excluded."""
    chain, shapes = _parts(arm)
    bodies = shapes.shapes
    _check_obstacles(bodies, scene)
    pairs: list[Pair] = []
    radii_of = cache(partial(_radii, chain))
    left_out = _links_without_shape(chain, bodies)
    for first, second, kind, margin, allowed in _obstacle_pairs(chain, bodies, scene):
        if first.link == second.link:
            reason = "both are fixed"
        elif allowed:
            reason = f"{first.name} allows it to touch"
        elif _slides_along(chain, first, second):
            reason = f"it only slides along the plane of {first.name}"
        else:
            cell = "plane" if isinstance(first.shape, HalfSpace) else "obstacle"
            pairs.append(_make_pair(radii_of, first, second, kind, margin, f"{kind} {cell}"))
            continue
        left_out.append(LeftOut(first=first.name, second=second.name, reason=reason))
    reasons = {frozenset((x.first, x.second)): x.reason for x in shapes.left_out}
    for first, second in combinations(sorted(bodies, key=lambda x: x.link), 2):
        exclusion = _exclusion_reason(first, second, reasons)
        if exclusion is None:
            kind = TOOL if second.tool or first.tool else OWN
            margin = scene.margins.tool if kind == TOOL else scene.margins.own
            pairs.append(_make_pair(radii_of, first, second, kind, margin, kind))
        elif first.name != second.name:
            left_out.append(LeftOut(first=first.name, second=second.name, reason=exclusion))
    return tuple(pairs), tuple(dict.fromkeys(left_out))


def mounting_pairs(arm: Arm, scene: Scene) -> tuple[Pair, ...]:
    """Pair the mounting plane of the base with each link that should stay above it."""
    if arm.dimension != 3 or not scene.has_mounting_plane:
        return ()
    chain, shapes = _parts(arm)
    floor = chain.floor_link
    plane = LinkShape(
        name="mounting plane", link=floor, shape=HalfSpace(), place=chain.floor, on_floor=True
    )
    # The base of an arm on a rail is also a link.
    raised = floor + FIRST_RAISED + int(chain.slides[floor])
    links = [x for x in shapes.shapes if x.link >= raised and not x.tool]
    radii_of = partial(_radii, chain)
    return tuple(_make_pair(radii_of, plane, x, MOUNTING, -BELOW, MOUNTING) for x in links)


def _parts(arm: Arm) -> tuple[Chain, ArmShapes]:
    """Return chain and shapes of an arm; raise InvalidInput if the shapes are unknown."""
    if arm.shapes is None or not arm.shapes.shapes:
        raise InvalidInput(
            f"The shapes of the links of the arm {arm.name} are not known, so its clearance "
            "cannot be computed. Specify a URDF with collision geometry, or arm.shapes in the job "
            "(arm.with_shapes in Python)."
        )
    return arm.chain, arm.shapes


def _slides_along(chain: Chain, obstacle: LinkShape, body: LinkShape) -> bool:
    """Return whether a body only slides along the plane of an obstacle, such as on a rail.

    Their distance is then that of their construction, and no motion changes it.
    """
    if not isinstance(obstacle.shape, HalfSpace) or body.tool:
        return False
    first, last = sorted((obstacle.link, body.link))
    if not chain.slides[first:last].all():
        return False
    turned = link_poses(chain, np.zeros((1, len(chain))))[0, :, :, :3]
    directions = np.einsum("kij,kj->ki", turned[first + 1 : last + 1], chain.axes[first:last])
    normal = turned[obstacle.link] @ obstacle.place.rotation[:, 2]
    return bool((np.abs(directions @ normal) < ALONG_PLANE).all())


def _links_without_shape(chain: Chain, bodies: Sequence[LinkShape]) -> list[LeftOut]:
    """Return the exclusions of the links whose shape is unknown."""
    known = {x.link for x in bodies}
    reason = "no shape of it is known"
    left_out = []
    for link, joint in enumerate(chain.joints, start=1):
        if link > chain.floor_link and link not in known:
            name = f"the link after {joint}"
            left_out.append(LeftOut(first=name, second="everything", reason=reason))
    return left_out


def _check_obstacles(bodies: Sequence[LinkShape], scene: Scene) -> None:
    """Check that obstacles are no moving links, and that `allow` names known bodies only."""
    names = {x.name for x in bodies} | {TOOL}
    moving = {x.name for x in bodies if x.link}
    if any(x.fixed_to == PART for x in scene.obstacles):
        names |= {x.name for x in scene.obstacles}
    end = max((x for x in bodies if not x.tool), key=lambda x: x.link, default=None)
    repair = "Remove the name" if end is None else f"Write {end.name}, the end of the arm,"
    for obstacle in scene.obstacles:
        if obstacle.name in moving:
            raise InvalidInput(
                f"{obstacle.name} is an obstacle of the scene, but also a moving body of the arm. "
                "Remove the arm from the scene, or rename the obstacle."
            )
        for name in obstacle.allow:
            if name not in names:
                raise InvalidInput(
                    f"{obstacle.name} of the scene allows {name!r} to touch it, but the bodies of "
                    "the arm "
                    f"are {', '.join(sorted(names))}. {repair} in allow of {obstacle.name}."
                )


def _obstacle_pairs(
    chain: Chain, bodies: Sequence[LinkShape], scene: Scene
) -> Iterable[tuple[LinkShape, LinkShape, str, float, bool]]:
    """Yield all pairs with an obstacle: two bodies, kind, margin [m], whether they may touch."""
    # `chain.base` is the frame of the base or table (link 0) in the work frame.
    floor = (chain.floor_link, chain.floor)
    part = (0, chain.base.inverse)
    placed = []
    for obstacle in scene.obstacles:
        on_floor = obstacle.fixed_to == BASE
        link, frame = floor if on_floor else part
        shape = LinkShape(
            name=obstacle.name,
            link=link,
            shape=obstacle.shape,
            place=frame @ obstacle.place,
            on_floor=on_floor,
        )
        placed.append((obstacle, shape.with_hull()))
    margins = scene.margins
    for obstacle, shape in placed:
        for body in bodies:
            kind = TOOL if body.tool else ENVIRONMENT
            margin = margins.tool if body.tool else margins.environment
            if obstacle.margin is not None:
                margin = obstacle.margin
            allowed = body.name in obstacle.allow or (body.tool and TOOL in obstacle.allow)
            yield shape, body, kind, margin, allowed
    # A positioner moves the part towards obstacles.
    for (x, first), (y, second) in combinations(placed, 2):
        if first.link != second.link:
            specified = [z.margin for z in (x, y) if z.margin is not None]
            allowed = y.name in x.allow or x.name in y.allow
            yield first, second, ENVIRONMENT, max(specified, default=margins.environment), allowed


def _exclusion_reason(
    first: LinkShape, second: LinkShape, reasons: dict[frozenset[str], str]
) -> str | None:
    """Return why two bodies of the arm are excluded; None if their distance must be checked.

    - `reasons`: reasons of the arm to exclude pairs, by the names of both bodies.
    """
    if first.link == second.link:
        return "they move together"
    reason = reasons.get(frozenset((first.name, second.name)))
    if reason is not None:
        return reason
    # A bent tool can reach the link before the last one, so tools are never neighbours.
    return "neighbours" if second.link == first.link + 1 and not second.tool else None


def _make_pair(
    radii_of: Callable[[LinkShape], FloatArray],
    one: LinkShape,
    other: LinkShape,
    kind: str,
    margin: float,
    group: str,
) -> Pair:
    """Make a pair with the bounds on its approach speed.

    - `radii_of`: function that returns `_radii` of a body.
    - `one`, `other`: the bodies, in any order.
    """
    first, second = sorted((one, other), key=lambda x: x.link)
    # Only joints between the links of both bodies cause relative motion. The points of a half-space
    # are at any distance from their axes.
    moving = first if isinstance(second.shape, HalfSpace) else second
    radii = radii_of(moving).copy()
    radii[: first.link] = radii[second.link :] = 0.0
    return Pair(first=first, second=second, kind=kind, margin=margin, group=group, radii=radii)


def _radii(chain: Chain, body: LinkShape) -> FloatArray:
    """Return the largest distances of a body's points from the joint axes [m], (dof,).

    `_make_pair` sets those of joints that do not move both bodies relative to each other to 0.
    """
    radii = np.zeros(len(chain))
    slides = chain.slides
    middle, size = body.shape.ball
    start = middle = body.place.position + body.place.rotation @ middle
    radius = size
    rows = chain.rows
    last = chain.joint_row[body.link - 1] if body.link else -1
    for row in rows[last::-1] if body.link else ():
        # A ball about a point on the axis contains the body at any joint position.
        if row.slides:
            radii[row.leader] += 1.0
            middle = row.position + row.rotation @ middle
            continue
        along = row.axis * float(row.axis @ middle)
        radius = radius + float(np.linalg.norm(middle - along))
        # Joints that follow another one add their speed to that of this joint.
        radii[row.leader] += abs(row.factor) * radius
        middle = row.position + row.rotation @ along
    middle = start
    radius = size
    for k in range(body.link, chain.floor_link):
        middle = chain.rotations[k].T @ (middle - chain.positions[k])
        if slides[k]:
            radii[k] = 1.0
            continue
        along = chain.axes[k] * float(chain.axes[k] @ middle)
        radii[k] = radius = radius + float(np.linalg.norm(middle - along))
        middle = along
    return radii


class Distances:
    """Body-pair distances along a chain."""

    def __init__(self, chain: Chain, pairs: Sequence[Pair]) -> None:
        self._coal = _coal()
        self._pairs = pairs
        convert = partial(_geometry, self._coal)
        # Bodies are compared by identity.
        bodies: dict[int, LinkShape] = {}
        for pair in pairs:
            bodies[id(pair.first)] = pair.first
            bodies[id(pair.second)] = pair.second
        places = {key: k for k, key in enumerate(bodies)}
        self._links = link_table(chain)
        self._chain = chain
        self._base = chain.base.matrix
        self.slides = chain.slides
        # Frames of the bodies in the frames of joints, which have z along the joint axis.
        turns = [np.eye(3), *np.swapaxes(joint_frames(chain), 1, 2)]
        self._joints = np.array([x.link - 1 for x in bodies.values()], dtype=np.intp)
        placements = [turns[x.link] @ x.place.matrix for x in bodies.values()]
        self._places = np.array(placements).reshape(-1, 3, 4)
        self._shapes = [(convert(x.first.shape), convert(x.second.shape)) for x in pairs]
        self._exact: list[tuple[Any, Any] | None] = []
        for pair in pairs:
            first = pair.first.exact or pair.first.shape
            second = pair.second.exact or pair.second.shape
            self._exact.append(None if _hulls_decide(pair) else (convert(first), convert(second)))
        self._faces = [face_distances(x.first.shape, x.second.shape) for x in pairs]
        self._ends = np.array(
            [(places[id(x.first)], places[id(x.second)]) for x in pairs], dtype=np.intp
        ).reshape(-1, 2)
        self._request = self._coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._identity = self._coal.Transform3s()

    def measure(self, q: FloatArray, state: IntArray, pair: IntArray) -> FloatArray:
        """Measure pair distances at joint positions [m], (m,); negative if the bodies overlap.

        - `q`: joint positions [rad], (n, dof).
        - `state`: row of q of each result, (m,).
        - `pair`: index of its pair, (m,).
        """
        rotations, positions = self._relative(q, state, pair)
        distances = self._from_faces(rotations, positions, pair)
        placement = self._coal.Transform3s()
        result = self._coal.DistanceResult()
        for i in np.flatnonzero(np.isnan(distances)).tolist():
            placement.setTransform(rotations[i], positions[i])
            distances[i] = self._distance(int(pair[i]), placement, result)
        return distances

    def _from_faces(
        self, rotations: FloatArray, positions: FloatArray, pair: IntArray
    ) -> FloatArray:
        """Return the distances from flat faces [m], (m,); NaN where the library must measure.

        - `rotations`, `positions`: as `_relative` returns them.
        - `pair`: indices of the pairs, (m,).
        """
        distances = np.full(len(pair), np.nan)
        counts = np.bincount(pair, minlength=len(self._pairs))
        for k in np.flatnonzero(counts >= PLACES_OF_PAIR).tolist():
            faces = self._faces[k]
            if faces is not None:
                rows = np.flatnonzero(pair == k)
                measured = faces.measure(rotations[rows], positions[rows])
                if self._exact[k] is not None:
                    # Hulls that are too near do not decide.
                    measured[measured < self._pairs[k].margin + UNCERTAINTY] = np.nan
                distances[rows] = measured
        return distances

    def points(self, q: FloatArray) -> FloatArray:
        """Return the two nearest points of every pair, in the work frame [m], (pairs, 2, 3).

        `q` are the joint positions of each pair [rad], (pairs, dof).
        """
        pairs = np.arange(len(self._pairs))
        rotations, positions = self._relative(q, pairs, pairs)
        points = np.empty((len(pairs), 2, 3))
        # Each call has its own result object, because several threads may call.
        result = self._coal.DistanceResult()
        for k in range(len(pairs)):
            self._distance(k, self._coal.Transform3s(rotations[k], positions[k]), result)
            points[k, 0] = result.getNearestPoint1()
            points[k, 1] = result.getNearestPoint2()
        first = self._placements(q)[pairs, self._ends[:, 0]]
        return np.asarray(points @ np.swapaxes(first[..., :3], 1, 2) + first[:, None, :, 3])

    def _distance(self, pair: int, placement: Any, result: Any) -> float:
        """Return the distance of a pair [m], and write its nearest points to `result`.

        - `placement`: second body in the frame of the first body.
        """
        distance = self._between(*self._shapes[pair], placement, result)
        exact = self._exact[pair]
        if exact is not None and distance < self._pairs[pair].margin + UNCERTAINTY:
            distance = max(distance, self._between(*exact, placement, result))
        return distance

    def _between(self, first: Any, second: Any, placement: Any, result: Any) -> float:
        """Return the distance of two objects of the library [m]; negative if they overlap."""
        result.clear()
        # `ComputeDistance` is faster, but its result depends on the previous calls.
        distance = self._coal.distance
        return float(distance(first, self._identity, second, placement, self._request, result))

    def _placements(self, q: FloatArray) -> FloatArray:
        """Return the placements of all bodies in the work frame, (n, bodies, 3, 4)."""
        joints = self._chain.without_followers(frames_of(self._links, kernel_array(q)))
        # The base (link 0) is stored at index -1, in place of the tool.
        joints[:, -1] = self._base
        poses = joints[:, self._joints]
        placements: FloatArray = poses[..., :3] @ self._places
        placements[..., 3] += poses[..., 3]
        return placements

    def _relative(
        self, q: FloatArray, state: IntArray, pair: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the placements of second bodies in the frames of first ones; as for `measure`.

        Returns rotations, (m, 3, 3), and positions [m], (m, 3).
        """
        # The library reads contiguous arrays in half of the time.
        placed = self._placements(q)
        first = placed[state, self._ends[pair, 0]]
        second = placed[state, self._ends[pair, 1]]
        inverse_rotation = np.swapaxes(first[:, :, :3], 1, 2)
        second[:, :, 3] -= first[:, :, 3]
        relative = inverse_rotation @ second
        return np.ascontiguousarray(relative[:, :, :3]), np.ascontiguousarray(relative[:, :, 3])


def can_measure() -> bool:
    """Return whether the library coal is installed."""
    return importlib.util.find_spec("coal") is not None


def _coal() -> Any:
    """Import the library coal, which is installed with pinocchio."""
    try:
        import coal
    except ImportError:
        raise InvalidInput(
            "Clearance needs the package coal. Install it with pip install "
            "'armcontour[dynamics]' (not available for Windows), or remove scene from the job."
        ) from None
    return coal


def _hulls_decide(pair: Pair) -> bool:
    """Return whether the convex shapes of a pair have the same distance as its bodies."""
    bodies = (pair.first, pair.second)
    # A body and its convex hull have the same distance from a half-space.
    return all(x.exact is None for x in bodies) or any(
        isinstance(x.shape, HalfSpace) for x in bodies
    )


def _geometry(coal: Any, shape: Shape) -> Any:
    """Make the library object of a shape."""
    match shape:
        case Sphere():
            return coal.Sphere(shape.radius)
        case Capsule():
            return coal.Capsule(shape.radius, shape.length)
        case Cylinder():
            return coal.Cylinder(shape.radius, shape.length)
        case Box():
            return coal.Box(*shape.size.tolist())
        case HalfSpace():
            return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
        case Mesh():
            if shape not in MESHES:
                MESHES[shape] = _mesh(coal, shape)
            return MESHES[shape]
    raise InvalidInput(
        f"Distances are not available for shapes of the kind {type(shape).__name__}."
    )


def _mesh(coal: Any, shape: Mesh) -> Any:
    """Convert a mesh to the library's object: its triangles, or without any its convex hull."""
    triangles = shape.triangles
    model = coal.BVHModelOBBRSS()
    model.beginModel(0 if triangles is None else len(triangles), len(shape.points))
    model.addVertices(np.ascontiguousarray(shape.points))
    if triangles is not None:
        model.addTriangles(np.ascontiguousarray(triangles, dtype=np.int64))
    model.endModel()
    if triangles is not None:
        return model
    # `buildConvexRepresentation` would assume that the triangles are convex.
    model.buildConvexHull(True, "Qt")
    if model.convex is None:
        raise InvalidInput(f"The convex hull of {shape.source or 'a mesh'} cannot be computed.")
    return model.convex


def exclude_touching(arm: Arm) -> ArmShapes:
    """Exclude pairs of an arm that touch in all sampled postures; returns the shapes."""
    # The posture with all joints at 0 may be invalid, so a pair is excluded only if it also touches
    # in all other sampled postures.
    assert arm.shapes is not None
    pairs, _ = pairs_of(arm, Scene())
    if not pairs or not can_measure():
        return arm.shapes
    distances = Distances(arm.chain, pairs)
    remaining = np.arange(len(pairs))
    for q in _postures(arm):
        distance = distances.measure(q[None], np.zeros(len(remaining), dtype=np.intp), remaining)
        remaining = remaining[distance <= UNCERTAINTY]
    touching = (pairs[k] for k in remaining.tolist())
    left_out = [LeftOut(first=x.first.name, second=x.second.name, reason=REASON) for x in touching]
    return replace(arm.shapes, left_out=(*arm.shapes.left_out, *dict.fromkeys(left_out)))


def _postures(arm: Arm) -> FloatArray:
    """Return all joints at 0, and postures distributed over the joint ranges [rad], (n, dof)."""
    farthest = np.where(arm.chain.slides, arm.span, np.pi)
    low, high = (np.clip(x, -farthest, farthest) for x in arm.limits.joint_range(arm.dof))
    # Multiples of the square root of a prime, modulo 1, are evenly distributed.
    steps = np.sqrt([2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37][: arm.dof])
    steps = np.concatenate([steps, np.sqrt(41 + np.arange(arm.dof - len(steps)))])
    fractions = np.arange(1, POSTURES + 1)[:, None] * steps % 1
    return np.vstack([np.zeros(arm.dof), low + fractions * (high - low)])
