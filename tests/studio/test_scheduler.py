"""The scheduler: order and accuracy of the pictures during and after edits."""

import dataclasses
from importlib import resources

import numpy as np
import pytest
from tests.files.tables import change_text
from tests.studio.session_pages import (
    JOB,
    MOVE,
    ImmediateWorker,
    ManualWorker,
    RecordingTaskWorker,
    RestingWorker,
    SessionPage,
    figure,
    kinds,
    session_of,
)
from tools.studio_page import SQUARE

import armcontour as ac
from armcontour.core import kernel_cache
from armcontour.core.progress import Step, TimeLeft
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job
from armcontour.files.job_text_edits import Change
from armcontour.jobs.run_plan import plan_one
from armcontour.report.message_frame import MessageFrame
from armcontour.studio import scheduler
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.tasks import dispatch

PAPER = (resources.files("armcontour.jobs") / "library" / "paper.yaml").read_text("utf-8")
FAR = {**MOVE, "to": [2.0, 0.15]}
pytestmark = pytest.mark.usefixtures("no_hurry")


@pytest.fixture
def opened(tmp_path):
    """Opens texts of jobs; each gives a session, a page and the lane of its exact figures."""
    sessions = []

    def open_text(text=JOB, preview_worker=ImmediateWorker):
        file = tmp_path / f"job{len(sessions)}.yaml"
        file.write_text(text)
        session = session_of(file, preview_worker=preview_worker)
        # The first task worker of a session is that of figures.
        lane = RecordingTaskWorker.last
        sessions.append(session)
        session.begin()
        return session, SessionPage(session), lane

    yield open_text
    for session in sessions:
        session.close()


def tiers(frames):
    """What frames are, and of which tier."""
    shown = ("picture", "executed", "figures")
    return [f"{x.kind} {x.header['tier']}" for x in frames if x.kind in shown]


def answer(lane, **header):
    """The task process sends the figures that were requested last, without pictures."""
    id, task, _ = lane.given[-1]
    assert task == "figures"
    lane.deliver(MessageFrame("figures", {**header, "id": id, "tier": "exact"}))
    while lane.given[-1][1] in ("picture", "executed") and lane.given[-1][0] != id:
        id = lane.given[-1][0]
        lane.deliver(MessageFrame("omitted", {"id": id}))


def compute(lane, *tasks):
    """The task process computes what was requested last, which are these tasks."""
    for name in tasks:
        id, task, request = lane.given[-1]
        assert task == name
        frame = dispatch.do(task, request, lambda step: None)
        lane.deliver(frame.stamped(id=id, task=task))


def figure_requests(lane):
    """Requests for figures."""
    return [x for x in lane.given if x[1] == "figures"]


@pytest.mark.parametrize("run", ["optimal", "shaped"])
def test_the_picture_after_the_last_edit_is_that_of_a_full_run(opened, run):
    others = [Change(("runs", x)) for x in load(PAPER, "job")["runs"] if x != run]
    text = change_text(PAPER, [*others, Change(("experiment",))])
    result = ac.run(parse_job(text)).runs[run]
    want = result.evaluation
    _, tab, lane = opened(text, preview_worker=RestingWorker)
    assert tab.last("picture")["tier"] == tab.last("executed")["tier"] == "preview"
    assert figure(tab.last("executed"), "contour_error.rms") != want.contour_error.rms
    coarse = figure(tab.last("picture"), "duration")
    assert coarse != want.duration
    assert run == "shaped" or coarse == pytest.approx(want.duration, rel=1e-3)
    compute(lane, "figures", "picture", "executed")
    assert tab.last("picture")["tier"] == tab.last("executed")["tier"] == "exact"
    assert figure(tab.last("picture"), "duration") == want.duration
    assert figure(tab.last("executed"), "contour_error.rms") == want.contour_error.rms


def test_older_answers_are_never_sent_after_newer_ones(opened):
    session, tab, _ = opened()
    session.scheduler._preview_worker = lane = ManualWorker(None)
    tab.edit(MOVE)
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    old, new = lane.works
    for work in (new, old):
        ImmediateWorker.submit(lane, work)
    revs = [x.header["rev"] for x in tab.frames if x.kind in ("document", "picture", "executed")]
    assert revs == sorted(revs)
    pictures = [x.header for x in tab.frames if x.kind == "picture" and x.header["seq"]]
    assert [x["seq"] for x in pictures] == [2]
    assert {x["document"] for x in pictures} == {tab.last("document")["id"]}


