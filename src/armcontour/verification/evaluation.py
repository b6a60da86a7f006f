"""Evaluation of an execution: contour errors, tool speed, and use of the joint limits."""

# The evaluation shares only geometry and arms with the code that made the execution.

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from armcontour.core import pictures
from armcontour.core.checks import BoolArray, FloatArray, Frozen
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, contour_step
from armcontour.core.quantities import Interval
from armcontour.core.render import Result, number
from armcontour.core.result import FILE, FIRST, VERDICT, Data, Row, Table
from armcontour.core.sampled_data import integrate
from armcontour.core.text import short_repr
from armcontour.geometry import Path
from armcontour.motion import Execution, SetPoints
from armcontour.program import Program
from armcontour.robot import Limits, resolve_limits
from armcontour.robot.arm import unit_of
from armcontour.robot.limit_use import use_of
from armcontour.verification.contour_errors import (
    ContourExecution,
    CornerDeviation,
    CoverageSearch,
    largest_coverage,
    settling_time,
    split_by_contour,
    tracking_errors,
)
from armcontour.verification.error_profile import Coverage, ErrorProfile, error_rows
from armcontour.verification.limit_verdict import measure_limit_ratios

# Fraction of a limit from which a joint counts as at the limit.
AT_LIMIT = 0.99
# A tool speed counts as above the assigned velocity if it exceeds it by more than this fraction.
SPEED_TOLERANCE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evaluation(Result, Frozen):
    """Errors, speeds and limit use of an execution.

    Args:
        duration: Planned time of the motion [s].
        settled: Time after which the tool speed stays below 1 mm/s [s].
        end_time: End of the time over which root mean squares are taken [s]; largest errors cover
            the time until all joints are at rest, unless you specified `end_time` in `evaluate`.
        contour_error: Distance from the tool to its path point [m].
        coverage_error: Largest distance from the path to the tool, including parts of the path that
            the tool does not reach.
        tracking_error: Distance from the tool to its planned position at the same time [m].
        model_error: First-order bounds of the tool errors along and across the path due to the
            servo's `model_error` [m]; None if it is unknown.
        objective_error: Distance from the tool to the objective path [m]; None if unknown.
        objective_coverage_error: Largest distance from the objective path to the tool [m]; None if
            the objective path is unknown.
        orientation_error: Angle between the tool orientation (or tool axis, if only the axis is
            required) and the required one at the path point [rad]; outside its cone, if the path
            has one; None if no orientation is required.
        corners: Cornering deviations (ISO 9283, 8.5) at the corners of the objective path.
        speed: Largest tool speed on the contours while the process is at work [m/s].
        rapid_speed: Largest tool speed in rapids and in leads without the process [m/s]; None if
            the motion has none.
        speed_ratio: Largest ratio of the tool speed to the assigned velocity of the limits or of a
            segment; NaN if no velocity is assigned.
        speed_peak: Time, tool speed and assigned velocity at this ratio; None if no velocity is
            assigned.
        speed_overshoot: Largest excess of the tool speed over the assigned velocity [m/s]; 0 if no
            velocity is assigned.
        path_velocity: Mean tool speed over the planned time of the motion; for a program, over the
            time at work [m/s].
        time_at_limit: Fraction of the planned time in which a joint is within 1 % of a limit of
            acceleration, velocity or torque; None unless `limit_use=True`.
        limit_ratios: Largest use of every limit in the planned motion, on both sides of its breaks
            and at the peaks between them; None unless `limit_use=True`.
        demand: Largest demanded acceleration of each joint [rad/s²], (dof,).
        demand_ratio: Largest demanded acceleration of each joint as a fraction of the limit in its
            direction, (dof,); 0 without a limit.
        jerk: Largest executed jerk of each joint, averaged over one cycle [rad/s³], (dof,).
        jerk_ratio: `jerk` as a fraction of each joint's limit, (dof,); 0 without a limit.
        command_jerk: Largest third difference of the set-points of each joint, over the command
            interval [rad/s³], (dof,).
        saturated: Fraction of time for which each joint is saturated, (dof,).
        contours: The contour error of every contour, in order.
        drawing_errors: For every contour, the larger of `objective_error` and
            `objective_coverage_error`; empty if the objective path is unknown.
        judged: Inputs of the evaluation, for figures and reports; None if unknown.
    """

    duration: float
    settled: float
    end_time: float
    contour_error: ErrorProfile
    coverage_error: Coverage
    tracking_error: ErrorProfile
    model_error: tuple[float, float] | None
    objective_error: ErrorProfile | None
    objective_coverage_error: Coverage | None
    orientation_error: ErrorProfile | None
    corners: tuple[CornerDeviation, ...]
    speed: float
    rapid_speed: float | None
    speed_ratio: float
    speed_peak: SpeedPeak | None
    speed_overshoot: float
    path_velocity: float
    time_at_limit: float | None
    limit_ratios: Mapping[str, float] | None
    demand: FloatArray
    demand_ratio: FloatArray
    jerk: FloatArray
    jerk_ratio: FloatArray
    command_jerk: FloatArray
    saturated: FloatArray
    contours: tuple[ErrorProfile, ...] = ()
    drawing_errors: tuple[ErrorProfile | Coverage, ...] = ()
    judged: EvaluationInputs | None = field(default=None, repr=False)

    @property
    def off_drawing(self) -> float | None:
        """Largest distance between tool and objective path, both ways [m]; None if unknown."""
        return max((x.max for x in self.drawing_errors), default=None)

    def to_data(self) -> Data:
        """Result rows, errors first."""
        names = ("joint", "contour", "point", "rounding", "overshoot")
        columns = tuple(Row(x, None, "m" if x not in names[:2] else "") for x in names)
        rows = [(c.vertex, c.contour, c.point, c.rounding, c.overshoot) for c in self.corners]
        corners = Table("cornering", columns, rows)
        return Data("Evaluation", (*self._errors, *self._motion), (corners,))

    @property
    def _errors(self) -> tuple[Row, ...]:
        """Rows of duration and tool errors."""
        model_error: tuple[Row, ...] = (Row("model_error", None),)
        if self.model_error is not None:
            along, across = self.model_error
            model_error = (
                Row("model_error.along", along, "m"),
                Row("model_error.across", across, "m", "at most more across, unexplained"),
            )
        turned = self.orientation_error
        return (
            duration_row(self.duration),
            settled_row(self.settled),
            Row("end_time", self.end_time, "s"),
            *error_rows("contour_error", "contour error", self.contour_error, FIRST, FIRST),
            *error_rows("coverage_error", "path missed", self.coverage_error),
            *error_rows("tracking_error", "tracking error", self.tracking_error, max_level=FILE),
            *model_error,
            *error_rows("objective_error", "", self.objective_error, FILE, FILE),
            *error_rows("objective_coverage_error", "", self.objective_coverage_error, FILE, FILE),
            *(error_rows("orientation_error", "orientation error", turned) if turned else ()),
        )

    @property
    def _motion(self) -> tuple[Row, ...]:
        """Rows of speeds and limit use."""
        uses = self.limit_ratios
        largest = ""
        if uses:
            largest = max(uses, key=lambda x: uses[x]).replace("_", " ")
        note = self._speed_peak_note
        return (
            *ToolSpeeds(work=self.speed, rapids=self.rapid_speed).rows,
            Row("speed_ratio", self.speed_ratio, "1", "tool speed / assigned, largest", note),
            Row("speed_overshoot", self.speed_overshoot, "m/s"),
            Row("path_velocity", self.path_velocity, "m/s", "tool speed, mean"),
            Row("time_at_limit", self.time_at_limit, "1", "some joint at a limit", self._reserved),
            Row("limit_ratios", self.limit_ratios, "1", "limit use, planned", largest),
            Row("demand", self.demand, self._unit("rad/s^2")),
            demand_row(self.demand_ratio),
            Row("jerk", self.jerk, self._unit("rad/s^3")),
            _joint_row("jerk_ratio", self.jerk_ratio, "joint jerk"),
            Row("command_jerk", self.command_jerk, self._unit("rad/s^3")),
            saturated_row(self.saturated),
        )

    @property
    def _speed_peak_note(self) -> str:
        """Note with the speed, the assigned velocity and the time of a `speed_ratio` above 1."""
        peak = self.speed_peak
        if peak is None or self.speed_ratio <= 1 + SPEED_TOLERANCE:
            return ""
        speed = number(peak.speed, "m/s")
        return f"{speed} of {number(peak.assigned, 'm/s')} at t = {peak.t:.3f} s"

    def _unit(self, unit: str) -> str:
        """Unit of all joints, from that of revolute joints."""
        return unit_of(None if self.judged is None else self.judged.executed.arm, unit)

    @property
    def _reserved(self) -> str:
        """Note on the times and limits to which `time_at_limit` refers."""
        plan = None if self.judged is None else self.judged.executed.set_points.trajectory
        if plan is None or not plan.reserve:
            return "of the motion"
        usable = number(1 - plan.reserve, "1")
        return f"of the motion; planned for {usable} of the accelerations and torques"

    __repr__ = short_repr
    plot = pictures.plot
    _repr_html_ = pictures.draw_as_html


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedPeak:
    """The place at which the tool speed exceeds the assigned velocity by the largest ratio.

    Args:
        t: Time [s].
        speed: Tool speed [m/s].
        ratio: Tool speed / assigned velocity.
    """

    t: float
    speed: float
    ratio: float

    @property
    def assigned(self) -> float:
        """The assigned velocity there [m/s]."""
        return self.speed / self.ratio


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolSpeeds:
    """Largest tool speeds of a motion.

    Args:
        work: On contours while the process is at work [m/s].
        rapids: At other times, in rapids and in leads without the process [m/s]; None if the motion
            has neither.
    """

    work: float
    rapids: float | None

    @property
    def rows(self) -> tuple[Row, Row]:
        """Rows of both speeds."""
        return (
            Row("speed", self.work, "m/s", "tool speed at work, largest"),
            Row("rapid_speed", self.rapids, "m/s", "tool speed in rapids, largest"),
        )


