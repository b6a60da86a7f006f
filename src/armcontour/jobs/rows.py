"""Rows of a run, which all outputs print: verdict, errors, speeds, limits, set-points, plan."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass, replace
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.core.checks import FloatArray
from armcontour.core.fields import quantities
from armcontour.core.render import number, plain, units_by_name
from armcontour.core.result import FILE, FIRST, JUDGED, TABLE, VERDICT, Data, Row, Table
from armcontour.core.text import count_noun, joint_label, list_some
from armcontour.core.validity import AS_MODELLED, OF_PLAN, OF_PROGRAM, OF_SIMULATION
from armcontour.geometry import RoundedPath, ShapedPath
from armcontour.geometry.shaped_path import SHAPED
from armcontour.jobs.job import Job, Run
from armcontour.jobs.plan_quantities import (
    angular_speed,
    largest_lean,
    largest_tilt,
)
from armcontour.jobs.run_record import PROGRAMS, SET_POINTS, RunRecord
from armcontour.jobs.verdict import BODIES, SERVO, Deviation, Verdict
from armcontour.motion import Execution, Servoj
from armcontour.motion.set_point_rule import ASSUMED, SetPointUse
from armcontour.planning import Explanation
from armcontour.planning.explanation import DWELLS, RAPIDS
from armcontour.program import Contour, Program
from armcontour.program.preparation import PIERCE
from armcontour.robot import Arm, compare_limits
from armcontour.robot.arm import unit_of
from armcontour.robot.limits import LIMITS
from armcontour.simulation import RigidBodyPlant
from armcontour.verification.evaluation import Evaluation, duration_row, tool_speeds

# Name of the assigned velocity in explanations.
ASSIGNED = LIMITS["speed"].label
# Key of the execution on rigid bodies in a run's data. The run itself has the values of the
# execution with the servo model.
EXPERIMENT = "experiment"
# If the distance from the drawing exceeds the sum of its parts by this fraction, a note says why.
EXPLAINED_EXCESS = 1e-3
# An execution that does not decide the verdict is shown only by rows whose names begin with these
# words, with a label that begins with the execution's name.
SHOWN_OF_OTHERS = ("contour_error", "torque")
OTHERS_LABELS = {SERVO: "servo model: ", BODIES: "on rigid bodies: "}


def job_data(
    job: Job,
    simulated: bool,
    runs: Mapping[str, Data],
    warnings: Sequence[str],
    parts: Mapping[str, Data],
) -> Data:
    """Return the data of a job, its arm and its runs, with further parts."""
    arm = job.arm
    suffix = f", {count_noun(len(warnings), 'warning')}" if warnings else ""
    return Data(
        f"Results of {job.title}{suffix}",
        (
            Row("armcontour", __version__),
            Row("job", job.name),
            Row("title", job.title),
            Row("arm.name", arm.name),
            Row("arm.source", arm.source),
            Row("arm.joints", arm.joint_names),
            *([Row("arm.external", arm.chain.external)] if arm.chain.external else ()),
            Row("arm.masses_known", arm.has_bodies),
            Row("arm.assumed", arm.chain.assumed or None),
            Row("arm.notes", arm.notes),
            Row("servo", job.servo.describe_with_source(arm.chain.prismatic)),
            Row("simulated", simulated),
            Row("units", units_by_name([*runs.values(), *parts.values()])),
        ),
        parts={"runs": Data("Runs", parts=runs), **parts},
        warnings=tuple(warnings),
        not_proven=OF_SIMULATION if simulated else OF_PLAN,
    )


def run_data(
    result: RunRecord, job: Job | None, warnings: tuple[str, ...], remarks: tuple[str, ...]
) -> Data:
    """Return the data of a run; without values of the execution if it was not simulated."""
    parts = dict[str, Data]()
    tables = list(_tables(result, job))
    experiment = tuple(_experiment_rows(result))
    if experiment:
        parts[EXPERIMENT] = Data("On rigid bodies", experiment)
    if result.clearance is not None:
        data = result.clearance.to_data()
        parts["clearance"] = replace(data, rows=(*data.rows, Row("avoided", result.avoided)))
    if result.executed_clearance is not None:
        data = result.executed_clearance.to_data()
        rows = (replace(x, label=x.label and f"{x.label}, executed") for x in data.rows)
        parts["executed_clearance"] = replace(
            data, rows=tuple(replace(x, level=TABLE) for x in rows)
        )
    if result.explanation is not None:
        data = _with_origin_of_slowest(result.explanation, result.path)
        # The table of time shares is listed with the tables of the run.
        tables.insert(0, data.tables[0])
        parts["explanation"] = replace(data, tables=data.tables[1:])
    if result.advice is not None:
        tables.insert(0, result.advice.table)
    return Data(
        f"Run {result.run.name}",
        (
            *verdict_rows(result, result.verdict),
            *_program_rows(result),
            *warning_rows(warnings),
            *_execution_rows(result),
            *_set_points(result),
            *_plan(result, job),
        ),
        tuple(tables),
        parts,
        notes=remarks,
        warnings=warnings,
        not_proven=_not_proven(result),
    )


def _not_proven(result: RunRecord) -> str:
    """Return the sentence on what a run does not prove."""
    if not result.sends_set_points:
        return OF_PROGRAM
    return OF_PLAN if result.execution is None else OF_SIMULATION


def _program_rows(result: RunRecord) -> Iterator[Row]:
    """Yield how far controllers may leave the path between the points of programs."""
    program = result.program
    if program is None:
        return
    verdicts = result.verdicts(result.errors)
    if len(verdicts) > 1:
        for name, label in ((SET_POINTS, SET_POINTS), (PROGRAMS, list_some(program.formats, 4))):
            verdict = verdicts[name]
            reason = reason_of(result.run, verdict)
            key = f"kept_{name.replace('-', '_')}"
            yield Row(key, verdict.kept, JUDGED, f"verdict of {label}", reason, VERDICT)
    between = program.between
    largest = {
        "straight lines": between.lines.max(),
        "spline": between.spline.max(),
        "path missed": between.missed.max(),
    }
    note = ", ".join(f"{name} {number(float(x), 'm')}" for name, x in largest.items())
    allowed = result.verdict.allowed
    if allowed is not None:
        note += f" of {number(allowed, 'm')} allowed"
    note += f"; t = {between.t_max:.3f} s"
    yield Row("between_points.max", between.max, "m", "between points, largest", note, VERDICT)
    for key in ("lines", "spline", "missed"):
        yield Row(f"between_points.{key}", float(getattr(between, key).max()), "m")
    yield Row("between_points.t_max", between.t_max, "s")
    count = count_noun(len(between.t), "point")
    chosen = "from the allowed contour error" if program.automatic else "as specified"
    if not program.automatic and allowed is None:
        chosen = ""
    note = ", ".join(filter(None, [count, chosen]))
    yield Row("between_points.interval", between.interval, "s", "interval of points", note, VERDICT)
    yield Row("between_points.formats", program.formats)


def warning_rows(warnings: Sequence[str]) -> Iterator[Row]:
    """Yield the number of warnings, unless it is 0, and a row with the warnings."""
    if warnings:
        yield Row("warning_count", len(warnings), "", "warnings", level=VERDICT)
    yield Row("warnings", warnings)


# The verdict: deviation of the tool from the drawing, compared with the allowed deviation.


def verdict_rows(result: RunRecord, verdict: Verdict) -> Iterator[Row]:
    """Yield rows of the verdict, the deviation from the drawing, the duration and its cause."""
    run = result.run
    evaluation = result.evaluation
    reason = reason_of(run, verdict)
    if compare_limits(run.limits, result.arm):
        reason = "; ".join(filter(None, [reason, "limits of the job are above the arm's"]))
    yield Row("kept", verdict.kept, JUDGED, "verdict", reason, VERDICT, holds=AS_MODELLED)
    if verdict.errors:
        yield worst_contour(run, verdict)
        yield Row("judged_by", tuple(verdict.errors))
    yield Row("accuracy", run.accuracy, "m")
    yield Row("contour_error_allowed", verdict.allowed, "m")
    if result.expected is not None and evaluation is not None:
        worst = number(result.expected.worst, "m")
        model = number(evaluation.contour_error.max, "m")
        note = f"with the largest errors of the logs {worst}; servo model alone {model}"
        value = max(result.expected.contours)
        label = "contour error expected, largest"
        yield Row("expected.max", value, "m", label, note, VERDICT)
    if (gains := result.unknown_gains) is not None:
        label = f"contour error, {gains.words}"
        note = "estimate for the worst such robot"
        if gains.saturates:
            note = "worst robot found; some of its joints saturate"
        if verdict.allowed is not None and gains.max > verdict.allowed:
            note += f"; above the allowed contour error of {number(verdict.allowed, 'm')}"
        yield Row("unknown_gains.max", gains.max, "m", label, note)
    yield duration_row(result.trajectory.duration, VERDICT)
    speed_factor = result.trajectory.speed_factor
    if speed_factor != 1.0:
        yield Row("speed_factor", speed_factor, "1", "speed factor", "of the plan", VERDICT)
    explanation = result.explanation
    if explanation is not None and explanation.longest is not None:
        limit, share = explanation.longest
        note = f"{number(share, '1')} of the time"
        if limit == ASSIGNED and (travel := weave_speed(result)) is not None:
            note += f"; the weave travels at {number(travel, 'm/s')}"
        elif limit not in (ASSIGNED, RAPIDS, DWELLS) and is_woven(result):
            note += "; the path weaves"
        yield Row("time_limit", limit, "", "time limited by", note, VERDICT)


def reason_of(run: Run, verdict: Verdict) -> str:
    """Write the requirement that decides a verdict, and violated limits; empty if there are none.

    If only limits are violated, the text also tells which other requirement is kept.
    """
    clauses = [*verdict.violations, _deciding_requirement(run, verdict)]
    if verdict.requirement != "limits":
        clauses.reverse()
    return "; ".join(filter(None, clauses))


def _deciding_requirement(run: Run, verdict: Verdict) -> str:
    """Write the requirement on motion and errors that decides, as a clause; empty if none does."""
    tolerance = None if run.rounding is None else run.rounding.tolerance
    match verdict.requirement:
        case "motion":
            return "the simulated robot does not complete the motion"
        case "corners":
            return f"the allowed corner error is {number(tolerance, 'm')}"
        case "accuracy":
            return f"the allowed distance from the drawing is {number(run.accuracy, 'm')}"
        case "contour error":
            return (
                f"the allowed contour error is {number(verdict.allowed, 'm')}, a tenth of the "
                "smallest corner tolerance"
            )
        case "limits" if run.accuracy is not None:
            return f"the allowed distance from the drawing of {number(run.accuracy, 'm')} is kept"
        case "limits" if verdict.allowed is not None:
            return f"the allowed contour error of {number(verdict.allowed, 'm')} is kept"
    return ""


def worst_contour(run: Run, verdict: Verdict) -> Row:
    """Write the row with the largest distance from the drawing."""
    tolerance = None if run.rounding is None else run.rounding.tolerance
    # If an accuracy is specified, only the sum is limited, not the parts.
    only_sum_limited = run.accuracy is not None
    assert verdict.off_drawing is not None
    row = off_drawing(
        verdict.off_drawing,
        verdict.deviation,
        None if only_sum_limited else tolerance,
        verdict.errors,
        None if only_sum_limited else verdict.allowed,
    )
    others = (
        f"; {name} {number(x, 'm')}, not judged, because it lacks the compensated dynamics"
        for name, x in verdict.others.items()
    )
    return replace(row, note=row.note + "".join(others))


def off_drawing(
    distance: float,
    deviation: Deviation,
    tolerance: float | None,
    errors: Mapping[str, float],
    allowed: float | None = None,
    label: str = "off the drawing",
) -> Row:
    """Write the row with the tool's distance from the drawing [m]; its parts stand in the note.

    Args:
        distance: The distance [m].
        deviation: Part of the distance by which the path differs from the drawing.
        tolerance: Limit of the rounding error [m]; None without one.
        errors: Contour error in each execution [m].
        allowed: Limit of the contour error [m]; None without one.
        label: Label of the row.
    """
    parts = list[tuple[str, float, float | None]]()
    if deviation.rounding is not None:
        parts.append(("rounding", deviation.rounding, tolerance))
    if deviation.smoothing:
        parts.append(("smoothing", deviation.smoothing, None))
    parts += ((name, error, allowed) for name, error in errors.items())
    note = ", ".join(
        f"{name} {number(value, 'm')}"
        + ("" if limit is None else f" of {number(limit, 'm')} allowed")
        for name, value, limit in parts
    )
    if distance > (deviation.total + max(errors.values())) * (1 + EXPLAINED_EXCESS):
        # A contour error is the distance from the tool to the path. The distance from a corner that
        # the tool cuts to the tool can be larger.
        note += "; a point of the drawing is missed by this distance"
    return Row("off_drawing", distance, "m", label, note, VERDICT)


def weave_speed(result: RunRecord) -> float | None:
    """Return the weaves' travel speed [m/s]; None without weaves, or if the run limits it."""
    contours = result.path.contours
    fastest = result.run.limits.speed
    if fastest is not None and any((x.path.speeds > fastest).any() for x in contours):
        return None
    speeds = [x.woven.frequency * x.woven.pitch for x in contours if x.woven is not None]
    return next((x for x in speeds if x > 0), None)