def test_exact_results_are_sent_after_the_last_edit(opened):
    session, tab, lane = opened(preview_worker=RestingWorker)
    ((id, task, request),) = lane.given
    assert task == "figures" and request["text"] == JOB and request["run"] == "slow"
    answer(lane, duration=12.5)
    figures = tab.last("figures")
    assert figures["duration"] == 12.5 and figures["rev"] == session.editor.rev
    tab.edit(MOVE)
    last_id = figure_requests(lane)[1][0]
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    assert len(figure_requests(lane)) == 2, "one at a time"
    before = kinds(tab.frames).count("figures")
    lane.deliver(MessageFrame("figures", {"id": last_id}))
    assert kinds(tab.frames).count("figures") == before, "out of date"
    requests = figure_requests(lane)
    assert len(requests) == 3 and requests[2][2]["text"] == session.editor.document.text
    # What is known is not computed again.
    answer(lane, duration=13.5)
    tab.say("select", run="slow")
    assert len(figure_requests(lane)) == 3 and tab.last("figures")["duration"] == 13.5


def test_previews_follow_the_configuration_of_the_full_run(opened):
    session, tab, lane = opened(SQUARE, preview_worker=RestingWorker)
    planned = session.scheduler.planned
    job = dataclasses.replace(planned.job, seed=planned.start + [0, 0, 0, 0, 0, np.pi / 2])
    other = plan_one(job, job.runs[0], clear=False).trajectory(0.0)
    lane.deliver(MessageFrame("figures", {"id": lane.given[-1][0], "tier": "exact"}))
    lane.deliver(MessageFrame("picture", {"id": lane.given[-1][0]}, {"q": other[None]}))
    lane.deliver(MessageFrame("omitted", {"id": lane.given[-1][0]}))
    tab.edit({"do": "set", "key": "limits.speed", "value": 0.09}, gesture=9)
    assert session.scheduler.start == pytest.approx(other, abs=1e-6)
    assert abs(session.scheduler.start - planned.start).max() > 1


class Nested(RestingWorker):
    """A preview worker that takes newer work after its present work, which `stale` reports."""

    def __init__(self, deliver):
        super().__init__(deliver)
        self.newest = None
        self.busy = False

    def submit(self, work):
        self.newest = work
        if self.busy:
            return
        self.busy = True
        done = None
        while done is not self.newest:
            done = self.newest
            done(lambda within=0.0, done=done: self.newest is not done)
        self.busy = False


@pytest.fixture
def during(monkeypatch):
    """Call a function during the next plan, which then reports its progress."""
    acts = []
    plan = CoarsePlanner.plan

    def planning(self, data, run=None, progress=None, **how):
        if acts:
            acts.pop(0)()
            progress(Step(("tracing",), 0.5))
        return plan(self, data, run, progress, **how)

    monkeypatch.setattr(CoarsePlanner, "plan", planning)
    monkeypatch.setattr(scheduler, "MAX_OBSOLETE_PLAN", -1.0)
    monkeypatch.setattr(scheduler, "PROGRESS_DELAY", -1.0)
    return acts.append


def moved(k):
    return {**MOVE, "to": [0.39 + 1e-3 * k, 0.16]}


def test_a_refusal_of_a_preview_applies_to_the_newest_state_only(opened, during):
    _, tab, _ = opened(preview_worker=Nested)
    during(lambda: tab.edit(FAR, gesture=2))
    frames = tab.edit(moved(1), gesture=1)
    *_, refusal = (x.header for x in frames if x.kind == "refusal")
    assert refusal["seq"] == tab.seq and refusal["error"] == "Unreachable" and refusal["tier"] == 1
    assert not tiers(frames), "the plan before is given up"
    frames = tab.say("undo")
    assert tiers(frames)[:2] == ["picture preview", "executed preview"]
    assert "refusal" not in kinds(frames)


