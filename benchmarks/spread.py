"""Robustness: executions of the paper's job a second, against one of the servo plant judged."""

from __future__ import annotations

import os
import time
from collections.abc import Callable

import armcontour as ac
from armcontour.robustness.monte_carlo import Box, spread
from benchmarks.measured import Measured, paired

SAMPLES = 4000
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))
PERIOD = 4e-3
BAR = "4,000 a second on 2 cores"


def measure() -> tuple[list[Measured], list[str]]:
    """The paper's job, 5.33 s of two joints, unsaturated mostly and saturated mostly."""
    arm, servo = ac.load_arm("pmk3s"), ac.ServoModel(kp=25.0, kv=150.0)
    limits = arm.limits.replace(speed=0.15, centripetal_acceleration=0.09)
    path = ac.round_corners(ac.Path.polyline(POINTS), tolerance=5e-3, acceleration=0.09)
    plan = ac.plan(path, arm, limits, method="mac", knots=600)
    found, notes = [], []
    for method in ("none", "inverse"):
        taught = ac.compensate(plan, servo, method=method, period=PERIOD)

        def peer(taught: ac.TaughtData = taught) -> object:
            executed = ac.execute(taught, ac.ServoPlant(arm, servo, limits))
            return ac.evaluate(executed, path, limits=limits)

        for threads in (1, 2):

            def ours(taught: ac.TaughtData = taught, threads: int = threads) -> object:
                return spread(
                    taught,
                    path,
                    arm,
                    servo,
                    limits,
                    Box(gains=0.1),
                    samples=SAMPLES,
                    threads=threads,
                )

            times = paired(ours, peer, 3)
            per = times[0] / SAMPLES
            who = f"one of {SAMPLES} executions, {method}, {threads} core{'s'[: threads - 1]}"
            bar = BAR if threads == 2 else ""
            found.append(Measured(who, per, "execute and evaluate", times[1], bar))
            notes.append(
                f"Robustness, compensation {method}, {threads} of {os.cpu_count()} cores: "
                f"{1 / per:,.0f} executions of the paper's job a second, "
                f"{rate(ours):,.0f} per second of one core."
            )
    return found, notes


def rate(call: Callable[[], object]) -> float:
    """Executions per second of processor time: what others do on the machine hardly counts."""
    start = time.process_time()
    call()
    return SAMPLES / (time.process_time() - start)
