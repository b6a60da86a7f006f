"""One document on pages, without a server."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.studio.serving import JOB, NoLane

from armcontour.errors import InvalidInput
from armcontour.studio import screen
from armcontour.studio.document import Document
from armcontour.studio.opening import open_session
from armcontour.studio.preview import Previewer
from armcontour.studio.session import Session, refuse_new_xacro
from armcontour.studio.wire import Frame

NEVER = 1e6
MOVE = {"do": "move_waypoint", "index": 1, "to": [0.4, 0.16]}


class AtOnce:
    """A fast lane that works where it is asked to."""

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        self.deliver = deliver

    def submit(self, work: Any) -> None:
        for frame in work(lambda: False):
            self.deliver(frame)

    def close(self) -> None:
        pass


class Held(AtOnce):
    """A fast lane that does nothing until it is told to; the last one can be looked at."""

    last: Held

    def __init__(self, deliver: Callable[[Frame], None]) -> None:
        super().__init__(deliver)
        Held.last = self
        self.works: list[Any] = []

    def submit(self, work: Any) -> None:
        self.works.append(work)


class Tab:
    """A page that keeps what it hears."""

    def __init__(self, session: Session) -> None:
        self.session, self.seq = session, 0
        self.frames: list[Frame] = []
        session.join(self)

    def send(self, data: bytes, replaces: str | None = None) -> None:
        self.frames.append(Frame.unpack(data))

    def say(self, op: str, **more: Any) -> list[Frame]:
        """Send a message; returns what is heard then."""
        self.seq += 1
        return self.heard({"op": op, "seq": self.seq, **more})

    def heard(self, message: Any) -> list[Frame]:
        before = len(self.frames)
        self.session.receive(self, message)
        return self.frames[before:]

    def edit(self, *edits: Any, gesture: int = 0, final: bool = True, **more: Any) -> list[Frame]:
        return self.say("edit", gesture=gesture, final=final, edits=list(edits), **more)

    def last(self, kind: str) -> dict[str, Any]:
        return next(dict(x.header) for x in reversed(self.frames) if x.kind == kind)


def kinds(frames: list[Frame]) -> list[str]:
    return [x.kind for x in frames]


def session_of(file: Path, fast: Any = AtOnce, rest: float = NEVER) -> Session:
    document = Document.open(file)
    assert document.folder is not None
    return Session(document, Previewer(document.folder), fast=fast, slow=NoLane, rest=rest)


@pytest.fixture(autouse=True)
def no_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plans are quick however busy the machine is."""
    monkeypatch.setattr(screen, "QUICK", NEVER)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    place = tmp_path / "job.yaml"
    place.write_text(JOB)
    return place


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    """A session for tests that leave it as it is."""
    place = tmp_path_factory.mktemp("shared") / "job.yaml"
    place.write_text(JOB)
    found = session_of(place)
    found.begin()
    yield found
    found.close()


@pytest.fixture
def session(file: Path) -> Iterator[Session]:
    found = session_of(file)
    found.begin()
    yield found
    found.close()


@pytest.fixture
def tab(session: Session) -> Tab:
    return Tab(session)


def test_a_page_that_comes_later_sees_what_the_others_see(tab: Tab) -> None:
    assert kinds(tab.frames) == ["document", "arm", "picture", "executed"]
    document = tab.last("document")
    assert document["name"] == "small" and document["run"] == "slow" and not document["dirty"]
    assert document["text"] == JOB and document["seq"] is None
    assert tab.last("picture")["rev"] == document["rev"]


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


def test_a_slow_plan_is_executed_when_nothing_moves(
    session: Session, tab: Tab, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(screen, "QUICK", 0.0)
    assert kinds(tab.edit(MOVE)) == ["document", "picture"]
    before = len(tab.frames)
    session.screen.rest()
    session.screen.rest()
    assert kinds(tab.frames[before:]) == ["executed"]


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
    assert pin["name"] == "before" and pin["duration"] == before and pin["rms"] > 0
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
        file = session.files[heard.header["file"]]
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


CSV = b"x [mm],y [mm]\n300,100\n350,120\n300,150\n"


def test_a_drawing_takes_the_place_of_the_path(session: Session, tab: Tab) -> None:
    session.open_upload("part.csv", CSV, None)
    assert tab.last("document")["path"]["kind"] == "file"
    assert "picture" in kinds(tab.frames[-2:]) and not list(session.folder.glob("*.csv"))
    tab.say("undo")
    assert session.document.text == JOB
    (session.folder / "part.csv").write_bytes(CSV)
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


def wait_for(found: Callable[[], Any]) -> None:
    """Wait until something holds."""
    end = time.monotonic() + 20
    while not found():
        assert time.monotonic() < end
        time.sleep(0.002)


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
    assert tab.last("figures")["duration"] == 12.5 and tab.last("figures")["rev"] == session.rev
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
    assert session.files[told["file"]].data == b"<html>" and tab.last("progress")["share"] == 0.5
    tab.say("task", id="t1", task="check")
    assert len(lane.given) == 2


def test_poses(tab: Tab) -> None:
    duration = tab.last("picture")["duration"]
    ends = [tab.say("pose", t=t, of="planned")[0].header["q"] for t in (-1, 0, duration, 1e9)]
    assert ends[0] == ends[1] and ends[2] == ends[3] != ends[0]
    executed = tab.say("pose", t=0.5 * duration, of="executed")[0].header["q"]
    planned = tab.say("pose", t=0.5 * duration, of="planned")[0].header["q"]
    assert np.allclose(executed, planned, atol=0.05) and executed != planned


def test_a_file_that_makes_no_job_is_shown_as_text_and_mended(tmp_path: Path) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(JOB.replace("arm: pmk3s", "arm: none"))
    session = session_of(file)
    session.begin()
    tab = Tab(session)
    assert "none" in tab.last("document")["sentence"] and "refusal" in kinds(tab.frames)
    assert kinds(tab.edit(MOVE))[-1] == "refusal"
    heard = tab.edit({"do": "text", "text": JOB}, gesture=1)
    assert kinds(heard) == ["document", "arm", "picture", "executed"]
    assert tab.last("document")["sentence"] is None
    session.close()


@pytest.mark.parametrize("arm", ["b.xacro", "b.yaml", "B.XACRO", {"file": "sub/a.xacro"}])
def test_programs_that_the_user_has_not_named_are_refused(tmp_path: Path, arm: Any) -> None:
    with pytest.raises(InvalidInput, match="--trust-xacro"):
        refuse_new_xacro({"arm": arm}, tmp_path, [tmp_path / "a.xacro"])


@pytest.mark.parametrize("arm", ["a.xacro", "./a.xacro", {"file": "a.xacro"}, "ur5e", "b.urdf"])
def test_programs_that_the_user_has_named_are_not(tmp_path: Path, arm: Any) -> None:
    refuse_new_xacro({"arm": arm}, tmp_path, [tmp_path / "a.xacro"])


def test_without_any_trust_an_arm_file_is_read_as_elsewhere(tmp_path: Path) -> None:
    refuse_new_xacro({"arm": "b.yaml"}, tmp_path, [])
    with pytest.raises(InvalidInput, match="is a program"):
        refuse_new_xacro({"arm": "a.xacro"}, tmp_path, [])
