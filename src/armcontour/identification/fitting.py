"""Maximum likelihood fit of one joint by simulation, with Levenberg-Marquardt iterations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.errors import ExecutionError
from armcontour.identification import _joint
from armcontour.identification.correlation import find_period, repeats
from armcontour.motion.log import Log
from armcontour.servo._sensitivity import COLUMNS
from armcontour.servo.model import MOST_FEEDFORWARD

# Ranges of the search for gains [1/s] and acceleration limits [rad/s²].
GAINS = (0.05, 5e3)
LIMITS = (1e-4, 1e7)
# The same for velocity feed-forward.
FEEDS = (0.0, MOST_FEEDFORWARD)
# The iteration ends when a step moves the parameters by less than this share of a standard
# deviation.
NEAR = 1e-3
MOST_ITERATIONS = 60
# A gap of at most this many intervals is short. Time for which a command is held in a longer one,
# and after which what follows it counts [s].
SHORT_GAP, REST, SETTLES = 20.0, 5.0, 1.0
# Steps with more damping than this are too short to be useful.
MOST_DAMPING = 1e8
# A gain changes by no more than this factor in one iteration.
LARGEST_FACTOR = 3.0

STARTS = ("rest", "held", "moving")
NAMES = ("kp", "kv", "delay", "q0", "dq0", "limit", "feed")
_LOGARITHMIC = ("kp", "kv", "limit")
_BOUNDED = ("delay", "feed", *_LOGARITHMIC)
# Sum of squares, residuals, their derivatives by the free parameters, and time at the limit.
Errors = tuple[float, FloatArray, FloatArray, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Data:
    """One joint of a log.

    Args:
        t: Times [s], (n,).
        u: Set-points [rad], (n,).
        y: Measured positions [rad], (n,).
        linear: Whether set-points are interpolated linearly; otherwise each is kept until the next.
        delays: Smallest and largest dead time of the search [s].
        offset: First value of the offset between measured position and command at rest [rad]; None
            if no offset is estimated.
        period: Samples after which commands repeat; 0 if they do not.
        used: Samples that count, (n,); None is all of them.
        rows: Their rows of the log, -1 for a sample that is not of the log, (n,).
    """

    t: FloatArray
    u: FloatArray
    y: FloatArray
    linear: bool
    delays: tuple[float, float]
    offset: float | None = None
    period: int = 0
    used: BoolArray | None = None
    rows: IntArray | None = None

    @classmethod
    def of(cls, log: Log, j: int, linear: bool, delays: tuple[float, float]) -> Data:
        """The joint j (from 0) of a log.

        Over a short gap the command goes on as between samples. In a longer one it is that at its
        end, for as long as it takes the joint to come to rest there, and what follows the gap
        counts after a while only, as the joint need not have been at rest.

        Args:
            log: The log.
            j: The joint.
            linear: Whether set-points are interpolated linearly.
            delays: Smallest and largest dead time of the search [s].
        """
        t, u, y = log.t - log.t[0], log.command[:, j].copy(), log.measured[:, j].copy()
        ends = log.gaps
        ends = ends[np.diff(t)[ends] > SHORT_GAP * log.interval]
        if not len(ends):
            return cls(t=t, u=u, y=y, linear=linear, delays=delays, period=find_period(u))
        rows, used = np.arange(len(t)), np.full(len(t), True)
        lasts = np.append(ends[1:], len(t) - 1)
        for end, last in zip(ends, lasts, strict=True):
            t[end + 1 :] += REST + t[end] + log.interval - t[end + 1]
            after = t[end + 1 : last + 1] - t[end + 1]
            used[end + 1 : last + 1] = after >= min(SETTLES, after[-1] / 3)
        places = ends + 1
        return cls(
            t=np.insert(t, places, t[ends] + log.interval),
            u=np.insert(u, places, u[places]),
            y=np.insert(y, places, y[places]),
            linear=linear,
            delays=delays,
            used=np.insert(used, places, False),
            rows=np.insert(rows, places, -1),
        )

    @property
    def noise(self) -> float:
        """Standard deviation of white noise on a smooth motion [rad], from third differences."""
        third = np.diff(self.y, n=3)
        if self.used is not None:
            third = third[np.lib.stride_tricks.sliding_window_view(self.used, 4).all(axis=1)]
        return float(np.sqrt(np.mean(third**2) / 20)) if len(third) else 0.0

    def part(self, begin: int, end: int, every: int = 1) -> Data:
        """The samples from `begin` to before `end`, every `every`-th one."""
        some = slice(begin, end, every)
        t, u, y = (np.ascontiguousarray(x[some]) for x in (self.t, self.u, self.y))
        used = None if self.used is None else self.used[some]
        rows = None if self.rows is None else self.rows[some]
        period = self.period if every == 1 else 0
        return replace(self, t=t, u=u, y=y, used=used, rows=rows, period=period)

    @property
    def interval(self) -> float:
        """The usual time between two samples [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def last(self) -> int:
        """The sample after the last one that the set-points reach, whatever the dead time."""
        return int(np.searchsorted(self.t, self.t[-1] + min(self.delays[0], 0.0), side="right"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """Parameters of one joint, and its state at the start of the log.

    Args:
        order: "second" or "first".
        start: "rest": the joint was at rest until the first set-point reached it; "held": the
            command before the log was the first set-point; "moving": the command before the log is
            not known.
        first: First sample that is used.
        kp, kv: Gains [1/s]; kv is infinite in the first order.
        delay: Dead time [s].
        limit: Acceleration limit [rad/s²], or infinity.
        q0, dq0: State at the first sample [rad, rad/s].
        fixed: Names of parameters that are given.
        offset: Measured position less that of the model [rad], if it is estimated.
        feed: Velocity feed-forward, if there is any.
    """

    order: str
    start: str
    first: int
    kp: float
    kv: float
    delay: float
    limit: float
    q0: float
    dq0: float
    fixed: tuple[str, ...] = ()
    offset: float | None = None
    feed: float | None = None

    @property
    def given(self) -> FloatArray:
        """What the compiled simulations take, as in `NAMES`."""
        return np.array([getattr(self, x) or 0.0 for x in NAMES])

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are estimated."""
        names = ["kp", "delay", "q0"]
        if self.order == "second":
            names.insert(1, "kv")
            if self.start != "rest":
                names.append("dq0")
            if math.isfinite(self.limit):
                names.append("limit")
        names += [x for x in ("feed", "offset") if getattr(self, x) is not None]
        return tuple(x for x in names if x not in self.fixed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Parameters with the largest likelihood.

    Args:
        state: The parameters.
        sse: Sum of squared residuals [rad²].
        count: Number of samples that count.
        jacobian: Derivatives of the positions by the free parameters, those of `_LOGARITHMIC` by
            their logarithms, (free, samples).
        residuals: Measured less simulated [rad], 0 where they do not count, (samples,).
        spread: Sum of the squares of the measured positions about their mean [rad²].
        saturated_time: Time at the acceleration limit [s].
        at_edge: Free parameters that ended at the edge of the search range.
        delays: The range of dead times [s].
        period: Samples after which the residuals repeat; 0 if they do not.
    """

    state: State
    sse: float
    count: int
    jacobian: FloatArray
    residuals: FloatArray
    spread: float
    saturated_time: float
    at_edge: tuple[str, ...]
    delays: tuple[float, float]
    period: int

    @property
    def variance(self) -> float:
        """Unbiased variance of the noise [rad²]."""
        return self.sse / max(self.count - len(self.state.free), 1)

    @property
    def r_squared(self) -> float:
        """Share of the variance of the measured positions that the model explains."""
        return 1.0 - self.sse / max(self.spread, 1e-300)

    @property
    def bic(self) -> float:
        """Bayes's information criterion: smaller is better, a difference of 10 is much."""
        likely = self.count * math.log(max(self.sse / self.count, 1e-300))
        return likely + len(self.state.free) * math.log(self.count)


def simulated(data: Data, state: State, columns: int = 1) -> tuple[FloatArray, FloatArray]:
    """Simulate a joint over its log, from the first used sample on.

    Returns:
        Positions [rad], followed by their derivatives if `columns` is above 1, (columns, samples);
        largest demand [rad/s²] and time at the acceleration limit [s].

    Raises:
        ExecutionError: An interval of the log is too long to simulate.
    """
    first, last, rest = state.first, data.last, state.start == "rest"
    given = (data.t, data.u, data.linear, first, last, rest, state.given, columns)
    if state.order == "first":
        return _joint.first_order(*given), np.zeros(2)
    found: tuple[FloatArray, FloatArray] = _joint.second_order(*given)
    if math.isnan(found[1][0]):
        raise ExecutionError(
            f"A joint cannot be simulated over the log with kp = {state.kp:g} and kv = "
            f"{state.kv:g} 1/s: time steps as short as the servo needs make no progress over its "
            f"longest interval of {np.diff(data.t).max():g} s, so give shorter intervals."
        )
    return found


def fit(data: Data, start: State, *, enough: float = -math.inf, most: int = MOST_ITERATIONS) -> Fit:
    """Find the maximum of the likelihood nearest to `start`.

    Args:
        data: The log of the joint.
        start: First parameters.
        enough: Sum of squares at which the iteration may stop [rad²].
        most: Largest number of iterations.

    Raises:
        ExecutionError: At the start the positions are not finite.
    """
    state, damping = start, 1e-3
    errors = _errors(data, state)
    if not math.isfinite(errors[0]):
        raise ExecutionError(
            f"The log cannot be simulated with kp = {state.kp:g} 1/s and kv = {state.kv:g} 1/s: "
            "its times or its positions are out of proportion to these gains; look at their units."
        )
    for _ in range(most):
        found = _step(data, state, errors, damping)
        if found is None:
            break
        gain = errors[0] - found[1][0]
        state, errors, damping = found
        sse, residuals, _, saturated = errors
        if sse <= enough or gain <= NEAR**2 * sse / len(residuals):
            break
        # An acceleration limit that is not reached has no effect on the errors.
        if "limit" in state.free and saturated == 0.0:
            break
    return _fit_at(data, state, errors)


def _step(
    data: Data, state: State, errors: Errors, damping: float
) -> tuple[State, Errors, float] | None:
    """Take one step; returns the state, its errors and the next damping, or None if none helps."""
    sse, residuals, jacobian, _ = errors
    names = state.free
    normal, slope, _ = _joint.normal_equations(jacobian, residuals)
    # A parameter that would leave its search range stays fixed while the others move.
    free = np.array([_moves(data, state, x, slope[k]) for k, x in enumerate(names)])
    normal[~free], normal[:, ~free], slope[~free] = 0.0, 0.0, 0.0
    scale = np.maximum(np.diag(normal), 1e-300)
    while damping < MOST_DAMPING:
        trial = _move(data, state, names, _solve(normal, slope, damping * scale))
        found = _errors(data, trial)
        if found[0] <= sse:
            return trial, found, max(damping / 10.0, 1e-9)
        damping *= 5.0
    return None


def _fit_at(data: Data, state: State, errors: Errors) -> Fit:
    sse, residuals, jacobian, saturated = errors
    used = data.y[state.first : data.last]
    count = len(residuals)
    if data.used is not None:
        some = data.used[state.first : data.last]
        used, count = used[some], int(some.sum())
    return Fit(
        state=state,
        sse=sse,
        count=count,
        jacobian=jacobian,
        residuals=residuals,
        spread=float(np.sum((used - used.mean()) ** 2)),
        saturated_time=saturated,
        at_edge=_edges(data, state),
        delays=data.delays,
        period=data.period if repeats(residuals, data.period) else 0,
    )


def best(data: Data, starts: Sequence[State]) -> Fit:
    """Fit from several starts, and return the fit with the smallest errors."""
    return min((fit(data, x) for x in starts), key=lambda x: x.sse)


def _errors(data: Data, state: State) -> Errors:
    """Errors of the simulated positions, with derivatives; an infinite sum if not finite."""
    out, seen = simulated(data, state, COLUMNS)
    residuals = data.y[state.first : data.last] - out[0] - (state.offset or 0.0)
    names = state.free
    jacobian = np.ones((len(names), len(residuals)))
    for k, name in enumerate(names):
        if name != "offset":
            scale = getattr(state, name) if name in _LOGARITHMIC else 1.0
            np.multiply(out[1 + NAMES.index(name)], scale, out=jacobian[k])
    if data.used is not None:
        unused = ~data.used[state.first : data.last]
        residuals[unused], jacobian[:, unused] = 0.0, 0.0
    sse = float(np.sum(residuals * residuals))
    return (sse if math.isfinite(sse) else math.inf), residuals, jacobian, float(seen[1])


def _solve(normal: FloatArray, slope: FloatArray, damping: FloatArray) -> FloatArray:
    """Solve the damped normal equations, scaled to a unit diagonal for a good condition number."""
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    matrix = normal / np.outer(scale, scale) + np.diag(damping / scale**2)
    return np.asarray(np.linalg.lstsq(matrix, slope / scale, rcond=None)[0] / scale)


def _move(data: Data, state: State, names: tuple[str, ...], step: FloatArray) -> State:
    """Apply a step within the search ranges; `_edges` names the parameters at their edges."""
    new: dict[str, Any] = {}
    for name, change in zip(names, step.tolist(), strict=True):
        value = getattr(state, name)
        if name in _LOGARITHMIC:
            most = math.log(LARGEST_FACTOR)
            low, high = _bounds(data, name)
            new[name] = min(max(value * math.exp(min(max(change, -most), most)), low), high)
        elif name in ("delay", "feed"):
            low, high = _bounds(data, name)
            new[name] = min(max(value + change, low), high)
        else:
            new[name] = value + change
    return replace(state, **new)


def _moves(data: Data, state: State, name: str, slope: float) -> bool:
    """Whether a parameter can move in the direction of smaller errors within its search range."""
    if name not in _BOUNDED:
        return True
    low, high = _bounds(data, name)
    value = getattr(state, name)
    return not ((value <= low and slope < 0) or (value >= high and slope > 0))


def _bounds(data: Data, name: str) -> tuple[float, float]:
    return {"delay": data.delays, "limit": LIMITS, "feed": FEEDS}.get(name, GAINS)


def _edges(data: Data, state: State) -> tuple[str, ...]:
    return tuple(
        name
        for name in state.free
        if name in _BOUNDED and getattr(state, name) in _bounds(data, name)
    )


def noise_of(y: npt.ArrayLike) -> float:
    """Standard deviation of white noise on a smooth motion, from its third differences."""
    third = np.diff(np.asarray(y, dtype=np.float64), n=3)
    return float(np.sqrt(np.mean(third**2) / 20)) if len(third) else 0.0
