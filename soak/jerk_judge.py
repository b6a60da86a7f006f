"""Judges plans with limits of jerk along joint paths, by formulas of its own."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from unittest import mock

import numpy as np

import armcontour as ac
from armcontour.timing.jerk import limiting
from soak.jerk_problems import Problem, draw

LEAK = 1e-9
# Places in every interval of a law, its ends among them.
PLACES = 11
# What may jump where intervals meet, as a share of the largest value.
STEP = 1e-9
# A bend q'' jumps where its jump is this share of its largest value there.
BEND = 1e-6
# Means of the jerk over samples; those that rounding spoils by more than NOISE are not judged.
RATES, SLACK, NOISE = (1000.0, 8000.0), 5e-3, 2e-3
MOST_SAMPLES = 40_000
MOST_ITERATIONS = 150
# Places between which starts elsewhere change evenly.
BENDS = 12
ORDERS = ("velocity", "acceleration", "jerk")
GAUSS, WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What came of a seed.

    Args:
        seed: The seed.
        kind: What is special about its problem.
        result: "planned", "refused", "wrong" or "crash".
        notes: What is wrong.
        worst: The largest ratio to a limit.
        iterations: The most that any search for the fastest motion took.
        seconds: Time it took.
    """

    seed: int
    kind: str
    result: str
    notes: list[str] = field(default_factory=list)
    worst: float = 0.0
    iterations: int = 0
    seconds: float = 0.0

    @property
    def failed(self) -> bool:
        """Whether this must not happen."""
        return self.result in ("wrong", "crash")


def run(seed: int) -> Outcome:
    """Draw, plan and judge the problem of a seed; warnings count as crashes."""
    begun = time.perf_counter()
    problem = draw(seed)
    worst = 0.0
    with warnings.catch_warnings(), counted() as iterations:
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "Limits of jerk add")
        try:
            result, notes, worst = _answer(problem)
        except Exception as error:  # noqa: BLE001 - every crash is a finding
            result, notes = "crash", [f"{type(error).__name__}: {error}"]
    most = max(iterations, default=0)
    if most >= MOST_ITERATIONS:
        result, notes = "wrong", [*notes, f"{most} iterations"]
    return Outcome(
        seed=seed,
        kind=problem.kind,
        result=result,
        notes=notes,
        worst=worst,
        iterations=most,
        seconds=time.perf_counter() - begun,
    )


@contextmanager
def counted() -> Iterator[list[int]]:
    """A list that gets the iterations of every search for the fastest motion."""
    found: list[int] = []
    improve = limiting.improve

    def counting(p, d, goal, *rest):  # noqa: ANN001, ANN002, ANN202
        taken = improve(p, d, goal, *rest)
        if goal == limiting.DURATION:
            found.append(taken)
        return taken

    with mock.patch.object(limiting, "improve", counting):
        yield found


@contextmanager
def interrupted(iterations: int) -> Iterator[None]:
    """Every search for the fastest motion ends after so many iterations."""
    limit_jerk = limiting.limit_jerk

    def short(law, task):  # noqa: ANN001, ANN202
        return limit_jerk(law, replace(task, iterations=iterations))

    with mock.patch.object(limiting, "limit_jerk", short):
        yield


@contextmanager
def started(rng: np.random.Generator) -> Iterator[None]:
    """Every search for the fastest motion from rest to rest starts somewhere else."""
    start = limiting._start

    def elsewhere(p, *rest):  # noqa: ANN001, ANN002, ANN202
        d = start(p, *rest)
        bends = np.linspace(0, len(d) - 1, BENDS)
        d = d * np.exp(
            rng.uniform(-3, 0) + np.interp(np.arange(len(d)), bends, rng.normal(0, 1, BENDS))
        )
        while limiting.least_slack(p, d) <= limiting.CLEAR:
            d = d / 2
        return d

    with mock.patch.object(limiting, "_start", elsewhere):
        yield


def _answer(problem: Problem) -> tuple[str, list[str], float]:
    options, refused = dict(problem.options), False
    # Each end's speed may be refused once, and what is then said to be allowed can be had.
    for _ in range(3):
        try:
            planned = ac.plan(problem.path, limits=problem.limits, **options)
        except ac.NotRealizable as error:
            name = (error.limit or "").replace(" ", "_")
            if not options.get(name) or not error.allowed < options[name]:
                return "wrong", [f"refused: {error}"], 0.0
            options[name], refused = error.allowed, True
            continue
        ends = options.get("start_speed", 0.0), options.get("end_speed", 0.0)
        notes, worst = judge(planned, problem.limits, ends)
        return "wrong" if notes else "refused" if refused else "planned", notes, worst
    return "wrong", ["what was said to be allowed was refused too"], 0.0


