"""Result folders: whole or not at all, and never over what somebody else wrote."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import threading
from pathlib import Path as FilePath

import pytest

from armcontour.errors import InvalidInput
from armcontour.io import ResultFolder

MANIFEST = ".armcontour.json"


def write(
    folder: FilePath, names: list[str], *, force: bool = False, text: str = "text of"
) -> None:
    with ResultFolder(folder, force=force) as results:
        for name in names:
            results.write(name, f"{text} {name}")
        results.write("summary.json", json.dumps({"files": [*results.files, "summary.json"]}))


def contents(folder: FilePath) -> set[str]:
    """All files, hidden ones too, without the list of files."""
    found = {str(x.relative_to(folder)) for x in folder.rglob("*") if not x.is_dir()}
    return {x for x in found if FilePath(x).name != MANIFEST}


def forge(folder: FilePath, names: list[str]) -> None:
    """A list of files as this program writes it, over files that it did not write."""
    files = {x: hashlib.sha256((folder / x).read_bytes()).hexdigest() for x in names}
    text = json.dumps({"armcontour": "0.1.0", "files": files})
    (folder / MANIFEST).write_text(text, encoding="utf-8")


def test_writes_into_a_new_folder_and_leaves_nothing_else(tmp_path: FilePath) -> None:
    write(tmp_path / "a" / "out", ["one/taught.csv", "report.html"])
    assert contents(tmp_path) == {
        "a/out/one/taught.csv",
        "a/out/report.html",
        "a/out/summary.json",
    }


def test_a_first_result_appears_at_once(tmp_path: FilePath) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with ResultFolder(out) as results:
        results.write("report.html", "report")
        assert not list(out.iterdir())
        assert (results.scratch).is_dir()
    assert contents(tmp_path) == {"out/report.html"}


def test_writes_into_the_folder_in_which_the_user_stands(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = tmp_path.stat().st_ino
    write(FilePath("."), ["report.html"])
    assert tmp_path.stat().st_ino == before
    assert contents(FilePath(".")) == {"report.html", "summary.json"}


def test_refuses_a_folder_with_something_in_it(tmp_path: FilePath) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InvalidInput, match="not empty.*--force"):
        ResultFolder(tmp_path)
    assert contents(tmp_path) == {"mine.txt"}


def test_force_replaces_the_earlier_result_and_nothing_else(tmp_path: FilePath) -> None:
    write(tmp_path, ["old/taught.csv", "report.html"])
    (tmp_path / "mine.txt").write_text("mine")
    write(tmp_path, ["new/taught.csv", "report.html"], force=True, text="newer")
    assert contents(tmp_path) == {"new/taught.csv", "report.html", "summary.json", "mine.txt"}
    assert not (tmp_path / "old").exists()
    assert (tmp_path / "report.html").read_text() == "newer report.html"


def test_a_result_of_the_same_kind_is_replaced_without_force(tmp_path: FilePath) -> None:
    for name in ("old.csv", "new.csv"):
        with ResultFolder(tmp_path / "out", replaces="demo") as results:
            results.write(name, "text")
    assert contents(tmp_path) == {"out/new.csv"}
    write(tmp_path / "out", ["report.html"], force=True)
    for kind in ("", "demo"):
        with pytest.raises(InvalidInput):
            ResultFolder(tmp_path / "out", replaces=kind)


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


@pytest.mark.parametrize(
    "summary",
    [
        {"files": ["thesis.tex", "data/raw.bin", "link/outside.txt"]},
        {"armcontour": "0.1.0", "files": ["thesis.tex"]},
        {"armcontour": "0.1.0", "files": {"thesis.tex": "0"}},
    ],
)
def test_force_removes_nothing_that_a_foreign_summary_names(
    tmp_path: FilePath, summary: dict[str, object]
) -> None:
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    (inside / "data").mkdir(parents=True)
    outside.mkdir()
    for file in (inside / "thesis.tex", inside / "data/raw.bin", outside / "outside.txt"):
        file.write_text("precious")
    (inside / "link").symlink_to("../outside")
    (inside / "summary.json").write_text(json.dumps(summary))
    before = contents(tmp_path)
    with pytest.raises(InvalidInput, match="holds no result of armcontour"):
        ResultFolder(inside, force=True)
    assert contents(tmp_path) == before


def test_force_follows_no_link_even_of_a_list_with_right_checksums(tmp_path: FilePath) -> None:
    out, outside = tmp_path / "out", tmp_path / "outside"
    write(out, ["report.html"])
    outside.mkdir()
    (outside / "outside.txt").write_text("precious")
    (out / "link").symlink_to("../outside")
    forge(out, ["report.html", "summary.json", "link/outside.txt"])
    write(out, ["report.html"], force=True)
    assert (outside / "outside.txt").read_text() == "precious"
    with pytest.raises(InvalidInput, match="link is not a folder of this result"):
        write(out, ["report.html", "link/taught.csv"], force=True)
    assert contents(outside) == {"outside.txt"}


@pytest.mark.parametrize("name", ["../precious.txt", "{folder}/precious.txt", "a/../../x", "a\\b"])
def test_a_list_of_files_cannot_name_files_outside(tmp_path: FilePath, name: str) -> None:
    (tmp_path / "precious.txt").write_text("precious")
    out = tmp_path / "out"
    write(out, ["report.html"])
    name = name.format(folder=tmp_path)
    checksum = hashlib.sha256(b"precious").hexdigest()
    text = json.dumps({"armcontour": "0.1.0", "files": {name: checksum}})
    (out / MANIFEST).write_text(text)
    with pytest.raises(InvalidInput, match="holds no result"):
        write(out, ["report.html"], force=True)
    assert (tmp_path / "precious.txt").exists()


def test_force_refuses_files_that_changed_since_they_were_written(tmp_path: FilePath) -> None:
    write(tmp_path, ["one/taught.csv", "report.html"])
    (tmp_path / "one" / "taught.csv").write_text("edited by hand")
    with pytest.raises(InvalidInput, match="one/taught.csv changed since armcontour wrote"):
        ResultFolder(tmp_path, force=True)
    assert (tmp_path / "one" / "taught.csv").read_text() == "edited by hand"


def test_force_refuses_files_that_change_while_a_run_goes_on(tmp_path: FilePath) -> None:
    write(tmp_path, ["one/taught.csv", "report.html"])
    file = tmp_path / "one" / "taught.csv"
    before, times = file.read_text(), file.stat()
    edited = before[::-1]
    assert edited != before
    with (
        pytest.raises(InvalidInput, match="one/taught.csv changed since armcontour wrote"),
        ResultFolder(tmp_path, force=True) as folder,
    ):
        folder.write("report.html", "newer")
        # Of the same length and age: the system knows that it was touched.
        file.write_text(edited)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert file.read_text() == edited


def test_force_writes_over_no_foreign_file(tmp_path: FilePath) -> None:
    write(tmp_path, ["report.html"])
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "taught.csv").write_text("foreign")
    with pytest.raises(InvalidInput, match="taught.csv: armcontour did not write"):
        write(tmp_path, ["report.html", "one/taught.csv"], force=True, text="newer")
    assert (tmp_path / "report.html").read_text() == "text of report.html"
    assert (tmp_path / "one" / "taught.csv").read_text() == "foreign"


def test_a_folder_in_the_way_is_seen_before_anything_is_moved(tmp_path: FilePath) -> None:
    write(tmp_path, ["one.csv"])
    (tmp_path / "two.csv").mkdir()
    with pytest.raises(InvalidInput, match="in the way"):
        write(tmp_path, ["one.csv", "two.csv"], force=True, text="newer")
    assert (tmp_path / "one.csv").read_text() == "text of one.csv"


def test_refuses_a_file_in_place_of_the_folder(tmp_path: FilePath) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InvalidInput, match="is a file, not a folder"):
        ResultFolder(tmp_path / "out")
    (tmp_path / "link").symlink_to("nowhere")
    with pytest.raises(InvalidInput, match="leads nowhere"):
        ResultFolder(tmp_path / "link")


def test_refuses_what_cannot_be_written(tmp_path: FilePath) -> None:
    (tmp_path / "file").write_text("a file")
    for name in ("out", "deep/er"):
        with pytest.raises(InvalidInput, match="Cannot write to the folder .*file is a file: cho"):
            ResultFolder(tmp_path / "file" / name)


@pytest.mark.parametrize("force", [False, True])
def test_a_second_run_into_the_same_folder_is_refused(tmp_path: FilePath, force: bool) -> None:
    out = tmp_path / "out"
    if force:
        write(out, ["report.html"])
    with ResultFolder(out, force=force) as first:
        with pytest.raises(InvalidInput, match="Another run is writing to"):
            ResultFolder(out, force=force)
        first.write("report.html", "the first")
    assert (out / "report.html").read_text() == "the first"
    assert contents(tmp_path) == {"out/report.html"}


def test_a_folder_that_was_filled_meanwhile_is_refused(tmp_path: FilePath) -> None:
    out = tmp_path / "out"
    with pytest.raises(InvalidInput, match="not empty any more"), ResultFolder(out) as results:
        results.write("report.html", "text")
        out.mkdir()
        (out / "mine.txt").write_text("mine")
    assert contents(tmp_path) == {"out/mine.txt"}


KILLED = """
import os, sys
from pathlib import Path
from armcontour.io import ResultFolder, results

