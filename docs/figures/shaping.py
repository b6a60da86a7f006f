"""Arcs against the shaped path of the paper's job: at its corners, and along it."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import armcontour as ac

FILE = "fig_shaping"

TOLERANCE = 5e-3  # m
VIEW = 22.0  # mm: half width of an enlarged corner
PLACES = 1500
TUBE = "#d5ecf8"


def draw() -> Figure:
    """Both corners in their tolerance; distance and speed along the path, of arcs and shape."""
    arcs = ac.plan(job.ROUNDED, job.ARM, job.LIMITS)
    shaped = ac.plan(job.OBJECTIVE, job.ARM, job.LIMITS, method="shaped", tolerance=TOLERANCE)
    figure = plt.figure(figsize=(8.6, 8.4))
    places = figure.subplot_mosaic(
        [["1", "2"], ["off", "off"], ["speed", "speed"]], height_ratios=(2.1, 1, 1)
    )
    for k, name in enumerate("12"):
        _corner(places[name], k, shaped.path)
    s = np.linspace(0, job.OBJECTIVE.length, PLACES)
    for path, place, motion, look in (
        (
            job.ROUNDED,
            job.ROUNDED.place,
            arcs,
            {"color": style.VERMILLION, "ls": "--", "label": "arcs"},
        ),
        (
            shaped.path,
            lambda s: np.interp(s, *shaped.path.places.T),
            shaped,
            {"color": style.BLUE, "lw": 2, "label": "shaped path"},
        ),
    ):
        along = job.OBJECTIVE(s, 1)
        v = path(place(s)) - job.OBJECTIVE(s)
        off = along[:, 0] * v[:, 1] - along[:, 1] * v[:, 0]
        places["off"].plot(1e3 * s, 1e3 * off, **look)
        speed = motion.speed_at(place(s))
        look["label"] += f": {motion.duration:.3f} s"
        places["speed"].plot(1e3 * s, 1e3 * speed, **look)
    size = 1e3 * TOLERANCE
    places["off"].axhspan(-size, size, color=TUBE, lw=0, zorder=0)
    places["off"].set(ylabel="to the left [mm]", ylim=(-1.1 * size, 1.1 * size))
    places["off"].set_title("(c) Distance from the lines of the objective path")
    places["off"].sharex(places["speed"])
    places["off"].tick_params(labelbottom=False)
    places["speed"].set(
        xlabel="arc length of the objective path [mm]",
        ylabel="tool speed [mm/s]",
        xlim=(0, 1e3 * job.OBJECTIVE.length),
    )
    places["speed"].set_title("(d) Speed, timed by the method “optimal”")
    places["speed"].legend(loc="lower center", ncols=2)
    for name in ("off", "speed"):
        for x in job.OBJECTIVE.breaks[1:-1]:
            places[name].axvline(1e3 * x, color=style.GREY, lw=0.8, ls=":")
    return figure


def _corner(axes: Axes, k: int, shaped: ac.Path) -> None:
    """A corner of the objective path, in its tolerance."""
    corner = 1e3 * job.OBJECTIVE.vertices[k + 1]
    x, y = (corner[i] + VIEW * np.linspace(-1, 1, 150) for i in (0, 1))
    grid = np.stack(np.meshgrid(x, y), axis=-1)
    off = job.OBJECTIVE.project(grid.reshape(-1, 2) / 1e3).distance.reshape(grid.shape[:2])
    axes.contourf(x, y, off, levels=(0, TOLERANCE), colors=[TUBE], zorder=0)
    for path, look in (
        (
            job.OBJECTIVE,
            {"color": style.OBJECTIVE, "lw": 3.5, "alpha": 0.5, "label": "objective path"},
        ),
        (job.ROUNDED, {"color": style.VERMILLION, "ls": "--", "label": "arcs"}),
        (shaped, {"color": style.BLUE, "lw": 2, "label": "shaped path"}),
    ):
        points = 1e3 * path(np.union1d(np.linspace(0, path.length, PLACES), path.breaks))
        axes.plot(*points.T, **look)
    axes.add_patch(
        plt.Circle(corner, 1e3 * TOLERANCE, fill=False, color=style.GREY, lw=0.8, ls=":")
    )
    axes.set(xlim=x[[0, -1]], ylim=y[[0, -1]], xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.set_title(f"({'ab'[k]}) Corner {k + 1}, tolerance {1e3 * TOLERANCE:.0f} mm")
    if k == 0:
        axes.legend(loc="upper right")
