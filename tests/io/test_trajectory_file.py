"""Trajectory files and limits files: what they give, and how a bad one is refused."""

from __future__ import annotations

import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.io import parse_trajectory, read_limits, read_trajectory

ROWS = "\n0,0.1,0.2\n0.5,0.3,0.4\n"


@pytest.mark.parametrize(
    "header",
    [
        "t,q1,q2",
        "t [s],joint 1 [rad],joint 2 [rad]",
        "time,q_1,q_2",
        "T (s), Q1 (rad), Q2 (rad)",
        "t_s,q1_rad,q2_rad",
        "t,shoulder [rad],elbow",
    ],
)
def test_names_and_units_of_columns(header: str) -> None:
    found = parse_trajectory(header + ROWS, ["shoulder", "elbow"])
    np.testing.assert_array_equal(found.t, [0, 0.5])
    np.testing.assert_array_equal(found.q, [[0.1, 0.2], [0.3, 0.4]])
    assert found.dq is None
    assert found.ddq is None
    assert not found.q.flags.writeable


@pytest.mark.parametrize("separator", [",", ";", "\t", " , "])
def test_all_columns_in_any_order_with_comments_and_other_units(separator: str) -> None:
    text = """# from a controller
    ddq 2 [deg/s^2],dq 1 [deg/s],t [ms],q 2 [deg],q1_deg,dq2,ddq1 [rad/s²]
    # the first sample

    180,90,0,45,90,1,2
    180,90,4,45,90,1,2
    """
    found = parse_trajectory(text.replace(",", separator))
    np.testing.assert_allclose(found.t, [0, 4e-3])
    np.testing.assert_allclose(found.q, [[np.pi / 2, np.pi / 4]] * 2)
    assert found.dq is not None
    assert found.ddq is not None
    np.testing.assert_allclose(found.dq, [[np.pi / 2, 1]] * 2)
    np.testing.assert_allclose(found.ddq, [[2, np.pi]] * 2)
    assert found.resolution["t"] == pytest.approx(1e-3)


