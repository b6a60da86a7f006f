"""A certificate: what the fastest plan asks of the servo, and what the certified one does."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.io import parse_job

FILE = "fig_certificate"

BUDGET = 2e-6  # m
PAPER = """
name: paper
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.280, 0.300], [0.350, 0.350]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
command_interval: 4 ms
runs:
  certified: {compensation: {method: inverse}}
"""
STEP = 1e-4  # s
POINTS = 700  # of a curve


def draw() -> Figure:
    """Contour error and demand of both plans over time."""
    fastest = ac.plan(job.ROUNDED, job.ARM, job.LIMITS)
    found = ac.certify(parse_job(PAPER), goal=ac.Goal(servo=BUDGET))
    figure, (error, demand) = plt.subplots(2, 1, figsize=(7.6, 6.0))
    limit = job.LIMITS.for_joints(2).joint_acceleration
    for plan, name, look in (
        (fastest, "fastest plan", {"color": style.VERMILLION, "lw": 1.2}),
        (found.trajectory, "certified plan", {"color": style.BLUE, "lw": 1.8}),
    ):
        executed = _executed(plan)
        profile = ac.evaluate(executed, job.ROUNDED, limits=job.LIMITS).contour_error
        t, off = _largest_of_each(profile.t, profile.values)
        error.semilogy(t, 1e6 * off, label=f"{name}, {plan.duration:.4f} s", **look)
        share = np.abs(executed.demand / limit).max(axis=1)
        demand.plot(*_largest_of_each(executed.t, share), **look)
    error.axhline(1e6 * BUDGET, color=style.BLACK, lw=0.9, ls="--", label="budget")
    error.set(xlabel="time [s]", ylabel="contour error [µm]", ylim=(1e-3, 1e3))
    error.set_title("(a) Distance of the executed tool from its path, set-points every 4 ms")
    error.legend(loc="upper right", ncols=3)
    demand.axhline(1, color=style.BLACK, lw=0.9, ls="--", label="limit")
    demand.set(xlabel="time [s]", ylabel="demand / limit", ylim=(0, None))
    demand.set_title("(b) What the set-points ask of the joint that is asked for most")
    demand.legend(loc="upper left")
    return figure


def _executed(plan: ac.Trajectory) -> ac.Execution:
    taught = ac.compensate(plan, job.SERVO, method="inverse", period=job.PERIOD)
    return ac.execute(taught, ac.ServoPlant(job.ARM, job.SERVO, job.LIMITS), resolution=STEP)


def _largest_of_each(t: np.ndarray, value: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve of fewer points, each the largest of those that it stands for."""
    edges = np.unique(np.linspace(0, len(t) - 1, POINTS).astype(int))
    return t[edges], np.maximum.reduceat(value, edges)
