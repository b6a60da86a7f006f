"""Reader for DXF drawings; the entities of the model space become a program of contours."""

from __future__ import annotations

import dataclasses
import io
import logging
import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any

import numpy as np

from armcontour.core.checks import raise_if
from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Progress
from armcontour.core.text import count_noun, list_some
from armcontour.files.colors import hex_of
from armcontour.files.drawings.arc_chain import WITHOUT_Z, Affine
from armcontour.files.drawings.drawing_traversal import (
    DASHED,
    TRAVERSAL_SHARE,
    EntityOutlines,
    Inherited,
    Walk,
    place_outline,
)
from armcontour.files.drawings.dxf_entities import (
    NO_CONTOUR,
    SHAPES,
    Unreadable,
    check_clip,
    check_required,
    insert_grid,
    insert_transforms,
)
from armcontour.files.drawings.outlines import Outline
from armcontour.files.drawings.read_options import SKIP_ADVICE, ReadOptions, valid_name
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program import Program

# Lengths of units by their codes in $INSUNITS [m] (DXF reference). The code 0 means no unit.
UNITS = {
    1: 0.0254,
    2: 0.3048,
    3: 1609.344,
    4: 1e-3,
    5: 1e-2,
    6: 1.0,
    7: 1e3,
    8: 25.4e-9,
    9: 25.4e-6,
    10: 0.9144,
    11: 1e-10,
    12: 1e-9,
    13: 1e-6,
    14: 0.1,
    15: 10.0,
    16: 100.0,
    21: 1200 / 3937,
    22: 100 / 3937,
    23: 3600 / 3937,
    24: 6336000 / 3937,
}
# Maximum depth of nested blocks. A document with a greater depth is malicious.
MAX_DEPTH = 50
EXPLODE = "Explode the entity into lines and arcs in the CAD program"
# Maximum number of copied entities. A document with more is malicious.
MAX_COPIES = 200_000
# States of a layer whose entities may be skipped:
OFF = "off"
FROZEN = "frozen"
UNPLOTTED = "not plotted"
# Layer of CAD programs for the points of dimensions, which is never plotted; in lower case.
DEFPOINTS = "defpoints"
# Group code of the tag with the layer of an entity.
LAYER_CODE = 8
# First words of the notes on omitted entities.
HIDDEN = "Skipped on layers that are off or frozen"
NOT_PLOTTED = "Skipped on layers that are not plotted and not named in layers or --layer"
INVISIBLE = "Skipped because they are invisible"
NOT_READ = "Skipped because they are not lines, arcs or curves"
BROKEN = "Skipped because they cannot be read"
# AutoCAD colour number: the colour of the block.
BY_BLOCK = 0
# AutoCAD colour number: the colour of the layer.
BY_LAYER = 256
# Line type of entities that have the line type of their layer.
LIKE_LAYER = "BYLAYER"
# AutoCAD colour number: black or white, whichever contrasts with the background.
ACI_WHITE = 7
# All names of the colour ACI_WHITE.
WHITE = frozenset({"7", "#ffffff", "#000000"})
BINARY = b"AutoCAD Binary DXF"
DRAWING_DATABASE = b"AC10"
CUT_OFF = "The file has no end mark (EOF). It seems to be cut off, and contours may be missing."
# Types of the tags whose numbers determine contours.
WITH_NUMBERS = {*SHAPES, "VERTEX", "INSERT", "BLOCK", "MLINE", "MLINESTYLE"}
# Matches a number; numbers that are not finite are refused later.
_FLOAT = re.compile(r"[-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf)", re.IGNORECASE)
# Matches the object handle in ezdxf's messages.
ADDRESS = re.compile(r"\(#\d+\)")
# Maximum number of layers that a message lists.
MAX_LAYERS = 12
# Maximum length of a reason from ezdxf in a message [characters].
MAX_REASON = 120