def is_woven(result: RunRecord) -> bool:
    """Return whether all contours are woven, so that limits of curves apply to the weave."""
    return all(x.woven is not None for x in result.path.contours)


def with_worst_execution(result: RunRecord, data: Data) -> Data:
    """Show the values of the execution that decides the verdict.

    If rigid bodies decide, their shown values replace those of the servo model.
    """
    if result.judged is result.evaluation:
        return data
    parts = dict(data.parts)
    experiment = parts.pop(EXPERIMENT)
    rows = {x.name: x for x in data.rows}
    rows |= {x.name: x for x in experiment.rows if x.level < FILE}
    return replace(data, rows=tuple(rows.values()), parts=parts)


# The executions, with the servo model and with rigid bodies.


def _execution_rows(result: RunRecord) -> Iterator[Row]:
    """Yield the execution with the servo model, or the plan if it was not simulated."""
    evaluation = result.evaluation
    if evaluation is None and result.trajectory.arm is not None:
        yield from tool_speeds(result.motion, result.motion.tool_speed).rows
    if evaluation is not None:
        evaluated = _with_origin_of_error(evaluation.to_data().rows, result, evaluation)
        for row in [*evaluated, *_angular_rows(result.motion)]:
            if row.name == "limit_ratios":
                yield row
            elif row.name != "duration":  # `verdict_rows` has the duration
                yield _row_of_execution(row, SERVO, result.judged is evaluation)
        yield Row("unsettled", result.motion.unsettled, unit_of(result.arm, "rad"))
    tilt = largest_tilt(result.arm, result.trajectory)
    if tilt is not None:
        yield Row("tilt", tilt, "rad", "tool axis from gravity, largest", "planned, on contours")
    lean = largest_lean(result.arm, result.trajectory, result.path)
    if lean is not None:
        label = "tool axis from the required axis, largest"
        yield Row("lean", lean, "rad", label, "planned, on contours")
    limit = result.run.limits.joint_torque
    yield from _torque_rows(result.arm, limit, result.peak_torques, "planned")


