"""Joints' ranges in tracing: those of the limits given rule, and refusals name what helps."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms import Chain, SerialArm
from armcontour.tracing import trace_all

DOWN = np.diag([1.0, -1.0, -1.0])
LINE = ac.Path.polyline([(0.4, -0.2, 0.3), (0.4, 0.2, 0.3)]).oriented(DOWN)
FLAT = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15)])


@pytest.fixture(scope="module")
def ur5e():
    return ac.load_arm("ur5e")


def ranges(arm, **joints):
    """The arm's limits with other ranges: joint_4=(lower, upper)."""
    lower, upper = (x.copy() for x in arm.limits.joint_range(arm.dof))
    for name, (low, high) in joints.items():
        lower[int(name[-1]) - 1], upper[int(name[-1]) - 1] = low, high
    return arm.limits.replace(joint_lower=lower, joint_upper=upper)


def test_ranges_that_limits_narrow_are_met_by_whole_turns(ur5e):
    limits = ranges(ur5e, joint_4=(3.2, 6.28))
    s = np.linspace(0, LINE.length, 200)
    found = trace_all(LINE, ur5e, limits=limits)
    assert len(found) >= 2
    for traced in [*found, ac.trace(LINE, ur5e, limits=limits)]:
        q = traced(s)
        assert ((q[:, 3] > 3.2) & (q[:, 3] < 6.28)).all()
        np.testing.assert_allclose(ur5e.forward(q), LINE(s), atol=1e-9)
    limits = limits.replace(joint_acceleration=5.0)
    for planned in (
        ac.plan(LINE, ur5e, limits),
        ac.plan(LINE, ur5e, limits, start=found[0](0.0) + 0.01),
    ):
        q = planned(np.linspace(0, planned.duration, 200))
        assert ((q[:, 3] > 3.2) & (q[:, 3] < 6.28)).all()


def test_ranges_that_limits_widen_are_used(ur5e):
    tight = ur5e.with_limits(ranges(ur5e, joint_1=(0.5, 0.6)))
    assert ur5e.limits.joint_upper[0] > 6
    with pytest.raises(ac.Unreachable):
        ac.trace(LINE, tight)
    assert len(trace_all(LINE, tight, limits=ur5e.limits)) == len(trace_all(LINE, ur5e))
    # Limits without ranges have none.
    assert len(trace_all(LINE, tight, limits=ac.Limits())) == len(trace_all(LINE, ur5e))
    wide = ur5e.limits.replace(joint_acceleration=5.0)
    assert ac.plan(LINE, tight, wide).duration > 0


def test_joints_to_spare_keep_the_ranges_of_limits():
    panda = ac.load_arm("panda")
    free = ac.trace(LINE, panda)
    s = np.linspace(0, LINE.length, 300)
    middle = free(s)[:, 0].mean() + 0.5
    limits = ranges(panda, joint_1=(middle, middle + 0.6))
    q = ac.trace(LINE, panda, limits=limits)(s)
    assert ((q[:, 0] >= middle) & (q[:, 0] <= middle + 0.6)).all()


@pytest.mark.parametrize("joint", range(6))
def test_the_velocities_of_limits_tell_the_shortest_way(ur5e, joint):
    velocity = np.full(6, 3.0)
    velocity[joint] = 0.01
    found = trace_all(LINE, ur5e, limits=ac.Limits(joint_velocity=velocity))
    s = np.linspace(0, LINE.length, 400)
    ways = [(np.abs(np.diff(x(s), axis=0)) / velocity).max(axis=1).sum() for x in found]
    assert (np.diff(ways) > -1e-3 * max(ways)).all()


def test_an_arm_in_the_plane_keeps_its_ranges(arm, refuses):
    free = ac.trace(FLAT, arm)
    q = free(free.breaks)
    low, high = q.min(axis=0), q.max(axis=0)
    inside = ac.Limits(joint_lower=low - 1e-6, joint_upper=high + 1e-6)
    np.testing.assert_array_equal(
        ac.trace(FLAT, arm, limits=inside).coefficients, free.coefficients
    )
    top = high[1] - 0.01
    for call in (
        lambda: ac.trace(FLAT, arm, limits=ac.Limits(joint_lower=-3.0, joint_upper=[3.0, top])),
        lambda: ac.trace(
            FLAT, arm.with_limits(ac.Limits(joint_lower=-3.0, joint_upper=[3.0, top]))
        ),
    ):
        refuses(
            call,
            ac.Unreachable,
            "joint 2 would stand at",
            "beyond its upper limit",
            "move the path or the arm.",
            joint=2,
            limit="joint_upper",
            needed=high[1],
            allowed=top,
        )
    turned = ac.trace(FLAT, arm, limits=ac.Limits(joint_lower=[5.0, 0.0], joint_upper=[7.0, 3.0]))
    np.testing.assert_allclose(turned(0.1 * FLAT.length), free(0.1 * FLAT.length) + [2 * np.pi, 0])


def test_where_no_whole_turn_fits_the_nearest_one_is_told(ur5e):
    for limits, name in (
        (ranges(ur5e, joint_1=(0.5, 0.6)), "joint_lower"),
        (ranges(ur5e, joint_1=(-1.0, -0.9)), "joint_upper"),
    ):
        with pytest.raises(ac.Unreachable, match="joint 1 would stand") as caught:
            ac.trace(LINE, ur5e, limits=limits)
        assert caught.value.limit == name
        assert abs(caught.value.needed - caught.value.allowed) < np.pi
        np.testing.assert_allclose(caught.value.point, LINE(caught.value.s), atol=1e-9)


def three_joints():
    chain = Chain(
        joints=("a", "b", "c"),
        rotations=np.tile(np.eye(3), (3, 1, 1)),
        positions=np.array([(0, 0, 0), (0, 0, 0.3), (0.3, 0, 0)]),
        axes=np.array([(0.0, 0, 1), (0, 1, 0), (0, 1, 0)]),
        tip=ac.Frame(position=[0.3, 0, 0]),
    )
    return SerialArm(name="three", chain=chain, limits=ac.Limits())


def refusals(arm, path, limits):
    """What is said of a range, of the reach at the start, and of the reach on the way."""
    far = ac.Path.polyline([(3.0, 0, 0.3), (4.0, 0, 0.3)])
    leaves = ac.Path.polyline([(0.3, 0, 0.3), (4.0, 0, 0.3)])
    for one, own in ((path, limits), (far, None), (leaves, None)):
        held = one.pointing([0, 0, -1]) if path.orientation is not None else one
        with pytest.raises(ac.Unreachable) as caught:
            ac.trace(held, arm, limits=own)
        yield str(caught.value)


def test_freeing_the_tool_axis_is_no_advice_where_it_is_free_already(ur5e):
    narrow = ranges(ur5e, joint_1=(0.5, 0.6))
    said = list(refusals(ur5e, LINE, narrow))
    point = ac.Path.polyline([(0.4, -0.2, 0.3), (0.4, 0.2, 0.3)])
    arm = three_joints()
    said += refusals(arm, point, ac.Limits(joint_lower=2.0, joint_upper=2.1))
    assert len(said) == 6
    for message in said:
        assert "tool axis" not in message and message.endswith("move the path or the arm.")
    with pytest.raises(ac.Unreachable, match="or leave turning about the tool axis free"):
        ac.trace(LINE, ur5e, limits=narrow)
