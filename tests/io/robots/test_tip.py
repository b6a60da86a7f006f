"""The tip that is chosen where the user names none."""

from __future__ import annotations

import pytest

import armcontour as ac
from armcontour.errors import InvalidInput

# Joints as name, kind, parent link, child link, mimicked joint.
ARM = [(f"a{k}", "revolute", f"l{k - 1}", f"l{k}", "") for k in range(1, 7)]
FRAMES = [("b", "fixed", "l0", "base", ""), ("f", "fixed", "l6", "flange", "")]
TOOL = ("t", "fixed", "flange", "tool0", "")
SENSOR = ("s", "fixed", "flange", "ft_frame", "")
SLIDING = [("left", "prismatic", "l6", "lf", ""), ("right", "prismatic", "l6", "rf", "left")]
HAND = [
    (f"{x}{k}", "revolute", f"{x}_{k - 1}" if k > 1 else "l6", f"{x}_{k}", "")
    for x in "uv"
    for k in (1, 2)
]
SECOND = [("c1", "revolute", "l0", "k1", ""), ("c2", "revolute", "k1", "k2", "")]


def load(tmp_path, joints, **options):
    links = {"l0": None} | dict.fromkeys(x[3] for x in joints)
    text = "".join(f'<link name="{x}"/>' for x in links)
    for name, kind, parent, child, master in joints:
        mimic = f'<mimic joint="{master}"/>' if master else ""
        text += (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 0 0.1"/>{mimic}'
            '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        )
    (tmp_path / "r.urdf").write_text(f'<robot name="r">{text}</robot>')
    return ac.load_arm(tmp_path / "r.urdf", **options)


@pytest.mark.parametrize(
    ("joints", "tip"),
    [
        ([*ARM, *FRAMES, TOOL, SENSOR], "tool0"),
        ([*ARM, *FRAMES, SENSOR], "flange"),
        ([*ARM, *FRAMES], "flange"),
        ([*ARM, FRAMES[0]], "l6"),
        ([*ARM, ("h", "fixed", "l6", "hand", ""), ("p", "fixed", "l0", "plate", "")], "hand"),
        # Two frames without a name of REP 199: the last link itself.
        ([*ARM, ("x", "fixed", "l6", "x", ""), ("y", "fixed", "l6", "y", "")], "l6"),
        # Grippers: one that mimics, two fingers side by side, two fingers of two joints.
        ([*ARM, *FRAMES, *SLIDING], "flange"),
        ([*ARM, *FRAMES, SLIDING[0], ("right", "prismatic", "l6", "rf", "")], "flange"),
        ([*ARM, *FRAMES, TOOL, *HAND], "tool0"),
        # A link that mimics a joint of the arm.
        ([*ARM, *FRAMES, TOOL, ("m", "revolute", "l1", "rod", "a2")], "tool0"),
    ],
)
def test_the_end_of_the_only_chain_is_the_tip(tmp_path, joints, tip):
    arm = load(tmp_path, joints)
    assert arm.joint_names == ("a1", "a2", "a3", "a4", "a5", "a6")
    assert arm.notes[0].startswith(f"r.urdf: the tip is {tip}, at the end of the only chain")
    assert "(in a job, arm: {tip: LINK})" in arm.notes[0]
    named = load(tmp_path, joints, tip=tip)
    assert (named.forward([0.1] * 6) == arm.forward([0.1] * 6)).all()
    assert not any("the tip is" in note for note in named.notes)


@pytest.mark.parametrize(
    "joints",
    [
        [*ARM, *SECOND],
        # One more joint beside the last two is no gripper.
        [*ARM, ("g", "revolute", "l4", "g", "")],
        # Legs: none is longer than the way to it.
        [*SECOND, ("d1", "revolute", "l0", "m1", ""), ("d2", "revolute", "m1", "m2", "")],
    ],
)
def test_of_more_chains_one_must_be_named(tmp_path, joints, refuses):
    refuses(
        lambda: load(tmp_path, joints), InvalidInput,
        "2 links that could be the tip: say which with tip= (in a job, arm: {tip:", "k2" if
        joints[-1] == SECOND[-1] else joints[-1][3],
    )  # fmt: skip


def test_a_locked_joint_does_not_count(tmp_path):
    arm = load(tmp_path, [*ARM, ("g", "revolute", "l5", "g", "")], locked={"g": 0.5})
    assert arm.dof == 6


def test_a_sliding_joint_at_the_end_is_not_left_out_in_silence(tmp_path, refuses):
    # A SCARA's: a part of the arm, which is refused by name.
    scara = [*ARM[:2], ("z", "prismatic", "l2", "z", ""), *FRAMES[:1]]
    refuses(lambda: load(tmp_path, scara), InvalidInput, "Joint z", "is prismatic")
