"""Warnings and remarks of a run, as sentences."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.render import figure, number
from armcontour.core.text import capitalise, count_noun, joint_label, list_some
from armcontour.geometry import Path
from armcontour.geometry.rounding.rounded_path import describe_large_tolerance
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.geometry.shaped_path import describe_unfinished
from armcontour.jobs.job import Run
from armcontour.jobs.plan_quantities import JerkStop
from armcontour.jobs.rows import pierce_length, shaping_rows
from armcontour.jobs.run_record import RunRecord
from armcontour.motion import Execution, Trajectory
from armcontour.motion.execution import describe_excess
from armcontour.motion.set_point_rule import ACCELERATION
from armcontour.planning.tracing.two_axis_head import HEAD_TOLERANCE, has_head_tolerance, head_of
from armcontour.program import Program, contour_called
from armcontour.robot import SerialArm, compare_limits
from armcontour.robot.arm import unit_of
from armcontour.robot.servo import ServoModel
from armcontour.verification import Evaluation

# If the arm comes closer to itself than this, a remark reports the clearance [m].
REPORTED_CLEARANCE = 10e-3
# Maximum number of contours that a sentence names.
MAX_NAMES = 4
# Relative difference below which two values count as equal.
SAME_VALUE = 1e-9
# Ratio of the demand to the acceleration limit above which saturation of a joint is reported.
REPORTED_DEMAND_RATIO = 1.5
# Share of the allowed contour error above which the cost of limited set-points is reported.
COSTLY_SHARE = 0.25
# Ratio of the cycle to the duration above which the cycle is reported as too coarse.
COARSE_CYCLE_SHARE = 0.1
# A plan is compared with the motion in logs at this number of times, and at its breaks.
PLAN_SAMPLES = 1000
# Minimum joint error that is reported [rad].
MIN_JOINT_ERROR = 1e-6
# Relative difference below which two speeds count as equal; it is above the margins of the timing.
SAME_SPEED = 1e-3


def warnings(result: RunRecord) -> Iterator[str | None]:
    """Yield warnings about what differs from the request; None stands for no warning."""
    run = result.run
    trajectory = result.trajectory
    executed = result.execution
    if result.resumption is not None:
        yield result.resumption.warning
    yield from _capped(result.objective, run)
    yield compare_limits(run.limits, result.arm)
    yield _warn_of_jerk_stops(result.jerk_stops)
    # With a duration or a speed factor, contours are slower than assigned on purpose.
    if run.duration is None and trajectory.speed_factor == 1.0:
        yield _warn_of_slow_leads(result)
    yield from (x.sentence for x in result.weaves if x.differs)
    yield from (x.deviation_sentence for x in result.weaves if x.leaves_seam)
    yield from _collisions(result)
    if run.cycle > COARSE_CYCLE_SHARE * trajectory.duration:
        yield (
            f"the cycle of {number(run.cycle, 's')} is more than a tenth of the duration of the "
            f"motion, {number(trajectory.duration, 's')}. A number without a unit is in seconds; "
            "for milliseconds, write cycle: 4 ms."
        )
    if result.set_points is not None and result.sends_set_points:
        yield from _warn_of_set_points(result)
    if result.servo is not None:
        yield beyond_logs(result.servo, trajectory)
        if run.compensation.compensates:
            yield result.servo.doubt
    if executed is not None and result.evaluation is not None:
        yield _unsettled(executed)
        yield _not_followed(run, executed, result.evaluation)
    if (experiment := result.experiment) is not None and experiment.uncompensated is not None:
        yield _warn_of_useless_compensation(run, experiment.evaluation, experiment.uncompensated)
    yield from result.path.notes


def remarks(result: RunRecord) -> Iterator[str]:
    """Yield notes about plan and execution that are not warnings."""
    if result.resumption is not None and (remark := result.resumption.remark):
        yield remark
    if waits := result.trajectory.waits:
        names = list_some(list(dict.fromkeys(x.input for x in waits)), MAX_NAMES)
        yield (
            f"exported programs wait for inputs ({names}) {count_noun(len(waits), 'time')}. The "
            "duration contains the rests, but not the time of the waits."
        )
    yield from result.path.remarks
    yield from (x.sentence for x in result.weaves if not x.differs)
    yield from _describe_shaping(result)
    yield from _describe_head(result)
    # Stops due to jerk limits are reported by a warning.
    if stops := result.stops_of_path:
        reasons = ", ".join(f"{n} {reason}" for reason, n in stops.items())
        number_of_stops = count_noun(sum(stops.values()), "full stop")
        yield f"{number_of_stops} inside contours ({reasons}){_first_stop(result.path)}."
    yield from _describe_clearance(result)
    if result.advice is not None and result.advice.note:
        yield result.advice.note
    explanation = result.explanation
    if explanation is not None and "torque" in explanation.kinds:
        yield (
            f"torque limits restrict the speed. They use the masses of {result.arm.name} (source: "
            f"{result.arm.source})."
        )
    yield from _describe_model_error(result)
    yield from _describe_unlimited_jerk(result)


def _first_stop(program: Program) -> str:
    """Write where the first full stop inside a contour is, as the end of a sentence."""
    for index, contour in enumerate(program.contours):
        if len(contour.path.stops):
            s = float(contour.path.stops[0])
            point = ", ".join(f"{1e3 * x:.4g}" for x in contour.path(s))
            name = ", ".join(filter(None, [contour_called(contour, index), contour.origin_at(s)]))
            return f", the first at ({point}) mm, after {number(s, 'm')} of {name}"
    return ""


def _describe_shaping(result: RunRecord) -> Iterator[str]:
    """Yield how much shaped corners gain, and which searches ended early."""
    if shaping := {x.name: x.note for x in shaping_rows(result.path)}:
        early = describe_unfinished(x.path for x in result.path.contours)
        yield " ".join([f"{shaping['shaping.gain']}.", *map(capitalise, early)])


def _describe_head(result: RunRecord) -> Iterator[str]:
    """Yield the tolerance of the tool axis near the pole of a machine's rotary axes, if used."""
    arm = result.arm
    if not isinstance(arm, SerialArm):
        return
    head = head_of(arm.without_held())
    paths = [x.path for x in result.path.contours if x.path.orientation is not None]
    if head is not None and any(has_head_tolerance(x, head) for x in paths):
        yield (
            f"near the pole of the rotary axes, where joint {arm.joint_names[head.first]} is "
            f"free, the tool axis may be up to {number(HEAD_TOLERANCE, 'rad')} from the required "
            "axis, so that this joint does not turn far."
        )


