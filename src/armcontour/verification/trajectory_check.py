"""Independent check of time-stamped joint trajectories against limits and a path."""

# The check shares only geometry and arms with the planners.

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Protocol

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import AngularRate, AtLeast, NotNegative, Quantity, Seed, Tolerance
from armcontour.core.render import Result, moment, number
from armcontour.core.result import VERDICT, Data, Row, Table, with_decimals
from armcontour.core.sampled_data import subdivide
from armcontour.core.text import count_noun, short_repr
from armcontour.core.validity import AT_ENCODERS, OF_LOGS
from armcontour.geometry import Path
from armcontour.motion import Trajectory, arm_of
from armcontour.motion.log import match_joints
from armcontour.motion.log_checks import check_samples
from armcontour.program import Program
from armcontour.robot import Arm, Limits, SerialArm, resolve_limits
from armcontour.robot.arm import unit_of
from armcontour.robot.limit_use import Use
from armcontour.robot.limits import TOOL_LIMITS
from armcontour.robot.limits import UNITS as LIMIT_UNITS
from armcontour.verification.error_profile import follow_path
from armcontour.verification.limit_verdict import (
    CANNOT_TELL,
    KEPT,
    VERDICTS,
    VIOLATED,
    LimitUse,
    LimitUseAccumulator,
    PathDeviation,
    TimeLaw,
    merge_uses,
    record_law,
    shift_use,
)
from armcontour.verification.sample_check import SampledMotion, record_samples
from armcontour.verification.sample_gaps import SampleGap, find_gaps

