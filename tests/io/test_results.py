"""Result folders: whole or not at all, and never over an earlier one unasked."""

from __future__ import annotations

import json
from pathlib import Path as FilePath

import pytest

from armcontour.errors import InvalidInput
from armcontour.io import ResultFolder


def write(folder: FilePath, names: list[str], *, force: bool = False) -> None:
    with ResultFolder(folder, force=force) as results:
        for name in names:
            results.write(name, f"text of {name}")
        results.write("summary.json", json.dumps({"files": [*results.files, "summary.json"]}))


def contents(folder: FilePath) -> set[str]:
    return {str(x.relative_to(folder)) for x in folder.rglob("*") if x.is_file()}


def test_writes_into_a_new_folder_and_leaves_nothing_else(tmp_path: FilePath) -> None:
    write(tmp_path / "a" / "out", ["one/taught.csv", "report.html"])
    assert contents(tmp_path) == {
        "a/out/one/taught.csv",
        "a/out/report.html",
        "a/out/summary.json",
    }


def test_refuses_a_folder_with_something_in_it(tmp_path: FilePath) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InvalidInput, match="not empty.*--force"):
        ResultFolder(tmp_path)
    assert contents(tmp_path) == {"mine.txt"}


def test_force_replaces_the_earlier_result_and_nothing_else(tmp_path: FilePath) -> None:
    write(tmp_path, ["old/taught.csv", "report.html"])
    (tmp_path / "mine.txt").write_text("mine")
    write(tmp_path, ["new/taught.csv", "report.html"], force=True)
    assert contents(tmp_path) == {"new/taught.csv", "report.html", "summary.json", "mine.txt"}


def test_an_error_leaves_the_earlier_result_as_it_was(tmp_path: FilePath) -> None:
    write(tmp_path, ["report.html"])
    with (
        pytest.raises(RuntimeError, match="halfway"),
        ResultFolder(tmp_path, force=True) as results,
    ):
        results.write("report.html", "half a report")
        raise RuntimeError("halfway")
    assert contents(tmp_path) == {"report.html", "summary.json"}
    assert (tmp_path / "report.html").read_text() == "text of report.html"


def test_a_summary_cannot_name_files_outside(tmp_path: FilePath) -> None:
    (tmp_path / "precious.txt").write_text("precious")
    out = tmp_path / "out"
    out.mkdir()
    (out / "summary.json").write_text(json.dumps({"files": ["../precious.txt", "/etc/hosts", 3]}))
    write(out, ["report.html"], force=True)
    assert (tmp_path / "precious.txt").exists()


def test_a_folder_in_the_way_is_seen_before_anything_is_moved(tmp_path: FilePath) -> None:
    write(tmp_path, ["one.csv"])
    (tmp_path / "two.csv").mkdir()
    (tmp_path / "one.csv").write_text("as it was")
    with pytest.raises(InvalidInput, match="in the way"):
        write(tmp_path, ["one.csv", "two.csv"], force=True)
    assert (tmp_path / "one.csv").read_text() == "as it was"


def test_refuses_a_file_in_place_of_the_folder(tmp_path: FilePath) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InvalidInput, match="is a file, not a folder"):
        ResultFolder(tmp_path / "out")


def test_refuses_what_cannot_be_written(tmp_path: FilePath) -> None:
    (tmp_path / "file").write_text("a file")
    for name in ("out", "deep/er"):
        with pytest.raises(InvalidInput, match="Cannot write to the folder .*file is a file: cho"):
            ResultFolder(tmp_path / "file" / name)