def _experiment_rows(result: RunRecord) -> Iterator[Row]:
    """Yield the execution on rigid bodies, or its failure; nothing without either."""
    if result.failure is not None:
        label = f"{OTHERS_LABELS[BODIES]}failed"
        yield Row("failed", str(result.failure), "", label, level=FIRST)
    experiment = result.experiment
    if experiment is None:
        return
    data = experiment.evaluation.to_data()
    rows = _with_origin_of_error(data.rows, result, experiment.evaluation)
    motion = experiment.execution
    limit = result.run.limits.joint_torque
    applied = None if motion.torque is None else np.abs(motion.torque).max(axis=0)
    torques = _torque_rows(result.arm, limit, applied, "applied")
    for row in [*_plant_rows(experiment.plant), *rows, *_angular_rows(motion), *torques]:
        if row.name == "duration":  # `verdict_rows` has the row that is shown
            yield replace(row, level=FILE)
        else:
            yield _row_of_execution(row, BODIES, result.judged is experiment.evaluation)
    yield Row("cornering", data.tables[0].as_dicts())


def _with_origin_of_error(
    rows: Sequence[Row], result: RunRecord, evaluation: Evaluation
) -> Sequence[Row]:
    """Add the place in the file of the largest contour error to the rows of an evaluation."""
    origin = result.path.origin_at(evaluation.contour_error.s_max)
    if not origin:
        return rows
    changed = []
    for row in rows:
        if row.name == "contour_error.max":
            changed.append(replace(row, note=f"{row.note}, {origin}"))
        else:
            changed.append(row)
    return [*changed, Row("contour_error.origin", origin)]


