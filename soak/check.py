"""Verdicts of `check` on random printed trajectories that violate a limit or keep all limits.

The oracle proves violations by interval arithmetic: a printed number stands for the interval of
half its last digit to either side. Between two samples, any motion through values in these
intervals has the chord's mean velocity. Over three samples, its mean acceleration is twice the
difference of two chord velocities divided by their total time. `check` must never say "kept" if
samples prove a violation, and never "violated" if they do not prove one or the motion keeps all
limits.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from functools import cache

import numpy as np

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_trajectory
from soak import Outcome

# A violation is proven above the limit by this fraction, and not proven below the limit by this
# fraction. Between them rounding errors decide.
HAIR = 1e-6
# Joint motion that determines the direction of the tool [rad].
SMALL = 1e-5


@dataclass(frozen=True)
class Interval:
    """Numbers that are known from `low` to `high`."""

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def around(cls, value, half):
        """Return the interval of numbers that differ by `half` at most."""
        return cls(value - half, value + half)

    def __sub__(self, other):
        return Interval(self.low - other.high, self.high - other.low)

    def __mul__(self, other):
        ends = [x * y for x in (self.low, self.high) for y in (other.low, other.high)]
        return Interval(np.minimum.reduce(ends), np.maximum.reduce(ends))

    def __truediv__(self, other):
        """Divided by what is above zero; where that may be zero, nothing is known."""
        good = other.low > 0
        safe = np.where(good, other.low, 1.0), np.where(good, other.high, 1.0)
        quotient = self * Interval(1 / safe[1], 1 / safe[0])
        return Interval(
            np.where(good, quotient.low, -np.inf), np.where(good, quotient.high, np.inf)
        )

    def __getitem__(self, rows):
        return Interval(self.low[rows], self.high[rows])

    @property
    def least(self):
        """The smallest amount that a number may have."""
        return np.maximum(np.maximum(self.low, -self.high), 0.0)


@dataclass(frozen=True)
class Log:
    """Printed samples: t (n, 1), q, dq, ddq (n, dof) as intervals; dq, ddq may be missing."""

    t: Interval
    q: Interval
    dq: Interval | None = None
    ddq: Interval | None = None

    def __len__(self):
        return len(self.t.low)


def proven_velocity(log):
    """Return each joint's largest velocity that the samples prove [rad/s]."""
    best = np.zeros(log.q.low.shape[1])
    if log.dq is not None:
        best = log.dq.least.max(axis=0)
    return np.maximum(best, _chords(log, log.q).least.max(axis=0))


def proven_acceleration(log):
    """Return each joint's largest acceleration that the samples prove [rad/s²]."""
    best = np.zeros(log.q.low.shape[1])
    if log.ddq is not None:
        best = log.ddq.least.max(axis=0)
    span = log.t[slice(1, None)] - log.t[slice(None, -1)]
    bounds = []
    if log.dq is not None:
        bounds.append(_chords(log, log.dq))
        step = log.q[slice(1, None)] - log.q[slice(None, -1)]
        half = Interval(span.low**2 / 2, span.high**2 / 2)
        half = Interval(np.where(span.low > 0, half.low, 0.0), half.high)
        for v in (log.dq[slice(None, -1)], log.dq[slice(1, None)]):
            bounds.append((step - v * span) / half)
    else:
        chords = _chords(log, log.q)
        span = log.t[slice(2, None)] - log.t[slice(None, -2)]
        change = chords[slice(1, None)] - chords[slice(None, -1)]
        bounds.append(change / Interval(span.low / 2, span.high / 2))
    for x in bounds:
        best = np.maximum(best, np.nan_to_num(x.least, nan=0.0).max(axis=0))
    return best


def proven_position(log):
    """Return each joint's largest absolute position that the samples prove [rad]."""
    return log.q.least.max(axis=0)


def proven_speed(log, forward, reach):
    """Return the smallest and the largest tool speed that the samples may prove [m/s].

    `forward` gives the tool's points (n, dimension), `reach` how far a joint may be from the tool.
    The first number is proven, as a joint that is off by an angle moves the tool by no more than
    the angle times the reach. The second is what exact numbers would prove.
    """
    middle = (log.q.low + log.q.high) / 2
    errors = ((log.q.high - log.q.low) / 2 * reach).sum(axis=1)
    points = forward(middle)
    span = log.t[slice(1, None)] - log.t[slice(None, -1)]
    length = np.linalg.norm(points[1:] - points[:-1], axis=1)
    lower_bounds = np.maximum(length - errors[1:] - errors[:-1], 0.0)
    low = float((lower_bounds / span.high[:, 0]).max())
    high = float((length / np.maximum(span.low[:, 0], 1e-300)).max())
    if log.dq is not None:
        speed, errors = _sample_speeds(log, middle, forward, reach)
        low = max(low, float((speed - errors).max()))
        high = max(high, float(speed.max()))
    return low, high


