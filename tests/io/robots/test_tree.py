"""Robot descriptions of any origin: what is read of them, and what is refused."""

from __future__ import annotations

import os
from pathlib import Path as FilePath

import numpy as np
import pytest

import armcontour as ac

ROBOT = FilePath(__file__).parent / "data" / "robot.urdf"
TEXT = ROBOT.read_text()


def load(tmp_path, *changes, **options):
    """The robot with parts of its text replaced."""
    text = TEXT
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (tmp_path / "robot.urdf").write_text(text, encoding="utf-8")
    return ac.load_arm(tmp_path / "robot.urdf", base="base_link", tip="tcp", **options)


@pytest.mark.parametrize("encoding", ["utf-7", "zlib_codec", "nowhere", "utf-16"])
def test_encodings_that_cannot_be_read_are_refused(encoding, tmp_path, refuses):
    file = tmp_path / "robot.urdf"
    file.write_text(f'<?xml version="1.0" encoding="{encoding}"?><robot name="r"/>')
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "robot.urdf is not XML")


def test_other_encodings_are_read(tmp_path):
    file = tmp_path / "robot.urdf"
    plain = TEXT[TEXT.index("<robot") :].replace("lifter", "Höhe")
    for encoding in ("latin-1", "utf-16"):
        text = f'<?xml version="1.0" encoding="{encoding}"?>' + plain
        file.write_bytes(text.encode(encoding))
        assert ac.load_arm(file, base="base_link", tip="tcp").name == "Höhe"


def test_xml_that_grows_without_end_is_refused(tmp_path, refuses):
    entities = "".join(
        f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" if i else "<!ENTITY a0 'aaaaaaaaaa'>"
        for i in range(12)
    )
    file = tmp_path / "robot.urdf"
    file.write_text(f'<!DOCTYPE robot [{entities}]><robot name="r">&a11;</robot>')
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "robot.urdf is not XML", "amplification")


def links(count: int) -> str:
    """A robot with so many links in a row."""
    body = "".join(
        f'<link name="l{i}"/><joint name="j{i}" type="revolute"><parent link="l{i - 1}"/>'
        f'<child link="l{i}"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        for i in range(1, count)
    )
    return f'<robot name="r"><link name="l0"/>{body}</robot>'


def test_descriptions_of_absurd_size_are_refused_at_once(tmp_path, refuses):
    file = tmp_path / "robot.urdf"
    file.write_text(links(1000))
    assert ac.load_arm(file).dof == 999
    file.write_text(links(100_000))
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "more than the 1000 links")
    file.write_text("<robot>" + "<x/>" * 300_000 + "</robot>")
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "more than the 200000 elements")
    file.write_text("<robot>" + "<link>" * 200_000 + "</link>" * 200_000 + "</robot>")
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "nested more than 100 deep")


def test_only_what_a_body_is_is_taken_from_it(tmp_path):
    deep = "<extra>" * 90 + "</extra>" * 90
    mass = '<mass value="2"/>'
    assert mass in TEXT
    found = load(tmp_path, (mass, mass + deep))
    plain = ac.load_arm(ROBOT, base="base_link", tip="tcp")
    np.testing.assert_array_equal(found.chain.masses, plain.chain.masses)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('link name="world"', 'link name="w\x9b2Jd"', ("name of a link of", r"'w\x9b2Jd'")),
        ('joint name="elbow"', 'joint name="&#10;elbow"', ("name of a joint of", r"'\nelbow'")),
        (
            'robot name="lifter"',
            'robot name="\u202elifter"',
            ("name of the robot of", r"'\u202elifter'"),
        ),
    ],
)
def test_names_that_cannot_be_printed_are_refused(old, new, words, tmp_path, refuses):
    (tmp_path / "robot.urdf").write_text(TEXT.replace(old, new), encoding="utf-8")
    refuses(lambda: ac.load_arm(tmp_path / "robot.urdf"), ac.InvalidInput, *words)


@pytest.mark.parametrize("number", ["1_0", "inf", "nan", "1e999", "١", "0x10"])
def test_numbers_are_plain_and_finite(number, tmp_path, refuses):
    for old, words in (
        ('velocity="2.5"', "must be one finite number"),
        ('upper="2.5"', "must be one finite number"),
        ('<mass value="2"/>', "needs a number as value of its mass"),
        ('<origin xyz="0.4 0 0.02"/>', "needs three numbers as its xyz"),
    ):
        at = old.index('"') + 1
        new = old[:at] + number + (old[-1] if old[-1] == '"' else old[old.index('"', at) :])
        if "xyz" in old:
            new = new.replace(number, f"{number} 0 0")
        refuses(lambda x=(old, new): load(tmp_path, x), ac.InvalidInput, words)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes with names")
@pytest.mark.parametrize("name", ["pipe.urdf", "pipe.xacro", "pipe.yaml"])
def test_pipes_are_refused(name, tmp_path, refuses):
    os.mkfifo(tmp_path / name)
    refuses(lambda: ac.load_arm(tmp_path / name), ac.InvalidInput, "is not a regular file")
    refuses(
        lambda: ac.load_arm("ur5e", joint_limits=tmp_path / name),
        ac.InvalidInput,
        "is not a regular file",
    )


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('xyz="0.4 0 0.02"', 'xyz="1e300 0 0.02"', ("elbow", "up to 1e+09", "1e300")),
        ('<axis xyz="0 1 1"/>', '<axis xyz="0 1e200 1"/>', ("tilt", "up to 1e+09")),
        ('<mass value="2"/>', '<mass value="1e200"/>', ("its mass", "up to 1e+09")),
        ('multiplier="0.5"', 'multiplier="1e300"', ("right", "is locked", "beyond 1e+09")),
    ],
)
def test_numbers_of_no_robot_are_refused(old, new, words, tmp_path, refuses):
    refuses(lambda: load(tmp_path, (old, new), locked={"left": 0.03}), ac.InvalidInput, *words)


def test_joints_that_mimic_one_another_in_a_long_row_are_refused(tmp_path, refuses):
    mimics = "".join(
        f'<link name="m{i}"/><joint name="m{i}" type="revolute"><parent link="tcp"/>'
        f'<child link="m{i}"/><mimic joint="m{i + 1}"/></joint>'
        for i in range(600)
    )
    refuses(
        lambda: load(tmp_path, ("</robot>", mimics + "</robot>")),
        ac.InvalidInput,
        "Joint m",
        "mimics no joint",
    )
