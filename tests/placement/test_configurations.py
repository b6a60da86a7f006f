"""The search for configurations that ends at 8 finds those of the whole search."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.arms.inverse import configurations
from armcontour.placement.configurations import Configurations, has_most_eight

# Six joints with a wrist, as of usual industrial arms; z axes of frames by URDF.
WRIST = """<robot name="wrist"><link name="l0"/>{links}<link name="l6"/>{joints}</robot>"""


def urdf(offset: float) -> str:
    """An arm whose last three axes meet, but for an offset [m]."""
    frames = ["0 0 0.4", "0.1 0 0", "0 0 0.5", "0.05 0 0", "0.45 0 0", f"0 0 {offset}"]
    axes = ["0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0"]
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        '<limit lower="-6" upper="6" velocity="2" effort="50"/></joint>'
        for k, (xyz, axis) in enumerate(zip(frames, axes, strict=True))
    )
    return WRIST.format(links="".join(f'<link name="l{k}"/>' for k in range(1, 6)), joints=joints)


@pytest.mark.parametrize("name", ["ur5e", "ur10e", "wrist"])
def test_it_finds_what_the_whole_search_finds(name: str, tmp_path) -> None:
    (tmp_path / "wrist.urdf").write_text(urdf(0.0))
    arm = ac.load_arm(tmp_path / "wrist.urdf" if name == "wrist" else name)
    assert has_most_eight(arm)
    found = Configurations(arm, 6)
    rng = np.random.default_rng(2)
    counts = set()
    for q in rng.uniform(-np.pi, np.pi, (25, 6)):
        point, turned = (x[0] for x in arm.pose(q[None]))
        pose = np.column_stack([turned, point])
        whole = configurations(arm, pose, 6)
        np.testing.assert_array_equal(found.find(arm, pose, None), whole)
        counts.add(len(whole))
    # Some poses have all of them, others fewer, and none has more.
    assert max(counts) == 8 and len(counts) > 1


def test_other_arms_are_searched_to_the_end(tmp_path) -> None:
    (tmp_path / "wrist.urdf").write_text(urdf(0.08))
    offset = ac.load_arm(tmp_path / "wrist.urdf")
    assert not has_most_eight(offset) and not has_most_eight(ac.load_arm("panda"))
