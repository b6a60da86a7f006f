"""Arms from `pinocchio.Model` and from MJCF files, against the libraries themselves."""

import numpy as np
import pytest
from tests.dynamics_extra import pinocchio

import armcontour as ac

mujoco = pytest.importorskip("mujoco")

MJCF = """<mujoco model="bent"><worldbody><body name="base" pos="0 0 .1">
  <body name="first" pos="0 0 .2" quat=".9 .1 0 0">
    <joint name="j1" axis="0 0 1" range="-170 170" damping=".3" armature=".1" frictionloss=".2"
           pos="0.01 0.02 0"/><geom type="capsule" size=".05" fromto="0 0 0 0 0 .3"/>
    <body name="second" pos="0 0 .3"><joint name="j2" axis="0 1 0" range="-100 100" ref="20"/>
      <geom type="capsule" size=".04" fromto="0 0 0 .3 0 0"/>
      <body name="third" pos=".3 0 0" euler="0 90 0"><joint name="j3" axis="1 .2 0"/>
        <geom type="capsule" size=".04" fromto="0 0 0 .1 0 0"/>
        <site name="tcp" pos=".1 0 0.02" euler="10 0 0"/>
        <body name="finger"><joint name="grip" type="slide" axis="0 1 0"/><geom size=".01"/></body>
      </body></body></body></body>
  <body name="cube" pos="1 0 0"><freejoint/><geom size=".1"/></body></worldbody>
  <actuator><motor joint="j1" gear="2" forcerange="-10 10"/></actuator></mujoco>"""


@pytest.fixture
def mjcf(tmp_path):
    file = tmp_path / "bent.xml"
    file.write_text(MJCF, encoding="utf-8")
    return file


def test_an_arm_of_a_model_moves_as_the_model():
    pin = pinocchio()
    model = pin.buildSampleModelManipulator()
    arm, tip = (
        ac.load_arm(model, ac.ArmOptions(tip="effector_body")),
        model.getFrameId("effector_body"),
    )
    data, (q, dq, ddq) = model.createData(), np.random.default_rng(0).uniform(-1, 1, (3, 6))
    pin.framesForwardKinematics(model, data, q)
    np.testing.assert_allclose(arm.forward(q), data.oMf[tip].homogeneous, atol=1e-12)
    np.testing.assert_allclose(arm.torque(q, dq, ddq), pin.rnea(model, data, q, dq, ddq), atol=1e-9)
    np.testing.assert_array_equal(arm.limits.joint_velocity, model.velocityLimit)
    np.testing.assert_array_equal(arm.limits.joint_upper, model.upperPositionLimit)
    # Accelerations are assumed, and a note says so.
    assert arm.limits.joint_acceleration is not None and "no acceleration limits" in arm.notes[0]
    # A path is planned for it as for any arm, here without weight.
    model.gravity.linear = np.zeros(3)
    arm = ac.load_arm(model, ac.ArmOptions(tip="effector_body"))
    line = ac.Path.polyline(arm.tool_position([q, q + 0.05])).oriented(arm.forward(q)[:3, :3])
    assert ac.plan(line, arm, arm.limits.replace(speed=0.1), ac.Optimal(seed=q)).duration > 0


def test_joints_that_are_locked_carry_what_hangs_on_them():
    pin = pinocchio()
    model = pin.buildSampleModelManipulator()
    name, value = model.names[3], 0.4
    arm = ac.load_arm(model, ac.ArmOptions(tip="effector_body", locked={name: value}))
    assert arm.dof == 5 and name not in arm.joint_names
    rng = np.random.default_rng(1)
    q, dq, ddq = (np.insert(rng.uniform(-1, 1, 5), 2, x) for x in (value, 0.0, 0.0))
    data, free_joints = model.createData(), np.delete(np.arange(6), 2)
    pin.framesForwardKinematics(model, data, q)
    tip = data.oMf[model.getFrameId("effector_body")].homogeneous
    np.testing.assert_allclose(arm.forward(q[free_joints]), tip, atol=1e-12)
    torque = pin.rnea(model, data, q, dq, ddq)[free_joints]
    np.testing.assert_allclose(
        arm.torque(q[free_joints], dq[free_joints], ddq[free_joints]), torque, atol=1e-9
    )


@pytest.mark.parametrize("name", ac.arm_names())
def test_an_arm_comes_back_from_its_own_model(name):
    pinocchio()
    arm = ac.load_arm(name)
    again = ac.load_arm(arm.pinocchio, ac.ArmOptions(tip="tool"))
    q = np.linspace(0.1, 0.6, arm.dof)
    np.testing.assert_allclose(again.forward(q), arm.forward(q), atol=1e-12)
    for limit in ("joint_velocity", "joint_torque", "joint_lower", "joint_upper"):
        expected, limits = getattr(arm.limits, limit), getattr(again.limits, limit)
        assert (expected is None) == (limits is None)
        if expected is not None:
            np.testing.assert_allclose(limits, expected)


