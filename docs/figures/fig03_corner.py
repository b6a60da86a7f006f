"""Fig. 3: a corner of the objective path and the arc that takes its place."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure
from matplotlib.patches import Arc


def draw() -> Figure:
    """Corner 1 of the job, with its points, its radius and its corner error."""
    path, corners = job.ROUNDED, job.ROUNDED.corners
    h = 1e3 * corners.point[0]
    s = corners.start[0], corners.end[0]
    r, g, q = (1e3 * x for x in (path(s[0]), _centre(path, s[0]), path(s[1])))
    middle = 1e3 * path(np.mean(s))
    arc = 1e3 * path(np.linspace(*s, 200))
    before, after = path(s[0], 1), path(s[1], 1)

    figure, axes = plt.subplots(figsize=(6.4, 4.6))
    style.no_frame(axes)
    lines = np.array([r - 16 * before, h, q + 16 * after])
    axes.plot(*lines.T, color=style.OBJECTIVE, lw=1.5, ls="--", label="objective path")
    axes.plot(*np.array([r - 16 * before, r]).T, color=style.PROPOSED, lw=2.5)
    axes.plot(*np.array([q, q + 16 * after]).T, color=style.PROPOSED, lw=2.5)
    axes.plot(*arc.T, color=style.PROPOSED, lw=2.5, label="rounded path")
    for end in (r, q):
        axes.plot(*np.array([g, end]).T, color=style.BLACK, lw=0.8)
    axes.plot(*np.array([g, middle]).T, color=style.BLACK, lw=0.8, ls=":")
    axes.plot(
        *np.array([middle, h]).T,
        color=style.VERMILLION,
        lw=2.5,
        label=f"corner error $ε$ = {1e3 * corners.error[0]:.0f} mm",
    )
    axes.plot(*np.array([r, g, q, h]).T, "o", color=style.BLACK, ms=4)

    for text, at, offset in (
        ("$R$", r, (12, -8)),
        ("$S$", q, (4, 14)),
        ("$G$", g, (-11, -6)),
        ("$H$", h, (13, 0)),
        ("$r$", (r + g) / 2, (-6, -10)),
        ("$r$", (q + g) / 2, (-8, 8)),
        ("$ε$", (h + middle) / 2, (2, 9)),
    ):
        style.label(axes, text, tuple(at), offset)
    _heading(axes, r - 16 * before, before, "$α_1$", 5)
    _heading(axes, q + 4 * after, after, "$α_2$", 4)
    _half_turn(axes, g, r, middle)

    axes.legend(loc="lower left", bbox_to_anchor=(1.0, 0.0))
    axes.set_title(
        "Corner 1 of the job: "
        f"turn $α_2-α_1$ = {np.degrees(corners.turn[0]):.1f}°, $r$ = {1e3 * corners.radius[0]:.2f} "
        f"mm, speed {1e3 * corners.speed[0]:.1f} mm/s"
    )
    return figure


def _centre(path, s):
    """Centre of the arc that starts at `s`."""
    i = int(path.locate(s))
    return path.starts[i] + path.normals[i] / path.curvatures[i]


def _heading(axes, at, direction, text, size):
    """Mark the angle of a heading from the x axis."""
    angle = np.degrees(np.arctan2(direction[1], direction[0]))
    axes.plot([at[0], at[0] + 1.5 * size], [at[1], at[1]], color=style.GREY, lw=0.8)
    axes.add_patch(Arc(at, 2 * size, 2 * size, theta1=0, theta2=angle, color=style.GREY, lw=0.8))
    half = np.radians(angle / 2)
    axes.text(
        at[0] + 1.45 * size * np.cos(half),
        at[1] + 1.45 * size * np.sin(half),
        text,
        ha="center",
        va="center",
    )


def _half_turn(axes, centre, first, second):
    """Mark the angle at G: half the turn."""
    angles = [np.degrees(np.arctan2(*(p - centre)[::-1])) for p in (first, second)]
    axes.add_patch(Arc(centre, 7, 7, theta1=angles[0], theta2=angles[1], color=style.BLACK, lw=0.8))
    half = np.radians(np.mean(angles))
    at = centre + 7.4 * np.array([np.cos(half), np.sin(half)])
    axes.text(*at, r"$\frac{α_2-α_1}{2}$", ha="center", va="center", fontsize=11)
