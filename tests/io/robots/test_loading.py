"""Arm files: the library, the user's own, those that name another arm, and files that are none."""

import subprocess
import sys

import numpy as np
import pytest
import yaml
from tests.io.tables import refusals

import armcontour as ac
from armcontour import _yaml
from armcontour.arms import Payload
from armcontour.frames import Frame

GOOD = yaml.safe_load("""
name: mine
kind: planar_two_link
source: drawing 7
base: {value: 0.1, unit: m, source: drawing 7}
links: {value: [0.3, 0.2], unit: m}
limits:
  joint_acceleration: {value: [0.5, 0.6], unit: rad/s^2}
  joint_velocity: {value: 2.0, unit: rad/s}
""")
SERIAL = yaml.safe_load("""
name: two
kind: serial
source: drawing 8
joints: [first, second]
positions: {value: [[0, 0, 0.1], [0.2, 0, 0]], unit: m}
angles: {value: [[0, 0, 0], [1, 0, 0]], unit: rad}
axes: {value: [[0, 0, 1], [0, 1, 0]], unit: "1"}
masses: {value: [2, 1], unit: kg}
centers: {value: [[0, 0, 0.1], [0.1, 0, 0]], unit: m}
inertias: {value: [[0.1, 0, 0, 0.1, 0, 0.1], [0.1, 0, 0, 0.1, 0, 0.1]], unit: kg m^2}
armature: {value: [0.1, 0.2], unit: kg m^2}
coulomb: {value: [1, 2], unit: N m}
gravity: {value: [0, 0, -1.62], unit: m/s^2}
tip: {value: [0, 0, 0.3], unit: m}
tip_angles: {value: [0, 1, 0], unit: rad}
limits: {joint_velocity: {value: [1, 2], unit: rad/s}}
not_kept: {speed: {value: 1, unit: m/s, source: drawing 8}}
""")


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
    # Limits may be left out.
    data = {key: value for key, value in GOOD.items() if key != "limits"}
    assert ac.load_arm(str(write(tmp_path, data))).limits.joint_acceleration is None


NO_ARMS = """
just words => does not describe an arm ... keys
=> does not describe an arm
[1, 2] => does not describe an arm
links: [1, 2 => is not valid YAML
"""
CHANGES = """
mass: 3 => does not describe an arm ... assumed, base, kind ... not mass
kind: scara => kind must be planar_two_link
limits: [1, 2] => limits must be named quantities
limits: {torque: {value: 1, unit: N m}} => unknown limit torque
kind: [serial] => kind must be planar_two_link or serial
base: 0.1 => base must be a quantity with value, unit and source
base: {value: 100, unit: mm} => base must be given in m ... 'mm'
base: {value: 100} => base must be given in m ... None
links: {unit: m} => links must be a quantity
links: {value: [1, 2, 3], unit: m} => links must be 2 numbers, but is 3
links: {value: 1, unit: m} => links must be 2 numbers, but is one
tubes: 3 => tubes take the keys outer_diameter, wall, density
tubes: {outer_diameter: &x {value: 1, unit: m}, wall: *x, density: *x} => outer_diameter ... 2 num
links: {value: [0.3, -0.2], unit: m} => second link length ... above zero
limits: {joint_acceleration: {value: 40, unit: deg/s^2}} => must be given in rad/s^2 ... 'deg/s^2'
limits: {joint_acceleration: {value: [1, 1, 1], unit: rad/s^2}} => joint_acceleration has 3 values
"""
SERIAL_CHANGES = r"""
links: 3 => of the kind serial ... not links
joints: first => joints must be the names
positions: {value: [[0, 0, 1]], unit: m} => positions must be 2 by 3 ... 1 by 3
axes: {value: [[0, 0, 2], [0, 1, 0]], unit: "1"} => axes ... unit vectors
angles: {value: 0, unit: deg} => angles must be given in rad ... 'deg'
angles: {value: up, unit: rad} => angles in ... numbers in rad
angles: {value: 1, unit: rad} => angles must be 2 by 3 ... but is one
masses: null => masses must be a quantity
masses: {value: [2, -1], unit: kg} => after second ... -1 kg
inertias: {value: [&x [0.1, 0, 0, 0.1, 0, 0.5], *x], unit: kg m^2} => link after first ... No body
name: "a\e]52;c" => 'a\x1b]52;c' ... not printable
joints: ["a\e]52;c", second] => 'a\x1b]52;c' ... not printable
"""


