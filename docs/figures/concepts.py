"""Figures of the pages on concepts, of the paper's job."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from docs.figures.paper import ACCELERATION, ARM, CYCLE, LIMITS, OBJECTIVE, ROUNDED, SERVO, planned
from docs.pages import blocks
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.geometry import round_path

README = Path(__file__).parents[2] / "README.md"
SIDE = 0.03  # m, length of both lines of the corner of 90°
ERROR = 5e-3  # m, corner error of the rounded corner of 90°
VIEW = 3.2  # mm, half of the enlarged part
LIMITING = {
    "joint 1 acceleration": style.BLUE,
    "joint 2 acceleration": style.VERMILLION,
    "assigned velocity": style.GREEN,
    "centripetal acceleration": style.ORANGE,
}


def draw_square_corner() -> Figure:
    """Draw a corner of the README's example, executed with and without compensation."""
    example: dict[str, Any] = {}
    exec(next(x.text for x in blocks(README) if x.language == "python"), example)
    plan = example["planned"]
    path = example["rounded"]
    uncompensated = ac.compensate(plan, example["assumed"], ac.NoCompensation(), cycle=2e-3)
    figure, (corner, errors) = plt.subplots(1, 2, figsize=(8.6, 3.4), width_ratios=(1, 1.5))
    square = 1e3 * example["square"].vertices
    corner.plot(*square.T[:2], color=style.OBJECTIVE, ls="--", label="drawing")
    rounded = 1e3 * path(np.linspace(0, path.length, 40_001))
    corner.plot(*rounded.T[:2], color=style.BLACK, lw=1, label="rounded by 0.25 mm")
    for name, set_points, colour in (
        ("planned positions", uncompensated, style.VERMILLION),
        ("compensated", example["set_points"], style.BLUE),
    ):
        executed = ac.simulate(set_points, example["robot"])
        error = ac.evaluate(executed, path).contour_error
        corner.plot(*1e3 * executed.tool.T[:2], color=colour, lw=1.6, label=name)
        label = f"{name}: {1e3 * error.rms:.3f} mm RMS"
        errors.plot(error.t, 1e3 * error.values, color=colour, lw=1.2, label=label)
    x, y = square[1, :2]
    corner.set(xlim=(x - 1.6, x + 0.9), ylim=(y - 1.2, y + 1.3), aspect="equal")
    corner.set(xlabel="x [mm]", ylabel="y [mm]", title="(a) The first corner")
    corner.legend(loc="lower right")
    errors.set(xlabel="time [s]", ylabel="contour error [mm]", ylim=(0, 0.7))
    errors.set_title("(b) Distance from the rounded path")
    errors.legend(loc="upper right")
    return figure


def draw_fig_bends() -> Figure:
    """Draw three blends of a corner with equal corner errors, and their curvatures."""
    corner = ac.Path.polyline([(-SIDE, 0.0), (0.0, 0.0), (0.0, SIDE)])
    smooth = ac.round_corners(corner, tolerance=ERROR, continuity="curvature")
    figure, (shape, curvature) = plt.subplots(1, 2, figsize=(8.6, 3.9), width_ratios=(1, 1.3))
    shape.plot(*1e3 * corner.vertices.T, color=style.OBJECTIVE, ls="--", label="objective path")
    for name, colour, path, line in (
        ("arc", style.BLUE, ac.round_corners(corner, tolerance=ERROR), "-"),
        (
            "parabola, as arcs",
            style.ORANGE,
            round_path(corner, tolerance=ERROR, curve="parabola"),
            "-",
        ),
        ("smooth bend", style.GREEN, smooth, "--"),
    ):
        s = np.linspace(0, path.length, 1201)
        shape.plot(*1e3 * path(s).T, color=colour, lw=1.4, ls=line, label=name)
        bent = np.linalg.norm(path(s, 2), axis=-1)
        curvature.plot(1e3 * (s - path.length / 2), bent, color=colour)
    shape.add_patch(plt.Circle((0, 0), 1e3 * ERROR, fill=False, color=style.GREY, lw=0.8, ls=":"))
    shape.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", xlim=(-17, 6), ylim=(-6, 17))
    shape.set_title("(a) Corner error 5 mm")
    shape.legend(loc="upper left")
    curvature.set(xlabel="arc length from the middle [mm]", ylabel="curvature [1/m]")
    curvature.set(xlim=(-25, 25), ylim=(0, None), title="(b) Curvature along the way")
    return figure


