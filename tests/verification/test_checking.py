"""The independent checker: hand-computed motions, verdicts and refusals."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.files.exports import CsvFormat, RosYamlFormat
from armcontour.files.exports.formats import ENDINGS
from armcontour.motion import LapLaw, Samples
from armcontour.robot.limit_use import Use
from armcontour.verification.limit_verdict import LimitUseAccumulator


def laps(durations, ddq, q):
    """Uniform joint accelerations one after the other, from rest at `q`."""
    t = np.concatenate([[0], np.cumsum(durations)])
    positions = [np.array(q)]
    velocities = [np.zeros(2)]
    for h, a in zip(durations, np.array(ddq), strict=True):
        positions.append(positions[-1] + velocities[-1] * h + a * h**2 / 2)
        velocities.append(velocities[-1] + a * h)
    law = LapLaw(breaks=t, q=np.array(positions), dq=np.array(velocities[:-1]), ddq=np.array(ddq))
    return ac.Trajectory(laws=(law,), method="by hand")


# Joint 1 up at 0.5, on, down at 0.4 rad/s²; joint 2 the other way at a third of it. Its breaks lie
# on no grid of samples.
JERKY = laps(
    [math.sqrt(0.5), 0.3111, math.sqrt(0.5) * 1.25],
    [[0.5, -0.2], [0.0, 0.0], [-0.4, 0.16]],
    (0.3, 0.9),
)
PEAK = 0.5 * math.sqrt(0.5)  # rad/s, of joint 1
BOUNDS = {"joint_acceleration": [0.5, 0.2], "joint_velocity": [PEAK, 0.4 * PEAK]}


def columns(samples, names):
    arrays = {x: getattr(samples, x) for x in names.split()}
    return SimpleNamespace(t=samples.t, **arrays)


def rounded_to(log, digits):
    """The log rounded to `digits` decimals, and its resolution."""
    rounded = {name: np.round(x, digits) for name, x in vars(log).items() if name != "t"}
    return SimpleNamespace(t=log.t, **rounded), dict.fromkeys(rounded, 10.0**-digits)


def test_the_ratios_of_a_law_equal_those_computed_by_hand(arm):
    check = ac.check(JERKY, arm, ac.Limits.only(**BOUNDS))
    assert not check.violated and check.worst is not None
    up = check["joint_acceleration"]
    assert (up.ratio, up.value, up.limit, up.joint) == (1.0, 0.5, 0.5, 0)
    assert check["joint_velocity"].ratio == pytest.approx(1, abs=1e-12)
    assert check["velocity_step"].value < 1e-12
    assert check.end_speeds == pytest.approx((0, 0), abs=1e-15)
    assert (check.start, check.end, check.states) == (0, JERKY.duration, 3 * 52)
    check = ac.check(JERKY, arm, ac.Limits.only(joint_acceleration=[0.5, 0.19], joint_velocity=1.0))
    (use,) = check.violations
    assert check.violated and use is check.worst
    assert (use.name, use.joint, use.limit) == ("joint_acceleration", 1, 0.19)
    assert use.ratio == pytest.approx(0.2 / 0.19)
    assert use.t <= math.sqrt(0.5)


def test_limits_may_differ_by_direction(arm):
    bounds = np.array([[-0.4, 0.5], [-0.2, 0.16]])
    both, swapped = (ac.Limits.only(joint_acceleration=x) for x in (bounds, -bounds[:, ::-1]))
    for samples in (JERKY, JERKY.sample(1e-3), columns(JERKY.sample(1e-3), "q")):
        assert not ac.check(samples, arm, both).violated
        check = ac.check(samples, arm, swapped)
        assert {x.name for x in check.violations} == {"joint_acceleration"}
        worst = check["joint_acceleration"]
        assert worst.joint in (0, 1) and worst.ratio == pytest.approx(0.2 / 0.16, rel=1e-6)


def test_the_smallest_peak_between_two_samples_is_found(arm):
    """Rest at both ends of one interval: to go 0.1 rad in 1 s takes 0.4 rad/s² on the way."""
    still = np.zeros((2, 2))
    log = SimpleNamespace(t=[0.0, 1.0], q=[[0.3, 0.9], [0.4, 0.9]], dq=still, ddq=still)
    check = ac.check(log, arm, ac.Limits.only(joint_acceleration=0.1, joint_velocity=0.09))
    assert check["joint_acceleration"].value == pytest.approx(0.4)
    assert check["joint_velocity"].value == pytest.approx(0.1)
    assert {x.name for x in check.violations} == {"joint_acceleration", "joint_velocity"}
    # Velocities that do not belong to the positions are found.
    wrong = columns(JERKY.sample(4e-3), "q dq ddq")
    wrong.dq = 0.9 * wrong.dq
    assert ac.check(wrong, arm, ac.Limits.only(**BOUNDS))["joint_acceleration"].ratio > 2


def test_excesses_within_the_printed_digits_are_tolerated(arm):
    """Ten decimals at 1 ms: second differences of q are off by up to 0.0002 rad/s²."""
    tight = ac.Limits.only(**{name: np.array(values) / 1.02 for name, values in BOUNDS.items()})
    for names in ("q", "q dq", "q dq ddq"):
        log, resolution = rounded_to(columns(JERKY.sample(1e-3), names), 10)
        check = ac.check(log, arm, ac.Limits.only(**BOUNDS), resolution=resolution)
        assert check.verdict == "kept", (names, check.worst)
        assert check.rounding["q"] == pytest.approx(5e-11)
        assert check["joint_acceleration"].certain > 0.99
        # Taken for exact, it is not forgiven.
        assert ac.check(log, arm, ac.Limits.only(**BOUNDS)).violated, names
        tight_check = ac.check(log, arm, tight, resolution=resolution)
        assert {x.name for x in tight_check.violations} == set(BOUNDS)
        assert tight_check["joint_acceleration"].ratio == pytest.approx(1.02, abs=5e-3)
        assert 0 < tight_check["joint_acceleration"].slack < 1e-2
    # Six decimals, 2 rad/s², decide nothing.
    log, resolution = rounded_to(columns(JERKY.sample(1e-3), "q"), 6)
    for limits in (ac.Limits.only(**BOUNDS), tight):
        assert ac.check(log, arm, limits, resolution=resolution)["joint_acceleration"].verdict == (
            "cannot tell"
        )


@pytest.mark.parametrize("cycle", [1e-3, 4e-3, 8e-3])
@pytest.mark.parametrize("derivatives", [0, 1, 2])
@pytest.mark.parametrize("jerk", [np.inf, 7.2])
def test_exported_plans_at_their_limits_satisfy_them(arm, tmp_path, cycle, derivatives, jerk):
    limits = ac.Limits.only(joint_acceleration=0.72, joint_jerk=jerk, speed=0.15)
    path = ac.Path(segments=[ac.Arc(start=(0.40, 0.25), center=(0.35, 0.25), angle=1.0)])
    planned = ac.plan(path, arm, limits)
    for form in (CsvFormat(derivatives=derivatives), RosYamlFormat(derivatives=derivatives)):
        file = tmp_path / f"plan{ENDINGS[form.kind]}"
        ac.export(planned, file, form, arm=arm, cycle=cycle)
        samples = ac.read_trajectory(file, arm.joint_names)
        check = ac.check(samples, arm, limits.replace(joint_jerk=None))
        assert check.verdict == "kept", check
        assert check["joint_acceleration"].highest.ratio > 0.99
        reduced = limits.replace(joint_jerk=None, joint_acceleration=0.72 / 1.02)
        assert ac.check(samples, arm, reduced).violated


def test_rounded_times_of_irregular_samples_are_tolerated_if_declared(arm):
    t = np.sort(np.random.default_rng(1).uniform(0, JERKY.duration, 400))
    t = t[np.append(True, np.diff(np.round(t, 5)) > 0)]
    log = SimpleNamespace(t=np.round(t, 5), q=JERKY(t), dq=JERKY(t, 1))
    limits = ac.Limits.only(**BOUNDS)
    assert ac.check(log, arm, limits).violated
    forgiven = ac.check(log, arm, limits, resolution={"t": 1e-5})
    assert not forgiven.violated, forgiven.worst
    assert forgiven.rounding["t"] == pytest.approx(5e-6)
    regular = columns(JERKY.sample(1e-3), "q")
    regular = SimpleNamespace(t=np.round(regular.t[:-1], 3), q=regular.q[:-1])
    assert ac.check(regular, arm, limits, resolution={"t": 1e-3}).rounding["t"] < 1e-12


def circle(arm, speed, names):
    """The tool on a circle of 50 mm at uniform speed, every 2 ms."""
    path = ac.Path(segments=[ac.Arc(start=(0.40, 0.25), center=(0.35, 0.25), angle=6.0)])
    t = np.arange(0, path.length / speed, 2e-3)
    s = speed * t
    q = arm.joint_position(path(s))
    dq = arm.joint_velocity(q, speed * path(s, 1))
    ddq = arm.joint_acceleration(q, dq, speed**2 * path(s, 2))
    return columns(Samples(t=t, q=q, dq=dq, ddq=ddq), names), path


def test_the_ratios_of_a_tool_on_a_circle_have_a_closed_form(arm):
    limits = ac.Limits.only(speed=0.1, tool_acceleration=0.2, centripetal_acceleration=0.2)
    tight = limits.replace(centripetal_acceleration=0.199)
    for names, near in (("q", 1e-5), ("q dq", 1e-5), ("q dq ddq", 1e-9), ("q ddq", 1e-5)):
        log, path = circle(arm, 0.1, names)
        check = ac.check(log, arm, limits, path, deviation=1e-6)
        for name in ("speed", "tool_acceleration", "centripetal_acceleration"):
            assert check[name].ratio == pytest.approx(1, abs=near), (name, names)
            assert check[name].s is not None and check[name].joint is None
        assert not check.violated, (names, check.worst)
        assert check.path_deviation.distance < 1e-9
        (use,) = ac.check(log, arm, tight).violations
        assert use.name == "centripetal_acceleration", names


def test_the_distance_from_a_path_is_checked(arm):
    points = np.linspace((0.30, 0.201), (0.40, 0.203), 50)
    log = SimpleNamespace(t=np.arange(50) * 0.1, q=arm.joint_position(points))
    path = ac.Path.polyline([(0.30, 0.20), (0.40, 0.20)])
    check = ac.check(log, arm, ac.Limits.only(), path, deviation=2e-3)
    far = check.path_deviation
    assert (far.distance, far.t, far.s) == pytest.approx((3e-3, 4.9, 0.1))
    assert check["path_deviation"].ratio == pytest.approx(1.5)
    assert check.violated
    assert not ac.check(log, arm, ac.Limits.only(), path).violated


def test_laws_are_checked_on_both_sides_of_their_breaks_and_at_jumps(arm):
    """A lap of a nanosecond with too much acceleration hides from any sampling."""
    hidden = laps([0.5, 1e-9, 0.5], [[0.1, 0], [5.0, 0], [-0.1, 0]], (0.3, 0.9))
    check = ac.check(hidden, arm, ac.Limits.only(joint_acceleration=0.1))
    assert check["joint_acceleration"].ratio == pytest.approx(50)
    law = LapLaw(
        breaks=np.array([0.0, 1.0, 2.0]),
        q=np.array([[0.3, 0.9], [0.4, 0.9], [0.5, 0.9]]),
        dq=np.array([[0.1, 0.0], [0.1, 0.01]]),
        ddq=np.zeros((2, 2)),
    )
    planned = ac.Trajectory(laws=(law,), method="by hand")
    check = ac.check(planned, arm, ac.Limits.only(joint_acceleration=1.0))
    use = check["velocity_step"]
    assert (use.value, use.joint, use.t) == pytest.approx((0.01, 1, 1.0))
    assert check.violated
    assert check.end_speeds == pytest.approx((0.1, 0.1))
    assert not ac.check(
        planned, arm, ac.Limits.only(joint_acceleration=1.0), velocity_step=0.02
    ).violated
    torn = LapLaw(breaks=law.breaks, q=law.q, dq=law.dq * [0.99, 1], ddq=law.ddq)
    check = ac.check(ac.Trajectory(laws=(torn,), method="by hand"), arm, ac.Limits.only())
    assert check["position_step"].value == pytest.approx(1e-3)
    assert check.violated


def test_the_papers_method_satisfies_the_limits_of_its_job(mac, rounded, arm, limits):
    """Laps hand over velocities with a step of about 1e-5 rad/s, by the method's design."""
    check = ac.check(mac, arm, limits, rounded)
    assert check["joint_acceleration"].ratio == pytest.approx(1, abs=1e-9)
    assert check["speed"].ratio < 1
    # The corner is uniform, but its joint path is traced to 1e-8 m.
    assert check["centripetal_acceleration"].ratio == pytest.approx(1, abs=1e-4)
    assert 1e-6 < check["velocity_step"].value < 2e-5
    assert check.path_deviation.distance < 1e-8
    # In samples the step is what it is: more acceleration than allowed within a sample.
    sampled = ac.check(mac.sample(1e-3), arm, limits, rounded)
    assert 1.005 < sampled["joint_acceleration"].ratio < 1.02


