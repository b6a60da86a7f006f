"""Result folders: complete or absent, never over other files, and reading."""

import hashlib
import json
import os
from functools import partial
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac
from armcontour.core.errors import InvalidInput
from armcontour.files import ResultFolder, write_planned, write_set_points
from armcontour.files.exports import make_table
from armcontour.files.result_folder import SUMMARY
from armcontour.files.trajectory_file import read_run
from armcontour.jobs.methods import COMPENSATIONS

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
    names = {str(x.relative_to(folder)) for x in folder.rglob("*") if not x.is_dir()}
    return {x for x in names if FilePath(x).name != MANIFEST}


def test_a_first_result_appears_as_a_whole_and_leaves_no_other_files(tmp_path, monkeypatch):
    out = tmp_path / "a" / "out"
    write(out, ["one/set_points.csv", "report.html"])
    names = {"one/set_points.csv", "report.html", "summary.json"}
    assert contents(tmp_path) == {f"a/out/{x}" for x in names}
    out = tmp_path / "out"
    out.mkdir()
    with ResultFolder(out) as results:
        results.write("report.html", "report")
        assert not (out / "report.html").exists()
    assert contents(out) == {"report.html"}
    # Also in the current folder.
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    write(FilePath("."), ["report.html"])
    assert contents(FilePath(".")) == {"report.html", "summary.json"}


def test_force_replaces_only_the_earlier_result(tmp_path):
    out = tmp_path / "out"
    write(out, ["old/set_points.csv", "report.html"])
    (out / "mine.txt").write_text("mine")
    with pytest.raises(InvalidInput, match="not empty.*--force"):
        ResultFolder(out)
    write(out, ["new/set_points.csv", "report.html"], force=True, text="newer")
    assert contents(out) == {"new/set_points.csv", "report.html", "summary.json", "mine.txt"}
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


def test_force_deletes_nothing_outside_of_the_folder(tmp_path):
    """Also with a list of files as this program writes it, over files that it did not write."""
    out = tmp_path / "out"
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious.txt").write_text("precious")
    checksum = hashlib.sha256(b"precious").hexdigest()
    for i, name in enumerate(("link/precious.txt", "../outside/precious.txt", "a/../../x", "a\\b")):
        write(out / str(i), ["report.html"])
        (out / str(i) / "link").symlink_to("../../outside")
        listed = json.loads((out / str(i) / MANIFEST).read_text())
        for extra in (name, f"{outside}/precious.txt", "", "."):
            listed["files"][extra] = checksum
        (out / str(i) / MANIFEST).write_text(json.dumps(listed))
        if i == 0:
            refused("changed since: link", out / "0")
        else:
            write(out / str(i), ["report.html"], force=True)
        assert contents(outside) == {"precious.txt"}


def test_force_refuses_files_that_changed_since_they_were_written(tmp_path):
    words = "changed since: one/set_points.csv"
    write(tmp_path, ["one/set_points.csv", "report.html"])
    file = tmp_path / "one" / "set_points.csv"
    edited = file.read_text()[::-1]
    with pytest.raises(InvalidInput, match=words), ResultFolder(tmp_path, force=True) as folder:
        folder.write("report.html", "newer")
        file.write_text(edited)
    assert file.read_text() == edited
    refused(words, tmp_path)
    assert file.read_text() == edited


