"""The optimal plan of the paper's job in the phase plane, and what binds where."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.motion import JointPath
from armcontour.timing._reach import reach
from armcontour.timing.constraints import JointDerivatives
from armcontour.timing.explanation import Explanation, explain
from armcontour.timing.grid import place_grid
from armcontour.timing.optimal import Problem, constraints_of

FILE = "fig_optimal"

COLOURS = {
    "joint 1 acceleration": style.BLUE,
    "joint 2 acceleration": style.VERMILLION,
    "assigned velocity": style.GREEN,
    "centripetal acceleration": style.ORANGE,
}


def draw() -> Figure:
    """Speed over arc length, and below it the joint accelerations, in the colours of limits."""
    joint_path = ac.trace(job.ROUNDED, job.ARM)
    plan = ac.plan(joint_path, job.ARM, job.LIMITS, method="optimal")
    why = explain(plan, job.ARM, job.LIMITS)
    figure, rows = plt.subplots(3, 1, figsize=(8.6, 7.2), sharex=True, height_ratios=(3, 1.4, 1.4))

    s, ceiling, most = ceiling_and_backward_pass(joint_path)
    rows[0].plot(*_steps(s, ceiling), color=style.BLACK, lw=0.9, ls="--", label="ceiling")
    rows[0].plot(
        1e3 * s, 1e3 * np.sqrt(most), color=style.GREY, lw=1.2, ls=":", label="backward pass"
    )
    s = plan.s(plan.breaks)
    _coloured(rows[0], why, s, 1e3 * plan.s(plan.breaks, 1))
    rows[0].set(ylabel="path speed $ds/dt$ [mm/s]", ylim=(0, 172))
    rows[0].set_title("(a) Speed along the path: the plan, in the colour of the limit that binds")

    ddq = plan((plan.breaks[:-1] + plan.breaks[1:]) / 2, 2)
    middle = (s[:-1] + s[1:]) / 2
    limit = job.LIMITS.for_joints(2).joint_acceleration
    for j, axes in enumerate(rows[1:]):
        axes.plot(1e3 * middle, ddq[:, j], color=style.GREY, lw=0.6)
        _coloured(axes, why, middle, ddq[:, j])
        for sign in (-1, 1):
            axes.axhline(sign * limit[j], color=style.BLACK, lw=0.9, ls="--")
        axes.set(ylabel="rad/s²", ylim=(-0.9, 0.9))
        axes.set_title(f"({'bc'[j]}) Joint {j + 1} acceleration")
    rows[2].set(xlabel="arc length $s$ [mm]", xlim=(0, 1e3 * joint_path.length))
    figure.legend(*rows[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def ceiling_and_backward_pass(joint_path: JointPath) -> tuple[np.ndarray, ...]:
    """Grid points [m]; ceiling of ds on every interval [mm/s]; largest x that leads to rest."""
    grid = place_grid(joint_path)
    active = constraints_of(joint_path, job.ARM, job.LIMITS)
    problem = Problem(grid, JointDerivatives.on(grid), active)
    _, most, _ = reach(
        grid.width,
        problem.packed,
        problem.at_points,
        problem.c,
        problem.radius,
        problem.shifts,
        0.0,
        0.0,
    )
    return grid.s, 1e3 * np.sqrt(problem.ceiling.min(axis=0)), most


def _steps(s: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve that is constant on every interval."""
    return 1e3 * np.repeat(s, 2)[1:-1], np.repeat(value, 2)


def _coloured(axes: Axes, why: Explanation, s: np.ndarray, value: np.ndarray) -> None:
    """A curve, stretch by stretch in the colour of what binds; jumps between stretches are left."""
    shown = set()
    for part in why.bindings:
        if part.name not in COLOURS:
            continue
        on = (s >= part.s[0]) & (s <= part.s[1])
        axes.plot(
            1e3 * s[on],
            value[on],
            color=COLOURS[part.name],
            lw=2.2,
            label=None if part.name in shown else part.name,
        )
        shown.add(part.name)
