"""A session: pages, their messages, gestures, and undo."""

from itertools import pairwise

import numpy as np
import pytest
from tests.studio.session_pages import (
    JOB,
    MOVE,
    RecordingTaskWorker,
    RestingWorker,
    SessionPage,
    figure,
    kinds,
    session_of,
)
from tools.studio_page import write_shapes

import armcontour as ac
from armcontour.files.job_file import drawing_text
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.connection import open_session
from armcontour.studio.document import Document
from armcontour.studio.pages import without_options
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.scheduler import SchedulerOptions
from armcontour.studio.session import Session
from armcontour.studio.tasks import dispatch

CSV = b"x [mm],y [mm]\n300,100\n350,120\n300,150\n"
pytestmark = pytest.mark.usefixtures("no_hurry")


def test_two_pages_show_the_same_and_do_not_undo_each_other(session, tab):
    other = SessionPage(session)
    whole = figure(tab.last("picture"), "duration")
    tab.edit({**MOVE, "to": [0.4, 0.2]}, gesture=1, final=False)
    assert figure(other.last("picture"), "duration") == figure(tab.last("picture"), "duration")
    assert other.last("picture")["seq"] is None
    other.edit({"do": "remove_waypoint", "index": 2}, gesture=1)
    assert tab.edit({**MOVE, "to": [0.4, 0.21]}, gesture=1, final=False) == []
    # The final message of a discarded gesture is answered, because the page waits for it.
    frames = tab.edit({**MOVE, "to": [0.4, 0.22]}, gesture=1)
    assert kinds(frames) == ["document", "notice"] and "discarded" in frames[1].header["sentence"]
    assert session.editor.document.undo_label == "remove waypoint 3"
    frames = tab.edit({**MOVE, "to": [0.4, 0.22]}, gesture=2)
    assert kinds(frames) == ["document", "picture", "executed"]
    # A page that goes away leaves no half of a gesture.
    tab.say("undo")
    tab.say("undo")
    other.edit({**MOVE, "to": [0.4, 0.3]}, gesture=3, final=False)
    assert figure(tab.last("picture"), "duration") != whole
    session.leave(other)
    assert figure(tab.last("picture"), "duration") == whole
    assert other.heard({"op": "undo"}) == []


MOVED = {"do": "move_waypoint", "index": 0}
EDITS = (
    *(None, [], {"do": "set"}, [1], [{}], [{"do": "text"}], [{"do": "text", "text": "- 1"}]),
    [{"do": "text", "text": "a: 1"}],
    [{"do": "set", "key": {}, "value": 1}],
    [{"do": "set", "key": "name", "value": {}}],
    *([{"do": "set", "key": x, "value": 1}] for x in (["a"] * 5000, "a." * 5000 + "a", "9" * 5000)),
    [{**MOVED, "index": 99, "to": [0, 0]}],
    [{**MOVED, "index": True, "to": "x"}],
    [{**MOVED, "to": [1e400, 0]}],
)
NONSENSE = (
    *({}, {"op": None}, {"op": ["edit"]}, {"op": "__init__"}, {"op": "edit"}),
    *({"op": "edit", "edits": x, "final": True} for x in EDITS),
    *({"op": "edit", "edits": x} for x in EDITS[-3:]),
    {"op": "edit", "edits": [{**MOVE, "index": 1.5}], "gesture": [], "rev": "x"},
    *({"op": "select"}, {"op": "select", "run": "none"}, {"op": "select", "run": {"a": 1}}),
    *({"op": "undo"}, {"op": "redo", "seq": "x"}, {"op": "pin"}, {"op": "compare", "with": None}),
    {"op": "edit", "edits": [{"do": "add_run", "name": "../x"}], "final": True},
    *({"op": "task", "id": "a", "task": "system"}, {"op": "task", "id": 1, "task": "report"}),
    {"op": "task", "id": "#1", "task": "report"},
    {"op": "task", "id": "a", "task": "report", "options": [1]},
    {"op": "restore_draft"},
    *({"op": "show_certified"}, {"op": "show_certified", "id": "none"}),
    {"op": "task", "id": "a", "task": "export", "options": {"certificate": [1]}},
    # Half of a character (a lone surrogate), which no frame could hold.
    *({"op": "select", "run": "\ud800"}, {"op": "\udfff", "id": "\ud800"}),
)


