"""Outlines of SVG's shapes in the coordinates of their elements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.files.drawings._svg_path_data import Pen, outlines_of
from armcontour.files.drawings._svg_tree import Element
from armcontour.files.drawings._svg_units import length_of, number_of, numbers_of
from armcontour.files.drawings.chain import Chain
from armcontour.files.drawings.shapes import Outline

Spend = Callable[[int], None]


def shape_of(element: Element, spend: Spend) -> list[Outline]:
    """The outlines of an element with a tag of `SHAPES`; empty if it has no size.

    Args:
        element: The element.
        spend: Called with a number of segments before they are made; may refuse them.

    Raises:
        InvalidInput: The attributes do not define the shape.
    """
    return SHAPES[element.tag](element, spend)


def _line(element: Element, spend: Spend) -> list[Outline]:
    """The outline of a line; empty if it has no length."""
    spend(1)
    x1, y1, x2, y2 = (number_of(element, key) for key in ("x1", "y1", "x2", "y2"))
    if (x1, y1) == (x2, y2):
        return []
    return [Outline([Chain.straight(np.array([[x1, y1], [x2, y2]]))])]


def _polyline(element: Element, spend: Spend) -> list[Outline]:
    """The outline of a polyline or polygon; empty if it has fewer than two points."""
    points = _read_points(element, spend)
    closed = element.tag == "polygon"
    return [Outline([Chain.straight(points)], closed)] if len(points) > 1 else []


def _read_points(element: Element, spend: Spend) -> FloatArray:
    """The attribute points of an element, (n, 2).

    Raises:
        InvalidInput: The attribute is not a list of pairs of numbers.
    """
    values = numbers_of(element, "points", element.get("points"))
    if len(values) % 2:
        element.refuse(f"points are pairs of x and y, but there are {len(values)} numbers")
    spend(len(values) // 2)
    return np.array(values).reshape(-1, 2)


def _rect(element: Element, spend: Spend) -> list[Outline]:
    """The outline of a rect with sharp or round corners; empty without width or height."""
    spend(8)
    x, y, width, height = (number_of(element, key) for key in ("x", "y", "width", "height"))
    radii = [length_of(element, key, default=None) for key in ("rx", "ry")]
    rx, ry = (b if a is None else a for a, b in (radii, radii[::-1]))
    rx, ry = rx or 0.0, ry or 0.0
    for key, value in (("width", width), ("height", height), ("rx", rx), ("ry", ry)):
        if value < 0:
            element.refuse(f"{key} must not be negative, but is {value:g}")
    if not (width and height):
        return []
    rx, ry = min(rx, width / 2), min(ry, height / 2)
    if not (rx and ry):
        corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
        return [Outline([Chain.straight(corners)], closed=True)]
    pen = Pen(element)
    right, bottom = x + width, y + height
    for letter, numbers in (
        ("M", (x + rx, y)),
        ("H", (right - rx,)),
        ("A", (rx, ry, 0, 0, 1, right, y + ry)),
        ("V", (bottom - ry,)),
        ("A", (rx, ry, 0, 0, 1, right - rx, bottom)),
        ("H", (x + rx,)),
        ("A", (rx, ry, 0, 0, 1, x, bottom - ry)),
        ("V", (y + ry,)),
        ("A", (rx, ry, 0, 0, 1, x + rx, y)),
        ("Z", ()),
    ):
        pen.obey(letter, numbers)
    return pen.outlines


def _circle(element: Element, spend: Spend) -> list[Outline]:
    """The outline of a circle; empty without a radius."""
    spend(1)
    radius = number_of(element, "r")
    return _around(element, (radius, radius), ("r", "r"))


def _ellipse(element: Element, spend: Spend) -> list[Outline]:
    """The outline of an ellipse; empty without radii."""
    spend(1)
    radii = [length_of(element, key, default=None) for key in ("rx", "ry")]
    rx, ry = (b if a is None else a for a, b in (radii, radii[::-1]))
    return _around(element, (rx or 0.0, ry or 0.0), ("rx", "ry"))


def _around(element: Element, radii: tuple[float, float], keys: tuple[str, str]) -> list[Outline]:
    """The outline of a full ellipse; empty if a radius is zero.

    Args:
        element: The element, with its centre in cx and cy.
        radii: Semi-axes along x and y.
        keys: Names of the attributes of the radii, for messages.

    Raises:
        InvalidInput: A radius is negative.
    """
    for key, value in zip(keys, radii, strict=True):
        if value < 0:
            element.refuse(f"{key} must not be negative, but is {value:g}")
    if not all(radii):
        return []
    center = np.array([number_of(element, "cx"), number_of(element, "cy")])
    # SVG draws an ellipse from its point with the largest x.
    cosine, sine = np.diag(radii)
    return [Outline([Chain.arc(center, cosine, sine, 2 * np.pi)], closed=True)]


SHAPES: dict[str, Callable[[Element, Spend], list[Outline]]] = {
    "path": outlines_of,
    "line": _line,
    "polyline": _polyline,
    "polygon": _polyline,
    "rect": _rect,
    "circle": _circle,
    "ellipse": _ellipse,
}
