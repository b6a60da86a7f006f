"""Result folders: whole or not at all, never over foreign files, and what is read of them."""

import hashlib
import json
import os
from functools import partial
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.io import ResultFolder
from armcontour.io.exports import make_table
from armcontour.io.motion_csv import write_planned, write_taught
from armcontour.io.results import SUMMARY
from armcontour.io.stored_run import read_run

MANIFEST = ".armcontour.json"


def write(folder, names, *, force=False, text="text of"):
    with ResultFolder(folder, force=force) as results:
        for name in names:
            results.write(name, f"{text} {name}")
        results.write("summary.json", json.dumps({"files": [*results.files, "summary.json"]}))


def refused(words, folder, names=("report.html",), **options):
    with pytest.raises(InvalidInput, match=words):
        write(folder, names, force=True, text="newer", **options)


def contents(folder):
    """All files, hidden ones too, without the list of files."""
    found = {str(x.relative_to(folder)) for x in folder.rglob("*") if not x.is_dir()}
    return {x for x in found if FilePath(x).name != MANIFEST}


def test_a_first_result_appears_at_once_and_leaves_nothing_else(tmp_path):
    out = tmp_path / "a" / "out"
    write(out, ["one/taught.csv", "report.html"])
    names = {"one/taught.csv", "report.html", "summary.json"}
    assert contents(tmp_path) == {f"a/out/{x}" for x in names}
    out = tmp_path / "out"
    out.mkdir()
    with ResultFolder(out) as results:
        results.write("report.html", "report")
        assert not list(out.iterdir())
        assert results.scratch.is_dir()
    assert contents(out) == {"report.html"}


def test_writes_into_the_folder_in_which_the_user_stands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = tmp_path.stat().st_ino
    write(FilePath("."), ["report.html"])
    assert tmp_path.stat().st_ino == before
    assert contents(FilePath(".")) == {"report.html", "summary.json"}


def test_force_replaces_the_earlier_result_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    write(out, ["old/taught.csv", "report.html"])
    (out / "mine.txt").write_text("mine")
    with pytest.raises(InvalidInput, match="not empty.*--force"):
        ResultFolder(out)
    write(out, ["new/taught.csv", "report.html"], force=True, text="newer")
    assert contents(out) == {"new/taught.csv", "report.html", "summary.json", "mine.txt"}
    assert not (out / "old").exists()
    assert (out / "report.html").read_text() == "newer report.html"


def test_a_result_of_the_same_kind_is_replaced_without_force(tmp_path):
    for name in ("old.csv", "new.csv"):
        with ResultFolder(tmp_path / "out", replaces="demo") as results:
            results.write(name, "text")
    assert contents(tmp_path) == {"out/new.csv"}
    write(tmp_path / "out", ["report.html"], force=True)
    for kind in ("", "demo"):
        with pytest.raises(InvalidInput):
            ResultFolder(tmp_path / "out", replaces=kind)


def test_an_error_leaves_the_earlier_result_as_it_was(tmp_path):
    write(tmp_path, ["report.html"])
    halfway = pytest.raises(RuntimeError, match="halfway")
    with halfway, ResultFolder(tmp_path, force=True) as results:
        results.write("report.html", "half a report")
        raise RuntimeError("halfway")
    assert contents(tmp_path) == {"report.html", "summary.json"}
    assert (tmp_path / "report.html").read_text() == "text of report.html"


def test_force_removes_nothing_that_a_foreign_summary_names(tmp_path):
    inside, outside = tmp_path / "inside", tmp_path / "outside"
    (inside / "data").mkdir(parents=True)
    outside.mkdir()
    for file in (inside / "thesis.tex", inside / "data/raw.bin", outside / "outside.txt"):
        file.write_text("precious")
    (inside / "link").symlink_to("../outside")
    for summary in (
        {"files": ["thesis.tex", "data/raw.bin", "link/outside.txt"]},
        {"armcontour": "0.1.0", "files": ["thesis.tex"]},
        {"armcontour": "0.1.0", "files": {"thesis.tex": "0"}},
    ):
        (inside / "summary.json").write_text(json.dumps(summary))
        before = contents(tmp_path)
        refused("holds no result of armcontour", inside)
        assert contents(tmp_path) == before


