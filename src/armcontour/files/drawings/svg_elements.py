"""Parser for SVG files: the tree of elements, and their styles, lengths and transforms."""

from __future__ import annotations

import dataclasses
import itertools
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from armcontour.core.checks import frozen_array
from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.arc_chain import Affine

if TYPE_CHECKING:
    from xml.parsers.expat import XMLParserType

SVG = "http://www.w3.org/2000/svg"
# Namespaces of the attributes that are read, and the prefixes for their names.
PREFIXES = {
    "http://www.w3.org/1999/xlink": "xlink:",
    "http://www.inkscape.org/namespaces/inkscape": "inkscape:",
    SVG: "",
}
# Maximum number of elements, which no drawing of contours exceeds.
MAX_ELEMENTS = 500_000
# Maximum number of characters that XML entities may add; entities for namespaces need thousands.
MAX_EXPANDED = 1_000_000
# Length of an inch [m].
INCH = 0.0254
# Length of a CSS pixel [m]. Without a viewBox, the user unit of SVG is a CSS pixel.
PIXEL = INCH / 96
# CSS pixels per unit.
PIXELS = {
    "": 1.0,
    "px": 1.0,
    "in": 96.0,
    "cm": 96 / 2.54,
    "mm": 96 / 25.4,
    "q": 96 / 101.6,
    "pt": 96 / 72,
    "pc": 16.0,
}
# Attributes whose percentages refer to the width, or to the height, of the viewport. Percentages of
# other attributes refer to its diagonal divided by the square root of 2.
WIDTH_KEYS = frozenset({"x", "x1", "x2", "cx", "rx", "width"})
HEIGHT_KEYS = frozenset({"y", "y1", "y2", "cy", "ry", "height"})
LENGTHS = WIDTH_KEYS | HEIGHT_KEYS | {"r"}
SQRT2 = math.sqrt(2)
NUMBER = r"[-+]?(?:[0-9]++\.?+[0-9]*+|\.[0-9]++)(?:[eE][-+]?[0-9]++)?"
NUMBERS = re.compile(rf"(?:[\s,]*+{NUMBER})*[\s,]*+")
EACH_NUMBER = re.compile(NUMBER)
_LENGTH = re.compile(rf"({NUMBER})\s*([A-Za-z]*|%)")
_TRANSFORM = re.compile(r"[\s,]*+([A-Za-z]++)\s*+\(([^()]*+)\)")
# Maximum number of transforms in one list, which no drawing exceeds.
MAX_TRANSFORMS = 1000
_ALIGN = re.compile(r"(?:defer\s+)?(?:(none)|x(Min|Mid|Max)Y(Min|Mid|Max))(?:\s+(meet|slice))?")
# Maximum number of values in one list, which no drawing of contours exceeds.
MAX_NUMBERS = 4_000_000
# A transform, scaled to the largest coefficient 1, with at most this determinant is singular.
SINGULAR = 1e-12
# Valid numbers of arguments, by transform.
ARGUMENT_COUNTS = {
    "matrix": (6,),
    "translate": (1, 2),
    "scale": (1, 2),
    "rotate": (1, 3),
    "skewX": (1,),
    "skewY": (1,),
}
# Fraction of the viewport's unused space that is before the viewBox, by alignment.
ALIGNMENT_SHARES = {"Min": 0.0, "Mid": 0.5, "Max": 1.0}
IDENTITY = Affine(frozen_array(np.eye(2)), frozen_array(np.zeros(2)))


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """An element of an SVG file."""

    tag: str  # Name of the element without a namespace; "" if the namespace is not SVG
    # Attributes by name; names in the namespaces of `PREFIXES` have the prefix.
    attributes: Mapping[str, str]
    source: str  # Name of the file
    line: int  # Line of the file in which the element starts
    children: list[Element] = field(default_factory=list)
    # Parts of the element's text; empty for elements other than style.
    text: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Name of the element in messages, such as `path 'leaf' in line 7`."""
        identifier = self.attributes.get("id")
        return f"{self.tag[:40]}{f' {identifier[:60]!r}' if identifier else ''} in line {self.line}"

    def get(self, key: str) -> str:
        """Return an attribute without surrounding white space; "" if it is missing."""
        return self.attributes.get(key, "").strip()

    def style(self, key: str) -> str:
        """Return a property from the attribute style, else the attribute with its name.

        The result is "" if both are missing.
        """
        return self.style_property(key) or self.get(key)

    def style_property(self, key: str) -> str:
        """Return a property from the attribute style; "" if it is missing."""
        style = self.attributes.get("style", "")
        if key in style:
            for declaration in reversed(style.split(";")):
                name, _, value = declaration.partition(":")
                if name.strip() == key:
                    return value.replace("!important", "").strip()
        return ""

    def refuse(self, defect: str) -> NoReturn:
        """Raise an error with the name of the element and a description of its defect."""
        raise InvalidInput(f"{self.source}: {self.name}: {defect}.")


def parse_tree(data: bytes, source: str) -> Element:
    """Parse an SVG file into the tree of its elements; returns the outermost element."""
    # XML entities must be defined in the file as plain text, and add at most `MAX_EXPANDED`
    # characters, because a short file can expand to any size. External files are never loaded.
    from xml.parsers import expat

    if data[:2] == b"\x1f\x8b":
        raise InvalidInput(f"{source} is compressed (svgz). Decompress the file first.")
    parser = expat.ParserCreate(namespace_separator="\n")
    parser.buffer_text = True
    builder = _Builder(source, data, parser)
    try:
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        if _is_in_comment(data, parser.ErrorByteIndex):
            reason = "a comment has two hyphens, --, which XML reserves for its end; write one"
        raise InvalidInput(
            f"{source}, line {error.lineno}: the file is not well-formed XML ({reason})."
        ) from None
    except (LookupError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{source} cannot be parsed as XML ({str(error)[:200]}).") from None
    return _svg_element(builder.root, source)


def _is_in_comment(data: bytes, place: int) -> bool:
    """Return whether the byte of an error is in a comment that has two hyphens before its end."""
    start = data.rfind(b"<!--", 0, place)
    if start < 0:
        return False
    hyphens = data.find(b"--", start + len(b"<!--"))
    return hyphens >= 0 and data[hyphens : hyphens + 3] != b"-->" and place <= hyphens + 3


def _svg_element(root: Element | None, source: str) -> Element:
    """Check that the outermost element of a file is svg, and return it."""
    if root is None or root.tag != "svg":
        name = (root.tag[:40] or "an element of another namespace") if root else "missing"
        raise InvalidInput(
            f"{source} is not an SVG file. Its outermost element must be svg, but is {name}."
        )
    return root


class _Builder:
    """Builds the tree of elements from events of the XML parser."""

    def __init__(self, source: str, data: bytes, parser: XMLParserType) -> None:
        self.source = source
        self._data = data
        self._parser = parser
        self._expanded = self._count = 0
        self.root: Element | None = None
        self._open: list[Element] = []
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._text
        parser.EntityDeclHandler = self._check_entity

    def _check_entity(self, name: str, parameter: int, value: str | None, *_: object) -> None:
        """Refuse an XML entity that is not plain text in the file or that expands too much."""
        line = self._parser.CurrentLineNumber
        location = f"{self.source}, line {line}: the entity {name[:60]!r}"
        if parameter or value is None or "&" in value or "%" in value or "<" in value:
            raise InvalidInput(
                f"{location} must be plain text within the file, but is not. Save the drawing as "
                "plain SVG."
            )
        # The references are counted in the bytes of the file, before the parser expands them.
        # Therefore the encoding of the file must contain ASCII.
        self._expanded += len(value) * self._data.count(f"&{name};".encode())
        if self._expanded > MAX_EXPANDED or b"<!ENTITY" not in self._data:
            raise InvalidInput(
                f"{location} expands the file by more than {MAX_EXPANDED} characters or by an "
                "unknown number. Save the drawing as plain SVG."
            )

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        """Add an element to the innermost open element."""
        self._count += 1
        if self._count > MAX_ELEMENTS:
            raise InvalidInput(
                f"{self.source} has more than {MAX_ELEMENTS} elements. Split the drawing."
            )
        space, _, local = name.rpartition("\n")
        read = {}
        for key, value in attributes.items():
            owner, _, bare = key.rpartition("\n")
            if not owner or owner in PREFIXES:
                read[PREFIXES.get(owner, "") + bare] = value
        tag = local if space in ("", SVG) else ""
        element = Element(tag, read, self.source, self._parser.CurrentLineNumber)
        if tag in ("rect", "circle", "ellipse"):
            # In SVG 2, lengths of shapes can also be properties of the attribute style.
            read.update({x: value for x in LENGTHS if (value := element.style_property(x))})
        if self._open:
            self._open[-1].children.append(element)
        else:
            self.root = element
        self._open.append(element)

    def _end(self, _: str) -> None:
        self._open.pop()

    def _text(self, data: str) -> None:
        if self._open[-1].tag == "style":
            self._open[-1].text.append(data)


def affine(a: float, b: float, c: float, d: float, e: float, f: float) -> Affine:
    """Return the affine map of SVG's `matrix(a b c d e f)`."""
    return Affine(np.array([[a, c], [b, d]]), np.array([e, f]))


