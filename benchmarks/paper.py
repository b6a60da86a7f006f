"""Evaluate the paper's job every 4 ms, and repeat all of it while a corner is dragged."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import armcontour as ac
from armcontour.cli.run_command import built_in_job
from armcontour.verification import Evaluation
from benchmarks import reference
from benchmarks.measured import Bar, Line, Pair, timed

CYCLE = 4e-3
POINTS = ((0.350, 0.100), (0.410, 0.150), (0.280, 0.300), (0.350, 0.350))
TOLERANCE = 5e-3  # m, corner error
ACCELERATION = 0.09  # m/s², centripetal, for limits and rounded corners
SPEED = 0.15  # m/s, limit of the tool
SERVO = ac.ServoModel(kp=25.0, kv=150.0)


def lines() -> list[Line]:
    """Return the lines for errors alone, with limits, and for the loop from corners to errors."""
    peer = reference.NAME
    evaluate = "evaluate, the paper's job at 4 ms"
    loop = "round, plan, explain, compensate, execute, errors"
    return [
        Line("evaluate/errors", f"{evaluate}, errors", peer, _errors, Bar(seconds=12e-3)),
        Line("evaluate/limits", f"{evaluate}, limits too", peer, _limits, Bar(seconds=30e-3)),
        # 30 ms where the reference work takes 11.6 ms; half of it is the evaluation.
        Line("loop", f"{loop}: the paper's job", peer, _loop, Bar(ratio=2.6)),
        Line("run/paper", "run, the paper's job: all of it but files", peer, _job),
    ]


def _errors() -> Pair:
    return _evaluation(False)


def _limits() -> Pair:
    return _evaluation(True)


def _evaluation(limit_use: bool) -> Pair:
    objective, arm, limits = _job_of()
    path, plan = _planned(objective, arm, limits)
    executed = _executed(arm, limits, plan)
    call = partial(_judge, executed, path, objective, limits, limit_use)

    def notes() -> list[str]:
        error = call().contour_error
        return [f"contour error {error.rms * 1e3:.6f} mm RMS, {error.max * 1e3:.6f} mm at most"]

    return Pair(timed(call), timed(reference.work), notes)


def _loop() -> Pair:
    objective, arm, limits = _job_of()

    def loop() -> Evaluation:
        path, plan = _planned(objective, arm, limits)
        ac.explain(plan, arm, limits)
        return _judge(_executed(arm, limits, plan), path, objective, limits, False)

    return Pair(timed(loop), timed(reference.work))


def _job() -> Pair:
    whole = built_in_job()
    runs = tuple(replace(x, experiment=None) for x in whole.runs)
    job = replace(whole, runs=runs)
    return Pair(timed(lambda: ac.run(job)), timed(reference.work))


def _job_of() -> tuple[ac.Path, ac.Arm, ac.Limits]:
    arm = ac.load_arm("pmk3s")
    limits = arm.limits.replace(speed=SPEED, centripetal_acceleration=ACCELERATION)
    return ac.Path.polyline(POINTS), arm, limits


def _planned(objective: ac.Path, arm: ac.Arm, limits: ac.Limits) -> tuple[ac.Path, ac.Trajectory]:
    path = ac.round_corners(objective, tolerance=TOLERANCE, acceleration=ACCELERATION)
    return path, ac.plan(path, arm, limits)


def _executed(arm: ac.Arm, limits: ac.Limits, plan: ac.Trajectory) -> ac.Execution:
    set_points = ac.compensate(plan, SERVO, ac.PolePlacement(), cycle=CYCLE)
    return ac.simulate(set_points, ac.ServoPlant(arm, SERVO, limits))


def _judge(
    executed: ac.Execution, path: ac.Path, objective: ac.Path, limits: ac.Limits, limit_use: bool
) -> Evaluation:
    return ac.evaluate(executed, path, objective=objective, limits=limits, limit_use=limit_use)
