"""Edges at which a user points in a picture of a model, and the rules that name them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import Quantity, write_like
from armcontour.files.model.edge_rules import CIRCLE, LINE, EdgeRule, FaceRule
from armcontour.files.model.edge_selection import Selector, distance_to_edge, fold_of, request_of
from armcontour.files.model.tables import Edge, Request, Tables

# Number of points of a curve in a picture, per full turn of a circle.
CURVE_POINTS = 32
# Least number of points of a curve that is not a line.
LEAST_POINTS = 9
# Largest rounding error of the coordinates and lengths that a rule has [m].
ROUNDING = 5e-6
# Below this distance from a seam, an edge of a part lies on the seam [m].
ON_SEAM = 1e-5
# Fractions of an edge at which its distance from seams is measured.
PROBES = np.array([0.1, 0.5, 0.9])
# Seams whose free distances differ by this factor are inside and outside of a tube.
INSIDE_OUTSIDE = 2.0
LENGTH = Quantity("m", "1 mm")
# How lengths of rules are written.
WRITTEN = "0 mm"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EdgeGroup:
    """Edges that one rule names.

    Args:
        rule: The rule.
        edges: Indices of the edges.
    """

    rule: EdgeRule
    edges: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class EdgePicker:
    """The edges of a model at which a user can point, and rules for them.

    Where a seam lies on an edge of a part, only the seam can be picked, because a weld needs the
    faces of both parts.

    Args:
        tables: Parts, faces and edges, with seams and triangles.
        names: Names of the parts, each once, as those of obstacles.
        source: Name of the file, for messages.
        ask: Function that answers another request about the file.
    """

    tables: Tables
    names: tuple[str, ...]
    source: str
    ask: Callable[[Request], Tables]

    @cached_property
    def edges(self) -> tuple[int, ...]:
        """Indices of the edges that rules can name, among those of the tables."""
        return tuple(i for i, x in enumerate(self.tables.edges) if not x.inside)

    @cached_property
    def covered(self) -> frozenset[int]:
        """Indices of the edges that cannot be picked, because seams lie on them."""
        seams = [x for x in self.tables.edges if x.seam is not None]
        edges = [(i, self.tables.edges[i]) for i in self.edges]
        return frozenset(i for i, x in edges if x.seam is None and _is_on(x, seams))

    @cached_property
    def groups(self) -> tuple[EdgeGroup, ...]:
        """Rules that name all edges of a kind, each with the edges that it names."""
        groups = {}
        for i in self.edges:
            key = self._kind_key(self.tables.edges[i])
            if key not in groups:
                rule = self._rule_of_kind(self.tables.edges[i])
                groups[key] = EdgeGroup(rule=rule, edges=tuple(self.select([rule])))
        return tuple(groups.values())

    @cached_property
    def group_of(self) -> dict[int, int]:
        """Index of the group in `groups` by index of the edge."""
        numbers: dict[tuple[Any, ...], int] = {}
        keys = {i: self._kind_key(self.tables.edges[i]) for i in self.edges}
        return {i: numbers.setdefault(key, len(numbers)) for i, key in keys.items()}

    def points(self, index: int) -> FloatArray:
        """Return points along an edge for a picture [m], (n, 3)."""
        edge = self.tables.edges[index]
        if edge.kind == LINE:
            return edge.ends
        count = CURVE_POINTS
        if edge.kind == CIRCLE:
            turn = edge.length / (2 * np.pi * edge.radius)
            count = max(LEAST_POINTS, int(np.ceil(turn * CURVE_POINTS)) + 1)
        return edge.curve(np.linspace(0.0, 1.0, count))

    def select(self, rules: Sequence[EdgeRule]) -> dict[int, int]:
        """Return the number of the rule, from 0, by index of the edges that rules select.

        Raises:
            InvalidInput: A rule selects no edge.
        """
        selector = self._selector(rules)
        if not rules:
            return {x.index: 0 for x in selector.without_rule()}
        selected: dict[int, int] = {}
        for number, rule in enumerate(rules):
            for edge in selector.select([rule]):
                selected.setdefault(edge.index, number)
        return selected

    def rule_like(self, index: int) -> EdgeRule:
        """Return the rule that names all edges like an edge."""
        return self.groups[self.group_of[index]].rule

    def rule_at(self, index: int, layer: str = "") -> EdgeRule:
        """Return a rule that names one edge by a point in its middle.

        Args:
            index: Index of the edge.
            layer: Layer of the contour.

        Raises:
            InvalidInput: No rule names only this edge.
        """
        edge = self.tables.edges[index]
        middle = edge.curve(np.array([0.5]))[0]
        near = [_rounded(x) for x in middle.tolist()]
        base = EdgeRule(seams=edge.seam, near=near, layer=layer)
        exact = [float(x) for x in middle]
        attempts = [base]
        if edge.seam is None:
            part = self._part_of(edge)
            fold = fold_of(edge) or None
            attempts += [replace(base, part=part), replace(base, part=part, fold=fold)]
            attempts.append(replace(base, part=part, fold=fold, kind=edge.kind, near=exact))
            attempts.append(EdgeRule(index=index + 1, layer=layer))
        else:
            attempts.append(replace(base, near=exact))
        for rule in attempts:
            if self._names_only(rule, index):
                return rule
        raise InvalidInput(
            f"No rule names only this edge of {self.source}, because others lie on it."
        )

    def _names_only(self, rule: EdgeRule, index: int) -> bool:
        """Return whether a rule names one edge and no other."""
        try:
            return list(self.select([rule])) == [index]
        except InvalidInput:
            return False

    def _selector(self, rules: Sequence[EdgeRule]) -> Selector:
        """Return the selector for rules, after a question to the kernel if necessary."""
        tables = self.tables
        needed = request_of(rules)
        if not tables.request.covers(needed):
            # Seams keep their numbers, because those of the picture stay first.
            tables = self.ask(tables.request.joined(needed))
        return Selector(tables=tables, source=self.source)

    def _kind_key(self, edge: Edge) -> tuple[Any, ...]:
        """Return what edges of a kind have in common."""
        rule = self._rule_of_kind(edge)
        return (rule.seams, rule.open, rule.fold, rule.part, rule.kind, rule.radius)

    def _rule_of_kind(self, edge: Edge) -> EdgeRule:
        """Return the rule that names all edges of an edge's kind."""
        if edge.seam is not None:
            return EdgeRule(seams=edge.seam, open=self._open(edge))
        if edge.kind == CIRCLE:
            return EdgeRule(kind=CIRCLE, radius=_rounded(edge.radius))
        return EdgeRule(fold=fold_of(edge) or None, kind=edge.kind, part=self._part_of(edge))

    @cached_property
    def _openings(self) -> dict[tuple[str, str], float]:
        """Free distance that separates seams outside of a tube from those inside [m], by parts."""
        extents = np.array([x.extent for x in self.tables.parts])
        size = float(np.linalg.norm(extents[:, 1].max(axis=0) - extents[:, 0].min(axis=0)))
        found = {}
        for pair in self.tables.request.seams:
            every = [min(x.opening, size) for x in self.tables.edges if x.seam == pair]
            openings = np.sort(np.maximum(every, ROUNDING))
            ratios = openings[1:] / openings[:-1]
            if len(ratios) and ratios.max() >= INSIDE_OUTSIDE:
                k = int(ratios.argmax())
                middle = float(np.sqrt(openings[k] * openings[k + 1]))
                found[pair] = round(middle, 3) or _rounded(middle)
        return found

    def _open(self, edge: Edge) -> float | None:
        """Return the free distance that leaves out seams inside a tube, for a seam outside."""
        least = None if edge.seam is None else self._openings.get(edge.seam)
        return None if least is None or edge.opening < least else least

    def _part_of(self, edge: Edge) -> str | None:
        """Return the name of an edge's part if the model has several."""
        if len(self.tables.parts) == 1 or not edge.uses:
            return None
        return self.tables.parts[self.tables.faces[edge.uses[0].face].part].name or None


