"""The planar two-link arm of the paper, eq. (1)-(4)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms.arm import Arm
from armcontour.arms.chain import Chain, Payload
from armcontour.arms.limits import Limits
from armcontour.arms.tube import Tube
from armcontour.errors import InvalidInput, Unreachable
from armcontour.frames import Frame

# Nearer than this to the edge of its reach the arm is singular: there sin(theta2) is about 1e-4,
# joints move 10^4 times faster than the tool, and double precision leaves 8 digits of position.
SINGULAR_MARGIN = 1e-9


class PlanarTwoLink(Arm):
    """Two parallel joints, two links; joint angles are measured from the y axis, clockwise.

    Args:
        name: For people.
        base: Distance L0 of the first joint from the origin, along x [m].
        links: Link lengths L1, L2 [m].
        limits: The arm's own limits.
        source: Where the numbers come from.
        joint_names: Two names.
        tubes: The tubes that its links are assumed to be; None: nothing is known of their masses.
        payload: What the tool carries; its frame is in the plane, with y along the second link.
        assumed: What is assumed of its bodies and by what rule, for people.
        limits_hint: What would give the arm the limits that it lacks, for messages.

    Its `chain` has both joints in space: the plane is z = 0, and taken as horizontal, so that
    gravity costs no torque.
    """

    dimension = 2
    # Named by the sign of theta2: (4) is printed for the first only.
    branches = ("positive", "negative")

    def __init__(
        self,
        *,
        name: str,
        base: float,
        links: tuple[float, float],
        limits: Limits,
        source: str = "",
        joint_names: tuple[str, str] = ("joint 1", "joint 2"),
        tubes: tuple[Tube, Tube] | None = None,
        payload: Payload | None = None,
        assumed: str = "",
        limits_hint: str = "",
    ) -> None:
        self.name = name
        self.base = _checks.number("base", base, "m")
        self.link1 = _checks.positive("first link length", links[0], "m")
        self.link2 = _checks.positive("second link length", links[1], "m")
        self.limits = limits.for_joints(2)
        self.source = source
        self.limits_hint = limits_hint
        self.joint_names = tuple(joint_names)
        self.chain = self._chain(tubes, payload, assumed)

    @property
    def reach(self) -> tuple[float, float]:
        """Shortest and longest distance of the tool from the first joint [m]."""
        return abs(self.link1 - self.link2), self.link1 + self.link2

    def forward(self, q: npt.ArrayLike) -> FloatArray:
        """Tool points, (1)-(2)."""
        return np.asarray(self.links(q)[..., -1, :])

    def links(self, q: npt.ArrayLike) -> FloatArray:
        """Base, elbow and tool."""
        q1, q12 = self._angles(q)
        base = np.stack([np.full_like(q1, self.base), np.zeros_like(q1)], axis=-1)
        elbow = base + self.link1 * np.stack([np.sin(q1), np.cos(q1)], axis=-1)
        tool = elbow + self.link2 * np.stack([np.sin(q12), np.cos(q12)], axis=-1)
        return np.stack([base, elbow, tool], axis=-2)

    def inverse(self, points: npt.ArrayLike, branch: str | None = None) -> FloatArray:
        """Joint positions, (3)-(4) with the quadrant of (3) mended; theta1 within (-2 pi, 2 pi).

        Args:
            points: Tool points [m], (..., 2).
            branch: Branch of the inverse kinematics, by default the first of `branches`.

        Raises:
            Unreachable: Out of reach or singular; `index` is the first such point.
        """
        sign = 1.0 if self._branch(branch) == "positive" else -1.0
        at = np.asarray(points, dtype=np.float64)
        c, y = at[..., 0] - self.base, at[..., 1]
        self._refuse_out_of_reach(at, np.hypot(c, y))
        # 1 - cos(theta2) and 1 + cos(theta2) as products: exact at both edges of the reach.
        distance = np.hypot(c, y)
        near, far = self.reach
        low = (distance - near) * (distance + near) / (2 * self.link1 * self.link2)
        high = (far - distance) * (far + distance) / (2 * self.link1 * self.link2)
        q2 = sign * 2 * np.arctan2(np.sqrt(high), np.sqrt(low))
        q1 = np.arctan2(c, y) - np.arctan2(
            self.link2 * np.sin(q2), self.link1 + self.link2 * np.cos(q2)
        )
        return np.stack([q1, q2], axis=-1)

    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """The Jacobian printed under (23)."""
        q1, q12 = self._angles(q)
        far = np.stack([self.link2 * np.cos(q12), -self.link2 * np.sin(q12)], axis=-1)
        near = np.stack([self.link1 * np.cos(q1), -self.link1 * np.sin(q1)], axis=-1)
        return np.stack([near + far, far], axis=-1)

    def jacobian_rate(self, q: npt.ArrayLike, dq: npt.ArrayLike) -> FloatArray:
        """Time derivative of the Jacobian."""
        q1, q12 = self._angles(q)
        rate = np.asarray(dq, dtype=np.float64)
        rate1, rate12 = rate[..., 0, None], (rate[..., 0] + rate[..., 1])[..., None]
        far = -rate12 * self.link2 * np.stack([np.sin(q12), np.cos(q12)], axis=-1)
        near = -rate1 * self.link1 * np.stack([np.sin(q1), np.cos(q1)], axis=-1)
        return np.stack([near + far, far], axis=-1)

    def joint_velocity(self, q: npt.ArrayLike, velocity: npt.ArrayLike) -> FloatArray:
        """Joint velocities [rad/s] that move the tool at `velocity` [m/s], (28).

        Args:
            q: Joint positions [rad], (..., 2).
            velocity: Tool velocities [m/s], same shape.
        """
        return self._solve(q, np.asarray(velocity, dtype=np.float64))

    def joint_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, acceleration: npt.ArrayLike
    ) -> FloatArray:
        """Joint accelerations [rad/s²] that give the tool `acceleration` [m/s²], (27).

        Written as `J⁻¹ (a - dJ/dt dq)`, which is (27) with its misprints mended.

        Args:
            q: Joint positions [rad], (..., 2).
            dq: Joint velocities [rad/s], same shape.
            acceleration: Tool accelerations [m/s²], same shape.
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

    def _chain(
        self, tubes: tuple[Tube, Tube] | None, payload: Payload | None, assumed: str
    ) -> Chain:
        lengths = np.array([self.link1, self.link2])
        bodies: dict[str, npt.ArrayLike] = {}
        if tubes is not None:
            pieces = tuple(zip(tubes, lengths.tolist(), strict=True))
            bodies["masses"] = [tube.mass(length) for tube, length in pieces]
            bodies["centers"] = np.outer(lengths / 2, [0.0, 1.0, 0.0])
            bodies["inertias"] = [tube.inertia(length) for tube, length in pieces]
        return Chain(
            joints=self.joint_names,
            rotations=np.tile(np.eye(3), (2, 1, 1)),
            positions=np.array([[0.0, 0.0, 0.0], [0.0, self.link1, 0.0]]),
            # Clockwise as seen from above.
            axes=np.tile([0.0, 0.0, -1.0], (2, 1)),
            base=Frame(position=np.array([self.base, 0.0, 0.0])),
            tip=Frame(position=np.array([0.0, self.link2, 0.0])),
            gravity=np.zeros(3),
            payload=payload,
            assumed=assumed,
            **bodies,  # type: ignore[arg-type]
        )

    def _angles(self, q: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
        at = np.asarray(q, dtype=np.float64)
        return at[..., 0], at[..., 0] + at[..., 1]

    def _branch(self, branch: str | None) -> str:
        if branch is None:
            return self.branches[0]
        if branch not in self.branches:
            raise InvalidInput(
                f"The arm {self.name} has the branches {', '.join(self.branches)}, not {branch!r}."
            )
        return branch

    def _refuse_out_of_reach(self, points: FloatArray, distance: FloatArray) -> None:
        near, far = self.reach
        outside = ~((distance > near + SINGULAR_MARGIN) & (distance < far - SINGULAR_MARGIN))
        if not outside.any():
            return
        index = int(np.flatnonzero(outside.ravel())[0])
        point = points.reshape(-1, 2)[index]
        at = float(distance.ravel()[index])
        x, y = point.tolist()
        beyond = max(near - at, at - far)
        if beyond > SINGULAR_MARGIN:
            edge = f"more than {far:g} m" if at > far else f"less than {near:g} m"
            problem = (
                f"is {beyond:.3g} m out of reach of the arm {self.name} ({edge} from its base)"
            )
        else:
            problem = (
                f"lies on the edge of the reach of the arm {self.name}, {at:.9g} m from its base, "
                "where it is singular"
            )
        raise Unreachable(
            f"Point ({x:.6g}, {y:.6g}) m {problem}: move the path or the arm.",
            point=point.tolist(),
            index=index,
            limit="reach",
            needed=at,
            allowed=far if at > (near + far) / 2 else near,
        )