def read_dxf(
    data: bytes, *, source: str, options: ReadOptions, progress: Progress | None = None
) -> Program:
    """Read the contours of a DXF drawing.

    Args:
        data: Content of the file.
        source: Name of the file, for messages.
        options: Options.
        progress: Called with the completed fraction.

    Raises:
        InvalidInput: The file is not a DXF file, has no contour that the options select, or has an
            entity that is not supported.
    """
    # Lines and arcs are not changed; ellipses and splines become arcs within the chord tolerance.
    # If all points have z = 0, the program is in the plane, otherwise in space.
    # Entities are named by their handles. In a block, the handle of the INSERT precedes the name.
    with silence_log(), np.errstate(all="ignore"):
        document, notes = open_document(data, source)
        walk = DxfWalk(document, source, options, progress)
        # If the file has no header, ezdxf adds one with the unit metre, which is ignored.
        has_unit = b"$INSUNITS" in data
        unit = _unit(document.header.get("$INSUNITS", 0) if has_unit else 0, source, options)
        return walk.program(_flattened(list(walk.shapes(unit))), notes)


def _unit(code: Any, source: str, options: ReadOptions) -> float:
    """Return the length of the unit [m]: that of the options, else of the code in the header."""
    if options.unit is not None:
        return options.unit
    if code in UNITS:
        return UNITS[code]
    reason = "does not specify its unit" if code == 0 else f"has the unknown unit {code!r}"
    raise InvalidInput(
        f"{source} {reason} ($INSUNITS). Specify the unit, for example `units: mm` or --units mm."
    )


def _flattened(entities: list[EntityOutlines]) -> list[EntityOutlines]:
    """Return the entities, projected onto the plane if all z are 0; otherwise unchanged."""

    def is_flat(entity: EntityOutlines) -> bool:
        heights = (x.bounding_points[:, 2] for x in entity.outlines)
        return all(np.abs(z).max() <= REPEATED_POINT for z in heights)

    if not all(is_flat(x) for x in entities):
        return entities
    return [
        dataclasses.replace(x, outlines=[y.place(WITHOUT_Z) for y in x.outlines]) for x in entities
    ]


