"""What a servo makes of set-points: lag, dead time, and how the controller fills the interval."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from docs.figures import job, style
from matplotlib.figure import Figure

import armcontour as ac

FILE = "fig_execution"

MOVE = [(0.0, 0.0), (0.1, 0.1)]  # rad
LIMITS = ac.Limits(joint_velocity=0.5, joint_acceleration=5.0)
PERIOD = 20e-3  # s: long, so that the set-points can be seen
FINE = 1e-3  # s, between two points of a curve
UNTIL = 0.45  # s
SERVOS = {
    "order second": (style.BLUE, "-", {"kp": 25.0, "kv": 150.0}),
    "order first": (style.GREEN, "--", {"kp": 25.0, "order": "first"}),
    "second, dead time 34 ms": (
        style.VERMILLION,
        "-",
        {"kp": 25.0, "kv": 150.0, "dead_time": 34e-3},
    ),
}
HELD = {
    "step": (style.VERMILLION, 1.0),
    "linear": (style.BLUE, 1.6),
    "cubic": (style.GREEN, 1.6),
}


def draw() -> Figure:
    """One joint: positions of three servos, and demands of three interpolations."""
    plan = ac.plan(ac.JointPath.spline(MOVE), limits=LIMITS)
    figure, (position, demand) = plt.subplots(2, 1, figsize=(7.6, 6.2), sharex=True)
    for name, (colour, line, options) in SERVOS.items():
        taught, executed = _execute(plan, ac.ServoModel(**options))
        on = executed.t <= UNTIL
        position.plot(executed.t[on], 1e3 * executed.q[on, 0], color=colour, ls=line, label=name)
    position.plot(taught.t, 1e3 * taught.q[:, 0], "o", color=style.BLACK, ms=3, label="set-points")
    position.set(ylabel="joint position [mrad]")
    position.set_title("(a) The same set-points, every 20 ms, on three servos")
    position.legend(loc="lower right")
    for name, (colour, width) in HELD.items():
        _, executed = _execute(plan, ac.ServoModel(kp=25.0, kv=150.0, interpolation=name))
        on = executed.t <= UNTIL
        demand.plot(executed.t[on], executed.demand[on, 0], color=colour, lw=width, label=name)
    t = np.linspace(0, plan.duration, 400)
    demand.plot(t, plan(t, 2)[:, 0], color=style.BLACK, lw=1, ls="--", label="the plan")
    demand.set(xlabel="time [s]", ylabel="demand [rad/s²]", xlim=(0, UNTIL))
    demand.set_title("(b) What three interpolations ask of the joint")
    demand.legend(loc="upper right", ncols=4)
    return figure


def _execute(plan: ac.Trajectory, servo: ac.ServoModel) -> tuple[ac.TaughtData, ac.Execution]:
    """The plan itself as set-points, executed without saturation."""
    taught = ac.compensate(plan, servo, method="none", period=PERIOD)
    plant = ac.ServoPlant(job.ARM, servo, saturation="none")
    return taught, ac.execute(taught, plant, resolution=FINE)
