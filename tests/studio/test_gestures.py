"""Edits that are shown while a gesture goes on, and made at its end."""

from __future__ import annotations

import pytest
from tests.studio.talking import JOB, MOVE, Tab, kinds

from armcontour.studio.session import Session

pytestmark = pytest.mark.usefixtures("no_hurry")


def test_a_drag_is_seen_at_every_move_and_is_one_step_of_undo(session: Session, tab: Tab) -> None:
    durations = []
    for k in range(5):
        heard = tab.edit({**MOVE, "to": [0.4, 0.15 + 0.01 * k]}, gesture=7, final=False)
        assert kinds(heard) == ["picture", "executed"]
        assert {x.header["seq"] for x in heard} == {tab.seq}
        durations.append(heard[0].header["duration"])
    assert len(set(durations)) == 5
    assert session.document.text == JOB
    heard = tab.edit({**MOVE, "to": [0.4, 0.19]}, gesture=7)
    assert kinds(heard) == ["document", "picture", "executed"]
    assert heard[1].header["duration"] == pytest.approx(durations[-1], rel=1e-3)
    assert tab.last("document")["undo_label"] == "move waypoint 2"
    changed = session.document.text
    assert changed.replace("400 mm, 190 mm", "410 mm, 150 mm") == JOB and "# from" in changed
    tab.say("undo")
    assert session.document.text == JOB and not tab.last("document")["can_undo"]
    tab.say("redo")
    assert session.document.text == changed


def test_a_gesture_that_is_given_up_leaves_nothing(session: Session, tab: Tab) -> None:
    whole = tab.last("picture")["duration"]
    tab.edit({**MOVE, "to": [0.4, 0.3]}, gesture=1, final=False)
    assert tab.last("picture")["duration"] != whole
    assert kinds(tab.say("cancel_gesture")) == ["picture", "executed"]
    assert tab.last("picture")["duration"] == whole
    assert session.document.text == JOB and not session.document.can_undo


def test_what_cannot_be_made_is_refused_and_the_document_stays(session: Session, tab: Tab) -> None:
    speed = {"do": "set", "key": "limits.speed", "value": "0 m/s"}
    heard = tab.edit(speed, final=False)
    assert kinds(heard) == ["refusal"] and "limits.speed" in heard[0].header["sentence"]
    heard = tab.edit(speed, gesture=1)
    assert kinds(heard) == ["document", "picture", "executed", "refusal"]
    assert heard[-1].header["dropped"] and heard[-1].header["seq"] == tab.seq
    assert session.document.text == JOB and not session.document.can_undo


def test_what_cannot_be_reached_is_a_state_and_says_where(session: Session, tab: Tab) -> None:
    heard = tab.edit({**MOVE, "to": [2.0, 0.15]})
    assert kinds(heard) == ["document", "refusal"]
    refusal = heard[1].header
    assert refusal["error"] == "Unreachable" and refusal["exit"] == 3 and "uv" in refusal["at"]
    assert session.document.can_undo
    assert kinds(tab.say("undo")) == ["document", "picture", "executed"]


def test_several_edits_of_a_message_see_one_another(tab: Tab) -> None:
    insert = {"do": "insert_waypoint", "index": 1, "at": [0.38, 0.12]}
    tab.edit(insert, {"do": "move_waypoint", "index": 1, "to": [0.39, 0.12]})
    document = tab.last("document")
    assert [x["written"][0] for x in document["waypoints"]] == [
        "350 mm",
        "390 mm",
        "410 mm",
        "280 mm",
    ]
    assert document["undo_label"] == "insert waypoint 2 and 1 more"


def test_an_edit_of_an_older_document_is_not_made(session: Session, tab: Tab) -> None:
    old = tab.last("document")["rev"]
    tab.edit(MOVE)
    text = session.document.text
    heard = tab.edit({**MOVE, "to": [0.3, 0.1]}, gesture=2, rev=old)
    assert kinds(heard) == ["document", "notice"]
    assert session.document.text == text
