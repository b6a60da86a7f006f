"""One number and one answer on the same set-points, wherever they are judged."""

import json
import shlex
import warnings

import numpy as np
import pytest
from tests.controllers.simulated import Simulated
from tests.dynamics_extra import needs_dynamics
from tests.studio.test_tasks import ask

import armcontour as ac
from armcontour.controllers import play
from armcontour.files import parse_job, read_trajectory

JOB = """
name: corner
arm: ur5e
path:
  points: [[0.45, -0.05, 0.3], [0.50, -0.05, 0.3], [0.50, 0.0, 0.3]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 250 mm/s}
corners: {tolerance: 0.25 mm}
accuracy: 0.5 mm
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 2 ms
runs:
  sent: {timing: {reserve: 20 %}, LIMITS}
"""
LIMIT = np.pi  # Joint acceleration of a UR5e [rad/s²]


class Machine(Simulated):
    """A machine that is no simulation, at the cycle of an e-Series."""

    simulates = False

    def __init__(self):
        super().__init__(late=False, cycle=2e-3, acceleration=LIMIT)


@needs_dynamics
@pytest.mark.parametrize(
    ("limits", "share"), [("", 3.0), ("command_limits: {joint_acceleration: 6.0 rad/s^2}", 1.91)]
)
def test_all_doors_state_the_same_share_of_the_acceleration(
    done, tmp_path, monkeypatch, limits, share
):
    monkeypatch.chdir(tmp_path)
    text = JOB.replace("LIMITS", limits)
    (tmp_path / "job.yaml").write_text(text)
    done(*shlex.split("run job.yaml --out out --no-changes --export csv"))
    summary = json.loads((tmp_path / "out/summary.json").read_text())["runs"]["sent"]
    found = {"run": summary["set_point_acceleration"]}
    # Own second differences of the written file
    q = read_trajectory(tmp_path / "out/sent/export/set_points.csv").q
    found["file"] = np.abs(np.diff(q, 2, axis=0)).max() / 2e-3**2 / LIMIT
    command = "check out/sent/set_points.csv --path job.yaml --set-points --json"
    found["check"] = json.loads(done(*shlex.split(command)))["set_point_acceleration"]
    job = parse_job(text)
    result = ac.run(job).runs["sent"]
    found["python"] = result.set_points.use.plan_ratios["joint_acceleration"].max()
    rows = ask("figures", text, "sent").header["rows"]
    (row,) = [x for x in rows if x["name"] == "set_point_acceleration"]
    found["studio"] = row["value"]
    played = play(job, Machine(), override=1.0).to_data()
    found["play"] = max(played["set_points.joint_acceleration"].value)
    for door, value in found.items():
        # `play` plans again, with its reserve.
        assert value == pytest.approx(share, rel=2e-3), (door, found)
        assert value <= share * (1 + 1e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ac.export(result.set_points, tmp_path / "sent.csv")


@needs_dynamics
def test_a_velocity_that_the_user_widens_is_still_the_smaller_one():
    text = JOB.replace("LIMITS", "command_limits: {joint_velocity: 90 rad/s}")
    bounds = []
    for job in (parse_job(JOB.replace("LIMITS", "")), parse_job(text)):
        (run,) = job.runs
        bounds.append(job.rule(run, run.limits).bounds[1])
    np.testing.assert_array_equal(*bounds)


def test_a_run_warns_of_set_points_whose_acceleration_nothing_limits():
    """Sent to a controller that stops, they stop the robot."""
    messages = []
    for limits in ("", "command_limits: {joint_acceleration: inf}"):
        (result,) = ac.run(parse_job(JOB.replace("LIMITS", limits))).runs.values()
        ratio = result.set_point_use.plan_ratios["joint_acceleration"].max()
        messages.append([x for x in result.warnings if "command_limits" in x])
    assert messages[0] == [] and ratio > 50
    (message,) = messages[1]
    assert f"{100 * ratio:.0f}"[:2] in message
