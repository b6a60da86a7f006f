"""SVG drawings, read into a program of contours in metres with y up."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.progress import Progress
from armcontour.files.drawings.arc_chain import Affine, ArcChain
from armcontour.files.drawings.read_options import SKIP, ReadOptions, color_of
from armcontour.files.drawings.svg_elements import (
    FONT,
    IDENTITY,
    INCH,
    PIXEL,
    Element,
    ViewBox,
    affine,
    font_size,
    is_flat,
    length_of,
    make_absolute,
    number_of,
    transform_of,
    tree_of,
    view_box,
    viewbox_transform,
)
from armcontour.files.drawings.svg_shapes import SHAPES, shape_of
from armcontour.files.drawings.walk import (
    NO_SIZE,
    WALKED,
    Clip,
    EntityOutlines,
    Inherited,
    Walk,
    place_outline,
)
from armcontour.program import Program

# Versions of Inkscape with 90 px per inch; the comment of Illustrator, which has 72 px per inch,
# and the number of bytes in which it occurs; lengths in absolute units.
OLD_INKSCAPE = re.compile(r"0\.(?:[0-8]\d?|9|9[01])(?!\d)[.\d]*")
ILLUSTRATOR = re.compile(rb"Generator:\s*Adobe\s+Illustrator", re.IGNORECASE)
BEGINNING = 10_000
ABSOLUTE = re.compile(r"\d\s*(?:mm|cm|in|pt|pc|q)$", re.IGNORECASE)
# Elements that draw nothing.
SILENT = (
    "",
    "clipPath",
    "defs",
    "desc",
    "filter",
    "linearGradient",
    "marker",
    "mask",
    "metadata",
    "pattern",
    "radialGradient",
    "script",
    "solidcolor",
    "title",
    "view",
)
# Elements that draw their children or the element that they refer to.
CONTAINERS = ("g", "a", "svg", "symbol", "use", "switch")
# Elements that are no outline, skipped with a note.
NO_OUTLINE = ("text", "image", "foreignObject")
# Properties that add marks to the ends of outlines, skipped with a note.
MARKERS = ("marker", "marker-start", "marker-mid", "marker-end")
# Style sheets are not evaluated, so declarations of these properties are refused, except for the
# harmless values.
_SHEET = re.compile(r"(?<![\w-])(display|visibility|transform|clip-path|mask)\s*:\s*(\w+)")
MARKED = "Skipped: the markers of"
NOT_READ = "Skipped because it is no outline"
HARMLESS = ("none", "inline", "block", "visible", "inherit")
_STROKE = re.compile(r"(?<![\w-])stroke\s*:")
# Values of properties that change nothing.
NOTHING = ("", "none", "inherit", "initial", "unset")
_URL = re.compile(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)")
HIDDEN = "Skipped because hidden"
# Largest number of segments, a curve counted as one; no drawing of contours has more.
MAX_SEGMENTS = 500_000
# Largest number of elements drawn by reference; a file with more is malicious.
MAX_REPEATED = 100_000
# Largest depth of references in references.
DEEPEST_USE = 50


def read_svg(
    data: bytes, *, source: str, options: ReadOptions, progress: Progress | None = None
) -> Program:
    """Read the outlines of an SVG drawing.

    Shapes become contours in drawing order, placed by their groups, transforms and references;
    each subpath is a contour. Separate elements whose ends touch are chained. Strokes, fills and
    the edges of the page have no effect; hidden elements are omitted.

    Coordinates are in metres from the lower left corner of the page, x to the right and y up.
    `options.unit` is the length of the user unit. If it is None, width, height and viewBox define
    the user unit, and without them it is a pixel: 1/72 inch in files of Illustrator, 1/90 inch in
    those of Inkscape before 0.92, else 1/96 inch as in CSS.

    Lines are kept, and so are arcs that are still circular after all transforms; other curves
    become tangent arcs within `options.fit_tolerance`.
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
    # The file may be UTF-16.
    illustrator = ILLUSTRATOR.search(data[:BEGINNING].replace(b"\0", b""))
    return (INCH / 72, "Adobe Illustrator") if illustrator else (PIXEL, "")