def test_an_mjcf_file_moves_as_in_mujoco(mjcf):
    arm = ac.load_arm(mjcf, ac.ArmOptions(tip="tcp"))
    assert arm.joint_names == ("j1", "j2", "j3")
    model = mujoco.MjModel.from_xml_path(str(mjcf))
    data = mujoco.MjData(model)
    q, dq, ddq = [0.3, 0.5, -0.2], [0.1, 0.2, 0.3], [1.0, 2.0, 3.0]
    data.qpos[:3], data.qvel[:3], data.qacc[:3] = q, dq, ddq
    data.qacc[3:] = 0.0
    mujoco.mj_inverse(model, data)
    site = data.site("tcp")
    pose = arm.forward(q)
    np.testing.assert_allclose(pose[:3, 3], site.xpos, atol=1e-12)
    np.testing.assert_allclose(pose[:3, :3].ravel(), site.xmat, atol=1e-12)
    # MuJoCo's friction is a constraint: torques are compared without it.
    torque = arm.torque(q, dq, ddq) - arm.chain.coulomb * np.sign(dq)
    friction = np.zeros(3) if not data.nefc else data.qfrc_constraint[:3]
    np.testing.assert_allclose(torque, data.qfrc_inverse[:3] + friction, atol=1e-6)
    np.testing.assert_allclose(arm.limits.joint_upper, [np.radians(170), np.radians(100), np.inf])
    np.testing.assert_array_equal(arm.chain.armature, [0.1, 0.0, 0.0])


@pytest.mark.parametrize("locked", [{"j2": 0.6}, {"j1": -0.3, "grip": 0.05}])
def test_locked_joints_of_an_mjcf_file_carry_what_hangs_on_them(mjcf, locked):
    whole = ac.load_arm(mjcf, ac.ArmOptions(tip="tcp", locked={"grip": locked.get("grip", 0.0)}))
    arm = ac.load_arm(mjcf, ac.ArmOptions(tip="tcp", locked=locked))
    free = [k for k, x in enumerate(whole.joint_names) if x not in locked]
    assert arm.joint_names == tuple(whole.joint_names[k] for k in free)
    q, dq, ddq = np.zeros((3, 50, 3))
    q[:] = [locked.get(x, 0.0) for x in whole.joint_names]
    for x in (q, dq, ddq):
        x[:, free] = np.random.default_rng(2).normal(size=(50, len(free)))
    free_state = [x[:, free] for x in (q, dq, ddq)]
    np.testing.assert_allclose(arm.forward(free_state[0]), whole.forward(q), atol=1e-12)
    np.testing.assert_allclose(
        arm.torque(*free_state), whole.torque(q, dq, ddq)[:, free], atol=1e-9
    )


def test_a_model_that_is_no_arm_is_refused(refuses):
    model = pinocchio().buildSampleModelManipulator()
    refuses(lambda: ac.load_arm(model), ac.InvalidInput, "effector_body")
    refuses(
        lambda: ac.load_arm(model, ac.ArmOptions(tip="hand")),
        ac.InvalidInput,
        "hand",
        "effector_body",
    )
    refuses(lambda: ac.load_arm(model, ac.ArmOptions(tip="universe")), ac.InvalidInput)
    refuses(
        lambda: ac.load_arm(model, ac.ArmOptions(tip="effector_body", base="x")), ac.InvalidInput
    )
    refuses(
        lambda: ac.load_arm(model, ac.ArmOptions(tip="effector_body", locked={"x": 0})),
        ac.InvalidInput,
        "x",
    )


def test_a_file_that_is_no_arm_is_refused(mjcf, tmp_path, refuses, monkeypatch):
    refuses(lambda: ac.load_arm(mjcf), ac.InvalidInput, "third", "tcp")
    for name, words in (("base", "moves its tip"), ("world", "moves its tip"), ("hand", "tcp")):
        options = ac.ArmOptions(tip=name)
        refuses(lambda x=options: ac.load_arm(mjcf, x), ac.InvalidInput, words)
    held = ac.ArmOptions(tip="tcp", locked={"x": 0})
    refuses(lambda: ac.load_arm(mjcf, held), ac.InvalidInput, "grip")
    refuses(lambda: ac.load_arm(mjcf, ac.ArmOptions(tip="finger")), ac.InvalidInput, "grip")
    refuses(lambda: ac.load_arm(mjcf, ac.ArmOptions(tip="cube")), ac.InvalidInput)
    refuses(lambda: ac.load_arm(tmp_path / "none.xml"), ac.InvalidInput, "none.xml")
    other = tmp_path / "page.xml"
    other.write_text("<html/>", encoding="utf-8")
    refuses(lambda: ac.load_arm(other), ac.InvalidInput, "page.xml")
    for wrong in (3, None, ac.Frame()):
        refuses(lambda x=wrong: ac.load_arm(x), ac.InvalidInput)
    monkeypatch.setitem(__import__("sys").modules, "mujoco", None)
    refuses(
        lambda: ac.load_arm(mjcf, ac.ArmOptions(tip="tcp")),
        ac.InvalidInput,
        "mujoco",
        "armcontour[experiment]",
    )


@pytest.mark.parametrize("name", ["UR5e", "PMK-3s", "Panda", "pmk3s", "FR3"])
def test_names_are_found_as_they_are_printed(name, refuses):
    assert ac.load_arm(name).name.lower() == ac.load_arm(name.lower().replace("-", "")).name.lower()
    refuses(lambda: ac.load_arm("ur5"), ac.InvalidInput, "ur5e")
