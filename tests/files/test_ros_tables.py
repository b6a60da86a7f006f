"""CSV of ROS topics, whose cells name the joints in any order."""

import re

import numpy as np
import pytest
from tests.files.tables import parse_log, refusals

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_trajectory
from armcontour.files.log_file import read_run_log

ARM = ac.load_arm("ur5e")
NAMES = ARM.joint_names
COUNT = 60
T = 0.008 * np.arange(COUNT)
EPOCH = 1_764_400_000
PHASES = np.arange(6)
Q = np.array([0.3, -1.2, 1.5, -1.8, -1.6, 0.4]) + 0.1 * np.sin(9 * T[:, None] + PHASES)
DQ = 0.9 * np.cos(9 * T[:, None] + PHASES)
U = Q + 1e-3
ORDERS = ((2, 1, 0, 3, 4, 5), (0, 1, 2, 3, 4, 5), (5, 3, 1, 0, 2, 4))


def numbers(values, i, order):
    return [f"{values[i, k]:.9f}" for k in order]


def rostopic(order, names=NAMES, state=False):
    """`rostopic echo -p` of JointState, or of the state of a controller."""
    arrays = {"position": Q, "velocity": DQ, "effort": 50 * Q}
    name = "name"
    if state:
        arrays = {"desired.positions": U, "actual.positions": Q, "actual.velocities": DQ}
        name = "joint_names"
    titles = ["%time", "field.header.seq", "field.header.stamp", "field.header.frame_id"]
    titles += [f"field.{x}{k}" for x in (name, *arrays) for k in range(6)]
    lines = [",".join(titles)]
    for i in range(COUNT):
        stamp = EPOCH * 10**9 + 8_000_000 * i
        # Messages arrive irregularly.
        cells = [str(stamp + 300_000 + 50_000 * (i % 7)), str(i), str(stamp), ""]
        cells += [names[k] for k in order]
        lines.append(",".join(cells + [x for y in arrays.values() for x in numbers(y, i, order)]))
    return "\n".join(lines) + "\n"


