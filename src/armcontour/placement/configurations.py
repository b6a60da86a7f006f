"""All configurations of a pose: in closed form for most arms of six joints, else by a search."""

from __future__ import annotations

from armcontour._checks import FloatArray
from armcontour.arms import SerialArm
from armcontour.arms.inverse import configurations
from armcontour.placement.closed_form import ClosedForm

# Tasks that prescribe the whole pose of the tool.
WHOLE = 6


class Configurations:
    """Finds all configurations of poses, as `arms.inverse.configurations` does, but sooner.

    Args:
        arm: The arm, which may stand anywhere.
        task: Task dimension, as in `configurations`.

    Attributes:
        closed: The arm's axes, if its joint positions are known in closed form; else None.
    """

    def __init__(self, arm: SerialArm, task: int) -> None:
        self.task = task
        self.closed = ClosedForm.of(arm) if task == WHOLE else None

    def find(self, arm: SerialArm, pose: FloatArray, near: FloatArray | None) -> FloatArray:
        """All joint positions that put the tool in a pose [rad], (k, dof).

        Args:
            arm: The arm in another place.
            pose: Rotation and position of the tool, (3, 4).
            near: As in `configurations`.
        """
        if near is None and self.closed is not None:
            found = self.closed.solve(arm.arrays[3], pose)
            if found is not None:
                return found
        return configurations(arm, pose, self.task, near)
