"""What every arm can do, whatever its build."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.arms.limits import Limits
from armcontour.errors import Unreachable


class Arm(ABC):
    """An arm's kinematics; arrays are time first, (n, dof) for joints, (n, dimension) for the tool.

    Attributes:
        name: For people.
        joint_names: One per joint.
        limits: The arm's own limits.
        dimension: Coordinates of a tool point: 2 in the plane, 3 in space.
        branches: Names of the inverse solutions, the default one first.
        source: Where the numbers come from.
    """

    name: str
    joint_names: tuple[str, ...]
    limits: Limits
    dimension: int
    branches: tuple[str, ...]
    source: str

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joint_names)

    @abstractmethod
    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points [m] of joint positions [rad]."""

    @abstractmethod
    def inverse(self, points: npt.ArrayLike, branch: str | None = None) -> FloatArray:
        """Joint positions [rad] of tool points [m] on one branch.

        Raises:
            Unreachable: Out of reach or singular; `index` is the first such point.
        """

    @abstractmethod
    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Tool velocity per joint velocity [m/rad], (n, dimension, dof)."""

    @abstractmethod
    def jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Time derivative of the Jacobian when the joints move at `dq`, (n, dimension, dof)."""

    @abstractmethod
    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Points of the arm from base to tool, for drawing it, (n, points, dimension) [m]."""

    def tool_velocity(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Tool velocity (22) [m/s]."""
        return np.asarray(np.einsum("...ij,...j->...i", self.jacobian(q), np.asarray(dq)))

    def tool_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, ddq: npt.ArrayLike
    ) -> FloatArray:
        """Tool acceleration [m/s²]."""
        coupling = np.einsum("...ij,...j->...i", self.jacobian_rate(q, dq), np.asarray(dq))
        return np.asarray(self.tool_velocity(q, ddq) + coupling)

    def joint_velocity(self, q: npt.ArrayLike, velocity: npt.ArrayLike) -> FloatArray:
        """Joint velocities [rad/s] that move the tool at `velocity` [m/s], (28)."""
        return self._solve(q, np.asarray(velocity, dtype=np.float64))

    def joint_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, acceleration: npt.ArrayLike
    ) -> FloatArray:
        """Joint accelerations [rad/s²] that give the tool `acceleration` [m/s²], (27).

        Written as `J⁻¹ (a - dJ/dt dq)`, which is (27) with its misprints mended.
        """
        coupling = np.einsum("...ij,...j->...i", self.jacobian_rate(q, dq), np.asarray(dq))
        return self._solve(q, np.asarray(acceleration, dtype=np.float64) - coupling)

    def _solve(self, q: npt.ArrayLike, right: FloatArray) -> FloatArray:
        jacobian = self.jacobian(q)
        try:
            return np.asarray(np.linalg.solve(jacobian, right[..., None])[..., 0])
        except np.linalg.LinAlgError:
            raise Unreachable(
                f"The arm {self.name} is singular at one of the joint positions: "
                "its tool cannot move in every direction there."
            ) from None