def test_the_verdict_follows_from_the_digits_and_the_worst_limit(arm):
    """One joint goes 0.1 rad in each second; what is known of it depends on the digits."""
    log = SimpleNamespace(t=np.arange(4.0), q=[[0.1 * i, 0.9] for i in range(4)])
    for limit, digit, verdict in (
        (0.10, 0.0, "kept"),
        (0.09, 0.0, "violated"),
        (0.09, 0.009, "violated"),
        (0.09, 0.05, "cannot tell"),
        (0.11, 0.05, "kept"),
        # In full use, printed: up to 1 % above it is let pass if the digits explain it.
        (0.1 / 1.0099, 1e-2, "kept"),
        (0.1 / 1.0101, 1e-2, "cannot tell"),
        (0.1 / 1.0019, 2e-4, "kept"),
        (0.1 / 1.0009, 0.0, "violated"),
    ):
        check = ac.check(log, arm, ac.Limits.only(joint_velocity=limit), resolution={"q": digit})
        assert check["joint_velocity"].verdict == check.verdict == verdict, (limit, digit)
        assert check.violated is (verdict == "violated")
        assert check["joint_velocity"].highest.ratio == pytest.approx(0.1 / limit)
    log = SimpleNamespace(t=np.arange(4.0), q=[[0.0, 0.9], [0.1, 0.9], [0.0, 0.9], [0.1, 0.9]])
    coarse = {"q": 0.05}
    within = {"joint_velocity": 1.0}
    unknown = {"joint_acceleration": 0.19}
    broken = {"joint_upper": [0.05, 2.0]}
    for limits, verdict in (
        (within, "kept"),
        (within | unknown, "cannot tell"),
        (within | unknown | broken, "violated"),
        ({}, "kept"),
        # Positions do not determine torques.
        ({"joint_torque": 1.0}, "cannot tell"),
    ):
        assert ac.check(log, arm, ac.Limits.only(**limits), resolution=coarse).verdict == verdict
    log = SimpleNamespace(t=np.arange(4.0), q=[[0.1 * i, 0.9] for i in range(4)])
    for limit, verdict in ((1e-30, "violated"), (1e-20, "violated"), (1e12, "kept")):
        limits = ac.Limits.only(joint_velocity=limit, joint_lower=-1e12, joint_upper=1e12)
        assert ac.check(log, arm, limits)["joint_velocity"].verdict == verdict
        assert ac.check(log, arm, limits)["joint_upper"].verdict == "kept"