def test_invalid_messages_are_answered_with_a_sentence(session, capsys):
    for message in NONSENSE:
        tab = SessionPage(session)
        frames = tab.heard(message)
        assert set(kinds(frames)) & {"failed", "refusal", "notice"}, message
        document = session.editor.document
        assert document.text == JOB and not document.undo_label, message
        assert "Traceback" not in capsys.readouterr().err, message
        assert "picture" in kinds(tab.edit(MOVE, gesture=9, final=False)), message
        session.leave(tab)


def test_an_uploaded_drawing_or_job_replaces_the_document(session, tab):
    session.open_upload("part.csv", CSV, None)
    assert tab.last("document")["path"]["kind"] == "file"
    assert "picture" in kinds(tab.frames[-3:]) and not list(session.editor.folder.glob("*.csv"))
    tab.say("undo")
    assert session.editor.document.text == JOB
    (session.editor.folder / "part.csv").write_bytes(CSV)
    session.open_upload("part.csv", CSV, None)
    assert tab.last("document")["path"]["file"] == "part.csv"
    session.open_upload("other.yaml", JOB.replace("small", "other").encode(), None)
    document = tab.last("document")
    assert document["name"] == "other" and document["file"] is None and not document["undo_label"]
    session.open_upload("part.csv", CSV, "pmk3s")
    assert tab.last("document")["name"] == "part"
    assert tab.frames[-1].kind in ("executed", "refusal")
    assert tab.frames[-1].header["rev"] == tab.last("document")["rev"]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("tolerance: 5 mm", "tolerance: -5 mm"),
        ("speed: 0.15 m/s", "speed: 0 m/s"),
        ("servo: {kp: 25 1/s, kv: 150 1/s}\n", ""),
        ("fast: {}", "fast: {velocity: 1}"),
        ("[410 mm, 150 mm]", "[2 m, 150 mm]"),
    ],
)
def test_a_job_that_is_refused_from_the_start_is_drawn(file, old, new):
    file.write_text(JOB.replace(old, new))
    session = session_of(file)
    early = SessionPage(session)
    session.begin()
    for page in (early, SessionPage(session)):
        *_, picture = (x for x in page.frames if x.kind == "picture")
        assert picture.header["tier"] == "outline" and len(picture.arrays["objective"]) == 3
        assert page.last("refusal")["tier"] == 1
    early.edit({"do": "text", "text": JOB})
    assert early.last("picture")["tier"] == "preview"
    session.close()


PIERCE = "process: {switch: {name: a}, lead_in: {length: 5 mm}, "


@pytest.mark.parametrize(
    ("old", "new", "steps"),
    [
        ("servo:", "process: {tabs: {width: 1 mm}}\nservo:", [2, 1]),
        ("servo:", "process: {lead_in: {length: 5 mm}, pierce: {time: 0.1 s}}\nservo:", [1]),
        ("servo:", PIERCE + "pierce: {time: 0.1 s}}\nservo:", [2]),
        ("servo:", PIERCE + "by_layer: {a: {pierce: {time: 0.1 s}}}}\nservo:", [2]),
        ("servo:", "process: {direction: climb, kerf_side: right}\nservo:", [2]),
        ("tolerance: 5 mm", "shape: free", [1]),
        ("tolerance: 5 mm", "shape: arc", [1]),
        ("tolerance: 5 mm", "shape: free, speed: 10 mm/s", [2, 1]),
        ("tolerance: 5 mm}", "shape: free, tolerance: 5 mm, continuity: tangent}", [2]),
        ("fast: {}", "fast: {timing: {method: paper}, duration: 9 s}", [2]),
        ("fast: {}", "fast: {timing: {method: paper}, corners: {shape: free}}", [1, 1]),
    ],
)
def test_each_offered_change_leads_to_a_plan_or_the_next_refusal(file, old, new, steps):
    file.write_text(JOB.replace(old, new))

    def try_all(taken, counts):
        session = session_of(file)
        tab = SessionPage(session)
        session.begin()
        for edits in taken:
            tab.edit(*edits)
        planned = tab.last("picture")["tier"] == "preview" and tab.frames[-1].kind == "executed"
        remedies = [] if planned else tab.last("refusal")["remedies"]
        assert planned or len(remedies) == counts[0]
        for edits in remedies:
            try_all([*taken, edits], counts[1:])
        session.close()

    try_all([], steps)


