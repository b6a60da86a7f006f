"""Bags of ROS 2 as logs and trajectories: releases, joints, times, choice of topics, refusals."""

import numpy as np
import pytest
from tests.files.bags import (
    JOINT_STATE,
    RELEASES,
    STAMP,
    STATE,
    controller_state,
    joint_state,
    write_db3,
    write_folder,
)
from tests.files.tables import refusals

import armcontour as ac
from armcontour.control.learning import Recording
from armcontour.core.errors import FileError, InvalidInput
from armcontour.files.log_file import read_run_log

pytest.importorskip("rosbags")

NAMES = ac.load_arm("ur5e").joint_names
ORDER = (2, 1, 0, 3, 5, 4)
COUNT = 60
STEP = 8_000_000
T = 1e-9 * STEP * np.arange(COUNT)
PHASES = np.arange(6)
Q = np.array([0.3, -1.2, 1.5, -1.8, -1.6, 0.4]) + 0.1 * np.sin(9 * T[:, None] + PHASES)
DQ = 0.9 * np.cos(9 * T[:, None] + PHASES)
U = Q + 1e-3
TOPIC = "/arm_controller/controller_state"
JOINTS = "/joint_states"


def arrival(i):
    """Messages arrive irregularly, unlike their stamps."""
    return STAMP + STEP * i + 300_000 + 400_000 * (i % 7)


def spread(values, i, order, spare=()):
    return [*spare, *(values[i, k] for k in order)]


def states(release="humble", *, order=ORDER, prefix="", filled=None, topic=TOPIC, spare=0):
    """States of a controller, with a spare joint if there is a value for it."""
    names = [*["gripper"] * spare, *(prefix + NAMES[k] for k in order)]
    more = [0.5] * spare
    rows = []
    for i in range(COUNT):
        arrays = [spread(x, i, order, more) for x in (U, Q, DQ)]
        data = controller_state(names, STAMP + STEP * i, *arrays, release, filled)
        rows.append((topic, STATE, arrival(i), data))
    return rows


def joints(*, order=ORDER, prefix="", topic=JOINTS, stamped=True, dq=DQ, shift=0.0):
    names = [prefix + NAMES[k] for k in order]
    rows = []
    for i in range(COUNT):
        stamp = STAMP + STEP * i if stamped else 0
        rates = [] if dq is None else spread(dq, i, order)
        data = joint_state(names, stamp, spread(Q + shift, i, order), rates)
        rows.append((topic, JOINT_STATE, arrival(i), data))
    return rows