def test_force_follows_no_link_even_of_a_list_with_right_checksums(tmp_path):
    out, outside = tmp_path / "out", tmp_path / "outside"
    write(out, ["report.html"])
    outside.mkdir()
    (outside / "outside.txt").write_text("precious")
    (out / "link").symlink_to("../outside")
    # A list of files as this program writes it, over files that it did not write.
    names = ("report.html", "summary.json", "link/outside.txt")
    files = {x: hashlib.sha256((out / x).read_bytes()).hexdigest() for x in names}
    (out / MANIFEST).write_text(json.dumps({"armcontour": "0.1.0", "files": files}))
    write(out, ["report.html"], force=True)
    assert (outside / "outside.txt").read_text() == "precious"
    refused("link is not a folder of this result", out, ["report.html", "link/taught.csv"])
    assert contents(outside) == {"outside.txt"}


def test_a_list_of_files_cannot_name_files_outside(tmp_path):
    (tmp_path / "precious.txt").write_text("precious")
    out = tmp_path / "out"
    write(out, ["report.html"])
    checksum = hashlib.sha256(b"precious").hexdigest()
    for name in ("../precious.txt", f"{tmp_path}/precious.txt", "a/../../x", "a\\b"):
        text = json.dumps({"armcontour": "0.1.0", "files": {name: checksum}})
        (out / MANIFEST).write_text(text)
        refused("holds no result", out)
        assert (tmp_path / "precious.txt").exists()


def test_force_refuses_files_that_changed_since_they_were_written(tmp_path):
    words = "one/taught.csv changed since armcontour wrote"
    write(tmp_path, ["one/taught.csv", "report.html"])
    file = tmp_path / "one" / "taught.csv"
    edited, times = file.read_text()[::-1], file.stat()
    assert edited != file.read_text()
    with pytest.raises(InvalidInput, match=words), ResultFolder(tmp_path, force=True) as folder:
        folder.write("report.html", "newer")
        # Of the same length and age: the system knows that it was touched.
        file.write_text(edited)
        os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert file.read_text() == edited
    refused(words, tmp_path)
    assert file.read_text() == edited


def test_force_writes_over_no_foreign_file_and_no_folder(tmp_path):
    write(tmp_path, ["report.html"])
    (tmp_path / "one").mkdir()
    (tmp_path / "one" / "taught.csv").write_text("foreign")
    (tmp_path / "two.csv").mkdir()
    refused("taught.csv: armcontour did not write", tmp_path, ["report.html", "one/taught.csv"])
    refused("in the way", tmp_path, ["report.html", "two.csv"])
    assert (tmp_path / "report.html").read_text() == "text of report.html"
    assert (tmp_path / "one" / "taught.csv").read_text() == "foreign"


def test_refuses_what_is_no_folder_or_cannot_be_written(tmp_path):
    (tmp_path / "out").write_text("a file")
    (tmp_path / "link").symlink_to("nowhere")
    for name, words in (
        ("out", "is a file, not a folder"),
        ("link", "leads nowhere"),
        ("out/in", "Cannot write to the folder .*out is a file"),
        ("out/deep/er", "Cannot write to the folder .*out is a file"),
    ):
        with pytest.raises(InvalidInput, match=words):
            ResultFolder(tmp_path / name)


@pytest.mark.parametrize("force", [False, True])
def test_a_second_run_into_the_same_folder_is_refused(tmp_path, force):
    out = tmp_path / "out"
    if force:
        write(out, ["report.html"])
    with ResultFolder(out, force=force) as first:
        with pytest.raises(InvalidInput, match="Another run is writing to"):
            ResultFolder(out, force=force)
        first.write("report.html", "the first")
    assert (out / "report.html").read_text() == "the first"
    assert contents(tmp_path) == {"out/report.html"}


def test_a_folder_that_was_filled_meanwhile_is_refused(tmp_path):
    out = tmp_path / "out"
    with pytest.raises(InvalidInput, match="not empty any more"), ResultFolder(out) as results:
        results.write("report.html", "text")
        out.mkdir()
        (out / "mine.txt").write_text("mine")
    assert contents(tmp_path) == {"out/mine.txt"}