def tool_speeds(motion: Execution, speed: FloatArray) -> ToolSpeeds:
    """Return the largest tool speeds of an execution, by the times at work of its plan.

    - `speed`: tool speed of the execution [m/s], (n,).
    """
    trajectory = motion.set_points.trajectory
    if not trajectory.spans:
        return ToolSpeeds(work=float(speed.max()), rapids=None)
    at_work = np.zeros(len(speed), dtype=np.bool_)
    work = np.array([span.work or span.t for span in trajectory.contour_spans])
    first = np.searchsorted(motion.t, work[:, 0])
    last = np.searchsorted(motion.t, work[:, 1], side="right")
    for begin, end in zip(first.tolist(), last.tolist(), strict=True):
        at_work[begin:end] = True
    elsewhere = ~at_work & (motion.t >= 0) & (motion.t <= trajectory.duration)
    return ToolSpeeds(
        work=float(speed[at_work].max(initial=0.0)),
        rapids=float(speed[elsewhere].max()) if elsewhere.any() else None,
    )


def duration_row(duration: float, level: int = FIRST) -> Row:
    """Make the row of a plan's duration [s]."""
    return Row("duration", duration, "s", "motion", level=level)


def settled_row(settled: float) -> Row:
    """Make the row of the time after which the tool rests [s]."""
    return Row("settled", settled, "s", "at rest after")


