"""Traversal of DXF and SVG drawings: inherited properties, clips, omitted entities, contours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain, islice

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Progress
from armcontour.core.text import list_some
from armcontour.files.drawings.arc_chain import Affine
from armcontour.files.drawings.entity_chains import DrawnEntity, chain_pieces
from armcontour.files.drawings.outlines import Outline, paths_of
from armcontour.files.drawings.read_options import (
    MAX_COORDINATE,
    SKIP_ADVICE,
    ReadOptions,
    fraction_reporter,
    repair_vertices,
    valid_name,
)
from armcontour.geometry import Path
from armcontour.geometry.projection import find_nearest
from armcontour.geometry.segments import REPEATED_POINT, Segments
from armcontour.program import Program
from armcontour.program.moves import describe_not_run
from armcontour.program.nesting import wind_around
from armcontour.program.offset_curves import find_crossings, to_pieces

# Fraction of the progress that is reported for the traversal of a drawing; the rest is for fitting.
TRAVERSAL_SHARE = 0.4
# First words of the note on dashed lines, which are often folds or centre lines.
DASHED = "Read as continuous contours, although they are drawn in dashes"
# Largest number of entities that a note lists.
MAX_NAMED = 9
NO_SIZE = "Skipped because they have no size"
CUT_OFF = "Skipped because a clip or viewport removes them, in part or completely"


# Places of a part beyond a border at which its distance is measured, as fractions of its length.
PLACES = (0.5, 0.0, 0.25, 0.75, 1.0)


def is_drawn(path: Path, border: Path, tolerance: float) -> BoolArray:
    """Return which parts of a planar path that was cut at a border are inside or on this border.

    A part outside is on the border if its points are at most `tolerance` [m] beyond it.
    """
    # A point is inside if its winding number is not 0.
    table = path.segments
    i, begin, end = _cut_at_border(table, border.segments)
    middles = table.evaluate(i, (begin + end) / 2)
    drawn = wind_around([border], middles) != 0
    beyond = np.flatnonzero(~drawn)
    for share in PLACES:
        place = begin[beyond] + share * (end - begin)[beyond]
        points = table.evaluate(i[beyond], place)
        distance = find_nearest(border.segments, points).distance
        beyond = beyond[distance <= max(REPEATED_POINT, tolerance)]
    drawn[beyond] = True
    return np.asarray(drawn)


def _cut_at_border(table: Segments, border: Segments) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return parts of segments, cut at a border: segment indices, start and end arc lengths [m]."""
    n = len(table)
    pairs, distances = find_crossings(np.concatenate([to_pieces(table), to_pieces(border)]))
    crosses = (pairs < n).sum(axis=1) == 1
    of_path = pairs[crosses] < n
    i = pairs[crosses][of_path]
    u = distances[crosses][of_path]
    # Crossings at the ends of a segment are ignored.
    inner = (u > REPEATED_POINT) & (u < table.lengths[i] - REPEATED_POINT)
    row = np.concatenate([np.arange(n), i[inner]])
    begin = np.concatenate([np.zeros(n), u[inner]])
    order = np.lexsort([begin, row])
    row = row[order]
    begin = begin[order]
    apart = np.append(True, (np.diff(row) > 0) | (np.diff(begin) > REPEATED_POINT))
    row = row[apart]
    begin = begin[apart]
    last = np.append(np.diff(row) > 0, True)
    return row, begin, np.where(last, table.lengths[row], np.append(begin[1:], 0.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inherited:
    """Properties that the entities inside a group, block or reference inherit."""

    to: Affine  # Map from the coordinates of the entities to the page or the world [m]
    layer: str = ""  # Layer of entities without their own layer
    name: str = ""  # Name of the innermost reference or INSERT
    targets: tuple[object, ...] = ()  # Targets of the nested references or INSERTs, outermost first
    color: frozenset[str] = frozenset()  # Names of the colour
    clips: tuple[Outline, ...] = ()  # Closed outlines outside of which nothing is drawn [m]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EntityOutlines:
    """The outlines of one entity [m], with the data of its contours."""

    outlines: Sequence[Outline]
    where: str  # Name of the entity for messages
    name: str
    layer: str
    clips: tuple[Outline, ...] = ()  # Clips that apply to the entity [m]


class Walk:
    """Base class of the traversals of drawings: selects entities, and makes contours and notes."""

    # Whether the parts of one entity have the same name and are never chained.
    separates_parts = False
    # Whether contours are named by their layer and their number on it, instead of an entity.
    counts_contours = False
    # Whether the notes that the traversal is given are about damage of the file, and so can explain
    # why there is no contour.
    damage_in_notes = True
    # Part of the file that is read, for messages.
    part = ""

    def __init__(self, source: str, options: ReadOptions, progress: Progress | None) -> None:
        self.source = source
        self.options = options
        self.skip = options.skips
        self.requested_layers = options.layer_set
        self.colors = options.color_set
        self.report_fraction = fraction_reporter(progress, source)
        # Names of omitted entities by the reason, with their counts.
        self.omitted: dict[str, Counter[str]] = {}
        # Numbers of entities that are not selected, by layer and by colour.
        self.on_other_layers: Counter[str] = Counter()
        self.of_other_colors: Counter[str] = Counter()

    def omit(self, reason: str, name: str) -> None:
        """Count an omitted entity under a reason, which starts the note."""
        self.omitted.setdefault(reason, Counter())[name] += 1

    def wants_layer(self, layer: str) -> bool:
        """Return whether the options select a layer."""
        return self.requested_layers is None or valid_name(layer) in self.requested_layers

    def wants_color(self, names: frozenset[str]) -> bool:
        """Return whether the options select a colour; otherwise count the entity as omitted."""
        if self.colors is None or names & self.colors:
            return True
        self.of_other_colors[min(names)] += 1
        return False

    @property
    def notes(self) -> list[str]:
        """Sentences on omitted entities."""
        return [f"{why}: {list_counted(x)}." for why, x in self.omitted.items()]

    def explain_empty(self) -> str:
        """Return the text for the error that there is no contour; "" selects the general text."""
        return ""

    def program(self, entities: Iterable[EntityOutlines], notes: Sequence[str]) -> Program:
        """Chain all entities to a program with `notes` and the notes of traversal and chaining."""
        pieces = self._clipped_entities(list(entities))
        contours, chaining_notes = chain_pieces(
            pieces, self.options.join_tolerance, counted=self.counts_contours
        )
        reasons = [*self.notes, *chaining_notes]
        if self.damage_in_notes:
            reasons = [*notes, *reasons]
        notes = [*notes, *self.notes, *chaining_notes]
        if not contours:
            if self.of_other_colors:
                reasons.append(f"Entities of other colours: {list_counted(self.of_other_colors)}.")
            reason = f" ({' '.join(reasons).rstrip('.')})" if reasons else ""
            reason = self.explain_empty() or f"has no contour to follow{self.part}{reason}"
            raise InvalidInput(f"{self.source} {reason}.")
        program = Program(
            moves=tuple(contours),
            source=self.source,
            notes=tuple(notes),
            remarks=describe_not_run(self.on_other_layers),
            other_layers=tuple(self.on_other_layers),
        )
        return repair_vertices(program, self.options)

    def _clipped_entities(self, entities: Sequence[EntityOutlines]) -> list[DrawnEntity]:
        """Return the paths of all outlines that clips draw, as entities for chaining."""
        options = self.options
        outlines = list(chain.from_iterable(x.outlines for x in entities))
        clips = list(dict.fromkeys(chain.from_iterable(x.clips for x in entities)))
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                paths = paths_of(
                    [*outlines, *clips],
                    options.chord_tolerance,
                    options.join_tolerance,
                    lambda share: self.report_fraction(
                        TRAVERSAL_SHARE + (1 - TRAVERSAL_SHARE) * share
                    ),
                )
        except InvalidInput as error:
            assert error.index is not None
            where = _places_of_outlines(entities, clips)[error.index]
            raise InvalidInput(f"{self.source}: {where}: {error}") from None
        pieces: list[DrawnEntity] = []
        drawn = iter(paths)
        borders = dict(zip(clips, paths[len(paths) - len(clips) :], strict=True))
        for entity in entities:
            parts = [path for path in islice(drawn, len(entity.outlines)) if path is not None]
            if not parts:
                self.omit(NO_SIZE, entity.where)
            for clip in entity.clips:
                parts = self._clip(parts, entity, borders[clip])
            first = len(pieces) + 1
            for k, path in enumerate(parts):
                is_split = len(parts) > 1
                name = (
                    f"{entity.name}[{k + 1}]"
                    if is_split and not self.separates_parts
                    else entity.name
                )
                group = first + k if is_split and self.separates_parts else 0
                piece = DrawnEntity(
                    path=path, name=name, where=entity.where, layer=entity.layer, group=group
                )
                pieces.append(piece)
        return pieces

    def _clip(self, paths: list[Path], entity: EntityOutlines, border: Path | None) -> list[Path]:
        """Return the paths of an entity; none if a clip removes them, in part or completely."""
        drawn = np.zeros(1, np.bool_)
        if border is not None and paths:
            tolerance = self.options.join_tolerance
            drawn = np.concatenate([is_drawn(x, border, tolerance) for x in paths])
        if drawn.all():
            return paths
        if drawn.any() and not self.skip:
            raise InvalidInput(
                f"{self.source}: a clip or viewport cuts {entity.where}. Cut it in the drawing "
                f"program, or {SKIP_ADVICE}."
            )
        self.omit(CUT_OFF, entity.where)
        return []


def _places_of_outlines(entities: Sequence[EntityOutlines], clips: Sequence[Outline]) -> list[str]:
    """Name, for messages, the entity to which each outline belongs, then each clip."""
    places = list[str]()
    for entity in entities:
        places += [entity.where] * len(entity.outlines)
    return places + ["a clip"] * len(clips)


def list_counted(names: Counter[str]) -> str:
    """Return the text that lists the first names, with their counts if above 1: `2 TEXT, HATCH`."""
    return list_some([x if n == 1 else f"{n} {x}" for x, n in names.items()], MAX_NAMED)


def place_outline(outline: Outline, to: Affine) -> tuple[Outline, str]:
    """Image of an outline under an affine map [m], and an error text; "" if it is in range."""
    with np.errstate(over="ignore", invalid="ignore"):
        placed = outline.place(to)
        reach = float(np.abs(placed.bounding_points).max())
    if reach <= MAX_COORDINATE:
        return placed, ""
    return placed, (
        f"has coordinates up to {reach:.3g} m, but at most {MAX_COORDINATE:g} m are allowed. Move "
        "the drawing to the origin in the CAD program, or specify its unit, such as units: mm"
    )
