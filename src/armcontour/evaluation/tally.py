"""Accumulation of a check: for every limit, its largest use and the verdict on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm, Limits, SerialArm
from armcontour.arms.limits import UNITS as LIMIT_UNITS
from armcontour.evaluation.angular_deviation import least_off
from armcontour.geometry import Path

# Below this tool speed [m/s] the direction of motion is not defined, so the centripetal
# acceleration is not defined either.
SLOWEST = 1e-6
# Below this joint velocity [rad/s] dry friction may have any value up to Coulomb friction, in both
# directions.
STILL = 1e-6
# The middle of a range with one end only is this far from its end [rad].
ONE_SIDED = np.pi

VERDICTS = KEPT, CANNOT_TELL, VIOLATED = ("kept", "cannot tell", "violated")
# A limit counts as kept if rounding can explain the excess and the excess is below this share of
# the limit: a plan that uses a limit in full exceeds the limit by a last digit once it is printed.
UNSEEN = 1e-3

# Units of the limits by their names; from this share on a use has an exponent.
UNITS = LIMIT_UNITS | {"path_deviation": "m", "orientation_deviation": "rad"}
MOST_PLAIN = 1e4

# A quantity of the motion: a function of q, of q and dq, or of q, dq and ddq.
Quantity = Callable[..., FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Occurrence:
    """The use of a limit at one time.

    Args:
        ratio: Value over limit; for joint_lower and joint_upper both counted from the middle of the
            joint range.
        value: Value without sign [unit of the limit].
        limit: The limit there.
        t: Time [s].
        joint: Joint number from 1; None for a limit of the tool.
        s: Arc length of the nearest point on the path [m]; None without a path.
        slack: Part of `ratio` that rounding may have caused.
        certain: Smallest ratio that the rounded numbers allow.
    """

    ratio: float
    value: float
    limit: float
    t: float
    joint: int | None
    s: float | None
    slack: float
    certain: float


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitUse(Occurrence):
    """The largest certain use of one limit.

    Args:
        name: The limit: a field of `Limits`, "path_deviation", "orientation_deviation", or a jump
            at a break of a law: "position_step", "velocity_step", "acceleration_step",
            "tool_acceleration_step" or "path_acceleration_step".
        highest: Largest ratio of the numbers as they stand, in the narrowest windows; rounding may
            have caused it.
        verdict: "violated": every motion through the samples, within their digits, exceeds the
            limit. "kept": the motion as it stands keeps the limit everywhere. Else "cannot tell".
    """

    name: str
    highest: Occurrence
    verdict: str

    @property
    def unit(self) -> str:
        """Unit of value and limit."""
        return UNITS.get(self.name, "")

    @property
    def cells(self) -> tuple[str, ...]:
        """Name, share, value, limit, time, joint and verdict as text, for tables."""
        return (
            self.name.replace("_", " "),
            f"{self.ratio:.4f}" if self.ratio < MOST_PLAIN else f"{self.ratio:.4g}",
            f"{self.value:.5g}",
            f"{self.limit:.5g} {self.unit}" if np.isfinite(self.limit) else "none",
            f"{self.t:.4g} s",
            "" if self.joint is None else str(self.joint),
            self.verdict,
        )

    def __str__(self) -> str:
        """How much of the limit is used, when and by which joint."""
        name, share, value, limit, t, joint, verdict = self.cells
        which = f" of joint {joint}" if joint else ""
        return f"{name}{which}: {share} of the limit, {value} of {limit} at t = {t}, {verdict}"


def judge_use(certain: float, highest: float, tolerance: float) -> str:
    """Give the verdict on a limit, from its largest certain ratio and its largest ratio."""
    if certain > 1 + tolerance:
        return VIOLATED
    return KEPT if highest <= 1 + tolerance + UNSEEN else CANNOT_TELL


def merge_uses(first: LimitUse, second: LimitUse) -> LimitUse:
    """Merge the uses of one limit by two motions."""
    use = max(first, second, key=lambda x: x.certain)
    return replace(
        use,
        highest=max(first.highest, second.highest, key=lambda x: x.ratio),
        verdict=max(first.verdict, second.verdict, key=VERDICTS.index),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class States:
    """Joint states at some times, with bounds on the errors of their numbers.

    Args:
        t: Times [s], (n,).
        q: Joint positions [rad], (n, dof).
        dq: Joint velocities [rad/s], (n, dof).
        ddq: Joint accelerations [rad/s²], (n, dof), or None.
        errors: Bounds on the error of q, dq and ddq, (dof,) each.
        dddq: Joint jerks [rad/s³], (n, dof), of a law that knows them; or None.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray | None
    errors: tuple[FloatArray, FloatArray, FloatArray]
    dddq: FloatArray | None = None


