"""Plant of rigid bodies, simulated by MuJoCo, with drives that do not depend on the job."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, ExecutionError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import AtLeast, Quantity
from armcontour.motion import Execution, FineMotion, SetPoints
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.chain import Chain
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import add_feedforward, command_pieces, sample_command
from armcontour.simulation import drive_loop, mujoco_model
from armcontour.simulation.drive_loop import Bodies, Loops, Rows
from armcontour.simulation.mujoco_model import count_parts
from armcontour.simulation.plant import (
    LONGEST_SETTLING,
    RUNAWAY_SPEED,
    LimitedPlant,
    check_joints,
    check_weight,
    count_intervals,
    longest_settling,
)

# Default cycle time of a drive [s]. A rate of 4 kHz is usual, and every usual set-point cycle is a
# multiple of this cycle. It delays the velocity loop by 2 % of the time constant 1 / K_v in the
# paper's servo.
DEFAULT_STEP = 2.5e-4
# Shortest and longest cycle time of a drive [s]. Shorter cycles would make the simulation slow,
# because each cycle is a step that takes some microseconds to compute. No drive of an arm has a
# cycle longer than 0.1 s.
STEP_RANGE = (1e-6, 0.1)
# Largest noise of a position measurement [rad]; real encoders have less.
LARGEST_NOISE = 0.1
DriveCycle = Annotated[float, Quantity("s", "4 ms", within=STEP_RANGE)]
PositionNoise = Annotated[float, Quantity("rad", "2 deg", within=(0.0, LARGEST_NOISE))]
# After the last set-point, a joint is at rest if it stays within a range for this time [s] and for
# the slowest time constant of a position loop. The test does not use the rest position, because it
# depends on friction and gravity.
RIGID_REST_TIME = 0.25
# This range [rad] (1 µm at 1 m).
RIGID_REST_RANGE = 1e-6
# Noise of the measured position widens this range by so many standard deviations.
RIGID_REST_DEVIATIONS = 4.0
# The iteration to the equilibrium under gravity ends when positions change by at most this [rad],
# and fails after the largest number of iterations.
EQUILIBRIUM_TOLERANCE = 1e-13
MAX_EQUILIBRIUM_ITERATIONS = 200
# The default torque limits allow the acceleration limits in this number of random poses.
RATED_POSES = 200
# Duration of one block of the simulation [s].
BLOCK_DURATION = 1.0
# Largest number of integration steps in one compiled call; a call takes up to 0.1 s.
MAX_CALL_STEPS = 1000
# Fields of a record with one row per step.
RECORD_FIELDS = ("q", "dq", "ddq", "demand", "torque", "torque_demand")


class RigidBodyPlant(LimitedPlant):
    """Plant of the arm's rigid bodies with sampled position and velocity loops of all joints.

    At the start of every step (drive cycle), each drive sets its torque to
    `J K_v (K_p (u - q) - dq)` and holds it for the step. An integrator in the velocity loop adds
    `J K_v k_i z`, where z is the velocity error `K_p (u - q) - dq` integrated over time, with
    anti-windup as in `ServoModel`. The controller can add the gravity torque. u is the command,
    delayed by the servo's dead time. J is the servo's inertia. If the servo specifies none, J is
    the inertia that the joint moves with its drive, without payload, with all joints in the middle
    of their ranges (at 0 without a range). Therefore J does not depend on the job.

    >>> heavy = arm.with_dynamics(payload=ac.Payload(mass=0.5), armature=0.1)
    >>> plant = ac.RigidBodyPlant(heavy, servo, noise=1e-5, seed=1)
    >>> ac.simulate(set_points, plant).q.shape[1]
    2

    Args:
        arm: The arm, with masses.
        servo: The gains of the drives, a servo of order "second".
        limits: Limits with the joint torques at which drives saturate. By default, the limits of
            the plan count; if the plan has none, those of the arm. Without torque limits, the
            drives are strong enough for all joints' acceleration limits together in the worst pose.
        step: Cycle time of the drives [s], by default 0.25 ms; it is shortened to an integer
            fraction of the set-points' cycle.
        gravity_feedforward: Whether the controller adds the gravity torque (default), including
            that of the payload in its model.
        noise: Standard deviation of measured joint positions [rad], independent in every step; by
            default 0. Measured velocities are exact, because the filters in drives are unknown.
        seed: Seed of the noise, by default 0; with one seed, the noise is the same in every run.
        controller: The controller's model of the arm, for example without a payload that the
            controller does not know; by default the arm itself. It determines J, the gravity
            torque, and torque limits that follow from acceleration limits.

    A plant is immutable.

    Attributes:
        limits: The explicit limits, or None.
        reference: Joint positions at which J is computed [rad], (dof,).
        nominal_inertia: J [kg m²], (dof,).
        torque_limit: Torque limits [N m], (dof,); infinite without limits.

    Raises:
        InvalidInput: The arm or `controller` has no masses, gains or limits do not fit the arm, the
            servo is not of order "second" or has friction, a drive cycle or an acceleration limit,
            the step is not from 1 µs to 0.1 s, the noise is too large, or mujoco is not installed.
    """

    torque_limit: FloatArray
    _gravity_added: bool

    @checked
    def __init__(
        self,
        arm: Arm,
        servo: ServoModel,
        limits: Limits | None = None,
        *,
        step: DriveCycle = DEFAULT_STEP,
        gravity_feedforward: bool = True,
        noise: PositionNoise = 0.0,
        seed: Annotated[int, AtLeast(0)] = 0,
        controller: Arm | None = None,
    ) -> None:
        self.arm = arm
        self.chain = _require_chain(arm)
        self.controller_chain = self.chain if controller is None else _require_chain(controller)
        if len(self.controller_chain) != arm.dof:
            raise ArmMismatch(
                f"arm and controller must have the same joints, but the arm {arm.name} has "
                f"{arm.dof} joints and the controller has {len(self.controller_chain)}."
            )
        self.servo = servo.for_joints(arm.dof)
        self.servo.check_orders("A rigid-body plant", integrator=True)
        if self.servo.acceleration_limit is not None:
            smallest = float(self.servo.acceleration_limit.min())
            raise InvalidInput(
                "A rigid-body plant saturates at torque limits, but the servo has an "
                f"acceleration_limit of {smallest} rad/s². Remove acceleration_limit, and specify "
                "limits of the plant with joint_torque."
            )
        assert self.servo.kv is not None
        self.kv = self.servo.kv
        self.step = step
        self.gravity_feedforward = gravity_feedforward
        self.noise = noise
        self.seed = seed
        self.reference = arm.limits.middle(arm.dof)
        if self.servo.inertia is None:
            model = mujoco_model.build_model(
                self.controller_chain.replace(payload=None), DEFAULT_STEP, friction=False
            )
            matrix = mujoco_model.mass_matrix(model, self.reference)
            self.nominal_inertia = np.asarray(np.diagonal(matrix))
        else:
            self.nominal_inertia = self.servo.inertia
        self.limits = limits
        self._set_saturation(None)
        self._freeze()

    def _set_saturation(self, planned: Limits | None) -> None:
        """Set the torque limits, and which torques they restrict."""
        resolved = resolve_limits("A RigidBodyPlant", self.arm, self.limits, planned)
        torques = _torque_limits(resolved, self.arm.limits, self.controller_chain)
        # A torque limit restricts the sum of the torques for motion and gravity. A limit that
        # follows from acceleration limits restricts only the torque for motion (_gravity_added).
        self.torque_limit = checks.frozen_array(torques)
        self._gravity_added = resolved.joint_torque is None

    def run(self, set_points: SetPoints, resolution: float) -> Execution:
        """Execute set-points from the equilibrium at the first set-point.

        The equilibrium of a joint is the set-point if it has an integrator, gravity feed-forward of
        the whole weight, or no weight. Otherwise the joint sags, without friction.

        Raises:
            InvalidInput: The set-points have another number of joints, or the resolution is finer
                than the step.
            ExecutionError: The drives are unstable, too weak to hold the arm, or do not settle.
        """
        check_joints(set_points, self.arm)
        return self.for_plan(set_points)._execute(set_points, resolution)

    def _execute(self, set_points: SetPoints, resolution: float) -> Execution:
        """Execute set-points with the limits that `for_plan` has chosen."""
        steps = int(np.ceil(set_points.cycle / self.step * (1 - 1e-12)))
        span = set_points.cycle / steps
        stride = _steps_per_result(steps, span, resolution)
        robot = _Robot(self, span, set_points)
        loop = self.nominal_inertia * self.kv
        viscous = np.asarray(self.chain.viscous)
        robot.refine(count_parts(robot.model, set_points, span, loop, viscous))
        rows = max(1, round(BLOCK_DURATION / set_points.cycle))
        logs = []
        servo = self.servo
        cycle = set_points.cycle
        pieces = add_feedforward(command_pieces(set_points.q, cycle, servo.interpolation), servo)
        count = count_intervals(set_points, servo)
        for k in range(0, count, rows):
            t = (k + np.arange(min(rows, count - k) * steps) / steps) * cycle
            commands = sample_command(pieces, cycle, servo.dead_time, t)
            # Acceleration feed-forward bypasses the integrators.
            integrated = commands - sample_command(pieces[:, :, 4:], cycle, servo.dead_time, t)
            logs.append(robot.advance(commands, integrated).thinned(stride))
        logs += self._come_to_rest(robot, set_points, steps, stride)
        return self._execution(set_points, logs, span * stride)

    def _come_to_rest(
        self, robot: _Robot, set_points: SetPoints, steps: int, stride: int
    ) -> list[_DriveRecord]:
        """Simulate after the last set-point until all joints rest; return the records.

        - `steps`: steps of the drives per cycle.
        - `stride`: steps of the drives per result.
        """
        window = rest_window(self.servo)
        commands = np.tile(set_points.q[-1], (int(np.ceil(window / set_points.cycle)) * steps, 1))
        last_time = robot.time
        longest = longest_settling(last_time - set_points.start_time)
        logs = []
        while robot.time - last_time <= longest:
            log = robot.advance(commands, commands)
            logs.append(log.thinned(stride))
            ranges = log.motion_ranges(robot.step)
            if (ranges <= RIGID_REST_RANGE + RIGID_REST_DEVIATIONS * self.noise).all():
                self._check_strength(log, set_points.q[-1], robot.time)
                return logs
        j = int(np.argmax(ranges))
        offset = abs(float(log.q[-1, j] - set_points.q[-1, j]))
        waited = robot.time - last_time
        unit = self.chain.unit("rad", j)
        missing = (
            " The inertia of its drive (armature) is missing."
            if np.asarray(self.chain.armature)[j] == 0
            else ""
        )
        raise ExecutionError(
            f"Joint {j + 1} is not at rest {waited:.3g} s after its last set-point. "
            f"It moves by {ranges[j]:.3g} {unit} in {window:.3g} s, {offset:.3g} {unit} from the "
            "set-point. With its servo gains, torque limit and friction, the joint does not "
            f"settle.{missing}",
            t=robot.time,
            joint=j,
        )

    def _check_strength(self, log: _DriveRecord, last: FloatArray, t: float) -> None:
        """Refuse a drive that is saturated all the time while the joints rest.

        - `last`: last set-point [rad], (dof,).
        - `t`: time for the error [s].
        """
        weak = (log.torque_demand != log.torque).all(axis=0)
        if not weak.any():
            return
        j = int(np.argmax(weak))
        needed, allowed = (float(abs(x[-1, j])) for x in (log.torque_demand, log.torque))
        offset = log.q[-1] - last
        unit, force = (self.chain.unit(x, j) for x in ("rad", "N m"))
        raise ExecutionError(
            f"Joint {j + 1} rests {abs(offset[j]):.3g} {unit} from its last set-point, because its "
            f"servo requires {needed:.4g} {force}, but the torque limit of its drive is "
            f"{allowed:.4g} {force}. Increase the torque limit or reduce the load.",
            t=t,
            joint=j,
            limit="joint_torque",
            needed=needed,
            allowed=allowed,
        )

    def _execution(self, set_points: SetPoints, logs: list[_DriveRecord], span: float) -> Execution:
        """Join consecutive records to an execution; `span` is the time between results [s]."""
        columns = {name: np.concatenate([getattr(x, name) for x in logs]) for name in RECORD_FIELDS}
        return Execution(
            arm=self.arm,
            set_points=set_points,
            t=set_points.times(len(columns["q"]), span),
            demand_range=np.stack(
                [
                    np.min([x.demand_range[0] for x in logs], axis=0),
                    np.max([x.demand_range[1] for x in logs], axis=0),
                ]
            ),
            saturated_time=np.sum([x.saturated for x in logs], axis=0),
            plant=self,
            **columns,
        )

    def motion_between(self, executed: Execution, indices: IntArray) -> FineMotion:
        """Interpolate joint positions between successive results by cubics.

        Args:
            executed: The execution, with all results.
            indices: Indices of the results at the starts of the intervals, increasing, (m,).
        """
        return FineMotion.through(executed.t, executed.q, executed.dq, None, indices)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _DriveRecord:
    """What the drives did in n successive steps."""

    q: FloatArray  # Positions at the starts of the steps [rad], (n, dof)
    dq: FloatArray  # Velocities at the starts of the steps [rad/s], (n, dof)
    ddq: FloatArray  # Mean accelerations over the steps [rad/s²], of the same shape
    demand: FloatArray  # Demanded accelerations [rad/s²], (n, dof)
    torque_demand: FloatArray  # Torques before saturation [N m], (n, dof)
    torque: FloatArray  # Torques after saturation [N m], (n, dof)
    demand_range: FloatArray  # Lowest and highest demand [rad/s²], (2, dof)
    saturated: FloatArray  # Time in saturation [s], (dof,)

    @classmethod
    def from_steps(
        cls,
        q: FloatArray,
        dq: FloatArray,
        demand: FloatArray,
        torque_demand: FloatArray,
        torque: FloatArray,
        step: float,
    ) -> _DriveRecord:
        """Make a record from states at the starts and the end, (n + 1, ...), and loop outputs."""
        return cls(
            q=q[:-1],
            dq=dq[:-1],
            ddq=np.diff(dq, axis=0) / step,
            demand=demand,
            torque_demand=torque_demand,
            torque=torque,
            demand_range=np.stack([demand.min(axis=0), demand.max(axis=0)]),
            saturated=(torque_demand != torque).sum(axis=0) * step,
        )

    def motion_ranges(self, step: float) -> FloatArray:
        """Return each joint's range of motion, also within steps [rad], (dof,)."""
        return np.asarray(np.ptp(self.q, axis=0) + np.abs(self.dq).max(axis=0) * step)

    def thinned(self, stride: int) -> _DriveRecord:
        """Keep every `stride`-th step, so that the memory of the other steps can be freed."""
        return _DriveRecord(
            demand_range=self.demand_range,
            saturated=self.saturated,
            **{name: getattr(self, name)[::stride].copy() for name in RECORD_FIELDS},
        )


