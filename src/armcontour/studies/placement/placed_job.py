"""Jobs whose part, or whose base of the arm, is moved to another place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, exp
from armcontour.jobs.job import Job
from armcontour.jobs.placement_options import LENGTHS
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.robot.scene import BASE, PART, Obstacle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moves:
    """Displacement of the part or base for values of the axes, in the frame of the job's path.

    Args:
        anchor: Point that is displaced by x, y and z, and centre of yaw and tilt [m], (3,).
        absolute: Axes among x, y and z whose values are coordinates of the displaced anchor; values
            of the other axes are displacements of the anchor.
    """

    anchor: FloatArray
    absolute: tuple[str, ...] = ()

    def frame(self, place: Mapping[str, float]) -> Frame:
        """Displacement of a place as a frame.

        Args:
            place: Values of some axes [m, rad]; the part or base is not moved along the others.
        """
        matrix = self.frames([place])[0]
        return Frame(position=matrix[:, 3], rotation=matrix[:, :3])

    def frames(self, places: Sequence[Mapping[str, float]]) -> FloatArray:
        """Displacements of several places: rotation matrices and translations, (n, 3, 4).

        Args:
            places: For each place, values of some axes [m, rad].
        """
        yaw, tilt = np.zeros((2, len(places), 3))
        target = np.tile(self.anchor, (len(places), 1))
        for n, place in enumerate(places):
            yaw[n, 2], tilt[n, 1] = place.get("yaw", 0.0), place.get("tilt", 0.0)
            for k, name in enumerate(LENGTHS):
                if name in place:
                    target[n, k] = place[name] + (0.0 if name in self.absolute else target[n, k])
        turned = exp(yaw) @ exp(tilt)
        return np.concatenate([turned, (target - turned @ self.anchor)[..., None]], axis=2)


def place_job(job: Job, frame: Frame, moved: str = PART) -> Job:
    """Copy of a job with its part, or the base of its arm, moved.

    For an arm in space, the work frame is moved; for an arm in the plane, the path is moved.

    Args:
        job: The job.
        frame: Displacement of the part or base, in the coordinates of the path.
        moved: "part" or "base". Obstacles that are fixed to the part move with the part; other
            obstacles are fixed in the cell.
    """
    arm = place_arm(job.arm, frame, moved)
    scene, path, part = job.scene, job.path, job.part
    if scene is not None:
        obstacles = (_place_obstacle(x, job.arm, frame, moved) for x in scene.obstacles)
        scene = replace(scene, obstacles=tuple(obstacles))
    if not isinstance(arm, SerialArm):
        part_frame = _part_frame(frame, moved)
        path, part = Program.from_path(path).placed(part_frame), part_frame @ part
        path = path.single_path or path
    return replace(job, arm=arm, path=path, scene=scene, part=part)


def place_arm(arm: Arm, frame: Frame, moved: str) -> Arm:
    """The arm with its work frame moved; unchanged in the plane, where arms have no work frame."""
    if not isinstance(arm, SerialArm):
        return arm
    return arm.with_work(arm.chain.base.inverse @ _part_frame(frame, moved))


def place_bases(base: FloatArray, frames: FloatArray, moved: str) -> FloatArray:
    """Poses of a base, (n, 3, 4), in the work frames that `place_arm` sets for displacements."""
    turns, shifts = frames[..., :3], frames[..., 3]
    if moved == PART:
        turns = np.swapaxes(turns, 1, 2)
        shifts = -np.einsum("nij,nj->ni", turns, shifts)
    bases = turns @ base
    bases[..., 3] += shifts
    return np.asarray(bases)


def _place_obstacle(obstacle: Obstacle, arm: Arm, frame: Frame, moved: str) -> Obstacle:
    """The obstacle in the frame of the base, after a displacement of part or base."""
    if obstacle.fixed_to == PART:
        # The obstacle is defined in the work frame, which is moved with the part.
        if isinstance(arm, SerialArm):
            return obstacle
        return replace(obstacle, place=_part_frame(frame, moved) @ obstacle.place)
    if moved == PART:
        return obstacle
    base = Frame() if arm.chain is None else arm.chain.base
    return replace(obstacle, place=(frame @ base).inverse @ base @ obstacle.place)


def _part_frame(frame: Frame, moved: str) -> Frame:
    """Displacement of the part relative to the base."""
    return frame if moved == PART else frame.inverse


def check_upright_base(axes: tuple[str, ...], moved: str) -> None:
    """Raise an error for a tilted base, because gravity is defined in the frame of the base."""
    if moved == BASE and "tilt" in axes:
        raise InvalidInput(
            "A base cannot be tilted, because gravity is defined in its frame. Remove the axis "
            "tilt, and describe the mounting of the base by the direction of gravity of the arm."
        )
