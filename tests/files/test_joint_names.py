"""Joints of logs whose names have other prefixes or suffixes than those of the arm."""

import itertools

import numpy as np
import pytest
from tests.files.bags import STAMP, STATE, controller_state, write_db3, write_folder

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files.log_file import read_run_log
from armcontour.motion.log import arrange_joints, match_joints

NAMES = ac.load_arm("ur5e").joint_names
# Order of the joints in a file.
ORDER = (2, 1, 0, 3, 5, 4)
COUNT = 60
STEP = 8_000_000
T = 1e-9 * STEP * np.arange(COUNT)
Q = np.array([0.3, -1.2, 1.5, -1.8, -1.6, 0.4]) + 0.1 * np.sin(9 * T[:, None] + np.arange(6))
U = Q + 1e-3
# Prefix and suffix in the file, and of the arm's joints.
AFFIXES = [
    ("robot1/", "", "", ""),
    ("left_", "", "", ""),
    ("robot1/", "", "left_", ""),
    ("", "_left", "", ""),
    ("cell/", "_1", "left_", "_right"),
    ("", "", "left_", ""),
]


def write_csv(file, names):
    titles = ["t", *(f"command {x}" for x in names), *(f"measured {x}" for x in names)]
    order = [*ORDER] * (len(names) // len(ORDER))
    rows = np.column_stack([T, U[:, order], Q[:, order]])
    np.savetxt(file, rows, "%.17g", ",", header=",".join(titles), comments="")
    return file


def messages(names, release):
    order = [*ORDER] * (len(names) // len(ORDER))
    rows = []
    for i in range(COUNT):
        stamp = STAMP + STEP * i
        arrays = [x[i, order].tolist() for x in (U, Q, np.zeros_like(Q))]
        data = controller_state(names, stamp, *arrays, release)
        rows.append(("/c/controller_state", STATE, stamp, data))
    return rows


def write(kind, folder, names):
    """Write a log of joints in the order `ORDER`; returns the file."""
    if kind == "csv":
        return write_csv(folder / "log.csv", names)
    pytest.importorskip("rosbags")
    if kind == "db3":
        return write_db3(folder / "log.db3", messages(names, "humble"))
    return write_folder(folder / "bag", messages(names, "jazzy")) / "bag.mcap"


@pytest.mark.parametrize("affixes", AFFIXES)
@pytest.mark.parametrize("kind", ["csv", "db3", "mcap"])
def test_joints_are_matched_without_prefixes_and_suffixes(kind, affixes, tmp_path):
    prefix, suffix, arm_prefix, arm_suffix = affixes
    in_file = [prefix + NAMES[k] + suffix for k in ORDER]
    of_arm = [arm_prefix + x + arm_suffix for x in NAMES]
    file = write(kind, tmp_path, in_file)
    for log in (arrange_joints(ac.read_log(file), of_arm), read_run_log(file, of_arm)):
        np.testing.assert_allclose(log.command, U, rtol=0, atol=1e-15)
        np.testing.assert_allclose(log.measured, Q, rtol=0, atol=1e-15)
        # The note states all pairs.
        assert any(all(x in note for x in (*in_file, *of_arm)) for note in log.notes)


def test_equal_names_need_no_note(tmp_path):
    file = write("csv", tmp_path, [NAMES[k] for k in ORDER])
    assert not arrange_joints(ac.read_log(file), NAMES).notes


@pytest.mark.parametrize("kind", ["csv", "db3", "mcap"])
@pytest.mark.parametrize("ends", [("left_", "", "right_", ""), ("", "_left", "", "_right")])
@pytest.mark.parametrize("arm_prefix", ["", "old_"])
def test_two_robots_are_refused_until_one_is_ignored(kind, ends, arm_prefix, tmp_path):
    pairs = (ends[:2], ends[2:])
    names = [prefix + NAMES[k] + suffix for prefix, suffix in pairs for k in ORDER]
    of_arm = [arm_prefix + x for x in NAMES]
    file = write(kind, tmp_path, names)
    with pytest.raises(InvalidInput) as refused:
        arrange_joints(ac.read_log(file), of_arm)
    message = str(refused.value)
    for prefix, suffix in pairs:
        assert repr(prefix + NAMES[0] + suffix) in message
    # The remedy of the message works.
    columns = message.split("--columns '")[1].split("'")[0]
    log = arrange_joints(ac.read_log(file, columns=columns), of_arm)
    np.testing.assert_allclose(log.measured, Q, rtol=0, atol=1e-15)


def test_names_that_differ_otherwise_are_not_matched():
    numbered = [f"joint_{k}" for k in range(1, 7)]
    for names, requested in (
        ([f"axis_{k}" for k in range(1, 7)], numbered),
        ([f"a{k}" for k in range(1, 7)], numbered),
        (["left_elbow", "right_wrist"], ["r1/elbow", "r1/wrist"]),
        (["elbow_joint", "spare"], ["elbow_joint", "wrist_joint"]),
        (["myelbow", "mywrist"], ["elbow", "wrist"]),
    ):
        assert match_joints(names, requested, "log.csv") is None


def test_matches_do_not_depend_on_the_order():
    names = [f"robot1/{x}_left" for x in NAMES]
    requested = [f"old_{x}" for x in NAMES]
    for order in itertools.islice(itertools.permutations(range(6)), 0, 720, 37):
        found = match_joints([names[k] for k in order], requested, "log.csv")
        assert found == [order.index(k) for k in range(6)]
