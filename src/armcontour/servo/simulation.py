"""Simulation of the servos of all joints over command intervals."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import ExecutionError
from armcontour.servo._simulation import Joints, Run, divide, prepare_joints, run_joints
from armcontour.servo.command import polynomials
from armcontour.servo.model import ServoModel


class Simulation:
    """Response of all joints to set-points, exact between the starts and ends of saturation.

    Args:
        q: Set-points [rad], (n, dof).
        period: Command interval [s].
        servo: Servo model with values per joint.
        lower: Lower acceleration bounds [rad/s²], (dof,); none by default.
        upper: Upper acceleration bounds [rad/s²], (dof,); none by default.
        steps: Number of results per interval.

    Raises:
        ExecutionError: The gains are too large to simulate.
    """

    def __init__(
        self,
        q: FloatArray,
        period: float,
        servo: ServoModel,
        lower: FloatArray | None = None,
        upper: FloatArray | None = None,
        *,
        steps: int = 1,
    ) -> None:
        self.period, self.servo, self.steps = period, servo, steps
        free = np.full(len(servo.kp), np.inf)
        kv = np.zeros_like(servo.kp) if servo.kv is None else servo.kv
        bounds = -free if lower is None else lower, free if upper is None else upper
        self.joints = Joints(*(np.array(x, dtype=np.float64) for x in (servo.kp, kv, *bounds)))
        self.commands = polynomials(q, period, servo.interpolation)
        self.parts = divide(period, steps, np.array(servo.dead_time))
        straight = servo.interpolation != "cubic"
        self._refuse_stuck(prepare_joints(self.joints, straight, self.parts))

    def run(
        self,
        begin: int,
        end: int,
        q: FloatArray,
        dq: FloatArray,
        bounds: tuple[FloatArray, FloatArray] | None = None,
    ) -> Run:
        """Simulate all joints over command intervals.

        Args:
            begin: Index of the first interval; 0 starts at the first set-point.
            end: Index after that of the last interval.
            q: Positions at the start [rad], (dof,).
            dq: Velocities at the start [rad/s], (dof,).
            bounds: Lower and upper acceleration bounds for this run [rad/s²], (dof,) each; by
                default those of the simulation.

        Raises:
            ExecutionError: The motion cannot be computed.
        """
        joints = self.joints
        if bounds is not None:
            joints = joints._replace(lower=bounds[0], upper=bounds[1])
        # Copies: functions are compiled again for arrays that are read-only.
        q, dq = np.array(q), np.array(dq)
        run = run_joints(joints, self.commands, self.parts, self.steps, begin, end, q, dq)
        if run.stuck.any():
            self._refuse_stuck(int(np.argmax(run.stuck)))
        return run

    def _refuse_stuck(self, j: int) -> None:
        """Raise ExecutionError for joint j, unless j is -1."""
        if j < 0:
            return
        kp, kv = self.servo.kp[j], self.servo.kv
        gains = f"kp = {kp:g}" + ("" if kv is None else f" and kv = {kv[j]:g}")
        raise ExecutionError(
            f"Joint {j + 1} cannot be simulated with {gains} 1/s and a command interval of "
            f"{self.period:g} s: time steps as short as the servo needs make no progress, so lower "
            "the gains.",
            joint=j + 1,
        )
