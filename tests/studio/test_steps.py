"""The undo list, names of steps, and what has changed since a result was made."""

import hashlib

import ezdxf
import pytest
from tests.studio.session_pages import (
    JOB,
    MOVE,
    RecordingTaskWorker,
    SessionPage,
    session_of,
)

from armcontour.core.yaml_loader import load
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.differences import differences

pytestmark = pytest.mark.usefixtures("no_hurry")
SPEED = {"do": "set", "key": "limits.speed", "value": "40 mm/s"}
KERF = {"do": "set", "key": "corners.tolerance", "value": "2 mm"}


def test_undo_goes_to_a_step_in_both_directions(session, tab):
    texts = [session.editor.document.text]
    for edit in (SPEED, MOVE, KERF):
        tab.edit(edit)
        texts.append(session.editor.document.text)
    assert len(set(texts)) == 4
    steps = tab.last("document")["steps"]
    assert steps["made"] == 3 and steps["first"] == 0 and len(steps["labels"]) == 3
    # Labels have the values.
    assert "40 mm/s" in steps["labels"][0] and "2 mm" in steps["labels"][2]
    for to in (1, 3, 0, 2):
        tab.say("undo", to=to)
        assert session.editor.document.text == texts[to]
        now = tab.last("document")["steps"]
        assert now == {**steps, "made": to}
    # A new change replaces the undone ones.
    tab.edit({**SPEED, "value": "45 mm/s"})
    assert len(tab.last("document")["steps"]["labels"]) == 3
    for to in (-1, 4, 1.5, "x", True):
        text = session.editor.document.text
        (frame,) = tab.say("undo", to=to)
        assert frame.kind == "failed" and session.editor.document.text == text


def test_an_added_run_is_shown_and_edited(session, tab):
    tab.say("select", run="fast")
    tab.edit({"do": "add_run", "name": "faster"})
    assert tab.last("document")["run"] == "faster"
    tab.edit({"do": "set", "key": "limits.speed", "value": "90 mm/s", "run": True})
    runs = load(session.editor.document.text, "")["runs"]
    assert runs["faster"] == {"limits": {"speed": "90 mm/s"}} and runs["fast"] == {}
    # Without the run, the one that was shown before is shown again.
    tab.say("select", run="slow")
    tab.edit({"do": "add_run", "name": "slower"})
    tab.say("undo")
    assert tab.last("document")["run"] == "slow"


def test_results_say_when_they_were_made_and_what_has_changed(session, tab):
    text = session.editor.document.text
    tab.say("task", id="t1", task="report")
    result = MessageFrame.of_file("x.html", b"x", {"id": "t1", "task": "report"})
    session._send_state_frame(result, None)
    made = tab.last("result")["made"]
    assert made["job"] == "small" and made["run"] == "slow"
    digest = hashlib.sha256(text.encode()).hexdigest()
    assert digest[:8] in made["files"] and made["time"][:2] == "20"
    shown = tab.last("document")["hash"]
    assert digest.startswith(shown) and len(shown) >= 8
    tab.edit(SPEED)
    document = tab.last("document")
    (change,) = document["outdated"]["t1"]
    assert "40 mm/s" in change and document["hash"] != shown
    # A second result belongs to the job as it is now.
    tab.say("task", id="t2", task="certify")
    tab.edit(KERF)
    outdated = tab.last("document")["outdated"]
    assert len(outdated["t1"]) == 2 and len(outdated["t2"]) == 1
    # With the edits undone, the first result is up to date; a comment changes nothing.
    tab.say("undo", to=0)
    assert set(tab.last("document")["outdated"]) == {"t2"}
    tab.edit({"do": "text", "text": f"# Comment\n{text}"})
    assert set(tab.last("document")["outdated"]) == {"t2"}
    # A result of which a change was taken applies to the changed job.
    tab.edit(SPEED, result="t2")
    assert set(tab.last("document")["outdated"]) == {"t1"}
    # Files that were read again may have changed.
    session.editor.document.file.write_text(session.editor.document.text)
    tab.say("reload")
    assert set(tab.last("document")["outdated"]) == {"t1", "t2"}
    id, _, request = RecordingTaskWorker.last.given[-1]
    assert id == "t2" and made["job"] in request["origin"]


