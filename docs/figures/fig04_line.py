"""Fig. 4: a realizable straight line in Cartesian and in joint space, with P1 and P2."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac


def rest_to_rest() -> ac.Trajectory:
    """Line 2 of the job, alone, from rest to rest."""
    line = ac.Path.polyline([(0.410, 0.150), (0.280, 0.300)])
    return ac.plan(line, job.ARM, job.LIMITS, method="mac", knots=job.KNOTS)


def draw() -> Figure:
    """The line in both spaces, coloured by the rule that made each part."""
    trajectory = rest_to_rest()
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 4.2))
    for part in trajectory.stretches:
        q = trajectory(np.linspace(*part.t, 200))
        tool = 1e3 * job.ARM.forward(q)
        colour = style.RULES[part.kind]
        left.plot(*tool.T, color=colour, lw=2.5, label=style.RULE_NAMES[part.kind])
        right.plot(*np.degrees(q).T, color=colour, lw=2.5)
    q = trajectory(trajectory.switching_points)
    tool = 1e3 * job.ARM.forward(q)
    for axes, points, offset in ((left, tool, (12, 10)), (right, np.degrees(q), (14, 8))):
        axes.plot(*points.T, "o", color=style.BLACK, ms=4, zorder=5)
        for name, at in zip(("$P_s$", "$P_1$", "$P_2$", "$P_e$"), points, strict=True):
            style.label(axes, name, tuple(at), offset)
        axes.margins(0.1)
    left.set(title="(a) Cartesian space", xlabel="$x$ [mm]", ylabel="$y$ [mm]", aspect="equal")
    left.legend(loc="lower left")
    right.set(title="(b) Joint space", xlabel="$θ_1$ [°]", ylabel="$θ_2$ [°]")
    return figure
