"""`Response` and `simulate`: linear response and motion of the nominal robot, with dry friction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ExecutionError
from armcontour.core.fields import Checked
from armcontour.core.kernels import compiled
from armcontour.robot import Arm
from armcontour.robot.drives.drives import Drives
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter

if TYPE_CHECKING:
    from scipy.sparse import csc_array

# Friction torques of coupled joints are computed joint by joint until none changes by more than
# this fraction of the largest Coulomb torque. A few iterations suffice because the drives dominate
# the coupling.
EXACT = 1e-10
ROUNDS = 60


class LinearLoops(NamedTuple):
    """Coefficients of the loops `M x'' + D x' + K x` of all joints, (n, dof, dof) each."""

    mass: FloatArray  # M [kg m²]
    damping: FloatArray  # D [N m s/rad]
    stiffness: FloatArray  # K [N m/rad]


@compiled()
def simulate_deviations(
    loops: LinearLoops,
    step: float,
    torque: FloatArray,
    hold: FloatArray,
    moved: FloatArray,
    coulomb: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Simulate deviations from a motion under torques, starting at rest, with dry friction."""
    # Newmark's method with constant mean acceleration (second order, unconditionally stable):
    #
    #     M (x[k+1] - 2 x[k] + x[k-1]) / h² + D (x[k+1] - x[k-1]) / (2 h) + K mean(x) = f[k]
    #     mean(x) = (x[k+1] + 2 x[k] + x[k-1]) / 4
    #
    # Friction brakes a moving joint with the Coulomb torque, and holds a joint at rest with a
    # torque of at most this size.
    # step: h [s]. torque: f, averaged around the times [N m], (n, dof, cases). hold: additional
    # stiffness of a sticking joint in each step, as a multiple of `M / h² + D / (2 h) + K / 4`,
    # (n, dof); 0 for other joints. moved: displacement of the motion in each step [rad],
    # (n - 1, dof). coulomb: Coulomb torques [N m], (dof,).
    # Returns deviations [rad] and friction torques in each step [N m], (n, dof, cases) each.
    n, dof, cases = torque.shape
    deviations, friction = np.zeros((n, dof, cases)), np.zeros((n, dof, cases))
    right, free, enough = np.zeros(dof), np.zeros(dof), EXACT * coulomb.max()
    for k in range(n - 1):
        m, d = loops.mass[k] / step**2, loops.damping[k] / (2 * step)
        s = loops.stiffness[k] / 4
        ahead, present, before = m + d + s, 2 * m - 2 * s, m - d + s
        for i in range(dof):
            extra = hold[k, i] * ahead[i, i]
            ahead[i, i] += extra
            present[i, i] += extra
        inverse, earlier = np.linalg.inv(ahead), max(k - 1, 0)
        for c in range(cases):
            brake = friction[k, :, c]
            brake[:] = friction[earlier, :, c]
            for i in range(dof):
                right[i] = torque[k, i, c]
                for j in range(dof):
                    right[i] += (
                        present[i, j] * deviations[k, j, c]
                        - before[i, j] * deviations[earlier, j, c]
                    )
            for i in range(dof):
                free[i] = 0.0
                for j in range(dof):
                    free[i] += inverse[i, j] * right[j]
            for _ in range(ROUNDS):
                change = 0.0
                for i in range(dof):
                    # Remaining motion of the joint, and the friction torque that stops it.
                    slip = moved[k, i] + free[i] - deviations[k, i, c]
                    for j in range(dof):
                        slip -= inverse[i, j] * brake[j]
                    required = brake[i] + slip / inverse[i, i]
                    new = min(max(required, -coulomb[i]), coulomb[i])
                    change = max(change, abs(new - brake[i]))
                    brake[i] = new
                if change <= enough:
                    break
            for i in range(dof):
                deviations[k + 1, i, c] = free[i]
                for j in range(dof):
                    deviations[k + 1, i, c] -= inverse[i, j] * brake[j]
    friction[n - 1] = friction[max(n - 2, 0)]
    return deviations, friction