def is_singular(transform: Affine) -> bool:
    """Return whether a transform is singular, so that it maps every area to zero."""
    size = float(np.abs(transform.linear).max())
    if size == 0:
        return True
    unit = transform.linear / size
    return bool(abs(unit[0, 0] * unit[1, 1] - unit[0, 1] * unit[1, 0]) <= SINGULAR)


def parse_numbers(element: Element, key: str, text: str) -> list[float]:
    """Parse numbers separated by white space or commas; `key` is for messages."""
    if not NUMBERS.fullmatch(text):
        valid_start = NUMBERS.match(text)
        position = valid_start.end() if valid_start else 0
        element.refuse(
            f"{key} must be a list of numbers, but has {text[position : position + 20]!r}"
        )
    return check_numbers(
        element, key, [float(x[0]) for x in limit_matches(EACH_NUMBER.finditer(text))]
    )


def limit_matches(matches: Iterable[re.Match[str]]) -> Iterable[re.Match[str]]:
    """Return at most MAX_NUMBERS + 1 matches.

    One more than allowed is enough for `check_numbers` to see that there are too many.
    """
    return itertools.islice(matches, MAX_NUMBERS + 1)


def check_numbers(element: Element, key: str, values: list[float]) -> list[float]:
    """Return a list of numbers; refuse too many or infinite numbers. `key` is for messages."""
    if len(values) > MAX_NUMBERS:
        element.refuse(f"{key} has more than {MAX_NUMBERS} numbers. Split the element")
    if not all(map(math.isfinite, values)):
        element.refuse(f"{key} has a number that is too large for a double")
    return values