def judge(
    planned: ac.Trajectory, limits: ac.Limits, ends: tuple[float, float] = (0.0, 0.0)
) -> tuple[list[str], float]:
    """What is wrong with a plan of one law along a joint path, and its largest ratio to a limit."""
    (law,) = planned.laws
    sampled = Sampled(law)
    notes = sampled.joins(limits, ends)
    worst = 0.0
    for name, (ratio, unit) in ratios(sampled, limits).items():
        k = np.unravel_index(int(np.argmax(np.nan_to_num(ratio, nan=np.inf))), ratio.shape)
        worst = max(worst, float(ratio[k]))
        if not ratio[k] <= 1 + LEAK:
            notes.append(
                f"{name}{unit[k]} 1 {ratio[k] - 1:+.2e} in interval {k[0]} of {len(ratio)}"
            )
    return notes + differences(planned, limits), worst


class Sampled:
    """A law at places of every interval: `s` and its derivatives, (n, k), and those of q.

    Args:
        law: A `PathLaw`.
        places: How many places of every interval.
    """

    def __init__(self, law: ac.PathLaw, places: int = PLACES) -> None:
        self.law, self.path = law, law.joint_path
        self.width, self.times = np.diff(law.s), np.diff(law.breaks)
        ds, dds, slope, jerk = (x[:, None] for x in law.rates)
        share = np.linspace(0, 1, places)
        # With dds linear in s, ds² is a quadratic in s.
        x = share * self.width[:, None]
        square = ds**2 + x * (2 * dds + slope * x)
        self.lowest = np.where(jerk[:, 0] == 0, square.min(axis=1), 0.0)
        speed = np.sqrt(np.maximum(square, 0.0))
        along = (x, speed, dds + slope * x, slope * speed)
        # With uniform jerk, s is a cubic in time.
        u = share * self.times[:, None]
        over = (
            u * (ds + u * (dds / 2 + u * jerk / 6)),
            ds + u * (dds + u * jerk / 2),
            dds + u * jerk,
            jerk + 0 * u,
        )
        even = jerk != 0
        self.x, *self.motion = (np.where(even, b, a) for a, b in zip(along, over, strict=True))
        middle = (law.s[1:] + law.s[:-1]) / 2
        self.piece = np.searchsorted(self.path.breaks, middle, side="right") - 1
        self.piece = np.clip(self.piece, 0, len(self.path.breaks) - 2)

    def slopes(self) -> list[np.ndarray]:
        """Q and its first three derivatives by s, (n, k, dof) each."""
        start = self.law.s[:-1] - self.path.breaks[self.piece]
        wide = np.diff(self.path.breaks)[self.piece][:, None]
        share = (start[:, None] + self.x) / wide
        c = self.path.coefficients[self.piece][:, :, None]
        found = []
        for order in range(4):
            factors = [np.prod(np.arange(k - order + 1.0, k + 1.0)) for k in range(6)]
            powers = sum(
                factors[k] * share[..., None] ** (k - order) * c[:, k] for k in range(order, 6)
            )
            found.append(powers / wide[..., None] ** order)
        return found

    def joints(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocity, acceleration and jerk of the joints, (n, k, dof) each."""
        _, q1, q2, q3 = self.slopes()
        ds, dds, ddds = (x[..., None] for x in self.motion)
        return q1 * ds, q2 * ds**2 + q1 * dds, q3 * ds**3 + 3 * q2 * ds * dds + q1 * ddds

    def joins(self, limits: ac.Limits, ends: tuple[float, float]) -> list[str]:
        """What is wrong where intervals meet, and at both ends."""
        law, notes = self.law, []
        if not np.isin(self.path.breaks, law.s).all():
            notes.append("a break of the path is no break of the law")
        if law.s[0] != self.path.breaks[0] or law.s[-1] != self.path.breaks[-1]:
            notes.append("s does not run from start to end")
        if not (self.width > 0).all() or not (self.times > 0).all():
            notes.append("runs back")
        ds, dds, _ = self.motion
        if (self.lowest < -STEP * (ds**2).max()).any() or (ds < -STEP * ds.max()).any():
            notes.append("ds is below zero")
        for name, x, allowed in (("ds", ds, STEP), ("dds", dds, STEP)):
            jump = np.abs(x[1:, 0] - x[:-1, -1])
            if jump.max(initial=0.0) > allowed * np.abs(x).max():
                k = int(np.argmax(jump)) + 1
                share = jump.max() / np.abs(x).max()
                notes.append(f"{name} jumps by {share:.1e} of its largest at break {k}")
        joints = self.joints()
        for name, at, asked in (("start", (0, 0), ends[0]), ("end", (-1, -1), ends[1])):
            if asked:
                if abs(ds[at] - asked) > STEP * ds.max():
                    notes.append(f"the {name} speed is {ds[at]:.6g}, not {asked:.6g}")
                continue
            for what, values in zip(ORDERS[:2], joints, strict=False):
                share = np.abs(values[at]).max() / np.abs(values).max()
                if share > STEP:
                    notes.append(f"{what} at the {name} is {share:.1e} of its largest, not 0")
        notes += self._durations()
        return notes + self._bends(limits, joints[1])

    def _durations(self) -> list[str]:
        """Intervals that take another time than the integral of 1 / ds, or miss their ends."""
        law = self.law
        ds, dds, slope, jerk = law.rates
        x = (GAUSS + 1) / 2 * self.width[:, None]
        square = ds[:, None] ** 2 + x * (2 * dds[:, None] + slope[:, None] * x)
        with np.errstate(invalid="ignore", divide="ignore"):
            taken = self.width * (WEIGHTS / 2 / np.sqrt(square)).sum(axis=1)
        notes = []
        off = np.abs(taken - self.times) / law.breaks[-1]
        off[jerk != 0] = np.abs(self.x[:, -1] - self.width)[jerk != 0] / self.path.length
        # A quadrature is exact enough where ds does not change much.
        smooth = (self.motion[0].max(axis=1) < 2 * self.motion[0].min(axis=1)) | (jerk != 0)
        k = int(np.argmax(np.where(smooth, off, 0.0)))
        if not off[k] <= 1e-11:
            notes.append(f"interval {k} takes a wrong time or way: {off[k]:.1e} of the whole")
        return notes

    def _bends(self, limits: ac.Limits, acceleration: np.ndarray) -> list[str]:
        """Places at which the acceleration jumps: it has to stop where the path bends."""
        jump = np.abs(acceleration[1:, 0] - acceleration[:-1, -1])
        scale = np.abs(acceleration).max(axis=(0, 1))
        if limits.joint_acceleration is not None:
            scale = np.maximum(scale, np.broadcast_to(limits.joint_acceleration, scale.shape))
        share = jump / np.where(scale > 0, scale, 1.0)
        if limits.joint_jerk is not None:
            share = share[:, np.isfinite(np.broadcast_to(limits.joint_jerk, scale.shape))]
        if not share.size or share.max() <= BEND:
            return []
        k, j = np.unravel_index(int(np.argmax(share)), share.shape)
        return [f"acceleration {j + 1} jumps by {share[k, j]:.1e} of its largest at break {k + 1}"]


def ratios(sampled: Sampled, limits: ac.Limits) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Ratios to limits of the joints and of the path's jerk, (n, k), and the joints they are of."""
    found = {}
    for name, values in zip(ORDERS, sampled.joints(), strict=True):
        most = getattr(limits, f"joint_{name}")
        if most is None:
            continue
        ratio = np.abs(values) / most
        if name == "acceleration":
            low, high = limits.acceleration_bounds(values.shape[-1])
            ratio = np.maximum(values / low, values / high)
        found[name] = ratio.max(axis=-1), ratio.argmax(axis=-1) + 1
    if limits.path_jerk is not None:
        ratio = np.abs(sampled.motion[2]) / limits.path_jerk
        found["path jerk"] = ratio, np.zeros(ratio.shape, dtype=int)
    return found


def differences(planned: ac.Trajectory, limits: ac.Limits) -> list[str]:
    """What third differences of sampled positions say of the jerk: their means over samples."""
    if limits.joint_jerk is None:
        return []
    notes = []
    size = np.abs(planned(np.linspace(0, planned.duration, 200))).max(axis=0)
    fastest = np.abs(planned(np.linspace(0, planned.duration, 200), 1)).max(axis=0)
    for rate in RATES:
        # In the units that a problem has, a second may be long or short.
        h = max(1 / rate, planned.duration / MOST_SAMPLES)
        t = np.arange(0, planned.duration, h)
        if len(t) < 4:
            continue
        third = np.abs(np.diff(planned(t), 3, axis=0)).max(axis=0) / h**3
        rounding = 8 * np.finfo(float).eps * (size + fastest * planned.duration) / h**3
        noise = rounding / limits.joint_jerk
        ratio = third / limits.joint_jerk
        judged = noise <= NOISE
        if judged.any() and not (ratio[judged] <= 1 + SLACK).all():
            j = int(np.argmax(np.where(judged, ratio, 0.0)))
            notes.append(f"third differences of joint {j + 1} at {1 / h:g} Hz: {ratio[j]:.5f}")
    return notes
