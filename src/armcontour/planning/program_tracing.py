"""Joint paths of all moves of a program, with each contour in its fastest configuration."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmContourError, InvalidInput, Unreachable, error_context
from armcontour.core.frames import exp, log, shortest
from armcontour.core.memory import content_key, is_remembering, remembered
from armcontour.core.progress import Progress, contour_step
from armcontour.core.render import number
from armcontour.geometry import Path, ShapedPath
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.path import cut_path
from armcontour.motion import JointPath, Trajectory
from armcontour.planning.duration_bound import bound_duration
from armcontour.planning.optimal_timing import Optimal, plan_optimal
from armcontour.planning.still_rapids import (
    find_gap,
    rapids_to_contour,
    trace_across,
    trace_away,
    trace_towards,
)
from armcontour.planning.tracing import (
    Candidate,
    is_redundant,
    sketch_all,
    trace,
    trace_all,
    trace_candidates,
    trace_rest,
    trace_to,
)
from armcontour.planning.tracing.joint_ranges import turn_by
from armcontour.planning.tracing.leaning import may_lean
from armcontour.program import Contour, Move, Program, Rapid, contour_called
from armcontour.program.move_errors import move_context
from armcontour.robot import Arm, Limits, PlanarTwoLink, SerialArm, resolve_limits
from armcontour.robot.arm import unit_of

# Joint positions closer than this are equal [rad]; closed-form inverse kinematics has this error.
SAME_JOINT_POSITION = 1e-9
# Distance of the vertices of two paths below which the paths are equal [m].
SAME_VERTEX = 1e-12
# Options of the coarse plans by which configurations are compared
COARSE_PLAN = Optimal(intervals=400)
# Options of the plans for an arm that prefers the fastest joint path
FINE_PLAN = Optimal()
# Planar joint paths of more pieces are compared by lower bounds, because a plan takes seconds.
MAX_PLANNED_PIECES = 8_000
# On paths of more segments than this, configurations are compared on parts of the path.
MANY_SEGMENTS = 20_000
# Approximate number of segments of such a part.
PART_SEGMENTS = 200
# A long path has one such part for each of this many segments.
PART_EVERY = 2500
# Largest number of such parts.
MAX_COMPARED_PARTS = 40
# Part of the length at each end of a part that is not compared, because the motion there starts and
# ends at rest, and does not on the whole path
UNCOMPARED_ENDS = 0.25
# Configurations whose durations on the parts differ by less than this fraction are equally fast;
# durations of whole paths were found to differ by the same fraction within about 5e-4.
SAME_ON_PARTS = 5e-4
# Durations of whole parts, with their ends, that differ by more than this fraction decide.
MAX_SLOWER = 0.01
# A configuration is not planned if this fraction of its lower bound of the duration exceeds the
# duration of a plan. The fraction is below 1 because the bound evaluates limits at points only.
BOUND_SHARE = 0.998
# Durations that differ by at most this fraction, the accuracy of the planner, are equal.
EQUALLY_FAST = 1e-6
# An arm with external axes has the joint path of the lowest cost among those that are slower than
# the fastest one by at most this fraction, because costs follow the weights of the joints.
NEARLY_AS_FAST = 0.01
# Joint paths of such an arm whose cost exceeds the lowest one by more than this factor are used
# only if all others are rejected.
COSTLY = 2.0
# Name of the line from given joint positions to the first move, in messages.
TO_FIRST = "rapid from the given start"
# Location of errors of moves that the configuration of given joint positions does not complete.
IN_START_CONFIGURATION = "in the configuration of start_from"
# Rotation that no joint makes from given joint positions to the first move [rad].
WHOLE_TURN = 2 * np.pi
# Number of following contours that decide between equally fast configurations.
LOOK_AHEAD = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class TracedMove:
    """Joint path of a program's move, or of the rapid to the next move."""

    move: int | None  # Index of the move; None for a rapid between two moves that do not meet
    joint_path: JointPath | None = None  # The joint path; None for dwells and events
    called: str = ""  # Name of the move in error messages; empty for a single path
    entities: tuple[str, ...] = ()  # Names of the drawing's entities on the path of the move

    def named(self) -> AbstractContextManager[None]:
        """Add the name of the move, and the place on its path, to errors in this context."""
        path = None if self.joint_path is None else self.joint_path.tool_path
        return move_context(self.called, path, self.entities)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TracedWhole:
    """Joint path of a whole contour; a resumed program begins with the rest of this contour.

    Args:
        joint_path: The joint path.
        s: Arc length of the whole contour at which the rest begins [m].
        later: Joint paths of the later moves of the whole program, by their number from its end;
            the last move has the number 1.
        chosen: The later contours of the program, if it leaves out contours of the whole program;
            they are all traced as in the whole program.
        rapid: Joint paths from the contour before to this contour, in order.
    """

    joint_path: JointPath
    s: float
    later: Mapping[int, JointPath]
    chosen: tuple[TracedWhole, ...] = ()
    rapid: tuple[JointPath, ...] = ()

    @property
    def q(self) -> FloatArray:
        """Joint positions at which the rest begins [rad], (dof,)."""
        return self.joint_path(self.s)

    def start_of(self, contour: Contour, arm: Arm) -> tuple[str | None, FloatArray | None]:
        """Return configuration or seed [rad], (dof,), for the rest of the contour with its leads.

        An arm in the plane has a configuration, other arms have a seed; the other value is None.
        """
        start = ends_of(self.trace(contour, arm))[0]
        if isinstance(arm, PlanarTwoLink):
            return arm.configuration_of(start), None
        return None, start

    def later_paths(self, moves: Sequence[Move]) -> dict[int, JointPath]:
        """Map move indices to joint paths, for moves that are the same in the whole program.

        - `moves`: moves of the resumed program.
        """
        paths: dict[int, JointPath] = {}
        for from_end, joint_path in self.later.items():
            i = len(moves) - from_end
            if i < 0:
                # Automatic leads are found along the contours alone, without rapids.
                continue
            path = joint_path.tool_path
            move = moves[i]
            if isinstance(move, Contour) and path is not None and _is_same(path, move.path):
                paths[i] = joint_path
        return paths

    def trace(self, contour: Contour, arm: Arm) -> JointPath:
        """Trace the rest of the contour, with its leads, in the configuration of the whole."""
        return trace_rest(contour.path, arm, self.joint_path, self.s, contour.at_work[0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tracing:
    """A program with its joint paths; plans that differ only in timing share it.

    Args:
        program: The program.
        steps: The joint paths in order.
        faster_rejected: True if a faster configuration was not accepted.
    """

    program: Program
    steps: tuple[TracedMove, ...]
    faster_rejected: bool = False

    @classmethod
    def along(cls, joint_path: JointPath, path: Path) -> Tracing:
        """Make the tracing of a single path that is already traced."""
        return cls(
            program=Program.from_path(path), steps=(TracedMove(move=0, joint_path=joint_path),)
        )

    def is_contour(self, step: TracedMove) -> bool:
        """Test whether a step is a contour of the program."""
        return step.move is not None and isinstance(self.program.moves[step.move], Contour)

    @property
    def joint_paths(self) -> tuple[JointPath, ...]:
        """The joint paths in order, without dwells and events."""
        return tuple(x.joint_path for x in self.steps if x.joint_path is not None)


def trace_program(
    program: Program,
    arm: Arm,
    limits: Limits | None = None,
    *,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
    start: FloatArray | None = None,
    accept: Callable[[JointPath], bool] | None = None,
    progress: Progress | None = None,
    fastest: dict[int, JointPath] | None = None,
    whole: TracedWhole | None = None,
) -> Tracing:
    """Trace all moves of a program.

    The first contour starts in its fastest configuration. If several are equally fast, it is the
    one with the shortest duration of the next contours. Every other contour starts in the
    configuration nearest to the previous joint positions, or in its fastest configuration if the
    nearest one does not complete it. A rapid without a path, and a gap between two moves, becomes a
    straight line in joint space.

    Args:
        program: The program, with rounded corners and the required tool orientation.
        arm: The arm.
        limits: Limits with the joint ranges; they also determine the fastest configuration.
            By default those of the arm.
        configuration: As in `plan`.
        seed: As in `plan`; by default the start at which the contours were shaped, if they were.
        start: Joint positions [rad], (dof,), from which the program begins with a straight line in
            joint space. The moves up to the first contour have their configuration.
        accept: Returns whether a contour may follow a joint path. It is called when a configuration
            is chosen; a rejected configuration is used only if all are rejected.
        progress: Called after every contour with the step "tracing" and the fraction done.
        fastest: Cache of the fastest joint paths, for calls that differ in `seed` only.
        whole: Joint path of the whole first contour, whose configuration a resumed program keeps;
            `configuration`, `seed` and `accept` do not apply to this contour.

    Raises:
        ArmContourError: A move cannot be traced; the message starts with the name of the contour.
    """
    bounds = resolve_limits("trace_program", arm, limits)
    if seed is None:
        shaped = [x.path for x in program.contours if isinstance(x.path, ShapedPath)]
        seed = shaped[0].outcome.joints if shaped else None
    limited = arm.with_limits(bounds)
    key: tuple[Hashable, ...] = ()
    if is_remembering():
        program = _with_known_paths(program)
        key = arm, content_key(bounds)
    contours = program.contours
    cached = {} if fastest is None else fastest
    tracer = _Tracer(program, contours, limited, configuration, seed, start, accept, cached, key)
    if whole is not None:
        for i, known in enumerate((whole, *whole.chosen)):
            contour = contours[i]
            with move_context(contour_called(contour, i), contour.path, contour.entities):
                tracer.known[i] = known.trace(contours[i], limited)
        # A later contour that the arm cannot reach from the previous contour starts in the
        # configuration of the whole program.
        cached.update(whole.later_paths(program.moves))
    for i, move in enumerate(program.moves):
        tracer.follow(i, move)
        if isinstance(move, Contour) and progress is not None:
            progress(contour_step("tracing", tracer.done, len(contours)))
    return Tracing(
        program=program, steps=tuple(tracer.steps), faster_rejected=tracer.faster_rejected
    )


@dataclass(slots=True)
class _Tracer:
    """Traces the moves of a program in order; each starts at the end of the previous one."""

    program: Program
    contours: tuple[Contour, ...]
    arm: Arm  # The arm with the limits of the motion
    configuration: str | None
    seed: npt.ArrayLike | None
    start: FloatArray | None  # Joint positions at which the program begins, if given [rad]
    accept: Callable[[JointPath], bool] | None
    fastest: dict[int, JointPath]
    key: tuple[Hashable, ...]  # Key of the arm with its limits in a memory
    steps: list[TracedMove] = field(default_factory=list)
    last: JointPath | None = None  # Joint path of the previous move
    # Known joint paths of contours, by the index of the contour
    known: dict[int, JointPath] = field(default_factory=dict)
    # Index among the steps of the last rapid without a path, at which a gap to the next path is
    # closed; None for the place right before this path.
    rapid_step: int | None = None
    done: int = 0  # Number of traced contours
    # Joint paths of later moves that are already traced, by the index of the move
    ahead: dict[int, JointPath] = field(default_factory=dict)
    # Joint paths of the trials of `_look_ahead`, by the index of the move and the joint positions
    # from which they continue, as bytes. All trials and the tracing itself share them.
    tried: dict[tuple[int, bytes], JointPath] = field(default_factory=dict)
    looks_ahead: bool = True  # False in the trial that compares equally fast configurations
    faster_rejected: bool = False

    def follow(self, i: int, move: Move) -> None:
        """Append the steps of a move; a rapid without a path has none, see `_append`."""
        if isinstance(move, Contour):
            # A single path has no number in messages.
            alone = self.program.single_path is not None and not move.name
            called = "" if alone else contour_called(move, self.done)
            with move_context(called, move.path, move.entities):
                known = self.known.get(self.done, self.ahead.get(i))
                joint_path = self._trace(move.path, i) if known is None else known
                self._append(i, joint_path, called, move.entities)
            self.done += 1
        elif not isinstance(move, Rapid):
            self.steps.append(TracedMove(move=i))
        elif move.path is not None:
            self._rapid(i, move.path)
        else:
            self.rapid_step = len(self.steps)

    def _rapid(self, i: int, path: Path) -> None:
        """Add a rapid along a path, named after the next contour, or else the previous one."""
        before = self.contours[max(self.done - 1, 0) : self.done]
        after = self.contours[self.done : self.done + 1]
        if after:
            called = f"rapid to {contour_called(after[0], self.done)}"
        else:
            called = f"rapid away from {contour_called(before[0], self.done - 1)}"
        turned = turn_along(path, before, after)
        if self.arm.chain.still:
            with error_context(called):
                if i not in self.ahead:
                    self._trace_ahead(i, lambda x: turn_along(x, before, after))
                self._append(i, self.ahead[i], called)
            return
        with move_context(called, turned):
            if self.done == 0 and 0 in self.known:
                start = ends_of(self.known[0])[0]
                self._append(i, trace_to(turned, self.arm, start), called)
                return
            is_free = self.last is None and self.seed is None and self.start is None
            joint_path = self._trace_to(after[0], turned, i) if is_free else self._trace(turned, i)
            self._append(i, joint_path, called)

    def _append(
        self, i: int, joint_path: JointPath, called: str, entities: tuple[str, ...] = ()
    ) -> None:
        """Append a joint path, with a straight line in joint space to its start if needed."""
        end = self._end
        q = ends_of(joint_path)[0]
        if end is not None and np.abs(q - end).max() > SAME_JOINT_POSITION:
            line = remembered(("line", end.tobytes(), q.tobytes()), lambda: _straight_line(end, q))
            if self.last is None:
                _check_turns(line, self.arm)
                # Dwells and events before the first path are at its start, after this line.
                self.steps.insert(0, TracedMove(move=None, joint_path=line, called=TO_FIRST))
            else:
                # Dwells and events after a rapid without a path are at its end.
                index = len(self.steps) if self.rapid_step is None else self.rapid_step
                step = TracedMove(move=None, joint_path=line, called=called)
                self.steps.insert(index, step)
        self.rapid_step = None
        self.steps.append(
            TracedMove(move=i, joint_path=joint_path, called=called, entities=entities)
        )
        self.last = joint_path

    @property
    def _end(self) -> FloatArray | None:
        """Joint positions after the previous move [rad], (dof,); None if they are free."""
        return self.start if self.last is None else ends_of(self.last)[1]

    def _trace(self, path: Path, i: int) -> JointPath:
        """Trace the path of a move in the current configuration, if possible, or the fastest."""
        end = self._end
        if end is None:
            return self._fastest(path, i, self.seed)
        try:
            return self._continue(path, i, end)
        except Unreachable as error:
            if self.start is not None and not self.done:
                raise error.with_location(IN_START_CONFIGURATION) from None
            if not self.looks_ahead:
                return _without_unwinding(self._fastest(path, i), self.arm, end)
            if i not in self.fastest:
                self.fastest[i] = self._fastest(path, i)
            return _without_unwinding(self.fastest[i], self.arm, end)

    def _continue(self, path: Path, i: int, q: FloatArray) -> JointPath:
        """Trace the path of a move in the configuration at joint positions q [rad], (dof,)."""
        orientation = path.orientation
        if orientation is not None and orientation.cone > 0.0:
            # The tool may lean in several ways, which differ in duration and clearance.
            return self._fastest(path, i, q)
        key = (i, q.tobytes())
        if key in self.tried:
            return self.tried[key]
        configuration = configuration_of(self.arm, q)
        joint_path = remembered(
            ("trace", path, *self.key, content_key(configuration)),
            lambda: trace(path, self.arm, **configuration),
        )
        if not self.looks_ahead:
            self.tried[key] = joint_path
        return joint_path

    def _trace_ahead(self, i: int, turn: Callable[[Path], Path]) -> None:
        """Trace the rapids from move i to the next contour, and this contour.

        Joints that are still within contours move between them: on a joint motion without a path,
        or else along the last rapid before the contour.

        - `turn`: adds the orientation to the path of a rapid.
        """
        moves = self.program.moves
        arm = self.arm
        assert isinstance(arm, SerialArm)
        rapids, k = rapids_to_contour(moves, i)
        paths = [turn(x) for x in rapids.values()]
        end = self._end
        if k is None:
            assert end is not None
            self.ahead |= zip(rapids, trace_away(paths, arm, end), strict=True)
            return
        contour = moves[k]
        assert isinstance(contour, Contour)
        known = self.known.get(self.done)
        self.ahead[k] = self._trace(contour.path, k) if known is None else known
        start = ends_of(self.ahead[k])[0]
        before = None if end is None or self.last is None else self.last.tool_path
        gap = find_gap(moves, i, k, before)
        if gap is not None:
            count = sum(x < gap for x in rapids)
            joint_paths = trace_away(paths[:count], arm, start if end is None else end)
            joint_paths += trace_towards(paths[count:], arm, start)
            self.ahead |= zip(rapids, joint_paths, strict=True)
            return
        assert end is not None
        joint_paths = trace_across([*paths, contour.path], arm, end, start)
        self.ahead |= zip([*rapids, k], joint_paths, strict=True)

    def _trace_to(self, contour: Contour, path: Path, i: int) -> JointPath:
        """Trace the first rapid, move i, so that it ends in the contour's fastest configuration."""
        arm = self.arm
        moves = self.program.moves
        try:
            index = next(k for k in range(i, len(moves)) if moves[k] is contour)
            fastest = self._fastest(contour.path, index)
            back = trace(path.reversed(), arm, **configuration_of(arm, fastest(0.0)))
            return trace(path, arm, **configuration_of(arm, back(back.length)))
        except ArmContourError:
            # Try the other configurations. Errors of the contour are raised when the contour is
            # traced.
            return self._trace(path, i)

    def _fastest(self, path: Path, i: int, seed: npt.ArrayLike | None = None) -> JointPath:
        """Trace a move in its fastest accepted configuration; the next moves decide ties."""
        accept = self.accept if self.looks_ahead else None
        fastest_rejected: JointPath | None = None
        groups = trace_by_duration(path, self.arm, configuration=self.configuration, seed=seed)
        for group in groups:
            for joint_path in self._sort_by_next_moves(group, i):
                if accept is None or np.all(accept(joint_path)):
                    self.faster_rejected |= fastest_rejected is not None
                    return joint_path
                if fastest_rejected is None:
                    fastest_rejected = joint_path
        assert fastest_rejected is not None
        return fastest_rejected

    def _sort_by_next_moves(self, joint_paths: list[JointPath], i: int) -> Iterator[JointPath]:
        """Yield equally fast joint paths of move i, those with the fastest next moves first.

        The others are followed only as far as their next moves do not take longer.
        """
        if len(joint_paths) == 1 or not self.looks_ahead:
            yield from joint_paths
            return
        self.tried.clear()
        trials = [self._look_ahead(x, i) for x in joint_paths]
        durations = np.zeros(len(trials))
        is_complete = np.zeros(len(trials), dtype=np.bool_)
        waiting = np.ones(len(trials), dtype=np.bool_)
        while waiting.any():
            shortest = durations[is_complete & waiting].min(initial=np.inf)
            as_fast = waiting & (durations <= shortest * (1 + EQUALLY_FAST))
            followed = as_fast & ~is_complete
            if followed.any():
                k = int(np.argmin(np.where(followed, durations, np.inf)))
                duration = next(trials[k], None)
                if duration is None:
                    is_complete[k] = True
                else:
                    durations[k] = duration
                continue
            for index in np.flatnonzero(as_fast):
                yield joint_paths[index]
            waiting &= ~as_fast

    def _look_ahead(self, joint_path: JointPath, i: int) -> Iterator[float]:
        """Yield lower bounds of the duration from the end of move i to that of each next move [s].

        The last one is infinite if a move is infeasible.
        """
        done = sum(isinstance(x, Contour) for x in self.program.moves[: i + 1])
        trial = replace(
            self,
            steps=[],
            last=joint_path,
            rapid_step=None,
            done=done,
            ahead={},
            looks_ahead=False,
        )
        duration = 0.0
        for k, move in enumerate(self.program.moves[i + 1 :], i + 1):
            if trial.done == done + LOOK_AHEAD:
                break
            # A straight line to the start of the move is inserted at the last rapid.
            first = len(trial.steps) if trial.rapid_step is None else trial.rapid_step
            try:
                trial.follow(k, move)
            except ArmContourError:
                yield np.inf
                return
            for x in trial.steps[first:]:
                if x.joint_path is not None:
                    duration += bound_duration(x.joint_path, self.arm.limits)
            yield duration


def _without_unwinding(joint_path: JointPath, arm: Arm, end: FloatArray) -> JointPath:
    """Shift joints without a range by whole turns, so that they begin near the previous end.

    - `end`: joint positions after the previous move [rad], (dof,).
    """
    if not isinstance(arm, SerialArm):
        return joint_path
    lower, upper = arm.limits.joint_range(arm.dof)
    endless = np.isinf(lower) & np.isinf(upper) & ~arm.chain.slides
    turns = np.rint((end - ends_of(joint_path)[0]) / (2 * np.pi))
    return turn_by(joint_path, np.where(endless, turns, 0.0))


def _with_known_paths(program: Program) -> Program:
    """Return a program in which paths with known contents are the known objects.

    Results are then found by the identity of their path.
    """
    moves = list(program.moves)
    for i, move in enumerate(moves):
        if isinstance(move, Contour):
            # The key of the same object is known, because computing it takes long.
            moves[i] = _with_known_path(move)
    return replace(program, moves=tuple(moves))


def _with_known_path(contour: Contour) -> Contour:
    """Return a contour whose path is the known object with the same contents, if there is one."""
    path = contour.path
    # The key of the same object is remembered, because computing it takes long.
    content = remembered(("content", path), lambda: content_key(path))
    known = remembered(("path", content), lambda: path)
    return contour if known is path else replace(contour, path=known)


def _is_same(path: Path, other: Path) -> bool:
    """Test whether two paths have the same vertices."""
    if len(path) != len(other):
        return False
    return bool(np.abs(path.vertices - other.vertices).max() <= SAME_VERTEX)


def _straight_line(begin: FloatArray, end: FloatArray) -> JointPath:
    """Make the straight line in joint space between two joint positions [rad], (dof,) each."""
    length = float(np.linalg.norm(end - begin))
    coefficients = np.zeros((1, 6, len(begin)))
    coefficients[0, 0] = begin
    coefficients[0, 1] = (end - begin) / length * length
    return JointPath(breaks=np.array([0.0, length]), coefficients=coefficients)


def _check_turns(line: JointPath, arm: Arm) -> None:
    """Refuse a line to the first move on which a revolute joint turns by a whole turn or more."""
    begin, end = ends_of(line)
    turns = np.where(arm.chain.slides, 0.0, np.abs(end - begin))
    j = int(turns.argmax())
    if turns[j] < WHOLE_TURN:
        return
    unit = unit_of(arm, "rad", j)
    raise InvalidInput(
        f"From the given start, joint {j + 1} ({arm.joint_names[j]}) would turn by "
        f"{number(turns[j], unit)} to the first move, from {number(begin[j], unit)} to "
        f"{number(end[j], unit)}, but only less than a whole turn is allowed. Check the units and "
        "the order of the joints, or teach a start that is nearer.",
        joint=j,
        needed=float(turns[j]),
        allowed=WHOLE_TURN,
    )


def ends_of(joint_path: JointPath) -> tuple[FloatArray, FloatArray]:
    """Return joint positions at the start and at the end of a joint path [rad], (dof,) each."""
    start = joint_path.coefficients[0, 0]
    end = joint_path.coefficients[-1, 5]
    # Evaluate the polynomial of the last interval at its end by Horner's rule.
    for k in range(4, -1, -1):
        end = end + joint_path.coefficients[-1, k]
    return start + 0.0, end


def configuration_of(arm: Arm, q: FloatArray) -> dict[str, Any]:
    """Return the arguments of `trace` for the configuration at joint positions [rad], (dof,)."""
    return (
        {"configuration": arm.configuration_of(q)}
        if isinstance(arm, PlanarTwoLink)
        else {"seed": q}
    )


def turn_along(path: Path, before: Sequence[Contour], after: Sequence[Contour]) -> Path:
    """Turn the tool along a rapid between two contours.

    The tool turns from the orientation at the end of the previous contour to that at the start of
    the next one.

    Returns the path with an orientation; the same path if it has one, or if none is required.

    - `before`: the contour before the rapid, if any.
    - `after`: the contour after the rapid, if any.
    """
    if path.orientation is not None or path.dimension == 2:
        return path
    ends = [(x.path.orientation, x.path.length) for x in before]
    ends += [(x.path.orientation, 0.0) for x in after]
    orientations = [(x, s) for x, s in ends if x is not None]
    if not orientations:
        return path
    axis_only = all(x.axis_only for x, _ in orientations)
    first = orientations[0][0](orientations[0][1])
    last = orientations[-1][0](orientations[-1][1])
    # If only tool axes are given, the tool does not turn about its axis. Between opposite
    # orientations, both directions of rotation are valid.
    turn = shortest(first[:, 2], last[:, 2]) if axis_only else log((last @ first.T)[None])[0]
    rates = np.tile(turn / path.length, (len(path), 1))
    starts = exp(path.breaks[:-1, None] * rates) @ first
    orientation = Orientation.even(path.lengths, starts, rates, axis_only=axis_only)
    cone = min(x.cone for x, _ in orientations) if axis_only else 0.0
    return replace(path, orientation=orientation.with_cone(cone))


def trace_by_duration(
    path: Path,
    arm: Arm,
    limits: Limits | None = None,
    *,
    configuration: str | None = None,
    seed: npt.ArrayLike | None = None,
) -> Iterator[list[JointPath]]:
    """Yield groups of equally fast joint paths, the fastest group first.

    An arm that prefers the least motion has groups of one joint path, the least motion first.

    The path is traced in all configurations. The joint paths of a group are sorted by length, the
    shortest first. For a path of more than MANY_SEGMENTS segments, only the fastest is yielded.
    """
    bounds = resolve_limits("trace_by_duration", arm, limits)
    # Limits of jerk increase the computing time and do not change the order of configurations.
    rough = bounds.without_jerk
    is_long = isinstance(path, Path) and len(path) > MANY_SEGMENTS
    if is_long and isinstance(arm, SerialArm) and not arm.chain.still:
        joint_path = (
            _trace_long(path, arm, bounds) if configuration is None and seed is None else None
        )
        if joint_path is not None:
            yield [joint_path]
            return
    candidates = trace_candidates(path, arm, limits=bounds, configuration=configuration, seed=seed)
    joint_paths = [x.joint_path for x in candidates]
    prefer = arm.chain.prefer if isinstance(arm, SerialArm) else None
    if len(joint_paths) == 1:
        yield joint_paths
    elif prefer == "least motion":
        yield from _by_cost(candidates, arm, rough)
    elif prefer == "fastest":
        yield from _group_by_duration(joint_paths, arm, rough, EQUALLY_FAST, FINE_PLAN)
    elif not _compares_costs(path, arm):
        yield from _group_by_duration(joint_paths, arm, rough, EQUALLY_FAST)
    else:
        for part in _divide_by_cost(candidates):
            yield from _group_by_duration(part, arm, rough, NEARLY_AS_FAST)


def _compares_costs(path: Path, arm: Arm) -> bool:
    """Test whether costs choose among joint paths that are nearly as fast as the fastest one."""
    # The costs of an arm without external axes and weights only measure the joint paths' lengths.
    # A tool that may lean leans where that is faster.
    if not isinstance(arm, SerialArm) or not is_redundant(path, arm) or may_lean(path, arm):
        return False
    chain = arm.chain
    return len(chain.external) > 0 or bool((np.asarray(chain.weights) != 1.0).any())


def _divide_by_cost(candidates: list[Candidate]) -> list[list[JointPath]]:
    """Return the joint paths of low cost, and the others, if any."""
    highest = COSTLY * candidates[0].cost
    low = [x.joint_path for x in candidates if x.cost <= highest]
    others = [x.joint_path for x in candidates if x.cost > highest]
    return [low, others] if others else [low]


def _by_cost(candidates: list[Candidate], arm: Arm, rough: Limits) -> Iterator[list[JointPath]]:
    """Yield joint paths one by one, that with the lowest cost first.

    Joint paths that cannot be planned come last.

    - `rough`: limits of the plans that show whether a joint path can be planned.
    """
    failed = []
    for candidate in sorted(candidates, key=lambda x: x.cost):
        joint_path = candidate.joint_path
        try:
            plan_optimal(joint_path, arm, rough, COARSE_PLAN)
        except ArmContourError:
            failed.append(joint_path)
            continue
        yield [joint_path]
    yield from ([x] for x in failed)


def _group_by_duration(
    joint_paths: list[JointPath],
    arm: Arm,
    rough: Limits,
    slack: float,
    options: Optimal = COARSE_PLAN,
) -> Iterator[list[JointPath]]:
    """Yield groups of equally fast joint paths.

    The first group has the first one of the joint paths whose durations exceed the shortest one by
    at most the fraction `slack`; the next group is found among the other joint paths.

    A joint path is planned only when its lower bound of the duration requires it.

    - `rough`: limits of the plans that compare joint paths.
    - `options`: options of these plans.
    """
    if len(joint_paths) == 1:
        yield joint_paths
        return
    lower_bounds = [bound_duration(x, rough) for x in joint_paths]
    order = np.argsort(lower_bounds, kind="stable").tolist()
    if isinstance(arm, PlanarTwoLink) and len(joint_paths[0].breaks) > MAX_PLANNED_PIECES:
        yield from ([joint_paths[i]] for i in order)
        return
    # Durations of the joint paths that are planned but not yet yielded, by index
    durations: dict[int, float] = {}
    while order or durations:
        # Joint paths whose lower bounds exceed the fastest duration are planned later.
        while order and BOUND_SHARE * lower_bounds[order[0]] <= (1 + slack) * min(
            durations.values(), default=np.inf
        ):
            i = order.pop(0)
            durations[i] = np.inf
            # If no configuration can be planned, the plan of the first one raises the error.
            with suppress(ArmContourError):
                durations[i] = plan_optimal(joint_paths[i], arm, rough, options).duration
        shortest = min(durations.values())
        first = min(i for i, x in durations.items() if x <= shortest * (1 + slack))
        chosen = durations[first]
        as_fast = sorted(
            i for i, x in durations.items()
            if x == chosen or abs(x - chosen) <= EQUALLY_FAST * chosen
        )  # fmt: skip
        yield [joint_paths[i] for i in as_fast]
        for i in as_fast:
            del durations[i]


def find_starts(path: Path, arm: SerialArm) -> list[FloatArray]:
    """Return the joint positions [rad], (dof,), at the start of a path in each configuration."""
    # A long path is checked at a few points only, so a configuration may not complete it.
    if len(path) > MANY_SEGMENTS and not arm.chain.still:
        try:
            return [x[0] for x in sketch_all(path, arm)[1]]
        except Unreachable:
            # `trace_all` raises the error.
            pass
    return [x(0.0) for x in trace_all(path, arm)]


def _trace_long(path: Path, arm: SerialArm, limits: Limits) -> JointPath | None:
    """Trace a long path in the configuration that is fastest on parts of it; None if none is found.

    The others are only tried if this one does not complete the path.
    """
    try:
        s, solutions = sketch_all(path, arm, limits=limits)
    except Unreachable:
        # `trace_all` raises the error.
        return None
    for k in _order_on_parts(path, arm, limits, s, solutions):
        with suppress(ArmContourError):
            return trace(path, arm, limits=limits, seed=solutions[k][0])
    return None


def _order_on_parts(
    path: Path, arm: SerialArm, limits: Limits, s: FloatArray, solutions: list[FloatArray]
) -> list[int]:
    """Return the indices of the solutions, the fastest one on parts of a long path first.

    `solutions` are the joint positions at the arc lengths `s` [m] in each configuration, (n, dof),
    the shortest joint path first. The first one of equally fast configurations is used.
    """
    rough = limits.without_jerk
    first, parts = _cut_parts(path, s)
    # Lower bounds and durations of the parts with their ends, and durations without their ends [s]
    bounds = np.full(len(solutions), np.inf)
    whole = np.full(len(solutions), np.inf)
    inner = np.full(len(solutions), np.inf)
    traced = list[list[JointPath]]()
    for k, q in enumerate(solutions):
        joint_paths = list[JointPath]()
        with suppress(ArmContourError):
            for part, i in zip(parts, first, strict=True):
                joint_paths.append(trace(part, arm, limits=limits, seed=q[i]))
            bounds[k] = sum(bound_duration(x, rough) for x in joint_paths)
        traced.append(joint_paths)
    order = np.argsort(bounds, kind="stable")
    for k in order:
        is_slower = BOUND_SHARE * bounds[k] > (1 + MAX_SLOWER) * whole.min()
        if is_slower or np.isinf(bounds[k]):
            break
        with suppress(ArmContourError):
            plans = [plan_optimal(x, arm, rough, COARSE_PLAN) for x in traced[k]]
            whole[k] = sum(x.duration for x in plans)
            inner[k] = sum(_duration_of_middle(x) for x in plans)
    as_fast = np.flatnonzero(inner <= (1 + SAME_ON_PARTS) * inner.min())
    slower = order[np.argsort(inner[order], kind="stable")]
    return [*as_fast.tolist(), *(k for k in slower.tolist() if k not in as_fast)]


def _cut_parts(path: Path, s: FloatArray) -> tuple[IntArray, list[Path]]:
    """Cut parts out of a long path; return the indices of their starts in `s`, and the parts.

    `s` are arc lengths at which joint positions are known [m], (n,).
    """
    count = min(max(len(path) // PART_EVERY, 1), MAX_COMPARED_PARTS)
    length = path.length * min(PART_SEGMENTS / len(path), 1.0)
    first = np.searchsorted(s, np.linspace(0, path.length - length, count), side="right") - 1
    last = np.append(s[first[:-1]] + length, path.length)
    parts = [cut_path(path, s[i], end) for i, end in zip(first, last, strict=True)]
    return first, parts


def _duration_of_middle(part: Trajectory) -> float:
    """Return the duration of the plan of a part without the ends of the part [s]."""
    length = float(part.s(part.duration))
    begin, end = part.time_at(length * np.array([UNCOMPARED_ENDS, 1.0 - UNCOMPARED_ENDS]))
    return float(end - begin)
