"""What every arm can do, whatever its build."""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray, Locked
from armcontour.arms.chain import Chain
from armcontour.arms.limits import Limits
from armcontour.errors import InvalidInput

if TYPE_CHECKING:
    from armcontour.arms.dynamics import Dynamics


class Arm(Locked, ABC):
    """An arm's kinematics; arrays are time first, (n, dof) for joints, (n, dimension) for the tool.

    Once made, an arm does not change; `with_limits` and the like give another one.

    Attributes:
        name: For people.
        joint_names: One per joint.
        limits: The arm's own limits.
        dimension: Coordinates of a tool point: 2 in the plane, 3 in space.
        branches: Names of the inverse solutions, the default one first; empty without such.
        source: Where the numbers come from.
        chain: Its joints and links as data; None where nothing is known of its bodies.
        limits_hint: What would give the arm the limits that it lacks, for messages.
    """

    name: str
    joint_names: tuple[str, ...]
    limits: Limits
    dimension: int
    branches: tuple[str, ...]
    source: str
    chain: Chain | None = None
    limits_hint: str = ""
    _instead = "with_limits, with_name, with_tool and with_work give another arm"

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    def with_limits(self, limits: Limits) -> Self:
        """The same arm with other limits of its own.

        Args:
            limits: The new limits, one value for all joints or one per joint.

        Raises:
            InvalidInput: A wrong number of values.
        """
        return self._copy(limits=limits.for_joints(self.dof))

    def with_name(self, name: str) -> Self:
        """The same arm under another name.

        Args:
            name: For people.
        """
        return self._copy(name=name)

    def _copy(self, **changes: Any) -> Self:
        other = copy.copy(self)
        vars(other).update(changes)
        return other

    @property
    def has_bodies(self) -> bool:
        """Whether its masses are known."""
        return self.chain is not None and self.chain.masses is not None

    @cached_property
    def dynamics(self) -> Dynamics:
        """What its motion costs in torque.

        Raises:
            InvalidInput: Its masses are not known.
        """
        from armcontour.arms.dynamics import Dynamics

        if self.chain is None or self.chain.masses is None:
            raise InvalidInput(
                f"The masses of the arm {self.name} are not known, so its torques are not either: "
                "load it from a file whose links have masses, centres of mass and inertias."
            )
        return Dynamics(self.chain)

    @abstractmethod
    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m] of joint positions [rad].

        Args:
            q: Joint positions [rad], (..., dof).
        """

    @abstractmethod
    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Tool velocity per joint velocity [m/rad], (n, dimension, dof).

        Args:
            q: Joint positions [rad], (..., dof).
        """

    @abstractmethod
    def jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Time derivative of the Jacobian when the joints move at `dq`, (n, dimension, dof).

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """

    @abstractmethod
    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points of the arm from base to tool, for drawing it, (n, points, dimension) [m].

        Args:
            q: Joint positions [rad], (..., dof).
        """

    def tool_velocity(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Tool velocity (22) [m/s].

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
        """
        return np.asarray(np.einsum("...ij,...j->...i", self.jacobian(q), np.asarray(dq)))

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool acceleration [m/s²].

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        coupling = np.einsum("...ij,...j->...i", self.jacobian_rate(q, dq), np.asarray(dq))
        return np.asarray(self.tool_velocity(q, ddq) + coupling)

    def tool_motion(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """Tool velocity [m/s] and acceleration [m/s²].

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.
        """
        return self.tool_velocity(q, dq), self.tool_acceleration(q, dq, ddq)

    def torque(self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike) -> FloatArray:
        """Torque of every joint's drive [N m]: bodies, drives, gravity, payload and friction.

        Args:
            q: Joint positions [rad], (..., dof).
            dq: Joint velocities [rad/s], same shape.
            ddq: Joint accelerations [rad/s²], same shape.

        Raises:
            InvalidInput: The masses of the arm are not known.
        """
        dynamics = self.dynamics
        return dynamics.torque(q, dq, ddq) + dynamics.friction(dq)
