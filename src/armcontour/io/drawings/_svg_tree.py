"""The elements of an SVG file, read so that no file can ask for more than it holds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn

from armcontour.errors import InvalidInput

SVG = "http://www.w3.org/2000/svg"
# Namespaces of attributes that are read, by their usual prefix.
PREFIXES = {
    "http://www.w3.org/1999/xlink": "xlink:",
    "http://www.inkscape.org/namespaces/inkscape": "inkscape:",
    SVG: "",
}
# More elements than this are no drawing that anyone wants followed.
MOST_ELEMENTS = 500_000


@dataclass(frozen=True, slots=True, eq=False)
class Element:
    """An element with what is in it.

    Args:
        tag: Its name, without a namespace; "" if it belongs to another language than SVG.
        attributes: By name; of another namespace with the usual prefix, where it is read.
        source: Name of the file.
        line: Line of the file that it begins on.
        children: The elements in it.
        text: Pieces of the text in it.
    """

    tag: str
    attributes: Mapping[str, str]
    source: str
    line: int
    children: list[Element] = field(default_factory=list)
    text: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """What it is called in messages, such as `path 'leaf' in line 7`."""
        given = self.attributes.get("id")
        return f"{self.tag[:40]}{f' {given[:60]!r}' if given else ''} in line {self.line}"

    def get(self, key: str) -> str:
        """An attribute without the blanks around it; "" if it is not there."""
        return self.attributes.get(key, "").strip()

    def style(self, key: str) -> str:
        """A property of its style, which goes before the attribute of that name; "" if none."""
        return self.style_property(key) or self.get(key)

    def style_property(self, key: str) -> str:
        """A property of its attribute style; "" if none."""
        said = self.attributes.get("style", "")
        if key in said:
            for one in reversed(said.split(";")):
                name, _, value = one.partition(":")
                if name.strip() == key:
                    return value.replace("!important", "").strip()
        return ""

    def refuse(self, what: str) -> NoReturn:
        """Raise what is wrong with it.

        Raises:
            InvalidInput: Always.
        """
        raise InvalidInput(f"{self.source}: {self.name}: {what}.")


def tree_of(data: bytes, source: str) -> Element:
    """The outermost element of an SVG file.

    Entities of a file's own are refused: with a few of them a short file says as much as it likes.
    Nothing outside the file is ever fetched.

    Raises:
        InvalidInput: No XML, entities, too many elements, or an outermost element that is not svg.
    """
    from xml.parsers import expat

    if data[:2] == b"\x1f\x8b":
        raise InvalidInput(f"{source} is compressed (svgz): unpack it first.")
    builder = _Builder(source)
    try:
        parser = expat.ParserCreate(namespace_separator="\n")
        parser.buffer_text = True
        builder.listen(parser)
        parser.Parse(data, True)
    except expat.ExpatError as error:
        said = expat.ErrorString(error.code)
        raise InvalidInput(
            f"{source}, line {error.lineno}: this is not well-formed XML: {said}."
        ) from None
    except (LookupError, ValueError) as error:
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"{source} cannot be read as XML: {str(error)[:200]}.") from None
    root = builder.root
    if root is None or root.tag != "svg":
        found = (
            f"begins with {root.tag[:40] or 'an element of another language'}"
            if root
            else "is empty"
        )
        raise InvalidInput(f"{source} is no SVG file: it {found}, not with svg.")
    return root


class _Builder:
    """Builds the tree as the parser goes through the file."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.root: Element | None = None
        self._open: list[Element] = []
        self._count = 0
        self._line = 0

    def listen(self, parser: object) -> None:
        """Have the parser call this builder."""

        def start(name: str, attributes: dict[str, str]) -> None:
            self._start(name, attributes, parser.CurrentLineNumber)  # type: ignore[attr-defined]

        def entity(name: str, *_: object) -> None:
            line = parser.CurrentLineNumber  # type: ignore[attr-defined]
            raise InvalidInput(
                f"{self.source}, line {line}: the file defines the entity {name[:60]!r}, which "
                "is not read: save it as plain SVG."
            )

        parser.StartElementHandler = start  # type: ignore[attr-defined]
        parser.EndElementHandler = self._end  # type: ignore[attr-defined]
        parser.CharacterDataHandler = self._text  # type: ignore[attr-defined]
        parser.EntityDeclHandler = entity  # type: ignore[attr-defined]

    def _start(self, name: str, attributes: dict[str, str], line: int) -> None:
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
