"""Tracing a program: what the joints follow, move by move, before any of it is timed."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step
from armcontour.arms import Arm, Limits, PlanarTwoLink
from armcontour.errors import ArmContourError, Unreachable, locate_errors
from armcontour.frames import exp, log, shortest
from armcontour.geometry import Path
from armcontour.geometry.cutting import reverse_path
from armcontour.geometry.orientation import Orientation
from armcontour.motion import JointPath
from armcontour.program import Contour, Move, Program, Rapid, contour_called
from armcontour.timing.fastest_configuration import trace_fastest
from armcontour.tracing import trace

# Joint positions nearer than this are the same [rad]: what exact inverse kinematics leaves.
SAME_POSITION = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedMove:
    """What the joints do for a move of a program, or to get from one move to the next.

    Args:
        move: Index of the move; None for the rapid between two moves that do not meet.
        joint_path: What the joints follow; None where they stand still.
        called: What sentences call it; empty for a path alone.
    """

    move: int | None
    joint_path: JointPath | None = None
    called: str = ""

    def named(self) -> AbstractContextManager[None]:
        """Errors that occur inside begin with what the step is called."""
        return locate_errors(self.called) if self.called else nullcontext()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracing:
    """A program with what the joints follow; plans that differ only in timing share it.

    Args:
        program: The program.
        steps: What the joints do, in order.
    """

    program: Program
    steps: tuple[TracedMove, ...]

    @classmethod
    def along(cls, joint_path: JointPath, path: Path) -> Tracing:
        """The program of one path that is traced already."""
        return cls(program=Program.of(path), steps=(TracedMove(move=0, joint_path=joint_path),))

    @property
    def joint_paths(self) -> tuple[JointPath, ...]:
        """What the joints follow, step by step; they stand still between some."""
        return tuple(x.joint_path for x in self.steps if x.joint_path is not None)


def trace_program(
    program: Program,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    progress: Progress | None = None,
) -> Tracing:
    """What the joints follow along all moves of a program.

    The first contour starts in the configuration that is fastest along it; every other one in that
    which is nearest to where the joints are then, or in the fastest if that does not complete it.
    A rapid without a path, and whatever gap is left between two moves, is a straight line of the
    joints.

    Args:
        program: The program, with its corners rounded and the tool's orientation given.
        arm: The arm.
        limits: They rule the ranges of the joints, and which configuration is the fastest; by
            default the arm's own.
        branch: As in `plan`.
        start: As in `plan`.
        progress: Called after every contour with the step "tracing" and the share that is done.

    Raises:
        ArmContourError: As tracing raises it, with the contour's name.
    """
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    tracer = _Tracer(program.single_path, program.contours, arm, bounds, branch, start)
    for i, move in enumerate(program.moves):
        tracer.follow(i, move)
        if isinstance(move, Contour) and progress is not None:
            progress(Step(("tracing",), tracer.done / len(tracer.contours)))
    return Tracing(program=program, steps=tuple(tracer.steps))


@dataclass(slots=True)
class _Tracer:
    """Steps so far, each of which starts where the one before ended."""

    single_path: Path | None
    contours: tuple[Contour, ...]
    arm: Arm
    limits: Limits
    branch: str | None
    start: npt.ArrayLike | None
    steps: list[TracedMove] = field(default_factory=list)
    last: JointPath | None = None
    done: int = 0

    def follow(self, i: int, move: Move) -> None:
        """Add the steps of a move; a rapid without a path is the gap before the next move."""
        if isinstance(move, Contour):
            # A path alone has no number.
            alone = self.single_path is not None and not move.name
            called = "" if alone else contour_called(move, self.done)
            with TracedMove(move=i, called=called).named():
                self._append(i, self._trace(move.path), called)
            self.done += 1
        elif not isinstance(move, Rapid):
            self.steps.append(TracedMove(move=i))
        elif move.path is not None:
            self._rapid(i, move.path)

    def _rapid(self, i: int, path: Path) -> None:
        """Add a rapid along a path, called by the contour that it leads to, or away from."""
        before = self.contours[max(self.done - 1, 0) : self.done]
        after = self.contours[self.done : self.done + 1]
        if after:
            called = f"rapid to {contour_called(after[0], self.done)}"
        else:
            called = f"rapid away from {contour_called(before[0], self.done - 1)}"
        turned = _turn_tool(path, before, after)
        with locate_errors(called):
            first = self.last is None and self.start is None
            found = self._trace_to(after[0], turned) if first else self._trace(turned)
            self._append(i, found, called)

    def _append(self, i: int, joint_path: JointPath, called: str) -> None:
        """Add what the joints follow, and a straight line of the joints to where it starts."""
        if self.last is not None:
            end, q = ends_of(self.last)[1], ends_of(joint_path)[0]
            if np.abs(q - end).max() > SAME_POSITION:
                line = JointPath.spline([end, q])
                self.steps.append(TracedMove(move=None, joint_path=line, called=called))
        self.steps.append(TracedMove(move=i, joint_path=joint_path, called=called))
        self.last = joint_path

    def _trace(self, path: Path) -> JointPath:
        """A path from the configuration that the joints are in, if that completes it."""
        if self.last is None or isinstance(self.arm, PlanarTwoLink):
            start = self.start if self.last is None else None
            return trace_fastest(path, self.arm, self.limits, branch=self.branch, start=start)
        try:
            return trace(path, self.arm, limits=self.limits, start=ends_of(self.last)[1])
        except Unreachable:
            return trace_fastest(path, self.arm, self.limits)

    def _trace_to(self, contour: Contour, path: Path) -> JointPath:
        """A rapid before the first contour, in the configuration that is fastest along that."""
        arm, limits = self.arm, self.limits
        if isinstance(arm, PlanarTwoLink):
            return self._trace(path)
        try:
            fastest = trace_fastest(contour.path, arm, limits)
            back = trace(reverse_path(path), arm, limits=limits, start=fastest(0.0))
            return trace(path, arm, limits=limits, start=back(back.length))
        except ArmContourError:
            # In another configuration, if there is one; what is wrong with the contour, it says.
            return self._trace(path)


def ends_of(joint_path: JointPath) -> tuple[FloatArray, FloatArray]:
    """Where the joints are at the start and at the end of a joint path [rad], (dof,) each."""
    first, last = joint_path.breaks[[0, -1]]
    return joint_path(first), joint_path(last, side="left")


def _turn_tool(path: Path, before: Sequence[Contour], after: Sequence[Contour]) -> Path:
    """A rapid's path with the tool turning from the last contour's orientation to the next one's.

    Args:
        path: The path.
        before: The contour before it, if there is one.
        after: The contour after it, if there is one.
    """
    if path.orientation is not None or path.dimension == 2:
        return path
    ends = [(x.path.orientation, x.path.length) for x in before]
    ends += [(x.path.orientation, 0.0) for x in after]
    given = [(x, s) for x, s in ends if x is not None]
    if not given:
        return path
    free = all(x.axis_only for x, _ in given)
    first, last = given[0][0](given[0][1]), given[-1][0](given[-1][1])
    # Of two ways of half a turn either will do, and an axis that is free to turn asks for none.
    turn = shortest(first[:, 2], last[:, 2]) if free else log((last @ first.T)[None])[0]
    rates = np.tile(turn / path.length, (len(path), 1))
    starts = exp(path.breaks[:-1, None] * rates) @ first
    return dataclasses.replace(
        path, orientation=Orientation.even(path.lengths, starts, rates, axis_only=free)
    )