def draw_fig_evaluation() -> Figure:
    """Draw contour error and tracking error of a robot whose joints have different gains."""
    plan = planned()
    set_points = ac.compensate(plan, SERVO, ac.NoCompensation(), cycle=CYCLE)
    robot = ac.ServoPlant(ARM, SERVO.replace(kp=[25.0, 20.0]), LIMITS)
    executed = ac.simulate(set_points, robot)
    result = ac.evaluate(executed, ROUNDED, objective=OBJECTIVE, limits=LIMITS)
    figure, (near, time) = plt.subplots(1, 2, figsize=(9.0, 4.0), width_ratios=(1, 1.3))
    t = result.contour_error.t_max
    tool = 1e3 * executed.tool[np.searchsorted(executed.t, t)]
    target = 1e3 * ARM.tool_position(plan(t))
    nearest = 1e3 * ROUNDED(ROUNDED.project(tool[None] / 1e3).s)[0]
    path = ROUNDED(np.linspace(0, ROUNDED.length, 2000))
    near.plot(*1e3 * path.T, color=style.BLACK, lw=1, label="path")
    near.plot(*1e3 * executed.tool.T, color=style.BLUE, lw=1.6, label="motion of the tool")
    near.plot(*np.array([tool, target]).T, color=style.ORANGE, lw=2.2)
    near.plot(*np.array([tool, nearest]).T, color=style.VERMILLION, lw=3)
    for name, point, offset in (
        ("tool", tool, (16, -10)),
        ("plan", target, (-18, 8)),
        ("nearest point", nearest, (-16, 12)),
    ):
        near.plot(*point, "o", color=style.BLACK, ms=4, zorder=5)
        style.label(near, name, tuple(point), offset)
    x, y = ((c - VIEW, c + VIEW) for c in (tool + target) / 2)
    near.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal", xlim=x, ylim=y)
    near.set_title(f"(a) At {t:.2f} s")
    near.legend(loc="lower right")
    for profile, name, colour in (
        (result.tracking_error, "tracking error", style.ORANGE),
        (result.contour_error, "contour error", style.VERMILLION),
    ):
        label = f"{name}: {1e3 * profile.rms:.2f} mm RMS, {1e3 * profile.max:.2f} mm at most"
        time.plot(profile.t, 1e3 * profile.values, color=colour, label=label)
    time.axvline(plan.duration, color=style.GREY, lw=0.8, ls=":")
    time.set(xlabel="time [s]", ylabel="[mm]", ylim=(0, None))
    time.set_title("(b) Both over time; dotted: end of the plan")
    time.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
    return figure


def draw_fig_optimal() -> Figure:
    """Draw tool speed and joint accelerations over arc length, coloured by the active limits."""
    plan = ac.plan(ROUNDED, ARM, LIMITS)
    s = plan.s(plan.breaks)
    ds = plan.s(plan.breaks, 1)
    ddq = plan(plan.breaks, 2)
    figure, rows = plt.subplots(3, 1, figsize=(8.6, 7.2), sharex=True, height_ratios=(3, 1.4, 1.4))
    for part in ac.explain(plan, ARM, LIMITS).bindings:
        on = (s >= part.s[0]) & (s <= part.s[1])
        for axes, values in zip(rows, (1e3 * ds, *ddq.T), strict=True):
            axes.plot(1e3 * s[on], values[on], color=LIMITING.get(part.name, style.GREY), lw=2.2)
    for name, colour in LIMITING.items():
        rows[0].plot([], [], color=colour, label=name)
    rows[0].axhline(1e3 * LIMITS.speed, **style.LIMIT)
    rows[0].set(ylabel="path speed $ds/dt$ [mm/s]", ylim=(0, 172))
    rows[0].set_title("(a) Speed along the path, in the colour of the limiting constraint")
    for j, axes in enumerate(rows[1:]):
        for sign in (-1, 1):
            axes.axhline(sign * ACCELERATION[j], **style.LIMIT)
        axes.set(ylabel="rad/s²", ylim=(-0.9, 0.9))
        axes.set_title(f"({'bc'[j]}) Joint {j + 1} acceleration")
    rows[2].set(xlabel="arc length $s$ [mm]", xlim=(0, 1e3 * ROUNDED.length))
    figure.legend(loc="outside lower center", ncols=4)
    return figure


