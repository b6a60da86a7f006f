"""Use of limits by a motion, with the verdict of a check."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Protocol, cast

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.render import Result, number
from armcontour.core.result import Data, Row
from armcontour.geometry import Path
from armcontour.motion import Trajectory
from armcontour.robot import Arm, Limits, SerialArm
from armcontour.robot.arm import unit_of
from armcontour.robot.limit_use import STILL_JOINT, States, Use, use_of
from armcontour.robot.limits import JOINT_LIMITS, JOINT_RANGE, LIMITS
from armcontour.robot.limits import UNITS as LIMIT_UNITS
from armcontour.verification.error_profile import maximize_smooth, smallest_angles

# Smallest number of evaluated times per interval of a law, including its ends.
MIN_PER_INTERVAL = 3
# Largest number of evaluated times per interval of a law, unless FEWEST_TIMES requires more.
MAX_TIMES_PER_INTERVAL = 20
# Smallest number of evaluated times in all intervals of a law together.
FEWEST_TIMES = 4000
# Number of evaluated times in all intervals of a law together that is enough: intervals have no
# more times than it requires, but at least MIN_PER_INTERVAL.
ENOUGH = 12_000
# Number of the highest estimated peaks that are refined.
PEAKS = 12

VERDICTS = KEPT, CANNOT_TELL, VIOLATED = ("kept", "cannot tell", "violated")
# An excess below this fraction of a limit is attributed to rounding, because the printed digits of
# a plan that uses a limit fully may exceed the limit.
UNSEEN = 1e-3
# The rounding of printed digits may explain an excess up to this fraction of a limit. Coarser
# digits leave the verdict open.
COARSE_DIGITS = 1e-2

# Units of the limits by their names.
UNITS = LIMIT_UNITS | {
    **{"path_deviation": "m", "coverage_error": "m", "orientation_deviation": "rad"},
    **{"position_step": "rad", "velocity_step": "rad/s", "acceleration_step": "rad/s²"},
}

# Number of times per batch.
CHUNK = 200_000
# The acceleration may jump at a break by the jerk limit times this time [s]. No controller resolves
# this time, and jumps due to rounding are smaller.
JUMP_TIME = 1e-5
ORDERS = ("positions", "velocities", "accelerations", "jerks")
# Permitted jump of joint positions at a break [rad], which is due to rounding only.
POSITION_STEP = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Occurrence:
    """The use of a limit at one time.

    Args:
        ratio: Value over limit; for joint_lower and joint_upper both relative to the middle of the
            joint range.
        value: Absolute value [unit of the limit].
        limit: The limit at this time [unit of the limit].
        t: Time [s].
        joint: Index of the joint, from 0; None for a limit of the tool.
        s: Arc length of the nearest point on the path [m]; None without a path.
        slack: Part of `ratio` that rounding may have caused.
        certain: Smallest ratio that is possible for the rounded numbers.
        unit: Unit of value and limit.
    """

    ratio: float
    value: float
    limit: float
    t: float
    joint: int | None
    s: float | None
    slack: float
    certain: float
    unit: str

    def rows(self) -> tuple[Row, ...]:
        """Result rows; joints are numbered from 1."""
        joint = None if self.joint is None else self.joint + 1
        unit = self.unit
        return (
            Row("ratio", self.ratio, "1", "share"),
            Row("value", self.value, unit, "value"),
            Row("limit", self.limit, unit, "of"),
            Row("t", self.t, "s", "at"),
            Row("joint", joint, "", "joint"),
            Row("certain", self.certain, "1"),
            Row("slack", self.slack, "1"),
            Row("s", self.s, "m"),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LimitUse(Result, Occurrence):
    """The largest certain use of one limit.

    Args:
        name: The limit: a field of `Limits`, "path_deviation", "orientation_deviation", or a jump
            at a break of a law: "position_step", "velocity_step", "acceleration_step",
            "tool_acceleration_step" or "path_acceleration_step".
        highest: Use with the largest ratio of the printed numbers; rounding may have caused it.
        verdict: "violated": every motion through the samples, within their digits, exceeds the
            limit. "kept": the motion satisfies the limit, but for an excess up to 0.1 %, or up to
            1 % that the digits explain. "cannot tell": neither, or the violated limit is only
            assumed for the arm.
    """

    name: str
    highest: Occurrence
    verdict: str

    def to_data(self) -> Data:
        """Use of the limit, with time and joint."""
        highest = self.highest.rows()
        note = (
            f"as printed {number(self.highest.ratio, '1')}" if self.verdict == CANNOT_TELL else ""
        )
        note = "of an assumed limit" if note and self.certain > 1 else note
        return Data(
            f"Use of {self.name}",
            (
                Row("name", self.name, "", "limit"),
                *self.rows(),
                Row("verdict", self.verdict, "", "verdict", note),
                *(replace(x, label="") for x in Data("", highest).with_prefix("highest")),
            ),
        )


def decide_verdict(certain: float, highest: Occurrence, tolerance: float) -> str:
    """Verdict on a limit, from the largest certain ratio and the use with the largest ratio."""
    if certain > 1 + tolerance:
        return VIOLATED
    rounding = max(UNSEEN, min(highest.slack, COARSE_DIGITS))
    return KEPT if highest.ratio <= 1 + tolerance + rounding else CANNOT_TELL


def shift_use(use: LimitUse, t: float, s: float) -> LimitUse:
    """Shift the times [s] and arc lengths [m] of a use."""

    def shifted(occurrence: Occurrence) -> dict[str, Any]:
        """Return the shifted fields of an occurrence."""
        return {"t": t + occurrence.t, "s": None if occurrence.s is None else s + occurrence.s}

    highest = replace(use.highest, **shifted(use.highest))
    return replace(use, highest=highest, **shifted(use))


def merge_uses(first: LimitUse, second: LimitUse) -> LimitUse:
    """Merge the uses of one limit by two motions."""
    use = max(first, second, key=lambda x: x.certain)
    return replace(
        use,
        highest=max(first.highest, second.highest, key=lambda x: x.ratio),
        verdict=max(first.verdict, second.verdict, key=VERDICTS.index),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class PathDeviation:
    """Largest distance of the tool from the path [m], its time [s] and arc length [m]."""

    distance: float
    t: float
    s: float


class LimitUseAccumulator:
    """Accumulates the largest use of every limit; `limits` must have one value per joint."""

    # deviation: permitted distance from the path [m]; orientation_deviation: permitted angle from
    # the required tool orientation [rad].

    def __init__(
        self,
        arm: Arm,
        limits: Limits,
        path: Path | None,
        deviation: float | None,
        orientation_deviation: float | None = None,
    ):
        self.arm = arm
        self.limits = limits
        self.path = path
        self.deviation = deviation
        self.orientation_deviation = orientation_deviation
        self.farthest = PathDeviation(distance=0.0, t=0.0, s=0.0)
        # False while lower bounds are recorded that rounding can make too large; they set the
        # highest ratio only if no other value does.
        self.updates_highest = True
        self._certain: dict[str, tuple[Occurrence, FloatArray]] = {}
        self._highest: dict[str, tuple[Occurrence, FloatArray]] = {}

    def record(self, use: Use, t: FloatArray, q: FloatArray) -> None:
        """Record a use at times and joint positions.

        - `t`, `q`: times [s], (n,), and joint positions [rad], (n, dof), of the values of `use`.
        """
        name = use.name
        value = use.value
        if not value.size:
            return
        ratio, certain, slack = use.ratios()
        allowed, slack = (np.broadcast_to(x, value.shape) for x in (use.limit, slack))

        def occurrence(i: int) -> tuple[Occurrence, FloatArray]:
            """Return the occurrence of value i and its joint positions [rad], (dof,)."""
            index = np.unravel_index(i, value.shape)
            joint = int(index[1]) if value.ndim == 2 else None
            unit = UNITS.get(name, "")
            result = Occurrence(
                ratio=float(ratio[index]),
                value=float(value[index]),
                limit=float(allowed[index]),
                t=float(t[index[0]]),
                joint=joint,
                unit=unit if joint is None else unit_of(self.arm, unit, joint),
                s=None,
                slack=float(slack[index]),
                certain=float(certain[index]),
            )
            return result, q[index[0]]

        i = int(np.argmax(certain))
        if name not in self._certain or certain.flat[i] > self._certain[name][0].certain:
            self._certain[name] = occurrence(i)
        i = int(np.argmax(ratio))
        current = self._highest.get(name)
        if current is None or (self.updates_highest and ratio.flat[i] > current[0].ratio):
            self._highest[name] = occurrence(i)

    def record_rates(
        self, name: str, t: FloatArray, rates: FloatArray, q: FloatArray, error: npt.ArrayLike = 0.0
    ) -> None:
        """Record rates as a use of their limit, if there is one."""
        if getattr(self.limits, name) is not None:
            self.record(use_of(name, self.limits, rates, error), t, q)

    def record_states(self, t: FloatArray, states: States) -> None:
        """Record all quantities of joints and tool for some states."""
        for use in states.uses(self.limits):
            self.record(use, t, states.q)

    def tool_points(self, q: FloatArray, error: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return tool points [m], (n, dimension), and bounds of their errors [m], (n,).

        - `q`, `error`: joint positions and bounds of their errors [rad], (n, dof) each.
        """
        return States(self.arm, (q,), (error,)).bounded(self.arm.tool_position, 0)

    def record_pose(self, t: FloatArray, q: FloatArray, error: FloatArray) -> None:
        """Record the distance of the tool from the path and from the required tool orientation."""
        if self.path is None:
            return
        points, error_bound = self.tool_points(q, error)
        nearest = self.path.project(points)
        worst = int(np.argmax(nearest.distance))
        if nearest.distance[worst] >= self.farthest.distance:
            self.farthest = PathDeviation(
                distance=float(nearest.distance[worst]),
                t=float(t[worst]),
                s=float(nearest.s[worst]),
            )
        if self.deviation is not None:
            self.record(Use("path_deviation", nearest.distance, self.deviation, error_bound), t, q)
        allowed = self.orientation_deviation
        orientation = self.path.orientation
        if allowed is None or orientation is None or not isinstance(self.arm, SerialArm):
            return
        reach = self.farthest.distance if self.deviation is None else self.deviation
        angle = smallest_angles(self.path, points, nearest, self.arm.pose(q)[1], reach)
        # An error of a joint position turns the tool by at most the same angle. An error of the
        # tool point moves the nearest point to another required orientation.
        rate = np.linalg.norm(orientation.rates(nearest.s)[0], axis=1)
        slack = float(error.sum()) + rate * error_bound
        self.record(Use("orientation_deviation", angle, allowed, slack), t, q)

    def uses(self, tolerance: float) -> tuple[LimitUse, ...]:
        """Return the largest uses of all limits, with arc lengths on the path and verdicts.

        - `tolerance`: as of `decide_verdict`.
        """
        entries = [*self._certain.values(), *self._highest.values()]
        uses = [x for x, _ in entries]
        if self.path is not None and entries:
            s = self.path.project(self.arm.tool_position(np.array([q for _, q in entries]))).s
            uses = [replace(x, s=float(y)) for x, y in zip(uses, s, strict=True)]
        certain = uses[: len(self._certain)]
        highest = uses[len(self._certain) :]
        judged = []
        for name, use, largest in zip(self._certain, certain, highest, strict=True):
            verdict = decide_verdict(use.certain, largest, tolerance)
            occurrence = {x.name: getattr(use, x.name) for x in fields(use)}
            judged.append(LimitUse(name=name, highest=largest, verdict=verdict, **occurrence))
        return tuple(judged)


