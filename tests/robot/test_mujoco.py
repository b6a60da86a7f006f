"""Built-in arms compared with MuJoCo, whose models are made from the files independently."""

from importlib import resources

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.geometry.tables import each

import armcontour as ac
from armcontour.robot import Dynamics

mujoco = pytest.importorskip("mujoco")

STATES = 1000


def states(arm, seed=0, n=STATES):
    rng = np.random.default_rng(seed)
    return tuple(rng.uniform(-size, size, (n, arm.dof)) for size in (np.pi, 3.0, 10.0))


@each("name", ac.arm_names())
def test_poses_torques_and_jacobians_equal_those_of_mujoco(name):
    arm = ac.load_arm(name)
    armature = np.linspace(0.5, 0.1, arm.dof)
    q, dq, ddq = states(arm)
    torque, point, rotation, jacobian = seen_by_mujoco(model_of(name, armature), q, dq, ddq)
    computed = Dynamics(arm.chain.replace(armature=armature)).torque(q, dq, ddq)
    largest = np.abs(torque).max(axis=1, keepdims=True)
    assert (np.abs(computed - torque) <= 1e-8 * largest).all()
    if arm.dimension == 3:
        points, rotations = arm.pose(q)
        np.testing.assert_allclose(points, point, atol=1e-9)
        np.testing.assert_allclose(rotations, rotation, atol=1e-9)
        np.testing.assert_allclose(arm.jacobian(q), jacobian, atol=1e-9)
    else:
        np.testing.assert_allclose(arm.tool_position(q), point[:, :2], atol=1e-9)
        np.testing.assert_allclose(arm.tool_jacobian(q), jacobian[:, :2], atol=1e-9)


def model_of(name, armature):
    """A model of a built-in arm, with the site "tool" at its tip."""
    file = resources.files("armcontour.files.robots") / "library" / f"{name}.yaml"
    data = yaml.safe_load(file.read_text("utf-8"))
    bodies = planar(data) if data["kind"] == "planar_two_link" else serial(data)
    tip = words(data["tip"]["value"]) if "tip" in data else bodies.pop("tip", "0 0 0")
    gravity = bodies.pop("gravity", "0 0 -9.81")
    text = ""
    for k, mass in enumerate(bodies["mass"]):
        pos, quat, axis, com, inertia = (
            words(bodies[x][k]) for x in ("pos", "quat", "axis", "com", "inertia")
        )
        text += (
            f'<body pos="{pos}" quat="{quat}">'
            f'<joint type="hinge" axis="{axis}" armature="{float(armature[k])!r}"/>'
            f'<inertial pos="{com}" mass="{mass!r}" fullinertia="{inertia}"/>'
        )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><option gravity="{gravity}"/><worldbody>{text}'
        f'<site name="tool" pos="{tip}"/>{"</body>" * len(bodies["mass"])}'
        "</worldbody></mujoco>"
    )


def seen_by_mujoco(model, q, dq, ddq):
    """Torques and the tool's position, rotation and Jacobian, by MuJoCo, one state at a time."""
    data = mujoco.MjData(model)
    states = []
    for state in zip(q, dq, ddq, strict=True):
        data.qpos[:], data.qvel[:], data.qacc[:] = state
        mujoco.mj_inverse(model, data)
        linear = np.zeros((3, model.nv))
        angular = np.zeros((3, model.nv))
        mujoco.mj_jacSite(model, data, linear, angular, 0)
        place = data.site_xpos[0].copy(), data.site_xmat[0].reshape(3, 3).copy()
        states.append((data.qfrc_inverse.copy(), *place, np.vstack([linear, angular])))
    return tuple(np.array(x) for x in zip(*states, strict=True))


def serial(data):
    turns = Rotation.from_euler("xyz", data["angles"]["value"])
    along = Rotation.identity(len(turns))
    if "inertia_angles" in data:
        along = Rotation.from_euler("xyz", data["inertia_angles"]["value"])
    inertias = []
    for axes, inertia in zip(along.as_matrix(), data["inertias"]["value"], strict=True):
        xx, xy, xz, yy, yz, zz = inertia
        full = axes @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ axes.T
        inertias.append(six(full))
    return {
        "pos": data["positions"]["value"],
        "quat": turns.as_quat()[:, [3, 0, 1, 2]],
        "axis": data["axes"]["value"],
        "com": data["centers"]["value"],
        "mass": data["masses"]["value"],
        "inertia": inertias,
    }


def planar(data):
    lengths = np.array(data["links"]["value"])
    tubes = {key: np.array(x["value"]) for key, x in data["tubes"].items()}
    outer = tubes["outer_diameter"] / 2
    inner = outer - tubes["wall"]
    mass = tubes["density"] * np.pi * (outer**2 - inner**2) * lengths
    across = mass * (3 * (outer**2 + inner**2) + lengths**2) / 12
    along = mass * (outer**2 + inner**2) / 2
    zero = np.zeros(2)
    return {
        "pos": [[data["base"]["value"], 0, 0], [0, lengths[0], 0]],
        "quat": [[1, 0, 0, 0]] * 2,
        "axis": [[0, 0, -1]] * 2,
        "com": np.outer(lengths / 2, [0, 1, 0]),
        "mass": mass.tolist(),
        "inertia": np.stack([across, along, across, zero, zero, zero], axis=1),
        "tip": words([0, lengths[1], 0]),
        "gravity": "0 0 0",
    }


def six(full):
    """An inertia in MuJoCo's order."""
    return [full[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def words(numbers):
    return " ".join(repr(float(x)) for x in numbers)