def ros2(order, names=NAMES, arrays=(Q, DQ, 50 * Q), frame=""):
    """`ros2 topic echo --csv` of JointState."""
    lines = []
    for i in range(COUNT):
        stamp = EPOCH * 10**9 + 8_000_000 * i
        cells = [str(stamp // 10**9), str(stamp % 10**9), frame, *(names[k] for k in order)]
        lines.append(",".join(cells + [x for y in arrays for x in numbers(y, i, order)]))
    return "\n".join(lines) + "\n"


def table(order):
    """A table with columns of names that no program writes."""
    titles = ["t", *"abcdef", *(f"q{k}" for k in range(1, 7))]
    lines = [",".join(titles)]
    for i in range(COUNT):
        lines.append(",".join([f"{T[i]:.6f}", *(NAMES[k] for k in order), *numbers(Q, i, order)]))
    return "\n".join(lines) + "\n"


def prefixed(text):
    for name in NAMES:
        text = text.replace(name, f"left_{name}")
    return text


def check_positions(trajectory, epoch=EPOCH):
    np.testing.assert_allclose(trajectory.q, Q, atol=1e-8)
    np.testing.assert_allclose(trajectory.t - epoch, T, atol=1e-6)


def test_joints_of_a_topic_are_those_of_the_arm():
    for order in ORDERS:
        for text in (rostopic(order), rostopic(order, state=True), ros2(order, frame="base")):
            for written in (text, prefixed(text)):
                trajectory = parse_trajectory(written, NAMES)
                check_positions(trajectory)
                np.testing.assert_allclose(trajectory.dq, DQ, atol=1e-8)
                assert any("shoulder_pan_joint" in x for x in trajectory.notes)
        check_positions(parse_trajectory(ros2(order, arrays=(Q,)), NAMES))
        # Of two arrays, the second one can be velocities or efforts.
        two = parse_trajectory(ros2(order, arrays=(Q, 50 * Q)), NAMES)
        check_positions(two)
        assert two.dq is None and "velocity_or_effort[0]" in two.left_out
        again = parse_trajectory(
            ros2(order, arrays=(Q, DQ)), NAMES, columns="dq#=velocity_or_effort[#]"
        )
        np.testing.assert_allclose(again.dq, DQ, atol=1e-8)
        check_positions(parse_trajectory(table(order), NAMES), 0.0)


def test_columns_by_number_do_not_exchange_joints():
    for order in ORDERS:
        text = rostopic(order)
        for columns in ("t [ns]=%time,q#=field.position#", "q#=field.position#,-=field.name*"):
            read = parse_trajectory(text, NAMES, columns=columns)
            np.testing.assert_allclose(read.q, Q, atol=1e-8)
        listed = ["-", "-", "t [ns]", *["-"] * 7, *(f"q{k}" for k in range(1, 7)), *["-"] * 12]
        check_positions(parse_trajectory(text, NAMES, columns=",".join(listed)))
        listed = ["sec", "nanosec", *["-"] * 7, *(f"q{k}" for k in range(1, 7)), *["-"] * 12]
        check_positions(parse_trajectory(ros2(order), NAMES, columns=",".join(listed)))
        # Of some positions only.
        one = f"q1=position[{order.index(0)}]"
        few = parse_trajectory(ros2(order), NAMES[:1], columns=f"-=position*,{one}")
        np.testing.assert_allclose(few.q[:, 0], Q[:, 0], atol=1e-8)


def test_other_names_are_refused_with_a_remedy_that_works():
    others = [f"a{k + 1}" for k in range(6)]
    for order in ORDERS:
        text = ros2(order, names=others)
        with pytest.raises(InvalidInput, match=r"6 joints.*'shoulder_pan_joint=NAME,.*position\[0"):
            parse_trajectory(text, NAMES)
        one = [*NAMES[:5], "a6"]
        with pytest.raises(InvalidInput, match=r"'wrist_3_joint=position\[\d\]'") as refused:
            parse_trajectory(ros2(order, names=one), NAMES)
        columns = re.search(r"--columns '(.*?)'", str(refused.value))[1]
        check_positions(parse_trajectory(ros2(order, names=one), NAMES, columns=columns))
        columns = ",".join(f"{NAMES[k]}=position[{i}]" for i, k in enumerate(order))
        read = parse_trajectory(text, NAMES, columns=columns)
        check_positions(read)
        np.testing.assert_allclose(read.dq, DQ, atol=1e-8)
    swapped = "elbow_joint=field.position2,shoulder_pan_joint=field.position0"
    lines = ros2(ORDERS[0]).splitlines()
    lines[7] = lines[7].replace(NAMES[2], "x").replace(NAMES[0], NAMES[2]).replace("x", NAMES[0])
    twice = [*NAMES[:5], NAMES[0]]
    refusals(
        lambda x: parse_trajectory(x[0], NAMES, columns=x[1]),
        [
            ((rostopic(ORDERS[0]), swapped), "'field.position0' ... 'elbow_joint' of the arm"),
            (("\n".join(lines), None), "line 8 ... 'shoulder_pan_joint' ... 'elbow_joint'"),
            ((ros2(ORDERS[1], names=twice), None), "both are of the joint 'shoulder_pan_joint'"),
        ],
    )


def test_columns_option_selects_one_of_two_arms_in_a_message():
    """Both arms in one message, as two publishers of a cell are often merged."""
    rows = []
    left, right = (ros2(ORDERS[0], [f"{side}_{x}" for x in NAMES]) for side in ("left", "right"))
    for a, b in zip(left.splitlines(), right.splitlines(), strict=True):
        a, b = a.split(","), b.split(",")
        cells = a[:3]
        for k in range(3, 27, 6):
            cells += [*a[k : k + 6], *b[k : k + 6]]
        rows.append(",".join(cells))
    text = "\n".join(rows)
    with pytest.raises(InvalidInput, match="can both be the joint") as refused:
        parse_trajectory(text, NAMES)
    columns = str(refused.value).split("'")[-2]
    check_positions(parse_trajectory(text, NAMES, columns=columns))


def test_texts_that_are_not_names_of_joints_are_ignored():
    lines = table(ORDERS[1]).splitlines()
    rows = [f"{x.split(',')[0]},ur5e,{','.join(x.split(',')[7:])}" for x in lines]
    rows[0] = rows[0].replace("ur5e", "name1")
    check_positions(parse_trajectory("\n".join(rows), NAMES), 0.0)


def test_messages_without_titles_name_the_option():
    """The state of a controller, whose layout a row without titles does not tell."""
    rows = [x + ",1.5" for x in ros2(ORDERS[0]).splitlines()]
    with pytest.raises(InvalidInput, match="must name the columns.*--columns"):
        parse_trajectory("\n".join(rows), NAMES)
    listed = ["sec", "nanosec", *["-"] * 7, *(f"q{k}" for k in range(1, 7)), *["-"] * 13]
    check_positions(parse_trajectory("\n".join(rows), NAMES, columns=",".join(listed)))


def test_samples_in_another_order_than_the_arm_are_refused_by_check(tmp_path):
    trajectory = parse_trajectory(rostopic(ORDERS[0]))
    assert trajectory.joints == tuple(NAMES[k] for k in ORDERS[0])
    with pytest.raises(InvalidInput, match="joint names of the arm"):
        ac.check(trajectory, ARM)
    (tmp_path / "a.csv").write_text(rostopic(ORDERS[0]))
    right = ac.check(ac.read_trajectory(tmp_path / "a.csv", NAMES), ARM)
    plain = ac.check(parse_trajectory(table(ORDERS[1]), NAMES), ARM)
    assert right["joint_upper"].value == pytest.approx(plain["joint_upper"].value, abs=1e-8)


def test_logs_of_a_controller_have_the_joints_of_the_arm(tmp_path):
    text = rostopic(ORDERS[2], state=True)
    (tmp_path / "log.csv").write_text(text)
    log = read_run_log(tmp_path / "log.csv", NAMES, commanded=True)
    assert log.joint_names == NAMES
    np.testing.assert_allclose(log.measured, Q, atol=1e-8)
    np.testing.assert_allclose(log.command, U, atol=1e-8)
    in_file = parse_log(text)
    assert in_file.joint_names == tuple(NAMES[k] for k in ORDERS[2])
    np.testing.assert_allclose(in_file.measured, Q[:, ORDERS[2]], atol=1e-8)
    other = rostopic(ORDERS[2], names=[f"a{k}" for k in range(6)], state=True)
    (tmp_path / "log.csv").write_text(other)
    with pytest.raises(InvalidInput, match="6 joints"):
        read_run_log(tmp_path / "log.csv", NAMES, commanded=True)
