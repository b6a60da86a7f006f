"""Workers: previews in a thread, and tasks in a process."""

from threading import Condition, Event

import pytest
from tests.studio.session_pages import figure
from tools.studio_page import write_shapes

from armcontour.core.pool import ProcessEnded
from armcontour.files.job_file import drawing_text
from armcontour.report.message_frame import MessageFrame
from armcontour.studio import workers
from armcontour.studio.tasks.dispatch import WARMUP_JOB
from armcontour.studio.workers import PreviewWorker, TaskWorker


class Heard:
    """Collects frames, and waits for one."""

    def __init__(self):
        self.frames = []
        self.news = Condition()

    def __call__(self, frame):
        with self.news:
            self.frames.append(frame)
            self.news.notify_all()

    def wait(self, id, *kinds):
        def matching_frames():
            return [x for x in self.frames if x.header["id"] == id and x.kind in kinds]

        with self.news:
            self.news.wait_for(matching_frames)
            return matching_frames()[0]


def test_only_the_newest_waiting_task_is_done():
    begun = Event()
    go = Event()
    heard = Heard()

    def first(stale):
        assert not stale() and not stale(within=1e-6)
        begun.set()
        go.wait()
        assert stale() and stale(within=1e6)
        heard(MessageFrame("picture", {"id": 1}))

    def other(n):
        def work(stale):
            assert not stale()
            heard(MessageFrame("picture", {"id": n}))

        return work

    lane = PreviewWorker(heard)
    lane.submit(first)
    begun.wait()
    for n in (2, 3, 4):
        lane.submit(other(n))
    go.set()
    heard.wait(4, "picture")
    lane.close()
    assert [x.header["id"] for x in heard.frames] == [1, 4]


class Process:
    """A task process as a test has it: a long task ends when the process is killed."""

    def __init__(self):
        self.killed = Event()

    @property
    def is_killed(self):
        return self.killed.is_set()

    def run(self, task_input, listener):
        if task_input.task == "long":
            listener(MessageFrame("progress", {"id": task_input.id}))
            self.killed.wait()
        if task_input.task in ("long", "die"):
            raise ProcessEnded("It has ended.")
        return MessageFrame("result", {})

    def stop(self, id):
        """It does not listen."""

    def kill(self):
        self.killed.set()


@pytest.fixture
def lane(monkeypatch):
    """A lane whose process is of this test, and what it delivers."""
    monkeypatch.setattr(workers, "TaskProcess", Process)
    heard = Heard()
    lane = TaskWorker(heard)
    yield lane, heard
    lane.close()


def test_a_cancelled_task_ends_and_the_next_is_done(lane):
    lane, heard = lane
    for id, task in (("d", "long"), ("e", "long"), ("f", "short")):
        lane.submit(id, task, {})
    heard.wait("d", "progress")
    lane.cancel("e")
    lane.cancel("d")
    heard.wait("f", "result")
    lane.cancel("f")
    assert [(x.kind, x.header["id"]) for x in heard.frames] == [
        *(("progress", "d"), ("cancelled", "e"), ("cancelled", "d"), ("result", "f"))
    ]


def test_the_end_of_a_process_fails_only_its_task(lane):
    lane, heard = lane
    lane.submit("a", "die", {})
    lane.submit("b", "short", {})
    heard.wait("b", "result")
    assert [(x.kind, x.header["id"]) for x in heard.frames] == [("failed", "a"), ("result", "b")]


def test_a_real_process_does_one_task_after_the_other():
    heard = Heard()
    lane = TaskWorker(heard)
    lane.submit("a", "figures", {"text": WARMUP_JOB})
    lane.submit("b", "report", {"text": WARMUP_JOB})
    lane.submit("c", "bake", {"text": WARMUP_JOB})
    assert figure(heard.wait("a", "figures").header, "duration") > 0
    assert heard.wait("b", "result").header["name"].endswith(".html")
    assert "but is 'bake'" in heard.wait("c", "failed").header["sentence"]
    lane.close()


def test_a_stopped_task_leaves_its_process_with_what_it_remembers(tmp_path):
    text = drawing_text("ur5e", write_shapes(tmp_path / "a.dxf", 30, 6, 8.0, 2.5), tmp_path)
    request = {"text": text, "folder": str(tmp_path)}
    heard = Heard()
    lane = TaskWorker(heard)
    lane.submit("a", "picture", request)
    heard.wait("a", "progress")
    process = lane._process
    lane.stop("a")
    # A task that still waits is taken from the queue.
    lane.submit("b", "picture", request)
    lane.submit("c", "figures", {"text": WARMUP_JOB})
    heard.wait("a", "cancelled")
    lane.stop("b")
    heard.wait("b", "cancelled")
    heard.wait("c", "figures")
    assert lane._process is process and not process.is_killed
    lane.submit("d", "picture", request)
    assert len(heard.wait("d", "picture").header["contours"]) == 30
    lane.close()


def test_a_task_that_does_not_stop_is_killed(lane, monkeypatch):
    lane, heard = lane
    monkeypatch.setattr(workers, "MAX_STOPPING", 0.01)
    lane.submit("a", "long", {})
    heard.wait("a", "progress")
    lane.stop("a")
    heard.wait("a", "cancelled")
    lane.submit("b", "short", {})
    heard.wait("b", "result")