# The motion is linearized at times this far apart [s], with interpolation between them, because the
# dynamics change slowly.
APART = 10e-3
# A motion: joint positions, velocities or accelerations (order 0, 1, 2) at times, (n, dof).
Motion = Callable[[FloatArray, int], FloatArray]


class Equations(NamedTuple):
    """Equations `A x = S u + U a` of deviations; vectors are ordered by time, then by joint."""

    # u: commands. a: commands that bypass the integrators, such as acceleration feed-forward;
    # without an integrator, S = U. The first rows of A express equilibrium at the first command. A
    # is lower triangular except for blocks of (dof, dof) on its diagonal. S averages over
    # neighbouring times.

    left: csc_array
    seen: csc_array
    unseen: csc_array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Response(Checked):
    """The closed loop, linearized around a motion: `M x'' + D x' + K x = G u + f`.

    x is the deviation of the joints, u the deviation of the command at the drives, f an additional
    torque. The joints are at rest at the first time. Time is discrete, as in `simulate_deviations`,
    and torques are averaged over neighbouring times with the weights 1/4, 1/2 and 1/4. Only
    `equations` includes integrators and the drive cycle.

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

    def to_torque(self, torque: FloatArray) -> FloatArray:
        """Deviations of the joints [rad] under an additional torque [N m], (n, dof[, cases])."""
        cases = torque if torque.ndim == 3 else torque[:, :, None]
        padded = np.concatenate([cases[:1], cases, cases[-1:]])
        means = (padded[:-2] + 2 * cases + padded[2:]) / 4
        free = np.zeros(self.mass.shape[:2])
        # The copies are writable, because Numba would compile the kernel again for read-only
        # arrays.
        arrays = (self.mass, self.damping, self.stiffness)
        loops = LinearLoops(*(np.array(x, order="C") for x in arrays))
        deviations, _ = simulate_deviations(loops, self.step, means, free, free[1:], free[0])
        return deviations.reshape(torque.shape)

    def equations(self) -> Equations:
        """The equations `A x = S u + U a` of the loops in discrete time."""
        # A cycle T delays the torque of the loops by T / 2 on average, which reduces the mass by
        # `D T / 2` and the damping by `K T / 2`. This is exact for steps of T and joints without
        # other torques. An integrator is a first-order filter of the loop torque; its inverse
        # filters the torque of the bodies.
        servo, delay = self.servo, self.servo.drive_cycle / 2
        lags = np.isfinite(servo.kp)
        loop = np.zeros_like(servo.kp) if servo.kv is None else np.isfinite(servo.kv) * 1.0
        # Damping and stiffness of the loops divided by the gain; delay as a fraction of a step.
        loops = loop / np.where(lags, servo.kp, 1.0), lags * 1.0
        fraction = lags * delay / self.step
        before, after = (np.diag(0.25 + x * fraction / 2) for x in (1, -1))
        unit, shape = np.eye(len(loop)), (len(self.t) - 1, 3, len(loop), len(loop))
        means = _banded(unit, np.broadcast_to([before, unit / 2, after], shape))
        damping, stiffness = (np.diag(x) for x in loops)
        gain = self.gain[:, None]
        mass, slow, stiff = (x / gain for x in (self.mass, self.damping, self.stiffness))
        mass, slow = mass - delay * damping, slow - delay * stiffness
        if not servo.ki.any():
            return Equations(self._steps(mass, slow, stiff), means, means)
        loop_terms = -delay * damping, damping - delay * stiffness, stiffness
        driven = self._steps(*(np.broadcast_to(x, mass.shape) for x in loop_terms))
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
        """Matrix of the joint filters, from the weights of the present and the previous value."""
        from scipy.sparse import csc_array, diags_array

        now, before = np.tile(weights.T[:, None], (1, len(self.t), 1))
        # The robot is at rest before the first time, so a filter with zero DC gain has the output 0
        # there.
        now[0] += weights[:, 1] * (weights.sum(axis=1) == 0.0)
        dof = len(weights)
        return csc_array(diags_array([now.ravel(), before[1:].ravel()], offsets=[0, -dof]))

    def _steps(self, mass: FloatArray, damping: FloatArray, stiffness: FloatArray) -> csc_array:
        """Matrix of `M x'' + D x' + K x` at all times, but of `K x` alone at the first time."""
        m, d, k = mass[:-1] / self.step**2, damping[:-1] / (2 * self.step), stiffness[:-1] / 4
        return _banded(stiffness[0], np.stack([m - d + k, 2 * k - 2 * m, m + d + k], axis=1))


def _banded(first: FloatArray, blocks: FloatArray) -> csc_array:
    """Sparse matrix with one block in the first block row and three in each other row."""
    from scipy.sparse import bsr_array, csc_array

    n, dof = len(blocks) + 1, len(first)
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
    """Mass, damping and stiffness at all times of a motion, (n, dof, dof) each."""
    rows = np.linspace(0, len(t) - 1, max(int((t[-1] - t[0]) / APART), 1) + 1).astype(np.intp)
    position = np.interp(np.arange(len(t)), rows, np.arange(len(rows)))
    before = np.minimum(position.astype(np.intp), len(rows) - 2)
    fraction = (position - before)[:, None, None]
    linear = drives.linear(q[rows], dq[rows], ddq[rows])
    return [(1 - fraction) * x[before] + fraction * x[before + 1] for x in linear]


def regular_times(start: float, end: float, longest: float) -> FloatArray:
    """Regular times from `start` to `end` with steps of at most `longest` [s], (n,)."""
    count = max(int(np.ceil((end - start) / longest * (1 - 1e-12))), 1)
    return np.linspace(start, end, count + 1)


def respond_along(
    motion: Motion,
    t: FloatArray,
    arm: Arm,
    servo: ServoModel,
    *,
    gravity_feedforward: bool = True,
    controller: Arm | None = None,
) -> Response:
    """Response of the nominal robot around a motion.

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
        loop, lag = np.isfinite(kv), np.isfinite(joint_servo.kp)
        # Joints with a pure delay follow the command: x = u.
        gain = np.where(lag, joint_servo.kp, 1.0) * np.where(loop, kv, 1.0)
        rows = loop * one, np.where(loop, kv, lag * one), gain
        mass, damping, stiffness = (np.broadcast_to(np.diag(x), shape) for x in rows)
    return Response(
        t=t, mass=mass, damping=damping, stiffness=stiffness, gain=gain, servo=joint_servo
    )