class DxfWalk(Walk):
    """Traversal of a DXF document, with notes on omitted entities."""

    part = " in its model space"
    counts_contours = True

    def __init__(
        self,
        document: Any,
        source: str,
        options: ReadOptions,
        progress: Progress | None,
    ) -> None:
        super().__init__(source, options, progress)
        self.document = document
        self._copies = 0
        self._block_sizes: dict[str, int] = {}
        self._layers: dict[str, tuple[str, str]] = {DEFPOINTS: ("Defpoints", UNPLOTTED)}
        self._layer_colors: dict[str, frozenset[str]] = {}
        self._layer_line_types: dict[str, str] = {}

    def explain_empty(self) -> str:
        """Explain why no contour is selected, for the error; "" if no other layer has entities."""
        if not self.on_other_layers:
            return ""
        requested = ", ".join(repr(x) for x in sorted(self.requested_layers or ()))
        layers = list_some([repr(x) for x in sorted(self.on_other_layers)], MAX_LAYERS)
        return f"has no contour on the layer {requested}, only on {layers}"

    def shapes(self, unit: float) -> Iterator[EntityOutlines]:
        """Yield the outlines of all entities in the model space, in the order of the document."""
        try:
            for layer in self.document.layers:
                name = _fold_case(layer.dxf.name)
                self._layers[name] = (layer.dxf.name, _state_of(layer, name))
                self._layer_colors[name] = _color_names(layer, abs(layer.color))
                self._layer_line_types[name] = _attribute(layer, "linetype", "CONTINUOUS")
            entities = self.document.modelspace()
        except Exception as error:
            raise InvalidInput(f"{self.source} is damaged ({error_line(error)}).") from None
        world = Affine(unit * np.eye(3), np.zeros(3))
        drawing = Inherited(to=world, layer="0", color=WHITE)
        for k, entity in enumerate(entities):
            self.report_fraction(TRAVERSAL_SHARE * k / len(entities))
            yield from self._shapes_in([entity], drawing)

    def _shapes_in(self, entities: Iterable[Any], block: Inherited) -> Iterator[EntityOutlines]:
        """Yield the outlines of the entities in a block or the drawing."""
        for entity in entities:
            kind = entity.dxftype()
            handle = _attribute(entity, "handle", "?")
            name = f"{block.name}/{handle}" if block.name else f"handle {handle}"
            layer, state = self._layer(entity, block)
            try:
                if kind == "ATTDEF" and block.targets:
                    # An ATTDEF is a template for a text, which the INSERT defines.
                    continue
                if state == FROZEN or (state == OFF and kind != "INSERT"):
                    self.omit(HIDDEN, layer)
                elif state == UNPLOTTED and kind != "INSERT" and self.requested_layers is None:
                    self.omit(NOT_PLOTTED, layer)
                elif _attribute(entity, "invisible", 0):
                    self.omit(INVISIBLE, kind)
                elif kind == "INSERT":
                    yield from self._insert(entity, block, name, layer)
                elif not self.wants_layer(layer):
                    # Entities on other layers are ignored, even if they are damaged.
                    self.on_other_layers[valid_name(layer)] += kind in SHAPES
                else:
                    yield from self._read_entity(entity, kind, name, layer, block)
            except Unreadable as error:
                self._refuse_or_skip(kind, name, layer, str(error))
            except InvalidInput:
                raise
            except Exception as error:
                # For a damaged entity, ezdxf can raise exceptions of any class.
                self._refuse_or_skip(kind, name, layer, f"is damaged ({error_line(error)})")

    def _read_entity(
        self, entity: Any, kind: str, name: str, layer: str, block: Inherited
    ) -> Iterator[EntityOutlines]:
        """Yield the outlines of a visible entity: several for MLINE, else at most one."""
        if kind == "MLINE":
            for k, part in enumerate(entity.virtual_entities()):
                yield from self._shape(part, kind, f"{name}[{k + 1}]", layer, block)
        elif kind in SHAPES and not (
            kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline)
        ):
            yield from self._shape(entity, kind, name, layer, block)
        elif kind in NO_CONTOUR:
            self.omit(NOT_READ, "mesh" if kind == "POLYLINE" else kind)
        else:
            raise Unreadable(f"is of an unsupported type. {EXPLODE}")

    def _is_dashed(self, entity: Any, layer: str) -> bool:
        """Return whether an entity is drawn in dashes, by its own line type or its layer's."""
        line_type = _attribute(entity, "linetype", LIKE_LAYER)
        if line_type.upper() == LIKE_LAYER:
            line_type = self._layer_line_types.get(_fold_case(layer), "CONTINUOUS")
        table = self.document.linetypes
        # The pattern of a continuous line has no dashes.
        return table.has_entry(line_type) and bool(table.get(line_type).simplified_line_pattern())

    def _shape(
        self, entity: Any, kind: str, name: str, layer: str, block: Inherited
    ) -> Iterator[EntityOutlines]:
        """Yield the outline of an entity if the options select its colour."""
        if not self.wants_color(self._color(entity, layer, block)):
            return
        if self._is_dashed(entity, layer):
            self.omit(DASHED, kind)
        check_required(entity)
        shape = SHAPES[entity.dxftype()](entity)
        outlines = []
        if shape is not None:
            placed, defect = place_outline(Outline([shape]), block.to)
            if defect:
                raise Unreadable(defect)
            outlines = [placed]
        yield EntityOutlines(
            outlines=outlines,
            where=f"{kind} {name} on layer {layer!r}",
            name=valid_name(name),
            layer=valid_name(layer),
        )

    def _color(self, entity: Any, layer: str, block: Inherited) -> frozenset[str]:
        """Return the names of an entity's colour, which can come from its block or layer."""
        number = _attribute(entity, "color", BY_LAYER)
        if _attribute(entity, "true_color", None) is None:
            if number == BY_BLOCK:
                return block.color
            if number == BY_LAYER:
                return self._layer_colors.get(_fold_case(layer), WHITE)
        return _color_names(entity, number)

    def _layer(self, entity: Any, block: Inherited) -> tuple[str, str]:
        """Return the name of an entity's layer, and the layer's state, as from `_state_of`."""
        layer = str(_attribute(entity, "layer", "") or _layer_tag(entity))
        # In a block, layer 0 stands for the layer of the INSERT.
        layer = block.layer if layer == "0" and block.targets else layer
        return self._layers.get(_fold_case(layer), (layer, ""))

    def _insert(
        self, entity: Any, block: Inherited, name: str, layer: str
    ) -> Iterator[EntityOutlines]:
        """Yield the outlines of all copies of the block that an INSERT names."""
        if self.wants_layer(layer):
            for _ in getattr(entity, "attribs", ()):
                self.omit(NOT_READ, "ATTRIB")
        check_required(entity)
        block_name = str(_attribute(entity, "name", ""))
        content = self.document.blocks.get(block_name)
        if content is None:
            raise Unreadable(f"inserts the block {block_name!r}, which does not exist")
        if _fold_case(block_name) in block.targets:
            raise Unreadable(f"inserts the block {block_name!r} in itself")
        if len(block.targets) >= MAX_DEPTH:
            raise Unreadable(f"is nested in more than {MAX_DEPTH} blocks")
        if not block.targets:
            self._copies += self._count_entities(entity)
            if self._copies > MAX_COPIES:
                raise Unreadable(
                    f"increases the number of copied entities above the maximum of {MAX_COPIES}"
                )
        check_clip(entity)
        base = np.array(tuple(content.block.dxf.base_point), dtype=np.float64)
        affine, offsets = insert_transforms(entity, base)
        columns = insert_grid(entity)[1]
        color = self._color(entity, layer, block)
        for k, offset in enumerate(offsets):
            row = k // columns + 1
            column = k % columns + 1
            inner = Inherited(
                name=name if len(offsets) == 1 else f"{name}[{row},{column}]",
                to=block.to @ Affine(affine.linear, affine.offset + offset),
                layer=layer,
                targets=(*block.targets, _fold_case(block_name)),
                color=color,
            )
            yield from self._shapes_in(content, inner)

    def _count_entities(self, entity: Any) -> int:
        """Count the blocks and entities that an INSERT copies, including those of nested blocks."""
        name = _fold_case(str(_attribute(entity, "name", "")))
        if name not in self._block_sizes:
            # The value 1 ends the recursion if a block contains itself. Such a block is refused
            # later.
            self._block_sizes[name] = 1
            content = self.document.blocks.get(name)
            inner = [x for x in content or () if x.dxftype() == "INSERT"]
            count = 1 + (len(content) if content is not None else 0)
            self._block_sizes[name] = count + sum(map(self._count_entities, inner))
        rows, columns = insert_grid(entity)
        return rows * columns * self._block_sizes[name]

    def _refuse_or_skip(self, kind: str, name: str, layer: str, reason: str) -> None:
        """Refuse an entity that cannot be read, or record it if the options skip such entities."""
        if kind != "INSERT" and not self.wants_layer(layer):
            return
        defect = f"{kind} {name} on layer {layer!r} {reason}"
        if not self.skip:
            raise InvalidInput(
                f"{self.source}: {defect}. Correct the entity in the drawing, select other layers "
                f"(layers, or --layer), or {SKIP_ADVICE}."
            )
        self.omit(BROKEN, defect)


