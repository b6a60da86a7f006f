"""The text of a job that is changed: undo, and its file."""

from __future__ import annotations

import os
import random
from pathlib import Path

import pytest

from armcontour._yaml import load
from armcontour.errors import InvalidInput
from armcontour.io import parse_job
from armcontour.io.job_edits import Change
from armcontour.studio import document as module
from armcontour.studio.document import Document
from armcontour.studio.edits import EditState, changes_of
from armcontour.studio.handles import handles_of

TEXT = """\
# Not to be lost.
name: corner
arm: pmk3s
path:
  points:   # in metres
    - [0.30, 0.20]
    - [360 mm, 200 mm]  # the corner
    - [0.36, 0.26]
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}  # both
corners: {tolerance: 5 mm, at: {2: 1 mm}}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: none}}
  slow: {limits: {speed: 20 mm/s}, corners: {tolerance: 1 mm}}
"""
FASTER = [Change(("limits", "speed"), "0.2 m/s")]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "job.yaml"
    file.write_bytes(TEXT.encode())
    return file


def test_a_change_is_one_step_that_can_be_undone_and_done_again(file: Path) -> None:
    document = Document.open(file)
    assert not (document.dirty or document.can_undo or document.can_redo)
    assert document.preview(FASTER)["limits"]["speed"] == "0.2 m/s"
    assert document.text == TEXT and document.data["limits"]["speed"] == "0.15 m/s"
    document.apply(FASTER, "speed")
    assert document.data == load(document.text, "") and document.dirty
    assert (document.undo_label, document.redo_label) == ("speed", None)
    # Nothing new is no step.
    document.apply(FASTER, "again")
    assert document.undo_label == "speed"
    document.undo()
    assert document.text == TEXT and document.redo_label == "speed" and not document.dirty
    document.redo()
    assert "0.2 m/s" in document.text
    document.undo()
    document.replace(TEXT.replace("corner\n", "other\n", 1), "text")
    assert not document.can_redo
    for step in (document.redo, document.undo, document.undo):
        if step == document.redo or not document.can_undo:
            with pytest.raises(InvalidInput, match="nothing to"):
                step()
        else:
            step()


def random_edit(rng: random.Random, points: int) -> dict:
    at = [round(rng.uniform(0.25, 0.4), 4), round(rng.uniform(0.15, 0.3), 4)]
    return rng.choice(
        [
            {"do": "set", "key": "limits.speed", "value": rng.uniform(0.01, 0.3)},
            {"do": "set", "key": "servo.kp.1", "value": rng.uniform(10, 40)},
            {"do": "set", "key": "timing.reserve", "value": rng.uniform(0, 0.5)},
            {"do": "unset", "key": "limits.speed"},
            {"do": "set", "key": "corners.shape", "value": rng.choice(["arc", "sharp"])},
            {"do": "move_waypoint", "index": rng.randrange(points), "to": at},
            {"do": "insert_waypoint", "index": rng.randrange(points + 1), "at": at},
            {"do": "remove_waypoint", "index": rng.randrange(points)},
            {"do": "corner_tolerance", "index": 1, "value": rng.choice([1e-3, "2 mm", None])},
            {"do": "place", "by": at, "turn": rng.uniform(-1, 1), "about": [0.3, 0.2]},
            {"do": "obstacle", "action": "add", "kind": "box", "size": [0.1] * 3, "at": [1, 0, 0]},
            {"do": "obstacle", "action": "remove", "kind": "box", "index": 0},
        ]
    )


@pytest.mark.parametrize(("eol", "edits"), [("\n", 200), ("\r\n", 20)])
def test_many_edits_and_their_undoing_give_the_same_bytes(eol: str, edits: int, file: Path) -> None:
    content = b"\xef\xbb\xbf" + TEXT.replace("\n", eol).encode()
    file.write_bytes(content)
    document = Document.open(file)
    job = parse_job(document.text)
    rng, made, texts = random.Random(eol), 0, [document.text]
    while made < edits:
        data = document.data
        if not 2 <= len(data["path"]["points"]) <= 6:
            document.undo()
            texts.pop()
            continue
        # Of the job only the arm and the names of runs matter here.
        state = EditState(
            data=data, run=rng.choice(["only", "slow"]), handles=handles_of(job, data)
        )
        try:
            changes = changes_of(random_edit(rng, len(data["path"]["points"])), state)
        except InvalidInput:
            continue
        wanted = document.preview(changes)
        document.apply(changes, "edit")
        made += 1
        assert document.data == wanted
        if document.text != texts[-1]:
            texts.append(document.text)
    assert load(document.text, "") == document.data and len(texts) > edits / 2
    comments = [x.partition("#")[2].strip() for x in TEXT.splitlines() if "#" in x]
    assert comments[0] in document.text and eol in document.text
    for text in reversed(texts[:-1]):
        document.undo()
        assert document.text == text
    assert not document.can_undo
    document.save()
    assert file.read_bytes() == content
    while document.can_redo:
        document.redo()
    assert document.text == texts[-1]


