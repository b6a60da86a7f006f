"""Robustness: the contour error of given taught data under what is not known exactly."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from armcontour import _checks, _memory
from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm, Limits, PlanarTwoLink, SerialArm
from armcontour.arms._tool_point import Robot
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.geometry import Path, angle_between
from armcontour.geometry.nearest import pack, pad
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.motion import TaughtData
from armcontour.robustness._monte_carlo import (
    SETTLED,
    STUCK,
    Clock,
    Drive,
    Found,
    Line,
    Rest,
    Samples,
    run,
)
from armcontour.servo import ServoModel
from armcontour.servo.command import polynomials

# Contour errors are looked at this often at least: every 2 ms [s], and twice in the shortest time
# constant of a servo. The RMS of the paper's job is then within 1e-4 of that at 0.1 ms.
RESOLUTION = 2e-3
TIME_CONSTANTS = 0.5
# Most results in a command interval: no servo is so fast.
MOST_RESULTS = 1e5
# More corners than this are not all executed: 10 parameters have so many.
MOST_CORNERS = 1024
# The tool is not further behind its plan than so many lags of its servo, nor further ahead.
LAGS_BEHIND = 2.0
LAGS_AHEAD = 1.0
# Times at which the plan is looked at per command interval, and in all at least.
PLACES_PER_INTERVAL = 2
FEWEST_PLACES = 4000
# As in `ServoPlant`: time to come to rest after the last set-point [s], or in durations.
PATIENCE = 60.0
PATIENCE_IN_DURATIONS = 10.0
# What an error of one sample's model takes [bytes], measured.
SAMPLE = 40.0
# Samples that a thread takes at a time.
BATCH = 32
# Largest errors that differ by this share are the same: they are sampled no finer.
SAME = 1e-4
# A share of the variance is estimated over this many equal parts of the samples.
PARTS = 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box:
    """How far the real robot may be from its model; every error is uniform in plus and minus.

    Args:
        gains: Relative error of servo gains, as 0.1 for 10 %: one number; one per joint, for kp and
            kv alike; or two rows, (2, dof) or (2, 1), of kp and of kv. Joints and loops err
            independently of each other.
        dead_time: Error of the dead time [s], one number or one per joint.
        dead_time_shared: Whether all joints' dead times err together, by the same share of
            `dead_time`; else each by itself.
        payload: Error of the mass at the tool [kg], as a point; not above the payload that the arm
            carries.
        jitter: Error of the time at which a set-point arrives [s], less than half a command
            interval; every set-point but the first for itself, for all joints alike.

    Raises:
        InvalidInput: An error that is negative, or a gain's that is not below 1.
    """

    gains: FloatArray | float = 0.0
    dead_time: FloatArray | float = 0.0
    dead_time_shared: bool = True
    payload: float = 0.0
    jitter: float = 0.0

    def __post_init__(self) -> None:
        gains = _checks.lock_floats(_checks.numbers("gains of a box", self.gains))
        if gains.ndim > 2 or gains.size == 0 or (gains < 0).any() or (gains >= 1).any():
            raise InvalidInput(
                "gains of a box must be relative errors from 0 to below 1, as 0.1 for 10 %, but "
                f"are {gains.tolist()}."
            )
        late = _checks.lock_floats(_checks.numbers("dead_time of a box", self.dead_time, "s"))
        if late.ndim > 1 or late.size == 0 or (late < 0).any():
            raise InvalidInput(
                "dead_time of a box must not be negative, one for all joints or one per joint, but "
                f"is {late.tolist()} s."
            )
        object.__setattr__(self, "gains", gains)
        object.__setattr__(self, "dead_time", late)
        for name, unit in (("payload", "kg"), ("jitter", "s")):
            value = _checks.not_negative(f"{name} of a box", getattr(self, name), unit)
            object.__setattr__(self, name, value)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spread:
    """Contour errors of many executions of the same taught data.

    Args:
        max: Largest contour error of each [m], (n,).
        rms: Its root mean square over time [m], (n,).
        until: End of the time that errors cover [s], (n,).
        saturated: Share of that time in which the joint that saturates longest does, (n,).
        demand_ratio: Largest demand of a joint, either way, over its acceleration limit (the lower
            of the two, where deceleration has its own), (n,).
        kp, kv: Gains [1/s], (n, dof); kv is None for a servo of first order.
        dead_time: [s], (n, dof).
        payload: Error of the mass at the tool [kg], (n,).
        seed: Of the samples; None for corners of the box.
        names: Of the parameters that vary, jitter apart.
        deviations: Their errors: relative, in s or in kg, (n, len(names)).
        nominal_max, nominal_rms: The same contour errors without any error of the model [m].
    """

    max: FloatArray
    rms: FloatArray
    until: FloatArray
    saturated: FloatArray
    demand_ratio: FloatArray
    kp: FloatArray
    kv: FloatArray | None
    dead_time: FloatArray
    payload: FloatArray
    seed: int | None
    names: tuple[str, ...]
    deviations: FloatArray
    nominal_max: float
    nominal_rms: float

    def __post_init__(self) -> None:
        for name in ("max", "rms", "until", "saturated", "demand_ratio", "kp", "dead_time"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        for name in ("payload", "deviations"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        if self.kv is not None:
            object.__setattr__(self, "kv", _checks.lock_floats(self.kv))

    def __len__(self) -> int:
        """Number of executions."""
        return len(self.max)

    @property
    def worst(self) -> int:
        """Index of the execution with the largest contour error."""
        return int(np.argmax(self.max))

    @property
    def worst_deviations(self) -> dict[str, float]:
        """Errors of the model in the worst execution, by the parameters' names."""
        return dict(zip(self.names, self.deviations[self.worst].tolist(), strict=True))

    def servo(self, i: int, like: ServoModel) -> ServoModel:
        """The servo of execution i, without its payload and jitter.

        Args:
            i: Number of the execution.
            like: Where interpolation and order come from.
        """
        return ServoModel(
            kp=self.kp[i],
            kv=None if self.kv is None else self.kv[i],
            interpolation=like.interpolation,
            dead_time=self.dead_time[i],
            order=like.order,
        )

    def quantile(self, share: float) -> float:
        """Largest contour error that so large a share of the executions keeps [m]."""
        return float(np.quantile(self.max, share, method="higher"))

    def within(self, budget: float) -> float:
        """Share of the executions whose largest contour error is not above `budget` [m]."""
        return float(np.mean(self.max <= budget))

    def influence(self) -> dict[str, float]:
        """Share of the largest errors' variance that each parameter explains by itself.

        The first-order index of Sobol, from the means over ten equal parts of the samples; below
        about 10 / n nothing is said. 0 for all where the largest errors are the same.
        """
        total = float(np.var(self.max))
        if np.sqrt(total) <= SAME * float(self.max.mean()):
            return dict.fromkeys(self.names, 0.0)
        found = {}
        for name, values in zip(self.names, self.deviations.T, strict=True):
            parts = np.array_split(self.max[np.argsort(values, kind="stable")], PARTS)
            held = [x for x in parts if len(x)]
            between = np.average(
                [(x.mean() - self.max.mean()) ** 2 for x in held], weights=[len(x) for x in held]
            )
            found[name] = float(between / total)
        return found