def test_a_drawing_out_of_reach_that_replaces_another_is_shown_with_the_arm(session, tab):
    before = len(tab.frames)
    session.open_upload("far.csv", CSV.replace(b"300,", b"3000,"), None)
    frames = tab.frames[before:]
    assert {"document", "arm", "picture", "refusal"} <= set(kinds(frames))
    (outline,) = (x for x in frames if x.kind == "picture")
    assert outline.header["tier"] == "outline" and len(outline.header["contours"]) == 1
    assert tab.last("refusal")["at"]["uv"]


def test_page_opened_after_refusal_shows_outline_and_refusal(session, tab):
    tab.edit({**MOVE, "to": [2.0, 0.15]})
    late = SessionPage(session)
    assert late.last("picture")["tier"] == "outline"
    *_, refusal = (x for x in late.frames if x.kind == "refusal")
    assert len(refusal.arrays["objective"]) == 3 and refusal.header["at"]["uv"]


@pytest.fixture
def many(tmp_path):
    """A session of a drawing with 120 contours, its page, and the worker of its figures."""
    file = write_shapes(tmp_path / "shapes.dxf", 120, 12, 8.0, 2.5)
    document = Document.of_drawing(file, "ur5e")
    previewer = CoarsePlanner(document.folder)
    options = SchedulerOptions(RestingWorker, RecordingTaskWorker, 0.0)
    session = Session(document, previewer, scheduling=options)
    tab = SessionPage(session)
    session.begin()
    yield session, tab, RecordingTaskWorker.last
    session.close()


def compute(lane):
    """The task process does what was requested last; returns the name of the task."""
    id, task, request = lane.given[-1]
    frame = dispatch.do(task, request, lambda step: None)
    lane.deliver(frame.stamped(id=id, task=task))
    return task


def test_many_contours_are_drawn_at_once_and_planned_by_the_task_process(many):
    session, tab, lane = many
    drawing = tab.last("picture")
    assert drawing["tier"] == "outline" and len(drawing["contours"]) == 120
    assert "executed" not in kinds(tab.frames) and session.scheduler.planned is None
    assert tab.last("arm")
    tasks = [compute(lane) for _ in range(3)]
    assert tasks == ["picture", "figures", "executed"] == [x[1] for x in lane.given]
    assert kinds(tab.frames)[-4:] == ["picture", "figures", "progress", "executed"]
    # The plan of the picture is that of the figures, and the page keeps the picture.
    durations = [figure(tab.last(x), "duration") for x in ("picture", "figures")]
    assert durations[0] == durations[1] > 0
    times = [x["t"] for x in tab.last("picture")["contours"]]
    assert len(times) == 120 and all(before[1] <= after[0] for before, after in pairwise(times))


def test_an_edit_of_one_of_many_contours_stops_the_work_on_the_state_before(many):
    _, tab, lane = many
    compute(lane)
    duration = figure(tab.last("picture"), "duration")
    name = tab.last("picture")["contours"][4]["name"]
    change = {"do": "set", "key": ["path", "contours", name, "speed"], "value": "1 mm/s"}
    running = lane.given[-1]
    assert running[1] == "figures"
    tab.edit(change)
    assert lane.stopped == [running[0]] and len(lane.given) == 2
    lane.deliver(MessageFrame("cancelled", {"id": running[0]}))
    assert compute(lane) == "picture"
    # The speed of the other contours is that of the job.
    assert figure(tab.last("picture"), "duration") > duration
    assert tab.last("picture")["seq"] == tab.seq and lane.given[-1][1] == "figures"
    # Frames of the state before are not sent any more.
    before = kinds(tab.frames).count("figures")
    lane.deliver(MessageFrame("figures", {"id": running[0]}))
    assert kinds(tab.frames).count("figures") == before