def _page(
    root: Element, options: ReadOptions, data: bytes
) -> tuple[Affine, ViewBox | None, list[str]]:
    """The coordinates of the page."""
    if root.get("transform"):
        root.refuse("a transform of the outermost svg is not read: put a group with it inside")
    box = view_box(root)
    width, height = _page_extent(root, "width"), _page_extent(root, "height")
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
            # Absolute lengths of the page do not depend on the size of a px.
            width, height = (x and x * PIXEL / unit for x in (width, height))
    if box is not None:
        # If only one of width and height is given, the aspect ratio of the viewBox gives the other.
        if options.unit is not None or (width is None and height is None):
            width, height = box.width, box.height
        wide = width if width is not None else (height or 0.0) * box.width / box.height
        high = height if height is not None else wide * box.height / box.width
        inner = viewbox_transform(root, box, ViewBox(0.0, 0.0, wide, high))
        return _up(high, unit) @ inner, box, notes
    if height is None:
        notes.append(
            f"{root.source} gives no height of its page: y is 0 at its upper edge and negative "
            "below."
        )
        return _up(0.0, unit), None, notes
    view = ViewBox(0.0, 0.0, width, height) if width is not None else None
    return _up(height, unit), view, notes


def _page_extent(root: Element, key: str) -> float | None:
    """Width or height of the page in user units; None without it, or if it is a percentage."""
    value = None if root.get(key).endswith("%") else length_of(root, key, default=None)
    if value is not None and value <= 0:
        root.refuse(f"{key} must be above zero, but is {root.get(key)}")
    return value


def _up(height: float, unit: float) -> Affine:
    """The map from page coordinates with y down to metres with y up from the lower edge."""
    return affine(unit, 0.0, 0.0, -unit, 0.0, height * unit)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SvgInherited(Inherited):
    """The properties that an element inherits from the elements around it."""

    view: ViewBox | None  # Viewport in the element's coordinates; None if it is not known
    inkscape: bool = False  # Whether the layer is one of Inkscape
    hidden: bool = False  # Whether the element is hidden
    used_by: Element | None = None  # The use element that refers directly to this element
    font: float = FONT  # Size of the font in user units


