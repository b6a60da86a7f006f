"""`Drives`: torques of the joint drives, and the command for a motion."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import integrator_filter

# Below this speed [rad/s] Coulomb friction is proportional to the speed, because a joint at rest
# has velocities of either sign due to rounding. A reversing joint passes this range in less than a
# cycle.
CREEP = 1e-3


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
            raise InvalidInput(
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
        """Command u for which the drives execute a motion [rad], (n, dof)."""
        # `u = q + dq / K_p + tau / (J K_v K_p)`. tau is the torque without gravity feed-forward and
        # without the output of integrators. At the first time, integrators supply the whole torque.
        # Integrators need the time `step` between two rows [s]; if it is infinite, the rows are
        # steady states.
        torque = self.moving_torque(q, dq, ddq)
        if self.servo.ki.any():
            from scipy.signal import lfilter

        for j in np.flatnonzero(self.servo.ki):
            coefficients = integrator_filter(self.servo.ki[j], step, 0.0)
            torque[:, j] = lfilter(*coefficients, torque[:, j] - torque[0, j])
        return np.asarray(q + dq / self.servo.kp + torque / self.stiffness)

    def moving_torque(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """The torque of the loops for a motion, without gravity feed-forward [N m], (n, dof)."""
        # The torque includes inertia, coupling, Coriolis and centrifugal torques, payload,
        # friction, and the gravity torque that the controller does not feed forward. Coulomb
        # friction is `coulomb sign(dq)`, except for joints slower than `CREEP`.
        chain = self.arm.dynamics.chain
        torque = self.inertial_torque(q, dq, ddq) + np.asarray(chain.viscous) * dq
        torque += np.asarray(chain.coulomb) * np.clip(dq / CREEP, -1.0, 1.0)
        return torque

    def inertial_torque(self, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
        """The torque of `moving_torque` without friction [N m], (n, dof)."""
        torque = self.arm.dynamics.torque(q, dq, ddq)
        return (
            torque - self.controller_arm.dynamics.gravity(q) if self.gravity_feedforward else torque
        )

    def linear(
        self, q: FloatArray, dq: FloatArray, ddq: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Mass, damping (with viscous friction) and stiffness of the loops, (n, dof, dof) each."""
        # The gravity torque that the controller feeds forward cancels the arm's gravity torque.
        fed, differs = self.gravity_feedforward, self.controller is not None
        stiffness, damping, mass = self.arm.dynamics.derivatives(
            q, dq, ddq, gravity=differs or not fed
        )
        if fed and differs:
            still = np.zeros_like(q)
            stiffness = stiffness - self.controller_arm.dynamics.derivatives(q, still, still)[0]
        viscous = np.asarray(self.arm.dynamics.chain.viscous)
        return mass, damping + np.diag(self.damping + viscous), stiffness + np.diag(self.stiffness)


def nominal_inertia(arm: Arm) -> FloatArray:
    """Nominal inertia of each joint with its drive [kg m²], (dof,)."""
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
