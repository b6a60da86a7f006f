"""Torques of cells with rails and positioners, read from job files, against pinocchio."""

import json

import numpy as np
import pytest
from tests.dynamics_extra import needs_dynamics, pinocchio

import armcontour as ac
from armcontour.core.frames import Frame
from armcontour.files import parse_job
from armcontour.robot import Payload

# Components xx, xy, xz, yy, yz and zz of a tensor in a job file.
UPPER = np.triu_indices(3)


def some_inertia(rng):
    """Inertia that a body can have, in general position [kg m²]."""
    masses = rng.uniform(0.2, 2.0, 4)
    points = rng.normal(size=(4, 3)) * 0.2
    tensor = np.zeros((3, 3))
    for mass, point in zip(masses, points, strict=True):
        tensor += mass * (point @ point * np.eye(3) - np.outer(point, point))
    return tensor


def components(tensor):
    return [float(x) for x in tensor[UPPER]]


def some_frame(rng):
    return {"position": rng.uniform(-0.5, 1.0, 3).tolist(), "rpy": rng.uniform(-1, 1, 3).tolist()}


def as_frame(data):
    return Frame() if data is None else Frame.rpy(data["position"], data["rpy"])


def some_cell(rng):
    """Values of the keys `arm` and `path.frame` of a random cell."""
    usual = {"lower": -3.0, "upper": 3.0, "velocity": 1.5, "acceleration": 2.0}
    axes = []
    for name in ("tilt", "turn")[-rng.integers(1, 3) :]:
        body = {"mass": rng.uniform(5, 50), "inertia": components(some_inertia(rng))}
        if rng.random() < 0.7:
            body["center"] = rng.uniform(-0.5, 1.0, 3).tolist()
        line = {"axis": rng.normal(size=3).tolist(), "origin": rng.uniform(-0.5, 1.0, 3).tolist()}
        axes.append({"name": name, **usual, **line, **body})
    part = {"mass": rng.uniform(1, 30), "center": rng.uniform(-0.2, 0.2, 3).tolist()}
    if rng.random() < 0.7:
        part["inertia"] = components(some_inertia(rng))
    arm = {"name": "ur10e", "positioner": {"axes": axes, "part": part}}
    if rng.random() < 0.5:
        arm["work"] = some_frame(rng)
    if rng.random() < 0.6:
        line = {"axis": rng.normal(size=3).tolist(), "origin": rng.uniform(-0.5, 1.0, 3).tolist()}
        arm["rail"] = {**usual, **line, "mass": rng.uniform(20, 90)}
    return arm, some_frame(rng) if rng.random() < 0.8 else None


def job_text(arm, frame):
    """A job file, in YAML's subset JSON; plain numbers are in SI units."""
    path = {"points": [[0, 0, 0], [0.1, 0, 0]]} | ({} if frame is None else {"frame": frame})
    servo = {"kp": 25, "kv": 150}
    return json.dumps({"name": "x", "arm": arm, "path": path, "servo": servo, "runs": {"a": {}}})


def tensor_of(values):
    tensor = np.zeros((3, 3))
    tensor[UPPER] = values
    return np.triu(tensor) + np.triu(tensor, 1).T


def same_cell_in_python(arm, frame):
    """The arm that Python makes of the same numbers, with its work frame on the part."""
    part_frame = as_frame(arm.get("work")) @ as_frame(frame)
    made = ac.load_arm("ur10e").with_work(part_frame)
    if "rail" in arm:
        made = made.with_rail(ac.Rail(**arm["rail"]))
    axes = []
    for x in arm["positioner"]["axes"]:
        axes.append(ac.PositionerAxis(**x | {"inertia": tensor_of(x["inertia"])}))
    load = dict(arm["positioner"]["part"])
    if "inertia" in load:
        load["inertia"] = tensor_of(load["inertia"])
    return made.with_positioner(ac.Positioner(axes=axes, part=Payload(**load)))


