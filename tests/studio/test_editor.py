"""The document that is edited."""

from __future__ import annotations

from pathlib import Path

import pytest
from tests.studio.talking import JOB, MOVE

from armcontour.errors import InvalidInput
from armcontour.io.job_edits import Change
from armcontour.studio.document import Document
from armcontour.studio.editor import Editor, Made
from armcontour.studio.preview import Previewer


@pytest.fixture
def editor(file: Path) -> Editor:
    return Editor(Document.open(file), Previewer(file.parent), [])


def test_what_cannot_be_made_changes_neither_text_nor_run(editor: Editor) -> None:
    editor.select("fast")
    before = editor.rev, editor.run, editor.seen
    made = editor.with_changes([Change(("runs", "fast")), Change(("limits", "speed"), "0 m/s")])
    with pytest.raises(InvalidInput, match=r"limits\.speed"):
        editor.commit(made, "remove", run="")
    assert (editor.rev, editor.run, editor.seen) == before
    assert editor.document.text == JOB and not editor.document.can_undo


def test_a_change_is_seen_and_counted(editor: Editor) -> None:
    editor.commit(editor.edited([MOVE]), "move", run="fast")
    assert (editor.rev, editor.run) == (2, "fast")
    assert editor.seen.data == editor.document.data != Document.of_text(JOB, None, "job").data
    editor.undo()
    assert (editor.rev, editor.document.text) == (3, JOB)
    with pytest.raises(InvalidInput, match="no run none"):
        editor.select("none")


def test_a_request_has_the_text_that_edits_would_make(editor: Editor) -> None:
    request = editor.request(editor.edited([MOVE]), {"key": 1})
    assert "400 mm, 160 mm" in request["text"] and editor.document.text == JOB
    assert (request["run"], request["options"]) == ("slow", {"key": 1})
    text = JOB.replace("small", "other")
    assert editor.request(editor.of_text(text), {})["text"] == text
    assert editor.request(Made(editor.seen.data), {})["text"] == JOB
