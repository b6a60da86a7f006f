"""Contour error and tracking error: the same instant of an execution, and both over time."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import armcontour as ac

FILE = "fig_evaluation"

ROBOT = job.SERVO.replace(kp=[25.0, 20.0])  # 1/s: joint 2 is slower than the model
VIEW = 3.2  # mm, half of the enlarged part
POINTS = 600


def draw() -> Figure:
    """The paper's job, sent as planned to a robot with unequal gains."""
    plan = job.planned()
    taught = ac.compensate(plan, job.SERVO, method="none", period=job.PERIOD)
    executed = ac.execute(taught, ac.ServoPlant(job.ARM, ROBOT, job.LIMITS))
    result = ac.evaluate(executed, job.ROUNDED, objective=job.OBJECTIVE, limits=job.LIMITS)
    figure, (place, time) = plt.subplots(1, 2, figsize=(9.0, 4.0), width_ratios=(1, 1.3))
    _instant(place, plan, executed, result.contour_error.t_max)
    for profile, name, colour in (
        (result.tracking_error, "tracking error", style.ORANGE),
        (result.contour_error, "contour error", style.VERMILLION),
    ):
        some = np.linspace(0, len(profile.t) - 1, POINTS).astype(int)
        label = f"{name}: {1e3 * profile.rms:.2f} mm RMS, {1e3 * profile.max:.2f} mm at most"
        time.plot(profile.t[some], 1e3 * profile.values[some], color=colour, label=label)
    time.axvline(plan.duration, color=style.GREY, lw=0.8, ls=":")
    time.set(xlabel="time [s]", ylabel="[mm]", ylim=(0, None))
    time.set_title("(b) Both over time; dotted: end of the plan")
    time.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
    return figure


def _instant(axes: Axes, plan: ac.Trajectory, executed: ac.Execution, t: float) -> None:
    """Tool, its place on the path and where the plan has it, at one time [mm]."""
    i = int(np.searchsorted(executed.t, t))
    tool = 1e3 * executed.tool[i]
    planned = 1e3 * job.ARM.forward(plan(t))
    place = 1e3 * job.ROUNDED(job.ROUNDED.project(tool[None] / 1e3).s)[0]
    axes.plot(
        *1e3 * job.ROUNDED(np.linspace(0, job.ROUNDED.length, 2000)).T,
        color=style.BLACK,
        lw=1,
        label="path",
    )
    axes.plot(*1e3 * executed.tool.T, color=style.BLUE, lw=1.6, label="way of the tool")
    axes.plot(*np.array([tool, planned]).T, color=style.ORANGE, lw=2.2)
    axes.plot(*np.array([tool, place]).T, color=style.VERMILLION, lw=3)
    axes.plot(*np.array([tool, planned, place]).T, "o", color=style.BLACK, ms=4, zorder=5)
    middle = (tool + planned) / 2
    axes.set(xlim=middle[0] + VIEW * np.array([-1, 1]), ylim=middle[1] + VIEW * np.array([-1, 1]))
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.set_title(f"(a) At {t:.2f} s")
    axes.legend(loc="lower right")
    style.label(axes, "tool", tuple(tool), (16, -10))
    style.label(axes, "plan", tuple(planned), (-18, 8))
    style.label(axes, "its place", tuple(place), (-16, 12))