def test_a_forged_journal_replaces_and_removes_no_foreign_file(tmp_path):
    for i, name in enumerate(["thesis.tex", "summary.json", "old/thesis.tex"] * 2):
        out = tmp_path / str(i)
        if i < 3:
            write(out, ["report.html"])
        mine, forged = out / name, out / ".armcontour-next" / "new" / name
        for file in (mine, forged):
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(f"text of {file}")
        text = mine.read_text()
        journal = forged.parents[len(FilePath(name).parts)] / "journal.json"
        stale = {name: hashlib.sha256(mine.read_bytes()).hexdigest()}
        for change in ({"stale": {}, "new": [name]}, {"stale": stale, "new": []}):
            journal.write_text(json.dumps(change))
            with pytest.raises(InvalidInput):
                ResultFolder(out)
            assert mine.read_text() == text
            journal.parent.mkdir(exist_ok=True)


@pytest.mark.parametrize("moves", range(6))
def test_a_replacement_that_the_system_stops_is_completed_by_the_next_run(
    tmp_path, monkeypatch, moves
):
    out = tmp_path / "out"
    write(out, ["old/taught.csv", "report.html"])
    (out / "mine.txt").write_text("mine")
    old = {x: (out / x).read_text() for x in contents(out)}
    made, inner = 0, os.replace

    def replace(source, target):
        nonlocal made
        if made == moves:
            raise OSError(5, os.strerror(5))
        made += 1
        inner(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", replace)
        if moves < 5:
            refused("Input/output error", out, ["new/taught.csv", "report.html"])
        else:
            write(out, ["new/taught.csv", "report.html"], force=True, text="newer")
    assert made == min(moves, 5)
    after = {x: (out / x).read_text() for x in contents(out) if not x.startswith(".armcontour")}
    assert after == old or "summary.json" not in after or moves == 5
    # The next run completes what was begun, then says that the folder is in use.
    with pytest.raises(InvalidInput, match="not empty"):
        ResultFolder(out)
    whole = {"new/taught.csv", "report.html", "summary.json", "mine.txt"}
    assert contents(out) == (set(old) if moves == 0 else whole)
    assert moves == 0 or (out / "report.html").read_text() == "newer report.html"
    write(out, ["report.html"], force=True)
    assert contents(out) == {"report.html", "summary.json", "mine.txt"}


PERIOD = 0.004
ARM = ac.load_arm("pmk3s")


@pytest.mark.parametrize("method", ["none", "inverse"])
def test_an_earlier_result_has_the_derivatives_that_its_run_had(method, tmp_path):
    path = ac.Path.polyline([(0.35, 0.1), (0.36, 0.11)])
    planned = ac.plan(path, ARM, ac.Limits(joint_acceleration=0.72, joint_jerk=7.2))
    assert planned.duration % PERIOD > 1e-6
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    taught = ac.compensate(planned, servo, method=method, period=PERIOD)
    runs = {"a": {"period": PERIOD, "compensation": method}}
    about = {"job": "line", "arm": {"joints": ARM.joint_names}, "runs": runs}
    with ResultFolder(tmp_path / "out") as folder:
        names, samples = ARM.joint_names, planned.sample(PERIOD)
        folder.place(SUMMARY, lambda file: file.write_text(json.dumps(about)))
        folder.place("a/taught.csv", partial(write_taught, taught=taught, joint_names=names))
        folder.place("a/planned.csv", partial(write_planned, x=samples, joint_names=names))
    for derivatives in (1, 2):
        found = read_run(tmp_path / "out").taught(derivatives=derivatives)
        expected = make_table(taught, name="x", derivatives=derivatives)
        np.testing.assert_array_equal(found.t, expected.t)
        np.testing.assert_allclose(found.dq, expected.dq, atol=2e-9)
    # Set-points have 12 decimals in a result, the derivatives of a spline follow.
    atol = 1e-11 if method == "none" else 2e-6
    np.testing.assert_allclose(found.ddq, expected.ddq, atol=atol)
