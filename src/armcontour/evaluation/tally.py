"""Use of every limit by a motion: along its laws, at its peaks, and the verdict of a check."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm, Limits, SerialArm
from armcontour.arms.limits import UNITS as LIMIT_UNITS
from armcontour.arms.limits import by_direction
from armcontour.core.render import Result, number
from armcontour.core.result import Data, Row
from armcontour.errors import InvalidInput
from armcontour.evaluation.error_profile import least_off
from armcontour.geometry import Path
from armcontour.motion import PathLaw, Trajectory

# Places in each interval of a law, its ends included: so many at least, and no more unless all
# intervals together have fewer than FEWEST; those with fewer than ENOUGH have more than the least.
LEAST_PLACES, MOST_PLACES = 3, 20
FEWEST, ENOUGH = 4000, 12_000
# So many of the highest parabolas are looked at more closely, so often, each time so much narrower.
PEAKS, ROUNDS, NARROWER = 12, 2, 1 / 16
# They are at least this share of an interval away from its ends, which are known.
INSIDE = 1e-9

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

# Units of the limits by their names.
UNITS = LIMIT_UNITS | {
    **{"path_deviation": "m", "path_missed": "m", "orientation_deviation": "rad"},
    **{"position_step": "rad", "velocity_step": "rad/s", "acceleration_step": "rad/s²"},
    **{"tool_acceleration_step": "m/s²", "path_acceleration_step": "m/s²"},
}

# A quantity of the motion: a function of q, of q and dq, or of q, dq and ddq.
Quantity = Callable[..., FloatArray]
# Places that are judged at a time.
CHUNK = 200_000
# Accelerations may jump at a break by what a limit of jerk covers in this time [s], which no
# controller resolves: jumps by rounding are smaller, those of plans without such a limit larger.
AT_ONCE = 1e-5
# Limits of jerk, with the jumps at breaks that break them.
JUMPS = {
    "joint_jerk": "acceleration_step",
    "tool_jerk": "tool_acceleration_step",
    "path_jerk": "path_acceleration_step",
}
ORDERS = ("positions", "velocities", "accelerations", "jerks")
# Joint positions may jump by this much at a break [rad]: rounding, not motion.
POSITION_STEP = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Occurrence:
    """The use of a limit at one time.

    Args:
        ratio: Value over limit; for joint_lower and joint_upper both counted from the middle of the
            joint range.
        value: Value without sign [unit of the limit].
        limit: The limit there.
        t: Time [s].
        joint: Index of the joint, from 0; None for a limit of the tool.
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

    def rows(self, unit: str) -> tuple[Row, ...]:
        """Its figures; joints are counted from 1.

        Args:
            unit: Unit of the limit.
        """
        joint = None if self.joint is None else self.joint + 1
        return (
            Row("ratio", self.ratio, "1", "share"),
            Row("value", self.value, unit, "value"),
            Row("limit", self.limit, unit, "of"),
            Row("t", self.t, "s", "at"),
            Row("joint", joint, "", "joint"),
            *(
                Row("certain", self.certain, "1"),
                Row("slack", self.slack, "1"),
                Row("s", self.s, "m"),
            ),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitUse(Result, Occurrence):
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

    def to_data(self) -> Data:
        """How much of the limit is used, when and by which joint."""
        highest = self.highest.rows(self.unit)
        printed = f"as printed {number(self.highest.ratio, '1')}"
        return Data(
            f"Use of {self.name}",
            (
                Row("name", self.name, "", "limit"),
                *self.rows(self.unit),
                Row(
                    "verdict", self.verdict, "", "verdict", printed * (self.verdict == CANNOT_TELL)
                ),
                *(replace(x, label="") for x in Data("", highest).under("highest")),
            ),
        )


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
                joint=int(at[1]) if value.ndim == 2 else None,
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

    def rates(
        self, name: str, t: FloatArray, rates: FloatArray, q: FloatArray, error: npt.ArrayLike = 0.0
    ) -> float:
        """Offer rates of joints, (n, dof), or vectors of the tool, (n, d), to their limit, if any.

        Joint velocities and accelerations have the limit of their direction. Arguments are as of
        `offer`; errors of vectors are those of their lengths.
        """
        limits, dof = self.limits, self.arm.dof
        limit = getattr(limits, name)
        if limit is None:
            return 0.0
        if name == "joint_velocity":
            rates, limit = by_direction(rates, limits.velocity_bounds(dof))
        elif name == "joint_acceleration":
            rates, limit = by_direction(rates, limits.acceleration_bounds(dof))
        elif name == "joint_jerk":
            rates = np.abs(rates)
        else:
            rates, error = np.linalg.norm(rates, axis=1), np.ravel(error)
        return self.offer(name, t, rates, limit, q, error)

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
            self.rates("angular_speed", x.t, rate, x.q, error)
        if limits.angular_acceleration is not None and x.ddq is not None:
            rate, error = self.bounded(x, angular(arm.tool_twist_rate), 2)
            self.rates("angular_acceleration", x.t, rate, x.q, error)

    def jerk(self, x: States) -> None:
        """Offer the jerks of joints and tool, where a law knows them."""
        if x.dddq is None or x.ddq is None:
            return
        self.rates("joint_jerk", x.t, x.dddq, x.q)
        if self.limits.tool_jerk is not None:
            self.rates("tool_jerk", x.t, self.arm.tool_jerk(x.q, x.dq, x.ddq, x.dddq), x.q)

    def states(self, x: States) -> None:
        """Offer all quantities of joints and tool at given states."""
        self.joint_range(x.t, x.q, x.errors[0])
        self.torque(x)
        self.turning(x)
        self.jerk(x)
        self.rates("joint_velocity", x.t, x.dq, x.q, x.errors[1])
        if x.ddq is not None:
            self.rates("joint_acceleration", x.t, x.ddq, x.q, x.errors[2])
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
        off = self._spread(x, self.arm.tool_velocity, velocity, 1)
        self.rates("speed", x.t, velocity, x.q, off)
        if ddq is None:
            return
        error = self._spread(x, self.arm.tool_acceleration, acceleration, 2)
        self.rates("tool_acceleration", x.t, acceleration, x.q, error)
        speed, size = np.linalg.norm(velocity, axis=1), np.linalg.norm(acceleration, axis=1)
        # An error of the direction of motion makes a normal part of tangential acceleration.
        turned = size * np.minimum(1.0, off / np.maximum(speed, SLOWEST))
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
        return self.bounded(x, self.arm.tool_position, 0)

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
            s = self.path.project(self.arm.tool_position(np.array([q for _, q in found]))).s
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


class Law(Protocol):
    """Joint positions over time as a law, such as a `Trajectory`."""

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""

    @property
    def breaks(self) -> FloatArray:
        """Times between which the law is smooth, its start and end included [s]."""

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Joint positions, velocities, accelerations or jerks, (n, dof).

        Of a law that refuses the order 3, jerk is not judged.
        """


def judge_law(law: Law, tally: Tally, *, points: int, seed: int, velocity_step: float) -> int:
    """Offer the law's states to the tally; returns how many.

    Args:
        law: The law.
        tally: Where findings go.
        points: Random places per interval.
        seed: Of the random places.
        velocity_step: Largest jump of a joint's velocity at a break [rad/s].

    Raises:
        InvalidInput: Breaks that do not increase, or a value that is not finite.
    """
    breaks = np.asarray(law.breaks, dtype=np.float64)
    if breaks.ndim != 1 or len(breaks) < 2 or not (np.diff(breaks) > 0).all():
        raise InvalidInput("The breaks of a law must be at least two times that increase.")
    random = np.random.default_rng(seed)
    jerks = find_known_jerks(law, tally.limits, breaks[:1])
    size = max(1, CHUNK // (points + 2))
    count = 0
    for first in range(0, len(breaks) - 1, size):
        ends = breaks[first : first + size + 1]
        inner = ends[:-1, None] + random.random((len(ends) - 1, points)) * np.diff(ends)[:, None]
        right = np.concatenate([ends[:-1], inner.ravel()])
        left = ends[1:]
        states = offer_states(law, tally, right, left, jerks)
        count += len(states.t)
        tally.pose(states.t, states.q, states.errors[0])
        if "path_jerk" in jerks:
            offer_path_jerk(law, tally, right, left, states)
        _acceleration_steps(
            law, ends if first == 0 else left, tally, jerks, (breaks[0], breaks[-1])
        )
        _steps(
            law, ends[1:] if first + size < len(breaks) - 1 else ends[1:-1], tally, velocity_step
        )
    return count


def offer_states(
    law: Law, tally: Tally, right: FloatArray, left: FloatArray, jerks: Collection[str]
) -> States:
    """Offer what joints and tool do at some times to a tally.

    Args:
        law: The law.
        tally: Where findings go.
        right: Times at which a break belongs to the interval after it [s], (n,).
        left: Times at which a break belongs to the interval before it [s], (m,).
        jerks: The limits of jerk that are judged.

    Returns:
        The states, (n + m, dof).

    Raises:
        InvalidInput: A value is not finite, or the law has another number of joints.
    """
    # Of joints and tool the third derivative is asked for only where it is judged.
    order = 3 if set(jerks) - {"path_jerk"} else 2
    states = _states(law, right, left, tally.arm.dof, order)
    tally.states(states)
    return states


def offer_path_jerk(
    law: Law, tally: Tally, right: FloatArray, left: FloatArray, states: States
) -> None:
    """Offer the path jerk at some times to a tally; arguments as of `offer_states`."""
    along = cast("Any", law)
    rate = np.concatenate([along.s(right, 3), along.s(left, 3, side="left")])
    tally.offer("path_jerk", states.t, np.abs(rate), _limit(tally, "path_jerk"), states.q)


def _states(law: Law, right: FloatArray, left: FloatArray, dof: int, order: int) -> States:
    t = np.concatenate([right, left])
    if isinstance(law, Trajectory):
        # All derivatives at once.
        after, before = law.motion(right, order), law.motion(left, order, side="left")
    else:
        after, before = (
            tuple(law(at, k, side=side) for k in range(order + 1))
            for at, side in ((right, "right"), (left, "left"))
        )
    columns = []
    for name, *sides in zip(ORDERS[: order + 1], after, before, strict=True):
        values = np.concatenate(sides)
        if values.shape != (len(t), dof):
            raise InvalidInput(
                f"The law gives {values.shape[-1]} joints, but the arm has {dof}: "
                "give the arm that the law was made for."
            )
        if not np.isfinite(values).all():
            at = float(t[~np.isfinite(values).all(axis=1)][0])
            raise InvalidInput(f"The law's {name} are not finite at t = {at:.9g} s.", t=at)
        columns.append(values)
    q, dq, ddq, *dddq = columns
    none = np.zeros(dof)
    return States(t=t, q=q, dq=dq, ddq=ddq, errors=(none,) * 3, dddq=dddq[0] if dddq else None)


def _steps(law: Law, t: FloatArray, tally: Tally, velocity_step: float) -> None:
    """Offer the jumps at breaks, which no acceleration at either side would show."""
    if not len(t):
        return
    q = law(t)
    tally.offer("position_step", t, np.abs(q - law(t, side="left")), POSITION_STEP, q)
    limits = tally.limits
    derived = (limits.joint_acceleration, limits.joint_torque, limits.joint_jerk)
    if any(x is not None for x in derived):
        jump = np.abs(law(t, 1) - law(t, 1, side="left"))
        tally.offer("velocity_step", t, jump, velocity_step, q)


def _acceleration_steps(
    law: Law, t: FloatArray, tally: Tally, names: Collection[str], ends: tuple[float, float]
) -> None:
    """Offer the jumps of accelerations at breaks, which no jerk at either side would show.

    Before a motion that starts at rest, and after one that ends at rest, accelerations are zero.

    Args:
        law: The law.
        t: Breaks [s], (n,).
        tally: Where findings go.
        names: The limits of jerk that are judged.
        ends: The first and the last break [s].
    """
    if not names:
        return
    q = law(t)
    resting = np.abs(law(t, 1)).max(axis=1) <= STILL
    for name in names:
        before, after = (_accelerations(law, t, tally, name, side) for side in ("left", "right"))
        before[resting & (t == ends[0])] = 0.0
        after[resting & (t == ends[1])] = 0.0
        jump = np.abs(after - before)
        size = jump if name == "joint_jerk" else np.linalg.norm(jump, axis=1)
        tally.offer(JUMPS[name], t, size, AT_ONCE * _limit(tally, name), q)


def _limit(tally: Tally, name: str) -> FloatArray:
    return np.asarray(getattr(tally.limits, name))


def _accelerations(law: Law, t: FloatArray, tally: Tally, name: str, side: str) -> FloatArray:
    """The accelerations whose rate a limit of jerk bounds, at one side of times, (n, columns)."""
    if name == "path_jerk":
        return np.array(cast("Any", law).s(t, 2, side=side))[:, None]
    q, dq, ddq = (law(t, order, side=side) for order in range(3))
    return np.array(ddq if name == "joint_jerk" else tally.arm.tool_acceleration(q, dq, ddq))


def find_known_jerks(law: Law, limits: Limits, start: FloatArray) -> tuple[str, ...]:
    """Find the limits of jerk that can be judged of a law: of joints and tool, along a path.

    Args:
        law: The law.
        limits: The limits.
        start: Its first time [s], (1,).
    """
    limited = (x for x in JUMPS if getattr(limits, x) is not None)
    return tuple(x for x in limited if _knows_jerk(law, start, along=x == "path_jerk"))


def _knows_jerk(law: Law, start: FloatArray, *, along: bool) -> bool:
    """Whether a law has a third derivative, of its joints or `along` its tool path."""
    # Of a law without a tool path s is the value of any parameter.
    if along and getattr(law, "path", None) is None:
        return False
    try:
        _ = cast("Any", law).s(start, 3) if along else law(start, 3)
    except (InvalidInput, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return False
    return True


def measure_limit_ratios(trajectory: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Measure the largest used share of every limit: 1 is the limit.

    In a program, limits of the tool count along contours, limits of the joints in every move.

    Args:
        trajectory: The planned motion.
        arm: The arm.
        limits: The limits, with one value per joint.

    Returns:
        A share for the field of every limit that is given and can be judged.
    """
    found: dict[str, float] = {}
    for motion, bounds in _parts(trajectory, limits):
        for name, ratio in _largest_shares(motion, _Shares(arm, bounds)).items():
            found[name] = max(ratio, found.get(name, ratio))
    return found


def _parts(trajectory: Trajectory, limits: Limits) -> Iterator[tuple[Trajectory, Limits]]:
    """Motions, each with the limits that hold in all of it."""
    if all(x.kind == "contour" for x in trajectory.spans):
        yield trajectory, limits
        return
    yield trajectory, limits.of_joints
    for span in trajectory.contour_spans:
        if span.trajectory is not None:
            yield span.trajectory, limits.of_tool


class _Shares(Tally):
    """A tally that keeps all shares instead of the largest ones.

    Attributes:
        shares: The shares of each limit that were offered last, (n, joints or 1).
    """

    def __init__(self, arm: Arm, limits: Limits) -> None:
        super().__init__(arm, limits, None, None)
        self.shares: dict[str, FloatArray] = {}

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
        """Keep the shares of a limit; arguments as of every tally."""
        if value.size:
            self.shares[name] = share_of(value, limit, zero).reshape(len(value), -1)
        return 0.0

    def centripetal(
        self,
        t: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        q: FloatArray,
        error: FloatArray,
        where: BoolArray,
    ) -> float:
        """Keep the shares of tool accelerations normal to `velocity`: 0 where the tool rests."""
        name = "centripetal_acceleration"
        super().centripetal(t, velocity, acceleration, q, error, where)
        if name in self.shares:
            moving = self.shares[name]
            self.shares[name] = np.zeros((len(t), 1))
            self.shares[name][where] = moving
        return 0.0

    def at(self, motion: Trajectory, right: FloatArray, left: FloatArray) -> dict[str, FloatArray]:
        """Shares of all limits on the right side of times, then on the left side of others [s]."""
        self.shares = {}
        jerks = find_known_jerks(motion, self.limits, motion.starts[:1])
        states = offer_states(motion, self, right, left, jerks)
        if "path_jerk" in jerks:
            offer_path_jerk(motion, self, right, left, states)
        return self.shares


def _largest_shares(motion: Trajectory, shares: _Shares) -> dict[str, float]:
    """The largest share of every limit in a motion."""
    breaks = _smooth_pieces(motion)
    few, enough = (-(-x // (len(breaks) - 1)) for x in (FEWEST, ENOUGH))
    places = max(LEAST_PLACES, few, min(MOST_PLACES, enough))
    part = np.linspace(0.0, 1.0, places)[:, None]
    size = max(1, CHUNK // places)
    best: dict[str, float] = {}
    peaks: dict[str, list[FloatArray]] = {}
    for first in range(0, len(breaks) - 1, size):
        ends = breaks[first : first + size + 1]
        t = ends[:-1] + part * np.diff(ends)
        t[-1] = ends[1:]
        for name, values in shares.at(motion, t[:-1].ravel(), t[-1]).items():
            best[name] = max(best.get(name, -np.inf), float(values.max()))
            found = _find_peaks(t, values.reshape(*t.shape, -1), best[name])
            peaks.setdefault(name, []).append(found)
    _climb(motion, shares, best, {x: _highest(np.hstack(y)) for x, y in peaks.items()})
    return best


def _smooth_pieces(motion: Trajectory) -> FloatArray:
    """Times between which both the laws and their joint paths are smooth [s]."""
    found = [motion.breaks]
    for law, start in zip(motion.laws, motion.starts[:-1], strict=True):
        if isinstance(law, PathLaw):
            # Those of most laws are breaks of the law, too.
            passed = np.setdiff1d(law.joint_path.breaks, law.s)
            passed = passed[(passed > law.s[0]) & (passed < law.s[-1])]
            found.append(start + law.reach(passed)[1])
    return np.unique(np.concatenate(found))


def _find_peaks(t: FloatArray, values: FloatArray, least: float) -> FloatArray:
    """The highest parabolas through three neighbouring places of an interval, above `least`.

    Args:
        t: Evenly spaced times of every interval [s], (places, n).
        values: Shares there, (places, n, columns).
        least: Lower parabolas do not count.

    Returns:
        Of each the height, when it is highest [s], half its width [s], the ends of its interval [s]
        and the column, (6, m).
    """
    before, middle, after = values[:-2], values[1:-1], values[2:]
    bend, tilt = before - 2 * middle + after, (after - before) / 2
    # Elsewhere the highest place is an end.
    round_ = np.flatnonzero((bend < 0) & (np.abs(tilt) < -bend))
    bend, tilt = bend.flat[round_], tilt.flat[round_]
    height = middle.flat[round_] - tilt**2 / (2 * bend)
    at, which, column = np.unravel_index(round_, middle.shape)
    half = t[1, which] - t[0, which]
    when = t[at + 1, which] - tilt / bend * half
    rows = np.stack([height, when, half, t[0, which], t[-1, which], column])
    return _highest(rows[:, height > least])


def _highest(peaks: FloatArray) -> FloatArray:
    """The highest of the peaks from `_find_peaks`."""
    return peaks[:, np.argsort(-peaks[0], kind="stable")[:PEAKS]]


def _climb(
    motion: Trajectory, shares: _Shares, best: dict[str, float], peaks: dict[str, FloatArray]
) -> None:
    """Raise the largest shares to those at peaks from `_find_peaks`."""
    rows = np.hstack([np.zeros((6, 0)), *peaks.values()])
    if not rows.size:
        return
    _, t, half, low, high, column = rows
    of = np.repeat(np.arange(len(peaks)), [x.shape[1] for x in peaks.values()])
    margin = INSIDE * (high - low)
    for _ in range(ROUNDS):
        t = np.clip(t, low + margin, high - margin)
        half = np.minimum(NARROWER * half, np.minimum(t - low, high - t) / 2)
        found = shares.at(motion, (t + half * [[-1], [0], [1]]).ravel(), np.zeros(0))
        for k, name in enumerate(peaks):
            mine = np.flatnonzero(of == k)
            values = found[name].reshape(3, len(t), -1)[:, mine, column[mine].astype(np.intp)]
            best[name] = max(best[name], float(values.max(initial=-np.inf)))
            bend, tilt = values[0] - 2 * values[1] + values[2], (values[2] - values[0]) / 2
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(bend < 0, np.clip(-tilt / bend, -1, 1), np.sign(tilt))
            t[mine] += step * half[mine]
