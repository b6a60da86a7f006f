"""All shapes of a DXF document, including those in blocks, in metres and world coordinates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.io.drawings._dxf_document import said
from armcontour.io.drawings._dxf_entities import (
    SHAPES,
    Unreadable,
    grid,
    insertions,
    refuse_missing,
)
from armcontour.io.drawings.affine import Affine
from armcontour.io.drawings.reading import FARTHEST, SKIP, WALKED, Labels, Tell
from armcontour.io.drawings.shapes import Shape

# Largest depth of blocks in blocks, and largest number of copied entities: a document with more
# is made to do harm.
DEEPEST = 50
MOST_COPIES = 200_000
OFF, FROZEN = "off", "frozen"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """A shape with the type, the name and the layer of its entity."""

    shape: Shape
    kind: str
    name: str
    layer: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Block:
    """The drawing, or one copy of a block in it, with what its entities inherit.

    Args:
        name: Name of the INSERT, empty for the drawing.
        affine: Map from the block's coordinates to world coordinates [m].
        layer: Layer of the entities that are on layer 0 of the block.
        inside: Keys of the block and of the blocks around it.
    """

    name: str
    affine: Affine
    layer: str
    inside: tuple[str, ...]


@dataclass(slots=True, kw_only=True, eq=False)
class Walk:
    """Traversal of a document's entities, which counts the entities that it leaves out.

    Args:
        document: ezdxf's document.
        source: Name of the file.
        skip: Whether unknown entities are left out instead of refused.
        wanted: Layers whose unknown entities matter; None means all layers.
        empty: Names of entities without length.
        unknown: Numbers of unknown entities by their types.
        hidden: Numbers of entities on layers that are off or frozen, by their layers.
        invisible: Number of entities that are marked invisible.
        labels: Names of entities and layers as the contours get them.
    """

    document: Any
    source: str
    skip: bool
    wanted: frozenset[str] | None = None
    empty: list[str] = field(default_factory=list)
    unknown: Counter[str] = field(default_factory=Counter)
    hidden: Counter[str] = field(default_factory=Counter)
    invisible: int = 0
    labels: Labels = field(default_factory=Labels)
    _copies: int = 0
    _sizes: dict[str, int] = field(default_factory=dict)
    _layers: dict[str, tuple[str, str]] = field(default_factory=dict)

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
                elif kind in SHAPES and not _is_mesh(entity):
                    refuse_missing(entity)
                    shape = SHAPES[kind](entity)
                    if shape is None:
                        self.empty.append(name)
                    else:
                        placed = shape.place(block.affine)
                        _refuse_far(placed)
                        name, layer = self.labels(name), self.labels(layer)
                        yield Found(shape=placed, kind=kind, name=name, layer=layer)
                elif self.wanted is None or self.labels(layer) in self.wanted:
                    self._unknown(kind, name, layer)
            except Unreadable as error:
                raise InvalidInput(
                    f"{self.source}: {kind} {name} on layer {layer!r} {error}."
                ) from None
            except InvalidInput:
                raise
            except Exception as error:
                # A broken entity makes ezdxf raise exceptions of any class.
                raise InvalidInput(
                    f"{self.source}: {kind} {name} on layer {layer!r} is damaged: {said(error)}."
                ) from None

    def _layer(self, entity: Any, block: _Block) -> tuple[str, str]:
        """Name of an entity's layer, and the layer's state: off, frozen or empty."""
        own = str(_attribute(entity, "layer", "0"))
        # In a block, layer 0 means the layer of the INSERT.
        own = block.layer if own == "0" and block.inside else own
        return self._layers.get(_key(own), (own, ""))

    def _insert(self, entity: Any, block: _Block, name: str, layer: str) -> Iterator[Found]:
        """Yield the shapes of all copies of a block.

        Raises:
            Unreadable: The block is missing, contains itself, or has too many copies.
        """
        for attribute in getattr(entity, "attribs", ()):
            self._unknown(attribute.dxftype(), name, layer)
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
        for offset in offsets:
            copy = Affine(affine.linear, affine.offset + offset)
            inner = _Block(
                name=name,
                affine=block.affine @ copy,
                layer=layer,
                inside=(*block.inside, _key(called)),
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

    def _unknown(self, kind: str, name: str, layer: str) -> None:
        """Count an unknown entity, or refuse it.

        Raises:
            InvalidInput: Unknown entities are refused.
        """
        if not self.skip:
            raise InvalidInput(
                f"{self.source} has a {kind} ({name}, layer {layer!r}), which is no contour to "
                f"follow: remove it, or {SKIP}."
            )
        self.unknown[kind] += 1

    @property
    def notes(self) -> list[str]:
        """Sentences on the entities that were left out."""
        found = []
        if self.unknown:
            found.append(f"Left out, because it is no contour: {_count(self.unknown)}.")
        if self.hidden:
            found.append(f"Left out, on layers that are off or frozen: {_count(self.hidden)}.")
        if self.invisible:
            found.append(f"Left out, because they are invisible: {self.invisible}.")
        if self.empty:
            found.append(f"Left out, because of no length: {list_some(self.empty, 6)}.")
        return found + self.labels.notes


def _attribute(entity: Any, name: str, default: Any) -> Any:
    """An attribute of an entity; the default if the entity or its type does not have it."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


def _count(counter: Counter[str]) -> str:
    """The numbers and names of a counter, such as `2 TEXT, 1 HATCH`."""
    return ", ".join(f"{n} {name}" for name, n in sorted(counter.items()))


def _key(name: str) -> str:
    """The name of a layer or block in lower case: DXF ignores the case of such names."""
    return name.lower()


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
            f"reaches to {far:.3g} m, further than {FARTHEST:g} m: is the unit of the drawing right"
        )