def read_length(element: Element, key: str, *, default: float | None = 0.0) -> float | None:
    """Return the length in an attribute [user units].

    It is `default` if the attribute is missing or auto.
    """
    text = element.get(key)
    if text in ("", "auto"):
        return default
    match = _LENGTH.fullmatch(text)
    factor = PIXELS.get(match[2].lower()) if match else None
    if match is None or factor is None:
        reason = (
            ", because the reference of the percentage is unknown"
            if match and match[2] == "%"
            else ""
        )
        element.refuse(
            f"{key}={text[:40]!r} is not a supported length{reason}. Write a number, or a number "
            "with the unit px, mm, cm, in, pt or pc"
        )
    value = float(match[1]) * factor
    if not math.isfinite(value):
        element.refuse(f"{key}={text[:40]!r} is too large for a double")
    return value


def read_length_or_zero(element: Element, key: str) -> float:
    """Return the length in an attribute [user units]; 0 if the attribute is missing or auto."""
    return read_length(element, key) or 0.0


def _whole_length(key: str, view: ViewBox) -> float:
    """Return the length of 100 % of an attribute [user units]."""
    if key in WIDTH_KEYS:
        return view.width
    if key in HEIGHT_KEYS:
        return view.height
    return math.hypot(view.width, view.height) / SQRT2


def make_absolute(element: Element, view: ViewBox | None) -> Element:
    """Return the element with lengths in % converted to user units if `view` is known."""
    changed = {}
    if view is None:
        return element
    for key in LENGTHS & element.attributes.keys():
        match = _LENGTH.fullmatch(element.get(key))
        if match is not None and match[2] == "%":
            changed[key] = repr(float(match[1]) * _whole_length(key, view) / 100)
    if not changed:
        return element
    return dataclasses.replace(element, attributes={**element.attributes, **changed})