def _describe_clearance(result: RunRecord) -> Iterator[str]:
    """Yield the clearance if a scene, a near pair or an avoided configuration makes it relevant."""
    if (clearance := result.clearance) is not None:
        is_relevant = (
            x.kind == "environment" or x.low <= REPORTED_CLEARANCE for x in clearance.nearest
        )
        if result.avoided or any(is_relevant):
            yield " ".join([clearance.sentence, *(f"{capitalise(x)}." for x in result.avoided)])


def _describe_model_error(result: RunRecord) -> Iterator[str]:
    """Yield the contour error with the errors that the servo model does not explain."""
    evaluation = result.evaluation
    if evaluation is not None and evaluation.model_error is not None:
        along, across = (number(x, "m") for x in evaluation.model_error)
        yield (
            f"the contour error is {number(evaluation.contour_error.max, 'm')}. Errors that the "
            f"servo model does not explain add at most {across} across the path and {along} along "
            "the path."
        )


def _describe_unlimited_jerk(result: RunRecord) -> Iterator[str]:
    """Yield a note if the maker limits the jerk, but neither arm nor job do."""
    limits = result.run.limits
    unused = result.arm.unused_limits
    if unused is None or unused.joint_jerk is None:
        return
    # A job that removes the limit needs no note.
    if limits.limits_jerk or "joint_jerk" in limits.removed:
        return
    # External axes come before the robot's own joints.
    external = [np.inf] * (result.arm.dof - len(unused.joint_jerk))
    jerks = ", ".join(f"{x:g}" for x in (*external, *unused.joint_jerk))
    yield (
        f"the jerk of the joints is not limited, but the maker of {result.arm.name} limits it. If "
        f"the controller checks it, specify limits: {{joint_jerk: [{jerks}]}}, in rad/s^3; "
        "otherwise, joint_jerk: inf removes this note."
    )


def unknown_notes(runs: Iterable[RunRecord]) -> tuple[str, ...]:
    """Return notes about properties of simulated robots that plan and controller do not model."""
    notes: dict[str, list[str]] = {}
    for result in runs:
        if result.run.experiment is not None and (unknown := result.run.experiment.unknown):
            notes.setdefault(unknown, []).append(result.run.name)
    return tuple(
        f"The simulated robot of {', '.join(names)} has properties unknown to plan and controller: "
        f"{unknown}."
        for unknown, names in notes.items()
    )


