"""The class `Model`: a CAD model whose edges become contours, and whose parts become obstacles."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from pathlib import Path as FilePath

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import LONGEST_NAME, FloatArray, Immutable
from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import MAX_HAND_WRITTEN, read_bytes
from armcontour.core.quantities import Distance, Name, Tolerance
from armcontour.core.text import list_some, make_printable, shorten
from armcontour.files.length_units import unit_length
from armcontour.files.model.axis_fit import orient
from armcontour.files.model.edge_chains import Chain, make_chains
from armcontour.files.model.edge_paths import make_path
from armcontour.files.model.edge_picking import EdgePicker
from armcontour.files.model.edge_rules import LINE, MODELS, EdgeRule
from armcontour.files.model.edge_selection import (
    MOST_NAMES,
    SelectedEdge,
    Selector,
    fold_of,
    request_of,
)
from armcontour.files.model.kernel_process import ask_kernel
from armcontour.files.model.tables import Request, Tables
from armcontour.files.model.tool_axis import BISECTOR, Bisector, FaceNormal
from armcontour.program import Contour, Program
from armcontour.robot.scene import PART, Mesh, Obstacle

# Largest number of contours of a program for which no rule names edges.
MOST_WITHOUT_RULE = 20
# Largest number of pairs of parts whose seams are listed.
MOST_PAIRS = 20
# Parts whose boxes are farther apart than this do not touch [m].
BOX_GAP = 1e-6
# Number of points of a curve in a picture.
CURVE_POINTS = 49


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelPart:
    """A part of a model.

    Args:
        name: Its name in the file, after the names of the assemblies that contain it.
        color: Colour `#rrggbb`; empty if the file has none.
        extent: Smallest and largest coordinates [m], (2, 3).
        faces: Number of faces.
    """

    name: str
    color: str
    extent: FloatArray
    faces: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelEdge:
    """An edge of a model.

    Args:
        index: Its number in the file, from 1, as in `EdgeRule`.
        kind: "line", "circle", "ellipse" or "curve".
        fold: "convex", "concave", "smooth", "border", or empty for an edge of more than two faces.
        angle: Angle between the outward normals of its faces, negative if concave [rad]; NaN if it
            does not have two faces.
        length: Length [m].
        radius: Radius of a circle [m]; NaN for other curves.
        middle: Point in its middle [m], (3,).
        parts: Names of the parts that have it.
    """

    index: int
    kind: str
    fold: str
    angle: float
    length: float
    radius: float
    middle: FloatArray
    parts: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModelSeam:
    """The seams between two parts that touch.

    Args:
        parts: Names of the parts, as in `EdgeRule.seams`.
        edges: Number of edges along which their surfaces meet.
        length: Length of these edges [m].
        openings: Free distances of the edges along the bisector of their faces [m], as in
            `EdgeRule.open`, (edges,); infinite without a face.
        lengths: Lengths of the edges [m], (edges,).
    """

    parts: tuple[str, str]
    edges: int
    length: float
    openings: FloatArray
    lengths: FloatArray


@checked
def read_model(file: str | FilePath, *, units: str | float | None = None) -> Model:
    """Read a CAD model (STEP), whose edges become contours.

    OCCT reads the file in a process of its own, which requires the extra `cad`.

    >>> model = ac.read_model("box.step")
    >>> model.parts[0].name, len(model.edges)
    ('box', 12)

    Args:
        file: Path of a .step or .stp file.
        units: Unit of the coordinates in the file, such as "mm", or its length in metres. It
            replaces the unit that the file declares. None uses the unit of the file.

    Raises:
        InvalidInput: The file cannot be read or has no surfaces, or the kernel is not installed.
    """
    location = FilePath(file)
    if location.suffix.lower() not in MODELS:
        raise FileError(
            f"{location.name} cannot be read as a model. Its extension must be one of "
            f"{', '.join(MODELS)}."
        )
    content = read_bytes(location, "file", maximum=MAX_HAND_WRITTEN)
    return Model(content, location.name, unit=unit_length(units))


class Model(Immutable):
    """A CAD model in metres, in the coordinates of its file; `read_model` makes it.

    Args:
        content: Content of the file.
        source: Name of the file.
        unit: Length of the unit in the file [m]; None for the one that the file declares.
        rules: Rules that will select edges, so that the file is read only once for them.
        triangles: Whether obstacles will be needed, as well.

    Raises:
        InvalidInput: As in `read_model`.
    """

    def __init__(
        self,
        content: bytes,
        source: str,
        *,
        unit: float | None = None,
        rules: Sequence[EdgeRule] = (),
        triangles: bool = False,
    ) -> None:
        self.source = source
        self._content = content
        self._unit = unit
        self._tables = self._ask(replace(request_of(rules), triangles=triangles))
        self._freeze()

    @cached_property
    def parts(self) -> tuple[ModelPart, ...]:
        """The parts."""
        return tuple(
            ModelPart(name=x.name, color=x.color, extent=x.extent, faces=x.faces)
            for x in self._tables.parts
        )

    @cached_property
    def edges(self) -> tuple[ModelEdge, ...]:
        """The edges of the parts that can become contours."""
        edges = enumerate(self._tables.edges)
        return tuple(self._describe(i) for i, x in edges if x.seam is None and not x.inside)

    @property
    def extent(self) -> FloatArray:
        """Smallest and largest coordinates of all parts [m], (2, 3)."""
        extents = np.array([x.extent for x in self.parts])
        return np.stack([extents[:, 0].min(axis=0), extents[:, 1].max(axis=0)])

    @property
    def unit(self) -> float:
        """Length of the unit that the file declares [m]; NaN if it declares several."""
        return self._tables.unit

    @cached_property
    def touching(self) -> tuple[tuple[str, str], ...]:
        """Pairs of names of parts whose boxes touch, so that they may have seams."""
        pairs: dict[tuple[str, str], None] = {}
        for first, second in combinations(self.parts, 2):
            apart = np.maximum(first.extent[0], second.extent[0]) - np.minimum(
                first.extent[1], second.extent[1]
            )
            if apart.max() <= BOX_GAP and first.name != second.name:
                pairs.setdefault((first.name, second.name))
        return tuple(pairs)

    def seams(self) -> tuple[ModelSeam, ...]:
        """Return the seams between all parts that touch.

        Raises:
            InvalidInput: More than 20 pairs of parts may touch, so finding all seams takes long.
        """
        if len(self.touching) > MOST_PAIRS:
            raise InvalidInput(
                f"{self.source} has {len(self.touching)} pairs of parts that may touch, but seams "
                f"are listed for at most {MOST_PAIRS}. Name two parts in a rule with seams."
            )
        if not self.touching:
            return ()
        tables = self._ask(Request(seams=self.touching))
        seams = []
        for pair in self.touching:
            edges = [x for x in tables.edges if x.seam == pair]
            lengths = np.array([x.length for x in edges])
            seams.append(
                ModelSeam(
                    parts=pair,
                    edges=len(edges),
                    length=float(lengths.sum()),
                    openings=np.array([x.opening for x in edges]),
                    lengths=lengths,
                )
            )
        return tuple(x for x in seams if x.edges)

    def picker(self) -> EdgePicker:
        """Return the edges at which a user can point in a picture, with seams of up to 20 pairs."""
        seams = self.touching if len(self.touching) <= MOST_PAIRS else ()
        tables = self._ask(Request(seams=seams, triangles=True))
        names = tuple(_unique([x.name for x in tables.parts], self.source))
        return EdgePicker(tables=tables, names=names, source=self.source, ask=self._ask)

    def curves(self) -> list[FloatArray]:
        """Return points along each edge of `edges`, for a picture [m], (n, 3) each."""
        points = []
        for edge in self.edges:
            count = 2 if edge.kind == LINE else CURVE_POINTS
            points.append(self._tables.edges[edge.index - 1].curve(np.linspace(0, 1, count)))
        return points

    def select(self, *rules: EdgeRule) -> tuple[ModelEdge, ...]:
        """Return the edges that rules select, in the order of the rules.

        Args:
            rules: The rules; the result is their union.

        Raises:
            InvalidInput: A rule selects no edge; the message names the nearest one.
        """
        selector = self._selector(rules)
        return tuple(self._describe(x.index, selector.tables) for x in selector.select(rules))

    @checked
    def program(
        self,
        *rules: EdgeRule,
        axis: Bisector | None = BISECTOR,
        tolerance: Tolerance = 1e-5,
        join_tolerance: Tolerance = 1e-5,
        repair: Distance = 2e-6,
    ) -> Program:
        """Return a program whose contours are the edges that rules select.

        Edges of a rule whose ends touch become one contour. Lines and circles are exact.

        Args:
            rules: The rules; without rules all edges of the model, at most 20 contours.
            axis: Direction of the tool along the edges: a `Bisector`, a `FaceNormal`, or None for
                contours without tool orientation.
            tolerance: Largest distance between other curves and the contours [m].
            join_tolerance: Distance below which two ends are the same point [m].
            repair: Largest rounding error of coordinates, which must not make corners [m].

        Raises:
            InvalidInput: A rule selects no edge, there are more than 20 contours without a rule, or
                the faces at an edge define no tool axis.
        """
        selector = self._selector(rules)
        selected = selector.select(rules) if rules else selector.without_rule()
        chains = make_chains(selected, selector.tables, join_tolerance)
        if not rules and len(chains) > MOST_WITHOUT_RULE:
            raise InvalidInput(self._describe_choice(len(chains)))
        if not chains:
            raise InvalidInput(f"{self.source} has no edges that can become contours.")
        if isinstance(axis, FaceNormal):
            self._check_faces(selected, selector, axis)
        contours = []
        for number, (name, chain) in enumerate(zip(_names(chains), chains, strict=True), start=1):
            edge_path = make_path(chain, tolerance, repair)
            path = edge_path.path
            if axis is not None:
                path = replace(path, orientation=orient(edge_path, axis))
            layer = chain.rule.layer
            contours.append(Contour(path=path, name=name, number=number, layer=layer))
        return Program(moves=tuple(contours), source=self.source)

    @checked
    def obstacles(
        self, *, margin: Distance | None = None, allow: tuple[Name, ...] = ()
    ) -> tuple[Obstacle, ...]:
        """Return the parts as obstacles that move with the part, as triangles.

        The triangles are within 0.1 mm of the surfaces.

        Args:
            margin: Smallest allowed distance of links and tool [m]; None is that of the scene.
            allow: Names of links and of shapes of the tool that may touch the parts; "tool" is the
                whole tool.
        """
        tables = self._tables
        if not tables.request.triangles:
            tables = self._ask(replace(tables.request, triangles=True))
        names = _unique([x.name for x in tables.parts], self.source)
        return tuple(
            Obstacle(
                name=name,
                shape=Mesh(points=x.points, triangles=x.triangles, source=self.source),
                fixed_to=PART,
                margin=margin,
                allow=allow,
            )
            for name, x in zip(names, tables.parts, strict=True)
            if len(x.triangles)
        )

    def _ask(self, request: Request) -> Tables:
        """Return the answer of the kernel, in the unit of the model."""
        if self._unit is None:
            return ask_kernel(self._content, self.source, request)
        declared = ask_kernel(self._content, self.source, Request()).unit
        if math.isnan(declared):
            raise InvalidInput(
                f"{self.source} declares several units of length, so units cannot replace them. "
                "Remove units, and use scale."
            )
        factor = self._unit / declared
        points = tuple((x / factor, y / factor, z / factor) for x, y, z in request.points)
        answer = ask_kernel(self._content, self.source, replace(request, points=points))
        return answer.scaled(factor, request)

    def _selector(self, rules: Sequence[EdgeRule]) -> Selector:
        """Return the selector for rules, after a question to the kernel if necessary."""
        for rule in rules:
            checks.check_type("rule", rule, EdgeRule)
        needed = request_of(rules)
        tables = self._tables
        if not tables.request.covers(needed):
            tables = self._ask(needed)
        return Selector(tables=tables, source=self.source)

    def _check_faces(
        self, selected: Sequence[SelectedEdge], selector: Selector, axis: FaceNormal
    ) -> None:
        """Check that each edge has one face to which the tool can be perpendicular."""
        for x in selected:
            several = len(selector.tables.edges[x.index].uses) > 1
            if axis.up is None and x.face is None and several:
                raise InvalidInput(
                    f"{selector.describe(x.index)} of {self.source} has two faces, so a tool axis "
                    "perpendicular to one of them requires `up`, or a rule with `face`."
                )

    def _describe(self, index: int, tables: Tables | None = None) -> ModelEdge:
        """Return the description of an edge."""
        tables = tables or self._tables
        edge = tables.edges[index]
        parts = dict.fromkeys(tables.faces[x.face].part for x in edge.uses)
        return ModelEdge(
            index=index + 1,
            kind=edge.kind,
            fold=fold_of(edge),
            angle=edge.turn,
            length=edge.length,
            radius=edge.radius,
            middle=edge.curve(np.array([0.5]))[0],
            parts=tuple(tables.parts[k].name for k in parts),
        )

    def _describe_choice(self, count: int) -> str:
        """Return what the edges of the model are, for a program that needs rules."""
        folds = Counter(x.fold for x in self.edges)
        kinds = Counter(x.kind for x in self.edges)
        parts = dict.fromkeys(x.name for x in self.parts)
        rows = [
            ("fold", ", ".join(f"{n} {name}" for name, n in folds.items() if name)),
            ("kind", ", ".join(f"{n} {name}" for name, n in kinds.items())),
            ("part", list_some(list(parts), MOST_NAMES)),
        ]
        table = "; ".join(f"{name}: {values}" for name, values in rows)
        return (
            f"The edges of {self.source} would become {count} contours, but without a rule at most "
            f"{MOST_WITHOUT_RULE} are allowed. Name edges with path.edges, for example by seams of "
            f"two parts, fold, kind, face or near. The file has {table}. armcontour show "
            f"{self.source} lists all edges."
        )


def _names(chains: Sequence[Chain]) -> list[str]:
    """Return the names of contours: the label of their rule, numbered if it has several."""
    labels = [x.rule.label for x in chains]
    counts = Counter(labels)
    used: Counter[str] = Counter()
    names = []
    for label in labels:
        used[label] += 1
        name = f"{label} {used[label]}" if counts[label] > 1 else label
        names.append(shorten(make_printable(name), LONGEST_NAME))
    return names


def _unique(names: Sequence[str], default: str) -> list[str]:
    """Return printable names, numbered where they repeat; `default` replaces empty ones."""
    counts = Counter(names)
    used: Counter[str] = Counter()
    unique = []
    for name in names:
        used[name] += 1
        text = make_printable(name) or default
        ending = f" {used[name]}" if counts[name] > 1 else ""
        unique.append(shorten(text, LONGEST_NAME - len(ending)) + ending)
    return unique