def _attribute(entity: Any, name: str, default: Any) -> Any:
    """Return an attribute of an entity; `default` if the entity or its type does not have it."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


def _fold_case(name: str) -> str:
    """Return the name of a layer or block in lower case, because DXF ignores its case."""
    return name.lower()


def _state_of(layer: Any, name: str) -> str:
    """Return the state of a layer: FROZEN, OFF, UNPLOTTED, or "" if its entities are drawn."""
    if layer.is_frozen():
        return FROZEN
    if layer.is_off():
        return OFF
    if name == DEFPOINTS or not _attribute(layer, "plot", 1):
        return UNPLOTTED
    return ""


def _layer_tag(entity: Any) -> str:
    """Return the layer of an entity whose type ezdxf does not support; "0" if it has none."""
    tags = getattr(entity, "xtags", None)
    for tag in chain.from_iterable(tags.subclasses if tags else ()):
        if tag.code == LAYER_CODE:
            return str(tag.value)
    return "0"


def _color_names(entity: Any, number: int) -> frozenset[str]:
    """Return the names of a colour: AutoCAD's number and #rrggbb.

    A true colour has only the name #rrggbb.
    """
    from ezdxf.colors import aci2rgb

    if entity.rgb is not None:
        return frozenset({hex_of(*entity.rgb)})
    if number == ACI_WHITE or not 0 < number < BY_LAYER:
        return WHITE
    return frozenset({str(number), hex_of(*aci2rgb(number))})


def open_document(data: bytes, source: str) -> tuple[Any, list[str]]:
    """Open a DXF file; return ezdxf's document, and notes on damage."""
    try:
        import ezdxf  # noqa: F401
    except ImportError:
        raise InvalidInput(
            "Reading DXF files requires ezdxf. Install it with: pip install 'armcontour[drawings]'."
        ) from None
    dwg = f"{source} is a DWG file, which is not supported. Save it as DXF."
    raise_if(data.startswith(DRAWING_DATABASE), dwg)
    raise_if(not data.strip(), f"{source} is empty.")
    sections = data.startswith(BINARY) or b"SECTION" in data
    raise_if(not sections, f"{source} is not a DXF file, because it has no section.")
    # For a damaged file, ezdxf can raise exceptions of any class. The last line of an ASCII file is
    # its end mark.
    is_whole = data.startswith(BINARY) or data.rstrip(b"\0\x1a \t\r\n").endswith(b"EOF")
    notes = [] if is_whole else [CUT_OFF]
    try:
        return _read(data), notes
    except Exception as error:
        first_error = error
    wrong_number = _wrong_number(data)
    # Of a wrong number, ezdxf would read the digits before the error, such as 12 of 12,7.
    raise_if(wrong_number != "", f"{source}: {wrong_number}. Correct the drawing.")
    try:
        from ezdxf import recover

        document, auditor = recover.read(io.BytesIO(data))
        changes = len(auditor.errors) + len(auditor.fixes)
        if notes and not changes:
            # The file is truncated, but its remaining part is intact.
            return document, notes
        repaired = f" and was repaired in {count_noun(changes, 'place')}" if changes else ""
        reason = ADDRESS.sub("", error_line(first_error))
        damage = f"The file is damaged ({reason}){repaired}; damaged parts may be missing."
        return document, [*notes, damage]
    except Exception:
        reason = ADDRESS.sub("", error_line(first_error))
        raise InvalidInput(
            f"{source} cannot be read as DXF: {' '.join([f'{reason}.', *notes])} Open the file in "
            "a CAD program, and save it again."
        ) from None


