"""Projection of points in the plane or in space into a drawing, and its lines and marks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.report.view import simplify

# Width of the drawing [px].
WIDTH = 800.0
# Maximum height of the drawing [px].
HEIGHT = 700.0
# Minimum height of the drawing [px].
FLATTEST = 190.0
# Margin of the drawing [px].
EDGE = 34.0
# Maximum deviation of a drawn line from its curve [px].
VISIBLE = 0.3
# A path whose height along z is below this fraction of its size is drawn as flat.
FLAT = 0.02
# Unit vectors to the right and up in the view of other paths in space.
OBLIQUE = np.array([[0.806, 0.591, 0.0], [-0.257, 0.351, 0.9]])
# Approximate minimum distance between marks of one kind [px].
APART = 7.0
# An axis is not drawn if its projection is shorter than this fraction of it.
SHORT_AXIS = 0.25
# Factor by which a link to a place enlarges the drawing.
CLOSER = 5
# A smaller extent of a drawing [m] is enlarged to this one.
SMALLEST_SIZE = 1e-9


class Mark(NamedTuple):
    """A mark at a point in a drawing.

    Args:
        point: Position [m], (dimension,).
        words: Tooltip.
        along: Direction, (dimension,); None if the mark has no direction.
        place: Id of the mark, to which the page links.
        window: Size of what a link to the mark shows [m]; 0 for a fraction of the drawing.
    """

    point: FloatArray
    words: str
    along: FloatArray | None = None
    place: str = ""
    window: float = 0.0


class Line(NamedTuple):
    """A line in a drawing.

    Args:
        look: SVG attributes.
        d: Points as the SVG attribute `d`.
        words: Tooltip.
    """

    look: str
    d: str
    words: str = ""


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Projection of path points into the drawing.

    Args:
        axes: Unit vectors to the right and up in the coordinates of the path, (2, dimension).
        origin: Coordinates of the lower left corner along these axes [m], (2,).
        size: Scale [px/m].
        extent: Width and height of the drawing [px], (2,).
    """

    axes: FloatArray
    origin: FloatArray
    size: float
    extent: FloatArray

    @classmethod
    def of(cls, points: FloatArray, axes: FloatArray) -> Sheet:
        """Make the sheet on which points [m], (n, dimension), are drawn as large as possible."""
        coordinates = points @ axes.T
        low = coordinates.min(axis=0)
        high = coordinates.max(axis=0)
        width, height = np.maximum(high - low, SMALLEST_SIZE)
        size = min((WIDTH - 2 * EDGE) / width, (HEIGHT - 2 * EDGE) / height)
        extent = np.array([WIDTH, max(FLATTEST, height * size + 2 * EDGE)])
        margins = (extent / size - (high - low)) / 2
        return cls(axes, low - margins, float(size), extent)

    def place(self, points: FloatArray) -> FloatArray:
        """Project points [m], (n, dimension), to positions in the drawing [px], (n, 2)."""
        xy = (points @ self.axes.T - self.origin) * self.size
        # In SVG, y points down.
        return np.asarray(np.stack([xy[..., 0], self.extent[1] - xy[..., 1]], axis=-1))

    def line(
        self, curves: Sequence[FloatArray], look: str, words: str = "", *, fine: bool = False
    ) -> Line:
        """Draw curves [m] as a line, simplified to a deviation of VISIBLE on the screen.

        `fine`: the curves are simplified already; their details are seen in the enlarged drawing.
        """
        drawn = [self.place(x) for x in curves]
        digits = 2 if fine else 1
        if not fine:
            chosen = simplify(drawn, VISIBLE)
            drawn = [points[rows] for points, rows in zip(drawn, chosen, strict=True)]
        texts = (
            "M" + " ".join(f"{x:.{digits}f}" for x in points.ravel().tolist()) for points in drawn
        )
        return Line(look, "".join(texts), words)

    def without_overlap(self, marks: Iterable[Mark]) -> list[Mark]:
        """Remove marks that would overlap an earlier one."""
        cells: dict[tuple[float, ...], Mark] = {}
        for mark in marks:
            cells.setdefault(tuple((self.place(mark.point) // APART).tolist()), mark)
        return list(cells.values())

    def angle(self, mark: Mark) -> float:
        """Return a mark's direction, clockwise from right [deg]."""
        along = np.array([1.0, 0.0]) if mark.along is None else mark.along @ self.axes.T
        return float(-np.degrees(np.arctan2(along[1], along[0])))

    def window(self, mark: Mark) -> float:
        """Return the width of the part of the drawing that a link to the mark shows [px]."""
        return mark.window * self.size or WIDTH / CLOSER

    @property
    def in_mm(self) -> tuple[float, ...]:
        """Coordinates of the lower left corner [mm] and size of a pixel [mm], seen from above."""
        flat = np.array_equal(self.axes, np.eye(*self.axes.shape))
        return (*self.origin * 1e3, 1e3 / self.size) if flat else ()

    @property
    def bar(self) -> float:
        """Round length of the scale bar [m]."""
        longest = WIDTH / 5 / self.size
        power = 10.0 ** np.floor(np.log10(longest))
        return float(max(x * power for x in (1, 2, 5) if x * power <= longest))

    @property
    def visible_axes(self) -> list[tuple[str, float, float]]:
        """Name, and components to the right and up, of the coordinate axes that are drawn."""
        axes = zip("xyz", *self.axes.tolist(), strict=False)
        return [x for x in axes if np.hypot(*x[1:]) > SHORT_AXIS]


def view_of(points: FloatArray) -> FloatArray:
    """Return unit vectors to the right and up in the view, (2, dimension).

    Paths in a plane of constant z are viewed from above, other paths in space obliquely.
    """
    size = np.ptp(points, axis=0)
    if len(size) == 2 or size[2] <= FLAT * size.max():
        return np.eye(2, len(size))
    return OBLIQUE
