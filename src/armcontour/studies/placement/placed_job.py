"""A job with its part, or the base of its arm, in another place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame, exp
from armcontour.jobs.job import Job
from armcontour.jobs.place_search import LENGTHS
from armcontour.program import Program
from armcontour.robot import Arm, SerialArm
from armcontour.robot.scene import BASE, PART, Obstacle, Scene


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Moves:
    """How coordinates of a place move the part, or the base.

    All coordinates are those of the job's path.

    Args:
        anchor: The point that x, y and z move and that yaw and tilt turn about [m], (3,).
        absolute: The axes among x, y and z whose values are coordinates of the anchor; other
            values are added to it.
    """

    anchor: FloatArray
    absolute: tuple[str, ...] = ()

    def frame(self, place: Mapping[str, float]) -> Frame:
        """Where what moves is taken: it was in the frame of the identity before.

        Args:
            place: Values of some axes [m, rad]; what is not named does not move.
        """
        found = self.frames([place])[0]
        return Frame(position=found[:, 3], rotation=found[:, :3])

    def frames(self, places: Sequence[Mapping[str, float]]) -> FloatArray:
        """Rotations and positions of the same frames of several places, (n, 3, 4).

        Args:
            places: Values of some axes [m, rad] in each.
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


def place_job(job: Job, frame: Frame, what: str = PART) -> Job:
    """A job with its part, or the base of its arm, moved.

    For an arm in space the part moves with the arm's work frame; in the plane its path moves.

    Args:
        job: The job.
        frame: Where the part or base is taken from its own place, in the coordinates of the path.
        what: "part": obstacles that are fixed to the part move with it. Or "base": all obstacles
            stay in the cell.
    """
    arm = place_arm(job.arm, frame, what)
    scene = place_scene(job.scene, job.arm, frame, what)
    path, part = job.path, job.part
    if not isinstance(arm, SerialArm):
        way = _of_part(frame, what)
        path, part = Program.from_path(path).placed(way), way @ part
        path = path.single_path or path
    return replace(job, arm=arm, path=path, scene=scene, part=part)


def place_arm(arm: Arm, frame: Frame, what: str) -> Arm:
    """The arm with its work frame moved; arms in the plane have none and stay as they are."""
    if not isinstance(arm, SerialArm):
        return arm
    return arm.with_work(arm.chain.base.inverse @ _of_part(frame, what))


def place_bases(base: FloatArray, frames: FloatArray, what: str) -> FloatArray:
    """The base of an arm in the work frame, moved as `place_arm` moves it, (n, 3, 4)."""
    turns, ways = frames[..., :3], frames[..., 3]
    if what == PART:
        turns = np.swapaxes(turns, 1, 2)
        ways = -np.einsum("nij,nj->ni", turns, ways)
    found = turns @ base
    found[..., 3] += ways
    return np.asarray(found)


def place_scene(scene: Scene | None, arm: Arm, frame: Frame, what: str) -> Scene | None:
    """The scene as the arm has it with its part or base moved."""
    if scene is None:
        return None
    return replace(scene, obstacles=tuple(_placed(x, arm, frame, what) for x in scene.obstacles))


def _placed(x: Obstacle, arm: Arm, frame: Frame, what: str) -> Obstacle:
    """An obstacle where the arm has it."""
    if x.fixed_to == PART:
        # The work frame of an arm in space moves with the part.
        moves = not isinstance(arm, SerialArm)
        return replace(x, place=_of_part(frame, what) @ x.place) if moves else x
    if what == PART:
        return x
    base = Frame() if arm.chain is None else arm.chain.base
    return replace(x, place=(frame @ base).inverse @ base @ x.place)


def _of_part(frame: Frame, what: str) -> Frame:
    """Where the part is as the base has it: a base that goes one way sees it go the other."""
    return frame if what == PART else frame.inverse


def check_upright_base(axes: tuple[str, ...], what: str) -> None:
    """Refuse to tilt a base: gravity is given in the frame of the base."""
    if what == BASE and "tilt" in axes:
        raise InvalidInput(
            "A base is not tilted: describe the arm with its base as it stands, with the direction "
            "of gravity."
        )