def _with_origin_of_slowest(explanation: Explanation, program: Program) -> Data:
    """Return the data of an explanation, with the place in the file of the slowest point."""
    data = explanation.to_data()
    slowest = explanation.slowest
    origin = "" if slowest is None else program.origin_at(slowest.s)
    if slowest is None or not origin:
        return data
    rows = []
    for row in data.rows:
        if row.name == "slowest":
            rows.append(replace(row, value=f"{slowest.sentence}, {origin}"))
        else:
            rows.append(row)
    return replace(data, rows=tuple(rows))


def _row_of_execution(row: Row, execution: str, is_worst: bool) -> Row:
    """Show a row as a main result only if its execution decides the verdict."""
    if is_worst:
        return row
    if row.label and row.name.startswith(SHOWN_OF_OTHERS):
        return replace(row, label=OTHERS_LABELS[execution] + row.label, level=TABLE)
    return replace(row, level=FILE)


def _angular_rows(execution: Execution) -> Iterator[Row]:
    """Yield the tool's largest angular speed; nothing for a planar arm."""
    speed = angular_speed(execution)
    if speed is not None:
        yield Row("angular_speed", speed.max(), "rad/s", "tool's angular speed, largest")


def _torque_rows(
    arm: Arm, limit: FloatArray | None, peak: FloatArray | None, kind: str
) -> Iterator[Row]:
    """Yield the largest torques [N m], (dof,), their limits, and assumed mass parameters."""
    if peak is None:
        return
    yield Row("torque.peak", peak, arm.chain.unit("N m"))
    yield Row("torque.limit", limit, arm.chain.unit("N m"))
    yield Row("torque.assumed", arm.chain.assumed or None)
    if limit is None:
        yield Row("torque_ratio", None)
        return
    share = peak / limit
    worst = int(share.argmax())
    largest, allowed = (number(x[worst], arm.chain.unit("N m", worst)) for x in (peak, limit))
    note = f"joint {joint_label(worst + 1, arm.joint_names)}, {largest} of {allowed}"
    yield Row("torque_ratio", share, "1", f"drive torque, {kind}", note)


