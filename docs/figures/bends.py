"""Three ways round the same corner within the same corner error, and their curvature."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.geometry import round_with_parabolas

FILE = "fig_bends"

ERROR = 5e-3  # m
SIDE = 0.03  # m
CORNER = ac.Path.polyline([(-SIDE, 0.0), (0.0, 0.0), (0.0, SIDE)])
SHAPES = {
    "arc": (style.BLUE, ac.round_corners(CORNER, tolerance=ERROR)),
    "parabola, as arcs": (style.ORANGE, round_with_parabolas(CORNER, tolerance=ERROR)),
    "smooth bend": (
        style.GREEN,
        ac.round_corners(CORNER, tolerance=ERROR, continuity="curvature"),
    ),
}


def draw() -> Figure:
    """A corner of 90°, and the curvature over the distance from its middle."""
    figure, (shape, curvature) = plt.subplots(1, 2, figsize=(8.6, 3.9), width_ratios=(1, 1.3))
    shape.plot(*1e3 * CORNER.vertices.T, color=style.OBJECTIVE, ls="--", label="objective path")
    for name, (colour, path) in SHAPES.items():
        s = np.linspace(0, path.length, 1201)
        line = "--" if name == "smooth bend" else "-"
        shape.plot(*1e3 * path(s).T, color=colour, lw=1.4, ls=line, label=name)
        bent = np.linalg.norm(path(s, 2), axis=-1)
        curvature.plot(1e3 * (s - path.length / 2), bent, color=colour)
    shape.add_patch(plt.Circle((0, 0), 1e3 * ERROR, fill=False, color=style.GREY, lw=0.8, ls=":"))
    shape.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", xlim=(-17, 6), ylim=(-6, 17))
    shape.set_title("(a) Corner error 5 mm")
    shape.legend(loc="upper left")
    curvature.set(xlabel="arc length from the middle [mm]", ylabel="curvature [1/m]")
    curvature.set(xlim=(-25, 25), ylim=(0, None))
    curvature.set_title("(b) Curvature along the way")
    return figure
