"""Simulation of the servos of all joints over command intervals."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import ExecutionError
from armcontour.servo._simulation import Joints, Parts, Run, divide, prepare_joints, run_joints
from armcontour.servo.command import SNAP, polynomials
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
        parts: Parts of an interval, if they are not `steps` equal ones.

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
        parts: Parts | None = None,
    ) -> None:
        self.period, self.servo, self.steps = period, servo, steps
        free = np.full(len(servo.kp), np.inf)
        kv = np.zeros_like(servo.kp) if servo.kv is None else servo.kv
        bounds = -free if lower is None else lower, free if upper is None else upper
        self.joints = Joints(*(np.array(x, dtype=np.float64) for x in (servo.kp, kv, *bounds)))
        self.commands = polynomials(q, period, servo)
        self.parts = parts or divide(period, steps, np.array(servo.dead_time))
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


def respond_within(
    q: FloatArray,
    period: float,
    servo: ServoModel,
    bounds: tuple[FloatArray, FloatArray],
    k: int,
    at: FloatArray,
    state: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Response of all joints at any times within one command interval, by the same formulas.

    Args:
        q: Set-points [rad], (n, dof).
        period: Command interval [s].
        servo: Servo model with values per joint.
        bounds: Lower and upper acceleration bounds [rad/s²], (dof,) each.
        k: Index of the interval; 0 starts at the first set-point.
        at: Times since the start of the interval, increasing, at least two [s].
        state: Positions [rad] and velocities [rad/s] at the first of these times, (dof,) each.

    Returns:
        The times and those between them at which a set-point reaches a joint [s], (m,); there,
        positions [rad], and velocities before and after [rad/s], (m, dof) each.

    Raises:
        ExecutionError: The motion cannot be computed.
    """
    late = np.floor(servo.dead_time / period + SNAP).astype(np.intp)
    rest = np.maximum(servo.dead_time - late * period, 0.0)
    near = SNAP * period
    at = np.union1d(at, rest[(rest > at[0] + near) & (rest < at[-1] - near)])
    # The set-points that can be active then, and those next to them, which shape cubics.
    first = max(min(k - int(late.max()) - 3, len(q) - 4), 0)
    own = q[first : max(k - int(late.min()) + 4, first + 4)]
    before = at[:-1] < (rest - near)[:, None]
    local = np.where(before, at[:-1] + period - rest[:, None], at[:-1] - rest[:, None])
    dof, count = before.shape
    parts = Parts(
        number=np.full(dof, count, np.intp),
        width=np.tile(np.diff(at), (dof, 1)),
        local=np.maximum(local, 0.0),
        late=late[:, None] + before,
        due=np.ones((dof, count), np.intp),
        repeats=np.empty((dof, count), np.intp),
        steps=np.empty((dof, count, 11)),
    )
    active = Simulation(own, period, servo, *bounds, steps=count, parts=parts)
    run = active.run(k - first, k - first + 1, *state)
    position, velocity = (np.vstack([x, run.states[:, :, i].T]) for i, x in enumerate(state))
    after = velocity.copy()
    if servo.kv is None:
        # The velocity of a servo of first order jumps with its command.
        last = active.commands.shape[1] - 1
        n = np.clip(k - first - parts.late + 1, 0, last)
        x = np.where((n > 0) & (n < last), parts.local, 0.0)
        a = active.commands[np.arange(dof)[:, None], n]
        u = a[..., 0] + x * (a[..., 1] + x * (a[..., 2] + x * a[..., 3]))
        after[:-1] = servo.kp * (u.T - position[:-1])
    return at, position, velocity, after
