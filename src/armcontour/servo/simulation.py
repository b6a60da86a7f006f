"""The servos of all joints, run through command intervals."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import ExecutionError
from armcontour.servo._simulation import Joints, Run, divide, prepare_joints, run_joints
from armcontour.servo.command import polynomials
from armcontour.servo.model import ServoModel


class Simulation:
    """Joints that follow set-points, exact between the instants at which saturation starts or ends.

    Args:
        q: Set-points, (n, dof) [rad].
        period: Time between them [s].
        servo: With values per joint.
        lower: Acceleration bounds, (dof,) [rad/s²]; by default there are none.
        upper: The same.
        steps: Results per interval.

    Raises:
        ExecutionError: Gains that are too large to simulate.
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
        """Run all joints through command intervals.

        Args:
            begin: First interval, from 0 at the first set-point.
            end: The one after the last.
            q: Positions at the beginning, (dof,) [rad].
            dq: Velocities there, (dof,) [rad/s].
            bounds: Other acceleration bounds than usual, (dof,) each [rad/s²].

        Raises:
            ExecutionError: A motion that cannot be computed.
        """
        joints = self.joints
        if bounds is not None:
            joints = joints._replace(lower=bounds[0], upper=bounds[1])
        run = run_joints(joints, self.commands, self.parts, self.steps, begin, end, q, dq)
        if run.stuck.any():
            self._refuse_stuck(int(np.argmax(run.stuck)))
        return run

    def _refuse_stuck(self, j: int) -> None:
        """Raise unless j is -1."""
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
