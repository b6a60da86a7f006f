"""The sample drawings as programs: contours, leads, rapids and events, in place and over time."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D

from armcontour.io.cell import read_cell
from armcontour.jobs import Job
from armcontour.jobs.programs import plan_run, programs_of
from armcontour.motion import Trajectory
from armcontour.program import Program

DRAWINGS = Path(__file__).parents[2] / "examples" / "drawings"
LAYERS = (style.BLUE, style.VERMILLION)
ROWS = {"contour": style.BLUE, "rapid": style.GREY}
PLACES = 400  # of every contour
# Seen from the robot's side of the table, x to the right.
TURNED = np.array([[0.0, -1.0], [1.0, 0.0]])


def draw() -> Figure:
    """Plan the three and draw them, with the first over time."""
    figure = plt.figure(figsize=(9.6, 6.6), layout="none")
    first = figure.add_axes((0.06, 0.4, 0.29, 0.52))
    second = figure.add_axes((0.41, 0.4, 0.27, 0.52))
    third = figure.add_axes((0.69, 0.4, 0.25, 0.5), projection="3d")
    time = figure.add_axes((0.09, 0.09, 0.89, 0.16))

    job, program, plan = _planned(str(DRAWINGS / "laser.yaml"), "gasket.dxf")
    _flat(first, job, program, plan)
    first.set_title("gasket.dxf: leads, laser on and off")
    _over_time(time, plan)

    job, program, plan = _planned("pmk3s", "lettering.svg")
    _flat(second, job, program, plan)
    second.set(title="lettering.svg: open strokes", ylabel="")

    job, program, plan = _planned("ur5e", "pocket.ngc")
    _space(third, job, program, plan)
    third.set_title("pocket.ngc: two depths")
    figure.legend(
        *_legend(first), loc="center", bbox_to_anchor=(0.5, 0.315), ncols=6, columnspacing=1.4
    )
    return figure


def _planned(cell: str, drawing: str) -> tuple[Job, Program, Trajectory]:
    """The job of a drawing in a cell, its program and its plan."""
    job = read_cell(cell, DRAWINGS / drawing)
    (run,) = job.runs
    _, program = programs_of(job, run)
    return job, program, plan_run(job, run, program)


def _flat(axes: Axes, job: Job, program: Program, plan: Trajectory) -> None:
    """From above, in mm; what an arm in space does is turned, so that its y is to the right."""
    layers = list(dict.fromkeys(x.layer for x in program.contours))
    for span in plan.spans:
        if span.kind == "rapid":
            tool = _seen(job.arm.forward(plan(np.linspace(*span.t, 60), side="left")))
            axes.plot(*tool.T, color=style.GREY, lw=0.8, ls=(0, (4, 2)), zorder=1)
    for x in program.contours:
        begin, end = x.work or (0.0, x.path.length)
        colour = LAYERS[layers.index(x.layer) % len(LAYERS)]
        axes.plot(*_along(x.path, begin, end), color=colour, lw=1.5, zorder=2)
        for lead in ((0.0, begin), (end, x.path.length)):
            if lead[1] - lead[0] > 1e-9:
                axes.plot(*_along(x.path, *lead), color=style.ORANGE, lw=1.5, zorder=3)
        middle = (begin + end) / 2
        here, ahead = _seen(x.path([middle, min(middle + 1e-3, end)]))
        axes.annotate("", ahead, here, arrowprops={"arrowstyle": "-|>", "color": colour}, zorder=4)
    for event in plan.events:
        look = {"mfc": style.GREEN} if event.value is True else {"mfc": "white"}
        place = _seen(np.array([event.point]))[0]
        axes.plot(*place, "o", ms=4.5, mec=style.BLACK, mew=0.7, zorder=5, **look)
    axes.set_aspect("equal")
    names = ("x", "y") if program.dimension == 2 else ("-y", "x")
    axes.set(xlabel=f"{names[0]} [mm]", ylabel=f"{names[1]} [mm]")


def _along(path: object, begin: float, end: float) -> np.ndarray:
    return _seen(path(np.linspace(begin, end, PLACES))).T  # type: ignore[operator]


def _seen(points: np.ndarray) -> np.ndarray:
    """Points from above [mm]."""
    if points.shape[1] == 2:
        return 1e3 * points
    return 1e3 * points[:, :2] @ TURNED.T


def _space(axes: Axes3D, job: Job, program: Program, plan: Trajectory) -> None:
    for span in plan.spans:
        if span.kind == "rapid":
            tool = 1e3 * job.arm.forward(plan(np.linspace(*span.t, 60), side="left"))
            axes.plot(*tool.T, color=style.GREY, lw=0.8, ls=(0, (4, 2)))
    for x in program.contours:
        points = 1e3 * x.path(np.linspace(0, x.path.length, 4 * PLACES))
        axes.plot(*points.T, color=style.BLUE, lw=1.2)
    axes.set(xlabel="x [mm]", ylabel="y [mm]")
    axes.set_zlabel("z [mm]", labelpad=-2)
    axes.set_box_aspect((1, 0.9, 0.5))
    axes.locator_params(nbins=4)
    axes.tick_params(labelsize=7, pad=0)
    axes.view_init(elev=32, azim=-62)


def _over_time(axes: Axes, plan: Trajectory) -> None:
    rows = list(ROWS)[::-1]
    for span in plan.spans:
        if span.kind in ROWS:
            width = span.t[1] - span.t[0]
            y = rows.index(span.kind) + 1
            axes.barh(y, width, left=span.t[0], height=0.7, color=ROWS[span.kind], ec="white")
    for event in plan.events:
        colour = style.GREEN if event.value is True else style.BLACK
        axes.plot([event.t] * 2, [-0.3, 0.3], color=colour, lw=1.4)
    axes.set_yticks([0, 1, 2], ["events", "rapids", "contours"])
    axes.set(xlabel="time [s]", xlim=(-0.2, plan.duration + 0.2))
    axes.set_title("gasket.dxf over time")
    axes.grid(axis="y", visible=False)


def _legend(axes: Axes) -> tuple[list[object], list[str]]:
    lines = {
        "contour": {"color": style.BLUE},
        "second layer": {"color": style.VERMILLION},
        "lead, tool off": {"color": style.ORANGE},
        "rapid": {"color": style.GREY, "lw": 0.8, "ls": (0, (4, 2))},
        "on": {"ls": "", "marker": "o", "ms": 4.5, "mec": style.BLACK, "mfc": style.GREEN},
        "off": {"ls": "", "marker": "o", "ms": 4.5, "mec": style.BLACK, "mfc": "white"},
    }
    handles = [axes.plot([], [], **look)[0] for look in lines.values()]
    return handles, list(lines)
