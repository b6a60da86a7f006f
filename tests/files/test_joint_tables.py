"""Joint tables of programs and controllers, read as logs and trajectories."""

import numpy as np
import pytest
from tests.files.tables import parse_log, refusals

from armcontour.core.errors import InvalidInput
from armcontour.files import parse_trajectory
from armcontour.files.log_file import log_text, read_run_log

COUNT = 60
T = 0.008 * np.arange(COUNT)
U = np.column_stack([0.3 * np.sin(9 * T), 0.2 * np.cos(7 * T)])
Q = 0.98 * U
# Columns of other quantities, with values that no joint has.
OTHER = 7.5
ARM = ("shoulder_pan_joint", "elbow_joint")


def table(titles, *columns, separator=",", comma=False, time=None, form="{:.9f}"):
    """CSV text of times and columns; those without values are of other quantities."""
    time = [f"{x:.6f}" for x in T] if time is None else time
    rows = []
    for i in range(COUNT):
        cells = [form.format(x[i]) for x in columns]
        cells += [str(OTHER)] * (len(titles) - 1 - len(cells))
        row = separator.join([str(time[i]), *cells])
        rows.append(row.replace(".", ",") if comma else row)
    return "\n".join([separator.join(titles), *rows]) + "\n"


# Times, commands, measured positions, other columns. {} is the number of the joint from 0.
LOGS = (
    # PlotJuggler and the controllers of ROS 2.
    (
        "__time",
        "/scaled_joint_trajectory_controller/controller_state/reference/positions[{}]",
        "/scaled_joint_trajectory_controller/controller_state/feedback/positions[{}]",
        "/scaled_joint_trajectory_controller/controller_state/error/positions[0]",
        "/scaled_joint_trajectory_controller/controller_state/feedback/velocities[0]",
        "/joint_states/effort[0]",
    ),
    ("__time", "/state/desired/positions[{}]", "/state/actual/positions[{}]"),
    # Clients of controllers: UR, KUKA (names with numbers from 1 are below), ABB, libfranka.
    (
        *(
            "timestamp",
            "target_q_{}",
            "actual_q_{}",
            "target_qd_0",
            "actual_qd_0",
            "actual_current_0",
        ),
        *("actual_TCP_pose_0", "actual_TCP_speed_0", "actual_digital_input_bits", "robot_mode"),
        *("actual_execution_time", "joint_temperatures_0", "joint_control_output_0", "safety_mode"),
        *("speed_scaling", "target_speed_fraction", "actual_momentum", "joint_mode_0"),
    ),
    ("time", "planned.joints[{}]", "feedBack.joints[{}]", "planned.cartesian.pos.x"),
    ("t", "q_d[{}]", "q[{}]", "dq[0]", "dq_d[0]", "tau_J[0]", "O_T_EE[0]"),
    ("t", "state.q_d[{}]", "state.q[{}]", "cmd.q_d[0]", "cmd.q_d[1]", "state.theta[0]"),
)
FROM_ONE = (
    ("t [s]", "command {} [rad]", "measured {} [rad]"),
    ("time", "u{}", "q{}"),
    ("t", "AxisSet{}", "AxisAct{}", "MACur1"),
    ("IPOC", "ASPos.A{}", "AIPos.A{}", "RIst.X", "RIst.A", "RSol.X", "RSol.A"),
)
# Other names: pairs of --columns, which the message states.
OTHERS = (
    ("Zeit", "Sollwert {}", "Istwert {}"),
    ("t", "des{}", "act{}", "des_x"),
    ("Time", "Axis {}.NcToPlc.SetPos", "Axis {}.NcToPlc.ActPos", "Axis 1.NcToPlc.ActVelo"),
)


