"""Whether drives that hold a torque for a step are stable, and how finely a step is integrated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import ExecutionError
from armcontour.execution._mujoco import Springs, mass_matrices
from armcontour.motion import TaughtData

# Number of set-points at which a run is checked before the simulation.
LOOKS = 50
# A motion that grows by less in a step of the drives does not grow, but for rounding.
GROWTH = 1 + 1e-6
# The simulation integrates over parts of a step, in which the fastest motion of springs and viscous
# friction has this phase [rad] or decay; its method is stable up to 2.8. At most so many parts.
PHASE = 0.5
MOST_PARTS = 50


class Instability(NamedTuple):
    """A joint whose sampled loop is unstable.

    Attributes:
        joint: Index of the joint.
        why: The reason, for a sentence.
        stable: A stable step [s]; without springs the longest one.
        mend: What would mend it, for a sentence.
    """

    joint: int
    why: str
    stable: float
    mend: str


class Modes(NamedTuple):
    """Small motions of links and motors about a pose: `M x'' + D x' + K x = tau`.

    Links come first, as in `_mujoco.build`; tau acts on the motors.

    Attributes:
        mass: M [kg m²], (n, n).
        damping: D of springs and viscous friction [N m s/rad], (n, n).
        stiffness: K of springs [N m/rad], (n, n).
    """

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray

    @property
    def fastest(self) -> float:
        """Largest rate of decay or oscillation without the drives [1/s]."""
        return float(np.abs(np.linalg.eigvals(self._state_matrix())).max())

    def spring(self, joint: int) -> float:
        """Stiffness of the spring of a joint [N m/rad]."""
        return float(self.stiffness[joint, joint])

    def growth(
        self, damping: FloatArray, stiffness: FloatArray, step: float
    ) -> tuple[float, FloatArray]:
        """How a small motion grows in a step, with drives that hold their torque for the step.

        Args:
            damping: J K_v of the drives [N m s/rad], (dof,).
            stiffness: J K_v K_p of the drives [N m/rad], (dof,).
            step: The step [s].

        Returns:
            The factor by which the least stable mode grows, and how much each motor takes part in
            that mode, (dof,).
        """
        from scipy.linalg import expm

        n, dof = len(self.mass), len(damping)
        into = np.zeros((n, dof))
        into[-dof:] = np.eye(dof)
        # With the held torque as a further state, the exponential is the motion over the step.
        held = np.zeros((2 * n + dof, 2 * n + dof))
        held[: 2 * n, : 2 * n] = self._state_matrix()
        held[n : 2 * n, 2 * n :] = np.linalg.solve(self.mass, into)
        over = expm(held * step)[: 2 * n]
        asked = np.hstack([(into * stiffness).T, (into * damping).T])
        values, vectors = np.linalg.eig(over[:, : 2 * n] - over[:, 2 * n :] @ asked)
        worst = int(np.argmax(np.abs(values)))
        return float(np.abs(values[worst])), np.abs(vectors[n - dof : n, worst])

    def _state_matrix(self) -> FloatArray:
        """The matrix of the equation of first order, for (x, x'), (2 n, 2 n)."""
        n = len(self.mass)
        right = -np.linalg.solve(self.mass, np.hstack([self.stiffness, self.damping]))
        return np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), right])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledLoops:
    """Drives whose loops hold a torque for a step, on links that are rigid or behind springs.

    Args:
        inertia: J, by which the loops are scaled [kg m²], (dof,).
        kv, kp: Gains of the loops [1/s], (dof,).
        armature: Inertias of the drives [kg m²], (dof,).
        viscous: Viscous friction of the drives [N m s/rad], (dof,).
        springs: Springs between drives and links; None for rigid joints.
    """

    inertia: FloatArray
    kv: FloatArray
    kp: FloatArray
    armature: FloatArray
    viscous: FloatArray
    springs: Springs | None

    def count_parts(self, model: Any, step: float, taught: TaughtData) -> int:
        """Number of parts in which a step is integrated; refuses a step that is too long.

        With a torque that is constant over a step h, a mode of rigid joints is stable if K_v J / M
        times h is below 2, and K_p times h too. This is exact for equal K_p of all joints, small
        motions and no viscous friction. Joints with springs are stable if no mode grows in a step.
        Drives that are not sampled are stable in every pose.

        Springs swing faster than the drives' cycle, and viscous friction brakes light links faster,
        so that a step is integrated in parts.

        Args:
            model: MuJoCo's model of the arm.
            step: The step [s].
            taught: The set-points, some of which are checked.

        Raises:
            ExecutionError: A joint is unstable at a set-point, or there would be too many parts.
        """
        most = 1
        looks = np.unique(np.linspace(0, len(taught.q) - 1, LOOKS).astype(int))
        for k, mass in zip(looks, mass_matrices(model, taught.q[looks]), strict=True):
            t = float(taught.start_time + k * taught.period)
            modes = None if self.springs is None else _modes(mass, self.viscous, self.springs)
            rate = _braking(mass, self.viscous) if modes is None else modes.fastest
            parts = int(np.ceil(rate * step / PHASE))
            if parts > MOST_PARTS:
                _refuse_parts(rate, parts, step, t)
            unstable = self._of_rigid(mass, step) if modes is None else self._of(modes, step)
            if unstable is not None:
                _refuse(unstable, step, t)
            most = max(most, parts)
        return most

    def _of_rigid(self, mass: FloatArray, step: float) -> Instability | None:
        """What is unstable in a pose, without springs; None if nothing is.

        Args:
            mass: Mass matrix [kg m²], (dof, dof).
            step: The step [s].
        """
        rate = np.sqrt(self.inertia * self.kv)
        values, vectors = np.linalg.eigh(rate[:, None] * np.linalg.inv(mass) * rate)
        fastest = max(float(values[-1]), float(self.kp.max()))
        if fastest * step < 2:
            return None
        mend = (
            f"{1 / fastest:.2g} s, lower the servo's gains, or give the arm the inertias of its "
            "drives if they are missing"
        )
        why = f"where it corrects the joint's velocity at a rate of {fastest:.4g} 1/s"
        return Instability(int(np.argmax(np.abs(vectors[:, -1]))), why, 2 / fastest, mend)

    def _of(self, modes: Modes, step: float) -> Instability | None:
        """What is unstable in a pose, with springs; None if nothing is.

        Args:
            modes: Small motions about the pose.
            step: The step [s].
        """
        loop = self.inertia * self.kv
        growth, parts = modes.growth(loop, loop * self.kp, step)
        if growth <= GROWTH:
            return None
        j, stable = int(np.argmax(parts)), step
        while modes.growth(loop, loop * self.kp, stable)[0] > GROWTH:
            stable /= 2
        why = (
            f"in which a loop that is scaled for {self.inertia[j]:.3g} kg m² makes its motor of "
            f"{self.armature[j]:.3g} kg m² swing up on a spring of {modes.spring(j):.3g} N m/rad"
        )
        mend = f"{stable:.2g} s, lower the servo's gains, or raise the drive's inertia (armature)"
        return Instability(j, why, stable, mend)