def changed(data, line):
    """The data as text with one key as in a line."""
    rest = {key: x for key, x in data.items() if key != line.partition(":")[0]}
    return f"{yaml.safe_dump(rest)}{line}\n"


def test_files_that_are_no_arm_are_refused(tmp_path):
    def read(data):
        return ac.load_arm(write(tmp_path, data))

    refusals(read, NO_ARMS)
    refusals(lambda x: read(changed(GOOD, x)), CHANGES)
    refusals(lambda x: read(changed(SERIAL, x)), SERIAL_CHANGES)
    numbers = ('"1_0"', '"١"', "true", ".inf", ".nan", '"1e999"')
    masses = [(f"masses: {{value: [{x}, 1], unit: kg}}", "masses in") for x in numbers]
    refusals(lambda x: read(changed(SERIAL, x)), masses, "finite numbers in kg")
    lacking = {key: value for key, value in SERIAL.items() if key != "centers"}
    refusals(read, [(lacking, "all of masses, centers")])
    (tmp_path / "bytes.yaml").write_bytes(b"name: \xff\xfe\x00")
    places = [
        (tmp_path / "no.yaml", "no arm file ... no.yaml"),
        (tmp_path / "bytes.yaml", "bytes.yaml ... is not valid YAML"),
        ("pmk4s", "no built-in arm 'pmk4s' ... pmk3s ... .yaml, .urdf or .xacro file"),
    ]
    refusals(ac.load_arm, places)
    # What is chosen of a description is no choice of an arm file.
    choices = [(x, "ur5e ... .urdf") for x in ({"tip": "t"}, {"base": "b"}, {"locked": {"j": 0}})]
    refusals(lambda x: ac.load_arm("ur5e", **x), choices)


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


def test_a_plane_arm_may_have_bodies_and_carry_a_payload(tmp_path):
    units = {"outer_diameter": "m", "wall": "m", "density": "kg/m^3"}
    values = zip(units.items(), (0.08, 0.005, 2700), strict=True)
    tubes = {key: {"value": [x] * 2, "unit": unit} for (key, unit), x in values}
    file = write(tmp_path, GOOD | {"tubes": tubes, "assumed": "tubes"})
    bare, loaded = ac.load_arm(file), ac.load_arm(file, payload=Payload(mass=2.0))
    assert bare.chain.assumed == "tubes"
    np.testing.assert_allclose(
        bare.chain.masses, 2700 * np.pi * (0.04**2 - 0.035**2) * np.array([0.3, 0.2])
    )
    still, push = np.zeros(2), np.ones(2)
    assert loaded.torque(still, still, push)[0] > bare.torque(still, still, push)[0] + 0.5
    refusals(lambda x: ac.load_arm(file, tool=x), [(Frame(), "moves in the plane ... no tool")])


def test_built_in_arms_take_tools_payloads_and_frames():
    tool, work = Frame.rpy([0, 0, 0.2], [0, 0, 0]), Frame.rpy([0.5, 0, 0], [0, 0, 1])
    arm = ac.load_arm("ur5e", tool=tool, work=work, payload=Payload(mass=3.0))
    assert arm.chain.payload.mass == 3.0 and arm.chain.tool is tool
    np.testing.assert_allclose(arm.chain.base.position, work.inverse.position)
    assert arm.chain.assumed == ac.load_arm("ur5e").chain.assumed