def _capped(program: Program, run: Run) -> Iterator[str]:
    """Yield warnings if the run reduces speeds or corner tolerances of the path."""
    # With corners of shape free, tolerances apply to whole segments, otherwise only to corners.
    tolerance = None if run.rounding is None else run.rounding.tolerance
    warnings_of_contours = (describe_large_tolerance(x.path, tolerance) for x in program.contours)
    yield from next(filter(None, warnings_of_contours), [])
    tolerances: Callable[[Path], FloatArray] = (
        (lambda x: x.tolerances) if run.is_shaped else _tolerances_of_corners
    )
    for label, key, unit, cap, values in (
        ("speed", "limits.speed", "m/s", run.limits.speed, lambda x: x.speeds),
        ("corner tolerance", "corners.tolerance", "m", tolerance, tolerances),
    ):
        if cap is None:
            continue
        largest = {
            contour_called(x, i): float(np.fmax.reduce(values(x.path), initial=0.0))
            for i, x in enumerate(program.contours)
        }
        above = [name for name, x in largest.items() if x > cap * (1 + SAME_VALUE)]
        if above:
            requested = max(largest[x] for x in above)
            yield (
                f"the {label} of up to {number(requested, unit)} of {list_some(above, MAX_NAMES)} "
                f"is reduced to {number(cap, unit)} by {key}. To avoid this, increase {key}."
            )


def _tolerances_of_corners(path: Path) -> FloatArray:
    """Return the tolerance of each vertex between segments [m], (segments - 1,).

    It is the smaller tolerance of the two segments at a corner, and NaN elsewhere.
    """
    tolerances = path.tolerances
    return np.where(
        path.turns > TANGENT_TOLERANCE, np.fmin(tolerances[:-1], tolerances[1:]), np.nan
    )


def _warn_of_slow_leads(result: RunRecord) -> str:
    """Warn of the lead at whose end the tool is slowest relative to its assigned velocity."""
    run = result.run
    # Ratio of the speed to the assigned velocity, and the words that describe the case.
    slow_ends = list[tuple[float, str]]()
    spans = result.trajectory.contour_spans
    for i, (contour, span) in enumerate(zip(result.path.contours, spans, strict=True)):
        path = contour.path
        motion = span.trajectory
        name = contour_called(contour, i)
        if motion is None:
            continue
        begin, end = contour.work or (0.0, path.length)
        # The move from the pierce height is no lead.
        for word, s, lead, side in (
            ("begins", begin, begin - pierce_length(contour), "right"),
            ("ends", end, path.length - end, "left"),
        ):
            if lead <= REPEATED_POINT:
                continue
            assigned = float(path.assigned_speeds(run.limits.speed, s, side=side))
            speed = float(motion.speed_at(s, side=side))
            if speed < assigned * (1 - SAME_SPEED) < np.inf:
                words = f"{name} {word} at {number(speed, 'm/s')} instead of "
                words += f"{number(assigned, 'm/s')}, with a lead of {number(lead, 'm')}"
                slow_ends.append((speed / assigned, words))
    if not slow_ends:
        return ""
    others = f" (the slowest of {len(slow_ends)} cases)" if len(slow_ends) > 1 else ""
    return f"{min(slow_ends)[1]}{others}."


def _warn_of_jerk_stops(stops: tuple[JerkStop, ...]) -> str:
    """Warn of all full stops that jerk limits require."""
    if not stops:
        return ""
    point = ", ".join(number(x, "m") for x in stops[0].point)
    contour = f" of {stops[0].contour}" if stops[0].contour else ""
    contour += f", {stops[0].origin}" if stops[0].origin else ""
    return (
        f"{count_noun(len(stops), 'full stop')}, the first at s = {number(stops[0].s, 'm')} "
        f"({point}){contour}. Jerk limits require these stops, because the curvature of the path "
        "jumps."
    )


def _collisions(result: RunRecord) -> Iterator[str | None]:
    """Yield warnings if bodies touch, if that is not checked, or if links are below the base."""
    planned = result.clearance
    executed = result.executed_clearance
    if planned is None:
        yield from result.avoided
        return
    if executed is not None and not executed.satisfied:
        yield f"in the execution, {executed.too_near[0]}, which is less than the margin."
    yield planned.below_base