def _plant_rows(plant: RigidBodyPlant) -> Iterator[Row]:
    """Yield parameters of the simulated robot, and of its controller's model."""
    yield Row("plant", type(plant).__name__)
    yield Row("step", plant.step, "s")
    yield Row("gravity_feedforward", plant.gravity_feedforward)
    yield Row("nominal_inertia", plant.nominal_inertia, plant.chain.unit("kg m^2"))
    for name, chain in ("robot", plant.chain), ("controller", plant.controller_chain):
        yield Row(f"{name}.payload", 0.0 if chain.payload is None else chain.payload.mass, "kg")
        yield Row(f"{name}.armature", chain.armature, chain.unit("kg m^2"))
        yield Row(f"{name}.viscous", chain.viscous, chain.unit("N m s/rad"))
        yield Row(f"{name}.coulomb", chain.coulomb, chain.unit("N m"))


# Set-points and plan.
# Limits of set-points that the first screen compares with those of the plan, by order.
SHARES = {1: "joint_velocity", 2: "joint_acceleration"}


def _set_points(result: RunRecord) -> Iterator[Row]:
    """Yield how set-points and command limits change the error."""
    set_points = result.set_points
    if not result.sends_set_points:
        # An export of the stored result needs them.
        yield Row("set_point_rule", result.set_point_use.rule.data())
        return
    if result.servo is None and result.execution is None:
        # Set-points are not reported, because joints without a servo follow the plan exactly.
        return
    every = f"every {number(set_points.cycle, 's')}"
    yield Row("set_points", len(set_points.q), "", "set-points", every)
    yield Row("servo", set_points.servo_text or None)
    yield Row("truncated", set_points.truncated, unit_of(result.arm, "rad"))
    cost = set_points.limit_cost
    use = result.set_point_use
    yield from set_point_rows(use, result.arm)
    if cost is not None:
        note = f"of the cycles; changes a set-point by {cost}"
        yield Row("limited", use.limited_share, "1", "set-points at a limit", note)
    yield Row("command_use", dict(use.ratios), "1")
    yield Row("set_point_rule", use.rule.data())
    yield Row("limited_share", use.limited_share, "1")
    changed = 0.0 if cost is None else cost.deviation
    yield Row("set_point_change", changed, unit_of(result.arm, "rad"))
    yield Row("limit_contour_rms", 0.0 if cost is None else cost.contour_rms, "m")
    yield Row("limit_contour_max", 0.0 if cost is None else cost.contour_max, "m")