def _sample_speeds(log, q, forward, reach):
    """Return the tool speeds at the samples, and a bound on their errors [m/s], (n,)."""
    dq = (log.dq.low + log.dq.high) / 2
    # Steps of equal length in joint positions, independent of the velocities.
    step = SMALL / np.maximum(np.abs(dq).max(axis=1), 1e-12)[:, None]
    speed = np.linalg.norm(forward(q + dq * step) - forward(q - dq * step), axis=1)
    angle = ((log.q.high - log.q.low) / 2).sum(axis=1)
    # An error of a joint turns the tool's velocity, and moves the axes of the later joints.
    uncertainty = ((log.dq.high - log.dq.low) / 2 * reach).sum(axis=1)
    uncertainty += (
        2 * angle * (np.maximum(np.abs(log.dq.low), np.abs(log.dq.high)) * reach.max()).sum(axis=1)
    )
    return speed / (2 * step[:, 0]), uncertainty


def _chords(log, y):
    step = y[slice(1, None)] - y[slice(None, -1)]
    return step / (log.t[slice(1, None)] - log.t[slice(None, -1)])


def pmk3s(q):
    """Return tool points of the paper's arm, (1) [m]."""
    first = q[:, 0]
    both = q[:, 0] + q[:, 1]
    x = 0.135 + 0.250 * np.sin(first) + 0.215 * np.sin(both)
    return np.column_stack([x, 0.250 * np.cos(first) + 0.215 * np.cos(both)])


def ur5e(q):
    """Return flange points of a UR5e, from the manufacturer's Denavit-Hartenberg parameters [m]."""
    a = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)
    d = (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)
    alpha = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
    frame = np.tile(np.eye(4), (len(q), 1, 1))
    for j in range(6):
        c = np.cos(q[:, j])
        s = np.sin(q[:, j])
        ca = np.cos(alpha[j])
        sa = np.sin(alpha[j])
        link = np.zeros((len(q), 4, 4))
        link[:, 0] = np.column_stack([c, -s * ca, s * sa, a[j] * c])
        link[:, 1] = np.column_stack([s, c * ca, -c * sa, a[j] * s])
        link[:, 2] = [0.0, sa, ca, d[j]]
        link[:, 3, 3] = 1.0
        frame = frame @ link
    return frame[:, :3, 3]


# Limits that are drawn.
LIMITS = ("joint_velocity", "joint_acceleration", "joint_upper", "speed")
# Smallest ratio of a violation to its limit: the digits of a file can hide smaller ones.
LEAST = 1.01
# Largest ratio of a violation to its limit.
MOST = 1e6
# Numbers that are impossible for joints and clocks.
WILD = ("1e308", "-1e308", "1e200", "-1e30", "9e9", "1e-308", "5e-324", "1e999", "-0.0")
# How far each joint's axis may be from the tool [m]: all links stretched.
REACH = {"pmk3s": np.array([0.465, 0.215]), "ur5e": np.array([1.1, 1.1, 0.7, 0.35, 0.2, 0.1])}
FORWARD = {"pmk3s": pmk3s, "ur5e": ur5e}


@dataclass(frozen=True)
class Motion:
    """Uniform joint accelerations one after the other, so that all extremes are known exactly."""

    breaks: np.ndarray
    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray

    def __call__(self, t):
        """Return the positions, velocities and accelerations at times t."""
        i = np.clip(np.searchsorted(self.breaks, t, side="right") - 1, 0, len(self.ddq) - 1)
        u = (t - self.breaks[i])[:, None]
        dq = self.dq[i] + self.ddq[i] * u
        return self.q[i] + self.dq[i] * u + self.ddq[i] * u**2 / 2, dq, self.ddq[i]

    def extremes(self):
        """Return the times at which a position, a velocity or an acceleration may be largest."""
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = self.breaks[:-1, None] - self.dq / self.ddq
        inside = (turn > self.breaks[:-1, None]) & (turn < self.breaks[1:, None])
        return np.concatenate([self.breaks, turn[inside]])

    def largest(self, limit, forward):
        """Return the largest amount of what a limit bounds, per joint or of the tool."""
        q, dq, ddq = self(self.extremes())
        if limit == "speed":
            # The tool's speed has no closed form, so it is sampled densely and enlarged.
            t = np.linspace(self.breaks[0], self.breaks[-1], 20_001)
            points = forward(self(t)[0])
            speed = np.linalg.norm(np.diff(points, axis=0), axis=1).max() / (t[1] - t[0])
            return np.array([speed * (1 + 1e-3)])
        amount = {"joint_velocity": dq, "joint_acceleration": ddq, "joint_upper": q}[limit]
        return np.abs(amount).max(axis=0)