def test_an_undo_continues_what_was_known_of_the_state_before(many):
    session, tab, lane = many
    compute(lane)
    duration = figure(tab.last("picture"), "duration")
    tab.edit({"do": "set", "key": "limits.speed", "value": "10 mm/s"})
    lane.deliver(MessageFrame("cancelled", {"id": lane.given[-1][0]}))
    assert [x[1] for x in lane.given] == ["picture", "figures", "picture"]
    tab.say("undo")
    # The picture is known; its figures follow when the obsolete task has stopped.
    assert figure(tab.last("picture"), "duration") == duration
    assert lane.stopped == [x[0] for x in lane.given[1:]]
    lane.deliver(MessageFrame("cancelled", {"id": lane.given[-1][0]}))
    assert lane.given[-1][1] == "figures" and len(lane.given) == 4
    SessionPage(session)
    assert len(lane.given) == 4 and len(lane.stopped) == 2
    compute(lane)
    assert figure(tab.last("figures"), "duration") == duration


def test_many_contours_out_of_reach_are_refused_with_the_outline(many):
    _, tab, lane = many
    tab.edit({"do": "set", "key": ["path", "frame", "position"], "value": [9.0, 0.0, 0.0]})
    lane.deliver(MessageFrame("cancelled", {"id": lane.given[-1][0]}))
    assert compute(lane) == "picture"
    refusal = next(x for x in reversed(tab.frames) if x.kind == "refusal")
    assert refusal.header["error"] == "Unreachable" and refusal.header["tier"] == 1
    assert len(refusal.arrays["objective_breaks"]) == 121
    assert lane.given[-1][1] == "picture", "a refused plan has no figures"


def test_another_page_gets_what_is_known_of_many_contours(many):
    session, _, lane = many
    compute(lane)
    count = len(lane.given)
    late = SessionPage(session)
    assert late.last("picture")["tier"] == "preview"
    assert len(lane.given) == count and not lane.stopped
    compute(lane)
    assert figure(late.last("figures"), "duration") > 0


def test_files_are_read_again_by_the_task_process(tmp_path):
    drawing = write_shapes(tmp_path / "shapes.dxf", 3, 12, 8.0, 2.5)
    job_file = tmp_path / "job.yaml"
    job_file.write_text(drawing_text("ur5e", drawing, tmp_path))
    session = session_of(job_file, RestingWorker, rest=0.0)
    lane = RecordingTaskWorker.last
    tab = SessionPage(session)
    session.begin()
    for count in (3, 2):
        write_shapes(drawing, count, 12, 8.0, 2.5)
        tab.say("reload")
        lane.deliver(MessageFrame("cancelled", {"id": lane.given[-1][0]}))
        assert compute(lane) == "figures"
        (expected,) = ac.run(ac.read_job(job_file)).runs.values()
        assert figure(tab.last("figures"), "duration") == expected.trajectory.duration
    session.close()


def test_an_invalid_job_is_shown_as_text_and_can_be_corrected(file):
    file.write_text(JOB.replace("arm: pmk3s", "arm: none"))
    session = session_of(file)
    session.begin()
    tab = SessionPage(session)
    assert "none" in tab.last("document")["sentence"] and "refusal" in kinds(tab.frames)
    assert kinds(tab.edit(MOVE))[-1] == "refusal"
    frames = tab.edit({"do": "text", "text": JOB}, gesture=1)
    assert kinds(frames) == ["document", "picture", "arm", "executed"]
    assert tab.last("document")["sentence"] is None
    session.close()


WHOLE = ["document", "picture", "executed"]


