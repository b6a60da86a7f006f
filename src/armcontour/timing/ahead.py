"""Plans of the moves of a program, made ahead: in other processes where that saves time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from armcontour._checks import FloatArray
from armcontour._processes import WorkAhead
from armcontour.arms import Arm
from armcontour.geometry import Path, Segments
from armcontour.motion import JointPath, Law, Method, PathLaw, Rates, Trajectory
from armcontour.program import Contour, Program
from armcontour.timing.methods import MoveTiming, Smoothed, Timing
from armcontour.timing.program_tracing import AddMove, TracedMove


@contextmanager
def planned_ahead(program: Program, timing: MoveTiming) -> Iterator[tuple[MoveTiming, AddMove]]:
    """A context with a timing that gives the same plans of a program's moves, in their order.

    All moves are added before the first plan is asked for; others begin to plan meanwhile. Only a
    `Timing` by the planner plans every move independently of the others; a `Smoothed` one smooths
    its plans. Any other timing, and that of a single move, is given as it is.

    Args:
        program: The program.
        timing: How its moves are timed.
    """
    inner = timing.timing if isinstance(timing, Smoothed) else timing
    known = (Method.OPTIMAL, Method.SHAPED) if len(program.moves) > 1 else ()
    if not isinstance(inner, Timing) or inner.method not in known:
        yield timing, lambda step, share: None
        return
    contours = [isinstance(x, Contour) for x in program.moves]
    # A constraint of a user may ask for anything; limits ask where the segments of a path are.
    whole = bool(inner.options.get("constraints"))
    with WorkAhead(partial(_plan, inner)) as work:

        def add(step: TracedMove, share: float) -> None:
            if step.joint_path is not None:
                is_contour = step.move is not None and contours[step.move]
                work.add(_Move(step.joint_path, is_contour, whole), share)

        ahead = _Ahead(inner, work.results())
        yield Smoothed(ahead, timing.windows) if isinstance(timing, Smoothed) else ahead, add


@dataclass(frozen=True, slots=True)
class _Move:
    """A contour or a rapid to be planned.

    Args:
        joint_path: Its joint path.
        is_contour: Whether it is a contour.
        whole: Whether other processes get its tool path as it is. A rounded path has its objective
            path and its corners, which take longer to send than the joint path does.
    """

    joint_path: JointPath
    is_contour: bool
    whole: bool = True

    def __reduce__(self) -> tuple[Callable[..., _Move], tuple[Any, ...]]:
        """What is sent to other processes."""
        x = self.joint_path
        if self.whole or x.tool_path is None:
            return _Move, (x, self.is_contour)
        parts = x.breaks, x.coefficients, x.stops, x.tool_path.segments
        return _plain_move, (*parts, self.is_contour)


def _plain_move(
    breaks: FloatArray,
    coefficients: FloatArray,
    stops: FloatArray,
    segments: Segments,
    is_contour: bool,
) -> _Move:
    """A move along a tool path of nothing but segments."""
    path = Path(segments=segments)
    x = JointPath(breaks=breaks, coefficients=coefficients, stops=stops, tool_path=path)
    return _Move(x, is_contour)


@dataclass(frozen=True, slots=True)
class _Made:
    """The plan of a move, of which another process sends a `_Plan`.

    Args:
        trajectory: The plan.
        joint_path: The joint path of the move.
    """

    trajectory: Trajectory
    joint_path: JointPath

    def __reduce__(self) -> tuple[type[_Plan], tuple[Any, ...]]:
        """What is sent to other processes."""
        (law,) = self.trajectory.laws
        assert isinstance(law, PathLaw)
        own = None if law.joint_path is self.joint_path else law.joint_path
        return _Plan, (law.breaks, law.s, law.rates, self.trajectory.method, own)


@dataclass(frozen=True, slots=True)
class _Plan:
    """The plan of a move, without what is known of the move already.

    Args:
        breaks: As in `PathLaw`.
        s: As in `PathLaw`.
        rates: As in `PathLaw`.
        method: The method.
        joint_path: The joint path of the law; None if it is that of the move.
    """

    breaks: FloatArray
    s: FloatArray
    rates: Rates
    method: str
    joint_path: JointPath | None


def _plan(timing: Timing, move: _Move) -> _Made:
    """Plan a move."""
    plan = timing.contour if move.is_contour else timing.rapid
    return _Made(plan(move.joint_path), move.joint_path)


@dataclass(frozen=True, slots=True)
class _Ahead:
    """Times the moves of a program, which come in order, by plans that are made ahead.

    Args:
        timing: How the plans are made.
        plans: The plans in order.
    """

    timing: Timing
    plans: Iterator[_Made | _Plan]

    @property
    def arm(self) -> Arm:
        """The arm that moves."""
        return self.timing.arm

    def contour(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """The plan of the next move, a contour."""
        return self._next(joint_path)

    def rapid(self, joint_path: JointPath, before: Sequence[Law] = ()) -> Trajectory:
        """The plan of the next move, a rapid."""
        return self._next(joint_path)

    def pause(self, before: Sequence[Law]) -> float:
        """As of the timing [s]."""
        return self.timing.pause(before)

    def _next(self, joint_path: JointPath) -> Trajectory:
        """The next plan, along the joint path that it was made for."""
        plan = next(self.plans)
        if isinstance(plan, _Made):
            return plan.trajectory
        law = PathLaw(
            joint_path=plan.joint_path or joint_path, breaks=plan.breaks, s=plan.s, rates=plan.rates
        )
        return Trajectory(laws=(law,), method=plan.method, path=joint_path.tool_path)
