"""Fig. 9: tool speed and joint accelerations of the realizable trajectory."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure


def draw() -> Figure:
    """Three rows over time, with limits and switching points."""
    trajectory = job.planned()
    t, ddq = job.two_sided(trajectory, 2)
    _, dq = job.two_sided(trajectory, 1)
    speed = 1e3 * np.linalg.norm(job.ARM.tool_velocity(trajectory(t), dq), axis=1)
    limit = job.LIMITS.for_joints(2).joint_acceleration

    figure, rows = plt.subplots(3, 1, figsize=(8.6, 6.4), sharex=True)
    rows[0].plot(t, speed, color=style.PROPOSED)
    rows[0].axhline(1e3 * job.LIMITS.speed, color=style.BLACK, lw=0.8, ls="--")
    rows[0].text(0.02, 1e3 * job.LIMITS.speed + 4, "assigned velocity", fontsize=8)
    rows[0].set(title="(a) Tool speed", ylabel="mm/s", ylim=(0, 180))
    for j in (0, 1):
        axes = rows[j + 1]
        axes.plot(t, ddq[:, j], color=style.PROPOSED)
        for sign in (-1, 1):
            axes.axhline(sign * limit[j], color=style.BLACK, lw=0.8, ls="--")
        axes.set(
            title=f"({'bc'[j]}) Joint {j + 1} acceleration", ylabel="rad/s²", ylim=(-0.95, 0.95)
        )
    for axes in rows:
        for at in trajectory.switching_points:
            axes.axvline(at, color=style.GREY, lw=0.6, ls=":")
    for k, at in enumerate(trajectory.switching_points):
        rows[0].text(at, 181, f"$P_{k}$", ha="center", va="bottom", fontsize=8)
    rows[0].title.set_position((0.5, 1.0))
    rows[0].set_title("(a) Tool speed", pad=16)
    rows[2].set(xlabel="time [s]", xlim=(0, trajectory.duration))
    return figure
