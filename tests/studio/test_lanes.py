"""Previews in a thread, and other work in a process."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Condition, Event

import pytest

from armcontour._process import ProcessEnded
from armcontour.errors import Unreachable
from armcontour.studio import lanes
from armcontour.studio.lanes import FastLane, SlowLane
from armcontour.studio.tasks.working import SMALL
from armcontour.studio.wire import Frame


def test_of_works_that_wait_only_the_latest_is_done():
    begun, go, done = Event(), Event(), Event()
    found = []

    def deliver(frame: Frame) -> None:
        found.append(frame.header["n"])
        if frame.header["n"] == 4:
            done.set()

    def first(stale) -> Iterator[Frame]:
        assert not stale()
        begun.set()
        go.wait(5)
        assert stale()
        yield Frame("picture", {"n": 1})

    def other(n):
        def work(stale):
            assert not stale()
            yield Frame("picture", {"n": n})

        return work

    lane = FastLane(deliver)
    lane.submit(first)
    assert begun.wait(5)
    for n in (2, 3, 4):
        lane.submit(other(n))
    go.set()
    assert done.wait(5)
    lane.close()
    assert found == [1, 4]


def test_errors_are_told_and_the_lane_goes_on():
    done = Event()
    found = []

    def deliver(frame: Frame) -> None:
        found.append(frame.header["sentence"])
        done.set()

    def refused(stale) -> Iterator[Frame]:
        raise Unreachable("The arm does not reach it.")
        yield

    def wrong(stale) -> Iterator[Frame]:
        raise ZeroDivisionError("division by zero")
        yield

    lane = FastLane(deliver)
    for work in (refused, wrong):
        done.clear()
        lane.submit(work)
        assert done.wait(5)
    lane.close()
    assert found == [
        "The arm does not reach it.",
        "The preview failed: ZeroDivisionError: division by zero",
    ]


class Heard:
    """Collects frames, and waits for one."""

    def __init__(self):
        self.frames, self.news = [], Condition()

    def __call__(self, frame):
        with self.news:
            self.frames.append(frame)
            self.news.notify_all()

    def wait(self, id, *kinds):
        def found():
            return [x for x in self.frames if x.header["id"] == id and x.kind in kinds]

        with self.news:
            assert self.news.wait_for(found, 120), [x.kind for x in self.frames]
            return found()[0]


@pytest.fixture(scope="module")
def heard():
    return Heard()


@pytest.fixture(scope="module")
def slow(heard):
    lane = SlowLane(heard)
    yield lane
    lane.close()


# Takes far longer than any of these tests.
LONG = {"text": SMALL, "options": {"key": "limits.speed", "values": [0.1] * 100_000}}


def test_no_process_is_started_before_the_first_task(monkeypatch):
    started = []
    monkeypatch.setattr(lanes, "Worker", lambda work: started.append(1))
    lane = SlowLane(lambda frame: None)
    time.sleep(0.1)
    assert not started
    lane.close()
    assert not started


class TestSlowLane:
    def test_a_task_is_done_and_others_after_it(self, slow, heard):
        slow.submit("a", "figures", {"text": SMALL})
        slow.submit("b", "sweep", LONG | {"options": LONG["options"] | {"values": [0.1, 0.2]}})
        slow.submit("c", "bake", {"text": SMALL})
        assert heard.wait("a", "figures").header["duration"] > 0
        assert heard.wait("b", "result").arrays["values"].tolist() == [0.1, 0.2]
        assert "no task 'bake'" in heard.wait("c", "failed").header["sentence"]

    def test_a_cancelled_task_ends_at_once_and_the_next_is_done(self, slow, heard):
        slow.submit("d", "sweep", LONG)
        slow.submit("e", "sweep", LONG)
        slow.submit("f", "figures", {"text": SMALL})
        progress = heard.wait("d", "progress").header
        assert progress["task"] == "sweep" and 0 < progress["share"] < 1 and progress["eta"] > 0
        process = slow._worker._child
        begin = time.monotonic()
        slow.cancel("e")
        slow.cancel("d")
        assert time.monotonic() - begin < 0.2
        assert {x.header["id"] for x in heard.frames if x.kind == "cancelled"} == {"d", "e"}
        assert heard.wait("f", "figures").header["duration"] > 0
        assert process.poll() is not None
        assert not [x for x in heard.frames[-1:] if x.header["id"] in "de"]
        slow.cancel("f")
        assert heard.frames[-1].header["id"] == "f"

    def test_a_process_that_dies_is_said_and_replaced(self, slow, heard):
        slow.submit("g", "sweep", LONG)
        heard.wait("g", "progress")
        slow._worker._child.kill()
        assert "has ended before it gave an answer" in heard.wait("g", "failed").header["sentence"]
        slow.submit("h", "figures", {"text": SMALL})
        assert heard.wait("h", "figures").header["duration"] > 0

    def test_a_process_that_does_not_start_fails_each_task(self, monkeypatch):
        starts = []

        class Ended:
            def __init__(self, work):
                starts.append(work)

            def do(self, given, heard):
                raise ProcessEnded("Another process has ended.")

            def end(self):
                pass

            close = end

        monkeypatch.setattr(lanes, "Worker", Ended)
        heard = Heard()
        lane = SlowLane(heard)
        for id in ("a", "b"):
            lane.submit(id, "figures", {"text": SMALL})
            assert heard.wait(id, "failed").header["sentence"] == "Another process has ended."
        lane.close()
        assert 2 <= len(starts) <= 3

    def test_it_ends_with_the_process_that_started_it(self, slow, heard, tmp_path):
        code = (
            "import time\n"
            "from armcontour.studio.lanes import SlowLane\n"
            "from tests.studio.test_lanes import LONG\n"
            "lane = SlowLane(lambda frame: print(lane._worker._child.pid, flush=True))\n"
            "lane.submit('a', 'sweep', LONG)\n"
            "time.sleep(60)\n"
        )
        root = Path(__file__).parents[2]
        first = subprocess.Popen(
            [sys.executable, "-c", code], stdout=subprocess.PIPE, cwd=root, text=True
        )
        other = int(first.stdout.readline())
        first.kill()
        first.wait()
        first.stdout.close()
        end = time.monotonic() + 20
        while is_running(other):
            assert time.monotonic() < end
            time.sleep(0.05)


def is_running(process):
    """Whether there is a process that has not ended."""
    try:
        text = Path(f"/proc/{process}/stat").read_text()
    except FileNotFoundError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"
