"""The first picture: path and contour error of both methods."""

from __future__ import annotations

import matplotlib.pyplot as plt
from docs.figures import job, style
from docs.figures.fig11_errors import curves
from matplotlib.figure import Figure


def draw() -> Figure:
    """Left the path with a corner enlarged; right the error over time."""
    old, new = job.conventional(), job.proposed()
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 5), width_ratios=[0.85, 1.15])
    corner = 1e3 * job.OBJECTIVE.vertices[1]
    inset = left.inset_axes([0.02, 0.02, 0.46, 0.40])
    for axes, scale in ((left, 1.0), (inset, 1.3)):
        axes.plot(
            *1e3 * job.OBJECTIVE.vertices.T,
            color=style.OBJECTIVE,
            ls="--",
            lw=scale,
            label="objective path",
        )
        axes.plot(
            *1e3 * old.executed.tool.T,
            color=style.CONVENTIONAL,
            lw=1.2 * scale,
            label="conventional",
        )
        axes.plot(
            *1e3 * new.executed.tool.T,
            color=style.PROPOSED,
            lw=1.6 * scale,
            label="proposed",
        )
        axes.set_aspect("equal")
    inset.set(xlim=(corner[0] - 22, corner[0] + 10), ylim=(corner[1] - 14, corner[1] + 14))
    inset.set(xticks=[], yticks=[])
    inset.spines[["top", "right"]].set_visible(True)
    left.indicate_inset_zoom(inset, edgecolor=style.BLACK, lw=0.7, alpha=0.6)
    left.set(xlabel="$x$ [mm]", ylabel="$y$ [mm]", xlim=(236, 428), ylim=(60, 372))
    left.set_title("Path of the tool")
    left.legend(loc="center left", bbox_to_anchor=(0.0, 0.44), fontsize=9, handlelength=1.4)
    curves(right, uncompensated=False)
    planned = old.evaluation.duration, new.evaluation.duration
    settled = old.evaluation.settled, new.evaluation.settled
    rms = [1e3 * x.evaluation.contour_error.rms for x in (old, new)]
    right.set_title("Distance of the tool from its path")
    right.legend(loc="lower right", fontsize=9)
    figure.suptitle(
        f"Conventional: {planned[0]:.2f} s, at rest after {settled[0]:.2f} s, "
        f"contour error {rms[0]:.2f} mm RMS\n"
        f"Proposed: {planned[1]:.2f} s, at rest after {settled[1]:.2f} s, "
        f"contour error {rms[1]:.4f} mm RMS",
        fontsize=11,
    )
    return figure
