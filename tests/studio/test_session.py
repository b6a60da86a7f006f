"""One document on pages, without a server."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.studio.talking import JOB, MOVE, Tab, kinds, session_of

from armcontour.studio.gestures import MOST_EDITS
from armcontour.studio.session import Session

CSV = b"x [mm],y [mm]\n300,100\n350,120\n300,150\n"
pytestmark = pytest.mark.usefixtures("no_hurry")


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """A session for tests that leave it as it is."""
    place = tmp_path_factory.mktemp("shared") / "job.yaml"
    place.write_text(JOB)
    found = session_of(place)
    found.begin()
    yield found
    found.close()


def test_a_page_that_comes_later_sees_what_the_others_see(tab: Tab) -> None:
    assert kinds(tab.frames) == ["document", "picture", "arm", "executed"]
    document = tab.last("document")
    assert document["name"] == "small" and document["run"] == "slow" and not document["dirty"]
    assert document["text"] == JOB and document["seq"] is None
    assert tab.last("picture")["rev"] == document["rev"]


def test_two_pages_see_the_same_and_do_not_undo_each_other(session: Session, tab: Tab) -> None:
    other = Tab(session)
    tab.edit({**MOVE, "to": [0.4, 0.2]}, gesture=1, final=False)
    assert other.last("picture")["duration"] == tab.last("picture")["duration"]
    assert other.last("picture")["seq"] is None
    other.edit({"do": "remove_waypoint", "index": 2}, gesture=1)
    heard = tab.edit({**MOVE, "to": [0.4, 0.21]}, gesture=1, final=False)
    assert kinds(heard) == ["document", "notice"] and "not made" in heard[1].header["sentence"]
    assert tab.edit({**MOVE, "to": [0.4, 0.22]}, gesture=1) == []
    assert session.document.undo_label == "remove waypoint 3"
    heard = tab.edit({**MOVE, "to": [0.4, 0.22]}, gesture=2)
    assert kinds(heard) == ["document", "picture", "executed"]


def test_a_page_that_goes_away_leaves_no_half_gesture(session: Session, tab: Tab) -> None:
    other = Tab(session)
    whole = tab.last("picture")["duration"]
    other.edit({**MOVE, "to": [0.4, 0.3]}, gesture=1, final=False)
    session.leave(other)
    assert tab.last("picture")["duration"] == whole
    assert other.heard({"op": "undo"}) == []


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"op": None},
        {"op": ["edit"]},
        {"op": "__init__"},
        {"op": "edit"},
        {"op": "edit", "edits": []},
        {"op": "edit", "edits": {"do": "set"}},
        {"op": "edit", "edits": [1]},
        {"op": "edit", "edits": [{}], "final": True},
        {"op": "edit", "edits": [{"do": "text"}], "final": True},
        {"op": "edit", "edits": [{"do": "text", "text": "- 1"}], "final": True},
        {"op": "edit", "edits": [{"do": "text", "text": "a: 1"}], "final": True},
        {"op": "edit", "edits": [{"do": "set", "key": {}, "value": 1}], "final": True},
        {"op": "edit", "edits": [{"do": "set", "key": "name", "value": {}}], "final": True},
        {"op": "edit", "edits": [{"do": "move_waypoint", "index": 99, "to": [0, 0]}]},
        {"op": "edit", "edits": [{"do": "move_waypoint", "index": True, "to": "x"}]},
        {"op": "edit", "edits": [{"do": "move_waypoint", "index": 0, "to": [1e400, 0]}]},
        {"op": "edit", "edits": [{**MOVE, "index": 1.5}], "gesture": [], "rev": "x"},
        {"op": "select"},
        {"op": "select", "run": "none"},
        {"op": "select", "run": {"a": 1}},
        {"op": "undo"},
        {"op": "redo", "seq": "x"},
        {"op": "unpin", "pin": [1]},
        {"op": "swap", "pin": 1},
        {"op": "compare", "with": 1},
        {"op": "compare", "with": {"run": ["fast"]}},
        {"op": "add_run", "name": "../x"},
        {"op": "add_run", "name": "fast"},
        {"op": "add_run", "name": "new", "like": ["fast"]},
        {"op": "remove_run", "name": "none"},
        {"op": "pin_to_run", "pin": None, "name": "x"},
        {"op": "pose", "t": "1", "of": "planned"},
        {"op": "pose", "t": 1, "of": "nothing"},
        {"op": "task", "id": "a", "task": "system"},
        {"op": "task", "id": 1, "task": "check"},
        {"op": "task", "id": "#1", "task": "check"},
        {"op": "task", "id": "a", "task": "check", "options": [1]},
        {"op": "restore_draft"},
    ],
)
def test_what_makes_no_sense_is_answered_with_a_sentence(
    shared: Session, message: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    tab = Tab(shared)
    heard = tab.heard(message)
    assert set(kinds(heard)) & {"failed", "refusal", "notice"}
    assert shared.document.text == JOB and not shared.document.can_undo
    assert "Traceback" not in capsys.readouterr().err
    assert "picture" in kinds(tab.edit(MOVE, gesture=9, final=False))
    shared.leave(tab)


def test_a_drawing_takes_the_place_of_the_path(session: Session, tab: Tab) -> None:
    session.open_upload("part.csv", CSV, None)
    assert tab.last("document")["path"]["kind"] == "file"
    assert "picture" in kinds(tab.frames[-2:]) and not list(session.editor.folder.glob("*.csv"))
    tab.say("undo")
    assert session.document.text == JOB
    (session.editor.folder / "part.csv").write_bytes(CSV)
    session.open_upload("part.csv", CSV, None)
    assert tab.last("document")["path"]["file"] == "part.csv"


def test_a_job_or_a_drawing_in_a_cell_is_another_document(session: Session, tab: Tab) -> None:
    session.open_upload("other.yaml", JOB.replace("small", "other").encode(), None)
    document = tab.last("document")
    assert document["name"] == "other" and document["file"] is None and not document["can_undo"]
    session.open_upload("part.csv", CSV, "pmk3s")
    assert tab.last("document")["name"] == "part"
    assert tab.frames[-1].kind in ("executed", "refusal")
    assert tab.frames[-1].header["rev"] == tab.last("document")["rev"]


def test_pages_know_when_another_job_or_drawing_is_shown(session: Session, tab: Tab) -> None:
    seen = [tab.last("document")["id"]]
    tab.edit(MOVE)
    assert tab.last("document")["id"] == seen[0]
    for name, content in (("line.csv", CSV), ("job.yaml", JOB.encode())):
        session.open_upload(name, content, None)
        assert tab.last("document")["id"] not in seen
        seen.append(tab.last("document")["id"])
    # A page that comes gets the last one only, before the picture of it.
    later = Tab(session)
    assert kinds(later.frames).count("document") == 1
    assert later.last("document")["id"] == seen[-1]


def test_a_file_that_makes_no_job_is_shown_as_text_and_mended(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(JOB.replace("arm: pmk3s", "arm: none"))
    session = session_of(file)
    session.begin()
    tab = Tab(session)
    assert "none" in tab.last("document")["sentence"] and "refusal" in kinds(tab.frames)
    assert kinds(tab.edit(MOVE))[-1] == "refusal"
    heard = tab.edit({"do": "text", "text": JOB}, gesture=1)
    assert kinds(heard) == ["document", "picture", "arm", "executed"]
    assert tab.last("document")["sentence"] is None
    session.close()


@pytest.mark.parametrize(
    "half", [{"op": "pin", "name": "\ud800"}, {"op": "\udfff", "id": "\ud800"}]
)
def test_half_of_a_character_stops_no_page(session: Session, tab: Tab, half: Any) -> None:
    assert kinds(tab.heard(half)) == ["failed"]
    later = Tab(session)
    assert later.last("document") == tab.last("document")
    assert later.last("document")["pins"] == []


def test_a_message_has_a_bounded_number_of_edits(tab: Tab) -> None:
    before = tab.last("document")["text"]
    assert tab.edit(*[MOVE] * (MOST_EDITS + 1))[-1].kind in ("refusal", "executed")
    assert tab.last("refusal")["error"] == "InvalidInput"
    assert tab.last("document")["text"] == before
    tab.edit(*[MOVE] * MOST_EDITS, gesture=1)
    assert tab.last("document")["text"] != before
