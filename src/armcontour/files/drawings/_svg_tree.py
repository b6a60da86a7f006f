"""The tree of elements of an SVG file, read without external files or huge trees."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn

from armcontour.core.errors import InvalidInput

SVG = "http://www.w3.org/2000/svg"
# Namespaces of attributes that are read, with their usual prefixes.
PREFIXES = {
    "http://www.w3.org/1999/xlink": "xlink:",
    "http://www.inkscape.org/namespaces/inkscape": "inkscape:",
    SVG: "",
}
# Largest number of elements; no drawing of contours has more.
MOST_ELEMENTS = 500_000
# Largest number of characters that entities may add to a file; namespaces need some thousand.
MOST_EXPANDED = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """An element of an SVG file.

    Args:
        tag: Name of the element without a namespace; "" if it belongs to another namespace.
        attributes: Attributes by name, those of the namespaces in `PREFIXES` with their prefix.
        source: Name of the file.
        line: Line of the file in which the element starts.
        children: Elements in this element.
        text: Parts of the element's text; kept for style sheets only.
    """

    tag: str
    attributes: Mapping[str, str]
    source: str
    line: int
    children: list[Element] = field(default_factory=list)
    text: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Name of the element in messages, such as `path 'leaf' in line 7`."""
        given = self.attributes.get("id")
        return f"{self.tag[:40]}{f' {given[:60]!r}' if given else ''} in line {self.line}"

    def get(self, key: str) -> str:
        """An attribute without the blanks around it; "" if it is missing."""
        return self.attributes.get(key, "").strip()

    def style(self, key: str) -> str:
        """A property from the attribute style, or else the attribute of that name; "" if none."""
        return self.style_property(key) or self.get(key)

    def style_property(self, key: str) -> str:
        """A property from the attribute style; "" if it is missing."""
        style = self.attributes.get("style", "")
        if key in style:
            for declaration in reversed(style.split(";")):
                name, _, value = declaration.partition(":")
                if name.strip() == key:
                    return value.replace("!important", "").strip()
        return ""

    def refuse(self, what: str) -> NoReturn:
        """Refuse the element; `what` says what is wrong.

        Raises:
            InvalidInput: Always.
        """
        raise InvalidInput(f"{self.source}: {self.name}: {what}.")


def tree_of(data: bytes, source: str) -> Element:
    """The outermost element of an SVG file, with all elements in it.

    Entities must be plain text in the file, and together add at most `MOST_EXPANDED` characters, as
    a short file could expand to any size. Other files are never loaded.

    Args:
        data: Content of the file.
        source: Name of the file.

    Raises:
        InvalidInput: The file is not XML, defines other entities or has too many elements, or its
            outermost element is not svg.
    """
    from xml.parsers import expat

    if data[:2] == b"\x1f\x8b":
        raise InvalidInput(f"{source} is compressed (svgz): unpack it first.")
    builder = _Builder(source, data)
    try:
        parser = expat.ParserCreate(namespace_separator="\n")
        parser.buffer_text = True
        builder.listen(parser)
        parser.Parse(data, True)
    except expat.ExpatError as error:
        reason = expat.ErrorString(error.code)
        raise InvalidInput(
            f"{source}, line {error.lineno}: this is not well-formed XML: {reason}."
        ) from None
    except (LookupError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{source} cannot be read as XML: {str(error)[:200]}.") from None
    return _svg_element(builder.root, source)


def _svg_element(root: Element | None, source: str) -> Element:
    """The outermost element of a file, if it is svg.

    Raises:
        InvalidInput: The file is empty or begins with another element.
    """
    if root is None or root.tag != "svg":
        found = (
            f"begins with {root.tag[:40] or 'an element of another language'}"
            if root
            else "is empty"
        )
        raise InvalidInput(f"{source} is no SVG file: it {found}, not with svg.")
    return root


class _Builder:
    """Builds the tree of elements from the events of the XML parser."""

    def __init__(self, source: str, data: bytes) -> None:
        self.source = source
        self._data = data
        self._expanded = 0
        self.root: Element | None = None
        self._open: list[Element] = []
        self._count = 0
        self._line = 0

    def listen(self, parser: object) -> None:
        """Register this builder's methods as handlers of the parser."""

        def start(name: str, attributes: dict[str, str]) -> None:
            self._start(name, attributes, parser.CurrentLineNumber)  # type: ignore[attr-defined]

        def entity(name: str, parameter: int, value: str | None, *_: object) -> None:
            line = parser.CurrentLineNumber  # type: ignore[attr-defined]
            self._check_entity(name, None if parameter else value, line)

        parser.StartElementHandler = start  # type: ignore[attr-defined]
        parser.EndElementHandler = self._end  # type: ignore[attr-defined]
        parser.CharacterDataHandler = self._text  # type: ignore[attr-defined]
        parser.EntityDeclHandler = entity  # type: ignore[attr-defined]

    def _check_entity(self, name: str, value: str | None, line: int) -> None:
        """Refuse an entity that is not plain text in the file, or expands to too much.

        Raises:
            InvalidInput: The entity is of another kind, or too long altogether.
        """
        where = f"{self.source}, line {line}: the entity {name[:60]!r}"
        if value is None or "&" in value or "%" in value or "<" in value:
            raise InvalidInput(
                f"{where} is not plain text in the file, which is not read: save it as plain SVG."
            )
        # Counted before the parser puts it in, where the file's letters are those of ASCII.
        self._expanded += len(value) * self._data.count(f"&{name};".encode())
        if self._expanded > MOST_EXPANDED or b"<!ENTITY" not in self._data:
            raise InvalidInput(
                f"{where} would make the file longer by more than {MOST_EXPANDED} characters, or "
                "nobody can tell: save it as plain SVG."
            )

    def _start(self, name: str, attributes: dict[str, str], line: int) -> None:
        """Add an element to the innermost open element.

        Raises:
            InvalidInput: The file has too many elements.
        """
        self._count += 1
        if self._count > MOST_ELEMENTS:
            raise InvalidInput(f"{self.source} has more than {MOST_ELEMENTS} elements: split it.")
        space, _, local = name.rpartition("\n")
        read = {}
        for key, value in attributes.items():
            owner, _, bare = key.rpartition("\n")
            if not owner or owner in PREFIXES:
                read[PREFIXES.get(owner, "") + bare] = value
        tag = local if space in ("", SVG) else ""
        element = Element(tag, read, self.source, line)
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
