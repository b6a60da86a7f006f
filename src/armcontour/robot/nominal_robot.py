"""Nominal robot: drives with position and velocity loops that move the bodies of an arm.

Compensation and learning use it. Plants verify their results, so they do not use it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter

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
    """Equations `A x = S u + U a` of deviations at successive times.

    x are the joint positions, u the commands, and a the commands that bypass the integrators, such
    as acceleration feed-forward. The equation at a time contains this time and the `width - 1`
    times before it. That of the first time expresses equilibrium at the first command.

    Args:
        left: A, whose last block is that of the equation's own time, (n, width, dof, dof).
        seen: Diagonals of S, which averages commands over neighbouring times, (n, width, dof).
        unseen: Diagonals of U, (n, width, dof); without an integrator equal to S.
    """

    left: FloatArray
    seen: FloatArray
    unseen: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response(Frozen):
    """The closed loop, linearized around a motion: `M x'' + D x' + K x = G u`.

    x is the deviation of the joints, u the deviation of the command at the drives. The joints are
    at rest at the first time. `equations` includes integrators and the drive cycle. M, D and K are
    interpolated linearly between nodes.

    Args:
        t: Regular times [s], (n,).
        nodes: Indices of the nodes in the times, increasing from 0 to n - 1, (m,).
        mass: M at the nodes [kg m²], (m, dof, dof).
        damping: D at the nodes, including the velocity loops [N m s/rad], (m, dof, dof).
        stiffness: K at the nodes, including the position loops [N m/rad], (m, dof, dof).
        gain: Diagonal of G, the torque per command [N m/rad], (dof,).
        servo: The servo of these loops, with one value per joint.
        is_coupled: Whether joints move each other. Otherwise M, D and K are diagonal.
    """

    t: FloatArray
    nodes: IntArray
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    gain: FloatArray
    servo: ServoModel
    is_coupled: bool

    @property
    def step(self) -> float:
        """Step of the regular times [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def groups(self) -> list[IntArray]:
        """Joints that move each other, as arrays of their indices from 0."""
        joints = np.arange(len(self.gain))
        return [joints] if self.is_coupled else list(joints[:, None])

    @property
    def width(self) -> int:
        """Number of successive times in one equation."""
        return 4 if self.servo.ki.any() else 3

    def equations(
        self, first: int = 0, last: int | None = None, joints: IntArray | None = None
    ) -> Equations:
        """Return the loops' equations `A x = S u + U a` in discrete time, of some times and joints.

        Args:
            first: Index of the first time.
            last: Index after the last time; None for all times.
            joints: Indices of the joints, a group of `groups`; None for all joints.
        """
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
        chosen = np.arange(len(self.gain)) if joints is None else joints
        # The filter of an integrator also needs the equation before the first one.
        times = np.arange(first - 1, len(self.t) if last is None else last)
        delay = servo.drive_cycle / 2
        lags = np.isfinite(servo.kp)[chosen]
        kv = np.zeros_like(servo.kp) if servo.kv is None else servo.kv
        loop = (servo.kv is not None) * np.isfinite(kv)[chosen] * 1.0
        # Damping and stiffness of the loops divided by the gain; delay as a fraction of a step.
        kp = np.where(np.isfinite(servo.kp), servo.kp, 1.0)[chosen]
        damping = np.diag(loop / kp)
        stiffness = np.diag(lags * 1.0)
        fraction = lags * delay / self.step
        half = np.full(len(chosen), 0.5)
        means = np.stack([0.25 + fraction / 2, half, 0.25 - fraction / 2])[None]
        seen = _from_rest(np.repeat(means, len(times), axis=0), times, np.ones(len(chosen)))
        mass, slow, stiff = self._interpolated(np.maximum(times - 1, 0), chosen)
        bodies = self._steps(times, mass - delay * damping, slow - delay * stiffness, stiff)
        if not servo.ki.any():
            return Equations(bodies[1:], seen[1:], seen[1:])
        driven = self._steps(times, -delay * damping, damping - delay * stiffness, stiffness)
        filters = [self._integrator_filter(x) for x in servo.ki[chosen]]
        alone, both = (np.array(x) for x in zip(*filters, strict=True))
        left = _filtered(alone, bodies - driven, times) + _filtered(both, driven, times)
        return Equations(left, _filtered(both, seen, times), _filtered(alone, seen, times))

    def _interpolated(self, times: IntArray, joints: IntArray) -> list[FloatArray]:
        """Return mass, damping and stiffness divided by the gain at times, (n, dof, dof) each.

        - `times`: indices of the times, (n,).
        - `joints`: indices of the joints, (dof,).
        """
        node = np.clip(np.searchsorted(self.nodes, times, "right") - 1, 0, len(self.nodes) - 2)
        position = np.interp(times, self.nodes, np.arange(len(self.nodes)))
        fraction = (position - node)[:, None, None]
        parts = []
        for values in (self.mass, self.damping, self.stiffness):
            part = values[:, joints[:, None], joints] / self.gain[joints, None]
            parts.append((1 - fraction) * part[node] + fraction * part[node + 1])
        return parts

    def _integrator_filter(self, ki: float) -> tuple[FloatArray, FloatArray]:
        """Return numerator and denominator, in z, of a joint's filter for its integrator gain."""
        if ki:
            return integrator_filter(ki, self.step, self.servo.drive_cycle)
        # Without an integrator, the filter does not change its input.
        unfiltered = np.array([1.0, 0.0])
        return unfiltered, unfiltered

    def _steps(
        self, times: IntArray, mass: FloatArray, damping: FloatArray, stiffness: FloatArray
    ) -> FloatArray:
        """Return the blocks of `M x'' + D x' + K x`, (n, 3, dof, dof); at the first time of K x."""
        m = mass / self.step**2
        d = damping / (2 * self.step)
        k = stiffness / 4
        shape = (len(times), *stiffness.shape[-2:])
        blocks = [np.broadcast_to(x, shape) for x in (m - d + k, 2 * k - 2 * m, m + d + k)]
        first = np.broadcast_to(stiffness, shape)[np.searchsorted(times, 0)]
        return _from_rest(np.stack(blocks, axis=1), times, first)


def _from_rest(blocks: FloatArray, times: IntArray, first: FloatArray) -> FloatArray:
    """Return blocks, (n, 3, ...), of joints that rest at their first positions before time 0.

    - `times`: indices of the times, (n,).
    - `first`: block of the equation at the first time.
    """
    blocks[times <= 0] = 0.0
    blocks[times == 0, 2] = first
    blocks[times == 1, 1] += blocks[times == 1, 0]
    blocks[times == 1, 0] = 0.0
    return blocks


def _filtered(weights: FloatArray, blocks: FloatArray, times: IntArray) -> FloatArray:
    """Filter equations in time by joint; return all but the first, (n - 1, 4, ...).

    - `weights`: weights of present and previous values, (dof, 2).
    - `blocks`: blocks of the equations, (n, 3, ...).
    - `times`: indices of their times, (n,).
    """
    shape = (1, 1, len(weights), *[1] * (blocks.ndim - 3))
    now = np.repeat(weights[:, 0].reshape(shape), len(times) - 1, axis=0)
    # The robot is at rest before the first time, so a filter with zero DC gain has the output 0
    # there.
    is_zero = weights.sum(axis=1) == 0.0
    now[times[1:] == 0] += (weights[:, 1] * is_zero).reshape(shape[1:])
    filtered = np.zeros((len(times) - 1, 4, *blocks.shape[2:]))
    filtered[:, 1:] = now * blocks[1:]
    filtered[:, :3] += weights[:, 1].reshape(shape) * blocks[:-1]
    return filtered


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
    is_coupled = arm.has_bodies and servo.is_plain("second")
    if is_coupled:
        drives = Drives(
            arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, controller=controller
        )
        count = max(int((t[-1] - t[0]) / LINEARIZATION_TIME), 1)
        nodes = np.linspace(0, len(t) - 1, count + 1).astype(np.intp)
        linear = drives.linear(*(motion(t[nodes], order) for order in range(3)))
        gain = drives.stiffness
    else:
        one = np.ones(arm.dof)
        kv = one * np.inf if joint_servo.kv is None else joint_servo.kv
        loop = np.isfinite(kv)
        lag = np.isfinite(joint_servo.kp)
        # Joints with a pure delay follow the command: x = u.
        gain = np.where(lag, joint_servo.kp, 1.0) * np.where(loop, kv, 1.0)
        nodes = np.array([0, len(t) - 1])
        rows = loop * one, np.where(loop, kv, lag * one), gain
        mass, damping, stiffness = (np.stack([np.diag(x)] * 2) for x in rows)
        linear = mass, damping, stiffness
    return Response(
        t=t,
        nodes=nodes,
        mass=linear[0],
        damping=linear[1],
        stiffness=linear[2],
        gain=gain,
        servo=joint_servo,
        is_coupled=is_coupled,
    )
