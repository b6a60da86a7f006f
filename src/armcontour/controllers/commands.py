"""Set-points at the cycles of a controller, and the set-points of stops."""

from __future__ import annotations

import numpy as np

from armcontour.control.compensation import CompensationOptions, NoCompensation
from armcontour.control.compensation.compensator import unchecked_set_points
from armcontour.controllers.controller import Motion, Stop
from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import SetPoints, Trajectory
from armcontour.planning import stop
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import command_weights

# Duration of the rest that is appended to a motion: the joints settle and the last samples arrive
# [s].
REST = 1.0
# Tolerance between the set-points of a stop and those of the plan, before the stop begins [rad].
SAME = 1e-7
# Number of set-points by which the compensation looks ahead: the first guess is doubled up to the
# maximum, until the set-points before the stop no longer change.
FORESIGHT, LONGEST_FORESIGHT = 16, 256
# Duration in which a stop reduces learned corrections to 0 [s].
FADING = 0.2
# Default band: a joint may differ from its prediction by LEAST [rad] and by the distance that it
# moves in LAG [s] at its largest speed. UNKNOWN_LAG applies if the servo is unknown.
LEAST, LAG, UNKNOWN_LAG = 2e-3, 0.05, 0.25


def commands_at(set_points: SetPoints, cycle: float, interpolation: str) -> FloatArray:
    """Set-points at the cycles of a controller, followed by a rest [rad], (n, dof).

    Args:
        set_points: The set-points.
        cycle: Cycle of the controller [s].
        interpolation: Interpolation between set-points, as in `ServoModel`.
    """
    q = set_points.q
    rest = np.repeat(q[-1:], round(REST / cycle), axis=0)
    if abs(set_points.cycle - cycle) < 1e-12:
        return np.concatenate([q, rest])
    t = np.arange(0.0, (len(q) - 1) * set_points.cycle + cycle / 2, cycle)
    index, weight = command_weights(len(q), set_points.cycle, interpolation, t)
    return np.concatenate([np.einsum("nk,nkj->nj", weight, q[index]), rest])


class Stopper:
    """Computes the set-points of stops on the path of a plan.

    Args:
        set_points: The set-points that are played; learned ones keep their corrections, which fade
            out in a stop.
        servo: The servo model of the compensation.
        options: Options of the compensation.
        arm: The arm.
        cycle: Cycle of the controller [s].
    """

    def __init__(
        self,
        set_points: SetPoints,
        servo: ServoModel,
        options: CompensationOptions,
        arm: Arm,
        cycle: float,
    ) -> None:
        self.set_points, self.servo, self.options = set_points, servo, options
        self.arm, self.cycle = arm, cycle
        self.q = commands_at(set_points, cycle, servo.interpolation)
        # If the robot has more dead time than its model, learned set-points start whole cycles
        # earlier than the planned set-points. Row k of the learned set-points corresponds to row k
        # of the planned set-points in any case.
        planned = self._compensate(set_points.trajectory)
        self._start_time = planned.start_time
        self._planned = commands_at(planned, cycle, servo.interpolation)

    def __call__(self, k: int) -> Stop:
        """Compute the stop that replaces the set-points from cycle k on.

        Raises:
            NotRealizable: The stop would also change set-points before k.
        """
        plan, foresight = self.set_points.trajectory, FORESIGHT
        while foresight <= LONGEST_FORESIGHT:
            t = k * self.cycle + self._start_time
            t += float(np.max(self.servo.dead_time)) + foresight * self.set_points.cycle
            if t >= plan.duration:
                return Stop(k=k, q=self.q[min(k, len(self.q) - 1) :])
            stopped = self._compensate(stop(plan, max(t, 0.0)))
            if abs(stopped.start_time - self._start_time) > SAME * stopped.cycle:
                raise NotRealizable(
                    "The set-points of a stop start at another time than the plan's."
                )
            q = commands_at(stopped, self.cycle, self.servo.interpolation)
            if np.abs(q[:k] - self._planned[:k]).max(initial=0.0) < SAME:
                return Stop(k=k, q=q[k:] + self._correction(k, len(q) - k))
            foresight *= 2
        raise NotRealizable(
            f"The set-points before cycle {k} depend on the stop after it, because the "
            f"compensation looks ahead by more than {LONGEST_FORESIGHT} set-points. Choose faster "
            "poles or wider command limits."
        )

    def _compensate(self, trajectory: Trajectory) -> SetPoints:
        """Set-points of a trajectory, with the compensation of the plan."""
        cycle = self.set_points.cycle
        return unchecked_set_points(trajectory, self.servo, self.options, cycle=cycle, arm=self.arm)

    def _correction(self, k: int, count: int) -> FloatArray:
        """Learned correction from cycle k on, which fades out [rad], (count, dof)."""
        learned = self.q[k : k + count] - self._planned[k : k + count]
        number = np.arange(count)
        x = np.clip(number * self.cycle / FADING, 0.0, 1.0)
        faded = 1 - x**3 * (10 - x * (15 - 6 * x))
        return np.asarray(learned[np.minimum(number, len(learned) - 1)] * faded[:, None])


def uncompensated_motion(trajectory: Trajectory, arm: Arm, cycle: float) -> Motion:
    """Motion along a trajectory, with its stops; the set-points are not compensated."""
    q = trajectory.sample(cycle).q
    set_points = SetPoints(cycle=cycle, q=q, trajectory=trajectory, method="none")
    stopper = Stopper(set_points, ServoModel(order="delay"), NoCompensation(), arm, cycle)
    return guarded_motion(stopper, stopper.q, UNKNOWN_LAG)


def guarded_motion(
    stopper: Stopper, predicted: FloatArray, lag: float, band: float | None = None
) -> Motion:
    """Motion that stops if a joint leaves a band around its predicted positions."""
    speed = np.abs(np.diff(predicted, axis=0)).max(axis=0, initial=0.0) / stopper.cycle
    allowed = LEAST + lag * speed if band is None else np.full_like(speed, band)
    return Motion(q=stopper.q, next_stop=stopper, predicted=predicted, band=allowed)
