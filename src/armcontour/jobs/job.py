"""A job: everything that a study needs to know, in SI units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.jobs.goal import Goal
from armcontour.program import Process, Program
from armcontour.servo import ServoModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Rounding:
    """How corners are rounded: the arguments of `round_corners`, one value for all corners."""

    tolerance: float | None = None
    speed: float | None = None
    acceleration: float | None = None
    angular_tolerance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """The arm's rigid bodies, on which a run is executed too: options of `RigidBodyPlant`.

    Args:
        step: Cycle of the drives [s].
        gravity_feedforward: Whether the controller adds the torque against gravity.
        friction: Whether the arm's friction acts.
        noise: Standard deviation of measured joint positions [rad].
        seed: Of the noise.
    """

    step: float = 2.5e-4
    gravity_feedforward: bool = True
    friction: bool = True
    noise: float = 0.0
    seed: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """One way to do the job, to be compared with others.

    Args:
        name: Key of the run in the study.
        timing: Method of `plan`.
        compensation: Method of `compensate`.
        limits: Limits of this run.
        rounding: How its corners are rounded; None keeps them sharp.
        period: Command interval [s].
        timing_options: Options of the timing method.
        compensation_options: Options of the compensation method.
        until: End of the time that errors cover [s]; None is until the tool rests.
        ignore_jerk: Plan in spite of limits of jerk.
        reserve: Share of joint acceleration and torque that the plan leaves to the servo.
        experiment: How it is executed on the arm's rigid bodies too; None leaves that out.
    """

    name: str
    timing: str
    compensation: str
    limits: Limits
    rounding: Rounding | None
    period: float
    timing_options: Mapping[str, Any] = field(default_factory=dict)
    compensation_options: Mapping[str, Any] = field(default_factory=dict)
    until: float | None = None
    ignore_jerk: bool = False
    reserve: float = 0.0
    experiment: Experiment | None = None

    @property
    def plan_options(self) -> dict[str, Any]:
        """How `plan` is to time its path."""
        return {
            "method": self.timing,
            "ignore_jerk": self.ignore_jerk,
            "reserve": self.reserve,
            **self.timing_options,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Published:
    """Figures that someone published for the same job, to stand beside ours.

    Args:
        source: Where they stand.
        runs: Per run of the job: name of a figure ("contour_error_rms", "duration", "settled") to
            its value [SI].
        time_stamps: The published times of the switching points [s].
        time_stamps_of: The run that they belong to.
        notes: Sentences on what to make of the differences.
    """

    source: str
    runs: Mapping[str, Mapping[str, float]]
    time_stamps: tuple[float, ...] = ()
    time_stamps_of: str | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Job:
    """A path, an arm, a servo, and the runs to compare.

    Args:
        name: Short name.
        title: For people.
        arm: The arm.
        path: The objective path, or a program of several.
        process: What is added to the contours of a program, such as leads.
        branch: Branch of the inverse kinematics of an arm in the plane; None is its first.
        start: For an arm in space: joint positions near to those to start in [rad], (dof,); None
            is the configuration that is fastest along the path.
        servo: The servo's nominal model, which compensation uses.
        plant_servo: The gains of the simulated servo.
        runs: At least one, with different names.
        published: Figures to compare with.
        certificate: What a certified plan of it has to hold.

    Raises:
        InvalidInput: No run, two of the same name, or a start for another number of joints.
    """

    name: str
    title: str
    arm: Arm
    path: Path | Program
    servo: ServoModel
    plant_servo: ServoModel
    runs: tuple[Run, ...]
    branch: str | None = None
    start: FloatArray | None = None
    process: Process = field(default_factory=Process)
    published: Published | None = None
    certificate: Goal | None = None

    def __post_init__(self) -> None:
        names = [x.name for x in self.runs]
        if not names or len(set(names)) < len(names):
            raise InvalidInput("A job needs at least one run, and every run its own name.")
        if isinstance(self.path, Program) and any(x.until is not None for x in self.runs):
            raise InvalidInput(
                "until is for a job of one path: the contours of a program are judged while they "
                "are worked on."
            )
        if self.start is not None:
            start = _checks.per_joint("start", self.start, self.arm.dof, "rad")
            object.__setattr__(self, "start", _checks.locked(start))

    @property
    def single_path(self) -> Path:
        """The objective path of a job that has one.

        Raises:
            InvalidInput: It has a program.
        """
        if isinstance(self.path, Path):
            return self.path
        raise InvalidInput(
            f"The job {self.name} is a program of {len(self.path.contours)} "
            f"contour{'s' if len(self.path.contours) != 1 else ''} with what belongs to it: "
            "certify, sweep and check --path take a job of a single path, without leads or events."
        )