def spread(
    taught: TaughtData,
    path: Path,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None,
    box: Box,
    *,
    samples: int = 1000,
    seed: int = 0,
    since: float | None = None,
    until: float | None = None,
    threads: int | None = None,
    memory: float = _memory.DEFAULT,
) -> Spread:
    """Execute taught data on robots drawn from a box, each as `ServoPlant` would.

    Sample i is the same for every number of samples, and does not depend on which parameters vary.

    Args:
        taught: The set-points.
        path: The path that the tool was to follow.
        arm: A planar two-link arm or a serial arm; with masses if the payload varies.
        servo: The nominal servo, in the middle of the box.
        limits: Whose joint accelerations saturate; the arm's own by default.
        box: How far the robot may be from that.
        samples: Number of executions.
        seed: Of the random numbers.
        since: Start of the time that errors cover [s]; by default the first set-point. Taught data
            of one contour of a program may start before it, with what leads to it.
        until: End of that time [s]; by default when the planned motion has ended and the tool is at
            rest.
        threads: Number of threads; by default as many as there are processors.
        memory: What the program may take [bytes].

    Raises:
        InvalidInput: A box, servo, path or taught data that do not fit the arm, or more samples
            than the memory takes.
        ExecutionError: A joint does not come to rest.
    """
    number = _checks.whole("samples", samples, 1, 10**7)
    _memory.refuse_above(
        memory,
        number * (3 * arm.dof + 1) * SAMPLE,
        f"The spread over {number} samples",
        "take fewer samples",
    )
    started = _checks.whole("seed", seed, 0, 2**63 - 1)
    model = _Model(taught, path, arm, servo, limits, box, since, until)
    unit = np.random.default_rng(started).uniform(-1, 1, size=(number, 3 * arm.dof + 1))
    return model.executed(unit, started, _threads(threads))