def set_point_rows(use: SetPointUse, arm: Arm) -> Iterator[Row]:
    """Yield how far set-points use the plan's limits of velocity and acceleration.

    The notes state the limits of the set-points with their sources.
    """
    rule = use.rule
    for order, name in SHARES.items():
        shares = use.plan_ratios.get(name)
        if shares is None:
            continue
        joint = int(shares.argmax())
        unit = unit_of(arm, LIMITS[name].unit, joint)
        # The smaller of both directions, if they differ.
        of_plan = np.abs(rule.plan[order, :, joint]).min()
        allowed = np.abs(rule.bounds[order, :, joint]).min() / of_plan
        source = rule.sources[order]
        if source == ASSUMED:
            source = "assumed: no limit of a controller is known"
        limit = f"allowed {number(allowed, '1')}, {source}" if np.isfinite(allowed) else "no limit"
        note = f"of {number(of_plan, unit)}, joint {joint_label(joint + 1, arm.joint_names)}"
        what = name.removeprefix("joint_")
        label = f"set-point {what}"
        yield Row(f"set_point_{what}", shares.max(), "1", label, f"{note}; {limit}")


def _plan(result: RunRecord, job: Job | None) -> Iterator[Row]:
    """Yield path, methods, stops and shaping of a plan."""
    run = result.run
    trajectory = result.trajectory
    path = result.path
    yield Row("length", path.length, "m", "path")
    if path.single_path is None:
        yield from _contour_rows(result)
    if result.rounding_error is not None:
        yield Row("corner_error", result.rounding_error, "m")
    if result.smoothing_error:
        yield Row("smoothing_error", result.smoothing_error, "m")
    yield Row("timing", run.timing.method, "", "timing")
    yield Row("compensation", run.compensation.method, "", "compensation")
    yield Row("cycle", run.cycle, "s")
    yield Row("reserve", run.timing.reserve, "1")
    yield Row("continuity", run.continuity)
    if trajectory.arm is not None:
        names = result.arm.joint_names
        start = dict(zip(names, trajectory(0.0), strict=True))
        yield Row("start", start, unit_of(result.arm, "rad"))
    yield Row("switching_points", trajectory.switching_points, "s")
    stops = result.full_stops
    yield Row("full_stops.count", sum(stops.values()))
    yield Row("full_stops.reasons", stops)
    if job is not None and job.process.off:
        yield Row("process_off", True, "", "process off", "no output is switched")
        if job.process.lift:
            yield Row("lift", job.process.lift, "m", "above the part", "along its z axis")
    elif job is not None and job.process.analog_names:
        yield Row("analog", job.process.analog_names)
    if job is not None and job.export.outputs:
        outputs = job.export.outputs.items()
        yield Row("outputs", {x: dict(y) if isinstance(y, Mapping) else y for x, y in outputs})
    if job is not None and job.export.inputs:
        inputs = job.export.inputs.items()
        yield Row("inputs", {x: dict(y) if isinstance(y, Mapping) else y for x, y in inputs})
    if job is not None and job.export.servoj != Servoj():
        yield Row("servoj", asdict(job.export.servoj))
    single = path.single_path
    yield Row("merged_points", () if single is None else single.merged)
    yield from shaping_rows(path)