def test_nan_is_undecided_and_infinity_violates_a_limit(arm):
    for value, verdict in (
        ([0.5, np.nan, 0.1], "cannot tell"),
        ([0.5, np.nan, 2.0], "violated"),
        ([0.5, np.inf, 0.1], "violated"),
        ([0.5, 0.4, 0.1], "kept"),
    ):
        tally = LimitUseAccumulator(arm, ac.Limits.only(joint_velocity=1.0), None, None)
        for part in (value[:2], value[2:]):
            tally.record(Use("speed", np.array(part), 1.0), np.arange(2.0), np.zeros((2, 2)))
        (use,) = tally.uses(1e-9)
        assert use.verdict == verdict, value
    tally = LimitUseAccumulator(arm, ac.Limits.only(joint_velocity=1.0), None, None)
    tally.record(Use("speed", np.array([np.inf]), 1.0, np.inf), np.zeros(1), np.zeros((1, 2)))
    assert tally.uses(1e-9)[0].verdict == "cannot tell"


def test_a_turn_between_two_samples_leaves_the_centripetal_acceleration_open(arm):
    """The path turns by a right angle; the samples do not determine the curve."""
    points = [(0.30 + 0.01 * min(i, 10), 0.20 + 0.01 * max(0, i - 10)) for i in range(21)]
    log = SimpleNamespace(t=np.arange(21) * 0.1, q=arm.joint_position(np.array(points)))
    check = ac.check(log, arm, ac.Limits.only(centripetal_acceleration=0.5))
    use = check["centripetal_acceleration"]
    assert use.highest.value == pytest.approx(math.sqrt(2) * 0.1 / 0.1)
    assert (use.highest.t, use.verdict) == (pytest.approx(1.0), "cannot tell")
    wide = ac.check(log, arm, ac.Limits.only(centripetal_acceleration=2.0))
    assert wide.verdict == "kept"