def worst_corner(
    taught: TaughtData,
    path: Path,
    arm: Arm,
    servo: ServoModel,
    limits: Limits | None,
    box: Box,
    *,
    since: float | None = None,
    until: float | None = None,
    threads: int | None = None,
) -> Spread:
    """Execute taught data in the corners of a box, without jitter.

    All 2^k of them if k <= 10 parameters vary. Of more: those that the largest errors of single
    parameters, at either end of their ranges, point to; from the worst of these one sign changed
    after the other while that makes it worse; and random ones, 1024 in all.

    Args and errors are those of `spread`.
    """
    model = _Model(taught, path, arm, servo, limits, box, since, until)
    use = _threads(threads)
    k = int(model.varies.sum())
    if 2**k <= MOST_CORNERS:
        signs = np.where(np.arange(2**k)[:, None] >> np.arange(k) & 1, -1.0, 1.0)
        return model.executed(model.span(signs), None, use)

    def errors(signs: FloatArray) -> FloatArray:
        return model.executed(model.span(signs), None, use).max

    return model.executed(model.span(_search_corners(errors, k)), None, use)


def jitter_of(seed: int, sample: int, count: int, jitter: float) -> FloatArray:
    """By how much each set-point comes late in one sample [s], (count,); the first one is on time.

    The set-points' times count from when the first one arrives.
    """
    drawn = np.random.default_rng([seed, sample]).uniform(-jitter, jitter, size=count)
    drawn[0] = 0.0
    return drawn


