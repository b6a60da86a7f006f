"""Jerk of laws with jumps, and lower bounds of the jerk of samples."""

import math
from dataclasses import dataclass
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PPoly

import armcontour as ac

ARM = ac.load_arm("pmk3s")
START = np.array([0.3, 0.9])  # rad


@dataclass
class Phases:
    """A law of somebody else: phases of uniform jerk, one after the other."""

    breaks: np.ndarray
    curve: PPoly

    @classmethod
    def of(cls, durations, jerks, *, velocity=0.0, jumps=None):
        """From a velocity of joint 1 on, whose acceleration jumps before every phase."""
        breaks = np.concatenate([[0], np.cumsum(durations)])
        terms = []
        q = START
        v = np.array([velocity, 0.0])
        a = np.zeros(2)
        for k, (h, j) in enumerate(zip(durations, np.asarray(jerks), strict=True)):
            a = a + [0.0 if jumps is None else jumps[k], 0.0]
            terms.append([j / 6, a / 2, v, q])
            q = q + h * (v + h * (a / 2 + h * j / 6))
            v = v + h * (a + h * j / 2)
            a = a + h * j
        return cls(breaks, PPoly(np.swapaxes(np.array(terms), 0, 1), breaks))

    @property
    def duration(self):
        return float(self.breaks[-1])

    def __call__(self, t, order=0, *, side="right"):
        i = np.clip(np.searchsorted(self.breaks, t, side=side) - 1, 0, len(self.breaks) - 2)
        curve = self.curve.derivative(order)
        x = (np.asarray(t) - self.breaks[i])[:, None]
        return sum(curve.c[-1 - k, i] * x**k for k in range(len(curve.c)))


# From rest to rest; joint 2 the other way at a quarter. The phases lie on no grid of samples.
UNIT = math.sqrt(0.05)  # s
JERK = 8.0  # rad/s³
SMOOTH = Phases.of([UNIT, 2 * UNIT, UNIT], [[JERK, -2.0], [-JERK, 2.0], [JERK, -2.0]])
LIMITS = ac.Limits.only(joint_jerk=[JERK, 2.0])
COLUMNS = (["q"], ["q", "dq"], ["q", "dq", "ddq"], ["q", "ddq"])


def sampled(law, t, names):
    """Samples of some columns, at given times."""
    columns = {
        name: law(t, order) for order, name in enumerate(("q", "dq", "ddq")) if name in names
    }
    return SimpleNamespace(t=t, **columns)


def times(cycle):
    return np.append(np.arange(0, SMOOTH.duration, cycle), SMOOTH.duration)


# --- laws


def test_a_smooth_law_uses_its_jerk_limit_in_full():
    check = ac.check(SMOOTH, ARM, LIMITS)
    assert check.verdict == "kept"
    use = check["joint_jerk"]
    assert (use.value, use.limit, use.ratio) == pytest.approx((JERK, JERK, 1), abs=1e-12)
    assert check["acceleration_step"].value < 1e-12
    tight = ac.check(SMOOTH, ARM, ac.Limits.only(joint_jerk=[np.inf, 1.9]))
    assert [(x.name, x.joint) for x in tight.violations] == [("joint_jerk", 1)]


def test_a_jump_of_acceleration_is_reported_with_its_position():
    for durations, velocity, jumps, place in (
        ([1.0], 0.0, [0.5], 0.0),  # from rest
        ([1.0], 0.5, [-0.5], 1.0),  # to rest; the motion before is unknown
        ([0.4, 0.6], 0.0, [0.0, 0.5], 0.4),
    ):
        law = Phases.of(durations, np.zeros((len(durations), 2)), velocity=velocity, jumps=jumps)
        check = ac.check(law, ARM, LIMITS)
        use = check["acceleration_step"]
        assert check.verdict == "violated" and check["joint_jerk"].ratio == 0
        assert (use.value, use.t, use.joint) == pytest.approx((0.5, place, 0))


