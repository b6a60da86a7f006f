"""Files of trajectories, limits and logs: values and refusals."""

import os

import numpy as np
import pytest
from tests.files.tables import refusals, values

from armcontour.control.learning import Recording
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_trajectory, read_limits, read_trajectory
from armcontour.files.log_file import read_run_log
from armcontour.motion import Log

ROWS = "\n0,0.1,0.2\n0.5,0.3,0.4\n"


@pytest.fixture
def read(tmp_path):
    def from_bytes(content, name="a.csv", **options):
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
        return read_trajectory(tmp_path / name, **options)

    return from_bytes


def test_names_and_units_of_columns_are_read():
    for header in (
        "t,q1,q2",
        "t [s],joint 1 [rad],joint 2 [rad]",
        "time,q_1,q_2",
        "T (s), Q1 (rad), Q2 (rad)",
        "t,shoulder [rad],elbow",
    ):
        trajectory = parse_trajectory(header + ROWS, ["shoulder", "elbow"])
        np.testing.assert_array_equal(trajectory.t, [0, 0.5])
        np.testing.assert_array_equal(trajectory.q, [[0.1, 0.2], [0.3, 0.4]])
        assert trajectory.dq is None and trajectory.ddq is None
        assert not trajectory.q.flags.writeable


def test_columns_are_read_in_any_order_with_comments_and_other_units():
    text = """# from a controller
    ddq 2 [deg/s^2],dq 1 [deg/s],t [ms],q 2 [deg],q1 [deg],dq2,ddq1 [rad/s²]
    # the first sample

    180,90,0,45,90,1,2
    180,90,4,45,90,1,2
    """
    for separator in (",", ";", "\t", " , "):
        trajectory = parse_trajectory(text.replace(",", separator))
        np.testing.assert_allclose(trajectory.t, [0, 4e-3])
        np.testing.assert_allclose(trajectory.q, [[np.pi / 2, np.pi / 4]] * 2)
        np.testing.assert_allclose(trajectory.dq, [[np.pi / 2, 1]] * 2)
        np.testing.assert_allclose(trajectory.ddq, [[2, np.pi]] * 2)
        assert trajectory.resolution["t"] == pytest.approx(1e-3)


def test_the_resolution_of_a_file_follows_from_its_printed_digits():
    for texts, resolution in (
        (["0.123456", "1.200000", "0.000000"], 1e-6),  # %.6f
        (["1.234567", "0.12", "0"], 1e-6),  # the same, its zeros cut off
        (["1.234560e-01", "1.200000e+00", "0.000000e+00"], 1e-6),  # %.6e: its largest number
        (["0.123457", "12.3457", "0.00123457"], 1e-4),  # %.6g: its largest number
        (["0.1", "0.30000000000000004", "-1.2345678901234567"], 1e-16),  # shortest
        (["12", "-7", "0"], 1),
        ([".5", "1.", "+2.25"], 1e-2),
    ):
        rows = "".join(f"{i},{x},0\n" for i, x in enumerate(texts))
        trajectory = parse_trajectory("t,q1,q2\n" + rows)
        assert trajectory.resolution["q"] == pytest.approx(resolution, rel=1e-6), texts
        in_degrees = parse_trajectory("t,q1 [deg],q2 [deg]\n" + rows)
        assert in_degrees.resolution["q"] == pytest.approx(np.deg2rad(resolution), rel=1e-6), texts


# Lines end at /.
BAD = f"""
=> log.csv is empty
# nothing/ => log.csv is empty
t,q1,q2/ => no rows
# a/t,q2,tau1/0,1,2/ => line 2: the column q1 is missing ... 'tau1' are not recognized
t,q1,q_1/0,1,2/ => line 1: the columns 'q1' and 'q_1' have the same quantity
q1,q2/0,1/ => line 1: the column t is missing
t,q1,q3/0,1,2/ => line 1: the column q2 is missing
t [m],q1/0,1/ => the unit 'm' of the column 't [m]' must be convertible to s
t,q1/0,1/1/ => line 3: the row has 1 values, but must have 2
t,q1/0,1//1,x/ => line 4, column 'q1': 'x' is not a finite number
t,q1/0,1/# a/0,2/ => line 4, column 't': '0' is 0.0 s, but times must increase
t,q1/0,1/1,{"1" * 140_000}/ => line 3, column 'q1': '1111
t,q1/0,1/1,"{"1" * 140_000}"/ => line 3: field larger
t,q1/0,"1/1,2/ => line 2: ... quotes
t,q1/0,1/1,1e308/ => line 3, column 'q1': '1e308' is ... more than 10000 rad
t,q1 [deg]/0,1/1,1e6/ => line 3, column 'q1 [deg]': '1e6' is 1.75e+04 rad
t,q1/0,1/5e-324,1/1e-323,1/ => line 3, ... at least 1 ns
t,q1/0,1/1e300,1/ => line 3, column 't': '1e300' is ... within 1e+10 s
t,q1/1e9,1/1000000000.0000005,1/ => line 3, ... more than their rounding
"""


