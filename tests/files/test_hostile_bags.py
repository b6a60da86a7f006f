"""Bags whose names, tables, links and packed bytes are meant to deceive: refused, or read whole."""

import os
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.files.bags import JOINT_STATE, STAMP, joint_state, write_db3, write_folder

import armcontour as ac
from armcontour.core.errors import FileError

pytest.importorskip("rosbags")

NAMES = ac.load_arm("ur5e").joint_names
COUNT = 20
Q = np.linspace(0, 2, COUNT)[:, None] + np.arange(6) / 10
TOPIC = "/joint_states"
MEGABYTE = 1_000_000


def rows(names, q=Q):
    stamps = [STAMP + 8_000_000 * i for i in range(len(q))]
    data = [joint_state(names, x, row) for x, row in zip(stamps, q, strict=True)]
    return [(TOPIC, JOINT_STATE, x, y) for x, y in zip(stamps, data, strict=True)]


def refusal(file):
    with pytest.raises(FileError) as error:
        ac.read_trajectory(file, NAMES)
    text = str(error.value)
    assert "\n" not in text and text.endswith(".")
    return text


@pytest.mark.parametrize(
    "ending", [" [deg]", " (mm)", "[deg]", ";", " # q", '"', "\t[deg]", " [0]"]
)
def test_names_of_joints_never_become_units_or_cells(ending, tmp_path):
    file = write_db3(tmp_path / "run.db3", rows([x + ending for x in NAMES]))
    if not ending.isprintable():
        assert "printable" in refusal(file)
        return
    np.testing.assert_array_equal(ac.read_trajectory(file, NAMES).q, Q)


@pytest.mark.parametrize("name", ["", "a\nb", "a\x1b[31mb", "a" * 81, "a\u202eb"])
def test_names_that_no_arm_can_have_are_refused(name, tmp_path):
    assert "printable" in refusal(write_db3(tmp_path / "run.db3", rows([name, *NAMES[1:]])))


def test_definitions_in_the_file_are_not_used(tmp_path):
    folder = write_folder(tmp_path / "run", rows(NAMES))
    file = folder / "run.mcap"
    content = file.read_bytes()
    text = b"float64[] position"
    assert text in content
    file.write_bytes(content.replace(text, b"float64[] velocity"))
    np.testing.assert_array_equal(ac.read_trajectory(file, NAMES).q, Q)


def test_other_fields_than_those_of_joint_states_are_refused(tmp_path):
    changed = [(*x[:3], x[3] + bytes(8)) for x in rows(NAMES)]
    assert TOPIC in refusal(write_db3(tmp_path / "run.db3", changed))
    short = [(*x[:3], x[3][:-20]) for x in rows(NAMES)]
    assert TOPIC in refusal(write_db3(tmp_path / "short.db3", short))


def test_lost_messages_are_noticed(tmp_path):
    file = write_folder(tmp_path / "run", rows(NAMES)) / "run.mcap"
    content = file.read_bytes()
    # A record of a message: its kind, its length, its channel.
    size = len(rows(NAMES)[0][3]) + 22
    begin = b"\5" + size.to_bytes(8, "little")
    assert content.count(begin) == COUNT
    file.write_bytes(content.replace(begin, b"\x7f" + begin[1:], 1))
    assert f"{COUNT - 1} messages" in refusal(file)


def test_joints_and_sets_of_joints_have_limits(tmp_path):
    many = [f"joint{k}" for k in range(1001)]
    text = refusal(write_db3(tmp_path / "many.db3", rows(many, np.zeros((2, 1001)))))
    assert "1001" in text and "1000" in text
    changing = []
    for i in range(101):
        data = joint_state([f"joint{i}"], STAMP + i, [0.0])
        changing.append((TOPIC, JOINT_STATE, STAMP + i, data))
    assert "100" in refusal(write_db3(tmp_path / "sets.db3", changing))


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE messages RENAME TO hidden; CREATE VIEW messages AS SELECT * FROM hidden;",
        "ALTER TABLE messages ADD COLUMN more BLOB AS (zeroblob(500000000));",
    ],
)
def test_computed_tables_are_refused(change, tmp_path):
    file = write_db3(tmp_path / "run.db3", rows(NAMES))
    with sqlite3.connect(file) as base:
        base.executescript(change)
    base.close()
    assert "messages" in refusal(file)


def name_in_metadata(folder, name):
    metadata = folder / "metadata.yaml"
    text = metadata.read_text()
    assert f"{folder.name}.mcap" in text
    metadata.write_text(text.replace(f"{folder.name}.mcap", name))


def test_files_of_a_bag_are_regular_files_in_its_folder(tmp_path):
    whole = write_folder(tmp_path / "whole", rows(NAMES)) / "whole.mcap"
    linked = write_folder(tmp_path / "linked", rows(NAMES))
    (linked / "linked.mcap").unlink()
    (linked / "linked.mcap").symlink_to(whole)
    assert "link" in refusal(linked)
    (linked / "metadata.yaml").unlink()
    assert "link" in refusal(linked)
    piped = write_folder(tmp_path / "piped", rows(NAMES))
    os.mkfifo(piped / "pipe")
    name_in_metadata(piped, "pipe")
    assert "regular" in refusal(piped)
    above = write_folder(tmp_path / "above", rows(NAMES))
    name_in_metadata(above, "..")
    refusal(above)


def test_unpacked_bytes_have_a_limit(tmp_path):
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    folder = write_folder(tmp_path / "packed", rows(NAMES), compression="FILE")
    (file,) = folder.glob("*.zstd")
    file.write_bytes(zstd.compress(bytes(MEGABYTE)) * 1001)
    assert file.stat().st_size < MEGABYTE
    assert "1000 MB" in refusal(folder)
    assert not [x for x in Path(tmp_path).rglob("*") if x.stat().st_size > MEGABYTE]


@pytest.mark.parametrize("name", ["a#b", "a?b", "a%23b", "a b&c"])
def test_any_character_in_a_path_is_allowed(name, tmp_path):
    folder = tmp_path / name
    file = write_db3(folder / f"{name}.db3", rows(NAMES))
    np.testing.assert_array_equal(ac.read_trajectory(file, NAMES).q, Q)
    np.testing.assert_array_equal(ac.read_trajectory(folder, NAMES).q, Q)


def test_brackets_of_the_arms_own_names_are_no_units_in_tables(tmp_path):
    text = "t [s],{0}\n0,0.5\n1,0.6\n2,0.8\n"
    plain = tmp_path / "plain.csv"
    plain.write_text(text.format("measured axis"))
    expected = ac.read_trajectory(plain, ["axis"]).q
    for title in ("measured axis [deg]", "axis [deg]"):
        named = tmp_path / "named.csv"
        named.write_text(text.format(title))
        np.testing.assert_array_equal(ac.read_trajectory(named, ["axis [deg]"]).q, expected)
        np.testing.assert_allclose(ac.read_trajectory(named, ["axis"]).q, np.radians(expected))
    named.write_text(text.format("measured axis [deg] [deg]"))
    motion = ac.read_trajectory(named, ["axis [deg]"])
    np.testing.assert_allclose(motion.q, np.radians(expected))
