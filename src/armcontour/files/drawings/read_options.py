"""Options of all readers of drawings, and the names, colours and progress that they share."""

from __future__ import annotations

import dataclasses
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

from armcontour.core import checks
from armcontour.core.checks import LONGEST_NAME
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.file_access import SMALL
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import (
    About,
    AngularDistance,
    Choice,
    Distance,
    Factor,
    Length,
    Tolerance,
)
from armcontour.core.text import digits, make_printable, show
from armcontour.files.units import parse_quantity
from armcontour.geometry import SegmentLimits
from armcontour.geometry.rounded_path import Continuity
from armcontour.geometry.tangent_repair import RepairedPath, repair_tangents
from armcontour.program import Contour, Program
from armcontour.program.moves import Move

# Largest file that is read [bytes]: the data structures made from it take many times its size.
LARGEST = SMALL
# Length of a name that is cut [characters]; a number is appended if two cut names are equal.
KEPT = LONGEST_NAME - 12
# Advice in messages to choose "skip".
SKIP = "skip it (unknown: skip, or --skip-unknown)"
# Names of CSS that drawings for lasers and plotters use; other names are used as written.
NAMED = {
    "black": "#000000",
    "white": "#ffffff",
    "red": "#ff0000",
    "lime": "#00ff00",
    "green": "#008000",
    "blue": "#0000ff",
    "yellow": "#ffff00",
    "cyan": "#00ffff",
    "aqua": "#00ffff",
    "magenta": "#ff00ff",
    "fuchsia": "#ff00ff",
    "orange": "#ffa500",
    "purple": "#800080",
    "gray": "#808080",
    "grey": "#808080",
    "silver": "#c0c0c0",
    "navy": "#000080",
    "maroon": "#800000",
}
_SHORT = re.compile(r"#([0-9a-f])([0-9a-f])([0-9a-f])")
_RGB = re.compile(r"rgb\(\s*([\d.]+)(%?)[\s,]+([\d.]+)%?[\s,]+([\d.]+)%?\s*\)")


Tell = Callable[[float], None]


def fraction_reporter(progress: Progress | None, source: str) -> Tell:
    """A function that reports the fraction of a file that is read, in whole percents."""
    if progress is None:
        return lambda share: None
    say, shown = subprogress(progress, source), -1

    def tell(fraction: float) -> None:
        nonlocal shown
        percent = int(100 * min(fraction, 1.0))
        if percent > shown:
            shown = percent
            say(Step((), percent / 100))

    return tell


@dataclass(slots=True)
class Labels:
    """Converts names of entities and layers to names that contours can have."""

    # A name that is too long is cut, and characters that are not printable become escapes: some CAD
    # programs write such names, and the user cannot change them. Different names stay different.

    _changed: dict[str, str] = field(default_factory=dict)
    _alike: Counter[str] = field(default_factory=Counter)

    def __call__(self, name: str) -> str:
        """The name of a contour or layer for a name in the drawing."""
        if len(name) <= LONGEST_NAME and name.isprintable():
            return name
        if name not in self._changed:
            self._changed[name] = self._fitted(name)
        return self._changed[name]

    def _fitted(self, name: str) -> str:
        """A printable, unique name of at most `LONGEST_NAME` characters."""
        plain = make_printable(name[: LONGEST_NAME + 1])
        short = len(name) <= LONGEST_NAME and len(plain) <= LONGEST_NAME
        first = plain if short else f"{plain[:KEPT]}..."
        self._alike[first] += 1
        count = self._alike[first]
        return first if count == 1 else f"{plain[:KEPT]}... ({count})"

    @property
    def notes(self) -> list[str]:
        """Notes on changed names; empty if there are none."""
        if not self._changed:
            return []
        name, label = next(iter(self._changed.items()))
        return [
            f"Names that have more than {LONGEST_NAME} characters, or some that are not printable, "
            f"were changed ({len(self._changed)}), such as {show(name)} to '{label}'."
        ]


def color_of(text: str) -> str:
    """A colour as `#rrggbb`, from a name, #rgb, #rrggbb or rgb(r, g, b); else lower-case text."""
    plain = text.strip().lower()
    if short := _SHORT.fullmatch(plain):
        return "#" + "".join(2 * x for x in short.groups())
    if parts := _RGB.fullmatch(plain):
        factor = 2.55 if parts[2] else 1.0
        return hex_of(*(min(round(float(parts[k]) * factor), 255) for k in (1, 3, 4)))
    return NAMED.get(plain, plain)


def hex_of(red: int, green: int, blue: int) -> str:
    """A colour as `#rrggbb`, from its parts from 0 to 255."""
    return f"#{red:02x}{green:02x}{blue:02x}"


