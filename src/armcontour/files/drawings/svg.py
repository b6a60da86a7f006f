"""Reader for SVG drawings, which become programs of contours in metres with y up."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armcontour.core.progress import Progress
from armcontour.files.colors import color_of
from armcontour.files.drawings.arc_chain import Affine, ArcChain
from armcontour.files.drawings.drawing_traversal import (
    DASHED,
    NO_SIZE,
    TRAVERSAL_SHARE,
    EntityOutlines,
    Inherited,
    Walk,
    place_outline,
)
from armcontour.files.drawings.outlines import Outline
from armcontour.files.drawings.read_options import SKIP_ADVICE, ReadOptions, valid_name
from armcontour.files.drawings.svg_elements import (
    IDENTITY,
    INCH,
    PIXEL,
    Element,
    ViewBox,
    affine,
    is_singular,
    make_absolute,
    parse_tree,
    read_length,
    read_length_or_zero,
    transform_of,
    view_box,
    viewbox_transform,
)
from armcontour.files.drawings.svg_shapes import SHAPES, element_outlines
from armcontour.program import Program

# Matches versions of Inkscape with 90 px per inch.
OLD_INKSCAPE = re.compile(r"0\.(?:[0-8]\d?|9|9[01])(?!\d)[.\d]*")
# Matches the comment of Illustrator, which has 72 px per inch, in the first COMMENT_RANGE bytes.
ILLUSTRATOR = re.compile(rb"Generator:\s*Adobe\s+Illustrator", re.IGNORECASE)
COMMENT_RANGE = 10_000
# Matches a length in an absolute unit.
ABSOLUTE = re.compile(r"\d\s*(?:mm|cm|in|pt|pc|q)$", re.IGNORECASE)
# Elements that draw nothing.
UNDRAWN = (
    *("", "clipPath", "defs", "desc", "filter", "linearGradient", "marker", "mask", "metadata"),
    *("pattern", "radialGradient", "script", "solidcolor", "title", "view"),
)
# Elements that draw their children, or the element to which they refer.
CONTAINERS = ("g", "a", "svg", "symbol", "use", "switch")
# Elements that have no outline and are skipped with a note.
NO_OUTLINE = ("text", "image", "foreignObject")
# Properties that add markers to the vertices of outlines; the markers are skipped with a note.
MARKERS = ("marker", "marker-start", "marker-mid", "marker-end")
# Matches declarations of style sheets that can change the contours. Style sheets are not evaluated,
# so these declarations are refused unless their value is in HARMLESS; `display: none` is refused.
_SHEET = re.compile(
    r"(?<![\w-])(display|visibility|transform|clip-path|mask|c[xy]|r[xy]?)\s*:\s*(\w+)"
)
MARKED = "Skipped the markers of"
NOT_READ = "Skipped because they have no outline"
HARMLESS = ("none", "inline", "block", "visible", "inherit")
_STROKE = re.compile(r"(?<![\w-])stroke\s*:")
# Values of properties that have no effect.
NO_EFFECT = ("", "none", "inherit", "initial", "unset")
_URL = re.compile(r"url\(\s*['\"]?#([^'\")]+)['\"]?\s*\)")
HIDDEN = "Skipped because they are hidden"
NO_TARGET = "Skipped because they refer to elements that the drawing does not have"
# Maximum number of segments (a curve is one segment), which no drawing of contours exceeds.
MAX_SEGMENTS = 500_000
# Maximum number of elements drawn by reference; a file with more is malicious.
MAX_REPEATED = 100_000
# Maximum depth of nested references.
DEEPEST_USE = 50


def read_svg(
    data: bytes, *, source: str, options: ReadOptions, progress: Progress | None = None
) -> Program:
    """Read the outlines of an SVG drawing.

    Shapes become contours in drawing order. Groups, transforms and references are applied, and
    each subpath is a contour. Separate elements whose ends touch are chained. Strokes, fills and
    the edges of the page have no effect. Hidden elements are omitted.

    Coordinates are in metres from the lower left corner of the page, x to the right and y up.
    `options.unit` is the length of the user unit. If it is None, width, height and viewBox define
    the user unit. Without these the user unit is a pixel: 1/72 inch in files of Illustrator, else
    1/90 inch in files of Inkscape before 0.92, else 1/96 inch as in CSS.

    Lines stay lines, and arcs that are circular after all transforms stay arcs. Other curves become
    tangent arcs within `options.chord_tolerance`.
    """
    root = parse_tree(data, source)
    page = _page(root, options, data)
    walk = SvgWalk(root, options, progress)
    return walk.program(walk.shapes(page.to_world, page.view), page.notes)


def _writers(root: Element, data: bytes) -> list[tuple[str, float]]:
    """Return the programs that wrote a file, in their order, and CSS; each with its px [m]."""
    writers = []
    # Zero bytes are removed because the file can be in UTF-16.
    if ILLUSTRATOR.search(data[:COMMENT_RANGE].replace(b"\0", b"")):
        writers.append(("Adobe Illustrator", INCH / 72))
    if version := root.get("inkscape:version"):
        pixel = INCH / 90 if OLD_INKSCAPE.match(version) else PIXEL
        writers.append((f"Inkscape {version.split()[0][:20]}", pixel))
    return [*writers, ("CSS", PIXEL), ("CSS", PIXEL)]


@dataclass(frozen=True, slots=True)
class _Page:
    """The page of a drawing."""

    to_world: Affine  # Map from user units to metres with y up
    view: ViewBox | None  # Viewport; None if it is unknown
    notes: list[str]


def _page(root: Element, options: ReadOptions, data: bytes) -> _Page:
    """Read size and units of the page."""
    if root.get("transform"):
        root.refuse(
            "a transform of the outermost svg element is not supported. Move the transform to a "
            "group inside"
        )
    box = view_box(root)
    width = _page_extent(root, "width")
    height = _page_extent(root, "height")
    unit = PIXEL if options.unit is None else options.unit
    notes = []
    absolute = any(ABSOLUTE.search(root.get(x)) for x in ("width", "height"))
    if options.unit is None and not (box is not None and absolute):
        unit, note = _pixel(root, data, span=width or (box.width if box else 100.0))
        notes += [note] if note else []
        if absolute:
            # Absolute lengths of the page do not depend on the size of a px.
            width, height = (x and x * PIXEL / unit for x in (width, height))
    if box is not None:
        # If only width or height is specified, the other follows from the viewBox's aspect ratio.
        if options.unit is not None or (width is None and height is None):
            width, height = box.width, box.height
        wide = width if width is not None else (height or 0.0) * box.width / box.height
        high = height if height is not None else wide * box.height / box.width
        inner = viewbox_transform(root, box, ViewBox(0.0, 0.0, wide, high))
        return _Page(_to_world(high, unit) @ inner, box, notes)
    if height is None:
        notes.append(
            f"{root.source} has no page height, so y is 0 at the upper edge of the page and "
            "negative below."
        )
        return _Page(_to_world(0.0, unit), None, notes)
    view = ViewBox(0.0, 0.0, width, height) if width is not None else None
    return _Page(_to_world(height, unit), view, notes)


def _pixel(root: Element, data: bytes, span: float) -> tuple[float, str]:
    """Return the px of the program that wrote a file [m], and a note if it differs from others.

    Args:
        root: Root of the drawing.
        data: Content of the file.
        span: Length that the note has as an example [px].
    """
    (program, unit), (other, other_unit), *_ = _writers(root, data)
    if unit == other_unit:
        return unit, ""
    return unit, (
        f"{root.source} was written by {program}, whose px is 1/{INCH / unit:.0f} inch "
        f"instead of the 1/{INCH / other_unit:.0f} inch of {other}, so {span:g} px are "
        f"{1e3 * span * unit:.5g} mm. If they are {1e3 * span * other_unit:.5g} mm, "
        f"specify units: {other_unit:.9g}."
    )


def _page_extent(root: Element, key: str) -> float | None:
    """Width or height of the page [user units]; None if it is missing or a percentage."""
    value = None if root.get(key).endswith("%") else read_length(root, key, default=None)
    if value is not None and value <= 0:
        root.refuse(f"{key} must be above zero, but is {root.get(key)}")
    return value


def _to_world(height: float, unit: float) -> Affine:
    """Return the map from the page [user units, y down] to metres with y up from the lower edge."""
    return affine(unit, 0.0, 0.0, -unit, 0.0, height * unit)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SvgInherited(Inherited):
    """The properties that an element of an SVG drawing inherits from its ancestors."""

    view: ViewBox | None  # Viewport in the coordinates of the element; None if it is unknown
    inkscape: bool = False  # Whether the layer is a layer of Inkscape, not a group
    hidden: bool = False  # Whether the element is hidden
    used_by: Element | None = None  # The use element that refers directly to this element


class SvgWalk(Walk):
    """Traversal of an SVG drawing, with notes on omitted elements."""

    separates_parts = True
    damage_in_notes = False

    def __init__(self, root: Element, options: ReadOptions, progress: Progress | None) -> None:
        super().__init__(root.source, options, progress)
        self.root = root
        self._elements = _all_elements(root)
        # If several elements have the same id, references use the first one.
        self._ids = {
            x.attributes["id"]: x for x in reversed(self._elements) if "id" in x.attributes
        }
        self._repeated = self._segments = 0
        # Whether an element with an outline is drawn, so is not only a definition.
        self.drawn = False

    def shapes(self, to: Affine, view: ViewBox | None) -> Iterator[EntityOutlines]:
        """Yield the outlines of all selected elements in drawing order."""
        counts = dict.fromkeys(SHAPES, 0)
        color = frozenset({color_of(self.root.style("stroke") or "none")})
        inherited = _SvgInherited(to=to, view=view, color=color)
        todo = [(x, inherited) for x in reversed(self.root.children)]
        visited = 0
        while todo:
            element, around = todo.pop()
            visited += 1
            self.report_fraction(TRAVERSAL_SHARE * min(visited / len(self._elements), 1.0))
            self._repeated += bool(around.targets)
            if self._repeated > MAX_REPEATED:
                element.refuse(
                    f"the drawing has more than {MAX_REPEATED} elements drawn by use up to here. "
                    "Simplify the drawing"
                )
            if element.tag in SHAPES:
                counts[element.tag] += 1
                self.drawn = True
            inner = self._inherit(element, around)
            if inner is None:
                continue
            if element.tag not in SHAPES:
                todo.extend(reversed(self._content(element, inner)))
            elif inner.hidden:
                self.omit(HIDDEN, element.name)
            elif self.wants_color(inner.color):
                name = element.get("id") or inner.name or f"{element.tag} {counts[element.tag]}"
                yield self._outlines(element, inner, name)

    def explain_empty(self) -> str:
        """Explain why nothing is drawn, for the error, if the file has only definitions."""
        if self.omitted or self.of_other_colors or self.on_other_layers:
            return ""
        if any(x.tag == "font" for x in self._elements):
            return (
                "has no contour to follow, because it defines a font, whose glyphs are not drawn. "
                "Write the text in a drawing program, and convert it to paths"
            )
        shapes = sum(x.tag in SHAPES for x in self._elements)
        if shapes and not self.drawn:
            return (
                f"has no contour to follow, because its {shapes} outlines are only definitions "
                "(defs, symbol, pattern, marker), which no use element draws"
            )
        return ""

    def _outlines(self, element: Element, inherited: _SvgInherited, name: str) -> EntityOutlines:
        """Return the outlines of a shape on the page [m]."""

        def count_segments(segments: int) -> None:
            """Add the segments of a part of the shape; refuse a drawing with too many."""
            self._segments += segments
            if self._segments > MAX_SEGMENTS:
                element.refuse(
                    f"the drawing has more than {MAX_SEGMENTS} segments up to here. Split the "
                    "drawing"
                )

        outlines = []
        for outline in element_outlines(make_absolute(element, inherited.view), count_segments):
            placed, defect = place_outline(outline, inherited.to)
            if defect:
                element.refuse(f"the element {defect}")
            outlines.append(placed)
        return EntityOutlines(
            outlines=outlines,
            where=element.name,
            name=valid_name(name),
            layer=valid_name(inherited.layer),
            clips=inherited.clips,
        )

    def _inherit(self, element: Element, around: _SvgInherited) -> _SvgInherited | None:
        """Return the properties of an element and its children; None if it draws nothing."""
        tag = element.tag
        if tag == "symbol" and around.used_by is None:
            return None
        if tag not in (*SHAPES, *CONTAINERS):
            # By the SVG standard, unknown elements are not drawn.
            self._check_undrawn(element, around.layer)
            return None
        if element.style("display") == "none":
            self.omit(HIDDEN, element.name)
            return None
        self._check_style(element)
        transform = transform_of(element)
        to = around.to if transform is IDENTITY else around.to @ transform
        if not to.finite:
            element.refuse("the product of its transforms is too large for doubles")
        if is_singular(to):
            self.omit(NO_SIZE, element.name)
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
        )
        clip = element.style("clip-path")
        if clip not in NO_EFFECT:
            inherited = self._clipped(element, inherited, clip)
        if tag in ("svg", "symbol"):
            return self._enter_viewport(element, inherited, around.used_by)
        return inherited

    def _check_undrawn(self, element: Element, layer: str) -> None:
        """Record an element without an outline; refuse a style sheet that can change contours."""
        if element.tag in NO_OUTLINE and element.style("display") != "none":
            if self.wants_layer(layer):
                self.omit(NOT_READ, element.name)
        if element.tag != "style":
            return
        sheet = "".join(element.text)
        if self.colors is not None and _STROKE.search(sheet):
            self._refuse_or_ignore(element, "style sheets that set stroke are not supported")
        for key, value in _SHEET.findall(sheet):
            if value not in HARMLESS or (key, value) == ("display", "none"):
                self._refuse_or_ignore(element, f"style sheets that set {key} are not supported")
                break

    def _check_style(self, element: Element) -> None:
        """Refuse or record style properties that are not supported."""
        mask = element.style("mask")
        if self._is_dead(mask):
            self.omit(NO_TARGET, f"mask of {element.name}")
        elif mask not in NO_EFFECT:
            self._refuse_or_ignore(element, "masks are not supported")
        if any(element.style(key) not in NO_EFFECT for key in MARKERS):
            self.omit(MARKED, element.name)
        dashes = element.style("stroke-dasharray")
        if dashes not in NO_EFFECT and dashes.strip("0, ") != "":
            self.omit(DASHED, element.name)
        if element.style_property("transform") or element.style("transform-origin"):
            self._refuse_or_ignore(
                element, "transforms in a style or with an origin are not supported"
            )

    def _clipped(self, element: Element, inherited: _SvgInherited, reference: str) -> _SvgInherited:
        """Return the properties of an element with the clip to which its clip-path refers."""
        if self._is_dead(reference):
            # By the standard, a reference to a missing element clips nothing.
            self.omit(NO_TARGET, f"clip path of {element.name}")
            return inherited
        name = _URL.fullmatch(reference)
        target = self._ids.get(name[1]) if name else None
        outline = None if target is None else self._clip_outline(target, inherited)
        if outline is None:
            self._refuse_or_ignore(element, "clip paths other than one outline are not supported")
            return inherited
        return dataclasses.replace(inherited, clips=(*inherited.clips, outline))

    def _is_dead(self, reference: str) -> bool:
        """Return whether a property refers to an element that the file does not have."""
        name = _URL.fullmatch(reference)
        return name is not None and name[1] not in self._ids

    def _clip_outline(self, target: Element, inherited: _SvgInherited) -> Outline | None:
        """Return the only outline of a clipPath on the page [m]; None if it has several or none."""
        drawn = [x for x in target.children if x.tag not in UNDRAWN]
        units = target.get("clipPathUnits") or "userSpaceOnUse"
        if target.tag != "clipPath" or units != "userSpaceOnUse" or len(drawn) != 1:
            return None
        (shape,) = drawn
        if shape.tag not in SHAPES or target.get("clip-path") or shape.get("clip-path"):
            return None
        outlines = element_outlines(make_absolute(shape, inherited.view), lambda n: None)
        if len(outlines) != 1:
            return None
        to = inherited.to @ transform_of(target) @ transform_of(shape)
        return place_outline(Outline(outlines[0].shapes, closed=True), to)[0]

    def _refuse_or_ignore(self, element: Element, reason: str) -> None:
        """Refuse an unsupported property, or record that it is ignored if the options say so."""
        if not self.skip:
            element.refuse(f"{reason}. Change the element in the drawing, or {SKIP_ADVICE}")
        self.omit(f"{reason[0].upper()}{reason[1:]} and are ignored", element.name)

    def _content(
        self, element: Element, inherited: _SvgInherited
    ) -> list[tuple[Element, _SvgInherited]]:
        """Return the elements that a container draws, each with its inherited properties."""
        if element.tag == "use":
            used = self._resolve_use(element, inherited)
            return [] if used is None else [used]
        inside = element.children
        if element.tag == "switch":
            conditions = {"requiredExtensions", "systemLanguage"}
            inside = [x for x in inside if not conditions & set(x.attributes)][:1]
        return [(x, inherited) for x in inside]

    def _resolve_use(
        self, element: Element, inherited: _SvgInherited
    ) -> tuple[Element, _SvgInherited] | None:
        """Return the element to which a use element refers, with its inherited properties.

        None if the file has no such element, so that the use element draws nothing.
        """
        reference = element.get("href") or element.get("xlink:href")
        if reference and not reference.startswith("#"):
            element.refuse(
                f"the element refers to {reference[:60]!r}, which is not an element of this file. "
                "Copy this element into the file"
            )
        target = self._ids.get(reference[1:])
        if target is None:
            self.omit(NO_TARGET, element.name)
            return None
        if target in inherited.targets:
            element.refuse(
                f"the element refers to {reference[:60]!r}, which refers back to this element"
            )
        if len(inherited.targets) >= DEEPEST_USE:
            element.refuse(f"references are nested more than {DEEPEST_USE} levels deep")
        plain = make_absolute(element, inherited.view)
        shift = affine(1, 0, 0, 1, read_length_or_zero(plain, "x"), read_length_or_zero(plain, "y"))
        inner = dataclasses.replace(
            inherited,
            to=inherited.to @ shift,
            targets=(*inherited.targets, target),
            used_by=element,
            name=element.get("id") or inherited.name,
        )
        return target, inner

    def _enter_viewport(
        self, element: Element, inherited: _SvgInherited, user: Element | None
    ) -> _SvgInherited | None:
        """Return what children of a nested svg or symbol inherit; None without a size."""
        outer = inherited.view
        element = make_absolute(element, outer)
        user = None if user is None else make_absolute(user, outer)
        width = _extent(element, user, "width", outer.width if outer else None)
        height = _extent(element, user, "height", outer.height if outer else None)
        x = read_length_or_zero(element, "x")
        y = read_length_or_zero(element, "y")
        box = view_box(element)
        if width is None or height is None:
            if box is not None:
                element.refuse("an element with a viewBox must have a width and a height")
            shift = affine(1, 0, 0, 1, x, y)
            return dataclasses.replace(inherited, to=inherited.to @ shift, view=None)
        if width <= 0 or height <= 0:
            self.omit(NO_SIZE, element.name)
            return None
        if box is None:
            box = ViewBox(0.0, 0.0, width, height)
        inner = inherited.to @ viewbox_transform(element, box, ViewBox(x, y, width, height))
        if not inner.finite or is_singular(inner):
            element.refuse("the ratio of its viewBox to its width and height is out of range")
        clips = inherited.clips
        if element.style("overflow") not in ("visible", "auto"):
            corners = np.array([[x, y], [x + width, y], [x + width, y + height], [x, y + height]])
            border = Outline([ArcChain.straight(corners)], closed=True)
            clips = (*clips, place_outline(border, inherited.to)[0])
        return dataclasses.replace(inherited, to=inner, view=box, clips=clips)


def _extent(element: Element, user: Element | None, key: str, whole: float | None) -> float | None:
    """Return the width or height of a viewport [user units]; None if it is unknown."""
    # The use element has priority over the element; the default is the extent of the outer
    # viewport.
    for source in (user, element):
        if source is not None and source.get(key) not in ("", "auto"):
            return read_length(source, key)
    return whole


def _layer(element: Element, around: _SvgInherited) -> _SvgInherited:
    """Return the inherited properties; a group that is a layer sets the layer."""
    # The layer is the innermost layer of Inkscape; without one, the innermost group with a name.
    if element.tag != "g":
        return around
    name = element.get("inkscape:label") or element.get("id")
    if element.get("inkscape:groupmode") == "layer":
        return dataclasses.replace(around, layer=name, inkscape=True)
    return around if around.inkscape or not name else dataclasses.replace(around, layer=name)


def _all_elements(root: Element) -> list[Element]:
    """Return all elements of a tree in the order of the file."""
    elements = []
    todo = [root]
    while todo:
        elements.append(todo.pop())
        todo.extend(reversed(elements[-1].children))
    return elements