# Error bound of computed numbers, in units of the last binary digit.
ULPS = 4
# Printed times within this distance of a regular grid, in units of the last printed digit, are on
# the grid.
ON_GRID = 1e-3
UNITS = {"t": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s²"}
# Largest joint velocity that counts as rest at an end [rad/s]; measured velocities have noise.
LARGEST_REST_VELOCITY = 0.01
# Displayed times have a resolution of at most this fraction of the shortest interval, and at most
# so many decimals.
STEPS_SHOWN = 4
MAX_DECIMALS = 9
# Number of tool points between two breaks of a law.
POINTS_PER_INTERVAL = 4


class TimeSamples(Protocol):
    """Samples in time: `t` (n,), `q` (n, dof); optionally `dq`, `ddq` and `resolution`."""

    @property
    def t(self) -> FloatArray:
        """Times [s]."""

    @property
    def q(self) -> FloatArray:
        """Joint positions [rad]."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Check(Result):
    """Result of `check`: the use of every limit, and the verdict.

    Args:
        uses: One entry for every limit that was checked.
        not_judged: Limits that cannot be checked with these samples, and requirements of the path
            for which no limit was specified.
        missing: Those of them that were specified for this check or for the plan.
        reconstruction: Assumption about the motion between samples, as text.
        tolerance: Fraction by which a limit may be exceeded.
        states: Number of checked times.
        start: First time [s].
        end: Last time [s].
        end_speeds: Largest joint velocity at the first and the last time [rad/s]; if only positions
            are known, the smallest one that the acceleration limits allow.
        end_units: Units of the end speeds, of the joints that have these speeds.
        path_deviation: Largest distance from the path; None without a path.
        rounding: Assumed bound on the error of "t", "q", "dq", "ddq" [SI].
        gaps: Intervals in which samples are missing.
        is_log: True if the positions were measured by a robot.
        time_decimals: Decimals of displayed times, with which all samples have different times;
            None for a law.
    """

    uses: tuple[LimitUse, ...]
    not_judged: tuple[str, ...]
    missing: tuple[str, ...]
    reconstruction: str
    tolerance: float
    states: int
    start: float
    end: float
    end_speeds: tuple[float, float]
    end_units: tuple[str, str]
    path_deviation: PathDeviation | None
    rounding: Mapping[str, float]
    gaps: tuple[SampleGap, ...] = ()
    is_log: bool = False
    time_decimals: int | None = None

    __repr__ = short_repr

    def to_data(self) -> Data:
        """Return the verdict, the distance from the path, and the use of every limit."""
        worst = self.worst
        deviation = self.path_deviation
        holds = AT_ENCODERS if self.is_log and self.verdict != CANNOT_TELL else ""
        note = "" if worst is None else f"{worst.name} used by {number(worst.ratio, '1')}"
        if unknown := ", ".join(x for x in self.not_judged if x in LIMIT_UNITS):
            note = "; ".join(filter(None, [f"not judged: {unknown}", note]))
        if self.unknown_gaps:
            missing = f"no samples after t = {self._moment(self.unknown_gaps[0].start)}"
            note = "; ".join(filter(None, [missing, note]))
        distance = [Row("path_deviation", None)]
        if deviation is not None:
            location = f"at t = {self._moment(deviation.t)}, s = {number(deviation.s, 'm')}"
            distance = [
                Row(
                    "path_deviation.distance",
                    deviation.distance,
                    "m",
                    "distance from path",
                    location,
                ),
                Row("path_deviation.t", deviation.t, "s"),
                Row("path_deviation.s", deviation.s, "m"),
            ]
        times = f"from {self._moment(self.start)} to {self._moment(self.end)}"
        limits = [with_decimals(x.to_data().rows, self.time_decimals) for x in self.uses]
        gaps = [(x.start, x.end, x.row, x.line, x.at_rest) for x in self.gaps]
        return Data(
            "Check",
            (
                Row("kept", {KEPT: True, VIOLATED: False}.get(self.verdict)),
                Row("verdict", self.verdict, "", "verdict", note, VERDICT, holds=holds),
                Row("worst", None if worst is None else worst.name),
                *distance,
                Row("states", self.states, "", "times", times),
                *(Row(x, getattr(self, x), "s") for x in ("start", "end")),
                Row("end_speeds", self.end_speeds, ", ".join(dict.fromkeys(self.end_units))),
                *(Row(x, getattr(self, x)) for x in ("tolerance", "rounding")),
                *(Row(x, getattr(self, x)) for x in ("not_judged", "missing", "reconstruction")),
            ),
            (
                Table.from_rows("limits", limits),
                Table(
                    "gaps",
                    (
                        *(Row(x, None, "s") for x in ("start", "end")),
                        *(Row(x, None) for x in ("row", "line", "at_rest")),
                    ),
                    gaps,
                ),
            ),
            notes=tuple(self._notes()),
            not_proven=OF_LOGS if self.is_log else "",
        )

    def _notes(self) -> Iterator[str]:
        """Yield sentences on gaps, undecided verdicts and limits that were not checked."""
        yield from self._gap_notes()
        undecided = [x for x in self.uses if x.verdict == CANNOT_TELL]
        if names := ", ".join(x.name for x in undecided if x.certain > 1):
            yield (
                f"Cannot tell: {names}. The motion exceeds the limit, but this limit of the arm is "
                "only assumed. Specify the manufacturer's limit."
            )
        if names := ", ".join(x.name for x in undecided if x.certain <= 1):
            yield (
                f"Cannot tell: {names}. The printed numbers exceed the limit, but the cause may be "
                "their rounding, or a reversal between two samples. Print more digits, add columns "
                "of velocities and accelerations, or sample more often."
            )
        yield self.reconstruction
        if self.not_judged:
            names = ", ".join(self.not_judged)
            yield f"Not judged, because a limit, masses or samples are missing: {names}."
        ends = zip(("start", "end"), self.end_speeds, self.end_units, strict=True)
        for end, speed, unit in ends:
            if speed > LARGEST_REST_VELOCITY:
                yield (
                    f"The motion does not {end} at rest: at its {end} a joint moves at "
                    f"{number(speed, unit)}, so the robot can execute it only as a part of a "
                    "longer motion."
                )

    def _gap_notes(self) -> Iterator[str]:
        """Yield sentences on the intervals in which samples are missing, with the longest one."""
        for at_rest in (False, True):
            gaps = [x for x in self.gaps if x.at_rest == at_rest]
            if not gaps:
                continue
            longest = max(gaps, key=lambda x: x.end - x.start)
            others = count_noun(len(gaps) - 1, "shorter gap")
            place = (
                f"from t = {self._moment(longest.start)} ({longest.place}) to "
                f"{self._moment(longest.end)}{f', and in {others}' if len(gaps) > 1 else ''}"
            )
            if at_rest:
                yield f"There are no samples {place}. The arm is assumed to rest there."
            else:
                yield (
                    f"Cannot tell: samples are missing {place}, so the motion there is unknown. "
                    "Record the whole motion."
                )

    def _moment(self, t: float) -> str:
        """Write a time [s], with enough digits to find the sample."""
        return moment(t, self.time_decimals)

    @property
    def unknown_gaps(self) -> tuple[SampleGap, ...]:
        """The gaps in which the arm moves."""
        return tuple(x for x in self.gaps if not x.at_rest)

    @property
    def worst(self) -> LimitUse | None:
        """The limit with the largest certain use; None if no limit was checked."""
        return max(self.uses, key=lambda x: x.certain, default=None)

    @property
    def violations(self) -> tuple[LimitUse, ...]:
        """The limits that are certainly exceeded."""
        return tuple(x for x in self.uses if x.verdict == VIOLATED)

    @property
    def violated(self) -> bool:
        """True if any limit is certainly exceeded."""
        return self.verdict == VIOLATED

    @property
    def verdict(self) -> str:
        """The verdict on all limits: "violated", "cannot tell" or "kept".

        "violated" if any limit is violated; otherwise "cannot tell" if any limit has this verdict,
        if a specified limit or all limits could not be checked, or if samples are missing in a part
        of the motion; otherwise "kept". See `LimitUse` for one limit.
        """
        unknown = self.missing or self.unknown_gaps or (not self.uses and self.not_judged)
        verdicts = (*(x.verdict for x in self.uses), CANNOT_TELL if unknown else KEPT)
        return max(verdicts, key=VERDICTS.index)

    def __getitem__(self, name: str) -> LimitUse:
        """Return the use of a limit by its name."""
        for use in self.uses:
            if use.name == name:
                return use
        raise KeyError(name)


@checked
def check(
    samples: TimeSamples | TimeLaw,
    arm: Arm | None = None,
    limits: Limits | None = None,
    path: Path | Program | None = None,
    *,
    deviation: Tolerance | None = None,
    coverage_error: Tolerance | None = None,
    orientation_deviation: Annotated[float, Quantity("rad", sign="positive")] | None = None,
    resolution: Mapping[str, npt.ArrayLike] | None = None,
    tolerance: NotNegative = 1e-9,
    velocity_step: AngularRate = 1e-4,
    points: Annotated[int, AtLeast(0, 10_000)] = 50,
    seed: Seed = 0,
) -> Check:
    """Check a joint trajectory from any source against limits and a path.

    A law, such as a `Trajectory`, is checked on both sides of every break and at random times
    between breaks. If jerk is limited, the accelerations of a law must not jump. For samples, the
    check covers the printed values and, between samples, the smallest peaks that every motion
    through two samples must reach. These are exact if the samples have the lower derivatives:
    velocities for a limit of joint acceleration, and accelerations for a limit of joint jerk. A
    reported violation is real within the rounding; a peak between samples may be higher.

    In a program, tool limits are checked along contours with their leads, and joint limits on every
    move. Samples of a program with several moves are checked against the limits of the joints only.

    "violated" means that every motion through the samples exceeds the limit, for all true numbers
    within their printed digits. "kept" means that the samples, and the smallest peaks between
    neighbours, satisfy the limit; an excess up to 0.1 % is ignored, and up to 1 % if the printed
    digits explain it. Otherwise the
    verdict is "cannot tell", also for a specified limit that these samples do not show, for a
    violated limit that is only assumed for the arm, and for samples that are missing in a part of
    the motion: intervals that are much longer than the usual ones.

    >>> ac.check(planned.sample(0.004), arm, limits, path).verdict
    'kept'

    Args:
        samples: An object with `t`, `q` and perhaps `dq`, `ddq`; or a law, callable as
            `law(t, order, side=...)` with orders up to 2, and 3 for jerk, with `duration` and
            `breaks`.
        arm: The arm; by default that of a `Trajectory`.
        limits: Limits instead of those of the plan, or of the arm if the samples are no plan.
        path: The path that the tool should follow, or the planned program. If you specify the
            objective path, a rounded or shaped motion is compared with the objective path.
        deviation: Permitted distance of the tool from the path [m].
        coverage_error: Permitted distance from any point of the path, such as a corner, to the
            tool's motion [m].
        orientation_deviation: Permitted angle between the tool and the required tool orientation
            nearby [rad]; between the axes if only the axis is required.
        resolution: Unit of the last printed digit of "t", "q", "dq", "ddq", one value or one per
            joint [SI]; by default the resolution of the samples, or 0.
        tolerance: Fraction by which a limit may be exceeded.
        velocity_step: Permitted jump of a joint's velocity at a break of a law [rad/s].
        points: Number of random times per interval of a law.
        seed: Seed of the random times.

    Raises:
        InvalidInput: The samples are not a trajectory of this arm; the message has the row,
            numbered from 1.
    """
    arm = arm_of(samples, arm)
    program = None if path is None else Program.from_path(path)
    checked_paths: list[Path | None] = (
        [None] if program is None else [x.path for x in program.contours]
    )
    for checked_path in checked_paths:
        _check_path(arm, checked_path, deviation, coverage_error, orientation_deviation)
    uses: dict[str, LimitUse] = {}
    not_judged: dict[str, None] = {}
    farthest: PathDeviation | None = None
    # What is known of the whole motion, which is the first part.
    whole: _Judged | None = None
    planned = samples.limits if isinstance(samples, Trajectory) else None
    bounds = resolve_limits("check", arm, limits, planned)
    of_arm = {x for x in LIMIT_UNITS if getattr(bounds, x) is getattr(arm.limits, x)}
    if not _is_law(samples) and program is not None and len(program.moves) > 1:
        if (deviation, coverage_error, orientation_deviation) != (None, None, None):
            raise InvalidInput(
                "Deviations from a path require samples of one contour, but the program has "
                "several moves. Check the plan of the program, or the samples of one contour."
            )
        not_judged |= dict.fromkeys(_not_judged(bounds.of_tool, None, set()))
    for part in _split(samples, arm, program, bounds):
        tally = LimitUseAccumulator(arm, part.limits, part.path, deviation, orientation_deviation)
        motion = part.motion
        if _is_law(motion):
            judged = _judge_law(motion, tally, points, seed, velocity_step)
        else:
            _check_joint_order(motion, arm)
            motion = _check_samples(motion, arm.dof, resolution)
            judged = _judge_log(motion, tally)
        whole = whole or judged
        if coverage_error is not None and part.path is not None:
            record_coverage(motion, tally, coverage_error)
        part_uses = {x.name: shift_use(x, part.t, part.s) for x in tally.uses(tolerance)}
        for name, use in part_uses.items():
            assumed = getattr(arm.assumed_limits, name, None)
            exceeded = use.verdict == VIOLATED and assumed is not None
            if exceeded and getattr(bounds, name) is assumed:
                part_uses[name] = replace(use, verdict=CANNOT_TELL)
        not_judged |= dict.fromkeys(_not_judged(part.limits, part.path, set(part_uses)))
        uses |= {x: merge_uses(uses[x], y) if x in uses else y for x, y in part_uses.items()}
        part_farthest = tally.farthest
        if part.path is not None and (
            farthest is None or part_farthest.distance > farthest.distance
        ):
            farthest = replace(
                part_farthest, t=part.t + part_farthest.t, s=part.s + part_farthest.s
            )
    assert whole is not None
    first_speed, last_speed = whole.end_speeds.max(axis=1).tolist()
    return Check(
        uses=tuple(uses.values()),
        not_judged=tuple(not_judged),
        missing=tuple(x for x in not_judged if x in LIMIT_UNITS and x not in of_arm),
        reconstruction=whole.reconstruction,
        tolerance=tolerance,
        states=whole.states,
        start=whole.start,
        end=whole.end,
        end_speeds=(first_speed, last_speed),
        end_units=_units_of_fastest(arm, whole.end_speeds),
        path_deviation=farthest,
        rounding=whole.rounding,
        gaps=whole.gaps,
        is_log=getattr(samples, "is_log", False),
        time_decimals=whole.time_decimals,
    )


def _is_law(motion: Any) -> bool:
    """Return whether a motion is a `TimeLaw`, not samples."""
    return callable(motion) and hasattr(motion, "breaks")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Part:
    """A part of a motion, with the limits and the path that apply to it."""

    motion: Any  # A law or samples
    limits: Limits
    path: Path | None = None  # Path that the tool should follow, or None
    t: float = 0.0  # Start time of the part, added to its times [s]
    s: float = 0.0  # Length of the previous contours, added to its arc lengths [m]


def _split(samples: Any, arm: Arm, program: Program | None, bounds: Limits) -> list[_Part]:
    """Split a motion: the whole motion with joint limits, and its contours with tool limits."""
    spans = getattr(samples, "spans", ())
    has_moves = program is not None and len(program.moves) > 1
    if not has_moves and (program is not None or all(x.kind == "contour" for x in spans)):
        path = None if program is None else program.path
        return [_Part(motion=samples, limits=bounds, path=path)]
    tool = bounds.of_tool
    parts = [_Part(motion=samples, limits=bounds.of_joints)]
    unlimited = program is None and all(getattr(tool, x) is None for x in TOOL_LIMITS)
    if unlimited or not _is_law(samples):
        return parts
    spans = getattr(samples, "contour_spans", ())
    paths: list[Path | None] = (
        [None] * len(spans) if program is None else [x.path for x in program.contours]
    )
    if len(spans) != len(paths):
        raise InvalidInput(
            f"The trajectory has {len(spans)} contours, but the program has {len(paths)}. "
            "Check the trajectory with the planned program."
        )
    return parts + [
        _Part(motion=x.trajectory, limits=tool, path=path, t=x.t[0], s=x.s[0])
        for x, path in zip(spans, paths, strict=True)
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Judged:
    """What a check of a law or of samples knows besides the uses of the limits, as in `Check`."""

    reconstruction: str
    states: int
    start: float
    end: float
    end_speeds: FloatArray  # Joint speeds at both ends [rad/s], (2, dof)
    rounding: Mapping[str, float] = field(default_factory=dict)
    gaps: tuple[SampleGap, ...] = ()
    time_decimals: int | None = None


def _judge_law(
    law: TimeLaw, tally: LimitUseAccumulator, points: int, seed: int, velocity_step: float
) -> _Judged:
    """Check a law, and record the uses of the limits in the accumulator."""
    count = record_law(law, tally, points=points, seed=seed, velocity_step=velocity_step)
    start = float(law.breaks[0])
    end = float(law.breaks[-1])
    start_velocity = law(np.array([start]), 1)
    end_velocity = law(np.array([end]), 1, side="left")
    return _Judged(
        reconstruction=(
            f"The motion is a continuous law and needs no reconstruction. It was checked at "
            f"{points} random times (seed {seed}) between any two breaks and on both sides of "
            "every break."
        ),
        states=count,
        start=start,
        end=end,
        end_speeds=np.abs([start_velocity[0], end_velocity[0]]),
    )


def _judge_log(log: SampledMotion, tally: LimitUseAccumulator) -> _Judged:
    """Check samples, and record the uses of the limits in the accumulator."""
    record_samples(log, tally)
    rounding = {"t": float(log.t_error.max())}
    for name, error in zip(("q", "dq", "ddq"), log.errors, strict=True):
        if getattr(log, name) is not None:
            rounding[name] = float(error.max())
    return _Judged(
        reconstruction=_reconstruction(log),
        states=len(log.t),
        start=float(log.t[0]),
        end=float(log.t[-1]),
        end_speeds=_end_speeds(log, tally.limits),
        rounding=rounding,
        gaps=() if log.is_plan else find_gaps(log.t, log.q, log.errors[0], log.lines),
        time_decimals=_time_decimals(log.t),
    )


def _time_decimals(t: FloatArray) -> int:
    """Return the decimals with which sample times, and the times between them, differ."""
    step = float(np.diff(t).min()) / STEPS_SHOWN
    # More decimals than a floating-point number has would be wrong.
    finest = float(np.spacing(np.abs(t).max()))
    return int(np.clip(np.ceil(-np.log10(max(step, finest))), 0, MAX_DECIMALS))


def _units_of_fastest(arm: Arm, speeds: FloatArray) -> tuple[str, str]:
    """Return the speed units of the fastest joints at both ends, from speeds, (2, dof)."""
    at_start, at_end = np.argmax(speeds, axis=1).tolist()
    return unit_of(arm, "rad/s", at_start), unit_of(arm, "rad/s", at_end)


def _end_speeds(log: SampledMotion, limits: Limits) -> FloatArray:
    """Return the joint speeds at both ends [rad/s], (2, dof); lower bounds without velocities."""
    if log.dq is not None:
        return np.abs(log.dq[[0, -1]])
    # At the acceleration a, the velocity at an end of an interval h differs from the mean velocity
    # by at most h a / 2.
    span = np.diff(log.t)[[0, -1], None]
    mean = (np.abs(np.diff(log.q, axis=0)[[0, -1]]) - 2 * log.errors[0]) / span
    low, high = limits.acceleration_bounds(log.q.shape[1])
    return np.maximum(mean - span * np.maximum(-low, high) / 2, 0.0)


def _check_path(
    arm: Arm,
    path: Path | None,
    deviation: float | None,
    coverage_error: float | None,
    orientation_deviation: float | None,
) -> None:
    """Check that the path has the dimension of the arm, and that limited deviations have a path."""
    if path is not None and path.dimension != arm.dimension:
        raise ArmMismatch(
            f"The path has {path.dimension} coordinates, but the arm {arm.name} moves its tool in "
            f"{arm.dimension}."
        )
    for name, value in (("deviation", deviation), ("coverage_error", coverage_error)):
        if value is not None and path is None:
            raise InvalidInput(
                f"{name} requires a path. Specify the path that the tool should follow."
            )
    oriented = path is not None and path.orientation is not None and isinstance(arm, SerialArm)
    if orientation_deviation is not None and not oriented:
        raise InvalidInput(
            "orientation_deviation requires a path with a tool orientation, and an arm in space."
        )


def _not_judged(limits: Limits, path: Path | None, judged: set[str]) -> tuple[str, ...]:
    """Name the limits and the path's requirements that were not checked."""
    required = [x for x in LIMIT_UNITS if getattr(limits, x) is not None]
    if path is not None and path.orientation is not None:
        required.append("orientation_deviation")
    has_speeds = path is not None and bool(np.isfinite(path.speeds).any())
    return (
        *(x for x in required if x not in judged),
        *(("segments' own speeds",) if has_speeds else ()),
    )


def _reconstruction(log: SampledMotion) -> str:
    """Write the assumption about the motion between samples, in complete sentences."""
    columns = ", ".join(x for x in ("q", "dq", "ddq") if getattr(log, x) is not None)
    cubic = " The distance from a path is that of the cubics through q and dq."
    return (
        f"The values of the samples ({columns}) are checked. Between samples, the smallest peaks "
        "that every motion through the samples must reach are checked, so peaks between samples "
        f"may be higher.{cubic if log.dq is not None else ''}"
    )


def _check_joint_order(samples: Any, arm: Arm) -> None:
    """Raise InvalidInput if samples with the names of the arm's joints have them in other order."""
    joints = tuple(getattr(samples, "joints", ()))
    order = match_joints(joints, arm.joint_names, getattr(samples, "source", "The trajectory"))
    if order is not None and order != list(range(len(joints))):
        raise ArmMismatch(
            f"The samples have the joints {', '.join(joints)}, but {arm.name} has "
            f"{', '.join(arm.joint_names)}. Read the file with the joint names of the arm, such as "
            "read_trajectory(file, arm.joint_names)."
        )


def _check_samples(
    samples: Any, dof: int, resolution: Mapping[str, npt.ArrayLike] | None
) -> SampledMotion:
    """Check samples, and bound the printing and rounding errors of their numbers."""
    t = getattr(samples, "t", None)
    q = getattr(samples, "q", None)
    if t is None or q is None:
        raise InvalidInput(
            "A trajectory to check must have times t and joint positions q, or be a callable law."
        )
    times = _column("t", t, None)
    columns = {"q": _column("q", q, dof)}
    for name in ("dq", "ddq"):
        if getattr(samples, name, None) is not None:
            columns[name] = _column(name, getattr(samples, name), dof)
    for name, values in columns.items():
        if len(values) != len(times):
            raise InvalidInput(
                f"{name} must have one row per time, but has {len(values)} rows for "
                f"{len(times)} times."
            )
    fewest = 2 if "dq" in columns else 3
    if len(times) < fewest:
        raise InvalidInput(
            f"A trajectory {'with' if fewest == 2 else 'without'} velocities needs at least "
            f"{fewest} samples, but has {len(times)}."
        )
    check_samples(
        times,
        columns,
        lambda name, i, j: f"{name}{f' of joint {j + 1}' * (name != 't')} in row {i + 1}",
    )
    digits: Mapping[str, npt.ArrayLike] = (
        (getattr(samples, "resolution", None) or {}) if resolution is None else resolution
    )
    unknown = set(digits) - set(UNITS)
    if unknown:
        raise InvalidInput(
            f"resolution has an unknown key {sorted(unknown)[0]!r}. The keys are t, q, dq and ddq."
        )
    errors = {name: np.zeros(dof) for name in ("q", "dq", "ddq")}
    for name, values in columns.items():
        printed = checks.per_joint(f"resolution of {name}", digits.get(name, 0.0), dof)
        if (printed < 0).any():
            raise InvalidInput(f"The resolution of {name} must not be negative.")
        errors[name] = printed / 2 + ULPS * np.finfo(np.float64).eps * np.abs(values).max(axis=0)
    t_error, clock = _time_errors(
        times, checks.not_negative("resolution of t", digits.get("t", 0.0))
    )
    return SampledMotion(
        t=times,
        q=columns["q"],
        dq=columns.get("dq"),
        ddq=columns.get("ddq"),
        errors=(errors["q"], errors["dq"], errors["ddq"]),
        t_error=t_error,
        clock=clock,
        is_plan=getattr(samples, "is_plan", False),
        lines=getattr(samples, "lines", None),
    )


def _time_errors(t: FloatArray, resolution: float) -> tuple[FloatArray, float]:
    """Return bounds on the errors of times [s], (n,), and on their common relative error.

    - `resolution`: unit of the last printed digit [s].
    """
    # If all printed times but the last are multiples of one step (regular), the true times are
    # assumed regular. The error of that step moves the last regular time by at most one printed
    # digit.
    step = (t[-2] - t[0]) / (len(t) - 2) if len(t) > 2 else t[-1] - t[0]
    number = np.round((t - t[0]) / step)
    regular = np.abs(t - t[0] - number * step) <= ON_GRID * resolution
    floor = ULPS * np.finfo(np.float64).eps * np.abs(t)
    if not regular[:-1].all():
        return resolution / 2 + floor, 0.0
    stretch = resolution / max(t[-2] - t[0], t[-1] - t[-2])
    return np.where(regular, 0.0, resolution / 2) + floor, float(stretch)


def _column(name: str, values: Any, dof: int | None) -> FloatArray:
    """Copy a column of samples: times, (n,), if `dof` is None, else (n, dof)."""
    shape = (None,) if dof is None else (None, dof)
    return np.array(checks.shaped(name, values, shape, UNITS[name]))


def record_coverage(motion: Any, tally: LimitUseAccumulator, allowed: float) -> None:
    """Record the distances from the path to the tool as uses of the limit `allowed` [m]."""
    # The tool's motion is assumed to be straight between tool points. The error bound is the
    # largest sagitta of a tool point and its neighbours.
    assert tally.path is not None
    if callable(motion):
        t = subdivide(np.asarray(motion.breaks, dtype=np.float64), POINTS_PER_INTERVAL)
        q = np.asarray(motion(t, 0, side="left"))
        error = np.zeros(q.shape[1])
    else:
        t = motion.t
        q = motion.q
        error = motion.errors[0]
    points, error_bound = tally.tool_points(q, error)
    followed = follow_path(tally.path, points)
    middle = (points[2:] + points[:-2]) / 2
    sagitta = np.pad(np.linalg.norm(points[1:-1] - middle, axis=1), 2)
    around = np.maximum.reduce([sagitta[:-2], sagitta[1:-1], sagitta[2:]])
    tally.record(
        Use("coverage_error", followed.coverage_error, allowed, around + error_bound), t, q
    )
    if tally.deviation is not None:
        # Distance from the path point. `record_pose` records the distance from the nearest point,
        # which may be on another part of the path.
        tally.record(Use("path_deviation", followed.distance, tally.deviation, error_bound), t, q)