def demand_row(ratios: FloatArray) -> Row:
    """Make the row of `demand_ratio`, (dof,)."""
    return _joint_row("demand_ratio", ratios, "joint demand")


def saturated_row(fractions: FloatArray) -> Row:
    """Make the row of `saturated`, (dof,)."""
    joints = [f"joint {j + 1} {number(x, '1')}" for j, x in enumerate(fractions) if x > 0]
    return Row("saturated", fractions, "1", "saturated", ", ".join(joints) or "no joint", VERDICT)


def _joint_row(name: str, ratios: FloatArray, label: str) -> Row:
    """Make a row of one ratio per joint that names the largest; without a label if all are 0."""
    if not ratios.any():
        return Row(name, ratios, "1")
    return Row(name, ratios, "1", label, f"joint {int(ratios.argmax()) + 1}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class EvaluationInputs:
    """Inputs of an evaluation."""

    executed: Execution
    path: Program  # Program that the tool should follow
    objective: Program | None  # Program before rounding or shaping; None if not specified
    limits: Limits


@checked
def evaluate(
    executed: Execution,
    path: Path | Program,
    *,
    objective: Path | Program | None = None,
    limits: Limits | None = None,
    end_time: Interval | None = None,
    limit_use: bool = False,
    progress: Progress | None = None,
) -> Evaluation:
    """Evaluate an execution against its path.

    Root mean squares are weighted by time, from the first set-point to `end_time`; the arm is
    assumed to be at rest after the end of the execution. In a program, every contour is evaluated
    while the process works on it, and nothing is evaluated between contours. A single path is
    evaluated from start to end.

    >>> result = ac.evaluate(executed, path, objective=objective, limits=limits)
    >>> result.contour_error.rms <= result.contour_error.max
    True

    Args:
        executed: The execution.
        path: The path that the tool should follow, or the planned program.
        objective: The path or program before rounding or shaping; required for `objective_error`,
            `objective_coverage_error` and `corners`.
        limits: Limits instead of those of the plan.
        end_time: End of the evaluated time [s]. By default largest errors cover the whole
            execution, and root mean squares the time until the planned motion has ended and the
            tool speed stays below 1 mm/s. Not allowed for a program of more than one path.
        limit_use: Compute `time_at_limit` and `limit_ratios`, which takes longer than all errors
            together. If False, they are None.
        progress: Called after every contour with the step "evaluation" and the fraction done.

    Raises:
        InvalidInput: The path has another dimension than the arm, `end_time` is not positive, or
            the program is not the planned one.
    """
    program = Program.from_path(path)
    drawn = None if objective is None else Program.from_path(objective)
    if end_time is not None and program.single_path is None:
        raise InvalidInput(
            "end_time is allowed only for a single path, because the contours of a program are "
            "evaluated while the process is on."
        )
    trajectory = executed.set_points.trajectory
    bounds = resolve_limits("evaluate", executed.arm, limits, trajectory.limits)
    tool_speed = executed.tool_speed
    settled = settling_time(executed, tool_speed)
    end = settled if end_time is None else end_time
    pieces = split_by_contour(executed, program, drawn, end_time)
    contour_errors = []
    drawing_errors = []
    for k, piece in enumerate(pieces, start=1):
        contour_errors.append(piece.contour_error)
        if (drawing_error := piece.drawing_error) is not None:
            drawing_errors.append(drawing_error)
        if progress is not None:
            progress(contour_step("evaluation", k, len(pieces)))
    speed_ratios = [x.speed_ratios(bounds.speed) for x in pieces]
    speed_peak = _find_speed_peak(pieces, speed_ratios, bounds.speed)
    jerk = executed_jerk(executed)
    is_program = program.single_path is None
    return Evaluation(
        duration=trajectory.duration,
        settled=settled,
        end_time=end,
        contour_error=ErrorProfile.join(contour_errors),
        coverage_error=largest_coverage([x.coverage_search for x in pieces]),
        tracking_error=ErrorProfile.join(tracking_errors(pieces)),
        model_error=_largest_errors([x.model_error for x in pieces]),
        objective_error=_join_known([x.objective_error for x in pieces]),
        objective_coverage_error=_largest_known([x.objective_search for x in pieces]),
        orientation_error=_join_known([x.orientation_error for x in pieces]),
        corners=_join_corners(pieces, is_program=is_program),
        contours=tuple(contour_errors),
        drawing_errors=tuple(drawing_errors),
        speed=max(float(x.speed.max()) for x in pieces),
        rapid_speed=tool_speeds(executed, tool_speed).rapids,
        speed_ratio=np.nan if speed_peak is None else speed_peak.ratio,
        speed_peak=speed_peak,
        speed_overshoot=_largest_overshoot(pieces, speed_ratios),
        path_velocity=_mean_speed(pieces) if is_program else _mean_planned_speed(executed),
        demand=executed.peak_demand,
        demand_ratio=demand_ratio(executed, bounds),
        jerk=jerk,
        jerk_ratio=use_of("joint_jerk", bounds, jerk).ratio,
        command_jerk=commanded_jerk(executed.set_points),
        saturated=saturated_fractions(executed, end),
        time_at_limit=_time_at_limit(executed, bounds) if limit_use else None,
        limit_ratios=measure_limit_ratios(trajectory, executed.arm, bounds) if limit_use else None,
        judged=EvaluationInputs(executed=executed, path=program, objective=drawn, limits=bounds),
    )


def _largest_known(searches: Sequence[CoverageSearch | None]) -> Coverage | None:
    """Return the largest coverage error of the searches that are not None; None if all are."""
    known = [x for x in searches if x is not None]
    return largest_coverage(known) if known else None


def _find_speed_peak(
    pieces: Sequence[ContourExecution], speed_ratios: Sequence[FloatArray], limit: float | None
) -> SpeedPeak | None:
    """Return where the ratio to the assigned velocity is largest; None if none is assigned.

    Where the assigned velocity jumps between two samples, the ratio is that of the segment's end,
    and the speed follows from it.
    """
    peaks = []
    for piece, ratios in zip(pieces, speed_ratios, strict=True):
        i = int(ratios.argmax())
        ratio = float(ratios[i])
        if ratio > 0:
            place = piece.followed.s[i]
            near = place + np.array([-1.0, 0.0, 1.0]) * piece.followed.distance[i]
            assigned = piece.path.assigned_speeds(limit, near)
            nearest = int(np.abs(assigned - piece.speed[i] / ratio).argmin())
            speed = ratio * float(assigned[nearest])
            peaks.append(SpeedPeak(t=float(piece.t[i]), speed=speed, ratio=ratio))
    return max(peaks, key=lambda x: x.ratio, default=None)


def _largest_overshoot(
    pieces: Sequence[ContourExecution], speed_ratios: Sequence[FloatArray]
) -> float:
    """Return the largest excess of the tool speed over the assigned velocity [m/s]."""
    overshoots = []
    for piece, ratio in zip(pieces, speed_ratios, strict=True):
        overshoot = piece.speed * (1 - 1 / np.maximum(ratio, 1.0))
        overshoots.append(float(overshoot.max()))
    return max(overshoots)


def _mean_speed(pieces: Sequence[ContourExecution]) -> float:
    """Return the mean tool speed over the time at work [m/s]."""
    lengths = [integrate(x.speed, x.t) for x in pieces]
    durations = [x.t[-1] - x.t[0] for x in pieces]
    return float(sum(lengths) / sum(durations))


def _mean_planned_speed(executed: Execution) -> float:
    """Return the mean tool speed over the planned time of the motion [m/s]."""
    planned = _planned_times(executed)
    length = integrate(executed.tool_speed[planned], executed.t[planned])
    return float(length / executed.set_points.trajectory.duration)


def _planned_times(executed: Execution) -> BoolArray:
    """Return the mask of the samples in the planned time of the motion, (n,)."""
    duration = executed.set_points.trajectory.duration
    return (executed.t >= 0) & (executed.t <= duration)


def demand_ratio(executed: Execution, limits: Limits) -> FloatArray:
    """Return the largest demanded fraction of each joint's acceleration limit, (dof,)."""
    return use_of("joint_acceleration", limits, executed.demand_range).largest


def saturated_fractions(executed: Execution, end: float) -> FloatArray:
    """Return the saturated share of the time to the last sample or a later `end` [s], (dof,)."""
    time = max(end, float(executed.t[-1])) - float(executed.t[0])
    return np.asarray(executed.saturated_time / time)


def _join_known(profiles: Sequence[ErrorProfile | None]) -> ErrorProfile | None:
    """Join the profiles that are not None; None if all are None."""
    known_profiles = [x for x in profiles if x is not None]
    return ErrorProfile.join(known_profiles) if known_profiles else None


def _join_corners(
    pieces: Sequence[ContourExecution], *, is_program: bool
) -> tuple[CornerDeviation, ...]:
    """Join the deviations at the corners of all pieces, with contour numbers in a program."""
    corners: list[CornerDeviation] = []
    for k, piece in enumerate(pieces, start=1):
        contour = k if is_program else None
        corners += [replace(x, contour=contour) for x in piece.corners]
    return tuple(corners)


def _largest_errors(errors: Sequence[tuple[float, float] | None]) -> tuple[float, float] | None:
    """Return the largest errors along and across the path [m]; None if all are None."""
    known = [x for x in errors if x]
    along = max((x[0] for x in known), default=-1.0)
    across = max((x[1] for x in known), default=-1.0)
    return None if along < 0 else (along, across)


def _time_at_limit(executed: Execution, limits: Limits) -> float:
    """Return the share of the planned time in which a joint uses at least AT_LIMIT of a limit."""
    planned = _planned_times(executed)
    values = {"joint_acceleration": executed.ddq, "joint_velocity": executed.dq}
    if executed.torque is not None:
        values["joint_torque"] = executed.torque
    elif limits.joint_torque is not None and executed.arm.has_bodies:
        values["joint_torque"] = executed.arm.torque(executed.q, executed.dq, executed.ddq)
    ratios = [use_of(name, limits, x[planned]).ratio for name, x in values.items()]
    return float((np.max(ratios, axis=0) >= AT_LIMIT).any(axis=1).mean())


def executed_jerk(executed: Execution) -> FloatArray:
    """Return the largest mean jerk of each joint over any cycle [rad/s³], (dof,)."""
    t = executed.t
    ddq = executed.ddq
    if len(t) < 2:
        return np.zeros(ddq.shape[1])
    step = float(t[-1] - t[0]) / (len(t) - 1)
    k = max(1, round(executed.set_points.cycle / step))
    # The mean is over the cycle that ends at each time. The arm rests before the first sample.
    before = np.concatenate([np.zeros((k, ddq.shape[1])), ddq])[: len(ddq)]
    return np.asarray(np.abs((ddq - before) / (k * step)).max(axis=0))


def commanded_jerk(set_points: SetPoints) -> FloatArray:
    """Return each joint's largest jerk, by third differences of set-points [rad/s³], (dof,)."""
    # Before the first and after the last set-point the command is constant.
    third = np.diff(np.pad(set_points.q, ((3, 3), (0, 0)), mode="edge"), n=3, axis=0)
    return np.asarray(np.abs(third).max(axis=0) / set_points.cycle**3)