def check_log(log):
    np.testing.assert_allclose(log.t, T, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(log.command, U)
    np.testing.assert_array_equal(log.measured, Q)


def check_motion(motion):
    np.testing.assert_allclose(motion.t, T, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(motion.q, Q)
    np.testing.assert_array_equal(motion.dq, DQ)


@pytest.mark.parametrize("release", RELEASES)
def test_states_of_each_release_are_logs(release, tmp_path):
    for prefix, spare in (("", 0), ("left_", 1)):
        rows = states(release, prefix=prefix, spare=spare)
        file = write_db3(tmp_path / f"{prefix}run.db3", rows)
        log = read_run_log(file, NAMES, commanded=True)
        check_log(log)
        assert log.joint_names == tuple(prefix + x for x in NAMES)
        check_motion(ac.read_trajectory(file, NAMES))
        in_file = ac.read_log(file)
        order = [prefix + NAMES[k] for k in ORDER]
        assert list(in_file.joint_names) == ["gripper"] * spare + order


def test_points_of_the_other_names_are_read_if_these_are_empty(tmp_path):
    for filled in (("reference", "feedback"), ("desired", "actual")):
        file = write_db3(tmp_path / f"{filled[0]}.db3", states(filled=filled))
        check_log(read_run_log(file, NAMES))


def test_mcap_and_folders_of_bags_are_read(tmp_path):
    rows = states("jazzy")
    folder = write_folder(tmp_path / "run", rows)
    check_log(read_run_log(folder, NAMES))
    check_log(read_run_log(folder / "run.mcap", NAMES))
    for mode in ("FILE", "MESSAGE"):
        packed = write_folder(tmp_path / mode, rows, storage="sqlite3", compression=mode)
        check_log(read_run_log(packed, NAMES))
    with pytest.raises(FileError, match="specify the folder"):
        read_run_log(tmp_path / "MESSAGE" / "MESSAGE.db3", NAMES)
    # A recording that was split, and lost its metadata.
    write_db3(tmp_path / "split" / "run_0.db3", rows[:20])
    write_db3(tmp_path / "split" / "run_1.db3", rows[20:])
    check_log(read_run_log(tmp_path / "split", NAMES))


def test_the_state_of_a_controller_is_preferred_and_named(tmp_path):
    file = write_db3(tmp_path / "run.db3", [*joints(shift=1.0), *states()])
    log = ac.read_log(file)
    assert any(TOPIC in x for x in log.notes)
    check_motion(ac.read_trajectory(file, NAMES))
    shifted = ac.read_trajectory(file, NAMES, topic="joint_states")
    np.testing.assert_array_equal(shifted.q, Q + 1.0)


def test_joint_states_are_recordings_and_trajectories(tmp_path):
    file = write_db3(tmp_path / "run.db3", joints())
    recording = read_run_log(file, NAMES)
    assert isinstance(recording, Recording) and recording.command is None
    np.testing.assert_array_equal(recording.q, Q)
    np.testing.assert_allclose(recording.t, T, rtol=0, atol=1e-12)
    check_motion(ac.read_trajectory(file, NAMES))
    without = write_db3(tmp_path / "plain.db3", joints(dq=None))
    assert ac.read_trajectory(without, NAMES).dq is None
    some = joints(dq=None)[:5] + joints()[5:]
    motion = ac.read_trajectory(write_db3(tmp_path / "some.db3", some), NAMES)
    assert motion.dq is None and any("velocity" in x and "5 messages" in x for x in motion.notes)


def test_each_message_has_its_own_order_and_other_publishers_are_skipped(tmp_path):
    first = joints()
    second = joints(order=(5, 4, 3, 2, 1, 0))
    rows = [*first[:30], *second[30:]]
    for i in range(0, COUNT, 10):
        data = joint_state(["finger"], STAMP + STEP * i + 7, [0.01])
        rows.append((JOINTS, JOINT_STATE, arrival(i) + 1, data))
    motion = ac.read_trajectory(write_db3(tmp_path / "run.db3", rows), NAMES)
    check_motion(motion)
    assert any("6 (finger)" in x for x in motion.notes)


def test_times_are_stamps_and_only_without_them_those_of_arrival(tmp_path):
    rows = joints()
    rows[10] = (*rows[10][:2], rows[13][2] + 1, rows[10][3])
    motion = ac.read_trajectory(write_db3(tmp_path / "late.db3", rows), NAMES)
    check_motion(motion)
    assert any("were sorted: 1" in x for x in motion.notes)
    assert any("1764400000.123456789 s" in x for x in motion.notes)
    motion = ac.read_trajectory(write_db3(tmp_path / "zero.db3", joints(stamped=False)), NAMES)
    arrived = 1e-9 * np.array([arrival(i) - arrival(0) for i in range(COUNT)])
    np.testing.assert_allclose(motion.t, arrived, rtol=0, atol=1e-12)
    assert any("no stamps" in x for x in motion.notes)


def test_several_topics_are_listed_and_one_can_be_chosen(tmp_path):
    other = "/other/controller_state"
    file = write_db3(tmp_path / "run.db3", [*states(), *states(topic=other)])
    message = f"{TOPIC} ... {other} ... --topic {TOPIC}"
    refusals(lambda x: ac.read_log(x), [(file, message)])
    check_log(read_run_log(file, NAMES, topic=other))
    # The arm's names decide between two arms, also in one topic.
    two = [*joints(), *joints(order=(0, 1, 2), prefix="right_", topic="/right/joint_states")]
    check_motion(ac.read_trajectory(write_db3(tmp_path / "two.db3", two), NAMES))


def test_units_and_names_are_specified_as_for_tables(tmp_path):
    rows = []
    for i, (topic, kind, received, _) in enumerate(joints()):
        data = joint_state([f"a{k}" for k in range(6)], STAMP + STEP * i, np.degrees(Q[i]))
        rows.append((topic, kind, received, data))
    file = write_db3(tmp_path / "run.db3", rows)
    refusals(
        lambda x: ac.read_trajectory(x, NAMES), [(file, "6 joints ... 'shoulder_pan_joint=NAME")]
    )
    pairs = ",".join(f"{x} [deg]=measured a{k}" for k, x in enumerate(NAMES))
    motion = ac.read_trajectory(file, NAMES, columns=pairs)
    np.testing.assert_allclose(motion.q, Q, rtol=0, atol=1e-14)


def test_bags_that_cannot_be_used_are_refused(tmp_path):
    only = write_db3(tmp_path / "only.db3", joints())
    wrong = joints()
    names = [NAMES[k] for k in ORDER]
    wrong[4] = (*wrong[4][:3], joint_state(names, STAMP + 4 * STEP, [0.0] * 5))
    nan = joints()
    nan[7] = (*nan[7][:3], joint_state(names, STAMP + 7 * STEP, [np.nan] * 6, [0.0] * 6))
    image = [("/image", "sensor_msgs/msg/Image", STAMP, b"\0\1\0\0")]
    empty = [(JOINTS, JOINT_STATE, STAMP, joint_state(names, STAMP, []))]
    table = tmp_path / "a.csv"
    table.write_text("t,u1,q1\n0,0,0\n1,1,1\n")
    cut = tmp_path / "cut.mcap"
    whole = write_folder(tmp_path / "whole", joints()) / "whole.mcap"
    cut.write_bytes(whole.read_bytes()[:3000])
    (tmp_path / "text.db3").write_text("t,q1\n")
    (tmp_path / "none.mcap").write_bytes(b"")
    files = [
        (only, None, "no commands ... controller_state"),
        (only, "/imu", "'/imu' ... /joint_states (sensor_msgs/msg/JointState)"),
        (write_db3(tmp_path / "wrong.db3", wrong), None, "message 5 of /joint_states ... 5 values"),
        (write_db3(tmp_path / "image.db3", image), None, "/image (sensor_msgs/msg/Image)"),
        (write_db3(tmp_path / "empty.db3", empty), None, "have no positions"),
        (table, "/joint_states", "a.csv is not a bag"),
        (cut, None, "cut.mcap cannot be read as a bag ... Ctrl-C"),
        (tmp_path / "text.db3", None, "text.db3 cannot be read as a bag"),
        (tmp_path / "none.mcap", None, "none.mcap cannot be read as a bag"),
        (tmp_path / "missing.mcap", None, "There is no bag"),
    ]
    refusals(lambda x: ac.read_log(x[0], topic=x[1]), [((f, t), m) for f, t, m in files])
    with pytest.raises(InvalidInput, match="message 8, column .*nan"):
        ac.read_trajectory(write_db3(tmp_path / "nan.db3", nan), NAMES)
