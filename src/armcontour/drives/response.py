"""`Response`: how joints deviate from a motion when commands or torques differ a little."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.drives._response import spread
from armcontour.drives.drives import Drives
from armcontour.servo import ServoModel

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# A motion: joint positions, velocities or accelerations (order 0, 1, 2) at times, (n, dof).
Motion = Callable[[FloatArray, int], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response:
    """The closed loop, linear around a motion: `M x'' + D x' + K x = G u + f`.

    x is the deviation of the joints, u that of the command that reaches the drives, f additional
    torque. The joints are at rest at the first time. Times are discrete, as in `_response.spread`,
    and torques are means over neighbouring times, with the weights 1/4, 1/2 and 1/4.

    Args:
        t: Regular times [s], (n,).
        mass: M at the times [kg m²], (n, dof, dof).
        damping: D at the times, with that of the velocity loops [N m s/rad], (n, dof, dof).
        stiffness: K at the times, with that of the position loops [N m/rad], (n, dof, dof).
        gain: Diagonal of G, the torque per command [N m/rad], (dof,).
    """

    t: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    gain: FloatArray

    def __post_init__(self) -> None:
        for name in ("t", "mass", "damping", "stiffness", "gain"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    @property
    def step(self) -> float:
        """Time between two times [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def to_torque(self, torque: FloatArray) -> FloatArray:
        """Deviations of the joints under additional torque [rad], same shape as `torque`.

        Args:
            torque: Torque at the times [N m], (n, dof), or (n, dof, cases) for several cases.
        """
        cases = torque if torque.ndim == 3 else torque[:, :, None]
        padded = np.concatenate([cases[:1], cases, cases[-1:]])
        means = (padded[:-2] + 2 * cases + padded[2:]) / 4
        free = np.zeros(self.mass.shape[:2], dtype=np.bool_)
        # Copies that can be written to: for locked ones the kernel would be compiled once more.
        mass, damping, stiffness = (np.array(x) for x in (self.mass, self.damping, self.stiffness))
        found = spread(mass, damping, stiffness, self.step, means, free)
        return np.asarray(found.reshape(torque.shape))

    def to_command(self, command: FloatArray) -> FloatArray:
        """Deviations of the joints under another command [rad], same shape as `command`.

        Args:
            command: Deviation of the command at the times [rad], (n, dof) or (n, dof, cases).
        """
        gain = self.gain[:, None] if command.ndim == 3 else self.gain
        return self.to_torque(command * gain)

    def equations(self) -> tuple[csc_array, csc_array]:
        """The matrices of `A x = S f` for deviations and torques as vectors, time first.

        A is lower triangular but for blocks of (dof, dof) on its diagonal. The first dof rows say
        that the joints start at rest.
        """
        from scipy.sparse import csc_array

        n, dof = len(self.t), len(self.gain)
        m, d, k = (
            self.mass[:-1] / self.step**2,
            self.damping[:-1] / (2 * self.step),
            self.stiffness[:-1] / 4,
        )
        # Before the first time the joints are where they are at the first time.
        earlier = np.maximum(np.arange(n - 1) - 1, 0)
        ahead, here = np.arange(1, n), np.arange(n - 1)
        left = _blocks([(m + d + k, ahead), (2 * k - 2 * m, here), (m - d + k, earlier)], n, dof)
        unit = np.broadcast_to(np.eye(dof), (n - 1, dof, dof))
        right = _blocks([(unit / 4, ahead), (unit / 2, here), (unit / 4, earlier)], n, dof)
        rest = np.arange(dof)
        first = csc_array((np.ones(dof), (rest, rest)), shape=(n * dof, n * dof))
        return csc_array(left + first), right


def _blocks(blocks: list[tuple[FloatArray, IntArray]], n: int, dof: int) -> csc_array:
    """A sparse matrix of blocks (n - 1, dof, dof) in the block rows 1 to n - 1.

    Args:
        blocks: Blocks, and their block columns, (n - 1,).
        n: Number of times.
        dof: Number of joints.
    """
    from scipy.sparse import csc_array

    inner = np.arange(dof)
    down = np.arange(1, n)[:, None, None] * dof + inner[:, None]
    rows = np.concatenate([np.broadcast_to(down, x.shape).ravel() for x, _ in blocks])
    columns = np.concatenate(
        [np.broadcast_to(c[:, None, None] * dof + inner, x.shape).ravel() for x, c in blocks]
    )
    values = np.concatenate([np.ravel(x) for x, _ in blocks])
    return csc_array((values, (rows, columns)), shape=(n * dof, n * dof))


def regular_times(start: float, end: float, longest: float) -> FloatArray:
    """Regular times from `start` to `end` with at most `longest` between two of them [s], (n,)."""
    count = max(int(np.ceil((end - start) / longest * (1 - 1e-12))), 1)
    return np.linspace(start, end, count + 1)


def respond_along(
    motion: Motion,
    t: FloatArray,
    arm: Arm,
    servo: ServoModel,
    *,
    gravity_feedforward: bool = True,
    known: Arm | None = None,
) -> Response:
    """The response of the nominal robot around a motion.

    An arm with masses and a servo of order "second" respond as `Drives`, with viscous friction.
    Otherwise every joint responds as its servo, (6), and torques are in units of acceleration
    (order "first": of velocity).

    Args:
        motion: Joint positions, velocities and accelerations of the motion at times, by order.
        t: Regular times, from rest [s], (n,).
        arm: The nominal arm.
        servo: The nominal servo.
        gravity_feedforward: Whether the controller adds the gravity torque.
        known: The arm as its controller knows it, as in `Drives`.

    Raises:
        InvalidInput: The gains do not fit the arm.
    """
    if arm.has_bodies and servo.kv is not None:
        drives = Drives(arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, known=known)
        return _of_drives(drives, motion, t)
    return _of_servo(servo.for_joints(arm.dof), t)


def _of_drives(drives: Drives, motion: Motion, t: FloatArray) -> Response:
    """The response of drives that move bodies."""
    q, fed = motion(t, 0), drives.gravity_feedforward
    by_position, by_velocity, mass = drives.arm.dynamics.derivatives(
        q, motion(t, 1), motion(t, 2), gravity=not fed or drives.known is not None
    )
    if fed and drives.known is not None:
        still = np.zeros_like(q)
        by_position = by_position - drives.known.dynamics.derivatives(q, still, still)[0]
    chain = drives.arm.dynamics.chain
    return Response(
        t=t,
        mass=mass,
        damping=by_velocity + np.diag(drives.damping + np.asarray(chain.viscous)),
        stiffness=by_position + np.diag(drives.stiffness),
        gain=drives.stiffness,
    )


def _of_servo(servo: ServoModel, t: FloatArray) -> Response:
    """The response of servos, each of one joint by itself."""
    dof, n = len(servo.kp), len(t)
    one = np.ones(dof)
    if servo.kv is None:
        diagonals = 0 * one, one, servo.kp
    else:
        diagonals = one, servo.kv, servo.kv * servo.kp
    mass, damping, stiffness = (np.broadcast_to(np.diag(x), (n, dof, dof)) for x in diagonals)
    return Response(t=t, mass=mass, damping=damping, stiffness=stiffness, gain=diagonals[2])
