"""Distances of bodies, by the library coal."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from armcontour.core.checks import FloatArray, IntArray, kernel_array
from armcontour.core.errors import InvalidInput
from armcontour.robot import Chain
from armcontour.robot.chain import joint_frames, link_table
from armcontour.robot.kernels import frames_of
from armcontour.robot.scene import Box, Capsule, Cylinder, HalfSpace, Mesh, Shape, Sphere
from armcontour.verification.clearance.pairs import Body, Pair

# What distances are uncertain by: the tolerance of the library's iteration [m].
UNCERTAINTY = 2e-6
# Meshes as the library has them, for as long as they are used: hulls take milliseconds.
MESHES: WeakKeyDictionary[Mesh, Any] = WeakKeyDictionary()


class Distances:
    """Distances of pairs of bodies of a chain."""

    def __init__(self, chain: Chain, pairs: Sequence[Pair]) -> None:
        self._coal = _coal()
        # Not `ComputeDistance`, which is faster: what it finds depends on what it was asked before.
        self._least = self._coal.distance
        self._pairs = pairs
        # Places in the list of all bodies; bodies are compared by identity.
        self._bodies: dict[int, int] = {}
        self._list: list[Body] = []
        made = partial(_geometry, self._coal)
        for x in pairs:
            for body in (x.first, x.second):
                if id(body) not in self._bodies:
                    self._bodies[id(body)] = len(self._list)
                    self._list.append(body)
        self._links, self._base = link_table(chain), chain.base.matrix
        # Frames of the bodies in the frames of joints, which have z along the joint axis.
        turns = [np.eye(3), *np.swapaxes(joint_frames(chain), 1, 2)]
        self._joints = np.array([x.link - 1 for x in self._list], dtype=np.intp)
        places = [turns[x.link] @ x.place.matrix for x in self._list]
        self._places = np.array(places).reshape(-1, 3, 4)
        self._shapes = [(made(x.first.shape), made(x.second.shape)) for x in pairs]
        self._exact = [
            None
            if _hulls_decide(x)
            else (made(x.first.exact or x.first.shape), made(x.second.exact or x.second.shape))
            for x in pairs
        ]
        self._ends = np.array(
            [(self._bodies[id(x.first)], self._bodies[id(x.second)]) for x in pairs], dtype=np.intp
        ).reshape(-1, 2)
        self._request = self._coal.DistanceRequest()
        self._request.enable_signed_distance = True
        self._still = self._coal.Transform3s()

    def measure(self, q: FloatArray, at: IntArray, pair: IntArray) -> FloatArray:
        """Distances of pairs at joint positions [m], (m,); where they overlap, below zero."""
        # q (n, dof) [rad], at (m,), pair (m,).
        turned, moved = self._relative(q, at, pair)
        found, place, result = [], self._coal.Transform3s(), self._coal.DistanceResult()
        for p, turn, move in zip(pair.tolist(), turned, moved, strict=True):
            place.setTransform(turn, move)
            found.append(self._distance(p, place, result))
        return np.array(found)

    def points(self, q: FloatArray) -> FloatArray:
        """The two nearest points of every pair, in the work frame [m], (pairs, 2, 3)."""
        # q (pairs, dof) [rad].
        every = np.arange(len(self._pairs))
        turned, moved = self._relative(q, every, every)
        # Not kept from call to call: several threads may ask.
        found, result = np.empty((len(every), 2, 3)), self._coal.DistanceResult()
        for k in range(len(every)):
            self._distance(k, self._coal.Transform3s(turned[k], moved[k]), result)
            found[k, 0] = result.getNearestPoint1()
            found[k, 1] = result.getNearestPoint2()
        first = self._placements(q)[every, self._ends[:, 0]]
        return np.asarray(found @ np.swapaxes(first[..., :3], 1, 2) + first[:, None, :, 3])

    def _distance(self, pair: int, place: Any, result: Any) -> float:
        """Distance of a pair with its second body so placed in the frame of the first one."""
        first, second = self._shapes[pair]
        # As `_between`: this is called by the hundred thousand.
        result.clear()
        found: float = self._least(first, self._still, second, place, self._request, result)
        exact = self._exact[pair]
        if exact is not None and found < self._pairs[pair].margin + UNCERTAINTY:
            found = max(found, self._between(*exact, place, result))
        return found

    def _between(self, first: Any, second: Any, place: Any, result: Any) -> float:
        """Distance of two bodies of the library."""
        result.clear()
        return float(self._coal.distance(first, self._still, second, place, self._request, result))

    def _placements(self, q: FloatArray) -> FloatArray:
        """Placements of all bodies, (n, bodies, 3, 4)."""
        joints = frames_of(self._links, kernel_array(q))
        # The base, link 0, takes the place of the tool.
        joints[:, -1] = self._base
        poses = joints[:, self._joints]
        found: FloatArray = poses[..., :3] @ self._places
        found[..., 3] += poses[..., 3]
        return found

    def _relative(
        self, q: FloatArray, at: IntArray, pair: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Rotations (m, 3, 3) and positions (m, 3) of second bodies in the frames of first ones."""
        # The library takes contiguous arrays in half of the time.
        placed = self._placements(q)
        first, second = placed[at, self._ends[pair, 0]], placed[at, self._ends[pair, 1]]
        back = np.swapaxes(first[:, :, :3], 1, 2)
        second[:, :, 3] -= first[:, :, 3]
        found = back @ second
        return np.ascontiguousarray(found[:, :, :3]), np.ascontiguousarray(found[:, :, 3])


def can_measure() -> bool:
    """True if the library of distances is installed."""
    return importlib.util.find_spec("coal") is not None


def _coal() -> Any:
    """The library coal, which comes with pinocchio."""
    try:
        import coal
    except ImportError:
        raise InvalidInput(
            "Clearance needs the package coal: pip install 'armcontour[dynamics]' (there are no "
            "wheels for Windows), or take scene out of the job."
        ) from None
    return coal


def _hulls_decide(pair: Pair) -> bool:
    """True if the distance of the convex shapes of a pair is that of its bodies."""
    bodies = (pair.first, pair.second)
    # Above a plane a body is as near as its convex hull.
    return all(x.exact is None for x in bodies) or any(
        isinstance(x.shape, HalfSpace) for x in bodies
    )


def _geometry(coal: Any, shape: Shape) -> Any:
    """A shape as one of the library."""
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
                make = _hull if shape.triangles is None else _triangles
                MESHES[shape] = make(coal, shape)
            return MESHES[shape]
    raise InvalidInput(f"There are no distances of a shape of the kind {type(shape).__name__}.")


def _hull(coal: Any, shape: Mesh) -> Any:
    """The convex hull of the points of a mesh."""
    model = coal.BVHModelOBBRSS()
    model.beginModel(0, len(shape.points))
    model.addVertices(np.ascontiguousarray(shape.points))
    model.endModel()
    # Not `buildConvexRepresentation`, which takes the triangles to be convex already.
    model.buildConvexHull(True, "Qt")
    if model.convex is None:
        raise InvalidInput(f"There is no convex hull of {shape.source or 'a mesh'}.")
    return model.convex


def _triangles(coal: Any, shape: Mesh) -> Any:
    """The triangles of a mesh."""
    assert shape.triangles is not None
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(shape.triangles), len(shape.points))
    model.addVertices(np.ascontiguousarray(shape.points))
    model.addTriangles(np.ascontiguousarray(shape.triangles, dtype=np.int64))
    model.endModel()
    return model
