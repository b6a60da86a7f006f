"""Fig. 10: what the joints and the tool did, conventional method and proposed method."""

from __future__ import annotations

import matplotlib.pyplot as plt
from docs.figures import job, style
from matplotlib.figure import Figure


def draw() -> Figure:
    """Rows: path, tool speed, joint accelerations; a column for each way to do the job."""
    columns = (
        (
            "Conventional\n(simulation)",
            job.conventional(),
            style.CONVENTIONAL,
            job.CONVENTIONAL_TIME,
        ),
        ("Proposed\n(simulation)", job.proposed(), style.PROPOSED, 6.0),
        (
            "Proposed, held as steps every 4 ms\n(simulation, not the paper's experiment)",
            job.proposed(hold=True, period=job.PERIOD),
            style.OTHER,
            7.5,
        ),
    )
    figure, grid = plt.subplots(4, 3, figsize=(11, 11), height_ratios=[2.6, 1, 1, 1], sharey="row")
    limit = job.LIMITS.for_joints(2).joint_acceleration
    for (title, result, colour, end), column in zip(columns, grid.T, strict=True):
        executed = result.executed
        error = result.evaluation.contour_error
        path = column[0]
        path.plot(*1e3 * job.OBJECTIVE.vertices.T, color=style.OBJECTIVE, lw=1, ls="--")
        path.plot(*1e3 * executed.tool[executed.t <= end].T, color=colour, lw=1.3)
        path.set_title(
            f"{title}\nRMS {1e3 * error.rms:.2g} mm, largest {1e3 * error.max:.2g} mm", fontsize=9
        )
        path.set(xlabel="$x$ [mm]", aspect="equal", adjustable="box", xlim=(268, 426))
        inside = executed.t <= end
        t = executed.t[inside]
        column[1].plot(t, 1e3 * executed.tool_speed[inside], color=colour, lw=1)
        for j in (0, 1):
            column[2 + j].plot(t, executed.ddq[inside, j], color=colour, lw=0.8)
            for sign in (-1, 1):
                column[2 + j].axhline(sign * limit[j], color=style.BLACK, lw=0.7, ls="--")
            column[2 + j].text(
                0.98,
                0.97,
                f"largest demand {result.evaluation.demand[j]:.3g} rad/s²",
                transform=column[2 + j].transAxes,
                ha="right",
                va="top",
                fontsize=7.5,
            )
        for axes in column[1:]:
            axes.set_xlim(0, end)
        column[3].set_xlabel("time [s]")
    for axes in grid[1]:
        axes.axhline(1e3 * job.LIMITS.speed, color=style.BLACK, lw=0.7, ls="--")
        axes.set_ylim(0, 185)
    for axes in grid[2:].ravel():
        axes.set_ylim(-1.15, 1.15)
    for axes, text in zip(
        grid[:, 0],
        (
            "$y$ [mm]",
            "tool speed [mm/s]",
            "joint 1 acceleration\n[rad/s²]",
            "joint 2 acceleration\n[rad/s²]",
        ),
        strict=True,
    ):
        axes.set_ylabel(text)
    return figure