# Largest coordinate [m]: beyond it floating point does not resolve the smallest distance between
# two points. Such a drawing has a wrong unit.
FARTHEST = 1e6
# Largest number of a tool: tables have some hundred, and G-code eight digits at most.
MAX_TOOLS = 99_999_999
UNKNOWN = ("refuse", "skip")
TEXTS = ("leave_out", "contours")
# Share of the chord tolerance that arcs take where transitions between them take the rest.
FIT_SHARE = 0.5
# Codes and letters of G-code that can be skipped by name.
WORD = re.compile(r"[GM]\d{1,4}(\.\d)?|[ABCDEHLPQSTUVW]")


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class ReadOptions(Checked):
    """Options for reading a drawing, G-code or a table of waypoints.

    >>> options = ac.ReadOptions(units="mm", layers=["CUT"])
    >>> options.units
    'mm'

    Args:
        units: Unit of the file's lengths, such as "mm", or its length in metres; replaces the unit
            that a drawing gives. None takes that unit. A table column with its own
            unit keeps it.
        scale: Factor of the file's lengths; tools keep their diameters.
        layers: Layers to read. Or a mapping from layers to speed and tolerance of their contours,
            for segments without their own values; missing layers are ignored.
        names: Names of contours to read: ids of elements (SVG), handles of entities (DXF), "line
            12" (G-code).
        colors: Colours of DXF entities, or of strokes in SVG, to read: names, "#rrggbb", and for
            DXF also AutoCAD's numbers.
        ignore_z: Whether to remove z and the tool orientation of the file.
        chord_tolerance: Largest distance between a curve and the arcs that replace it [m].
        join_tolerance: Distance below which two ends are one point [m].
        mend_vertices: Largest rounding error of coordinates [m]: vertices whose turn such an error
            can explain are made tangent within it, with a note. The default suits three decimals
            of a millimetre and four of an inch; 0 changes no vertex.
        smooth_axes: For tables of waypoints with tool axes, the largest correction that makes noisy
            measured axes turn smoothly [rad]; 0 leaves the axes unchanged.
        columns: For waypoints in CSV, names of the columns in place of the first line, or of a line
            that is missing, such as "x [mm],y [mm],-"; "-" skips a column.
        unknown: Whether to refuse elements that the reader does not know, or skip them with a note;
            for G-code, `{skip: [T, M6]}` skips these words.
        texts: For DXF, "contours" draws the letters of TEXT through a font of this machine, with a
            note; "leave_out" skips texts with a note.
        tools: For G41 and G42 of G-code, diameters of tools [m] by their numbers, such as
            `{1: 0.003}`; a negative diameter offsets the tool to the other side.
        continuity: "curvature" puts transitions where the curvature jumps without a corner, for
            motions with a limit of jerk (`smooth_curvature`): curves then become arcs within half
            of the chord tolerance, and transitions leave lines and arcs by the other half at most.
            "tangent" keeps lines and arcs.

    Raises:
        InvalidInput: An unknown unit, word or choice, or a number out of range.
    """

    units: Annotated[str | float | None, About("--units")] = None
    scale: Annotated[Factor, About("--scale")] = 1.0
    layers: Annotated[Sequence[str] | Mapping[str, SegmentLimits] | None, About("--layer")] = None
    names: Annotated[Sequence[str] | None, About("--contour")] = None
    colors: Annotated[Sequence[str | int] | None, About("--color")] = None
    ignore_z: Annotated[bool, About("--ignore-z")] = False
    chord_tolerance: Tolerance = 1e-5
    join_tolerance: Tolerance = 1e-5
    mend_vertices: Distance = 2e-6
    smooth_axes: AngularDistance = 0.0
    columns: Annotated[str | None, About("--waypoint-columns")] = None
    unknown: Annotated[
        Annotated[str, Choice(UNKNOWN)] | Mapping[Literal["skip"], Sequence[str]],
        About("--skip-unknown", help="Skip unknown elements.", read="to_skip"),
        About("--skip", "G-code", "Words of G-code to skip: 'T,M6'.", "to_words"),
    ] = "refuse"
    texts: Annotated[str, Choice(TEXTS), About("--texts")] = "leave_out"
    tools: Annotated[
        Mapping[int, Length] | None,
        About(
            "--tool-diameter",
            "G-code",
            "Number and diameter of a tool, for G41: '1: 3 mm'.",
            "to_tools",
        ),
    ] = None
    continuity: Continuity = "tangent"

    def _check_together(self) -> None:
        # Invalid options are refused before any file is read.
        _ = self.unit, self.layer_set, self.color_set, self.words, self.unscaled_tools

    @property
    def unit(self) -> float | None:
        """Length of the unit of the file [m]; None takes that of the file."""
        if isinstance(self.units, str):
            try:
                return parse_quantity(f"1 {self.units}", "m")
            except ValueError:
                raise InvalidInput(
                    f"units must be a unit of length such as mm, not {self.units!r}."
                ) from None
        return None if self.units is None else checks.positive("units", self.units, "m")

    @property
    def fit_tolerance(self) -> float:
        """Largest distance between a curve and its arcs [m]; transitions may add the rest."""
        fraction = 1.0 if self.continuity == "tangent" else FIT_SHARE
        return fraction * self.chord_tolerance

    @property
    def skips(self) -> bool:
        """True if elements that the reader does not know are skipped."""
        return self.unknown == "skip"

    @property
    def words(self) -> frozenset[str]:
        """Words and codes of G-code to skip, such as G43 or T."""
        if isinstance(self.unknown, str):
            return frozenset()
        if list(self.unknown) != ["skip"]:
            raise InvalidInput(
                'unknown must be "refuse", "skip", or {"skip": [...]} with the words of G-code to '
                f"skip, such as M6 or T, not {show(self.unknown)}."
            )
        words = checks.check_sequence("unknown: skip", self.unknown["skip"], str, "words of G-code")
        plain = {x.strip().upper() for x in words}
        wrong = next((x for x in sorted(plain) if WORD.fullmatch(x) is None), None)
        if wrong is not None:
            raise InvalidInput(
                f"unknown: {{skip: ...}} names {wrong!r}, which cannot be skipped: it takes codes "
                "such as G43 or M6, and letters other than X, Y, Z, I, J, K, R, F, N and O."
            )
        return frozenset(re.sub(r"(?<=[GM])0+(?=\d)", "", x) for x in plain)

    @property
    def layer_set(self) -> frozenset[str] | None:
        """The names of layers; None for all layers."""
        if self.layers is None:
            return None
        names = [self.layers] if isinstance(self.layers, str) else self.layers
        names = list(names) if isinstance(names, Mapping) else names
        return frozenset(checks.check_names("layers", names))

    @property
    def layer_tolerances(self) -> dict[str, float]:
        """Largest corner errors on layers that have one [m], by their names."""
        limits = self.layers if isinstance(self.layers, Mapping) else {}
        return {name: x.tolerance for name, x in limits.items() if x.tolerance is not None}

    @property
    def color_set(self) -> frozenset[str] | None:
        """The colours as `color_of` names them; None for all colours."""
        if self.colors is None:
            return None
        if not self.colors:
            raise InvalidInput('colors must be one colour or more, such as ["red", "#00ff00"].')
        return frozenset(color_of(str(x)) for x in self.colors)

    @property
    def unscaled_tools(self) -> dict[int, float]:
        """Diameters of tools by their numbers, in metres of the file before it is scaled."""
        return {
            checks.check_int("number of a tool", number, 0, MAX_TOOLS): diameter / self.scale
            for number, diameter in (self.tools or {}).items()
        }


