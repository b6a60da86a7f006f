"""The text of an edited job, its file, its history and its drafts."""

import os
import random
import shutil

import pytest
from tests.studio.conftest import DRAWINGS

from armcontour.core.errors import InvalidInput
from armcontour.core.file_access import reading_below
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job
from armcontour.files.job_text_edits import Change, change_data
from armcontour.studio.document import MAX_STORED, Document
from armcontour.studio.editor import Editor
from armcontour.studio.edits import changes_of
from armcontour.studio.handles import EditState, handles_of
from armcontour.studio.opening import Uploads
from armcontour.studio.preview import CoarsePlanner
from armcontour.studio.recent import all_recent

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
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
runs:
  only: {compensation: {method: none}}
  slow: {limits: {speed: 20 mm/s}, corners: {tolerance: 1 mm}}
"""
FASTER = [Change(("limits", "speed"), "0.2 m/s")]
THEIRS = TEXT.replace("corner", "theirs", 1)


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "job.yaml"
    file.write_bytes(TEXT.encode())
    return file


def random_edit(rng, points):
    position = [round(rng.uniform(0.25, 0.4), 4), round(rng.uniform(0.15, 0.3), 4)]
    return rng.choice(
        [
            {"do": "set", "key": "limits.speed", "value": rng.uniform(0.01, 0.3)},
            {"do": "set", "key": "servo.kp.1", "value": rng.uniform(10, 40)},
            {"do": "set", "key": "timing.reserve", "value": rng.uniform(0, 0.5)},
            {"do": "unset", "key": "limits.speed"},
            {"do": "set", "key": "corners.shape", "value": rng.choice(["arc", "sharp"])},
            {"do": "move_waypoint", "index": rng.randrange(points), "to": position},
            {"do": "insert_waypoint", "index": rng.randrange(points + 1), "at": position},
            {"do": "remove_waypoint", "index": rng.randrange(points)},
            {"do": "set", "key": "corners.tolerance", "value": rng.choice([1e-3, "2 mm"])},
            {"do": "place", "by": position, "turn": rng.uniform(-1, 1), "about": [0.3, 0.2]},
            {"do": "obstacle", "action": "add", "type": "box", "size": [0.1] * 3, "at": [1, 0, 0]},
            {"do": "obstacle", "action": "remove", "index": 0},
        ]
    )


@pytest.mark.parametrize(("eol", "edits"), [("\n", 60), ("\r\n", 20)])
def test_undoing_many_edits_restores_the_file_exactly(eol, edits, file):
    content = b"\xef\xbb\xbf" + TEXT.replace("\n", eol).encode()
    file.write_bytes(content)
    document = Document.open(file)
    job = parse_job(document.text)
    rng = random.Random(eol)
    made = 0
    texts = [document.text]
    while made < edits:
        data = document.data
        if not 2 <= len(data["path"]["points"]) <= 6:
            document.undo()
            texts.pop()
            continue
        # Of the job only the arm and the names of runs matter here.
        run = rng.choice(["only", "slow"])
        handles = handles_of(job, data)
        state = EditState(data=data, run=run, handles=handles)
        try:
            changes = changes_of(random_edit(rng, len(data["path"]["points"])), state)
        except InvalidInput:
            continue
        expected = change_data(document.data, changes)
        document.apply(expected, "edit")
        made += 1
        assert document.data == expected
        if document.text != texts[-1]:
            texts.append(document.text)
    assert load(document.text, "") == document.data and len(texts) > edits / 2
    assert "# Not to be lost." in document.text and eol in document.text
    for text in reversed(texts[:-1]):
        document.undo()
        assert document.text == text
    assert not document.undo_label
    document.save()
    assert file.read_bytes() == content
    while document.redo_label:
        document.redo()
    assert document.text == texts[-1]


def test_saving_and_reloading_respect_external_changes(file):
    document = Document.open(file)
    document.save()
    assert file.read_bytes() == TEXT.encode()
    os.chmod(file, 0o640)
    document.apply(change_data(document.data, FASTER), "speed")
    document.save()
    assert file.read_text() == document.text and file.stat().st_mode & 0o777 == 0o640
    assert (document.on_disk(), document.dirty) == ("same", False)
    assert [x.name for x in file.parent.iterdir()] == ["job.yaml"]
    file.write_text(THEIRS)
    assert document.on_disk() == "changed"
    with pytest.raises(InvalidInput, match="Another program has changed"):
        document.save()
    document.save(force=True)
    assert file.read_text() == document.text
    file.unlink()
    assert document.on_disk() == "missing"
    document.save()
    assert file.read_text() == document.text
    file.write_text(TEXT)
    document = Document.open(file)
    document.apply(change_data(document.data, FASTER), "speed")
    file.write_text(THEIRS)
    document.reload()
    assert document.text == THEIRS and not document.dirty and document.undo_label == "reload"
    document.undo()
    assert "0.2 m/s" in document.text and document.dirty
    document.save()
    assert file.read_text() == document.text


def test_a_drawing_becomes_a_job_next_to_it_with_the_comments_of_its_cell(tmp_path):
    (tmp_path / "in").mkdir()
    drawing = tmp_path / "in" / "plate: 1.svg"
    drawing.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 L9 0"/></svg>')
    document = Document.of_drawing(drawing, "pmk3s")
    assert document.file == drawing.with_suffix(".yaml") and document.on_disk() == "missing"
    assert document.data["path"]["file"] == "plate: 1.svg" and document.data["name"] == "plate: 1"
    assert "# Origin of the drawing" in document.text and document.dirty
    document.save()
    assert Document.open(document.file).text == document.text
    with pytest.raises(InvalidInput):
        Document.of_drawing(drawing, "ur5e").save()
    cell = tmp_path / "cell.yaml"
    cell.write_text("arm: {name: ur5e, joint_limits: soft.yaml}\npath: {points: [[0, 0], [1, 0]]}\n"
                   "servo: {kp: 25 1/s, kv: 150 1/s}\nruns: {a: {}}\n")  # fmt: skip
    (tmp_path / "soft.yaml").touch()
    data = Document.of_drawing(drawing, str(cell)).data
    assert data["arm"]["joint_limits"] == "../soft.yaml"
    assert data["path"] == {"file": "plate: 1.svg"}
    with pytest.raises(InvalidInput):
        Document.of_drawing(tmp_path / "gone.svg", "ur5e")


def test_a_job_without_a_file_is_not_saved(tmp_path):
    document = Document(TEXT, source="upload.yaml", folder=tmp_path)
    assert document.on_disk() == "none" and not document.dirty
    with pytest.raises(InvalidInput):
        document.save()


def test_texts_are_replaced_by_jobs_only_with_the_line_breaks_of_the_file(file):
    document = Document.open(file)
    for text in ("a: [", "- 1", "", "a: 1\na: 2"):
        with pytest.raises(InvalidInput):
            document.replace(text, "text")
        assert document.text == TEXT and not document.undo_label, text
    file.write_bytes(TEXT.replace("\n", "\r\n").encode())
    document = Document.open(file)
    document.replace(document.text.replace("\r\n", "\n"), "text")
    assert not document.undo_label
    document.replace(TEXT.replace("corner", "other", 1), "text")
    assert document.text.count("\r\n") == document.text.count("\n") == TEXT.count("\n")


def faster(file):
    document = Document.open(file)
    document.apply(change_data(document.data, FASTER), "speed")
    return document


def drafts(home):
    return [x.text for x in all_recent() if x.text is not None]


def test_a_draft_survives_until_the_job_is_saved(file, home):
    document = faster(file)
    again = Document.open(file)
    assert again.earlier_draft.text == document.text != TEXT
    document.undo()
    assert Document.open(file).earlier_draft is None and not drafts(home)
    document.redo()
    # A draft that is older than the file is not offered.
    (draft,) = (home / "armcontour" / "studio" / "recent").glob(f"{document.id}.json")
    os.utime(draft, (1, 1))
    assert Document.open(file).earlier_draft is None
    document.undo()
    document.redo()
    again = Document.open(file)
    again.replace(again.earlier_draft.text, "draft")
    assert again.text == document.text and drafts(home) == [again.text] * 2
    again.drop_earlier_draft()
    again.save()
    assert Document.open(file).earlier_draft is None and not drafts(home)
    assert not (file.parent / ".armcontour").exists()


SPEEDS = ("0.16 m/s", "0.17 m/s", "0.18 m/s")


def edited(file):
    """An editor of the job with three changes, of which the last one was undone."""
    editor = Editor(Document.open(file), CoarsePlanner(file.parent))
    for speed in SPEEDS:
        changed = editor.revise([{"do": "set", "key": "limits.speed", "value": speed}])
        editor.commit(changed, f"Speed {speed}")
    editor.change(editor.document.undo)
    return editor


def test_restored_draft_has_the_undo_steps_that_led_to_it(file, home):
    before = edited(file)
    texts = [TEXT.replace("0.15 m/s", x) for x in ("0.15 m/s", *SPEEDS[:2])]
    assert before.document.text == texts[-1]
    labels = [f"Speed {x}" for x in SPEEDS[:2]]
    # The process was killed, so nothing else was written.
    again = Editor(Document.open(file), CoarsePlanner(file.parent))
    again.restore()
    assert again.document.text == texts[-1] and again.document.steps == (tuple(labels), 2)
    for text in reversed(texts[:-1]):
        again.change(again.document.undo)
        assert again.document.text == text
    assert again.document.text == TEXT and not again.document.dirty
    # They survive a second time.
    again.document.go_to_step(2)
    third = Editor(Document.open(file), CoarsePlanner(file.parent))
    third.restore()
    assert third.document.steps.labels == tuple(labels)


def test_restored_draft_of_a_changed_file_begins_at_the_file(file, home):
    edited(file)
    file.write_text(THEIRS)
    for entry in (home / "armcontour" / "studio" / "recent").glob("*.json"):
        os.utime(entry)
    again = Editor(Document.open(file), CoarsePlanner(file.parent))
    again.restore()
    assert again.document.steps.labels[1:] == tuple(f"Speed {x}" for x in SPEEDS[:2])
    again.document.go_to_step(0)
    assert again.document.text == THEIRS
    again.document.go_to_step(1)
    assert again.document.text == TEXT


def test_long_texts_are_not_stored_with_all_their_steps(file, home):
    file.write_text(TEXT + f"# {'x' * 200_000}\n")
    edited(file)
    (draft,) = (x for x in all_recent() if x.text is not None)
    assert [x[0] for x in draft.steps] == ["Speed 0.16 m/s", "Speed 0.17 m/s"][-len(draft.steps) :]
    assert sum(len(x[1]) for x in draft.steps) <= MAX_STORED


def test_every_document_has_a_draft_of_its_own(tmp_path, home):
    drawing = tmp_path / "part.dxf"
    shutil.copy(DRAWINGS / "gasket.dxf", drawing)
    uploads = Uploads()
    job = TEXT.encode()
    dxf = (DRAWINGS / "gasket.dxf").read_bytes()
    openings = [
        lambda: Document.of_drawing(drawing, "ur5e"),
        lambda: Document.of_drawing(drawing, "ur10e"),
        lambda: uploads.open("job.yaml", job, None, tmp_path),
        lambda: uploads.open("plate.dxf", dxf, "ur5e", tmp_path),
        lambda: uploads.open("plate.dxf", dxf, "ur10e", tmp_path),
    ]
    texts = []
    for k, opening in enumerate(openings):
        document = opening()
        assert document.earlier_draft is None, k
        # A drawing without edits leaves no draft.
        assert not document.write_draft() and drafts(home) == texts[::-1]
        document.apply(
            change_data(document.data, [Change(("limits", "speed"), f"{k + 1} mm/s")]), "speed"
        )
        texts.append(document.text)
    assert [opening().earlier_draft.text for opening in openings[:2]] == texts[:2]
    # The drawings that drafts name outlive the session.
    uploads.close()
    for text in texts[-2:]:
        assert (tmp_path / load(text, "draft")["path"]["file"]).read_bytes() == dxf
    document.undo()
    assert drafts(home) == texts[-2::-1]


def test_a_job_is_saved_through_a_link_only_where_it_may_be_read(file, tmp_path_factory):
    target = tmp_path_factory.mktemp("home") / "job.yaml"
    before = file.read_text()
    target.write_text(before)
    document = faster(file)
    file.unlink()
    file.symlink_to(target)
    with reading_below([file.parent]), pytest.raises(InvalidInput):
        document.save(force=True)
    assert target.read_text() == before
    target.unlink()
    with pytest.raises(InvalidInput):
        document.save(force=True)
    assert not target.exists()