def test_invalid_rows_are_refused_with_their_line():
    def parse(text):
        return parse_trajectory(text.replace("/", "\n").replace(":", "/"), source="log.csv")

    refusals(parse, BAD, "log.csv")
    tokens = ("nan", "", "1_0", "\u0663", "Infinity", "1e999", "0x10")
    words = "log.csv, line 3, column 'q1': '{}' is not a finite number"
    refusals(parse, [(f"t,q1/0,1/1,{x}/", words.format(x)) for x in tokens])
    clocks = ("2024-03-01T12:00:00.000", "1.3.2024", "12:00:00.008", "2024/03/01 12:00")
    rows = [f"t,q1\n{x},1\n" for x in clocks]
    refusals(parse_trajectory, [(x, "is not a finite number") for x in rows])


def test_missing_and_binary_files_are_refused(tmp_path, read):
    os.mkfifo(tmp_path / "pipe.csv")
    places = [
        ("none.csv", "There is no trajectory file ... none.csv"),
        ("pipe.csv", "is not a regular file"),
        ("/dev/zero", "is not a regular file"),
    ]
    refusals(lambda x: read_trajectory(tmp_path / x), places)
    lfs = b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n"
    # Some columns occur in files of other programs.
    contents = [
        (b"\xff\xfe\x00", "not UTF-8"),
        (b"t,q1\n0,\xff\0\n", "UTF-8"),
        (lfs, "git lfs pull"),
        (b"#ROSBAG V2.0\n\x45\xff\0", "a bag of ROS 1 ... rosbags-convert"),
    ]
    refusals(read, contents)
    refusals(lambda x: read(x, "a.bag"), contents[2:])
    text = "t,q1\n0,1\n1,1\n"
    with pytest.raises(InvalidInput, match="no columns"):
        read(text, "a.yaml", columns="t,q1")


LIMITS = """
speed: 150 mm/s => {speed: 0.15}
tool_acceleration: 2 => {tool_acceleration: 2, joint_acceleration: [0.72, 0.72]}
centripetal_acceleration: 0.09 m/s^2 => {centripetal_acceleration: 0.09}
joint_velocity: [90 deg/s, 1.0] => {joint_velocity: [1.5707963267948966, 1]}
joint_acceleration: [[-0.5 rad/s^2, 0.6]] => {joint_acceleration: [[-0.5, 0.6], [-0.5, 0.6]]}
joint_velocity: [[-90 deg/s, 1], [-2, 3]] => {joint_velocity: [[-1.5707963267948966, 1], [-2, 3]]}
"""
BAD_LIMITS = r"""
- 1 => must be a mapping of limits
{ => not valid YAML
joint_limits: {elbow_joint: {max_velocity: 3}} => of MoveIt ... arm.joint_limits
deviation: 1 s => deviation: must be a quantity in m
joint_velocity: [1, 2, 3] => 3 values ... 2 joints
speed: 0 => speed: must be above zero
"""


def test_a_limits_file_contains_quantities_or_none(tmp_path, arm):
    def read(text):
        (tmp_path / "limits.yaml").write_text(text)
        return read_limits(tmp_path / "limits.yaml", arm)

    values(lambda text: read(text).limits, LIMITS)
    required = read("deviation: 0.1 mm")
    assert required.deviation == 1e-4 and required.orientation_deviation is None
    refusals(read, BAD_LIMITS)
    none = [(tmp_path / "none.yaml", "There is no limits file")]
    refusals(lambda x: read_limits(x, arm), none)


