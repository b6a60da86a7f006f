"""`check_clearance`: smallest distances of a motion, proven for all times."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TypeAlias

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import Collision
from armcontour.core.fields import checked
from armcontour.core.quantities import Tolerance
from armcontour.core.render import Result, number
from armcontour.core.result import TABLE, VERDICT, Data, Row, Table
from armcontour.core.sampled_data import interpolate
from armcontour.core.text import clock, list_some, short_repr
from armcontour.motion import Execution, JointPath, Trajectory, arm_of
from armcontour.motion.derivative_bounds import (
    joint_travel,
    largest_accelerations,
    travel_in_parts,
)
from armcontour.motion.joined_laws import JoinedLaws
from armcontour.motion.laws import PathLaw
from armcontour.robot import Arm
from armcontour.robot.scene import LeftOut, Scene
from armcontour.verification.clearance.body_pairs import (
    UNCERTAINTY,
    Distances,
    Pair,
    mounting_pairs,
    pairs_of,
)

# Distances within this tolerance of the margin count as violations [m].
MARGIN_TOLERANCE = 1e-6
# Search for the first time at which a margin is violated: accuracy of this time, as a travel [m].
VIOLATION_TRAVEL = 1e-5
# Search for the first time at which a margin is violated: number of pieces per window.
PIECES = 16
# Numbers of pieces per window, each with the largest number of windows for which it is used. If
# there are more windows, each is divided into two pieces.
FEW = {8: 25, 4: 100}
# Number of breaks of a motion per batch, to bound the memory.
BREAKS_AT_ONCE = 20_000
# Number of cells in the cache.
CELLS = 4
# A joint path represents any motion along it, with arc length instead of time.
Motion: TypeAlias = Trajectory | Execution | JointPath


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairClearance:
    """Smallest distance of two bodies in a motion.

    Args:
        first, second: Names of the bodies: links, the tool, obstacles.
        kind: "environment" for a link and an obstacle, "own" for two links, "tool" for the tool and
            anything else.
        margin: Smallest allowed distance [m].
        low: Proven lower bound of their distance [m]; negative if they overlap.
        high: Their distance at time t [m].
        t: Time of the distance `high` [s].
        points: Nearest points of both bodies in the work frame [m], (2, 3): at `first_time`, or at
            `t` if no margin is violated.
        first_time: First time at which the margin is violated [s]; None if it is always satisfied.
        q: Joint positions at the time of `points` [rad], (dof,).
    """

    first: str
    second: str
    kind: str
    margin: float
    low: float
    high: float
    t: float
    points: FloatArray
    first_time: float | None = None
    q: FloatArray = field(default_factory=lambda: np.empty(0))

    @property
    def satisfied(self) -> bool:
        """True if the margin is satisfied, proven for all times."""
        return self.low >= self.margin

    def later(self, by: float) -> PairClearance:
        """Return the same result with all times shifted by a time [s]."""
        first_time = None if self.first_time is None else self.first_time + by
        return replace(self, t=self.t + by, first_time=first_time)

    def __str__(self) -> str:
        """Write the pair, its distance and time as a sentence."""
        verb = "touch" if self.high <= 0 else f"come as near as {number(self.high, 'm')}"
        return f"{self.second} and {self.first} {verb}, {self.place}"

    @property
    def bodies(self) -> str:
        """Names of the two bodies as words."""
        names = (self.second, self.first)
        return " and ".join(re.sub("(_link|_inertia)+$", "", x).replace("_", " ") for x in names)

    @property
    def place(self) -> str:
        """Time and place of the smallest distance, or of the first violation, as a phrase."""
        t = self.t if self.first_time is None else self.first_time
        when = f"{'' if self.first_time is None else 'first '}at t = {clock(t)} s"
        x, y, z = self.points[1] * 1e3
        return f"{when} near ({x:.4g}, {y:.4g}, {z:.4g}) mm in the work frame"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Clearance(Result):
    """Distances of an arm from itself and from its cell in a motion.

    Args:
        pairs: The pairs of bodies, sorted by distance above the margin.
        left_out: Pairs whose distance was not checked, with the reasons.
        evaluations: Number of computed distances.
        below: Links that go below the mounting plane of the base, the lowest first.
    """

    pairs: tuple[PairClearance, ...]
    left_out: tuple[LeftOut, ...] = ()
    evaluations: int = 0
    below: tuple[PairClearance, ...] = ()

    @property
    def satisfied(self) -> bool:
        """True if all margins are satisfied, proven for all times."""
        return all(x.satisfied for x in self.pairs)

    @property
    def too_near(self) -> tuple[PairClearance, ...]:
        """Pairs that violate their margins, in order of time."""
        pairs = [x for x in self.pairs if x.first_time is not None]
        return tuple(sorted(pairs, key=lambda x: (x.first_time, x.low)))

    @property
    def least(self) -> PairClearance | None:
        """The pair with the smallest distance; None without pairs."""
        return min(self.pairs, key=lambda x: x.high, default=None)

    @property
    def low(self) -> float | None:
        """Proven lower bound of all distances [m]; None without pairs."""
        return min((x.low for x in self.pairs), default=None)

    @property
    def nearest(self) -> tuple[PairClearance, ...]:
        """For every kind, the pair with the smallest distance; sorted by distance."""
        by_kind: dict[str, PairClearance] = {}
        for pair in sorted(self.pairs, key=lambda x: x.high):
            by_kind.setdefault(pair.kind, pair)
        return tuple(by_kind.values())

    def later(self, by: float) -> Clearance:
        """Return the same result with all times shifted [s].

        Args:
            by: The time [s].
        """
        pairs = tuple(x.later(by) for x in self.pairs)
        below = tuple(x.later(by) for x in self.below)
        return replace(self, pairs=pairs, below=below)

    @property
    def first_time(self) -> float | None:
        """First time at which a margin is violated [s]; None if all are satisfied.

        For a joint path, it is a parameter of the joint path.
        """
        return self.too_near[0].first_time if self.too_near else None

    def refuse(
        self,
        remedy: str = "Move the part, the obstacle or the start posture",
        *,
        s: float | None = None,
    ) -> None:
        """Raise an error if a margin is violated.

        Args:
            remedy: A remedy for the message.
            s: Arc length at `first_time` [m], for the error; None if unknown.

        Raises:
            Collision: A margin is violated; the error has the first time.
        """
        if self.satisfied:
            return
        nearest, *others = self.too_near
        names = list_some([f"{x.second} and {x.first}" for x in others], 5)
        collision = Collision(
            f"{nearest}, but must not come nearer than {number(nearest.margin, 'm')}"
            f"{f' (also {names})' if others else ''}. "
            f"{remedy}, or allow them to touch.",
            t=nearest.first_time,
            s=s,
            point=nearest.points[1].tolist(),
            limit="clearance",
            needed=nearest.margin,
            allowed=nearest.high,
        )
        collision.bodies = (nearest.first, nearest.second)
        collision.clearance = self
        raise collision

    def to_data(self) -> Data:
        """Return the verdict, and the pairs sorted by distance above the margin."""
        below = None if not self.below else -self.below[0].high
        note = "" if self.least is None else self.least.bodies
        if self.too_near:
            note = str(self.too_near[0])
        return Data(
            "Clearance",
            (
                Row("kept", self.satisfied, "", "clearance kept"),
                Row("low", self.low, "m", "clearance", note, VERDICT),
                Row("below_base", self.below_base),
                Row("below", below, "m", "below the base"),
            ),
            (
                Table(
                    "pairs",
                    (
                        Row("first", None, "", "body"),
                        Row("second", None, "", "and"),
                        Row("kind", None),
                        Row("margin", None, "m", "margin"),
                        Row("nowhere_below", None, "m", "clearance"),
                        Row("least", None, "m"),
                        Row("t", None, "s", "at"),
                        Row("first_too_near", None, "s", "too near from"),
                        Row("points", None, "m"),
                    ),
                    [
                        (
                            *(x.first, x.second, x.kind, x.margin, x.low, x.high, x.t),
                            *(x.first_time, x.points),
                        )
                        for x in self.pairs
                    ],
                    TABLE,
                ),
                Table(
                    "left_out_pairs",
                    tuple(Row(x, None) for x in ("first", "second", "reason")),
                    [(x.first, x.second, x.reason) for x in self.left_out],
                ),
            ),
        )

    __repr__ = short_repr

    @property
    def sentence(self) -> str:
        """The verdict with the smallest distance, as a sentence."""
        if not self.satisfied:
            return f"Too near: {self.too_near[0]}."
        if (least := self.least) is None:
            return "Clear: there is no pair of bodies that could touch."
        clear = "Clear of the cell, but below the base" if self.below else "Clear"
        return (
            f"{clear}: nothing comes nearer than {number(self.low, 'm')} at any time; "
            f"{least.bodies} are nearest, {least.place}."
        )

    @property
    def below_base(self) -> str | None:
        """A sentence on links that go below the base; None if there are none."""
        if not self.below:
            return None
        lowest, *others = self.below
        also = f" (also {list_some([x.second for x in others], 5)})" if others else ""
        return (
            f"{lowest.second} goes {number(-lowest.high, 'm')} below the base of the arm, at t = "
            f"{clock(lowest.t)} s{also}. Specify the height of the floor or table as scene.floor, "
            "or none if there is no floor."
        )


@checked
def check_clearance(
    motion: Motion, arm: Arm | None = None, scene: Scene | None = None, *, resolution: float = 1e-3
) -> Clearance:
    """Prove the distances of an arm from itself and from its cell in a motion.

    Distances are also proven between samples. A distance at one time bounds the time in which the
    joints could bring two bodies together (conservative advancement; Mirtich, 1996). Violations are
    reported with their first time.

    >>> ac.check_clearance(planned, arm).satisfied
    True

    Args:
        motion: A planned or an executed motion, or a joint path, with arc length instead of time.
        arm: The arm, with the shapes of its links; by default the arm of the motion.
        scene: Obstacles and margins; by default none, with the default margins.
        resolution: Accuracy of the smallest distance of each kind of pair [m]. For links, and for
            the tool, the nearest plane and the nearest other obstacle have this accuracy, too.

    Raises:
        InvalidInput: The shapes of the arm are unknown, or the scene is invalid.
    """
    cell = Cell(arm_of(motion, arm), Scene() if scene is None else scene)
    return cell.check(motion, resolution=resolution)


class Cell:
    """An arm and its cell, prepared for checks of many motions.

    Args:
        arm: The arm, with the shapes of its links.
        scene: Obstacles and margins.

    Attributes:
        pairs: The checked pairs of bodies.
        left_out: The other pairs, with the reasons.

    Raises:
        InvalidInput: As `check_clearance`.
    """

    @checked
    def __init__(self, arm: Arm, scene: Scene) -> None:
        self.pairs, self.left_out = pairs_of(arm, scene)
        self._mounting = mounting_pairs(arm, scene)
        self._distances = Distances(arm.chain, self.pairs) if self.pairs else None
        self._heights = Distances(arm.chain, self._mounting) if self._mounting else None

    @checked
    def check(self, motion: Motion, *, resolution: Tolerance = 1e-3) -> Clearance:
        """Prove the distances in a motion, as `check_clearance` does.

        Args:
            motion: The motion.
            resolution: As in `check_clearance`.
        """
        below = self.below(motion, resolution)
        if self._distances is None:
            return Clearance(pairs=(), left_out=self.left_out, below=below)
        search = _ClearanceSearch(motion, self.pairs, self._distances, resolution)
        search.run()
        return Clearance(
            pairs=tuple(sorted(search.results(), key=lambda x: x.low - x.margin)),
            left_out=self.left_out,
            evaluations=search.evaluations,
            below=below,
        )

    def below(self, motion: Motion, resolution: float = 1e-3) -> tuple[PairClearance, ...]:
        """Find the links that go below the mounting plane of the base, the lowest first.

        Args:
            motion: The motion.
            resolution: Accuracy of the height of the lowest point [m].
        """
        if self._heights is None or self.stays_above(motion):
            return ()
        search = _ClearanceSearch(motion, self._mounting, self._heights, resolution)
        search.run()
        pairs = (x for x in search.results() if x.high < x.margin)
        return tuple(sorted(pairs, key=lambda x: x.high))

    @checked
    def stays_above(self, motion: Motion) -> bool:
        """Return whether all links stay above the mounting plane of the base, if there is one.

        Args:
            motion: The motion.
        """
        if self._heights is None:
            return True
        return _ClearanceSearch(motion, self._mounting, self._heights, np.inf).run()

    def fits(self, motion: Motion) -> bool:
        """Return whether a motion satisfies all margins and no link goes below the base.

        Args:
            motion: The motion.
        """
        return self.stays_above(motion) and self.keeps(motion)

    def keeps(self, motion: Motion) -> bool:
        """Return whether a motion satisfies all margins; faster than `check`.

        Args:
            motion: The motion.
        """
        return self.first_violation(motion, np.inf) == np.inf

    def first_violation(self, motion: Motion, enough: float = 0.0) -> float:
        """Return the first time at which a margin is violated [s]; infinite if never.

        Args:
            motion: The motion.
            enough: Any violation until this time [s] ends the search.
        """
        if self._distances is None:
            return np.inf
        search = _ClearanceSearch(motion, self.pairs, self._distances, np.inf, enough)
        search.run()
        return search.first_violation


@lru_cache(maxsize=CELLS)
def cell_of(arm: Arm, scene: Scene | None) -> Cell:
    """Return the cell of an arm and a scene, from a cache; without obstacles if scene is None."""
    return Cell(arm, Scene() if scene is None else scene)


class _ClearanceSearch:
    """Search for the smallest distances of pairs, to an accuracy `resolution` per kind [m]."""

    def __init__(
        self,
        motion: Motion,
        pairs: tuple[Pair, ...],
        distances: Distances,
        resolution: float,
        enough: float = np.inf,
    ) -> None:
        self.pairs = pairs
        self.evaluations = 0
        # Time of the first violation that is known [s].
        self.first_violation = np.inf
        # A violation until this time ends the search [s].
        self._enough = enough
        self._distances = distances
        # If the resolution is infinite, only the first violation is determined.
        self._resolution = resolution
        self._motion = motion
        self._radii = np.array([x.radii for x in pairs])
        if distances.slides.any():
            t, travel = self._whole_travel
            q = motion.q if isinstance(motion, Execution) else motion(t)
            # A joint is at most its travel in an interval away from its position at the start.
            farthest = (np.abs(q[:-1]) + np.diff(travel, axis=0)).max(axis=0)
            self._radii = np.array([x.radii_at(farthest, distances.slides) for x in pairs])
        self._margins = np.array([x.margin for x in pairs])
        self._groups = np.unique([x.group for x in pairs], return_inverse=True)[1]
        self._blur = np.zeros(len(pairs))
        if isinstance(motion, Execution):
            # Between samples the joints deviate from straight lines.
            steps = np.diff(motion.t).max() if len(motion.t) > 1 else 0.0
            self._blur = self._radii @ (largest_accelerations(motion) * steps**2 / 8)
        # Laws of the part of the motion whose distances are bounded.
        self._laws: _JoinedPart | None = None
        n = len(pairs)
        # Per pair: lower bound of the distance [m], smallest computed distance [m], and its time
        # [s].
        self._low = np.full(n, np.inf)
        self._high = np.full(n, np.inf)
        self._at = np.zeros(n)

    @cached_property
    def _whole_travel(self) -> tuple[FloatArray, FloatArray]:
        """Times and joint travel of the whole motion, as of `joint_travel`."""
        return joint_travel(self._motion)

    def run(self) -> bool:
        """Subdivide time windows until all are decided; True if all margins are satisfied."""
        for t, travel in travel_in_parts(self._motion, BREAKS_AT_ONCE):
            self._laws = _JoinedPart.of(self._motion, t)
            self._bound_distances(t, travel)
            self._laws = None
            if self._resolution == np.inf and self.first_violation < np.inf:
                return False
        return bool((self._low >= self._margins).all())

    @property
    def _decided(self) -> bool:
        """True if only a violation is to be determined, and an early one is found."""
        violation = self.first_violation
        return self._resolution == np.inf and violation < np.inf and violation <= self._enough

    def results(self) -> list[PairClearance]:
        """Return the results of all pairs."""
        first_times = [self._violation_time(k) for k in range(len(self.pairs))]
        # Points are shown at the first violation, or at the smallest distance if there is none.
        t = self._at.copy()
        for k, first_time in enumerate(first_times):
            if first_time is not None:
                t[k] = first_time
        q = self._positions(t)
        points = self._distances.points(q)
        return [
            PairClearance(
                first=x.first.name,
                second=x.second.name,
                kind=x.kind,
                margin=x.margin,
                low=float(self._low[k]),
                high=float(self._high[k]),
                t=float(self._at[k]),
                points=checks.frozen_array(points[k]),
                first_time=first_times[k],
                q=checks.frozen_array(q[k]),
            )
            for k, x in enumerate(self.pairs)
        ]

    def _bound_distances(self, t: FloatArray, travel: FloatArray) -> None:
        """Bound all pair distances in a part of the motion.

        - `t`: times of the breaks in the part [s], (n,).
        - `travel`: largest travel of each joint since the start of the part [rad], (n, dof).
        """
        pair = np.arange(len(self.pairs))
        begin = np.full(len(pair), t[0])
        end = np.full(len(pair), t[-1])
        travelled = np.zeros(len(pair)), self._radii @ travel[-1]
        begin_distance = self._measure(pair, begin)
        end_distance = self._measure(pair, end) if travel[-1].any() else begin_distance
        distance = begin_distance, end_distance
        while len(pair) and not self._decided:
            width = travelled[1] - travelled[0]
            # The distance changes at most as fast as the travel grows.
            low = (distance[0] + distance[1] - width) / 2
            np.minimum(low, np.minimum(*distance), out=low)
            goes_on = self._undecided(pair, begin, low, width)
            np.minimum.at(self._low, pair[~goes_on], low[~goes_on])
            self._record_violation(end, ~goes_on & (low < self._margins[pair]))
            pair = pair[goes_on]
            begin = begin[goes_on]
            end = end[goes_on]
            travelled = (travelled[0][goes_on], travelled[1][goes_on])
            distance = (distance[0][goes_on], distance[1][goes_on])
            # The time of an iteration with few windows is constant, so each window is divided into
            # more pieces.
            count = next((n for n, windows in FEW.items() if len(pair) <= windows), 2)
            # Edges of the pieces, one row per window.
            fractions = np.arange(count + 1) / count
            edges = begin[:, None] + (end - begin)[:, None] * fractions
            edges[:, -1] = end
            inner = edges[:, 1:-1].ravel()
            inner_pair = np.repeat(pair, count - 1)
            inner_travelled = self._bound_approach(t, travel, inner, inner_pair)
            inner_distance = self._measure(inner_pair, inner)
            travelled = _piece_ends(travelled, inner_travelled.reshape(-1, count - 1))
            distance = _piece_ends(distance, inner_distance.reshape(-1, count - 1))
            pair = np.repeat(pair, count)
            begin = edges[:, :-1].ravel()
            end = edges[:, 1:].ravel()

    def _bound_approach(
        self, t: FloatArray, travel: FloatArray, times: FloatArray, pair: IntArray
    ) -> FloatArray:
        """Bound the approach of pairs from the start of the part to times [m], (m,).

        - `t`, `travel`: breaks of the part [s], (n,), and travel to them [rad], (n, dof).
        - `times`, `pair`: times [s] and indices of pairs, (m,) each.
        """
        i = np.clip(np.searchsorted(t, times, side="right") - 1, 0, len(t) - 2)
        fraction = ((times - t[i]) / (t[i + 1] - t[i]))[:, None]
        travel_then = (1 - fraction) * travel[i] + fraction * travel[i + 1]
        return np.asarray((travel_then * self._radii[pair]).sum(axis=1))

    def _record_violation(self, t: FloatArray, violated: BoolArray) -> None:
        """Record the first of the times at which a margin is violated."""
        self.first_violation = float(np.min(t[violated], initial=self.first_violation))

    def _undecided(
        self, pair: IntArray, begin: FloatArray, low: FloatArray, width: FloatArray
    ) -> BoolArray:
        """Return the mask of the windows that must be subdivided, (m,).

        - `pair`, `begin`: index of the pair and start [s] of each window, (m,) each.
        - `low`: lower bound of the distance in each window [m], (m,).
        - `width`: bound of the approach in each window [m], (m,).
        """
        if self._resolution == np.inf:
            unproven = (low < self._margins[pair]) & (begin < self.first_violation)
            return np.asarray(unproven & (width > MARGIN_TOLERANCE))
        smallest = np.full(self._groups.max() + 1, np.inf)
        np.minimum.at(smallest, self._groups, self._high)
        margin = self._margins[pair]
        # A pair whose margin is not proven at one time is decided.
        provable = self._high[pair] - UNCERTAINTY - self._blur[pair] >= margin
        unproven = (low < margin) & provable
        coarse = low < smallest[self._groups[pair]] - self._resolution
        return np.asarray(
            (unproven & (width > MARGIN_TOLERANCE)) | (coarse & (width > self._resolution))
        )

    def _measure(self, pair: IntArray, t: FloatArray) -> FloatArray:
        """Return lower bounds of pair distances at times [m], (m,); record smallest distances."""
        times, index = np.unique(t, return_inverse=True)
        distances = self._distances.measure(self._positions(times), index, pair)
        self.evaluations += len(pair)
        order = np.argsort(-distances, kind="stable")
        better = order[distances[order] < self._high[pair[order]]]
        # Of several values for a pair, the last one is stored, which is the smallest.
        self._high[pair[better]] = distances[better]
        self._at[pair[better]] = t[better]
        bounds = distances - UNCERTAINTY - self._blur[pair]
        # No smaller windows prove a margin that is not proven at a time.
        self._record_violation(t, bounds < self._margins[pair])
        return np.asarray(bounds)

    def _violation_time(self, k: int) -> float | None:
        """Return the first time at which pair k may violate its margin [s]; None if never."""
        if self._low[k] >= self.pairs[k].margin:
            return None
        return self._first_time(k, float(self._at[k]))

    def _first_time(self, k: int, latest: float) -> float:
        """Return the first time at which a pair may violate its margin [s].

        The pair travels at most VIOLATION_TRAVEL between the exact time and the result.
        """
        times, travel = self._whole_travel
        travelled = travel @ self._radii[k]  # Bound of the approach since the start [m]
        margin = self.pairs[k].margin
        # Windows are ranges of the travel, of which the earliest is searched first.
        windows = [(0.0, float(np.interp(latest, times, travelled)))]
        while windows:
            begin, end = windows.pop()
            edges = np.linspace(begin, end, PIECES + 1)
            t = np.interp(edges, travelled, times)
            distance = self._measure(np.full(len(t), k), t)
            if distance[0] < margin:
                # While the arm rests at the start, all times have the same distance. The first of
                # them counts.
                return float(t[0] if begin > 0 else times[0])
            low = (distance[:-1] + distance[1:] - np.diff(edges)) / 2
            doubtful = np.flatnonzero(np.minimum(low, distance[1:]) < margin).tolist()
            if doubtful and end - begin <= VIOLATION_TRAVEL:
                return float(t[1 + doubtful[0]])
            windows += [(float(edges[x]), float(edges[x + 1])) for x in reversed(doubtful)]
        return latest

    def _positions(self, t: FloatArray) -> FloatArray:
        """Return the joint positions at times [rad], (n, dof)."""
        if self._laws is not None:
            return self._laws.positions(t)
        if isinstance(self._motion, Trajectory):
            return self._motion(np.clip(t, 0.0, self._motion.duration))
        if isinstance(self._motion, JointPath):
            return self._motion(t)
        executed = self._motion
        return interpolate(t, executed.t, executed.q)


@dataclass(frozen=True, slots=True, kw_only=True)
class _JoinedPart:
    """The laws of a part of a trajectory, joined once for all evaluations in this part."""

    # Start times of the laws [s], (laws,).
    starts: FloatArray
    joined: JoinedLaws

    @classmethod
    def of(cls, motion: Motion, t: FloatArray) -> _JoinedPart | None:
        """Join the laws between the first and the last of times [s]; None if they cannot be.

        Only path laws can be joined, and a single law needs no joining.
        """
        if not isinstance(motion, Trajectory):
            return None
        first, last = np.searchsorted(motion.starts, [t[0], t[-1]], side="right") - 1
        chosen = slice(int(first), int(last) + 1)
        laws = [x for x in motion.laws[chosen] if type(x) is PathLaw]
        if len(laws) < max(2, len(motion.laws[chosen])):
            return None
        starts = motion.starts[:-1][chosen]
        return cls(starts=starts, joined=JoinedLaws.join(laws, starts))

    def positions(self, t: FloatArray) -> FloatArray:
        """Return the joint positions at times in the part [rad], (n, dof)."""
        law = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, None)
        return self.joined.motion(law, t, "right", (0,))[0]


def _piece_ends(
    ends: tuple[FloatArray, FloatArray], inner: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the values at the start and at the end of each piece of m windows, (m pieces,) each.

    - `ends`: values at the start and at the end of each window, (m,) each.
    - `inner`: values at the edges between the pieces, (m, pieces - 1).
    """
    edges = np.column_stack([ends[0], inner, ends[1]])
    return edges[:, :-1].ravel(), edges[:, 1:].ravel()
