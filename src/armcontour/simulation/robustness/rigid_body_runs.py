"""Contour errors of set-points on uncertain rigid bodies, simulated by MuJoCo."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, TypeVar, cast

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ExecutionError
from armcontour.core.pool import map_in_processes
from armcontour.geometry import Path
from armcontour.motion import SetPoints
from armcontour.robot import Limits
from armcontour.simulation import RigidBodyPlant, simulate
from armcontour.simulation.robustness.monte_carlo import MonteCarloResult
from armcontour.simulation.robustness.uncertainty import Unknowns
from armcontour.verification.path_following import follow_path

# Longest time between two samples of the contour error [s].
RESOLUTION = 5e-4
R = TypeVar("R")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyRuns:
    """Callable that executes set-points on a robot of a box with `RigidBodyPlant`."""

    set_points: SetPoints
    path: Path  # The path that the tool must follow
    unknowns: Unknowns  # The varying parameters of the box
    limits: Limits  # Limits with the joint torques at which drives saturate
    options: dict[str, Any]  # Other options of `RigidBodyPlant`

    def plant(self, errors: FloatArray) -> RigidBodyPlant:
        """Robot of the box with errors of the unknowns, (k,)."""
        arm, controller, servo = self.unknowns.make_robot(errors)
        return RigidBodyPlant(arm, servo, self.limits, controller=controller, **self.options)

    def trace(self, errors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray] | str:
        """Execute on one robot: times [s], contour errors [m], (n,), and tool points [m]."""
        # A contour error is the larger of the distance from the path and the coverage error. Tool
        # points have the shape (n, dimension). If the execution fails, its message is returned.
        plant = self.plant(errors)
        try:
            executed = simulate(self.set_points, plant, resolution=max(RESOLUTION, plant.step))
        except ExecutionError as error:
            return str(error)
        followed = follow_path(self.path, executed.tool)
        return executed.t, np.maximum(followed.distance, followed.coverage_error), executed.tool

    def __call__(self, errors: FloatArray) -> tuple[float, float, float, float, float] | str:
        """Execute on one robot: largest and RMS contour error [m], and three other values."""
        # The other values are the end of the execution [s], the share of time in saturation, and
        # the largest ratio of required torque to its limit. If the execution fails, its message is
        # returned.
        plant = self.plant(errors)
        try:
            executed = simulate(self.set_points, plant, resolution=max(RESOLUTION, plant.step))
        except ExecutionError as error:
            return str(error)
        followed = follow_path(self.path, executed.tool)
        coverage_error = float(followed.coverage_error.max(initial=0.0))
        span = float(executed.t[-1] - executed.t[0])
        demanded = 0.0 if executed.torque_demand is None else np.abs(executed.torque_demand)
        return (
            max(float(followed.distance.max()), coverage_error),
            float(np.sqrt(np.mean(followed.distance**2))),
            float(executed.t[-1]),
            float(executed.saturated_time.max()) / span,
            float(np.max(demanded / plant.torque_limit)),
        )


def trace_on_bodies(
    runs: BodyRuns, errors: FloatArray, *, executor: Executor | None = None
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Results of `BodyRuns.trace` for robots with these errors, (n, k)."""
    rows = list(errors)
    return _require_results(
        runs, rows, map_in_processes(runs.trace, rows, processes=1, executor=executor)
    )


def _require_results(runs: BodyRuns, rows: list[FloatArray], results: list[R | str]) -> list[R]:
    """Results of all robots; raises an error if a result is the message of a failed execution."""
    for row, result in zip(rows, results, strict=True):
        if isinstance(result, str):
            robot = describe_errors(runs.unknowns, row) if row.any() else "no errors"
            raise ExecutionError(f"The execution on the robot with {robot} failed: {result}")
    return cast(list[R], results)


def spread_on_bodies(
    runs: BodyRuns,
    errors: FloatArray,
    *,
    seed: int | None = None,
    processes: int | None = None,
    executor: Executor | None = None,
    done: Callable[[int], None] | None = None,
) -> MonteCarloResult:
    """Execute set-points on rigid-body robots with these errors, (n, k)."""
    # seed: seed with which the errors were drawn; None for corners. done: called with the number of
    # robots that have been executed.
    unknowns = runs.unknowns
    rows = list(np.concatenate([np.zeros((1, len(unknowns))), errors]))
    results = map_in_processes(runs, rows, processes=processes, executor=executor, done=done)
    results = _require_results(runs, rows, results)
    largest, rms, end_time, saturated, ratio = np.array(results).T
    servos = [unknowns.make_robot(x)[2] for x in errors]
    return MonteCarloResult(
        max=largest[1:],
        rms=rms[1:],
        end_time=end_time[1:],
        saturated=saturated[1:],
        demand_ratio=ratio[1:],
        kp=np.array([x.kp for x in servos]).reshape(-1, unknowns.arm.dof),
        kv=np.array([x.kv for x in servos]).reshape(-1, unknowns.arm.dof),
        dead_time=np.array([x.dead_time for x in servos]).reshape(-1, unknowns.arm.dof),
        payload=errors[:, 0] if "payload" in unknowns.kinds else np.zeros(len(errors)),
        seed=seed,
        names=unknowns.names,
        deviations=errors,
        nominal_max=float(largest[0]),
        nominal_rms=float(rms[0]),
    )


def describe_errors(unknowns: Unknowns, errors: FloatArray) -> str:
    """Text with the errors of a robot, (k,); equal values of several joints are listed once."""
    units = {"payload": " kg", "dead time": " s"}
    values_by_kind: dict[str, list[float]] = {}
    for kind, error in zip(unknowns.kinds, errors.tolist(), strict=True):
        values_by_kind.setdefault(kind, []).append(error)
    parts = [
        f"{kind} {', '.join(f'{x:+.3g}' for x in dict.fromkeys(values))}{units.get(kind, '')}"
        for kind, values in values_by_kind.items()
    ]
    return "; ".join(parts) or "no errors"
