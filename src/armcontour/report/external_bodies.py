"""Bodies that show rails, gantries and positioners whose shapes are unknown.

Their positions, directions and strokes are those of the axes; their sizes are assumed. They are
only drawn: no distance to them is computed. Each structure is built from the arm, or from the part,
towards the floor: an axis gets a body that moves with it, and a body on its parent, which carries
it. The structure ends with stands on the floor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.report.drawn_cell import SHORTEST, UP, Body, DrawnCell, DrawnJoint

# Width of beams, as a factor of the arm's size; the other lengths are factors of this width.
BEAM_WIDTH = 0.12
BEAM_HEIGHT = 0.5
CARRIAGE_LENGTH = 1.4
CARRIAGE_WIDTH = 1.2
CARRIAGE_HEIGHT = 0.2
RAM_WIDTH = 0.6
# A ram slides in a sleeve of this width and height.
SLEEVE = 1.3
# Smallest height of a beam above a floor that leaves no space below the arm's base, as a factor of
# its width.
LOWEST_BEAM = 0.15
# Share of the space between the arm's base and a floor that the carriage gets, if there is not
# enough for both carriage and beam.
CARRIAGE_SHARE = 0.4
# Radius of a faceplate without bodies on the part, as a factor of the arm's size, and as a factor
# of the part's radius; the other lengths of a positioner are factors of the faceplate's radius.
PLATE = 0.12
PLATE_OF_PART = 0.7
PLATE_THICKNESS = 0.12
HOUSING_LENGTH = 0.7
HOUSING_RADIUS = 0.45
HUB_LENGTH = 0.5
MEMBER_WIDTH = 0.35
# Distance between the part's radius and the bearing beside it, as a factor of the radius.
BESIDE = 1.3
# Cosine of the angle to the vertical below which an axis counts as horizontal.
HORIZONTAL = 0.7
# Cosine of the angle to the vertical above which a faceplate lies below the part.
LYING = 0.3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """Where a structure stands: a point on the floor link [m], (3,), and the width there [m]."""

    top: FloatArray
    width: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surroundings:
    """What a structure is adapted to, in the frame of the floor with all joints at 0.

    Args:
        size: Size of the arm without external axes [m].
        base: Corners of the bodies that move with the arm's base [m], (n, 3); may be empty.
        arm: Positions of the arm's joints and of the tool [m], (n, 3).
        part: Corners of the bodies on the part, or of the path [m], (n, 3); may be empty.
        floor: Height of the floor of the scene [m]; None without one.
    """

    size: float
    base: FloatArray
    arm: FloatArray
    part: FloatArray
    floor: float | None


def slide_bodies(cell: DrawnCell, around: Surroundings) -> tuple[list[Body], list[Stand]]:
    """Make the bodies of the sliding joints that carry the arm, and say where they stand."""
    count = cell.sliding
    last = cell.positioner + count
    mount = cell.frames[last].position
    height = float((around.arm - mount).mean(axis=0) @ UP)
    hangs = height < 0
    if len(around.base):
        # The carriage touches the base of the arm.
        end = around.base[:, 2].max() if hangs else around.base[:, 2].min()
        mount = np.array([*mount[:2], end])
    slides = _Slides(cell, around, BEAM_WIDTH * around.size)
    mounts = [mount]
    # A link whose joint is vertical is carried from the side, others from above or below.
    outward = UP if hangs else -UP
    for link in range(last, cell.positioner, -1):
        if abs(cell.direction(link) @ UP) >= HORIZONTAL:
            is_outermost = cell.joints[link - 1].parent == 0
            mounts, outward = slides.vertical(link, mounts, hangs and not is_outermost)
        else:
            mounts = slides.horizontal(link, mounts, outward)
            outward = -UP
        hangs = False
    return slides.bodies, [Stand(top=x, width=slides.width) for x in mounts]


class _Slides:
    """Bodies of sliding joints, from the arm or the part outwards."""

    def __init__(self, cell: DrawnCell, around: Surroundings, width: float) -> None:
        self.cell = cell
        self.around = around
        self.width = width
        self.bodies: list[Body] = []

    def horizontal(
        self, link: int, mounts: Sequence[FloatArray], outward: FloatArray
    ) -> list[FloatArray]:
        """Add carriages and beams of a horizontal joint; return where the beams are carried.

        Args:
            link: Link after the joint.
            mounts: Points that the carriages touch [m], (3,) each.
            outward: Unit vector from the mounts to the beams, (3,).
        """
        joint = self.cell.joints[link - 1]
        along = self.cell.direction(link)
        outward = outward - (outward @ along) * along
        outward = outward / np.linalg.norm(outward)
        axes = np.stack([along, np.cross(outward, along), outward], axis=1)
        low, high = stroke(joint, self.around.size)
        length = high - low + CARRIAGE_LENGTH * self.width
        carried = []
        for mount in _one_per_beam(mounts, axes):
            carriage, beam, start = self._heights(joint, mount, outward)
            self._box(
                joint.name,
                link,
                start + outward * carriage / 2,
                axes,
                (CARRIAGE_LENGTH * self.width, CARRIAGE_WIDTH * self.width, carriage),
            )
            center = start + outward * (carriage + beam / 2) + along * (low + high) / 2
            self._box(joint.name, joint.parent, center, axes, (length, self.width, beam))
            half = np.abs(axes[:, 1:].T @ UP) @ [self.width / 2, beam / 2]
            ends = along * (length - self.width) / 2
            carried += [center - ends - half * UP, center + ends - half * UP]
        return carried

    def _heights(
        self, joint: DrawnJoint, mount: FloatArray, outward: FloatArray
    ) -> tuple[float, float, FloatArray]:
        """Return the heights of carriage and beam [m], and the point where the carriage starts."""
        carriage = CARRIAGE_HEIGHT * self.width
        beam = BEAM_HEIGHT * self.width
        floor = self.around.floor
        if floor is None or joint.parent or outward @ UP > -HORIZONTAL:
            return carriage, beam, mount
        space = float(mount[2]) - floor
        lowest = LOWEST_BEAM * self.width
        if space >= carriage + beam:
            return carriage, beam, mount
        if space >= lowest:
            return CARRIAGE_SHARE * space, (1 - CARRIAGE_SHARE) * space, mount
        # The arm's base stands on the floor, so the beam must be beside it.
        start = np.array([*mount[:2], floor + lowest])
        return CARRIAGE_SHARE * lowest, (1 - CARRIAGE_SHARE) * lowest, start

    def vertical(
        self, link: int, mounts: Sequence[FloatArray], hangs: bool
    ) -> tuple[list[FloatArray], FloatArray]:
        """Add ram and sleeve, or column and plate, of a vertical joint.

        Args:
            link: Link after the joint.
            mounts: Points that it carries [m], (3,) each.
            hangs: Whether the link hangs on a ram; otherwise it is in front of a column.

        Returns:
            Where sleeve or column are carried [m], (3,), and the direction from there outwards.
        """
        joint = self.cell.joints[link - 1]
        mount = np.mean(mounts, axis=0)
        ends = np.array(stroke(joint, self.around.size)) * (self.cell.direction(link) @ UP)
        low, high = sorted(ends.tolist())
        width = self.width
        back = self._backwards(joint, mount)
        axes = np.stack([np.cross(UP, back), -back, UP], axis=1)
        if hangs:
            sleeve = SLEEVE * width
            length = high - low + sleeve
            ram = (RAM_WIDTH * width, RAM_WIDTH * width, length)
            self._box(joint.name, link, mount + UP * length / 2, axes, ram)
            center = mount + UP * (high + sleeve / 2)
            self._box(joint.name, joint.parent, center, axes, (sleeve, sleeve, sleeve))
            return [center + back * sleeve / 2], back
        plate = CARRIAGE_HEIGHT * width
        reach = (CARRIAGE_LENGTH + 1) * width
        center = mount + back * (reach - CARRIAGE_LENGTH * width) / 2 - UP * plate / 2
        self._box(joint.name, link, center, axes, (CARRIAGE_LENGTH * width, reach, plate))
        height = high - low + width
        foot = mount + back * (CARRIAGE_LENGTH / 2 + 0.5) * width + UP * (low - width / 2)
        self._box(joint.name, joint.parent, foot + UP * height / 2, axes, (width, width, height))
        return [foot], -UP

    def _backwards(self, joint: DrawnJoint, mount: FloatArray) -> FloatArray:
        """Return the horizontal direction in which a vertical joint is carried."""
        outer = joint.parent
        if outer and outer > self.cell.positioner and self.cell.joints[outer - 1].prismatic:
            # The beam of the next joint is beside the ram.
            along = self.cell.direction(outer)
            back = np.cross(UP, along - (along @ UP) * UP)
        else:
            # The column is behind the arm, as seen from the part.
            back = mount - (self.around.part.mean(axis=0) if len(self.around.part) else mount)
            back = back - (back @ UP) * UP
        length = float(np.linalg.norm(back))
        return back / length if length > SHORTEST else np.array([-1.0, 0.0, 0.0])

    def _box(
        self, name: str, link: int, center: FloatArray, axes: FloatArray, size: Sequence[float]
    ) -> None:
        self.bodies.append(self.cell.box(name, link, center, axes, size))


def positioner_bodies(cell: DrawnCell, around: Surroundings) -> tuple[list[Body], list[Stand]]:
    """Make the bodies of a positioner: faceplate, housings, and members between its axes."""
    made = _Positioner(cell, around)
    link = cell.positioner
    support = cell.frames[link].position
    if not cell.joints[link - 1].prismatic:
        support = made.faceplate(link)
        link -= 1
    slides = _Slides(cell, around, MEMBER_WIDTH * made.radius)
    mounts = [support]
    while link:
        joint = cell.joints[link - 1]
        if not joint.prismatic:
            mounts = [made.bearing(link, np.mean(mounts, axis=0))]
        elif abs(cell.direction(link) @ UP) >= HORIZONTAL:
            mounts, _ = slides.vertical(link, mounts, False)
        else:
            mounts = slides.horizontal(link, mounts, -UP)
        link = joint.parent
    bodies = [*made.bodies, *slides.bodies]
    return bodies, [Stand(top=x, width=made.member) for x in mounts]


class _Positioner:
    """Bodies of a positioner's revolute joints, from the part to the floor."""

    def __init__(self, cell: DrawnCell, around: Surroundings) -> None:
        self.cell = cell
        self.around = around
        self.bodies: list[Body] = []
        self.part_radius = self._radius_of_part()
        radius = PLATE_OF_PART * self.part_radius
        self.radius = max(radius, PLATE * around.size / 2) if radius else PLATE * around.size
        self.member = MEMBER_WIDTH * self.radius

    def _radius_of_part(self) -> float:
        """Return the radius of the bodies on the part about the last axis [m]; 0 without any."""
        if not len(self.around.part):
            return 0.0
        along = self.cell.direction(self.cell.positioner)
        away = self.around.part - self.cell.frames[self.cell.positioner].position
        return float(np.linalg.norm(away - np.outer(away @ along, along), axis=1).max())

    def faceplate(self, link: int) -> FloatArray:
        """Add the plate that carries the part, and its housing; return the housing's end [m]."""
        joint = self.cell.joints[link - 1]
        start = self.cell.frames[link].position
        along = self.cell.direction(link)
        bodies = self.around.part if len(self.around.part) else start[None]
        heights = (bodies - start) @ along
        upwards = along @ UP if abs(along @ UP) > LYING else heights.mean()
        if upwards < 0:
            along = -along
            heights = -heights
        # The part stands on the plate, which is at most at the origin of the axis.
        face = start + along * min(0.0, heights.min())
        back = face - along * PLATE_THICKNESS * self.radius
        end = back - along * HOUSING_LENGTH * self.radius
        self._cylinder(joint.name, link, back, face, self.radius)
        self._cylinder(joint.name, joint.parent, end, back, HOUSING_RADIUS * self.radius)
        return np.asarray(end)

    def bearing(self, link: int, support: FloatArray) -> FloatArray:
        """Add the member that carries a point, and the bearing of its joint.

        Args:
            link: Link after the joint, with which the point moves.
            support: The point [m], (3,).

        Returns:
            The end of the bearing, which the parent of the joint carries [m], (3,).
        """
        joint = self.cell.joints[link - 1]
        along = self.cell.direction(link)
        start = self.cell.frames[link].position
        foot = start + ((support - start) @ along) * along
        hub = HUB_LENGTH * self.radius
        if abs(along @ UP) >= HORIZONTAL:
            # The bearing is below the point.
            outward = along * np.sign(-along @ UP)
            place = foot
        else:
            outward = self._away_from_arm(along, start)
            beside = max(self.part_radius, self.radius) * BESIDE
            inner = max(beside, float((foot - start) @ outward) + self.member)
            place = start + outward * inner
        corner = support + ((place - support) @ outward) * outward
        self._member(joint.name, link, support, corner)
        self._member(joint.name, link, corner, place)
        self._cylinder(joint.name, link, place, place + outward * hub, self.member)
        end = place + outward * 2 * hub
        self._cylinder(joint.name, joint.parent, place + outward * hub, end, 1.2 * self.member)
        return np.asarray(place + outward * 1.5 * hub)

    def _away_from_arm(self, along: FloatArray, start: FloatArray) -> FloatArray:
        """Return the direction along an axis that leads away from the arm, (3,)."""
        towards = float((self.around.arm[0] - start) @ along)
        return -along if towards > SHORTEST else along

    def _member(self, name: str, link: int, start: FloatArray, end: FloatArray) -> None:
        """Add a beam between two points in the frame of the floor, unless they are equal."""
        if np.linalg.norm(end - start) > SHORTEST:
            self._cylinder(name, link, start, end, self.member / 2)

    def _cylinder(
        self, name: str, link: int, start: FloatArray, end: FloatArray, radius: float
    ) -> None:
        self.bodies.append(self.cell.cylinder(name, link, start, end, radius))