def test_an_option_names_unknown_columns(read):
    # Logs of robots have currents, tool poses, states.
    trajectory = parse_trajectory("t,state,q1,q2,i1 [A]\n0,ready,1,2,\n1,ready,1,2,nan\n")
    np.testing.assert_array_equal(trajectory.q, [[1, 2], [1, 2]])
    assert trajectory.left_out == ("state", "i1 [A]") and trajectory.joints == ("q1", "q2")
    for names in ("t [ms],-,q1 [deg],dq1", " t [ms], - ,q1 [deg],dq 1 [rad/s]"):
        for header in ("", "a,b,c,d\n", "# a comment\n"):
            trajectory = parse_trajectory(header + "0,x,90,1\n4,x,45,2\n", columns=names)
            np.testing.assert_allclose(trajectory.t, [0, 4e-3])
            np.testing.assert_allclose(trajectory.q, [[np.pi / 2], [np.pi / 4]])
            np.testing.assert_allclose(trajectory.dq, [[1], [2]])
            assert trajectory.left_out == ()
    text = "Zeit;Achse 1 für Prüfung\n0;0.5\n1;1.5\n"
    trajectory = read(text.encode("latin-1"), "KRCIpo.csv", columns="t,q1")
    assert trajectory.t.tolist() == [0.0, 1.0] and trajectory.q.tolist() == [[0.5], [1.5]]


BAD_NAMES = """
t,q1 => log.csv, line 1: the table has 3 columns, but --columns has 2 names
t,-,- => log.csv, --columns: the column q1 is missing
1,2,3 => log.csv, --columns: the first line must name
"""


def test_joint_names_of_another_arm_are_refused():
    text = "0,1,2\n1,1,2\n"
    refusals(lambda x: parse_trajectory(text, source="log.csv", columns=x), BAD_NAMES)
    kinds = {"q {} [rad]": 0, "dq {} [rad/s]": 0, "ddq {} [rad/s^2]": 0}
    six = [kind.format(x) for kind in kinds for x in ("a", "b", "wrist_1", "c", "d", "e")]
    table = [
        (["t [s]", *six], "6 joints ('a', 'b', 'wrist_1' ... the arm has 2 ('joint 1', 'joint 2')"),
        (["t", *(f"x{k}" for k in range(20))], "'x7' and 12 more are not recognized"),
    ]

    def parse(titles):
        zeros = ",".join(["0"] * len(titles))
        return parse_trajectory(f"{','.join(titles)}\n{zeros}\n", ("joint 1", "joint 2"))

    refusals(parse, table, without="[rad/s]")


T = np.arange(60) * 0.008
Q = np.stack([np.sin(T), 0.1 * T], axis=1)
U = Q + 0.01
ARM = ("shoulder_joint", "elbow_joint")


def written(tmp_path, titles, *columns):
    file = tmp_path / "run.csv"
    np.savetxt(file, np.column_stack(columns), "%.9f", ",", header=titles, comments="")
    return file


def test_columns_are_sorted_in_the_order_of_the_joints(tmp_path):
    titles = "t,command elbow_joint,measured elbow_joint,command gripper,measured gripper,"
    titles += "command shoulder_joint [deg],measured shoulder_joint [deg]"
    first = np.degrees(np.stack([U[:, 0], Q[:, 0]], axis=1))
    log = read_run_log(written(tmp_path, titles, T, U[:, 1], Q[:, 1], 0 * T, 0 * T, first), ARM)
    assert isinstance(log, Log) and log.joint_names == ARM
    np.testing.assert_allclose(log.command, U, atol=1e-9)
    np.testing.assert_allclose(log.measured, Q, atol=1e-9)
    titles = "t,elbow_joint,measured shoulder_joint"
    recording = read_run_log(written(tmp_path, titles, T, Q[:, ::-1]), ARM)
    assert isinstance(recording, Recording)
    np.testing.assert_allclose(recording.q, Q, atol=1e-9)


def test_invalid_logs_are_refused(tmp_path):
    table = [
        (("t,u1,q1,q2", T, U[:, 0], Q), "'q2' ... no command column"),
        (("t,q1,q2", T[:20], Q[:20]), "20 samples"),
        (("q1,q2", Q), "the column t is missing"),
        (("t,q1,q2", T, np.mod(20 * Q, 2 * np.pi)), "wrapped angle"),
    ]
    refusals(lambda x: read_run_log(written(tmp_path, *x), ARM), table)
