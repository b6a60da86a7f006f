"""Logs of a run, as `learn` takes them: joints in the arm's order, with or without commands."""

from __future__ import annotations

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.io.log_file import read_run_log
from armcontour.learning import Recording
from armcontour.motion import Log

T = np.arange(60) * 0.008
Q = np.stack([np.sin(T), 0.1 * T], axis=1)
U = Q + 0.01
ARM = ("shoulder_joint", "elbow_joint")


def written(tmp_path, titles, *columns):
    file = tmp_path / "run.csv"
    np.savetxt(file, np.column_stack(columns), "%.9f", ",", header=titles, comments="")
    return file


def test_joints_with_the_names_of_the_arm_are_put_in_its_order(tmp_path):
    titles = "t,elbow_joint command,elbow_joint actual,gripper command,gripper actual,"
    titles += "shoulder_joint command [deg],shoulder_joint actual [deg]"
    still = np.zeros_like(T)
    first = np.degrees(np.stack([U[:, 0], Q[:, 0]], axis=1))
    file = written(tmp_path, titles, T, U[:, 1], Q[:, 1], still, still, first)
    log = read_run_log(file, ARM)
    assert isinstance(log, Log)
    assert log.joint_names == ARM
    np.testing.assert_allclose(log.command, U, atol=1e-9)
    np.testing.assert_allclose(log.measured, Q, atol=1e-9)


def test_joints_with_other_names_stay_in_their_order(tmp_path):
    file = written(tmp_path, "t,target_q_0,actual_q_0,target_q_1,actual_q_1", T, U[:, 0], Q[:, 0],
                   U[:, 1], Q[:, 1])  # fmt: skip
    log = read_run_log(file, ARM, start=0.05)
    assert isinstance(log, Log)
    assert log.t[0] == pytest.approx(0.056)
    np.testing.assert_allclose(log.measured, Q[T >= 0.05], atol=1e-9)


@pytest.mark.parametrize(
    "titles",
    ["t [ms],actual_q_0,actual_q_1", "time [ms],q1,q2", "t [ms],shoulder_joint measured,elbow q"],
)
def test_positions_without_commands_are_a_recording(tmp_path, titles):
    found = read_run_log(written(tmp_path, titles, 1e3 * T, Q), ARM)
    assert isinstance(found, Recording)
    assert found.command is None and found.source == "run.csv"
    np.testing.assert_allclose(found.q, Q, atol=1e-9)
    np.testing.assert_allclose(found.t, T, atol=1e-12)


def test_positions_with_the_names_of_the_arm_are_put_in_its_order(tmp_path):
    titles = "t,elbow_joint measured,shoulder_joint measured"
    found = read_run_log(written(tmp_path, titles, T, Q[:, ::-1]), ARM)
    assert isinstance(found, Recording)
    np.testing.assert_allclose(found.q, Q, atol=1e-9)


@pytest.mark.parametrize(
    ("titles", "columns", "words"),
    [
        ("t,u1,q1,q2", (T, U[:, 0], Q), ["'q2'", "no command column"]),
        ("t,q1,q2", (T[:20], Q[:20]), ["20 samples"]),
        ("t,q1,q2", (np.where(T > 0.2, T + 9, T), Q), ["gap of 9"]),
        ("q1,q2", (Q,), ["the column t is missing"]),
        ("t,q1,q2", (T, np.mod(20 * Q, 2 * np.pi)), ["wrapped angle"]),
    ],
)
def test_refusals(refuses, tmp_path, titles, columns, words):
    file = written(tmp_path, titles, *columns)
    refuses(lambda: read_run_log(file, ARM), InvalidInput, *words)


def test_whole_turns_are_undone_on_demand(tmp_path):
    file = written(tmp_path, "t,q1,q2", T, np.mod(20 * Q, 2 * np.pi))
    found = read_run_log(file, ARM, unwrap=True)
    assert isinstance(found, Recording)
    np.testing.assert_allclose(np.diff(found.q, axis=0), np.diff(20 * Q, axis=0), atol=1e-8)


def test_numbers_of_joints_may_be_of_any_length(tmp_path):
    large = "9" * 5000
    file = written(tmp_path, f"t,u{large},q{large},u2,q2", T, U[:, 0], Q[:, 0], U[:, 1], Q[:, 1])
    with pytest.raises(InvalidInput):
        read_run_log(file, ARM)
    file = written(tmp_path, "t,u10,q10,u9,q9", T, U[:, 1], Q[:, 1], U[:, 0], Q[:, 0])
    np.testing.assert_allclose(read_run_log(file, ARM).command, U, atol=1e-9)