# The iteration ends with a correction below this [rad], which is less than the best encoder
# resolves. The remaining error is about a thousandth of the correction.
SMALLEST_CORRECTION = 1e-9
# Maximum number of corrections. Each correction is about a thousandth of the previous one.
CORRECTIONS = 40
# Additional stiffness of a sticking joint, see `hold` of `simulate_deviations`.
HELD = 1e6
# A correction above this means that the simulation diverges [rad].
AWAY = 1e3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NominalMotion:
    """A motion of the nominal robot, and its response to small torques.

    Args:
        t: Regular times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities, central differences [rad/s], (n, dof).
        ddq: Joint accelerations, second differences [rad/s²], (n, dof).
        friction: Torque of dry friction [N m], (n, dof).
        held: True if a joint sticks in a step, (n, dof).
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
        """Step of the regular times [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    def to_torque(self, torque: FloatArray) -> FloatArray:
        """Deviations of the joints [rad] under small torques [N m], (n, dof, cases) each."""
        # Sticking joints remain at rest, and friction does not change its direction.
        n, dof, _ = torque.shape
        loops, still = LinearLoops(self.mass, self.damping, self.stiffness), np.zeros((n - 1, dof))
        hold = np.where(self.held, HELD, 0.0)
        return simulate_deviations(loops, self.step, torque, hold, still, np.zeros(dof))[0]


def simulate(
    drives: Drives,
    command: FloatArray,
    t: FloatArray,
    guess: FloatArray,
    *,
    speed: FloatArray | None = None,
    viscous: FloatArray | None = None,
    lag: float = 0.0,
) -> NominalMotion:
    """Simulate the motion of `Drives` under a command, on a regular time grid.

    The torques balance in every step of Newmark's method. Each iteration corrects the motion by the
    linear response to its residual torque.

    Args:
        drives: The nominal robot. Friction is that of its arm.
        command: Command at the times, after interpolation, dead time and `lag` [rad], (n, dof).
        t: Regular times [s], (n,).
        guess: Initial guess of the motion [rad], (n, dof); its first row is the initial position.
        speed: Joint velocities at the first time [rad/s], (dof,); by default zero.
        viscous: Viscous friction instead of the arm's [N m s/rad], (dof,), of either sign.
        lag: Delay of the loop torque [s], such as half a drive cycle; small against the time
            constants of the loops.

    Raises:
        ExecutionError: The iteration diverges, or friction has no solution.
    """
    step = float((t[-1] - t[0]) / (len(t) - 1))
    chain = drives.arm.dynamics.chain
    coulomb = np.array(chain.coulomb)
    brake = np.asarray(chain.viscous) if viscous is None else viscous
    # The delay of the loop torque reduces inertia and damping.
    lost_mass, lost_damping = drives.damping * lag, drives.stiffness * lag
    before = guess[0] - step * (np.zeros(drives.arm.dof) if speed is None else speed)
    demanded = drives.stiffness * _mean(command, command[0])
    q, free = np.array(guess), np.zeros(guess.shape)
    for k in range(CORRECTIONS):
        dq, ddq = _rates(q, before, step)
        if k < 2:
            mass, damping, stiffness = linear_along(drives, t, q, dq, ddq)
            mass -= np.diag(lost_mass)
            damping += np.diag(brake - np.asarray(chain.viscous) - lost_damping)
        lacking = demanded - drives.stiffness * _mean(q, before)
        lacking -= (drives.damping + brake - lost_damping) * dq - lost_mass * ddq
        lacking -= drives.inertial_torque(q, dq, ddq)
        loops, moved = LinearLoops(mass, damping, stiffness), np.diff(q, axis=0)
        correction, friction = (
            found[:, :, 0]
            for found in simulate_deviations(loops, step, lacking[:, :, None], free, moved, coulomb)
        )
        q = q + correction
        size = float(np.abs(correction).max())
        if not size < AWAY:
            break
        if size <= SMALLEST_CORRECTION:
            dq, ddq = _rates(q, before, step)
            sticking = np.abs(friction) < coulomb * (1 - 1e-9)
            return NominalMotion(
                t=checks.frozen_array(t), q=q, dq=dq, ddq=ddq, friction=friction, held=sticking,
                mass=mass, damping=damping, stiffness=stiffness,
            )  # fmt: skip
    raise ExecutionError(
        f"The motion of {drives.arm.name} cannot be simulated, because the iteration does not "
        f"converge (last correction {size:.2g} rad). Check servo gains, inertias and units."
    )


def _mean(values: FloatArray, before: FloatArray) -> FloatArray:
    """Weighted means of values and their neighbours, (n, dof)."""
    around = np.concatenate([before[None], values, values[-1:]])
    return np.asarray((around[2:] + 2 * around[1:-1] + around[:-2]) / 4)


def _rates(q: FloatArray, before: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """First and second derivatives by central differences, the last rows repeated, (n, dof)."""
    around = np.concatenate([before[None], q, q[-1:]])
    dq = (around[2:] - around[:-2]) / (2 * step)
    ddq = (around[2:] - 2 * around[1:-1] + around[:-2]) / step**2
    dq[-1], ddq[-1] = dq[-2], ddq[-2]
    return dq, ddq