class Tally:
    """Accumulator of the largest use of every limit.

    Args:
        arm: The arm.
        limits: The limits, with one value per joint.
        path: The path that the tool was to follow, or None.
        deviation: Largest distance from the path [m].
        orientation_deviation: Largest angle from the required tool orientation [rad].
    """

    def __init__(
        self,
        arm: Arm,
        limits: Limits,
        path: Path | None,
        deviation: float | None,
        orientation_deviation: float | None = None,
    ):
        self.arm, self.limits, self.path, self.deviation = arm, limits, path, deviation
        self.orientation_deviation = orientation_deviation
        self.farthest = {"distance": 0.0, "t": 0.0, "s": 0.0}
        # Whether offered values count for the highest ratio. Means over wider windows are more
        # certain, but never above the means over the narrower windows inside them.
        self.narrow = True
        self._certain: dict[str, tuple[Occurrence, FloatArray]] = {}
        self._highest: dict[str, tuple[Occurrence, FloatArray]] = {}

    def offer(
        self,
        name: str,
        t: FloatArray,
        value: FloatArray,
        limit: npt.ArrayLike,
        q: FloatArray,
        error: npt.ArrayLike = 0.0,
        zero: FloatArray | float = 0.0,
    ) -> float:
        """Accumulate values of a limited quantity: keep the largest certain and highest ratios.

        NaN counts as an infinite ratio, of which nothing is certain.

        Args:
            name: The limit.
            t: Times [s], (n,).
            value: Values, (n, dof) for joints or (n,) for the tool.
            limit: One limit, or one per joint, (dof,).
            q: Joint positions [rad], (n, dof).
            error: Bound on the error of `value`, broadcast to its shape.
            zero: Origin of values and limits, one or (dof,); above the limit for a lower limit.

        Returns:
            Largest share of the limit that rounding may have caused.
        """
        if not value.size:
            return 0.0
        allowed = np.broadcast_to(np.asarray(limit, dtype=np.float64), value.shape)
        off, (used, room) = np.asarray(error, dtype=np.float64), _use(value, limit, zero)
        # With a very small limit the ratio may overflow.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            ratio = certain = used / room
            slack = np.zeros(1)
            if off.any() or not (room > 0).all() or np.isnan(ratio).any():
                ratio = _without_nan(ratio, np.inf)
                slack = _without_nan(np.asarray(off / room), np.inf)
                certain = _without_nan((used - off) / room, -np.inf)
        slack = np.broadcast_to(slack, value.shape)

        def occurrence(i: int) -> tuple[Occurrence, FloatArray]:
            at = np.unravel_index(i, value.shape)
            found = Occurrence(
                ratio=float(ratio[at]),
                value=float(value[at]),
                limit=float(allowed[at]),
                t=float(t[at[0]]),
                joint=int(at[1]) + 1 if value.ndim == 2 else None,
                s=None,
                slack=float(slack[at]),
                certain=float(certain[at]),
            )
            return found, q[at[0]]

        i = int(np.argmax(certain))
        if name not in self._certain or certain.flat[i] > self._certain[name][0].certain:
            self._certain[name] = occurrence(i)
        i = int(np.argmax(ratio))
        known = self._highest.get(name)
        if known is None or (self.narrow and ratio.flat[i] > known[0].ratio):
            self._highest[name] = occurrence(i)
        return float(slack.max())

    def joint_acceleration(
        self, t: FloatArray, ddq: FloatArray, q: FloatArray, error: npt.ArrayLike = 0.0
    ) -> float:
        """Offer joint accelerations, each with the limit of its direction."""
        up, down = self.limits.joint_acceleration, self.limits.joint_deceleration
        if up is None:
            return 0.0
        if down is None:
            return self.offer("joint_acceleration", t, np.abs(ddq), up, q, error)
        return max(
            self.offer("joint_acceleration", t, np.maximum(ddq, 0.0), up, q, error),
            self.offer("joint_deceleration", t, np.maximum(-ddq, 0.0), down, q, error),
        )

    def joint_range(self, t: FloatArray, q: FloatArray, error: npt.ArrayLike = 0.0) -> None:
        """Offer joint positions to both ends of their ranges."""
        lower, upper = self.limits.joint_range(self.arm.dof)
        both = np.isfinite(lower) & np.isfinite(upper)
        half = np.where(both, np.where(both, upper / 2 - lower / 2, 0.0), ONE_SIDED)
        for name, end, middle in (
            ("joint_lower", lower, lower + half),
            ("joint_upper", upper, upper - half),
        ):
            known = np.isfinite(end)
            if getattr(self.limits, name) is None or not known.any():
                continue
            # A joint without this end has an infinite range, of which no part is used.
            value = np.where(known, q, 0.0)
            far, zero = np.where(known, end, np.inf), np.where(known, middle, 0.0)
            self.offer(name, t, value, far, q, error, zero)

    def torque(self, x: States) -> None:
        """Offer joint torques, if the arm has masses."""
        limit = self.limits.joint_torque
        if limit is None or x.ddq is None or not self.arm.has_bodies:
            return
        chain = self.arm.chain
        assert chain is not None and chain.coulomb is not None
        coulomb = chain.coulomb

        def without_dry(q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
            return np.asarray(self.arm.torque(q, dq, ddq) - coulomb * np.sign(dq))

        torque = without_dry(x.q, x.dq, x.ddq)
        error = np.zeros_like(torque)
        for change in _changes(x, without_dry, torque, 2):
            error += np.abs(change)
        # If a joint may be at rest, dry friction takes the most favourable value.
        helping = -np.clip(torque, -coulomb, coulomb)
        still = np.abs(x.dq) <= STILL + x.errors[1]
        least = np.abs(torque + np.where(still, helping, coulomb * np.sign(x.dq)))
        stands = np.abs(x.dq) <= STILL
        value = np.abs(torque + np.where(stands, helping, coulomb * np.sign(x.dq)))
        self.offer("joint_torque", x.t, value, limit, x.q, error + np.maximum(value - least, 0.0))

    def turning(self, x: States) -> None:
        """Offer angular velocity and acceleration of the tool, where it has an orientation."""
        limits, arm = self.limits, self.arm
        if not isinstance(arm, SerialArm):
            return
        if limits.angular_speed is not None:
            rate, error = self.bounded(x, angular(arm.tool_twist), 1)
            size = np.linalg.norm(rate, axis=1)
            self.offer("angular_speed", x.t, size, limits.angular_speed, x.q, error)
        if limits.angular_acceleration is not None and x.ddq is not None:
            found, error = self.bounded(x, angular(arm.tool_twist_rate), 2)
            size = np.linalg.norm(found, axis=1)
            self.offer("angular_acceleration", x.t, size, limits.angular_acceleration, x.q, error)

    def jerk(self, x: States) -> None:
        """Offer the jerks of joints and tool, where a law knows them."""
        limits = self.limits
        if x.dddq is None or x.ddq is None:
            return
        if limits.joint_jerk is not None:
            self.offer("joint_jerk", x.t, np.abs(x.dddq), limits.joint_jerk, x.q)
        if limits.tool_jerk is not None:
            found = self.arm.tool_jerk(x.q, x.dq, x.ddq, x.dddq)
            self.offer("tool_jerk", x.t, np.linalg.norm(found, axis=1), limits.tool_jerk, x.q)

    def states(self, x: States) -> None:
        """Offer all quantities of joints and tool at given states."""
        limits = self.limits
        self.joint_range(x.t, x.q, x.errors[0])
        self.torque(x)
        self.turning(x)
        self.jerk(x)
        if limits.joint_velocity is not None:
            self.offer("joint_velocity", x.t, np.abs(x.dq), limits.joint_velocity, x.q, x.errors[1])
        if x.ddq is not None:
            self.joint_acceleration(x.t, x.ddq, x.q, x.errors[2])
        self.tool_motion(x)

    def tool_motion(self, x: States) -> None:
        """Offer speed and acceleration of the tool."""
        limits = self.limits
        accelerations = (limits.tool_acceleration, limits.centripetal_acceleration)
        ddq = x.ddq if any(y is not None for y in accelerations) else None
        if limits.speed is None and ddq is None:
            return
        if ddq is None:
            velocity = self.arm.tool_velocity(x.q, x.dq)
        else:
            velocity, acceleration = self.arm.tool_motion(x.q, x.dq, ddq)
        speed = np.linalg.norm(velocity, axis=1)
        velocity_error = self._spread(x, self.arm.tool_velocity, velocity, 1)
        if limits.speed is not None:
            self.offer("speed", x.t, speed, limits.speed, x.q, velocity_error)
        if ddq is None:
            return
        size = np.linalg.norm(acceleration, axis=1)
        error = self._spread(x, self.arm.tool_acceleration, acceleration, 2)
        if limits.tool_acceleration is not None:
            self.offer("tool_acceleration", x.t, size, limits.tool_acceleration, x.q, error)
        # An error of the direction of motion makes a normal part of tangential acceleration.
        turned = size * np.minimum(1.0, velocity_error / np.maximum(speed, SLOWEST))
        self.centripetal(x.t, velocity, acceleration, x.q, error + turned, speed > SLOWEST)

    def centripetal(
        self,
        t: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        q: FloatArray,
        error: FloatArray,
        where: BoolArray,
    ) -> float:
        """Offer the part of tool accelerations normal to `velocity`, where the tool moves."""
        limit = self.limits.centripetal_acceleration
        if limit is None:
            return 0.0
        v, a = velocity[where], acceleration[where]
        direction = v / np.linalg.norm(v, axis=1)[:, None]
        normal = a - np.einsum("ij,ij->i", a, direction)[:, None] * direction
        value = np.linalg.norm(normal, axis=1)
        return self.offer(
            "centripetal_acceleration", t[where], value, limit, q[where], error[where]
        )

    def bounded(self, x: States, function: Quantity, order: int) -> tuple[FloatArray, FloatArray]:
        """A quantity of the tool, (n, columns), and a bound on the length of its error, (n,).

        Args:
            x: The states.
            function: Gives the quantity from q and its first derivatives.
            order: Number of these derivatives.
        """
        known = x.q, x.dq, x.q if x.ddq is None else x.ddq
        value = function(*known[: order + 1])
        return value, self._spread(x, function, value, order)

    def tool(self, q: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tool points [m], (n, dimension), and a bound on the length of their error, (n,)."""
        none = np.zeros_like(error)
        x = States(t=q[:, 0], q=q, dq=np.zeros_like(q), ddq=None, errors=(error, none, none))
        return self.bounded(x, self.arm.forward, 0)

    def pose(self, t: FloatArray, q: FloatArray, error: FloatArray) -> None:
        """Offer the distance of the tool from the path and from the required tool orientation."""
        if self.path is None:
            return
        points, off = self.tool(q, error)
        nearest = self.path.project(points)
        worst = int(np.argmax(_without_nan(nearest.distance, np.inf)))
        if nearest.distance[worst] >= self.farthest["distance"]:
            self.farthest = {
                "distance": float(nearest.distance[worst]),
                "t": float(t[worst]),
                "s": float(nearest.s[worst]),
            }
        if self.deviation is not None:
            self.offer("path_deviation", t, nearest.distance, self.deviation, q, off)
        allowed, orientation = self.orientation_deviation, self.path.orientation
        if allowed is None or orientation is None or not isinstance(self.arm, SerialArm):
            return
        reach = self.farthest["distance"] if self.deviation is None else self.deviation
        angle = least_off(self.path, points, nearest, self.arm.pose(q)[1], reach)
        # An error of a joint position turns the tool by at most the same angle. An error of the
        # tool point moves the nearest point to another required orientation.
        rate = np.linalg.norm(orientation.rates(nearest.s)[0], axis=1)
        slack = float(error.sum()) + rate * off
        self.offer("orientation_deviation", t, angle, allowed, q, slack)

    def uses(self, tolerance: float) -> tuple[LimitUse, ...]:
        """The largest uses of all limits, with arc lengths on the path and verdicts."""
        found = [*self._certain.values(), *self._highest.values()]
        uses = [x for x, _ in found]
        if self.path is not None and found:
            s = self.path.project(self.arm.forward(np.array([q for _, q in found]))).s
            uses = [replace(x, s=float(at)) for x, at in zip(uses, s, strict=True)]
        certain, highest = uses[: len(self._certain)], uses[len(self._certain) :]
        return tuple(
            LimitUse(
                name=name,
                highest=most,
                verdict=judge_use(x.certain, most.ratio, tolerance),
                **{y.name: getattr(x, y.name) for y in fields(x)},
            )
            for name, x, most in zip(self._certain, certain, highest, strict=True)
        )

    def _spread(self, x: States, function: Quantity, value: FloatArray, order: int) -> FloatArray:
        """Bound on the length of the error of a tool quantity from the errors of states, (n,)."""
        total = np.zeros(len(value))
        for change in _changes(x, function, value, order):
            total += np.linalg.norm(change, axis=1)
        # The joint effect of two errors is less than the effect of one times the other's angle.
        return np.asarray(total * (1 + x.errors[0].sum()))


def _changes(x: States, function: Quantity, value: FloatArray, order: int) -> Iterator[FloatArray]:
    """Changes of a quantity with the error of each number of q and its first `order` rates."""
    columns = [x.q, x.dq, x.q if x.ddq is None else x.ddq][: order + 1]
    for k in range(len(columns)):
        for joint in np.flatnonzero(x.errors[k]):
            moved = list(columns)
            moved[k] = columns[k].copy()
            moved[k][:, joint] += x.errors[k][joint]
            yield function(*moved) - value


def share_of(value: FloatArray, limit: npt.ArrayLike, zero: FloatArray | float = 0.0) -> FloatArray:
    """Values over a limit, which is counted from an origin; NaN counts as an infinite share."""
    used, room = _use(value, limit, zero)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _without_nan(used / room, np.inf)


def _use(
    value: FloatArray, limit: npt.ArrayLike, zero: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """How far values are from an origin, towards a limit; and how far the limit is from there."""
    allowed = np.asarray(limit, dtype=np.float64)
    used = np.where(allowed < zero, zero - value, value - zero)
    return used, np.asarray(np.abs(allowed - zero))


def _without_nan(values: FloatArray, instead: float) -> FloatArray:
    """The values, with NaN replaced."""
    none = np.isnan(values)
    return np.where(none, instead, values) if none.any() else values


def angular(twist: Quantity) -> Quantity:
    """The angular part of a twist."""
    return lambda *states: twist(*states)[:, 3:]
