"""`Job`: path, arm, servo, runs, certificate and exports, in SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated

import numpy as np

from armcontour.control.compensation import (
    INVERSE,
    CompensationOptions,
    InverseDynamics,
    NoCompensation,
)
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.fields import Checked, declared
from armcontour.core.frames import Frame
from armcontour.core.lazy import load_method
from armcontour.core.quantities import (
    NO_KEY,
    Acceleration,
    AngularDistance,
    AtLeast,
    Choice,
    Distance,
    Factor,
    Interval,
    Name,
    Named,
    Quantity,
    Speed,
    SpeedFactor,
)
from armcontour.core.render import number
from armcontour.core.source_file import SourceFile
from armcontour.core.text import count_noun, digits, format_table, short_repr
from armcontour.geometry import Path
from armcontour.jobs.analog_signals import check_analog
from armcontour.jobs.certificate_goal import CertificateGoal
from armcontour.motion import DEFAULT_CYCLE, Method, Servoj, SetPointRule, check_cycle, make_rule
from armcontour.motion.controller_facts import (
    ControllerFacts,
    facts_of_format,
)
from armcontour.planning import FASTEST, Optimal, PlanOptions, check_duration
from armcontour.planning.program_tracing import configuration_of
from armcontour.planning.timing_options import DEFAULT_ITERATIONS, MAX_SHAPES
from armcontour.program import Process, Program
from armcontour.program.corner_rounding import CONTINUITIES, Continuity
from armcontour.program.preparation import check_process
from armcontour.robot import Arm, Limits
from armcontour.robot.arm import unit_of
from armcontour.robot.bodies import Payload
from armcontour.robot.scene import Scene
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant
from armcontour.simulation.rigid_body_plant import DEFAULT_STEP, DriveCycle
from armcontour.verification.clearance import Cell, cell_of

if TYPE_CHECKING:
    from armcontour.planning import Shaped

PointTolerance = Annotated[float, Quantity("rad", "0.1 mrad", "positive")]
# Maximum length of a title, which is a line in reports [characters].
LONGEST_TITLE = 200
# Shapes of corners: arcs, or the fastest shape within the tolerance.
ARC = "arc"
FREE = "free"
SHAPES = (ARC, FREE)
TANGENT, CURVATURE = CONTINUITIES
# Proposed tolerance of corners that become rounded.
FIRST_TOLERANCE = "1 mm"
# Default limit for the distance of transitions from the objective [m].
TRANSITION_TOLERANCE = 1e-5


@declared(eq=False)
class Exports(Checked):
    """Files for robot controllers that `run` writes.

    >>> lasers = {"laser": {"kuka": 17, "abb": "doLaser"}}
    >>> Exports(formats=("kuka",), outputs=lasers).outputs_for("kuka")
    {'laser': 17}

    Args:
        formats: Formats by name, such as csv, or a template such as house.j2.
        outputs: Output of each event and analog output of the process, by name, such as `{laser: 0,
            power: AO0}`; or one per format, such as `{laser: {kuka: 17, abb: doLaser}}`.
        inputs: Input of the robot for each wait of the process, such as `{clamp: 3}`, or one per
            format, such as `{clamp: {kuka: 5, abb: diClamp}}`.
        tolerances: With ros-yaml, the tolerances in a FollowJointTrajectory goal, as a multiple of
            the predicted joint errors, at least 1; by default no goal is written.
        cycle: Time between points of the plan [s]; by default the cycle of the run. For programs
            such as kuka and abb, by default the longest interval with which the controller stays
            within the allowed contour error between the points.
        derivatives: Highest derivative of the positions: 2, 1 or 0; by default 2, or 0 for
            compensated set-points with limits of the user or a controller.
        points: With ros-yaml, largest number of points.
        point_tolerance: With `points`, largest difference that fewer points cause at any joint
            [rad].
        call: With urscript, whether the program is called at the end of its file, for the script
            file of a pendant.
        servoj: With urscript and `play --on ur`, arguments of `servoj`.
    """

    formats: Sequence[str] = ()
    outputs: Mapping[str, int | str | Mapping[str, int | str]] = field(default_factory=dict)
    inputs: Mapping[str, int | str | Mapping[str, int | str]] = field(default_factory=dict)
    tolerances: Factor | None = None
    cycle: Interval | None = None
    derivatives: Annotated[int, AtLeast(0, 2)] | None = None
    points: Annotated[int, AtLeast(2)] | None = None
    point_tolerance: PointTolerance | None = None
    call: bool = False
    servoj: Servoj = Servoj()

    def _check_together(self) -> None:
        """Refuse options that need each other or another format."""
        if (self.points is None) != (self.point_tolerance is None):
            raise InvalidInput("points and point_tolerance require each other. Specify both.")
        if self.tolerances is not None and self.tolerances < 1:
            raise InvalidInput(
                f"tolerances must be at least 1, but is {self.tolerances:g}.", allowed=1.0
            )
        if self.formats or self.outputs or self.inputs:
            load_method("check_formats")(self)

    @property
    def programs(self) -> tuple[str, ...]:
        """Formats whose controllers plan the motion between the points, such as kuka and abb."""
        return tuple(load_method("program_formats")(self))

    @property
    def only_programs(self) -> bool:
        """True if there are formats, and all of them are such programs."""
        programs = self.programs
        return bool(programs) and len(programs) == len(self.formats)

    def outputs_for(self, format: str) -> dict[str, int | str]:
        """Map events and analog outputs to their outputs in a format.

        Args:
            format: Name of the format, or path of a template.
        """
        return _choose_signals(self.outputs, format)

    def inputs_for(self, format: str) -> dict[str, int | str]:
        """Map inputs for which the robot waits to its inputs in a format.

        Args:
            format: Name of the format, or path of a template.
        """
        return _choose_signals(self.inputs, format)


def _choose_signals(
    signals: Mapping[str, int | str | Mapping[str, int | str]], format: str
) -> dict[str, int | str]:
    """Return the outputs or inputs of a format, by name."""
    # Templates are named without their folder.
    key = PurePath(format).name
    chosen: dict[str, int | str] = {}
    for name, signal in signals.items():
        if not isinstance(signal, Mapping):
            chosen[name] = signal
        elif key in signal:
            chosen[name] = signal[key]
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment(Checked):
    """Options for simulating the arm as rigid bodies with `RigidBodyPlant`.

    Plans, compensation and the controller of the robot use only the model of the arm: gravity
    feed-forward does not include this payload.

    >>> Experiment(payload=Payload(mass=0.5)).unknown
    'a payload of 0.5 kg'

    Args:
        step: Cycle time of the drives [s].
        payload: Real payload at the tip, instead of the arm's payload; unknown to the controller.
            By default the arm's payload.

    Raises:
        InvalidInput: A step out of range.
    """

    step: DriveCycle = DEFAULT_STEP
    payload: Payload | None = None

    @property
    def unknown(self) -> str:
        """Text about properties of the robot that its controller does not model; may be empty."""
        return "" if self.payload is None else f"a payload of {self.payload.mass:g} kg"


def default_compensation(
    servo: ServoModel, arm: Arm, experiment: Experiment | None
) -> CompensationOptions:
    """Return the inverse of the plant that judges a run: rigid bodies, or the servo model."""
    if experiment is None or not arm.has_bodies or not servo.is_plain("second"):
        return INVERSE
    return InverseDynamics()


def required_servo(servo: ServoModel | None, export: Exports) -> ServoModel:
    """Return the servo of a job, which may be missing if the job exports only programs.

    Raises:
        InvalidInput: The servo is missing.
    """
    if servo is not None:
        return servo
    if export.only_programs:
        return ServoModel(order="unknown")
    raise InvalidInput(
        "the key servo is missing. Only a job whose exports are all programs of a controller that "
        "plans the motion itself, such as formats: [kuka], needs no servo.",
        key=("servo",),
    )


def build_plant(
    experiment: Experiment, arm: Arm, servo: ServoModel, limits: Limits, fed: bool
) -> RigidBodyPlant:
    """Build the simulated robot of an experiment: the rigid bodies that a run is simulated on.

    The key `plant` of a job only changes the parameters of the servo model.

    The plant has the payload of the experiment if it is given, else that of the arm. Its controller
    uses the model `arm`: J of its loops (unless the servo gives one), gravity feed-forward if
    `fed`, and torque limits that follow from acceleration limits.

    Raises:
        InvalidInput: The arm has no masses, or values do not fit the arm.
    """
    return RigidBodyPlant(
        arm.with_dynamics(payload=experiment.payload),
        servo,
        limits,
        step=experiment.step,
        gravity_feedforward=fed,
        controller=arm,
    )


@declared()
class Rounding(Checked):
    """Rounding of corners: by `tolerance`, or by `speed` and `acceleration`.

    >>> ac.Rounding(tolerance=1e-3).shape
    'arc'

    Args:
        shape: "arc" rounds corners with arcs; "free" finds, for the limits of the run, the fastest
            path whose points are all within the tolerance of the objective, at corners and along
            lines, and requires `tolerance` and the timing optimal.
        tolerance: Largest corner error [m].
        iterations: For the shape free, how many iterations the search may take.
        speed: Lowest corner speed [m/s].
        acceleration: Centripetal acceleration at that speed [m/s²]. If the limits have no
            `centripetal_acceleration`, this value limits the corner speed too.
        angular_tolerance: Largest angle between the tool and its required orientation [rad].
        continuity: For the shape arc, continuity of the rounded path: "tangent" with arcs alone, or
            "curvature" with transitions, so that jerk limits do not require stops. By default
            "curvature" for runs with jerk limits, and "tangent" for others.
    """

    shape: Annotated[str, Choice(SHAPES)] = ARC
    tolerance: Distance | None = None
    iterations: Annotated[int, AtLeast(0, MAX_SHAPES), NO_KEY] = DEFAULT_ITERATIONS
    speed: Speed | None = None
    acceleration: Acceleration | None = None
    angular_tolerance: AngularDistance | None = None
    continuity: Annotated[Continuity, Choice(CONTINUITIES)] | None = None

    @property
    def free(self) -> bool:
        """True if the shape is optimized together with the timing."""
        return self.shape == FREE

    @property
    def with_arcs(self) -> Rounding:
        """The same tolerance with arcs at the corners."""
        return replace(self, shape=ARC)

    def check(self, timing: PlanOptions, key: str = "corners") -> None:
        """Check that the values are consistent.

        Args:
            timing: Options of the run's timing method.
            key: The key of these values in messages.

        Raises:
            InvalidInput: Inconsistent values.
        """
        self._check_continuity(timing, key)
        if not self.free:
            return
        if timing.method != Method.OPTIMAL:
            raise InvalidInput(
                f"{key}.shape: free requires the timing method optimal, but this run has the "
                f"method {timing.method}. Add corners to the run, such as corners: {{tolerance: "
                "1 mm}, or set timing: {method: optimal}.",
                remedies=({("shape",): ARC},),
            )
        for name in ("speed", "acceleration"):
            if getattr(self, name) is not None:
                raise InvalidInput(
                    f"{key}.{name} determines the radius of arcs, but the shape is free. Remove "
                    f"{name} and specify tolerance, the largest distance from the objective.",
                    remedies=({(name,): None}, {("shape",): ARC}),
                )
        if self.tolerance is None:
            raise InvalidInput(
                f"{key}.tolerance is missing. Shape free requires the largest distance from the "
                "objective, such as tolerance: 1 mm.",
                remedies=({("tolerance",): FIRST_TOLERANCE},),
            )

    def _check_continuity(self, timing: PlanOptions, key: str) -> None:
        """Check that shape and timing support the continuity of the corners."""
        if self.continuity is None:
            return
        if self.free:
            raise InvalidInput(
                f"{key}.continuity requires shape: arc, but the shape is free. Remove continuity, "
                "or set shape: arc.",
                remedies=({("continuity",): None}, {("shape",): ARC}),
            )
        if self.continuity == CURVATURE and timing.only_arcs:
            raise InvalidInput(
                f"{key}.continuity is curvature, but the timing method {timing.method} supports "
                "only lines and arcs. Set continuity: tangent, or timing: {method: optimal}.",
                remedies=({("continuity",): TANGENT},),
            )


@declared()
class Run(Checked):
    """A run: limits and methods for one plan of the job, to be compared with other runs.

    >>> job = ac.read_job("job.yaml")
    >>> job.runs[0].name, job.runs[0].cycle
    ('only', 0.01)

    Args:
        name: Key of the run in the results.
        limits: Limits of this run.
        timing: Options of `plan`.
        compensation: Options of `compensate`.
        rounding: How corners are rounded; None keeps sharp corners.
        cycle: Cycle [s].
        end_time: End of the time over which errors are evaluated [s]; None: when all joints are at
            rest.
        experiment: Options for simulating rigid bodies; None if they are not simulated.
        accuracy: Largest distance of the tool from the drawing that is allowed [m]. By default,
            corner errors may reach their tolerances, and the contour error a tenth of the smallest
            tolerance.
        default_compensation: Whether the job file specifies no compensation. If so, certificates
            for servos use the inverse of the servo, even if the run has an experiment.
        speed_factor: Fraction of the planned speed, as of `Trajectory.stretched`; None means 1, but
            0.1 for `play`.

    Raises:
        InvalidInput: A cycle out of range, a time that is not above zero, or a rounding
            that is not for the timing method.
    """

    name: Name
    limits: Limits
    timing: PlanOptions = FASTEST
    compensation: CompensationOptions = INVERSE
    rounding: Rounding | None = None
    cycle: float = DEFAULT_CYCLE
    end_time: Interval | None = None
    experiment: Experiment | None = None
    accuracy: Distance | None = None
    default_compensation: bool = False
    speed_factor: SpeedFactor | None = None

    def _check_together(self) -> None:
        check_cycle(self.cycle)
        if self.rounding is not None:
            self.rounding.check(self.timing)

    def check_end_time(self, program: Program) -> None:
        """Check that an end of the evaluation is given for a single path only.

        Args:
            program: The program, as it is drawn or prepared.

        Raises:
            InvalidInput: The run has `end_time`, and the program has several paths.
        """
        if self.end_time is not None and program.single_path is None:
            raise InvalidInput(
                "end_time requires a job with a single path, because errors of a program are "
                "evaluated while the process is on. Remove end_time."
            )

    @property
    def for_bodies(self) -> bool:
        """True if compensation uses the dynamics of the arm, which the servo model lacks."""
        return self.compensation.for_bodies

    @property
    def feeds_gravity_forward(self) -> bool:
        """True if the controller adds the gravity torque."""
        return self.compensation.feeds_gravity_forward

    @property
    def is_shaped(self) -> bool:
        """True if corners have shape free, which is optimized together with the timing."""
        return self.rounding is not None and self.rounding.free

    @property
    def shaping(self) -> Shaped | None:
        """How free corners are shaped, with the reserve and the grid of the timing.

        None for other corners.
        """
        rounding = self.rounding
        if rounding is None or not rounding.free:
            return None
        from armcontour.planning import Shaped

        # `Rounding.check` refuses other timings, and free corners without a tolerance.
        assert isinstance(self.timing, Optimal) and rounding.tolerance is not None
        return Shaped(
            tolerance=rounding.tolerance,
            angular_tolerance=rounding.angular_tolerance,
            iterations=rounding.iterations,
            reserve=self.timing.reserve,
            intervals=self.timing.intervals,
        )

    @property
    def continuity(self) -> Continuity | None:
        """Continuity of rounded corners; None if corners are not rounded with arcs."""
        if self.rounding is None or self.rounding.free:
            return None
        return self.rounding.continuity or (CURVATURE if self.limits.limits_jerk else TANGENT)

    @property
    def transition_tolerance(self) -> float:
        """Maximum distance of transitions from the objective [m]; 0 without transitions."""
        if self.continuity != CURVATURE or self.rounding is None:
            return 0.0
        maximum = self.rounding.tolerance
        return min(TRANSITION_TOLERANCE, math.inf if maximum is None else maximum)

    @property
    def duration(self) -> float | None:
        """Specified duration of the motion [s]; None if the motion is as fast as possible."""
        return self.timing.duration if isinstance(self.timing, Optimal) else None


@declared(eq=False)
class Job(Checked):
    """A path, an arm, a servo, and the runs that are compared.

    Its `program` is the path as a program; runs add leads, overlaps and events of the process.

    >>> job = ac.read_job("job.yaml")
    >>> job.arm.name, [run.name for run in job.runs]
    ('PMK-3s', ['only'])

    Args:
        name: Short name.
        title: Title for reports; the name by default.
        arm: The arm.
        path: The objective path, or a program of several contours.
        process: Leads, overlaps and events that are added to the contours.
        configuration: For a planar arm, the branch of its inverse kinematics; by default the
            fastest.
        seed: For an arm in space: joint positions near the start configuration [rad], (dof,); None
            takes the configuration that is fastest along the path.
        start_from: Taught joint positions [rad], (dof,), from which the motion begins with a rapid
            in joint space. The first contour has their configuration. None begins the motion at the
            first contour.
        servo: The servo's nominal model, which compensation uses. A job that exports only programs
            such as kuka and abb needs none.
        plant_servo: The simulated servo; by default the nominal one.
        runs: At least one run, with different names.
        certificate: Requirements of a certified plan.
        scene: Obstacles in the cell; None if they are unknown.
        export: Files for robot controllers that the command `run` writes; they name neither outputs
            nor inputs if the process is off.
        part: Part frame, with which the path is already transformed.
        sources: Files from which the job was read, for reports.
        played_on: Controller that plays the job, whose limits its set-points keep, too.

    Raises:
        InvalidInput: No run, no servo although set-points are sent, two runs of the same name, a
            name that is too long or not printable, a seed or start for another number of joints, a
            start outside of the joint ranges or together with a seed, a configuration or an end
            time, gains too large for a cycle, a speed so low that the motion is endless, an analog
            output that needs a speed, or a process that the program cannot have.
    """

    name: Name
    title: Annotated[str, Named(LONGEST_TITLE)] = ""
    arm: Arm
    path: Path | Program
    servo: ServoModel = None  # type: ignore[assignment]
    plant_servo: ServoModel = None  # type: ignore[assignment]
    runs: tuple[Run, ...]
    configuration: str | None = None
    seed: FloatArray | None = None
    start_from: FloatArray | None = None
    process: Process = field(default_factory=Process)
    certificate: CertificateGoal | None = None
    scene: Scene | None = None
    export: Exports = field(default_factory=Exports)
    part: Frame = field(default_factory=Frame)
    sources: tuple[SourceFile, ...] = ()
    played_on: ControllerFacts | None = None
    program: Program = field(init=False)

    @property
    def targets(self) -> tuple[ControllerFacts, ...]:
        """Known controllers that get the set-points: of the export formats, and that plays them.

        A controller that plans the motion itself gets no set-points.
        """
        known = [*(facts_of_format(x) for x in self.export.formats), self.played_on]
        return tuple(x for x in known if x is not None)

    @property
    def only_programs(self) -> bool:
        """True if controllers get only programs between whose points they plan the motion."""
        return self.played_on is None and self.export.only_programs

    def as_sent(self, run: Run) -> Run:
        """Return a run without compensation and experiment if controllers get only programs.

        Args:
            run: The run.
        """
        if not self.only_programs:
            return run
        return replace(run, compensation=NoCompensation(), experiment=None)

    def rule(self, run: Run, limits: Limits) -> SetPointRule:
        """Return the limits of a run's set-points: of the plan, the user and all controllers.

        Args:
            run: The run.
            limits: The limits of the plan.
        """
        return make_rule(limits, self.arm.dof, run.compensation.command_limits, self.targets)

    def __post_init__(self) -> None:
        """Complete the title and the plant's servo, then check the fields."""
        if isinstance(self.title, str) and not self.title:
            object.__setattr__(self, "title", self.name)
        object.__setattr__(self, "servo", required_servo(self.servo, self.export))
        if self.plant_servo is None:
            object.__setattr__(self, "plant_servo", self.servo)
        Checked.__post_init__(self)

    def _check_together(self) -> None:
        """Check that runs, process and servos fit the program, and store the program."""
        program = Program.from_path(self.path)
        object.__setattr__(self, "program", program)
        for run in self.runs:
            with error_context(f"Run {run.name}"):
                if not self.only_programs:
                    self.servo.check_gains(run.cycle)
                    self.plant_servo.check_gains(run.cycle)
                check_duration(program, run.limits)
                run.check_end_time(program)
                check_analog(program, self.process, run.limits)
        with error_context("process"):
            check_process(program, self.process)
        if self.process.off:
            object.__setattr__(self, "export", replace(self.export, outputs={}, inputs={}))
        names = [x.name for x in self.runs]
        if not names or len(set(names)) < len(names):
            raise InvalidInput("A job must have at least one run, and runs must differ in name.")
        if self.seed is not None:
            seed = checks.per_joint("seed", self.seed, self.arm.dof, "rad")
            object.__setattr__(self, "seed", checks.frozen_array(seed))
        if self.start_from is not None:
            with error_context("", "start_from", "joints"):
                start = checks.per_joint("start_from", self.start_from, self.arm.dof, "rad")
            object.__setattr__(self, "start_from", checks.frozen_array(start))
            for run in self.runs:
                self._check_start(run, start)

    def _check_start(self, run: Run, start: FloatArray) -> None:
        """Check that a run can begin at taught joint positions [rad], (dof,)."""
        if self.seed is not None or self.configuration is not None:
            raise InvalidInput(
                "start_from determines the configuration at the start, so the job must not have "
                "seed or configuration, too. Remove seed.",
                key=("seed",),
                remedies=({("seed",): None},),
            )
        if run.end_time is not None:
            raise InvalidInput(
                f"Run {run.name}: end_time requires a motion that begins at the path, but the job "
                "has start_from. Remove end_time.",
                key=("start_from",),
            )
        lower, upper = run.limits.joint_range(len(start))
        excess = np.maximum(lower - start, start - upper)
        j = int(excess.argmax())
        if excess[j] > 0:
            unit = unit_of(self.arm, "rad", j)
            raise InvalidInput(
                f"Run {run.name}: in start_from, joint {j + 1} ({self.arm.joint_names[j]}) is at "
                f"{number(start[j], unit)}, outside of its range from {number(lower[j], unit)} to "
                f"{number(upper[j], unit)}. Check the order and the units of the joints.",
                key=("start_from", "joints"),
                joint=j,
                needed=float(start[j]),
                allowed=float(lower[j] if start[j] < lower[j] else upper[j]),
            )

    @property
    def has_start(self) -> bool:
        """True if the configuration at the start is given."""
        taught = self.start_from is not None
        return taught or self.seed is not None or self.configuration is not None

    @property
    def at_path(self) -> Job:
        """The job whose motion begins at the first contour, in the configuration of this one."""
        if self.start_from is None:
            return self
        return replace(self, start_from=None, **configuration_of(self.arm, self.start_from))

    def __str__(self) -> str:
        """Write a table with arm, path, runs and further parts of the job."""
        program = self.program
        summary = f"{count_noun(len(program.contours), 'contour')}, {digits(program.length)} m"
        return format_table(
            f"Job {self.name}: {self.title}" if self.title != self.name else f"Job {self.name}",
            [
                ("arm", str(self.arm)),
                ("path", f"{summary}, {program.source}" if program.source else summary),
                *((f"run {x.name}", self._words(x)) for x in self.runs),
                ("obstacles", "" if self.scene is None else f"{len(self.scene.obstacles)}"),
                ("certificate", "" if self.certificate is None else "requested"),
            ],
        )

    __repr__ = short_repr

    @staticmethod
    def _words(run: Run) -> str:
        """Write timing, compensation, cycle and speed of a run."""
        speed = run.limits.speed
        fast = "" if speed is None else f", {digits(speed * 1e3)} mm/s"
        methods = f"{run.timing.method}, {run.compensation.method}"
        return f"{methods}, cycle {number(run.cycle, 's')}{fast}"

    @property
    def cell(self) -> Cell:
        """Arm and obstacles, with which the clearance is checked.

        Raises:
            InvalidInput: `check_clearance` would refuse the arm or the scene.
        """
        return cell_of(self.arm, self.scene)


def find_run(job: Job, name: str) -> Run:
    """Find the run of a job by its name.

    Raises:
        InvalidInput: The job has no run with this name.
    """
    for run in job.runs:
        if run.name == name:
            return run
    names = ", ".join(x.name for x in job.runs)
    raise InvalidInput(f"The job {job.name} has no run {name!r}. Its runs are {names}.")


def choose_run(job: Job, name: str | None, done: str, among: Sequence[Run] = ()) -> Run:
    """Find the run with this name, or the only run.

    `done`: participle for the message, such as "certified"; `among`: the runs from which the only
    one is taken, by default all.

    Raises:
        InvalidInput: The name is unknown, or several runs are possible.
    """
    if name is not None:
        return find_run(job, name)
    able = among or job.runs
    if len(able) > 1:
        names = ", ".join(x.name for x in able)
        raise InvalidInput(
            f"The job {job.name} has several runs, but only one can be {done}. Choose it with "
            f"--run ({names})."
        )
    return able[0]