def written_rule(rule: EdgeRule) -> dict[str, Any]:
    """Return a rule as keys and values of a job file, with lengths in mm."""
    data: dict[str, Any] = {}
    for name in EdgeRule.__dataclass_fields__:
        value = getattr(rule, name)
        if value is None or value == "":
            continue
        if name in ("open", "radius"):
            data[name] = _write(value)
        elif name == "near":
            data[name] = [_write(x) for x in value]
        elif isinstance(value, FaceRule):
            data[name] = {"near": [_write(x) for x in value.near]}
        else:
            data[name] = list(value) if isinstance(value, tuple) else value
    return data


def _write(length: float) -> str:
    """Return a length as text in mm, which reads as the same number."""
    return str(write_like(length, WRITTEN, LENGTH))


def _rounded(length: float) -> float:
    """Return a length that has few digits in mm [m]."""
    text = str(write_like(length, WRITTEN, LENGTH, within=ROUNDING))
    return float(text.split()[0]) / 1e3


def _is_on(edge: Edge, seams: Sequence[Edge]) -> bool:
    """Return whether an edge lies on seams."""
    if not seams:
        return False
    points = edge.curve(PROBES)
    return all(_is_near(point, seams) for point in points)


def _is_near(point: FloatArray, seams: Sequence[Edge]) -> bool:
    """Return whether a point lies on one of several seams."""
    for seam in seams:
        low, high = seam.extent
        inside = (point >= low - ON_SEAM).all() and (point <= high + ON_SEAM).all()
        if inside and distance_to_edge(seam, point) <= ON_SEAM:
            return True
    return False
