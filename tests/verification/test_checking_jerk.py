"""Jerk judged: of laws and their jumps, and of samples by what every motion through them needs."""

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
from armcontour.motion import Method, PathLaw, Rates

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
        breaks, terms = np.concatenate([[0], np.cumsum(durations)]), []
        q, v, a = START, np.array([velocity, 0.0]), np.zeros(2)
        for k, (h, j) in enumerate(zip(durations, np.asarray(jerks), strict=True)):
            a = a + [0.0 if jumps is None else jumps[k], 0.0]
            terms.append([j / 6, a / 2, v, q])
            q, v, a = q + h * (v + h * (a / 2 + h * j / 6)), v + h * (a + h * j / 2), a + h * j
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


def test_a_law_that_is_smooth_uses_its_limit_in_full():
    check = ac.check(SMOOTH, ARM, LIMITS.replace(tool_jerk=1e3))
    assert check.verdict == "kept"
    use = check["joint_jerk"]
    assert (use.value, use.limit, use.ratio) == pytest.approx((JERK, JERK, 1), abs=1e-12)
    assert check["acceleration_step"].value < 1e-12
    q, dq, ddq, dddq = (
        SMOOTH(np.linspace(0, 1e-9 + SMOOTH.duration / 4, 500), k) for k in range(4)
    )
    peak = np.linalg.norm(ARM.tool_jerk(q, dq, ddq, dddq), axis=1).max()
    assert check["tool_jerk"].value >= peak * (1 - 1e-3)
    tight = ac.check(SMOOTH, ARM, ac.Limits.only(joint_jerk=[np.inf, 1.9]))
    assert [(x.name, x.joint) for x in tight.violations] == [("joint_jerk", 1)]


def test_a_jump_of_acceleration_is_found_with_its_place():
    for durations, velocity, jumps, place in (
        ([1.0], 0.0, [0.5], 0.0),  # from rest
        ([1.0], 0.5, [-0.5], 1.0),  # to rest; nobody knows what was before
        ([0.4, 0.6], 0.0, [0.0, 0.5], 0.4),
    ):
        law = Phases.of(durations, np.zeros((len(durations), 2)), velocity=velocity, jumps=jumps)
        check = ac.check(law, ARM, LIMITS.replace(tool_jerk=1e3))
        use, tool = check["acceleration_step"], check["tool_acceleration_step"]
        assert check.verdict == "violated" and check["joint_jerk"].ratio == 0
        assert (use.value, use.t, use.joint) == pytest.approx((0.5, place, 0))
        q = law(np.array([place]))
        jump = ARM.tool_acceleration(q, 0 * q, np.array([[0.5, 0.0]]))
        assert (tool.value, tool.t) == pytest.approx((np.linalg.norm(jump), place))


def test_laws_that_start_in_motion_jump_or_have_no_third_derivative():
    def part(t, order=0, *, side="right"):
        return SMOOTH(t, order, side=side)

    part.breaks, part.duration = SMOOTH.breaks[1:-1], 0.0
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
    limits = LIMITS.replace(path_jerk=1.0, tool_jerk=1.0)
    check = ac.check(law, ARM, limits)
    assert check.not_judged == ("joint_jerk", "tool_jerk", "path_jerk")
    # Nothing that is judged is violated, but three specified limits are not judged.
    assert check.verdict == "cannot tell" and check.missing == check.not_judged


def test_path_jerk_is_judged_of_laws_along_a_path():
    center = np.array([0.135, 0.0])  # m, the first joint
    point = ARM.tool_position(START)
    path = ac.Path.from_segments([ac.Arc(start=point, center=center, angle=-1.0)])
    radius = float(np.hypot(*(point - center)))
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 0], coefficients[0, 1] = START, [1.0, 0.0]
    joint_path = ac.JointPath(
        breaks=np.array([0.0, path.length]), coefficients=coefficients, tool_path=path
    )
    # Uniform jerk to and fro: from rest to its largest acceleration, half a wave, and to rest.
    ramp, jerk = 0.2, 5.0
    speed, peak = jerk * ramp**2 / 2, jerk * ramp
    width = path.length - jerk * ramp**3 / 6 - (speed * ramp - jerk * ramp**3 / 3)
    slope = 2 * peak / width
    wave = 2 * math.atan(peak / (speed * math.sqrt(slope))) / math.sqrt(slope)
    law = PathLaw(
        joint_path=joint_path,
        breaks=np.cumsum([0.0, ramp, wave, ramp]),
        s=np.array([0.0, jerk * ramp**3 / 6, jerk * ramp**3 / 6 + width, path.length]),
        rates=Rates(
            ds=np.array([0.0, speed, speed]),
            dds=np.array([0.0, peak, -peak]),
            slope=np.array([0.0, -slope, 0.0]),
            jerk=np.array([jerk, 0.0, jerk]),
        ),
    )
    planned = ac.Trajectory(laws=(law,), method=Method.OPTIMAL, path=path)
    most_of_all = max(jerk, slope * math.sqrt(speed**2 + peak**2 / slope))
    limits = ac.Limits.only(path_jerk=most_of_all, tool_jerk=1e3, joint_jerk=most_of_all / radius)
    check = ac.check(planned, ARM, limits, path, deviation=1e-9)
    assert check.verdict == "kept" and not check.not_judged
    for name in ("path_jerk", "joint_jerk"):
        assert check[name].ratio == pytest.approx(1, abs=1e-3)
    assert check["path_acceleration_step"].value < 1e-9
    # On a circle the tool has more than the jerk along it.
    t = np.linspace(0, planned.duration, 2001)
    ds, dds, jerks = (planned.s(t, order) for order in (1, 2, 3))
    tool = np.hypot(jerks - ds**3 / radius**2, 3 * ds * dds / radius)
    assert check["tool_jerk"].value == pytest.approx(tool.max(), rel=1e-3)
    tight = ac.check(planned, ARM, ac.Limits.only(path_jerk=0.99 * most_of_all))
    assert [x.name for x in tight.violations] == ["path_jerk"]
    # Samples have no arc length.
    check = ac.check(planned.sample(4e-3), ARM, ac.Limits.only(path_jerk=1.0, joint_jerk=1e3), path)
    assert check.not_judged == ("path_jerk",)


