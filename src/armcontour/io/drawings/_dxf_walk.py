"""The entities of a DXF document, blocks and all, in metres and in the world's coordinates."""

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
from armcontour.io.drawings.reading import FARTHEST, SKIP, Labels
from armcontour.io.drawings.shapes import Shape

# Blocks in blocks: more is a document made to do harm, as are more copies of entities.
DEEPEST = 50
MOST_COPIES = 200_000
OFF, FROZEN = "off", "frozen"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """A shape with the name and the layer of its entity."""

    shape: Shape
    kind: str
    name: str
    layer: str


@dataclass(frozen=True, slots=True, kw_only=True)
class _Block:
    """Where entities come from: the drawing, or a block that is placed in it."""

    name: str
    affine: Affine
    layer: str
    inside: tuple[str, ...]


@dataclass(slots=True, kw_only=True, eq=False)
class Walk:
    """One way through a document, which counts what it leaves out.

    Args:
        document: ezdxf's.
        source: Name of the file.
        skip: Whether unknown entities are left out, and not refused.
        wanted: Layers that count; what is unknown on others is no matter. None means all.
        empty: Names of what has no length.
        unknown: Unknown entities, by their types.
        hidden: Entities on layers that are off or frozen, by their layers.
        invisible: Number of entities that are marked so.
        labels: Names of entities and layers as contours have them.
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

    def shapes(self, unit: float) -> Iterator[Found]:
        """Shapes of all entities of the model space, in its order.

        Args:
            unit: Length of the drawing's unit [m].

        Raises:
            InvalidInput: An entity that cannot be read, or is unknown and not to be skipped.
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
        yield from self._of(entities, drawing)

    def _of(self, entities: Iterable[Any], block: _Block) -> Iterator[Found]:
        for entity in entities:
            kind = entity.dxftype()
            handle = _attribute(entity, "handle", "?")
            name = f"{block.name}/{handle}" if block.name else f"handle {handle}"
            layer, state = self._layer(entity, block)
            try:
                if kind == "ATTDEF" and block.inside:
                    # The pattern of a text, which the drawing shows as the insert's own.
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
                # Whatever ezdxf makes of an entity that is broken.
                raise InvalidInput(
                    f"{self.source}: {kind} {name} on layer {layer!r} is damaged: {said(error)}."
                ) from None

    def _layer(self, entity: Any, block: _Block) -> tuple[str, str]:
        """Name of an entity's layer, and whether it is off or frozen."""
        own = str(_attribute(entity, "layer", "0"))
        # In a block, layer 0 is that of what places it.
        own = block.layer if own == "0" and block.inside else own
        return self._layers.get(_key(own), (own, ""))

    def _insert(self, entity: Any, block: _Block, name: str, layer: str) -> Iterator[Found]:
        """What a block draws, for each of its copies."""
        for attribute in getattr(entity, "attribs", ()):
            self._unknown(attribute.dxftype(), name, layer)
        refuse_missing(entity)
        called = str(_attribute(entity, "name", ""))
        content = self.document.blocks.get(called)
        if content is None:
            raise Unreadable(f"places the block {called!r}, which there is not")
        if _key(called) in block.inside or len(block.inside) >= DEEPEST:
            raise Unreadable(f"places the block {called!r} in itself")
        if not block.inside:
            self._copies += self._copies_of(entity)
            if self._copies > MOST_COPIES:
                raise Unreadable(f"brings the copies of entities to more than {MOST_COPIES}")
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
            yield from self._of(content, inner)

    def _copies_of(self, entity: Any) -> int:
        """How many entities an INSERT draws, known before they are drawn."""
        name = _key(str(_attribute(entity, "name", "")))
        if name not in self._sizes:
            # A block in itself is found later, where it can be named.
            self._sizes[name] = 1
            content = self.document.blocks.get(name)
            inner = [x for x in content or () if x.dxftype() == "INSERT"]
            own = 1 + (len(content) if content is not None else 0)
            self._sizes[name] = own + sum(self._copies_of(x) for x in inner)
        rows, columns = grid(entity)
        return rows * columns * self._sizes[name]

    def _unknown(self, kind: str, name: str, layer: str) -> None:
        if not self.skip:
            raise InvalidInput(
                f"{self.source} has a {kind} ({name}, layer {layer!r}), which is no contour to "
                f"follow: take it out, or {SKIP}."
            )
        self.unknown[kind] += 1

    @property
    def notes(self) -> list[str]:
        """Sentences on what was left out."""
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
    """An attribute that an entity of a type that ezdxf does not know cannot have."""
    return entity.dxf.get(name, default) if entity.dxf.is_supported(name) else default


def _count(counter: Counter[str]) -> str:
    return ", ".join(f"{n} {name}" for name, n in sorted(counter.items()))


def _key(name: str) -> str:
    """Names of layers and blocks are the same in capitals."""
    return name.lower()


def _is_mesh(entity: Any) -> bool:
    return entity.dxftype() == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline)


def _refuse_far(shape: Shape) -> None:
    far = float(np.abs(shape.reach).max())
    if not far <= FARTHEST:
        raise Unreadable(
            f"reaches to {far:.3g} m, further than {FARTHEST:g} m: is the unit of the drawing right"
        )
