"""Joint ranges in tracing: the given limits apply, and refusals name a remedy."""

from functools import partial

import numpy as np
import pytest

import armcontour as ac
from armcontour.jobs.methods import TIMINGS
from armcontour.planning.tracing import check_joint_range, trace_all

DOWN = np.diag([1.0, -1.0, -1.0])
POINTS = ac.Path.polyline([(0.4, -0.2, 0.3), (0.4, 0.2, 0.3)])
LINE = POINTS.oriented(DOWN)
FLAT = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15)])
S = np.linspace(0, LINE.length, 300)
UR5E = ac.load_arm("ur5e")


@pytest.fixture(scope="module")
def ur5e():
    return ac.load_arm("ur5e")


def ranges(arm, joint, low, high):
    """The arm's limits with another range of one joint."""
    lower, upper = (x.copy() for x in arm.limits.joint_range(arm.dof))
    lower[joint - 1] = low
    upper[joint - 1] = high
    return arm.limits.replace(joint_lower=lower, joint_upper=upper)


def test_joint_ranges_of_the_limits_replace_those_of_the_arm(ur5e):
    limits = ranges(ur5e, 4, 3.2, 6.28).replace(joint_acceleration=5.0)
    candidates = trace_all(LINE, ur5e, limits=limits)
    assert len(candidates) >= 2
    ways = [x(S) for x in (*candidates, ac.trace(LINE, ur5e, limits=limits))]
    for q in ways:
        np.testing.assert_allclose(ur5e.tool_position(q), LINE(S), atol=1e-9)
    for start in (None, candidates[0](0.0) + 0.01):
        planned = ac.plan(LINE, ur5e, limits, ac.Optimal(seed=start))
        ways.append(planned(np.linspace(0, planned.duration, 200)))
    assert all(((q[:, 3] > 3.2) & (q[:, 3] < 6.28)).all() for q in ways)
    tight = ur5e.with_limits(ranges(ur5e, 1, 0.5, 0.6))
    assert ur5e.limits.joint_upper[0] > 6
    with pytest.raises(ac.Unreachable):
        ac.trace(LINE, tight)
    # Limits without ranges have none.
    for limits in (ur5e.limits, ac.Limits.only()):
        assert len(trace_all(LINE, tight, limits=limits)) == len(trace_all(LINE, ur5e))
    assert ac.plan(LINE, tight, ur5e.limits.replace(joint_acceleration=5.0)).duration > 0


def test_configurations_are_ordered_by_travel_relative_to_the_velocity_limits(ur5e):
    for joint in range(6):
        velocity = np.full(6, 3.0)
        velocity[joint] = 0.01
        candidates = trace_all(LINE, ur5e, limits=ac.Limits.only(joint_velocity=velocity))
        ways = [(np.abs(np.diff(x(S), axis=0)) / velocity).max(axis=1).sum() for x in candidates]
        assert (np.diff(ways) > -1e-3 * max(ways)).all(), joint


def test_a_planar_arm_stays_within_its_joint_ranges(arm, refuses):
    free = ac.trace(FLAT, arm)
    low, high = (getattr(free(free.breaks), x)(axis=0) for x in ("min", "max"))
    inside = ac.Limits.only(joint_lower=low - 1e-6, joint_upper=high + 1e-6)
    joint_path = ac.trace(FLAT, arm, limits=inside)
    np.testing.assert_array_equal(joint_path.coefficients, free.coefficients)
    top = high[1] - 0.01
    tight = ac.Limits.only(joint_lower=-3.0, joint_upper=[3.0, top])
    data = {"joint": 1, "limit": "joint_upper", "needed": high[1], "allowed": top}
    for arm_with_limits, limits in ((arm, tight), (arm.with_limits(tight), None)):
        trace = partial(ac.trace, FLAT, arm_with_limits, limits=limits, configuration="positive")
        refuses(trace, ac.Unreachable, **data)
        # The other branch is inside, and taken where none is named.
        other = ac.trace(FLAT, arm_with_limits, limits=limits)
        assert (other(FLAT.breaks)[:, 1] < 0).all()
    turned = ac.trace(
        FLAT, arm, limits=ac.Limits.only(joint_lower=[5.0, 0.0], joint_upper=[7.0, 3.0])
    )
    np.testing.assert_allclose(turned(0.1 * FLAT.length), free(0.1 * FLAT.length) + [2 * np.pi, 0])


def bump(height):
    """Joint 2 rises from 0 to `height` and falls again, between its knots."""
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, 1, 0] = 1.0
    coefficients[0, 1:3, 1] = 4 * height, -4 * height
    return ac.JointPath(breaks=np.array([0.0, 2.0]), coefficients=coefficients)


def test_a_joint_beyond_its_range_between_samples_is_refused(refuses):
    limits = ac.Limits.only(joint_upper=[2.0, 0.5], joint_lower=[-0.1, -0.1])
    check_joint_range(bump(0.5), limits, UR5E)
    upper = {"limit": "joint_upper", "needed": 0.500001, "allowed": 0.5}
    lower = {"limit": "joint_lower", "needed": -0.3, "allowed": -0.1}
    for height, words, data in (
        (0.5 + 1e-6, "0.000057 deg beyond its upper limit of 28.6 deg", upper),
        (-0.3, "beyond its lower limit of -5.73 deg", lower),
    ):
        path_of_bump = bump(height)
        refuses(
            lambda x=path_of_bump: check_joint_range(x, limits, UR5E), ac.Unreachable, words,
            joint=1, s=1.0, **data,
        )  # fmt: skip
    # Ranges may be missing or endless.
    check_joint_range(bump(5.0), ac.Limits.only(), UR5E)
    check_joint_range(bump(5.0), ac.Limits.only(joint_upper=[np.inf, np.inf]), UR5E)
    for seed in range(20):
        rng = np.random.default_rng(seed)
        path = ac.JointPath(breaks=np.array([0.0, 1.5]), coefficients=rng.uniform(-1, 1, (1, 6, 3)))
        q = path(np.linspace(0, 1.5, 20_001))
        check_joint_range(
            path, ac.Limits.only(joint_lower=q.min() - 1e-6, joint_upper=q.max() + 1e-6), UR5E
        )
        with pytest.raises(ac.Unreachable) as caught:
            check_joint_range(path, ac.Limits.only(joint_upper=q.max() - 0.01), UR5E)
        assert caught.value.needed == pytest.approx(q.max(), abs=1e-6), seed
        assert caught.value.joint == int(np.argmax(q.max(axis=0))), seed


def test_every_method_refuses_paths_out_of_the_joint_range(traced, arm, limits):
    narrow = limits.replace(joint_upper=traced(0.0) + 0.01)
    for method in ("optimal", "paper", "conventional"):
        with pytest.raises(ac.Unreachable, match="beyond its upper limit"):
            ac.plan(traced, arm, narrow, TIMINGS[method]())
