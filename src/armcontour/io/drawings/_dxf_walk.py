"""All shapes of a DXF document, including those in blocks, in metres and world coordinates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.io.drawings._dxf_document import said
from armcontour.io.drawings._dxf_entities import (
    NO_CONTOUR,
    SHAPES,
    Unreadable,
    clip_of,
    grid,
    insertions,
    refuse_missing,
)
from armcontour.io.drawings.affine import Affine
from armcontour.io.drawings.clipping import Clip
from armcontour.io.drawings.colors import count_names, hex_of
from armcontour.io.drawings.reading import FARTHEST, SKIP, WALKED, Labels, Tell
from armcontour.io.drawings.shapes import Shape

# Largest depth of blocks in blocks, and largest number of copied entities: a document with more
# is made to do harm.
DEEPEST = 50
# Largest number of broken entities that a note names.
NAMED = 6
EXPLODE = "explode it into lines and arcs in the CAD program"
MOST_COPIES = 200_000
OFF, FROZEN = "off", "frozen"
# Numbers of AutoCAD's colours that mean the colour of the block, of the layer, and black or white.
BY_BLOCK, BY_LAYER, ACI_WHITE = 0, 256, 7
WHITE = frozenset({"7", "#ffffff", "#000000"})


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """A shape with the type, the name and the layer of its entity.

    Args:
        clips: Clips of the blocks around it [m].
    """

    shape: Shape
    kind: str
    name: str
    layer: str
    clips: tuple[Clip, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Block:
    """The drawing, or one copy of a block in it, with what its entities inherit.

    Args:
        name: Name of the INSERT, empty for the drawing.
        affine: Map from the block's coordinates to world coordinates [m].
        layer: Layer of the entities that are on layer 0 of the block.
        inside: Keys of the block and of the blocks around it.
        color: Names of the colour of the entities whose colour is that of the block.
        clips: Clips of the block and of those around it [m].
    """

    name: str
    affine: Affine
    layer: str
    inside: tuple[str, ...]
    color: frozenset[str] = WHITE
    clips: tuple[Clip, ...] = ()


@dataclass(slots=True, kw_only=True, eq=False)
class Walk:
    """Traversal of a document's entities, which counts the entities that it leaves out.

    Args:
        document: ezdxf's document.
        source: Name of the file.
        skip: Whether entities that cannot be read are left out instead of refused.
        line_of: Text that says in which line of the file a handle stands.
        wanted: Layers whose entities matter; None means all layers.
        colors: Colours of the entities that are read; None means all colours.
        texts: Whether the letters of texts are contours.
        empty: Names of entities without length.
        unknown: Numbers of entities that are no contour by their types.
        broken: Sentences on entities that cannot be read.
        hidden: Numbers of entities on layers that are off or frozen, by their layers.
        invisible: Number of entities that are marked invisible.
        others: Numbers of entities of other colours than those of `colors`, by their colours.
        elsewhere: Numbers of lines, arcs and curves on layers that are not wanted, by layer.
        drawn_texts: Number of texts whose letters are contours.
        labels: Names of entities and layers as the contours get them.
    """

    document: Any
    source: str
    skip: bool
    line_of: Callable[[str], str]
    wanted: frozenset[str] | None = None
    colors: frozenset[str] | None = None
    texts: bool = False
    empty: list[str] = field(default_factory=list)
    unknown: Counter[str] = field(default_factory=Counter)
    broken: list[str] = field(default_factory=list)
    hidden: Counter[str] = field(default_factory=Counter)
    invisible: int = 0
    others: Counter[str] = field(default_factory=Counter)
    elsewhere: Counter[str] = field(default_factory=Counter)
    drawn_texts: int = 0
    labels: Labels = field(default_factory=Labels)
    _copies: int = 0
    _sizes: dict[str, int] = field(default_factory=dict)
    _layers: dict[str, tuple[str, str]] = field(default_factory=dict)
    _layer_colors: dict[str, frozenset[str]] = field(default_factory=dict)

    def shapes(self, unit: float, tell: Tell) -> Iterator[Found]:
        """Yield the shapes of all entities of the model space, in the order of the document.

        Args:
            unit: Length of the drawing's unit [m].
            tell: Called from time to time with the share of the drawing that is read.

        Raises:
            InvalidInput: An entity cannot be read, or is unknown and unknown entities are refused.
        """
        try:
            for layer in self.document.layers:
                state = FROZEN if layer.is_frozen() else OFF if layer.is_off() else ""
                self._layers[_key(layer.dxf.name)] = (layer.dxf.name, state)
                self._layer_colors[_key(layer.dxf.name)] = _color_names(layer, abs(layer.color))
            entities = self.document.modelspace()
        except Exception as error:
            raise InvalidInput(f"{self.source} is damaged: {said(error)}.") from None
        world = Affine(unit * np.eye(3), np.zeros(3))
        drawing = _Block(name="", affine=world, layer="0", inside=())
        for k, entity in enumerate(entities):
            tell(WALKED * k / len(entities))
            yield from self._shapes_in([entity], drawing)

    def _shapes_in(self, entities: Iterable[Any], block: _Block) -> Iterator[Found]:
        """Yield the shapes of the entities of a block or of the drawing."""
        for entity in entities:
            kind = entity.dxftype()
            handle = _attribute(entity, "handle", "?")
            name = f"{block.name}/{handle}" if block.name else f"handle {handle}"
            layer, state = self._layer(entity, block)
            try:
                if kind == "ATTDEF" and block.inside:
                    # A template of a text; the drawing shows the texts of the INSERT instead.
                    continue
                if state == FROZEN or (state == OFF and kind != "INSERT"):
                    self.hidden[layer] += 1
                elif _attribute(entity, "invisible", 0):
                    self.invisible += 1
                elif kind == "INSERT":
                    yield from self._insert(entity, block, name, layer)
                elif self.wanted is not None and self.labels(layer) not in self.wanted:
                    # Nothing on other layers matters, broken or not.
                    self.elsewhere[self.labels(layer)] += kind in SHAPES
                    continue
                elif kind == "MLINE":
                    for k, part in enumerate(entity.virtual_entities()):
                        yield from self._shape(part, kind, f"{name}[{k + 1}]", layer, block)
                elif kind in SHAPES and not _is_mesh(entity):
                    yield from self._shape(entity, kind, name, layer, block)
                elif kind == "TEXT" and self.texts:
                    self.drawn_texts += 1
                    for k, part in enumerate(letters_of(entity)):
                        yield from self._shape(
                            part, part.dxftype(), f"{name}[{k + 1}]", layer, block
                        )
                elif kind in NO_CONTOUR:
                    self.unknown["mesh" if kind == "POLYLINE" else kind] += 1
                else:
                    self._leave(kind, name, layer, f"is not read: {EXPLODE}", handle)
            except Unreadable as error:
                self._leave(kind, name, layer, str(error), handle)
            except InvalidInput:
                raise
            except Exception as error:
                # A broken entity makes ezdxf raise exceptions of any class.
                self._leave(kind, name, layer, f"is damaged: {said(error)}", handle)

    def _shape(
        self, entity: Any, kind: str, name: str, layer: str, block: _Block
    ) -> Iterator[Found]:
        """Yield the shape of an entity, if it has a length and one of the chosen colours.

        Raises:
            Unreadable: The entity does not define a shape.
        """
        if self.colors is not None:
            color = self._color(entity, layer, block)
            if not color & self.colors:
                self.others[min(color)] += 1
                return
        refuse_missing(entity)
        shape = SHAPES[entity.dxftype()](entity)
        if shape is None:
            self.empty.append(name)
            return
        placed = shape.place(block.affine)
        _refuse_far(placed)
        name, layer = self.labels(name), self.labels(layer)
        yield Found(shape=placed, kind=kind, name=name, layer=layer, clips=block.clips)

    def _color(self, entity: Any, layer: str, block: _Block) -> frozenset[str]:
        """The names of the colour in which an entity is drawn."""
        number = _attribute(entity, "color", BY_LAYER)
        if _attribute(entity, "true_color", None) is None:
            if number == BY_BLOCK:
                return block.color
            if number == BY_LAYER:
                return self._layer_colors.get(_key(layer), WHITE)
        return _color_names(entity, number)

    def _layer(self, entity: Any, block: _Block) -> tuple[str, str]:
        """Name of an entity's layer, and the layer's state: off, frozen or empty."""
        own = str(_attribute(entity, "layer", "") or _layer_tag(entity))
        # In a block, layer 0 means the layer of the INSERT.
        own = block.layer if own == "0" and block.inside else own
        return self._layers.get(_key(own), (own, ""))

    def _insert(self, entity: Any, block: _Block, name: str, layer: str) -> Iterator[Found]:
        """Yield the shapes of all copies of a block.

        Raises:
            Unreadable: The block is missing, contains itself, or has too many copies.
        """
        if self.wanted is None or self.labels(layer) in self.wanted:
            self.unknown["ATTRIB"] += len(getattr(entity, "attribs", ()))
        refuse_missing(entity)
        called = str(_attribute(entity, "name", ""))
        content = self.document.blocks.get(called)
        if content is None:
            raise Unreadable(f"places the block {called!r}, which does not exist")
        if _key(called) in block.inside or len(block.inside) >= DEEPEST:
            raise Unreadable(f"places the block {called!r} in itself")
        if not block.inside:
            self._copies += self._copies_of(entity)
            if self._copies > MOST_COPIES:
                raise Unreadable(f"raises the number of copies of entities above {MOST_COPIES}")
        base = np.array(tuple(content.block.dxf.base_point), dtype=np.float64)
        affine, offsets = insertions(entity, base)
        columns = grid(entity)[1]
        clip = clip_of(entity)
        color = self._color(entity, layer, block)
        for k, offset in enumerate(offsets):
            copy = block.affine @ Affine(affine.linear, affine.offset + offset)
            row, column = k // columns + 1, k % columns + 1
            inner = _Block(
                name=name if len(offsets) == 1 else f"{name}[{row},{column}]",
                affine=copy,
                layer=layer,
                inside=(*block.inside, _key(called)),
                color=color,
                clips=block.clips if clip is None else (*block.clips, clip.place(copy)),
            )
            yield from self._shapes_in(content, inner)

    def _copies_of(self, entity: Any) -> int:
        """Number of entities that an INSERT draws, computed without drawing them."""
        name = _key(str(_attribute(entity, "name", "")))
        if name not in self._sizes:
            # A block that contains itself is refused later, with its name.
            self._sizes[name] = 1
            content = self.document.blocks.get(name)
            inner = [x for x in content or () if x.dxftype() == "INSERT"]
            own = 1 + (len(content) if content is not None else 0)
            self._sizes[name] = own + sum(self._copies_of(x) for x in inner)
        rows, columns = grid(entity)
        return rows * columns * self._sizes[name]

    def _leave(self, kind: str, name: str, layer: str, why: str, handle: str) -> None:
        """Leave out an entity that cannot be read, or refuse it.

        Raises:
            InvalidInput: Such entities are refused.
        """
        if kind != "INSERT" and self.wanted is not None and self.labels(layer) not in self.wanted:
            return
        # Looking for a line takes as long as the file; the notes name the first entities only.
        line = self.line_of(handle) if len(self.broken) < NAMED else ""
        what = f"{kind} {name}{line} on layer {layer!r} {why}"
        if not self.skip:
            raise InvalidInput(
                f"{self.source}: {what}. Mend it in the drawing, choose the layers to follow "
                f"(layers, or --layer), or {SKIP}."
            )
        self.broken.append(what)

    @property
    def notes(self) -> list[str]:
        """Sentences on the entities that were left out."""
        found = []
        if +self.unknown:
            found.append(
                f"Left out, because it is no line, arc or curve: {count_names(+self.unknown)}."
            )
            if self.unknown["TEXT"]:
                found[-1] += (
                    " Letters of TEXT become contours with path.texts or --texts: contours."
                )
        if self.drawn_texts:
            found.append(
                f"Drawn through a font of this machine, which may differ from the drawing's: "
                f"{self.drawn_texts} TEXT."
            )
        if self.broken:
            found.append(f"Left out, because it cannot be read: {list_some(self.broken, NAMED)}.")
        if self.hidden:
            found.append(f"Left out, on layers that are off or frozen: {count_names(self.hidden)}.")
        if self.invisible:
            found.append(f"Left out, because they are invisible: {self.invisible}.")
        if self.empty:
            found.append(f"Left out, because of no length: {list_some(self.empty, 6)}.")
        return found + self.labels.notes


def letters_of(entity: Any) -> list[Any]:
    """The outlines of the letters of a TEXT, as splines and polylines.

    Raises:
        Unreadable: The text cannot be drawn.
    """
    from ezdxf.addons import text2path

    try:
        return list(text2path.virtual_entities(entity, kind=text2path.Kind.SPLINES))
    except Exception as error:
        raise Unreadable(f"cannot be drawn through a font: {said(error)}") from None


def _attribute(entity: Any, name: str, default: Any) -> Any:
    """An attribute of an entity; the default if the entity or its type does not have it."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


