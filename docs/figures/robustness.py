"""Robots whose gains are off: how far the same taught data takes their tools off the path."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.robustness import Box, spread

FILE = "fig_robustness"

BOX = Box(gains=0.1)
ROBOTS = 1000
SHOWN = 300  # robots in the cloud
RESERVED = 0.66  # rad/s²: a plan that leaves some of 0.72
PLANS = (
    ("none", None, style.GREEN, "-"),
    ("pole_placement", None, style.VERMILLION, "-"),
    ("pole_placement", RESERVED, style.BLUE, "--"),
)


def draw() -> Figure:
    """The share of robots within an error; and what makes the error of uncompensated ones."""
    figure, (shares, cause) = plt.subplots(1, 2, figsize=(9.0, 4.0), width_ratios=(1.25, 1))
    for method, acceleration, colour, line in PLANS:
        drawn = _drawn(method, acceleration)
        if method == "none":
            uncompensated = drawn
        name = method.replace("_", " ")
        used = job.LIMITS.joint_acceleration if acceleration is None else acceleration
        label = f"{name}, planned at {np.max(used):.2f} rad/s²"
        error = 1e3 * np.sort(drawn.max)[:: ROBOTS // 200]
        shares.plot(error, np.linspace(0, 100, len(error)), color=colour, ls=line, label=label)
        shares.plot(1e3 * drawn.nominal_max, 0, "o", color=colour, ms=5, clip_on=False, zorder=4)
    shares.set(xscale="log", xlabel="largest contour error [mm]", ylabel="robots within it [%]")
    shares.set(ylim=(0, 100))
    shares.set_title(f"(a) {ROBOTS} robots with gains within ±10 %")
    shares.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16))
    errors = 100 * (uncompensated.kp[:SHOWN] / job.SERVO.kp - 1)
    apart = errors[:, 0] - errors[:, 1]
    cause.plot(apart, 1e3 * uncompensated.max[:SHOWN], ".", color=style.GREEN, ms=3)
    cause.set(xlabel="$K_p$ of joint 1 less that of joint 2 [%]", ylim=(0, None))
    cause.set(ylabel="largest contour error [mm]")
    cause.set_title("(b) Uncompensated: what counts")
    return figure


def _drawn(method: str, acceleration: float | None) -> object:
    """Executions of the paper's job, planned with an acceleration and compensated."""
    limits = job.LIMITS
    if acceleration is not None:
        limits = limits.replace(joint_acceleration=acceleration)
    plan = ac.plan(job.ROUNDED, job.ARM, limits, method="mac", knots=job.KNOTS)
    taught = ac.compensate(plan, job.SERVO, method=method, period=job.PERIOD)
    return spread(taught, job.ROUNDED, job.ARM, job.SERVO, job.LIMITS, BOX, samples=ROBOTS, seed=0)
