"""Clearance compared with independent kinematics, triangles and MuJoCo."""

import numpy as np
import pytest
from tests.dynamics_extra import pinocchio

import armcontour as ac
from armcontour.robot.chain import link_poses
from armcontour.robot.scene import Scene
from armcontour.verification.clearance.body_pairs import pairs_of

pinocchio()

from soak import clearance as judge  # noqa: E402


def test_motion_judged_clear_never_touches():
    tally = judge.Tally()
    for name in judge.ARMS:
        arm = ac.load_arm(name)
        for seed in range(5):
            judge.judge_motion(arm, np.random.default_rng(seed), tally, finer=10)
    assert tally.motions == 15 and tally.clear >= 4 and tally.looks > 25_000
    assert tally.touches == 0


def test_the_oracle_reports_contacts_and_has_the_same_kinematics():
    # The elbow folded back to its end: the wrist is in the upper arm.
    arm = ac.load_arm("ur5e")
    checker = judge.Judge(arm.chain, pairs_of(arm, Scene())[0])
    assert checker.touches(np.array([[0, -1.5, 3.1, 0.3, 0, 0]])) > 0
    assert checker.touches(np.array([[0, -1.5, 1.5, -1.5, -1.5, 0]])) == 0
    q = np.random.default_rng(1).uniform(-3, 3, 6)
    mine = np.array(checker.poses(q[None]))[:, 0, :3]
    np.testing.assert_allclose(mine, link_poses(arm.chain, q[None])[0], atol=1e-12)


@pytest.mark.parametrize("name", judge.ARMS)
def test_contacts_agree_with_those_of_mujoco(name):
    pytest.importorskip("mujoco")
    contacts = judge.compare_contacts(ac.load_arm(name), np.random.default_rng(5), 200)
    assert contacts.pairs >= 200 * 15 and contacts.touching >= 5
    assert contacts.worst <= judge.EXCESS and contacts.different <= 2
