"""What a check found: for every limit, the place where it is used most."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm, Limits
from armcontour.geometry import Path

# Below this tool speed [m/s] the direction of motion, and so the centripetal part, is not defined.
SLOWEST = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitUse:
    """How far one limit is used, at the place where it is certainly used most.

    Args:
        name: The limit: a field of `Limits`, "path_deviation", "position_step" or "velocity_step".
        ratio: value / limit.
        value: Amount [unit of the limit].
        limit: What is allowed there.
        t: When [s].
        joint: Joint number from 1; None for a limit of the tool.
        s: Nearest place on the path [m], if a path was given.
        slack: The part of `ratio` that rounding may have made.
    """

    name: str
    ratio: float
    value: float
    limit: float
    t: float
    joint: int | None
    s: float | None
    slack: float

    @property
    def certain(self) -> float:
        """The ratio that is left when rounding is given the benefit of the doubt."""
        return self.ratio - self.slack


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
    """

    def __init__(self, arm: Arm, limits: Limits, path: Path | None, deviation: float | None):
        self.arm, self.limits, self.path, self.deviation = arm, limits, path, deviation
        self.found: dict[str, LimitUse] = {}
        self.farthest = {"distance": 0.0, "t": 0.0, "s": 0.0}
        self._q: dict[str, FloatArray] = {}

    def offer(
        self,
        name: str,
        t: FloatArray,
        value: FloatArray,
        limit: npt.ArrayLike,
        q: FloatArray,
        error: npt.ArrayLike = 0.0,
    ) -> float:
        """Remember the place where a limit is certainly used most; returns the largest slack.

        Args:
            name: The limit.
            t: Times (n,).
            value: Amounts, (n, dof) for joints or (n,) for the tool.
            limit: Per joint (dof,), or one.
            q: Joint positions there, (n, dof).
            error: Bound on the error of `value`, of a shape that fits.
        """
        if not value.size:
            return 0.0
        allowed = np.broadcast_to(np.asarray(limit, dtype=np.float64), value.shape)
        ratio = value / allowed
        slack = np.broadcast_to(np.asarray(error, dtype=np.float64), value.shape) / allowed
        at = np.unravel_index(int(np.argmax(ratio - slack)), value.shape)
        use = LimitUse(
            name=name,
            ratio=float(ratio[at]),
            value=float(value[at]),
            limit=float(allowed[at]),
            t=float(t[at[0]]),
            joint=int(at[1]) + 1 if value.ndim == 2 else None,
            s=None,
            slack=float(slack[at]),
        )
        if name not in self.found or use.certain > self.found[name].certain:
            self.found[name], self._q[name] = use, q[at[0]]
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

    def states(self, x: States) -> None:
        """Offer everything that is known at one time each: joints and tool."""
        limits = self.limits
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
        error = self._spread(x, acceleration, 2)
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
        return velocity, self._spread(x, velocity, 1)

    def tool(self, q: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tool points (n, dimension), and a bound on the length of their error (n,)."""
        none = np.zeros_like(error)
        x = States(t=q[:, 0], q=q, dq=np.zeros_like(q), ddq=None, errors=(error, none, none))
        points = self.arm.forward(q)
        return points, self._spread(x, points, 0)

    def distance(self, t: FloatArray, q: FloatArray, error: FloatArray) -> None:
        """Offer the tool's distance from the path."""
        if self.path is None:
            return
        points, off = self.tool(q, error)
        nearest = self.path.project(points)
        worst = int(np.argmax(nearest.distance))
        if nearest.distance[worst] >= self.farthest["distance"]:
            self.farthest = {
                "distance": float(nearest.distance[worst]),
                "t": float(t[worst]),
                "s": float(nearest.s[worst]),
            }
        if self.deviation is not None:
            self.offer("path_deviation", t, nearest.distance, self.deviation, q, off)

    def uses(self) -> tuple[LimitUse, ...]:
        """The uses, each with its place on the path."""
        if self.path is None or not self.found:
            return tuple(self.found.values())
        s = self.path.project(self.arm.forward(np.array([self._q[x] for x in self.found]))).s
        return tuple(
            replace(use, s=float(at)) for use, at in zip(self.found.values(), s, strict=True)
        )

    def _spread(self, x: States, value: FloatArray, order: int) -> FloatArray:
        """Length by which a tool quantity moves when each number is off by its error, (n,)."""
        columns = [x.q, x.dq, x.q if x.ddq is None else x.ddq][: order + 1]
        functions = (self.arm.forward, self.arm.tool_velocity, self.arm.tool_acceleration)
        total = np.zeros(len(value))
        for k in range(len(columns)):
            for joint in np.flatnonzero(x.errors[k]):
                moved = list(columns)
                moved[k] = columns[k].copy()
                moved[k][:, joint] += x.errors[k][joint]
                total += np.linalg.norm(functions[order](*moved) - value, axis=1)
        return total