def _warn_of_set_points(result: RunRecord) -> Iterator[str]:
    """Yield warnings if set-points are truncated, changed much, or beyond their limits."""
    set_points = result.set_points
    servo = result.servo
    if set_points.truncated is not None and set_points.truncated.max() >= MIN_JOINT_ERROR:
        j = int(np.argmax(set_points.truncated))
        unit = unit_of(set_points.trajectory.arm, "rad", j)
        integrates = servo is not None and servo.for_joints(set_points.q.shape[1]).ki[j] > 0
        cause = "integrator (ki)" if integrates else "velocity feed-forward"
        yield (
            f"the {cause} of the servo requires set-points long after the motion, which are "
            f"truncated. This adds up to {number(set_points.truncated[j], unit)} to the error of "
            f"joint {j + 1} after the end of the plan."
        )
    cost = set_points.limit_cost
    allowed = result.verdict.allowed
    if cost is not None and cost.contour_max is not None and allowed is not None:
        if cost.contour_max > COSTLY_SHARE * allowed:
            yield (
                "the limits of the set-points cost much of the contour error of "
                f"{number(allowed, 'm')} that the path leaves. They change the set-points by "
                f"{cost}."
            )
    for excess in result.set_point_use.excesses:
        yield describe_excess(excess, set_points)
    use = result.set_point_use
    if not use.rule.sources[ACCELERATION]:
        yield (
            f"no acceleration limit of {result.arm.name} is known, so that the accelerations of "
            "the set-points are not limited. Specify limits.joint_acceleration."
        )
    elif not np.isfinite(use.rule.bounds[ACCELERATION]).any():
        largest = use.plan_ratios["joint_acceleration"].max()
        yield (
            "command_limits removes the limit of the set-points' acceleration, which is up to "
            f"{number(largest, '1')} of the plan's limit. Check that your controller accepts this."
        )


def _unsettled(executed: Execution) -> str:
    """Warn if the joints are not at rest at the end of the execution."""
    if executed.unsettled is None:
        return ""
    j = int(np.argmax(executed.unsettled))
    unit = unit_of(executed.arm, "rad", j)
    waited = executed.t[-1] - executed.set_points.t[-1]
    return (
        f"joint {j + 1} is not at rest {waited:.3g} s after its last set-point; its distance from "
        f"the set-point is {number(executed.unsettled[j], unit)}."
    )


def _not_followed(run: Run, executed: Execution, evaluation: Evaluation) -> str:
    """Warn of the most saturated joint, or that the servo model cannot judge the run."""
    error = f"up to {number(evaluation.contour_error.max, 'm')}"
    joint = int(evaluation.demand_ratio.argmax())
    ratio = float(evaluation.demand_ratio[joint])
    if run.for_bodies and run.experiment is None:
        return (
            "the servo model cannot judge this run, because its set-points compensate the dynamics "
            f"of the arm (with the servo model, the contour error is {error}). Add an experiment "
            "to the job, such as experiment: {}."
        )
    # A method that ignores joint limits saturates joints as expected.
    if run.for_bodies or ratio <= REPORTED_DEMAND_RATIO or run.timing.ignores_joint_limits:
        return ""
    t = float(executed.t[int(np.abs(executed.demand[:, joint]).argmax())])
    label = joint_label(joint + 1, executed.arm.joint_names)
    return (
        f"the demand of joint {label} is {ratio:.3g} "
        f"times its acceleration limit at {t:.4g} s, so the joint saturates; the contour error "
        f"is {error}."
    )


def _warn_of_useless_compensation(run: Run, judged: Evaluation, uncompensated: Evaluation) -> str:
    """Warn if compensation increases the contour error of the rigid-body simulation."""
    compensated = judged.contour_error
    without = uncompensated.contour_error
    if compensated.rms <= without.rms and compensated.max <= without.max:
        return ""
    why = (
        "it uses the servo model without the dynamics of the arm; compensation: {method: "
        "inverse_dynamics} uses the dynamics"
    )
    if run.for_bodies:
        why = (
            "gains, dead time, masses or gravity feed-forward of the simulated robot differ from "
            "the compensation's model, or drives saturate"
        )
    if run.experiment is not None and run.experiment.unknown:
        why += f"; the compensation does not model {run.experiment.unknown}"
    shown = [*compensated.to_data().shown(), *without.to_data().shown()]
    rms, largest, *others = (figure(x) for x in shown)
    return (
        f"with rigid bodies, the contour error is {rms} RMS and {largest} at most; without "
        f"compensation, it is {' and '.join(others)}. The compensation {run.compensation.method} "
        f"increases the error, because {why}."
    )


def beyond_logs(servo: ServoModel, trajectory: Trajectory) -> str:
    """Warn if the plan exceeds the motion with which the servo was identified; else return ""."""
    if servo.model_error is None or servo.logged_velocity is None:
        return ""
    return servo.describe_excess(*sample_rates(trajectory))


def sample_rates(trajectory: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Sample a plan's joint velocities [rad/s] and accelerations [rad/s²], (n, dof) each."""
    t = np.union1d(trajectory.breaks, np.linspace(0.0, trajectory.duration, PLAN_SAMPLES))
    return trajectory(t, 1), trajectory(t, 2)
