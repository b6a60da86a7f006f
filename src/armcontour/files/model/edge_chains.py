"""Chains of selected edges that follow one another, each of which becomes a contour."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.files.model.edge_rules import EdgeRule
from armcontour.files.model.edge_selection import SelectedEdge, normals_of
from armcontour.files.model.tables import Edge, Face, Tables

# Steps of Newton's method for the point of an edge nearest to a point that is almost on it.
PROJECTION_STEPS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Link:
    """An edge in a chain. Its points have a fraction v from 0 to 1 in the direction of travel.

    Args:
        index: Index of the edge.
        edge: The edge.
        forward: Whether the chain runs in the direction of the edge's curve.
        first: Index, among the uses of the edge, of the face on whose boundary the chain runs.
        faces: All faces of the model.
    """

    index: int
    edge: Edge
    forward: bool
    first: int
    faces: Sequence[Face]

    def fractions(self, v: FloatArray) -> FloatArray:
        """Return fractions of the edge's curve for fractions in the direction of travel."""
        return v if self.forward else 1.0 - v

    def points(self, v: FloatArray) -> FloatArray:
        """Return points [m], (n, 3)."""
        return self.edge.curve(self.fractions(v))

    def slopes(self, v: FloatArray) -> FloatArray:
        """Return derivatives by v [m], (n, 3)."""
        slopes = self.edge.curve(self.fractions(v), 1)
        return slopes if self.forward else -slopes

    def tangents(self, v: FloatArray) -> FloatArray:
        """Return unit tangents in the direction of travel, (n, 3)."""
        slopes = self.slopes(v)
        return np.asarray(slopes / np.linalg.norm(slopes, axis=1, keepdims=True))

    def normals(self, v: FloatArray) -> list[FloatArray]:
        """Return the outward unit normals of the faces, (n, 3) each, the first face first."""
        u = self.fractions(v)
        order = [self.first, *(k for k in range(len(self.edge.uses)) if k != self.first)]
        return [normals_of(self.edge, self.faces, k, u) for k in order]

    def project(self, points: FloatArray, v: FloatArray) -> FloatArray:
        """Return the fractions at which the edge is nearest to points close to it.

        - `points`: the points [m], (n, 3).
        - `v`: first estimates of the fractions, (n,).
        """
        for _ in range(PROJECTION_STEPS):
            slopes = self.slopes(v)
            along = np.sum((points - self.points(v)) * slopes, axis=1)
            v = np.clip(v + along / np.sum(slopes * slopes, axis=1), 0.0, 1.0)
        return v


@dataclass(frozen=True, kw_only=True, eq=False)
class Chain:
    """Edges that follow one another.

    Args:
        rule: Rule that selects the edges.
        links: The edges in the order of travel.
        corners: Points at which they start and end [m], (n + 1, 3); the last one repeats the first
            if the chain is closed.
        closed: Whether the chain ends where it starts.
    """

    rule: EdgeRule
    links: tuple[Link, ...]
    corners: FloatArray
    closed: bool

    @cached_property
    def turns(self) -> FloatArray:
        """Angles between the tangents before and after each link's end [rad], (n,).

        The last one is at the end of a closed chain, and infinite for an open chain.
        """
        ends = np.concatenate([x.tangents(np.array([1.0])) for x in self.links])
        starts = np.concatenate([x.tangents(np.array([0.0])) for x in self.links])
        following = np.roll(starts, -1, axis=0)
        angles = 2 * np.arctan2(
            np.linalg.norm(ends - following, axis=1), np.linalg.norm(ends + following, axis=1)
        )
        return angles if self.closed else np.append(angles[:-1], np.inf)


def make_chains(
    selected: Sequence[SelectedEdge], tables: Tables, join_tolerance: float
) -> list[Chain]:
    """Join selected edges whose ends touch, separately for each rule.

    A chain ends where another number of edges than two meet. It runs in the direction of its first
    edge, which has the first face on its left, seen from outside.

    - `join_tolerance`: distance below which two ends are the same point [m].
    """
    groups: dict[int, list[SelectedEdge]] = defaultdict(list)
    for edge in selected:
        groups[id(edge.rule)].append(edge)
    chains = []
    for group in groups.values():
        chains += _chains_of_rule(group, tables, join_tolerance)
    return chains


