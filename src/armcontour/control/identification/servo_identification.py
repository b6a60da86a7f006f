"""Identification of independent servos: selection and validation of the model of each joint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from typing import Annotated, ClassVar

import numpy as np

from armcontour.control.identification.identification_result import (
    Identification,
    JointIdentification,
    Judgement,
    round_digits,
    with_servo,
)
from armcontour.control.identification.joint_fit import (
    MRAD,
    LogSegment,
    Search,
    estimate_parameters,
    predict,
    split_logs,
)
from armcontour.control.identification.least_squares import (
    encoder_resolution,
    fastest_motion,
    is_white,
)
from armcontour.control.identification.model_selection import (
    Selected,
    find_lag,
    find_supported_saturation,
    predict_program,
    select_model,
)
from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import Options, checked, declared
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import Choice, Interval, Quantity, linear_unit
from armcontour.core.sampled_data import interpolate, white_noise
from armcontour.core.text import show
from armcontour.motion.log import (
    FEWEST,
    INTERPOLATIONS,
    Log,
    arrange_joints,
    regularize_times,
    renew_positions,
    with_units_of,
)
from armcontour.motion.log_checks import check_interval, check_range_of_log, check_speeds
from armcontour.robot import Arm
from armcontour.robot.servo.model import TRUSTED
from armcontour.robot.servo.simulation import JointServo

# Remedy for a weak or missing model.
RECORD = (
    "Check the unit, sign and order of the columns. Record the program also at half its speed, and "
    "motions of this joint alone, to see whether gravity, friction or other joints cause the error."
)
# Spacing of the samples from which contour errors are computed [s].
SPACING = 4e-3
# Two logs are of the same program if their commands differ by at most this fraction of their range.
SAME_PROGRAM = 0.02
# Without an arm, errors of a joint are divided by its RMS tracking error, or by this fraction of
# the largest tracking error if that is larger. Then the noise of a joint that hardly moves is not
# amplified.
LEAST_WEIGHT = 0.1
# Number of Newton steps in the search for a delay.
NEWTON_STEPS = 3
# The delay of the contour is searched from minus this value to the longest delay of a joint plus
# this value [s].
DELAY_MARGIN = 0.1
# A model or delay is rejected if its error exceeds this fraction of the tracking error.
MAX_WEAK = 0.8
# Smallest fraction of a mean square that counts as signal, because the noise of a finite number of
# samples correlates.
LEAST_SIGNAL = 0.01
# If all models are good, a joint is weak if compensation leaves more than the fraction TRUSTED of
# its deviation from the contour in a log, and this deviation is more than MAIN_SHARE of the contour
# error that remains in this log.
MAIN_SHARE = 0.5
# Lower bound of divisors.
TINY = 1e-30
# Orders of the candidate models for each value of the option `model`.
MODELS = {"auto": ("delay", "first", "second"), "second": ("second",), "first": ("first",)}
# A model is good if its RMS error is at most this fraction of the tracking error. A weak model is
# written only if its RMS error is at most this fraction of the motion.
GOOD_SHARE = 0.3
# A model is also good if its RMS error is at most this multiple of the encoder noise. Deviations
# from the contour up to this multiple of the noise do not show that a model is weak.
NOISE_MULTIPLE = 3.0
# The columns are checked if the error exceeds this fraction of the motion.
MISREAD_SHARE = 0.1
# A joint is at rest if the standard deviation of its measured positions is at most this multiple of
# that of the noise. Its velocity is uniform if the same holds for deviations from a line.
REST_SIGMAS = 1.5
# A joint is also at rest if the range of its measured positions is at most this [rad]; a 32-bit
# encoder has a resolution of 1.5e-9 rad.
LEAST_MOTION = 1e-9
# Lower bound of a tracking error that is used as a divisor [rad].
LEAST_LAG = 1e-12
# Deviations from uniform velocity below this value are rounding errors, because logs have at most
# nine digits [rad].
LEAST_BEND = 1e-8
# Longest drive cycle that is assumed if none is given [s]; a longer sample interval replaces it.
USUAL_CYCLE = 2e-3


@dataclass(frozen=True, slots=True, eq=False)
class _LogSamples:
    """Samples of a log: times [s], commands [rad], mask of used samples, and residuals [rad]."""

    # rest: residuals for each choice of the written model ("none", "delay", "model"), (n, dof).

    t: FloatArray
    command: FloatArray
    use: BoolArray
    rest: dict[str, FloatArray]

    def deviate(
        self, choice: Sequence[str], longest: float, weight: FloatArray, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """RMS contour error (see `Judgement.errors`), and RMS deviations of the joints [rad].

        - `choice`: key of `rest` for each joint.
        - `longest`: longest delay of a joint [s].
        """
        residual = np.stack([self.rest[c][:, j] for j, c in enumerate(choice)], axis=1)
        moved = self.command + residual
        times = self.t
        if arm is not None:
            reach = (longest + DELAY_MARGIN) / float(np.median(np.diff(self.t)))
            path = arm.tool_position(self.command)
            tool = arm.tool_position(moved)
            rows = np.arange(len(path), dtype=np.float64)
            positions = find_nearest(path, tool, int(np.ceil(reach)))
            times = np.interp(positions, rows, self.t)
        elif len(weight) > 1:
            both = self.command * weight, moved * weight
            times = times - find_delay([(times, *both)], -DELAY_MARGIN, longest + DELAY_MARGIN)
        deviations = moved - interpolate(times, self.t, self.command)
        errors = deviations * weight if arm is None else tool - interpolate(positions, rows, path)
        each = np.sqrt(np.mean(deviations[self.use] ** 2, axis=0))
        square = float(np.mean(np.sum(errors[self.use] ** 2, axis=1)))
        if set(choice) != {"none"}:
            # The small errors that remain are separated from the white noise of the encoders, which
            # does not correlate in neighbouring samples.
            pairs = np.sum(errors[1:] * errors[:-1], axis=1)[self.use[1:] & self.use[:-1]]
            square = max(float(np.mean(pairs)), LEAST_SIGNAL * square)
        return math.sqrt(square), each


def choose_and_judge(
    logs: Sequence[Log],
    joints: Sequence[JointIdentification],
    interpolation: str,
    longest: float,
    arm: Arm | None,
    program: int | None = None,
) -> tuple[tuple[JointIdentification, ...], Judgement]:
    """Choose by the contour error which model of each joint is written, and judge the result.

    Good models are written. For the other joints, the weak model, the delay or nothing is written,
    whichever has the smallest contour error. Without an arm, the contour is a curve in joint space.

    `longest` is the longest dead time of the search [s]. `program` is the index of the only log of
    a program if the other logs are multisines.
    """
    delays = _joint_delays(logs, longest)
    motions = [_sample_log(logs, i, joints, longest) for i in range(len(logs))]
    lags = _residual_rms(motions, "none")
    delayed = _residual_rms(motions, "delay")
    weight = 1 / np.maximum(lags, max(LEAST_WEIGHT * float(lags.max()), TINY))

    def deviations(choice: Sequence[str]) -> list[tuple[float, FloatArray]]:
        return [x.deviate(choice, float(delays.max()), weight, arm) for x in motions]

    none = deviations(["none"] * len(joints))

    def cost(choice: Sequence[str]) -> float:
        pairs = zip(deviations(choice), none, strict=True)
        return sum((x[0] / max(y[0], TINY)) ** 2 for x, y in pairs)

    choice = ["model" if x.written else "none" for x in joints]
    for j, joint in enumerate(joints):
        if joint.note:
            others = ("none", "delay") if delayed[j] <= MAX_WEAK * lags[j] else ("none",)
            choice = min((choice, *([*choice[:j], y, *choice[j + 1 :]] for y in others)), key=cost)
    done = deviations(choice)
    errors = np.array([(y[0], x[0]) for x, y in zip(done, none, strict=True)])
    before, after = errors.T
    ratio = after / np.maximum(before, TINY)
    shares = [x[1] / np.maximum(y[1], TINY) for x, y in zip(done, none, strict=True)]
    noises = np.nan_to_num(np.array([x.noise for x in joints]))
    if arm is None:
        noise = float(np.linalg.norm(noises * weight))
    else:
        moves = arm.tool_jacobian(motions[0].command) * noises
        noise = float(np.sqrt(np.mean(np.sum(moves**2, axis=(1, 2)))))
    slow = fastest_motion(logs).slow_logs
    program_ratio = float(ratio[slow].max())
    if program is not None:
        names = ["program" if x == "model" else x for x in choice]
        left = motions[program].deviate(names, float(delays.max()), weight, arm)[0]
        program_ratio = left / max(float(before[program]), TINY)
    judgement = Judgement(
        programs=count_programs(logs),
        ratios=np.where(after > NOISE_MULTIPLE * noise, ratio, np.minimum(ratio, TRUSTED)),
        program_ratio=program_ratio,
        errors=errors,
    )
    written = []
    are_good = not any(x.note for x in joints)
    for j, (joint, c) in enumerate(zip(joints, choice, strict=True)):
        i = int(np.argmax([x[j] for x in shares]))
        left = done[i][1][j]
        remaining = float(np.linalg.norm(done[i][1] * weight))
        if (
            are_good
            and shares[i][j] > TRUSTED
            and left > NOISE_MULTIPLE * noises[j]
            and left * weight[j] > MAIN_SHARE * remaining
        ):
            note = (
                f"The model of {joint.name} is weak: {shares[i][j]:.0%} of its deviation from the "
                f"contour of {logs[i].source} remains with compensation ({left * 1e3:.3g} of "
                f"{none[i][1][j] * 1e3:.3g} {'mm' if joint.prismatic else 'mrad'} RMS), which is "
                f"most of the remaining contour error of this log. {RECORD}"
            )
            joint = replace(joint, note=note)
        if c != "model":
            delay = round_digits(delays[j] * (c == "delay"))
            servo = JointServo(np.inf, dead_time=delay)
            joint = with_servo(joint, split_logs(logs, j, interpolation, delay), servo)
        written.append(replace(joint, contour_ratio=float(shares[i][j])))
    return tuple(written), judgement


def _residual_rms(motions: Sequence[_LogSamples], choice: str) -> FloatArray:
    """Return the RMS residual of each joint [rad], (dof,); `choice` is a key of `rest`."""
    residuals = np.concatenate([x.rest[choice] for x in motions])
    return np.asarray(np.sqrt(np.mean(residuals**2, axis=0)))


def _sample_log(
    logs: Sequence[Log], i: int, joints: Sequence[JointIdentification], longest: float
) -> _LogSamples:
    """Samples of log i; residuals without models, with delays from other logs, with models."""
    log = logs[i]
    every = max(int(SPACING / log.interval * (1 + 1e-6)), 1)
    delays = _joint_delays([x for k, x in enumerate(logs) if k != i] or logs, longest)
    model = np.stack([x.rests[i] if x.rests else np.full(len(log.t), np.nan) for x in joints], 1)
    predicted = np.isfinite(model)
    use = (predicted | ~predicted.any(axis=0)).all(axis=1)
    use = use if use.any() else np.full(len(use), True)
    delayed = [interpolate(log.t - x, log.t, log.command[:, [j]]) for j, x in enumerate(delays)]
    late = log.measured - np.concatenate(delayed, axis=1)
    # An offset is no error of the model. A mean lag is one, so the mean is not subtracted.
    means = late[use].mean(axis=0)
    offsets = [x.offsets.get(i, y) if x.written else y for x, y in zip(joints, means, strict=True)]
    residuals = {
        "none": log.measured - log.command - offsets,
        "delay": late - offsets,
        "model": np.where(predicted, model, 0.0),
    }
    if all(len(x.program_rest) == len(log.t) for x in joints if x.rests):
        rows = [x.program_rest if x.rests else np.zeros(len(log.t)) for x in joints]
        residuals["program"] = np.nan_to_num(np.stack(rows, axis=1))
    some = slice(None, None, every)
    rest = {name: x[some] for name, x in residuals.items()}
    return _LogSamples(log.t[some] - log.t[0], log.command[some], use[some], rest)


def _joint_delays(logs: Sequence[Log], longest: float) -> FloatArray:
    """Delay of each joint with the smallest tracking error, at most `longest` [s], (dof,)."""
    delays = []
    for j in range(logs[0].dof):
        motions = [(x.t, x.command[:, [j]], x.measured[:, [j]]) for x in logs]
        delays.append(find_delay(motions, 0.0, longest))
    return np.array(delays)


def find_delay(
    motions: Sequence[tuple[FloatArray, FloatArray, FloatArray]], low: float, high: float
) -> float:
    """Delay from `low` to `high` with the smallest tracking error, by Newton's method [s].

    `motions` are times (n,) [s], commands (n, k) and positions (n, k) of each log.
    """
    delay = 0.0
    for _ in range(NEWTON_STEPS):
        above = below = 0.0
        for t, command, q in motions:
            errors = q - interpolate(t - delay, t, command)
            rate = interpolate(t - delay, t, np.gradient(command, t, axis=0))
            above -= float(np.sum((errors - errors.mean(axis=0)) * rate))
            below += float(np.sum(rate**2))
        delay = float(np.clip(delay + above / max(below, TINY), low, high))
    return delay


def count_programs(logs: Sequence[Log]) -> int:
    """Number of different programs: logs whose commands differ from those of all earlier logs."""

    def is_same(one: Log, other: Log) -> bool:
        difference = one.command - interpolate(
            one.t - one.t[0], other.t - other.t[0], other.command
        )
        ranges = np.maximum(np.ptp(one.command, axis=0), np.ptp(other.command, axis=0))
        return bool((np.ptp(difference, axis=0) <= SAME_PROGRAM * ranges).all())

    programs: list[Log] = []
    for log in logs:
        programs += [] if any(is_same(log, y) for y in programs) else [log]
    return len(programs)


def find_nearest(curve: FloatArray, points: FloatArray, reach: int) -> FloatArray:
    """Fractional indices of the points of a polyline that are nearest to points, (n,).

    Rows of curve and points, (n, m), are at the same times. The search for the nearest point covers
    `reach` samples before and after.
    """
    n = len(curve)
    nearest = np.full(n, np.inf)
    positions = np.zeros(n)
    rows = np.arange(n)
    edges = np.diff(curve, axis=0)
    lengths = np.maximum(np.sum(edges**2, axis=1), TINY)
    for k in range(-reach, reach + 1):
        start = np.clip(rows + k, 0, n - 2)
        edge = edges[start]
        offset = points - curve[start]
        share = np.clip(np.sum(offset * edge, axis=1) / lengths[start], 0.0, 1.0)
        squares = np.sum((offset - share[:, None] * edge) ** 2, axis=1)
        positions = np.where(squares < nearest, start + share, positions)
        nearest = np.minimum(squares, nearest)
    return positions


@declared(eq=False)
class ServoFit(Options):
    """Options of `identify` for independent joint servos.

    >>> ac.ServoFit(model="first", longest_dead_time=0.05).model
    'first'

    Args:
        interpolation: Interpolation of set-points in the controller, "linear" or "step"; by default
            as stated in the log, otherwise linear.
        longest_dead_time: Longest dead time of the search [s].
        model: "second" or "first" allows only models of this order, "auto" allows all models.
        drive_cycle: Time between two computations of the drives' loops, from 0.25 to 8 ms [s]; by
            default the loops are continuous.
        kinematics: The arm whose tool is used for the contour error; by default the contour error
            is computed in joint space.
    """

    method: ClassVar[str] = "servo"
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None
    longest_dead_time: Interval = 0.25
    model: Annotated[str, Choice(tuple(MODELS))] = "auto"
    drive_cycle: Annotated[float, Quantity("s", "1 ms", within=(2.5e-4, 8e-3))] | None = None
    kinematics: Arm | None = None


def choose_interpolation(logs: Sequence[Log], required: str | None) -> str:
    """Interpolation of set-points: as required, otherwise as the logs state, otherwise linear."""
    for log in logs:
        checks.raise_if(
            required is not None and log.interpolation not in (None, required),
            f"{log.source} states the interpolation {log.interpolation}, but the option "
            f"interpolation is {required}. Remove one of the two.",
        )
    kinds = {required or x.interpolation or "linear" for x in logs}
    if len(kinds) > 1:
        raise InvalidInput(
            "All logs must have the same interpolation of set-points, but they state different "
            "ones. Identify each log separately."
        )
    return kinds.pop()


SERVO_FIT = ServoFit()


@checked
def identify(
    logs: Log | Sequence[Log], options: ServoFit = SERVO_FIT, *, progress: Progress | None = None
) -> Identification:
    """Identify the servo of every joint from logs.

    The candidate models of a joint are a dead time, a servo of first order and a servo of second
    order, as in `ServoModel`. The simplest model that predicts parts of the logs to which it was
    not fitted is selected. The model is simulated exactly from the set-points. With several logs,
    each log is predicted from the others. A model is good if its error is at most 30 % of the
    tracking error, or at most 3 times the noise of the encoder. A model with an error of at most
    80 % is weak. For joints without a good model, the weak model, the delay of the joint or nothing
    is written, whichever has the smallest contour error on motion that was not fitted.

    >>> identification = ac.identify(ac.read_log("log.csv"))
    >>> identification.determined, identification.joints[0].order
    (True, 'delay')

    Args:
        logs: A log, with set-points and measured positions, or several logs of the same robot.
        options: Options, such as `ServoFit(model="second")`.
        progress: Called with a step that names the joint, before each joint is identified.

    Raises:
        InvalidInput: The sample interval of a log is outside 0.05 to 100 ms, the logs or the arm
            differ in their joints, or command and measurement of a log do not belong together.
    """
    single = (logs,) if isinstance(logs, Log) else logs
    originals = checks.check_sequence("logs", single, Log, "Logs")
    checks.raise_if(
        not originals, "The identification requires at least one log, but logs is empty."
    )
    for log in originals:
        check_interval(log.source, log.t)
    arm = options.kinematics
    if arm is not None:
        originals = tuple(_with_joints_of(x, arm) for x in originals)
    timed = [regularize_times(x) for x in originals]
    pairs = [renew_positions(x) for x, _ in timed]
    every = tuple(x for x, _ in pairs)
    first = every[0]
    for log in every[1:]:
        if log.joint_names != first.joint_names:
            raise InvalidInput(
                f"All logs must have the same joints, but joint_names is "
                f"{show(str(first.joint_names))} in {first.source} and "
                f"{show(str(log.joint_names))} in {log.source}."
            )
    interpolation = choose_interpolation(every, options.interpolation)
    for log in every:
        if arm is not None:
            both = {"set-point": log.command, "measured position": log.measured}
            check_range_of_log(log.source, log.t, both, log.joint_names, arm)
        check_speeds(log.source, log.t, log.measured, log.joint_names, log.prismatic)
    report = subprogress(progress)
    joints = []
    # The dead time must be short compared with the logs.
    shortest = min(float(x.t[-1] - x.t[0]) for x in every)
    longest = min(options.longest_dead_time, shortest / 4)
    orders = MODELS[options.model]
    slow = np.flatnonzero(fastest_motion(every).slow_logs)
    program = int(slow[0]) if len(slow) == 1 < len(every) else None
    search = Search(longest, options.drive_cycle or 0.0, orders)
    for j, name in enumerate(first.joint_names):
        report(Step((name,), j / first.dof))
        joints.append(identify_joint(every, j, interpolation, search, program))
    judged, judgement = choose_and_judge(every, joints, interpolation, search.longest, arm, program)
    return Identification(
        logs=every,
        interpolation=interpolation,
        joints=judged,
        drive_cycle=search.drive_cycle,
        judgement=judgement,
        repeats=tuple(chain.from_iterable(x for _, x in (*timed, *pairs))),
    )


def _with_joints_of(log: Log, arm: Arm) -> Log:
    """The log with the joints of an arm in their order, and with their units."""
    if log.dof < arm.dof:
        raise ArmMismatch(
            f"{log.source} has {log.dof} joints, but the arm {arm.name} has {arm.dof}. Specify the "
            "arm with which the log was recorded."
        )
    return with_units_of(arrange_joints(log, arm.joint_names), arm)


def identify_joint(
    logs: Sequence[Log], j: int, interpolation: str, search: Search, program: int | None = None
) -> JointIdentification:
    """Identify the servo of joint j (index from 0); order "unknown" if no model is accepted.

    `program` is the index of the only log of a program if the other logs are multisines.
    """
    name = logs[0].joint_names[j]
    segments = split_logs(logs, j, interpolation)
    lag = find_lag(segments, search.longest)
    segments = [x.after(lag) for x in segments]
    slides = logs[0].prismatic[j]
    joint = JointIdentification(name=name, prismatic=slides)
    if reason := _explain_no_model(segments):
        return _mark_unknown(joint, segments, f"{name} has no model, because {reason}")
    saturation, selected = find_supported_saturation(segments, search)
    if saturation is not None:
        if selected is None and not saturation.determines_servo:
            note = saturation.explain_no_model(name, prismatic=slides)
            return _mark_unknown(joint, segments, note)
        # Models have no velocity limit, so samples at this limit are neither fitted nor predicted.
        if selected is not None and saturation.kind == "velocity":
            segments = list(selected.segments)
    poor = selected is not None and selected.rms > NOISE_MULTIPLE * selected.fit.noise
    # All samples are fitted if no model is selected. They are also fitted if the selected model is
    # poor and the acceleration saturates, because the unsaturated samples can be insufficient for
    # the servo.
    if selected is None or (poor and saturation is not None and saturation.kind == "acceleration"):
        whole = select_model(segments, search)
        selected = min(
            filter(None, (selected, whole)), key=partial(_rms_error, segments), default=None
        )
    motion = _rms([s.y for s in segments], segments)[0]
    if selected is None or selected.rms > MISREAD_SHARE * motion:
        for log in logs:
            _check_columns(log, j, lag)
    if selected is None:
        note = (
            f"{name} has no model, because fitted gains (at most {search.fastest:g} 1/s) or "
            f"feed-forward are at the bounds of their ranges. {RECORD}"
        )
        return _mark_unknown(joint, segments, note)
    servo = JointServo(*(round_digits(x) for x in selected.servo))
    order = selected.fit.problem.model.order
    noise = selected.fit.noise
    file = [s.y - predict(s, servo, order, search.drive_cycle) for s in segments]
    unseen = [s.y - q for s, q in zip(selected.segments, selected.unseen, strict=True)]
    error, tracking = _worst_log(unseen, selected.segments)
    worst = max((error, tracking), _worst_log(file, segments), key=lambda x: x[0] / x[1])
    interval = max(float(np.median(np.diff(s.command.t))) for s in segments)
    unknown_cycle = 0.0 if search.drive_cycle else max(interval, USUAL_CYCLE)
    limit = {} if selected.limit is None else {selected.limit.name: selected.limit}
    step = max(encoder_resolution(s.y) for s in segments)
    effective = not is_white(selected.fit.problem.residuals(selected.fit.x) / MRAD, step)
    rivals = selected.rivals if effective else ()
    rests = _at_samples(logs, selected.segments, unseen)
    program_rest = np.zeros(0)
    if program is not None:
        predicted = predict_program(selected, program)
        errors = [s.y - q for s, q in zip(selected.segments, predicted, strict=True)]
        program_rest = _at_samples(logs, selected.segments, errors)[program]
    described = saturation.describe(name, prismatic=slides) if saturation else ""
    estimates = estimate_parameters(selected.fit, selected.without, unknown_cycle, rivals) | limit
    twin = ""
    if selected.twin is not None:
        twin = _describe_twin(name, selected.servo, selected.twin)
        estimates = {x: y.including(getattr(selected.twin, x)) for x, y in estimates.items()}
    if slides:
        estimates = {x: replace(y, unit=linear_unit(y.unit)) for x, y in estimates.items()}
    joint = replace(
        joint,
        parameters=estimates,
        effective=effective,
        twin=twin,
        saturation=f"{described}, which the fit allows for." if described else "",
        unseen_rms=error,
        share=error / tracking,
        noise=noise,
        rests=tuple(rests),
        program_rest=program_rest,
    )
    if saturation is not None and saturation.hides and not joint.kp.determined:
        note = saturation.explain_no_model(name, prismatic=slides)
        return _mark_unknown(replace(joint, saturation=""), segments, note)
    note = ""
    advice = ""
    share = worst[0] / worst[1]
    if worst[0] > max(GOOD_SHARE * worst[1], NOISE_MULTIPLE * noise):
        note = (
            f"on motion that was not fitted, {share:.0%} of the tracking error remains "
            f"({worst[0] * 1e3:.3g} of {worst[1] * 1e3:.3g} {'mm' if slides else 'mrad'} RMS)"
        )
        advice = f" {RECORD}"
    if note and (share > MAX_WEAK or selected.rms > GOOD_SHARE * motion):
        allowed = f"{MAX_WEAK:.0%}" if share > MAX_WEAK else f"{GOOD_SHARE:.0%} of the motion"
        note = f"{name} has no model, because {note}, which exceeds {allowed}.{advice}"
        return _mark_unknown(joint, segments, note)
    note = (
        f"The model of {name} is weak: {note}, which exceeds {GOOD_SHARE:.0%}.{advice}"
        if note
        else ""
    )
    joint = replace(joint, note=note, tracking_rms=_rms(_lags(segments), segments)[0])
    used = np.concatenate([x[s.use] for x, s in zip(unseen, selected.segments, strict=True)])
    return with_servo(joint, segments, servo, order, search.drive_cycle, float(np.abs(used).max()))


def _at_samples(
    logs: Sequence[Log], segments: Sequence[LogSegment], errors: Sequence[FloatArray]
) -> list[FloatArray]:
    """Errors of segments [rad] at the samples of each log, (n,); nan at unused samples."""
    rests = [np.full(len(x.t), np.nan) for x in logs]
    for s, error in zip(segments, errors, strict=True):
        t = logs[s.log].t - logs[s.log].t[s.start]
        some = (t >= s.command.t[s.use][0]) & (t <= s.command.t[-1])
        rests[s.log][some] = np.interp(t[some], s.command.t, error)
    return rests


def _describe_twin(name: str, servo: JointServo, twin: JointServo) -> str:
    """Sentence about two servos with exchanged K_p and k_i."""
    return (
        f"The log of {name} agrees with two servos: kp {servo.kp:.3g} 1/s and ki {servo.ki:.3g} "
        f"1/s, or kp {twin.kp:.3g} 1/s and ki {twin.ki:.3g} 1/s. Their motion is nearly the same, "
        "and the file has the first one."
    )


def _check_columns(log: Log, j: int, lag: float) -> None:
    """Raise InvalidInput if joint j follows other commands, or its own with the opposite sign."""
    commands = interpolate(log.t - lag, log.t, log.command - log.command.mean(axis=0))
    products = (log.measured[:, j] - log.measured[:, j].mean()) @ commands
    similar = products / np.maximum(np.linalg.norm(commands, axis=0), LEAST_LAG)
    if similar[j] < np.abs(similar).max():
        raise InvalidInput(
            f"{log.source}: {log.joint_names[j]} does not follow its commands. Correct the order "
            "and the signs of the columns.",
            joint=j,
        )


def _mark_unknown(
    joint: JointIdentification, segments: Sequence[LogSegment], note: str
) -> JointIdentification:
    """The joint with order "unknown"; its error is the RMS tracking error about the mean."""
    written = with_servo(joint, segments, JointServo(math.inf))
    return replace(written, note=note, tracking_rms=written.rms)


def _rms_error(segments: Sequence[LogSegment], selected: Selected) -> float:
    """RMS error of a model over all used samples [rad]."""
    order = selected.fit.problem.model.order
    drive_cycle = selected.fit.problem.search.drive_cycle
    return _rms([s.y - predict(s, selected.servo, order, drive_cycle) for s in segments], segments)[
        0
    ]


def _worst_log(errors: Sequence[FloatArray], segments: Sequence[LogSegment]) -> tuple[float, float]:
    """RMS error and RMS tracking error [rad] of the log in which their ratio is largest."""
    # If there is only one log, its errors are weighted by motion, because the joint may rest in
    # parts of it.
    logs = sorted({s.log for s in segments if s.weight.any()})
    single = int(len(logs) == 1)
    pairs = []
    lags = _lags(segments)
    for k in logs:
        indices = [i for i, s in enumerate(segments) if s.log == k]
        some = [segments[i] for i in indices]
        error = _rms([errors[i] for i in indices], some, centred=False)[single]
        pairs.append((error, max(_rms([lags[i] for i in indices], some)[single], LEAST_LAG)))
    return max(pairs, key=lambda x: x[0] / x[1])


def _lags(segments: Sequence[LogSegment]) -> list[FloatArray]:
    """Measured positions less commands [rad]."""
    return [s.y - s.command.u for s in segments]


def _rms(
    values: Sequence[FloatArray], segments: Sequence[LogSegment], *, centred: bool = True
) -> tuple[float, float]:
    """Unweighted and motion-weighted RMS of values over the used samples, about their means.

    If not `centred`, means are not subtracted.
    """
    sums = np.zeros(4)
    for row, s in zip(values, segments, strict=True):
        square = (row - (np.mean(row[s.use]) if centred else 0.0)) ** 2
        weight = s.weight * s.use
        sums += [square @ s.use, s.use.sum(), square @ weight, weight.sum()]
    return float(np.sqrt(sums[0] / sums[1])), float(np.sqrt(sums[2] / max(sums[3], 1e-300)))


def _explain_no_model(segments: Sequence[LogSegment]) -> str:
    """Reason why no model can be identified (no motion, uniform velocity); empty if none."""
    if not segments:
        return f"the log has fewer than {FEWEST} samples without a gap. Record a longer motion."
    if not any((s.weight * s.use).any() for s in segments):
        return "no motion is commanded. Record a program that moves this joint."
    if all(
        np.ptp(s.y) <= LEAST_MOTION or np.std(s.y) <= REST_SIGMAS * white_noise(s.y)
        for s in segments
    ):
        change = max(float(np.ptp(s.command.u)) for s in segments)
        still = f"its measured motion is only noise, although its commands span {change:.3g} rad"
        return f"{still}. Record more motion."
    if all(_is_uniform(s) for s in segments):
        return "the velocity is uniform, which determines a lag, but no gains. Record a multisine."
    return ""


def _is_uniform(segment: LogSegment) -> bool:
    """Return whether both the commanded and the measured velocity of a segment are uniform."""
    t = segment.command.t
    return not changes_velocity(t, segment.command.u) and not changes_velocity(t, segment.y)


def changes_velocity(t: FloatArray, positions: FloatArray) -> bool:
    """Return whether positions [rad] at times t [s], (n,), deviate from a line beyond the noise."""
    errors = positions - np.polyval(np.polyfit(t, positions, 1), t)
    return bool(
        np.std(errors) > REST_SIGMAS * white_noise(positions) and np.ptp(errors) > LEAST_BEND
    )
