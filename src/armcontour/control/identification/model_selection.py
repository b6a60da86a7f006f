"""Selection of a joint's servo model by cross-validation, also with saturated parts of the logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from armcontour.control.identification.joint_fit import (
    HALF_INTERVAL,
    PARTS,
    ROUNDING,
    Fit,
    LogSegment,
    Model,
    Problem,
    Search,
    estimate_parameters,
    fit,
    predict,
)
from armcontour.control.identification.least_squares import UNITS, Estimate, allowed_deviation
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.quantities import shared_unit
from armcontour.core.sampled_data import white_noise
from armcontour.motion.log import FEWEST
from armcontour.robot.servo.simulation import JointServo

# Derivatives are computed from parabolas through the fewest samples for which the noise is below
# this fraction of the largest derivative.
MAX_NOISE = 0.015
# Longest time that such a parabola spans on each side of its sample [s].
LONGEST_WINDOW = 0.04
# This percentile of the magnitudes of a derivative counts as the largest derivative, and is the
# first guess of a limit.
TOP_PERCENTILE = 99.0
# A limit is first searched within this fraction of the guess above and below it.
PLATEAU_RANGE = 0.1
# A value is at a limit if it differs from the limit by at most this fraction of the limit.
PLATEAU_SHARE = 0.01
# A value is also at a limit if it differs from the limit by at most this number of standard
# deviations of the noise.
PLATEAU_SIGMAS = 4.0
# Searches: derivative, kind of the limit, range, and time before and after a plateau [s] in which
# the limit also applies, because the joint accelerates to it. The narrow range finds a limit above
# a planned plateau.
SEARCHES = (
    (2, "acceleration", PLATEAU_RANGE, 0.0),
    (2, "acceleration", 2 * PLATEAU_SHARE, 0.0),
    (1, "velocity", PLATEAU_RANGE, 0.05),
)
# Smallest number of successive samples of a plateau.
FEWEST_SAMPLES = 4
# Shortest duration of a plateau [s].
SHORTEST_PLATEAU = 5e-3
# On a saturated plateau, the commanded acceleration exceeds the measured acceleration by more than
# this fraction of the largest acceleration. Velocities less than this fraction below a velocity
# limit are saturated too.
EXCESS = 0.05
# On a saturated plateau, the commanded acceleration also exceeds the measured acceleration by more
# than this multiple of the RMS error of the commanded acceleration at the unsaturated samples.
EXCESS_ERRORS = 4.0
# Number of dead times that are tried for the commanded acceleration.
DELAY_COUNT = 26
# Longest dead time that is tried for the commanded acceleration [s].
LONGEST_DELAY = 0.1
# Smallest fraction of saturated samples that counts as saturation.
LEAST_SHARE = 2e-3
# Smallest number of samples outside of plateaus to which the commanded acceleration is fitted.
FEWEST_FREE = 50
# Multiples of the measured limit that are tried: smallest, largest, and their number.
LIMIT_MULTIPLES = (0.98, 1.06, 9)
# Segments between saturated samples with fewer samples than this are not fitted, because they
# determine no more than their initial state.
FEWEST_UNSATURATED = 20
# Largest number of segments that are fitted; the free initial states of more segments would explain
# most of the motion.
MAX_SEGMENTS = 40
# Number of segments between samples at a velocity limit that are fitted: the longest ones.
LONGEST_SEGMENTS = 10
# If a joint is at its acceleration limit for more than this fraction of the time, models with
# undetermined K_p are rejected.
MAX_LIMIT_TIME = 0.5
# If the unsaturated samples of such a joint determine no model, the times of the reversals must
# determine it. This number of reversals is sufficient, one for each of K_p, K_v, feed-forward and
# dead time.
FEWEST_REVERSALS = 4
# Margin before and after saturated samples [s], because drives react up to one drive cycle later.
MARGIN = 1e-3
# Names of the parameters of a joint's servo, as in `JointServo`.
KP = "kp"
KV = "kv"
KI = "ki"
FEED = "velocity_feedforward"
ACCELERATION = "acceleration_feedforward"
DELAY = "dead_time"
LIMIT = "acceleration_limit"
FRICTION = "friction"
# Candidate models, from simple to rich.
CANDIDATES = (
    Model("delay", (DELAY,)),
    Model("first", (KP, DELAY)),
    Model("first", (KP, FEED, DELAY)),
    Model("second", (KP, KV, DELAY)),
    Model("second", (KP, KV, FEED, DELAY)),
    Model("first", (KP, FEED, ACCELERATION, DELAY)),
    Model("second", (KP, KV, FEED, ACCELERATION, DELAY)),
    Model("second", (KP, KV, KI, FEED, DELAY, FRICTION)),
    Model("second", (KP, KV, KI, FEED, ACCELERATION, DELAY, FRICTION)),
    Model("second", (KP, KV, FEED, DELAY, LIMIT)),
)
# Parameters that are removed from a P-PI cascade (model with k_i) if it is not significantly worse
# without them.
OPTIONAL = (ACCELERATION, FEED, FRICTION)
# A richer model is selected only if the median over the parts of its error divided by the error of
# the simpler model is below this. Errors with a ratio above this are nearly the same.
GAIN = 0.9
# The same for models with an acceleration limit, instead of GAIN.
LIMIT_GAIN = 0.5
# A richer model is selected only if its error is smaller on at least this fraction of the parts.
MIN_BETTER_PARTS = 0.6
# A richer model is discarded if its error on the fitted data exceeds this fraction of the error of
# the best model.
RICHER_SHARE = 0.97
# A simpler model is discarded if its cost on the fitted data exceeds this multiple of the best.
POORER_RATIO = 2.0
# A cascade is fitted if the error of the best model so far is below this fraction of the tracking
# error.
CASCADE_SHARE = 0.5
# Saturation is reported only if the error of the best linear model at the saturated samples exceeds
# this multiple of the error of the model of the other samples.
SATURATED_ERROR = 2.0
# Two solutions with exchanged K_p and k_i are different if their K_p differs by more than this
# factor.
TWIN_FACTOR = 1.1
# Shortest drive cycle with which a model with acceleration feed-forward is also fitted [s].
SHORT_CYCLE = 0.5e-3
# Smallest damping ratio of a fitted loop; no drive is tuned with less damping.
LEAST_DAMPING = 0.2
# Largest number of evaluations of a cross-validation fit, which starts from the fit of all parts.
REFIT_EVALUATIONS = 10
# Selection uses samples with this spacing [s] if linear interpolation of their set-points
# reproduces the command.
COARSE_SPACING = 4e-3
# Coarse samples reproduce the command if the RMS error of the interpolated command is at most this
# fraction of the noise of the positions.
THINNING_ERROR = 0.3
# Upper bound of the initial dead time in the fit of a saturating joint [s].
USUAL_DELAY = 0.01
# Times over which accelerations are measured [s]: a short time for fast motion, and a long time for
# small motion in noise.
ACCELERATION_TIMES = (8e-3, 40e-3)
# This percentile of the magnitudes of the accelerations counts as the largest acceleration.
ACCELERATION_PERCENTILE = 99
# Initial values of loops: a, b, K_v [1/s], k_i [1/s], velocity feed-forward, and dead time divided
# by the lag. The initial K_p is a + b / lag. Feed-forward matters only in loops that saturate.
STARTS = (
    (10.0, 0.0, 20.0, 5.0, 1.0, 0.8), (1.0, 0.0, 100.0, 5.0, 1.0, 1.0),
    (40.0, 0.0, 150.0, 5.0, 0.6, 0.5), (30.0, 0.0, 100.0, 5.0, 0.0, 0.3),
    (150.0, 0.0, 60.0, 5.0, 0.6, 0.9), (0.0, 0.8, 60.0, 5.0, 0.0, 0.1),
    (0.0, 1.5, 150.0, 12.0, 0.0, 0.3), (0.0, 4.0, 100.0, 5.0, 0.0, 0.7),
)  # fmt: skip


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Saturation:
    """Acceleration or velocity limit at which a joint saturates, and the affected samples."""

    kind: str  # "acceleration" or "velocity"
    limit: float  # The limit [rad/s² or rad/s]
    sd: float  # Standard deviation of the limit [rad/s² or rad/s]
    time: float  # Time at the limit [s]
    duration: float  # Total duration of the segments [s]
    reversals: int  # Number of changes between the positive and the negative limit
    clipped: tuple[BoolArray, ...]  # Mask of the samples that the limit affects, for each segment

    @property
    def hides(self) -> bool:
        """True if the joint is at its acceleration limit for too much time, see MAX_LIMIT_TIME."""
        return self.kind == "acceleration" and self.time > MAX_LIMIT_TIME * self.duration

    @property
    def determines_servo(self) -> bool:
        """True if a model with the limit can be fitted to all samples, see FEWEST_REVERSALS."""
        few = self.hides and self.reversals < FEWEST_REVERSALS
        return self.kind == "acceleration" and not few

    def describe(self, name: str, *, prismatic: bool = False) -> str:
        """Clause for messages, such as "joint 2 saturates at 3 rad/s² for 0.4 s of 10 s"."""
        unit = shared_unit("rad/s²" if self.kind == "acceleration" else "rad/s", [prismatic])
        limit = f"{self.limit:.3g} {unit}"
        return f"{name} saturates at {limit} for {self.time:.2g} s of {self.duration:.3g} s"

    def explain_no_model(self, name: str, *, prismatic: bool = False) -> str:
        """Note on a joint whose other samples do not determine its servo."""
        lower = "accelerations" if self.kind == "acceleration" else "velocities"
        cause = self.describe("it", prismatic=prismatic)
        return (
            f"{name} has no model, because {cause}, and the other samples do not "
            f"determine its servo. Record more motion at lower {lower}."
        )


def find_saturation(segments: Sequence[LogSegment]) -> Saturation | None:
    """Find plateaus of acceleration or velocity that the loop commands to exceed; None if none."""
    # The commanded acceleration is linear in position, velocity and command. Its coefficients are
    # fitted to the samples outside the plateaus. Therefore a planned plateau that the joint follows
    # is not saturation.
    motion = _MeasuredMotion(segments)
    for order, kind, share, transient in SEARCHES:
        # The test of a velocity plateau also requires the acceleration.
        windows = [motion.window(x) for x in {2, order}]
        if not all(windows):
            continue
        k = max(windows)
        values = motion.derive(order, k)
        noise = motion.noise(order, k)
        limit, plateaus = _find_plateaus(values, noise, share, motion.interval)
        if not plateaus.any():
            continue
        excluded = _widen(plateaus, 2 * k + round(transient / motion.interval))
        prediction = motion.predict_acceleration(k, ~excluded)
        if prediction is None:
            continue
        acceleration = motion.derive(2, k)
        demanded, error = prediction
        excess = np.sign(values) * (demanded - acceleration)
        top = float(np.percentile(np.abs(acceleration), TOP_PERCENTILE))
        threshold = max(EXCESS * top, EXCESS_ERRORS * error)
        clipped = np.full(len(values), False)
        for i, j in _spans(plateaus):
            clipped[i:j] = np.median(excess[i:j]) > threshold
        if np.mean(clipped) < LEAST_SHARE:
            continue
        time = float(np.sum(clipped)) * motion.interval
        reversals = int(np.sum(np.diff(np.sign(values[clipped])) != 0))
        sizes = np.abs(values[clipped])
        sd = float(np.std(sizes) * np.sqrt((2 * k + 1) / len(sizes)))
        if order == 2:
            slack = max(EXCESS_ERRORS * error, EXCESS * PLATEAU_SHARE * limit)
            clipped |= np.abs(demanded) > limit + slack
        else:
            clipped |= np.abs(values) > (1 - EXCESS) * limit
        margin = k + max(round((MARGIN + transient) / motion.interval), 1)
        every = motion.at_samples(_widen(clipped, margin), k)
        duration = sum(float(t[-1] - t[0]) for t in motion.times)
        return Saturation(
            kind=kind, limit=limit, sd=sd, time=time, duration=duration, reversals=reversals,
            clipped=every,
        )  # fmt: skip
    return None


def find_supported_saturation(
    segments: Sequence[LogSegment], search: Search
) -> tuple[Saturation | None, Selected | None]:
    """Saturation that models support, and the model of the unsaturated samples; None if none.

    A linear joint can also have plateaus, on which the commanded acceleration is inaccurate. A
    model without saturation then predicts the plateaus as well as the other samples.
    """
    saturation = find_saturation(segments)
    if saturation is None:
        return None, None
    selected = select_unsaturated(segments, saturation, search)
    linear = select_model(segments, search, limited=False)
    if linear is None:
        return saturation, selected
    order = linear.fit.problem.model.order
    every = []
    for s, clipped in zip(segments, saturation.clipped, strict=True):
        every.append((s.y - predict(s, linear.servo, order, search.drive_cycle))[clipped & s.use])
    errors = np.concatenate(every)
    error = float(np.sqrt(np.mean(errors**2))) if len(errors) else 0.0
    usual = linear.fit.noise if selected is None else max(selected.rms, selected.fit.noise)
    if error <= SATURATED_ERROR * max(usual, ROUNDING):
        return None, None
    return saturation, selected


def select_unsaturated(
    segments: Sequence[LogSegment], saturation: Saturation, search: Search
) -> Selected | None:
    """Select the model of a joint from its unsaturated samples; None if they are too few."""
    # Each interval between saturated samples is a segment with a free initial state. A fit of all
    # samples with an acceleration limit is preferred if its error in these segments is not
    # significantly larger and its K_p has a smaller standard deviation.
    # None is also returned if there are too many segments. At a velocity limit, only the longest
    # segments are used.
    between = _cut_unsaturated(segments, saturation)
    if saturation.kind == "velocity":
        between = sorted(between, key=lambda x: len(x.y), reverse=True)[:LONGEST_SEGMENTS]
    if not between or len(between) > MAX_SEGMENTS:
        return None
    free = select_model(between, search, limited=False)
    if free is None or saturation.kind == "velocity":
        return free
    if free.fit.problem.model.order != "second":
        return replace(predict_parts(free.fit, segments), rivals=free.rivals)
    order, names = free.fit.problem.model
    problem = Problem(Model(order, (*names, LIMIT)), segments, search)
    start = {**free.fit.servo._asdict(), LIMIT: saturation.limit}
    whole = fit(problem, [problem.guess(start, free.fit.servo.dead_time)])
    squares = _error(between, whole.servo._replace(acceleration_limit=np.inf), search.drive_cycle)
    rms = (squares / sum(float(np.sum(s.weight)) for s in between)) ** 0.5
    certain = [estimate_parameters(x)[KP].sd for x in (whole, free.fit)]
    if not is_implausible(whole) and rms * GAIN < free.rms and certain[0] < certain[1]:
        return replace(predict_parts(whole), rivals=free.rivals)
    measured = saturation.limit
    servo = free.fit.servo
    # Smoothing reduces the height of short plateaus, so larger limits are also tried.
    value = min(
        (measured, *measured * np.linspace(*LIMIT_MULTIPLES)),
        key=lambda x: _error(segments, servo._replace(acceleration_limit=x), search.drive_cycle),
    )
    sd = max(saturation.sd, abs(value - measured) / 2)
    limit = Estimate(
        name=LIMIT, unit=UNITS[LIMIT], value=float(value), sd=sd, low=value - HALF_INTERVAL * sd,
        high=value + HALF_INTERVAL * sd, determined=bool(sd <= allowed_deviation(value)),
    )  # fmt: skip
    return replace(predict_parts(free.fit, segments, limit), rivals=free.rivals)


def _cut_unsaturated(segments: Sequence[LogSegment], saturation: Saturation) -> list[LogSegment]:
    """Cut segments into their parts between saturated samples, without parts that are too short."""
    parts = []
    for segment, clipped in zip(segments, saturation.clipped, strict=True):
        for begin, end in _spans(~clipped):
            if np.sum(segment.use[begin:end]) >= FEWEST_UNSATURATED:
                parts.append(segment.cut(begin, end))
    return parts


def _error(segments: Sequence[LogSegment], servo: JointServo, drive_cycle: float) -> float:
    """Sum of the squared errors of a servo of second order, weighted by motion [rad²]."""
    errors = [s.y - predict(s, servo, "second", drive_cycle) for s in segments]
    return sum(float(s.weight @ x**2) for s, x in zip(segments, errors, strict=True))


class _MeasuredMotion:
    """Measured motion of a joint on uniform times, and its derivatives from fitted parabolas."""

    # The parabola of a sample spans the `k` samples before and after it, so derivatives lack the
    # first `k` and the last `k` samples of a segment.

    def __init__(self, segments: Sequence[LogSegment]) -> None:
        self.segments = segments
        self.interval = float(np.median(np.diff(segments[0].command.t)))
        self.sigma = max(float(white_noise(s.y)) for s in segments)
        self.times = []
        for s in segments:
            first, last = s.command.t[[0, -1]]
            self.times.append(np.linspace(first, last, round((last - first) / self.interval) + 1))
        self.positions = [
            np.interp(t, s.command.t, s.y) for t, s in zip(self.times, segments, strict=True)
        ]

    def noise(self, order: int, k: int) -> float:
        """Standard deviation of the noise of a derivative [rad/s**order]."""
        return self.sigma * float(np.linalg.norm(_filter(order, k, self.interval)))

    def derive(self, order: int, k: int, signals: Sequence[FloatArray] | None = None) -> FloatArray:
        """Derivative of the positions or of other signals, concatenated over the segments."""
        weights = _filter(order, k, self.interval)
        every = self.positions if signals is None else signals
        return np.concatenate([np.convolve(x, weights, "valid") for x in every if len(x) > 2 * k])

    def window(self, order: int) -> int:
        """Half-width k of the filter of a derivative [samples]; 0 if noise dominates for all k."""
        longest = min(
            round(LONGEST_WINDOW / self.interval), max(len(x) for x in self.positions) // 4
        )
        for k in range(1, longest + 1):
            top = float(np.percentile(np.abs(self.derive(order, k)), TOP_PERCENTILE))
            if self.noise(order, k) < MAX_NOISE * top:
                return k
        return 0

    def predict_acceleration(self, k: int, free: BoolArray) -> tuple[FloatArray, float] | None:
        """Commanded acceleration [rad/s²], (n,), and its RMS error at the samples in `free`."""
        # None if the mask has too few samples for the fit.
        if np.sum(free) < FEWEST_FREE:
            return None
        acceleration = self.derive(2, k)
        best = None
        position = self.derive(0, k)
        velocity = self.derive(1, k)
        for delay in np.linspace(0.0, LONGEST_DELAY, DELAY_COUNT):
            every = zip(self.times, self.segments, strict=True)
            commands = [s.command.evaluate(t - delay) for t, s in every]
            u, du, ddu = (self.derive(x, k, commands) for x in range(3))
            columns = np.stack([u - position, velocity, du, ddu, np.ones(len(u))], axis=1)
            columns /= np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
            gains = np.linalg.lstsq(columns[free], acceleration[free], rcond=1e-10)[0]
            values = columns @ gains
            error = float(np.sqrt(np.mean((values - acceleration)[free] ** 2)))
            if best is None or error < best[1]:
                best = values, error
        return best

    def at_samples(self, mask: BoolArray, k: int) -> tuple[BoolArray, ...]:
        """Convert a mask of derivatives to a mask of the samples of each segment."""
        masks = []
        done = 0
        for t, s in zip(self.times, self.segments, strict=True):
            times_mask = np.full(len(t), False)
            count = max(len(t) - 2 * k, 0)
            times_mask[k : k + count] = mask[done : done + count]
            done += count
            masks.append(times_mask[np.rint((s.command.t - t[0]) / self.interval).astype(np.intp)])
        return tuple(masks)


def _filter(order: int, k: int, interval: float) -> FloatArray:
    """Weights for `np.convolve`: middle derivative of a parabola fitted to 2 k + 1 samples."""
    from scipy.signal import savgol_coeffs

    return np.asarray(savgol_coeffs(2 * k + 1, 2, deriv=order, delta=interval))


def _find_plateaus(
    values: FloatArray, noise: float, first: float, interval: float
) -> tuple[float, BoolArray]:
    """Limit of a derivative, and the mask of the samples in plateaus at this limit."""
    sizes = np.abs(values)
    limit = float(np.percentile(sizes, TOP_PERCENTILE))
    width = PLATEAU_SIGMAS * noise
    plateaus = np.full(len(sizes), False)
    for share in (first, first / 2, *[PLATEAU_SHARE] * 5):
        near = np.abs(sizes - limit) <= max(share * limit, width)
        if not near.any():
            return limit, plateaus
        limit = float(np.median(sizes[near]))
    near = np.abs(sizes - limit) <= max(PLATEAU_SHARE * limit, width)
    fewest = max(FEWEST_SAMPLES, round(SHORTEST_PLATEAU / interval))
    for sign in (1.0, -1.0):
        for i, j in _spans(near & (np.sign(values) == sign)):
            plateaus[i:j] = j - i >= fewest
    return limit, plateaus


def _spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Start and end index (exclusive) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.intp)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _widen(mask: BoolArray, by: int) -> BoolArray:
    """The mask with each run of true values extended by `by` samples on both sides."""
    return np.asarray(np.convolve(mask, np.ones(2 * by + 1))[by : len(mask) + by] > 0.5)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Selected:
    """A fitted model and its predictions of the parts to which it was not fitted."""

    fit: Fit  # The fit to all samples
    segments: Sequence[LogSegment]  # The segments that are predicted
    # unseen: predicted positions of each segment [rad]; each part by a fit of the other parts.
    unseen: list[FloatArray]
    errors: FloatArray  # Mean squared errors of the parts, weighted by motion [rad²], (parts,)
    motions: FloatArray  # Weights of the parts (sums of the sample weights), (parts,)
    limit: Estimate | None = None  # Acceleration limit if it is estimated separately from the fit
    without: Sequence[JointServo] = ()  # Servos, each fitted without one part
    rivals: Sequence[JointServo] = ()  # Servos of other models with nearly the same error
    # The solution with exchanged K_p and k_i if its error is nearly the same.
    twin: JointServo | None = None
    # The solution if the drive differentiates the command continuously, see `find_continuous`.
    continuous: JointServo | None = None

    @property
    def servo(self) -> JointServo:
        """The fitted servo, with the separately estimated limit if there is one."""
        return limited_servo(self.fit.servo, self.limit)

    @property
    def rms(self) -> float:
        """RMS error on parts that were not fitted, weighted by motion [rad]."""
        return float(np.sqrt(np.average(self.errors, weights=self.motions)))

    @property
    def explains_all(self) -> bool:
        """True if the error is noise or rounding. Then no richer model can be better."""
        return self.rms * GAIN < max(self.fit.noise, ROUNDING)

    def is_better(self, other: Selected) -> bool:
        """Return whether this model is significantly better than the simpler `other`, see GAIN."""
        limited = LIMIT in self.fit.problem.model.free
        ratio = float(np.median(self.errors / np.maximum(other.errors, 1e-300))) ** 0.5
        better = float(np.mean(self.errors < other.errors))
        return ratio < (LIMIT_GAIN if limited else GAIN) and better >= MIN_BETTER_PARTS


def find_lag(segments: Sequence[LogSegment], longest: float) -> float:
    """Delay of the command with the smallest tracking error [s], on a grid of about 1 ms."""

    def remaining_error(lag: float) -> float:
        errors = [s.y - s.command.evaluate(s.command.t - lag) for s in segments]
        return sum(
            float(np.var(x[s.use]) * s.use.sum()) for x, s in zip(errors, segments, strict=True)
        )

    return float(min(np.linspace(0.0, longest, int(longest / 1e-3) + 2), key=remaining_error))


def select_model(
    segments: Sequence[LogSegment], search: Search, *, limited: bool = True
) -> Selected | None:
    """Select the model of a joint; None if less than two parts move or all fits are implausible."""
    some = _thin_segments(segments)
    # Cross-validation requires at least two parts.
    if len(_moving_parts(some)) < 2:
        return None
    trials = _Trials(some, search)
    for model in CANDIDATES:
        bent = ACCELERATION in model.free and not some[0].command.linear
        excluded = bent or (LIMIT in model.free and not limited) or model.order not in search.orders
        if excluded or (KI in model.free and not trials.may_be_cascade(model)):
            continue
        trials.add(model)
        if trials.best and trials.best.explains_all:
            break
    if trials.best is None:
        return None
    order, free = trials.best.fit.problem.model
    if KI in free:
        trials.prune()
    elif order != "delay" and not trials.best.explains_all:
        trials.add(Model(order, (*free, FRICTION)))
    trials.drop_open_dead_time()
    best = replace(trials.best, twin=trials.find_twin())
    rivals = [x.fit.servo for x in trials.tried if x.rms * GAIN < best.rms and x is not trials.best]
    if some is not segments:
        whole = Problem(best.fit.problem.model, segments, search)
        best = replace(best, fit=fit(whole, [best.fit.x], REFIT_EVALUATIONS))
    return replace(best, rivals=rivals, continuous=find_continuous(best.fit))


def find_continuous(result: Fit) -> JointServo | None:
    """Servo that fits the logs if the drive differentiates the command continuously.

    Models without a drive cycle compute the command's acceleration from differences over the
    interval between set-points, which delays it by half of this interval. Drives with a shorter
    cycle differentiate with less delay. Fits with the cycles h and 2 h differ from continuous loops
    by about h and 2 h times a constant, so the result is `2 x(h) - x(2 h)` with the parameters x
    (Richardson's extrapolation), with h = SHORT_CYCLE.

    Returns:
        The servo; None if the model has no acceleration feed-forward, the drive cycle is known, or
        the logs contradict continuous differentiation because the error is larger (see GAIN).
    """
    problem = result.problem
    if ACCELERATION not in problem.model.free or problem.search.drive_cycle:
        return None
    fits = []
    for cycle in (SHORT_CYCLE, 2 * SHORT_CYCLE):
        search = problem.search._replace(drive_cycle=cycle)
        held = Problem(problem.model, problem.segments, search)
        fits.append(fit(held, [result.x]))
    if fits[0].cost * GAIN**2 > result.cost:
        return None
    unknowns = np.clip(2 * fits[0].x - fits[1].x, problem.low, problem.high)
    return replace(result, x=unknowns).servo


class _Trials:
    """Models that were fitted to a joint, and the best of them."""

    def __init__(self, segments: Sequence[LogSegment], search: Search) -> None:
        self.segments = segments
        self.search = search
        self.lag = find_lag(segments, search.longest)
        self.fits: dict[Model, Fit] = {}
        self.tried: list[Selected] = []
        self.best: Selected | None = None

    def add(self, model: Model) -> None:
        """Fit a model; it becomes the best model if it is significantly better."""
        problem = Problem(model, self.segments, self.search)
        best = self.best
        starts = [problem.guess(x, self.lag) for x in self._starts(model)]
        result = fit(problem, starts, 30 if KI in model.free else 60)
        hopeless = best and result.cost > RICHER_SHARE**2 * best.fit.cost
        if KI in model.free and not hopeless:
            # Loops with exchanged K_p and k_i have the same poles.
            servo = result.servo
            other = servo._replace(kp=servo.ki, ki=servo.kp)._asdict()
            exchanged = fit(problem, [problem.guess(other, servo.dead_time)], 30)
            result = min(result, exchanged, key=lambda x: x.cost)
        self.fits[model] = result
        if hopeless or is_implausible(result):
            return
        self.tried.append(predict_parts(result))
        if best is None or self.tried[-1].is_better(best):
            self.best = self.tried[-1]

    def may_be_cascade(self, model: Model) -> bool:
        """Return whether the best model explains enough of the tracking error to try a cascade."""
        if self.best is None:
            return False
        lag = np.concatenate([(s.y - s.command.u)[s.use] for s in self.best.segments])
        supported = {KI, ACCELERATION} & set(self.best.fit.problem.model.free)
        explains = self.best.rms < CASCADE_SHARE * np.std(lag)
        return bool(explains and (ACCELERATION not in model.free or supported))

    def prune(self) -> None:
        """Remove OPTIONAL parameters without which the best model is not significantly worse."""
        for name in OPTIONAL:
            assert self.best is not None
            free = self.best.fit.problem.model.free
            # Acceleration feed-forward requires velocity feed-forward.
            if name in free and not (name == FEED and ACCELERATION in free):
                self._drop(name)

    def drop_open_dead_time(self) -> None:
        """Remove an undetermined dead time if the best model is not significantly worse."""
        assert self.best is not None
        loop = self.best.fit.problem.model.order != "delay"
        if loop and not estimate_parameters(self.best.fit, self.best.without)[DELAY].determined:
            self._drop(DELAY)

    def find_twin(self) -> JointServo | None:
        """Servo with exchanged K_p and k_i that fits nearly as well as the best; None if none.

        The poles of both servos are the same. Feed-forward of about 1 also makes their zeros equal.
        """
        assert self.best is not None
        best = self.best.fit
        model = best.problem.model
        if KI not in model.free:
            return None
        servo = best.servo._replace(kp=best.servo.ki, ki=best.servo.kp)
        problem = Problem(model, self.segments, self.search)
        result = fit(problem, [problem.guess(servo._asdict(), servo.dead_time)], 30)
        factor = result.servo.kp / best.servo.kp
        differs = max(factor, 1 / factor) > TWIN_FACTOR
        if is_implausible(result) or result.cost * GAIN**2 > best.cost or not differs:
            return None
        return result.servo

    def _drop(self, name: str) -> None:
        """Remove a parameter unless the best model is significantly worse without it."""
        assert self.best is not None
        best = self.best.fit
        order, free = best.problem.model
        model = Model(order, tuple(y for y in free if y != name))
        problem = Problem(model, self.segments, self.search)
        start = best.servo._replace(**{name: 0.0})
        result = fit(problem, [problem.guess(start._asdict(), best.servo.dead_time)])
        if is_implausible(result) or result.cost > POORER_RATIO * best.cost:
            return
        simpler = predict_parts(result)
        if not self.best.is_better(simpler):
            self.best = simpler

    def _starts(self, model: Model) -> list[dict[str, float]]:
        """Initial parameters of a fit: generic loops (STARTS), or the fit of a simpler model."""
        order, free = model
        lag = self.lag
        if order == "delay":
            return [{DELAY: x} for x in (lag, max(lag - 4e-3, 0.0))]
        gain = max(1 / (lag + 1e-4), 0.5)
        loops: list[dict[str, float]] = [
            {KP: a + b * gain, KV: kv, KI: ki, FEED: f, DELAY: d * lag}
            for a, b, kv, ki, f, d in STARTS
        ]
        new = {FRICTION} if FRICTION in free else {ACCELERATION, LIMIT} & set(free)
        if KI in free or not new:
            return loops
        simpler = self.fits[Model(order, tuple(x for x in free if x not in new))]
        initial = simpler.servo._asdict()
        if LIMIT not in new:
            return [initial]
        # If a joint often saturates, the fit without a limit is a useless start. Therefore generic
        # loops are also tried.
        tops = [max(_largest_acceleration(s, x) for s in self.segments) for x in ACCELERATION_TIMES]
        loops = [{**x, DELAY: min(x[DELAY], USUAL_DELAY)} for x in loops[2:4]]
        limits = (*tops, 3 * max(tops))
        return [{**x, LIMIT: limit} for x, limit in product((initial, *loops), limits)]


def is_implausible(result: Fit) -> bool:
    """Return whether a fitted loop has parameters at their bounds, or too little damping."""
    low, high = result.at_bounds()
    servo = result.servo
    ringing = np.isfinite(servo.kv) and 0.5 * np.sqrt(servo.kv / servo.kp) < LEAST_DAMPING
    lead = {FEED} if ACCELERATION in result.problem.model.free else set()
    bounded = high & {KP, KV, KI, FEED, ACCELERATION, LIMIT} or low & ({KP, KV, KI, LIMIT} | lead)
    return bool(ringing or bounded)


def _thin_segments(segments: Sequence[LogSegment]) -> Sequence[LogSegment]:
    """Segments with samples at COARSE_SPACING; unchanged if this would change the command."""
    interval = float(np.median(np.diff(segments[0].command.t)))
    every = int(COARSE_SPACING / interval * (1 + 1e-6))
    if every < 2 or not segments[0].command.linear:
        return segments
    thinned = [x.cut(0, len(x.y), every) for x in segments]
    for one, full in zip(thinned, segments, strict=True):
        difference = one.command.evaluate(full.command.t) - full.command.u
        rough = np.sqrt(np.mean(np.diff(full.y, n=3) ** 2) / 20)
        if np.sqrt(np.mean(difference**2)) > THINNING_ERROR * rough or len(one.y) < FEWEST:
            return segments
    return thinned


def _moving_parts(segments: Sequence[LogSegment]) -> IntArray:
    """Indices of the parts in which the command of some used samples moves."""
    every = [s.part[s.use & (s.weight > 0) & (s.part >= 0)] for s in segments]
    return np.unique(np.concatenate(every))


def _largest_acceleration(s: LogSegment, time: float) -> float:
    """Largest acceleration from positions `time` apart [rad/s²], see ACCELERATION_PERCENTILE."""
    t = s.command.t
    interval = float(np.median(np.diff(t)))
    k = min(max(int(round(time / interval)), 1), (len(t) - 1) // 2)
    second = s.y[2 * k :] - 2 * s.y[k:-k] + s.y[: -2 * k]
    return float(np.percentile(np.abs(second), ACCELERATION_PERCENTILE)) / (k * interval) ** 2


def limited_servo(servo: JointServo, limit: Estimate | None) -> JointServo:
    """The servo with the acceleration limit; unchanged if the limit is None."""
    return servo if limit is None else servo._replace(acceleration_limit=limit.value)


def divide_log(segments: Sequence[LogSegment], log: int) -> list[LogSegment]:
    """Divide one of several logs into PARTS parts of equal motion; other logs become part -1."""
    total = sum(float(s.weight.sum()) for s in segments if s.log == log)
    divided = []
    done = 0.0
    for s in segments:
        part = np.full(len(s.y), -1)
        if s.log == log:
            share = (done + np.cumsum(s.weight)) / max(total, 1e-300)
            part = np.minimum((share * PARTS).astype(np.intp), PARTS - 1)
            done += float(s.weight.sum())
        divided.append(replace(s, part=part))
    return divided


def predict_program(selected: Selected, log: int) -> list[FloatArray]:
    """Predict the parts of one log by fits of the other parts of this log and of the other logs.

    Returns:
        Predicted positions of each of the predicted segments [rad].
    """
    result = selected.fit
    problem = result.problem
    # The segments on which the model was selected can have fewer samples than those of the fit.
    fitted = selected.segments if selected.limit is None else problem.segments
    parts = divide_log(fitted, log)
    divided = replace(result, problem=Problem(problem.model, parts, problem.search))
    judged = divide_log(selected.segments, log)
    return predict_parts(divided, judged, selected.limit).unseen


def predict_parts(
    result: Fit, judged: Sequence[LogSegment] | None = None, limit: Estimate | None = None
) -> Selected:
    """Predict each moving part by a fit of the other parts (cross-validation).

    `judged` are the segments that are predicted, by default those of the fit. Part -1 is always
    fitted.
    """
    p = result.problem
    segments = judged or result.problem.segments

    def predict_by(servo: JointServo, s: LogSegment) -> FloatArray:
        return predict(s, limited_servo(servo, limit), p.model.order, p.search.drive_cycle)

    # Parts without motion are predicted by the fit of all parts.
    unseen = [predict_by(result.servo, s) for s in segments]
    errors = []
    motions = []
    without = []
    for k in _moving_parts(segments):
        others = [replace(s, use=s.use & (s.part != k)) for s in p.segments]
        indices = [i for i, s in enumerate(others) if s.use.any()]
        other = Problem(p.model, [others[i] for i in indices], p.search)
        servo = fit(other, [p.select(result.x, indices)], REFIT_EVALUATIONS).servo
        without.append(servo)
        squares = motion = 0.0
        for i, s in enumerate(segments):
            mask = s.part == k
            if mask.any():
                q = predict_by(servo, s)
                unseen[i][mask] = q[mask]
                weight = s.weight[mask] * s.use[mask]
                squares += float(np.sum(weight * (q - s.y)[mask] ** 2))
                motion += float(np.sum(weight))
        errors.append(squares / motion)
        motions.append(motion)
    return Selected(
        fit=result,
        segments=segments,
        unseen=unseen,
        errors=np.array(errors),
        motions=np.array(motions),
        limit=limit,
        without=without,
    )
