"""All configurations of Universal Robots' arms against their closed form."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.oracle import ur_inverse

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.planning.tracing import trace_all
from armcontour.robot.inverse_kinematics import configurations

POSES = 60
# Closer than this to where two configurations meet, one is as good as two.
SINGULAR = 0.02


def apart(first, second):
    """Largest joint angle between every two joint positions, whole turns left out."""
    differences = np.mod(first[:, None] - second[None] + np.pi, 2 * np.pi) - np.pi
    return np.abs(differences).max(axis=2)


@pytest.mark.parametrize("name", ["ur5e", "ur10e"])
def test_every_configuration_is_found_at_random_poses(name):
    arm = ac.load_arm(name)
    counts = []
    for q in np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, 6)):
        point, rotation = arm.pose(q)
        closed_form, margin = ur_inverse.solutions(name, point, rotation)
        if len(closed_form) == 0 or margin.min() < SINGULAR:
            continue
        np.testing.assert_allclose(
            arm.tool_position(closed_form), np.tile(point, (len(closed_form), 1)), atol=1e-9
        )
        solutions = configurations(arm, np.column_stack([rotation, point]), 6)
        between = apart(closed_form, solutions)
        assert between.min(axis=1).max() < 1e-6
        assert len(solutions) == len(closed_form)
        assert (
            apart(closed_form, q[None]).min() < 1e-6
        )  # the oracle knows the one that it was made of
        counts.append(len(closed_form))
    assert len(counts) > 0.8 * POSES and set(counts) >= {4, 8}


def test_a_trace_starts_in_every_configuration_that_can_follow():
    arm = ac.load_arm("ur5e")
    path = ac.Path.polyline([(0.4, -0.2, 0.3), (0.42, -0.15, 0.32)])
    path = path.oriented(np.diag([1.0, -1.0, -1.0]))
    closed_form, _ = ur_inverse.solutions("ur5e", path(0.0), path.orientation(0.0))
    traced = trace_all(path, arm)
    starts = np.array([x(0.0) for x in traced])
    assert len(closed_form) == len(starts) == 8
    between = apart(closed_form, starts)
    assert (between.min(axis=1) < 1e-9).all() and (between.min(axis=0) < 1e-9).all()
    # And stays in it: at the end, each is another one of the eight there.
    ends = np.array([x(path.length) for x in traced])
    closed_form, _ = ur_inverse.solutions("ur5e", path(path.length), path.orientation(path.length))
    assert sorted(np.argmin(apart(ends, closed_form), axis=1)) == list(range(8))


def test_derivatives_are_those_of_the_closed_form():
    """dq_ds and d2q_ds2 against differences of high order of the closed form."""
    arm = ac.load_arm("ur5e").with_tool(Frame.rpy([0.03, 0.02, 0.1], [0.1, 0.2, 0.3]))
    tool = arm.chain.tool.inverse
    turns = Rotation.from_rotvec([[0, 0, 0], [0.2, 0.3, -0.1], [0.1, 0.5, 0.2]])
    path = ac.Path.polyline([(0.4, -0.2, 0.3), (0.5, 0.1, 0.35), (0.35, 0.3, 0.3)])
    path = path.oriented(turns * Rotation.from_matrix(np.diag([1.0, -1.0, -1.0])))
    path = ac.round_corners(path, tolerance=0.02, angular_tolerance=0.3)
    traced = ac.trace(path, arm)

    def closed(s, near):
        held = Frame(position=path(s), rotation=path.orientation(s)) @ tool
        closed_form, _ = ur_inverse.solutions("ur5e", held.position, held.rotation)
        best = closed_form[np.argmin(apart(closed_form, near[None])[:, 0])]
        return near + np.mod(best - near + np.pi, 2 * np.pi) - np.pi

    h = 2e-4
    weights = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60
    bends = np.array([2, -27, 270, -490, 270, -27, 2]) / 180
    cuts = np.union1d(path.breaks, path.orientation.breaks)
    checked = 0
    for s in traced.breaks[1:-1]:
        if np.abs(cuts - s).min() < 4 * h:  # differences must not reach over a break
            continue
        q = np.array([closed(s + k * h, traced(s)) for k in range(-3, 4)])
        np.testing.assert_allclose(traced(s), q[3], atol=1e-11)
        first = weights @ q / h
        second = bends @ q / h**2
        np.testing.assert_allclose(traced(s, 1), first, atol=1e-8 * np.abs(first).max())
        np.testing.assert_allclose(traced(s, 2), second, atol=1e-5 * np.abs(second).max())
        checked += 1
    assert checked > 20
