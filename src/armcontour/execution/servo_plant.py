"""The paper's robot: independent joints, each a servo (7) with a limited acceleration."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.arms.limits import or_unlimited
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.execution._servo import simulate
from armcontour.execution.plant import Plant
from armcontour.motion import Execution, TaughtData
from armcontour.servo import ServoModel

# A joint is at rest when it is this slow [rad/s] and this near to its last set-point [rad].
REST_VELOCITY = 1e-8
REST_DISTANCE = 1e-8
# Behind the last set-point the joints get this long to come to rest [s], or this many durations.
PATIENCE = 60.0
PATIENCE_IN_DURATIONS = 10.0
# The tail is run in chunks of this time [s].
CHUNK = 0.25


class ServoPlant(Plant):
    """The servo (7) on every joint.

    Args:
        arm: The arm.
        servo: The real gains; they may differ from those that the taught data was made with.
        limits: Whose joint accelerations saturate; the arm's own by default.

    Raises:
        InvalidInput: Gains or limits that do not fit the arm.
    """

    def __init__(self, arm: Arm, servo: ServoModel, limits: Limits | None = None) -> None:
        self.arm = arm
        self.servo = servo.for_joints(arm.dof)
        own = (arm.limits if limits is None else limits).for_joints(arm.dof)
        if not own.same_both_ways():
            raise InvalidInput(
                "The servo plant saturates alike in both directions: leave joint_deceleration out "
                "of its limits."
            )
        self.acceleration = or_unlimited(own.joint_acceleration, arm.dof)

    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data; exact between the instants where saturation starts or ends.

        Raises:
            InvalidInput: Taught data for another number of joints.
            ExecutionError: The joints do not come to rest.
        """
        if taught.q.shape[1] != self.arm.dof:
            raise InvalidInput(
                f"The taught data is for {taught.q.shape[1]} joints, but the arm {self.arm.name} "
                f"has {self.arm.dof}."
            )
        steps = int(np.ceil(taught.period / resolution * (1 - 1e-12)))
        first, last = taught.q[0], taught.q[-1]
        parts = [self._piece(taught.q, taught.period, steps, first, np.zeros_like(first))]
        chunk = np.tile(last, (int(np.ceil(CHUNK / taught.period)) + 1, 1))
        end = len(taught.q) * taught.period
        patience = end + max(PATIENCE, PATIENCE_IN_DURATIONS * end)
        now = end
        q, dq = (
            x[-1] if len(x) else y for x, y in zip(parts[0][:2], (first, 0 * first), strict=True)
        )
        while (np.abs(dq) > REST_VELOCITY).any() or (np.abs(q - last) > REST_DISTANCE).any():
            if now > patience:
                j = int(np.argmax(np.abs(q - last)))
                raise ExecutionError(
                    f"Joint {j + 1} is not at rest {now - end:.3g} s after its last set-point: its "
                    "servo gains and acceleration limit do not let it settle.",
                    t=now,
                    joint=j + 1,
                )
            parts.append(self._piece(chunk, taught.period, steps, q, dq))
            q, dq = parts[-1][0][-1], parts[-1][1][-1]
            now += (len(chunk) - 1) * taught.period
        position, velocity, demand = (
            np.concatenate([start[None], *(x[i] for x in parts)])
            for i, start in enumerate((first, 0 * first, 0 * first))
        )
        return Execution(
            arm=self.arm,
            taught=taught,
            t=np.arange(len(position), dtype=np.float64) * (taught.period / steps),
            q=position,
            dq=velocity,
            ddq=np.clip(demand, -self.acceleration, self.acceleration),
            demand=demand,
            peak_demand=np.max([x[4] for x in parts], axis=0),
            saturated_time=np.sum([x[3] for x in parts], axis=0),
        )

    def _piece(
        self, commands: FloatArray, period: float, steps: int, q: FloatArray, dq: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        linear = self.servo.interpolation == "linear"
        result: tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray] = simulate(
            np.ascontiguousarray(commands),
            period,
            steps,
            linear,
            self.servo.kp,
            self.servo.kv,
            self.acceleration,
            q,
            dq,
        )
        return result
