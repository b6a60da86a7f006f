"""Closed-form inverse kinematics, compared with the search for other arms."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.robot.inverse_kinematics import configurations, search

# Six joints with a spherical wrist, as in usual industrial arms; z axes as in URDF.
WRIST = """<robot name="wrist"><link name="l0"/>{links}<link name="l6"/>{joints}</robot>"""


def urdf(offset):
    """An arm whose last three axes meet, but for an offset [m]."""
    frames = ["0 0 0.4", "0.1 0 0", "0 0 0.5", "0.05 0 0", "0.45 0 0", f"0 0 {offset}"]
    axes = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        '<limit lower="-6" upper="6" velocity="2" effort="50"/></joint>'
        for k, (xyz, axis) in enumerate(zip(frames, axes, strict=True))
    )
    return WRIST.format(
        links="".join(f'<link name="l{k}"/>' for k in range(1, 6)), joints=joints
    ).replace('"l6"', '"tool0"')


@pytest.fixture(scope="module")
def arms(tmp_path_factory):
    """Arms with a tool, somewhere before their work."""
    file = tmp_path_factory.mktemp("arms") / "wrist.urdf"
    file.write_text(urdf(0.0))
    tool = ac.Frame.rpy((0.01, 0.02, 0.1), (0.1, 0.2, 0.3))
    work = ac.Frame.rpy((0.1, 0.2, 0.3), (1, 2, 3))
    names = {"ur5e": "ur5e", "ur10e": "ur10e", "wrist": file}
    return {k: ac.load_arm(x).with_tool(tool).with_work(work) for k, x in names.items()}


def poses_of(arm, q):
    points, turned = arm.pose(q)
    return np.concatenate([turned, points[..., None]], axis=2)


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "wrist"])
def test_the_closed_form_finds_the_same_configurations_as_the_search(arms, name):
    arm = arms[name]
    assert arm.closed_form is not None and arm.closed_form.wrist == (name == "wrist")
    rng = np.random.default_rng(2)
    counts = set()
    for pose in poses_of(arm, rng.uniform(-np.pi, np.pi, (25, 6))):
        closed = configurations(arm, pose, 6)
        searched = search(arm, pose, 6)
        assert len(closed) == len(searched)
        for q in searched:
            apart = np.abs(np.angle(np.exp(1j * (closed - q)))).max(axis=1)
            assert apart.min() < 1e-9
        counts.add(len(searched))
    # Some poses have all of them, others fewer, and none has more.
    assert max(counts) == 8 and len(counts) > 1


@pytest.mark.parametrize("name", ["ur5e", "wrist"])
def test_singular_poses_are_solved_by_search_instead_of_the_closed_form(arms, name):
    arm = arms[name]
    q = np.array([[0.3, -1.2, 1.4, -0.5, 0.0, 0.7]])
    pose = poses_of(arm, q)[0]
    assert arm.closed_form.solve(arm.chain.base.matrix, pose) is None
    np.testing.assert_array_equal(configurations(arm, pose, 6), search(arm, pose, 6))


def test_arms_of_another_geometry_have_no_closed_form(tmp_path):
    (tmp_path / "wrist.urdf").write_text(urdf(0.08))
    for arm in (ac.load_arm(tmp_path / "wrist.urdf"), ac.load_arm("panda")):
        assert arm.closed_form is None
