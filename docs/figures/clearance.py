"""A thin plate that an arm passes between two samples, and what is proven between them."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

import armcontour as ac
from armcontour.clearance.clearance import Cell
from armcontour.motion.travel import joint_travel
from armcontour.scene import Box, Obstacle, Scene

FILE = "fig_clearance"

ARM = ac.load_arm("pmk3s")
BASE = np.array([ARM.base, 0.0])  # m
SWEEP = [(-0.3, 0.9), (1.0, 0.9)]  # rad
LIMITS = ac.Limits(joint_velocity=2.5, joint_acceleration=6.0)
PLATE = np.array([0.06, 0.001, 0.5])  # m, upright
EVERY = 0.1  # s, between two samples
HIT = 5  # The plate stands between this sample and the next one.


def draw() -> Figure:
    """From above the arm at the samples; beside it the distance from the plate over time."""
    plan = ac.plan(ac.JointPath.spline(SWEEP), limits=LIMITS)
    samples = np.arange(0, plan.duration, EVERY)
    plate = _plate(float(samples[HIT] + 0.5 * EVERY), plan)
    scene = Scene(obstacles=(plate,))
    cell = Cell(ARM, scene)
    figure, (above, distance) = plt.subplots(1, 2, figsize=(9.0, 4.2), width_ratios=(1, 1.35))
    _from_above(above, plan, samples, cell)
    found = ac.check_clearance(plan, ARM, scene)
    _over_time(distance, plan, samples, cell, found.too_near[0])
    return figure


def _plate(t: float, plan: ac.Trajectory) -> Obstacle:
    """A plate along the arm's outer link, where that is at a time."""
    elbow, tool = ARM.links(plan(t))[-2:]
    way = np.append((tool - elbow) / np.linalg.norm(tool - elbow), 0.0)
    turned = np.stack([way, np.cross((0, 0, 1), way), (0, 0, 1)], axis=1)
    # Obstacles stand in the frame of the arm's base.
    centre = np.append(tool - 0.015 * way[:2] - BASE, 0.0)
    place = ac.Frame(position=centre, rotation=turned)
    return Obstacle(name="plate", shape=Box(size=tuple(PLATE)), place=place)


def _from_above(axes: Axes, plan: ac.Trajectory, samples: np.ndarray, cell: Cell) -> None:
    plate = cell.pairs[0].first
    links = [x.second.shape for x in cell.pairs]
    for k, t in enumerate(samples):
        joints = ARM.links(plan(t))
        for begin, end, link in zip(joints[:-1], joints[1:], links, strict=True):
            way = (end - begin) / np.linalg.norm(end - begin)
            around = 1e3 * _capsule(begin, way, link.length, link.radius)
            near = k in (HIT, HIT + 1)
            colour, alpha = (style.BLUE, 0.5) if near else (style.GREY, 0.12)
            axes.add_patch(Polygon(around, fc=colour, ec=colour, alpha=alpha, lw=0.6))
    corners = np.array([(1, 1), (1, -1), (-1, -1), (-1, 1)]) / 2 * PLATE[:2]
    there = 1e3 * (corners @ plate.place.rotation[:2, :2].T + plate.place.position[:2] + BASE)
    axes.add_patch(Polygon(there, ec=style.VERMILLION, lw=1.5, zorder=5))
    style.label(axes, "plate, 1 mm", tuple(there.mean(axis=0)), (40, 10))
    axes.autoscale_view()
    axes.set(xlabel="x [mm]", ylabel="y [mm]", aspect="equal")
    axes.set_title(f"(a) The arm every {1e3 * EVERY:.0f} ms")


def _capsule(begin: np.ndarray, way: np.ndarray, length: float, radius: float) -> np.ndarray:
    """Outline of a capsule from above [m]."""
    side = np.array([-way[1], way[0]])
    turn = np.linspace(0, np.pi, 13)[:, None]
    first = begin + radius * (np.cos(turn) * side - np.sin(turn) * way)
    return np.concatenate([first, 2 * begin + length * way - first])


def _over_time(axes, plan, samples, cell, found) -> None:
    t = np.linspace(0, plan.duration, 500)
    true = 1e3 * cell.least_over(plan(t))["environment"]
    seen = 1e3 * cell.least_over(plan(samples))["environment"]
    breaks, travel = joint_travel(plan)
    radii = np.max([x.radii for x in cell.pairs if x.kind == "environment"], axis=0)
    way = 1e3 * np.column_stack([np.interp(t, breaks, x) for x in travel.T]) @ radii
    begun = 1e3 * np.column_stack([np.interp(samples, breaks, x) for x in travel.T]) @ radii
    proven = (seen - np.abs(way[:, None] - begun)).max(axis=1)
    axes.fill_between(t, -60, np.maximum(proven, -60), color="#e9e9e9", lw=0)
    axes.plot(t, proven, color=style.GREY, lw=1, label="proven by the samples: nowhere less")
    axes.plot(t, true, color=style.BLUE, label="distance of arm and plate")
    axes.plot(samples, seen, "o", color=style.BLUE, ms=4, label="at the samples")
    axes.axvline(found.first_time, color=style.VERMILLION, lw=1.2, ls="--")
    axes.annotate(
        f"too near from\n{found.first_time:.3f} s on",
        (found.first_time, 0.75 * seen.max()),
        xytext=(6, 0),
        textcoords="offset points",
        color=style.VERMILLION,
    )
    axes.axhline(0, color=style.BLACK, lw=0.8)
    axes.set(xlabel="time [s]", ylabel="[mm]", xlim=(0, plan.duration), ylim=(-60, None))
    axes.set_title("(b) What samples show, and what they prove")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=1)
