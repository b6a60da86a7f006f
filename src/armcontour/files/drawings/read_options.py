"""Options of all readers for drawings, and their shared functions for names, colours, progress."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import LONGEST_NAME, BoolArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.file_access import MAX_HAND_WRITTEN
from armcontour.core.frames import angle_between
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import NO_KEY, Choice, Distance, Factor, Tolerance
from armcontour.core.text import digits, make_printable, shorten
from armcontour.files.colors import color_of
from armcontour.files.length_units import unit_length
from armcontour.files.model.edge_rules import EdgeRule
from armcontour.files.model.tool_axis import BISECTOR, Bisector
from armcontour.geometry import Path, SegmentLimits, Segments
from armcontour.geometry.rounding.tangent_repair import LARGEST_KINK, RepairedPath, repair_tangents
from armcontour.geometry.segments import TANGENT_TOLERANCE
from armcontour.program import Contour, Program
from armcontour.program.moves import Move, Value, put_on_path

# Maximum size of a file [bytes]. The data structures need many times the size of the file.
MAX_FILE_SIZE = MAX_HAND_WRITTEN
# Advice in messages to set `unknown` to "skip".
SKIP_ADVICE = "skip it (unknown: skip, or --skip-unknown)"
ReportFraction = Callable[[float], None]
# Largest coordinate [m]. Above this value, doubles do not resolve the smallest distance between
# two points; a drawing with such coordinates has a wrong unit.
MAX_COORDINATE = 1e6
UNKNOWN = ("refuse", "skip")
# Meanings of the word P of an arc in G-code.
ARC_TURNS = ("total", "extra")


def fraction_reporter(progress: Progress | None, source: str) -> ReportFraction:
    """Return a function that reports the fraction of a file that is read, per whole percent."""
    if progress is None:
        return lambda share: None
    report_step = subprogress(progress, source)
    reported = -1

    def report_fraction(fraction: float) -> None:
        """Report a fraction from 0 to 1, if it is the first of its whole percent."""
        nonlocal reported
        percent = int(100 * min(fraction, 1.0))
        if percent > reported:
            reported = percent
            report_step(Step((), percent / 100))

    return report_fraction


def valid_name(name: str) -> str:
    """Make a name in a drawing printable, and shorten it to the length of a valid name."""
    return shorten(make_printable(name), LONGEST_NAME)


@declared()
class ReadOptions(Checked):
    """Options for reading a drawing, G-code or a table of waypoints.

    >>> options = ac.ReadOptions(units="mm", layers=["CUT"])
    >>> options.units
    'mm'

    Args:
        units: Unit of the lengths in the file, such as "mm", or the length of the unit in metres.
            It replaces the unit that a drawing specifies, but not the unit of a table column. None
            uses the unit of the file.
        scale: Factor for all lengths in the file.
        layers: Layers to read, or a mapping from layers to the speed and tolerance of their
            contours, for segments that have none. Layers of a mapping that do not exist are
            ignored.
        names: Names of contours to read: ids of elements (SVG), "CUT-3" for the third contour of
            the layer CUT (DXF), "line 12" (G-code).
        colors: Colours of DXF entities, or of strokes in SVG, to read: names, "#rrggbb", and for
            DXF also AutoCAD's numbers.
        ignore_z: Whether to ignore z and the tool orientation in the file.
        chord_tolerance: Maximum distance between a curve and the arcs that replace it [m].
        join_tolerance: Distance below which two ends are the same point, and by which an outline
            may be beyond its clip [m].
        repair_vertices: Largest rounding error of coordinates [m]. A vertex is made tangent, with a
            note, if an error of this size can explain its turn. Short moves along a line become
            one line. The default suits three decimals of a millimetre and four of an inch. 0
            changes no vertex.
        columns: For waypoints in CSV, names of the columns, such as "x [mm],y [mm],-". They replace
            the first line of the file or a missing heading; "-" skips a column.
        edges: For CAD models (STEP), the edges that become contours: one rule, or a list of rules
            whose union is read. Without rules all edges are read, at most 20 contours.
        tool_axis: For CAD models, the direction of the tool along edges; by default the `Bisector`
            of the faces. None reads contours without tool orientation.
        words: For G-code, G and M codes that switch outputs, with the states that they set by the
            name of the output, such as {"M101": {"arc": True}, "M103": {"arc": False}}. A code with
            an empty mapping is ignored, with a note.
        arc_turns: For G-code, the meaning of the word P of an arc: "total" counts all turns, as in
            LinuxCNC and FluidNC, "extra" the full circles before the arc, as in Marlin. By default
            a comment of the file that names one of them decides.
        unknown: Whether to "refuse" unknown elements of drawings and unknown columns of tables, or
            "skip" them with a note.

    Raises:
        InvalidInput: A unit, word or choice is unknown, or a number is out of range.
    """

    units: str | float | None = None
    scale: Factor = 1.0
    layers: Sequence[str] | Mapping[str, SegmentLimits] | None = None
    names: Sequence[str] | None = None
    colors: Sequence[str | int] | None = None
    ignore_z: bool = False
    chord_tolerance: Tolerance = 1e-5
    join_tolerance: Tolerance = 1e-5
    repair_vertices: Distance = 2e-6
    columns: str | None = None
    edges: Sequence[EdgeRule] | EdgeRule | None = None
    tool_axis: Annotated[Bisector | None, NO_KEY] = BISECTOR
    words: Mapping[str, Mapping[str, Value]] | None = None
    arc_turns: Annotated[str, Choice(ARC_TURNS)] | None = None
    unknown: Annotated[str, Choice(UNKNOWN)] = "refuse"

    def _check_together(self) -> None:
        if self.edges is not None and not isinstance(self.edges, EdgeRule):
            noun = "EdgeRules, or one EdgeRule"
            rules = checks.check_sequence("edges", self.edges, EdgeRule, noun)
            object.__setattr__(self, "edges", rules)
        # The properties raise errors for invalid options before a file is read.
        _ = self.unit, self.layer_set, self.color_set, self.rules

    @property
    def unit(self) -> float | None:
        """Length of the specified unit [m]; None if the unit of the file is used."""
        return unit_length(self.units)

    @property
    def rules(self) -> tuple[EdgeRule, ...]:
        """The rules that select edges of models."""
        if self.edges is None:
            return ()
        if not isinstance(self.edges, EdgeRule) and not self.edges:
            raise InvalidInput(
                "edges must have at least one rule, such as {kind: circle}, but is empty. Without "
                "the key, all edges are read.",
                key=("edges",),
            )
        return (self.edges,) if isinstance(self.edges, EdgeRule) else tuple(self.edges)

    @property
    def skips(self) -> bool:
        """True if unknown elements are skipped."""
        return self.unknown == "skip"

    @property
    def layer_set(self) -> frozenset[str] | None:
        """Names of the selected layers; None if all layers are selected."""
        if self.layers is None:
            return None
        names = [self.layers] if isinstance(self.layers, str) else self.layers
        names = list(names) if isinstance(names, Mapping) else names
        return frozenset(checks.check_names("layers", names))

    @property
    def layer_tolerances(self) -> dict[str, float]:
        """Maximum permitted corner errors [m] by layer name, for the layers that have one."""
        limits = self.layers if isinstance(self.layers, Mapping) else {}
        return {name: x.tolerance for name, x in limits.items() if x.tolerance is not None}

    @property
    def color_set(self) -> frozenset[str] | None:
        """The selected colours as names by `color_of`; None if all colours are selected."""
        if self.colors is None:
            return None
        if not self.colors:
            raise InvalidInput(
                'colors must have at least one colour, such as ["red", "#00ff00"], but is empty.'
            )
        return frozenset(color_of(str(x)) for x in self.colors)


def repair_vertices(program: Program, options: ReadOptions) -> Program:
    """Make vertices tangent if rounding of coordinates can explain their turn, and add a note."""
    # Contours with a tool orientation are not changed.
    moves: list[Move] = list(program.moves)
    tolerances = options.layer_tolerances
    changed = []
    paths = [x.path for x in moves if isinstance(x, Contour)]
    needed = iter(_may_have_repairs(paths, options.repair_vertices).tolist())
    for i, move in enumerate(moves):
        if not isinstance(move, Contour) or not next(needed) or move.path.orientation is not None:
            continue
        tolerance = tolerances.get(move.layer, math.inf)
        repaired = repair_tangents(move.path, options.repair_vertices, tolerance)
        if repaired is not None:
            changed.append(repaired)
            moves[i] = put_on_path(move, repaired.path, repaired.place)
    if not changed:
        return program
    notes = (*program.notes, _describe_repairs(changed))
    return dataclasses.replace(program, moves=tuple(moves), notes=notes)


def _may_have_repairs(paths: Sequence[Path], tolerance: float) -> BoolArray:
    """Mask of the paths that `repair_tangents` may change, for all in a fraction of its time."""
    table = Segments.join([x.segments for x in paths])
    after = np.append(np.arange(1, len(table)), 0)
    firsts = np.cumsum([0, *map(len, paths)])
    after[firsts[1:] - 1] = firsts[:-1]
    turns = angle_between(table.end_tangents, table.tangents[after])
    # Nearly tangent vertices are repaired, and lines are merged at vertices that are no corners.
    changed = (turns > TANGENT_TOLERANCE) & (turns <= LARGEST_KINK)
    shorter = np.minimum(table.lengths, table.lengths[after])
    lines = (table.curvatures == 0) & (table.curvatures[after] == 0) & (turns < np.pi / 2)
    changed |= (lines & (shorter * np.sin(turns) <= 4 * tolerance)) | table.is_transition
    return np.logical_or.reduceat(changed, firsts[:-1])


def _describe_repairs(done: list[RepairedPath]) -> str:
    """Return a note on the number, turn and displacement of the repaired vertices."""
    count = sum(x.count for x in done)
    kink, deviation = (max(getattr(x, y) for x in done) for y in ("kink", "deviation"))
    vertices = f"{count} vertices" if count > 1 else "1 vertex"
    return (
        f"Repaired {vertices} whose turn of at most {digits(math.degrees(kink), 2)}° can be "
        "explained by rounded coordinates. The path is tangent there, and deviates from the path "
        f"of the file by at most {digits(deviation * 1e3, 2)} mm. With path.repair_vertices: 0 mm "
        "the turns stay, and the tool stops there."
    )
