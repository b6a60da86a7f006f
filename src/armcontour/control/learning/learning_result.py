"""`Recording`, `LearningRun` and `LearningResult`: measured runs, and the next set-points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np

from armcontour.control.identification.candidate_models import Search
from armcontour.control.identification.log_segments import split_logs
from armcontour.control.identification.saturated_selection import find_supported_saturation
from armcontour.control.identification.saturation import LEAST_SHARE
from armcontour.control.learning.lifted_model import INDEPENDENT_SERVOS, Lifted
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Axes, Quantity, shared_unit
from armcontour.core.render import Result, number
from armcontour.core.result import FIRST, TABLE, VERDICT, Data, Row, Table
from armcontour.core.text import count_noun, short_repr
from armcontour.core.validity import AT_ENCODERS, OF_LOGS
from armcontour.motion import Execution, Log, SetPoints
from armcontour.motion.log import FEWEST
from armcontour.motion.log_checks import check_gaps
from armcontour.motion.log_times import repair_times
from armcontour.motion.time_finding import TimeFinding
from armcontour.robot.servo import ServoModel
from armcontour.verification import RepeatedRuns

# Largest difference of an execution's set-points from the set-points of the run [rad].
SET_POINT_TOLERANCE = 1e-9
# Longest dead time of the models that confirm saturation [s].
SEARCHED_DEAD_TIME = 0.25
# Consequence of saturation.
SATURATED = "Learning assumes a linear response. Plan with a larger reserve."
# Rounding error of the override in a log.
FULL_SPEED_ROUNDING = 1e-6


@declared(eq=False)
class Recording(Checked):
    """Measured joint positions over time.

    Args:
        t: Times [s], increasing, (n,).
        q: Measured joint positions [rad], (n, dof).
        velocity: Measured joint velocities [rad/s], (n, dof); None if they were not recorded.
        command: Set-points at the same times [rad], (n, dof), which determine the offset of the
            clock; None if they were not recorded.
        in_plan_time: True if `t` is exactly the time of the plan.
        exact: True if `q` are true positions of a simulation, without measurement noise.
        source: Source of the data, for messages.
        notes: As in `Log`.
        findings: As in `Log`.

    Raises:
        InvalidInput: The arrays are not finite numbers, or their shapes do not match.
    """

    t: Annotated[FloatArray, Quantity("s"), Axes("times")] = field(kw_only=False)
    q: Annotated[FloatArray, Quantity("rad"), Axes("times", "joints")] = field(kw_only=False)
    velocity: Annotated[FloatArray, Quantity("rad/s"), Axes("times", "joints")] | None = None
    command: Annotated[FloatArray, Quantity("rad"), Axes("times", "joints")] | None = None
    in_plan_time: bool = False
    exact: bool = False
    source: str = "the log"
    notes: tuple[str, ...] = ()
    findings: tuple[TimeFinding, ...] = ()

    def _check_together(self) -> None:
        """Raise InvalidInput unless there are at least two times, which increase."""
        if len(self.t) < 2:
            raise InvalidInput(
                f"{self.source} must have at least 2 samples, but has {len(self.t)}. Record the "
                "whole run."
            )
        falling = np.flatnonzero(np.diff(self.t) <= 0)
        if len(falling):
            k = int(falling[0])
            raise InvalidInput(
                f"The times of {self.source} must increase, but sample {k + 2} has t = "
                f"{self.t[k + 1]:.6g} s after {self.t[k]:.6g} s. Sort the samples by time, and "
                "remove samples with equal times."
            )

    __repr__ = short_repr

    @property
    def interval(self) -> float:
        """Median time between two samples [s]."""
        return float(np.median(np.diff(self.t)))

    def with_true_times(self) -> Recording:
        """Return the recording with repaired times, see `repair_times`.

        Raises:
            InvalidInput: Times are wrong, and no measured velocities determine the true ones.
        """
        if self.exact or self.in_plan_time or len(self.t) < FEWEST:
            return self
        # Without set-points, the repair only needs the measured positions.
        command = self.q if self.command is None else self.command
        log = repair_times(
            Log(
                t=self.t,
                command=command,
                measured=self.q,
                velocity=self.velocity,
                source=self.source,
                notes=self.notes,
                findings=self.findings,
            )
        )
        return replace(
            self,
            t=log.t,
            q=log.measured,
            command=None if self.command is None else log.command,
            velocity=log.velocity,
            notes=log.notes,
            findings=log.findings,
        )


def record(executed: Execution | Log | Recording, set_points: SetPoints) -> Recording:
    """Convert an execution or a log to a recording; raise an error if it does not fit the run."""
    if isinstance(executed, Execution):
        executed_points = executed.set_points
        same = (
            executed_points.q.shape == set_points.q.shape
            and executed_points.cycle == set_points.cycle
        )
        if not same or np.abs(executed_points.q - set_points.q).max() > SET_POINT_TOLERANCE:
            raise InvalidInput(
                "The execution must have the same set-points and cycle as set_points, but they "
                "differ. Specify the set-points that were executed."
            )
        recording = Recording(
            t=executed.t + set_points.start_time - executed_points.start_time,
            q=executed.q,
            in_plan_time=True,
            exact=True,
            source="the execution",
            notes=tuple(
                f"joint {j + 1} saturates for {number(time, 's')}. {SATURATED}"
                for j, time in enumerate(executed.saturated_time)
                if time > LEAST_SHARE * float(np.ptp(executed.t))
            ),
        )
    elif isinstance(executed, Log):
        if executed.lowest_override < 1 - FULL_SPEED_ROUNDING:
            raise InvalidInput(
                f"{executed.source} was recorded at {100 * executed.lowest_override:.3g} % of the "
                "planned speed at the least, but learning needs a whole run at 100 %. Play the run "
                "again without a pause, with --speed-factor '100 %'."
            )
        log = repair_times(executed)
        recording = Recording(
            t=log.t, q=log.measured, command=log.command, source=log.source,
            notes=tuple(_describe_saturation(log)), findings=log.findings,
        )  # fmt: skip
    elif isinstance(executed, Recording):
        recording = executed.with_true_times()
    else:
        raise InvalidInput(
            f"executed must be an Execution, a Log or a Recording, but is "
            f"{type(executed).__name__}."
        )
    check_gaps(recording.source, recording.t)
    if recording.q.shape[1] != set_points.q.shape[1]:
        raise InvalidInput(
            f"{recording.source} has {recording.q.shape[1]} joints, but the set-points have "
            f"{set_points.q.shape[1]}. Specify a log of this job."
        )
    return recording


def _describe_saturation(log: Log) -> list[str]:
    """Return sentences about the joints that saturate in a log."""
    longest = min(SEARCHED_DEAD_TIME, float(np.ptp(log.t)) / 4)
    search = Search(longest, 0.0, ("delay", "first", "second"))
    sentences = []
    for j, (name, slides) in enumerate(zip(log.joint_names, log.prismatic, strict=True)):
        segments = split_logs([log], j, "linear")
        saturation = find_supported_saturation(segments, search)[0] if segments else None
        if saturation is not None:
            sentences.append(f"{saturation.describe(name, prismatic=slides)}. {SATURATED}")
    return sentences


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearningRun(Result, Checked):
    """One run and its measured errors.

    Except for `error`, errors do not include white noise.

    Args:
        q: Set-points that were executed [rad], (n, dof).
        error: Measured deviations of the joints from the plan, with noise, at the times
            `LearningResult.lifted.t` [rad], (m, dof).
        noise: Standard deviation of the white noise in `error` [rad], (dof,).
        rest: Deviations of the joints from the end of the plan where they come to rest after the
            last set-point [rad], (dof,).
        rests_later: Whether each joint comes to rest after the times of `error`, (dof,).
        joint_rms: RMS error of each joint [rad], (dof,).
        joint_max: Largest error of each joint [rad], (dof,).
        tool_rms: RMS distance of the tool from its planned position at the same time [m].
        tool_max: Largest distance of the tool from its planned position at the same time, also at
            rest [m].
        tool_rest: Distance of the tool from the end of the plan where it comes to rest [m].
        contour_rms: RMS distance of the tool from its path [m]; None if the plan has no path.
        contour_max: Largest distance of the tool from its path, also at rest [m]; None if the plan
            has no path.
        offset: Time of the plan at which the clock of the log is 0 [s].
        rate: Time of the plan per time of the log.
        set_points_off: RMS difference of the set-points in the log from those of the run [rad]; 0
            if the log has no set-points.
        source: Source of the log, for messages.
        notes: Sentences on the log, such as joints that saturate.
        prismatic: Whether each joint is prismatic, with m instead of rad; by default none is.
    """

    q: FloatArray
    error: FloatArray
    noise: FloatArray
    rest: FloatArray
    rests_later: BoolArray
    joint_rms: FloatArray
    joint_max: FloatArray
    tool_rms: float
    tool_max: float
    tool_rest: float = 0.0
    contour_rms: float | None = None
    contour_max: float | None = None
    offset: float = 0.0
    rate: float = 1.0
    set_points_off: float = 0.0
    source: str = "the execution"
    notes: tuple[str, ...] = ()
    prismatic: tuple[bool, ...] = ()

    def to_data(self) -> Data:
        """Return the errors of the run as data."""
        unit = shared_unit("rad", self.prismatic)
        level = FIRST if self.contour_rms is None else TABLE
        rms, largest = (
            ("contour error, RMS", "contour error, largest") if level == TABLE else ("", "")
        )
        return Data(
            f"Run from {self.source}",
            (
                Row("source", self.source, "", "from", level=FIRST),
                Row("contour_rms", self.contour_rms, "m", rms, "", FIRST),
                Row("contour_max", self.contour_max, "m", largest, "", FIRST),
                Row("tool_rms", self.tool_rms, "m", "tracking error, RMS", level=level),
                Row("tool_max", self.tool_max, "m", "tracking error, largest", level=level),
                Row("tool_rest", self.tool_rest, "m", "error at rest"),
                Row("offset", self.offset, "s"),
                Row("begin", -self.offset / self.rate, "s", "begins in the log at", "", FIRST),
                Row("rate", self.rate),
                Row("joint_rms", self.joint_rms, unit, "joint error, RMS"),
                Row("joint_max", self.joint_max, unit, "joint error, largest"),
                Row("noise", self.noise, unit, "noise"),
                Row("set_points_off", self.set_points_off, unit),
                Row("notes", self.notes),
            ),
        )

    __repr__ = short_repr

    @property
    def largest(self) -> float:
        """Largest error of the tool [m]: `contour_max`, or `tool_max` if it is None."""
        return self.tool_max if self.contour_max is None else self.contour_max

    @property
    def rms(self) -> float:
        """Error by which runs are compared [m]: `contour_rms`, or `tool_rms` if it is None."""
        return self.tool_rms if self.contour_rms is None else self.contour_rms


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearningResult(Result, SetPoints):
    """Set-points for the next run, and the results of the runs so far.

    Args:
        runs: The runs so far, in order.
        servo: The servo whose response is used for learning, as specified for the first run or as
            identified from its log.
        best: Index of the run with the smallest measured error.
        repeats: RMS value of the mean error in all runs with the best run's set-points [m].
        noise: RMS error that differs between runs of equal set-points [m]; None if there are no
            such runs.
        setbacks: Number of runs that did not reduce the error by at least 5 %.
        finished: True if no further improvement is expected. The set-points are then those of the
            best run.
        reason: Reason why learning is finished, or limit that restricts the step; may be empty.
        model: Model whose response is used: "rigid bodies" or "independent servos", whichever the
            first log supports, or "independent servos identified from the first log".
        lifted: The linear model, reused from run to run because computing it takes most of the
            time; None computes it again.

    Raises:
        InvalidInput: There are no runs, or the set-points are invalid (see `SetPoints`).
    """

    runs: tuple[LearningRun, ...]
    servo: ServoModel
    best: int
    repeats: float
    noise: float | None = None
    setbacks: int = 0
    finished: bool = False
    reason: str = ""
    model: str = INDEPENDENT_SERVOS
    lifted: Lifted | None = field(default=None, repr=False)

    def _check_together(self) -> None:
        SetPoints._check_together(self)
        if not self.runs:
            raise InvalidInput("A learning result must have at least one run, but runs is empty.")

    def to_data(self) -> Data:
        """Return the verdict and the errors of the runs as data."""
        best = f"run {self.best + 1}"
        return Data(
            f"Learning from {count_noun(len(self.runs), 'run')}, errors {AT_ENCODERS}: "
            f"{count_noun(len(self.q), 'set-point')} every {number(self.cycle, 's')}",
            (
                Row("finished", self.finished, "", "finished", self.reason, VERDICT),
                Row("first", self.runs[0].rms, "m", "before learning, RMS", level=FIRST),
                Row("remaining", self.remaining, "m", "best run, RMS", best, FIRST),
                Row("repeats", self.repeats, "m"),
                Row("does_not_repeat", self.noise, "m", "does not repeat, RMS", level=FIRST),
                *(self.repeated.rows if self.repeated else ()),
                Row("model", self.model, "", "model", level=FIRST),
                Row("best", self.best + 1),
                Row("setbacks", self.setbacks, "", "setbacks"),
                Row("reason", self.reason),
            ),
            (Table.from_results("runs", [x.to_data() for x in self.runs]),),
            notes=self.notes,
            not_proven=OF_LOGS,
        )  # fmt: skip

    __repr__ = short_repr

    @property
    def repeated(self) -> RepeatedRuns | None:
        """Largest errors of the runs with the last run's set-points; None if it is the only one."""
        last = self.runs[-1]
        equal = [k for k, x in enumerate(self.runs) if np.array_equal(x.q, last.q)]
        if len(equal) < 2:
            return None
        largest = [self.runs[k].largest for k in equal]
        return RepeatedRuns(largest=np.array(largest), numbers=np.array(equal) + 1)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the last run, and on runs that differ from others with its set-points."""
        repeated = self.repeated
        difference = (repeated.note,) if repeated and repeated.note else ()
        return (*difference, *self.runs[-1].notes)

    @property
    def remaining(self) -> float:
        """RMS error of the best run [m]."""
        return self.runs[self.best].rms