def heard_of_tasks(page):
    """Kinds and identifiers of the frames of tasks that a page has received."""
    told = ("started", "result", "failed", "cancelled")
    return [(x.kind, x.header["id"]) for x in page.frames if x.kind in told]


def test_a_page_that_joins_receives_all_results(session, tab):
    other = SessionPage(session)
    for id, task in (("t1", "report"), ("t2", "certify"), ("t3", "export"), ("t4", "compare")):
        tab.say("task", id=id, task=task, options={"format": "csv"})
    ends = (
        MessageFrame.of_file("x.html", b"x", {"id": "t1", "task": "report", "sentence": "Made."}),
        MessageFrame("failed", {"id": "t2", "task": "certify", "sentence": "No."}),
        MessageFrame("result", {"id": "t4", "task": "compare", "runs": []}),
    )
    for frame in ends:
        session._send_state_frame(frame, None)
    # A task that is refused at once has no result for others.
    (refused,) = [x for x in tab.say("task", id="t3", task="report") if x.kind == "failed"]
    assert refused.header["id"] == "t3"
    # Another page hears of all tasks while they run.
    starts = [("started", x) for x in ("t1", "t2", "t3")]
    assert heard_of_tasks(other)[:3] == starts
    late = SessionPage(session)
    assert heard_of_tasks(late) == [
        starts[0], ("result", "t1"), starts[1], ("failed", "t2"), starts[2]
    ]  # fmt: skip
    assert late.last("started")["task"] == "export"
    assert late.last("started")["options"] == {"format": "csv"}
    result = late.last("result")
    (begun,) = [x.header for x in tab.frames if x.kind == "started" and x.header["id"] == "t1"]
    assert result["made"] == begun["made"] and begun["made"]["run"] == "slow"
    assert session.pages.files[result["file"]].data == b"x"
    # The page knows the job before its results, and what has changed since they were made.
    order = [x.kind for x in late.frames]
    assert order.index("document") < order.index("started")
    tab.edit(SPEED)
    assert set(SessionPage(session).last("document")["outdated"]) >= {"t1", "t3"}
    # Another document has no results.
    session.open_upload("other.yaml", JOB.encode(), None)
    assert heard_of_tasks(SessionPage(session)) == []


def test_a_page_receives_the_newest_results(session, tab):
    for k in range(20):
        tab.say("task", id=f"t{k}", task="report")
    kept = heard_of_tasks(SessionPage(session))
    assert 1 < len(kept) < 20 and kept[-1] == ("started", "t19")


