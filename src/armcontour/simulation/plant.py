"""`simulate`, base classes of plants, and the plant with independent joint servos."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import Self

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, Immutable, IntArray
from armcontour.core.errors import ArmMismatch, ExecutionError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import Interval
from armcontour.motion import Execution, FineMotion, SetPoints, arm_of
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.march import JointMotions
from armcontour.robot.servo.simulation import ServoSimulation, respond_within

# Longest time until rest after the last set-point [s]. For rigid bodies it is at least
# SETTLING_DURATIONS times the duration of the motion.
LONGEST_SETTLING = 60.0
SETTLING_DURATIONS = 10.0
# A joint runs away (it falls, or its servo is unstable) if its velocity exceeds this [rad/s].
RUNAWAY_SPEED = 1e3
# A joint is at rest up to this velocity [rad/s] and this distance from the last set-point [rad].
REST_VELOCITY = 1e-8
REST_DISTANCE = 1e-8
# Duration of the parts in which the simulation continues until rest after the last set-point [s].
REST_CHUNK = 0.25
# A loop whose gain times the cycle of its drive is not below this value is unstable.
LARGEST_STABLE = 2.0
# Longest time between two results for which quintics between them are exact enough [time
# constants]. For time constants of 1 ms, their error is about 2e-11 s² times the acceleration.
SMOOTH_TIME_CONSTANTS = 1.0
# If a set-point reaches a joint within this fraction of a step before or after a result, it counts
# as arriving with the result.
ARRIVAL_TOLERANCE = 1e-6
# The motion between two results is divided into this number of parts. For time constants of 1 ms,
# a cubic over a part has an error below 1e-11 rad.
FINE_PARTS = 16


class Plant(ABC):
    """A simulated robot: an arm with its drives."""

    @abstractmethod
    def run(self, set_points: SetPoints, resolution: float) -> Execution:
        """Execute set-points, from rest at the first set-point until rest at the last one.

        Args:
            set_points: The set-points.
            resolution: Largest time between two results [s].
        """

    def motion_between(self, executed: Execution, indices: IntArray) -> FineMotion | None:
        """Compute the motion between successive results of an execution on this plant.

        Args:
            executed: The execution, with all results.
            indices: Indices of the results at the starts of the intervals, increasing, (m,).

        Returns:
            The motion; None if the plant does not support it (default).
        """
        return None

    def smooth_steps(self, executed: Execution) -> BoolArray:
        """Return whether `motion_between` is a quintic from each result to the next, (n - 1,).

        The quintic has the positions, velocities and accelerations of both results. A plant need
        not know this (default): then `motion_between` is called for each interval.

        Args:
            executed: The execution, with all n results.
        """
        return np.zeros(len(executed.t) - 1, dtype=np.bool_)

    def __repr__(self) -> str:
        """Write the class, and the arm if the plant has one."""
        arm = getattr(self, "arm", None)
        return f"{type(self).__name__}({'' if arm is None else repr(arm)})"


class LimitedPlant(Immutable, Plant):
    """A plant whose drives saturate at explicit limits, or by default at those of the plan."""

    # A plant is immutable. `Execution.plant` is a copy with the limits of the plan.

    limits: Limits | None

    @abstractmethod
    def _set_saturation(self, planned: Limits | None) -> None:
        """Set the attributes for saturation, before the plant is frozen.

        `planned`: limits of the plan; they count if the plant has no explicit limits.
        """

    @checked
    def for_plan(self, set_points: SetPoints) -> Self:
        """Copy the plant with the limits of a plan; explicit limits of the plant stay.

        Args:
            set_points: Set-points of the plan.
        """
        planned = set_points.trajectory.limits
        if planned is None:
            return self
        plant = copy(self)
        del vars(plant)["_frozen"]
        plant._set_saturation(planned)
        plant._freeze()
        return plant


@checked
def simulate(
    set_points: SetPoints, plant: Plant | ServoModel, *, resolution: Interval = 1e-3
) -> Execution:
    """Execute set-points on a plant.

    >>> motion = ac.simulate(set_points, ac.ServoPlant(arm, servo), resolution=2e-3)
    >>> motion.dq.shape == motion.q.shape
    True

    Args:
        set_points: The set-points.
        plant: The plant, or the servos of the planned arm; it should differ from the model for
            which compensation was computed.
        resolution: Largest time between two results [s], by default 1 ms; it does not change the
            motion.

    Raises:
        InvalidInput: The set-points and the plant have different numbers of joints, the gains are
            too large for the cycle, or there would be too many results.
        ExecutionError: Rigid bodies do not come to rest, or a drive is too weak to hold the arm.
    """
    if isinstance(plant, ServoModel):
        plant = ServoPlant(arm_of(set_points.trajectory), plant)
    span = (len(set_points.q) - 1) * set_points.cycle
    checks.check_count(
        f"The simulation of {span:.4g} s of set-points with results every {resolution:g} s",
        (span / set_points.cycle + 1)
        * max(set_points.cycle / resolution, 1.0)
        * set_points.q.shape[1],
        "Use a coarser resolution or a higher speed, or skip the simulation (--no-simulation)",
    )
    return plant.run(set_points, resolution)


def check_joints(set_points: SetPoints, arm: Arm) -> None:
    """Refuse set-points and an arm with different numbers of joints."""
    checks.check_type("set_points", set_points, SetPoints)
    if set_points.q.shape[1] != arm.dof:
        raise ArmMismatch(
            f"The set-points and the arm must have the same joints, but the set-points have "
            f"{set_points.q.shape[1]} joints and the arm {arm.name} has {arm.dof}."
        )


def check_weight(arm: Arm, weight: FloatArray, limit: FloatArray, location: str, t: float) -> None:
    """Refuse gravity torques that exceed torque limits at rest.

    Args:
        arm: The arm.
        weight: Magnitudes of the gravity torques [N m], (dof,).
        limit: Torque limits [N m], (dof,).
        location: Where the arm rests, for the message.
        t: Time for the error [s].

    Raises:
        ExecutionError: A drive is too weak.
    """
    heavy = weight > limit
    if heavy.any():
        j = int(np.argmax(heavy))
        unit = arm.chain.unit("N m", j)
        raise ExecutionError(
            f"Joint {j + 1} requires {weight[j]:.4g} {unit} against gravity at {location}, but the "
            f"torque limit of its drive is {limit[j]:.4g} {unit}. Increase the torque limit or "
            "reduce the load.",
            t=t,
            joint=j,
            limit="joint_torque",
            needed=float(weight[j]),
            allowed=float(limit[j]),
        )


def _check_stability(servo: ServoModel) -> None:
    """Refuse a loop that is unstable because its drive holds its output for a cycle.

    With the gains K_p and K_v of order "second", the characteristic polynomial in z of a cycle T is
    z² - (2 - K_v T - K_p K_v T²/2) z + 1 - K_v T + K_p K_v T²/2. By Jury's criterion, its roots are
    inside the unit circle if K_v T < 2 and K_p T < 2. The latter also holds for order "first".
    """
    for name, gains in (("kv", servo.kv), ("kp", servo.kp)):
        if gains is None or not servo.drive_cycle:
            continue
        # A loop with an infinite gain has no delay, so it is not computed.
        gains = np.where(np.isfinite(gains), gains, 0.0)
        j = int(np.argmax(gains))
        product = float(gains[j]) * servo.drive_cycle
        if product >= LARGEST_STABLE:
            raise ExecutionError(
                f"Joint {j + 1} is unstable, because {name} times drive_cycle is {product:.4g}, "
                f"but must be below {LARGEST_STABLE:g}. Reduce {name} from {gains[j]:.4g} 1/s to "
                f"below {LARGEST_STABLE / servo.drive_cycle:.4g} 1/s, or shorten the drive_cycle "
                f"of {1e3 * servo.drive_cycle:.4g} ms.",
                joint=j,
                needed=product,
                allowed=LARGEST_STABLE,
            )


def count_intervals(set_points: SetPoints, servo: ServoModel) -> int:
    """Count the cycles until the last set-point has reached all joints."""
    delay = int(np.ceil(servo.dead_time.max() / set_points.cycle * (1 - 1e-12)))
    return len(set_points.q) - 1 + delay


def longest_settling(duration: float) -> float:
    """Return the longest time that joints may take to come to rest after a motion [s]."""
    return max(LONGEST_SETTLING, SETTLING_DURATIONS * duration)


class ServoPlant(LimitedPlant):
    """Plant of independent joints, each with its own servo.

    >>> slower = ac.ServoPlant(arm, servo.replace(kp=20.0))
    >>> ac.simulate(set_points, slower).q.shape[1]
    2

    Args:
        arm: The arm.
        servo: The servo of the simulated robot; it may differ from the nominal servo.
        limits: Limits with the joint accelerations at which drives saturate. By default, the
            limits of the plan count; if the plan has none, those of the arm.
        saturation: Limit at which a servo of order "second" saturates. "acceleration" is (7) with
            acceleration_limit of the servo, otherwise joint_acceleration. "none" disables
            saturation. The default is "acceleration" if acceleration limits are known, otherwise
            "none". Joints of other orders do not saturate. Torque limits saturate the drives of a
            `RigidBodyPlant`.

    A plant is immutable. `Execution.plant` is a copy with the limits of the plan.

    Attributes:
        limits: The explicit limits, or None.
        saturation: The explicit or default saturation.
        lower, acceleration: Acceleration bounds [rad/s²], (dof,); infinite without limits.

    Raises:
        InvalidInput: Gains or limits do not fit the arm, or saturation is specified for a servo of
            another order.
    """

    saturation: str
    lower: FloatArray
    acceleration: FloatArray

    @checked
    def __init__(
        self,
        arm: Arm,
        servo: ServoModel,
        limits: Limits | None = None,
        *,
        saturation: str | None = None,
    ) -> None:
        self.arm = arm
        self.servo = servo.for_joints(arm.dof)
        self.limits = limits
        self._requested_saturation = saturation
        self._set_saturation(None)
        self._freeze()

    def _set_saturation(self, planned: Limits | None) -> None:
        """Set `saturation` and the acceleration bounds."""
        arm = self.arm
        servo = self.servo
        resolved = resolve_limits("A ServoPlant", arm, self.limits, planned)
        saturation = _resolve_saturation(self._requested_saturation, servo, resolved)
        lower, upper = np.full((2, arm.dof), [[-np.inf], [np.inf]])
        if saturation == "acceleration":
            lower, upper = servo.saturate(*resolved.acceleration_bounds(arm.dof))
        self.saturation = saturation
        self.lower = checks.frozen_array(lower)
        self.acceleration = checks.frozen_array(upper)

    def run(self, set_points: SetPoints, resolution: float) -> Execution:
        """Execute set-points; the motion is exact between the starts and ends of saturation.

        Raises:
            InvalidInput: The set-points have another number of joints, or the gains are too large
                for the cycle.
            ExecutionError: A loop is unstable at the cycle of the drives.
        """
        check_joints(set_points, self.arm)
        self.servo.check_gains(set_points.cycle)
        _check_stability(self.servo)
        return self.for_plan(set_points)._execute(set_points, resolution)

    def _execute(self, set_points: SetPoints, resolution: float) -> Execution:
        """Execute set-points with the limits that `for_plan` has chosen."""
        steps = int(np.ceil(set_points.cycle / resolution * (1 - 1e-12)))
        motions, unsettled = self._until_rest(set_points, steps)
        start = np.zeros((self.arm.dof, 1, 3))
        start[:, 0, 0] = set_points.q[0]
        states = np.concatenate([start, *(x.states for x in motions)], axis=1)
        q, dq, demand = (np.ascontiguousarray(states[:, :, i].T) for i in range(3))
        lowest = np.min([x.lowest for x in motions], 0)
        highest = np.max([x.highest for x in motions], 0)
        return Execution(
            arm=self.arm,
            set_points=set_points,
            t=set_points.times(len(q), set_points.cycle / steps),
            q=q,
            dq=dq,
            ddq=np.clip(demand, self.lower, self.acceleration),
            demand=demand,
            demand_range=np.stack([lowest, highest]),
            saturated_time=np.sum([x.saturated for x in motions], axis=0),
            unsettled=unsettled,
            model_error=self.servo.model_error,
            plant=self,
        )

    def motion_between(self, executed: Execution, indices: IntArray) -> FineMotion | None:
        """Compute the motion between successive results of an execution on this plant.

        Intervals with smooth motion are quintics. Otherwise the motion is exact at 16 uniform times
        of the interval and when set-points reach joints, and cubic between these times.

        Args:
            executed: The execution, at uniform times.
            indices: Indices of the results at the starts of the intervals, increasing, (m,).
        """
        motion = executed
        set_points = executed.set_points
        steps, width = _steps_of(executed)
        demand = np.stack([motion.demand[indices], motion.demand[indices + 1]])
        if self._is_smooth(width) and self._are_within(demand).all():
            return FineMotion.through(motion.t, motion.q, motion.dq, motion.ddq, indices)
        parts = []
        bounds = (self.lower, self.acceleration)
        for i in indices.tolist():
            k, phase = divmod(round(float(motion.t[i] - set_points.start_time) / width), steps)
            times = (phase + np.arange(FINE_PARTS + 1) / FINE_PARTS) * width
            held = np.where(self.servo.ki > 0, motion.demand[i], np.clip(motion.demand[i], *bounds))
            if self.servo.drive_cycle and self.servo.kv is None:
                held = motion.dq[i]
            arguments = self.servo, bounds, k, times, (motion.q[i], motion.dq[i], held)
            response = respond_within(set_points.q, set_points.cycle, *arguments)
            parts.append(response._replace(t=response.t - times[0] + motion.t[i]))
        return FineMotion(
            t=np.concatenate([x.t for x in parts]),
            q=np.concatenate([x.q for x in parts]),
            before=np.concatenate([x.before for x in parts]),
            after=np.concatenate([x.after for x in parts]),
        )

    def smooth_steps(self, executed: Execution) -> BoolArray:
        """Return whether `motion_between` is a quintic from each result to the next, (n - 1,).

        Args:
            executed: The execution, at uniform times, with all n results.
        """
        within = np.asarray(self._are_within(executed.demand).all(axis=1))
        _, width = _steps_of(executed)
        return np.asarray(within[:-1] & within[1:] & self._is_smooth(width))

    def _are_within(self, demand: FloatArray) -> BoolArray:
        """Return which demands [rad/s²], (..., dof), do not saturate a joint, of the same shape."""
        return np.asarray((self.lower < demand) & (demand < self.acceleration))

    def _is_smooth(self, width: float) -> bool:
        """Return whether unsaturated motion has no kink between results `width` apart [s].

        Quintics must also be exact enough.
        """
        servo = self.servo
        jumps = servo.interpolation == "step" or servo.has_feedforward or servo.friction.any()
        if (
            servo.order != "second"
            or servo.kv is None
            or jumps
            or servo.drive_cycle
            or servo.ki.any()
        ):
            return False
        delay = servo.dead_time / width
        slow = max(servo.kv.max(), servo.kp.max()) * width <= SMOOTH_TIME_CONSTANTS
        return bool(slow and (abs(delay - np.round(delay)) < ARRIVAL_TOLERANCE).all())

    def _until_rest(
        self, set_points: SetPoints, steps: int
    ) -> tuple[list[JointMotions], FloatArray | None]:
        """Simulate until the joints rest; return successive parts and `Execution.unsettled`.

        - `steps`: number of results per cycle.
        """
        cycle = set_points.cycle
        simulation = ServoSimulation(
            set_points.q, cycle, self.servo, self.lower, self.acceleration, steps=steps
        )
        start = set_points.q[0]
        last = set_points.q[-1]
        # Number of cycles that have been simulated.
        count = count_intervals(set_points, self.servo)
        motions = [simulation.run(0, count, start, np.zeros_like(start))]
        longest = count + int(np.ceil(LONGEST_SETTLING / cycle))
        chunk = int(np.ceil(REST_CHUNK / cycle))
        q, dq = (motions[0].states[:, -1, :2].T if count else np.stack([start, 0.0 * start])).copy()
        while (np.abs(dq) > REST_VELOCITY).any() or (np.abs(q - last) > REST_DISTANCE).any():
            if count > longest:
                return motions, np.abs(q - last)
            motions.append(simulation.run(count, count + chunk, q, dq, motions[-1].held))
            q, dq = motions[-1].states[:, -1, :2].T.copy()
            count += chunk
        return motions, None


def _steps_of(executed: Execution) -> tuple[int, float]:
    """Return the results per cycle of an execution, and the time between two results [s]."""
    cycle = executed.set_points.cycle
    steps = round(cycle / float(executed.t[1] - executed.t[0]))
    return steps, cycle / steps


def _resolve_saturation(requested: str | None, servo: ServoModel, limits: Limits) -> str:
    """Check the requested saturation, or select the default if it is None."""
    second = servo.kv is not None
    if requested is None:
        if servo.acceleration_limit is not None:
            limited = second and np.isfinite(servo.acceleration_limit).any()
            return "acceleration" if limited else "none"
        return "acceleration" if second and limits.joint_acceleration is not None else "none"
    checks.check_choice("saturation", requested, ("acceleration", "none"))
    if not second and requested != "none":
        raise InvalidInput(
            f"Saturation {requested!r} requires a servo of order second, but the servo is of order "
            f"{servo.order}. Remove saturation, or use a servo of order second."
        )
    return requested
