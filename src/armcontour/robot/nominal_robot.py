"""Nominal robot: drives with position and velocity loops that move the bodies of an arm.

Compensation and learning use it. Plants verify their results, so they do not use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Frozen
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# Below this speed [rad/s] Coulomb friction is proportional to the speed, because a joint at rest
# has velocities of either sign due to rounding. A reversing joint passes this range in less than a
# cycle.
CREEP = 1e-3
# The motion is linearized at times this far apart [s], with interpolation between them, because the
# dynamics change slowly.
LINEARIZATION_TIME = 10e-3
# A motion: joint positions, velocities or accelerations (order 0, 1, 2) at times, (n, dof).
Motion = Callable[[FloatArray, int], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Drives:
    """The drives of an arm with masses: `tau = J K_v (K_p (u - q) - dq) + g(q)`.

    With an integrator, K_v is `K_v (1 + k_i / s)`. u is the command after dead time and
    interpolation. g is the gravity torque that the controller feeds forward; it is computed from
    the controller's model of the arm.

    Args:
        arm: The nominal arm, with masses.
        servo: Servo of order "second".
        gravity_feedforward: Whether the controller adds the gravity torque.
        controller: The controller's model of the arm, used for g and J, for example without a
            payload that was identified later. By default the arm itself.

    Attributes:
        inertia: J: the inertia of the servo if known, otherwise the nominal inertia of
            `controller_arm` [kg m²], (dof,).
        damping: J K_v [N m s/rad], (dof,).
        stiffness: J K_v K_p [N m/rad], (dof,).

    Raises:
        InvalidInput: An arm has no masses, the servo is of first order, or joints differ in number.
    """

    arm: Arm
    servo: ServoModel
    gravity_feedforward: bool = True
    controller: Arm | None = None
    inertia: FloatArray = field(init=False)
    damping: FloatArray = field(init=False)
    stiffness: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        servo = self.servo.for_joints(self.arm.dof)
        servo.check_orders("The inverse dynamics of rigid bodies", integrator=True)
        assert servo.kv is not None
        if self.controller is not None and self.controller.dof != self.arm.dof:
            raise ArmMismatch(
                f"The arm {self.arm.name} has {self.arm.dof} joints, but the controller's model of "
                f"the arm has {self.controller.dof}."
            )
        inertia = nominal_inertia(self.controller_arm) if servo.inertia is None else servo.inertia
        object.__setattr__(self, "servo", servo)
        object.__setattr__(self, "inertia", checks.frozen_array(inertia))
        object.__setattr__(self, "damping", checks.frozen_array(inertia * servo.kv))
        object.__setattr__(self, "stiffness", checks.frozen_array(inertia * servo.kv * servo.kp))

    @property
    def controller_arm(self) -> Arm:
        """The controller's model of the arm."""
        return self.arm if self.controller is None else self.controller

    def command(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray, step: float = np.inf
    ) -> FloatArray:
        """Return the command u with which the drives execute a motion [rad], (n, dof).

        `u = q + dq / K_p + tau / (J K_v K_p)`, where tau is `moving_torque` without the part that
        the integrators supply. At the first time, the integrators supply the whole torque.

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof).
            step: Time between two rows, which integrators need [s]; by default infinite, which
                means that the rows are steady states.
        """
        torque = self.moving_torque(q, dq, ddq)
        if self.servo.ki.any():
            from scipy.signal import lfilter

        for j in np.flatnonzero(self.servo.ki):
            coefficients = integrator_filter(self.servo.ki[j], step, 0.0)
            torque[:, j] = lfilter(*coefficients, torque[:, j] - torque[0, j])
        return np.asarray(q + dq / self.servo.kp + torque / self.stiffness)

    def moving_torque(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """Return the torque that the drives' loops supply in a motion [N m], (n, dof).

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof).
        """
        # The torque includes inertia, coupling, Coriolis and centrifugal torques, payload,
        # friction, and the gravity torque that the controller does not feed forward. Coulomb
        # friction is `coulomb sign(dq)`, except for joints slower than `CREEP`.
        chain = self.arm.dynamics.chain
        torque = self.arm.dynamics.torque(q, dq, ddq)
        if self.gravity_feedforward:
            torque = torque - self.controller_arm.dynamics.gravity(q)
        torque = torque + np.asarray(chain.viscous) * dq
        torque += np.asarray(chain.coulomb) * np.clip(dq / CREEP, -1.0, 1.0)
        return torque

    def linear(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Linearize the loops: return mass, damping and stiffness, (n, dof, dof) each.

        The damping includes viscous friction.

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof).
        """
        fed = self.gravity_feedforward
        differs = self.controller is not None
        # The gravity torque that the controller feeds forward cancels the arm's gravity torque.
        stiffness, damping, mass = self.arm.dynamics.derivatives(
            q, dq, ddq, gravity=differs or not fed
        )
        if fed and differs:
            still = np.zeros_like(q)
            stiffness = stiffness - self.controller_arm.dynamics.derivatives(q, still, still)[0]
        viscous = np.asarray(self.arm.dynamics.chain.viscous)
        return mass, damping + np.diag(self.damping + viscous), stiffness + np.diag(self.stiffness)


def nominal_inertia(arm: Arm) -> FloatArray:
    """Return each joint's nominal inertia with its drive, from the masses of `arm` [kg m²]."""
    # The inertia is the diagonal of the mass matrix in the middle of the joint ranges, without
    # payload.
    from armcontour.robot.dynamics import Dynamics

    chain = arm.dynamics.chain
    bare = arm.dynamics if chain.payload is None else Dynamics(chain.replace(payload=None))
    inertia = np.diagonal(bare.mass_matrix(arm.limits.middle(arm.dof))).copy()
    if (inertia <= 0).any():
        j = int(np.argmin(inertia))
        raise InvalidInput(
            f"Joint {j + 1} ({chain.joints[j]}) moves no inertia. Specify mass and inertia of the "
            "link after the joint, or the armature of its drive."
        )
    return inertia


class Equations(NamedTuple):
    """Equations `A x = S u + U a` of deviations; vectors are ordered by time, then by joint.

    x are the joint positions, u the commands, and a the commands that bypass the integrators, such
    as acceleration feed-forward. The first rows of A express equilibrium at the first command.

    Args:
        left: A, lower triangular except for (dof, dof) blocks on its diagonal.
        seen: S, which averages commands over neighbouring times.
        unseen: U; without an integrator equal to S.
    """

    left: csc_array
    seen: csc_array
    unseen: csc_array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response(Frozen):
    """The closed loop, linearized around a motion: `M x'' + D x' + K x = G u`.

    x is the deviation of the joints, u the deviation of the command at the drives. The joints are
    at rest at the first time. `equations` includes integrators and the drive cycle.

    Args:
        t: Regular times [s], (n,).
        mass: M at the times [kg m²], (n, dof, dof).
        damping: D at the times, including the velocity loops [N m s/rad], (n, dof, dof).
        stiffness: K at the times, including the position loops [N m/rad], (n, dof, dof).
        gain: Diagonal of G, the torque per command [N m/rad], (dof,).
        servo: The servo of these loops, with one value per joint.
    """

    t: FloatArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    gain: FloatArray
    servo: ServoModel

    @property
    def step(self) -> float:
        """Step of the regular times [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def equations(self) -> Equations:
        """Return the loops' equations `A x = S u + U a` in discrete time."""
        # Newmark's method with constant mean acceleration (second order, unconditionally stable):
        #
        #     M (x[k+1] - 2 x[k] + x[k-1]) / h² + D (x[k+1] - x[k-1]) / (2 h) + K m(x) = G m(u)
        #     m(x) = (x[k+1] + 2 x[k] + x[k-1]) / 4
        #
        # A cycle T delays the torque of the loops by T / 2 on average, which reduces the mass by
        # `D T / 2` and the damping by `K T / 2`. This is exact for steps of T and joints without
        # other torques. An integrator is a first-order filter of the loop torque; its inverse
        # filters the torque of the bodies.
        servo = self.servo
        delay = self.servo.drive_cycle / 2
        lags = np.isfinite(servo.kp)
        loop = np.zeros_like(servo.kp) if servo.kv is None else np.isfinite(servo.kv) * 1.0
        # Damping and stiffness of the loops divided by the gain; delay as a fraction of a step.
        loops = loop / np.where(lags, servo.kp, 1.0), lags * 1.0
        fraction = lags * delay / self.step
        before, after = (np.diag(0.25 + x * fraction / 2) for x in (1, -1))
        unit = np.eye(len(loop))
        shape = (len(self.t) - 1, 3, len(loop), len(loop))
        means = _banded(unit, np.broadcast_to([before, unit / 2, after], shape))
        damping, stiffness = (np.diag(x) for x in loops)
        gain = self.gain[:, None]
        mass, slow, stiff = (x / gain for x in (self.mass, self.damping, self.stiffness))
        mass = mass - delay * damping
        slow = slow - delay * stiffness
        if not servo.ki.any():
            return Equations(self._steps(mass, slow, stiff), means, means)
        loop_terms = -delay * damping, damping - delay * stiffness, stiffness
        driven = self._steps(*(np.broadcast_to(x, mass.shape) for x in loop_terms))
        bodies = self._steps(mass, slow, stiff) - driven
        filters = [self._integrator_filter(x) for x in servo.ki]
        alone, both = (self._filters(np.array(x)) for x in zip(*filters, strict=True))
        return Equations(alone @ bodies + both @ driven, both @ means, alone @ means)

    def _integrator_filter(self, ki: float) -> tuple[FloatArray, FloatArray]:
        """Return numerator and denominator, in z, of a joint's filter for its integrator gain."""
        if ki:
            return integrator_filter(ki, self.step, self.servo.drive_cycle)
        # Without an integrator, the filter does not change its input.
        unfiltered = np.array([1.0, 0.0])
        return unfiltered, unfiltered

    def _filters(self, weights: FloatArray) -> csc_array:
        """Make the matrix of joint filters from the weights of present and previous values."""
        from scipy.sparse import csc_array, diags_array

        now, before = np.tile(weights.T[:, None], (1, len(self.t), 1))
        # The robot is at rest before the first time, so a filter with zero DC gain has the output 0
        # there.
        now[0] += weights[:, 1] * (weights.sum(axis=1) == 0.0)
        dof = len(weights)
        return csc_array(diags_array([now.ravel(), before[1:].ravel()], offsets=[0, -dof]))

    def _steps(self, mass: FloatArray, damping: FloatArray, stiffness: FloatArray) -> csc_array:
        """Return the matrix of `M x'' + D x' + K x`; at the first time of `K x` alone."""
        m = mass[:-1] / self.step**2
        d = damping[:-1] / (2 * self.step)
        k = stiffness[:-1] / 4
        return _banded(stiffness[0], np.stack([m - d + k, 2 * k - 2 * m, m + d + k], axis=1))


def _banded(first: FloatArray, blocks: FloatArray) -> csc_array:
    """Make a sparse matrix with one block in the first block row and three in each other row."""
    from scipy.sparse import bsr_array, csc_array

    n = len(blocks) + 1
    dof = len(first)
    # Before the first time the joints rest at their first positions.
    columns = np.maximum(np.arange(n - 1)[:, None] + [-1, 0, 1], 0)
    values = np.concatenate([first[None], blocks.reshape(-1, dof, dof)])
    row_starts = np.append(0, 1 + 3 * np.arange(n))
    parts = values, np.append(0, columns), row_starts
    matrix = csc_array(bsr_array(parts, shape=(n * dof, n * dof)))
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix


def linear_along(
    drives: Drives, t: FloatArray, q: FloatArray, dq: FloatArray, ddq: FloatArray
) -> list[FloatArray]:
    """Return mass, damping and stiffness of `Drives.linear` at all times, (n, dof, dof) each.

    Args:
        drives: The drives.
        t: Times of the motion [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities [rad/s], (n, dof).
        ddq: Joint accelerations [rad/s²], (n, dof).
    """
    count = max(int((t[-1] - t[0]) / LINEARIZATION_TIME), 1)
    rows = np.linspace(0, len(t) - 1, count + 1).astype(np.intp)
    position = np.interp(np.arange(len(t)), rows, np.arange(len(rows)))
    before = np.minimum(position.astype(np.intp), len(rows) - 2)
    fraction = (position - before)[:, None, None]
    linear = drives.linear(q[rows], dq[rows], ddq[rows])
    return [(1 - fraction) * x[before] + fraction * x[before + 1] for x in linear]


def respond_along(
    motion: Motion,
    t: FloatArray,
    arm: Arm,
    servo: ServoModel,
    *,
    gravity_feedforward: bool = True,
    controller: Arm | None = None,
) -> Response:
    """Linearize the nominal robot around a motion.

    If the arm has masses and the servos are of second order, the robot responds as `Drives`, with
    viscous friction. Otherwise every joint responds as its servo, (6), and torques are in units of
    acceleration (order "first": velocity; "delay" and "unknown": position).

    Args:
        motion: Joint positions, velocities and accelerations of the motion at times, by order.
        t: Regular times, from rest [s], (n,).
        arm: The nominal arm.
        servo: The nominal servo.
        gravity_feedforward: Whether the controller adds the gravity torque.
        controller: The controller's model of the arm, as in `Drives`.

    Raises:
        InvalidInput: The gains do not fit the arm.
    """
    joint_servo = servo.for_joints(arm.dof)
    if arm.has_bodies and servo.is_plain("second"):
        drives = Drives(
            arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, controller=controller
        )
        rates = (motion(t, order) for order in range(3))
        mass, damping, stiffness = linear_along(drives, t, *rates)
        gain = drives.stiffness
    else:
        shape = len(t), arm.dof, arm.dof
        one = np.ones(arm.dof)
        kv = one * np.inf if joint_servo.kv is None else joint_servo.kv
        loop = np.isfinite(kv)
        lag = np.isfinite(joint_servo.kp)
        # Joints with a pure delay follow the command: x = u.
        gain = np.where(lag, joint_servo.kp, 1.0) * np.where(loop, kv, 1.0)
        rows = loop * one, np.where(loop, kv, lag * one), gain
        mass, damping, stiffness = (np.broadcast_to(np.diag(x), shape) for x in rows)
    return Response(
        t=t, mass=mass, damping=damping, stiffness=stiffness, gain=gain, servo=joint_servo
    )