@pytest.mark.parametrize(
    ("before", "after", "count", "words"),
    [
        ("path: {frame: {position: [420 mm, 0, 0.1]}}",
         "path: {frame: {position: [0.42, 10 mm, 0.1]}}", 1, ("Y", "+10 mm")),
        ("path: {frame: {position: [0, 0, 0]}}",
         "path: {frame: {position: [0, 0, -5 mm], rpy: [0, 0, 15 deg]}}", 2, ("Z", "−5 mm")),
        ("path: {frame: {quaternion: [0, 0]}}", "path: {frame: {position: [0, 0, 0]}}", 1, ()),
        ("path: {points: [[0, 0], [1, 0]]}", "path: {points: [[0, 0], [1, 1]]}", 1, ("2",)),
        ("path: {points: [[0, 0], [1, 0]]}", "path: {points: [[0, 0], [1, 1], [2, 2]]}", 1, ("1",)),
        ("scene: {obstacles: [{name: post}]}", "{}", 1, ("post", "removed")),
        ("scene: {obstacles: [{name: post, at: [0, 0, 0]}]}",
         "scene: {obstacles: [{name: post, at: [0, 0, 1]}, {name: wall}]}", 2, ("post", "Z 0 → 1")),
        ("scene: {obstacles: [{name: post, at: [725 mm, 0, 0], rpy: [0, 0, 0 deg]}]}",
         "scene: {obstacles: [{name: post, at: [500 mm, 0, 0], rpy: [0, 0, 9 deg]}]}", 1,
         ("post", "X 725 mm → 500 mm", "yaw 0 deg → 9 deg")),
        ("scene: {obstacles: [{name: post, radius: 20 mm}]}",
         "scene: {obstacles: [{name: post, radius: 30 mm}]}", 1, ("post", "20 mm → 30 mm")),
        ("scene: {obstacles: [{name: post}]}",
         "scene: {obstacles: [{name: post, allow: [wrist_3]}]}", 1, ("post", "touch wrist_3")),
        ("runs: {a: {limits: {speed: 60 mm/s}}}", "runs: {a: {limits: {speed: 70 mm/s}}}", 1,
         ("Run a, speed 60 mm/s → 70 mm/s",)),
        ("timing: {method: optimal}", "timing: {method: constant}", 1,
         ("Timing optimal → constant",)),
        ("path: {contours: {A: {order: 1}}}",
         "path: {contours: {A: {order: 2}, B: {order: 1}}}", 1, ("Order",)),
        ("{}", "path: {contours: {CUT-1: {speed: 3 mm/s}}}", 1, ("CUT-1", "speed", "3 mm/s")),
        ("runs: {a: {}}", "runs: {a: {}, b: {}}", 1, ("b", "added")),
        ("process: {tabs: {width: 1 mm}}", "process: {}", 1, ("Tabs", "removed")),
        ("process: {}", "process: {tabs: {width: 2 mm, spacing: 50 mm}}", 1, ("2 mm", "50 mm")),
        ("process: {}", "process: {switch: {name: torch}}", 1, ("Switch torch",)),
        ("runs: {a: {}}", "runs: {a: {limits: {speed: 60 mm/s}}}", 1, ("Run a", "60 mm/s")),
        ("arm: {name: ur5e}", "arm: {name: ur10e}", 1, ("Arm ur5e → ur10e",)),
        ("path: {layers: {CUT: {}, MARK: {}}}", "path: {layers: {CUT: {}}}", 1, ("Layer MARK",)),
        ("path: {layers: [CUT, MARK]}", "path: {layers: {CUT: {}, MARK: {speed: 9 mm/s}}}", 1,
         ("Layer MARK", "speed 9 mm/s")),
        ("path: {file: a.dxf}", "path: {file: a.dxf, layers: [CUT]}", 1, ("Layers CUT",)),
        ("limits: {speed: 1}", "limits: {speed: 1}", 0, ()),
    ],
)  # fmt: skip
def test_differences_name_what_has_changed(before, after, count, words):
    found = differences(load(before, ""), load(after, ""))
    assert len(found) == count
    assert all(x in found[0] for x in words)
    # In the other direction there are as many.
    assert len(differences(load(after, ""), load(before, ""))) == count


def test_a_layer_that_no_longer_runs_is_named_in_the_undo_list(tmp_path):
    drawing = ezdxf.new()
    for k, layer in enumerate(("CUT", "MARK")):
        line = [(300 + 30 * k, 200), (320 + 30 * k, 230)]
        drawing.modelspace().add_lwpolyline(line, dxfattribs={"layer": layer})
    drawing.saveas(tmp_path / "two.dxf")
    head, _, rest = JOB.partition("path:\n")
    _, _, rest = rest.partition("\n")
    (tmp_path / "job.yaml").write_text(f"{head}path: {{file: two.dxf, units: mm}}\n{rest}")
    session = session_of(tmp_path / "job.yaml")
    session.begin()
    page = SessionPage(session)
    # As the page does when the layer is unticked.
    page.edit(
        {"do": "set", "key": "path.layers", "value": {"CUT": {}, "MARK": {}}},
        {"do": "unset", "key": "path.layers.MARK"},
    )
    assert page.last("document")["undo_label"] == "Layer MARK off"
    page.edit({"do": "set", "key": "path.layers.MARK", "value": {}})
    assert page.last("document")["undo_label"] == "Layer MARK on"
    session.close()