def _contour_rows(result: RunRecord) -> Iterator[Row]:
    """Yield lengths and times of a program, with the process on and off."""
    spans = result.trajectory.spans
    path = result.path
    objective = result.objective
    works = [x.work for x in result.trajectory.contour_spans if x.work is not None]
    rapids = sum(x.t[1] - x.t[0] for x in spans if x.kind == "rapid")
    dwells = sum(x.t[1] - x.t[0] for x in spans if x.kind == "dwell")
    length = sum(map(work_length, path.contours))
    time = sum(end - start for start, end in works)
    pierces = sum(map(pierce_length, path.contours))
    leads = path.length - length - pierces
    closed = sum(x.closed for x in objective.contours)
    layers = count_noun(len({x.layer for x in path.contours}), "layer")
    ways = {"leads": leads if leads > 1e-9 else 0.0, "pierces": pierces}
    note = ", ".join(f"{name} {number(x, 'm')}" for name, x in ways.items() if x)
    mean = f"mean {number(length / time, 'm/s')}" if time else ""
    dwelling = f"dwells {number(dwells, 's')}" if dwells else ""
    events = result.trajectory.events
    names = list_some(list(dict.fromkeys(x.name for x in events)), 4)
    yield Row("contours", len(path.contours), "", "contours", f"{closed} closed, {layers}")
    yield Row("work_length", length, "m", "length at work", note or "no leads")
    yield Row("work_time", time, "s", "time at work", mean)
    yield Row("rapid_time", float(rapids), "s", "time of rapids", dwelling)
    yield Row("event_count", len(events), "", "events", names)


def work_length(contour: Contour) -> float:
    """Return the length of a contour on which the process is on [m]."""
    start, end = contour.at_work
    return end - start


def pierce_length(contour: Contour) -> float:
    """Return the length of the move from the pierce height to the lead-in or contour [m]."""
    tags = contour.path.tags
    return float(sum(contour.path.lengths[k] for k, tag in enumerate(tags) if tag == PIERCE))


def shaping_rows(program: Program) -> Iterator[Row]:
    """Yield the time that shaping the contours saves, without rapids and dwells."""
    outcomes = [x.path.outcome for x in program.contours if isinstance(x.path, ShapedPath)]
    if not outcomes:
        return
    won = [x.start for x in outcomes]
    yield Row("shaping.starts", {name: won.count(name) for name in dict.fromkeys(won)})
    common = [x for x in outcomes[0].durations if all(x in y.durations for y in outcomes)]
    sums = {name: sum(x.durations[name] for x in outcomes) for name in common}
    yield Row("shaping.durations", sums, "s")
    shaped = sums[SHAPED]
    starts = sorted((name, t) for name, t in sums.items() if name != SHAPED)
    others = ", ".join(f"{name} {number(t, 's')}" for name, t in starts)
    gain = 1 - shaped / min(t for _, t in starts)
    note = f"{number(shaped, 's')} ({others})"
    yield Row("shaping.gain", gain, "1", "saved by shaping", f"shaped: {note}")
    yield Row("shaping.iterations", max(max(len(x.history) - 1, 0) for x in outcomes))


