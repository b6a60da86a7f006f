"""Search for the cause that keeps an arm from following a path.

Each range of a joint, each axis that is held, the tilt of the positioner and the free rotation
about the tool axis is relaxed alone. What makes the path feasible is a cause, and the smallest such
relaxation is what the path needs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.sampled_data import spread_indices
from armcontour.geometry import Path
from armcontour.planning.tracing.positioner_tilt import angles_to_gravity, chord_of, tilt_of
from armcontour.planning.tracing.smoothing import null_space
from armcontour.planning.tracing.strained_postures import (
    LARGEST_CHANGE,
    MARGIN,
    PATH_ROUNDS,
    REACHED,
    TILT_MARGIN,
    Poses,
    Ranges,
    first_postures,
    improve,
    settle,
    targets_at,
    walk,
)
from armcontour.robot import SerialArm, pose_solver
from armcontour.robot.arm import MET, shift_by_turns
from armcontour.robot.inverse_kinematics import (
    AXIS,
    MAX_SEARCH_STEPS,
    SEARCH_WEIGHT,
    TURNED,
    WHOLE,
)

WHOLE_TURN = 2 * np.pi
# Excess over a range that counts as none [rad or m].
NO_EXCESS = 1e-6
# Size of a change of the tilt relative to that of a range, because a tilt is at most some degrees.
TILT_SIZE = 20.0
# Number of first postures that are followed with all ranges.
FOLLOWED = 12
# Number of their paths, those with the smallest excess, that are improved.
STRAINED = 4
# Number of first postures from which a relaxed range starts, of those that are followed then, and
# of their paths that are improved.
SETTLED_STARTS = 24
RELAXED_STARTS = 5
RELAXED = 2
# Smallest singular value below which a posture is singular.
SINGULAR = 0.01
# The place at which a posture ends is found by dividing an interval into parts, several times.
STOP_PARTS = 16
STOP_ROUNDS = 4
# Distance behind a singularity at which the arm must reach the path, divided by its length.
BEHIND = 1e-3
# Intervals into which that between two poses is divided to find the largest excess.
BETWEEN = 8
# Halvings of a relaxation, to find the smallest that suffices.
HALVINGS = 4
# Number of steps that improve a path after each halving.
HALVED_ROUNDS = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Relaxation:
    """A change of one range, held axis or tilt that makes a path feasible."""

    kind: str  # "range", "hold", "tilt" or "rotation"
    joint: int = -1  # Index of the joint; -1 for the tilt
    together: tuple[int, ...] = ()  # Indices of all joints that must be released
    s: float = 0.0  # Arc length at which the needed value is reached [m]
    s_first: float = 0.0  # Arc length at which the range is left first [m]
    least: float = 0.0  # Smallest position of the joint along the path [rad]
    most: float = 0.0  # Largest position of the joint, or largest angle to gravity [rad]
    lower: float = -np.inf  # Lower end of the joint's range [rad]
    upper: float = np.inf  # Upper end of the joint's range [rad]
    needed: float = 0.0  # Position of the joint, or angle, farthest outside [rad]
    allowed: float = 0.0  # End of the range, position of the axis, or tilt that is exceeded [rad]

    @property
    def travel(self) -> float:
        """Distance between the joint's smallest and largest position on the path [rad]."""
        return self.most - self.least

    @property
    def width(self) -> float:
        """Width of the joint's range [rad]."""
        return self.upper - self.lower

    @property
    def size(self) -> float:
        """Change of the value that the path needs [rad or m]; larger for the tilt."""
        return abs(self.needed - self.allowed) * (TILT_SIZE if self.kind == "tilt" else 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Singularity:
    """A place at which a posture inside of all ranges cannot be continued."""

    s: float  # Arc length [m]
    joint: int  # Index of the joint that moves most in the direction that the tool does not
    value: float  # Smallest singular value, with lengths relative to those of the arm


@dataclass(frozen=True, slots=True, kw_only=True)
class Postures:
    """Joint paths inside of all ranges."""

    s: FloatArray  # Arc lengths of the poses [m], (n,)
    q: FloatArray  # Positions of the joints that are not held [rad], (paths, n, joints)


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """Result of a search for causes."""

    singularity: Singularity | None  # The singularity farthest along the path, if there is one
    relaxations: tuple[Relaxation, ...]  # Those that suffice alone, the cause first
    # Ranges or tilt that are exceeded in the best postures; if no relaxation suffices, the largest
    # excess comes first.
    strained: tuple[Relaxation, ...]
    feasible: Postures | None = None  # Postures that exceed nothing, if any were found


def find_causes(path: Path, arm: SerialArm, task: int) -> Findings:
    """Search for the causes by which an arm cannot follow a path.

    - `arm`: the arm with its held joints.
    - `task`: task dimension, see `task_dimension`.
    """
    held = list(arm.chain.held)
    moving = np.setdiff1d(np.arange(arm.dof), held)
    study = _Study.of(path, arm.without_held(), task)
    if study.is_feasible:
        feasible = Postures(s=study.poses.s, q=study.q[study.fits])
        return Findings(singularity=None, relaxations=(), strained=(), feasible=feasible)
    found = [replace(x, joint=_index(moving, x.joint)) for x in study.relax()]
    strained = [replace(x, joint=_index(moving, x.joint)) for x in study.strained()]
    found.sort(key=lambda x: x.size)
    found = [*_released(path, arm, task), *found]
    if task == WHOLE and not any(x.kind == "hold" for x in found):
        free = _Study.of(path, arm.without_held(), AXIS)
        if free.is_feasible:
            found.append(Relaxation(kind="rotation"))
    singular = study.singularity(path)
    if singular is not None:
        singular = replace(singular, joint=_index(moving, singular.joint))
    return Findings(
        singularity=singular,
        relaxations=tuple(found),
        strained=tuple(strained),
    )


def _index(moving: IntArray, joint: int) -> int:
    """Return the index among all joints, from that among the joints that are not held."""
    return joint if joint < 0 else int(moving[joint])


def _released(path: Path, arm: SerialArm, task: int) -> Iterator[Relaxation]:
    """Yield the held axes whose release makes the path feasible."""
    held = list(arm.chain.held)
    groups = [(k,) for k in held]
    released: set[int] = set()
    for group in [*groups, tuple(held)] if len(held) > 1 else groups:
        if len(group) > 1 and released:
            return
        freed = arm.without_held(group)
        rest = [k for k in range(arm.dof) if k not in held or k in group]
        study = _Study.of(path, freed, task)
        if not study.is_feasible:
            continue
        released.update(group)
        for k in group:
            yield replace(study.hold(rest.index(k), k, arm.chain.held[k]), together=group)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Study:
    """Postures of an arm along a path that exceed its ranges as little as possible."""

    path: Path
    poses: Poses
    starts: FloatArray  # Postures at the first pose, that with the least strain first, (k, dof)
    q: FloatArray  # Joint paths, the one with the smallest excess first [rad], (paths, n, dof)
    touched: FloatArray  # Largest excess over the inner ranges in any joint path, (dof + 1,)
    stopped: tuple[FloatArray, ...]  # Joint paths that end before, (reached, dof) each

    @classmethod
    def of(cls, path: Path, arm: SerialArm, task: int) -> _Study:
        """Follow the postures of an arm along a path."""
        poses = Poses.along(path, arm, task)
        starts = first_postures(poses)
        followed = _spread(poses, Ranges.of(arm, len(starts)), starts, FOLLOWED)
        ranges = Ranges.of(arm, len(followed))
        walked = walk(poses, ranges, followed)
        q = walked.q[walked.complete]
        ranges = ranges.select(walked.complete)
        excess = _excess(poses, ranges, q)
        touched = _touched(poses, ranges, q)
        best = np.argsort(excess.sum(axis=1), kind="stable")[:STRAINED]
        ranges = ranges.select(best)
        q = _eased(poses, ranges, q[best])
        touched = np.maximum(touched, _touched(poses, ranges, q))
        order = np.argsort(_excess(poses, ranges, q).sum(axis=1), kind="stable")
        ends = zip(walked.q[~walked.complete], walked.reached[~walked.complete], strict=True)
        stopped = tuple(x[:reached] for x, reached in ends)
        return cls(
            path=path,
            poses=poses,
            starts=starts,
            q=q[order],
            touched=touched,
            stopped=stopped,
        )

    @property
    def is_feasible(self) -> bool:
        """True if a joint path is inside of all ranges."""
        return bool(self.fits.any())

    @property
    def fits(self) -> BoolArray:
        """Mask of the joint paths that are inside of all ranges, (paths,)."""
        ranges = Ranges.of(self.poses.arm, len(self.q))
        return np.asarray((_excess(self.poses, ranges, self.q) <= NO_EXCESS).all(axis=1))

    def singularity(self, path: Path) -> Singularity | None:
        """Return the farthest singularity at which a posture inside of all ranges ends, or None."""
        arm = self.poses.arm
        farthest = None
        for q in self.stopped:
            shifted = shift_by_turns(arm, q)[0]
            if (np.abs(Ranges.of(arm, 1).excess(shifted[None])) > NO_EXCESS).any():
                continue
            found = self._singularity_after(path, len(q), shifted[-1])
            if found is not None and (farthest is None or found.s > farthest.s):
                farthest = found
        return farthest

    def _singularity_after(self, path: Path, reached: int, q: FloatArray) -> Singularity | None:
        """Return the singularity between two poses, if the posture could go on behind it.

        At an edge of the reach the posture cannot go on, and the range of another posture decides.

        - `reached`: index of the first pose that is not reached.
        - `q`: posture at the pose before it [rad], (dof,).
        """
        arm = self.poses.arm
        task = self.poses.task
        low, high = self.poses.s[reached - 1 : reached + 1]
        for _ in range(STOP_ROUNDS):
            s = np.linspace(low, high, STOP_PARTS + 1)
            part = np.tile(q, (1, len(s), 1))
            arrived = np.empty(1, np.intp)
            pose_solver.follow(arm.link_table, task, targets_at(path, s), part, arrived, REACHED)
            if arrived[0] == len(s):
                return None
            low, high = s[arrived[0] - 1 : arrived[0] + 1]
            q = part[0, arrived[0] - 1]
        value, joint = smallest_singular_value(arm, targets_at(path, np.array([low]))[0], task, q)
        if value > SINGULAR:
            return None
        ahead = targets_at(path, np.array([min(low + BEHIND * path.length, path.length)]))[0]
        behind = q[None].copy()
        errors = pose_solver.approach(
            arm.link_table, task, ahead, behind, SEARCH_WEIGHT, MAX_SEARCH_STEPS
        )
        if (errors > MET).any():
            return None
        return Singularity(s=float(low), joint=joint, value=value)

    def strained(self) -> list[Relaxation]:
        """Return what the best joint path exceeds, the largest excess first."""
        if not len(self.q):
            return []
        excess = _excess(self.poses, Ranges.of(self.poses.arm, 1), self.q[:1])[0]
        outside = np.flatnonzero(excess > NO_EXCESS).tolist()
        found = [self._describe_finely(self.q[0], k) for k in outside]
        return sorted(found, key=lambda x: -x.size)

    def relax(self) -> list[Relaxation]:
        """Return the ranges, and the tilt, that make the path feasible if relaxed alone."""
        if not len(self.starts):
            # No posture reaches the first pose, even beyond the ranges.
            return []
        # If no posture reaches the end, any range may be the cause.
        candidates = self.touched > 0.0 if len(self.q) else np.ones_like(self.touched, np.bool_)
        owner, starts = self._relaxed_starts(np.flatnonzero(candidates).tolist())
        walked = walk(self.poses, self._relaxed(owner), starts)
        owner = owner[walked.complete]
        q = walked.q[walked.complete]
        excess = _excess(self.poses, self._relaxed(owner), q).sum(axis=1)
        rows: list[int] = []
        for k in np.unique(owner):
            own = np.flatnonzero(owner == k)
            rows += own[np.argsort(excess[own], kind="stable")[:RELAXED]].tolist()
        owner = owner[rows]
        ranges = self._relaxed(owner)
        q = _eased(self.poses, ranges, q[rows])
        suffices = (_excess(self.poses, ranges, q) <= NO_EXCESS).all(axis=1)
        best: list[int] = []
        for k in np.unique(owner):
            own = np.flatnonzero(suffices & (owner == k))
            if len(own):
                s = self.poses.s
                sizes = [self._describe(s, q[row], int(k)).size for row in own]
                best.append(int(own[np.argmin(sizes)]))
        joints = [int(owner[row]) for row in best]
        ends = np.array([self._range(k) for k in joints]).reshape(-1, 2)
        tight = self._tighten(q[best], joints, ends[:, 0], ends[:, 1])
        return [self._describe_finely(x, k) for x, k in zip(tight, joints, strict=True)]

    def _relaxed_starts(self, candidates: list[int]) -> tuple[IntArray, FloatArray]:
        """Return the relaxed joint and the posture, (k, dof), of each start to follow."""
        owner: list[int] = []
        starts: list[FloatArray] = []
        some = self.starts[spread_indices(len(self.starts), SETTLED_STARTS)]
        for k in candidates:
            settled = settle(self.poses, self._relaxed(np.full(len(some), k)), some)
            ranges = self._relaxed(np.full(len(settled), k))
            chosen = _spread(self.poses, ranges, settled, RELAXED_STARTS)
            starts += list(chosen)
            owner += [k] * len(chosen)
        return np.array(owner, dtype=np.intp), np.array(starts).reshape(-1, self.poses.arm.dof)

    def _relaxed(self, owner: IntArray) -> Ranges:
        """Return ranges for several joint paths, each without that of its own joint, or tilt."""
        ranges = Ranges.of(self.poses.arm, len(owner))
        for row, k in enumerate(owner):
            ranges.relaxed(row, int(k), -np.inf, np.inf)
        return ranges

    def hold(self, joint: int, index: int, position: float) -> Relaxation:
        """Return how far a released axis must move from the position at which it was held.

        - `joint`: index of the axis among the joints of this arm.
        - `index`: its index in the arm with all joints.
        """
        ends = np.array([position])
        nearest = self._turned_near(self.q[:1], joint, position)
        s, q = self._between(self._tighten(nearest, [joint], ends, ends)[0])
        row = int(np.argmax(np.abs(q[:, joint] - position)))
        away = np.abs(q[:, joint] - position) > NO_EXCESS
        return Relaxation(
            kind="hold",
            joint=index,
            s=float(s[row]),
            s_first=float(s[np.argmax(away)]),
            least=float(q[:, joint].min()),
            most=float(q[:, joint].max()),
            needed=float(q[row, joint]),
            allowed=position,
        )

    def _turned_near(self, q: FloatArray, joint: int, position: float) -> FloatArray:
        """Shift a joint by the whole turns that bring it nearest to a position within its range.

        - `q`: a joint path [rad], (1, n, dof).
        """
        if self.poses.arm.chain.slides[joint]:
            return q
        lower, upper = self._range(joint)
        least, most = self._travel(q[0], joint)
        first = np.ceil((lower - least - NO_EXCESS) / WHOLE_TURN)
        last = np.floor((upper - most + NO_EXCESS) / WHOLE_TURN)
        turned = q.copy()
        if first <= last:
            wanted = np.rint((position - (least + most) / 2) / WHOLE_TURN)
            turned[..., joint] += WHOLE_TURN * np.clip(wanted, first, last)
        return turned

    def _tighten(
        self, q: FloatArray, joints: list[int], low: FloatArray, high: FloatArray
    ) -> FloatArray:
        """Reduce relaxations by halves as far as the joint paths stay feasible.

        - `q`: feasible joint paths [rad], (paths, n, dof), one per relaxed joint.
        - `low`, `high`: ends of the range that is relaxed [rad], (paths,).
        """
        best = q.copy()
        share = np.ones(len(q))
        for step in 0.5 ** np.arange(1, HALVINGS + 1):
            tried = share - step
            ranges = Ranges.of(self.poses.arm, len(q))
            for row, k in enumerate(joints):
                least, most = self._travel(q[row], k)
                lower = low[row] - tried[row] * max(low[row] - least, 0.0)
                upper = high[row] + tried[row] * max(most - high[row], 0.0)
                is_tilt = k == self.poses.arm.dof
                ranges.relaxed(row, k, lower, chord_of(upper) if is_tilt else upper)
            improved = improve(self.poses, ranges, best, HALVED_ROUNDS)
            fits = (_excess(self.poses, ranges, improved) <= NO_EXCESS).all(axis=1)
            best[fits] = improved[fits]
            share[fits] = tried[fits]
        return best

    def _range(self, joint: int) -> tuple[float, float]:
        """Return the range of a joint, or of the angle to gravity after the last joint [rad]."""
        arm = self.poses.arm
        if joint == arm.dof:
            return -np.inf, tilt_of(arm.chain) or np.inf
        lower, upper = arm.limits.joint_range(arm.dof)
        return float(lower[joint]), float(upper[joint])

    def _values(self, q: FloatArray, joint: int) -> FloatArray:
        """Return positions of a joint, or the angles to gravity after the last joint [rad]."""
        if joint == self.poses.arm.dof:
            return angles_to_gravity(self.poses.arm, q)
        return q[:, joint]

    def _travel(self, q: FloatArray, joint: int) -> tuple[float, float]:
        """Return the smallest and the largest of `_values` along a path [rad]."""
        values = self._values(q, joint)
        return float(values.min()), float(values.max())

    def _describe_finely(self, q: FloatArray, joint: int) -> Relaxation:
        """Describe how a joint path, (n, dof), exceeds a range or the tilt, also between poses."""
        return self._describe(*self._between(q), joint)

    def _between(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return arc lengths [m] and joint positions [rad] at the poses and between them."""
        arm = self.poses.arm
        s = self.poses.s
        every = np.arange(len(s))
        index = np.linspace(0.0, len(s) - 1, BETWEEN * (len(s) - 1) + 1)
        finer = np.interp(index, every, s)
        guess = np.column_stack([np.interp(index, every, x) for x in q.T])
        targets = targets_at(self.path, finer)
        w = null_space(arm, targets, self.poses.task, guess)[:, None]
        solved = pose_solver.solve_poses(
            arm.link_table, self.poses.task, positions := guess.copy(), targets, w, guess[:, None]
        )
        near = solved & (np.abs(positions - guess).max(axis=1) < LARGEST_CHANGE)
        return finer, np.where(near[:, None], positions, guess)

    def _describe(self, s: FloatArray, q: FloatArray, joint: int) -> Relaxation:
        """Describe how joint positions, (n, dof), at arc lengths exceed a range or the tilt."""
        values = self._values(q, joint)
        lower, upper = self._range(joint)
        beyond = np.maximum(values - upper, lower - values)
        row = int(np.argmax(beyond))
        is_tilt = joint == self.poses.arm.dof
        return Relaxation(
            kind="tilt" if is_tilt else "range",
            joint=-1 if is_tilt else joint,
            s=float(s[row]),
            s_first=float(s[np.argmax(beyond > 0.0)]),
            least=float(values.min()),
            most=float(values.max()),
            lower=lower,
            upper=upper,
            needed=float(values[row]),
            allowed=upper if values[row] > upper else lower,
        )


def _excess(poses: Poses, ranges: Ranges, q: FloatArray) -> FloatArray:
    """Return the largest excess over each range and, last, over the tilt, (paths, dof + 1)."""
    joints = np.abs(ranges.excess(q)).max(axis=1, initial=0.0)
    if not np.isfinite(ranges.chord).any():
        return np.column_stack([joints, np.zeros(len(q))])
    angles = angles_to_gravity(poses.arm, q.reshape(-1, q.shape[2])).reshape(q.shape[:2])
    tilts = 2 * np.arcsin(np.minimum(ranges.chord / 2, 1.0))
    return np.column_stack([joints, np.maximum(angles.max(axis=1) - tilts, 0.0)])


def _touched(poses: Poses, ranges: Ranges, q: FloatArray) -> FloatArray:
    """Return the largest excess over inner ranges and inner tilt in several paths, (dof + 1,)."""
    inner = replace(
        ranges,
        lower=ranges.lower + MARGIN,
        upper=ranges.upper - MARGIN,
        chord=ranges.chord - TILT_MARGIN,
    )
    return np.asarray(_excess(poses, inner, q).max(axis=0, initial=0.0))


def _spread(poses: Poses, ranges: Ranges, starts: FloatArray, count: int) -> FloatArray:
    """Choose postures at the first pose that exceed nothing, far from each other, then others.

    - `starts`: postures, that with the least strain first [rad], (k, dof).
    """
    first = poses.part(slice(1))
    fits = (_excess(first, ranges, starts[:, None]) <= NO_EXCESS).all(axis=1)
    inside = starts[fits]
    chosen: list[FloatArray] = []
    distance = np.full(len(inside), np.inf)
    while len(chosen) < min(count, len(inside)):
        posture = inside[int(np.argmax(distance))]
        chosen.append(posture)
        distance = np.minimum(distance, np.abs(inside - posture).max(axis=1))
    chosen += list(starts[~fits][: count - len(chosen)])
    return np.array(chosen).reshape(-1, starts.shape[1])


def _eased(poses: Poses, ranges: Ranges, q: FloatArray) -> FloatArray:
    """Reduce the strain of joint paths, (paths, n, dof), but keep those that then exceed more."""
    improved = improve(poses, ranges, q, PATH_ROUNDS)
    before = _excess(poses, ranges, q).sum(axis=1)
    after = _excess(poses, ranges, improved).sum(axis=1)
    return np.where((after <= before)[:, None, None], improved, q)


def smallest_singular_value(
    arm: SerialArm, pose: FloatArray, task: int, q: FloatArray
) -> tuple[float, int]:
    """Return the smallest singular value of a posture, and the joint that moves most there.

    The Jacobian has the rows that the task prescribes, with lengths relative to those of the arm,
    so that the value has no unit.

    - `pose`: tool pose, (3, 4).
    - `q`: joint positions [rad], (dof,).
    """
    jacobian = arm.jacobian(q)
    inner = np.setdiff1d(np.arange(arm.dof), arm.chain.external)
    lengths = np.linalg.norm(np.asarray(arm.chain.positions)[inner[1:]], axis=1).sum()
    moving = jacobian[:3] / (lengths if lengths > 0.0 else 1.0)
    turning = jacobian[3:]
    if task == TURNED:
        revolute = np.flatnonzero(~arm.chain.slides)[0]
        turning = turning[:, revolute][None] @ turning
    elif task != WHOLE:
        turning = pose[:, : task - 3].T @ turning
    _, sizes, motions = np.linalg.svd(np.concatenate([moving, turning]))
    return float(sizes[task - 1]), int(np.argmax(np.abs(motions[task - 1])))