def test_saving_writes_the_file_whole_and_refuses_changes_of_others(file: Path) -> None:
    document = Document.open(file)
    document.save()
    assert file.read_bytes() == TEXT.encode()
    os.chmod(file, 0o640)
    document.apply(FASTER, "speed")
    assert (
        "-limits: {speed: 0.15 m/s" in document.diff() and "+limits: {speed: 0.2" in document.diff()
    )
    document.save()
    assert file.read_text() == document.text and file.stat().st_mode & 0o777 == 0o640
    assert (document.on_disk(), document.dirty, document.diff()) == ("same", False, "")
    assert [x.name for x in file.parent.iterdir()] == ["job.yaml"]
    file.write_text(TEXT.replace("corner", "theirs", 1))
    assert document.changed_on_disk()
    with pytest.raises(InvalidInput, match="was changed by another program"):
        document.save()
    assert "-name: theirs" in document.conflict()
    document.save(force=True)
    assert file.read_text() == document.text
    file.unlink()
    assert document.on_disk() == "missing"
    document.save()
    assert file.read_text() == document.text


def test_reloading_takes_what_others_wrote_and_can_be_undone(file: Path) -> None:
    document = Document.open(file)
    document.apply(FASTER, "speed")
    theirs = TEXT.replace("corner", "theirs", 1)
    file.write_text(theirs)
    document.reload()
    assert document.text == theirs and not document.dirty and document.undo_label == "reload"
    document.undo()
    assert "0.2 m/s" in document.text and document.dirty
    document.save()
    assert file.read_text() == document.text


def test_a_drawing_becomes_a_job_beside_it_with_the_comments_of_its_cell(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    drawing = tmp_path / "in" / "plate: 1.svg"
    drawing.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L9 0"/></svg>')
    document = Document.of_drawing(drawing, "pmk3s")
    assert document.file == drawing.with_suffix(".yaml") and document.on_disk() == "missing"
    assert document.data["path"]["file"] == "plate: 1.svg" and document.data["name"] == "plate: 1"
    assert "# The drawing's origin lies here" in document.text and document.dirty
    document.save()
    assert Document.open(document.file).text == document.text
    other = Document.of_drawing(drawing, "ur5e")
    with pytest.raises(InvalidInput, match="was changed by another program"):
        other.save()
    own = tmp_path / "cell.yaml"
    own.write_text("arm: {name: ur5e, joint_limits: soft.yaml}\npath: {points: [[0, 0], [1, 0]]}\n"
                   "servo: {kp: 25 1/s, kv: 150 1/s}\nruns: {a: {}}\n")  # fmt: skip
    (tmp_path / "soft.yaml").touch()
    found = Document.of_drawing(drawing, str(own)).data
    assert found["arm"]["joint_limits"] == "../soft.yaml"
    assert found["path"] == {"file": "plate: 1.svg"}
    with pytest.raises(InvalidInput, match="There is no drawing"):
        Document.of_drawing(tmp_path / "gone.svg", "ur5e")


def test_a_job_without_a_folder_may_name_no_files() -> None:
    document = Document.of_text(TEXT, None, "upload.yaml")
    assert document.on_disk() == "none" and not document.dirty
    with pytest.raises(
        InvalidInput, match="upload.yaml names the file part.dxf, which is not here"
    ):
        Document.of_text("path: {file: part.dxf}\n", None, "upload.yaml")
    with pytest.raises(InvalidInput, match="names the file /etc/passwd"):
        document.apply([Change(("path", "file"), "/etc/passwd")], "file")
    assert document.text == TEXT
    with pytest.raises(InvalidInput, match="has no file to save to"):
        document.save()


@pytest.mark.parametrize("text", ["a: [", "- 1", "", "a: 1\na: 2"])
def test_a_text_that_is_no_job_is_refused_and_changes_nothing(text: str, file: Path) -> None:
    document = Document.open(file)
    with pytest.raises(InvalidInput, match="job.yaml"):
        document.replace(text, "text")
    assert document.text == TEXT and not document.can_undo


def test_line_breaks_of_a_browser_become_those_of_the_file(file: Path) -> None:
    file.write_bytes(TEXT.replace("\n", "\r\n").encode())
    document = Document.open(file)
    document.replace(document.text.replace("\r\n", "\n"), "text")
    assert not document.can_undo
    document.replace(TEXT.replace("corner", "other", 1), "text")
    assert document.text.count("\r\n") == document.text.count("\n") == TEXT.count("\n")


def test_long_texts_are_kept_for_undo_as_far_as_there_is_room(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MOST_UNDO", 3 * len(TEXT))
    document = Document.open(file)
    for speed in range(1, 7):
        document.apply([Change(("limits", "speed"), f"0.{speed} m/s")], f"to {speed}")
    undone = []
    while document.can_undo:
        undone.append(document.undo_label)
        document.undo()
    assert undone == ["to 6", "to 5", "to 4"]
    assert document.data["limits"]["speed"] == "0.3 m/s"
