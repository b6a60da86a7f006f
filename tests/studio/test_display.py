"""What pages see while somebody edits, and when nothing moves."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from soak.studio_page import SQUARE
from tests.studio.talking import JOB, MOVE, AtOnce, Held, NoLane, Tab, kinds, session_of

from armcontour.studio import screen
from armcontour.studio.session import Session
from armcontour.studio.wire import Frame

pytestmark = pytest.mark.usefixtures("no_hurry")


def wait_for(found: Callable[[], Any]) -> None:
    """Wait until something holds."""
    end = time.monotonic() + 20
    while not found():
        assert time.monotonic() < end
        time.sleep(0.002)


def test_a_slow_plan_is_executed_when_nothing_moves(
    session: Session, tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screen, "QUICK", 0.0)
    assert kinds(tab.edit(MOVE)) == ["document", "picture"]
    before = len(tab.frames)
    session.display.screen.rest()
    session.display.screen.rest()
    assert kinds(tab.frames[before:]) == ["executed"]


def test_a_long_motion_is_executed_when_nothing_moves(
    session: Session, tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screen, "SHORT", 0.0)
    assert kinds(tab.edit(MOVE)) == ["document", "picture"]
    before = len(tab.frames)
    session.display.screen.rest()
    assert kinds(tab.frames[before:]) == ["executed"]


def test_one_timer_waits_for_the_rest_of_many_edits(file: Path) -> None:
    session = session_of(file, rest=1.0)
    tab, rests = Tab(session), list[float]()
    session.display.screen.rest = lambda: rests.append(time.monotonic())  # type: ignore[method-assign]
    timers = {x for x in threading.enumerate() if isinstance(x, threading.Timer)}
    seen, begin = set[threading.Thread](), time.monotonic()
    for k in range(40):
        tab.edit({**MOVE, "to": [0.39, 0.16 + 1e-4 * k]}, final=False)
        last = time.monotonic()
        seen |= {x for x in threading.enumerate() if isinstance(x, threading.Timer)} - timers
        time.sleep(0.01)
    assert not rests and len(seen) < 2 + (last - begin) < 30
    wait_for(lambda: rests)
    assert len(rests) == 1 and rests[0] >= last + 1.0 - 0.01
    session.close()


def test_older_answers_never_come_after_newer_ones(file: Path) -> None:
    session = session_of(file, fast=Held)
    lane = Held.last
    tab = Tab(session)
    tab.edit(MOVE)
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    old, new = lane.works
    for work in (new, old):
        AtOnce.submit(lane, work)
    assert [x.header["seq"] for x in tab.frames if x.kind == "picture"] == [2]
    session.close()


def resting(file: Path) -> tuple[Session, Held, NoLane]:
    """A session at rest at once, whose first plan is held, and its lanes."""
    session = session_of(file, fast=Held, rest=0.0)
    with session.display.lock:
        session.display.show_all()
    return session, Held.last, NoLane.last


def test_exact_figures_wait_for_the_first_plan(file: Path) -> None:
    session, lane, slow = resting(file)
    time.sleep(0.05)
    assert not slow.given
    AtOnce.submit(lane, lane.works[-1])
    wait_for(lambda: slow.given)
    session.close()


def test_exact_figures_wait_for_the_first_plan_of_each_document(file: Path) -> None:
    session, lane, slow = resting(file)
    (old,) = lane.works
    AtOnce.submit(lane, old)
    wait_for(lambda: slow.given)
    slow.deliver(Frame("figures", {"id": slow.given[0][0]}))
    session.open_upload("other.yaml", JOB.replace("small", "other").encode(), None)
    # What comes late of the document before is no plan of this one.
    AtOnce.submit(lane, old)
    time.sleep(0.2)
    assert len(slow.given) == 1
    AtOnce.submit(lane, lane.works[-1])
    wait_for(lambda: len(slow.given) == 2)
    session.close()


def test_nothing_waits_for_a_plan_of_a_document_that_cannot_be_shown(file: Path) -> None:
    before = set(threading.enumerate())
    session, _, _ = resting(file)
    with session.display.lock:
        session.editor.seen = dataclasses.replace(session.editor.seen, handles=None)
        session.display.open()
    wait_for(
        lambda: not any(isinstance(x, threading.Timer) for x in {*threading.enumerate()} - before)
    )
    session.close()


def test_exact_figures_come_when_nothing_moves(file: Path) -> None:
    session = session_of(file, rest=0.0)
    session.begin()
    tab, lane = Tab(session), NoLane.last
    wait_for(lambda: lane.given)
    id, task, request = lane.given[0]
    assert task == "figures" and request["text"] == JOB and request["run"] == "slow"
    tab.say("pin")
    figures = {"id": id, "run": "slow", "duration": 12.5, "rms": 1e-4}
    lane.deliver(Frame("figures", figures))
    assert (
        tab.last("figures")["duration"] == 12.5 and tab.last("figures")["rev"] == session.editor.rev
    )
    tab.say("pin", name="again")
    assert [x["duration"] for x in tab.last("document")["pins"]] == [12.5, 12.5]
    tab.edit(MOVE)
    wait_for(lambda: len(lane.given) == 2)
    late = lane.given[1][0]
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    time.sleep(0.05)
    assert len(lane.given) == 2, "one at a time"
    before = len([x for x in tab.frames if x.kind == "figures"])
    lane.deliver(Frame("figures", {**figures, "id": late}))
    assert len([x for x in tab.frames if x.kind == "figures"]) == before, "out of date"
    wait_for(lambda: len(lane.given) == 3)
    assert lane.given[2][2]["text"] == session.document.text
    session.close()


def test_figures_of_a_drag_that_pauses_are_of_what_is_seen(file: Path) -> None:
    session = session_of(file, rest=0.0)
    session.begin()
    tab, lane = Tab(session), NoLane.last
    wait_for(lambda: lane.given)
    lane.deliver(Frame("figures", {"id": lane.given[0][0]}))
    tab.edit(MOVE, final=False)
    wait_for(lambda: len(lane.given) == 2)
    text = lane.given[1][2]["text"]
    assert session.document.text == JOB != text and "400 mm, 160 mm" in text
    session.close()


def test_another_configuration_of_the_full_run_is_announced(tmp_path: Path) -> None:
    file = tmp_path / "job.yaml"
    file.write_text(SQUARE)
    session = session_of(file, rest=0.0)
    session.begin()
    tab, lane = Tab(session), NoLane.last

    def notices() -> list[str]:
        return [x.header["sentence"] for x in tab.frames if x.kind == "notice"]

    wait_for(lambda: lane.given)
    lane.deliver(Frame("figures", {"id": lane.given[0][0]}))
    for k, turn in enumerate((0.0, np.pi / 2), 1):
        tab.edit({"do": "set", "key": "limits.speed", "value": 0.1 + 0.01 * k}, gesture=k)
        wait_for(
            lambda k=k: len(lane.given) > k and lane.given[-1][2]["text"] == session.document.text
        )
        planned = session.display.screen.planned
        assert planned is not None
        before = planned.start
        after = before + [0, 0, 0, 0, 0, turn]
        assert not notices()
        lane.deliver(Frame("figures", {"id": lane.given[-1][0], "start": after}))
    wait_for(notices)
    session.close()
    (sentence,) = notices()
    assert all(f"{np.degrees(q[5]):.1f}" in sentence for q in (before, after))