def test_columns_of_programs_and_controllers_are_recognized():
    cases = [*((x, 0) for x in LOGS), *((x, 1) for x in FROM_ONE)]
    for (time, command, measured, *others), first in cases:
        ends = (first, first + 1)
        titles = [time, *map(command.format, ends), *map(measured.format, ends), *others]
        text = table(titles, *U.T, *Q.T)
        log = parse_log(text)
        np.testing.assert_allclose(log.command, U, atol=1e-8, err_msg=str(titles))
        np.testing.assert_allclose(log.measured, Q, atol=1e-8, err_msg=str(titles))
        # A check reads what was measured; without it, the commands.
        trajectory = parse_trajectory(text, ARM)
        np.testing.assert_allclose(trajectory.q, Q, atol=1e-8, err_msg=str(titles))
        assert "--columns" in trajectory.notes[0]
        trajectory = parse_trajectory(table(titles[:3], *U.T), ARM)
        np.testing.assert_allclose(trajectory.q, U, atol=1e-8, err_msg=str(titles))
        assert trajectory.notes == ()


def test_the_option_in_the_message_renames_unknown_joints():
    for header, command, measured, *others in OTHERS:
        titles = [header, *map(command.format, (1, 2)), *map(measured.format, (1, 2)), *others]
        text = table(titles, *U.T, *Q.T)
        option = f"u#={command.format('#')},q#={measured.format('#')}"
        with pytest.raises(InvalidInput) as refused:
            parse_log(text)
        if header.lower() in ("t", "time"):
            assert f"--columns '{option}'" in str(refused.value)
        log = parse_log(text, columns=f"t={header},{option}")
        np.testing.assert_allclose(log.command, U, atol=1e-8)
        np.testing.assert_allclose(log.measured, Q, atol=1e-8)


def test_incomplete_pairs_of_columns_are_ignored_with_a_note(tmp_path):
    text = table(["t", "u1", "q1", "q2", "position_x", "u7"], U[:, 0], Q[:, 0], Q[:, 1])
    log = parse_log(text)
    assert log.joint_names == ("joint 1",) and len(log.notes) == 2
    assert "'u7'" in log.notes[0] and "'q2'" in log.notes[1]
    assert log.between(0.05).notes == log.notes
    # Learning needs all joints.
    (tmp_path / "run.csv").write_text(text)
    with pytest.raises(InvalidInput, match="1 joint .* arm has 2 .* 'q2' .* no command column"):
        read_run_log(tmp_path / "run.csv", ARM)


def test_decimal_commas_and_units_are_read():
    degrees = [*np.degrees(U).T, *np.degrees(Q).T]
    titles = ["t[s]", "u1[deg]", "u2[deg]", "q1[°]", "q2[°]"]
    for separator in (";", "\t", " "):
        text = table(titles, *degrees, separator=separator, comma=True)
        log = parse_log(text)
        np.testing.assert_allclose(log.t, T, atol=1e-9)
        np.testing.assert_allclose(log.command, U, atol=1e-8)
        np.testing.assert_allclose(log.measured, Q, atol=1e-8)
        assert parse_trajectory(text).q.shape == (COUNT, 2)
    slid = [1e3 * U[:, 0], degrees[1], 1e2 * Q[:, 0], degrees[3]]
    log = parse_log(table(["t", "u1 [mm]", "u2 [deg]", "q1 [cm]", "q2 [deg]"], *slid))
    np.testing.assert_allclose(log.measured, Q, atol=1e-8)
    assert log.prismatic == (True, False)
    again = parse_log(log_text(log))
    np.testing.assert_array_equal(again.command, log.command)
    assert again.prismatic == log.prismatic
    quoted = table(["t", "u1", "q1"], U[:, 0], Q[:, 0], separator='","', comma=False)
    rows = [f'"{x.replace(".", ",")}"' for x in quoted.splitlines()]
    np.testing.assert_allclose(parse_log("\n".join(rows)).command[:, 0], U[:, 0], atol=1e-8)


