"""Pictures of the examples: each is drawn from the names that its example defines."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

import armcontour as ac
from armcontour.robot.chain import floor_poses

# What an example's module has when it has run.
Names = Mapping[str, Any]
SIZE = (5.0, 3.4)  # inches
PLACES = 1500
COLOURS = (style.VERMILLION, style.BLUE, style.GREEN)
ARM = {"color": style.GREY, "lw": 3, "solid_capstyle": "round", "marker": "o", "ms": 3}


def draw_01(names: Names) -> Figure:
    """Draw the paper's path, coloured by the rules of its timing, and the objective path."""
    figure, axes = plt.subplots(figsize=SIZE)
    axes.plot(*1e3 * names["objective"].vertices.T, color=style.GREY, ls="--", lw=1)
    begin = 0.0
    drawn_kinds = set()
    for stretch in names["planned"].stretches:
        t = np.linspace(*stretch.t, 100)
        tool = 1e3 * names["arm"].tool_position(names["planned"](t, side="left"))
        label = None if stretch.kind in drawn_kinds else style.RULE_NAMES[stretch.kind]
        drawn_kinds.add(stretch.kind)
        axes.plot(*tool.T, color=style.RULES[stretch.kind], lw=3, label=label)
        begin = stretch.t[1]
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.set_title(f"Rules of the paper's timing, {begin:.2f} s")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def draw_02(names: Names) -> Figure:
    """Draw the contour error of both compensations over time."""
    return _errors(names["errors"].items(), "Contour error of the slot")


def draw_03(names: Names) -> Figure:
    """Draw the bead along the box, with the tool axis and the arm."""
    axes = _space("Tool axis and arm along the box")
    path = names["rounded"]
    plan = names["planned"]
    arm = names["arm"]
    _axes_along(axes, path, 0.05, 24)
    axes.plot(*path(np.linspace(0, path.length, PLACES)).T, color=style.BLUE, lw=2)
    for k, t in enumerate(np.linspace(0, plan.duration, 4)):
        axes.plot(*arm.links(plan(t)).T, alpha=0.25 + 0.25 * k, **ARM)
    axes.set_aspect("equal")
    return axes.figure


def draw_04(names: Names) -> Figure:
    """Draw the tube, its seam and the torch axis."""
    axes = _space("Torch axis and arm along the seam")
    path = names["free"]
    plan = names["planned"]
    arm = names["arm"]
    turn, along = np.meshgrid(np.linspace(0, 2 * np.pi, 60), (-0.12, 0.12))
    x, y, z = names["center"]
    radius = names["radius"]
    axes.plot_surface(
        x + radius * np.sin(turn), y + along, z + radius * np.cos(turn), color=style.SKY, alpha=0.25
    )
    _axes_along(axes, path, 0.06, 24)
    axes.plot(*path(np.linspace(0, path.length, PLACES)).T, color=style.BLUE, lw=2)
    for k, t in enumerate(np.linspace(0, plan.duration, 4)[:-1]):
        axes.plot(*arm.links(plan(t)).T, alpha=0.3 + 0.3 * k, **ARM)
    axes.set_aspect("equal")
    return axes.figure


def draw_05(names: Names) -> Figure:
    """Draw the set-points of a joint, which lead its motion by dead time and servo lag."""
    certificate = names["certificate"]
    figure, axes = plt.subplots(figsize=SIZE)
    joint = 1
    for label, t, q, look in (
        (
            "set-points, every 4 ms",
            certificate.set_points.t,
            certificate.set_points.q,
            {"marker": ".", "lw": 0.6},
        ),
        ("executed", certificate.result.execution.t, certificate.result.execution.q, {"lw": 2.5}),
    ):
        part = t < 0.35
        axes.plot(t[part], np.degrees(q[part, joint]), label=label, **look)
    t = np.linspace(0, 0.35, 200)
    planned = np.degrees(certificate.trajectory(t)[:, joint])
    axes.plot(t, planned, color=style.BLACK, ls="--", lw=1, label="planned")
    axes.set(xlabel="time [s]", ylabel=f"joint {joint + 1} [°]", xlim=(-0.06, 0.35))
    axes.set_title("The set-points lead by dead time and delay")
    axes.legend(loc="best")
    return figure