def transform_of(element: Element) -> Affine:
    """Return the affine map in an element's attribute `transform`."""
    text = element.get("transform")
    if text in ("", "none"):
        return IDENTITY
    whole = IDENTITY
    position = 0
    count = 0
    while position < len(text):
        match = _TRANSFORM.match(text, position)
        if match is None or match[1] not in ARGUMENT_COUNTS or count >= MAX_TRANSFORMS:
            if not text[position:].strip(" \t\r\n,"):
                break
            element.refuse(
                f"transform must be a list of at most {MAX_TRANSFORMS} transforms "
                f"{', '.join(ARGUMENT_COUNTS)}, but has {text[position : position + 30].strip()!r}"
            )
        values = parse_numbers(element, f"transform {match[1]}", match[2])
        if len(values) not in ARGUMENT_COUNTS[match[1]]:
            counts = " or ".join(map(str, ARGUMENT_COUNTS[match[1]]))
            element.refuse(f"{match[1]} must have {counts} numbers, but has {len(values)}")
        whole = whole @ _single_transform(match[1], values)
        position = match.end()
        count = count + 1
    if not whole.finite:
        element.refuse("transform has numbers whose product is too large for a double")
    return whole


def _single_transform(kind: str, values: list[float]) -> Affine:
    """Return the affine map of one transform, such as "rotate", with the given arguments."""
    first = values[0]
    if kind == "matrix":
        return affine(*values)
    if kind == "translate":
        return affine(1, 0, 0, 1, first, values[1] if len(values) > 1 else 0)
    if kind == "scale":
        return affine(first, 0, 0, values[1] if len(values) > 1 else first, 0, 0)
    if kind == "skewX":
        return affine(1, 0, math.tan(math.radians(first)), 1, 0, 0)
    if kind == "skewY":
        return affine(1, math.tan(math.radians(first)), 0, 1, 0, 0)
    c, s = _cos_sin(first)
    turned = affine(c, s, -s, c, 0, 0)
    if len(values) == 1:
        return turned
    forward = affine(1, 0, 0, 1, *values[1:])
    back = affine(1, 0, 0, 1, -values[1], -values[2])
    return forward @ turned @ back


def _cos_sin(degrees: float) -> tuple[float, float]:
    """Return the cosine and sine of an angle, exact for multiples of a right angle."""
    quarters, remainder = divmod(degrees, 90.0)
    c = math.cos(math.radians(remainder))
    s = math.sin(math.radians(remainder))
    for _ in range(int(quarters % 4)):
        c, s = -s, c
    return c, s


@dataclass(frozen=True, slots=True)
class ViewBox:
    """A rectangle parallel to the axes [user units]: a viewBox or a viewport."""

    x: float
    y: float
    width: float
    height: float


def view_box(element: Element) -> ViewBox | None:
    """Return the viewBox of an element; None if the element has no viewBox."""
    text = element.get("viewBox")
    if not text or text == "none":
        return None
    values = parse_numbers(element, "viewBox", text)
    if len(values) != 4 or values[2] <= 0 or values[3] <= 0:
        element.refuse(
            f"viewBox must be x, y, width and height, with width and height above zero, but is "
            f"{text[:60]!r}"
        )
    return ViewBox(*values)


def viewbox_transform(element: Element, inner: ViewBox, outer: ViewBox) -> Affine:
    """Return the map from the viewBox `inner` of an element to its viewport `outer`."""
    text = element.get("preserveAspectRatio") or "xMidYMid"
    match = _ALIGN.fullmatch(text)
    if match is None:
        element.refuse(
            "preserveAspectRatio must be none, or an alignment such as xMidYMid with meet or "
            f"slice, but is {text[:40]!r}"
        )
    x = outer.width / inner.width
    y = outer.height / inner.height
    shares = ALIGNMENT_SHARES[match[2] or "Min"], ALIGNMENT_SHARES[match[3] or "Min"]
    if match[1] is None:
        x = y = max(x, y) if match[4] == "slice" else min(x, y)
    x_offset = outer.x + shares[0] * (outer.width - x * inner.width) - x * inner.x
    y_offset = outer.y + shares[1] * (outer.height - y * inner.height) - y * inner.y
    return affine(x, 0, 0, y, x_offset, y_offset)