@dataclass(frozen=True)
class Case:
    """One printed trajectory."""

    seed: int
    arm: str
    limit: str
    allowed: np.ndarray
    kind: str
    text: str
    log: Log | None


@dataclass(frozen=True)
class Answer:
    """What was said of a case."""

    case: Case
    said: str
    proof: str
    note: str = ""

    @property
    def wrong(self):
        """Whether this must not happen."""
        blamed = self.proof == "not proven" or self.case.kind == "kept"
        return (
            self.said == "crash"
            or (self.said == "refused" and self.case.log is not None)
            or (self.said == "kept" and self.proof == "proven")
            or (self.said == "kept" and self.case.log is None)
            or (self.said == "violated" and blamed)
        )


@cache
def load(name):
    """Load a built-in arm."""
    return ac.load_arm(name)


def draw(seed, violating):
    """Draw the case of a seed."""
    rng = np.random.default_rng([seed, int(violating)])
    name = str(rng.choice(["pmk3s", "ur5e"]))
    limit = str(rng.choice(LIMITS))
    motion = _motion(rng, 2 if name == "pmk3s" else 6)
    t, printed_t, even, half = _times(rng, motion.breaks[-1])
    largest = motion.largest(limit, FORWARD[name])
    columns = dict(zip(("q", "dq", "ddq"), motion(t), strict=True))
    names = str(rng.choice(["q", "q dq", "q dq ddq"])).split()
    columns = {x: columns[x] for x in names}
    kind = "kept"
    if violating:
        kind = str(rng.choice(["scaled", "spike", "wild"], p=[0.45, 0.45, 0.1]))
    factor = float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
    # At the limit, a little below it, or far below it.
    allowed = largest * float(rng.choice([1.0, 1.001, 1.1, 10.0]))
    if kind == "scaled":
        allowed = largest / factor
    elif kind == "spike":
        _add_spike(rng, columns, t, limit, allowed, factor)
    form = str(rng.choice(["f", "g"])), int(rng.integers(3, 16))
    texts = {x: _printed(values, form) for x, values in columns.items()}
    rows = [[x] for x in printed_t]
    for part in texts.values():
        for row, cells in zip(rows, part, strict=True):
            row.extend(cells)
    if kind == "wild":
        row = rows[int(rng.integers(len(rows)))]
        row[int(rng.integers(len(row)))] = str(rng.choice(WILD))
    dof = motion.q.shape[1]
    # Far positions in a column without a unit could be degrees, so that its unit is asked for.
    units = {"q": " [rad]"}
    head = ["t"]
    for x in texts:
        head += [f"{x}{j + 1}{units.get(x, '')}" for j in range(dof)]
    return Case(
        seed=seed,
        arm=name,
        limit=limit,
        allowed=np.maximum(allowed, 1e-9),
        kind=kind,
        text="\n".join(",".join(x) for x in [head, *rows]) + "\n",
        log=_intervals(np.array(rows, dtype=float), names, form, 0.0 if even else half),
    )


def judge(case):
    """Read and check a case; warnings count as crashes."""
    note = ""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Limits of jerk add")
        try:
            arm = load(case.arm)
            samples = parse_trajectory(case.text, arm.joint_names)
            verdict = ac.check(samples, arm, _limits(case)).verdict
        except InvalidInput as error:
            verdict = "refused"
            note = str(error)
        except Exception as error:  # noqa: BLE001 - every crash is a finding
            verdict = "crash"
            note = f"{type(error).__name__}: {error}"
    return Answer(case, verdict, "open" if case.log is None else prove(case), note)


def prove(case):
    """Return whether the samples prove a violation."""
    log = case.log
    allowed = case.allowed
    if case.limit == "speed":
        low, high = proven_speed(log, FORWARD[case.arm], REACH[case.arm])
        ratios = low / allowed, high / allowed
    else:
        prove_limit = {
            "joint_velocity": proven_velocity,
            "joint_acceleration": proven_acceleration,
            "joint_upper": proven_position,
        }[case.limit]
        ratios = (prove_limit(log) / allowed,) * 2
    if np.max(ratios[0]) > 1 + HAIR:
        return "proven"
    return "not proven" if np.max(ratios[1]) <= 1 - HAIR else "open"


