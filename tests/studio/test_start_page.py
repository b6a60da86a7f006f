"""The start page: jobs to begin with, files opened before, and drafts."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.dynamics_extra import mark_all_but
from tests.studio.conftest import DRAWINGS
from tests.studio.session_pages import JOB, ImmediateWorker, RecordingTaskWorker, SessionPage

import armcontour as ac
from armcontour.files.job_file import cell_names, drawing_text
from armcontour.files.job_text_edits import Change, change_data
from armcontour.report.message_frame import MessageFrame
from armcontour.studio.connection import open_session
from armcontour.studio.opening import DRAWINGS as CARDS
from armcontour.studio.opening import Uploads, new_document

FASTER = [Change(("limits", "speed"), "0.1 m/s")]


@pytest.fixture
def opened(tmp_path, monkeypatch):
    """Opens sessions as the command does, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("armcontour.studio.session.PreviewWorker", ImmediateWorker, raising=False)
    sessions = []

    def open_one(file=None, cell=None):
        session = open_session(file, cell=cell, task_worker=RecordingTaskWorker)
        sessions.append(session)
        tab = SessionPage(session)
        session.begin()
        return session, tab

    yield open_one
    for session in sessions:
        session.close()


def start(tab):
    """What the start page shows."""
    tab.say("start")
    return tab.last("start")


@pytest.mark.parametrize("arm", mark_all_but(cell_names(), ["pmk3s"]))
def test_each_example_of_the_start_page_can_be_run_with_each_arm(arm, tmp_path):
    for card in CARDS:
        document = new_document(card, arm, Uploads(), tmp_path)
        (tmp_path / "job.yaml").write_text(document.text)
        job = ac.read_job(tmp_path / "job.yaml")
        result = ac.run(job, simulate=False)
        (run,) = result.runs.values()
        assert (
            job.arm.name == ac.load_arm(arm.removesuffix("_positioner")).name
            and run.trajectory.duration > 1
        )
    paper = new_document("paper", arm, Uploads(), tmp_path)
    assert "PMK-3s" in paper.text
    with pytest.raises(ac.InvalidInput, match="card"):
        new_document("table", arm, Uploads(), tmp_path)


def test_a_long_drawing_is_shown_before_its_job_is_read(tmp_path):
    shapes = "".join(f'<circle cx="{3 * k}" cy="{k % 7}" r="1"/>' for k in range(1, 121))
    file = tmp_path / "circles.svg"
    sent = []
    file.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 400 400">{shapes}</svg>')
    job = tmp_path / "job.yaml"
    job.write_text(
        drawing_text("ur5e", file, tmp_path).replace(
            "frame: {", "frame: {rpy: [0.1 rad, 0.2 rad, 0.7 rad], "
        )
    )

    def send(data, key="start"):
        sent.append(MessageFrame.unpack(data))

    session = open_session(job, send=send, task_worker=RecordingTaskWorker)
    tab = SessionPage(session)
    early = sent[-1]
    session.begin()
    late = next(x for x in tab.frames if x.kind == "picture")
    session.close()
    assert early.header["tier"] == late.header["tier"] == "outline"
    assert early.header["contours"] == late.header["contours"]
    for name in ("objective", "objective_breaks"):
        np.testing.assert_allclose(early.arrays[name], late.arrays[name], rtol=0, atol=1e-9)


def test_an_empty_plane_is_drawn_on_and_undone(opened):
    session, tab = opened()
    tab.say("new", card="empty", arm="ur10e")
    blank = tab.last("document")
    text = session.editor.document.text
    assert blank["path"]["kind"] == "blank" and not blank["start"] and "ur10e" in text
    assert tab.last("picture")["tier"] == "outline"
    # The arm of the new job replaces that of the one before.
    assert tab.last("arm")["document"] == tab.last("document")["id"]
    a, b = np.array(tab.last("picture")["centre"]) + [[0, 0], [0.05, 0.02]]
    lines = [{"to": [b[0], a[1]]}, {"to": b}, {"to": [a[0], b[1]]}, {"to": a}]
    edit = {"do": "draw", "start": a.tolist()}
    edit["segments"] = [{"to": np.asarray(x["to"]).tolist()} for x in lines]
    tab.edit(edit, gesture=1)
    session.scheduler.wait()
    assert tab.last("document")["path"]["kind"] == "segments"
    tab.say("undo")
    assert session.editor.document.text == text and tab.last("document")["path"]["kind"] == "blank"
    tab.say("redo")
    assert len(tab.last("document")["waypoints"]) == 5


