"""A straight move with and without a limit of jerk, and its compensated set-points."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.figure import Figure

import armcontour as ac

FILE = "fig_jerk"

PATH = ac.JointPath.spline([(0.0,), (1.0,)])
LIMITS = ac.Limits(joint_velocity=1.0, joint_acceleration=4.0)
JERK = 40.0  # rad/s³
JUMP = 1e-3  # rad/s²
POINTS = 400
ROWS = (
    (1, "velocity [rad/s]", 1.0),
    (2, "acceleration [rad/s²]", 4.0),
    (3, "jerk [rad/s³]", JERK),
)


def draw() -> Figure:
    """Velocity, acceleration and jerk of both plans over time, with their limits."""
    figure, rows = plt.subplots(3, 1, figsize=(7.2, 6.2), sharex=True)
    for limits, name, look in (
        (LIMITS, "without a limit of jerk", {"color": style.VERMILLION, "lw": 1.2}),
        (LIMITS.replace(joint_jerk=JERK), "with 40 rad/s³", {"color": style.BLUE, "lw": 1.8}),
    ):
        plan = ac.plan(PATH, limits=limits)
        t, left = _both_sides(plan)
        for axes, (order, _, _) in zip(rows, ROWS, strict=True):
            value = np.where(left, plan(t, order, side="left")[:, 0], plan(t, order)[:, 0])
            axes.plot(t, value, label=f"{name}: {plan.duration:.4f} s", **look)
    for axes, (_, name, limit), letter in zip(rows, ROWS, "abc", strict=True):
        axes.set_title(f"({letter}) " + name.split(" [")[0].capitalize())
        axes.set(ylabel=name.split(" ")[-1], ylim=(-1.25 * limit, 1.25 * limit))
        for sign in (-1, 1):
            axes.axhline(sign * limit, color=style.BLACK, lw=0.8, ls="--")
    rows[0].set(ylim=(0, 1.25))
    rows[2].set(xlabel="time [s]")
    rows[0].legend(loc="lower center")
    return figure


def _both_sides(plan: ac.Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Times, with breaks twice at which the acceleration jumps; where left-hand values belong."""
    jump = np.abs(plan(plan.breaks, 2) - plan(plan.breaks, 2, side="left"))[:, 0]
    breaks = plan.breaks[jump > JUMP]
    t = np.sort(np.concatenate([np.linspace(0, plan.duration, POINTS), np.repeat(breaks, 2)]))
    return t, np.isin(t, breaks) & np.append(np.diff(t) == 0, False)
