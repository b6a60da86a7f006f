"""SVG drawings, read into a program of contours in metres with y up."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence

import numpy as np

from armcontour._progress import Progress
from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.geometry.mending import Printed
from armcontour.io.drawings._svg_shapes import shape_of
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
from armcontour.io.drawings._svg_walk import NO_SIZE, Shape, Walk
from armcontour.io.drawings.chain import Affine
from armcontour.io.drawings.chaining import Piece, chain_pieces
from armcontour.io.drawings.clipping import clip_path
from armcontour.io.drawings.mending import half_a_place, mend
from armcontour.io.drawings.options import FARTHEST, ReadOptions
from armcontour.io.drawings.reading import (
    WALKED,
    Tell,
    after_walk,
    count_names,
    tell_share,
)
from armcontour.io.drawings.shapes import Outline, paths_of
from armcontour.program import Program

# Largest number of segments, a curve counted as one; no drawing of contours has more.
MOST_SEGMENTS = 500_000
# Attributes with the coordinates of a shape.
COORDINATES = ("d", "points", "x", "y", "width", "height", "x1", "y1", "x2", "y2")
# Versions of Inkscape with 90 px per inch, the comment of Illustrator, which has 72, and the bytes
# in which it is; lengths that depend on no pixel.
OLD_INKSCAPE = re.compile(r"0\.(?:[0-8]\d?|9|9[01])(?!\d)[.\d]*")
ILLUSTRATOR = re.compile(rb"Generator:\s*Adobe\s+Illustrator", re.IGNORECASE)
BEGINNING = 10_000
ABSOLUTE = re.compile(r"\d\s*(?:mm|cm|in|pt|pc|q)$", re.IGNORECASE)
# Largest number of elements that one note names.
NAMED = 6


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
    walk = Walk(root=root, skip=options.skips, wanted=options.layer_set, colors=options.color_set)
    shapes: list[Shape] = []
    tell = tell_share(progress, source)
    pieces = _pieces(walk, page, view, options, shapes, tell)
    contours, chaining_notes = chain_pieces(pieces, options.join_tolerance)
    for reason, names in walk.left_out.items():
        notes.append(f"{reason}: {list_some(names, NAMED)}.")
    if not contours:
        if b"<glyph" in data:
            raise InvalidInput(
                f"{source} is a font, whose glyphs are no drawing: give a drawing in which the "
                "text is converted to paths."
            )
        if walk.others:
            notes.append(f"Strokes of other colours than chosen: {count_names(walk.others)}.")
        why = f" ({' '.join([*notes, *chaining_notes])})" if notes or chaining_notes else ""
        raise InvalidInput(f"{source} has no contour to follow{why}.")
    notes += walk.labels.notes
    program = Program(moves=tuple(contours), source=source, notes=(*notes, *chaining_notes))
    units = _printed_units(shapes)
    return mend(program, {name: Printed(point=x) for name, x in units.items()}, options)


def _pieces(
    walk: Walk,
    page: Affine,
    view: Box | None,
    options: ReadOptions,
    shapes: list[Shape],
    tell: Tell,
) -> list[Piece]:
    """The outlines of all shapes as pieces, in metres.

    Args:
        walk: The traversal, which records shapes without size.
        page: Map from user units to the page [m].
        view: Viewport in user units.
        options: Settings of the reader.
        shapes: Takes the shapes.
        tell: Called from time to time with the fraction that is done.

    Raises:
        InvalidInput: A shape is invalid, too far away or too large.
    """
    found: list[tuple[Shape, Outline]] = []
    budget = _Budget()
    for shape in walk.shapes(page, view):
        tell(WALKED * walk.share)
        budget.element = shape.element
        shapes.append(shape)
        outlines = shape_of(shape.element, budget)
        found += [(shape, _placed(shape, x)) for x in outlines]
        if not outlines:
            walk.leave_out(NO_SIZE, shape.element)
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            paths = paths_of(
                [x for _, x in found],
                options.fit_tolerance,
                options.join_tolerance,
                after_walk(tell),
            )
    except InvalidInput as error:
        assert error.index is not None
        found[error.index][0].element.refuse(str(error).rstrip("."))
    pieces: list[Piece] = []
    # Subpaths of one element have different numbers, so that they are never chained.
    for _, group in itertools.groupby(zip(found, paths, strict=True), lambda x: id(x[0][0])):
        drawn = list(group)
        shape = drawn[0][0][0]
        kept = [path for _, path in drawn if path is not None]
        if not kept:
            walk.leave_out(NO_SIZE, shape.element)
        kept = [part for path in kept for part in clip_path(path, *shape.clips)]
        first = len(pieces) + 1 if len(kept) > 1 else 0
        pieces += [
            Piece(path=path, name=shape.name, layer=shape.layer, apart=number)
            for number, path in enumerate(kept, first)
        ]
    return pieces


def _printed_units(shapes: Sequence[Shape]) -> dict[str, float]:
    """Half of the last decimal place of coordinates [m], by the names of shapes."""
    half = half_a_place(x.element.get(key) for x in shapes for key in COORDINATES)
    found: dict[str, float] = {}
    # Shapes without transforms of their own share the map of their group.
    sizes = {id(x.to): x.to for x in shapes}
    factors = {key: float(np.linalg.norm(x.linear, 2)) for key, x in sizes.items()}
    for x in shapes:
        size = half * factors[id(x.to)]
        found[x.name] = min(size, found.get(x.name, size))
    return found


class _Budget:
    """Counts segments before they are made, and refuses the element that exceeds the limit."""

    def __init__(self) -> None:
        self.element: Element | None = None
        self._left = MOST_SEGMENTS

    def __call__(self, segments: int) -> None:
        self._left -= segments
        if self._left < 0 and self.element is not None:
            self.element.refuse(
                f"the drawing has more than {MOST_SEGMENTS} segments by here: split it"
            )


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


def _placed(shape: Shape, outline: Outline) -> Outline:
    """An outline in metres.

    Raises:
        InvalidInput: The outline is too far away.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        placed = outline.place(shape.to)
        reach = float(np.abs(placed.reach).max())
    if not reach <= FARTHEST:
        shape.element.refuse(
            f"it reaches {reach:.3g} m far, more than {FARTHEST:g} m: give another unit"
        )
    return placed
