"""Learning: contour error over time and from run to run, on rigid bodies with unknown gains."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.motion import smooth

FILE = "fig_learning"

RUNS = 3
COLOURS = (style.VERMILLION, style.ORANGE, style.BLUE)
POINTS = 500
# What nobody tells the controller: gains, and dry friction.
ROBOT = {"kp": [25.0, 24.0]}
FRICTION = [0.02, 0.01]  # N m
NOISE = 1e-5  # rad


def draw() -> Figure:
    """Left the contour error of every run over time, right its RMS by run."""
    plan = smooth(ac.plan(job.ROUNDED, job.ARM, job.LIMITS), job.PERIOD)
    taught = ac.compensate(
        plan, job.SERVO, method="inverse_dynamics", arm=job.ARM, period=job.PERIOD
    )
    real = job.ARM.with_dynamics(coulomb=FRICTION)
    robot = ac.RigidBodyPlant(real, job.SERVO.replace(**ROBOT), known=job.ARM, noise=NOISE)
    figure, (time, runs) = plt.subplots(1, 2, figsize=(9.0, 3.9), width_ratios=(2, 1))
    rms = []
    for k in range(RUNS):
        executed = ac.execute(taught, robot)
        error = ac.evaluate(executed, job.ROUNDED, limits=job.LIMITS).contour_error
        edges = np.linspace(0, len(error.t) - 1, POINTS).astype(int)
        most = np.maximum.reduceat(error.values, edges)
        time.semilogy(error.t[edges], 1e3 * most, color=COLOURS[k], lw=1.1, label=f"run {k + 1}")
        rms.append(1e3 * error.rms)
        if k + 1 < RUNS:
            taught = ac.learn(taught, executed, arm=job.ARM, servo=job.SERVO)
    time.set(
        xlabel="time [s]", ylabel="contour error [mm]", xlim=(0, plan.duration), ylim=(1e-6, 10)
    )
    time.set_title("(a) The paper's job, run by run")
    time.legend(loc="upper center", ncols=RUNS)
    runs.semilogy(range(1, RUNS + 1), rms, color=style.GREY, lw=1, zorder=1)
    runs.scatter(range(1, RUNS + 1), rms, color=COLOURS, s=36, zorder=2)
    for k, value in enumerate(rms):
        style.label(runs, f"{value:.2g}", (k + 1, value), (14, 10))
    runs.set(
        xlabel="run",
        ylabel="contour error, RMS [mm]",
        xlim=(0.6, RUNS + 0.8),
        ylim=(rms[-1] / 3, 4 * rms[0]),
    )
    runs.set_xticks(range(1, RUNS + 1))
    runs.set_title("(b) From run to run")
    return figure
