"""What a page may say, besides edits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.studio.talking import JOB, MOVE, NoLane, Tab, kinds, session_of

from armcontour.studio.opening import open_session
from armcontour.studio.session import Session
from armcontour.studio.wire import Frame

pytestmark = pytest.mark.usefixtures("no_hurry")


def test_the_run_that_is_shown(tab: Tab) -> None:
    slow = tab.last("picture")["duration"]
    heard = tab.say("select", run="fast")
    assert kinds(heard) == ["document", "picture", "executed"]
    assert tab.last("picture")["run"] == "fast" and tab.last("picture")["duration"] < slow
    assert tab.last("document")["run"] == "fast"


def test_runs_are_added_and_removed(session: Session, tab: Tab) -> None:
    tab.say("add_run", name="slower", like="slow")
    assert [x["name"] for x in tab.last("document")["runs"]] == ["slow", "fast", "slower"]
    assert session.document.data["runs"]["slower"] == {"limits": {"speed": "50 mm/s"}}
    tab.say("select", run="slower")
    tab.say("remove_run", name="slower")
    assert tab.last("document")["run"] == "slow" and session.document.text == JOB
    tab.say("remove_run", name="slow")
    assert "only run" in tab.say("remove_run", name="fast")[0].header["sentence"]


def test_a_pin_is_compared_and_swapped(session: Session, tab: Tab) -> None:
    tab.say("pin", name="before")
    (pin,) = tab.last("document")["pins"]
    before = tab.last("picture")["duration"]
    assert pin["name"] == "before" and pin["duration"] == before and pin["max"] > pin["rms"] > 0
    tab.edit({"do": "set", "key": "limits.speed", "value": "60 mm/s"})
    changed, after = session.document.text, tab.last("picture")["duration"]
    heard = tab.say("compare", **{"with": {"pin": pin["pin"]}})
    assert [(x.kind, x.header.get("of")) for x in heard] == [
        ("document", None),
        ("picture", "live"),
        ("executed", "live"),
        ("picture", "compare"),
        ("executed", "compare"),
    ]
    assert heard[3].header["duration"] == before and heard[1].header["duration"] == after
    tab.say("swap", pin=pin["pin"])
    assert session.document.text == JOB
    assert tab.last("document")["pins"][0]["duration"] == after
    tab.say("undo")
    assert session.document.text == changed
    tab.say("unpin", pin=pin["pin"])
    assert tab.last("document")["pins"] == [] and tab.last("document")["compare"] is None


def test_a_run_is_compared_while_the_path_moves(tab: Tab) -> None:
    tab.say("compare", **{"with": {"run": "fast"}})
    heard = tab.edit({**MOVE, "to": [0.4, 0.2]}, final=False)
    assert [x.header["run"] for x in heard] == ["slow", "slow", "fast", "fast"]
    tab.say("cancel_gesture")
    heard = tab.say("remove_run", name="fast")
    assert tab.last("document")["compare"] is None
    assert kinds(heard) == ["document", "picture", "executed"]


def test_a_pin_becomes_a_run_if_runs_can_differ_so(session: Session, tab: Tab) -> None:
    tab.edit({"do": "set", "key": "corners.tolerance", "value": "2 mm"})
    tab.edit({"do": "set", "key": "limits.joint_acceleration", "value": "0.5 rad/s^2"}, gesture=1)
    tab.say("pin")
    pinned = tab.last("picture")["duration"]
    tab.say("undo")
    tab.say("undo")
    tab.say("pin_to_run", pin=1, name="careful")
    assert session.document.data["runs"]["careful"] == {
        "limits": {"speed": "50 mm/s", "joint_acceleration": "0.5 rad/s^2"},
        "corners": {"tolerance": "2 mm"},
    }
    tab.say("select", run="careful")
    assert tab.last("picture")["duration"] == pytest.approx(pinned, rel=1e-12)
    tab.edit(MOVE, gesture=2)
    told = tab.say("pin_to_run", pin=1, name="other")[0].header["sentence"]
    assert "differs in path" in told


def test_saving_and_what_others_have_changed(session: Session, tab: Tab, file: Path) -> None:
    tab.edit(MOVE)
    assert "-  points" in tab.say("diff")[0].header["text"]
    assert kinds(tab.say("save")) == ["saved", "document"]
    assert file.read_text() == session.document.text and not tab.last("document")["dirty"]
    file.write_text(f"{JOB}# by another program\n")
    session.look()
    assert tab.last("document")["on_disk"] == "changed"
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    (heard,) = tab.say("save")
    assert heard.kind == "conflict" and "-# by another program" in heard.header["diff"]
    assert file.read_text().endswith("# by another program\n")
    tab.say("reload")
    assert session.document.text.endswith("# by another program\n")
    tab.say("undo")
    tab.say("save", force=True)
    assert file.read_text() == session.document.text
    tab.edit({**MOVE, "to": [0.38, 0.16]}, gesture=2)
    tab.say("revert")
    assert session.document.text == file.read_text() and session.document.can_undo


def test_a_job_without_a_file_is_a_download(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    session = open_session(None, slow=NoLane)
    tab = Tab(session)
    try:
        session.begin()
        assert tab.last("document")["run"] == "optimal"
        (heard,) = tab.say("save")
        file = session.display.tabs.files[heard.header["file"]]
        assert heard.header["name"] == file.name == "paper.yaml"
        assert file.data.decode() == session.document.text
    finally:
        session.close()
    assert list(tmp_path.iterdir()) == []


def test_a_draft_is_offered_and_taken(session: Session, tab: Tab, file: Path) -> None:
    tab.edit(MOVE)
    changed = session.document.text
    assert "draft" in str(session.unsaved())
    session.close()
    again = session_of(file)
    other = Tab(again)
    again.begin()
    assert other.last("document")["draft"] and again.document.text == JOB
    other.say("restore_draft")
    assert again.document.text == changed and not other.last("document")["draft"]
    other.say("undo")
    assert again.document.text == JOB
    assert again.unsaved() is None
    again.close()
    assert [x.name for x in file.parent.iterdir()] == ["job.yaml"]


def test_tasks_run_are_cancelled_and_give_files(session: Session, tab: Tab) -> None:
    tab.say("task", id="t1", task="report", options={"all": True})
    lane = NoLane.last
    ((id, task, request),) = lane.given
    assert (id, task, request["options"]) == ("t1", "report", {"all": True})
    assert "running already" in tab.say("task", id="t1", task="check")[0].header["sentence"]
    tab.say("cancel", id="t1")
    assert lane.cancelled == ["t1"] and tab.say("cancel", id="t2") == []
    lane.deliver(Frame("progress", {"id": "t1", "share": 0.5}))
    header = {"id": "t1", "name": "a.html", "type": "text/html"}
    lane.deliver(Frame("result", header, {"content": np.frombuffer(b"<html>", np.uint8)}))
    told = tab.last("result")
    assert (
        session.display.tabs.files[told["file"]].data == b"<html>"
        and tab.last("progress")["share"] == 0.5
    )
    tab.say("task", id="t1", task="check")
    assert len(lane.given) == 2


def test_poses(tab: Tab) -> None:
    duration = tab.last("picture")["duration"]
    ends = [tab.say("pose", t=t, of="planned")[0].header["q"] for t in (-1, 0, duration, 1e9)]
    assert ends[0] == ends[1] and ends[2] == ends[3] != ends[0]
    executed = tab.say("pose", t=0.5 * duration, of="executed")[0].header["q"]
    planned = tab.say("pose", t=0.5 * duration, of="planned")[0].header["q"]
    assert np.allclose(executed, planned, atol=0.05) and executed != planned