def draw_06(names: Names) -> Figure:
    """Draw contours, leads and rapids of the gasket, and where the laser is switched."""
    figure, axes = plt.subplots(figsize=SIZE)
    plan = names["set_points"].trajectory
    arm = names["arm"]
    program = ac.prepare(names["gasket"], names["process"])
    for span in plan.spans:
        if span.kind == "rapid":
            tool = 1e3 * arm.tool_position(plan(np.linspace(*span.t, 60), side="left"))
            axes.plot(*tool.T, color=style.GREY, lw=0.8, ls=(0, (4, 2)))
    for x in program.contours:
        whole = np.linspace(0, x.path.length, PLACES)
        axes.plot(*1e3 * x.path(whole).T, color=style.ORANGE, lw=1.5)
        axes.plot(*1e3 * x.path(np.linspace(*x.work, PLACES)).T, color=style.BLUE, lw=1.8)
    for event in plan.events:
        fill = style.GREEN if event.value is True else "white"
        axes.plot(*1e3 * np.array(event.point), "o", ms=5, mec=style.BLACK, mfc=fill)
    for label, look in (
        ("contour", {"color": style.BLUE}),
        ("lead", {"color": style.ORANGE}),
        ("rapid", {"color": style.GREY, "ls": "--", "lw": 0.8}),
        ("laser on", {"color": "none", "marker": "o", "mec": style.BLACK, "mfc": style.GREEN}),
    ):
        axes.plot([], [], label=label, **look)
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.set_title(f"{program.source}: {len(program.contours)} contours")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def draw_07(names: Names) -> Figure:
    """Draw the contour error of each run over time."""
    runs = ((f"run {k + 1}", x) for k, x in enumerate(names["errors"]))
    return _errors(runs, "Contour error from run to run, unknown load")


def draw_08(names: Names) -> Figure:
    """Draw the contour error of each run over time."""
    runs = ((f"run {k + 1}", x) for k, x in enumerate(names["errors"]))
    return _errors(runs, "Contour error from run to run, from log files")


def draw_09(names: Names) -> Figure:
    """Draw the first corner: objective path, arc and shaped path within the tolerance."""
    figure, axes = plt.subplots(figsize=SIZE)
    objective = names["objective"]
    shaped = names["planned"].path
    corner = 1e3 * objective.vertices[1]
    tolerance = 5.0
    x = corner[0] + np.linspace(-28, 12, 300)
    y = corner[1] + np.linspace(-14, 14, 300)
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    distances = 1e3 * objective.project(grid / 1e3).distance.reshape(300, 300)
    axes.contourf(x, y, distances, levels=(0, tolerance), colors=[style.SKY], alpha=0.25)
    arcs = ac.round_corners(objective, tolerance=tolerance / 1e3)
    for label, path, look in (
        ("drawn", objective, {"color": style.GREY, "lw": 3, "alpha": 0.5}),
        ("arc", arcs, {"color": style.VERMILLION, "ls": "--"}),
        ("fastest path", shaped, {"color": style.BLUE, "lw": 2}),
    ):
        points = 1e3 * path(np.union1d(np.linspace(0, path.length, 4 * PLACES), path.breaks))
        axes.plot(*points.T, label=label, **look)
    axes.set(xlim=x[[0, -1]], ylim=y[[0, -1]], aspect="equal")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", title="A corner with its tolerance of 5 mm")
    axes.legend(loc="lower left")
    return figure


