"""An arm in space: the box edge of example 03, its arm, its speed and its torques."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

import armcontour as ac

POINTS = [(0.35, -0.15, 0.25), (0.35, 0.10, 0.25), (0.55, 0.10, 0.25), (0.55, 0.10, 0.10)]
INTO = np.array([(0.5, 0.0, -1.0), (0.3, -0.3, -1.0), (0.0, -0.5, -1.0), (-0.4, -0.5, -1.0)])
COLOURS = (
    style.BLUE,
    style.VERMILLION,
    style.GREEN,
    style.ORANGE,
    style.PURPLE,
    style.SKY,
)
ELBOW_UP = (0.0, -1.1, -2.4, -0.8, 1.6, 1.5)
AXIS = 0.05  # length of the sticks that show the tool axis [m]


def draw() -> Figure:
    """Plan the motion and draw it."""
    arm = ac.load_arm("ur5e", tool=ac.Frame(position=(0.0, 0.0, 0.12)))
    objective = ac.Path.polyline(POINTS).pointing(INTO)
    path = ac.round_corners(objective, tolerance=2e-3, angular_tolerance=np.radians(3))
    plan = ac.plan(path, arm, arm.limits.replace(speed=0.2), start=ELBOW_UP)
    t = np.linspace(0, plan.duration, 1500)
    q, dq, ddq = plan(t), plan(t, 1), plan(t, 2)

    figure = plt.figure(figsize=(9.6, 4.4), layout="none")
    _space(figure.add_axes((0.0, 0.02, 0.5, 0.9), projection="3d"), arm, path, plan)
    speed = figure.add_axes((0.6, 0.62, 0.38, 0.3))
    torque = figure.add_axes((0.6, 0.12, 0.38, 0.34))
    speed.plot(t, np.linalg.norm(arm.tool_velocity(q, dq), axis=1), color=style.BLUE)
    speed.axhline(0.2, color=style.BLACK, linestyle="--", linewidth=1, label="assigned velocity")
    speed.set(title="Tool speed", ylabel="[m/s]", ylim=(0, 0.235))
    speed.legend(loc="lower center")
    share = arm.torque(q, dq, ddq) / arm.limits.joint_torque
    for j, colour in enumerate(COLOURS):
        torque.plot(t, share[:, j], color=colour, linewidth=1.2, label=f"joint {j + 1}")
    torque.set(title="Joint torque over its limit", xlabel="time [s]", ylabel="[-]")
    torque.set_ylim(-0.35, 0.9)
    torque.legend(ncols=3, loc="upper left")
    return figure


def _space(axes: Axes3D, arm: ac.Arm, path: ac.RoundedPath, plan: ac.Trajectory) -> None:
    s = np.linspace(0, path.length, 600)
    line = path(s)
    for place in s[::40]:
        tip = path(place)
        back = tip - AXIS * path.orientation(place)[:, 2]
        axes.plot(*np.stack([back, tip]).T, color=style.ORANGE, linewidth=1)
    for k, when in enumerate(np.linspace(0, plan.duration, 4)):
        links = arm.links(plan(when))
        shade = 0.25 + 0.25 * k
        axes.plot(*links.T, color=style.GREY, linewidth=3, alpha=shade, solid_capstyle="round")
        axes.plot(*links.T, color=style.BLACK, marker="o", markersize=2, linewidth=0, alpha=shade)
    axes.plot(*line.T, color=style.BLUE, linewidth=2, label="rounded path")
    axes.plot([], [], color=style.ORANGE, label="tool axis")
    axes.plot([], [], color=style.GREY, linewidth=3, label="UR5e at four times")
    axes.set(title="Box edge, corners rounded within 2 mm and 3°", xlabel="x [m]", ylabel="y [m]")
    axes.set_zlabel("z [m]")
    axes.set_aspect("equal")
    axes.locator_params(nbins=5)
    axes.view_init(elev=24, azim=-58)
    axes.legend(loc="upper left", fontsize=7)
