"""What a program consists of: size, nesting and corners of every contour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.frames import angle_between
from armcontour.program.moves import Contour, Program
from armcontour.program.nesting import nest

# Turn from which a vertex is called a corner [rad]: less is what printed coordinates make.
CORNER = np.radians(1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContourFacts:
    """Facts of one contour.

    Args:
        number: Its number in the program, from 1.
        name: Its name in its source.
        layer: Its layer.
        length: Its length [m].
        closed: Whether it is closed.
        extent: Smallest and largest coordinates [m], (2, 2) or (2, 3).
        area: Area of a closed contour [m²], positive if it is counter-clockwise; 0 if open.
        inside: Number of the smallest contour that holds it; None if none does.
        lines, arcs: Numbers of segments.
        corners: Number of vertices that turn by a degree or more.
    """

    number: int
    name: str
    layer: str
    length: float
    closed: bool
    extent: FloatArray
    area: float
    inside: int | None
    lines: int
    arcs: int
    corners: int


def survey(program: Program) -> tuple[ContourFacts, ...]:
    """Facts of all contours of a program; a program in space is viewed along z."""
    nesting = nest(program.contours, np.array([0.0, 0.0, 1.0]))
    found = []
    for i, x in enumerate(program.contours):
        arcs = int(np.count_nonzero(x.path.curvatures))
        parent = int(nesting.parents[i])
        found.append(
            ContourFacts(
                number=i + 1,
                name=x.name,
                layer=x.layer,
                length=x.path.length,
                closed=x.closed,
                extent=x.path.segments.extent,
                area=float(nesting.areas[i]),
                inside=None if parent < 0 else parent + 1,
                lines=len(x.path) - arcs,
                arcs=arcs,
                corners=int(np.count_nonzero(_turns(x) >= CORNER)),
            )
        )
    return tuple(found)


def _turns(contour: Contour) -> FloatArray:
    """Angles of all vertices [rad], for closed contours that of the start, too."""
    path = contour.path
    if not contour.closed:
        return path.turns
    return np.append(path.turns, angle_between(path.segments.end_tangents[-1:], path.tangents[:1]))


def extent_of(facts: Sequence[ContourFacts]) -> FloatArray:
    """Smallest and largest coordinates of all contours [m], (2, 2) or (2, 3)."""
    low = np.min([x.extent[0] for x in facts], axis=0)
    high = np.max([x.extent[1] for x in facts], axis=0)
    return np.stack([low, high])
