"""The plant of the paper: independent joints, each a servo (7) with limited acceleration."""

from __future__ import annotations

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray, Locked
from armcontour.arms import Arm, Limits, choose_limits
from armcontour.arms.limits import or_unlimited
from armcontour.errors import InvalidInput
from armcontour.execution.plant import (
    PATIENCE,
    Plant,
    count_intervals,
    refuse_other_joints,
)
from armcontour.execution.servo_run import Part, ServoRun, TorqueBounds, join_parts
from armcontour.motion import Execution, FineMotion, TaughtData
from armcontour.servo import ServoModel
from armcontour.servo.simulation import respond_within

SATURATIONS = ("acceleration", "torque", "none")
# A joint is at rest below this velocity [rad/s] and this distance to the last set-point [rad].
REST_VELOCITY = 1e-8
REST_DISTANCE = 1e-8
# After the last set-point the simulation continues in parts of this time [s] until rest.
CHUNK = 0.25
# A servo with at most so many time constants between two results has no more than 1e-11 of its
# acceleration per s² in what quintics leave out.
SMOOTH = 1.0
# Set-points that reach a joint nearer to a result than this share of the time to the next one count
# as reaching it there.
REACHED = 1e-6
# Times from one result to the next at which the motion between them is computed: cubics between
# these are off by less than 1e-11 rad for servos with time constants of a millisecond.
PARTS = 16