def draw_10(names: Names) -> Figure:
    """Draw the acceleration of a joint without and with a jerk limit."""
    figure, axes = plt.subplots(figsize=SIZE)
    arm = names["arm"]
    limits = names["limits"]
    for label, path, jerk, colour in (
        ("arcs, no limit of jerk", names["arcs"], None, style.VERMILLION),
        ("smooth corners, 7.2 rad/s³", names["smooth"], 7.2, style.BLUE),
    ):
        plan = ac.plan(path, arm, limits.replace(joint_jerk=jerk))
        t = np.linspace(0, plan.duration, 4 * PLACES)
        axes.plot(t, plan(t, 2)[:, 0], color=colour, lw=1.2, label=f"{label}: {t[-1]:.2f} s")
    axes.set(xlabel="time [s]", ylabel="acceleration of joint 1 [rad/s²]", ylim=(-0.85, 1.15))
    axes.set_title("Acceleration without and with a jerk limit")
    axes.legend(loc="upper center", ncols=2, columnspacing=0.8)
    return figure


def draw_11(names: Names) -> Figure:
    """Draw the durations at all places of the part, and the places that are refused."""
    placed = names["placed"]
    figure, axes = plt.subplots(figsize=SIZE)
    x, y = (1e3 * a for a in placed.axes.values())
    image = axes.pcolormesh(x, y, placed.durations.T, cmap="viridis_r", edgecolors="white", lw=1)
    figure.colorbar(image, label="duration [s]")
    axes.set_facecolor("#d0d0d0")
    best = placed.best.values
    axes.plot(1e3 * best["x"], 1e3 * best["y"], "*", ms=16, color=style.ORANGE, mec=style.BLACK)
    axes.set(xlabel="offset of the part in x [mm]", ylabel="offset in y [mm]", aspect="equal")
    axes.set_title("Star: best; grey: out of reach")
    axes.grid(visible=False)
    return figure


def draw_12(names: Names) -> Figure:
    """Draw both posts, and the arm when it first comes too near to the first one."""
    axes = _space("Posture at the first violation")
    arm = names["arm"]
    plan = names["planned"]
    seam = names["seam"]
    for x, colour in ((0.35, style.VERMILLION), (0.60, style.GREEN)):
        post = names["scene_with_post"](x).obstacles[1]
        axes.add_collection3d(Poly3DCollection(_box(post), color=colour, alpha=0.35))
    (first, *_) = ac.check_clearance(plan, arm, names["scene_with_post"](0.35)).too_near
    for t, alpha in ((0.0, 0.3), (first.first_time, 1.0)):
        axes.plot(*arm.links(plan(t)).T, alpha=alpha, **ARM)
    axes.plot(*seam.vertices.T, color=style.BLUE, lw=2)
    axes.plot(*first.points[1], "x", color=style.BLACK, ms=9, mew=2, zorder=9)
    axes.set_aspect("equal")
    return axes.figure


def draw_13(names: Names) -> Figure:
    """Draw the error over the cycle time, with a line for each compensation."""
    figure, axes = plt.subplots(figsize=SIZE)
    axes.set_prop_cycle(color=COLOURS)
    rows = names["result"].rows
    key = "compensation.method"
    for method, marker in zip(dict.fromkeys(x.values[key] for x in rows), "os^", strict=True):
        mine = [x.data for x in rows if x.values[key] == method]
        error = [1e3 * x["contour_error.max"].value for x in mine]
        axes.semilogy([x["duration"].value for x in mine], error, marker=marker, label=method)
    axes.set(xlabel="cycle time [s]", ylabel="largest contour error [mm]")
    axes.set_title(f"{len(rows)} jobs")
    axes.legend()
    return figure


def draw_14(names: Names) -> Figure:
    """Draw the contour error with the gains of the data sheet and with identified gains."""
    return _errors(names["errors"].items(), "Contour error of the same robot")