class _Robot:
    """A plant's state during one simulation: rigid bodies and drives."""

    def __init__(self, plant: RigidBodyPlant, step: float, set_points: SetPoints) -> None:
        self.plant = plant
        self.step = step
        self.start = set_points.start_time
        self.steps = 0
        self.mujoco = mujoco_model.import_mujoco()
        self.model = mujoco_model.build_model(plant.chain, step, friction=True)
        self.data = self.mujoco.MjData(self.model)
        self.parts = 1
        # The controller computes gravity torques with its own model, in a state at rest.
        self.controller_model = (
            self.model
            if plant.controller_chain is plant.chain
            else mujoco_model.build_model(plant.controller_chain, step, friction=False)
        )
        self.controller_data = self.mujoco.MjData(self.controller_model)
        self.rng = np.random.default_rng(plant.seed)
        # Drives are simulated in the order of the model's joints.
        self.order = mujoco_model.order_of(self.model)
        start, torque = self._equilibrium(np.array(set_points.q[0]))
        self.data.qpos[:] = start[self.order]
        self.functions = mujoco_model.function_addresses()
        self.bodies = Bodies.from_model(self.model, self.data)
        self.controller = Bodies.from_model(self.controller_model, self.controller_data)
        ki = np.array(plant.servo.ki)
        integral = torque / (plant.nominal_inertia * plant.kv * np.where(ki > 0, ki, np.inf))
        self.loops = Loops(
            kp=np.array(plant.servo.kp)[self.order],
            kv=np.array(plant.kv)[self.order],
            ki=ki[self.order],
            integral=integral[self.order],
            step=step,
            inertia=np.array(plant.nominal_inertia)[self.order],
            limit=np.array(plant.torque_limit)[self.order],
            gravity_feedforward=plant.gravity_feedforward,
            gravity_added=plant._gravity_added,
        )

    @property
    def time(self) -> float:
        """Current simulated time on the clock of the plan [s]."""
        return self.start + self.steps * self.step

    def refine(self, parts: int) -> None:
        """Divide every step of the drives into this number of integration steps."""
        self.parts = parts
        mujoco_model.set_step(self.model, self.step / parts)
        # An error in a compiled call of MuJoCo would end the process, because it cannot raise an
        # exception. So one step is simulated from Python first, where errors are exceptions.
        self.mujoco.mj_step(self.model, self.mujoco.MjData(self.model))

    def advance(self, commands: FloatArray, integrated: FloatArray) -> _DriveRecord:
        """Simulate one step per row of the commands [rad], (n, dof).

        `integrated` are the commands of the integrators, without acceleration feed-forward.
        """
        n, dof = commands.shape
        q, dq = (np.empty((n + 1, self.model.nv)) for _ in range(2))
        rows = Rows(q, dq, *(np.empty((n, dof)) for _ in range(3)))
        noise = np.empty((0, dof))
        if self.plant.noise:
            noise = self.rng.normal(0.0, self.plant.noise, (n, dof))
            noise = np.ascontiguousarray(noise[:, self.order])
        commands, integrated = (
            np.ascontiguousarray(x[:, self.order]) for x in (commands, integrated)
        )
        # The steps are divided into calls, because Python handles signals only between calls.
        at_once = max(1, MAX_CALL_STEPS // self.parts)
        for first in range(0, n, at_once):
            end = min(first + at_once, n)
            reached = drive_loop.advance(
                self.functions, self.bodies, self.controller, self.loops, self.parts,
                commands, integrated, noise, first, end, RUNAWAY_SPEED, rows,
            )  # fmt: skip
            if reached != end:
                self._raise_runaway(reached)
        self.steps += n
        in_chain = np.argsort(self.order)
        ordered = Rows(*(np.ascontiguousarray(x[:, in_chain]) for x in rows))
        return _DriveRecord.from_steps(*ordered, self.step)

    def _equilibrium(self, first: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Find rest positions [rad] and the loops' torques at rest [N m], (dof,) each.

        - `first`: first set-point [rad], (dof,).
        """
        # The integrator, or without it the position loop,
        # compensates the weight that is not fed forward.
        plant = self.plant
        q = first
        gain = plant.nominal_inertia * plant.kv * plant.servo.kp
        gain = np.where(plant.servo.ki > 0, np.inf, gain)
        for _ in range(MAX_EQUILIBRIUM_ITERATIONS):
            weight, fed_forward = self._weight(q)
            before = q
            q = first - (weight - fed_forward) / gain
            change = np.abs(q - before)
            if change.max() <= EQUILIBRIUM_TOLERANCE:
                break
        else:
            j = int(np.argmax(change))
            raise ExecutionError(
                f"Joint {j + 1} has no equilibrium near its first set-point, because its servo "
                "gains are too low for the weight that gravity feed-forward does not compensate. "
                "Increase them, or use gravity feed-forward.",
                t=self.start,
                joint=j,
            )
        location = "the first set-point"
        torque = weight - fed_forward
        if plant._gravity_added and plant.gravity_feedforward:
            weight = torque
            location = f"{location}, in addition to gravity feed-forward"
        check_weight(plant.arm, np.abs(weight), plant.torque_limit, location, self.start)
        return q, torque

    def _weight(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gravity torques at q, and those that the controller adds [N m], (dof,) each."""
        weight = mujoco_model.gravity_torques(self.model, self.data, q)
        if not self.plant.gravity_feedforward:
            return weight, np.zeros(len(q))
        controller = self.controller_model, self.controller_data
        return weight, mujoco_model.gravity_torques(*controller, q)

    def _raise_runaway(self, k: int) -> None:
        """Raise the error for a joint that is faster than `RUNAWAY_SPEED` in step k of a call."""
        velocity = np.abs(self.data.qvel)
        k_model = int(np.argmax(np.where(np.isfinite(velocity), velocity, np.inf)))
        speed = velocity[k_model]
        j = int(self.order[k_model])
        unit = self.plant.chain.unit("rad/s", j)
        t = self.start + (self.steps + k + 1) * self.step
        raise ExecutionError(
            f"Joint {j + 1} runs away at t = {t:.4g} s with {speed:.3g} {unit}, because its servo "
            f"is unstable with a step of {self.step:.3g} s. Reduce its gains or shorten the step.",
            t=t,
            joint=j,
        )


def can_simulate() -> bool:
    """Return whether MuJoCo, which simulates the rigid bodies, is installed."""
    return importlib.util.find_spec("mujoco") is not None


def rest_window(servo: ServoModel) -> float:
    """Return the time for which joints must stay within `RIGID_REST_RANGE` to be at rest [s]."""
    # With an integrator, the slowest time constant of a position loop is at most `1 / kp + 1 / ki`.
    slowest = 1 / servo.kp + np.where(servo.ki > 0, 1 / np.where(servo.ki > 0, servo.ki, 1.0), 0.0)
    return min(max(RIGID_REST_TIME, float(slowest.max())), LONGEST_SETTLING)


def _require_chain(arm: Arm) -> Chain:
    """Return the chain of an arm; refuse an arm whose masses are missing."""
    if not arm.has_bodies:
        raise InvalidInput(
            f"A rigid-body plant requires masses, but those of the arm {arm.name} are not known. "
            "Load the arm from a file whose links have masses, centres of mass and inertias."
        )
    return arm.chain


def _torque_limits(limits: Limits, arm_limits: Limits, chain: Chain) -> FloatArray:
    """Return the torque limits of the drives [N m], (dof,).

    Without torque limits, the drives are strong enough for the acceleration limits of all joints
    together, without payload, in RATED_POSES random poses: the limit is the largest |M(q)| ddq.
    """
    if limits.joint_torque is not None:
        return limits.joint_torque
    dof = len(chain)
    fastest = limits.acceleration_bounds(dof)[1]
    if np.isinf(fastest).any():
        return np.full(dof, np.inf)
    if not limits.same_both_ways():
        raise InvalidInput(
            "A rigid-body plant requires the same acceleration limits in both directions, but they "
            "differ. Specify one value of joint_acceleration per joint, or joint_torque."
        )
    lower, upper = (np.clip(x, -np.pi, np.pi) for x in arm_limits.joint_range(dof))
    # Positions in the joint ranges, as fractions of the ranges.
    fractions = np.random.default_rng(0).uniform(size=(RATED_POSES, dof))
    model = mujoco_model.build_model(chain.replace(payload=None), DEFAULT_STEP, friction=False)
    matrices = np.abs(mujoco_model.mass_matrices(model, lower + fractions * (upper - lower)))
    return np.asarray(np.max([x @ fastest for x in matrices], axis=0))


def _steps_per_result(steps: int, span: float, resolution: float) -> int:
    """Return the steps per result: the largest divisor of `steps` within the resolution.

    - `steps`: steps of the drives per cycle.
    - `span`: duration of a step [s].
    - `resolution`: largest time between two results [s].
    """
    if span > resolution * (1 + 1e-9):
        raise InvalidInput(
            f"The step of the rigid-body plant must be at most the resolution of {resolution:.4g} "
            f"s, but is {span:.4g} s. Specify a shorter step or a coarser resolution."
        )
    fitting = (m for m in range(steps, 0, -1) if steps % m == 0)
    return next(m for m in fitting if m * span <= resolution * (1 + 1e-9))
