"""What pages see while somebody edits, and when nothing moves; time passes as tests say."""

from functools import partial

import numpy as np
import pytest
from tests.studio.talking import JOB, MOVE, AtOnce, Held, NoLane, Tab, kinds, session_of
from tools.studio_page import SQUARE

from armcontour.studio import display
from armcontour.studio.wire import Frame

pytestmark = pytest.mark.usefixtures("no_hurry")


class Clock:
    """A clock and the timers that it starts."""

    def __init__(self):
        self.now, self.waiting, self.started = 0.0, [], 0

    def monotonic(self):
        return self.now

    def go(self, seconds=1.0):
        """Let time pass."""
        end = self.now + seconds
        while due := [x for x in self.waiting if x.at <= end]:
            first = min(due, key=lambda x: x.at)
            self.waiting.remove(first)
            self.now = first.at
            first.call()
        self.now = end


class FakeTimer:
    def __init__(self, clock, seconds, call, args=()):
        self.clock, self.at, self.call = clock, clock.now + seconds, partial(call, *args)

    def start(self):
        self.clock.waiting.append(self)
        self.clock.started += 1

    def cancel(self):
        self.clock.waiting.remove(self)


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr(display, "time", found)
    monkeypatch.setattr(display, "Timer", partial(FakeTimer, found))
    return found


def test_older_answers_never_come_after_newer_ones(file):
    session = session_of(file, fast=Held)
    lane, tab = Held.last, Tab(session)
    tab.edit(MOVE)
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    old, new = lane.works
    for work in (new, old):
        AtOnce.submit(lane, work)
    assert [x.header["seq"] for x in tab.frames if x.kind == "picture"] == [2]
    session.close()


def test_exact_figures_come_when_nothing_moves(file, clock):
    session = session_of(file, rest=0.0)
    session.begin()
    tab, lane = Tab(session), NoLane.last
    clock.go()
    ((id, task, request),) = lane.given
    assert task == "figures" and request["text"] == JOB and request["run"] == "slow"
    figures = {"id": id, "run": "slow", "duration": 12.5, "rms": 1e-4}
    lane.deliver(Frame("figures", figures))
    told = tab.last("figures")
    assert told["duration"] == 12.5 and told["rev"] == session.editor.rev
    tab.edit(MOVE)
    clock.go()
    late = lane.given[1][0]
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    clock.go()
    assert len(lane.given) == 2, "one at a time"
    before = kinds(tab.frames).count("figures")
    lane.deliver(Frame("figures", {**figures, "id": late}))
    assert kinds(tab.frames).count("figures") == before, "out of date"
    assert len(lane.given) == 3 and lane.given[2][2]["text"] == session.document.text
    session.close()


def test_another_configuration_of_the_full_run_is_announced(tmp_path, clock):
    file = tmp_path / "job.yaml"
    file.write_text(SQUARE)
    session = session_of(file, rest=0.0)
    session.begin()
    tab, lane = Tab(session), NoLane.last
    clock.go()
    lane.deliver(Frame("figures", {"id": lane.given[0][0]}))
    for k, turn in enumerate((0.0, np.pi / 2), 1):
        tab.edit({"do": "set", "key": "limits.speed", "value": 0.1 + 0.01 * k}, gesture=k)
        clock.go()
        assert "notice" not in kinds(tab.frames)
        assert len(lane.given) == k + 1 and lane.given[k][2]["text"] == session.document.text
        before = session.display.screen.planned.start
        after = before + [0, 0, 0, 0, 0, turn]
        lane.deliver(Frame("figures", {"id": lane.given[k][0], "start": after}))
    clock.go()
    session.close()
    assert kinds(tab.frames).count("notice") == 1
    told = tab.last("notice")["sentence"]
    assert all(f"{np.degrees(q[5]):.1f}" in told for q in (before, after))