class SvgWalk(Walk):
    """Traversal of a drawing's elements, which records the elements that it omits."""

    apart = True

    def __init__(self, root: Element, options: ReadOptions, progress: Progress | None) -> None:
        super().__init__(root.source, options, progress)
        self.root = root
        self._all = _all_elements(root)
        # The first element, if several have the same id.
        self._ids = {x.attributes["id"]: x for x in reversed(self._all) if "id" in x.attributes}
        self._repeated = self._segments = 0

    def explain_empty(self) -> str:
        """The reason for a program without contours: the file is a font."""
        if all(x.tag != "glyph" for x in self._all):
            return ""
        return "is a font, whose glyphs are no drawing: give one whose text is converted to paths"

    def shapes(self, to: Affine, view: ViewBox | None) -> Iterator[EntityOutlines]:
        """Yield the shapes in the order in which they are drawn."""
        counts = dict.fromkeys(SHAPES, 0)
        color = frozenset({color_of(self.root.style("stroke") or "none")})
        inherited = _SvgInherited(to=to, view=view, color=color, font=font_size(self.root, FONT))
        todo = [(x, inherited) for x in reversed(self.root.children)]
        visited = 0
        while todo:
            element, around = todo.pop()
            visited += 1
            self.tell(WALKED * min(visited / len(self._all), 1.0))
            self._repeated += bool(around.inside)
            if self._repeated > MAX_REPEATED:
                element.refuse(f"use repeats more than {MAX_REPEATED} elements by here")
            if element.tag in SHAPES:
                counts[element.tag] += 1
            inner = self._enter(element, around)
            if inner is None:
                continue
            if element.tag not in SHAPES:
                todo.extend(reversed(self._inside(element, inner)))
            elif inner.hidden:
                self.leave_out(HIDDEN, element.name)
            elif self.wants_color(inner.color):
                name = element.get("id") or inner.name or f"{element.tag} {counts[element.tag]}"
                yield self._drawn(element, inner, name)

    def _drawn(self, element: Element, inherited: _SvgInherited, name: str) -> EntityOutlines:
        """The outlines of a shape."""

        def spend(segments: int) -> None:
            self._segments += segments
            if self._segments > MAX_SEGMENTS:
                element.refuse(
                    f"the drawing has more than {MAX_SEGMENTS} segments by here: split it"
                )

        outlines = []
        for outline in shape_of(make_absolute(element, inherited.view, inherited.font), spend):
            placed, defect = place_outline(outline, inherited.to)
            if defect:
                element.refuse(f"it {defect}")
            outlines.append(placed)
        return EntityOutlines(
            outlines=outlines,
            where=element.name,
            name=self.labels(name),
            layer=self.labels(inherited.layer),
            clips=inherited.clips,
        )

    def _enter(self, element: Element, around: _SvgInherited) -> _SvgInherited | None:
        """The properties that the children of an element inherit; None if it draws nothing."""
        tag = element.tag
        if tag == "symbol" and around.used_by is None:
            return None
        if tag not in (*SHAPES, *CONTAINERS):
            # SVG does not draw unknown elements.
            self._check_undrawn(element, around.layer)
            return None
        if element.style("display") == "none":
            self.leave_out(HIDDEN, element.name)
            return None
        self._check_style(element)
        transform = transform_of(element)
        to = around.to if transform is IDENTITY else around.to @ transform
        if not to.finite:
            element.refuse("its transforms together have numbers that are too large")
        if is_flat(to):
            self.leave_out(NO_SIZE, element.name)
            return None
        visibility = element.style("visibility")
        hidden = around.hidden if visibility in ("", "inherit") else visibility != "visible"
        inherited = _layer(element, around)
        stroke = element.style("stroke")
        inherited = dataclasses.replace(
            inherited,
            to=to,
            hidden=hidden,
            used_by=None,
            color=inherited.color if stroke in ("", "inherit") else frozenset({color_of(stroke)}),
            font=font_size(element, inherited.font),
        )
        clip = element.style("clip-path")
        if clip not in NOTHING:
            inherited = self._clipped(element, inherited, clip)
        if tag in ("svg", "symbol"):
            return self._viewport(element, inherited, around.used_by)
        return inherited

    def _check_undrawn(self, element: Element, layer: str) -> None:
        """Record an element without an outline, and style sheets that change what is drawn."""
        if element.tag in NO_OUTLINE and element.style("display") != "none":
            if self.wants_layer(layer):
                self.leave_out(NOT_READ, element.name)
        if element.tag != "style":
            return
        sheet = "".join(element.text)
        if self.colors is not None and _STROKE.search(sheet):
            self._unknown(element, "style sheets are not followed, and it sets stroke")
        for key, value in _SHEET.findall(sheet):
            if value not in HARMLESS or (key, value) == ("display", "none"):
                self._unknown(element, f"style sheets are not followed, and it sets {key}")
                break

    def _check_style(self, element: Element) -> None:
        """Refuse or record style properties that are not evaluated."""
        if element.style("mask") not in NOTHING:
            self._unknown(element, "its mask is not followed")
        if any(element.style(key) not in NOTHING for key in MARKERS):
            self.leave_out(MARKED, element.name)
        if element.style_property("transform") or element.style("transform-origin"):
            self._unknown(element, "transforms by style, or about an origin, are not followed")

    def _clipped(self, element: Element, inherited: _SvgInherited, reference: str) -> _SvgInherited:
        """The properties of an element with the clip that its clip-path names."""
        name = _URL.fullmatch(reference)
        target = self._ids.get(name[1]) if name else None
        corners = None if target is None else self._clip_corners(target, inherited)
        if corners is None:
            self._unknown(element, "its clip-path is no single polygon of this file")
            return inherited
        return dataclasses.replace(inherited, clips=(*inherited.clips, Clip(corners)))

    def _clip_corners(self, target: Element, inherited: _SvgInherited) -> FloatArray | None:
        """Corners of the polygon of a clipPath on the page, (n, 2); None for another form."""
        drawn = [x for x in target.children if x.tag not in SILENT]
        units = target.get("clipPathUnits") or "userSpaceOnUse"
        if target.tag != "clipPath" or units != "userSpaceOnUse" or len(drawn) != 1:
            return None
        (shape,) = drawn
        if shape.tag not in SHAPES or target.get("clip-path") or shape.get("clip-path"):
            return None
        outlines = shape_of(make_absolute(shape, inherited.view, inherited.font), lambda n: None)
        chains = outlines[0].shapes if len(outlines) == 1 else []
        if len(chains) != 1 or not isinstance(chains[0], ArcChain) or chains[0].angles.any():
            return None
        corners = np.concatenate([chains[0].starts, chains[0].ends[-1:]])
        return (inherited.to @ transform_of(target) @ transform_of(shape))(corners)

    def _unknown(self, element: Element, reason: str) -> None:
        """Record an unknown element, or refuse it; `reason` is the reason."""
        if not self.skip:
            element.refuse(f"{reason}: change it in the drawing, or {SKIP}")
        self.leave_out(reason, element.name)

    def _inside(
        self, element: Element, inherited: _SvgInherited
    ) -> list[tuple[Element, _SvgInherited]]:
        """The elements that a container draws, with the properties that they inherit."""
        if element.tag == "use":
            return [self._resolve_use(element, inherited)]
        inside = element.children
        if element.tag == "switch":
            conditions = {"requiredExtensions", "systemLanguage"}
            inside = [x for x in inside if not conditions & set(x.attributes)][:1]
        return [(x, inherited) for x in inside]

    def _resolve_use(
        self, element: Element, inherited: _SvgInherited
    ) -> tuple[Element, _SvgInherited]:
        """The element that a use element refers to, with the properties that it inherits."""
        reference = element.get("href") or element.get("xlink:href")
        target = self._ids.get(reference[1:]) if reference.startswith("#") else None
        if target is None:
            element.refuse(f"it refers to {reference[:60]!r}, which is no element of this file")
        if target in inherited.inside or len(inherited.inside) >= DEEPEST_USE:
            element.refuse(f"it refers to {reference[:60]!r}, which refers back to it")
        plain = make_absolute(element, inherited.view, inherited.font)
        shift = affine(1, 0, 0, 1, number_of(plain, "x"), number_of(plain, "y"))
        inner = dataclasses.replace(
            inherited,
            to=inherited.to @ shift,
            inside=(*inherited.inside, target),
            used_by=element,
            name=element.get("id") or inherited.name,
        )
        return target, inner

    def _viewport(
        self, element: Element, inherited: _SvgInherited, user: Element | None
    ) -> _SvgInherited | None:
        """The properties that the children of a nested svg or symbol inherit; None without size."""
        outer = inherited.view
        element = make_absolute(element, outer, inherited.font)
        user = None if user is None else make_absolute(user, outer, inherited.font)
        width = _extent(element, user, "width", outer.width if outer else None)
        height = _extent(element, user, "height", outer.height if outer else None)
        x, y = number_of(element, "x"), number_of(element, "y")
        box = view_box(element)
        if width is None or height is None:
            if box is not None:
                element.refuse("it has a viewBox and needs a width and a height to fit it into")
            shift = affine(1, 0, 0, 1, x, y)
            return dataclasses.replace(inherited, to=inherited.to @ shift, view=None)
        if width <= 0 or height <= 0:
            self.leave_out(NO_SIZE, element.name)
            return None
        if box is None:
            box = ViewBox(0.0, 0.0, width, height)
        inner = inherited.to @ viewbox_transform(element, box, ViewBox(x, y, width, height))
        if not inner.finite or is_flat(inner):
            element.refuse("its viewBox does not fit its width and height")
        return dataclasses.replace(inherited, to=inner, view=box)


def _extent(element: Element, user: Element | None, key: str, whole: float | None) -> float | None:
    """Width or height of a viewport; None if it is not known."""
    # The value is taken from the use element, else from the element, else it is that of the outer
    # viewport.
    for source in (user, element):
        if source is not None and source.get(key) not in ("", "auto"):
            return length_of(source, key)
    return whole


def _layer(element: Element, around: _SvgInherited) -> _SvgInherited:
    """The inherited properties with the layer of a group."""
    # A layer is a layer of Inkscape, or else the innermost group with a name.
    if element.tag != "g":
        return around
    name = element.get("inkscape:label") or element.get("id")
    if element.get("inkscape:groupmode") == "layer":
        return dataclasses.replace(around, layer=name, inkscape=True)
    return around if around.inkscape or not name else dataclasses.replace(around, layer=name)


def _all_elements(root: Element) -> list[Element]:
    """All elements in their order."""
    elements, todo = [], [root]
    while todo:
        elements.append(todo.pop())
        todo.extend(reversed(elements[-1].children))
    return elements
