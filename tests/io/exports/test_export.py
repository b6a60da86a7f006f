"""Export: formats by name and ending, whole files or none, the same bytes every time."""

import os
import re
import sys
import warnings
from pathlib import Path as FilePath

import numpy as np
import pandas as pd
import pytest
from tests.io.tables import refusals

from armcontour.errors import InvalidInput
from armcontour.io.exports import export, exporting, formats, write_table
from armcontour.io.exports.destination import put

PLAIN = [(x, end) for x, end in formats().items() if x != "template"]


@pytest.fixture
def six(taught):
    events = taught(np.zeros((1, 1))).trajectory.events
    return taught(
        np.random.default_rng(0).normal(size=(20, 6)),
        events=tuple(x for x in events if x.name != "label"),
    )


def bytes_of(place):
    files = [place] if place.is_file() else sorted(place.rglob("*"))
    return {x.name: x.read_bytes() for x in files if x.is_file()}


@pytest.mark.filterwarnings("ignore:.*switched for gas")
def test_the_ending_or_the_name_says_the_format_and_bytes_are_the_same_twice(six, tmp_path):
    for form, ending in PLAIN:
        first, second = (tmp_path / f"{x}{form}" / f"part{ending}" for x in "ab")
        for place in (first, second):
            place.parent.mkdir()
        outputs = {"tool": 0} if form == "urscript" else None
        export(six, first, outputs=outputs)
        export(six, str(second), format=form, outputs=outputs)
        assert bytes_of(first) and bytes_of(first) == bytes_of(second)
        # Once more, over what is there.
        export(six, first, outputs=outputs)
        assert bytes_of(first) == bytes_of(second)
        assert [x.name for x in first.parent.iterdir()] == [first.name]


def test_events_without_an_output_are_warned_of_once(taught, six, tmp_path):
    with pytest.warns(UserWarning, match="switched for gas,"):
        export(six, tmp_path / "part.src", template="kuka", outputs={"tool": 17})
    assert "DEF part( )" in (tmp_path / "part.src").read_text()
    q = np.zeros((20, 6))
    switches = tuple(x for x in taught(q).trajectory.events if x.name == "tool")
    given, place = taught(q, events=switches), tmp_path / "part.txt"
    for kind in ({"template": "kuka"}, {"template": "abb"}, {"format": "urscript"}):
        with pytest.warns(UserWarning, match="nothing is switched for tool,") as told:
            export(given, place, **kind)
        assert len(told) == 1 and told[0].filename == __file__
    # Values that these programs cannot switch.
    with pytest.warns(UserWarning, match="gas, label, whose values are not on or off"):
        export(taught(q), place, template="abb", outputs={"tool": "doTool"})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(given, place, template="abb", outputs={"tool": "doTool"})
        export(taught(q, events=()), place, template="kuka")
        export(given, tmp_path / "part.csv")
        # Templates of users may switch events by their names.
        own = tmp_path / "own.txt.j2"
        own.write_text("{% for x in events %}{{ x.name }}{% endfor %}")
        export(given, place, template=own)


def test_nothing_is_written_where_warnings_are_errors(six, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match="Template kuka: nothing is switched for"):
            export(six, tmp_path / "part.src", template="kuka")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".src", ".script"])
