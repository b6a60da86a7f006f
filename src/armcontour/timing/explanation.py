"""Why a plan is not faster: what binds where, and how much is run at the assigned velocity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput
from armcontour.motion import Method, PathLaw, Trajectory
from armcontour.timing.constraints import Constraint, IntervalEnds, ToolSpeed
from armcontour.timing.grid import Grid
from armcontour.timing.optimal import constraints_of

# A limit binds on an interval from this share of it on, which is what margins may take at most;
# below, the plan is between two limits.
BINDS = 0.99
# The assigned velocity counts as reached from this share of it on.
REACHED = 0.999
# The speed has turned when it has left its extreme by this share.
FLAT = 0.01
# What an explanation adds up over contours: lengths and times.
SUMMED = ("asked", "reached")


@dataclass(frozen=True, slots=True, kw_only=True)
class Binding:
    """A stretch of the path on which one limit binds.

    Args:
        limit: Such as "acceleration" or "assigned velocity"; "nothing" where a plan passes from one
            limit to another.
        joint: Joint number from 1, or None for a limit of the tool.
        t: Start and end [s].
        s: Start and end [m].
        share: Largest share of the limit in use on it.
    """

    limit: str
    joint: int | None
    t: tuple[float, float]
    s: tuple[float, float]
    share: float

    @property
    def name(self) -> str:
        """What people call it, such as "joint 2 acceleration"."""
        return self.limit if self.joint is None else f"joint {self.joint} {self.limit}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Shortfall:
    """A place where the assigned velocity is not reached, and why.

    Args:
        kind: "slowest" at a dip of the speed, "fastest" where it turns below the assigned velocity.
        s: The place [m].
        speed: Tool speed there [m/s].
        assigned: The assigned velocity there [m/s].
        reason: What binds there, such as "joint 2 acceleration".
    """

    kind: str
    s: float
    speed: float
    assigned: float
    reason: str

    @property
    def sentence(self) -> str:
        """For people."""
        return f"{self.reason} at s = {self.s:.3f} m: {self.speed:.3g} of {self.assigned:.3g} m/s"


@dataclass(frozen=True, slots=True, kw_only=True)
class Explanation:
    """What makes a plan take its time.

    Args:
        bindings: Stretch by stretch, from start to end.
        assigned_length: Share of the length run at the assigned velocity, of that which has one;
            None without one.
        assigned_time: Share of the time run at the assigned velocity, of the same part; None
            without one.
        shortfalls: Where the assigned velocity is not reached, and why.
    """

    bindings: tuple[Binding, ...]
    assigned_length: float | None
    assigned_time: float | None
    shortfalls: tuple[Shortfall, ...]


def explain(
    trajectory: Trajectory,
    arm: Arm,
    limits: Limits | None = None,
    *,
    constraints: Sequence[Constraint] = (),
) -> Explanation:
    """Say which limit binds where on a plan of the method "optimal".

    Args:
        trajectory: The plan.
        arm: The arm that it was made for.
        limits: The limits that it was made for; by default the arm's own.
        constraints: The further constraints that it was made for.

    Raises:
        InvalidInput: A plan of another method.
    """
    bounds = (arm.limits if limits is None else limits).for_joints(arm.dof)
    laws: list[tuple[float, float, PathLaw]] = []
    for x in trajectory.contour_spans:
        # The limits bind on intervals of the grid, and these only the law has.
        law = None if x.trajectory is None else x.trajectory.laws[0]
        if trajectory.method is not Method.OPTIMAL or not isinstance(law, PathLaw):
            raise InvalidInput(
                f"Only plans of the method optimal can be explained, not of {trajectory.method}."
            )
        laws.append((x.t[0], x.s[0], law))
    return _together([_of_law(law, arm, bounds, constraints, (t, s)) for t, s, law in laws])


@dataclass(frozen=True, slots=True)
class _Part:
    """What is said of one law; lengths and times that have an assigned velocity, and reach it."""

    bindings: tuple[Binding, ...]
    shortfalls: tuple[Shortfall, ...]
    asked: tuple[float, float] = (0.0, 0.0)
    reached: tuple[float, float] = (0.0, 0.0)


def _together(parts: Sequence[_Part]) -> Explanation:
    asked, reached = (np.sum([getattr(x, name) for x in parts], axis=0) for name in SUMMED)
    shares = [None, None] if asked[0] == 0 else (reached / asked).tolist()
    return Explanation(
        bindings=tuple(x for part in parts for x in part.bindings),
        assigned_length=shares[0],
        assigned_time=shares[1],
        shortfalls=tuple(x for part in parts for x in part.shortfalls),
    )


def _of_law(
    law: PathLaw,
    arm: Arm,
    bounds: Limits,
    constraints: Sequence[Constraint],
    offsets: tuple[float, float],
) -> _Part:
    """What binds on one law, with what is added to its times and places."""
    active = [*constraints_of(law.joint_path, arm, bounds), *constraints]
    middle = (law.s[:-1] + law.s[1:]) / 2
    grid = Grid(law.joint_path, law.s, law.joint_path.locate(middle))
    ends = IntervalEnds(arm, law, grid)
    used = [x.usage(ends) for x in active]
    names = [
        (constraint.name, k + 1 if constraint.joints else None)
        for constraint, shares in zip(active, used, strict=True)
        for k in range(shares.shape[1])
    ]
    shares = np.concatenate(used, axis=1)
    share = shares.max(axis=1)
    which = np.where(share >= BINDS, shares.argmax(axis=1), -1)
    bindings = _bindings(law, share, which, names, offsets)
    for constraint, shares in zip(active, used, strict=True):
        if isinstance(constraint, ToolSpeed):
            assigned = constraint.allowed(grid)[:, 0]
            reached = (shares[:, 0] >= REACHED) & np.isfinite(assigned)
            shortfalls = _shortfalls(law, assigned, reached, which, names)
            return _Part(
                bindings,
                tuple(replace(x, s=offsets[1] + x.s) for x in shortfalls),
                _extent(law, np.isfinite(assigned)),
                _extent(law, reached),
            )
    return _Part(bindings, ())


def _bindings(
    law: PathLaw,
    share: FloatArray,
    which: IntArray,
    names: list[tuple[str, int | None]],
    offsets: tuple[float, float],
) -> tuple[Binding, ...]:
    """The stretches on which one limit binds, from what binds on every interval, or -1."""
    later, farther = offsets
    edges = np.flatnonzero(np.diff(which)) + 1
    starts, ends = np.append(0, edges), np.append(edges, len(which))
    largest = np.maximum.reduceat(share, starts)
    found = []
    for i, k, most in zip(starts, ends, largest, strict=True):
        limit, joint = ("nothing", None) if which[i] < 0 else names[which[i]]
        t = (later + float(law.breaks[i]), later + float(law.breaks[k]))
        s = (farther + float(law.s[i]), farther + float(law.s[k]))
        found.append(Binding(limit=limit, joint=joint, t=t, s=s, share=float(most)))
    return tuple(found)


def _extent(law: PathLaw, where: BoolArray) -> tuple[float, float]:
    """Length and time of some intervals."""
    return float(np.diff(law.s)[where].sum()), float(np.diff(law.breaks)[where].sum())


def _shortfalls(
    law: PathLaw,
    assigned: FloatArray,
    reached: BoolArray,
    which: IntArray,
    names: list[tuple[str, int | None]],
) -> tuple[Shortfall, ...]:
    """The turning points of the speed on every stretch below the assigned velocity, stops apart."""
    speed = law.speeds.tolist()
    result = []
    reached = reached | ~np.isfinite(assigned)
    edges = np.flatnonzero(np.diff(np.concatenate([[1], reached, [1]]).astype(int)))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        for i, k, kind in _turning_points(speed, int(first), int(last)):
            if speed[i] == 0:
                continue
            # What binds on most of the place and of the intervals next to it.
            near = which[max(i - 2, 0) : k + 2]
            near = near[near >= 0]
            reason = "the way between two limits"
            if len(near):
                limit, joint = names[int(np.bincount(near).argmax())]
                reason = limit if joint is None else f"joint {joint} {limit}"
            middle = (i + k) // 2
            result.append(
                Shortfall(
                    kind=kind,
                    s=float((law.s[i] + law.s[k]) / 2),
                    speed=float(speed[middle]),
                    assigned=float(assigned[min(middle, len(assigned) - 1)]),
                    reason=reason,
                )
            )
    return tuple(result)


def _turning_points(speed: list[float], first: int, last: int) -> list[tuple[int, int, str]]:
    """Where the speed turns by more than a hundredth: first and last point, and which way.

    A turn is known once the speed has left its extreme by `FLAT`; all points within `FLAT` of the
    extreme are its place.
    """
    found: list[tuple[int, int, str]] = []
    rising: bool | None = None
    extreme = first
    for i in range(first + 1, last + 1):
        if rising is None:
            if abs(speed[i] - speed[extreme]) > FLAT * max(speed[i], speed[extreme]):
                rising, extreme = bool(speed[i] > speed[extreme]), i
            continue
        if (speed[i] > speed[extreme]) == rising:
            extreme = i
        elif abs(speed[i] - speed[extreme]) > FLAT * max(speed[i], speed[extreme]):
            near = FLAT * speed[extreme]
            left = right = extreme
            while left > first and abs(speed[left - 1] - speed[extreme]) <= near:
                left -= 1
            while right < i and abs(speed[right + 1] - speed[extreme]) <= near:
                right += 1
            found.append((left, right, "fastest" if rising else "slowest"))
            rising, extreme = not rising, i
    return found
