"""The planar two-link arm against the paper's formulas, by finite differences, and at its edges."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac

L0, L1, L2 = 0.135, 0.250, 0.215  # m, paper Sec. IV-A
NEAR, FAR = L1 - L2, L1 + L2


def random_points(n=400, margin=1e-3, seed=0):
    rng = np.random.default_rng(seed)
    distance = rng.uniform(NEAR + margin, FAR - margin, n)
    angle = rng.uniform(-np.pi, np.pi, n)
    return np.stack([L0 + distance * np.cos(angle), distance * np.sin(angle)], axis=1)


def random_joints(n=200, seed=1):
    """Joint positions away from the singular ones."""
    rng = np.random.default_rng(seed)
    q2 = rng.choice([-1, 1], n) * rng.uniform(0.2, np.pi - 0.2, n)
    return np.stack([rng.uniform(-3, 3, n), q2], axis=1)


def test_forward_as_printed_1_and_2(arm):
    for t1, t2 in random_joints(20):
        x = L0 + L1 * np.sin(t1) + L2 * np.sin(t1 + t2)
        y = L1 * np.cos(t1) + L2 * np.cos(t1 + t2)
        np.testing.assert_allclose(arm.forward([t1, t2]), (x, y), atol=1e-15)


def test_inverse_as_printed_3_and_4_where_these_hold(arm):
    # (3) loses the quadrant for y <= 0, and (4) is the elbow with theta2 >= 0.
    points = random_points()
    points = points[points[:, 1] > 1e-3]
    assert len(points) > 100
    c, y = points[:, 0] - L0, points[:, 1]
    d2 = c**2 + y**2
    t1 = np.arctan(c / y) - np.arccos((L1**2 - L2**2 + d2) / (2 * L1 * np.sqrt(d2)))
    t2 = np.pi - np.arccos((L1**2 + L2**2 - d2) / (2 * L1 * L2))
    np.testing.assert_allclose(arm.inverse(points), np.stack([t1, t2], axis=1), atol=1e-9)


@pytest.mark.parametrize("branch", ["positive", "negative"])
def test_round_trip_from_the_tool(arm, branch):
    points = random_points()
    q = arm.inverse(points, branch)
    np.testing.assert_allclose(arm.forward(q), points, atol=2e-15)
    assert (np.sign(q[:, 1]) == (1 if branch == "positive" else -1)).all()


@pytest.mark.parametrize("branch", ["positive", "negative"])
def test_round_trip_from_the_joints(arm, branch):
    q = random_joints()
    q = q[np.sign(q[:, 1]) == (1 if branch == "positive" else -1)]
    found = arm.inverse(arm.forward(q), branch)
    turns = (found - q) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-13)
    np.testing.assert_array_equal(np.round(turns[:, 1]), 0)


def test_the_default_branch_is_the_papers(arm):
    points = random_points(20)
    np.testing.assert_array_equal(arm.inverse(points), arm.inverse(points, "positive"))
    assert arm.branches == ("positive", "negative")


@pytest.mark.parametrize("branch", ["positive", "negative"])
@pytest.mark.parametrize("edge", [NEAR + 2e-9, NEAR + 1e-6, FAR - 1e-6, FAR - 2e-9])
def test_round_trip_near_the_edges_of_the_reach(arm, branch, edge):
    angle = np.linspace(-3, 3, 50)
    points = np.stack([L0 + edge * np.cos(angle), edge * np.sin(angle)], axis=1)
    np.testing.assert_allclose(arm.forward(arm.inverse(points, branch)), points, atol=1e-14)


@given(
    st.floats(0.05, 2.0),
    st.floats(0.05, 2.0),
    st.floats(0.001, 0.999),
    st.floats(-np.pi, np.pi),
    st.sampled_from(["positive", "negative"]),
)
def test_any_arm_reaches_where_it_should(link1, link2, share, angle, branch):
    arm = ac.PlanarTwoLink(name="any", base=-0.3, links=(link1, link2), limits=ac.Limits())
    near, far = arm.reach
    assert (near, far) == (abs(link1 - link2), link1 + link2)
    distance = near + share * (far - near)
    point = np.array([-0.3 + distance * np.cos(angle), distance * np.sin(angle)])
    np.testing.assert_allclose(arm.forward(arm.inverse(point, branch)), point, atol=1e-13)


def test_the_jacobian_agrees_with_differences(arm):
    q, step = random_joints(), 1e-6
    found = arm.jacobian(q)
    for j in range(2):
        dq = step * np.eye(2)[j]
        difference = (arm.forward(q + dq) - arm.forward(q - dq)) / (2 * step)
        np.testing.assert_allclose(found[..., j], difference, atol=1e-9)


def test_the_jacobian_rate_agrees_with_differences(arm):
    q, step = random_joints(), 1e-6
    dq = np.random.default_rng(2).normal(size=q.shape)
    difference = (arm.jacobian(q + step * dq) - arm.jacobian(q - step * dq)) / (2 * step)
    np.testing.assert_allclose(arm.jacobian_rate(q, dq), difference, atol=1e-8)


def test_tool_motion_agrees_with_differences(arm):
    def q(t):
        return np.stack([np.sin(t), 1 + 0.5 * np.cos(2 * t)], axis=-1)

    t, h = np.linspace(0, 3, 40), 1e-4
    dq = np.stack([np.cos(t), -np.sin(2 * t)], axis=-1)
    ddq = np.stack([-np.sin(t), -2 * np.cos(2 * t)], axis=-1)
    before, now, after = (arm.forward(q(t + k * h)) for k in (-1, 0, 1))
    velocity, acceleration = (after - before) / (2 * h), (after - 2 * now + before) / h**2
    np.testing.assert_allclose(arm.tool_velocity(q(t), dq), velocity, atol=1e-8)
    np.testing.assert_allclose(arm.tool_acceleration(q(t), dq, ddq), acceleration, atol=1e-6)
    np.testing.assert_allclose(
        arm.joint_velocity(q(t), arm.tool_velocity(q(t), dq)), dq, atol=1e-12
    )
    back = arm.joint_acceleration(q(t), dq, arm.tool_acceleration(q(t), dq, ddq))
    np.testing.assert_allclose(back, ddq, atol=1e-11)


def entries_27(q, dq):
    """The matrices p and q of (27), with p22 and q22 as mended in docs/method.md."""
    (t1, t2), (w1, w2) = q, dq
    s1, c1, s2, c2 = np.sin(t1), np.cos(t1), np.sin(t2), np.cos(t2)
    s12, c12 = np.sin(t1 + t2), np.cos(t1 + t2)
    p = [
        [s12 / (L1 * s2), c12 / (L1 * s2)],
        [
            -(L1 * s1 + L2 * s12) / (L1 * L2 * s2),
            -(L1 * c1 + L2 * c12) / (L1 * L2 * s2),  # printed without the brackets
        ],
    ]
    rates = [
        [
            c12 / (L1 * s2) * w1 - s1 / (L1 * s2**2) * w2,
            -(s12 / (L1 * s2) * w1 + c1 / (L1 * s2**2) * w2),
        ],
        [
            -(L1 * c1 + L2 * c12) / (L1 * L2 * s2) * w1
            + s1 * (L2 + L1 * c2) / (L1 * L2 * s2**2) * w2,
            (L1 * s1 + L2 * s12) / (L1 * L2 * s2) * w1
            + c1 * (L2 + L1 * c2) / (L1 * L2 * s2**2) * w2,  # printed without the square
        ],
    ]
    return np.array(p), np.array(rates)


@pytest.mark.parametrize("n", [0, 1, 31, 33])
def test_blocks_of_states_end_anywhere(arm, n):
    q, dq, ddq = np.random.default_rng(n).normal(size=(3, n, 2))
    velocity, acceleration = arm.tool_motion(q, dq, ddq)
    jacobian, rate = arm.jacobian(q), arm.jacobian_rate(q, dq)
    np.testing.assert_allclose(velocity, np.einsum("nij,nj->ni", jacobian, dq), atol=1e-14)
    expected = np.einsum("nij,nj->ni", jacobian, ddq) + np.einsum("nij,nj->ni", rate, dq)
    np.testing.assert_allclose(acceleration, expected, atol=1e-14)
    np.testing.assert_array_equal(arm.tool_velocity(q, dq), velocity)
    np.testing.assert_array_equal(arm.tool_acceleration(q, dq, ddq), acceleration)


def test_joint_acceleration_is_27_as_mended(arm):
    rng = np.random.default_rng(3)
    for q in random_joints(50):
        velocity, acceleration = rng.normal(size=(2, 2))
        dq = np.linalg.solve(arm.jacobian(q), velocity)
        p, rates = entries_27(q, dq)
        expected = p @ acceleration + rates @ velocity
        found = arm.joint_acceleration(q, dq, acceleration)
        np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_links_lead_from_the_base_to_the_tool(arm):
    q = random_joints(10)
    points = arm.links(q)
    assert points.shape == (10, 3, 2)
    np.testing.assert_array_equal(points[:, 0], np.tile((L0, 0), (10, 1)))
    lengths = np.linalg.norm(np.diff(points, axis=1), axis=2)
    np.testing.assert_allclose(lengths, np.tile((L1, L2), (10, 1)))
    np.testing.assert_array_equal(points[:, 2], arm.forward(q))


def test_angles_are_measured_from_y_clockwise(arm):
    np.testing.assert_allclose(arm.forward([0, 0]), (L0, L1 + L2), atol=1e-15)
    np.testing.assert_allclose(arm.forward([np.pi / 2, 0]), (L0 + L1 + L2, 0), atol=1e-15)


def test_single_and_many_have_the_shapes_of_their_arguments(arm):
    assert arm.inverse([0.35, 0.1]).shape == (2,)
    assert arm.inverse(np.full((3, 4, 2), 0.2)).shape == (3, 4, 2)
    assert arm.jacobian(np.ones((5, 2))).shape == (5, 2, 2)
    assert arm.dof == 2 and arm.dimension == 2


@pytest.mark.parametrize(
    ("point", "words", "needed", "allowed"),
    [
        ((0.700, 0.0), ("(0.7, 0) m", "0.1 m out of reach", "more than 0.465 m"), 0.565, FAR),
        ((0.145, 0.0), ("(0.145, 0) m", "0.025 m out of reach", "less than 0.035 m"), 0.01, NEAR),
        ((L0 + FAR, 0.0), ("on the edge of the reach", "singular"), FAR, FAR),
        ((L0, NEAR), ("on the edge of the reach", "singular"), NEAR, NEAR),
        ((L0, FAR - 1e-10), ("on the edge of the reach", "singular"), FAR, FAR),
        ((L0, 0.0), ("out of reach",), 0.0, NEAR),
    ],
)
@pytest.mark.parametrize("branch", ["positive", "negative"])
def test_out_of_reach(arm, point, words, needed, allowed, branch, refuses):
    points = [(0.35, 0.1), (0.41, 0.15), point, (9.0, 9.0)]
    refuses(
        lambda: arm.inverse(points, branch),
        ac.Unreachable,
        "PMK-3s",
        "move the path or the arm",
        *words,
        point=point,
        index=2,
        limit="reach",
        needed=needed,
        allowed=allowed,
    )


def test_not_a_number_is_out_of_reach(arm):
    with pytest.raises(ac.Unreachable) as caught:
        arm.inverse([(np.nan, 0.1)])
    assert caught.value.index == 0


def test_a_singular_arm_cannot_move_every_way(arm, refuses):
    straight = [[0.0, 0.0]]
    refuses(
        lambda: arm.joint_velocity(straight, [[1.0, 0.0]]),
        ac.Unreachable,
        "PMK-3s",
        "singular at one of the joint positions",
    )


def test_an_unknown_branch_is_refused(arm, refuses):
    refuses(
        lambda: arm.inverse([0.35, 0.1], "left"),
        ac.InvalidInput,
        "branches positive, negative",
        "'left'",
    )


GOOD = {"name": "a", "base": 0.1, "links": (0.2, 0.3), "limits": ac.Limits()}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"base": np.nan}, ("base", "finite")),
        ({"base": (1, 2)}, ("base", "one number", "not an array of 2")),
        ({"links": (0.0, 0.3)}, ("first link length", "above zero")),
        ({"links": (0.2, -0.3)}, ("second link length", "-0.3 m")),
        ({"links": ("long", 0.3)}, ("first link length", "numbers in m")),
        (
            {"limits": ac.Limits(joint_velocity=[1.0, 2.0, 3.0])},
            ("joint_velocity has 3 values", "2 joints"),
        ),
    ],
)
def test_an_arm_that_is_none_is_refused(change, words, refuses):
    assert ac.PlanarTwoLink(**GOOD).link2 == 0.3
    refuses(lambda: ac.PlanarTwoLink(**GOOD | change), ac.InvalidInput, *words)
