"""Plans of a given duration: exactly that long, every limit kept, along the same path."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms.serial import SerialArm

SPLINE = ac.JointPath.spline(np.random.default_rng(11).uniform(-2, 2, (5, 6)))


def test_a_path(rounded, arm, limits, worst_ratios, refuses):
    fastest = ac.plan(rounded, arm, limits).duration
    for slower in (1.0, 1.37, 40.0):
        planned = ac.plan(rounded, arm, limits, duration=slower * fastest)
        assert planned.duration == pytest.approx(slower * fastest, rel=1e-12)
        assert all(x <= 1 + 1e-9 for x in worst_ratios(planned, limits, arm).values()), slower
        found = rounded.project(arm.forward(planned(np.linspace(0, planned.duration, 2001))))
        assert found.distance.max() < 1e-7
        np.testing.assert_allclose(found.s[[0, -1]], [0, rounded.length], atol=1e-7)
    # It moves as it says: velocities and accelerations are the derivatives, by differences.
    planned, step = ac.plan(rounded, arm, limits, duration=9.0), 1e-6
    middle = (planned.breaks[:-1] + planned.breaks[1:]) / 2
    for order in (0, 1):
        rise = (planned(middle + step, order) - planned(middle - step, order)) / (2 * step)
        np.testing.assert_allclose(planned(middle, order + 1), rise, atol=1e-5)
    # Too short a duration names the fastest.
    refuses(
        lambda: ac.plan(rounded, arm, limits, duration=0.99 * fastest),
        ac.NotRealizable,
        f"takes {fastest:.9g} s",
        limit="duration",
        needed=fastest,
        allowed=0.99 * fastest,
    )
    named = ac.plan(rounded, arm, limits, duration=float(f"{fastest:.9g}"))
    assert named.duration == pytest.approx(fastest, rel=2e-9)


def test_refused(traced, arm, limits, refuses):
    more = {"method": "mac"}, {"start_speed": 0.01}
    for options in (*({"duration": x} for x in (0.0, np.nan, 2e6)), *more):
        given = {"duration": 9.0} | options
        refuses(lambda x=given: ac.plan(traced, arm, limits, **x), ac.InvalidInput)


def test_a_joint_path_that_stands_still_somewhere(worst_ratios):
    path = ac.JointPath.spline([(0.0, 0.0), (0.6, 1.1), (0.0, 0.0)], ends="clamped")
    limits = ac.Limits(joint_acceleration=[5.0, 8.0])
    planned = ac.plan(path, limits=limits, duration=3.0)
    assert planned.duration == pytest.approx(3.0, rel=1e-12)
    assert max(worst_ratios(planned, limits).values()) <= 1 + 1e-9


def test_all_contours_of_a_program_share_one_factor(arm, limits):
    lines = [ac.Path.polyline([(0.3, y), (0.36, y)]) for y in (0.1, 0.15)]
    program = ac.Program(
        moves=(ac.Contour(path=lines[0]), ac.Dwell(duration=0.25), ac.Contour(path=lines[1]))
    )
    fastest = ac.plan(program, arm, limits)
    planned = ac.plan(program, arm, limits, duration=2 * fastest.duration)
    assert planned.duration == pytest.approx(2 * fastest.duration, rel=1e-12)
    for fast, slow in zip(fastest.spans, planned.spans, strict=True):
        ratio = (slow.t[1] - slow.t[0]) / (fast.t[1] - fast.t[0])
        moved = sum(x.t[1] - x.t[0] for x in fastest.contour_spans)
        shared = 1 + fastest.duration / moved
        assert ratio == pytest.approx(shared if fast.kind == "contour" else 1.0, rel=1e-12)
    assert [x.kind for x in planned.spans] == ["contour", "dwell", "rapid", "contour"]
    assert not ac.check(planned, arm, limits, path=program).violated


def test_gravity_and_friction():
    """Viscous friction helps to brake: a plan that is merely stretched breaks its limits."""
    ur5e = ac.load_arm("ur5e")
    viscous = np.array([15.0, 15.0, 10.0, 3.0, 3.0, 2.0])
    robot = SerialArm(name="UR5e", chain=ur5e.chain.replace(viscous=viscous), limits=ur5e.limits)
    limits = ac.Limits(joint_torque=ur5e.limits.joint_torque, joint_velocity=3.0)
    fastest = ac.plan(SPLINE, robot, limits, intervals=500).duration
    for slower in (1.0003, 1.5, 6.0):
        planned = ac.plan(SPLINE, robot, limits, intervals=500, duration=slower * fastest)
        assert planned.duration == pytest.approx(slower * fastest, rel=1e-12)
        assert not ac.check(planned, robot, limits, points=30).violated, slower
        assert planned.time_at(SPLINE.length) > planned.duration * (1 - 1e-3)
        np.testing.assert_allclose(planned(planned.duration), SPLINE(SPLINE.length), atol=1e-12)
