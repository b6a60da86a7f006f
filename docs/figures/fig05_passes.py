"""Fig. 5: the forward and the reverse pass over a line, and the tool speed that comes of them."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from docs.figures.fig04_line import rest_to_rest
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.timing.mac_line import Line


def draw() -> Figure:
    """Both passes over line 2 from rest to rest, run on beyond the assigned velocity."""
    trajectory = rest_to_rest()
    path = trajectory.path
    line = Line(
        name="line",
        joint_path=ac.trace(path, job.ARM),
        arm=job.ARM,
        limit=job.LIMITS.for_joints(2).joint_acceleration,
        s=path.length * np.linspace(0, 1, 1501) ** 2,
        assigned=job.LIMITS.speed,
    )
    back = Line(
        name="line",
        joint_path=line.joint_path,
        arm=job.ARM,
        limit=line.limit,
        s=path.length * (1 - np.linspace(1, 0, 1501) ** 2),
        assigned=job.LIMITS.speed,
    )
    end, (_, t_f, t_2, _) = trajectory.duration, trajectory.switching_points
    assigned = 1e3 * job.LIMITS.speed

    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7.2, 5.6), sharex=True)
    for run, colour, name, clock in (
        (line.forward(0.0), style.RULES["MAC"], "forward pass (MAC)", lambda t: t),
        (back.reverse(0.0), style.RULES["MDC"], "reverse pass (MDC)", lambda t: end - t),
    ):
        t = np.concatenate([[0.0], np.cumsum(run.h[: run.done])])
        speed = 1e3 * run.speed[: run.done + 1]
        within = speed <= assigned
        top.plot(clock(t[within]), speed[within], color=colour, lw=2.5, label=name)
        top.plot(clock(t[~within]), speed[~within], color=colour, lw=1.2, ls=":")
    top.plot([], [], color=style.GREY, lw=1.2, ls=":", label="not used: above $v_a$")

    for part in trajectory.stretches:
        t = np.linspace(*part.t, 300)
        speed = 1e3 * np.linalg.norm(
            job.ARM.tool_velocity(trajectory(t), trajectory(t, 1, side="left")), axis=1
        )
        bottom.plot(
            t, speed, color=style.RULES[part.kind], lw=2.5, label=style.RULE_NAMES[part.kind]
        )
    for axes in (top, bottom):
        axes.axhline(assigned, color=style.BLACK, lw=0.8, ls="--")
        for t in (t_f, t_2):
            axes.axvline(t, color=style.GREY, lw=0.8)
        axes.set(ylabel="tool speed [mm/s]", ylim=(0, 240), xlim=(0, end))
    top.text(0.02, assigned + 5, "assigned velocity $v_a$", fontsize=8)
    for at, text in ((t_f, "$t = t_f$, $P_1$"), (t_2, "$t = T - t_r$, $P_2$")):
        top.annotate(
            text, (at, 222), ha="center", va="center", bbox={"fc": "white", "ec": "none", "pad": 1}
        )
    top.set_title("(a) Forward and reverse pass, and where they are switched")
    top.legend(loc="lower center")
    bottom.set_title("(b) Tool speed of the line")
    bottom.set_xlabel("time [s]")
    bottom.legend(loc="lower center")
    return figure