moves = 0
def replace(a, b, inner=os.replace):
    global moves
    if moves == int(sys.argv[2]):
        os.kill(os.getpid(), 9)
    moves += 1
    inner(a, b)

with ResultFolder(Path(sys.argv[1]), force=True) as folder:
    for name in ("new/taught.csv", "report.html", "summary.json"):
        folder.write(name, f"newer {name}")
    os.replace = replace
print("not killed")
"""


@pytest.mark.parametrize("moves", range(6))
def test_a_killed_replacement_never_looks_whole_and_is_completed(
    tmp_path: FilePath, moves: int
) -> None:
    out = tmp_path / "out"
    write(out, ["old/taught.csv", "report.html"])
    (out / "mine.txt").write_text("mine")
    old = {x: (out / x).read_text() for x in contents(out)}
    command = [sys.executable, "-c", KILLED, str(out), str(moves)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    killed = "not killed" not in done.stdout
    assert killed == (moves < 5), done.stderr
    after = {x: (out / x).read_text() for x in contents(out) if not x.startswith(".armcontour")}
    assert after == old or "summary.json" not in after or not killed
    # The next run completes what was begun, then says that the folder is in use.
    with pytest.raises(InvalidInput, match="not empty"):
        ResultFolder(out)
    whole = {"new/taught.csv", "report.html", "summary.json", "mine.txt"}
    assert contents(out) == (set(old) if moves == 0 else whole)
    write(out, ["report.html"], force=True)
    assert contents(out) == {"report.html", "summary.json", "mine.txt"}


@pytest.mark.parametrize("name", ["thesis.tex", "summary.json", "old/thesis.tex"])
@pytest.mark.parametrize("result", [True, False])
def test_a_forged_journal_replaces_and_removes_no_foreign_file(
    tmp_path: FilePath, result: bool, name: str
) -> None:
    if result:
        write(tmp_path, ["report.html"])
    mine, forged = tmp_path / name, tmp_path / ".armcontour-next" / "new" / name
    for file in (mine, forged):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"text of {file}")
    text = mine.read_text()
    journal = forged.parents[len(FilePath(name).parts)] / "journal.json"
    stale = {name: hashlib.sha256(mine.read_bytes()).hexdigest()}
    for change in ({"stale": {}, "new": [name]}, {"stale": stale, "new": []}):
        journal.write_text(json.dumps(change))
        with pytest.raises(InvalidInput):
            ResultFolder(tmp_path)
        assert mine.read_text() == text
        journal.parent.mkdir(exist_ok=True)


def test_a_replacement_that_the_system_stops_is_completed_by_the_next_run(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path, ["old.csv", "report.html"])
    moves = 0
    inner = os.replace

    def replace(source: FilePath, target: FilePath) -> None:
        nonlocal moves
        moves += 1
        if moves == 3:
            raise OSError(5, os.strerror(5))
        inner(source, target)

    with monkeypatch.context() as patch, pytest.raises(InvalidInput, match="Input/output error"):
        patch.setattr(os, "replace", replace)
        write(tmp_path, ["new.csv", "report.html"], force=True, text="newer")
    assert not (tmp_path / "summary.json").exists()
    with pytest.raises(InvalidInput, match="not empty"):
        ResultFolder(tmp_path)
    assert contents(tmp_path) == {"new.csv", "report.html", "summary.json"}
    assert (tmp_path / "report.html").read_text() == "newer report.html"


def test_what_a_killed_first_run_left_is_cleared(tmp_path: FilePath) -> None:
    out = tmp_path / "out"
    code = KILLED.replace("os.replace = replace", "os.kill(os.getpid(), 9)")
    subprocess.run([sys.executable, "-c", code, str(out), "0"], timeout=60)
    assert any(x.startswith(".armcontour-out-") for x in os.listdir(tmp_path))
    write(out, ["report.html"])
    assert contents(tmp_path) == {"out/report.html", "out/summary.json"}


def test_many_runs_at_once_into_one_folder(tmp_path: FilePath) -> None:
    out = tmp_path / "out"
    ended: list[str] = []
    gate = threading.Barrier(8)

    def attempt(i: int) -> None:
        gate.wait()
        try:
            write(out, [f"{i}.csv"])
            ended.append("written")
        except InvalidInput:
            ended.append("refused")

    threads = [threading.Thread(target=attempt, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(ended) == ["refused"] * 7 + ["written"]
    assert len(contents(tmp_path)) == 2