def test_arm_files_are_read_without_the_traps_of_yaml(tmp_path):
    flood = "".join(f"x{i}: &x{i} [{', '.join([f'*x{i - 1}'] * 10)}]\n" for i in range(1, 9))
    table = [
        ("name: a\nlinks: [1, 1]\nname: b\n", "arm.yaml ... 'name' stands twice ... line 3"),
        (f"x0: &x0 [1]\n{flood}", "fewer aliases"),
    ]
    refusals(lambda x: ac.load_arm(write(tmp_path, x)), table)
    limits = write(tmp_path, "joint_limits: {a: {max_velocity: 1, max_velocity: 2}}")
    twice = [(limits, "'max_velocity' stands twice")]
    refusals(lambda x: ac.load_arm("ur5e", joint_limits=x), twice)
    # What YAML merges is no key twice.
    text = "y: &y {b: 1e-3, c: 2}\na: {in: &x {<<: *y, c: !degrees 180}}\nd: {<<: *x, b: 4}"
    found = _yaml.load(text, "x.yaml", _yaml.AngleLoader)
    assert found["a"]["in"] == {"b": 1e-3, "c": np.pi} and found["d"] == {"b": 4, "c": np.pi}


def test_loading_an_arm_loads_nothing_that_only_jobs_need():
    code = "import armcontour as ac, sys; ac.load_arm('ur5e'); print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    imported = set(done.stdout.split())
    assert "armcontour.io.robots.arm_file" in imported
    assert not imported & {"pydantic", "pint", "numba", "pinocchio", "scipy", "xacro"}


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
def put(tmp_path):
    def to(text, name="robot.yaml"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return to


def test_payload_and_friction_replace_those_of_the_named_arm(put):
    file, base = put(HEAD + PAYLOAD + FRICTION), ac.load_arm("ur5e")
    arm = ac.load_arm(file)
    chain = arm.chain
    assert arm.name == "loaded" and arm.joint_names == base.joint_names
    assert chain.payload.mass == 2.5 and chain.payload.center.tolist() == [0.01, 0, 0.05]
    np.testing.assert_array_equal(chain.viscous, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(chain.coulomb, [6, 5, 4, 3, 2, 1])
    np.testing.assert_array_equal(chain.armature, np.full(6, 0.1))
    q = np.full(6, 0.3)
    np.testing.assert_array_equal(arm.forward(q), base.forward(q))
    # A payload that is asked for replaces that of the file.
    assert ac.load_arm(file, payload=Payload(mass=1.0)).chain.payload.mass == 1.0
    # The named arm may be a file beside it.
    put(HEAD + PAYLOAD, "first.yaml")
    chain = ac.load_arm(put(HEAD.replace("ur5e", "{file: first.yaml}") + FRICTION)).chain
    assert chain.payload.mass == 2.5 and chain.coulomb[0] == 6.0
    # What the file does not give stays.
    chain = ac.load_arm(put(HEAD.replace("ur5e", "panda"))).chain
    np.testing.assert_array_equal(chain.coulomb, ac.load_arm("panda").chain.coulomb)
    assert chain.payload is None


BAD_DERIVED = [
    (HEAD.replace("arm: ur5e\n", ""), "arm must be the name of a built-in arm"),
    (HEAD.replace("ur5e", "{file: a.urdf, speed: 1}"), "arm must be the name"),
    (HEAD.replace("ur5e", "{name: ur5e, file: a.urdf}"), "either name, a built-in arm, or file"),
    (HEAD.replace("ur5e", "{name: ur5e, tip: tool0}"), "has no other tip"),
    (HEAD.replace("ur5e", "{file: robot.yaml}"), "leads back to it"),
    (HEAD + PAYLOAD.splitlines()[1], "payload_center needs the payload_mass"),
    (HEAD + PAYLOAD.replace("kg", "g"), "must be given in kg"),
    (HEAD + "coulomb: {value: [1, 2], unit: N m, source: c}", "6 numbers"),
    (HEAD + "coulomb: 3", "a quantity with value, unit and source"),
    (HEAD + "masses: {value: 1, unit: kg}", "it takes the keys"),
    (HEAD.replace("ur5e", "ur6e"), "There is no built-in arm 'ur6e'"),
]


def test_files_of_no_derived_arm_are_refused(put):
    refusals(lambda x: ac.load_arm(put(x)), BAD_DERIVED)