class ServoPlant(Locked, Plant):
    """Independent joints, each with its own servo.

    Args:
        arm: The arm.
        servo: The servo of the simulated robot; it may differ from the model by which the taught
            data was compensated.
        limits: Limits with the joint accelerations or torques that saturate; the arm's own by
            default.
        saturation: Which limit saturates a servo of second order. "acceleration" is (7):
            acceleration_limit of the servo, or without one joint_acceleration, and
            joint_deceleration in the negative direction if it is given.
            "torque" bounds the acceleration by `-T <= M_jj(q) ddq_j + b_j(q, dq) <= T` with the
            state at the start of each command interval, where T is joint_torque and b is the torque
            of gravity, centrifugal and Coriolis effects and friction; accelerations of other joints
            are neglected. "none" never saturates. The default is "acceleration" if there are such
            limits; else "torque" if there are such limits and the arm has masses; else "none". A
            joint of another order than "second" has no limited acceleration, and its demands are
            its accelerations.

    Once made, a plant does not change.

    Attributes:
        saturation: The given or default saturation.
        lower, acceleration: Acceleration bounds [rad/s²], (dof,); infinite without limits.
        torque_limit: Torque limits [N m], (dof,); None unless torque saturates.

    Raises:
        InvalidInput: Gains or limits do not fit the arm, the servo is of first order and saturates,
            or torque saturates but limits or masses are missing.
    """

    def __init__(
        self,
        arm: Arm,
        servo: ServoModel,
        limits: Limits | None = None,
        *,
        saturation: str | None = None,
    ) -> None:
        _checks.refuse_other("A ServoPlant", arm, Arm, "such as load_arm('ur5e')")
        _checks.refuse_other("A ServoPlant", servo, ServoModel)
        self.arm = arm
        self.servo = servo.for_joints(arm.dof)
        own = choose_limits("A ServoPlant", arm, limits)
        self.saturation = _saturation(saturation, self.servo, own, arm)
        self.torque_limit: FloatArray | None = None
        self.acceleration: FloatArray = np.full(arm.dof, np.inf)
        self.lower: FloatArray = -self.acceleration
        if self.saturation == "acceleration":
            self.lower, self.acceleration = self.servo.saturate(*own.acceleration_bounds(arm.dof))
        if self.saturation == "torque":
            if own.joint_torque is None:
                raise InvalidInput(
                    "Saturation of torque needs joint_torque among the limits: give it, or let "
                    "the plant saturate in acceleration.",
                    limit="joint_torque",
                )
            self.torque_limit = or_unlimited(own.joint_torque, arm.dof)
            # This property refuses an arm without masses.
            _ = arm.dynamics

    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data; the motion is exact between the starts and ends of saturation.

        Raises:
            InvalidInput: The taught data is for another number of joints, or the gains are too
                large for the command interval.
            ExecutionError: A drive is too weak to hold the arm.
        """
        refuse_other_joints(taught, self.arm)
        self.servo.refuse_too_fast(taught.period)
        steps = int(np.ceil(taught.period / resolution * (1 - 1e-12)))
        parts, unsettled = self._until_rest(taught, steps)
        whole = join_parts(parts)
        return Execution(
            arm=self.arm,
            taught=taught,
            t=taught.times(len(whole.q), taught.period / steps),
            q=whole.q,
            dq=whole.dq,
            ddq=whole.ddq,
            demand=whole.demand,
            demand_range=whole.demand_range,
            saturated_time=whole.saturated,
            unsettled=unsettled,
            unexplained=self.servo.unexplained,
            plant=self,
        )

    def motion_between(self, executed: Execution, which: IntArray) -> FineMotion | None:
        """The motion from some results of an execution on this plant to the next ones.

        Quintics where the motion is smooth. Else exact at PARTS times, and where a set-point
        reaches a joint, with cubics between these.

        Args:
            executed: The execution, at regular times.
            which: Indices of the results before, increasing, (m,).

        Returns:
            The motion; None if the torque limits of its command interval follow from a result that
            the execution does not have.
        """
        x, taught = executed, executed.taught
        steps = round(taught.period / float(x.t[1] - x.t[0]))
        width = taught.period / steps
        demand = np.stack([x.demand[which], x.demand[which + 1]])
        if self._smooth_between(demand, width):
            return FineMotion.through(x.t, x.q, x.dq, x.ddq, which)
        parts = []
        for i in which.tolist():
            k, phase = divmod(round(float(x.t[i] - taught.start_time) / width), steps)
            bounds = self.lower, self.acceleration
            if self.torque_limit is not None:
                # The bounds of a command interval follow from the state at its start.
                if i < phase:
                    return None
                limits = TorqueBounds(self.arm, self.torque_limit, taught)
                bounds = limits.at(k, x.q[i - phase], x.dq[i - phase])
            at = (phase + np.arange(PARTS + 1) / PARTS) * width
            held = np.clip(x.demand[i], *bounds)
            if self.servo.cycle and self.servo.kv is None:
                held = x.dq[i]
            own = self.servo, bounds, k, at, (x.q[i], x.dq[i], held)
            t, *states = respond_within(taught.q, taught.period, *own)
            parts.append((t - at[0] + x.t[i], *states))
        columns = (np.concatenate(each) for each in zip(*parts, strict=True))
        t, q, before, after = columns
        return FineMotion(t=t, q=q, before=before, after=after)

    def _smooth_between(self, demand: FloatArray, width: float) -> bool:
        """Whether nothing happens between results, and quintics are exact enough there.

        Args:
            demand: Demands at the results [rad/s²], (..., dof).
            width: Time between two of them [s].
        """
        servo = self.servo
        jumps = servo.interpolation == "step" or servo.has_feedforward or servo.friction.any()
        if servo.order != "second" or servo.kv is None or jumps or servo.cycle:
            return False
        if self.torque_limit is not None:
            return False
        if not ((self.lower < demand) & (demand < self.acceleration)).all():
            return False
        late = servo.dead_time / width
        slow = max(servo.kv.max(), servo.kp.max()) * width <= SMOOTH
        return bool(slow and (abs(late - np.round(late)) < REACHED).all())

    def _until_rest(self, taught: TaughtData, steps: int) -> tuple[list[Part], FloatArray | None]:
        """The run in parts, from the state at the start on, and `Execution.unsettled`."""
        run = self._begin(taught, steps)
        first, last = taught.q[0], taught.q[-1]
        still = np.zeros((1, len(first)))
        begin = Part(first[None], still, still, still, still[0], np.zeros((2, len(first))))
        done = count_intervals(taught, self.servo)
        parts = [begin, run.advance(0, done, first, np.zeros_like(first))]
        more = int(np.ceil(CHUNK / taught.period))
        last_one = done + int(np.ceil(PATIENCE / taught.period))
        q, dq = (
            x[-1] if len(x) else y for x, y in zip(parts[1][:2], (first, 0 * first), strict=True)
        )
        while (np.abs(dq) > REST_VELOCITY).any() or (np.abs(q - last) > REST_DISTANCE).any():
            if done > last_one:
                return parts, np.abs(q - last)
            parts.append(run.advance(done, more, q, dq))
            q, dq = parts[-1].q[-1], parts[-1].dq[-1]
            done += more
        return parts, None

    def _begin(self, taught: TaughtData, steps: int) -> ServoRun:
        """A run of the servos, with `steps` results per command interval."""
        bounds = None
        if self.torque_limit is not None:
            bounds = TorqueBounds(self.arm, self.torque_limit, taught)
        return ServoRun(taught, steps, self.servo, (self.lower, self.acceleration), bounds)


def _saturation(asked: str | None, servo: ServoModel, limits: Limits, arm: Arm) -> str:
    """The given saturation, or the default one for None.

    Raises:
        InvalidInput: The saturation is unknown, or no joint is of second order and can saturate.
    """
    second = servo.kv is not None
    if asked is None:
        if servo.acceleration_limit is not None:
            limited = second and np.isfinite(servo.acceleration_limit).any()
            return "acceleration" if limited else "none"
        if second and limits.joint_acceleration is not None:
            return "acceleration"
        torque = second and limits.joint_torque is not None and arm.has_bodies
        return "torque" if torque else "none"
    _checks.choice("saturation", asked, SATURATIONS)
    if not second and asked != "none":
        raise InvalidInput(
            f"A servo of order {servo.order} has no acceleration that its {asked} could limit: "
            "leave saturation out, or take a servo of order second."
        )
    return asked