def test_recent_files_are_offered_if_they_still_exist(opened, tmp_path):
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    job = folder / "job.yaml"
    drawing = folder / "gasket.dxf"
    job.write_text(JOB)
    shutil.copy(DRAWINGS / "gasket.dxf", drawing)
    opened(job)
    opened(drawing, "ur5e")
    session, tab = opened()
    recent = start(tab)["recent"]
    assert [x["name"] for x in recent] == ["gasket.dxf", "job.yaml"]
    assert all(str(folder) in x["where"] for x in recent) and "ur5e" in recent[0]["where"]
    tab.say("open_recent", id=recent[1]["id"])
    assert session.editor.document.file == job and tab.last("document")["text"] == JOB
    tab.say("open_recent", id=recent[0]["id"])
    assert tab.last("document")["path"]["file"] == "gasket.dxf"
    drawing.unlink()
    assert [x["name"] for x in start(tab)["recent"]] == ["job.yaml"]
    for id in (recent[0]["id"], "0" * 32, "job.yaml"):
        assert "no longer exists" in tab.say("open_recent", id=id)[-1].header["sentence"]


def test_opening_a_recent_file_does_not_allow_other_folders(opened, tmp_path):
    inside = tmp_path / "a" / "job.yaml"
    outside = tmp_path / "b" / "secret.svg"
    for x in (inside, outside):
        x.parent.mkdir()
    shutil.copy(Path(ac.__file__).parent / "jobs" / "library" / "plate.svg", outside)
    inside.write_text(JOB)
    opened(inside)
    session, tab = opened()
    tab.say("open_recent", id=start(tab)["recent"][0]["id"])
    frames = tab.edit({"do": "text", "text": re.sub(r"points:.*", f"file: {outside}", JOB)})

    assert frames[-1].kind == "refusal" and "may be read" in frames[-1].header["sentence"]
    assert session.editor.document.text == JOB


def test_a_new_job_does_not_discard_unsaved_changes(opened):
    session, tab = opened()
    texts = []
    for arm in ("ur5e", "panda"):
        tab.say("new", card="drawing", arm=arm)
        session.editor.document.apply(change_data(session.editor.document.data, FASTER), "speed")
        texts.append(session.editor.document.text)
    frames = tab.say("new", card="empty", arm="ur5e")
    assert any(x.kind == "notice" and "stored as a draft" in x.header["sentence"] for x in frames)
    drafts = start(tab)["recent"]
    assert all(x["where"].startswith("not saved, changed ") for x in drafts) and len(drafts) == 2
    # The server is killed, and started again.
    session, tab = opened()
    assert start(tab)["recent"] == drafts
    for x, text in zip(drafts, reversed(texts), strict=True):
        tab.say("open_recent", id=x["id"])
        assert session.editor.document.text == text
    assert len(start(tab)["recent"]) == 1


def test_a_draft_of_a_file_is_continued_without_a_question(opened, tmp_path):
    file = tmp_path / "job.yaml"
    file.write_text(JOB)
    session, _ = opened(file)
    session.editor.document.apply(change_data(session.editor.document.data, FASTER), "speed")
    changed = session.editor.document.text
    assert changed != JOB
    session, tab = opened()
    (draft,) = start(tab)["recent"]
    tab.say("open_recent", id=draft["id"])
    assert session.editor.document.text == changed
    assert tab.last("document")["draft"] is None
    # The first step of the undo list is the file.
    tab.say("undo")
    assert session.editor.document.text == JOB
