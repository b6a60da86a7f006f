"""Constraints of the joints: velocity and acceleration, by direction if they differ, and torque."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armcontour.core.checks import FloatArray, kernel_array
from armcontour.motion import JointPath
from armcontour.planning.constraints.constraint import Constraint, check_rest
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.limit_forms import (
    BY_SLOPE,
    BY_U,
    BY_X,
    HIGH,
    LOW,
    A,
    B,
    Form,
    Friction,
    JointBounds,
    LinearRows,
)
from armcontour.planning.topp.on_grid import ROUNDING, OnGrid
from armcontour.robot import Arm, Limits


class JointTorque(Constraint):
    """`|a u + b x + c + viscous q' sqrt(x) + coulomb sign(q')| <= limit` for every joint."""

    serves = ("joint_torque",)
    limit: FloatArray  # Largest torques [N m], (dof,)
    joints = True

    def __init__(self, arm: Arm, limit: FloatArray) -> None:
        self.dynamics = arm.dynamics
        self.limit = np.array(limit)
        chain = self.dynamics.chain
        self.viscous, self.coulomb = np.array(chain.viscous), np.array(chain.coulomb)
        self.curved = bool(self.viscous.any())

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> JointTorque | None:
        """Make the constraint of the torques; None if they are not limited."""
        return None if limits.joint_torque is None else cls(arm, limits.joint_torque)

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Rows of the torques, with limits less dry friction, and any form of viscous friction."""
        terms, bounds = self.dynamics.path_terms(*path.motion), (-self.limit, self.limit)
        rows = path.rows(terms, *bounds)
        weight = path.at_ends(terms[2])
        check_rest(path.grid, self, weight, bounds)
        if not (self.curved or self.coulomb.any()):
            return (rows,)
        (first, _), (third, _) = path.derivatives
        bulge = path.grid.width[:, None] ** 2 / 8 * third
        size = np.abs(first)
        largest = size.max(axis=1) + bulge
        one_way = (first[:, 0] * first[:, 1] > 0) & (size.min(axis=1) > bulge)
        sign = np.where(one_way, np.sign(first[:, 0]), 0.0)
        dry = np.where(largest > 0, self.coulomb, 0.0)
        # If a joint may reverse, dry friction counts against both limits.
        above, below = np.where(one_way, sign, 1.0) * dry, np.where(one_way, sign, -1.0) * dry
        creeping = weight + np.where(weight > 0, above[:, None], below[:, None])
        when = "in the slowest motion, with friction"
        check_rest(path.grid, self, creeping, bounds, when=when, cannot="move")
        rows.ends[..., LOW] -= below[:, None]
        rows.ends[..., HIGH] -= above[:, None]
        if not self.curved:
            return (rows,)
        within = np.stack([self.viscous * largest, self.viscous * bulge, sign], axis=2)
        return rows, Friction(self.viscous * first, within)


class JointMotion(Constraint):
    """Bounds of the velocities `q' ds` and accelerations `q' dds + q'' ds²` of every joint."""

    serves = ("joint_velocity", "joint_acceleration")

    def __init__(
        self,
        velocity: tuple[FloatArray, FloatArray] | None = None,
        acceleration: tuple[FloatArray, FloatArray] | None = None,
    ) -> None:
        # `velocity`: lower (negative) and upper bounds [rad/s], (dof,) each, infinite for a joint
        # without a limit; None without velocity limits. `acceleration`: the same for accelerations
        # [rad/s²].
        none = np.empty((2, 0))
        self.velocity = none if velocity is None else np.array(velocity)
        self.low, self.high = none if acceleration is None else map(kernel_array, acceleration)

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> JointMotion | None:
        """Make the constraint of velocities and accelerations; None if neither is limited."""
        dof, velocity, acceleration = joint_path.dof, None, None
        if limits.joint_velocity is not None:
            velocity = limits.velocity_bounds(dof)
        if limits.joint_acceleration is not None:
            acceleration = limits.acceleration_bounds(dof)
        return cls(velocity, acceleration) if velocity or acceleration else None

    def bounds(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds of accelerations on each interval [rad/s²], (n, joints) each."""
        shape = len(grid), len(self.low)
        return np.broadcast_to(self.low, shape), np.broadcast_to(self.high, shape)

    def fastest(self, path: OnGrid) -> FloatArray:
        """Velocity limits on each interval in the directions of motion [rad/s], (n, dof)."""
        (slopes, _), (third, _) = path.derivatives
        certain = path.grid.width[:, None] ** 2 / 8 * third
        low, high = np.abs(self.velocity)
        # A joint that may reverse must satisfy both bounds.
        back = np.where(slopes.max(axis=1) < -certain, low, np.minimum(low, high))
        return np.asarray(np.where(slopes.min(axis=1) > certain, high, back))

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Bounds of velocities and accelerations; the planner converts them to rows."""
        dof, inverses = path.grid.joint_path.dof, 1 / self.velocity**2
        return (JointBounds.from_limits(dof, self.low, self.high, *inverses),)

    def rows(self, path: OnGrid) -> LinearRows:
        """Rows of g = q' u + q'' x, with g'' = 5 q''' u + q'''' x + 4 q'' k, where k = u'."""
        (first, second), (third, fourth) = path.derivatives
        w, n = path.grid.width[:, None], len(path)
        ends, rise = np.empty((n, 2, len(self.low), 4)), np.zeros((n, len(self.low), 4))
        ends[..., A], ends[..., B] = first, second
        ends[..., LOW], ends[..., HIGH] = (x[:, None] for x in self.bounds(path.grid))
        q1 = np.abs(first).max(axis=1) + w**2 / 8 * third
        q2 = np.abs(second).max(axis=1) + w * third
        rise[..., BY_U] = w**2 / 8 * 5 * third
        rise[..., BY_X] = w**2 / 8 * fourth + ROUNDING / w * q1
        rise[..., BY_SLOPE] = w**2 / 8 * 4 * q2
        return LinearRows(ends, rise)
