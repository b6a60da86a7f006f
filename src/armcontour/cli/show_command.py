"""The command `show`: size and layers of a drawing, or parts and edges of a CAD model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Show
from armcontour.cli.console import table_lines
from armcontour.cli.inputs import naming_options_in_errors, read_patch, refuse_existing
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.files.drawings.path_reader import read_path
from armcontour.files.file_keys import read_keys
from armcontour.files.job_model import PathModel
from armcontour.files.job_path import is_model, tool_axis_of
from armcontour.files.model import Model, ModelEdge
from armcontour.program import Program

# A smaller size in z [mm] is shown as 0.00, so it is omitted.
MIN_SHOWN_HEIGHT = 5e-3
# Largest number of edges that the table of a model lists; --json lists all.
MOST_EDGES = 60


def show(options: Show, _: None, progress: Progress) -> Outcome:
    """Print size and layers of a drawing, or parts, seams and edges of a CAD model."""
    keys, names = _read_keys(options)
    if is_model(keys):
        return _show_model(options, keys, names)
    for name in ("out", "force"):
        if getattr(options, name):
            raise InvalidInput(f"--{name} requires a CAD model (.step, .stp).")
    if keys.orientation is not None:
        raise InvalidInput("--orientation requires a CAD model (.step, .stp).")
    program = read_path(options.drawing, keys, progress=progress)
    page = _describe(program)
    lines = [
        f"{options.drawing.name}: {_size_text(page['extent'])}",
        *_layer_table(page),
        *(f"Note: {x}" for x in program.notes),
    ]
    return Outcome(lines=lines, page=page)


def _read_keys(options: Show) -> tuple[PathModel, dict[str, str]]:
    """Read the options of the command as keys of a path, and the options by their keys."""
    patch, names = read_patch(options)
    data = {str(key): value for (_, key), value in patch.items()}
    names_without_path = {key.removeprefix("path."): option for key, option in names.items()}
    with naming_options_in_errors(names_without_path), error_context(options.drawing.name):
        keys: PathModel = read_keys(PathModel, data)
    return replace(keys, file=str(options.drawing)), names


def _size_text(extent: Sequence[Sequence[float]]) -> str:
    """Return the size and the lowest corner of an extent [m] as text."""
    low, high = np.array(extent) * 1e3
    sides = [x for k, x in enumerate(high - low) if k < 2 or x >= MIN_SHOWN_HEIGHT]
    size = " x ".join(f"{x:.2f}" for x in sides)
    corner = ", ".join(f"{x:z.2f}" for x in low)
    return f"{size} mm from {corner} mm"


def _layer_table(page: dict[str, Any]) -> list[str]:
    """Return the table of layers."""
    rows = [
        (layer or "-", str(x["contours"]), str(x["closed"]), f"{x['length'] * 1e3:.2f}")
        for layer, x in page["layers"].items()
    ]
    return table_lines([("layer", "contours", "closed", "length [mm]"), *rows])


def _describe(program: Program) -> dict[str, Any]:
    """Return the size, layers and notes of a drawing as a mapping for JSON, in SI units."""
    extents = np.array([x.path.segments.extent for x in program.contours])
    layers: dict[str, dict[str, Any]] = {}
    for contour in program.contours:
        layer = layers.setdefault(contour.layer, {"contours": 0, "closed": 0, "length": 0.0})
        layer["contours"] += 1
        layer["closed"] += contour.closed
        layer["length"] += contour.path.length
    return {
        "dimension": program.dimension,
        "length": program.length,
        "extent": [extents[:, 0].min(axis=0).tolist(), extents[:, 1].max(axis=0).tolist()],
        "layers": layers,
        "notes": list(program.notes),
    }


def _show_model(options: Show, keys: PathModel, names: dict[str, str]) -> Outcome:
    """Print parts, seams and edges of a CAD model, and the contours that rules select."""
    from armcontour.files.model.cad_model import read_model

    model = read_model(options.drawing, units=keys.units)
    program = None
    if keys.rules:
        with naming_options_in_errors(names):
            keys = replace(keys, tool_axis=tool_axis_of(keys))
            program = read_path(options.drawing, keys)
    seams, notes = _seam_rows(model)
    lines = [
        f"{options.drawing.name}: {_size_text(model.extent.tolist())}, "
        f"{_unit_text(model.unit, keys)}",
        *_part_table(model),
        *seams,
        *_edge_table(model.edges),
        *(_contour_table(program) if program is not None else ()),
        *(f"Note: {x}" for x in notes),
    ]
    if options.out is not None:
        refuse_existing(options.out, options.force)
        _draw(options.out, options.drawing.name, model, program, keys.scale)
        lines.append(f"Picture: {options.out.resolve().as_uri()}")
    return Outcome(lines=lines, page=_model_page(model, program, notes))


def _unit_text(unit: float, keys: PathModel) -> str:
    """Return the unit of a file as text."""
    if keys.units is not None:
        return f"in {keys.units} as specified"
    if math.isnan(unit):
        return "in several units"
    return f"in units of {unit * 1e3:g} mm"


def _part_table(model: Model) -> list[str]:
    """Return the table of parts."""
    rows: list[tuple[str, ...]] = [("part", "x [mm]", "y [mm]", "z [mm]", "faces", "colour")]
    for part in model.parts:
        size = np.ptp(part.extent, axis=0) * 1e3
        rows.append(
            (part.name or "-", *(f"{x:.2f}" for x in size), str(part.faces), part.color or "-")
        )
    return table_lines(rows)


def _seam_rows(model: Model) -> tuple[list[str], list[str]]:
    """Return the table of seams, and a note if there are too many pairs of parts."""
    try:
        seams = model.seams()
    except InvalidInput as error:
        return [], [str(error)]
    if not seams:
        return [], []
    rows = [("seams", "edges", "length [mm]", "longest free distances [mm]")]
    for seam in seams:
        free = sorted(set(seam.openings.round(4).tolist()), reverse=True)[:3]
        texts = ["unlimited" if math.isinf(x) else f"{x * 1e3:.4g}" for x in free]
        rows.append(
            (", ".join(seam.parts), str(seam.edges), f"{seam.length * 1e3:.2f}", ", ".join(texts))
        )
    return table_lines(rows), []


def _edge_table(edges: Sequence[ModelEdge]) -> list[str]:
    """Return the table of edges; if there are many, the table of their kinds."""
    if len(edges) > MOST_EDGES:
        return [*_kind_table(edges), f"{len(edges)} edges; --json lists all."]
    rows = [("edge", "kind", "fold", "angle [deg]", "length [mm]", "radius [mm]", "middle [mm]")]
    for x in edges:
        middle = ", ".join(f"{v:z.2f}" for v in x.middle * 1e3)
        angle = "-" if math.isnan(x.angle) else f"{math.degrees(x.angle):z.1f}"
        length = f"{x.length * 1e3:.2f}"
        rows.append((str(x.index), x.kind, x.fold or "-", angle, length, _radius_text(x), middle))
    return table_lines(rows)


def _kind_table(edges: Sequence[ModelEdge]) -> list[str]:
    """Return the table of kinds of edges, the most frequent ones first."""
    groups: dict[tuple[str, str, str], list[ModelEdge]] = {}
    for x in edges:
        groups.setdefault((x.kind, x.fold or "-", _radius_text(x)), []).append(x)
    rows = [("edges", "fold", "radius [mm]", "number", "length [mm]")]
    for (kind, fold, radius), group in sorted(groups.items(), key=lambda x: -len(x[1])):
        length = sum(x.length for x in group) * 1e3
        rows.append((kind, fold, radius, str(len(group)), f"{length:.2f}"))
    return table_lines(rows[: MOST_EDGES + 1])


def _radius_text(edge: ModelEdge) -> str:
    """Return the radius of an edge in mm as text."""
    return "-" if math.isnan(edge.radius) else f"{edge.radius * 1e3:.3f}"


def _contour_table(program: Program) -> list[str]:
    """Return the table of selected contours."""
    rows = [("contour", "layer", "closed", "length [mm]", "stops inside")]
    for x in program.contours:
        closed = "yes" if x.closed else "no"
        length = f"{x.path.length * 1e3:.2f}"
        rows.append((x.name, x.layer or "-", closed, length, str(len(x.path.stops))))
    return table_lines(rows)


def _draw(file: FilePath, name: str, model: Model, program: Program | None, scale: float) -> None:
    """Write the picture of a model."""
    from armcontour.report.model_drawing import draw_model

    curves = [x * scale for x in model.curves()]
    numbers = [x.index for x in model.edges]
    draw_model(name, curves, numbers, program).write_html(file)


def _model_page(model: Model, program: Program | None, notes: Sequence[str]) -> dict[str, Any]:
    """Return parts, edges and contours as a mapping for JSON, in SI units."""
    page: dict[str, Any] = {
        "extent": model.extent.tolist(),
        "unit": None if math.isnan(model.unit) else model.unit,
        "parts": [
            {"name": x.name, "color": x.color, "extent": x.extent.tolist(), "faces": x.faces}
            for x in model.parts
        ],
        "edges": [
            {
                "index": x.index,
                "kind": x.kind,
                "fold": x.fold,
                "angle": None if math.isnan(x.angle) else x.angle,
                "length": x.length,
                "radius": None if math.isnan(x.radius) else x.radius,
                "middle": x.middle.tolist(),
                "parts": list(x.parts),
            }
            for x in model.edges
        ],
        "notes": list(notes),
    }
    if program is not None:
        page["contours"] = [
            {"name": x.name, "layer": x.layer, "closed": x.closed, "length": x.path.length}
            for x in program.contours
        ]
    return page
