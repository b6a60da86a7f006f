"""A stopped motion is continued: the rest begins at the stop, and the robot moves back to it."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from docs.pages import run_command
from soak import resuming
from tests.controllers.simulated import Simulated
from tests.controllers.test_stopped_place import CYCLE, REPEATED, After, squares

import armcontour as ac
from armcontour.cli import play_command
from armcontour.controllers import ControllerRefused, Played, play, unfinished_place
from armcontour.files import parse_job
from armcontour.files.log_file import log_head
from armcontour.files.stop_file import read_stopped_place, read_unfinished, unfinished_comment
from armcontour.jobs.stopped_place import find_stopped_place

# Largest distance of the tool from the path on the way back: that of a start tolerance [m].
ON_PATH = 0.2e-3
# Length that is processed again [m].
REJOIN = 3e-3


def robot(at=None, **values) -> Simulated:
    return Simulated(late=False, cycle=CYCLE, acceleration=100.0, at=at, **values)


def stopped(job: ac.Job, t: float) -> Played:
    """The job played on a simulated robot, stopped after a time [s]."""
    return play(job, robot(), execute=True, override=1.0, stop_requested=After(t + 0.3))


def continued(job: ac.Job, before: Played, **options) -> tuple[Played, Simulated]:
    """The rest of the job, played by the robot that stands where it has stopped."""
    arm = robot(at=before.record.command[-1])
    played = play(job, arm, execute=True, override=1.0, resume=before.stopped_at, **options)
    return played, arm


def with_rejoin(job: ac.Job, rejoin: float) -> ac.Job:
    return replace(job, process=replace(job.process, rejoin=rejoin))


def distances(path: ac.Path, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(path(path.project(points).s) - points, axis=1)


WOVEN = resuming.PLANAR.replace("corners: {tolerance: 0.5 mm}\n", "") + (
    "process: {weave: {width: 2 mm, pitch: 4 mm}}\n"
)
LEADS = resuming.PLANAR + (
    "process: {begin: drawn, lead_in: {shape: line, length: 8 mm}, switch: {name: laser}}\n"
)


@pytest.mark.parametrize(
    ("text", "t"),
    [
        *((resuming.PLANAR, t) for t in (0.1, 0.5, 1.15, 1.9)),
        *((resuming.SPATIAL, t) for t in (0.2, 0.55)),
        (resuming.LED, 1.0),
        (resuming.RAIL, 9.0),
        (LEADS, 0.7),
        (WOVEN, 1.0),
    ],
)
def test_the_rest_joins_the_finished_part_and_the_robot_moves_back_along_it(text, t):
    job = parse_job(text)
    before = stopped(job, t)
    tool = job.arm.tool_position(before.record.measured[-1])
    played, arm = continued(with_rejoin(job, REJOIN), before)
    assert played.record.stopped is None
    (way, _) = arm.motions
    # The robot does not jump, and ends at the start.
    np.testing.assert_allclose(way.q[0], before.record.command[-1], atol=1e-12)
    np.testing.assert_allclose(way.q[-1], played.motion.q[0], atol=1e-9)
    contour = played.plan.path.contours[0]
    moves = [x for x in played.plan.traced.steps if x.joint_path is not None]
    if len(moves) == 1 or played.plan.traced.is_contour(moves[0]):
        assert distances(contour.path, job.arm.tool_position(way.q)).max() < ON_PATH
    # The rest begins before the place of the stop, by the overlap.
    drawn = played.plan.objective.contours[0]
    s = float(drawn.path.project(tool[None]).s[0]) - drawn.at_work[0]
    assert 0 <= s - REJOIN < REPEATED + 0.5e-3
    # It passes the place in the same configuration.
    q = played.plan.trajectory.sample(CYCLE).q
    i = int(np.linalg.norm(job.arm.tool_position(q) - tool, axis=1).argmin())
    np.testing.assert_allclose(q[i], before.record.measured[-1], atol=0.02)


def test_a_drawing_is_continued_on_the_contour_of_the_stop():
    job, _ = resuming.whole_plan("drawing")
    # The gains of the machine of the tests
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    job = replace(job, runs=job.runs[:1], servo=servo, plant_servo=servo)
    before = stopped(job, 1.0)
    assert "CUT-1" in before.stopped_at.words
    played, arm = continued(with_rejoin(job, REJOIN), before)
    assert played.kept
    drawn = played.plan.objective.contours[0]
    assert drawn.name == "CUT-1"
    tool = job.arm.tool_position(before.record.measured[-1])
    assert 0 <= float(drawn.path.project(tool[None]).s[0]) - REJOIN < REPEATED
    way = job.arm.tool_position(arm.motions[0].q)
    assert distances(played.plan.path.contours[0].path, way).max() < ON_PATH


def test_without_an_overlap_the_rest_begins_at_the_stop():
    job = parse_job(resuming.PLANAR)
    before = stopped(job, 0.1)
    played, arm = continued(job, before)
    assert len(arm.motions) == 1 and played.approach_speed is None
    tool = job.arm.tool_position(before.record.measured[-1])
    start = job.arm.tool_position(played.motion.q[0])
    assert np.linalg.norm(tool - start) < REPEATED


def test_the_way_back_leads_around_a_corner():
    job = parse_job(resuming.PLANAR)
    before = stopped(job, 1.0)
    (drawn,) = before.plan.objective.contours
    tool = job.arm.tool_position(before.record.measured[-1])
    s = float(drawn.path.project(tool[None]).s[0])
    # The stop is after the first corner, and the rest begins before it.
    assert 0.065 < s < 0.115
    played, arm = continued(with_rejoin(job, s - 0.04), before)
    way = job.arm.tool_position(arm.motions[0].q)
    assert distances(played.plan.path.contours[0].path, way).max() < ON_PATH
    # A straight line would have left the path by millimetres.
    ends = np.linspace(arm.motions[0].q[0], arm.motions[0].q[-1], 200)
    assert distances(drawn.path, job.arm.tool_position(ends)).max() > 3e-3
    # The tool moves at most at 10 % of the assigned velocity.
    speed = np.linalg.norm(np.diff(way, axis=0), axis=1).max() / CYCLE
    assert 0.005 < speed < 0.1 * 0.10 * 1.001
    assert played.approach_speed == pytest.approx(speed, rel=0.02)


def test_a_robot_that_was_moved_away_returns_on_a_straight_line():
    job = parse_job(resuming.PLANAR)
    before = stopped(job, 0.2)
    arm = robot(at=before.record.command[-1] + [0.05, -0.05])
    play(with_rejoin(job, REJOIN), arm, execute=True, override=1.0, resume=before.stopped_at)
    way = arm.motions[0].q
    direction = way[-1] - way[0]
    off = way - way[0] - np.outer((way - way[0]) @ direction, direction) / (direction @ direction)
    assert np.abs(off).max() < 1e-9


def test_a_stop_before_a_contour_resumes_the_whole_contour():
    job = squares()
    whole = resuming.plan_of(job)
    _, rapid, _ = whole.trajectory.spans
    before = stopped(job, (rapid.t[0] + rapid.t[1]) / 2 - 0.4)
    played, _ = continued(with_rejoin(job, REJOIN), before)
    (left,) = played.plan.objective.contours
    assert left.path.length == pytest.approx(whole.objective.contours[1].path.length)


def lifted_job() -> ac.Job:
    """Two lines in space, with a rapid that lifts the tool by 30 mm between them."""
    job = parse_job(resuming.SPATIAL)
    points = [(0.4, -0.05, 0.2), (0.4, -0.05, 0.23), (0.4, 0.05, 0.23), (0.4, 0.05, 0.2)]

    def line(a: tuple[float, ...], b: tuple[float, ...]) -> ac.Path:
        return ac.Path.polyline([a, b]).pointing([0, 0, -1])

    moves = (
        ac.Contour(line((0.45, -0.05, 0.2), points[0])),
        *(ac.Rapid(line(a, b)) for a, b in itertools.pairwise(points)),
        ac.Contour(line(points[-1], (0.45, 0.05, 0.2))),
    )
    return replace(job, path=ac.Program(moves=moves))


@pytest.mark.parametrize("share", [0.1, 0.5])
def test_a_robot_that_was_stopped_on_a_rapid_completes_it_with_its_lift(share):
    job = lifted_job()
    whole = resuming.plan_of(job).trajectory
    first, last = (x.t for x in whole.contour_spans)
    before = stopped(job, first[1] + share * (last[0] - first[1]) - 0.4)
    place = before.record.plan_time[-1]
    plan = before.plan.trajectory
    end = plan.contour_spans[1].t[0]
    assert plan.contour_spans[0].t[1] < place < end
    played, arm = continued(job, before)
    assert played.record.stopped is None
    (way, _) = arm.motions
    np.testing.assert_allclose(way.q[0], before.record.command[-1], atol=1e-12)
    np.testing.assert_allclose(way.q[-1], played.motion.q[0], atol=1e-9)
    # All joints are where the job's rapid has them.
    rapid = plan(np.linspace(place, end, 4001))
    distances = [np.abs(rapid - q).max(axis=1).min() for q in way.q[::10]]
    assert max(distances) < 1.5e-3
    assert job.arm.tool_position(way.q)[:, 2].max() > 0.2299


def test_a_note_is_not_the_reason_of_a_stop():
    """A set-point was late, and later the motion was stopped on request."""
    job = parse_job(resuming.PLANAR)
    late = "Set-points were computed too late 1 time."

    class Late(Simulated):
        def stream(self, *args):
            return replace(super().stream(*args), notes=(late,))

    machine = Late(late=False, cycle=CYCLE, acceleration=100.0)
    played = play(job, machine, execute=True, override=1.0, stop_requested=After(0.8))
    assert played.record.stopped is not None
    assert played.reason == "stopped on request" and played.record.notes == (late,)


def test_a_rest_that_is_stopped_again_is_continued():
    job = parse_job(resuming.PLANAR)
    first = stopped(job, 0.2)
    arm = robot(at=first.record.command[-1])
    second = play(
        job, arm, execute=True, override=1.0, resume=first.stopped_at, stop_requested=After(0.9)
    )
    assert second.stopped_at.resume_at > first.stopped_at.resume_at + 0.01
    played, _ = continued(second.job, second)
    tool = job.arm.tool_position(second.record.measured[-1])
    np.testing.assert_allclose(
        job.arm.tool_position(played.motion.q[0]), tool, atol=REPEATED + 0.5e-3
    )


def test_another_job_or_configuration_is_refused():
    job = parse_job(resuming.SPATIAL)
    before = stopped(job, 0.2)
    with pytest.raises(ac.InvalidInput, match="other"):
        continued(replace(job, name="other"), before)
    # Joint 6 is a whole turn away.
    turned = replace(
        before.stopped_at,
        measured=before.stopped_at.measured + [0, 0, 0, 0, 0, 2 * np.pi],
    )
    with pytest.raises(ControllerRefused) as refused:
        play(job, robot(), resume=turned)
    assert refused.value.joint == 5
    nothing = replace(before.stopped_at, resume_at=None, words="all contours are complete")
    with pytest.raises(ac.InvalidInput, match="all contours are complete"):
        play(job, robot(), resume=nothing)


def test_the_rest_of_chosen_contours_is_continued():
    job = squares()
    chosen = replace(job, process=replace(job.process, only=("2",)))
    before = stopped(chosen, 0.3)
    lengths = [x.path.length for x in job.program.contours]
    # The place counts in the whole job.
    assert lengths[0] < before.stopped_at.resume_at < sum(lengths)
    played, arm = continued(with_rejoin(job, REJOIN), before)
    (left,) = played.plan.objective.contours
    tool = job.arm.tool_position(before.record.measured[-1])
    assert 0 <= float(left.path.project(tool[None]).s[0]) - REJOIN < REPEATED + 0.5e-3
    assert distances(left.path, job.arm.tool_position(arm.motions[0].q)).max() < 0.5e-3


def killed(folder: Path, job: ac.Job, played: Played, t: float) -> int:
    """Write the record that remains if `play` is killed some time after the begin [s].

    The motion to the start is before it. Returns the number of its samples.
    """
    folder.mkdir()
    record = played.record
    count = round(t / CYCLE)
    way = np.linspace(record.measured[0] + 0.05, record.measured[0], 100)
    q = np.concatenate([way, record.measured[:1], record.measured[:count]])
    cycles = np.concatenate([np.arange(100), [-1], np.arange(count)])
    table = np.column_stack([CYCLE * np.arange(len(q)), q, q, cycles])
    run = played.plan.run.name
    head = log_head([unfinished_comment(job, run)], [False] * job.arm.dof) + ",cycle"
    file = folder / "unfinished.csv"
    np.savetxt(file, table, delimiter=",", fmt="%.9g", header=head, comments="")
    # A feeder that was killed has not completed its last line.
    file.write_text(file.read_text(encoding="utf-8") + "9.1,0.3", encoding="utf-8")
    return count


class Slower:
    """An override that changes, with a pause."""

    def __init__(self) -> None:
        self.left = [1.0] * 6 + [0.0] * 9 + [0.4] * 8 + [0.9]

    def __call__(self) -> float:
        return self.left.pop(0) if len(self.left) > 1 else self.left[0]


@pytest.mark.parametrize(
    ("job", "t"),
    [
        (parse_job(resuming.PLANAR), 0.7),
        (parse_job(resuming.PLANAR), 2.0),
        (squares(), 3.9),
        (resuming.resume(parse_job(resuming.SPATIAL), 0.06), 1.5),
    ],
)
def test_the_place_of_a_command_that_was_killed_is_found_in_its_record(tmp_path, job, t):
    played = play(job, robot(), execute=True, override=Slower())
    count = killed(tmp_path / "killed", job, played, t)
    whole = resuming.resume(job, 0.0)
    place = unfinished_place(whole, robot(), read_unfinished(tmp_path / "killed"))
    record = played.record
    expected = find_stopped_place(
        played.job,
        played.plan,
        float(record.plan_time[count - 1]),
        record.plan_time[:count],
        record.measured[:count],
    )
    assert place.words == expected.words
    assert place.resume_at == pytest.approx(expected.resume_at, abs=20e-6)
    np.testing.assert_allclose(place.measured, record.measured[count - 1], atol=1e-8)
    assert place.resumed(whole).process.resume_at == place.resume_at


def test_a_command_that_was_killed_before_its_motion_is_played_from_the_start(tmp_path):
    job = parse_job(resuming.PLANAR)
    played = play(job, robot(), execute=True, override=1.0)
    killed(tmp_path / "killed", job, played, 0.0)
    place = unfinished_place(job, robot(), read_unfinished(tmp_path / "killed"))
    assert place.resume_at == 0.0 and "not begun" in place.words
    with pytest.raises(ac.InvalidInput, match="other"):
        unfinished_place(replace(job, name="other"), robot(), read_unfinished(tmp_path / "killed"))


def test_the_command_resumes_after_it_was_killed(tmp_path, monkeypatch):
    job = parse_job(resuming.PLANAR)
    played = play(job, robot(), execute=True, override=1.0)
    killed(tmp_path / "killed", job, played, 0.9)
    terminal = Terminal(monkeypatch, tmp_path, resuming.PLANAR)
    code, printed = terminal.play("--resume", "killed", "--execute", "--out", "rest")
    assert code == 0, printed
    place = unfinished_place(job, robot(), read_unfinished("killed"))
    begun = job.arm.tool_position(terminal.arm.motions[-1].q[0])
    (drawn,) = resuming.plan_of(job).objective.contours
    np.testing.assert_allclose(begun, drawn.path(place.resume_at), atol=1e-6)
    Path("killed/unfinished.csv").write_text("t,u1,q1\n", encoding="utf-8")
    code, printed = terminal.play("--resume", "killed")
    assert code == 2 and "unfinished.csv" in printed


class Terminal:
    """The command `play` with a simulated robot that keeps its position."""

    def __init__(self, monkeypatch, folder: Path, text: str) -> None:
        self.trip = np.inf
        self.held = None
        self.arm = None
        monkeypatch.setattr(play_command, "controller_of", self.controller)
        monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
        name = parse_job(text).arm.name
        monkeypatch.setattr(play_command.typer, "prompt", lambda *_, **__: name)
        monkeypatch.chdir(folder)
        (folder / "job.yaml").write_text(text, encoding="utf-8")

    def controller(self, *_) -> Simulated:
        if self.arm is not None:
            self.held = self.arm.held
        self.arm = robot(at=self.held, trip=self.trip)
        return self.arm

    def play(self, *words: str) -> tuple[int, str]:
        begin = ["play", "job.yaml", "--on", "linuxcnc", "--speed-factor", "100 %"]
        code, printed, errors = run_command([*begin, *words])
        return code, " ".join((printed + errors).split())


def test_the_command_continues_from_the_folder_of_the_stop(tmp_path, monkeypatch):
    terminal = Terminal(monkeypatch, tmp_path, resuming.PLANAR)
    terminal.trip = 225
    code, printed = terminal.play("--execute", "--out", "played")
    assert code == 1 and "--resume played" in printed
    stop = read_stopped_place("played")
    terminal.trip = np.inf
    again = ("--resume", "played", "--rejoin", "3 mm")
    code, printed = terminal.play(*again, "--execute", "--out", "played2")
    assert code == 0, printed
    summary = json.loads(Path("played2/summary.json").read_text(encoding="utf-8"))
    assert summary["kept"] and "resume" not in summary
    # The rest of the whole job was played, from 3 mm before the stop.
    begun = terminal.arm.motions[-1].q[0]
    job = parse_job(resuming.PLANAR)
    (drawn,) = resuming.plan_of(job).objective.contours
    point = job.arm.tool_position(begun)
    np.testing.assert_allclose(point, drawn.path(stop.resume_at - 3e-3), atol=1e-6)


def test_the_command_refuses_what_cannot_be_continued(tmp_path, monkeypatch):
    terminal = Terminal(monkeypatch, tmp_path, resuming.PLANAR)
    code, printed = terminal.play("--resume", "missing")
    assert code == 2 and "missing" in printed
    code, printed = terminal.play("--execute", "--out", "whole")
    assert code == 0 and "--resume" not in printed
    code, printed = terminal.play("--resume", "whole")
    assert code == 2 and "nothing is left" in printed
    terminal.trip = 225
    terminal.play("--execute", "--out", "played")
    code, printed = terminal.play("--resume", "played", "--resume-at", "5 mm")
    assert code == 2 and "--resume-at" in printed
    code, printed = terminal.play("--resume", "played", "--set", "name=other")
    assert code == 2 and "'square'" in printed and "'other'" in printed
    assert run_command(["run", "job.yaml", "--out", "ran"])[0] == 0
    code, printed = terminal.play("--resume", "ran")
    assert code == 2 and "not the summary of a motion" in printed
