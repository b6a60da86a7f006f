"""`Response`: how joints deviate from a motion when commands or torques differ a little."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
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

    def of_drives(self, drives: Drives, others: Drives) -> Response:
        """The response with other drives of the same arm, from that with some drives."""
        return replace(
            self,
            damping=self.damping + np.diag(others.damping - drives.damping),
            stiffness=self.stiffness + np.diag(others.stiffness - drives.stiffness),
            gain=others.stiffness,
        )

    def to_torque(self, torque: FloatArray) -> FloatArray:
        """Deviations of the joints under additional torque [rad], same shape as `torque`.

        Args:
            torque: Torque at the times [N m], (n, dof), or (n, dof, cases) for several cases.
        """
        cases = torque if torque.ndim == 3 else torque[:, :, None]
        padded = np.concatenate([cases[:1], cases, cases[-1:]])
        means = (padded[:-2] + 2 * cases + padded[2:]) / 4
        free = np.zeros(self.mass.shape[:2])
        # Copies that can be written to: for locked ones the kernel would be compiled once more.
        loops = (self.mass, self.damping, self.stiffness)
        mass, damping, stiffness = (np.array(x, order="C") for x in loops)
        found, _ = spread(mass, damping, stiffness, self.step, means, free, free[1:], free[0])
        return found.reshape(torque.shape)

    def equations(self) -> csc_array:
        """The matrix A of `A x = S u` for deviations and commands as vectors, time first.

        S is `mean_over_three`. A is lower triangular but for blocks of (dof, dof) on its diagonal.
        The first dof rows say that the joints start in equilibrium at the first command.
        """
        m, d, k = (
            self.mass[:-1] / self.step**2,
            self.damping[:-1] / (2 * self.step),
            self.stiffness[:-1] / 4,
        )
        blocks = np.stack([m - d + k, 2 * k - 2 * m, m + d + k], axis=1)
        gain = self.gain[:, None]
        return _banded(self.stiffness[0] / gain, blocks / gain)


def mean_over_three(count: int, dof: int) -> csc_array:
    """The matrix of means over neighbouring times, for vectors with time first.

    The means of three neighbours, with the weights 1/4, 1/2 and 1/4, follow the first time.
    """
    unit = np.eye(dof)
    means = np.multiply.outer([1 / 4, 1 / 2, 1 / 4], unit)
    return _banded(unit, np.broadcast_to(means, (count - 1, *means.shape)))


def _banded(first: FloatArray, blocks: FloatArray) -> csc_array:
    """The sparse matrix of one block in the first block row and three in each other one.

    Args:
        first: Block of the first row and column, (dof, dof).
        blocks: Blocks by which a time depends on the two times before it and on itself,
            (n - 1, 3, dof, dof).
    """
    from scipy.sparse import bsr_array, csc_array

    n, dof = len(blocks) + 1, len(first)
    # Before the first time the joints are where they are at the first time.
    columns = np.maximum(np.arange(n - 1)[:, None] + [-1, 0, 1], 0)
    values = np.concatenate([first[None], blocks.reshape(-1, dof, dof)])
    row_starts = np.append(0, 1 + 3 * np.arange(n))
    parts = values, np.append(0, columns), row_starts
    found = csc_array(bsr_array(parts, shape=(n * dof, n * dof)))
    found.sum_duplicates()
    found.eliminate_zeros()
    return found


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

    An arm with masses and servos all of order "second" respond as `Drives`, with viscous friction.
    Otherwise every joint responds as its servo, (6), and torques are in units of acceleration
    (order "first": of velocity; "delay" and "unknown": of position). The integrator of a P-PI
    cascade is left out.

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
    if arm.has_bodies and servo.is_plain("second"):
        drives = Drives(arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, known=known)
        mass, damping, stiffness = drives.linear(*(motion(t, order) for order in range(3)))
        gain = drives.stiffness
    else:
        own, shape = servo.for_joints(arm.dof), (len(t), arm.dof, arm.dof)
        one = np.ones(arm.dof)
        kv = one * np.inf if own.kv is None else own.kv
        loop, lag = np.isfinite(kv), np.isfinite(own.kp)
        # Joints that only delay follow the command: x = u.
        gain = np.where(lag, own.kp, 1.0) * np.where(loop, kv, 1.0)
        rows = loop * one, np.where(loop, kv, lag * one), gain
        mass, damping, stiffness = (np.broadcast_to(np.diag(x), shape) for x in rows)
    return Response(t=t, mass=mass, damping=damping, stiffness=stiffness, gain=gain)