def _refuse(unstable: Instability, step: float, t: float) -> None:
    """Refuse a step that is too long [s], at a time [s].

    Raises:
        ExecutionError: Always.
    """
    raise ExecutionError(
        f"Joint {unstable.joint + 1} is unstable at t = {t:.4g} s: its drive keeps a torque for a "
        f"step of {step:.3g} s, {unstable.why}; shorten the step to {unstable.mend}.",
        t=t,
        joint=unstable.joint + 1,
        limit="step",
        needed=step,
        allowed=unstable.stable,
    )


def _refuse_parts(rate: float, parts: int, step: float, t: float) -> None:
    """Refuse springs or friction that take too many parts of a step [s], at a time [s].

    Raises:
        ExecutionError: Always.
    """
    raise ExecutionError(
        f"The springs or the viscous friction of the joints move them at a rate of {rate:.3g} 1/s "
        f"at t = {t:.4g} s, which takes {parts} integration steps in a step of {step:.3g} s, but "
        f"at most {MOST_PARTS} are made: lower joint_stiffness, joint_damping or viscous friction, "
        "raise the inertias of drives (armature), or shorten the step.",
        t=t,
        needed=float(parts),
        allowed=float(MOST_PARTS),
    )


def _braking(mass: FloatArray, viscous: FloatArray) -> float:
    """Largest rate at which viscous friction brakes rigid joints [1/s].

    Args:
        mass: Mass matrix [kg m²], (dof, dof).
        viscous: Viscous friction [N m s/rad], (dof,).
    """
    if not viscous.any():
        return 0.0
    rate = np.sqrt(viscous)
    return float(np.linalg.eigvalsh(rate[:, None] * np.linalg.inv(mass) * rate)[-1])


def _modes(mass: FloatArray, viscous: FloatArray, springs: Springs) -> Modes:
    """Small motions of links and motors at rest in a pose, without gravity.

    Args:
        mass: Mass matrix of links and motors [kg m²], (2 dof, 2 dof).
        viscous: Viscous friction of the drives [N m s/rad], (dof,).
        springs: The springs.
    """
    # The torque of a spring pulls on the link as it holds back the motor.
    signs = np.array([[1.0, -1.0], [-1.0, 1.0]])
    motors = np.diag([0.0, 1.0])
    return Modes(
        mass=mass,
        damping=np.kron(signs, np.diag(springs.damping)) + np.kron(motors, np.diag(viscous)),
        stiffness=np.kron(signs, np.diag(springs.stiffness)),
    )
