"""What a check found: for every limit, where it is used most, and the verdict on it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np
import numpy.typing as npt

from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm, Limits, SerialArm
from armcontour.errors import InvalidInput
from armcontour.evaluation.angular_deviation import least_off
from armcontour.geometry import Path

# Below this tool speed [m/s] the direction of motion, and so the centripetal part, is not defined.
SLOWEST = 1e-6
# Below this joint velocity [rad/s] dry friction may have any value up to Coulomb's, either way.
STILL = 1e-6
# A range with one end only is taken to have its middle this far from it [rad].
ONE_SIDED = np.pi

VERDICTS = KEPT, CANNOT_TELL, VIOLATED = ("kept", "cannot tell", "violated")
# A limit counts as kept if rounding alone may have made the excess, and the excess is below this
# part of the limit: a plan that uses a limit in full exceeds it, once printed, by a last digit.
UNSEEN = 1e-3

# A quantity of the motion, from q, dq and ddq as far as it takes them.
Quantity = Callable[..., FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Occurrence:
    """How far a limit is used at one time.

    Args:
        ratio: value / limit; for joint_lower and joint_upper both counted from the middle of the
            joint's range.
        value: Amount [unit of the limit].
        limit: What is allowed there.
        t: When [s].
        joint: Joint number from 1; None for a limit of the tool.
        s: Nearest place on the path [m], if a path was given.
        slack: The part of `ratio` that rounding may have made.
        certain: The ratio that is left when rounding is given the benefit of the doubt.
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
    """How far one limit is used, at the time where it is certainly used most.

    Args:
        name: The limit: a field of `Limits`, "path_deviation", "orientation_deviation",
            "position_step" or "velocity_step".
        highest: Where the ratio of the numbers as they stand is largest, in the narrowest windows;
            rounding may have made it.
        verdict: "violated": every motion through the samples, as far as their digits tell, exceeds
            the limit. "kept": the motion as it is written keeps it everywhere. "cannot tell":
            neither.
    """

    name: str
    highest: Occurrence
    verdict: str


def judge_use(certain: float, highest: float, tolerance: float) -> str:
    """The verdict on a limit, from its largest certain ratio and its largest ratio."""
    if certain > 1 + tolerance:
        return VIOLATED
    return KEPT if highest <= 1 + tolerance + UNSEEN else CANNOT_TELL


