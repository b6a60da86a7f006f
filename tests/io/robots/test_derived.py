"""Arm files that name another arm, and what is different of it."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac
from armcontour.errors import InvalidInput

HEAD = "name: loaded\nkind: derived\nsource: a test\narm: ur5e\n"
PAYLOAD = (
    "payload_mass: {value: 2.5, unit: kg, source: scales}\n"
    "payload_center: {value: [0.01, 0, 0.05], unit: m, source: ruler}\n"
)
FRICTION = (
    "armature: {value: [0.1, 0.1, 0.1, 0.1, 0.1, 0.1], unit: kg m^2, source: a}\n"
    "viscous: {value: [1, 2, 3, 4, 5, 6], unit: N m s/rad, source: b}\n"
    "coulomb: {value: [6, 5, 4, 3, 2, 1], unit: N m, source: c}\n"
)


@pytest.fixture
def write(tmp_path):
    def to(text, name="robot.yaml"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return to


def test_payload_and_friction_replace_those_of_the_named_arm(write):
    arm = ac.load_arm(write(HEAD + PAYLOAD + FRICTION))
    base = ac.load_arm("ur5e")
    assert arm.name == "loaded" and arm.joint_names == base.joint_names
    assert arm.chain.payload.mass == 2.5
    np.testing.assert_array_equal(arm.chain.payload.center, [0.01, 0, 0.05])
    np.testing.assert_array_equal(arm.chain.viscous, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(arm.chain.coulomb, [6, 5, 4, 3, 2, 1])
    np.testing.assert_array_equal(arm.chain.armature, np.full(6, 0.1))
    q = np.full(6, 0.3)
    np.testing.assert_array_equal(arm.forward(q), base.forward(q))


def test_what_the_file_does_not_give_stays(write):
    base = ac.load_arm("panda")
    arm = ac.load_arm(write(HEAD.replace("ur5e", "panda")))
    np.testing.assert_array_equal(arm.chain.coulomb, base.chain.coulomb)
    assert arm.chain.payload is None


def test_a_payload_that_is_asked_for_replaces_that_of_the_file(write):
    arm = ac.load_arm(write(HEAD + PAYLOAD), payload=ac.Payload(mass=1.0))
    assert arm.chain.payload.mass == 1.0


def test_the_named_arm_is_a_file_beside_it(write):
    write(HEAD + PAYLOAD, "first.yaml")
    arm = ac.load_arm(write(HEAD.replace("arm: ur5e", "arm: {file: first.yaml}") + FRICTION))
    assert arm.chain.payload.mass == 2.5 and arm.chain.coulomb[0] == 6.0


def test_a_file_that_names_itself_is_refused(write):
    with pytest.raises(InvalidInput, match="leads back to it"):
        ac.load_arm(write(HEAD.replace("arm: ur5e", "arm: {file: robot.yaml}")))


def test_a_job_takes_such_a_file(write, tmp_path):
    write(HEAD + PAYLOAD + FRICTION)
    job = write(
        "name: j\narm: {file: robot.yaml, tool: {position: [0, 0, 0.1]}}\n"
        "path: {points: [[0.45, 0.08, 0.2], [0.50, 0.08, 0.2]]}\n"
        "limits: {speed: 0.1, joint_acceleration: 8.0}\nservo: {kp: 25, kv: 150}\n"
        "runs: {one: {compensation: {method: none}}}\n",
        "job.yaml",
    )
    arm = ac.read_job(job).arm
    assert arm.chain.payload.mass == 2.5
    np.testing.assert_array_equal(arm.chain.tool.position, [0, 0, 0.1])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD.replace("arm: ur5e\n", ""), "arm must be the name of a built-in arm"),
        (HEAD.replace("ur5e", "{file: a.urdf, speed: 1}"), "arm must be the name"),
        (
            HEAD.replace("ur5e", "{name: ur5e, file: a.urdf}"),
            "either name, a built-in arm, or file",
        ),
        (HEAD.replace("ur5e", "{name: ur5e, tip: tool0}"), "has no other tip"),
        (HEAD + PAYLOAD.splitlines()[1], "payload_center needs the payload_mass"),
        (HEAD + PAYLOAD.replace("kg", "g"), "must be given in kg"),
        (HEAD + "coulomb: {value: [1, 2], unit: N m, source: c}", "6 numbers"),
        (HEAD + "coulomb: 3", "a quantity with value, unit and source"),
        (HEAD + "masses: {value: 1, unit: kg}", "it takes the keys"),
        (HEAD.replace("ur5e", "ur6e"), "There is no built-in arm 'ur6e'"),
    ],
)
def test_bad_files_are_refused(write, text, message):
    with pytest.raises(InvalidInput, match=message):
        ac.load_arm(write(text))
