"""A stopped motion states where to resume the job: not after the place that the tool reached."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from docs.pages import run_command
from soak import resuming
from tests.controllers.simulated import Simulated

import armcontour as ac
from armcontour.cli import play_command
from armcontour.controllers import Played, play
from armcontour.files import parse_job

CYCLE = 4e-3
# Largest length that is executed again, on a line [m].
REPEATED = 5e-6


class After:
    """Requests a stop after a time [s]."""

    def __init__(self, t: float) -> None:
        self.left = round(t / CYCLE)

    def __call__(self) -> bool:
        self.left -= 1
        return self.left < 0


def stopped(job: ac.Job, t: float, **robot) -> Played:
    """The job played on a simulated robot, stopped after a time."""
    arm = Simulated(**{"late": False, "cycle": CYCLE, "acceleration": 100.0, **robot})
    return play(job, arm, execute=True, override=1.0, stop_requested=After(t + 0.3))


def resumed_at(played: Played) -> float:
    """Value of the printed option [m]."""
    option = played.to_data()["resume.option"].value
    (millimetres,) = re.findall(r"^--resume-at '(.*) mm'$", option)
    return 1e-3 * float(millimetres)


def squares() -> ac.Job:
    """Two squares with a rapid between them."""
    job = parse_job(resuming.PLANAR)
    (square,) = job.program.contours
    other = ac.Contour(path=ac.Path.polyline(square.path.vertices + [0.0, 0.08]))
    return replace(job, path=ac.Program(moves=(square, other)))


@pytest.mark.parametrize(
    ("text", "t", "begin", "corner"),
    [
        (resuming.PLANAR, 0.1, 0.0, 0.0),
        (resuming.PLANAR, 0.4, 0.0, 0.5e-3),
        (resuming.PLANAR, 0.9, 0.06, 0.0),
        (resuming.SPATIAL, 0.3, 0.0, 0.0),
        (resuming.LED, 1.1, 0.0, 0.0),
    ],
)
def test_the_resumed_tool_starts_where_the_tool_has_stopped(text, t, begin, corner):
    """`corner`: error of the rounded corner in which the tool stops [m]; 0 on a line."""
    job = resuming.resume(parse_job(text), begin)
    played = stopped(job, t)
    value = resumed_at(played)
    tool = job.arm.tool_position(played.record.measured[-1])
    rest = resuming.plan_of(resuming.resume(job, value))
    drawn = rest.objective.contours[0]
    # The tool is on the rest of the contour, just after its start.
    beyond = float(drawn.path.project(tool[None]).s[0]) - drawn.at_work[0]
    assert 0 <= beyond < REPEATED + corner
    q = resuming.start_of_work(rest)
    np.testing.assert_allclose(job.arm.tool_position(q), tool, atol=REPEATED + corner)
    # The configuration is kept, also whole turns.
    np.testing.assert_allclose(q, played.record.measured[-1], atol=1e-4 + 10 * corner)


def test_a_stop_in_a_rapid_resumes_the_next_contour_as_a_whole():
    job = squares()
    whole = resuming.plan_of(job)
    _, rapid, second = whole.trajectory.spans
    assert rapid.kind == "rapid"
    played = stopped(job, (rapid.t[0] + rapid.t[1]) / 2 - 0.4)
    assert rapid.t[0] < played.record.plan_time[-1] < second.t[0]
    value = resumed_at(played)
    (left,) = resuming.plan_of(resuming.resume(job, value)).objective.contours
    assert left.path.length == whole.objective.contours[1].path.length
    assert value == pytest.approx(resuming.work_lengths(whole)[1], abs=1e-9)
    assert "contour 2" in played.stopped_at.words


@pytest.mark.parametrize("trip", [290, 365])
def test_a_robot_whose_drives_fail_resumes_where_it_left_the_path(trip):
    played = stopped(parse_job(resuming.PLANAR), 99.0, trip=trip)
    assert played.record.deviated
    tool = played.job.arm.tool_position(played.record.measured[-1])
    (drawn,) = played.plan.objective.contours
    beyond = float(drawn.path.project(tool[None]).s[0]) - resumed_at(played)
    assert 0 <= beyond < 1e-3
    # The set-points ended farther on the path.
    commanded = played.job.arm.tool_position(played.record.command[-1])
    assert np.linalg.norm(commanded - tool) > 5e-3


def test_a_stop_after_an_overlap_states_the_place_in_the_whole_job():
    job = resuming.resume(parse_job(resuming.PLANAR), 0.06)
    again = replace(job, process=replace(job.process, rejoin=0.02))
    played = stopped(again, 0.4)
    tool = job.arm.tool_position(played.record.measured[-1])
    beyond = float(job.program.path.project(tool[None]).s[0]) - resumed_at(played)
    # The tool stops in or near the rounded corner.
    assert 0 <= beyond < REPEATED + 0.5e-3
    start = resuming.plan_of(again).objective.contours[0].path(0.0)
    np.testing.assert_allclose(start, [0.34, 0.16], atol=1e-9)


def test_a_complete_motion_has_no_place_to_resume():
    played = stopped(parse_job(resuming.PLANAR), 99.0)
    assert played.stopped_at is None
    assert not [x for x in played.to_data().rows if x.name.startswith("resume")]


def test_play_prints_the_option(tmp_path, monkeypatch):
    def controller(*_):
        return Simulated(late=False, cycle=CYCLE, acceleration=100.0, trip=225)

    monkeypatch.setattr(play_command, "controller_of", controller)
    monkeypatch.setattr(play_command, "refuse_without_terminal", lambda _: None)
    monkeypatch.setattr(play_command.typer, "prompt", lambda *_, **__: "PMK-3s")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(resuming.PLANAR, encoding="utf-8")
    words = ["play", "job.yaml", "--on", "linuxcnc", "--speed-factor", "100 %", "--execute"]
    code, printed, _ = run_command(words)
    (value,) = re.findall(r"--resume-at '(.*?)'", printed)
    assert code == 1
    code, printed, _ = run_command(["run", "job.yaml", "--resume-at", value, "--out", "rest"])
    assert code == 0 and "configuration of the whole job" in " ".join(printed.split())


def test_the_printed_option_does_not_move_the_start_of_a_closed_path():
    """The keys of a resumed or a first run leave a path of points as it is."""
    job = parse_job(resuming.PLANAR)
    patch = {("process", "resume_at"): "20 mm", ("process", "off"): True}
    again = parse_job(resuming.PLANAR, patch=patch)
    start = resuming.plan_of(again).objective.contours[0].path.start
    np.testing.assert_allclose(start, job.program.path(0.02), atol=1e-12)
