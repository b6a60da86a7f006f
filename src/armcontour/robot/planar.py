"""The planar two-link arm of the paper with its closed-form kinematics, eq. (1)-(4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, Unreachable
from armcontour.core.fields import Checked, checked
from armcontour.core.frames import Frame
from armcontour.core.quantities import Length, Name, Quantity, Size
from armcontour.robot.arm import Arm, unit_hint
from armcontour.robot.bodies import Payload
from armcontour.robot.chain import Chain, state_rows
from armcontour.robot.limits import Limits
from armcontour.robot.scene import ArmShapes, Capsule, LinkShape

# Within this distance [m] from either end of its reach the arm counts as singular: sin(theta2) is
# 1e-4, the joints move 10^4 times faster than the tool, and theta2 has only 8 correct digits in
# double precision.
SINGULAR_MARGIN = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LinkTube(Checked):
    """A uniform round tube that replaces a link whose mass and inertia are unknown.

    Args:
        outer_diameter: Outer diameter [m].
        wall: Thickness of the wall [m].
        density: Density of the material [kg/m³].

    Raises:
        InvalidInput: The wall is thicker than the radius.
    """

    outer_diameter: Size
    wall: Size
    density: Annotated[float, Quantity("kg/m^3", sign="positive")]

    def _check_together(self) -> None:
        """Check that the wall is at most as thick as the radius."""
        if 2 * self.wall > self.outer_diameter:
            raise InvalidInput(
                f"The wall of a tube must be at most half its outer diameter of "
                f"{self.outer_diameter:g} m, but is {self.wall:g} m."
            )

    def mass(self, length: float) -> float:
        """Return the mass of a tube with this length [kg]."""
        outer, inner = self._radii()
        return self.density * math.pi * (outer**2 - inner**2) * length

    def inertia(self, length: float) -> FloatArray:
        """Return the inertia of a tube along y, `length` long, about its centre [kg m²], (3, 3)."""
        outer, inner = self._radii()
        mass = self.mass(length)
        squares = outer**2 + inner**2
        across = mass * (3 * squares + length**2) / 12
        return np.diag([across, mass * squares / 2, across])

    def _radii(self) -> tuple[float, float]:
        """Return the outer and inner radius [m]."""
        outer = self.outer_diameter / 2
        return outer, outer - self.wall


class PlanarTwoLink(Arm):
    """An arm of two links in a plane, with two parallel joint axes.

    Joint angles are measured clockwise: the first from the y axis, the second from the first link.
    The plane is z = 0 of the attribute `chain`. It is assumed to be horizontal, so gravity causes
    no torque.

    >>> own = ac.PlanarTwoLink(name="own", base=0.1, links=(0.3, 0.2), limits=arm.limits)
    >>> own.forward([0.0, 0.0])[:2, 3]
    array([0.1, 0.5])

    Args:
        name: Name of the arm, for messages and reports.
        links: Link lengths L1, L2 [m].
        base: Distance L0 of the first joint from the origin, along x [m].
        limits: Limits of the arm's joints and tool.
        source: Where the data of the arm come from.
        joint_names: Names of the two joints.
        tubes: The tubes that replace the two links; None if neither masses nor shapes are known.
        payload: Load at the tool; its frame lies in the plane, with y along the second link. None
            without one.
        assumed: Assumed masses and inertias and the rule for them, for messages.
        limits_hint: Advice on how to add the limits that the arm lacks, for messages.
    """

    dimension = 2
    # The branches are named after the sign of theta2. The paper prints (4) for the first branch
    # only.
    branches = ("positive", "negative")

    @checked
    def __init__(
        self,
        *,
        name: str,
        links: tuple[Size, Size],
        base: Length = 0.0,
        limits: Limits,
        source: str = "",
        joint_names: tuple[Name, Name] = ("joint 1", "joint 2"),
        tubes: tuple[LinkTube, LinkTube] | None = None,
        payload: Payload | None = None,
        assumed: str = "",
        limits_hint: str = "",
    ) -> None:
        self.base = base
        self.link1, self.link2 = links
        chain = self._chain(joint_names, tubes, payload, assumed)
        self._describe(name, chain, limits, source, limits_hint)
        if tubes is not None:
            self.shapes = _capsules(tubes, (self.link1, self.link2))
        self._freeze()

    @property
    def reach(self) -> tuple[float, float]:
        """Shortest and longest distance of the tool from the first joint [m]."""
        return abs(self.link1 - self.link2), self.link1 + self.link2

    @property
    def span(self) -> float:
        """Length of all links together [m]."""
        return self.reach[1]

    def joint_position(self, points: npt.ArrayLike, configuration: str | None = None) -> FloatArray:
        """Return joint positions [rad], (..., 2), for tool points, eq. (3)-(4).

        The quadrant of (3) is corrected; theta1 is within (-2 pi, 2 pi).

        Args:
            points: Tool points [m], (..., 2).
            configuration: Solution of the inverse kinematics, by default the first of `branches`.

        Raises:
            Unreachable: A point is out of reach or singular; `index` is the first such point.
        """
        branch = self.branches[0] if configuration is None else configuration
        sign = 1.0 if checks.check_choice("branch", branch, self.branches) == "positive" else -1.0
        tool = checks.floats("tool points", points, "m")
        if tool.shape[-1:] != (2,):
            raise InvalidInput(
                f"Tool points of a planar arm must have the shape (..., 2), not {tool.shape}."
            )
        c = tool[..., 0] - self.base
        y = tool[..., 1]
        distance = np.hypot(c, y)
        self._check_reach(tool, distance)
        # low is 1 + cos(theta2) and high is 1 - cos(theta2). The products are exact at both limits
        # of reach.
        shortest, longest = self.reach
        low = (distance - shortest) * (distance + shortest) / (2 * self.link1 * self.link2)
        high = (longest - distance) * (longest + distance) / (2 * self.link1 * self.link2)
        q2 = sign * 2 * np.arctan2(np.sqrt(high), np.sqrt(low))
        q1 = np.arctan2(c, y) - np.arctan2(
            self.link2 * np.sin(q2), self.link1 + self.link2 * np.cos(q2)
        )
        return np.stack([q1, q2], axis=-1)

    def _solutions(
        self, point: FloatArray, rotation: FloatArray | None, near: FloatArray | None
    ) -> tuple[FloatArray, float]:
        """Return the joint positions of both branches for a tool point in the plane, (2, 2)."""
        if point[2:].any():
            raise InvalidInput(f"z of a pose must be 0, because the arm {self.name} is planar.")
        return np.stack([self.joint_position(point[:2], x) for x in self.branches]), 0.0

    def configuration_of(self, q: npt.ArrayLike) -> str:
        """Return the configuration (one of `branches`) of joint positions.

        Args:
            q: Joint positions [rad], (2,).
        """
        sine = float(np.sin(checks.shaped("joint positions", q, (2,), "rad")[1]))
        return self.branches[0 if sine >= 0 else 1]

    def joint_velocity(self, q: npt.ArrayLike, velocity: npt.ArrayLike) -> FloatArray:
        """Return the joint velocities [rad/s] for the tool velocity `velocity`, eq. (28).

        Args:
            q: Joint positions [rad], (..., 2).
            velocity: Tool velocities [m/s], same shape.

        Raises:
            Unreachable: The arm is singular at one of the joint positions.
        """
        return self._solve(q, checks.floats("tool velocities", velocity, "m/s"))

    def joint_acceleration(
        self, q: npt.ArrayLike, dq: npt.ArrayLike, acceleration: npt.ArrayLike
    ) -> FloatArray:
        """Return the joint accelerations [rad/s²] for the tool acceleration `acceleration`.

        The equation is `J⁻¹ (a - dJ/dt dq)`, which is (27) without its misprints.

        Args:
            q: Joint positions [rad], (..., 2).
            dq: Joint velocities [rad/s], same shape.
            acceleration: Tool accelerations [m/s²], same shape.

        Raises:
            Unreachable: The arm is singular at one of the joint positions.
        """
        rate, required = (checks.floats("states of an arm", x) for x in (dq, acceleration))
        state_rows(self.dof, q, rate, required)
        return self._solve(q, required - self.tool_acceleration(q, rate, np.zeros_like(rate)))

    def _solve(self, q: npt.ArrayLike, right: FloatArray) -> FloatArray:
        """Solve `J(q) x = right` for x, (..., 2); raises an error if the arm is singular."""
        state_rows(self.dof, q, right)
        jacobian = self.tool_jacobian(q)
        try:
            return np.asarray(np.linalg.solve(jacobian, right[..., None])[..., 0])
        except np.linalg.LinAlgError:
            raise Unreachable(
                f"The arm {self.name} is singular at one of the joint positions, so its tool "
                "cannot move in every direction there."
            ) from None

    def _chain(
        self,
        joints: tuple[str, ...],
        tubes: tuple[LinkTube, LinkTube] | None,
        payload: Payload | None,
        assumed: str,
    ) -> Chain:
        """Make the chain of the two joints and links in space."""
        lengths = np.array([self.link1, self.link2])
        bodies: dict[str, npt.ArrayLike] = {}
        if tubes is not None:
            pieces = tuple(zip(tubes, lengths.tolist(), strict=True))
            bodies["masses"] = [tube.mass(length) for tube, length in pieces]
            bodies["centers"] = np.outer(lengths / 2, [0.0, 1.0, 0.0])
            bodies["inertias"] = [tube.inertia(length) for tube, length in pieces]
        return Chain(
            joints=joints,
            rotations=np.tile(np.eye(3), (2, 1, 1)),
            positions=np.array([[self.base, 0.0, 0.0], [0.0, self.link1, 0.0]]),
            # Positive angles turn clockwise, seen from above.
            axes=np.tile([0.0, 0.0, -1.0], (2, 1)),
            base=Frame(),
            tip=Frame(position=np.array([0.0, self.link2, 0.0])),
            gravity=np.zeros(3),
            payload=payload,
            assumed=assumed,
            **bodies,  # type: ignore[arg-type]
        )

    def _check_reach(self, points: FloatArray, distance: FloatArray) -> None:
        """Raise an error if a point is out of reach or singular."""
        shortest, longest = self.reach
        outside = ~(
            (distance > shortest + SINGULAR_MARGIN) & (distance < longest - SINGULAR_MARGIN)
        )
        if not outside.any():
            return
        index = int(np.flatnonzero(outside.ravel())[0])
        point = points.reshape(-1, 2)[index]
        radius = float(distance.ravel()[index])
        x, y = point.tolist()
        beyond = max(shortest - radius, radius - longest)
        if beyond > SINGULAR_MARGIN:
            edge = f"more than {longest:g} m" if radius > longest else f"less than {shortest:g} m"
            problem = (
                f"is {beyond:.3g} m out of reach of the arm {self.name} ({edge} from its base)"
            )
        else:
            problem = (
                f"is on the edge of the reach of the arm {self.name}, {radius:.9g} m from its "
                "base, where it is singular"
            )
        raise Unreachable(
            f"Point ({x:.6g}, {y:.6g}) m {problem}. Move the path or the arm{unit_hint(beyond)}.",
            point=point.tolist(),
            index=index,
            limit="reach",
            needed=radius,
            allowed=longest if radius > (shortest + longest) / 2 else shortest,
        )


def _capsules(tubes: tuple[LinkTube, LinkTube], lengths: tuple[float, float]) -> ArmShapes:
    """Return the capsules that replace the tubes; the second one ends at the tool."""
    shapes = []
    for k, (tube, length) in enumerate(zip(tubes, lengths, strict=True), start=1):
        radius = tube.outer_diameter / 2
        # The second capsule ends at the tool, unless its radius is at least the length of the link.
        # Then its round end extends beyond the tool.
        stretch = length - radius if k == 2 and length > radius else length
        shape = Capsule(radius=radius, length=stretch)
        frame = Frame.rpy((0.0, stretch / 2, 0.0), (-np.pi / 2, 0.0, 0.0))
        shapes.append(LinkShape(name=f"link {k}", link=k, shape=shape, place=frame))
    source = "capsules in the place of links, with the assumed diameters of their tubes"
    return ArmShapes(shapes=tuple(shapes), source=source)
