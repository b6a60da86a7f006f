"""How far motion uses its limits; shared by planning, explanation and certification.

`evaluation` has its own formulas, so that no plan is judged by the code that made it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits, SerialArm
from armcontour.arms.limits import or_unlimited
from armcontour.errors import InvalidInput

# Below this tool speed [m/s] the direction of motion is not defined, so the centripetal
# acceleration is not defined either.
SLOWEST = 1e-6


# Below this joint velocity [rad/s] dry friction may have any value up to Coulomb friction, in both
# directions.
STILL = 1e-6


@dataclass(frozen=True)
class States:
    """Joint states of an arm, with the motion of the tool that they cause.

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities [rad/s], (n, dof).
        ddq: Joint accelerations [rad/s²], (n, dof).
        dddq: Joint jerks [rad/s³], (n, dof); None where they are not asked for.
    """

    arm: Arm
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    dddq: FloatArray | None = None

    @cached_property
    def tool_velocity(self) -> FloatArray:
        """Tool velocities [m/s], (n, dimension)."""
        return self.arm.tool_velocity(self.q, self.dq)

    @cached_property
    def tool_acceleration(self) -> FloatArray:
        """Tool accelerations [m/s²], (n, dimension)."""
        return self.arm.tool_acceleration(self.q, self.dq, self.ddq)

    @property
    def joint_jerk(self) -> FloatArray:
        """Joint jerks [rad/s³], (n, dof).

        Raises:
            InvalidInput: The states were made without them.
        """
        if self.dddq is None:
            raise InvalidInput("The use of a limit of jerk needs states with dddq.")
        return self.dddq


def require_orientation(arm: Arm) -> SerialArm:
    """Return the arm if its tool has an orientation.

    Raises:
        InvalidInput: The tool is a point without an orientation.
    """
    if not isinstance(arm, SerialArm):
        raise InvalidInput(
            f"The tool of the arm {arm.name} is a point without an orientation: lift its limits "
            "with limits.replace(angular_speed=math.inf, angular_acceleration=math.inf)."
        )
    return arm


def quantity(name: str, states: States) -> FloatArray:
    """The quantity that a limit applies to, in the unit of the limit.

    Args:
        name: A field of `Limits`; of "path_jerk" states know
            nothing: it belongs to a law along a path.
        states: The motion.

    Returns:
        Values per joint, (n, dof), or of the tool, (n,). Joint velocities and accelerations have
        a sign, all other values are amounts.

    Raises:
        InvalidInput: There is no such limit, the arm has no masses for torques, or the tool has no
            orientation for angular motion, or the states have no jerk.
    """
    if name not in QUANTITIES:
        raise InvalidInput(
            f"The use of a limit {name!r} is not known: known are {', '.join(QUANTITIES)}."
        )
    return QUANTITIES[name](states)


def allowed(name: str, limits: Limits, states: States) -> FloatArray:
    """Largest values that limits allow, infinite without a limit; signed as the quantity is.

    Args:
        name: A field of `Limits`, as in `quantity`.
        limits: The limits, with one value per joint.
        states: The motion.
    """
    if name == "joint_acceleration":
        return _directed(states.ddq, limits.acceleration_bounds(states.arm.dof))
    if name == "joint_velocity":
        return _directed(states.dq, limits.velocity_bounds(states.arm.dof))
    value = getattr(limits, name)
    return or_unlimited(value, states.arm.dof) if name.startswith("joint") else _or_infinite(value)


def ratio(name: str, limits: Limits, states: States) -> FloatArray:
    """Used share of a limit: 1 is the limit. Arguments as in `quantity` and `allowed`."""
    return np.asarray(quantity(name, states) / allowed(name, limits, states))


def _directed(values: FloatArray, bounds: tuple[FloatArray, FloatArray]) -> FloatArray:
    return np.where(values < 0, *bounds)


def _or_infinite(value: float | None) -> FloatArray:
    return np.asarray(np.inf if value is None else value)


def _centripetal(states: States) -> FloatArray:
    """Tool acceleration at right angles to the motion [m/s²], (n,); zero below `SLOWEST`."""
    velocity, acceleration = states.tool_velocity, states.tool_acceleration
    speed = _length(velocity)
    direction = velocity / np.maximum(speed, SLOWEST)[:, None]
    along = np.einsum("ij,ij->i", acceleration, direction)
    across = _length(acceleration - along[:, None] * direction)
    return np.where(speed > SLOWEST, across, 0.0)


def _angular_speed(states: States) -> FloatArray:
    return _length(require_orientation(states.arm).tool_twist(states.q, states.dq)[:, 3:])


def _angular_acceleration(states: States) -> FloatArray:
    arm = require_orientation(states.arm)
    return _length(arm.tool_twist_rate(states.q, states.dq, states.ddq)[:, 3:])


def _length(vectors: npt.ArrayLike) -> FloatArray:
    return np.asarray(np.linalg.norm(vectors, axis=1))


def _torque(x: States) -> FloatArray:
    """Amounts of the joint torques [N m], with the dry friction at rest that helps most."""
    torque = x.arm.torque(x.q, x.dq, x.ddq)
    chain = x.arm.chain
    if chain is None or chain.coulomb is None or not chain.coulomb.any():
        return np.abs(torque)
    without = np.abs(torque - chain.coulomb * np.sign(x.dq))
    helped = np.maximum(without - chain.coulomb, 0.0)
    return np.where(np.abs(x.dq) <= STILL, helped, np.abs(torque))


QUANTITIES: dict[str, Callable[[States], FloatArray]] = {
    "joint_velocity": lambda x: x.dq,
    "joint_acceleration": lambda x: x.ddq,
    "joint_jerk": lambda x: np.abs(x.joint_jerk),
    "joint_torque": _torque,
    "speed": lambda x: _length(x.tool_velocity),
    "tool_acceleration": lambda x: _length(x.tool_acceleration),
    "centripetal_acceleration": _centripetal,
    "tool_jerk": lambda x: _length(x.arm.tool_jerk(x.q, x.dq, x.ddq, x.joint_jerk)),
    "angular_speed": _angular_speed,
    "angular_acceleration": _angular_acceleration,
}
