"""Identification and learning on a controller that simulates LinuxCNC's loops without a clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from docs.pages import run_command
from tests.controllers.simulated import Lost, Simulated

import armcontour as ac
from armcontour.cli import play_command
from armcontour.control.learning import LearningResult
from armcontour.controllers import identify_on, learn_on, play
from armcontour.controllers.player import plan_played
from armcontour.controllers.robot_identification import LIMIT_SHARE, excite
from armcontour.core.errors import ControllerLost, ControllerRefused
from armcontour.files import parse_job
from armcontour.jobs.run_learning import learn_logs

JOB = """
name: loop
arm: pmk3s
seed: [0, 1]
path: {points: [[0.35, 0.10], [0.39, 0.14], [0.35, 0.18]]}
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 20 1/s, kv: 120 1/s}
runs:
  go: {timing: {reserve: 2 %}, compensation: {method: inverse}, cycle: 4 ms}
"""
# Without a search for the order.
SECOND = ac.ServoFit(model="second")


@pytest.fixture(scope="module")
def job() -> ac.Job:
    return parse_job(JOB)


@pytest.fixture(scope="module")
def learned(job):
    robot = Simulated()
    return robot, learn_on(job, robot, execute=True, runs=3)


def errors(result) -> list[float]:
    return [x.rms for x in result.lesson.runs]


def test_the_identified_servo_reaches_the_predicted_error(job):
    # Limited set-points require more of the drives than the plan.
    robot = Simulated(acceleration=1.0)
    found = identify_on(job, robot, execute=True, options=SECOND)
    servo = found.fit.servo_model()
    assert list(found.logs) == ["run", "excitation"] and len(robot.motions) == 2
    assert found.fit.judgement.programs == 2 and found.fit.judgement.trusted
    np.testing.assert_allclose(servo.kp, 25.0, rtol=0.05)
    np.testing.assert_allclose(servo.kv, 150.0, rtol=0.1)
    assert found.prediction.largest.max() < 1e-6
    known = replace(job, servo=servo, plant_servo=servo)
    played = play(known, Simulated(acceleration=1.0), execute=True, override=1.0)
    measured = learn_logs(known, played.plan, [played.log]).runs[0].contour_rms
    assert measured < played.plan.evaluation.contour_error.rms + 1e-7


def test_dry_runs_move_nothing(job):
    robot = Simulated()
    assert identify_on(job, robot).fit is None
    assert learn_on(job, robot).lesson is None
    assert robot.motions == []


def test_excitation_is_within_limits_from_rest_to_rest(job):
    played_job, plan = plan_played(job, Simulated(), None)
    motion = excite(played_job, plan.run.limits, plan.trajectory, 1e-3)
    begin = plan.trajectory(0.0)
    np.testing.assert_allclose(motion.q[[0, -1]], [begin, begin], atol=1e-12)
    accelerations = np.diff(motion.q, 2, axis=0) / 1e-6
    assert (np.abs(accelerations).max(axis=0) < 0.72 * LIMIT_SHARE).all()
    assert (np.abs(accelerations[[0, -1]]) < 1e-3).all()
    # Joints do not move alike.
    assert abs(np.corrcoef(motion.q[:12000].T)[0, 1]) < 0.5


def test_a_joint_at_the_end_of_its_range_is_not_excited(job):
    played_job, plan = plan_played(job, Simulated(), None)
    limits = plan.run.limits.replace(joint_lower=plan.trajectory(0.0))
    with pytest.raises(ControllerRefused, match="end of its range"):
        excite(played_job, limits, plan.trajectory, 1e-3)


def test_learning_reduces_the_error_in_every_run(learned):
    _, result = learned
    assert (np.diff(errors(result)) < 0).all() and errors(result)[-1] < 1e-6
    assert result.ended == "" and isinstance(result.best, LearningResult)
    np.testing.assert_array_equal(result.best.q, result.lesson.runs[-1].q)


def test_a_log_of_other_set_points_is_refused(job, learned):
    _, result = learned
    robot = Simulated()
    with pytest.raises(ac.InvalidInput, match="set-points of run 2"):
        learn_on(job, robot, execute=True, logs=[result.logs[0], result.logs[0]])
    other = ac.ServoModel(kp=21.0, kv=120.0)
    with pytest.raises(ac.InvalidInput, match="the job has changed"):
        learn_on(replace(job, servo=other, plant_servo=other), robot, logs=result.logs)
    assert robot.motions == []


def test_learning_returns_to_the_best_run_after_a_worse_run(job):
    # The servo of this robot does not respond as learning expects.
    robot = Simulated(ki=40.0, friction=0.03)
    # With the assumed limit, learning would end after two runs.
    anything = ac.Inverse(command_limits=ac.Limits(joint_acceleration=np.inf))
    job = replace(job, runs=(replace(job.runs[0], compensation=anything),))
    result = learn_on(job, robot, reserve=0.02, execute=True, runs=8, band=0.2)
    assert len(robot.motions) < 8 and result.lesson.finished
    every = errors(result)
    runs = result.lesson.runs
    best = int(np.argmin(every))
    np.testing.assert_array_equal(result.best.q, runs[best].q)
    worse = int(np.argmax(np.diff(every) > 0)) + 1
    steps = [np.abs(runs[k].q - runs[worse - 1].q).max() for k in (worse, worse + 1)]
    assert every[worse] > every[worse - 1] and 0 < steps[1] < 0.7 * steps[0]


def test_a_stop_on_request_keeps_the_learned_set_points(job, learned):
    class Stopped(Simulated):
        def stream(self, *arguments):
            asked.append(True)
            return super().stream(*arguments)

    asked: list[bool] = []
    _, result = learned
    stopped = learn_on(
        job, Stopped(), execute=True, logs=result.logs[:1], stop_requested=lambda: bool(asked)
    )
    assert stopped.stopped and len(stopped.logs) == 1 and stopped.played.record.stopped
    again = learn_on(job, Stopped(), runs=1, logs=result.logs[:1])
    np.testing.assert_array_equal(stopped.lesson.q, again.lesson.q)


def test_an_identification_that_is_stopped_on_request_is_not_repeated(job):
    robot = Simulated(cycle=4e-3)
    requested = identify_on(job, robot, execute=True, stop_requested=lambda: bool(robot.motions))
    assert requested.stopped and requested.fit is None and len(robot.motions) == 1


@pytest.fixture
def execute(tmp_path, monkeypatch):
    """A function that runs a command with a controller and --execute --out out."""

    def run(command, controller, *options):
        monkeypatch.setattr(play_command, "controller_of", lambda *_: controller)
        monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
        monkeypatch.setattr(play_command.typer, "prompt", lambda *_, **__: "PMK-3s")
        monkeypatch.chdir(tmp_path)
        (tmp_path / "job.yaml").write_text(JOB, encoding="utf-8")
        words = [command, "job.yaml", "--on", "linuxcnc", "--execute", "--out", "out"]
        return run_command([*words, *options])

    return run


@pytest.mark.parametrize(
    ("command", "motion", "whole", "lost"),
    [
        ("identify", 0, [], "run.csv"),
        ("identify", 1, ["run.csv"], "excitation.csv"),
        ("learn", 0, [], "logs/run_1_lost.csv"),
    ],
)
def test_a_lost_controller_leaves_its_logs(execute, tmp_path, command, motion, whole, lost):
    code, printed, errors = execute(command, Lost(700, motion))
    assert code == 11 and "its process has ended" in errors
    assert f"Log: out/{lost}" in printed
    out = tmp_path / "out"
    logs = {"run.csv", "excitation.csv", *(f"logs/{x.name}" for x in out.glob("logs/*"))}
    assert {x for x in logs if (out / x).exists()} == {*whole, lost}
    assert "incomplete" in (out / lost).read_text(encoding="utf-8")
    assert len(ac.read_log(out / lost).t) == 700
    for name in whole:
        assert "incomplete" not in (out / name).read_text(encoding="utf-8")


def test_learning_continues_after_a_lost_controller(execute, tmp_path):
    def logs():
        return sorted(x.name for x in (tmp_path / "out" / "logs").iterdir())

    code, printed, _ = execute("learn", Lost(700, 1), "--runs", "2")
    assert code == 11 and "Log: out/logs/run_2_lost.csv" in printed
    assert logs() == ["run_1.csv", "run_2_lost.csv"]
    code, _, _ = execute("learn", Simulated(late=False), "--runs", "2")
    assert code == 0 and logs() == ["run_1.csv", "run_2.csv"]


def test_a_record_that_is_too_short_is_no_log(execute, tmp_path):
    code, printed, _ = execute("identify", Lost(3))
    assert code == 11 and "Log:" not in printed
    assert not (tmp_path / "out" / "run.csv").exists()


def test_a_lost_controller_is_raised_with_its_record(job):
    for call in (identify_on, learn_on):
        with pytest.raises(ControllerLost, match="its process has ended") as lost:
            call(job, Lost(700), execute=True)
        assert len(lost.value.record.t) == 700
