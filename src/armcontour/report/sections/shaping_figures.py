"""Figures of a shaped path: the whole path magnified, and distance, speed and time along it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path, ShapedPath
from armcontour.geometry.shaped import ARCS
from armcontour.motion import Trajectory
from armcontour.report.figure import Figure, make_subplots
from armcontour.report.outline import simplify
from armcontour.report.sections.scene import ROW, buttons, row_label
from armcontour.report.sections.shape_comparison import (
    Variant,
    across,
    distances,
    sharp_vertices,
)
from armcontour.report.sections.tolerance import draw_tube, tube_outline, tube_pieces
from armcontour.report.style import PATH_COLOUR, finish, line, thin

SHAPED_LOOK: dict[str, Any] = {"colour": "#0072B2", "width": 2.5}
ARCS_LOOK: dict[str, Any] = {"colour": "#D55E00", "width": 1.8, "dash": "dash"}
OTHER_LOOK: dict[str, Any] = {"colour": "#009E73", "width": 1.8, "dash": "dot"}
# Of arcs, if they are drawn, and of the shaped path.
LOOKS = (ARCS_LOOK, SHAPED_LOOK)
ARCS_NAME = "arcs of the same tolerance"
# Magnified, the tolerance is at most this share of the picture at first.
MAGNIFIED = 0.12
MAGNIFICATIONS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10000)
# Number of larger magnifications to choose from.
MORE = 2
# Largest number of points of a magnified path, which is stored once per magnification, and of
# pieces of a magnified tube.
MOST_DRAWN = 800
MOST_PIECES = 150
# Largest number of vertices that are marked; more would hide the curves.
MOST_MARKED = 100


def magnified(path: ShapedPath, variants: Mapping[str, Variant]) -> Any:
    """The whole path in the plane, with magnified distances from the objective path.

    Args:
        path: The shaped path.
        variants: The arcs, if there are any, and the shaped path, by their names in the legend.
    """
    objective = path.objective
    factors, first = _magnifications(path)
    moved = [_base_and_off(x, objective, factors[-1]) for x in variants.values()]
    s, radius = _few_pieces(path)
    centre = objective(s) * 1e3
    figure = Figure(draw_tube(tube_outline(centre, first * radius * 1e3)))
    figure.add_trace(
        line(centre[:, 0], centre[:, 1], "objective path", PATH_COLOUR, width=6, opacity=0.5)
    )
    looks = LOOKS[-len(variants) :]
    for name, (base, off), look in zip(variants, moved, looks, strict=True):
        x, y = ((base + first * off) * 1e3).T
        figure.add_trace(line(x, y, name, **look))
    choices = []
    for k in factors:
        curves = [
            tube_outline(centre, k * radius * 1e3),
            *((base + k * off) * 1e3 for base, off in moved),
        ]
        at = {axis: [np.round(c[:, i], 3).tolist() for c in curves] for i, axis in enumerate("xy")}
        # All but the objective path.
        which = [0, *range(2, 2 + len(moved))]
        choices.append({"label": f"{k}×", "method": "restyle", "args": [at, which]})
    figure.update_xaxes(title="x [mm]")
    figure.update_yaxes(title="y [mm]", scaleanchor="x")
    finish(figure, title="The whole path, distances magnified", height=640)
    label = "magnified"
    figure.update_layout(
        updatemenus=[{**buttons(choices, label=label), "active": factors.index(first)}],
        annotations=[row_label(label)],
        margin={"t": ROW},
    )
    return figure


def _magnifications(path: ShapedPath) -> tuple[list[int], int]:
    """Factors to choose from, and the one that is shown at first."""
    size = float(np.ptp(path.objective.vertices, axis=0).max())
    fit = [x for x in MAGNIFICATIONS if x * path.tolerance < MAGNIFIED * size]
    at = max(len(fit) - 1, 0)
    return sorted({1, *MAGNIFICATIONS[at : at + 1 + MORE]}), MAGNIFICATIONS[at]


def _base_and_off(variant: Variant, objective: Path, factor: int) -> tuple[FloatArray, FloatArray]:
    """Points of the objective path, and vectors to a variant [m], enough for a magnification."""
    s, off = distances(variant, objective)
    base = objective(s)
    kept = simplify([base + factor * off], MOST_DRAWN, even=MOST_DRAWN // 2)[0]
    return base[kept], off[kept]


def _few_pieces(path: ShapedPath) -> tuple[FloatArray, FloatArray]:
    """The pieces of the tube around the whole objective path, few enough to draw."""
    s, radius = tube_pieces(path)
    if len(radius) <= MOST_PIECES:
        return s, radius
    kept = simplify([path.objective(s)], MOST_PIECES, even=MOST_PIECES // 2)[0]
    return s[kept], np.minimum.reduceat(radius, kept[:-1])


def along(path: ShapedPath, variants: Sequence[Variant], motions: Sequence[Trajectory]) -> Any:
    """Distance, speed and time gained over the arc length of the objective path.

    Args:
        path: The shaped path.
        variants: The fastest start, and the shaped path.
        motions: The fastest motion along each.
    """
    rival, shaped = variants
    objective = path.objective
    flat = objective.dimension == 2
    figure = make_subplots(rows=3, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    figure.add_trace(draw_tube(_band(path, two_sided=flat)), row=1, col=1)
    looks = (ARCS_LOOK if rival.name == ARCS else OTHER_LOOK, SHAPED_LOOK)
    names = (f"fastest start: {rival.name}", shaped.name)
    for x, motion, name, look in zip(variants, motions, names, looks, strict=True):
        s, vectors = distances(x, objective)
        off = across(vectors, objective, s)
        figure.add_trace(_curve(s, off, name, legendgroup=name, **look), row=1, col=1)
        places = x.origin(motion.s(motion.breaks))
        speed = motion.s(motion.breaks, 1)
        same: dict[str, Any] = {"legendgroup": name, "showlegend": False, **look}
        figure.add_trace(_curve(places, speed, name, **same), row=2, col=1)
    s, _ = distances(shaped, objective)
    lead = motions[0].time_at(rival.place(s)) - motions[1].time_at(shaped.place(s))
    gained = _curve(s, lead, "time gained", colour="#000000", showlegend=False)
    figure.add_trace(gained, row=3, col=1)
    titles = ("to the left [mm]" if flat else "distance [mm]", "speed [mm/s]", "time gained [ms]")
    for k, title in enumerate(titles, start=1):
        figure.update_yaxes(title=title, row=k, col=1)
    figure.update_xaxes(title="arc length of the objective path [mm]", row=3, col=1)
    durations = [f"{x.duration:.3f} s" for x in motions]
    title = f"Along the path: shaped {durations[1]}, {rival.name} {durations[0]}"
    finish(figure, title=title, height=760)
    _mark_vertices(figure, objective)
    return figure


def _curve(s: FloatArray, values: FloatArray, name: str, **look: Any) -> Any:
    """A curve of values in thousandths over arc length, few enough points to draw."""
    at, value = thin(s * 1e3, values * 1e3)
    return line(at, value, name, **look)


def _band(path: ShapedPath, *, two_sided: bool) -> FloatArray:
    """Outline of the tolerance over arc length, on both sides of zero or above it [mm]."""
    s, radius = tube_pieces(path)
    edge, high = np.repeat(s, 2)[1:-1] * 1e3, np.repeat(radius, 2) * 1e3
    low = -high if two_sided else np.zeros_like(high)
    return np.stack([np.append(edge, edge[::-1]), np.append(high, low[::-1])], axis=1)


def _mark_vertices(figure: Any, objective: Path) -> None:
    """Draw dotted lines at the vertices of the objective path, through all rows."""
    at = sharp_vertices(objective) * 1e3
    if len(at) > MOST_MARKED:
        return
    look = {"type": "line", "xref": "x", "yref": "paper", "y0": 0, "y1": 1, "layer": "below"}
    dotted = {"color": "#BBBBBB", "width": 1, "dash": "dot"}
    figure.add_shapes({**look, "x0": x, "x1": x, "line": dotted} for x in at.tolist())