def _wrong_number(data: bytes) -> str:
    """Describe the first value in contours of an ASCII file that is not a number; "" without."""
    from ezdxf.lldxf.types import TYPE_TABLE

    # Codes from 1000 are data of applications.
    codes = {str(code) for code in TYPE_TABLE if code < 1000}
    lines = data.decode("utf-8", errors="replace").split("\n")
    kind = ""
    for k in range(0, len(lines) - 1, 2):
        code = lines[k].strip()
        value = lines[k + 1].strip()
        if code == "0":
            kind = value
        elif kind in WITH_NUMBERS and code in codes and not _FLOAT.fullmatch(value):
            return (
                f"the value {value[:40]!r} in line {k + 2} ({kind}, group code {code}) must be a "
                "number with a decimal point"
            )
    return ""


def _read(data: bytes) -> Any:
    """Load an intact file; returns ezdxf's document."""
    from ezdxf.document import Drawing
    from ezdxf.filemanagement import dxf_stream_info
    from ezdxf.lldxf.tagger import binary_tags_loader

    if data.startswith(BINARY):
        return Drawing.load(binary_tags_loader(data, errors="surrogateescape"))
    # The header contains the name of the encoding, and is itself plain ASCII.
    info = dxf_stream_info(io.StringIO(data.decode("utf-8", errors="ignore"), newline=None))
    text = data.decode(info.encoding, errors="surrogateescape")
    return Drawing.read(io.StringIO(text, newline=None))


def error_line(error: Exception) -> str:
    """Return the first line of an exception's message, shortened to MAX_REASON characters."""
    lines = str(error).strip().splitlines() or [type(error).__name__]
    text = lines[0].strip().rstrip(".")
    return text if len(text) <= MAX_REASON else f"{text[: MAX_REASON - 3]}..."


@contextmanager
def silence_log() -> Iterator[None]:
    """Disable ezdxf's log, because the notes of the program inform the user."""
    logger = logging.getLogger("ezdxf")
    before = logger.disabled
    logger.disabled = True
    try:
        yield
    finally:
        logger.disabled = before
