"""What pole placement trades: lag, peaking and demand against the speed of the poles."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac
from armcontour.compensation.poles import fastest_poles, pole_behaviour

FILE = "fig_poles"

SPEEDS = np.geomspace(25, 2500, 121)  # 1/s
LIMIT = 0.72  # rad/s², of both joints
PLANNED = 0.71  # rad/s²: 1.4 % are left for the corners of the interpolated command
FAMILIES = {
    r"all three at $-p$": (style.VERMILLION, lambda p, kv: (-p, -p, -p)),
    r"$-p$, $-p$, observer at $-K_v$": (style.BLUE, lambda p, kv: (-p, -p, -kv)),
}


def draw() -> Figure:
    """Three rows over the poles' speed: lag, largest response, and demand of the paper's job."""
    figure, rows = plt.subplots(3, 1, figsize=(6.6, 7.0), sharex=True)
    kv = float(job.SERVO.kv)
    plan = ac.plan(
        job.ROUNDED,
        job.ARM,
        job.LIMITS.replace(joint_acceleration=PLANNED),
        method="mac",
        knots=job.KNOTS,
    )
    for name, (colour, family) in FAMILIES.items():
        found = [pole_behaviour(job.SERVO, family(p, kv)) for p in SPEEDS]
        rows[0].plot(SPEEDS, [1e3 * x.lag[0] for x in found], color=colour, label=name)
        rows[1].plot(
            SPEEDS,
            [x.peaking[0] for x in found],
            color=colour,
        )
        rows[1].plot(SPEEDS, [x.demand[0] for x in found], color=colour, ls=":")
        some = SPEEDS[::4]
        asked = [_demand(plan, family(p, kv)) for p in some]
        rows[2].plot(some, asked, color=colour, marker=".", ms=4)
    fastest = -float(fastest_poles(job.SERVO, plan, job.LIMITS, job.PERIOD)[0, 0])
    for axes in rows:
        axes.axvline(kv, color=style.GREY, lw=0.8, ls="--")
    rows[2].axvline(fastest, color=style.BLUE, lw=0.8, ls="--")
    rows[2].axhline(LIMIT, color=style.BLACK, lw=0.9, ls="--")
    style.label(rows[2], "fastest", (fastest, 1.6), (0, 0))
    style.label(rows[0], "$K_v$", (kv, 50), (0, 0))
    rows[0].set(ylabel="lag [ms]", ylim=(-20, 60))
    rows[0].set_title("(a) Lag behind the plan")
    rows[0].legend()
    rows[1].set(ylabel="largest", ylim=(0.9, 2.5))
    rows[1].set_title("(b) Of F G at any frequency (full), and of the demand (dotted)")
    rows[2].set(ylabel="rad/s²", ylim=(0.6, 2.0), xscale="log", xlabel="speed of the poles p [1/s]")
    rows[2].set_title("(c) Largest demand, the paper's job planned at 0.71 rad/s², every 4 ms")
    return figure


def _demand(plan: ac.Trajectory, poles: tuple[float, float, float]) -> float:
    """What the set-points ask of the joints, if they do not saturate [rad/s²]."""
    taught = ac.compensate(plan, job.SERVO, method="pole_placement", poles=poles, period=job.PERIOD)
    plant = ac.ServoPlant(job.ARM, job.SERVO, saturation="none")
    return float(ac.execute(taught, plant, resolution=job.PERIOD).peak_demand.max())