HERE = [0.3, 0.9]
GOOD = {"t": [0.0, 0.1, 0.2], "q": [HERE, [0.31, 0.9], [0.32, 0.9]]}


def test_invalid_trajectories_are_refused(arm, refuses):
    for change, words, data in (
        ({"t": [0.0, 0.1, 0.1]}, "t in row 3 is 0.1 s, but times must increase", {"index": 2}),
        ({"t": [0.0, 0.1, 0.1], "q": [HERE, [0.3, 1], [0.3, 1]]}, "repeated sample", {"index": 2}),
        ({"t": [0.0, 0.2, 0.1]}, "row 3", {"index": 2, "t": 0.1}),
        ({"t": [0.0, np.nan, 0.2]}, "t in row 2 is nan", {"index": 1}),
        ({"q": [HERE, HERE, [0.3, np.inf]]}, "joint 2 in row 3 is inf", {"index": 2, "joint": 1}),
        ({"dq": [HERE, [np.nan, 0.9], HERE]}, "dq of joint 1 in row 2 is nan", {}),
        ({"t": [0.0, 0.1], "q": GOOD["q"][:2]}, "at least 3 samples", {}),
        ({"t": [0.0, 0.1]}, "3 rows for 2 times", {}),
        ({"q": [[0.3], [0.3], [0.3]]}, "shape (any, 2)", {}),
        ({"q": [["a", "b"]]}, "q must be numbers in rad", {}),
        ({"t": None}, "must have times t", {}),
        ({"t": [0.0, 5e-324, 1e-323]}, "at least 1 ns", {"index": 1}),
        ({"t": [0.0, 1.0, 1e300]}, "within 1e+10 s", {"index": 2}),
        ({"t": [1e9, 1e9 + 5e-7, 1e9 + 1]}, "more than their rounding", {}),
        ({"q": [HERE, [0.3, -1e308], HERE]}, "10000 rad", {"index": 1, "joint": 1}),
        ({"dq": [HERE, [1e200, 0.9], HERE]}, "1e+09 rad/s", {}),
        ({"ddq": [HERE, [1e13, 0.9], HERE]}, "1e+12 rad/s", {}),
    ):
        log = SimpleNamespace(**{**GOOD, **change})
        refuses(partial(ac.check, log, arm), ac.InvalidInput, words, **data)