def _limits(case):
    if case.limit == "speed":
        return ac.Limits.only(speed=float(case.allowed[0]))
    if case.limit == "joint_upper":
        return ac.Limits.only(joint_lower=-case.allowed, joint_upper=case.allowed)
    return ac.Limits.only(**{case.limit: case.allowed})


def _motion(rng, dof):
    n = int(rng.integers(2, 12))
    h = rng.uniform(0.05, 0.4, n)
    ddq = rng.uniform(-1, 1, (n, dof)) * float(rng.choice([0.1, 1.0, 10.0]))
    ddq[rng.random((n, dof)) < 0.2] = 0.0
    q = [rng.uniform(-1.5, 1.5, dof)]
    dq = [np.zeros(dof)]
    for a, step in zip(ddq, h, strict=True):
        q.append(q[-1] + dq[-1] * step + a * step**2 / 2)
        dq.append(dq[-1] + a * step)
    breaks = np.concatenate([[0.0], np.cumsum(h)])
    return Motion(breaks, np.array(q[:-1]), np.array(dq[:-1]), ddq)


def _times(rng, end):
    """Draw times: the values, their printed form, whether regular, and half of the last digit."""
    even = bool(rng.random() < 0.5)
    if even:
        step = float(rng.choice([x for x in (0.001, 0.004, 0.01, 0.05) if 3 * x < end]))
        digits = 3
        t = np.arange(1 + int(min(end / step, 200))) * step
    else:
        digits = int(rng.integers(4, 13))
        t = np.unique(rng.uniform(0, end, int(rng.integers(10, 150))))
        t = t[np.append(True, np.diff(np.round(t, digits)) > 0.5 * 10.0**-digits)]
    return t, [f"{x:.{digits}f}" for x in t], even, 10.0**-digits / 2


def _add_spike(rng, columns, t, limit, allowed, factor):
    """Move one sample so far that, but for the rounding, the limit is exceeded by `factor`."""
    i = int(rng.integers(1, len(t) - 1))
    j = int(rng.integers(columns["q"].shape[1]))
    before = t[i] - t[i - 1]
    after = t[i + 1] - t[i]
    sign = float(rng.choice([-1.0, 1.0]))
    q = columns["q"]
    if limit == "joint_upper":
        q[i, j] = sign * factor * allowed[j]
    elif limit == "joint_velocity" and "dq" in columns and rng.random() < 0.5:
        columns["dq"][i, j] = sign * factor * allowed[j]
    elif limit == "joint_acceleration" and "ddq" in columns and rng.random() < 0.5:
        columns["ddq"][i, j] = sign * factor * allowed[j]
    elif limit == "joint_velocity":
        q[i, j] = q[i - 1, j] + sign * factor * allowed[j] * before
    elif limit == "joint_acceleration":
        chord = q[i - 1, j] + (q[i + 1, j] - q[i - 1, j]) * before / (before + after)
        q[i, j] = chord + sign * factor * allowed[j] * before * after / 2
    else:
        q[i, j] += sign * factor * allowed[0] * before


def _printed(values, form):
    kind, digits = form
    return [[f"{x:.{digits}{kind}}" for x in row] for row in values.tolist()]


def _intervals(values, names, form, shift):
    """Return intervals of printed numbers; None if no clock or joint can be so."""
    t = values[:, :1]
    dof = (values.shape[1] - 1) // len(names)
    if not (np.diff(t[:, 0]) > 1e-9).all() or not (np.abs(t) < 1e10).all():
        return None
    kind, digits = form
    columns = {}
    for k, name in enumerate(names):
        part = values[:, 1 + k * dof : 1 + (k + 1) * dof]
        if not (np.abs(part) <= {"q": 1e4, "dq": 1e9, "ddq": 1e12}[name]).all():
            return None
        error = np.full(part.shape, 10.0**-digits / 2)
        if kind == "g":
            first = np.floor(np.log10(np.where(part == 0, 1.0, np.abs(part))))
            error = np.where(part == 0, 0.0, 10.0 ** (first - digits + 1) / 2)
        columns[name] = Interval.around(part, error)
    return Log(t=Interval.around(t, shift), **columns)


def run(seed: int) -> Outcome:
    """Check and judge the trajectory of a seed; odd ones break a limit."""
    answer = judge(draw(seed, bool(seed % 2)))
    case = answer.case
    kind = f"{'breaks a limit' if seed % 2 else 'keeps all'}, {answer.proof}"
    description = f"{case.kind}, {case.arm}, {case.limit} {answer.note}"
    return Outcome(kind=kind, result=answer.said, notes=[description] if answer.wrong else [])