def test_a_drag_is_previewed_at_every_move_and_is_one_step_of_undo(session, tab):
    durations = []
    for k in range(5):
        frames = tab.edit({**MOVE, "to": [0.4, 0.15 + 0.01 * k]}, gesture=7, final=False)
        assert kinds(frames) == ["picture", "executed"]
        assert {x.header["seq"] for x in frames} == {tab.seq}
        durations.append(figure(frames[0].header, "duration"))
    assert len(set(durations)) == 5
    assert session.editor.document.text == JOB
    frames = tab.edit({**MOVE, "to": [0.4, 0.19]}, gesture=7)
    assert kinds(frames) == WHOLE
    assert figure(frames[1].header, "duration") == pytest.approx(durations[-1], rel=1e-3)
    assert tab.last("document")["undo_label"] == "move waypoint 2"
    changed = session.editor.document.text
    assert changed.replace("400 mm, 190 mm", "410 mm, 150 mm") == JOB and "# from" in changed
    tab.say("undo")
    assert session.editor.document.text == JOB and not tab.last("document")["undo_label"]
    tab.say("redo")
    assert session.editor.document.text == changed
    whole = figure(tab.last("picture"), "duration")
    tab.edit({**MOVE, "to": [0.4, 0.3]}, gesture=1, final=False)
    assert figure(tab.last("picture"), "duration") != whole
    assert kinds(tab.say("cancel_gesture")) == ["picture", "executed"]
    assert figure(tab.last("picture"), "duration") == whole
    assert session.editor.document.text == changed
    tab.say("undo")
    assert session.editor.document.text == JOB and not session.editor.document.undo_label


def test_edits_of_a_message_apply_in_order(session, tab):
    insert = {"do": "insert_waypoint", "index": 1, "at": [0.38, 0.12]}
    tab.edit(insert, {"do": "move_waypoint", "index": 1, "to": [0.39, 0.12]})
    document = tab.last("document")
    written = [x["written"][0] for x in document["waypoints"]]
    assert written == ["350 mm", "390 mm", "410 mm", "280 mm"]
    assert document["undo_label"] == "insert waypoint 2 and 1 more"


def sentence(frames):
    return frames[0].header["sentence"]


def test_runs_are_shown_added_and_removed(session, tab):
    slow = figure(tab.last("picture"), "duration")
    assert kinds(tab.say("select", run="fast")) == ["document", "picture", "executed"]
    assert tab.last("picture")["run"] == "fast" and figure(tab.last("picture"), "duration") < slow
    assert tab.last("document")["run"] == "fast"
    tab.say("select", run="slow")
    tab.edit({"do": "add_run", "name": "slower"})
    assert [x["name"] for x in tab.last("document")["runs"]] == ["slow", "fast", "slower"]
    assert session.editor.document.data["runs"]["slower"] == {"limits": {"speed": "50 mm/s"}}
    tab.say("select", run="slower")
    tab.edit({"do": "unset", "key": ["runs", "slower"]}, gesture=1)
    assert tab.last("document")["run"] == "slow" and session.editor.document.text == JOB
    tab.edit({"do": "unset", "key": ["runs", "slow"]}, gesture=2)
    assert tab.last("document")["run"] == "fast"
    tab.edit({"do": "unset", "key": ["runs", "fast"]}, gesture=3)
    assert tab.last("refusal")["dropped"] and list(tab.last("document")["data"]["runs"]) == ["fast"]


def test_saving_reports_external_changes(session, tab, file):
    tab.edit(MOVE)
    assert kinds(tab.say("save")) == ["saved", "document"]
    assert file.read_text() == session.editor.document.text and not tab.last("document")["dirty"]
    file.write_text(f"{JOB}# by another program\n")
    session.look()
    assert tab.last("document")["on_disk"] == "changed"
    tab.edit({**MOVE, "to": [0.39, 0.16]}, gesture=1)
    (frames,) = tab.say("save")
    assert frames.kind == "conflict"
    assert file.read_text().endswith("# by another program\n")
    tab.say("reload")
    assert session.editor.document.text.endswith("# by another program\n")
    tab.say("undo")
    tab.say("save", force=True)
    assert file.read_text() == session.editor.document.text