def torques_in_pinocchio(arm, frame, q, dq, ddq):
    """Torques of the cell as a tree of joints, in the order of armcontour's joints."""
    pin = pinocchio()
    model = pin.Model()
    axes = arm["positioner"]["axes"]
    carried = 0
    before = np.zeros(3)
    for x in axes:
        along = np.array(x["axis"]) / np.linalg.norm(x["axis"])
        place = pin.SE3(np.eye(3), np.array(x["origin"]) - before)
        joint = pin.JointModelRevoluteUnaligned(along)
        carried = model.addJoint(carried, joint, place, x["name"])
        before = np.array(x["origin"])
        center = np.array(x.get("center", x["origin"])) - before
        body = pin.Inertia(x["mass"], center, tensor_of(x["inertia"]))
        model.appendBodyToJoint(carried, body, pin.SE3.Identity())
    # The part: the drawing's frame in the work frame, which is fixed to the last axis.
    load = arm["positioner"]["part"]
    tensor = tensor_of(load["inertia"]) if "inertia" in load else np.zeros((3, 3))
    part = as_frame(arm.get("work")) @ as_frame(frame)
    body = pin.Inertia(load["mass"], np.array(load["center"]), tensor)
    model.appendBodyToJoint(carried, body, pin.SE3(part.rotation, part.position - before))
    base = 0
    place = np.zeros(3)
    if "rail" in arm:
        rail = arm["rail"]
        along = np.array(rail["axis"]) / np.linalg.norm(rail["axis"])
        joint = pin.JointModelPrismaticUnaligned(along)
        base = model.addJoint(0, joint, pin.SE3(np.eye(3), np.zeros(3)), "rail")
        body = pin.Inertia(rail["mass"], np.zeros(3), np.zeros((3, 3)))
        model.appendBodyToJoint(base, body, pin.SE3.Identity())
        place = np.array(rail["origin"])
    own = ac.load_arm("ur10e").chain
    for k in range(len(own)):
        at = pin.SE3(np.array(own.rotations[k]), np.array(own.positions[k]) + place)
        joint = pin.JointModelRevoluteUnaligned(np.array(own.axes[k]))
        base = model.addJoint(base, joint, at, f"joint {k}")
        inertia = np.array(own.inertias[k])
        body = pin.Inertia(float(own.masses[k]), np.array(own.centers[k]), inertia)
        model.appendBodyToJoint(base, body, pin.SE3.Identity())
        place = np.zeros(3)
    count = len(axes)
    order = [*range(count - 1, -1, -1), *range(count, len(q))]
    states = [x[order] for x in (q, dq, ddq)]
    torques = pin.rnea(model, model.createData(), *states)
    drives = np.zeros(len(q))
    drives[-len(own) :] = np.array(own.armature) * ddq[-len(own) :]
    return torques[order] + drives


@needs_dynamics
@pytest.mark.parametrize("seed", range(30))
def test_torques_of_a_cell_in_a_job_file_are_those_of_pinocchio_and_of_python(seed):
    rng = np.random.default_rng(seed)
    arm, frame = some_cell(rng)
    read = parse_job(job_text(arm, frame)).arm
    made = same_cell_in_python(arm, frame)
    assert read.joint_names == made.joint_names
    for q, dq, ddq in rng.normal(size=(5, 3, read.dof)):
        torques = read.dynamics.torque(q, dq, ddq)
        expected = torques_in_pinocchio(arm, frame, q, dq, ddq)
        size = np.abs(expected).max()
        np.testing.assert_allclose(torques, expected, rtol=0, atol=1e-9 * max(1.0, size))
        of_python = made.dynamics.torque(q, dq, ddq)
        np.testing.assert_allclose(torques, of_python, rtol=0, atol=1e-9 * max(1.0, size))


def test_positioner_load_is_on_top_of_table(tmp_path):
    # A tilted table whose load is above its axis: gravity turns it further.
    (tmp_path / "line.csv").write_text(
        "x [mm],y [mm],z [mm],ax,ay,az\n0,0,100,0,0,-1\n50,0,100,0,0,-1\n"
    )
    for x in (0.9, 1.2):
        patch = {("path", "frame", "position"): [x, 0, 0.4]}
        job = ac.read_job(tmp_path / "line.csv", cell="ur10e_positioner", patch=patch)
        (table,) = (y for y in job.scene.obstacles if y.fixed_to == "part")
        load = job.arm.chain.positioner.part
        center = table.place.position + np.array([0, 0, 0.011 + 0.05])
        np.testing.assert_allclose(load.center, center, atol=1e-12)
        q = np.zeros(job.arm.dof)
        q[1] = 0.9
        tilt = job.arm.dynamics.torque(q, 0 * q, 0 * q)[1]
        # kg m above and beside the tilt axis, which is at x = 0.9 m and z = 0.3 m.
        above = 30 * 0.10 + 7 * 0.15
        beside = 7 * (x - 0.9)
        expected = -9.81 * (np.sin(0.9) * above + np.cos(0.9) * beside)
        assert tilt == pytest.approx(expected, abs=1e-9)