class _Model:
    """Everything that all executions share, as the compiled code takes it."""

    def __init__(
        self,
        taught: TaughtData,
        path: Path,
        arm: Arm,
        servo: ServoModel,
        limits: Limits | None,
        box: Box,
        since: float | None,
        until: float | None,
    ) -> None:
        dof = arm.dof
        self.taught, self.box, self.dof, self.second = taught, box, dof, servo.order == "second"
        self.servo = servo.for_joints(dof)
        self.spans = _spans(box, self.servo, arm, taught)
        self.varies: BoolArray = self.spans > 0.0
        if box.dead_time_shared:
            self.varies[2 * dof + 1 : 3 * dof] = False
        if not self.second:
            self.varies[dof : 2 * dof] = False
        self.robot, reach = _robot(arm, path)
        if taught.q.shape[1] != dof:
            raise InvalidInput(
                f"The taught data is for {taught.q.shape[1]} joints, but the arm {arm.name} has "
                f"{dof}."
            )
        own = (arm.limits if limits is None else limits).for_joints(dof)
        lower, upper = (np.array(x) for x in own.acceleration_bounds(dof))
        if not self.second:
            lower, upper = np.full(dof, -np.inf), np.array(upper)
        duration = taught.trajectory.duration
        end = duration if until is None else _checks.positive("until", until, "s")
        patience = max(PATIENCE, PATIENCE_IN_DURATIONS * len(taught.q) * taught.period)
        steps = self._steps()
        last = taught.start_time + len(taught.q) * taught.period
        begin = taught.start_time if since is None else _checks.number("since", since, "s")
        if not begin < end:
            raise InvalidInput(
                f"Errors cover no time: they start at {begin:g} s and end at {end:g} s."
            )
        fixed = until is not None
        self.clock = Clock(taught.start_time, taught.period, steps, begin, end, fixed)
        self.rest = Rest(reach, last + patience)
        self.line = _line(path, taught, arm, self._lag())
        straight = servo.interpolation != "cubic"
        commands = polynomials(taught.q, taught.period, servo.interpolation)
        self.drive = Drive(commands, _inertia(arm, taught, box), straight, lower, upper)

    def span(self, signs: FloatArray) -> FloatArray:
        """Corners by the signs of the parameters that vary, as rows in units of the box."""
        unit = np.zeros((len(signs), len(self.spans)))
        unit[:, self.varies] = signs
        return unit

    def executed(self, unit: FloatArray, seed: int | None, threads: int) -> Spread:
        """Execute rows in units of the box, and the nominal robot.

        Raises:
            ExecutionError: A joint does not come to rest.
        """
        rows = np.concatenate([unit, np.zeros((1, unit.shape[1]))])
        if self.box.dead_time_shared:
            rows[:, 2 * self.dof : 3 * self.dof] = rows[:, 2 * self.dof, None]
        errors = rows * self.spans
        dof, servo = self.dof, self.servo
        kp = servo.kp * (1 + errors[:, :dof])
        kv = np.zeros_like(kp) if servo.kv is None else servo.kv * (1 + errors[:, dof : 2 * dof])
        # Below zero by rounding only: more has been refused.
        late = np.maximum(servo.dead_time + errors[:, 2 * dof : 3 * dof], 0.0)
        payload = np.ascontiguousarray(errors[:, -1])
        found = self._run(kp, kv, late, payload, seed, threads)
        _refuse_unsettled(found, kp, kv)
        return Spread(
            rms=found.rms[:-1],
            max=found.max[:-1],
            until=found.until[:-1],
            saturated=found.saturated[:-1],
            demand_ratio=found.demand_ratio[:-1],
            kp=kp[:-1],
            kv=kv[:-1] if self.second else None,
            dead_time=late[:-1],
            payload=payload[:-1],
            seed=seed,
            names=tuple(x for x, on in zip(self._names(), self.varies, strict=True) if on),
            deviations=errors[:-1, self.varies],
            nominal_rms=float(found.rms[-1]),
            nominal_max=float(found.max[-1]),
        )

    def _run(
        self,
        kp: FloatArray,
        kv: FloatArray,
        late: FloatArray,
        payload: FloatArray,
        seed: int | None,
        threads: int,
    ) -> Found:
        n = len(kp)
        rms, largest, until, saturated, ratio = np.full((5, n), np.nan)
        status = np.zeros(n, dtype=np.intp)
        found = Found(rms, largest, until, saturated, ratio, status)

        def batch(first: int) -> None:
            last = min(first + BATCH, n)
            # The nominal robot is the last one; its set-points are on time.
            jitter = self._jitter(first, last, n - 1, seed)
            of = slice(first, last)
            samples = Samples(kp[of], kv[of], late[of], payload[of], jitter)
            errors = (rms[of], largest[of], until[of], saturated[of], ratio[of])
            own = Found(*errors, status[of])
            run(self.robot, self.line, self.clock, self.drive, self.rest, samples, own)

        # The first by itself: it compiles.
        batch(0)
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(batch, range(BATCH, n, BATCH)))
        return found

    def _jitter(self, first: int, last: int, nominal: int, seed: int | None) -> FloatArray:
        count = len(self.taught.q)
        if seed is None or self.box.jitter == 0.0:
            return np.zeros((last - first, 0))
        return np.array(
            [
                np.zeros(count) if i == nominal else jitter_of(seed, i, count, self.box.jitter)
                for i in range(first, last)
            ]
        )

    def _names(self) -> list[str]:
        numbers = range(1, self.dof + 1)
        names = [f"{gain} of joint {j}" for gain in ("kp", "kv") for j in numbers]
        shared = self.box.dead_time_shared
        names += ["dead time" if shared else f"dead time of joint {j}" for j in numbers]
        return [*names, "payload"]

    def _steps(self) -> int:
        """Results per command interval.

        Raises:
            ExecutionError: They are too many.
        """
        span = min(RESOLUTION, TIME_CONSTANTS / self._fastest())
        if not self.taught.period < MOST_RESULTS * span:
            raise ExecutionError(
                f"The fastest servo of the box has a time constant of {1 / self._fastest():.3g} s, "
                f"too short to simulate command intervals of {self.taught.period:g} s: lower its "
                "gains kp and kv [1/s]."
            )
        # Steps of the command draw a ripple of its own period, which one result would not see.
        least = 2 if self.servo.interpolation == "step" else 1
        return max(least, int(np.ceil(self.taught.period / span * (1 - 1e-12))))

    def _fastest(self) -> float:
        """Largest rate of the servos in the box [1/s]."""
        kp = self.servo.kp * (1 + self.spans[: self.dof])
        if self.servo.kv is None:
            return float(kp.max())
        kv = self.servo.kv * (1 + self.spans[self.dof : 2 * self.dof])
        return float(np.where(kv >= 4 * kp, kv, np.sqrt(kp) * np.sqrt(kv)).max())

    def _lag(self) -> float:
        """Time by which the tool may be from where the plan has it [s]."""
        spans, servo, dof = self.spans, self.servo, self.dof
        lag = 1 / (servo.kp * (1 - spans[:dof]))
        if servo.kv is not None:
            lag = lag + 1 / (servo.kv * (1 - spans[dof : 2 * dof]))
        late = (servo.dead_time + spans[2 * dof : 3 * dof]).max()
        return float(lag.max() + late + self.box.jitter + 2 * self.taught.period)