def draw_15(names: Names) -> Figure:
    """Draw the pipe and its branch on the positioner, and the arm, at two times."""
    figure = plt.figure(figsize=SIZE, layout="none")
    figure.suptitle("Pipe and arm at two times, seen from the floor", fontsize=10, weight="bold")
    result = names["result"]
    arm = result.arm
    plan = result.trajectory
    path = result.path.contours[0].path
    turn, share = np.meshgrid(np.linspace(0, 2 * np.pi, 40), (0.0, 1.0))
    pipe = 0.3 * share - 0.15, 0.1 * np.sin(turn), 0.1 * np.cos(turn)
    x, y = 0.05 * np.cos(turn), 0.05 * np.sin(turn)
    foot = np.sqrt(0.1**2 - y**2)
    branch = x, y, foot + share * (0.2 - foot)
    seam = path(np.linspace(0, path.length, PLACES)).T
    for k, t in enumerate((0.0, 0.25 * plan.duration)):
        axes = figure.add_axes((0.5 * k - 0.01, 0.0, 0.5, 0.92), projection="3d")
        floor = floor_poses(arm.chain, plan(t)[None])[0]

        def from_floor(points: Any, floor: np.ndarray = floor) -> np.ndarray:
            return np.moveaxis((points - floor[:, 3]) @ floor[:, :3], -1, 0)

        for surface in (pipe, branch):
            # The path begins at (50, 0, 100) mm of the drawing.
            x, y, z = from_floor(np.stack(surface, axis=-1) + path(0.0) - (0.05, 0.0, 0.1))
            axes.plot_surface(x, y, z, color=style.SKY, alpha=0.4)
        axes.plot(*from_floor(seam.T), color=style.BLUE, lw=2)
        axes.plot(*from_floor(arm.links(plan(t))[3:]), **ARM)
        axes.set_aspect("equal")
        axes.view_init(elev=15, azim=-75)
        axes.set_box_aspect(None, zoom=1.1)
        axes.set(yticks=(), xlabel="x [m]")
        axes.locator_params(nbins=4)
        axes.tick_params(labelsize=6, pad=-2)
        axes.set_title(f"{t:.0f} s", fontsize=9, y=0.95)
    return figure


def draw_16(names: Names) -> Figure:
    """Draw the edges of the part, and the seam with the axes of the torch."""
    axes = _space("Seam and torch axes")
    for curve in names["model"].curves():
        axes.plot(*1e3 * curve.T, color=style.GREY, lw=0.8)
    path = names["seam"].path
    axes.plot(*1e3 * path(np.linspace(0, path.length, PLACES)).T, color=style.BLUE, lw=2)
    s = np.arange(24) * path.length / 24
    length = 25.0
    torch = path.orientation(s)[:, :, 2]
    tails = 1e3 * path(s) - length * torch
    axes.quiver(*tails.T, *(length * torch).T, color=style.VERMILLION, lw=0.8)
    axes.set_aspect("equal")
    axes.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.locator_params(nbins=4)
    axes.tick_params(labelsize=6, pad=-2)
    return axes.figure  # type: ignore[return-value]


def _errors(errors: Any, title: str) -> Figure:
    """Draw named errors over time, on a logarithmic scale."""
    figure, axes = plt.subplots(figsize=SIZE)
    axes.set_prop_cycle(color=COLOURS)
    for name, error in errors:
        axes.semilogy(error.t, np.maximum(1e3 * error.values, 1e-5), label=name, lw=1.2)
    axes.set(xlabel="time [s]", ylabel="contour error [mm]", title=title)
    axes.legend()
    return figure


def _space(title: str) -> Axes3D:
    """Return axes in space without a frame around them."""
    figure = plt.figure(figsize=SIZE, layout="none")
    axes = figure.add_axes((-0.05, -0.07, 1.1, 1.05), projection="3d")
    figure.suptitle(title, fontsize=10, fontweight="bold")
    axes.locator_params(nbins=4)
    axes.tick_params(labelsize=7, pad=0)
    axes.view_init(elev=24, azim=-58)
    return axes


def _axes_along(axes: Axes3D, path: ac.Path, length: float, count: int) -> None:
    """Draw sticks that show the tool axis along a path."""
    for s in np.linspace(0, path.length, count):
        tip = path(s)
        back = tip - length * path.orientation(s)[:, 2]
        axes.plot(*np.stack([back, tip]).T, color=style.ORANGE, lw=1)


def _box(obstacle: ac.Obstacle) -> np.ndarray:
    """Return the corners of the six sides of a box [m], (6, 4, 3)."""
    half = np.array(obstacle.shape.size) / 2
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    sides = [np.insert(square, axis, sign, axis=1) for axis in range(3) for sign in (-1, 1)]
    return obstacle.place.position + half * np.array(sides)
