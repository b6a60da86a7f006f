"""Selection of the edges of a model that rules name."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.text import count_noun, list_some
from armcontour.files.colors import color_of
from armcontour.files.model.edge_rules import (
    BORDER,
    CONCAVE,
    CONVEX,
    FOLDS,
    KINDS,
    SMOOTH,
    EdgeRule,
    FaceRule,
    point_text,
)
from armcontour.files.model.tables import Edge, Face, Point, Request, Tables

# Faces that meet at a smaller angle are one surface for a tool [rad].
SMOOTH_ANGLE = math.radians(1.0)
# Largest distance between the point of a rule and the edge or face that it names [m].
NEAR = 2e-3
# Edges and faces at distances that differ by less are equally near [m].
SAME_DISTANCE = 1e-6
# Radii that differ by less are equal [m].
SAME_RADIUS = 1e-6
# Fractions of an edge at which its distance to a point is computed first.
COARSE = np.linspace(0.0, 1.0, 129)
# Number of steps that then refine the distance.
REFINEMENTS = 4
# Largest number of names in a message.
MOST_NAMES = 12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SelectedEdge:
    """An edge that a rule selects.

    Args:
        index: Index of the edge.
        rule: The rule.
        face: Index of the face that the rule names; None if it names none.
    """

    index: int
    rule: EdgeRule
    face: int | None = None


def request_of(rules: Sequence[EdgeRule]) -> Request:
    """Return what the kernel computes for rules."""
    seams = dict.fromkeys((x.seams[0], x.seams[1]) for x in rules if x.seams is not None)
    points = dict.fromkeys(_point(x.face) for x in rules if x.face is not None)
    return Request(seams=tuple(seams), points=tuple(points))


def _point(face: FaceRule) -> Point:
    """Return the point of a rule [m]."""
    x, y, z = map(float, face.near)
    return x, y, z


def fold_of(edge: Edge) -> str:
    """Return how the faces at an edge meet, as in `EdgeRule.fold`; empty for more than two."""
    if math.isnan(edge.turn):
        return BORDER if len(edge.uses) == 1 else ""
    if abs(edge.turn) < SMOOTH_ANGLE:
        return SMOOTH
    return CONVEX if edge.turn > 0 else CONCAVE


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selector:
    """Selects edges of a model by rules.

    Args:
        tables: Parts, faces and edges, with the answers to the rules' request.
        source: Name of the file, for messages.
    """

    tables: Tables
    source: str

    def select(self, rules: Sequence[EdgeRule]) -> list[SelectedEdge]:
        """Return the edges of all rules; each edge belongs to the first rule that selects it.

        Raises:
            InvalidInput: A rule selects no edge.
        """
        selected: dict[int, SelectedEdge] = {}
        for number, rule in enumerate(rules):
            for edge in self._select_one(rule, number):
                selected.setdefault(edge.index, edge)
        return list(selected.values())

    def without_rule(self) -> list[SelectedEdge]:
        """Return all edges of the parts at which a tool would find an edge."""
        rule = EdgeRule()
        edges = enumerate(self.tables.edges)
        found = [i for i, x in edges if x.seam is None and not x.inside and fold_of(x) != SMOOTH]
        return [SelectedEdge(index=i, rule=rule) for i in found]

    def _select_one(self, rule: EdgeRule, number: int) -> list[SelectedEdge]:
        """Return the edges of one rule, the rule with index `number`."""
        if rule.index is not None:
            return [self._by_index(rule, rule.index)]
        found = self._candidates(rule)
        face = None
        if rule.face is not None:
            face = self.find_face(rule.face)
            on_face = self._edges_of_face(face, rule.loop or "all")
            found = [i for i in found if i in on_face]
        for condition in self._conditions(rule):
            found = [i for i in found if condition(self.tables.edges[i])]
        if not found:
            raise InvalidInput(self._describe_missing(rule), key=(str(number),))
        if rule.near is not None:
            found = [self._nearest(rule.near, found)]
        return [SelectedEdge(index=i, rule=rule, face=face) for i in found]

    def _candidates(self, rule: EdgeRule) -> list[int]:
        """Return the edges that a rule may select: seams, or edges of parts."""
        edges = self.tables.edges
        if rule.seams is None:
            if rule.part is not None:
                self._check_part(rule.part)
            return [i for i, x in enumerate(edges) if x.seam is None and not x.inside]
        for name in rule.seams:
            self._check_part(name)
        return [i for i, x in enumerate(edges) if x.seam == rule.seams]

    def _conditions(self, rule: EdgeRule) -> list[Callable[[Edge], bool]]:
        """Return the conditions of a rule that depend on one edge only."""
        conditions: list[Callable[[Edge], bool]] = []
        faces = self.tables.faces
        if rule.open is not None:
            least = rule.open
            conditions.append(lambda x: x.opening >= least)
        if rule.fold is not None:
            conditions.append(lambda x: fold_of(x) == rule.fold)
        if rule.kind is not None:
            conditions.append(lambda x: x.kind == rule.kind)
        if rule.radius is not None:
            radius = rule.radius
            conditions.append(lambda x: abs(x.radius - radius) <= SAME_RADIUS)
        if rule.color is not None:
            color = color_of(rule.color)
            conditions.append(lambda x: any(faces[use.face].color == color for use in x.uses))
        if rule.part is not None:
            names = {i for i, x in enumerate(self.tables.parts) if x.name == rule.part}
            conditions.append(lambda x: any(faces[use.face].part in names for use in x.uses))
        return conditions

    def _by_index(self, rule: EdgeRule, index: int) -> SelectedEdge:
        """Return the edge with a number of the table."""
        edges = [i for i, x in enumerate(self.tables.edges) if x.seam is None]
        if index > len(edges) or self.tables.edges[index - 1].inside:
            raise InvalidInput(
                f"{self.source} has no edge {index} that can become a contour. Its edges have the "
                f"numbers 1 to {len(edges)}: armcontour show {self.source} lists them."
            )
        return SelectedEdge(index=index - 1, rule=rule)

    def find_face(self, rule: FaceRule) -> int:
        """Return the index of the face that a rule names.

        Raises:
            InvalidInput: No face is near, or several are equally near.
        """
        points = self.tables.request.points
        indices, distance = self.tables.nearest[points.index(_point(rule))]
        if distance > NEAR:
            raise InvalidInput(
                f"{self.source} has no face within {NEAR * 1e3:g} mm of {point_text(rule.near)}: "
                f"the nearest is {distance * 1e3:.4g} mm away. Name a point on the face."
            )
        if len(indices) > 1:
            raise InvalidInput(
                f"{len(indices)} faces of {self.source} are equally near to "
                f"{point_text(rule.near)}. Name a point inside of the face, not on its edges."
            )
        return indices[0]

    def _edges_of_face(self, face: int, loop: str) -> set[int]:
        """Return the edges on boundaries of a face."""
        loops = self.tables.faces[face].loops
        chosen = [x for x in loops if loop == "all" or x.outer == (loop == "outer")]
        return {edge for x in chosen for edge in x.edges}

    def _nearest(self, point: Sequence[float], found: Sequence[int]) -> int:
        """Return the edge nearest to a point."""
        found, distances = self._distances(np.array(point), found)
        best = int(np.argmin(distances))
        nearest = distances[best]
        described = self.describe(found[best])
        if nearest > NEAR:
            raise InvalidInput(
                f"{self.source} has no such edge within {NEAR * 1e3:g} mm of {point_text(point)}. "
                f"The nearest is {described}, {nearest * 1e3:.4g} mm away. Name a point on the "
                "edge."
            )
        same = [
            i for i, x in zip(found, distances, strict=True) if x <= distances[best] + SAME_DISTANCE
        ]
        if len(same) > 1:
            raise InvalidInput(
                f"{count_noun(len(same), 'edge')} of {self.source} are equally near to "
                f"{point_text(point)}, such as {described}. Name a point inside of the edge."
            )
        return found[best]

    def _distances(self, point: FloatArray, found: Sequence[int]) -> tuple[list[int], list[float]]:
        """Return the edges that may be nearest to a point, and their distances from it [m]."""
        extents = np.array([self.tables.edges[i].extent for i in found])
        outside = np.maximum(np.maximum(extents[:, 0] - point, point - extents[:, 1]), 0.0)
        bounds = np.linalg.norm(outside, axis=1)
        near: list[int] = []
        distances: list[float] = []
        for k in np.argsort(bounds, kind="stable").tolist():
            if distances and bounds[k] > min(distances) + NEAR:
                break
            near.append(found[k])
            distances.append(distance_to_edge(self.tables.edges[found[k]], point))
        return near, distances

    def describe(self, index: int) -> str:
        """Return an edge as text, for messages."""
        edge = self.tables.edges[index]
        middle = edge.curve(np.array([0.5]))[0]
        number = f"edge {index + 1}" if edge.seam is None else f"a seam of {'/'.join(edge.seam)}"
        length = edge.length * 1e3
        return f"{number} ({edge.kind}, {length:.4g} mm, around {point_text(middle.round(5))})"

    def _check_part(self, name: str) -> None:
        """Check that a part exists."""
        names = list(dict.fromkeys(x.name for x in self.tables.parts))
        if name not in names:
            raise InvalidInput(
                f"{self.source} has no part {name!r}. Its parts are {list_some(names, MOST_NAMES)}."
            )

    def _describe_missing(self, rule: EdgeRule) -> str:
        """Return why a rule selects no edge, and what there is instead."""
        edges = [self.tables.edges[i] for i in self._candidates(rule)]
        start = f"No edge of {self.source} satisfies {rule.words}."
        if rule.seams is not None:
            return f"{start} {self._describe_seams(rule, edges)}"
        if rule.radius is not None:
            radii = np.unique([round(x.radius, 6) for x in edges if x.radius > 0])
            if not len(radii):
                return f"{start} The file has no circles."
            nearest = radii[np.abs(radii - rule.radius).argmin()]
            return f"{start} The nearest radius is {nearest * 1e3:g} mm."
        if rule.color is not None:
            colors = sorted({x.color for x in self.tables.faces} - {""})
            return (
                f"{start} The colours of faces are {list_some(colors, MOST_NAMES) or 'not given'}."
            )
        counts = {x: sum(fold_of(edge) == x for edge in edges) for x in FOLDS}
        kinds = {x: sum(edge.kind == x for edge in edges) for x in KINDS}
        there = [f"{n} {name}" for name, n in (counts | kinds).items() if n]
        return f"{start} Its edges are {', '.join(there)}."

    def _describe_seams(self, rule: EdgeRule, edges: Sequence[Edge]) -> str:
        """Return what is known about the seams between two parts."""
        names = rule.seams or ("", "")
        if edges:
            folds = {x: sum(fold_of(edge) == x for edge in edges) for x in FOLDS}
            counts = ", ".join(f"{n} {fold}" for fold, n in folds.items() if n)
            largest = max(x.opening for x in edges)
            free = "unlimited" if math.isinf(largest) else f"up to {largest * 1e3:.4g} mm"
            return (
                f"The parts have {count_noun(len(edges), 'seam edge')} ({counts}), whose free "
                f"distance is {free}."
            )
        pairs = self.tables.request.seams
        gap = self.tables.gaps[pairs.index((names[0], names[1]))]
        if gap > SAME_DISTANCE:
            return f"The parts do not touch: their distance is {gap * 1e3:.4g} mm."
        return "The parts touch, but their surfaces meet along no line."


def distance_to_edge(edge: Edge, point: FloatArray) -> float:
    """Return the distance between a point and an edge [m]."""
    distances = np.linalg.norm(edge.curve(COARSE) - point, axis=1)
    best = int(distances.argmin())
    low = COARSE[max(best - 1, 0)]
    high = COARSE[min(best + 1, len(COARSE) - 1)]
    for _ in range(REFINEMENTS):
        u = np.linspace(low, high, 17)
        distances = np.linalg.norm(edge.curve(u) - point, axis=1)
        best = int(distances.argmin())
        low = u[max(best - 1, 0)]
        high = u[min(best + 1, len(u) - 1)]
    return float(distances.min())


def normals_of(edge: Edge, faces: Sequence[Face], which: int, u: FloatArray) -> FloatArray:
    """Return the outward unit normals of one face along an edge, (n, 3).

    - `which`: index of the face among those of the edge.
    """
    use = edge.uses[which]
    if use.normals is None:
        surface = faces[use.face].surface
        assert surface is not None
        return surface.normals(edge.curve(u))
    normals = use.normals(u)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))
