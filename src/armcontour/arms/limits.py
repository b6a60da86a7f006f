"""What an arm, its tool and the process allow."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Limits:
    """Limits of the joints and of the tool; what is not given is not limited.

    Args:
        joint_acceleration: Largest acceleration of each joint, either way [rad/s²], (dof,).
        joint_velocity: Largest velocity of each joint, either way [rad/s], (dof,).
        speed: Assigned velocity: tool speed asked for and not exceeded [m/s].
        centripetal_acceleration: Largest centripetal acceleration of the tool [m/s²].

    Raises:
        InvalidInput: A limit that is not above zero.
    """

    joint_acceleration: FloatArray | None = None
    joint_velocity: FloatArray | None = None
    speed: float | None = None
    centripetal_acceleration: float | None = None

    def __post_init__(self) -> None:
        for name, unit in (("joint_acceleration", "rad/s²"), ("joint_velocity", "rad/s")):
            values = getattr(self, name)
            if values is None:
                continue
            array = _checks.numbers(name, values, unit)
            if array.ndim > 1 or (array <= 0).any():
                raise InvalidInput(
                    f"{name} must be above zero for every joint, but is {array.tolist()} {unit}.",
                    limit=name,
                )
            object.__setattr__(self, name, _checks.locked(array))
        for name, unit in (("speed", "m/s"), ("centripetal_acceleration", "m/s²")):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _checks.positive(name, value, unit))

    def replace(self, **changes: Any) -> Limits:
        """The same limits with some of them changed; None lifts one.

        Raises:
            InvalidInput: An unknown name, or a value that is not a limit.
        """
        known = [x.name for x in dataclasses.fields(self)]
        for name in changes:
            if name not in known:
                raise InvalidInput(f"Unknown limit {name!r}: the limits are {', '.join(known)}.")
        return dataclasses.replace(self, **changes)

    def for_joints(self, dof: int) -> Limits:
        """The same limits with one value per joint.

        Raises:
            InvalidInput: A wrong number of values.
        """
        changes = {
            name: _checks.per_joint(name, values, dof, unit)
            for name, unit in (("joint_acceleration", "rad/s²"), ("joint_velocity", "rad/s"))
            if (values := getattr(self, name)) is not None
        }
        return self.replace(**changes)


def or_unlimited(values: npt.ArrayLike | None, dof: int) -> FloatArray:
    """The given joint limits, or infinity for every joint."""
    return np.full(dof, np.inf) if values is None else np.array(values, dtype=np.float64)