def test_values_that_look_like_another_unit_are_refused():
    titles = ["time", "u1", "u2", "q1", "q2"]
    degrees = 120 * np.column_stack([U, Q]).T
    for time, unit in ((8 * np.arange(COUNT), "ms"), (8000 * np.arange(COUNT), "us")):
        text = table(titles, *U.T, *Q.T, time=time)
        for read in (parse_log, parse_trajectory):
            with pytest.raises(InvalidInput, match=rf"--columns 't \[{unit}\]=time'"):
                read(text)
            parsed = read(text, columns=f"t [{unit}]=time")
            np.testing.assert_allclose(parsed.t, T, atol=1e-12)
            # The order of the option applies.
            assert read(text, columns="t [s]=time").t[1] == time[1]
    for factor, unit in ((1e3, "ms"), (1e6, "us"), (1e9, "ns")):
        unix_times = [f"{factor * (1_700_000_000 + x):.0f}" for x in T]
        refusals(parse_log, [(table(titles, *U.T, *Q.T, time=unix_times), f"'t [{unit}]=time'")])
    text = table(titles, *degrees)
    for read in (parse_log, parse_trajectory):
        with pytest.raises(InvalidInput, match=r"turns in rad\. .* --columns .*q# \[deg\]=q#"):
            read(text)
        parsed = read(text, columns="u# [deg]=u#,q# [deg]=q#")
        q = parsed.measured if read is parse_log else parsed.q
        np.testing.assert_allclose(q, np.radians(120 * Q), atol=1e-7)
        assert read(text, columns="u# [rad]=u#,q# [rad]=q#") is not None


def repeated(text, rows):
    lines = text.splitlines()
    for i in rows:
        lines.insert(i, lines[i])
    return "\n".join(lines)


def test_repeated_and_rounded_times_are_read():
    titles = ["t", "u1", "q1"]
    text = repeated(table(titles, U[:, 0], Q[:, 0]), (40, 20, 20))
    for read in (parse_log, parse_trajectory):
        parsed = read(text)
        np.testing.assert_allclose(parsed.t, T, atol=1e-9)
        assert any("skipped: 3" in x for x in parsed.notes)
        rounded = [f"{x:.2f}" for x in T]
        with pytest.raises(InvalidInput, match="times must increase"):
            read(table(titles, U[:, 0], Q[:, 0], time=rounded))


def test_bursts_of_samples_are_reported_in_a_note(tmp_path):
    time = [f"{k // 4 * 0.032 + k % 4 * 1e-4:.6f}" for k in range(COUNT)]
    text = table(["t", "u1", "q1"], U[:, 0], Q[:, 0], time=time)
    for read in (parse_log, parse_trajectory):
        assert any("bursts" in x for x in read(text).notes)
        assert read(table(["t", "u1", "q1"], U[:, 0], Q[:, 0])).notes[1:] == ()


def test_rows_of_other_topics_are_ignored():
    titles = ["__time", "/state/feedback/positions[0]", "/imu", "/state/feedback/positions[1]"]
    text = table([*titles[:2], titles[3], titles[2]], *Q.T).replace(f",{OTHER}", ",")
    lines = text.splitlines()
    lines[20:20] = [f"{T[18] + 0.001:.6f},,,9", f"{T[18] + 0.002:.6f},,,9"]
    trajectory = parse_trajectory("\n".join(lines))
    np.testing.assert_allclose(trajectory.q, Q, atol=1e-8)
    assert "skipped: 2" in trajectory.notes[0]
    # Half a row is a fault.
    lines[20] = f"{T[18] + 0.001:.6f},1,,9"
    refusals(parse_trajectory, [("\n".join(lines), "line 21, ... positions[1]': '' is not")])


BAD = """
q1=none => no column or joint 'none' ... It has 't', 'u1', 'q1'
q1= => NEW=NAME ... 'q1='
q#=u1 => NEW=NAME
q*=u# => NEW=NAME
q1 => 3 columns, but --columns has 1 names
q1=u1 => the columns 'q1' and 'q1' ... Remove one (for example with --columns '-=q1')
"""


def test_invalid_new_names_are_refused():
    text = table(["t", "u1", "q1"], U[:, 0], Q[:, 0])
    refusals(lambda x: parse_log(text, columns=x), BAD)