class TimeLaw(Protocol):
    """Time law of joint positions, such as a `Trajectory`."""

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""

    @property
    def breaks(self) -> FloatArray:
        """Times between which the law is smooth, including start and end [s]."""

    def __call__(self, t: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Return q or its derivative of an order up to 3, in rad and s, (n, dof)."""
        # Jerk is not checked if the law raises an error for order 3.


def record_law(
    law: TimeLaw, tally: LimitUseAccumulator, *, points: int, seed: int, velocity_step: float
) -> int:
    """Record a law at breaks and `points` random times per interval; return the number of times.

    `velocity_step` is the permitted jump of a joint's velocity at a break [rad/s].
    """
    breaks = np.asarray(law.breaks, dtype=np.float64)
    if breaks.ndim != 1 or len(breaks) < 2 or not (np.diff(breaks) > 0).all():
        raise InvalidInput("The breaks of a law must be at least two increasing times.")
    random = np.random.default_rng(seed)
    jerk = has_checkable_jerk(law, tally.limits, breaks[:1])
    size = max(1, CHUNK // (points + 2))
    count = 0
    for first in range(0, len(breaks) - 1, size):
        ends = breaks[first : first + size + 1]
        inner = ends[:-1, None] + random.random((len(ends) - 1, points)) * np.diff(ends)[:, None]
        right_times = np.concatenate([ends[:-1], inner.ravel()])
        left_times = ends[1:]
        t, q, uses = uses_of_law(law, tally.arm, tally.limits, right_times, left_times, jerk)
        count += len(t)
        for use in uses:
            tally.record(use, t, q)
        tally.record_pose(t, q, np.zeros(tally.arm.dof))
        if jerk:
            times = ends if first == 0 else left_times
            _record_acceleration_steps(law, times, tally, (breaks[0], breaks[-1]))
        is_last = first + size >= len(breaks) - 1
        _record_steps(law, ends[1:-1] if is_last else ends[1:], tally, velocity_step)
    return count


def uses_of_law(
    law: TimeLaw,
    arm: Arm,
    limits: Limits,
    right_times: FloatArray,
    left_times: FloatArray,
    jerk: bool,
) -> tuple[FloatArray, FloatArray, list[Use]]:
    """Return times (n + m,), q at them [rad], (n + m, dof), and the use of limits by a law.

    At a break, the law has the value after the break for right_times [s], (n,), and the value
    before it for left_times [s], (m,). The third derivative is evaluated only if joint jerk is
    checked.
    """
    order = 3 if jerk else 2
    t = np.concatenate([right_times, left_times])
    if isinstance(law, Trajectory):
        # `motion` evaluates all derivatives at once.
        after = law.motion(right_times, order)
        before = law.motion(left_times, order, side="left")
    else:
        after = tuple(law(right_times, k, side="right") for k in range(order + 1))
        before = tuple(law(left_times, k, side="left") for k in range(order + 1))
    columns = []
    for name, *sides in zip(ORDERS[: order + 1], after, before, strict=True):
        values = np.concatenate(sides)
        if values.shape != (len(t), arm.dof):
            raise ArmMismatch(
                f"The trajectory has {values.shape[-1]} joints, but the arm has {arm.dof}. "
                "Specify the arm for which it was planned."
            )
        if not np.isfinite(values).all():
            time = float(t[~np.isfinite(values).all(axis=1)][0])
            raise InvalidInput(
                f"The trajectory's {name} are not finite at t = {time:.9g} s.", t=time
            )
        columns.append(values)
    return t, columns[0], list(States(arm, columns).uses(limits))


def _record_steps(
    law: TimeLaw, t: FloatArray, tally: LimitUseAccumulator, velocity_step: float
) -> None:
    """Record the jumps of positions and velocities at breaks."""
    if not len(t):
        return
    q = law(t)
    jump = np.abs(q - law(t, side="left"))
    tally.record(Use("position_step", jump, POSITION_STEP), t, q)
    # These limits of joints apply to derivatives of velocities.
    derived = (name for name in JOINT_LIMITS if LIMITS[name].order > 1)
    if any(getattr(tally.limits, name) is not None for name in derived):
        jump = np.abs(law(t, 1) - law(t, 1, side="left"))
        tally.record(Use("velocity_step", jump, velocity_step), t, q)


def _record_acceleration_steps(
    law: TimeLaw, t: FloatArray, tally: LimitUseAccumulator, ends: tuple[float, float]
) -> None:
    """Record the jumps of accelerations at breaks, which the jerk on both sides does not show."""
    # Before a motion that starts at rest, and after one that ends at rest, accelerations are zero.
    resting = np.abs(law(t, 1)).max(axis=1) <= STILL_JOINT
    before, after = (np.array(law(t, 2, side=side)) for side in ("left", "right"))
    before[resting & (t == ends[0])] = 0.0
    after[resting & (t == ends[1])] = 0.0
    allowed = JUMP_TIME * cast("FloatArray", tally.limits.joint_jerk)
    tally.record(Use("acceleration_step", np.abs(after - before), allowed), t, law(t))


def has_checkable_jerk(law: TimeLaw, limits: Limits, start: FloatArray) -> bool:
    """Return whether joint jerk is limited and known for a law that begins at `start` [s], (1,)."""
    if limits.joint_jerk is None:
        return False
    try:
        law(start, 3)
    except (InvalidInput, ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        return False
    return True


def measure_limit_ratios(trajectory: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Return the largest ratio of each specified limit that can be evaluated, by its name."""
    breaks = trajectory.smooth_breaks
    intervals = np.stack([breaks[:-1], breaks[1:]])
    if all(x.kind == "contour" for x in trajectory.spans):
        return _largest_ratios(trajectory, arm, limits, intervals)
    # Limits of the tool apply along contours, limits of the joints in every move.
    span = np.searchsorted([x.t[1] for x in trajectory.spans], intervals.mean(axis=0))
    on_contour = np.array([x.kind == "contour" for x in trajectory.spans])[span]
    ratios = _largest_ratios(trajectory, arm, limits, intervals[:, on_contour])
    elsewhere = _largest_ratios(trajectory, arm, limits.of_joints, intervals[:, ~on_contour])
    for name, ratio in elsewhere.items():
        ratios[name] = max(ratios.get(name, ratio), ratio)
    return ratios


def _largest_ratios(
    motion: Trajectory, arm: Arm, limits: Limits, intervals: FloatArray
) -> dict[str, float]:
    """Return the largest ratio of each limit in some intervals of a motion, by name of the limit.

    - `intervals`: start and end times between which the motion is smooth [s], (2, n).
    """
    begins, ends = intervals
    if not len(begins):
        return {}
    jerk = has_checkable_jerk(motion, limits, motion.starts[:1])
    # Number of times per interval with which the motion has FEWEST_TIMES and ENOUGH times.
    few, enough = (-(-x // len(begins)) for x in (FEWEST_TIMES, ENOUGH))
    count = max(MIN_PER_INTERVAL, few, min(MAX_TIMES_PER_INTERVAL, enough))
    fractions = np.linspace(0.0, 1.0, count)[:, None]
    size = max(1, CHUNK // count)
    best: dict[str, float] = {}
    for first in range(0, len(begins), size):
        part = slice(first, first + size)
        t = begins[part] + fractions * (ends[part] - begins[part])
        t[-1] = ends[part]
        for use in uses_of_law(motion, arm, limits, t[:-1].ravel(), t[-1], jerk)[-1]:
            name = use.name
            largest = max(best.get(name, -np.inf), float(use.largest.max()))
            # Both ends of a joint range determine its middle.
            names = JOINT_RANGE if name in JOINT_RANGE else (name,)
            only = Limits.only(**{x: getattr(limits, x) for x in names})
            peaks = _peaks(motion, arm, use, only, t, largest)
            best[name] = max([largest, *peaks.tolist()])
    return best


def _peaks(
    motion: Trajectory, arm: Arm, use: Use, only: Limits, t: FloatArray, threshold: float
) -> FloatArray:
    """Return the ratios at the highest peaks between times, (m,), m at most PEAKS.

    Peaks count if the parabolas through three successive ratios exceed `threshold` there.

    - `use`: use of the limit at these times.
    - `only`: this limit alone.
    - `t`: times of all intervals [s], (times, intervals).
    """
    from armcontour.verification.ratio_peaks import find_peaks

    name = use.name
    values = (use.value if use.is_linear else use.ratio).reshape(*t.shape, -1)
    zero = np.zeros(values.shape[2])
    room = np.ones(values.shape[2])
    if use.is_linear:
        zero += 0.0 if use.zero is None else use.zero
        room = use.limit - zero
    places, heights = find_peaks(values, zero, room, threshold)
    highest = np.argsort(-heights, kind="stable")[:PEAKS]
    i, k, column = places[highest].T
    if not len(i):
        return np.zeros(0)

    def measure(t: FloatArray) -> FloatArray:
        *_, uses = uses_of_law(motion, arm, only, t.ravel(), t[0, :0], only.limits_jerk)
        values = next(x.ratio for x in uses if x.name == name).reshape(*t.shape, -1)
        return np.take_along_axis(values, column[:, None, None], axis=2)[..., 0]

    return maximize_smooth(t[i - 1, k], t[i + 1, k], measure)