def test_checks_with_missing_or_contradictory_inputs_are_refused(arm, objective, refuses):
    log = SimpleNamespace(**GOOD)
    three = ac.Limits.only(joint_acceleration=[1, 1, 1])
    spline = LapLaw(
        breaks=np.array([0, 1.0]), q=np.zeros((2, 3)), dq=np.zeros((1, 3)), ddq=np.zeros((1, 3))
    )
    other = ac.Trajectory(laws=(spline,), method="by hand")
    check = partial(ac.check, log, arm)
    for call, words in (
        (partial(check, deviation=1e-3), "requires a path"),
        (partial(check, coverage_error=1e-3), "coverage_error"),
        (partial(check, path=objective, deviation=0), "above zero"),
        (partial(check, resolution={"x": 1}), "key 'x'"),
        (partial(check, resolution={"q": -1}), "must not be negative"),
        (partial(check, path=ac.Path.polyline([(0, 0, 0), (1, 1, 1)])), "3 coordinates"),
        (partial(check, three), "3 values"),
        (partial(ac.check, other, arm), "the arm has 2"),
    ):
        refuses(call, ac.InvalidInput, words)


@pytest.mark.parametrize("names", ["q", "q dq", "q dq ddq"])
def test_samples_of_valid_motions_are_never_violations(arm, names):
    """Random jerky motions, sampled at random times and printed with few digits, time included."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        n = int(random.integers(1, 8))
        ddq = random.uniform(-1, 1, (n, 2)) * random.choice([0.1, 1, 5])
        planned = laps(random.uniform(0.05, 0.3, n).tolist(), ddq.tolist(), (0.3, 0.9))
        dense = np.union1d(np.linspace(0, planned.duration, 2001), planned.breaks)
        velocity = np.abs(planned(dense, 1)).max(axis=0)
        tool = np.linalg.norm(arm.tool_velocity(planned(dense), planned(dense, 1)), axis=1)
        limits = ac.Limits.only(
            joint_velocity=velocity * (1 + 1e-9),
            joint_acceleration=np.stack(
                [np.minimum(ddq.min(axis=0), -1e-3), np.maximum(ddq.max(axis=0), 1e-3)], axis=1
            ),
            speed=tool.max() * (1 + 1e-5),
        )
        digits = int(random.choice([4, 6, 9]))
        t = np.sort(random.uniform(0, planned.duration, 100))
        t = t[np.append(True, np.diff(np.round(t, digits)) > 0)]
        samples = Samples(t=t, q=planned(t), dq=planned(t, 1), ddq=planned(t, 2))
        log, resolution = rounded_to(columns(samples, names), digits)
        log.t = np.round(t, digits)
        check = ac.check(log, arm, limits, resolution={**resolution, "t": 10.0**-digits})
        assert not check.violated, (seed, check.worst)


def test_a_specified_limit_that_was_not_checked_leaves_the_verdict_open():
    """A limit of torque needs accelerations; that of the arm itself is only named."""
    arm = ac.load_arm("ur5e")
    t = np.arange(11) / 10
    log = SimpleNamespace(
        t=t, q=np.full((11, 6), 0.1) + 0.01 * t[:, None], dq=np.full((11, 6), 0.01)
    )
    own = ac.check(log, arm)
    assert own.verdict == "kept" and own.not_judged == ("joint_torque",) and own.missing == ()
    assert "not judged: joint_torque" in str(own)
    torque = ac.Limits(joint_torque=arm.limits.joint_torque.tolist())
    for limits in (torque,):
        check = ac.check(log, arm, limits)
        (name,) = check.missing
        assert check.verdict == "cannot tell" and name in str(check) and name in repr(limits)
        assert check.to_data()["kept"].value is None
    # A certain violation remains one.
    tight = torque.replace(joint_velocity=0.005)
    assert ac.check(log, arm, tight).verdict == "violated"
    log.ddq = np.zeros((11, 6))
    assert ac.check(log, arm, torque).missing == ()


def test_assumed_acceleration_limit_leaves_verdict_open(tmp_path):
    limit = '<limit lower="-9" upper="9" velocity="4" effort="9"/>'
    joint = (
        '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/>'
        f'<origin xyz="0 0 0.3"/><axis xyz="0 1 0"/>{limit}</joint>'
    )
    links = "".join(f'<link name="{x}"/>' for x in ("base", "arm", "tool0"))
    joints = joint.format("a", "base", "arm") + joint.format("b", "arm", "tool0")
    (tmp_path / "own.urdf").write_text(f'<robot name="own">{links}{joints}</robot>')
    arm = ac.load_arm(tmp_path / "own.urdf")
    t = np.arange(101) / 100
    log = SimpleNamespace(t=t, q=np.outer(0.4 * np.sin(2 * np.pi * t), [1.0, 0.0]))
    check = ac.check(log, arm)
    assert check["joint_acceleration"].certain > 3 and check.verdict == "cannot tell"
    for other in (arm.with_tool([0.0, 0.0, 0.1]), arm.with_work([0.1, 0.0, 0.0])):
        assert ac.check(log, other).verdict == "cannot tell"
    assert any("only assumed" in x for x in check.to_data().notes) and "assumed" in str(check)
    for specified in (ac.Limits(joint_acceleration=4.0), ac.Limits(joint_velocity=2.0)):
        assert ac.check(log, arm, specified).verdict == "violated"
    own = arm.with_limits(ac.Limits(joint_acceleration=4.0))
    assert ac.check(log, own).verdict == "violated"
    assert ac.check(log, arm.with_limits(ac.Limits(joint_velocity=5.0))).verdict == "cannot tell"
