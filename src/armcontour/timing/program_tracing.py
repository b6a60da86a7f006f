"""Joint paths of all moves of a program, before the program is timed."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step
from armcontour.arms import Arm, Limits, PlanarTwoLink, choose_limits
from armcontour.errors import ArmContourError, Unreachable, locate_errors
from armcontour.frames import exp, log, shortest
from armcontour.geometry import Path
from armcontour.geometry.cutting import reverse_path
from armcontour.geometry.orientation import Orientation
from armcontour.motion import JointPath
from armcontour.program import Contour, Move, Program, Rapid, contour_called
from armcontour.timing.fastest_configuration import AS_FAST, bound_duration, trace_by_duration
from armcontour.tracing import trace

# Joint positions nearer than this are the same [rad]: the error of exact inverse kinematics.
SAME_POSITION = 1e-9
# Where configurations are as fast for a contour, so many contours after it tell which is chosen.
AHEAD = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedMove:
    """The joint path of a move of a program, or of the rapid from one move to the next.

    Args:
        move: Index of the move; None for a rapid between two moves that do not meet.
        joint_path: The joint path; None where the joints stand still.
        called: Name of the move in error messages; empty for a single path.
    """

    move: int | None
    joint_path: JointPath | None = None
    called: str = ""

    def named(self) -> AbstractContextManager[None]:
        """A context in which error messages start with the name of the move."""
        return locate_errors(self.called) if self.called else nullcontext()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracing:
    """A program with its joint paths; plans that differ only in timing share it.

    Args:
        program: The program.
        steps: The joint paths in order.
        passed_over: Whether a configuration was taken that is not the fastest, as that did not fit.
    """

    program: Program
    steps: tuple[TracedMove, ...]
    passed_over: bool = False

    @classmethod
    def along(cls, joint_path: JointPath, path: Path) -> Tracing:
        """The tracing of one path that is traced already."""
        return cls(program=Program.of(path), steps=(TracedMove(move=0, joint_path=joint_path),))

    @property
    def joint_paths(self) -> tuple[JointPath, ...]:
        """The joint paths in order, without the steps at which the joints stand still."""
        return tuple(x.joint_path for x in self.steps if x.joint_path is not None)


def trace_program(
    program: Program,
    arm: Arm,
    limits: Limits | None = None,
    *,
    branch: str | None = None,
    start: npt.ArrayLike | None = None,
    fits: Callable[[JointPath], bool] | None = None,
    progress: Progress | None = None,
) -> Tracing:
    """Trace all moves of a program.

    The first contour starts in its fastest configuration, and where several are as fast for it, in
    the one in which the next contours are reached and done the soonest. Every other contour starts
    in the configuration nearest to the joint positions before it, or in its fastest configuration
    if the nearest one does not complete it. A rapid without a path, and a gap between two moves,
    becomes a straight line in joint space.

    Args:
        program: The program, with rounded corners and the required tool orientation.
        arm: The arm.
        limits: Limits with the joint ranges; they also decide which configuration is the fastest.
            By default the arm's own.
        branch: As in `plan`.
        start: As in `plan`.
        fits: Whether a contour may be followed along a joint path, asked where a configuration is
            chosen: one that does not fit is only taken if none does.
        progress: Called after every contour with the step "tracing" and the share that is done.

    Raises:
        ArmContourError: A move cannot be traced; the message starts with the name of the contour.
    """
    tracer = _Tracer.of(program, arm, limits, branch, start, fits)
    for i, move in enumerate(program.moves):
        tracer.follow(i, move)
        if isinstance(move, Contour) and progress is not None:
            progress(Step(("tracing",), tracer.done / len(tracer.contours)))
    return Tracing(program=program, steps=tuple(tracer.steps), passed_over=tracer.passed_over)


@dataclass(slots=True)
class _Tracer:
    """Traces the moves of a program one after the other; each starts where the last one ended."""

    single_path: Path | None
    moves: tuple[Move, ...]
    contours: tuple[Contour, ...]
    arm: Arm
    limited: Arm
    limits: Limits
    branch: str | None
    start: npt.ArrayLike | None
    fits: Callable[[JointPath], bool] | None
    steps: list[TracedMove] = field(default_factory=list)
    last: JointPath | None = None
    done: int = 0
    looks_ahead: bool = True
    passed_over: bool = False

    @classmethod
    def of(
        cls,
        program: Program,
        arm: Arm,
        limits: Limits | None,
        branch: str | None = None,
        start: npt.ArrayLike | None = None,
        fits: Callable[[JointPath], bool] | None = None,
    ) -> _Tracer:
        """The tracer of a program; arguments as in `trace_program`."""
        bounds = choose_limits("trace_program", arm, limits)
        return cls(
            program.single_path,
            program.moves,
            program.contours,
            arm,
            arm.with_limits(bounds),
            bounds,
            branch,
            start,
            fits,
        )

    def follow(self, i: int, move: Move) -> None:
        """Add the steps of a move; a rapid without a path is the gap before the next move."""
        if isinstance(move, Contour):
            # A single path has no number.
            alone = self.single_path is not None and not move.name
            called = "" if alone else contour_called(move, self.done)
            with TracedMove(move=i, called=called).named():
                self._append(i, self._trace(move.path, i), called)
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
        turned = turn_along(path, before, after)
        with locate_errors(called):
            first = self.last is None and self.start is None
            found = self._trace_to(after[0], turned, i) if first else self._trace(turned, i)
            self._append(i, found, called)

    def _append(self, i: int, joint_path: JointPath, called: str) -> None:
        """Append a joint path, with a straight line in joint space to its start if needed."""
        if self.last is not None:
            end, q = ends_of(self.last)[1], ends_of(joint_path)[0]
            if np.abs(q - end).max() > SAME_POSITION:
                self.steps.append(TracedMove(move=None, joint_path=_line(end, q), called=called))
        self.steps.append(TracedMove(move=i, joint_path=joint_path, called=called))
        self.last = joint_path

    def _trace(self, path: Path, i: int) -> JointPath:
        """Trace the path of a move from the present configuration, else from the fastest one."""
        if self.last is None or isinstance(self.arm, PlanarTwoLink):
            start = self.start if self.last is None else None
            return self._fastest(path, i, branch=self.branch, start=start)
        try:
            return trace(path, self.limited, start=ends_of(self.last)[1])
        except Unreachable:
            return self._fastest(path, i)

    def _trace_to(self, contour: Contour, path: Path, i: int) -> JointPath:
        """Trace a rapid to the first contour, in the configuration that is fastest for it."""
        arm, limits = self.arm, self.limits
        if isinstance(arm, PlanarTwoLink):
            return self._trace(path, i)
        try:
            at = next(k for k in range(i, len(self.moves)) if self.moves[k] is contour)
            fastest = self._fastest(contour.path, at)
            back = trace(reverse_path(path), arm, limits=limits, start=fastest(0.0))
            return trace(path, arm, limits=limits, start=back(back.length))
        except ArmContourError:
            # Try the other configurations; errors of the contour are raised when it is traced.
            return self._trace(path, i)

    def _fastest(
        self, path: Path, i: int, branch: str | None = None, start: npt.ArrayLike | None = None
    ) -> JointPath:
        """Trace the path of a move in its fastest configuration; of equals that for what follows.

        Args:
            path: The path.
            i: Index of the move.
            branch: As in `trace_fastest`.
            start: As in `trace_fastest`.
        """
        fits = self.fits if self.looks_ahead else None
        first: JointPath | None = None
        for group in trace_by_duration(path, self.limited, branch=branch, start=start):
            for x in self._in_order(group, i):
                if fits is None or fits(x):
                    self.passed_over |= first is not None
                    return x
                first = x if first is None else first
        assert first is not None
        return first

    def _in_order(self, as_fast: list[JointPath], i: int) -> list[JointPath]:
        """Joint paths of a move that are as fast: those first after which the rest is faster.

        Args:
            as_fast: The joint paths.
            i: Index of the move.
        """
        if len(as_fast) == 1 or not self.looks_ahead:
            return as_fast
        durations = np.array([self._look_ahead(x, i) for x in as_fast])
        durations[durations <= durations.min() * (1 + AS_FAST)] = durations.min()
        return [as_fast[k] for k in np.argsort(durations, kind="stable")]

    def _look_ahead(self, joint_path: JointPath, i: int) -> float:
        """A lower bound of the duration of some moves after a move [s]; infinite without a way.

        Args:
            joint_path: The joint path of the move.
            i: Index of the move.
        """
        done = sum(isinstance(x, Contour) for x in self.moves[: i + 1])
        trial = dataclasses.replace(self, steps=[], last=joint_path, done=done, looks_ahead=False)
        for k, move in enumerate(self.moves[i + 1 :], i + 1):
            if trial.done == done + AHEAD:
                break
            try:
                trial.follow(k, move)
            except ArmContourError:
                return np.inf
        ways = [x.joint_path for x in trial.steps if x.joint_path is not None]
        return sum(bound_duration(x, self.limits) for x in ways)


def _line(begin: FloatArray, end: FloatArray) -> JointPath:
    """The straight line between joint positions [rad], (dof,) each, over its length [rad]."""
    length = float(np.linalg.norm(end - begin))
    coefficients = np.zeros((1, 6, len(begin)))
    coefficients[0, 0], coefficients[0, 1] = begin, (end - begin) / length * length
    return JointPath(breaks=np.array([0.0, length]), coefficients=coefficients)


def ends_of(joint_path: JointPath) -> tuple[FloatArray, FloatArray]:
    """Joint positions at the start and at the end of a joint path [rad], (dof,) each."""
    start, end = joint_path.coefficients[0, 0], joint_path.coefficients[-1, 5]
    # The polynomial of the last interval at its end, as Horner's rule has it.
    for k in range(4, -1, -1):
        end = end + joint_path.coefficients[-1, k]
    return start + 0.0, end


def turn_along(path: Path, before: Sequence[Contour], after: Sequence[Contour]) -> Path:
    """Turn the tool along a rapid from the orientation of the last contour to that of the next.

    Args:
        path: The path of the rapid.
        before: The contour before the rapid, or nothing.
        after: The contour after the rapid, or nothing.

    Returns:
        The path with an orientation; the same path where it has one, or where none is required.
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
    # If only tool axes are given, the tool does not turn about its axis. For opposite orientations
    # either direction of rotation will do.
    turn = shortest(first[:, 2], last[:, 2]) if free else log((last @ first.T)[None])[0]
    rates = np.tile(turn / path.length, (len(path), 1))
    starts = exp(path.breaks[:-1, None] * rates) @ first
    return dataclasses.replace(
        path, orientation=Orientation.even(path.lengths, starts, rates, axis_only=free)
    )
