"""Model of a joint servo: the paper's two loops (5)-(7) or a first-order lag, with dead time."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, Value
from armcontour._quantities import Choice, DeadTimes, FeedForwards, Gains, JointInertias
from armcontour.errors import InvalidInput

INTERPOLATIONS = ("linear", "step", "cubic")
ORDERS = ("second", "first")
# Smallest and largest gain [1/s], for time constants from a microsecond to a quarter of an hour: no
# robot joint is faster or slower, and no result overflows.
GAINS = (1e-3, 1e6)
# Smallest and largest inertia of a joint [kg m²]: from a milligram at 1 cm to ten tonnes at 10 m.
INERTIAS = (1e-10, 1e6)
# Largest feed-forward: no drive asks for twice the velocity of its command.
MOST_FEEDFORWARD = 2.0
# Largest dead time; set-points have a time advance of the dead time, so the robot waits for it [s].
LONGEST_DEAD_TIME = 60.0
# Most time constants in a command interval. With more, the joint comes to rest long before the next
# set-point, and the simulation needs a step for each half of a time constant.
MOST_TIME_CONSTANTS = 1000.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoModel(Value):
    """The joint servo: response of a joint to its command u, with dead time `tau`.

    - order "second": `ddq = K_v (K_p (u - q) + f du - dq) + g ddu`, a velocity loop inside a
      position loop; with f = g = 0 it is (6) of the paper;
    - order "first": `dq = K_p (u - q) + f du`, a first-order lag, for a very fast velocity loop.

    All of u, du and ddu are delayed by tau. Between two set-points the command is, by
    interpolation,

    - "linear": the straight line;
    - "step": the earlier set-point (zero-order hold);
    - "cubic": the cubic with slopes `(u[k + 1] - u[k - 1]) / (2 T)` at set-points, and 0 at the
      first and the last one (Catmull-Rom spline: continuously differentiable, and local).

    Before the first set-point the command equals the first set-point, and after the last one the
    last, and du and ddu are 0. The rates of the command are, by interpolation,

    - "linear": du is the slope of the line, and ddu the second difference of the set-points that
      end it, `(u[k] - 2 u[k - 1] + u[k - 2]) / T²`;
    - "step": du is the difference to the set-point before, over the command interval; there is no
      ddu;
    - "cubic": the derivatives of the cubic.

    The command passes each set-point at its time. A controller needs the next set-point for
    a line, and the one after it for the cubic; its wait for them is part of the dead time.

    Args:
        kp: Position loop gain [1/s], one for all joints or one per joint.
        kv: Velocity loop gain [1/s], one for all joints or one per joint; None for order "first".
        interpolation: Interpolation between set-points: "linear", "step" or "cubic".
        dead_time: Time from a set-point's time until it reaches the joint's servo [s], one for all
            joints or one per joint; need not be a multiple of the command interval.
        order: "second" or "first".
        inertia: Inertia J by which the controller scales the velocity loop [kg m²], one for all
            joints or one per joint: its torque is `J (K_v (K_p (u - q) + f du - dq) + g ddu)`. Only
            for rigid bodies and for servos of order "second". None is the arm's own nominal
            inertia.
        velocity_feedforward: Share f of the velocity of the command that is added to the velocity
            loop, one for all joints or one per joint: 0 for the paper's servo, about 1 for most
            drives of industrial robots.
        acceleration_feedforward: Share g of the acceleration of the command that is added to the
            demand, one for all joints or one per joint; above 0 only with velocity feed-forward,
            order "second", and not for interpolation "step".

    Raises:
        InvalidInput: A gain or an inertia is missing, not needed or out of range; a dead time is
            negative or above LONGEST_DEAD_TIME; a feed-forward is negative, above MOST_FEEDFORWARD
            or not possible; the interpolation or order is unknown.
    """

    kp: Gains
    kv: Gains | None
    order: Annotated[str, Choice(ORDERS)]
    dead_time: DeadTimes
    interpolation: Annotated[str, Choice(INTERPOLATIONS)]
    inertia: JointInertias | None
    velocity_feedforward: FeedForwards
    acceleration_feedforward: FeedForwards

    def __init__(
        self,
        *,
        kp: npt.ArrayLike,
        kv: npt.ArrayLike | None = None,
        interpolation: str = "linear",
        dead_time: npt.ArrayLike = 0.0,
        order: str = "second",
        inertia: npt.ArrayLike | None = None,
        velocity_feedforward: npt.ArrayLike = 0.0,
        acceleration_feedforward: npt.ArrayLike = 0.0,
    ) -> None:
        _checks.choice("order", order, ORDERS)
        if (kv is None) == (order == "second"):
            raise InvalidInput(
                "A servo of order second needs the velocity loop gain kv [1/s] beside kp."
                if kv is None
                else "A servo of order first has no velocity loop: leave its gain kv out."
            )
        object.__setattr__(self, "kp", _check_gain("kp", kp))
        object.__setattr__(self, "kv", None if kv is None else _check_gain("kv", kv))
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
        object.__setattr__(self, "inertia", _check_inertia(inertia, order))
        velocity = _check_feedforward("velocity_feedforward", velocity_feedforward)
        second = _check_feedforward("acceleration_feedforward", acceleration_feedforward)
        if second.any() and (order == "first" or interpolation == "step"):
            which = "of order first" if order == "first" else "with held set-points"
            raise InvalidInput(
                f"A servo {which} has no acceleration of the command: leave "
                "acceleration_feedforward out."
            )
        if ((second > 0) & (velocity == 0)).any():
            raise InvalidInput(
                "acceleration_feedforward without velocity_feedforward would swing for a long "
                "time: give velocity_feedforward, too, such as 1."
            )
        object.__setattr__(self, "velocity_feedforward", velocity)
        object.__setattr__(self, "acceleration_feedforward", second)

    def __str__(self) -> str:
        """Gains, dead time and feed-forward, such as "kp 25 1/s and kv 150 1/s"."""
        found = f"kp {_per_joint(self.kp)} 1/s"
        if self.kv is not None:
            found += f" and kv {_per_joint(self.kv)} 1/s"
        if self.dead_time.any():
            found += f", dead time {_per_joint(self.dead_time * 1e3)} ms"
        for name in ("velocity", "acceleration"):
            values = getattr(self, f"{name}_feedforward")
            if values.any():
                found += f", {name} feed-forward {_per_joint(values)}"
        return found

    def for_joints(self, dof: int) -> ServoModel:
        """The same servo with one gain, dead time and feed-forward per joint.

        Args:
            dof: Number of joints.

        Raises:
            InvalidInput: The number of gains, dead times or inertias is not 1 or `dof`.
        """
        inertia = self.inertia
        velocity, second = self.velocity_feedforward, self.acceleration_feedforward
        return self.replace(
            velocity_feedforward=_checks.per_joint("velocity_feedforward", velocity, dof, ""),
            acceleration_feedforward=_checks.per_joint("acceleration_feedforward", second, dof, ""),
            kp=_checks.per_joint("servo gain kp", self.kp, dof, "1/s"),
            kv=None if self.kv is None else _checks.per_joint("servo gain kv", self.kv, dof, "1/s"),
            dead_time=_checks.per_joint("dead_time", self.dead_time, dof, "s"),
            inertia=None
            if inertia is None
            else _checks.per_joint("servo inertia", inertia, dof, "kg m²"),
        )

    def replace(self, **changes: Any) -> ServoModel:
        """The same servo with other values of some parameters.

        Args:
            changes: New values by the names of the constructor's parameters.

        Raises:
            InvalidInput: As the constructor raises it, or an unknown name.
        """
        own = {x.name: getattr(self, x.name) for x in fields(self)}
        unknown = sorted(set(changes) - set(own))
        if unknown:
            raise InvalidInput(f"A servo has no {unknown[0]}: it has {', '.join(own)}.")
        return ServoModel(**{**own, **changes})

    @property
    def has_feedforward(self) -> bool:
        """Whether any joint has feed-forward."""
        return bool(self.velocity_feedforward.any())

    @property
    def lead(self) -> tuple[FloatArray, FloatArray]:
        """Factors a [s] and b [s²] by which feed-forward changes the command, (dof,) each.

        The servo responds to u as one without feed-forward to `u + a du + b ddu`.
        """
        velocity = np.asarray(self.velocity_feedforward / self.kp)
        if self.kv is None:
            return velocity, np.zeros_like(velocity)
        return velocity, np.asarray(self.acceleration_feedforward / (self.kp * self.kv))

    @property
    def slowest(self) -> float:
        """Smallest decay rate of any joint [1/s]."""
        if self.kv is None:
            return float(self.kp.min())
        # Rates are the negative real parts of the roots of s² + kv s + kp kv. For real roots the
        # sum of the rates is kv and their product kp kv.
        root = np.sqrt(np.maximum(self.kv * self.kv / 4 - self.kp * self.kv, 0.0))
        fast = self.kv / 2 + root
        return float(np.where(root > 0, self.kp * self.kv / fast, self.kv / 2).min())

    def refuse_too_fast(self, period: float) -> None:
        """Refuse gains that are too large for a command interval.

        Args:
            period: Command interval [s].

        Raises:
            InvalidInput: The interval is longer than MOST_TIME_CONSTANTS time constants.
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

    def command(self, q: FloatArray, dq: FloatArray, ddq: FloatArray | None = None) -> FloatArray:
        """The command that makes the unsaturated servo without dead time follow q [rad], (n, dof).

        Second order: `q + dq / K_p + ddq / (K_p K_v)`, from (6). First order: `q + dq / K_p`. With
        feed-forward, it is `u + a du + b ddu` with the factors of `lead`, from which `compensate`
        gets set-points.

        Args:
            q: Joint positions [rad], (n, dof).
            dq: Joint velocities [rad/s], (n, dof).
            ddq: Joint accelerations [rad/s²], (n, dof); not needed for first order.

        Raises:
            InvalidInput: The accelerations are missing.
        """
        at, rate = _checks.floats("q", q, "rad"), _checks.floats("dq", dq, "rad/s")
        if self.kv is None:
            return np.asarray(at + rate / self.kp)
        if ddq is None:
            raise InvalidInput("A servo of order second needs joint accelerations, too: give ddq.")
        second = _checks.floats("ddq", ddq, "rad/s²")
        return np.asarray(at + rate / self.kp + second / (self.kp * self.kv))

    def response(self, s: npt.ArrayLike) -> FloatArray:
        """Transfer function from command to joint position at each s; complex, (n, joints).

        `G(s) = exp(-s tau) (g s² + f K_v s + K_p K_v) / (s² + K_v s + K_p K_v)`, with f = g = 0
        (5), or for order "first" `exp(-s tau) (f s + K_p) / (s + K_p)`. The interpolation of
        set-points is not included.

        Args:
            s: Complex frequencies [rad/s], (n,).
        """
        at = np.atleast_1d(np.asarray(s))[:, None]
        kp, delay = np.atleast_1d(self.kp), np.exp(-at * np.atleast_1d(self.dead_time))
        a, b = self.lead
        delay = delay * (1 + at * a + at**2 * b)
        if self.kv is None:
            return np.asarray(delay * kp / (at + kp))
        kv = np.atleast_1d(self.kv)
        return np.asarray(delay * (kp * kv / (at**2 + kv * at + kp * kv)))


