"""The same arm as rigid bodies in MuJoCo, with drives that nobody tuned to the job."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.arms.chain import Chain
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.execution import _mujoco
from armcontour.execution.plant import (
    PATIENCE,
    RESULT,
    RUNAWAY,
    Plant,
    intervals,
    patience,
    refuse_other_joints,
    refuse_too_heavy,
    results,
)
from armcontour.motion import Execution, TaughtData
from armcontour.servo import ServoModel
from armcontour.servo.command import polynomials, sample_command

# Cycle of a drive's velocity loop: 4 kHz is usual, goes into every usual command interval, and
# delays the loop by 2 % of the time constant 1 / K_v of the paper's servo.
STEP = 2.5e-4
# Cycles that drives have [s]: each is a step of the simulation, which takes some microseconds; in a
# longer one than the other end no arm is controlled.
STEPS = (1e-6, 0.1)
# No encoder is worse than this [rad].
LARGEST_NOISE = 0.1
# What a result of one joint takes, torques too, beside RESULT of all of them; and what a step takes
# while its block of commands is run [bytes], measured.
OF_JOINT = 200.0
AT_A_STEP = 120.0
# After the last set-point, the joints are at rest when for this time [s], and for the slowest
# position loop's time constant, each one stays within this range [rad], within steps too: a micron
# at 1 m. Where they stop is up to friction and gravity; so it is no part of the test.
REST_TIME = 0.25
REST_RANGE = 1e-6
# Noise on the measured position moves a joint by less than this many of its standard deviations.
REST_NOISE = 4.0
# Where the arm rests under its weight is found to this [rad], in that many iterations.
EQUILIBRIUM = 1e-13
ITERATIONS = 200
# At so many set-points it is seen beforehand whether the drives are stable.
LOOKS = 50
# Poses all over the joints' ranges in which acceleration limits are to be had.
RATED_POSES = 200
# Command intervals that are computed at a time span this time [s].
BLOCK = 1.0


class RigidBodyPlant(Plant):
    """The arm's bodies under a sampled position and velocity loop on every joint.

    Every `step` each drive sets its torque to `J K_v (K_p (u - q) - dq)`, to which the controller
    may add the torque that holds the arm against gravity, and keeps it for that step. J is the
    joint's nominal inertia: what it sees, drive included, with all joints in the middle of the
    arm's own ranges (at 0 where there is none) and without payload. That is known when an arm is
    built, and no job enters it. u is what the command was the servo's dead time before the step.

    Args:
        arm: The arm; its chain must have masses.
        servo: The gains that the drives were given, of order second.
        limits: Whose joint torques saturate; the arm's own by default. Without any, the drives are
            just strong enough for its joint accelerations, all at once in the worst pose.
        step: Cycle of the drives [s], shortened so that a whole number fits a command interval.
        gravity_feedforward: Whether the controller adds the torque against gravity; it knows the
            payload.
        friction: Whether the chain's friction acts; else neither viscous nor Coulomb friction does.
        noise: Standard deviation of measured joint positions [rad], independent in every step.
            Measured velocities are the true ones: what a drive makes of noise is not known.
        seed: Of the noise, the same in every run.

    Attributes:
        reference: Where J is taken [rad], (dof,).
        nominal_inertia: J [kg m²], (dof,).
        torque_limit: [N m], (dof,); infinite without one.

    Raises:
        InvalidInput: An arm without masses, gains or limits that do not fit it, a servo of order
            first, a step outside STEPS, too much noise, or mujoco is not installed.
    """

    def __init__(
        self,
        arm: Arm,
        servo: ServoModel,
        limits: Limits | None = None,
        *,
        step: float = STEP,
        gravity_feedforward: bool = True,
        friction: bool = True,
        noise: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.arm = arm
        self.chain = _bodies(arm)
        self.servo = servo.for_joints(arm.dof)
        if self.servo.kv is None:
            raise InvalidInput(
                "The drives of the rigid-body plant have a velocity loop: give it a servo of order "
                "second, with the gain kv."
            )
        self.kv = self.servo.kv
        self.step = check_step(step)
        self.gravity_feedforward = gravity_feedforward
        self.friction = friction
        self.noise = check_noise(noise)
        self.seed = _checks.whole("seed", seed, 0, 2**63 - 1)
        self.reference = _checks.lock_floats(_middle(arm.limits, arm.dof))
        self.nominal_inertia = _checks.lock_floats(_nominal(self.chain, self.reference))
        own = (arm.limits if limits is None else limits).for_joints(arm.dof)
        self.torque_limit = _checks.lock_floats(_torques(own, arm.limits, self.chain))
        # An acceleration limit is what a joint has left for moving; a torque limit holds for all.
        self._on_top = own.joint_torque is None

    def memory(self, span: float, period: float, resolution: float) -> float:
        """What an execution takes, about [bytes]: its results, and a block of steps."""
        return bytes_of(self.servo, self.step, span, period, resolution)

    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data, from the equilibrium at its first set-point.

        With gravity feed-forward, or without gravity, that is the set-point itself; else where the
        arm has sagged to (friction left out).

        Raises:
            InvalidInput: Taught data for another number of joints, or a resolution below the step.
            ExecutionError: The drives are unstable, too weak to hold the arm, or do not settle.
        """
        refuse_other_joints(taught, self.arm)
        steps = int(np.ceil(taught.period / self.step * (1 - 1e-12)))
        span = taught.period / steps
        every = _every(steps, span, resolution)
        robot = _Robot(self, span, taught)
        self._refuse_unstable(robot, taught)
        rows = max(1, round(BLOCK / taught.period))
        logs = []
        command = self._command(taught, steps)
        count = intervals(taught, self.servo)
        for k in range(0, count, rows):
            commands = command(k, min(rows, count - k))
            logs.append(robot.advance(commands).thinned(every))
        logs += self._come_to_rest(robot, taught, steps, every)
        return self._execution(taught, logs, span * every)

    def _command(self, taught: TaughtData, steps: int) -> Callable[[int, int], FloatArray]:
        """What the drives are given in every step of so many intervals from one on."""
        q, period, servo = taught.q, taught.period, self.servo
        if servo.interpolation != "cubic" and not servo.dead_time.any():
            return lambda k, count: _straight(q[k : k + count + 1], steps, servo.interpolation)
        pieces = polynomials(q, period, servo.interpolation)
        return lambda k, count: sample_command(
            pieces,
            period,
            servo.dead_time,
            (k + np.arange(count * steps) / steps) * period,
        )

    def _come_to_rest(
        self, robot: _Robot, taught: TaughtData, steps: int, every: int
    ) -> list[_Log]:
        window = rest_window(self.servo)
        commands = np.tile(taught.q[-1], (int(np.ceil(window / taught.period)) * steps, 1))
        begin = robot.now
        longest = patience(begin - taught.start_time)
        logs = []
        while robot.now - begin <= longest:
            log = robot.advance(commands)
            logs.append(log.thinned(every))
            moved = np.ptp(log.q, axis=0) + np.abs(log.dq).max(axis=0) * robot.step
            if (moved <= REST_RANGE + REST_NOISE * self.noise).all():
                self._refuse_weak(log, taught.q[-1], robot.now)
                return logs
        j = int(np.argmax(moved))
        off = abs(float(log.q[-1, j] - taught.q[-1, j]))
        missing = (
            "; the inertia of its drive, armature, is missing"
            if np.asarray(self.chain.armature)[j] == 0
            else ""
        )
        raise ExecutionError(
            f"Joint {j + 1} is not at rest {robot.now - begin:.3g} s after its last set-point: "
            f"{off:.3g} rad from it, it still moves by {moved[j]:.3g} rad in {window:.3g} s, so "
            f"its servo gains, torque limit and friction do not let it settle{missing}.",
            t=robot.now,
            joint=j + 1,
        )

    def _refuse_unstable(self, robot: _Robot, taught: TaughtData) -> None:
        """Refuse a step in which a joint's torque takes more than twice its velocity away.

        A mode of the joints keeps still under a torque held for h if K_v J / M times h is below 2,
        and K_p h is: exact for one K_p for all joints, no viscous friction, and small motions.
        Not sampled, the drives are stable at every pose.
        """
        rate = np.sqrt(self.nominal_inertia * self.kv)
        for k in np.unique(np.linspace(0, len(taught.q) - 1, LOOKS).astype(int)):
            mass = _mujoco.mass_matrix(robot.model, taught.q[k])
            values, vectors = np.linalg.eigh(rate[:, None] * np.linalg.inv(mass) * rate)
            fastest = max(float(values[-1]), float(self.servo.kp.max()))
            if fastest * robot.step < 2:
                continue
            j = int(np.argmax(np.abs(vectors[:, -1])))
            t = float(taught.start_time + k * taught.period)
            raise ExecutionError(
                f"Joint {j + 1} is unstable at t = {t:.4g} s: its drive keeps a torque for a step "
                f"of {robot.step:.3g} s, where it corrects the joint's velocity at a rate of "
                f"{fastest:.4g} 1/s; shorten the step to {1 / fastest:.2g} s, lower the servo's "
                "gains, or give the arm the inertias of its drives if they are missing.",
                t=t,
                joint=j + 1,
                limit="step",
                needed=robot.step,
                allowed=2 / fastest,
            )

    def _refuse_weak(self, log: _Log, last: FloatArray, now: float) -> None:
        weak = (log.wanted != log.torque).all(axis=0)
        if not weak.any():
            return
        j = int(np.argmax(weak))
        needed, allowed = (float(abs(x[-1, j])) for x in (log.wanted, log.torque))
        raise ExecutionError(
            f"Joint {j + 1} rests {abs(log.q[-1, j] - last[j]):.3g} rad from its last set-point, "
            f"since its drive gives {allowed:.4g} N m where its servo asks for {needed:.4g} N m: "
            "raise its torque limit or lighten its load.",
            t=now,
            joint=j + 1,
            limit="joint_torque",
            needed=needed,
            allowed=allowed,
        )

    def _execution(self, taught: TaughtData, logs: list[_Log], span: float) -> Execution:
        q, dq, ddq, demand, wanted, torque = (
            np.concatenate([getattr(x, name) for x in logs])
            for name in ("q", "dq", "ddq", "demand", "wanted", "torque")
        )
        return Execution(
            arm=self.arm,
            taught=taught,
            t=taught.times(len(q), span),
            q=q,
            dq=dq,
            ddq=ddq,
            demand=demand,
            torque=torque,
            torque_demand=wanted,
            demand_range=np.stack(
                [
                    np.min([x.demand_range[0] for x in logs], axis=0),
                    np.max([x.demand_range[1] for x in logs], axis=0),
                ]
            ),
            saturated_time=np.sum([x.saturated for x in logs], axis=0),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Log:
    """What happened in steps: states at their beginnings, and what held during them."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    demand: FloatArray
    wanted: FloatArray
    torque: FloatArray
    demand_range: FloatArray
    saturated: FloatArray

    @classmethod
    def of(
        cls,
        q: FloatArray,
        dq: FloatArray,
        demand: FloatArray,
        wanted: FloatArray,
        torque: FloatArray,
        step: float,
    ) -> _Log:
        """From states at the beginnings of steps and at the end, (n + 1, dof), and what held."""
        return cls(
            q=q[:-1],
            dq=dq[:-1],
            ddq=np.diff(dq, axis=0) / step,
            demand=demand,
            wanted=wanted,
            torque=torque,
            demand_range=np.stack([demand.min(axis=0), demand.max(axis=0)]),
            saturated=(wanted != torque).sum(axis=0) * step,
        )

    def thinned(self, every: int) -> _Log:
        """Every so many steps of it; copies, so that the rest is let go."""
        return _Log(
            demand_range=self.demand_range,
            saturated=self.saturated,
            **{
                name: getattr(self, name)[::every].copy()
                for name in ("q", "dq", "ddq", "demand", "wanted", "torque")
            },
        )


class _Robot:
    """One run of a plant: the state of its bodies, and the drives that move them."""

    def __init__(self, plant: RigidBodyPlant, step: float, taught: TaughtData) -> None:
        self.plant = plant
        self.step = step
        self.start = taught.start_time
        self.steps = 0
        self.mujoco = _mujoco.load()
        self.model = _mujoco.build(plant.chain, step, friction=plant.friction)
        self.data = self.mujoco.MjData(self.model)
        # Another state, never moving: what gravity takes is asked of it.
        self.still = self.mujoco.MjData(self.model)
        self.rng = np.random.default_rng(plant.seed)
        self.data.qpos[:] = self._equilibrium(np.array(taught.q[0]))

    @property
    def now(self) -> float:
        """Time [s]; 0 is when the plan begins."""
        return self.start + self.steps * self.step

    def advance(self, commands: FloatArray) -> _Log:
        """Run through commands, one per step."""
        plant, n, dof = self.plant, *commands.shape
        q, dq = np.empty((n + 1, dof)), np.empty((n + 1, dof))
        demand, wanted, torque = (np.empty((n, dof)) for _ in range(3))
        noise = self.rng.normal(0.0, plant.noise, (n, dof)) if plant.noise else None
        kp, kv, inertia = plant.servo.kp, plant.kv, plant.nominal_inertia
        top, bottom = plant.torque_limit, -plant.torque_limit
        limited = np.isfinite(top).all()
        gravity, holds, on_top = np.zeros(dof), plant.gravity_feedforward, plant._on_top
        # This loop is most of a run's time: names are local, nothing is allocated but views.
        model, data, move = self.model, self.data, self.mujoco.mj_step
        position, velocity, applied = data.qpos, data.qvel, data.qfrc_applied
        subtract, multiply, add, measured = np.subtract, np.multiply, np.add, position
        minimum, maximum, wildest = np.minimum, np.maximum, RUNAWAY**2
        for k in range(n):
            q[k], dq[k] = position, velocity
            ask, want, get = demand[k], wanted[k], torque[k]
            if noise is not None:
                measured = position + noise[k]
            subtract(commands[k], measured, ask)
            multiply(ask, kp, ask)
            subtract(ask, velocity, ask)
            multiply(ask, kv, ask)
            multiply(ask, inertia, want)
            if holds:
                self._weigh(measured, gravity)
            if not on_top:
                add(want, gravity, want)
            get[:] = want
            if limited:
                minimum(get, top, out=get)
                maximum(get, bottom, out=get)
            if on_top:
                add(want, gravity, want)
                add(get, gravity, get)
            applied[:] = get
            move(model, data)
            if not velocity.dot(velocity) < wildest:
                self._refuse_runaway(k)
        q[n], dq[n] = position, velocity
        self.steps += n
        return _Log.of(q, dq, demand, wanted, torque, self.step)

    def _weigh(self, q: FloatArray, out: FloatArray) -> None:
        """Torques that hold the arm against gravity at q."""
        mujoco, model, still = self.mujoco, self.model, self.still
        still.qpos[:] = q
        mujoco.mj_kinematics(model, still)
        mujoco.mj_comPos(model, still)
        mujoco.mj_rne(model, still, 0, out)

    def _equilibrium(self, first: FloatArray) -> FloatArray:
        """Where the arm stands still under the first set-point.

        Raises:
            ExecutionError: Nowhere, or its drives are too weak.
        """
        plant, weight, q = self.plant, np.zeros(len(first)), first
        stiffness = plant.nominal_inertia * plant.kv * plant.servo.kp
        self._weigh(q, weight)
        if not plant.gravity_feedforward:
            for _ in range(ITERATIONS):
                before, q = q, first - weight / stiffness
                self._weigh(q, weight)
                if np.abs(q - before).max() <= EQUILIBRIUM:
                    break
            else:
                j = int(np.argmax(np.abs(q - before)))
                raise ExecutionError(
                    f"Joint {j + 1} has no equilibrium near its first set-point: its servo gains "
                    "are too low for the arm's weight without gravity feed-forward.",
                    t=self.start,
                    joint=j + 1,
                )
        if not (plant._on_top and plant.gravity_feedforward):
            refuse_too_heavy(np.abs(weight), plant.torque_limit, "the first set-point", self.start)
        return q

    def _refuse_runaway(self, k: int) -> None:
        velocity = np.abs(self.data.qvel)
        j = int(np.argmax(np.where(np.isfinite(velocity), velocity, np.inf)))
        t = self.start + (self.steps + k + 1) * self.step
        raise ExecutionError(
            f"Joint {j + 1} runs away at t = {t:.4g} s, at {velocity[j]:.3g} rad/s: its servo is "
            f"unstable with a step of {self.step:.3g} s; lower its gains or shorten the step.",
            t=t,
            joint=j + 1,
        )


def bytes_of(
    servo: ServoModel, step: float, span: float, period: float, resolution: float
) -> float:
    """What an execution takes, about [bytes]: its results, and a block of steps.

    Args:
        servo: With values per joint.
        step: Cycle of the drives [s].
        span: Time between the first and the last set-point [s].
        period: Command interval [s].
        resolution: Largest time between two results [s].
    """
    window = rest_window(servo)
    late = float(servo.dead_time.max())
    rows = results(span + late + 2 * window, period, resolution)
    steps = max(BLOCK, period, window) / min(step, period)
    return rows * RESULT + (rows * OF_JOINT + steps * AT_A_STEP) * len(servo.kp)


def rest_window(servo: ServoModel) -> float:
    """For how long a joint is seen to be at rest [s]."""
    return min(max(REST_TIME, 1 / float(servo.kp.min())), PATIENCE)


def check_step(step: float) -> float:
    """A cycle of the drives [s].

    Raises:
        InvalidInput: Not a number, or outside STEPS.
    """
    return _checks.between("step of the experiment's drives", step, *STEPS, "s")


def check_noise(noise: float) -> float:
    """A standard deviation of measured positions [rad].

    Raises:
        InvalidInput: Not a number, negative, or above LARGEST_NOISE.
    """
    return _checks.between("noise of measured positions", noise, 0.0, LARGEST_NOISE, "rad")


def _straight(q: FloatArray, steps: int, interpolation: str) -> FloatArray:
    """The command at the beginnings of steps between set-points."""
    if interpolation == "step":
        return np.repeat(q[:-1], steps, axis=0)
    share = np.arange(steps)[:, None] / steps
    between = q[:-1, None] + share * np.diff(q, axis=0)[:, None]
    return np.asarray(between.reshape(-1, q.shape[1]))


def _bodies(arm: Arm) -> Chain:
    """The chain of an arm, if it has masses.

    Raises:
        InvalidInput: It has none.
    """
    chain = arm.chain
    if chain is None or not arm.has_bodies:
        raise InvalidInput(
            f"The masses of the arm {arm.name} are not known, so it has no rigid bodies: load it "
            "from a file whose links have masses, centres of mass and inertias."
        )
    if len(chain) != arm.dof:
        raise InvalidInput(
            f"The arm {arm.name} has {arm.dof} joints, but its chain has {len(chain)}."
        )
    return chain


def _middle(limits: Limits, dof: int) -> FloatArray:
    """Middle of every joint's range; what is nearest to 0 in a range without one."""
    low, high = limits.joint_range(dof)
    both = np.isfinite(low) & np.isfinite(high)
    middle = (np.where(both, low, 0.0) + np.where(both, high, 0.0)) / 2
    return np.asarray(np.where(both, middle, np.clip(0.0, low, high)))


def _nominal(chain: Chain, reference: FloatArray) -> FloatArray:
    """Inertia that every joint sees at the reference without payload."""
    model = _mujoco.build(chain.replace(payload=None), STEP, friction=False)
    return np.asarray(np.diagonal(_mujoco.mass_matrix(model, reference)))


def _torques(limits: Limits, own: Limits, chain: Chain) -> FloatArray:
    """Largest torque of every drive.

    Without torque limits a drive is strong enough for the acceleration limits, all at once, in
    every pose that is looked at, without payload: that is what such a rating promises.

    Args:
        limits: The limits.
        own: The arm's own, for its joints' ranges.
        chain: The arm's bodies.

    Raises:
        InvalidInput: Accelerations that differ between directions, without torques.
    """
    if limits.joint_torque is not None:
        return limits.joint_torque
    dof = len(chain)
    if limits.joint_acceleration is None:
        return np.full(dof, np.inf)
    if not limits.same_both_ways():
        raise InvalidInput(
            "The rigid-body plant saturates alike in both directions: leave joint_deceleration out "
            "of its limits, or give it joint_torque."
        )
    lower, upper = (np.clip(x, -np.pi, np.pi) for x in own.joint_range(dof))
    shares = np.random.default_rng(0).uniform(size=(RATED_POSES, dof))
    model = _mujoco.build(chain.replace(payload=None), STEP, friction=False)
    needed = [
        np.abs(_mujoco.mass_matrix(model, lower + share * (upper - lower)))
        @ limits.joint_acceleration
        for share in shares
    ]
    return np.asarray(np.max(needed, axis=0))


def _every(steps: int, span: float, resolution: float) -> int:
    """Most steps between two results: a part of a command interval, so that these are met.

    Raises:
        InvalidInput: Results closer than steps.
    """
    if span > resolution * (1 + 1e-9):
        raise InvalidInput(
            f"The rigid-body plant moves in steps of {span:.4g} s, so it has no results every "
            f"{resolution:.4g} s: give it a step of at most that, or ask for a coarser resolution."
        )
    fitting = (m for m in range(steps, 0, -1) if steps % m == 0)
    return next(m for m in fitting if m * span <= resolution * (1 + 1e-9))
