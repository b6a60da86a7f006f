"""The motion pauses at the end of the contour that is executed, and goes on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from soak import resuming
from tests.controllers.simulated import Simulated
from tests.controllers.test_stopped_place import CYCLE, squares

import armcontour as ac
from armcontour.cli.override_keys import OverrideKeys
from armcontour.controllers import play
from armcontour.files import parse_job
from armcontour.program import Lead

# Rates of the plan's time below this are a pause.
RESTING = 1e-9


class Operator:
    """Wants a pause after the contour from a time on, and goes on from another time.

    `Simulated` asks `stop_requested` once per cycle.
    """

    def __init__(self, *spans: tuple[float, float], stop: float = np.inf) -> None:
        self.spans = spans
        self.stop = stop
        self.time = 0.0

    def pause_after(self) -> bool:
        return any(a <= self.time < b for a, b in self.spans)

    def stop_requested(self) -> bool:
        self.time += CYCLE
        return self.time > self.stop


def robot() -> Simulated:
    return Simulated(late=False, cycle=CYCLE, acceleration=100.0)


def played(job: ac.Job, operator: Operator, speed: float = 1.0, **options):
    return play(
        job,
        robot(),
        execute=True,
        override=speed,
        pause_after=operator.pause_after,
        stop_requested=operator.stop_requested,
        **options,
    )


def pauses(record) -> list[tuple[float, float]]:
    """The pauses before the end of the plan: its time there and how long it stands [s]."""
    rate = np.diff(record.plan_time) / np.diff(record.t)
    found: list[tuple[float, float]] = []
    resting = rate < RESTING
    begin = None
    for i, rests in enumerate([*resting, False]):
        if rests and begin is None:
            begin = i
        elif not rests and begin is not None:
            found.append((float(record.plan_time[i - 1]), float(record.t[i] - record.t[begin])))
            begin = None
    return found


def contour_ends(result) -> list[float]:
    return [x.t[1] for x in result.plan.trajectory.contour_spans]


def jerky() -> ac.Job:
    job = squares()
    runs = tuple(replace(x, limits=x.limits.replace(joint_jerk=[60.0, 60.0])) for x in job.runs)
    return replace(job, runs=runs)


JOBS = {
    "rapid between": squares,
    "jerk limits": jerky,
    "leads": lambda: replace(
        squares(),
        process=ac.Process(lead_in=Lead(length=5e-3), lead_out=Lead(length=5e-3), dwell=0.2),
    ),
}


@pytest.mark.parametrize(
    ("name", "speed", "end"),
    [
        ("rapid between", 1.0, 6.5),
        ("rapid between", 0.4, 13.5),
        ("jerk limits", 1.0, 6.5),
        ("leads", 1.0, 8.0),
    ],
)
def test_the_motion_rests_exactly_at_the_end_of_the_contour(name, speed, end):
    """`end`: time at which the operator goes on [s]."""
    result = played(JOBS[name](), Operator((0.5, end)), speed)
    ends = contour_ends(result)
    record = result.record
    ((place, duration), *others) = pauses(record)
    assert place == pytest.approx(ends[0], abs=1e-6)
    assert duration > 1.0 and not others
    # It goes on to the end, as simulated.
    assert record.stopped is None and result.kept, result.reason
    # Nothing was repeated or left out.
    assert (np.diff(record.plan_time) > -1e-12).all()
    still = np.flatnonzero(np.diff(record.plan_time) < RESTING)
    tools = result.job.arm.tool_position(record.measured[still[len(still) // 2 :]])
    place = result.job.arm.tool_position(result.plan.trajectory(ends[0]))
    assert np.linalg.norm(tools - place, axis=1).max() < 1e-5
    # The joints stay within their limits.
    limit = result.plan.run.limits.joint_acceleration
    q = result.plan.trajectory(np.clip(record.plan_time, 0, result.plan.trajectory.duration))
    assert (np.abs(np.diff(q, 2, axis=0)).max(axis=0) < 1.001 * limit * CYCLE**2).all()


def test_a_pause_that_comes_too_late_is_at_the_end_of_the_next_contour():
    whole = play(squares(), robot(), execute=True, override=1.0)
    first, second = contour_ends(whole)
    # The last 0.1 s are already sent.
    result = played(squares(), Operator((first - 0.05, 30.0)))
    # The motion ends with the next contour, so it does not pause.
    assert not pauses(result.record)
    assert result.record.stopped is None and result.kept
    three = squares()
    (a, b) = three.program.contours
    c = replace(a, path=ac.Path.polyline(a.path.vertices + [0.08, 0.0]))
    three = replace(three, path=ac.Program(moves=(a, b, c)))
    result = played(three, Operator((first - 0.05, second + 3.0)))
    ((place, duration),) = pauses(result.record)
    assert place == pytest.approx(contour_ends(result)[1], abs=1e-6) and duration > 1.0


def test_the_pause_can_be_given_up_and_wanted_again():
    first, _ = contour_ends(play(squares(), robot(), execute=True, override=1.0))
    given_up = played(squares(), Operator((0.5, first - 0.5)))
    assert not pauses(given_up.record) and given_up.kept
    again = played(squares(), Operator((0.5, 1.0), (1.5, first + 2.0)))
    ((place, duration),) = pauses(again.record)
    assert place == pytest.approx(contour_ends(again)[0], abs=1e-6) and 1.0 < duration < 3.0
    assert again.kept


def test_a_stop_during_the_pause_resumes_before_the_next_contour():
    result = played(squares(), Operator((0.5, 99.0), stop=7.0))
    lengths = [x.path.length for x in squares().program.contours]
    assert result.record.stopped is not None
    assert result.stopped_at.resume_at == pytest.approx(lengths[0], abs=1e-9)
    assert "contour 2" in result.stopped_at.words


def test_the_line_says_that_the_motion_pauses():
    seen = []

    def progress(step):
        seen.append(" ".join(map(str, step.names)))

    played(squares(), Operator((0.5, 9.0)), progress=progress)
    (wanted, paused) = ([x for x in seen if y in x] for y in ("pauses at its end", "paused"))
    assert wanted and paused and all("contour 1" in x for x in (*wanted, *paused))
    assert "contour 2" in seen[-1] or "after all contours" in seen[-1]


def test_keys():
    keys = OverrideKeys(0.5)
    assert not keys.pause_after()
    keys.press("c", 0.0)
    assert keys.pause_after() and keys() == 0.5
    keys.press("r", 1.0)
    assert not keys.pause_after()
    # A pause at once does not cancel the later one.
    for i, key in enumerate("c r"):
        keys.press(key, 10.0 + i)
    assert keys.pause_after() and keys() == 0.5
    # A key that is held counts once.
    keys.press("r", 12.2)
    assert keys.pause_after()
    keys.press("r", 14.0)
    assert not keys.pause_after()


def test_a_motion_without_contours_has_no_pause():
    job = parse_job(resuming.PLANAR)
    result = played(job, Operator((0.0, 99.0)))
    assert not pauses(result.record) and result.kept


def test_rests_at_a_pause_and_at_the_end_do_not_count_as_late_set_points():
    rows = play(squares(), robot()).motion.rows
    chunk = rows.first(1.0)
    while not chunk.pauses:
        chunk = rows.next(chunk, chunk.brake - 50, 1.0, pause_after=True)
    # The motion goes on long after the pause has begun.
    chunk = rows.next(chunk, chunk.brake + 500, 1.0)
    assert not chunk.braked
    while not chunk.pace.is_complete:
        chunk = rows.next(chunk, chunk.brake - 50, 1.0)
        assert not chunk.braked
    # Set-points look ahead beyond the end of the plan.
    assert not rows.next(chunk, chunk.brake - 1, 1.0).braked
    # A chunk that comes during the stop of the one before counts.
    first = rows.first(1.0)
    assert rows.next(first, first.brake + 5, 1.0).braked
