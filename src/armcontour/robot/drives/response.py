"""`Response`: how joints deviate from a motion when commands or torques differ a little."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.fields import Checked
from armcontour.robot import Arm
from armcontour.robot.drives._response import spread
from armcontour.robot.drives.drives import Drives
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# The linear response is that of the motion at times this far apart [s], and interpolated: arms
# hardly change between them.
APART = 10e-3
# A motion: joint positions, velocities or accelerations (order 0, 1, 2) at times, (n, dof).
Motion = Callable[[FloatArray, int], FloatArray]


class Equations(NamedTuple):
    """The equations `A x = S u + U a` of deviations, with vectors of all times, time first.

    u are commands, and a commands that the integrators do not see, such as acceleration
    feed-forward; without an integrator, S = U. The first rows of A say that the joints start in
    equilibrium at the first command; A is lower triangular but for blocks of (dof, dof) on its
    diagonal. S takes means over neighbouring times.
    """

    left: csc_array
    seen: csc_array
    unseen: csc_array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response(Checked):
    """The closed loop, linear around a motion: `M x'' + D x' + K x = G u + f`.

    x is the deviation of the joints, u that of the command that reaches the drives, f additional
    torque. The joints are at rest at the first time. Times are discrete, as in `_response.spread`,
    and torques are means over neighbouring times, with the weights 1/4, 1/2 and 1/4. Integrators
    and a cycle of the drives count in `equations` only.

    Args:
        t: Regular times [s], (n,).
        mass: M at the times [kg m²], (n, dof, dof).
        damping: D at the times, with that of the velocity loops [N m s/rad], (n, dof, dof).
        stiffness: K at the times, with that of the position loops [N m/rad], (n, dof, dof).
        gain: Diagonal of G, the torque per command [N m/rad], (dof,).
        servo: The servo of these loops, with values per joint.
    """

    t: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    gain: FloatArray
    servo: ServoModel

    @property
    def step(self) -> float:
        """Time between two times [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def of_drives(self, drives: Drives, others: Drives, every: int) -> Response:
        """The response with other drives of the same arm, from that with some drives.

        Args:
            drives: The drives of this response.
            others: The other drives.
            every: Only every so many times are used.
        """
        return replace(
            self,
            t=self.t[::every],
            mass=self.mass[::every],
            damping=self.damping[::every] + np.diag(others.damping - drives.damping),
            stiffness=self.stiffness[::every] + np.diag(others.stiffness - drives.stiffness),
            gain=others.stiffness,
            servo=others.servo,
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

    def equations(self) -> Equations:
        """The equations `A x = S u + U a` of the loops in discrete time.

        A cycle T delays the torque of the loops by T / 2 on average, which takes `D T / 2` of the
        mass and `K T / 2` of the damping away. Where times are T apart, and for joints that have no
        other torques, this is exact. An integrator is a filter of first order, which multiplies
        what the loops give and divides what the bodies need.
        """
        servo, late = self.servo, self.servo.drive_cycle / 2
        lags = np.isfinite(servo.kp)
        loop = np.zeros_like(servo.kp) if servo.kv is None else np.isfinite(servo.kv) * 1.0
        # What the loops give, and the share of a step by which it is late.
        loops = loop / np.where(lags, servo.kp, 1.0), lags * 1.0
        share = lags * late / self.step
        before, after = (np.diag(0.25 + x * share / 2) for x in (1, -1))
        unit, shape = np.eye(len(loop)), (len(self.t) - 1, 3, len(loop), len(loop))
        means = _banded(unit, np.broadcast_to([before, unit / 2, after], shape))
        damping, stiffness = (np.diag(x) for x in loops)
        gain = self.gain[:, None]
        mass, slow, stiff = (x / gain for x in (self.mass, self.damping, self.stiffness))
        mass, slow = mass - late * damping, slow - late * stiffness
        if not servo.ki.any():
            return Equations(self._steps(mass, slow, stiff), means, means)
        own = -late * damping, damping - late * stiffness, stiffness
        driven = self._steps(*(np.broadcast_to(x, mass.shape) for x in own))
        bodies = self._steps(mass, slow, stiff) - driven
        filters = [
            integrator_filter(x, self.step, servo.drive_cycle)
            if x
            else (np.eye(2)[0], np.eye(2)[0])
            for x in servo.ki
        ]
        alone, both = (self._filters(np.array(x)) for x in zip(*filters, strict=True))
        return Equations(alone @ bodies + both @ driven, both @ means, alone @ means)

    def _filters(self, weights: FloatArray) -> csc_array:
        """The matrix of a filter of each joint, by the weights of a value and of that before it."""
        from scipy.sparse import csc_array, diags_array

        now, before = np.tile(weights.T[:, None], (1, len(self.t), 1))
        # At rest before the first time, a filter without the weight of a constant gives nothing.
        now[0] += weights[:, 1] * (weights.sum(axis=1) == 0.0)
        dof = len(weights)
        return csc_array(diags_array([now.ravel(), before[1:].ravel()], offsets=[0, -dof]))

    def _steps(self, mass: FloatArray, damping: FloatArray, stiffness: FloatArray) -> csc_array:
        """The matrix of `M x'' + D x' + K x` at all times but the first, where it is `K x`."""
        m, d, k = mass[:-1] / self.step**2, damping[:-1] / (2 * self.step), stiffness[:-1] / 4
        return _banded(stiffness[0], np.stack([m - d + k, 2 * k - 2 * m, m + d + k], axis=1))


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


def linear_along(
    drives: Drives, t: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray
) -> list[FloatArray]:
    """Mass, damping and stiffness at the times, interpolated, (n, dof, dof) each."""
    rows = np.linspace(0, len(t) - 1, max(int((t[-1] - t[0]) / APART), 1) + 1).astype(np.intp)
    place = np.interp(np.arange(len(t)), rows, np.arange(len(rows)))
    before = np.minimum(place.astype(np.intp), len(rows) - 2)
    share = (place - before)[:, None, None]
    linear = drives.linear(q[rows], dq[rows], ddq[rows])
    return [(1 - share) * x[before] + share * x[before + 1] for x in linear]


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
    (order "first": of velocity; "delay" and "unknown": of position).

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
    own = servo.for_joints(arm.dof)
    if arm.has_bodies and servo.is_plain("second"):
        drives = Drives(arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, known=known)
        rates = (motion(t, order) for order in range(3))
        mass, damping, stiffness = linear_along(drives, t, *rates)
        gain = drives.stiffness
    else:
        shape = len(t), arm.dof, arm.dof
        one = np.ones(arm.dof)
        kv = one * np.inf if own.kv is None else own.kv
        loop, lag = np.isfinite(kv), np.isfinite(own.kp)
        # Joints that only delay follow the command: x = u.
        gain = np.where(lag, own.kp, 1.0) * np.where(loop, kv, 1.0)
        rows = loop * one, np.where(loop, kv, lag * one), gain
        mass, damping, stiffness = (np.broadcast_to(np.diag(x), shape) for x in rows)
    return Response(t=t, mass=mass, damping=damping, stiffness=stiffness, gain=gain, servo=own)