def merge_uses(first: LimitUse, second: LimitUse) -> LimitUse:
    """The use of a limit by two motions, from its uses by each."""
    use = max(first, second, key=lambda x: x.certain)
    return replace(
        use,
        highest=max(first.highest, second.highest, key=lambda x: x.ratio),
        verdict=max(first.verdict, second.verdict, key=VERDICTS.index),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class States:
    """Joint states at some times, and how far each number may be off.

    Args:
        t: Times [s], (n,).
        q, dq, ddq: Joints, (n, dof).
        errors: Bounds on the error of q, dq and ddq, (dof,) each.
    """

    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray | None
    errors: tuple[FloatArray, FloatArray, FloatArray]


class Tally:
    """The largest use of every limit so far.

    Args:
        arm: The arm.
        limits: One value per joint.
        path: The path the tool was to follow.
        deviation: Largest distance from it [m].
        orientation_deviation: Largest angle from how the path has the tool held [rad].
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
        # Whether what is offered counts as it stands. Means over wider windows say more of what is
        # certain, but as they stand they are never above those over the windows in them.
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
        """Remember where a limit is used most, certainly and as it stands; returns largest slack.

        NaN counts as a ratio without bound, of which nothing is certain.

        Args:
            name: The limit.
            t: Times (n,).
            value: Amounts, (n, dof) for joints or (n,) for the tool.
            limit: Per joint (dof,), or one.
            q: Joint positions there, (n, dof).
            error: Bound on the error of `value`, of a shape that fits.
            zero: Where both are counted from, one or (dof,); below it for a lower limit.
        """
        if not value.size:
            return 0.0
        allowed = np.broadcast_to(np.asarray(limit, dtype=np.float64), value.shape)
        off = np.broadcast_to(np.asarray(error, dtype=np.float64), value.shape)
        # A limit may be so small that a ratio to it is beyond all floats.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            room = np.abs(allowed - zero)
            used = np.where(allowed < zero, zero - value, value - zero)
            ratio = _without_nan(used / room, np.inf)
            slack = _without_nan(off / room, np.inf)
            certain = _without_nan((used - off) / room, -np.inf)

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
        """Offer joint accelerations: in each direction to the limit of that direction."""
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
            # A joint that turns endlessly stands in the middle of a range of its own.
            value = np.where(known, q, 0.0)
            far, zero = np.where(known, end, np.inf), np.where(known, middle, 0.0)
            self.offer(name, t, value, far, q, error, zero)

    def torque(self, x: States) -> None:
        """Offer joint torques, where the arm's masses are known."""
        limit = self.limits.joint_torque
        if limit is None or x.ddq is None or not judges_torque(self.arm):
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
        # Where a joint may stand, dry friction is whatever helps most.
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
            rate, error = self.angular_velocity(arm, x)
            size = np.linalg.norm(rate, axis=1)
            self.offer("angular_speed", x.t, size, limits.angular_speed, x.q, error)
        if limits.angular_acceleration is not None and x.ddq is not None:
            found = _angular(arm.tool_twist_rate)(x.q, x.dq, x.ddq)
            error = self._spread(x, _angular(arm.tool_twist_rate), found, 2)
            size = np.linalg.norm(found, axis=1)
            self.offer("angular_acceleration", x.t, size, limits.angular_acceleration, x.q, error)

    def angular_velocity(self, arm: SerialArm, x: States) -> tuple[FloatArray, FloatArray]:
        """Angular velocities of the tool (n, 3), and a bound on the length of their error (n,)."""
        rate = _angular(arm.tool_twist)(x.q, x.dq)
        return rate, self._spread(x, _angular(arm.tool_twist), rate, 1)

    def states(self, x: States) -> None:
        """Offer everything that is known at one time each: joints and tool."""
        limits = self.limits
        self.joint_range(x.t, x.q, x.errors[0])
        self.torque(x)
        self.turning(x)
        if limits.joint_velocity is not None:
            self.offer("joint_velocity", x.t, np.abs(x.dq), limits.joint_velocity, x.q, x.errors[1])
        if x.ddq is not None:
            self.joint_acceleration(x.t, x.ddq, x.q, x.errors[2])
        if limits.speed is not None:
            velocity, error = self.tool_velocity(x)
            self.offer("speed", x.t, np.linalg.norm(velocity, axis=1), limits.speed, x.q, error)
        if x.ddq is None or (
            limits.tool_acceleration is None and limits.centripetal_acceleration is None
        ):
            return
        acceleration = self.arm.tool_acceleration(x.q, x.dq, x.ddq)
        size = np.linalg.norm(acceleration, axis=1)
        error = self._spread(x, self.arm.tool_acceleration, acceleration, 2)
        if limits.tool_acceleration is not None:
            self.offer("tool_acceleration", x.t, size, limits.tool_acceleration, x.q, error)
        velocity, velocity_error = self.tool_velocity(x)
        # The direction may be off by the velocity's error, which turns the rest into normal part.
        speed = np.linalg.norm(velocity, axis=1)
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
        """Offer the part of tool accelerations normal to `velocity`, at places `where` it moves."""
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

    def tool_velocity(self, x: States) -> tuple[FloatArray, FloatArray]:
        """Tool velocities (n, dimension), and a bound on the length of their error (n,)."""
        velocity = self.arm.tool_velocity(x.q, x.dq)
        return velocity, self._spread(x, self.arm.tool_velocity, velocity, 1)

    def tool(self, q: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tool points (n, dimension), and a bound on the length of their error (n,)."""
        none = np.zeros_like(error)
        x = States(t=q[:, 0], q=q, dq=np.zeros_like(q), ddq=None, errors=(error, none, none))
        points = self.arm.forward(q)
        return points, self._spread(x, self.arm.forward, points, 0)

    def pose(self, t: FloatArray, q: FloatArray, error: FloatArray) -> None:
        """Offer the tool's distance from the path, and its angle from how it is held there."""
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
        angle = least_off(self.path, points, nearest, self.arm.pose(q)[1], allowed, reach)
        # A joint that is off by an angle turns the tool by that angle; a tool that is off may be
        # nearest to a place where it is held otherwise.
        rate = np.linalg.norm(orientation.rates(nearest.s)[0], axis=1)
        slack = float(error.sum()) + rate * off
        self.offer("orientation_deviation", t, angle, allowed, q, slack)

    def uses(self, tolerance: float) -> tuple[LimitUse, ...]:
        """The uses, each with its place on the path and the verdict on it."""
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
        """Length by which a tool quantity moves when each number is off by its error, (n,)."""
        total = np.zeros(len(value))
        for change in _changes(x, function, value, order):
            total += np.linalg.norm(change, axis=1)
        # What the errors of two joints do together is less than the one's part times the other's
        # angle.
        return np.asarray(total * (1 + x.errors[0].sum()))


def judges_torque(arm: Arm) -> bool:
    """Whether an arm's torques can be told: its masses, and the package that takes them."""
    try:
        return arm.has_bodies and arm.dynamics is not None
    except InvalidInput:
        return False


def _changes(x: States, function: Quantity, value: FloatArray, order: int) -> Iterator[FloatArray]:
    """How a quantity of q and its first `order` rates changes with the error of each number."""
    columns = [x.q, x.dq, x.q if x.ddq is None else x.ddq][: order + 1]
    for k in range(len(columns)):
        for joint in np.flatnonzero(x.errors[k]):
            moved = list(columns)
            moved[k] = columns[k].copy()
            moved[k][:, joint] += x.errors[k][joint]
            yield function(*moved) - value


def _without_nan(values: FloatArray, instead: float) -> FloatArray:
    return np.where(np.isnan(values), instead, values)


def _angular(twist: Quantity) -> Quantity:
    """The angular part of a twist."""
    return lambda *states: twist(*states)[:, 3:]
