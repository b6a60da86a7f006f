"""Errors of the tool that errors of the joints make."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.geometry import Path
from armcontour.motion import Trajectory


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolError:
    """Errors of the tool over a run, as in `LearnedRun`.

    Args:
        tool_rms: RMS distance from the planned position at the same time [m].
        tool_max: Largest such distance [m].
        contour_rms: RMS distance from the path [m]; None without a path.
        contour_max: Largest such distance [m].
    """

    tool_rms: float
    tool_max: float
    contour_rms: float | None
    contour_max: float | None

    @property
    def rms(self) -> float:
        """The error by which runs are compared [m]."""
        return self.tool_rms if self.contour_rms is None else self.contour_rms


class Judge:
    """Judges errors of joints by what they do to the tool.

    A path is judged from its first set-point to the end of the times, contours of a program while
    the process is at work on them. The tool's place on the path is the nearest one.

    Args:
        arm: The arm.
        plan: The planned motion.
        t: Times [s], (n,).
        planned: Planned joint positions at the times [rad], (n, dof).
    """

    def __init__(self, arm: Arm, plan: Trajectory, t: FloatArray, planned: FloatArray) -> None:
        self.arm, self.planned = arm, planned
        self.tool = arm.forward(planned)
        self._paths = _paths(plan, t)

    def judge(self, error: FloatArray) -> ToolError:
        """Errors of the tool.

        Args:
            error: Errors of the joints [rad], (n, dof).
        """
        tool = self.arm.forward(self.planned + error)
        off = np.linalg.norm(tool - self.tool, axis=1)
        found = [path.project(tool[which]).distance for path, which in self._paths]
        contour = np.concatenate(found) if found else None
        return ToolError(
            tool_rms=_rms(off),
            tool_max=float(off.max()),
            contour_rms=None if contour is None else _rms(contour),
            contour_max=None if contour is None else float(contour.max()),
        )


def _paths(plan: Trajectory, t: FloatArray) -> list[tuple[Path, IntArray]]:
    """The paths of a plan, and which times belong to each; empty if one has no path."""
    if not plan.spans:
        return [] if plan.path is None else [(plan.path, np.arange(len(t)))]
    found: list[tuple[Path, IntArray]] = []
    for span in plan.contour_spans:
        path = None if span.trajectory is None else span.trajectory.path
        start, end = span.work or span.t
        which = np.flatnonzero((t >= start) & (t <= end))
        if path is None:
            return []
        if len(which):
            found.append((path, which))
    return found


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))