@pytest.mark.parametrize(
    ("texts", "resolution"),
    [
        (["0.123456", "1.200000", "0.000000"], 1e-6),  # %.6f
        (["1.234567", "0.12", "0"], 1e-6),  # the same, its zeros cut off
        (["1.234560e-01", "1.200000e+00", "0.000000e+00"], 1e-6),  # %.6e: its largest number
        (["0.123457", "12.3457", "0.00123457"], 1e-4),  # %.6g: its largest number
        (["0.1", "0.30000000000000004", "-1.2345678901234567"], 1e-16),  # shortest
        (["12", "-7", "0"], 1),
        ([".5", "1.", "+2.25"], 1e-2),
    ],
)
def test_resolution_is_that_of_the_printed_digits(texts: list[str], resolution: float) -> None:
    rows = "".join(f"{i},{x},0\n" for i, x in enumerate(texts))
    found = parse_trajectory("t,q1,q2\n" + rows)
    assert found.resolution["q"] == pytest.approx(resolution, rel=1e-6)
    in_degrees = parse_trajectory("t,q1 [deg],q2 [deg]\n" + rows)
    assert in_degrees.resolution["q"] == pytest.approx(np.deg2rad(resolution), rel=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "log.csv is empty"),
        ("# nothing\n", "log.csv is empty"),
        ("t,q1,q2\n", "no samples"),
        ("0,0.1,0.2\n1,0.1,0.2\n", "line 1: the first line must name the columns"),
        ("# a\nt,q2,tau1\n0,1,2\n", "line 2: the column q1 is missing.*'tau1' are not known"),
        ("t,q1,q1_deg\n0,1,2\n", "line 1: the columns 'q1' and 'q1_deg' hold the same"),
        ("q1,q2\n0,1\n", "line 1: the column t is missing"),
        ("t,dq1\n0,1\n", "line 1: the column q1 is missing"),
        ("t\n0\n", "line 1: the column q1 is missing"),
        ("t,q1,q3\n0,1,2\n", "line 1: the column q2 is missing"),
        ("t,q1,q2,dq1\n0,1,2,3\n", "line 1: the column dq2 is missing"),
        ("t,q0,q1\n0,1,2\n", "joints count from 1"),
        ("t,q\n0,1\n", "the column q1 is missing.*'q' are not known"),
        ("t [m],q1\n0,1\n", r"the unit 'm' of the column 't \[m\]' is not one that converts to s"),
        ("t,q1 [rad/s]\n0,1\n", "is not one that converts to rad"),
        ("t,q1,dq1 [1/s]\n0,1,2\n", "is not one that converts to rad/s"),
        ("t,q1 []\n0,1\n", "is not one that converts to rad"),
        ("t,q1\n0,1\n1\n", "line 3: 1 values, but 2 columns"),
        ("t,q1\n0,1\n1,2,3\n", "line 3: 3 values, but 2 columns"),
        ("t,q1\n0,1\n\n1,x\n", "line 4: 'x' in the column 'q1' is not a finite number"),
        ("t,q1\n0,1\n1,nan\n", "line 3: 'nan' in the column 'q1'"),
        ("t,q1\n0,1\n1,\n", "line 3: '' in the column 'q1'"),
        ("t,q1\n0,1\n# a\n0,2\n", "line 4: times must increase, but 0 does not come after 0"),
        ("t,q1\n0,1\n1,1_0\n", "line 3: '1_0' in the column 'q1' is not a finite number"),
        ("t,q1\n0,1\n\u0663,1\n", "line 3: '\u0663' in the column 't' is not a finite number"),
        ("t,q1\n0,1\n1,Infinity\n", "line 3: 'Infinity' in the column 'q1'"),
        ("t,q1\n0,1\n1,1e999\n", "line 3: '1e999' in the column 'q1'"),
        ("t,q1\n0,1\n1,0x10\n", "line 3: '0x10' in the column 'q1'"),
        (f"t,q1\n0,1\n1,{'1' * 140_000}\n", "line 3: '1111.*[.]{3} in the column 'q1'"),
        (f't,q1\n0,1\n1,"{"1" * 140_000}"\n', "line 3: .* in the column 'q1' is not a finite"),
        ('t,q1\n0,"1\n1,2\n', "line 2: '\"1' in the column 'q1' is not a finite number"),
        ("t,q1\n0,1\n1,1e308\n", "line 3: '1e308' in the column 'q1' is .* above 10000 rad"),
        ("t,q1 [deg]\n0,1\n1,1e6\n", "line 3: '1e6' in the column 'q1 .deg.' is 1.75e.04 rad"),
        ("t,q1,dq1\n0,1,-2e9\n", "line 2: '-2e9' in the column 'dq1'.*1e.09 rad/s"),
        ("t,q1,ddq1\n0,1,2e12\n", "line 2: '2e12' in the column 'ddq1'.*1e.12 rad/s"),
        ("t,q1\n0,1\n5e-324,1\n1e-323,1\n", "line 3: .*at least 1 ns.*5e-324 comes only"),
        ("t,q1\n0,1\n1e300,1\n", "line 3: '1e300' in the column 't' is .*within 1e.10 s"),
        ("t,q1\n1e9,1\n1000000000.0000005,1\n", "line 3: .*by more than their own rounding"),
    ],
)
def test_anything_else_is_refused_with_its_line(text: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words) as caught:
        parse_trajectory(text, source="log.csv")
    assert str(caught.value).startswith("log.csv")
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_or_no_text(tmp_path: FilePath) -> None:
    with pytest.raises(InvalidInput, match="There is no trajectory file .*none.csv"):
        read_trajectory(tmp_path / "none.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    for place in (tmp_path / "pipe.csv", "/dev/zero"):
        with pytest.raises(InvalidInput, match="is not a regular file"):
            read_trajectory(place)
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InvalidInput, match="not UTF-8"):
        read_trajectory(tmp_path / "binary.csv")


def test_usual_steps_and_large_times_are_read() -> None:
    """Nanoseconds with nine decimals, milliseconds since 1970, and quotes around every cell."""
    fast = parse_trajectory("t,q1\n1.000000001,1\n1.000000002,1\n1.000000003,1\n")
    np.testing.assert_allclose(np.diff(fast.t), 1e-9, rtol=1e-6)
    late = parse_trajectory("t [ms],q1\n1700000000001,1\n1700000000002,1\n")
    np.testing.assert_allclose(np.diff(late.t), 1e-3, rtol=1e-3)
    quoted = parse_trajectory('"t","q1, [deg]"\n"0","1"\n"1","2"\n'.replace(", [deg]", " [deg]"))
    np.testing.assert_allclose(np.rad2deg(quoted.q[:, 0]), [1, 2])


