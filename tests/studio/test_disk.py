"""Job files and their drafts on disk."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest

from armcontour._files import reading_below
from armcontour.errors import InvalidInput
from armcontour.io.job_edits import Change
from armcontour.studio.document import Document

FASTER = [Change(("limits", "speed"), "0.2 m/s")]


def test_a_link_to_a_job_file_stays_a_link(file: Path, tmp_path: Path) -> None:
    link = tmp_path / "link.yaml"
    link.symlink_to(file)
    document = Document.open(link)
    document.apply(FASTER, "speed")
    document.save()
    assert link.is_symlink() and file.read_text() == document.text


def test_a_draft_survives_until_the_job_is_saved(file: Path) -> None:
    document = Document.open(file)
    assert document.earlier_draft() is None
    document.apply(FASTER, "speed")
    assert document.earlier_draft() == document.text
    document.undo()
    assert document.earlier_draft() is None and not (file.parent / ".armcontour").exists()
    document.redo()
    # A draft that is older than the file is not offered.
    os.utime(file.parent / ".armcontour" / "job.draft.yaml", (1, 1))
    assert document.earlier_draft() is None
    document.undo()
    document.redo()
    again = Document.open(file)
    again.replace(again.earlier_draft() or "", "draft")
    assert again.text == document.text
    again.save()
    assert document.earlier_draft() is None and not (file.parent / ".armcontour").exists()


def test_a_drawing_that_was_only_looked_at_leaves_no_draft(tmp_path: Path) -> None:
    drawing, folder = tmp_path / "part.dxf", tmp_path / ".armcontour"
    shutil.copy(Path(__file__).parents[2] / "examples" / "drawings" / "gasket.dxf", drawing)
    document = Document.of_drawing(drawing, "ur5e")
    assert document.dirty and not document.write_draft() and not folder.exists()
    document.apply([Change(("limits", "speed"), "0.2 m/s")], "speed")
    assert Document.of_drawing(drawing, "ur5e").earlier_draft() == document.text
    document.undo()
    assert not folder.exists()
    # What another version of the tool left is no change either.
    folder.mkdir()
    (folder / "part.draft.yaml").write_text(document.text)
    assert Document.of_drawing(drawing, "ur5e").earlier_draft() is None
    # Once it is saved otherwise, the first text is a change.
    document.redo()
    document.save()
    document.undo()
    assert Document.open(tmp_path / "part.yaml").earlier_draft() == document.text


def test_a_folder_that_cannot_be_written_to_has_no_draft(file: Path) -> None:
    document = Document.open(file)
    (file.parent / ".armcontour").write_text("no folder")
    document.apply(FASTER, "speed")
    assert document.can_undo and not document.write_draft()
    shutil.rmtree(file.parent)
    with pytest.raises(InvalidInput, match="Cannot write .*job.yaml: "):
        document.save()


@pytest.mark.parametrize("linked", ["draft", "dangling draft", "folder"])
def test_a_draft_is_never_written_read_or_removed_through_a_link(
    file: Path, tmp_path_factory: pytest.TempPathFactory, linked: str
) -> None:
    home, folder = tmp_path_factory.mktemp("home"), file.parent / ".armcontour"
    target, kept = home / "job.draft.yaml", "name: kept\n"
    if linked != "dangling draft":
        target.write_text(kept)
    if linked == "folder":
        folder.symlink_to(home)
    else:
        folder.mkdir()
        (folder / "job.draft.yaml").symlink_to(target)
    document = Document.open(file)
    assert document.earlier_draft() is None
    document.apply(FASTER, "speed")
    assert list(home.iterdir()) == ([] if linked == "dangling draft" else [target])
    assert linked == "dangling draft" or target.read_text() == kept
    # In a real folder the link is replaced by the draft.
    assert document.write_draft() == (linked != "folder")
    assert (document.earlier_draft() == document.text) == (linked != "folder")
    document.undo()
    assert linked == "dangling draft" or target.read_text() == kept


def test_a_job_is_saved_through_a_link_only_where_it_may_be_read(
    file: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    target = tmp_path_factory.mktemp("home") / "job.yaml"
    target.write_text(file.read_text())
    document = Document.open(file)
    document.apply(FASTER, "speed")
    before = target.read_text()
    file.unlink()
    file.symlink_to(target)
    with reading_below([file.parent]), pytest.raises(InvalidInput):
        document.save(force=True)
    assert target.read_text() == before
    target.unlink()
    with pytest.raises(InvalidInput):
        document.save(force=True)
    assert not target.exists()
