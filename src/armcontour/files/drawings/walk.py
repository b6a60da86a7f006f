"""Traversal of DXF and SVG drawings: what entities inherit, what is left out, and the contours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Progress
from armcontour.core.text import list_some
from armcontour.files.drawings.chain import Affine
from armcontour.files.drawings.chaining import DrawnEntity, chain_pieces
from armcontour.files.drawings.clipping import Clip, clip_path
from armcontour.files.drawings.mending import repair
from armcontour.files.drawings.options import FARTHEST, ReadOptions
from armcontour.files.drawings.reading import Labels, tell_share
from armcontour.files.drawings.shapes import Outline, paths_of
from armcontour.program import Program
from armcontour.program.moves import describe_not_run

# Share of the reading of a drawing after which its entities are known and their curves are fitted.
WALKED = 0.4
# Largest number of entities that a note names.
NAMED = 9
NO_SIZE = "Left out because of no size"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Place:
    """What the entities in a group, block or reference inherit.

    Args:
        to: Map from their coordinates to the page or the world [m].
        layer: Their layer, if they have none of their own.
        name: Name of the reference or INSERT around them.
        inside: What is placed by references or INSERTs around them.
        color: Names of their colour.
        clips: Clips around them [m].
    """

    to: Affine
    layer: str = ""
    name: str = ""
    inside: tuple[object, ...] = ()
    color: frozenset[str] = frozenset()
    clips: tuple[Clip, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drawn:
    """The outlines of one entity in metres.

    Args:
        outlines: The outlines.
        where: Name of the entity for messages.
        name: Name of its contours.
        layer: Layer of its contours.
        clips: Clips around it [m].
    """

    outlines: Sequence[Outline]
    where: str
    name: str
    layer: str
    clips: tuple[Clip, ...] = ()


class Walk:
    """What a traversal looks for, and what it leaves out.

    Args:
        source: Name of the file.
        options: Settings of the reader.
        progress: Called from time to time with the share of the file that is read.
    """

    # Whether the parts of one entity are never chained, and have its name.
    apart = False
    # The part of a file that is read, for messages.
    part = ""

    def __init__(self, source: str, options: ReadOptions, progress: Progress | None) -> None:
        self.source, self.options, self.skip = source, options, options.skips
        self.wanted, self.colors = options.layer_set, options.color_set
        self.tell = tell_share(progress, source)
        self.labels = Labels()
        # Names of what is left out, by the reasons; entities on other layers and of other colours.
        self.left_out: dict[str, Counter[str]] = {}
        self.elsewhere: Counter[str] = Counter()
        self.others: Counter[str] = Counter()

    def leave_out(self, reason: str, name: str) -> None:
        """Record that something is left out, and why."""
        self.left_out.setdefault(reason, Counter())[name] += 1

    def wants_layer(self, layer: str) -> bool:
        """Whether contours on a layer matter."""
        return self.wanted is None or self.labels(layer) in self.wanted

    def wants_color(self, names: frozenset[str]) -> bool:
        """Whether entities of a colour are read; counts them otherwise."""
        if self.colors is None or names & self.colors:
            return True
        self.others[min(names)] += 1
        return False

    @property
    def notes(self) -> list[str]:
        """Sentences on what was left out or changed."""
        found = [f"{why}: {list_counted(x)}." for why, x in self.left_out.items()]
        return found + self.labels.notes

    def explain_empty(self) -> str:
        """Why there is no contour, if it is not by what was left out."""
        return ""

    def program(self, found: Iterable[Drawn], notes: Sequence[str]) -> Program:
        """The program of all contours.

        Args:
            found: The entities, in their order.
            notes: Sentences on the file.

        Raises:
            InvalidInput: An entity makes no path, or there is no contour.
        """
        pieces = self._pieces(list(found))
        contours, chaining_notes = chain_pieces(pieces, self.options.join_tolerance)
        notes = [*notes, *self.notes, *chaining_notes]
        if not contours:
            if self.others:
                notes.append(f"Of other colours than chosen: {list_counted(self.others)}.")
            why = f" ({' '.join(notes).rstrip('.')})" if notes else ""
            why = self.explain_empty() or f"has no contour to follow{self.part}{why}"
            raise InvalidInput(f"{self.source} {why}.")
        program = Program(
            moves=tuple(contours),
            source=self.source,
            notes=tuple(notes),
            remarks=describe_not_run(self.elsewhere),
            other_layers=tuple(self.elsewhere),
        )
        return repair(program, self.options)

    def _pieces(self, found: Sequence[Drawn]) -> list[DrawnEntity]:
        """The paths of all outlines, clipped.

        Raises:
            InvalidInput: An outline makes no path.
        """
        options = self.options
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                paths = paths_of(
                    [y for x in found for y in x.outlines],
                    options.fit_tolerance,
                    options.join_tolerance,
                    lambda share: self.tell(WALKED + (1 - WALKED) * share),
                )
        except InvalidInput as error:
            assert error.index is not None
            where = [x.where for x in found for _ in x.outlines][error.index]
            raise InvalidInput(f"{self.source}: {where}: {error}") from None
        pieces: list[DrawnEntity] = []
        drawn = iter(paths)
        for x in found:
            whole = [path for path in islice(drawn, len(x.outlines)) if path is not None]
            if not whole:
                self.leave_out(NO_SIZE, x.where)
            parts = [part for path in whole for part in clip_path(path, *x.clips)]
            first = len(pieces) + 1
            for k, path in enumerate(parts):
                is_split = len(parts) > 1
                name = f"{x.name}[{k + 1}]" if is_split and not self.apart else x.name
                apart = first + k if is_split and self.apart else 0
                pieces.append(DrawnEntity(path=path, name=name, layer=x.layer, apart=apart))
        return pieces


def list_counted(names: Counter[str]) -> str:
    """The first names with their numbers above 1, such as `2 TEXT, HATCH`."""
    return list_some([x if n == 1 else f"{n} {x}" for x, n in names.items()], NAMED)


def place_outline(outline: Outline, to: Affine) -> tuple[Outline, str]:
    """The image of an outline under an affine map [m], and what is wrong if it is too far away."""
    with np.errstate(over="ignore", invalid="ignore"):
        placed = outline.place(to)
        reach = float(np.abs(placed.reach).max())
    if reach <= FARTHEST:
        return placed, ""
    return placed, (
        f"reaches {reach:.3g} m far, more than {FARTHEST:g} m: give the unit in which it is drawn, "
        "such as units: mm"
    )