def test_folders_that_cannot_be_written_are_refused(tmp_path):
    (tmp_path / "out").write_text("a file")
    (tmp_path / "link").symlink_to("nowhere")
    for name, words in (
        ("out", "is not a folder"),
        ("link", "is not a folder"),
        ("out/in", "Cannot write to the folder .*out/in: Not a directory"),
        ("out/deep/er", "Cannot write to the folder .*out/deep/er: Not a directory"),
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


def fail_at(patch, counts, error, *, after=False):
    """Let some renames, by their numbers from 0, raise an error before or after them."""
    made = iter(range(99))
    inner = os.rename

    def rename(source, target):
        fails = next(made) in counts
        if not fails or after:
            inner(source, target)
        if fails:
            raise error

    patch.setattr(os, "rename", rename)


@pytest.mark.parametrize("count", range(8))
@pytest.mark.parametrize("error", [OSError(5, "Input/output error"), KeyboardInterrupt()])
def test_a_replacement_that_is_stopped_leaves_the_earlier_result(
    tmp_path, monkeypatch, count, error
):
    write(tmp_path, ["old/set_points.csv", "report.html"])
    (tmp_path / "mine.txt").write_text("mine")
    old = {x: (tmp_path / x).read_text() for x in contents(tmp_path)}
    names = ["new/set_points.csv", "report.html"]
    # Ctrl-C comes after a rename, an error instead of one.
    with monkeypatch.context() as patch:
        fail_at(patch, [count], error, after=isinstance(error, KeyboardInterrupt))
        with pytest.raises((InvalidInput, KeyboardInterrupt), match="Input/output error|^$"):
            write(tmp_path, names, force=True, text="newer")
    assert {x: (tmp_path / x).read_text() for x in contents(tmp_path)} == old
    write(tmp_path, ["report.html"], force=True, text="newer")
    assert contents(tmp_path) == {"report.html", "summary.json", "mine.txt"}
    assert (tmp_path / "report.html").read_text() == "newer report.html"


CYCLE = 0.004
ARM = ac.load_arm("pmk3s")


@pytest.mark.parametrize("method", ["none", "inverse"])
def test_an_earlier_result_is_exported_with_the_derivatives_of_its_run(method, tmp_path):
    path = ac.Path.polyline([(0.35, 0.1), (0.36, 0.11)])
    planned = ac.plan(path, ARM, ac.Limits(joint_acceleration=0.72, joint_jerk=7.2))
    assert planned.duration % CYCLE > 1e-6
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    set_points = ac.compensate(planned, servo, COMPENSATIONS[method](), cycle=CYCLE)
    runs = {"a": {"cycle": CYCLE, "compensation": method}}
    about = {"job": "line", "arm": {"joints": ARM.joint_names}, "runs": runs}
    with ResultFolder(tmp_path / "out") as folder:
        names = ARM.joint_names
        samples = planned.sample(CYCLE)
        folder.write_with(SUMMARY, lambda file: file.write_text(json.dumps(about)))
        folder.write_with(
            "a/set_points.csv", partial(write_set_points, set_points=set_points, joint_names=names)
        )
        folder.write_with(
            "a/planned.csv", partial(write_planned, samples=samples, joint_names=names)
        )
    for derivatives in (1, 2):
        from_file = read_run(tmp_path / "out").set_points(derivatives=derivatives)
        expected = make_table(set_points, name="x", derivatives=derivatives)
        np.testing.assert_array_equal(from_file.t, expected.t)
        np.testing.assert_allclose(from_file.dq, expected.dq, atol=2e-9)
    # Set-points have 12 decimals in a result, the derivatives of a spline follow.
    atol = 1e-11 if method == "none" else 2e-6
    np.testing.assert_allclose(from_file.ddq, expected.ddq, atol=atol)


def test_a_refused_folder_is_not_locked(tmp_path, monkeypatch):
    def fail(*_, **options):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(FilePath, "mkdir", lambda x, *_, **y: fail() if x.name[0] == "." else None)
        with pytest.raises(InvalidInput, match="No space left on device; free some space"):
            ResultFolder(tmp_path)
    write(tmp_path, ["report.html"])
    assert contents(tmp_path) == {"report.html", "summary.json"}


def test_a_record_remains_only_if_the_command_fails(tmp_path):
    out = tmp_path / "out"
    with ResultFolder(out) as results:
        record = results.begin_record("unfinished.csv", "t,q1\n")
        record.write_text("t,q1\n0,0\n")
        results.write("log.csv", "log")
    assert contents(out) == {"log.csv"}
    with pytest.raises(RuntimeError), ResultFolder(out, force=True) as results:
        results.begin_record("unfinished.csv", "t,q1\n")
        raise RuntimeError("Nothing was recorded.")
    assert contents(out) == {"log.csv"}
    with pytest.raises(RuntimeError), ResultFolder(out, force=True) as results:
        results.begin_record("unfinished.csv", "t,q1\n").write_text("t,q1\n0,0\n")
        results.write("log.csv", "newer")
        raise RuntimeError("The command has failed.")
    assert contents(out) == {"log.csv", "unfinished.csv"}
    assert (out / "log.csv").read_text() == "log"
    with pytest.raises(InvalidInput, match="Move it"), ResultFolder(out, force=True) as results:
        results.begin_record("unfinished.csv", "t,q1\n")
    assert (out / "unfinished.csv").read_text() == "t,q1\n0,0\n"