def stand_bodies(cell: DrawnCell, stands: Sequence[Stand], ground: float) -> list[Body]:
    """Make the columns on which the structures stand.

    Args:
        cell: The joints and links.
        stands: Tops of the columns.
        ground: Height of the floor [m].
    """
    bodies = []
    for stand in stands:
        height = float(stand.top[2]) - ground
        if height <= SHORTEST:
            continue
        center = stand.top - UP * height / 2
        size = (stand.width, stand.width, height)
        bodies.append(cell.box("stand", 0, center, np.eye(3), size))
    return bodies


def stroke(joint: DrawnJoint, size: float) -> tuple[float, float]:
    """Return the drawn range of a sliding joint [m]; an infinite end is drawn at the arm's size."""
    low = joint.lower if np.isfinite(joint.lower) else -size
    high = joint.upper if np.isfinite(joint.upper) else size
    return low, high


def _one_per_beam(mounts: Sequence[FloatArray], axes: FloatArray) -> list[FloatArray]:
    """Return one point for each beam: the mean of the points that lie along the same beam."""
    beams: dict[float, list[FloatArray]] = {}
    for mount in mounts:
        across = round(float(mount @ axes[:, 1]) / SHORTEST)
        beams.setdefault(across, []).append(mount)
    return [np.mean(x, axis=0) for x in beams.values()]
