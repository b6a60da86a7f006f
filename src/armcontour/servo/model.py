"""The joint servo: the paper's two loops (5)-(7), or a first-order lag, after a dead time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._quantities import Choice, DeadTimes, Gains
from armcontour.errors import InvalidInput

INTERPOLATIONS = ("linear", "step", "cubic")
ORDERS = ("second", "first")
# Time constants from a microsecond to a quarter of an hour, as gains [1/s]: no joint of a robot is
# faster or slower, and what is computed from gains in here stays within numbers.
GAINS = (1e-3, 1e6)
# Commands lead the plan by the dead time, so that a robot would wait for it [s].
LONGEST_DEAD_TIME = 60.0
# A servo of more time constants in a command interval has come to rest long before the next one:
# there is nothing of it to be seen, and each half of one is a step of the simulation.
MOST_TIME_CONSTANTS = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoModel:
    """The joint servo: what a joint makes of its command u, `tau` being the dead time.

    - order "second": `ddq = K_v (K_p (u(t - tau) - q) - dq)`, (6), a velocity loop inside a
      position loop;
    - order "first": `dq = K_p (u(t - tau) - q)`, a lag, for a velocity loop too fast to matter.

    Between two set-points the command is, for the interpolation

    - "linear": the straight line;
    - "step": the earlier set-point, held;
    - "cubic": the cubic with the slopes `(u[k + 1] - u[k - 1]) / (2 T)` at set-points, and 0 at the
      first and the last one (Catmull and Rom's spline: once differentiable, and local).

    Before the first set-point the command is the first, after the last the last. Each one is met
    when it is due. A controller cannot draw a line before it has the set-point at its end, nor the
    cubic before it has the one after that; how long it waits for them is part of the dead time.

    Args:
        kp: Position loop gain [1/s], one for all joints or one per joint.
        kv: Velocity loop gain [1/s], one for all joints or one per joint; None for the
            order "first".
        interpolation: What the controller does between two set-points.
        dead_time: Time from when a set-point is due until the joint's servo sees it [s], one for
            all joints or one per joint; any number of command intervals, whole or not.
        order: "second" or "first".

    Raises:
        InvalidInput: A gain that is missing, one too many, or outside GAINS; a dead time that is
            negative or above LONGEST_DEAD_TIME; an unknown interpolation or order.
    """

    kp: Gains
    kv: Gains | None
    order: Annotated[str, Choice(ORDERS)]
    dead_time: DeadTimes
    interpolation: Annotated[str, Choice(INTERPOLATIONS)]

    def __init__(
        self,
        *,
        kp: npt.ArrayLike,
        kv: npt.ArrayLike | None = None,
        interpolation: str = "linear",
        dead_time: npt.ArrayLike = 0.0,
        order: str = "second",
    ) -> None:
        _checks.choice("order", order, ORDERS)
        if (kv is None) == (order == "second"):
            raise InvalidInput(
                "A servo of order second needs the velocity loop gain kv [1/s] beside kp."
                if kv is None
                else "A servo of order first has no velocity loop: leave its gain kv out."
            )
        object.__setattr__(self, "kp", _gain("kp", kp))
        object.__setattr__(self, "kv", None if kv is None else _gain("kv", kv))
        _checks.choice("interpolation", interpolation, INTERPOLATIONS)
        object.__setattr__(self, "interpolation", interpolation)
        delay = _checks.numbers("dead_time", dead_time, "s")
        if delay.ndim > 1 or delay.size == 0 or (delay < 0).any():
            raise InvalidInput(
                "dead_time must not be negative, one for all joints or one per joint, but is "
                f"{delay.tolist()} s."
            )
        if (delay > LONGEST_DEAD_TIME).any():
            raise InvalidInput(
                f"dead_time must be at most {LONGEST_DEAD_TIME:g} s, for which the robot waits "
                f"before it moves, but is {float(delay.max()):g} s."
            )
        object.__setattr__(self, "dead_time", _checks.lock_floats(delay))
        object.__setattr__(self, "order", order)

    def for_joints(self, dof: int) -> ServoModel:
        """The same servo with one gain and dead time per joint.

        Args:
            dof: Number of joints.

        Raises:
            InvalidInput: A wrong number of them.
        """
        return ServoModel(
            kp=_checks.per_joint("servo gain kp", self.kp, dof, "1/s"),
            kv=None if self.kv is None else _checks.per_joint("servo gain kv", self.kv, dof, "1/s"),
            interpolation=self.interpolation,
            dead_time=_checks.per_joint("dead_time", self.dead_time, dof, "s"),
            order=self.order,
        )

    @property
    def slowest(self) -> float:
        """Smallest rate at which any joint comes to rest [1/s]."""
        if self.kv is None:
            return float(self.kp.min())
        # Of s² + kv s + kp kv; the sum of a real pair's is kv, and their product kp kv.
        root = np.sqrt(np.maximum(self.kv * self.kv / 4 - self.kp * self.kv, 0.0))
        fast = self.kv / 2 + root
        return float(np.where(root > 0, self.kp * self.kv / fast, self.kv / 2).min())

    def refuse_too_fast(self, period: float) -> None:
        """Refuse gains that are too large for a command interval.

        Args:
            period: Command interval [s].

        Raises:
            InvalidInput: More than MOST_TIME_CONSTANTS in it.
        """
        for name, values in (("kp", self.kp), ("kv", self.kv)):
            largest = 0.0 if values is None else float(values.max())
            if largest * period > MOST_TIME_CONSTANTS:
                more = ", or take a servo of order first" if name == "kv" else ""
                raise InvalidInput(
                    f"servo gain {name} is {largest:g} 1/s, which is {largest * period:.3g} time "
                    f"constants in a command interval of {period:g} s, but at most "
                    f"{MOST_TIME_CONSTANTS:g} are simulated: lower {name} to "
                    f"{MOST_TIME_CONSTANTS / period:g} 1/s, shorten the command interval{more}.",
                    limit=name,
                    needed=largest,
                    allowed=MOST_TIME_CONSTANTS / period,
                )

    def response(self, s: npt.ArrayLike) -> FloatArray:
        """From command to joint, for each s; complex, (n, joints).

        `G(s) = exp(-s tau) K_p K_v / (s² + K_v s + K_p K_v)`, (5), or for the order "first"
        `exp(-s tau) K_p / (s + K_p)`. What interpolation makes of set-points is not in it.

        Args:
            s: Complex frequencies [rad/s], (n,).
        """
        at = np.atleast_1d(np.asarray(s))[:, None]
        kp, late = np.atleast_1d(self.kp), np.exp(-at * np.atleast_1d(self.dead_time))
        if self.kv is None:
            return np.asarray(late * kp / (at + kp))
        kv = np.atleast_1d(self.kv)
        return np.asarray(late * (kp * kv / (at**2 + kv * at + kp * kv)))


def _gain(name: str, values: npt.ArrayLike) -> FloatArray:
    array = _checks.numbers(f"servo gain {name}", values, "1/s")
    if array.ndim > 1 or array.size == 0 or (array <= 0).any():
        raise InvalidInput(
            f"servo gain {name} must be above zero, one for all joints or one per joint, "
            f"but is {array.tolist()} 1/s."
        )
    low, high = GAINS
    outside = (array < low) | (array > high)
    if outside.any():
        raise InvalidInput(
            f"servo gain {name} must be from {low:g} to {high:g} 1/s, but is "
            f"{float(array[outside].flat[0]):g} 1/s."
        )
    return _checks.lock_floats(array)
