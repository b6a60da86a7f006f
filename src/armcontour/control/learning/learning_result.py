"""`Recording`, `LearningRun` and `LearningResult`: earlier runs, and the next set-points."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from armcontour.control.learning.lifted_model import Lifted
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import Axes, Quantity
from armcontour.core.render import Result, number
from armcontour.core.result import FIRST, TABLE, VERDICT, Data, Row, Table
from armcontour.core.sampling import GAP, describe_bursts
from armcontour.core.text import clock, count_noun, format_table, joint_rows, short_repr
from armcontour.motion import Execution, Log, SetPoints
from armcontour.robot.servo import ServoModel

# Largest number of runs whose errors are printed.
MAX_LISTED = 10
# Set-points of an execution differ from the exported ones by less than this [rad].
SAME = 1e-9
# Largest share of a recording that may be gaps.
MAX_MISSED = 0.1


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording(Checked):
    """Measured joint positions over time.

    Args:
        t: Times [s], increasing, (n,).
        q: Measured joint positions [rad], (n, dof).
        command: Set-points at the same times [rad], (n, dof), by which the clock is found; None if
            they were not recorded.
        in_plan_time: True if `t` is exactly the time of the plan.
        exact: True if `q` are the true positions of a simulation, without measurement noise.
        source: Source of the data, for messages.
        notes: As in `Log`.

    Raises:
        InvalidInput: The arrays are not finite numbers, or do not fit each other.
    """

    t: Annotated[FloatArray, Quantity("s"), Axes("times")] = field(kw_only=False)
    q: Annotated[FloatArray, Quantity("rad"), Axes("times", "joints")] = field(kw_only=False)
    command: Annotated[FloatArray, Quantity("rad"), Axes("times", "joints")] | None = None
    in_plan_time: bool = False
    exact: bool = False
    source: str = "the log"
    notes: tuple[str, ...] = ()

    def _check_together(self) -> None:
        if len(self.t) < 2 or (np.diff(self.t) <= 0).any():
            raise InvalidInput(f"{self.source} needs at least two times, which must increase.")

    def __str__(self) -> str:
        """Source, times, and ranges of the joints."""
        times = f"t = {self.t[0]:.4f} to {self.t[-1]:.4f} s"
        return format_table(
            f"Recording: {count_noun(len(self.t), 'sample')}, {times}",
            [
                ("source", self.source),
                ("clock", "that of the plan" if self.in_plan_time else "its own"),
                ("set-points", "not recorded" if self.command is None else "recorded"),
                *joint_rows(self.q),
            ],
        )

    __repr__ = short_repr

    @property
    def interval(self) -> float:
        """The usual time between two samples [s]."""
        return float(np.median(np.diff(self.t)))


def record(executed: Execution | Log | Recording, set_points: SetPoints) -> Recording:
    """Convert an execution or a log to a recording, with checks."""
    if isinstance(executed, Execution):
        executed_points = executed.set_points
        same = (
            executed_points.q.shape == set_points.q.shape
            and executed_points.cycle == set_points.cycle
        )
        if not same or np.abs(executed_points.q - set_points.q).max() > SAME:
            raise InvalidInput(
                "The execution is one of other set-points: give the set-points that were executed."
            )
        recording = Recording(
            t=executed.t + set_points.start_time - executed_points.start_time,
            # Encoders of drives measure the motors.
            q=executed.q if executed.motor_q is None else executed.motor_q,
            in_plan_time=True,
            exact=True,
            source="the execution",
        )
    elif isinstance(executed, Log):
        recording = Recording(
            t=executed.t, q=executed.measured, command=executed.command, source=executed.source
        )
    elif isinstance(executed, Recording):
        recording = executed
    else:
        raise InvalidInput(
            f"learn needs an Execution, a Log or a Recording, not {type(executed).__name__}."
        )
    _check_gaps(recording)
    if recording.q.shape[1] != set_points.q.shape[1]:
        raise InvalidInput(
            f"{recording.source} has {recording.q.shape[1]} joints, but the set-points have "
            f"{set_points.q.shape[1]}: give the log of this job."
        )
    return recording


def _check_gaps(recording: Recording) -> None:
    """Check that gaps are a small share of the recording, and that times do not come in bursts."""
    t, source = recording.t, recording.source
    steps = np.diff(t)
    if bursts := describe_bursts(t, source):
        raise InvalidInput(bursts)
    missed = float(steps[steps > GAP * recording.interval].sum())
    allowed = MAX_MISSED * float(np.ptp(t))
    if missed > allowed:
        i = int(np.argmax(steps))
        raise InvalidInput(
            f"{source} has gaps of {missed:.3g} s in all, the longest of {steps[i]:.3g} s at "
            f"t = {clock(t[i])} s, but learning bridges at most {allowed:.3g} s of this log: "
            "record the run again.",
            index=i,
            t=float(t[i]),
            needed=missed,
            allowed=allowed,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearningRun(Result, Checked):
    """One run and its measured errors.

    Errors are those that a disturbance of the drives explains, without white noise.

    Args:
        q: Set-points that were executed [rad], (n, dof).
        error: Measured deviations of the joints from the plan, with noise, at the times
            `LearningResult.lifted.t` [rad], (m, dof).
        noise: Standard deviation of the white noise in `error` [rad], (dof,).
        loop_noise: Standard deviation of the noise of positions in the joints' loops, one value at
            each of these times [rad], (dof,).
        joint_rms: RMS error of each joint [rad], (dof,).
        joint_max: Largest error of each joint [rad], (dof,).
        tool_rms: RMS distance of the tool from its planned position at the same time [m].
        tool_max: Largest such distance [m].
        contour_rms: RMS distance of the tool from its path [m]; None if the plan has no path.
        contour_max: Largest such distance [m].
        offset: Time of the plan when the clock of the log was at 0 [s].
        rate: Seconds of the plan in a second of the log.
        predicted: Predicted value of `rms` [m]; None for the first run.
        set_points_off: RMS difference of the set-points in the log from those of the run [rad]; 0
            if the log has none.
        source: Source of the log, for messages.
        encoder_shift: Offset of each encoder since the best earlier run, which is not in `error`
            [rad], (dof,); None if it was not estimated.
        outliers: Number of samples of the log that were ignored.
    """

    q: FloatArray
    error: FloatArray
    noise: FloatArray
    loop_noise: FloatArray
    joint_rms: FloatArray
    joint_max: FloatArray
    tool_rms: float
    tool_max: float
    contour_rms: float | None = None
    contour_max: float | None = None
    offset: float = 0.0
    rate: float = 1.0
    predicted: float | None = None
    set_points_off: float = 0.0
    source: str = "the execution"
    encoder_shift: FloatArray | None = None
    outliers: int = 0

    def to_data(self) -> Data:
        """Errors of the run, and the predicted error."""
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
                Row("tool_rms", self.tool_rms, "m", "off the plan, RMS", level=level),
                Row("tool_max", self.tool_max, "m", "off the plan, largest", level=level),
                Row("predicted", self.predicted, "m", "expected, RMS", level=FIRST),
                Row("offset", self.offset, "s"),
                Row("begin", -self.offset / self.rate, "s", "begins in the log at", "", FIRST),
                Row("rate", self.rate),
                Row("joint_rms", self.joint_rms, "rad", "joint error, RMS"),
                Row("joint_max", self.joint_max, "rad", "joint error, largest"),
                Row("noise", self.noise, "rad", "noise"),
                Row("loop_noise", self.loop_noise, "rad"),
                Row("set_points_off", self.set_points_off, "rad"),
                Row("encoder_shift", self.encoder_shift, "rad"),
                Row("outliers", self.outliers),
            ),
        )

    __repr__ = short_repr

    @property
    def rms(self) -> float:
        """Error for the comparison of runs [m]: `contour_rms`, or else `tool_rms`."""
        return self.tool_rms if self.contour_rms is None else self.contour_rms


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearningResult(Result, SetPoints):
    """Set-points for the next run, and the findings from the runs before it.

    Args:
        runs: The runs so far, in order.
        servo: The servo whose response learning assumes: the nominal one, or, if the log of the
            first run does not support it, the one fitted to that log.
        misfits: RMS deviation of the joints in that log from the motion with the nominal servo,
            and with `servo` [rad]; both 0 if no servo was fitted.
        delay: Dead time of the robot beyond that of the servo model [s].
        predicted: Expected RMS error of the next run [m], comparable to `LearningRun.rms`.
        noise: Estimated RMS error that does not repeat from run to run [m].
        best: Index of the run whose set-points have the smallest repeating error.
        repeats: RMS error of these set-points that repeats [m], by all runs.
        setbacks: Number of times that a run was worse than the best before it.
        finished: True if no further improvement is expected. The set-points are then those of the
            best run or, if errors differ between runs, learned from all of them.
        reason: Reason why learning is finished, or limit of the step; may be empty.
        lifted: The model, reused from run to run because it takes most of the time; None builds it
            again.

    Raises:
        InvalidInput: There are no runs, or as `SetPoints` raises it.
    """

    runs: tuple[LearningRun, ...]
    servo: ServoModel
    misfits: tuple[float, float] = (0.0, 0.0)
    delay: float = 0.0
    predicted: float
    noise: float
    best: int
    repeats: float
    setbacks: int = 0
    finished: bool = False
    reason: str = ""
    lifted: Lifted | None = field(default=None, repr=False)

    def _check_together(self) -> None:
        SetPoints._check_together(self)
        if not self.runs:
            raise InvalidInput("A lesson needs at least one run from which it was learned.")

    def to_data(self) -> Data:
        """Errors of the runs, the expected error of the next one, and the verdict."""
        best = f"run {self.best + 1}"
        share = f"{number(self.noise_share, '1')} of the square"
        return Data(
            self._title(f"Lesson of {count_noun(len(self.runs), 'run')}"),
            (
                Row("finished", self.finished, "", "finished", self.reason, VERDICT),
                Row("first", self.runs[0].rms, "m", "before learning, RMS", level=FIRST),
                Row("remaining", self.remaining, "m", "best run, RMS", best, FIRST),
                Row("predicted", self.predicted, "m", "next run, expected RMS", "", FIRST),
                Row("repeats", self.repeats, "m", "repeats, RMS", best),
                Row("does_not_repeat", self.noise, "m", "does not repeat, RMS", share, FIRST),
                Row("noise_share", self.noise_share, "1"),
                Row("best", self.best + 1),
                Row("setbacks", self.setbacks, "", "setbacks"),
                Row("delay", self.delay, "s", "further dead time"),
                Row("reason", self.reason),
            ),
            (Table.from_results("runs", [x.to_data() for x in self.runs]),),
        )

    __repr__ = short_repr

    @property
    def remaining(self) -> float:
        """RMS error of the best run [m]."""
        return self.runs[self.best].rms

    @property
    def noise_share(self) -> float:
        """Share of the squared remaining error that does not repeat, from 0 to 1."""
        return min((self.noise / self.remaining) ** 2, 1.0) if self.remaining > 0 else 1.0
