"""Arm files: the library, the user's own, and files that are none."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

import armcontour as ac

GOOD = {
    "name": "mine",
    "kind": "planar_two_link",
    "source": "drawing 7",
    "base": {"value": 0.1, "unit": "m", "source": "drawing 7"},
    "links": {"value": [0.3, 0.2], "unit": "m"},
    "limits": {
        "joint_acceleration": {"value": [0.5, 0.6], "unit": "rad/s^2"},
        "joint_velocity": {"value": 2.0, "unit": "rad/s"},
    },
}


def write(tmp_path, data):
    file = tmp_path / "arm.yaml"
    file.write_text(data if isinstance(data, str) else yaml.safe_dump(data), encoding="utf-8")
    return file


def test_the_papers_arm(arm):
    assert ac.arm_names() == ("pmk3s",)
    assert (arm.name, arm.base, arm.link1, arm.link2) == ("PMK-3s", 0.135, 0.250, 0.215)
    np.testing.assert_array_equal(arm.limits.joint_acceleration, [0.72, 0.72])
    assert arm.limits.joint_velocity is None and arm.limits.speed is None
    assert "Munasinghe" in arm.source


def test_the_users_own_arm(tmp_path):
    arm = ac.load_arm(write(tmp_path, GOOD))
    assert (arm.name, arm.source, arm.base) == ("mine", "drawing 7", 0.1)
    assert (arm.link1, arm.link2) == (0.3, 0.2)
    np.testing.assert_array_equal(arm.limits.joint_acceleration, [0.5, 0.6])
    np.testing.assert_array_equal(arm.limits.joint_velocity, [2.0, 2.0])


def test_limits_may_be_left_out(tmp_path):
    data = {key: value for key, value in GOOD.items() if key != "limits"}
    assert ac.load_arm(str(write(tmp_path, data))).limits.joint_acceleration is None


def changed(**changes):
    return GOOD | changes


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ("links: [1, 2", ("is not YAML",)),
        ("just words", ("does not describe an arm", "keys")),
        ("", ("does not describe an arm",)),
        ("- 1\n- 2\n", ("does not describe an arm",)),
        (changed(mass=3), ("does not describe an arm", "base, kind, limits, links")),
        (changed(kind="scara"), ("kind must be planar_two_link",)),
        (changed(limits=[1, 2]), ("limits must be named quantities",)),
        (changed(limits={"torque": {"value": 1, "unit": "N m"}}), ("unknown limit torque",)),
        (changed(base=0.1), ("base must be a quantity with value, unit and source",)),
        (changed(base={"value": 100, "unit": "mm"}), ("base must be given in m", "'mm'")),
        (changed(base={"value": 100}), ("base must be given in m", "None")),
        (changed(links={"unit": "m"}), ("links must be a quantity",)),
        (changed(links={"value": [1, 2, 3], "unit": "m"}), ("links must be two lengths",)),
        (changed(links={"value": 1, "unit": "m"}), ("links must be two lengths",)),
        (changed(links={"value": [0.3, -0.2], "unit": "m"}), ("second link length", "above zero")),
        (
            changed(limits={"joint_acceleration": {"value": 40, "unit": "deg/s^2"}}),
            ("joint_acceleration must be given in rad/s^2", "'deg/s^2'"),
        ),
        (
            changed(limits={"joint_acceleration": {"value": [1, 1, 1], "unit": "rad/s^2"}}),
            ("joint_acceleration has 3 values",),
        ),
    ],
)
def test_files_that_are_no_arm_are_refused(tmp_path, data, words, refuses):
    refuses(lambda: ac.load_arm(write(tmp_path, data)), ac.InvalidInput, *words)


def test_a_missing_file_is_refused(tmp_path, refuses):
    refuses(lambda: ac.load_arm(tmp_path / "no.yaml"), ac.InvalidInput, "no arm file", "no.yaml")


def test_bytes_that_are_no_text_are_refused(tmp_path, refuses):
    file = tmp_path / "arm.yaml"
    file.write_bytes(b"name: \xff\xfe\x00")
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "arm.yaml", "is not YAML")


def test_an_unknown_name_is_refused(refuses):
    refuses(
        lambda: ac.load_arm("pmk4s"),
        ac.InvalidInput,
        "no built-in arm 'pmk4s'",
        "pmk3s",
        ".yaml file",
    )
