"""Figures of the paper's contouring job, Sec. IV-A, redrawn; everything is computed once."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle

import armcontour as ac
from armcontour.jobs.methods import COMPENSATIONS
from armcontour.paper.timing import PaperLine
from armcontour.verification import Evaluation

FINE = 2e-4  # s: nearly a continuous command
CYCLE = 4e-3  # s: a usual cycle
KNOTS = 600
CONVENTIONAL_TIME = 12.06  # s, T_total of Table I
# Table I, mm: root mean square errors of the paper's simulations.
PRINTED = {"conventional": 2.630, "proposed": 0.164}
LOWEST = 1e-5  # mm

ARM = ac.load_arm("pmk3s")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
OBJECTIVE = ac.Path.polyline([(0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350)])
LIMITS = ARM.limits.replace(speed=0.15, centripetal_acceleration=0.09)
ROUNDED = ac.round_corners(OBJECTIVE, tolerance=5e-3, acceleration=0.09)
ACCELERATION = LIMITS.for_joints(2).joint_acceleration


class Result(NamedTuple):
    """An execution and its evaluation."""

    executed: ac.Execution
    evaluation: Evaluation


@cache
def planned() -> ac.Trajectory:
    """The realizable trajectory."""
    return ac.plan(ROUNDED, ARM, LIMITS, ac.Paper(knots=KNOTS))


@cache
def conventional() -> Result:
    """Uniform speed along the objective path, no compensation."""
    limits = LIMITS.replace(speed=0.04)
    trajectory = ac.plan(OBJECTIVE, ARM, limits, ac.Conventional())
    set_points = ac.compensate(trajectory, SERVO, ac.NoCompensation(), cycle=FINE)
    executed = ac.simulate(set_points, ac.ServoPlant(ARM, SERVO, limits))
    return Result(
        executed, ac.evaluate(executed, OBJECTIVE, limits=limits, end_time=CONVENTIONAL_TIME)
    )


@cache
def proposed(method: str = "pole_placement", fill: str = "linear", cycle: float = FINE) -> Result:
    """The realizable trajectory, compensated, on a servo with an interpolation."""
    set_points = ac.compensate(planned(), SERVO, COMPENSATIONS[method](), cycle=cycle)
    plant = ac.ServoPlant(ARM, SERVO.replace(interpolation=fill), LIMITS)
    executed = ac.simulate(set_points, plant)
    return Result(executed, ac.evaluate(executed, ROUNDED, objective=OBJECTIVE, limits=LIMITS))


def draw_overview() -> Figure:
    """Left the path with a corner enlarged; right the error over time."""
    old, new = conventional(), proposed()
    figure, (path_axes, right) = plt.subplots(1, 2, figsize=(10, 5), width_ratios=[0.85, 1.15])
    corner = 1e3 * OBJECTIVE.vertices[1]
    inset = path_axes.inset_axes([0.02, 0.02, 0.46, 0.40])
    for points, width, look in (
        (
            OBJECTIVE.vertices,
            1.0,
            {"color": style.OBJECTIVE, "ls": "--", "label": "objective path"},
        ),
        (old.executed.tool, 1.2, {"color": style.CONVENTIONAL, "label": "conventional"}),
        (new.executed.tool, 1.6, {"color": style.PROPOSED, "label": "proposed"}),
    ):
        path_axes.plot(*1e3 * points.T, lw=width, **look)
        inset.plot(*1e3 * points.T, lw=1.3 * width, **look)
    path_axes.set_aspect("equal")
    inset.set(xlim=(corner[0] - 22, corner[0] + 10), ylim=(corner[1] - 14, corner[1] + 14))
    inset.set(xticks=[], yticks=[], aspect="equal")
    inset.spines[["top", "right"]].set_visible(True)
    path_axes.indicate_inset_zoom(inset, edgecolor=style.BLACK, lw=0.7, alpha=0.6)
    path_axes.set(xlabel="$x$ [mm]", ylabel="$y$ [mm]", xlim=(236, 428), ylim=(60, 372))
    path_axes.set_title("Path of the tool")
    path_axes.legend(loc="center left", bbox_to_anchor=(0.0, 0.44), fontsize=9, handlelength=1.4)
    _errors(right, uncompensated=False)
    right.set_title("Distance of the tool from its path")
    right.legend(loc="lower right", fontsize=9)
    captions = [
        f"{name}: {x.duration:.2f} s, at rest after {x.settled:.2f} s, "
        f"contour error {1e3 * x.contour_error.rms:.2g} mm RMS"
        for name, x in (("Conventional", old.evaluation), ("Proposed", new.evaluation))
    ]
    figure.suptitle("\n".join(captions), fontsize=11)
    return figure


def draw_fig03_corner() -> Figure:
    """Corner 1 of the job, with its points, its radius and its corner error."""
    corners = ROUNDED.corners
    s = corners.start[0], corners.end[0]
    i = int(ROUNDED.locate(s[0]))
    centre = ROUNDED.starts[i] + ROUNDED.normals[i] / ROUNDED.curvatures[i]
    h, g, r, q = (1e3 * x for x in (corners.point[0], centre, ROUNDED(s[0]), ROUNDED(s[1])))
    middle = 1e3 * ROUNDED(np.mean(s))
    before, after = ROUNDED(s[0], 1), ROUNDED(s[1], 1)

    figure, axes = plt.subplots(figsize=(6.4, 4.6))
    axes.set_aspect("equal")
    axes.axis("off")
    arc = 1e3 * ROUNDED(np.linspace(*s, 200))
    first = r - 16 * before
    last = q + 16 * after
    rounded = {"color": style.PROPOSED, "lw": 2.5}
    thin = {"color": style.BLACK, "lw": 0.8}
    error = {"color": style.VERMILLION, "lw": 2.5}
    error["label"] = f"corner error $ε$ = {1e3 * corners.error[0]:.0f} mm"
    for points, look in (
        ((first, h, last), {"color": style.OBJECTIVE, "ls": "--", "label": "objective path"}),
        ((first, *arc, last), rounded | {"label": "rounded path"}),
        ((r, g, q), thin),
        ((g, middle), thin | {"ls": ":"}),
        ((middle, h), error),
    ):
        axes.plot(*np.array(points).T, **look)
    axes.plot(*np.array([r, g, q, h]).T, "o", color=style.BLACK, ms=4)
    for text, point, offset in (
        ("$R$", r, (12, -8)),
        ("$S$", q, (4, 14)),
        ("$G$", g, (-11, -6)),
        ("$H$", h, (13, 0)),
        ("$r$", (r + g) / 2, (-6, -10)),
        ("$r$", (q + g) / 2, (-8, 8)),
        ("$ε$", (h + middle) / 2, (2, 9)),
    ):
        style.label(axes, text, tuple(point), offset)
    for point, heading, text, size in (
        (first, before, "$α_1$", 5),
        (q + 4 * after, after, "$α_2$", 4),
    ):
        axes.plot([point[0], point[0] + 1.5 * size], [point[1], point[1]], color=style.GREY, lw=0.8)
        _angle(axes, point, (np.array([1.0, 0.0]), heading), size, 1.45 * size, text)
    turn = r"$\frac{α_2-α_1}{2}$"
    _angle(axes, g, (r - g, middle - g), 3.5, 7.4, turn)
    axes.legend(loc="lower left", bbox_to_anchor=(1.0, 0.0))
    axes.set_title(
        "Corner 1 of the job: "
        f"turn $α_2-α_1$ = {np.degrees(corners.turn[0]):.1f}°, $r$ = {1e3 * corners.radius[0]:.2f} "
        f"mm, speed {1e3 * corners.speed[0]:.1f} mm/s"
    )
    return figure


def _angle(axes: Axes, vertex, between, radius: float, away: float, text: str) -> None:
    """An angle between two directions, with its name."""
    begin, end = (np.arctan2(v[1], v[0]) for v in between)
    theta = {"theta1": np.degrees(begin), "theta2": np.degrees(end)}
    axes.add_patch(Arc(vertex, 2 * radius, 2 * radius, color=style.GREY, lw=0.8, **theta))
    half = (begin + end) / 2
    axes.text(
        *vertex + away * np.array([np.cos(half), np.sin(half)]), text, ha="center", va="center"
    )


def draw_fig05_passes() -> Figure:
    """Both passes over line 2 from rest to rest, line_pass on beyond the assigned velocity."""
    path = ac.Path.polyline(OBJECTIVE.vertices[1:3])
    trajectory = ac.plan(path, ARM, LIMITS, ac.Paper(knots=KNOTS))
    joint_path = ac.trace(path, ARM)
    share = np.linspace(0, 1, 1501)
    line, back = (
        PaperLine(
            name="line",
            joint_path=joint_path,
            arm=ARM,
            limit=ACCELERATION,
            s=path.length * s,
            assigned=LIMITS.speed,
        )
        for s in (share**2, 1 - (1 - share) ** 2)
    )
    end = trajectory.duration
    _, t_f, t_2, _ = trajectory.switching_points
    assigned = 1e3 * LIMITS.speed

    figure, (top, bottom) = plt.subplots(2, 1, figsize=(7.2, 5.6), sharex=True)
    for line_pass, rule, name, clock in (
        (line.forward(0.0), "MAC", "forward pass (MAC)", lambda t: t),
        (back.reverse(0.0), "MDC", "reverse pass (MDC)", lambda t: end - t),
    ):
        t = clock(np.concatenate([[0.0], np.cumsum(line_pass.durations[: line_pass.valid_count])]))
        speed = 1e3 * line_pass.speed[: line_pass.valid_count + 1]
        within = speed <= assigned
        top.plot(t[within], speed[within], color=style.RULES[rule], lw=2.5, label=name)
        top.plot(t[~within], speed[~within], color=style.RULES[rule], lw=1.2, ls=":")
    top.plot([], [], color=style.GREY, lw=1.2, ls=":", label="not used: above $v_a$")
    for part in trajectory.stretches:
        t = np.linspace(*part.t, 300)
        velocity = ARM.tool_velocity(trajectory(t), trajectory(t, 1, side="left"))
        look = {"color": style.RULES[part.kind], "label": style.RULE_NAMES[part.kind]}
        bottom.plot(t, 1e3 * np.linalg.norm(velocity, axis=1), lw=2.5, **look)
    for axes in (top, bottom):
        axes.axhline(assigned, **style.LIMIT)
        for t in (t_f, t_2):
            axes.axvline(t, color=style.GREY, lw=0.8)
        axes.set(ylabel="tool speed [mm/s]", ylim=(0, 240), xlim=(0, end))
        axes.legend(loc="lower center")
    top.text(0.02, assigned + 5, "assigned velocity $v_a$", fontsize=8)
    style.label(top, "$t = t_f$, $P_1$", (t_f, 222), (0, 0))
    style.label(top, "$t = T - t_r$, $P_2$", (t_2, 222), (0, 0))
    top.set_title("(a) Forward and reverse pass, and where they are switched")
    bottom.set(title="(b) Tool speed of the line", xlabel="time [s]")
    return figure


def draw_fig07_blocks() -> Figure:
    """Realizable trajectory, compensator, servo (7), joint."""
    figure, axes = plt.subplots(figsize=(9.6, 3.2))
    axes.set(xlim=(-6, 134), ylim=(0, 40), aspect="equal")
    axes.axis("off")
    y = 20
    for x, width, height, text, colour in (
        (19, 18, 11, "compensator\n$F_j(s)$, (26)", style.ORANGE),
        (59, 8, 8, "$K_{pj}$", style.BLUE),
        (77, 8, 8, "$K_{vj}$", style.BLUE),
        (90, 12, 8, "sat, (7)", style.VERMILLION),
        (105, 6, 8, "1/s", style.BLUE),
        (118, 6, 8, "1/s", style.BLUE),
    ):
        style.box(axes, (x, y), (width, height), text, colour)
    ends = (-5, 10, 28, 47.8, 52.2, 55, 63, 65.8, 70.2, 73, 81, 84, 96, 102, 108, 115, 121, 134)
    for begin, end in zip(ends[::2], ends[1::2], strict=True):
        style.arrow(axes, (begin, y), (end, y))
    for x in (50, 68):
        axes.add_patch(Circle((x, y), 2.2, fc="white", ec=style.BLACK, lw=1))
        axes.text(x - 3.6, y + 3, "+", ha="center", va="center", fontsize=8)
        axes.text(x + 2.2, y - 4.2, "−", ha="center", va="center", fontsize=9)
    for x, text in (
        (1.5, "realizable\ntrajectory"),
        (35.5, "set-points\n$u_j$"),
        (99, r"$\ddotθ_j$"),
        (111.5, r"$\dotθ_j$"),
        (131, "$θ_j$"),
    ):
        axes.text(x, y + 2.3, text, ha="center", va="bottom", fontsize=8)
    for x, to, low in ((111.5, 68, 12), (125, 50, 8)):
        axes.plot([x, x, to, to], [y, low, low, y - 2.2], color=style.BLACK, lw=1)
        axes.plot([x], [y], "o", color=style.BLACK, ms=3)
        style.arrow(axes, (to, y - 5), (to, y - 2.2))
    axes.plot([44, 44, 127.5, 127.5, 44], [5, 32, 32, 5, 5], color=style.GREY, lw=0.8, ls="--")
    axes.text(85.7, 33, "servo of joint $j$", color=style.GREY, ha="center", va="bottom")
    axes.set_title("Forward compensation of the servo's delay", pad=10)
    return figure


def draw_fig08_trajectory() -> Figure:
    """The realizable trajectory in Cartesian and in joint space, coloured by rule."""
    trajectory = planned()
    figure, (path_axes, right) = plt.subplots(1, 2, figsize=(9.6, 5.4))
    path_axes.plot(*1e3 * OBJECTIVE.vertices.T, color=style.OBJECTIVE, ls="--", lw=1)
    for part in trajectory.stretches:
        q = trajectory(np.linspace(*part.t, 100))
        for axes, points in ((path_axes, 1e3 * ARM.tool_position(q)), (right, np.degrees(q))):
            axes.plot(*points.T, color=style.RULES[part.kind], lw=2.2)
    for kind, colour in style.RULES.items():
        path_axes.plot([], [], color=colour, label=style.RULE_NAMES[kind])
    q = trajectory(trajectory.switching_points)
    # Offsets of the names from their points, in points of type.
    at_left = "-13 0 10 -9 11 -9 12 7 12 7 12 7 -12 -7 -7 12 9 -11 12 6"
    at_right = "13 2 -13 -2 15 3 -4 -12 2 12 -2 12 -4 13 -6 -13 -12 -8 -12 -8"
    for axes, points, offsets in (
        (path_axes, 1e3 * ARM.tool_position(q), at_left),
        (right, np.degrees(q), at_right),
    ):
        axes.plot(*points.T, "o", color=style.BLACK, ms=3.5, zorder=5)
        label_offsets = np.array(offsets.split(), float).reshape(-1, 2)
        for k, (point, offset) in enumerate(zip(points, label_offsets, strict=True)):
            style.label(axes, f"$P_{k}$", tuple(point), tuple(offset))
        axes.margins(0.08)
    path_axes.set(title="(a) Cartesian space", xlabel="$x$ [mm]", ylabel="$y$ [mm]", aspect="equal")
    right.set(title="(b) Joint space", xlabel="$θ_1$ [°]", ylabel="$θ_2$ [°]")
    figure.legend(loc="outside lower center", ncols=4)
    return figure


def draw_fig09_profiles() -> Figure:
    """Tool speed and joint accelerations over time, with limits and switching points."""
    trajectory = planned()
    points = trajectory.switching_points
    figure, rows = plt.subplots(3, 1, figsize=(8.6, 6.4), sharex=True)
    for begin, end in zip(points[:-1], points[1:], strict=True):
        # From the right at the begin of a stretch, from the left at its end.
        t = np.linspace(begin, np.nextafter(end, begin), 300)
        speed = np.linalg.norm(ARM.tool_velocity(trajectory(t), trajectory(t, 1)), axis=1)
        for axes, value in zip(rows, (1e3 * speed, *trajectory(t, 2).T), strict=True):
            axes.plot(t, value, color=style.PROPOSED)
    rows[0].axhline(1e3 * LIMITS.speed, **style.LIMIT)
    rows[0].text(0.02, 1e3 * LIMITS.speed + 4, "assigned velocity", fontsize=8)
    rows[0].set(ylabel="mm/s", ylim=(0, 180))
    rows[0].set_title("(a) Tool speed", pad=16)
    for j, axes in enumerate(rows[1:]):
        for sign in (-1, 1):
            axes.axhline(sign * ACCELERATION[j], **style.LIMIT)
        axes.set(ylabel="rad/s²", ylim=(-0.95, 0.95))
        axes.set_title(f"({'bc'[j]}) Joint {j + 1} acceleration")
    for k, instant in enumerate(points):
        rows[0].text(instant, 181, f"$P_{k}$", ha="center", va="bottom", fontsize=8)
        for axes in rows:
            axes.axvline(instant, color=style.GREY, lw=0.6, ls=":")
    rows[2].set(xlabel="time [s]", xlim=(0, trajectory.duration))
    return figure


def draw_fig10_results() -> Figure:
    """Rows: path, tool speed, joint accelerations; a column for each way to do the job."""
    columns = (
        ("Conventional\n(simulation)", conventional(), style.CONVENTIONAL, CONVENTIONAL_TIME),
        ("Proposed\n(simulation)", proposed(), style.PROPOSED, 6.0),
        (
            "Proposed, held as steps every 4 ms\n(simulation, not the paper's experiment)",
            proposed(fill="step", cycle=CYCLE),
            style.OTHER,
            7.5,
        ),
    )
    figure, grid = plt.subplots(4, 3, figsize=(11, 11), height_ratios=[2.6, 1, 1, 1], sharey="row")
    for (title, (executed, evaluation), colour, end), column in zip(columns, grid.T, strict=True):
        error = evaluation.contour_error
        inside = executed.t <= end
        t = executed.t[inside]
        path, speed, *joints = column
        path.plot(*1e3 * OBJECTIVE.vertices.T, color=style.OBJECTIVE, lw=1, ls="--")
        path.plot(*1e3 * executed.tool[inside].T, color=colour, lw=1.3)
        caption = f"RMS {1e3 * error.rms:.2g} mm, largest {1e3 * error.max:.2g} mm"
        path.set_title(f"{title}\n{caption}", fontsize=9)
        path.set(xlabel="$x$ [mm]", aspect="equal", adjustable="box", xlim=(268, 426))
        speed.plot(t, 1e3 * executed.tool_speed[inside], color=colour, lw=1)
        speed.axhline(1e3 * LIMITS.speed, **style.LIMIT)
        speed.set(xlim=(0, end), ylim=(0, 185))
        for j, axes in enumerate(joints):
            axes.plot(t, executed.ddq[inside, j], color=colour, lw=0.8)
            for sign in (-1, 1):
                axes.axhline(sign * ACCELERATION[j], **style.LIMIT)
            axes.set_title(f"largest demand {evaluation.demand[j]:.3g} rad/s²", fontsize=7.5)
            axes.set(xlim=(0, end), ylim=(-1.15, 1.15))
        joints[-1].set_xlabel("time [s]")
    texts = ["$y$ [mm]", "tool speed [mm/s]"]
    texts += [f"joint {j} acceleration\n[rad/s²]" for j in (1, 2)]
    for axes, text in zip(grid[:, 0], texts, strict=True):
        axes.set_ylabel(text)
    return figure


def draw_fig11_errors() -> Figure:
    """Contour error over time: linear above, as in the paper; logarithmic below."""
    figure, (top, bottom) = plt.subplots(2, 1, figsize=(8.6, 6.4), sharex=True)
    for result, colour, name in (
        (conventional(), style.CONVENTIONAL, "conventional, from the objective path"),
        (proposed(), style.PROPOSED, "proposed, from the rounded path"),
    ):
        error = result.evaluation.contour_error
        top.plot(error.t, 1e3 * error.values, color=colour, label=name)
    top.set(ylabel="contour error [mm]", ylim=(0, 16), title="(a) Linear scale")
    top.legend(loc="upper left")
    _errors(bottom)
    for name, colour in (("conventional", style.CONVENTIONAL), ("proposed", style.PROPOSED)):
        bottom.axhline(PRINTED[name], color=colour, lw=0.8, ls="--")
        text = f"printed RMS, {name}: {PRINTED[name]:.3f} mm"
        style.label(bottom, text, (5.45, PRINTED[name]), (0, 7))
    bottom.set_title("(b) Logarithmic scale, largest value of every 10 ms")
    bottom.legend(loc="lower right")
    return figure


def _errors(axes: Axes, *, uncompensated: bool = True) -> None:
    """The largest error [mm] of every 10 ms, on a logarithmic scale."""
    runs = [(conventional(), style.CONVENTIONAL, "conventional")]
    if uncompensated:
        runs.append((proposed("none"), style.OTHER, "proposed, no compensation"))
    for result, colour, name in [*runs, (proposed(), style.PROPOSED, "proposed")]:
        error = result.evaluation.contour_error
        t = np.arange(error.t[0], error.t[-1], 0.01)
        peaks = np.maximum.reduceat(1e3 * error.values, np.searchsorted(error.t, t))
        label = f"{name}: RMS {1e3 * error.rms:.2g} mm"
        axes.semilogy(t, np.maximum(peaks, LOWEST), color=colour, lw=1.2, label=label)
    axes.set(xlabel="time [s]", ylabel="contour error [mm]", ylim=(LOWEST, 40), xlim=(0, 12.06))