def test_a_job_without_a_file_is_a_download(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session = open_session(None, task_worker=RecordingTaskWorker)
    tab = SessionPage(session)
    try:
        session.begin()
        tab.say("new", card="paper", arm="ur5e")
        assert tab.last("document")["run"] == "optimal"
        (frames,) = tab.say("save")
        file = session.pages.files[frames.header["file"]]
        assert frames.header["name"] == file.name == "paper.yaml"
        assert file.data.decode() == session.editor.document.text
    finally:
        session.close()
    assert list(tmp_path.iterdir()) == []


def test_tasks_can_be_cancelled_and_return_files(session, tab):
    tab.say("task", id="t1", task="report", options={"all": True})
    lane = RecordingTaskWorker.last
    ((id, task, request),) = lane.given
    assert (id, task, request["options"]) == ("t1", "report", {"all": True})
    assert "already in use" in sentence(tab.say("task", id="t1", task="report"))
    tab.say("cancel", id="t1")
    assert lane.cancelled == ["t1"] and tab.say("cancel", id="t2") == []
    lane.deliver(MessageFrame("progress", {"id": "t1", "share": 0.5}))
    header = {"id": "t1", "name": "a.html"}
    lane.deliver(MessageFrame("result", header, {"content": np.frombuffer(b"<html>", np.uint8)}))
    assert session.pages.files[tab.last("result")["file"]].data == b"<html>"
    assert tab.last("progress")["share"] == 0.5
    tab.say("task", id="t1", task="report")
    assert len(lane.given) == 2


def test_messages_of_the_studio_name_no_command_line_options():
    pairs = {
        "a text (unknown: skip, or --skip-unknown).": "a text (unknown: skip).",
        "such as `units: mm` or --units mm.": "such as `units: mm`.",
        "the part (path.frame, --position), with which": "the part (path.frame), with which",
        "leave z out (on the command line --ignore-z), or": "leave z out, or",
        "name one such as u1, also with --columns 'u#=NAME_#'.": "name one such as u1.",
        "name the unit, such as --columns 'q# [deg]=q#' for degrees": "name the unit for degrees",
        "are wrong, so give these as --set-points.": "are wrong, so give these.",
        "from -3 -- or less -- to 4": "from -3 -- or less -- to 4",
    }
    assert {x: without_options(x) for x in pairs} == pairs


def test_drawing_that_its_cell_cannot_follow_is_refused_and_nothing_changes(session, tab):
    """The planar arm has no third coordinate. The server sends such an error with status 422."""
    editor = session.editor
    id = editor.id
    run = editor.run
    text = editor.document.text
    frames = len(tab.frames)
    with pytest.raises(ac.InvalidInput, match="z"):
        session.open_upload("lifted.csv", b"x [m],y [m],z [m]\n0,0,0\n0.1,0,0.1\n", "pmk3s")
    assert (editor.id, editor.run, editor.document.text) == (id, run, text)
    assert len(tab.frames) == frames
    # The job is planned and edited as before.
    assert editor.previewer.folder == editor.document.folder
    tab.edit(MOVE)
    assert tab.last("picture")["run"] == run


def test_a_new_session_shows_the_run_that_was_shown_last(file):
    def shown(session):
        page = SessionPage(session)
        session.begin()
        return page, page.last("document")["run"]

    first = session_of(file)
    page, run = shown(first)
    assert run == "slow"
    page.say("select", run="fast")
    first.close()
    second = session_of(file)
    page, run = shown(second)
    assert run == "fast"
    # The new run is only in the draft.
    page.edit({"do": "add_run", "name": "faster"})
    assert page.last("document")["run"] == "faster"
    second.close()
    third = session_of(file)
    page, run = shown(third)
    assert run == "slow"
    page.say("restore_draft")
    assert page.last("document")["run"] == "faster"
    third.close()