def test_programs_that_do_not_set_an_analog_output_warn(taught, tmp_path, ending):
    given = taught(np.zeros((20, 6)), events=())
    options = {"analog": {"power": lambda t: 0 * t}}
    options |= {"template": "kuka"} if ending == ".src" else {}
    with pytest.warns(UserWarning, match="does not set power"):
        export(given, tmp_path / f"part{ending}", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(given, tmp_path / f"part{ending}", outputs={"power": 1}, **options)
    assert re.search(r"ANOUT\[1\]|analog_out\(1,", (tmp_path / f"part{ending}").read_text())


def test_the_uncompensated_reference_is_exported_every_period(conventional, arm, tmp_path):
    export(conventional, tmp_path / "part.csv", arm=arm, period=0.01)
    found = pd.read_csv(tmp_path / "part.csv")
    t = found["t [s]"].to_numpy()
    np.testing.assert_allclose(np.diff(t)[:-1], 0.01, atol=1e-11)
    np.testing.assert_allclose(t[-1], conventional.duration, atol=1e-11)
    sampled = conventional.sample(0.01)
    names = [x.removeprefix("joint ") for x in arm.joint_names]
    for i, name in enumerate(names):
        for kind, unit in (("q", "rad"), ("dq", "rad/s"), ("ddq", "rad/s^2")):
            np.testing.assert_allclose(
                found[f"{kind} {name} [{unit}]"], getattr(sampled, kind)[:, i], rtol=0, atol=6e-13
            )


def test_a_period_beyond_the_motion_is_refused(conventional, tmp_path, refuses):
    place, duration = tmp_path / "a.csv", conventional.duration
    # Somebody who means milliseconds.
    refuses(lambda: export(conventional, place, period=20), InvalidInput, allowed=duration)
    refusals(lambda x: export(conventional, place, period=x), [(1e-12, "longer period")])
    export(conventional, place, period=duration)


def test_refuses_what_does_not_fit_together(six, tmp_path):
    cases = [
        ("a.txt", {}, "The ending of a.txt is not that of a format"),
        ("a", {}, "ros-yaml (.yaml)"),
        ("a.csv", {"format": "xml"}, "no format 'xml'"),
        ("a.csv", {"format": "csv", "template": "abb"}, "the format is csv and not template"),
        ("a.src", {"format": "template"}, "needs a template"),
        ("a.csv", {"outputs": {"tool": 1}}, "Outputs are for urscript and template"),
        ("a.csv", {"period": 0.1}, "its own interval"),
        ("a.csv", {"joint_names": "abcdef"}, "list of 6 names"),
        ("a.csv", {"joint_names": 6}, "list of 6 names"),
        ("no/a.csv", {}, "No such file or directory"),
        ("a.script", {"outputs": ["tool"]}, "outputs must give the output of each event"),
        ("a.script", {"outputs": {"tol": 1}}, "outputs ... 'tol' ... gas, tool"),
    ]
    refusals(lambda x: export(six, tmp_path / x[0], **x[1]), [((a, b), c) for a, b, c in cases])
    assert not list(tmp_path.iterdir())
    with pytest.warns(UserWarning, match="gas, whose values are not on or off"):
        export(six, tmp_path / "a.script", outputs={"tool": 1})
    export(six, tmp_path / "a.csv", joint_names=np.array(list("abcdef")))


def test_a_missing_library_is_named_with_its_extra(six, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags", None)
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    words = "rosbags ... pip install 'armcontour[ros]'"
    refusals(lambda x: export(six, tmp_path / "a", format=x), [("mcap", words)])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".csv", ".mcap"])
def test_a_writer_that_fails_halfway_leaves_what_was_there(six, tmp_path, monkeypatch, ending):
    place = tmp_path / f"part{ending}"
    export(six, place)
    before = bytes_of(place)

    def halfway(table, path, **options):
        write_table(table, path, **options)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(exporting, "write_table", halfway)
    words = "Cannot write  ... No space left on device; free "
    places = [(place, words), (tmp_path / f"new{ending}", words)]
    refusals(lambda x: export(six, x), places)
    assert bytes_of(place) == before
    assert [x.name for x in tmp_path.iterdir()] == [place.name]


def test_any_other_failure_leaves_nothing_either(tmp_path):
    def broken(path):
        path.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        put(tmp_path / "a.csv", broken)
    assert not list(tmp_path.iterdir())


def test_a_bag_replaces_a_bag_but_nothing_else(six, tmp_path):
    precious, folder, file = (tmp_path / x for x in ("precious.mcap", "folder.csv", "file.mcap"))
    for x in (precious, folder):
        x.mkdir()
    (precious / "thesis.tex").write_text("all of it")
    file.write_text("a file")
    places = [
        (precious, "other things than a bag ... thesis.tex"),
        (file, "a file of that name is in the way"),
        (folder, "a folder of that name is in the way"),
    ]
    refusals(lambda x: export(six, x), places)
    assert (precious / "thesis.tex").read_text() == "all of it"


def test_the_old_bag_comes_back_if_the_new_one_cannot_be_put_there(six, tmp_path, monkeypatch):
    place = tmp_path / "part.mcap"
    export(six, place)
    before, rename = bytes_of(place), os.rename

    def failing(source, target):
        if FilePath(target) == place and ".old" not in FilePath(source).parts:
            raise PermissionError(13, "Permission denied")
        rename(source, target)

    monkeypatch.setattr(os, "rename", failing)
    with pytest.raises(InvalidInput, match="Permission denied"):
        export(six, place)
    assert bytes_of(place) == before