def test_contours_of_a_program_are_judged_one_by_one():
    square = ac.Path.polyline([[0.3, 0.1], [0.36, 0.1], [0.36, 0.14]])
    other = ac.Path.polyline([[0.3, 0.2], [0.35, 0.2]])
    program = ac.Program(moves=(ac.Contour(path=square), ac.Contour(path=other)))
    planned = ac.plan(program, ARM, ARM.limits.replace(speed=0.1))
    limits = ac.Limits.only(path_jerk=50.0, tool_jerk=50.0, joint_jerk=50.0)
    check = ac.check(planned, ARM, limits, program, points=3)
    assert not check.not_judged
    starts = [x.t[0] for x in planned.contour_spans]
    step = check["path_acceleration_step"]
    assert check.verdict == "violated" and step.t >= starts[0]
    # The whole motion starts and ends at rest, and jumps there too.
    assert check["acceleration_step"].ratio > 100


# --- samples


def test_samples_of_a_motion_that_keeps_its_limits_are_never_blamed():
    tight = ac.Limits.only(joint_jerk=np.array([JERK, 2.0]) / 1.001)
    for names, cycle in product(COLUMNS, (4e-3, 0.0613)):
        log = sampled(SMOOTH, times(cycle), names)
        check = ac.check(log, ARM, LIMITS)
        assert check.verdict == "kept", (names, cycle, check.worst)
        assert check["joint_jerk"].ratio == pytest.approx(1, abs=1e-6)
        check = ac.check(log, ARM, tight)
        assert check.violated and check["joint_jerk"].certain == pytest.approx(1.001, abs=1e-6)


def test_the_tools_jerk_is_bounded_from_below():
    q, dq, ddq, dddq = (SMOOTH(np.linspace(0, SMOOTH.duration, 5001), k) for k in range(4))
    peak = np.linalg.norm(ARM.tool_jerk(q, dq, ddq, dddq), axis=1).max()
    for names in COLUMNS[:3]:
        log = sampled(SMOOTH, times(1e-3), names)
        check = ac.check(log, ARM, ac.Limits.only(tool_jerk=peak))["tool_jerk"]
        assert check.verdict == "kept" and 0.99 < check.certain <= check.ratio <= 1 + 1e-6, names
        assert check.joint is None


def test_rounding_is_tolerated_and_few_samples_prove_little():
    log = sampled(SMOOTH, times(1e-3), ["q"])
    log.q, log.resolution = np.round(log.q, 6), {"q": 1e-6}
    check = ac.check(log, ARM, LIMITS)
    # Six decimals at 1 ms are 4000 rad/s³: what the numbers say is far above the limit.
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
def test_no_motion_within_its_limits_is_blamed(durations, seed, digits, names, clock):
    random = np.random.default_rng(seed)
    law = Phases.of(durations, random.uniform(-1, 1, (len(durations), 2)) * [JERK, 2.0])
    t = np.unique(np.append(random.uniform(0, law.duration, 60), [0, law.duration]))
    t = t[np.append(True, np.diff(t) > 1e-4)]
    log = sampled(law, t, names)
    for name in names:
        setattr(log, name, np.round(getattr(log, name), digits))
    log.resolution = dict.fromkeys(names, 10.0**-digits)
    if clock is not None:
        log.t, log.resolution["t"] = np.round(t, 5), clock
    dense = np.linspace(0, law.duration, 3001)
    motion = [law(dense, k) for k in range(4)]
    tool = np.linalg.norm(ARM.tool_jerk(*motion), axis=1).max() * 1.01 + 0.01
    check = ac.check(log, ARM, LIMITS.replace(tool_jerk=tool))
    assert not check.violated, check.worst