def _refuse_unsettled(found: Found, kp: FloatArray, kv: FloatArray) -> None:
    """Raise for the first execution that did not come to rest or could not be computed.

    Raises:
        ExecutionError: There is one.
    """
    failed = np.flatnonzero(found.status != SETTLED)
    if not len(failed):
        return
    i = int(failed[0])
    gains = f"the gains kp {kp[i].tolist()} and kv {kv[i].tolist()} 1/s"
    if found.status[i] == STUCK:
        raise ExecutionError(
            f"Execution {i} cannot be simulated with {gains}: time steps as short as the servo "
            "needs make no progress, so lower the gains."
        )
    raise ExecutionError(
        f"Execution {i} does not come to rest with {gains}: make the box smaller, or raise the "
        "acceleration limits."
    )


def _search_corners(errors: Callable[[FloatArray], FloatArray], k: int) -> FloatArray:
    """Corners to look at where there are too many, as signs, (MOST_CORNERS, k)."""
    single = np.concatenate([np.eye(k), -np.eye(k)])
    found = errors(single)
    toward = np.where(found[:k] >= found[k:], 1.0, -1.0)
    best, worst = toward, float(errors(toward[None])[0])
    seen = [toward[None], -toward[None]]
    count = 2
    while count + k <= MOST_CORNERS:
        near = np.where(np.eye(k, dtype=np.bool_), -best, best)
        tried = errors(near)
        seen.append(near)
        count += k
        i = int(np.argmax(tried))
        if tried[i] <= worst:
            break
        best, worst = near[i], float(tried[i])
    left = MOST_CORNERS - count
    seen.append(np.random.default_rng(0).choice([-1.0, 1.0], size=(left, k)))
    return np.concatenate(seen)


def _threads(threads: int | None) -> int:
    if threads is None:
        return os.cpu_count() or 1
    return _checks.whole("threads", threads, 1, 1024)


def _spans(box: Box, servo: ServoModel, arm: Arm, taught: TaughtData) -> FloatArray:
    """Half widths of the box: kp, kv and dead time of every joint, and the payload.

    Raises:
        InvalidInput: A box that does not fit the robot.
    """
    dof = arm.dof
    try:
        gains = np.broadcast_to(np.asarray(box.gains), (2, dof))
    except ValueError:
        raise InvalidInput(
            f"gains of the box have the shape {np.shape(box.gains)}, but the arm has {dof} joints: "
            f"give one number, {dof} of them, or two rows for kp and kv."
        ) from None
    late = _checks.per_joint("dead_time of the box", box.dead_time, dof, "s")
    low = servo.dead_time - late
    if (low < 0).any():
        j = int(np.argmin(low))
        raise InvalidInput(
            f"The dead time of joint {j + 1} is {servo.dead_time[j]:g} s and its error "
            f"{late[j]:g} s, but a dead time cannot be negative: give the servo a larger one (the "
            "same for all joints changes no contour), or the box a smaller error."
        )
    if box.jitter >= taught.period / 2:
        raise InvalidInput(
            f"A jitter of {box.jitter:g} s is not below half the command interval of "
            f"{taught.period:g} s, so that set-points could come in another order."
        )
    _check_payload(box, servo, arm)
    return np.concatenate([gains[0], gains[1], late, [box.payload]])