def repair_vertices(program: Program, options: ReadOptions) -> Program:
    """The program with vertices made tangent that rounded coordinates can have bent."""
    # Contours with a tool orientation stay.
    moves: list[Move] = list(program.moves)
    tolerances, changed = options.layer_tolerances, []
    for i, move in enumerate(moves):
        if not isinstance(move, Contour) or move.path.orientation is not None:
            continue
        tolerance = tolerances.get(move.layer, math.inf)
        mended = repair_tangents(move.path, options.mend_vertices, tolerance)
        if mended is not None:
            changed.append(mended)
            events = tuple(dataclasses.replace(y, s=float(mended.place(y.s))) for y in move.events)
            moves[i] = dataclasses.replace(move, path=mended.path, events=events)
    if not changed:
        return program
    notes = (*program.notes, _note(changed))
    return dataclasses.replace(program, moves=tuple(moves), notes=notes)


def _note(done: list[RepairedPath]) -> str:
    """A note on the repaired vertices."""
    count = sum(x.count for x in done)
    kink, deviation = (max(getattr(x, y) for x in done) for y in ("kink", "deviation"))
    vertices = f"{count} vertices" if count > 1 else "1 vertex"
    return (
        f"Repaired {vertices} whose turn of at most {digits(math.degrees(kink), 2)}° can be "
        "explained by rounded coordinates: the path is tangent there, at most "
        f"{digits(deviation * 1e3, 2)} mm from the file's (path.mend_vertices: 0 mm keeps such "
        "turns, at which the tool stops)."
    )