def test_a_bad_number_is_found_after_many_good_lines() -> None:
    """Lines are converted by the thousand; the message still names the one."""
    lines = ["t,q1,q2", *(f"{i},0.5,0.25" for i in range(40_000))]
    assert len(parse_trajectory("\n".join(lines)).t) == 40_000
    lines[30_001] = "30000,0.5,0_5"
    with pytest.raises(InvalidInput, match="line 30002: '0_5' in the column 'q2'") as caught:
        parse_trajectory("\n".join(lines))
    assert caught.value.index == 30_000


def test_a_trajectory_survives_its_file(tmp_path: FilePath, mac: ac.Trajectory) -> None:
    samples = mac.sample(4e-3)
    table = np.column_stack([samples.t, samples.q, samples.dq, samples.ddq])
    file = tmp_path / "mac.csv"
    np.savetxt(file, table, "%.9f", ",", header="t,q1,q2,dq1,dq2,ddq1,ddq2", comments="")
    found = read_trajectory(file)
    for name in ("t", "q", "dq", "ddq"):
        np.testing.assert_allclose(getattr(found, name), getattr(samples, name), atol=6e-10)
        assert found.resolution[name] == pytest.approx(1e-9)


def test_limits_with_units(tmp_path: FilePath, arm: ac.Arm) -> None:
    file = tmp_path / "limits.yaml"
    file.write_text(
        "speed: 150 mm/s\ntool_acceleration: 2\ncentripetal_acceleration: 0.09 m/s^2\n"
        "joint_velocity: [90 deg/s, 1.0]\njoint_deceleration: 0.5 rad/s^2\ndeviation: 0.1 mm\n"
    )
    limits, deviation, _ = read_limits(file, arm)
    assert deviation == pytest.approx(1e-4)
    assert (limits.speed, limits.tool_acceleration) == (0.15, 2)
    assert limits.joint_velocity is not None
    assert limits.joint_acceleration is not None
    assert limits.joint_deceleration is not None
    np.testing.assert_allclose(limits.joint_velocity, [np.pi / 2, 1])
    np.testing.assert_array_equal(limits.joint_acceleration, [0.72, 0.72])  # the arm's own
    np.testing.assert_array_equal(limits.joint_deceleration, [0.5, 0.5])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- 1", "must hold a mapping of limits"),
        ("{", "not valid YAML"),
        ("speeed: 1", "unknown key speeed"),
        ("joint_limits: {elbow_joint: {max_velocity: 3}}", "of MoveIt.* --joint-limits"),
        ("speed: '0.1'", "speed: '0.1' has no unit"),
        ("speed: -1", "speed: must be above zero"),
        ("deviation: 1 s", "deviation: must be a quantity in m"),
        ("joint_velocity: [1, 2, 3]", "3 values.*2 joints"),
        ("joint_lower: [-1, -1]\njoint_upper: [1, 1, 1]", "joint_lower has 2 values.*3"),
        ("joint_acceleration: .nan", "joint_acceleration: must be finite"),
        ("speed: .inf", "speed: must be finite"),
        ("speed: 0", "speed: must be above zero"),
    ],
)
def test_limits_that_are_none(tmp_path: FilePath, arm: ac.Arm, text: str, words: str) -> None:
    (tmp_path / "limits.yaml").write_text(text)
    with pytest.raises(InvalidInput, match=words):
        read_limits(tmp_path / "limits.yaml", arm)
    with pytest.raises(InvalidInput, match="There is no limits file"):
        read_limits(tmp_path / "none.yaml", arm)


def test_columns_that_are_not_known_are_left_out() -> None:
    """Logs of robots have currents, tool poses, states: `check` used to refuse all of it."""
    rows = "\n0,ready,1,2,\n1,ready,1,2,nan\n"
    found = parse_trajectory("t,state,q1,q2,i1 [A]" + rows)
    np.testing.assert_array_equal(found.q, [[1, 2], [1, 2]])
    assert found.left_out == ("state", "i1 [A]")
    assert found.joints == ("q1", "q2")


