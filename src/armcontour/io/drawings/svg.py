"""SVG drawings, read into a program of contours in metres with y up."""

from __future__ import annotations

import re

from armcontour._progress import Progress
from armcontour.io.drawings._svg_tree import Element, tree_of
from armcontour.io.drawings._svg_units import (
    INCH,
    PIXEL,
    Box,
    affine,
    length_of,
    view_box,
    viewbox_transform,
)
from armcontour.io.drawings._svg_walk import SvgWalk
from armcontour.io.drawings.chain import Affine
from armcontour.io.drawings.options import ReadOptions
from armcontour.program import Program

# Versions of Inkscape with 90 px per inch, the comment of Illustrator, which has 72, and the bytes
# in which it is; lengths that depend on no pixel.
OLD_INKSCAPE = re.compile(r"0\.(?:[0-8]\d?|9|9[01])(?!\d)[.\d]*")
ILLUSTRATOR = re.compile(rb"Generator:\s*Adobe\s+Illustrator", re.IGNORECASE)
BEGINNING = 10_000
ABSOLUTE = re.compile(r"\d\s*(?:mm|cm|in|pt|pc|q)$", re.IGNORECASE)


def read_svg(
    data: bytes, *, source: str, options: ReadOptions, progress: Progress | None = None
) -> Program:
    """Read the outlines of an SVG drawing.

    Shapes become contours in drawing order, placed by their groups, transforms and references;
    each subpath is a contour. Separate elements whose ends touch are chained. Strokes, fills and
    the edges of the page have no effect; hidden elements are left out.

    Coordinates are in metres from the lower left corner of the page, x to the right and y up.
    `options.unit` is the length of the user unit. If it is None, width, height and viewBox define
    the user unit, and without them it is a pixel: 1/72 inch in files of Illustrator, 1/90 inch in
    those of Inkscape before 0.92, else 1/96 inch as in CSS.

    Lines are kept, and so are arcs that are still circular after all transforms; other curves
    become tangent arcs within `options.fit_tolerance`.

    Args:
        data: Content of the file.
        source: Name of the file.
        options: Settings of the reader.
        progress: Called from time to time with the name of the source and the share of it that is
            read.

    Raises:
        InvalidInput: The file is not SVG, or has content that is not read; the message names the
            element and its line.
    """
    root = tree_of(data, source)
    page, view, notes = _page(root, options, data)
    walk = SvgWalk(root, options, progress)
    return walk.program(walk.shapes(page, view), notes)


def _program_pixel(root: Element, data: bytes) -> tuple[float, str]:
    """Length of a px of the program that wrote a file [m], and its name; "" for CSS pixels."""
    version = root.get("inkscape:version")
    if version:
        number = OLD_INKSCAPE.match(version)
        return (INCH / 90, f"Inkscape {number[0]}") if number else (PIXEL, "")
    # It may be UTF-16.
    illustrator = ILLUSTRATOR.search(data[:BEGINNING].replace(b"\0", b""))
    return (INCH / 72, "Adobe Illustrator") if illustrator else (PIXEL, "")


def _page(root: Element, options: ReadOptions, data: bytes) -> tuple[Affine, Box | None, list[str]]:
    """The coordinates of the page.

    Returns:
        The map from user units to metres on the page with y up, the viewport in user units (None
        if it is not known), and notes for the user.

    Raises:
        InvalidInput: Width, height or viewBox is invalid, or the outermost svg has a transform.
    """
    if root.get("transform"):
        root.refuse("a transform of the outermost svg is not read: put a group with it inside")
    box = view_box(root)
    width, height = _extent(root, "width"), _extent(root, "height")
    unit = PIXEL if options.unit is None else options.unit
    notes = []
    absolute = any(ABSOLUTE.search(root.get(x)) for x in ("width", "height"))
    if options.unit is None and not (box is not None and absolute):
        unit, program = _program_pixel(root, data)
        if program:
            notes.append(
                f"{root.source} is by {program}, whose px is 1/{INCH / unit:.0f} inch: it is read "
                "so, and not as the 1/96 inch of CSS. To change this, give the unit."
            )
        if absolute:
            # Millimetres of the page are true, whatever a px is.
            width, height = (x and x * PIXEL / unit for x in (width, height))
    if box is not None:
        # If only one of width and height is given, the aspect ratio of the viewBox gives the other.
        if options.unit is not None or (width is None and height is None):
            width, height = box.width, box.height
        wide = width if width is not None else (height or 0.0) * box.width / box.height
        high = height if height is not None else wide * box.height / box.width
        inner = viewbox_transform(root, box, Box(0.0, 0.0, wide, high))
        return _up(high, unit) @ inner, box, notes
    if height is None:
        notes.append(
            f"{root.source} says no height of its page: y is 0 at its upper edge and negative "
            "below."
        )
        return _up(0.0, unit), None, notes
    view = Box(0.0, 0.0, width, height) if width is not None else None
    return _up(height, unit), view, notes


def _extent(root: Element, key: str) -> float | None:
    """Width or height of the page in user units; None without it, or if it is a percentage."""
    value = None if root.get(key).endswith("%") else length_of(root, key, default=None)
    if value is not None and value <= 0:
        root.refuse(f"{key} must be above zero, but is {root.get(key)}")
    return value


def _up(height: float, unit: float) -> Affine:
    """The map from page coordinates with y down to metres with y up from the lower edge."""
    return affine(unit, 0.0, 0.0, -unit, 0.0, height * unit)
