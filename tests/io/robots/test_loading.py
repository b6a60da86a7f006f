"""Arm files: the library, the user's own, and files that are none."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
import yaml

import armcontour as ac
from armcontour import _yaml
from armcontour.arms import Payload
from armcontour.frames import Frame

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

TUBE_UNITS = {"outer_diameter": "m", "wall": "m", "density": "kg/m^3"}
SERIAL = {
    "name": "two",
    "kind": "serial",
    "source": "drawing 8",
    "joints": ["first", "second"],
    "positions": {"value": [[0, 0, 0.1], [0.2, 0, 0]], "unit": "m"},
    "angles": {"value": [[0, 0, 0], [1, 0, 0]], "unit": "rad"},
    "axes": {"value": [[0, 0, 1], [0, 1, 0]], "unit": "1"},
    "masses": {"value": [2, 1], "unit": "kg"},
    "centers": {"value": [[0, 0, 0.1], [0.1, 0, 0]], "unit": "m"},
    "inertias": {"value": [[0.1, 0, 0, 0.1, 0, 0.1]] * 2, "unit": "kg m^2"},
    "armature": {"value": [0.1, 0.2], "unit": "kg m^2"},
    "coulomb": {"value": [1, 2], "unit": "N m"},
    "gravity": {"value": [0, 0, -1.62], "unit": "m/s^2"},
    "tip": {"value": [0, 0, 0.3], "unit": "m"},
    "tip_angles": {"value": [0, 1, 0], "unit": "rad"},
    "limits": {"joint_velocity": {"value": [1, 2], "unit": "rad/s"}},
    "not_kept": {"speed": {"value": 1, "unit": "m/s", "source": "drawing 8"}},
}


def write(tmp_path, data):
    file = tmp_path / "arm.yaml"
    file.write_text(data if isinstance(data, str) else yaml.safe_dump(data), encoding="utf-8")
    return file


def test_the_papers_arm(arm):
    assert ac.arm_names() == ("fr3", "panda", "pmk3s", "ur10e", "ur5e")
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
        ("links: [1, 2", ("is not valid YAML",)),
        ("just words", ("does not describe an arm", "keys")),
        ("", ("does not describe an arm",)),
        ("- 1\n- 2\n", ("does not describe an arm",)),
        (changed(mass=3), ("does not describe an arm", "assumed, base, kind", "not mass")),
        (changed(kind="scara"), ("kind must be planar_two_link",)),
        (changed(limits=[1, 2]), ("limits must be named quantities",)),
        (changed(limits={"torque": {"value": 1, "unit": "N m"}}), ("unknown limit torque",)),
        (changed(kind=["serial"]), ("kind must be planar_two_link or serial",)),
        (changed(base=0.1), ("base must be a quantity with value, unit and source",)),
        (changed(base={"value": 100, "unit": "mm"}), ("base must be given in m", "'mm'")),
        (changed(base={"value": 100}), ("base must be given in m", "None")),
        (changed(links={"unit": "m"}), ("links must be a quantity",)),
        (changed(links={"value": [1, 2, 3], "unit": "m"}), ("links must be 2 numbers, but is 3",)),
        (changed(links={"value": 1, "unit": "m"}), ("links must be 2 numbers, but is one",)),
        (changed(tubes=3), ("tubes take the keys outer_diameter, wall, density",)),
        (
            changed(tubes={key: {"value": 1, "unit": unit} for key, unit in TUBE_UNITS.items()}),
            ("outer_diameter must be 2 numbers, but is",),
        ),
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


def test_the_users_own_serial_arm(tmp_path):
    arm = ac.load_arm(write(tmp_path, SERIAL))
    assert (arm.name, arm.source, arm.joint_names) == ("two", "drawing 8", ("first", "second"))
    assert "joint_acceleration" in arm.limits_hint and "arm.yaml" in arm.limits_hint
    chain = arm.chain
    np.testing.assert_array_equal(chain.masses, [2, 1])
    np.testing.assert_array_equal(chain.armature, [0.1, 0.2])
    np.testing.assert_array_equal(chain.coulomb, [1, 2])
    np.testing.assert_array_equal(chain.viscous, [0, 0])
    np.testing.assert_array_equal(chain.gravity, [0, 0, -1.62])
    np.testing.assert_array_equal(chain.tip.position, [0, 0, 0.3])
    np.testing.assert_allclose(chain.tip.rotation @ [0, 0, 1], [np.sin(1), 0, np.cos(1)])
    bare = {key: x for key, x in SERIAL.items() if key not in ("masses", "centers", "inertias")}
    assert ac.load_arm(write(tmp_path, bare)).chain.masses is None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"links": 3}, ("of the kind serial", "not links")),
        ({"joints": "first"}, ("joints must be the names",)),
        (
            {"positions": {"value": [[0, 0, 1]], "unit": "m"}},
            ("positions must be 2 by 3", "1 by 3"),
        ),
        ({"axes": {"value": [[0, 0, 2], [0, 1, 0]], "unit": "1"}}, ("axes", "unit vectors")),
        ({"angles": {"value": 0, "unit": "deg"}}, ("angles must be given in rad", "'deg'")),
        ({"angles": {"value": "up", "unit": "rad"}}, ("angles in", "numbers in rad")),
        ({"angles": {"value": 1, "unit": "rad"}}, ("angles must be 2 by 3", "but is one")),
        ({"masses": None}, ("masses must be a quantity",)),
        ({"masses": {"value": [2, -1], "unit": "kg"}}, ("after second", "-1 kg")),
        (
            {"inertias": {"value": [[0.1, 0, 0, 0.1, 0, 0.5]] * 2, "unit": "kg m^2"}},
            ("inertia of the link after first", "No body"),
        ),
    ],
)
def test_files_that_are_no_serial_arm_are_refused(tmp_path, change, words, refuses):
    refuses(lambda: ac.load_arm(write(tmp_path, SERIAL | change)), ac.InvalidInput, *words)


def test_bodies_are_given_whole_or_not_at_all(tmp_path, refuses):
    data = {key: value for key, value in SERIAL.items() if key != "centers"}
    refuses(lambda: ac.load_arm(write(tmp_path, data)), ac.InvalidInput, "all of masses, centers")


def test_a_plane_arm_may_have_bodies_and_carry_a_payload(tmp_path, refuses):
    tubes = {
        key: {"value": [value] * 2, "unit": unit}
        for (key, unit), value in zip(TUBE_UNITS.items(), (0.08, 0.005, 2700), strict=True)
    }
    file = write(tmp_path, GOOD | {"tubes": tubes, "assumed": "tubes"})
    bare, loaded = ac.load_arm(file), ac.load_arm(file, payload=Payload(mass=2.0))
    assert bare.chain.assumed == "tubes"
    np.testing.assert_allclose(
        bare.chain.masses, 2700 * np.pi * (0.04**2 - 0.035**2) * np.array([0.3, 0.2])
    )
    still, push = np.zeros(2), np.ones(2)
    assert loaded.torque(still, still, push)[0] > bare.torque(still, still, push)[0] + 0.5
    refuses(
        lambda: ac.load_arm(file, tool=Frame()), ac.InvalidInput, "moves in the plane", "no tool"
    )


def test_what_is_chosen_of_a_description_is_no_choice_of_an_arm_file(tmp_path, refuses):
    for choice in ({"tip": "tool0"}, {"base": "base"}, {"locked": {"j": 0}}):
        refuses(lambda x=choice: ac.load_arm("ur5e", **x), ac.InvalidInput, "ur5e", ".urdf")


def test_built_in_arms_take_tools_payloads_and_frames():
    tool, work = Frame.rpy([0, 0, 0.2], [0, 0, 0]), Frame.rpy([0.5, 0, 0], [0, 0, 1])
    arm = ac.load_arm("ur5e", tool=tool, work=work, payload=Payload(mass=3.0))
    assert arm.chain.payload.mass == 3.0 and arm.chain.tool is tool
    np.testing.assert_allclose(arm.chain.base.position, work.inverse.position)
    assert arm.chain.assumed == ac.load_arm("ur5e").chain.assumed


def test_a_missing_file_is_refused(tmp_path, refuses):
    refuses(lambda: ac.load_arm(tmp_path / "no.yaml"), ac.InvalidInput, "no arm file", "no.yaml")


def test_bytes_that_are_no_text_are_refused(tmp_path, refuses):
    file = tmp_path / "arm.yaml"
    file.write_bytes(b"name: \xff\xfe\x00")
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "arm.yaml", "is not valid YAML")


def test_an_unknown_name_is_refused(refuses):
    refuses(
        lambda: ac.load_arm("pmk4s"),
        ac.InvalidInput,
        "no built-in arm 'pmk4s'",
        "pmk3s",
        ".yaml, .urdf or .xacro file",
    )


def test_arm_files_are_read_without_the_traps_of_yaml(tmp_path, refuses):
    file = tmp_path / "arm.yaml"
    file.write_text("name: a\nlinks: [1, 1]\nname: b\n")
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "arm.yaml", "'name' stands twice", "line 3")
    flood = "".join(f"x{i}: &x{i} [{', '.join([f'*x{i - 1}'] * 10)}]\n" for i in range(1, 9))
    file.write_text(f"x0: &x0 [1]\n{flood}")
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "fewer aliases")
    table = tmp_path / "joint_limits.yaml"
    table.write_text("joint_limits: {a: {max_velocity: 1, max_velocity: 2}}")
    refuses(
        lambda: ac.load_arm("ur5e", joint_limits=table),
        ac.InvalidInput,
        "'max_velocity' stands twice",
    )


def test_what_yaml_merges_is_no_key_twice():
    text = "y: &y {b: 1e-3, c: 2}\na: {in: &x {<<: *y, c: !degrees 180}}\nd: {<<: *x, b: 4}"
    found = _yaml.load(text, "x.yaml", _yaml.AngleLoader)
    assert found["a"]["in"] == {"b": 1e-3, "c": np.pi} and found["d"] == {"b": 4, "c": np.pi}


@pytest.mark.parametrize("number", ["'1_0'", "'١'", "true", ".inf", ".nan", "'1e999'"])
def test_numbers_of_arm_files_are_plain_and_finite(number, tmp_path, refuses):
    text = yaml.safe_dump(SERIAL)
    file = tmp_path / "arm.yaml"
    masses = yaml.safe_load(text)["masses"]["value"]
    file.write_text(yaml.safe_dump({**SERIAL, "masses": {**SERIAL["masses"], "value": "HERE"}}))
    values = ", ".join([number, *("1" for _ in masses[1:])])
    file.write_text(file.read_text().replace("HERE", f"[{values}]"))
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, "masses in", "finite numbers in kg")


@pytest.mark.parametrize("key", ["name", "joints"])
def test_names_of_arm_files_can_be_printed(key, tmp_path, refuses):
    bad = "a\x1b]52;c"
    value = bad if key == "name" else [bad, *SERIAL["joints"][1:]]
    file = write(tmp_path, SERIAL | {key: value})
    refuses(lambda: ac.load_arm(file), ac.InvalidInput, r"'a\x1b]52;c'", "not printable")


def test_loading_an_arm_loads_nothing_that_only_jobs_need():
    code = "import armcontour as ac, sys; ac.load_arm('ur5e'); print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True
    )
    imported = set(done.stdout.split())
    assert "armcontour.io.robots.arm_file" in imported
    assert not imported & {"pydantic", "pint", "numba", "pinocchio", "scipy", "xacro"}