def field_rows(name: str, value: Any) -> Iterator[Row]:
    """Yield one file-only row per field of a dataclass, with the unit of its annotation."""
    if value is None:
        yield Row(name, None)
        return
    kind: Any = type(value)
    units_by_name = quantities(kind)
    for attribute in fields(value):
        inner = getattr(value, attribute.name)
        key = f"{name}.{attribute.name}"
        if is_dataclass(inner):
            yield from field_rows(key, inner)
            continue
        quantity = units_by_name.get(attribute.name)
        yield Row(key, inner, quantity.unit if quantity else "")


# Tables: stretches (intervals of a speed rule), corners, weaves, moves and events.


def _tables(result: RunRecord, job: Job | None) -> Iterator[Table]:
    """Yield the tables that are written to files but not printed."""
    trajectory = result.trajectory
    single = result.path.single_path
    yield Table(
        "stretches",
        _columns(name="", kind="", t="s", s="m", demand="", speed="m/s"),
        [(x.name, x.kind, x.t, x.s, x.demand, x.speed) for x in trajectory.stretches],
    )
    if isinstance(single, RoundedPath):
        c = single.corners
        values = (
            *(c.vertex, c.point, c.turn, c.radius, c.error, c.angular_error, c.tangent),
            *(c.shrunk, c.stopped, c.reason, c.speed),
        )
        yield Table(
            "corners",
            _columns(
                **{"joint": "", "point": "m", "turn": "rad", "radius": "m", "error": "m"},
                **{"angular_error": "rad", "tangent": "m", "shrunk": "", "full_stop": ""},
                **{"reason": "", "speed": "m/s"},
            ),
            list(zip(*values, strict=True)),
        )
    if result.weaves:
        yield Table(
            "weaves",
            _columns(contour="", width="m", frequency="Hz", left_out="1", deviation="m"),
            [(x.contour, x.width, x.frequency, x.left_out, x.deviation) for x in result.weaves],
        )
    if single is None:
        yield _move_table(result)
        yield Table(
            "events",
            _columns(name="", value="", t="s", due="s", s="m", point="m"),
            [(x.name, x.value, x.t, x.due, x.s, x.point) for x in trajectory.events],
        )
        yield Table(
            "waits",
            _columns(input="", within="s", at="", t="s", rest="s"),
            [(x.input, x.within, x.at, x.t, x.rest) for x in trajectory.waits],
        )
    if result.evaluation is not None:
        yield from result.evaluation.to_data().tables


def _move_table(result: RunRecord) -> Table:
    """List the moves of a program with their times; only rows of contours have all values."""
    # Start and end of a contour are values of `resume_at`.
    work = result.objective.work_ranges
    errors = () if result.judged is None else result.judged.contours
    contours = enumerate(result.path.contours)
    rows = list[tuple[Any, ...]]()
    for span in result.trajectory.spans:
        profile: tuple[Any, ...] = (None,) * 7
        if span.kind == "contour":
            k, contour = next(contours)
            outcome = None
            if isinstance(contour.path, ShapedPath):
                shaped = contour.path.outcome
                outcome = {x: getattr(shaped, x) for x in ("start", "durations", "gain")}
                outcome["iterations"] = max(len(shaped.history) - 1, 0)
            profile = (
                *(contour.name, contour.layer, contour.closed, span.work),
                *(tuple(map(float, work[k])), outcome),
                plain(errors[k].to_data()) if errors else None,
            )
        rows.append((span.kind, span.t, span.s, *profile))
    return Table(
        "moves",
        _columns(
            **{"kind": "", "t": "s", "s": "m", "name": "", "layer": "", "closed": ""},
            **{"work": "s", "resume_at": "m", "shaping": "", "contour_error": "m"},
        ),
        rows,
    )


def _columns(**columns: str) -> tuple[Row, ...]:
    """Make the columns of a table for files; each argument is a name with its unit."""
    return tuple(Row(name, None, unit) for name, unit in columns.items())
