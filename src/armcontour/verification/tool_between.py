"""`ToolBetween`: the tool motion between the samples of an execution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.checks import BoolArray, IntArray, kernel_array
from armcontour.motion import Execution, FineMotion

if TYPE_CHECKING:
    from armcontour.verification.peak_search import ToolPath


@dataclass(frozen=True, eq=False)
class ToolBetween:
    """The tool motion between the samples of an execution, for all its contours."""

    executed: Execution

    @cached_property
    def _smooth(self) -> BoolArray:
        """Mask of the samples with a quintic to the next one, (n - 1,)."""
        # One mask for the whole execution takes less time than a test of each searched interval.
        return self.executed.smooth_steps()

    def joints(self, indices: IntArray) -> FineMotion | None:
        """Return the joint motion from samples to the next ones; None if unknown.

        - `indices`: indices of the samples in the execution, increasing, (m,).
        """
        motion = self.executed
        if self._smooth[indices].all():
            return FineMotion.through(motion.t, motion.q, motion.dq, motion.ddq, indices)
        return motion.between(indices)

    def path(self, first: int, last: int) -> ToolPath | None:
        """Return the tool motion from sample `first` to the sample after `last`; None if unknown.

        - `first`, `last`: indices of samples in the execution.
        """
        from armcontour.verification.peak_search import ToolPath

        motion = self.executed
        arm = motion.arm
        if self._smooth[first : last + 1].all():
            nodes = slice(first, last + 2)
            velocities = motion.dq[nodes].copy()
            return ToolPath(
                t=motion.t[nodes].copy(),
                q=motion.q[nodes].copy(),
                before=velocities,
                after=velocities,
                ddq=motion.ddq[nodes].copy(),
                links=arm.link_table,
                dimension=arm.dimension,
            )
        fine = motion.between(np.arange(first, last + 1))
        if fine is None:
            return None
        none = np.empty((0, fine.q.shape[1]))
        return ToolPath(
            t=kernel_array(fine.t),
            q=kernel_array(fine.q),
            before=kernel_array(fine.before),
            after=kernel_array(fine.after),
            ddq=none if fine.ddq is None else kernel_array(fine.ddq),
            links=arm.link_table,
            dimension=arm.dimension,
        )