def test_laws_that_start_in_motion_or_jump_are_checked_for_jerk():
    def part(t, order=0, *, side="right"):
        return SMOOTH(t, order, side=side)

    part.breaks = SMOOTH.breaks[1:-1]
    part.duration = 0.0
    assert np.abs(part(part.breaks, 2)).min() > 0.4
    assert ac.check(part, ARM, LIMITS).verdict == "kept"
    path = ac.JointPath.spline([START, START + [0.5, -0.2]])
    planned = ac.plan(path, ARM, ac.Limits.only(joint_acceleration=2.0))
    use = ac.check(planned, ARM, ac.Limits.only(joint_jerk=[np.inf, 5.0]))["acceleration_step"]
    # From 0.8 to -0.8 in the middle.
    assert (use.value, use.joint, use.t) == pytest.approx((1.6, 1, planned.duration / 2))

    class Older(Phases):
        def __call__(self, t, order=0, *, side="right"):
            if order > 2:
                raise ValueError("The order is 0, 1 or 2.")
            return super().__call__(t, order, side=side)

    law = Older(SMOOTH.breaks, SMOOTH.curve)
    check = ac.check(law, ARM, LIMITS)
    assert check.not_judged == ("joint_jerk",)
    # Nothing that is judged is violated, but a specified limit is not judged.
    assert check.verdict == "cannot tell" and check.missing == check.not_judged


# --- samples


def test_samples_of_a_motion_within_its_limits_are_never_violations():
    tight = ac.Limits.only(joint_jerk=np.array([JERK, 2.0]) / 1.001)
    for names, cycle in product(COLUMNS, (4e-3, 0.0613)):
        log = sampled(SMOOTH, times(cycle), names)
        check = ac.check(log, ARM, LIMITS)
        assert check.verdict == "kept", (names, cycle, check.worst)
        assert check["joint_jerk"].ratio == pytest.approx(1, abs=1e-6)
        check = ac.check(log, ARM, tight)
        assert check.violated and check["joint_jerk"].certain == pytest.approx(1.001, abs=1e-6)


def test_rounded_samples_are_tolerated_and_few_samples_prove_no_violation():
    log = sampled(SMOOTH, times(1e-3), ["q"])
    log.q = np.round(log.q, 6)
    log.resolution = {"q": 1e-6}
    check = ac.check(log, ARM, LIMITS)
    # Six decimals at 1 ms are 4000 rad/s³, so the computed jerk is far above the limit.
    assert check.verdict == "cannot tell" and check["joint_jerk"].highest.ratio > 10
    assert ac.check(log, ARM, LIMITS, resolution={"q": 0.0}).violated
    log = SimpleNamespace(t=[0.0, 1.0], q=[[0.3, 0.9], [0.4, 0.9]], dq=np.zeros((2, 2)))
    check = ac.check(log, ARM, ac.Limits.only(joint_jerk=1.0))["joint_jerk"]
    assert (check.value, check.joint, check.t) == pytest.approx((1.2, 0, 0.5))
    assert check.verdict == "violated"
    q = np.zeros((3, 2)) + START
    check = ac.check(SimpleNamespace(t=[0.0, 1.0, 2.0], q=q), ARM, LIMITS)
    assert check.not_judged == ("joint_jerk",)


@given(
    durations=st.lists(st.floats(0.02, 0.5), min_size=2, max_size=6),
    seed=st.integers(0, 9999),
    digits=st.integers(3, 9),
    names=st.sampled_from(COLUMNS),
    clock=st.sampled_from([None, 1e-5]),
)
def test_no_jerk_violation_is_reported_for_valid_motions(durations, seed, digits, names, clock):
    random = np.random.default_rng(seed)
    law = Phases.of(durations, random.uniform(-1, 1, (len(durations), 2)) * [JERK, 2.0])
    t = np.unique(np.append(random.uniform(0, law.duration, 60), [0, law.duration]))
    t = t[np.append(True, np.diff(t) > 1e-4)]
    log = sampled(law, t, names)
    for name in names:
        setattr(log, name, np.round(getattr(log, name), digits))
    log.resolution = dict.fromkeys(names, 10.0**-digits)
    if clock is not None:
        log.t = np.round(t, 5)
        log.resolution["t"] = clock
    check = ac.check(log, ARM, LIMITS)
    assert not check.violated, check.worst
