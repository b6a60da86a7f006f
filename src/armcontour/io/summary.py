"""The summary of a study, as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.arms.chain import Chain
from armcontour.clearance import Clearance
from armcontour.evaluation import ErrorProfile, Evaluation
from armcontour.geometry import Corners, Outcome, RoundedPath, ShapedPath
from armcontour.io.json_text import to_json
from armcontour.jobs import ExperimentResult, Job, Run, RunResult, Shaped, Study
from armcontour.jobs.quantities import (
    Torques,
    angular_speed,
    applied_torques,
    assumed_numbers,
    planned_torques,
)
from armcontour.motion import Execution, TaughtData
from armcontour.program import Program
from armcontour.timing import Explanation

# Longest list in a summary, which people and small programs read.
MOST_LISTED = 10_000
UNITS = {
    "length": "m",
    "duration": "s",
    "settled": "s",
    "until": "s",
    "contour_error": "m",
    "missed": "m",
    "tracking_error": "m",
    "common_delay": "s",
    "undelayed_error": "m",
    "unexplained": "m",
    "objective_error": "m",
    "objective_missed": "m",
    "speed": "m/s",
    "speed_overshoot": "m/s",
    "path_velocity": "m/s",
    "utilisation": "share of time",
    "demand": "rad/s^2",
    "jerk": "rad/s^3",
    "command_jerk": "rad/s^3",
    "saturated": "share of time",
    "assigned_length": "share of length",
    "assigned_time": "share of time",
    "period": "s",
    "reserve": "share of the limit",
    "t": "s",
    "due": "s",
    "work": "s",
    "from_s": "m",
    "s": "m",
    "start": "rad",
    "cut_off": "rad",
    "set_point_change": "rad",
    "command_use": "share of the limit",
    "limit_contour_rms": "m",
    "limit_contour_max": "m",
    "unsettled": "rad",
    "turn": "rad",
    "angular_error": "rad",
    "orientation_error": "rad",
    "angular_speed": "rad/s",
    "torque": "N m",
    "torque_ratio": "share of the limit",
    "step": "s",
    "noise": "rad",
    "nominal_inertia": "kg m^2",
    "payload": "kg",
    "armature": "kg m^2",
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "joint_stiffness": "N m/rad",
    "joint_damping": "N m s/rad",
    "durations": "s",
    "gain": "share of the duration",
    "margin": "m",
    "nowhere_below": "m",
    "least": "m",
    "first_too_near": "s",
    "points": "m",
    "tolerance": "m",
    "line_tolerance": "m",
    "zone": "m",
    "angular_tolerance": "rad",
}


def summary(study: Study, files: Sequence[str] = ()) -> str:
    """All metrics of all runs as JSON, in SI units, with the version.

    Lists are cut after 10,000 entries; `left_out` has the number of entries that were cut.

    Args:
        study: The study.
        files: The files of the result, relative to its folder.
    """
    job = study.job
    runs = {name: run_summary(job, result) for name, result in study.runs.items()}
    found = of_job(job, runs, files)
    simulated = any(x.execution is not None for x in study.runs.values())
    return to_json(found if simulated else {**found, "simulated": False})


def of_job(job: Job, runs: Mapping[str, Any], files: Sequence[str]) -> dict[str, Any]:
    """Data of a job, its arm and its runs, for a summary.

    Args:
        job: The job.
        runs: Data of the runs by their names.
        files: The files of the result, relative to its folder.
    """
    return {
        "armcontour": __version__,
        "job": job.name,
        "title": job.title,
        "arm": {
            "name": job.arm.name,
            "source": job.arm.source,
            "joints": job.arm.joint_names,
            "masses_known": job.arm.has_bodies,
            "assumed": assumed_numbers(job.arm) or None,
            "notes": job.arm.notes,
        },
        "units": UNITS,
        "runs": runs,
        "files": list(files),
    }


def _plan(job: Job, plan: RunResult) -> dict[str, Any]:
    """Data of the plan of one run."""
    path, trajectory = plan.path, plan.trajectory
    single_path = path.single_path
    found: dict[str, Any] = {
        "timing": plan.run.timing,
        "compensation": plan.run.compensation,
        "period": plan.run.period,
        "reserve": plan.run.reserve,
        "continuity": plan.run.continuity,
        "start": dict(zip(job.arm.joint_names, trajectory(0.0), strict=True)),
        "length": path.length,
        "duration": trajectory.duration,
        "switching_points": trajectory.switching_points,
        "stretches": [
            {
                "name": x.name,
                "kind": x.kind,
                "t": x.t,
                "s": x.s,
                "demand": x.demand,
                "speed": x.speed,
            }
            for x in trajectory.stretches
        ],
        "full_stops": {"count": sum(plan.full_stops.values()), "reasons": plan.full_stops},
        "merged_points": () if single_path is None else single_path.merged,
        "cut_off": plan.taught.cut_off,
        **_commands(plan.taught),
        "warnings": plan.warnings,
        **({"analog": job.process.analog_names} if job.process.analog_names else {}),
        **_moves(job, plan),
    }
    if isinstance(single_path, RoundedPath):
        found["corners"] = _corners(single_path.corners)
        _count_left_out(found, corners=len(single_path.corners))
    if plan.clearance is not None:
        found["clearance"] = clearance_summary(plan.clearance, plan.avoided)
    if plan.weaves:
        found["weaves"] = [
            {
                "contour": x.contour,
                "width": x.width,
                "frequency": x.frequency,
                "left_out": x.left_out,
            }
            for x in plan.weaves
        ]
    if plan.shaped is not None:
        found["shaping"] = _shaping(plan.shaped, plan.run)
    return found


def _commands(taught: TaughtData) -> dict[str, Any]:
    """Data of limits of commands: their use, and what they cost."""
    cost = taught.limit_cost
    if taught.command_limits is None:
        return {}
    return {
        "command_use": taught.command_use,
        "set_point_change": 0.0 if cost is None else cost.deviation,
        "limit_contour_rms": 0.0 if cost is None else cost.contour_rms,
        "limit_contour_max": 0.0 if cost is None else cost.contour_max,
    }


def clearance_summary(x: Clearance, avoided: Sequence[str] = ()) -> dict[str, Any]:
    """Data of how far the arm stays from itself and from its cell.

    Args:
        x: The clearance.
        avoided: Sentences on other ways that were taken to keep clear.
    """
    found: dict[str, Any] = {
        "kept": x.kept,
        "below_base": x.below_base,
        "pairs": [
            {
                "first": pair.first,
                "second": pair.second,
                "kind": pair.kind,
                "margin": pair.margin,
                "nowhere_below": pair.low,
                "least": pair.high,
                "t": pair.t,
                "first_too_near": pair.first_time,
                "points": pair.points.tolist(),
            }
            for pair in x.pairs[:MOST_LISTED]
        ],
        "left_out_pairs": [
            {"first": pair.first, "second": pair.second, "reason": pair.reason}
            for pair in x.left_out[:MOST_LISTED]
        ],
        "avoided": list(avoided),
    }
    _count_left_out(found, pairs=len(x.pairs), left_out_pairs=len(x.left_out))
    return found


def _shaping(shaped: Shaped, this: Run) -> dict[str, Any]:
    """Data of what shaping the contours of a run gained."""
    return {
        "starts": shaped.starts,
        "durations": shaped.durations,
        "gain": shaped.gain,
        "iterations": shaped.iterations,
        "wanted": None if this.rounding is None else this.rounding.wishes,
    }


def _corners(c: Corners) -> list[dict[str, Any]]:
    """Data of the rounded corners of a path."""
    return [
        {
            "joint": c.vertex[i],
            "point": c.point[i],
            "turn": c.turn[i],
            "radius": c.radius[i],
            "error": c.error[i],
            "angular_error": c.angular_error[i],
            "tangent": c.tangent[i],
            "shrunk": bool(c.shrunk[i]),
            "full_stop": bool(c.stopped[i]),
            "reason": c.reason[i],
            "speed": c.speed[i],
        }
        for i in range(min(len(c), MOST_LISTED))
    ]


def _count_left_out(found: dict[str, Any], **lengths: int) -> None:
    """Add the numbers of entries that were cut from long lists."""
    more = {name: x - MOST_LISTED for name, x in lengths.items() if x > MOST_LISTED}
    if more:
        found["left_out"] = {**found.get("left_out", {}), **more}


def run_summary(job: Job, result: RunResult) -> dict[str, Any]:
    """All metrics of one run; without those of its execution, if it was not simulated."""
    found = _plan(job, result)
    if result.execution is None:
        return found
    found["unsettled"] = result.execution.unsettled
    found |= _errors(result.evaluation) | _angular_motion(result.execution, result.evaluation)
    # A single path has no list of moves; its one error is that of the whole run.
    errors = result.evaluation.contours if "moves" in found else ()
    for move, error in zip(_contours(found), errors, strict=True):
        move["contour_error"] = _error(error)
    torques = planned_torques(result)
    if torques is not None:
        found.update(_torques(torques, result))
    if result.experiment is not None:
        found["experiment"] = _experiment(result, result.experiment)
    if result.failure is not None:
        found["experiment"] = {"failed": str(result.failure)}
    if result.executed_clearance is not None:
        found["executed_clearance"] = clearance_summary(result.executed_clearance)
    _count_left_out(found, cornering=len(result.evaluation.corners))
    if result.explanation is not None:
        found["explanation"] = _explanation(result.explanation)
    return found


def _contours(found: dict[str, Any]) -> list[dict[str, Any]]:
    """The moves of a summary that are contours."""
    return [x for x in found.get("moves", ()) if x["kind"] == "contour"]


def _explanation(why: Explanation) -> dict[str, Any]:
    """Data of what binds where, and of places below the assigned velocity."""
    found: dict[str, Any] = {
        "assigned_length": why.assigned_length,
        "assigned_time": why.assigned_time,
        "bindings": [
            {
                "limit": x.limit,
                "joint": None if x.joint is None else x.joint + 1,
                "t": x.t,
                "s": x.s,
                "share": x.share,
            }
            for x in why.bindings[:MOST_LISTED]
        ],
        "shortfalls": [
            {
                "kind": x.kind,
                "s": x.s,
                "speed": x.speed,
                "assigned": x.assigned,
                "reason": x.reason,
            }
            for x in why.shortfalls[:MOST_LISTED]
        ],
    }
    _count_left_out(found, bindings=len(why.bindings), shortfalls=len(why.shortfalls))
    return found


def _moves(job: Job, plan: RunResult) -> dict[str, Any]:
    """Moves and events with their times; empty for a single path without other moves."""
    if plan.path.single_path is not None:
        return {}
    contours, from_s = iter(plan.path.contours), iter(_resume_intervals(job, plan.objective))
    moves = []
    for x in plan.trajectory.spans:
        move: dict[str, Any] = {"kind": x.kind, "t": x.t, "s": x.s}
        if x.kind == "contour":
            contour = next(contours)
            if isinstance(contour.path, ShapedPath):
                move |= {"shaping": _outcome(contour.path.outcome)}
            move |= {
                "name": contour.name,
                "layer": contour.layer,
                "closed": contour.closed,
                "work": x.work,
                "from_s": next(from_s),
            }
        moves.append(move)
    return {
        "moves": moves,
        "events": [
            {"name": x.name, "value": x.value, "t": x.t, "due": x.due, "s": x.s, "point": x.point}
            for x in plan.trajectory.events
        ],
    }


def _outcome(x: Outcome) -> dict[str, Any]:
    """Data of how the shape of one contour was found."""
    return {
        "start": x.start,
        "durations": x.durations,
        "gain": x.gain,
        "iterations": max(len(x.history) - 1, 0),
    }


def _resume_intervals(job: Job, objective: Program) -> list[tuple[float, float]]:
    """Start and end of every contour, in the arc length of `from_s` [m]."""
    lengths = []
    for x in objective.contours:
        start, end = x.at_work
        lengths.append(end - start)
    ends = job.process.from_s + np.concatenate([[0.0], np.cumsum(lengths)])
    return list(zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True))


def _errors(e: Evaluation) -> dict[str, Any]:
    """Data of an evaluation."""
    return {
        "duration": e.duration,
        "settled": e.settled,
        "until": e.until,
        "contour_error": _error(e.contour_error),
        "missed": asdict(e.missed),
        "tracking_error": _error(e.tracking_error),
        "common_delay": e.common_delay,
        "undelayed_error": _error(e.undelayed_error),
        "unexplained": None
        if e.unexplained is None
        else dict(zip(("along", "across"), e.unexplained, strict=True)),
        "objective_error": None if e.objective_error is None else _error(e.objective_error),
        "objective_missed": None if e.objective_missed is None else asdict(e.objective_missed),
        "speed": e.speed,
        "speed_ratio": e.speed_ratio,
        "speed_overshoot": e.speed_overshoot,
        "path_velocity": e.path_velocity,
        "utilisation": e.utilisation,
        "limit_ratios": e.limit_ratios,
        "demand": e.demand,
        "demand_ratio": e.demand_ratio,
        "jerk": e.jerk,
        "jerk_ratio": e.jerk_ratio,
        "command_jerk": e.command_jerk,
        "saturated": e.saturated,
        "cornering": [
            {
                "joint": c.vertex,
                **({} if c.contour is None else {"contour": c.contour}),
                "point": c.point,
                "rounding": c.rounding,
                "overshoot": c.overshoot,
            }
            for c in e.corners[:MOST_LISTED]
        ],
    }


def _angular_motion(execution: Execution, evaluation: Evaluation) -> dict[str, Any]:
    """Largest angular speed and orientation error of the tool of an arm in space."""
    speed, error = angular_speed(execution), evaluation.orientation_error
    found: dict[str, Any] = {}
    if speed is not None:
        found["angular_speed"] = speed.max()
    if error is not None:
        found["orientation_error"] = _error(error)
    return found


def _torques(torques: Torques, result: RunResult) -> dict[str, Any]:
    """Largest torques, their limits, and the assumed parameters of the bodies."""
    limit = result.run.limits.joint_torque
    return {
        "torque": {
            "peak": torques.peak,
            "limit": limit,
            "assumed": assumed_numbers(result.execution.arm) or None,
        },
        "torque_ratio": None if limit is None else torques.peak / limit,
    }


def _experiment(result: RunResult, experiment: ExperimentResult) -> dict[str, Any]:
    """Data of an experiment on rigid bodies."""
    plant, executed = experiment.plant, experiment.execution
    found: dict[str, Any] = {
        "plant": type(plant).__name__,
        "step": plant.step,
        "gravity_feedforward": plant.gravity_feedforward,
        "friction": plant.friction,
        "noise": plant.noise,
        "seed": plant.seed,
        "nominal_inertia": plant.nominal_inertia,
        "robot": {
            **_robot(plant.chain),
            "joint_stiffness": plant.joint_stiffness,
            "joint_damping": plant.joint_damping,
        },
        "controller": _robot(plant.known_chain),
        **_errors(experiment.evaluation),
        **_angular_motion(executed, experiment.evaluation),
    }
    applied = applied_torques(experiment)
    return found if applied is None else {**found, **_torques(applied, result)}


def _robot(chain: Chain) -> dict[str, Any]:
    """Load, drive inertias and friction of a robot, or of the robot that a controller knows."""
    return {
        "payload": 0.0 if chain.payload is None else chain.payload.mass,
        "armature": chain.armature,
        "viscous": chain.viscous,
        "coulomb": chain.coulomb,
    }


def _error(profile: ErrorProfile) -> dict[str, float]:
    """Data of an error over time."""
    return {
        "rms": profile.rms,
        "max": profile.max,
        "t_max": profile.t_max,
        "s_max": profile.s_max,
    }
