"""Plans of the moves of a program, in other processes where that saves time."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Any

from armcontour._checks import FloatArray
from armcontour._pool import map_in_order
from armcontour.arms import Arm
from armcontour.geometry import Path, Segments
from armcontour.motion import JointPath, Law, Method, PathLaw, Rates, Trajectory
from armcontour.program import Contour
from armcontour.timing.methods import MoveTiming, Smoothed, Timing
from armcontour.timing.program_tracing import Tracing


@contextmanager
def planned_in_processes(traced: Tracing, timing: MoveTiming) -> Iterator[MoveTiming]:
    """A context with a timing that gives the same plans of a program's moves, in their order.

    Other processes make them where that saves time. Only a `Timing` by the planner plans every move
    independently of the others; a `Smoothed` one smooths its plans. Any other timing, and that of a
    single move, is given as it is.

    Args:
        traced: The program with its joint paths.
        timing: How its moves are timed.
    """
    inner = timing.timing if isinstance(timing, Smoothed) else timing
    moves = traced.program.moves
    known = (Method.OPTIMAL, Method.SHAPED) if len(moves) > 1 else ()
    if not isinstance(inner, Timing) or inner.method not in known:
        yield timing
        return
    # A constraint of a user may ask for anything; limits ask where the segments of a path are.
    whole = bool(inner.options.get("constraints"))
    items = [
        _Move(x.joint_path, x.move is not None and isinstance(moves[x.move], Contour), whole)
        for x in traced.steps
        if x.joint_path is not None
    ]
    with closing(map_in_order(partial(_plan, inner), items)) as plans:
        planned = _Planned(inner, plans)
        yield Smoothed(planned, timing.windows) if isinstance(timing, Smoothed) else planned


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
class _Planned:
    """Times the moves of a program, which come in order, by plans that are made for them.

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
