"""Export: formats by name and ending, whole files or none, the same bytes every time."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pandas as pd
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput
from armcontour.io.exports import Table, export, exporting, formats, write_table
from armcontour.io.exports.destination import put

PLAIN = [(x, end) for x, end in formats().items() if x != "template"]


@pytest.fixture
def six(taught: Callable[..., ac.TaughtData]) -> ac.TaughtData:
    events = taught(np.zeros((1, 1))).trajectory.events
    return taught(
        np.random.default_rng(0).normal(size=(20, 6)),
        events=tuple(x for x in events if x.name != "label"),
    )


def bytes_of(place: FilePath) -> dict[str, bytes]:
    files = [place] if place.is_file() else sorted(place.rglob("*"))
    return {x.name: x.read_bytes() for x in files if x.is_file()}


@pytest.mark.parametrize(("form", "ending"), PLAIN)
def test_the_ending_or_the_name_says_the_format_and_bytes_are_the_same_twice(
    six: ac.TaughtData, tmp_path: FilePath, form: str, ending: str
) -> None:
    first, second = tmp_path / "a" / f"part{ending}", tmp_path / "b" / f"part{ending}"
    for place in (first, second):
        place.parent.mkdir()
    export(six, first)
    export(six, str(second), format=form)
    assert bytes_of(first) and bytes_of(first) == bytes_of(second)
    # Once more, over what is there.
    export(six, first)
    assert bytes_of(first) == bytes_of(second)
    assert [x.name for x in first.parent.iterdir()] == [first.name]


def test_a_template_needs_no_format(six: ac.TaughtData, tmp_path: FilePath) -> None:
    outputs = {"tool": 17}
    with pytest.warns(UserWarning, match="switched for gas,"):
        export(six, tmp_path / "part.src", template="kuka", outputs=outputs)
    assert "DEF part( )" in (tmp_path / "part.src").read_text()


def test_events_without_an_output_are_warned_of_once(
    taught: Callable[..., ac.TaughtData], tmp_path: FilePath
) -> None:
    events = taught(np.zeros((1, 6))).trajectory.events
    switches = tuple(x for x in events if x.name == "tool")
    six = taught(np.zeros((20, 6)), events=switches)
    for template, output in (("kuka", "17"), ("abb", "'doTool'")):
        with pytest.warns(UserWarning) as told:
            export(six, tmp_path / "part.txt", template=template)
        assert [str(x.message) for x in told] == [
            f"Template {template}: nothing is switched for tool, as no output is named: the "
            "program has comments in these places. Name an output, such as "
            f"outputs={{'tool': {output}}}."
        ]
        assert told[0].filename == __file__
    # Values that these programs cannot switch.
    with pytest.warns(UserWarning, match="gas, label, whose values are not on or off"):
        export(
            taught(np.zeros((20, 6))),
            tmp_path / "part.txt",
            template="abb",
            outputs={"tool": "doTool"},
        )
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(six, tmp_path / "part.txt", template="abb", outputs={"tool": "doTool"})
        export(taught(np.zeros((20, 6)), events=()), tmp_path / "part.txt", template="kuka")
        export(six, tmp_path / "part.csv")
        # Templates of users may switch events by their names.
        own = tmp_path / "own.txt.j2"
        own.write_text("{% for x in events %}{{ x.name }}{% endfor %}")
        export(six, tmp_path / "part.txt", template=own)


def test_nothing_is_written_where_warnings_are_errors(
    six: ac.TaughtData, tmp_path: FilePath
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(UserWarning, match="Template kuka: nothing is switched for"):
            export(six, tmp_path / "part.src", template="kuka")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("ending", [".src", ".script"])
def test_programs_that_do_not_set_an_analog_output_warn(
    taught: Callable[..., ac.TaughtData], tmp_path: FilePath, ending: str
) -> None:
    given = taught(np.zeros((20, 6)), events=())
    options: dict[str, Any] = {"analog": {"power": lambda t: 0 * t}}
    options |= {"template": "kuka"} if ending == ".src" else {}
    with pytest.warns(UserWarning, match="does not set power"):
        export(given, tmp_path / f"part{ending}", **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        export(given, tmp_path / f"part{ending}", outputs={"power": 1}, **options)
    assert re.search(r"ANOUT\[1\]|analog_out\(1,", (tmp_path / f"part{ending}").read_text())


def test_the_uncompensated_reference_is_exported_every_period(
    conventional: ac.Trajectory, arm: ac.Arm, tmp_path: FilePath
) -> None:
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


def test_a_period_beyond_the_motion_is_refused(
    conventional: ac.Trajectory, tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    # Somebody who means milliseconds.
    words = f"The period of 20 s is longer than the motion of {conventional.duration:.6g} s"
    refuses(
        lambda: export(conventional, tmp_path / "a.csv", period=20),
        InvalidInput,
        words,
        allowed=conventional.duration,
    )
    export(conventional, tmp_path / "a.csv", period=conventional.duration)


def test_refuses_what_does_not_fit_together(
    six: ac.TaughtData, tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    cases: list[tuple[str, dict[str, Any], str]] = [
        ("a.txt", {}, "The ending of a.txt is not that of a format"),
        ("a", {}, "ros-yaml (.yaml)"),
        ("a.csv", {"format": "xml"}, "no format 'xml'"),
        ("a.csv", {"format": "csv", "template": "abb"}, "the format is csv and not template"),
        ("a.src", {"format": "template"}, "needs a template"),
        ("a.csv", {"outputs": {"tool": 1}}, "Outputs are for urscript and template"),
        ("a.csv", {"period": 0.1}, "its own interval"),
        ("no/a.csv", {}, "No such file or directory"),
        ("a.script", {"outputs": ["tool"]}, "outputs must give the output of each event"),
    ]
    for file, options, words in cases:
        refuses(lambda f=file, o=options: export(six, tmp_path / f, **o), InvalidInput, words)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("form", "library", "extra"),
    [("parquet", "pyarrow", "tables"), ("mcap", "rosbags.rosbag2", "ros")],
)
def test_a_missing_library_is_named_with_its_extra(
    six: ac.TaughtData,
    tmp_path: FilePath,
    monkeypatch: pytest.MonkeyPatch,
    refuses: Callable[..., None],
    form: str,
    library: str,
    extra: str,
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    place = tmp_path / "a"
    refuses(
        lambda: export(six, place, format=form),
        InvalidInput,
        library.partition(".")[0],
        f"pip install 'armcontour[{extra}]'",
    )
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("form", "ending"), PLAIN)
def test_a_writer_that_fails_halfway_leaves_what_was_there(
    six: ac.TaughtData,
    tmp_path: FilePath,
    monkeypatch: pytest.MonkeyPatch,
    form: str,
    ending: str,
) -> None:
    place = tmp_path / f"part{ending}"
    export(six, place)
    before = bytes_of(place)

    def halfway(table: Table, path: FilePath, **options: Any) -> None:
        write_table(table, path, **options)
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(exporting, "write_table", halfway)
    with pytest.raises(
        InvalidInput,
        match=r"Cannot write .*part.*: No space left on device; free ",
    ):
        export(six, place)
    assert bytes_of(place) == before
    assert [x.name for x in tmp_path.iterdir()] == [place.name]
    with pytest.raises(InvalidInput, match="No space left"):
        export(six, tmp_path / f"new{ending}")
    assert [x.name for x in tmp_path.iterdir()] == [place.name]


def test_any_other_failure_leaves_nothing_either(tmp_path: FilePath) -> None:
    def broken(path: FilePath) -> None:
        path.write_text("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        put(tmp_path / "a.csv", broken)
    assert not list(tmp_path.iterdir())


def test_a_bag_replaces_a_bag_but_nothing_else(
    six: ac.TaughtData, tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    precious = tmp_path / "precious.mcap"
    precious.mkdir()
    (precious / "thesis.tex").write_text("all of it")
    refuses(lambda: export(six, precious), InvalidInput, "other things than a bag", "thesis.tex")
    assert (precious / "thesis.tex").read_text() == "all of it"
    file = tmp_path / "file.mcap"
    file.write_text("a file")
    refuses(lambda: export(six, file), InvalidInput, "a file of that name is in the way")
    folder = tmp_path / "folder.csv"
    folder.mkdir()
    refuses(lambda: export(six, folder), InvalidInput, "a folder of that name is in the way")


def test_the_old_bag_comes_back_if_the_new_one_cannot_be_put_there(
    six: ac.TaughtData, tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    import os

    place = tmp_path / "part.mcap"
    export(six, place)
    before, replace = bytes_of(place), os.replace

    def failing(source: Any, target: Any) -> None:
        if FilePath(target) == place and ".old" not in FilePath(source).name:
            raise PermissionError(13, "Permission denied")
        replace(source, target)

    monkeypatch.setattr(os, "replace", failing)
    with pytest.raises(InvalidInput, match="Permission denied"):
        export(six, place)
    assert bytes_of(place) == before


def test_an_output_of_an_event_that_there_is_not_is_refused(
    six: ac.TaughtData, tmp_path: FilePath, refuses: Callable[..., None]
) -> None:
    place = tmp_path / "part.script"
    words = "outputs", "'tol'", "gas, tool"
    refuses(lambda: export(six, place, outputs={"tol": 1}), InvalidInput, *words)
    assert not place.exists()
    export(six, place, outputs={"tool": 1})


def test_joint_names_that_are_one_text_and_samples_without_end_are_refused(
    six: ac.TaughtData,
    conventional: ac.Trajectory,
    tmp_path: FilePath,
    refuses: Callable[..., None],
) -> None:
    place = tmp_path / "part.csv"
    for names in ("abcdef", 6):
        refuses(lambda x=names: export(six, place, joint_names=x), InvalidInput, "list of 6 names")
    export(six, place, joint_names=np.array(list("abcdef")))
    refuses(lambda: export(conventional, place, period=1e-12), InvalidInput, "longer period")