def test_the_cell_of_a_job_without_a_plan_is_shown(file):
    file.write_text(JOB.replace("280 mm, 300 mm", "2 m, 300 mm"))
    session = session_of(file)
    tab = SessionPage(session)
    session.begin()
    assert "picture preview" not in tiers(tab.frames) and "refusal" in kinds(tab.frames)
    (arm,) = (x for x in tab.frames if x.kind == "arm")
    assert len(arm.header["joints"]) == 2
    # It is sent once.
    tab.edit({"do": "move_waypoint", "index": 2, "to": [2.1, 0.3]})
    assert len([x for x in tab.frames if x.kind == "arm"]) == 1
    session.close()


def progress(frames):
    return [x.header["state"] for x in frames if x.kind == "progress"]


def test_a_slow_plan_has_an_outline_and_progress(opened, during, monkeypatch):
    _, tab, lane = opened(preview_worker=Nested)
    monkeypatch.setattr(scheduler, "SLOW_PLAN", -1.0)
    frames = tab.edit(moved(1), gesture=1)
    assert tiers(frames) == ["picture outline", "picture preview", "executed preview"]
    assert set(progress(frames)) == {"working"}
    answer(lane)
    answer(lane)
    assert progress(tab.frames)[-1] == "done"
    # Progress of a state that is not shown any more goes.
    during(lambda: tab.edit(moved(3), gesture=3))
    assert "done" in progress(tab.edit(moved(2), gesture=2))


def test_path_and_arm_are_shown_before_the_functions_of_the_plan_are_compiled(opened):
    session, tab, _ = opened()
    with kernel_cache.waiting(lambda function: None):
        frames = tab.edit(moved(1), gesture=1)
        page = SessionPage(session)
    assert tiers(frames) == ["picture outline", "picture preview", "executed preview"]
    # A page that has no arm yet receives it before the plan.
    shown = [x for x in kinds(page.frames) if x in ("picture", "arm")]
    assert shown == ["picture", "arm", "picture"]


def test_a_killed_process_is_reported_and_the_next_edit_has_figures(opened):
    _, tab, lane = opened(preview_worker=Nested)
    failure = {"id": lane.given[-1][0], "sentence": "It has ended before it gave an answer."}
    lane.deliver(MessageFrame("failed", failure))
    assert "has ended" in tab.last("notice")["sentence"]
    tab.edit(moved(1), gesture=1)
    answer(lane, duration=12.5)
    assert tab.last("figures")["seq"] == tab.seq


def test_a_slow_simulation_of_a_preview_is_omitted_before_the_exact_figures(opened, monkeypatch):
    _, tab, lane = opened(preview_worker=RestingWorker)
    answer(lane)
    monkeypatch.setattr(scheduler, "SLOW_SIMULATION", -1.0)
    asked = len(figure_requests(lane))
    assert tiers(tab.edit(moved(1), gesture=1)) == ["picture preview"]
    assert len(figure_requests(lane)) == asked + 1
    monkeypatch.setattr(scheduler, "SLOW_SIMULATION", np.inf)
    answer(lane)
    assert tiers(tab.edit(moved(2), gesture=2)) == ["picture preview", "executed preview"]


def test_progress_of_a_long_plan_names_the_contour_and_the_time_left(opened, monkeypatch):
    _, tab, lane = opened(preview_worker=RestingWorker)
    monkeypatch.setattr(scheduler, "PROGRESS_DELAY", -1.0)
    monkeypatch.setattr(scheduler, "PROGRESS_INTERVAL", -1.0)
    clock = [100.0]
    monkeypatch.setattr(scheduler, "TimeLeft", lambda _: TimeLeft(lambda: clock[0]))
    answer(lane)
    tab.edit(moved(1), gesture=1)
    id = figure_requests(lane)[-1][0]
    for k in (1, 2, 3):
        clock[0] += 2.0
        header = {"id": id, "task": "figures", "steps": ["only", "tracing"], "share": k / 10}
        lane.deliver(MessageFrame("progress", {**header, "part": f"contour {k} of 10"}))
    last = tab.last("progress")
    assert last["part"] == "contour 3 of 10" and last["tier"] == "exact"
    # Seven contours are left, of 2 s each.
    assert last["left"] == pytest.approx(14.0)
