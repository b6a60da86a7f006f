"""Errors that differ between runs with equal set-points are reported and averaged."""

from dataclasses import replace

import numpy as np
import pytest

import armcontour as ac

from .robots import GAINS, SERVO, gentle_plan, rods, rounded

# RMS error per joint that differs between runs [rad]: 8 millidegrees.
SIZE = np.radians(8e-3)
TERMS = 6


class Robot:
    """A robot whose joints drift differently in every run; times of its log jitter."""

    def __init__(self, seed):
        self.arm = rods()
        self.random = np.random.default_rng(seed)
        limits = ac.Limits.only(speed=0.15, joint_acceleration=3.0, joint_velocity=2.0).for_joints(
            2
        )
        self.plan = gentle_plan(rounded(), self.arm, limits)
        self.set_points = ac.compensate(self.plan, SERVO, ac.Inverse())
        self.plant = ac.ServoPlant(self.arm, SERVO.replace(kp=GAINS), saturation="none")

    def run(self, set_points):
        """A log, and the RMS error that repeats [rad]."""
        execution = ac.simulate(set_points, self.plant)
        phase = np.pi * execution.t[:, None] / self.plan.duration * np.arange(TERMS)
        q = execution.q + SIZE / np.sqrt((TERMS + 1) / 2) * np.cos(phase) @ self.random.normal(
            size=(TERMS, 2)
        )
        command = np.stack(
            [np.interp(execution.t, set_points.t, x) for x in set_points.q.T], axis=1
        )
        t = np.sort(execution.t + self.random.normal(scale=2e-4, size=len(q)))
        increasing = np.append(True, np.diff(t) > 0)
        inside = (execution.t >= 0) & (execution.t <= self.plan.duration)
        error = (execution.q - self.plan.with_rests(execution.t))[inside]
        log = ac.Log(t=t[increasing] + 5.0, command=command[increasing], measured=q[increasing])
        return log, float(np.sqrt(np.mean(error**2)))

    def learn(self, set_points, logs):
        return ac.learn(set_points, logs, arm=self.arm, servo=SERVO)

    def tool(self, rms):
        """RMS of the tool for independent errors of the joints [m], about, along and across."""
        jacobian = self.arm.tool_jacobian(self.plan(np.linspace(0, self.plan.duration, 100)))
        return rms * float(np.sqrt((jacobian**2).sum(axis=(1, 2)).mean()))


def test_learning_ends_if_only_differences_between_logs_remain():
    """Four logs of each set-points: the repeating error ends near half of what differs."""
    rms_ratios = []
    stated = []
    for seed in range(4):
        robot = Robot(seed)
        set_points = robot.set_points
        for _ in range(4):
            set_points = robot.learn(set_points, [robot.run(set_points)[0] for _ in range(4)])
            if set_points.finished:
                break
        assert set_points.reason == "the remaining error is noise"
        rms_ratios.append(robot.run(set_points)[1] / SIZE)
        stated.append(set_points.noise / robot.tool(SIZE))
    assert np.sqrt(np.mean(np.square(rms_ratios))) < 0.7
    # The contour error is about 0.7 of the tool's.
    assert np.mean(stated) == pytest.approx(0.7, abs=0.25)


def test_noise_is_unknown_without_repeated_runs_of_same_set_points():
    """Differences of runs with other set-points are no noise."""
    robot = Robot(0)
    set_points = robot.set_points
    for _ in range(3):
        set_points = robot.learn(set_points, robot.run(set_points)[0])
        assert set_points.noise is None and "noise" not in set_points.reason
        assert set_points.best == np.argmin([x.rms for x in set_points.runs])


def test_noise_is_the_difference_between_logs_of_the_same_set_points():
    """Their mean repeats, and what differs is stated."""
    robot = Robot(4)
    logs = [robot.run(robot.set_points)[0] for _ in range(5)]
    lesson = robot.learn(robot.set_points, logs)
    assert len(lesson.runs) == 5
    assert lesson.noise / robot.tool(SIZE) == pytest.approx(0.7, abs=0.25)
    assert lesson.repeats > 3 * lesson.noise
    assert robot.run(lesson)[1] < 0.8 * SIZE


def test_learning_without_a_log_is_refused(refuses):
    robot = Robot(0)
    refuses(lambda: robot.learn(robot.set_points, []), ac.InvalidInput, "but is 0")


class BadLogs(Robot):
    """A robot whose logs of runs after the second one are bad; none of its errors differ."""

    def log(self, set_points, k, kind):
        execution = ac.simulate(set_points, self.plant)
        q = execution.q + self.random.normal(scale=1e-5, size=execution.q.shape)
        mask = np.ones(len(q), dtype=bool)
        if kind == "lost":
            mask = self.random.random(len(q)) > 0.05
        elif k >= 1 and kind == "gap":
            mask = ~((execution.t > 0.3) & (execution.t < 0.36))
        command = np.stack(
            [np.interp(execution.t, set_points.t, x) for x in set_points.q.T], axis=1
        )
        error = ac.evaluate(execution, self.plan.path).contour_error.rms
        return ac.Log(t=execution.t[mask] + 5.0, command=command[mask], measured=q[mask]), error

    def best(self, kind):
        """Least RMS contour error that learning ends with after four runs, and the last lesson."""
        set_points = self.set_points
        errors = []
        for k in range(4):
            log, error = self.log(set_points, k, kind)
            errors.append(error)
            set_points = self.learn(set_points, log)
        return ac.evaluate(
            ac.simulate(set_points, self.plant), self.plan.path
        ).contour_error.rms, set_points


@pytest.mark.parametrize("kind", ["lost", "gap"])
def test_logs_with_outliers_increase_the_error_only_slightly(kind):
    clean, bad = (BadLogs(2).best(x)[0] for x in ("none", kind))
    assert bad < 1.5 * clean + 2e-7


def test_a_log_with_large_gaps_is_refused(refuses):
    robot = BadLogs(2)
    log, _ = robot.log(robot.set_points, 0, "none")
    mask = (log.t < 5.2) | (log.t > 5.8)
    cut = ac.Log(t=log.t[mask], command=log.command[mask], measured=log.measured[mask])
    refuses(lambda: robot.learn(robot.set_points, cut), ac.InvalidInput, "gaps")


def test_a_run_that_differs_from_the_others_is_named():
    """Four logs of the same set-points; the last robot carries a load that bends its joints."""
    robot = Robot(3)
    logs = [robot.run(robot.set_points)[0] for _ in range(4)]
    bump = 5e-3 * np.sin(np.pi * (logs[3].t - logs[3].t[0]) / np.ptp(logs[3].t))[:, None] ** 2
    logs[3] = replace(logs[3], measured=logs[3].measured + bump)
    lesson = robot.learn(robot.set_points, logs)
    assert lesson.repeated.different.tolist() == [3]
    assert lesson.repeated.largest.max() == lesson.runs[3].largest
    assert any("Run 4 differs from runs 1 to 3" in x for x in lesson.to_data().notes)
    alike = robot.learn(robot.set_points, logs[:3])
    assert not len(alike.repeated.different)
    assert robot.learn(robot.set_points, logs[0]).repeated is None