@pytest.mark.parametrize("names", ["t [ms],-,q1 [deg],dq1", " t [ms], - ,q1_deg,dq 1 [rad/s]"])
@pytest.mark.parametrize("header", ["", "a,b,c,d\n", "# a comment\n"])
def test_columns_can_be_named_beside_the_file(names: str, header: str) -> None:
    found = parse_trajectory(header + "0,x,90,1\n4,x,45,2\n", columns=names)
    np.testing.assert_allclose(found.t, [0, 4e-3])
    np.testing.assert_allclose(found.q, [[np.pi / 2], [np.pi / 4]])
    assert found.dq is not None
    np.testing.assert_allclose(found.dq, [[1], [2]])
    assert found.left_out == ()


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("t,q1", "log.csv, line 1: 3 columns, but names of 2 are given: .* - for each"),
        ("t,q1,q1", "log.csv, --columns: there are two columns 'q1'"),
        ("t,q1 [m],-", "log.csv, --columns: the unit 'm'"),
        ("t,-,-", "log.csv, --columns: the column q1 is missing"),
        ("1,2,3", "log.csv, --columns: the first line must name"),
    ],
)
def test_wrong_names_beside_the_file(columns: str, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        parse_trajectory("0,1,2\n1,1,2\n", source="log.csv", columns=columns)


def test_what_does_not_go_with_a_kind_of_file(tmp_path: FilePath) -> None:
    (tmp_path / "a.csv").write_text("t,q1\n0,1\n1,1\n")
    with pytest.raises(InvalidInput, match="CSV, which has no topics"):
        read_trajectory(tmp_path / "a.csv", topic="/joint_states")
    with pytest.raises(InvalidInput, match="no columns to name"):
        read_trajectory(tmp_path / "a.yaml", columns="t,q1")


def test_joints_of_another_arm_are_said_once():
    names = ("shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3", "flange")
    titles = [f"{kind} {x} [rad{unit}]" for kind, unit in
              (("q", ""), ("dq", "/s"), ("ddq", "/s^2")) for x in names]  # fmt: skip
    text = ",".join(["t [s]", *titles]) + "\n" + ",".join(["0"] * 19) + "\n"
    with pytest.raises(ac.InvalidInput) as raised:
        parse_trajectory(text, ("joint 1", "joint 2"))
    said = str(raised.value)
    assert "has positions of 6 joints ('shoulder', 'elbow', 'wrist_1'" in said
    assert "but the arm has 2 ('joint 1', 'joint 2'): give the arm of the file with --arm." in said
    assert "not known" not in said and "[rad/s]" not in said


def test_many_unknown_columns_are_not_all_named():
    text = ",".join(["t", *(f"x{k}" for k in range(20))]) + "\n" + ",".join(["0"] * 21) + "\n"
    with pytest.raises(ac.InvalidInput, match="'x7' and 12 more are not known"):
        parse_trajectory(text, ("joint 1", "joint 2"))


def test_a_log_in_latin_1_with_names_of_its_own(tmp_path: FilePath) -> None:
    text = "Zeit;Achse 1 für Prüfung\n0;0.5\n1;1.5\n"
    (tmp_path / "KRCIpo.csv").write_bytes(text.encode("latin-1"))
    found = read_trajectory(tmp_path / "KRCIpo.csv", columns="t,q1")
    assert found.t.tolist() == [0.0, 1.0]
    assert found.q.tolist() == [[0.5], [1.5]]


def test_bytes_of_no_text_are_refused(tmp_path: FilePath, refuses: Callable[..., None]) -> None:
    (tmp_path / "a.csv").write_bytes(b"t,q1\n0,\xff\0\n")
    refuses(lambda: read_trajectory(tmp_path / "a.csv"), InvalidInput, "UTF-8")


@pytest.mark.parametrize(
    ("first", "word"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n", "git lfs pull"),
        (b"#ROSBAG V2.0\n\x45\xff\0", "rosbags-convert"),
    ],
)
def test_files_that_stand_for_others_are_named(
    tmp_path: FilePath, refuses: Callable[..., None], first: bytes, word: str
) -> None:
    for name in ("a.csv", "a.bag"):
        (tmp_path / name).write_bytes(first)
        refuses(lambda name=name: read_trajectory(tmp_path / name), InvalidInput, word)


def test_large_numbers_of_joints_take_no_memory() -> None:
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInput):
            parse_trajectory("t,q1,q1000000\n0,1,2\n")
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()
    title = f"q{'9' * 5000}"
    assert parse_trajectory(f"t,q1,{title}\n0,1,2\n").left_out == (title,)