def _check_payload(box: Box, servo: ServoModel, arm: Arm) -> None:
    if box.payload == 0.0:
        return
    if servo.order == "first":
        raise InvalidInput(
            "A servo of order first has no velocity loop whose gain a payload could change: leave "
            "payload out of the box, or take a servo of order second."
        )
    chain = arm.chain
    carried = 0.0 if chain is None or chain.payload is None else chain.payload.mass
    if box.payload > carried:
        raise InvalidInput(
            f"The payload of the box is {box.payload:g} kg either way, but the arm {arm.name} "
            f"carries only {carried:g} kg: give it the payload in the middle of what it may carry.",
            needed=box.payload,
            allowed=carried,
        )


def _robot(arm: Arm, path: Path) -> tuple[Robot, float]:
    """The arm for the compiled code, and how far its tool can be from any of its joints [m].

    Raises:
        InvalidInput: An arm of another kind, or a path of another dimension.
    """
    if path.dimension != arm.dimension:
        raise InvalidInput(
            f"The path has {path.dimension} coordinates, but the arm {arm.name} moves in "
            f"{arm.dimension}."
        )
    if isinstance(arm, SerialArm):
        rotations, positions, axes, base, end = (np.array(x) for x in arm.arrays)
        reach = float(np.linalg.norm(positions, axis=1).sum() + np.linalg.norm(end[:, 3]))
        return Robot(np.zeros(3), rotations, positions, axes, base, end), reach
    if not isinstance(arm, PlanarTwoLink):
        raise InvalidInput(
            "Robustness needs the compiled kinematics of a planar two-link arm or a serial arm, "
            f"not of a {type(arm).__name__}."
        )
    empty = np.zeros((2, 3, 3)), np.zeros((2, 3)), np.zeros((2, 3)), np.eye(3, 4), np.eye(3, 4)
    return Robot(np.array([arm.base, arm.link1, arm.link2]), *empty), arm.link1 + arm.link2


def _line(path: Path, taught: TaughtData, arm: Arm, lag: float) -> Line:
    """The path's table, its length if it is closed, and where the tool may be on it when.

    The plan follows the path from its beginning to its end; so the length that its tool has drawn
    is the place, the more exactly the more alike their lengths are. Elsewhere than near that place
    no nearest point is looked for: it would be on another branch.
    """
    table = _table(path)
    plan = taught.trajectory
    count = max(FEWEST_PLACES, PLACES_PER_INTERVAL * len(taught.q))
    t = np.union1d(np.linspace(0, plan.duration, count), plan.breaks)
    tool = arm.forward(plan(t))
    drawn = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(tool, axis=0), axis=1)))
    margin = abs(path.length - drawn[-1]) + 1e-6 * path.length
    begin = taught.start_time + np.arange(len(taught.q) + 1) * taught.period
    low = np.interp(begin - LAGS_BEHIND * lag, t, drawn) - margin
    high = np.interp(begin + taught.period + LAGS_AHEAD * lag, t, drawn) + margin
    closed = bool(np.linalg.norm(table[-1, 15:18] - table[0, :3]) <= REPEATED_POINT)
    return Line(table, path.length if closed else 0.0, low, high)


def _table(path: Path) -> FloatArray:
    """Per segment what `pack` gives, and what the compiled code needs beside, (n, 19).

    Sine, cosine and angle of its turn; its end; the corner between the segment before and it [rad],
    of the first one on a closed path.
    """
    turn = path.curvatures * path.lengths
    ends = pad(path.segments.ends)
    closing = angle_between(path(path.length, 1, side="left"), path.tangents[0])
    corner = np.append(closing, path.turns)
    table = [pack(path.segments), np.sin(turn), np.cos(turn), turn, ends, corner]
    return np.ascontiguousarray(np.column_stack(table))


def _inertia(arm: Arm, taught: TaughtData, box: Box) -> FloatArray:
    """Of 1 kg at the tool's tip over the arm's own, at every set-point and joint, (dof, n) [1/kg].

    A point of mass m at the tip adds `m |dx/dq_j|²` to the inertia M_jj of joint j.

    Raises:
        InvalidInput: The masses of the arm are not known.
    """
    q = np.asarray(taught.q)
    if box.payload == 0.0:
        return np.zeros((arm.dof, 1))
    own = np.diagonal(arm.dynamics.mass_matrix(q), axis1=-2, axis2=-1)
    added = (arm.jacobian(q) ** 2).sum(axis=-2)
    return np.ascontiguousarray((added / own).T)
