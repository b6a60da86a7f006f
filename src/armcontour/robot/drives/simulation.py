"""`simulate`: the motion of the nominal robot under a command, with dry friction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ExecutionError
from armcontour.robot.drives._response import spread
from armcontour.robot.drives.drives import Drives
from armcontour.robot.drives.response import linear_along

# Corrections below this [rad], less than the best encoder resolves, end the iteration. What is left
# is a thousandth of them.
EXACT = 1e-9
# Each correction leaves about a thousandth of the one before it.
CORRECTIONS = 40
# How much stiffer than inertia and drive a joint that sticks is held.
HELD = 1e6
# A joint that a correction moves by more than this [rad] runs away.
AWAY = 1e3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulation:
    """A motion of the nominal robot, and how it answers to small torques.

    Args:
        t: Regular times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities, central differences [rad/s], (n, dof).
        ddq: Joint accelerations, second differences [rad/s²], (n, dof).
        friction: Torque of dry friction [N m], (n, dof).
        held: Whether a joint sticks from each time to the next, (n, dof).
        mass: M at the times [kg m²], (n, dof, dof).
        damping: D at the times [N m s/rad], (n, dof, dof).
        stiffness: K at the times [N m/rad], (n, dof, dof).
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    friction: FloatArray
    held: BoolArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray

    @property
    def step(self) -> float:
        """Time between two times [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def to_torque(self, torque: FloatArray) -> FloatArray:
        """Deviations of the joints under small additional torques [rad], from the first time on.

        Joints that stick go on to stick, and friction brakes in the same direction.

        Args:
            torque: Torque at the times for several cases [N m], (n, dof, cases).
        """
        n, dof, _ = torque.shape
        loops, still = (self.mass, self.damping, self.stiffness), np.zeros((n - 1, dof))
        hold = np.where(self.held, HELD, 0.0)
        return spread(*loops, self.step, torque, hold, still, np.zeros(dof))[0]


def simulate(
    drives: Drives,
    command: FloatArray,
    t: FloatArray,
    near: FloatArray,
    *,
    speed: FloatArray | None = None,
    viscous: FloatArray | None = None,
    lag: float = 0.0,
) -> Simulation:
    """The motion of `Drives` under a command, on a grid of times.

    The torques balance in every step of the method of Newmark. The solution is found by
    corrections, each of which is the linear response to the torque that the motion before it lacks.

    Args:
        drives: The nominal robot. Friction is that of its arm.
        command: Command at the times, after interpolation, dead time and `lag` [rad], (n, dof).
        t: Regular times [s], (n,).
        near: A motion near the solution [rad], (n, dof); its first row is where the
            joints start.
        speed: Joint velocities at the first time [rad/s], (dof,); by default zero.
        viscous: Viscous friction instead of that of the arm [N m s/rad], (dof,), of either sign.
        lag: Time by which the torque of the loops comes late [s], such as half a cycle of the
            drives. Small against the loops' time constants.

    Raises:
        ExecutionError: A joint runs away, or friction has no solution.
    """
    step = float((t[-1] - t[0]) / (len(t) - 1))
    chain = drives.arm.dynamics.chain
    coulomb = np.array(chain.coulomb)
    brake = np.asarray(chain.viscous) if viscous is None else viscous
    # What comes late takes inertia and damping away.
    lost_mass, lost_damping = drives.damping * lag, drives.stiffness * lag
    before = near[0] - step * (np.zeros(drives.arm.dof) if speed is None else speed)
    wanted = drives.stiffness * _mean(command, command[0])
    q, free = np.array(near), np.zeros(near.shape)
    for k in range(CORRECTIONS):
        dq, ddq = _rates(q, before, step)
        if k < 2:
            mass, damping, stiffness = linear_along(drives, t, q, dq, ddq)
            mass -= np.diag(lost_mass)
            damping += np.diag(brake - np.asarray(chain.viscous) - lost_damping)
        lacking = wanted - drives.stiffness * _mean(q, before)
        lacking -= (drives.damping + brake - lost_damping) * dq - lost_mass * ddq
        lacking -= drives.inertial_torque(q, dq, ddq)
        loops, moved = (mass, damping, stiffness), np.diff(q, axis=0)
        x, friction = (
            found[:, :, 0]
            for found in spread(*loops, step, lacking[:, :, None], free, moved, coulomb)
        )
        q = q + x
        size = float(np.abs(x).max())
        if not size < AWAY:
            break
        if size <= EXACT:
            dq, ddq = _rates(q, before, step)
            held = np.abs(friction) < coulomb * (1 - 1e-9)
            return Simulation(
                t=checks.frozen_array(t), q=q, dq=dq, ddq=ddq, friction=friction, held=held,
                mass=mass, damping=damping, stiffness=stiffness,
            )  # fmt: skip
    raise ExecutionError(
        f"The motion of {drives.arm.name} cannot be simulated with its servo gains and inertias: "
        f"corrections of {size:.2g} rad remain; look at gains, inertias and units."
    )


def _mean(values: FloatArray, before: FloatArray) -> FloatArray:
    """Weighted means of values and their neighbours, (n, dof)."""
    around = np.concatenate([before[None], values, values[-1:]])
    return np.asarray((around[2:] + 2 * around[1:-1] + around[:-2]) / 4)


def _rates(q: FloatArray, before: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Central first and second differences, the last ones repeated, (n, dof) each."""
    around = np.concatenate([before[None], q, q[-1:]])
    dq = (around[2:] - around[:-2]) / (2 * step)
    ddq = (around[2:] - 2 * around[1:-1] + around[:-2]) / step**2
    dq[-1], ddq[-1] = dq[-2], ddq[-2]
    return dq, ddq
