"""Results as text: the summary of a study, and taught data."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._version import __version__
from armcontour.arms import Arm
from armcontour.evaluation import ErrorProfile, Evaluation
from armcontour.geometry import Path, RoundedPath
from armcontour.io.exports.text import csv_text
from armcontour.motion import Execution, TaughtData, Trajectory
from armcontour.study import ExperimentResult, RunResult, Study
from armcontour.study.quantities import (
    Torques,
    angular_speed,
    applied_torques,
    assumed,
    planned_torques,
)

UNITS = {
    "length": "m",
    "duration": "s",
    "settled": "s",
    "until": "s",
    "contour_error": "m",
    "tracking_error": "m",
    "objective_error": "m",
    "speed": "m/s",
    "speed_overshoot": "m/s",
    "path_velocity": "m/s",
    "utilisation": "share of time",
    "demand": "rad/s^2",
    "saturated": "share of time",
    "assigned_length": "share of length",
    "assigned_time": "share of time",
    "period": "s",
    "t": "s",
    "due": "s",
    "work": "s",
    "s": "m",
    "start": "rad",
    "turn": "rad",
    "angular_error": "rad",
    "orientation_error": "rad",
    "angular_speed": "rad/s",
    "torque": "N m",
    "torque_ratio": "share of the limit",
    "step": "s",
    "noise": "rad",
    "nominal_inertia": "kg m^2",
}


def summary(study: Study, files: Sequence[str] = ()) -> str:
    """Every metric of every run as JSON, in SI units, with the version.

    Args:
        study: The study.
        files: The files of the result, relative to its folder.
    """
    job = study.job
    data = {
        "armcontour": __version__,
        "job": job.name,
        "title": job.title,
        "arm": {
            "name": job.arm.name,
            "source": job.arm.source,
            "joints": job.arm.joint_names,
            "masses_known": job.arm.has_bodies,
            "assumed": assumed(job.arm) or None,
        },
        "units": UNITS,
        "runs": {name: run_summary(result) for name, result in study.runs.items()},
        "files": list(files),
    }
    if job.published is not None:
        data["published"] = {
            "source": job.published.source,
            "runs": job.published.runs,
            "time_stamps": list(job.published.time_stamps),
        }
    return json.dumps(plain(data), indent=2, allow_nan=False) + "\n"


def taught_csv(taught: TaughtData, joint_names: Sequence[str]) -> str:
    """Taught data as CSV: a header with units, then t and q of every joint."""
    return _csv([f"{name} [rad]" for name in joint_names], [taught.t, taught.q])


def planned_csv(trajectory: Trajectory, period: float, joint_names: Sequence[str] = ()) -> str:
    """The realizable trajectory as CSV: t, then q, dq and ddq of every joint.

    Args:
        trajectory: The trajectory.
        period: Time between rows; the last row is the end [s].
        joint_names: Names of the joints; numbers by default, and where a name is but a number.
    """
    x = trajectory.sample(period)
    called = [name.removeprefix("joint ") for name in joint_names]
    names = [
        f"{quantity} {name} [{unit}]"
        for quantity, unit in (("q", "rad"), ("dq", "rad/s"), ("ddq", "rad/s^2"))
        for name in called or range(1, trajectory.dof + 1)
    ]
    return _csv(names, [x.t, x.q, x.dq, x.ddq])


def torque_csv(trajectory: Trajectory, arm: Arm, period: float) -> str:
    """Torques of the realizable trajectory as CSV: t, then the torque of every joint's drive.

    Args:
        trajectory: The trajectory.
        arm: The arm, with bodies.
        period: Time between rows; the last row is the end [s].
    """
    x = trajectory.sample(period)
    return _csv([f"{name} [N m]" for name in arm.joint_names], [x.t, arm.torque(x.q, x.dq, x.ddq)])


def _csv(names: Sequence[str], columns: Sequence[FloatArray]) -> str:
    return csv_text(["t [s]", *names], columns)


def run_summary(result: RunResult) -> dict[str, Any]:
    """Every metric of one run."""
    path, arm = result.path, result.execution.arm
    found: dict[str, Any] = {
        "timing": result.run.timing,
        "compensation": result.run.compensation,
        "period": result.run.period,
        "ignore_jerk": result.run.ignore_jerk,
        "start": dict(zip(arm.joint_names, result.trajectory(0.0), strict=True)),
        "length": path.length,
        **_judged(result.evaluation),
        **_turned(result.execution, result.evaluation),
        "switching_points": result.trajectory.switching_points,
        "stretches": [
            {
                "name": x.name,
                "kind": x.kind,
                "t": x.t,
                "s": x.s,
                "demand": x.demand,
                "speed": x.speed,
            }
            for x in result.trajectory.stretches
        ],
        "merged_points": path.merged if isinstance(path, Path) else (),
        "warnings": result.warnings,
        **_moves(result),
    }
    torques = planned_torques(result)
    if torques is not None:
        found.update(_torques(torques, result))
    if result.experiment is not None:
        found["experiment"] = _experiment(result, result.experiment)
    if result.failure is not None:
        found["experiment"] = {"failed": str(result.failure)}
    if result.explanation is not None:
        why = result.explanation
        found["explanation"] = {
            "assigned_length": why.assigned_length,
            "assigned_time": why.assigned_time,
            "bindings": [
                {"limit": x.limit, "joint": x.joint, "t": x.t, "s": x.s, "share": x.share}
                for x in why.bindings
            ],
            "shortfalls": [
                {
                    "kind": x.kind,
                    "s": x.s,
                    "speed": x.speed,
                    "assigned": x.assigned,
                    "reason": x.reason,
                }
                for x in why.shortfalls
            ],
        }
    if isinstance(path, RoundedPath):
        c = path.corners
        found["corners"] = [
            {
                "joint": c.joint[i],
                "point": c.point[i],
                "turn": c.turn[i],
                "radius": c.radius[i],
                "error": c.error[i],
                "angular_error": c.angular_error[i],
                "tangent": c.tangent[i],
                "shrunk": bool(c.shrunk[i]),
                "full_stop": bool(c.stopped[i]),
                "speed": c.speed[i],
            }
            for i in range(len(c))
        ]
    return found


def _moves(result: RunResult) -> dict[str, Any]:
    """What a program adds: its moves with their times, and its events."""
    if isinstance(result.path, Path):
        return {}
    contours = iter(zip(result.path.contours, result.evaluation.contours, strict=True))
    moves = []
    for x in result.trajectory.spans:
        move: dict[str, Any] = {"kind": x.kind, "t": x.t, "s": x.s}
        if x.kind == "contour":
            contour, error = next(contours)
            move |= {
                "name": contour.name,
                "layer": contour.layer,
                "closed": contour.closed,
                "work": x.work,
                "contour_error": _error(error),
            }
        moves.append(move)
    return {
        "moves": moves,
        "events": [
            {"name": x.name, "value": x.value, "t": x.t, "due": x.due, "s": x.s, "point": x.point}
            for x in result.trajectory.events
        ],
    }


def _judged(e: Evaluation) -> dict[str, Any]:
    return {
        "duration": e.duration,
        "settled": e.settled,
        "until": e.until,
        "contour_error": _error(e.contour_error),
        "tracking_error": _error(e.tracking_error),
        "objective_error": None if e.objective_error is None else _error(e.objective_error),
        "speed": e.speed,
        "speed_ratio": e.speed_ratio,
        "speed_overshoot": e.speed_overshoot,
        "path_velocity": e.path_velocity,
        "utilisation": e.utilisation,
        "limit_ratios": e.limit_ratios,
        "demand": e.demand,
        "demand_ratio": e.demand_ratio,
        "saturated": e.saturated,
        "cornering": [
            {
                "joint": c.joint,
                "point": c.point,
                "rounding": c.rounding,
                "overshoot": c.overshoot,
            }
            for c in e.corners
        ],
    }


def _turned(execution: Execution, evaluation: Evaluation) -> dict[str, Any]:
    """How the tool turned, in space."""
    speed, error = angular_speed(execution), evaluation.orientation_error
    found: dict[str, Any] = {}
    if speed is not None:
        found["angular_speed"] = speed.max()
    if error is not None:
        found["orientation_error"] = _error(error)
    return found


def _torques(torques: Torques, result: RunResult) -> dict[str, Any]:
    """Torques beside their limits, and what they rest on."""
    limit = result.run.limits.joint_torque
    return {
        "torque": {
            "peak": torques.peak,
            "limit": limit,
            "assumed": assumed(result.execution.arm) or None,
        },
        "torque_ratio": None if limit is None else torques.peak / limit,
    }


def _experiment(result: RunResult, experiment: ExperimentResult) -> dict[str, Any]:
    plant, done = experiment.plant, experiment.execution
    found: dict[str, Any] = {
        "plant": type(plant).__name__,
        "step": plant.step,
        "gravity_feedforward": plant.gravity_feedforward,
        "friction": plant.friction,
        "noise": plant.noise,
        "seed": plant.seed,
        "nominal_inertia": plant.nominal_inertia,
        **_judged(experiment.evaluation),
        **_turned(done, experiment.evaluation),
    }
    applied = applied_torques(experiment)
    return found if applied is None else {**found, **_torques(applied, result)}


def _error(profile: ErrorProfile) -> dict[str, float]:
    return {
        "rms": profile.rms,
        "max": profile.max,
        "t_max": profile.t_max,
        "s_max": profile.s_max,
    }


def plain(value: Any) -> Any:
    """The same data in what JSON knows; not-a-number becomes null."""
    if isinstance(value, dict) or hasattr(value, "items"):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(x) for x in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
