"""Fig. 8: the realizable trajectory of the job in Cartesian and in joint space, with P0 to P9."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

# Where the names of P0 ... P9 stand beside their points, in points of type.
CARTESIAN = [
    (-13, 0),
    (10, -9),
    (11, -9),
    (12, 7),
    (12, 7),
    (12, 7),
    (-12, -7),
    (-7, 12),
    (9, -11),
    (12, 6),
]
JOINT = [
    (13, 2),
    (-13, -2),
    (15, 3),
    (-4, -12),
    (2, 12),
    (-2, 12),
    (-4, 13),
    (-6, -13),
    (-12, -8),
    (-12, -8),
]


def draw() -> Figure:
    """Both spaces side by side, coloured by rule."""
    trajectory = job.planned()
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.6, 5.4))
    corners = 1e3 * job.OBJECTIVE.vertices
    left.plot(*corners.T, color=style.OBJECTIVE, ls="--", lw=1, label="objective path")
    shown = set()
    for part in trajectory.stretches:
        q = trajectory(np.linspace(*part.t, 100))
        colour, name = style.RULES[part.kind], style.RULE_NAMES[part.kind]
        left.plot(
            *1e3 * job.ARM.forward(q).T, color=colour, lw=2.2, label=None if name in shown else name
        )
        right.plot(*np.degrees(q).T, color=colour, lw=2.2)
        shown.add(name)
    q = trajectory(trajectory.switching_points)
    for axes, points, offsets in (
        (left, 1e3 * job.ARM.forward(q), CARTESIAN),
        (right, np.degrees(q), JOINT),
    ):
        axes.plot(*points.T, "o", color=style.BLACK, ms=3.5, zorder=5)
        for k, (at, offset) in enumerate(zip(points, offsets, strict=True)):
            style.label(axes, f"$P_{k}$", tuple(at), offset)
        axes.margins(0.08)
    left.set(title="(a) Cartesian space", xlabel="$x$ [mm]", ylabel="$y$ [mm]", aspect="equal")
    right.set(title="(b) Joint space", xlabel="$θ_1$ [°]", ylabel="$θ_2$ [°]")
    figure.legend(loc="outside lower center", ncols=5)
    return figure