def _per_joint(values: FloatArray) -> str:
    """Values of all joints in words: one number where they are equal."""
    shown = [f"{x:g}" for x in np.atleast_1d(values)]
    return shown[0] if len(set(shown)) == 1 else ", ".join(shown)


def _check_gain(name: str, values: npt.ArrayLike) -> FloatArray:
    """Gains as a locked array, one for all joints or one per joint.

    Raises:
        InvalidInput: A gain is not a number, not above zero, or outside GAINS.
    """
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


def _check_feedforward(name: str, values: npt.ArrayLike) -> FloatArray:
    """Feed-forward as a locked array, one for all joints or one per joint.

    Raises:
        InvalidInput: One is not a number, or outside 0 to MOST_FEEDFORWARD.
    """
    array = _checks.numbers(name, values, "")
    if array.ndim > 1 or array.size == 0 or not ((array >= 0) & (array <= MOST_FEEDFORWARD)).all():
        raise InvalidInput(
            f"{name} must be from 0 to {MOST_FEEDFORWARD:g}, one for all joints or one per joint, "
            f"but is {array.tolist()}."
        )
    return _checks.lock_floats(array)


def _check_inertia(values: npt.ArrayLike | None, order: str) -> FloatArray | None:
    """Inertias as a locked array, one for all joints or one per joint; None stays None.

    Raises:
        InvalidInput: An inertia is not a number or outside INERTIAS, or the servo has no velocity
            loop.
    """
    if values is None:
        return None
    if order == "first":
        raise InvalidInput("A servo of order first has no velocity loop: leave its inertia out.")
    array = _checks.numbers("servo inertia", values, "kg m²")
    low, high = INERTIAS
    outside = ~((array >= low) & (array <= high))
    if array.ndim > 1 or array.size == 0 or outside.any():
        raise InvalidInput(
            f"servo inertia must be from {low:g} to {high:g} kg m², one for all joints or one per "
            f"joint, but is {array.tolist()} kg m²."
        )
    return _checks.lock_floats(array)