class Node(NamedTuple):
    """Box of a value in the data flow: column, row, text and colour."""

    column: int
    row: int
    text: str
    colour: str


NODES = (
    Node(0, 0, "drawing,\nwaypoints, G-code", style.GREY),
    Node(1, 0, "Program:\ncontours, rapids", style.BLUE),
    Node(2, 0, "Program,\nrounded corners", style.BLUE),
    Node(3, 0, "Tracing:\njoint paths", style.BLUE),
    Node(0, 1, "Evaluation,\nreport", style.GREEN),
    Node(1, 1, "Execution:\njoints and tool", style.BLUE),
    Node(2, 1, "SetPoints:\njoints, each cycle", style.BLUE),
    Node(3, 1, "Trajectory:\njoints over time", style.BLUE),
    Node(0, 2, "ServoModel", style.ORANGE),
    Node(1, 2, "Log: commands,\nmeasurements", style.GREY),
    Node(2, 2, "file or adapter\nof a controller", style.GREY),
)
STEPS = (
    ("read_path,\nprepare", 0, 1),
    ("round_corners,\nshape", 1, 2),
    ("trace\n(arm)", 2, 3),
    ("plan (limits)", 3, 7),
    ("compensate", 7, 6),
    ("simulate", 6, 5),
    ("evaluate", 5, 4),
    ("export, play", 6, 10),
    ("robot", 10, 9),
    ("identify", 9, 8),
)
# Distances between the centres of neighbouring columns and of neighbouring rows of boxes.
COLUMN = 38
ROW = 23
# Width and height of a box.
BOX = (23, 9)
THIN = {"color": style.BLACK, "lw": 1}


def draw_flow() -> Figure:
    """Draw the data flow from a drawing to set-points and contour error, and back from a log."""
    figure, axes = plt.subplots(figsize=(9.6, 4.2))
    axes.set(xlim=(-13, 3 * COLUMN + 25), ylim=(-2 * ROW - 14, 7), aspect="equal")
    axes.axis("off")
    centres = [(COLUMN * x.column, -ROW * x.row) for x in NODES]
    for node, centre in zip(NODES, centres, strict=True):
        style.box(axes, centre, BOX, node.text, node.colour)
    for name, begin, end in STEPS:
        x, y = centres[begin]
        x_end, y_end = centres[end]
        middle = ((x + x_end) / 2, (y + y_end) / 2)
        if y == y_end:
            half = BOX[0] / 2 if x_end > x else -BOX[0] / 2
            style.arrow(axes, (x + half, y), (x_end - half, y))
            axes.text(middle[0], y + 1, name, ha="center", va="bottom", fontsize=8)
        else:
            style.arrow(axes, (x, y - BOX[1] / 2), (x_end, y_end + BOX[1] / 2))
            axes.text(x + 1.5, middle[1], name, ha="left", va="center", fontsize=8)
    # The servo model enters `compensate`, and the log the learning of set-points.
    x, y = centres[8]
    log, _ = centres[9]
    used, used_y = centres[6]
    low = y - 8
    right = 2.5 * COLUMN
    top = used_y - 0.3
    axes.plot([x, x, right, right], [y - BOX[1] / 2, low, low, top - 2], **THIN)
    style.arrow(axes, (right, top - 3), (right, top))
    axes.text(right + 1.5, (low + top) / 2, "servo\nmodel", ha="left", va="center", fontsize=8)
    style.arrow(axes, (log + 8, y + BOX[1] / 2), (used - 8, used_y - BOX[1] / 2))
    axes.text(log + 15, y + 12.5, "learn", ha="right", va="center", fontsize=8)
    return figure
