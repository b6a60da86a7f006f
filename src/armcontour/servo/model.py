"""The joint servo of the paper, eq. (5)-(7): a velocity loop inside a position loop."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput

INTERPOLATIONS = ("linear", "step")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoModel:
    """`ddq = K_v (K_p (u - q) - dq)` for every joint, (6).

    Args:
        kp: Position loop gain [1/s], one for all joints or one per joint.
        kv: Velocity loop gain [1/s], likewise.
        interpolation: What the controller does between two set-points: "linear" or "step" (holds).

    Raises:
        InvalidInput: A gain that is not above zero, or an unknown interpolation.
    """

    kp: FloatArray
    kv: FloatArray
    interpolation: str = "linear"

    def __init__(
        self, *, kp: npt.ArrayLike, kv: npt.ArrayLike, interpolation: str = "linear"
    ) -> None:
        for name, values in (("kp", kp), ("kv", kv)):
            array = _checks.numbers(f"servo gain {name}", values, "1/s")
            if array.ndim > 1 or array.size == 0 or (array <= 0).any():
                raise InvalidInput(
                    f"servo gain {name} must be above zero, one for all joints or one per joint, "
                    f"but is {array.tolist()} 1/s."
                )
            object.__setattr__(self, name, _checks.locked(array))
        _checks.choice("interpolation", interpolation, INTERPOLATIONS)
        object.__setattr__(self, "interpolation", interpolation)

    def for_joints(self, dof: int) -> ServoModel:
        """The same servo with one gain per joint.

        Raises:
            InvalidInput: A wrong number of gains.
        """
        return ServoModel(
            kp=_checks.per_joint("servo gain kp", self.kp, dof, "1/s"),
            kv=_checks.per_joint("servo gain kv", self.kv, dof, "1/s"),
            interpolation=self.interpolation,
        )

    def response(self, s: npt.ArrayLike) -> FloatArray:
        """`G(s) = K_p K_v / (s² + K_v s + K_p K_v)`, (5), for each s; complex, (n, joints)."""
        at = np.atleast_1d(np.asarray(s))[:, None]
        kp, kv = np.atleast_1d(self.kp), np.atleast_1d(self.kv)
        return np.asarray(kp * kv / (at**2 + kv * at + kp * kv))