def _chains_of_rule(
    selected: Sequence[SelectedEdge], tables: Tables, join_tolerance: float
) -> list[Chain]:
    """Join the edges of one rule; edges shorter than the join tolerance are points."""
    ordered = sorted(selected, key=lambda x: x.index)
    links = [_link(x, tables) for x in ordered if tables.edges[x.index].length > join_tolerance]
    if not links:
        longest = max(tables.edges[x.index].length for x in ordered)
        raise InvalidInput(
            f"Edge {ordered[0].index + 1} is {longest * 1e3:.3g} mm long, but contours must be "
            f"longer than join_tolerance, {join_tolerance * 1e3:g} mm."
        )
    nodes, places = _find_nodes(links, join_tolerance)
    at_node: dict[int, list[int]] = defaultdict(list)
    for k, pair in enumerate(nodes.tolist()):
        if pair[0] != pair[1]:
            at_node[pair[0]].append(k)
            at_node[pair[1]].append(k)
    left = set(range(len(links)))
    chains = []
    for k in range(len(links)):
        if k in left:
            order = _walk(k, nodes, at_node)
            left -= {index for index, _ in order}
            chains.append(_chain(order, links, nodes, places, selected[0].rule))
    return chains


def _link(selected: SelectedEdge, tables: Tables) -> Link:
    """Return the link of a selected edge, in the direction of its first face's boundary."""
    edge = tables.edges[selected.index]
    if not edge.uses:
        raise InvalidInput(f"Edge {selected.index + 1} bounds no face.")
    first = 0
    for k, use in enumerate(edge.uses):
        part = tables.faces[use.face].part
        is_first_part = edge.seam is not None and tables.parts[part].name == edge.seam[0]
        if use.face == selected.face or is_first_part:
            first = k
            break
    return Link(
        index=selected.index,
        edge=edge,
        forward=edge.uses[first].forward,
        first=first,
        faces=tables.faces,
    )


def _find_nodes(links: Sequence[Link], join_tolerance: float) -> tuple[IntArray, FloatArray]:
    """Return the node at the start and the end of each link, (n, 2), and the nodes' places [m].

    A node is a group of ends that are the same point; its place is their mean.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    ends = np.concatenate([x.points(np.array([0.0, 1.0])) for x in links])
    pairs = cKDTree(ends).query_pairs(join_tolerance, output_type="ndarray")
    count = len(ends)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    number, labels = connected_components(graph, directed=False)
    sizes = np.bincount(labels, minlength=number)
    places = np.stack(
        [np.bincount(labels, ends[:, k], minlength=number) / sizes for k in range(3)], axis=1
    )
    return labels.astype(np.intp).reshape(-1, 2), places


def _walk(first: int, nodes: IntArray, at_node: dict[int, list[int]]) -> list[tuple[int, bool]]:
    """Return the links of the chain with a link, each with whether it keeps its direction.

    The chain runs in the direction of the link `first`; a closed chain starts with it.

    - `nodes`: nodes at the start and the end of each link, (n, 2).
    - `at_node`: links that start or end at each node.
    """
    start, end = nodes[first].tolist()
    chain = [(first, True)]
    if start == end:
        return chain
    used = {first}
    for forwards in (True, False):
        node = end if forwards else start
        while len(at_node[node]) == 2:
            following = next((k for k in at_node[node] if k not in used), None)
            if following is None:
                return chain
            used.add(following)
            a, b = nodes[following].tolist()
            if forwards:
                chain.append((following, a == node))
            else:
                chain.insert(0, (following, b == node))
            node = b if a == node else a
    return chain


def _chain(
    order: Sequence[tuple[int, bool]],
    links: Sequence[Link],
    nodes: IntArray,
    places: FloatArray,
    rule: EdgeRule,
) -> Chain:
    """Return the chain of links in an order."""
    chosen = []
    corners = []
    for k, keeps in order:
        link = links[k]
        start, end = nodes[k] if keeps else nodes[k][::-1]
        corners.append(places[start])
        forward = link.forward if keeps else not link.forward
        chosen.append(replace(link, forward=forward))
    corners.append(places[end])
    closed = bool(np.array_equal(corners[0], corners[-1]))
    return Chain(rule=rule, links=tuple(chosen), corners=np.array(corners), closed=closed)