def _key(name: str) -> str:
    """The name of a layer or block in lower case: DXF ignores the case of such names."""
    return name.lower()


def _layer_tag(entity: Any) -> str:
    """Layer of an entity whose type ezdxf does not know."""
    tags = getattr(entity, "xtags", None)
    found = (x.value for part in (tags.subclasses if tags else ()) for x in part if x.code == 8)
    return str(next(found, "0"))


def _color_names(entity: Any, number: int) -> frozenset[str]:
    """The names of the colour of an entity or layer: its number and #rrggbb, or its true colour."""
    from ezdxf.colors import aci2rgb

    if entity.rgb is not None:
        return frozenset({hex_of(*entity.rgb)})
    if number == ACI_WHITE or not 0 < number < BY_LAYER:
        return WHITE
    return frozenset({str(number), hex_of(*aci2rgb(number))})


def _is_mesh(entity: Any) -> bool:
    """Whether a POLYLINE is a mesh and not a curve."""
    return entity.dxftype() == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline)


def _refuse_far(shape: Shape) -> None:
    """Refuse a shape with points beyond `FARTHEST`.

    Raises:
        Unreadable: A coordinate is too large.
    """
    far = float(np.abs(shape.reach).max())
    if not far <= FARTHEST:
        raise Unreadable(
            f"reaches to {far:.3g} m, further than {FARTHEST:g} m: give the unit in which it is "
            "drawn, such as units: mm"
        )
