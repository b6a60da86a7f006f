"""The override of `play`: pauses and changes of the speed during a motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.controllers.simulated import Simulated

import armcontour as ac
from armcontour.controllers import Played, RollingRows, learn_on, play
from armcontour.core.errors import InvalidInput
from armcontour.files import parse_job
from armcontour.files.log_file import log_text, read_log
from armcontour.jobs.run_learning import learn_logs

JOB = """
name: corner
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.350, 0.200]]}
corners: {tolerance: 5 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {cycle: 1 ms, compensation: {method: inverse}}}
"""
RAIL = """
name: seam
arm:
  name: ur5e
  rail: {axis: [0, 1, 0], upper: 1 m, velocity: 1 m/s, acceleration: 2 m/s^2}
path:
  points: [[-0.5, 0, 0.3], [-0.5, 0.2, 0.3], [-0.4, 0.2, 0.3]]
  orientation: {axis: [0, 0, -1]}
corners: {tolerance: 5 mm, continuity: curvature}
limits: {speed: 0.15 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {compensation: {method: inverse}}}
"""


class Profile:
    """Wanted override by the number of times that it was asked for: twice in each cycle."""

    def __init__(self, *values: float) -> None:
        self.values = list(values)

    def __call__(self) -> float:
        return self.values.pop(0) if len(self.values) > 1 else self.values[0]


def robot(**changes) -> Simulated:
    return Simulated(**{"late": False, "acceleration": 100.0, **changes})


def played(text: str, override, **changes) -> Played:
    return play(parse_job(text), robot(**changes), execute=True, override=override)


def slow(value: float, cycles: int) -> list[float]:
    """The same wanted override in many cycles."""
    return [value] * (2 * cycles)


@pytest.mark.parametrize(("text", "cycle"), [(JOB, 1e-3), (RAIL, 4e-3)])
def test_the_robot_stays_on_the_path_at_every_speed(text, cycle):
    full = played(text, 1.0, cycle=cycle)
    n = round(0.4 / cycle)
    values = [*slow(1.0, n), *slow(0.0, 3 * n), *slow(0.3, n), *slow(0.9, n), 0.0, 0.0, 1.0]
    changed = played(text, Profile(*values), cycle=cycle)
    assert changed.kept, changed.reason
    errors = [x.to_data()["contour_error.max"].value for x in (full, changed)]
    # The largest error of the second one may be where it is slower, or at a change, which
    # uses the limits of acceleration.
    assert errors[1] <= errors[0] + 0.3e-6
    data = changed.to_data()
    assert data["override.paused"].value > 0.4
    assert data["played_time"].value > full.to_data()["played_time"].value + 1.2
    # Pauses and the changes to them are not a speed.
    assert data["override.lowest"].value == pytest.approx(0.3, rel=1e-6)
    # The robot is where the plan is at its time.
    record = changed.record
    plan = changed.plan.trajectory
    assert (np.diff(record.plan_time) >= 0).all() and record.plan_time[-1] > plan.duration
    expected = plan.with_rests(record.plan_time)
    # The robot of the test integrates by steps, and limits of the set-points have a cost.
    limited = np.abs(full.record.measured - plan.with_rests(full.record.plan_time)).max()
    np.testing.assert_allclose(record.measured, expected, atol=max(20 * cycle**2, 1.05 * limited))


def test_a_stop_during_a_pause_ends_the_motion_there():
    asked = []

    def stop() -> bool:
        asked.append(True)
        return len(asked) > 2500

    job = parse_job(JOB)
    n = 600
    stopped = play(
        job, robot(), execute=True, override=Profile(*slow(1.0, n), 0.0), stop_requested=stop
    )
    record = stopped.record
    assert record.stopped is not None and stopped.kept is False
    assert 0.5 < record.plan_time[-1] < stopped.plan.trajectory.duration
    assert stopped.stopped_at is not None and stopped.stopped_at.resume_at > 0
    resting = record.measured[-500:]
    np.testing.assert_allclose(resting, np.broadcast_to(resting[-1], resting.shape), atol=1e-9)


def test_the_start_can_be_a_pause():
    waited = played(JOB, Profile(*slow(0.0, 800), 1.0))
    assert waited.kept
    assert 0.6 < waited.to_data()["override.paused"].value < 1.0


def test_a_robot_away_from_the_start_moves_there_after_a_pause():
    start = play(parse_job(JOB), robot()).motion.q[0]
    away = robot(at=start + 0.02)
    moved = play(parse_job(JOB), away, execute=True, override=Profile(0.0, *slow(0.0, 300), 1.0))
    assert moved.kept and len(away.motions) == 2


def test_an_override_above_100_percent_is_refused():
    with pytest.raises(InvalidInput, match="override"):
        played(JOB, 1.5)
    with pytest.raises(InvalidInput, match="override"):
        played(JOB, Profile(*slow(0.5, 300), 1.5))


def test_a_log_has_the_time_of_the_plan_and_learning_refuses_a_slower_run(tmp_path):
    changed = played(JOB, Profile(*slow(1.0, 500), *slow(0.5, 600), 1.0))
    file = tmp_path / "log.csv"
    file.write_text(log_text(changed.log), encoding="utf-8")
    log = read_log(file)
    np.testing.assert_allclose(log.plan_time, changed.record.plan_time, atol=1e-12)
    assert log.lowest_override == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_array_equal(log.between(0.5, 1.0).plan_time[0], log.plan_time[500])
    with pytest.raises(InvalidInput, match="50 %"):
        learn_logs(changed.job, changed.plan, [log])
    full = played(JOB, 1.0)
    assert full.log.lowest_override == pytest.approx(1.0, abs=1e-6)
    assert learn_logs(full.job, full.plan, [full.log]).runs
    # Identification needs the commands only.
    fit = ac.identify([changed.log, full.log], ac.ServoFit(model="second"))
    np.testing.assert_allclose(fit.servo_model().kp, 25.0, rtol=0.02)


def test_learned_corrections_fade_while_the_speed_changes():
    """With friction, learned set-points differ from the compensated ones."""
    job = parse_job(JOB)
    machine = robot(friction=0.02)
    learned = learn_on(job, machine, execute=True, runs=3, reserve=0.02).best
    at_full = play(job, robot(friction=0.02), execute=True, set_points=learned)
    q = learned.q
    np.testing.assert_allclose(at_full.record.command[: len(q)], q, atol=1e-9)
    override = Profile(*slow(1.0, 700), *slow(0.4, 700), 1.0)
    changed = play(job, robot(friction=0.02), execute=True, set_points=learned, override=override)
    step = np.abs(np.diff(changed.record.command, 2, axis=0)).max()
    assert step < 2 * np.abs(np.diff(at_full.record.command, 2, axis=0)).max()
    errors = [x.to_data()["contour_error.max"].value for x in (at_full, changed)]
    plain = play(job, robot(friction=0.02), execute=True, override=1.0)
    # The limits of the set-points hold for learned ones, too.
    assert errors[0] < 0.5 * plain.to_data()["contour_error.max"].value
    assert errors[1] < 1.5 * plain.to_data()["contour_error.max"].value


def rows_of(text: str, cycle: float) -> RollingRows:
    return play(parse_job(text), robot(cycle=cycle)).motion.rows


@pytest.mark.parametrize(("text", "cycle"), [(JOB, 1e-3), (JOB, 3e-3), (RAIL, 4e-3)])
def test_rows_at_full_speed_are_those_of_the_plan(text, cycle):
    rows = rows_of(text, cycle)
    chunk = rows.first(1.0)
    sent = chunk.q
    k = 0
    step = round(0.1 / cycle)
    while not (chunk.pace.is_complete and k + step > chunk.brake):
        k += step
        chunk = rows.next(chunk, k, 1.0)
        sent = np.concatenate([sent[:k], chunk.q])
    assert len(sent) == len(rows.q)
    np.testing.assert_allclose(sent, rows.q, atol=1e-10)


def test_rows_of_a_changing_override_are_within_the_limits_of_set_points():
    """Own differences of all rows, with pauses, late chunks, and changes in every chunk."""
    rows = rows_of(JOB, 1e-3)
    plan = rows.set_points.trajectory
    limit = np.abs(plan.limits_for(None).joint_acceleration)
    wanted = np.random.default_rng(3)
    chunk = rows.first(1.0)
    sent = chunk.q
    k = 0
    while not chunk.pace.is_complete:
        k += int(wanted.integers(20, 300))
        sent = np.pad(sent, ((0, max(k - len(sent), 0)), (0, 0)), mode="edge")
        override = float(wanted.choice([0.0, 0.3, 0.9, 1.0, 1.0]))
        chunk = rows.next(chunk, k, override)
        sent = np.concatenate([sent[:k], chunk.q])
    rest = np.repeat(sent[:1], 3, axis=0)
    accelerations = np.abs(np.diff(np.concatenate([rest, sent]), 2, axis=0)).max(axis=0) / 1e-6
    assert (accelerations <= 3.0 * limit * (1 + 1e-6)).all()
    assert (accelerations > 2.9 * limit).any()
    np.testing.assert_allclose(sent[-1], plan(plan.duration), atol=1e-9)


def test_rows_depend_on_what_was_sent_last_and_not_on_earlier_rows():
    rows = rows_of(JOB, 1e-3)
    before = rows.first(1.0, 1.0)
    k = 900
    changed = before.set_points.copy()
    # Beyond the rows that are compared to decide when the override changes
    changed[: k - 400] += 0.1
    other = replace(before, set_points=changed)
    np.testing.assert_array_equal(rows.next(before, k, 0.5).q, rows.next(other, k, 0.5).q)


def test_a_late_chunk_leads_on_from_the_stop():
    rows = rows_of(JOB, 1e-3)
    first = rows.first(1.0)
    late = rows.next(first, first.brake + 60, 1.0)
    assert late.braked and not late.ends
    joined = np.concatenate([first.q[: late.k], late.q])
    # No jump: accelerations of the set-points stay as large as those of the first chunk.
    step = np.abs(np.diff(joined, 2, axis=0)).max()
    assert step < 1.5 * np.abs(np.diff(rows.q, 2, axis=0)).max()
    assert not rows.next(first, 100, 1.0).braked
