"""Bodies of rails, gantries and positioners, against own kinematics."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from tests.report.drawn_bodies import Drawing, turn

import armcontour as ac
from armcontour.files import parse_job
from armcontour.report.arm_frame import arm_frame

RAIL = {"axis": [0.0, 2.0, 0.0], "lower": -0.5, "upper": 2.5, "velocity": 1, "acceleration": 1}
TILT = {"name": "tilt", "axis": [0.2, 1.0, 0.0], "origin": [0.9, 0.1, 0.35]}
TURN = {"name": "turn", "axis": [0.0, 0.1, 1.0], "origin": [0.95, 0.1, 0.45]}
RANGE = {"lower": -3.0, "upper": 3.0, "velocity": 1.5, "acceleration": 2.0}
FRAME = {"position": [0.95, 0.1, 0.45]}
PATH = {"points": [[0, 0, 0.05], [0.1, 0, 0.05]], "orientation": {"axis": [0, 0, -1]}}
SLIDES = {
    "gx": ("1 0 0", "0 0 0", 0, 6),
    "gy": ("0 1 0", "0 0 0", 0, 3),
    "gz": ("0 0 -1", "0 0 3", 0, 1),
}
HEIGHT = 3.0


def job(arm, **keys):
    servo = {"kp": 25, "kv": 150}
    text = {"name": "x", "arm": arm, "path": PATH, "servo": servo, "runs": {"a": {}}, **keys}
    return parse_job(json.dumps(text))


def cell(**keys):
    """A UR10e on a rail, before a positioner with two axes in general position."""
    positioner = {"axes": [TILT | RANGE, TURN | RANGE]}
    path = PATH | {"frame": FRAME}
    return job({"name": "ur10e", "rail": RAIL, "positioner": positioner}, path=path, **keys)


def gantry(tmp_path):
    """An arm of two joints that hangs on three sliding joints; no link has a shape."""
    names = [*SLIDES, "swing", "bend", "flange"]
    links = "".join(f'<link name="{x}_link"/>' for x in ["world", *names])
    joints = []
    parent = "world_link"
    for name, (axis, xyz, lower, upper) in SLIDES.items():
        joints.append((name, "prismatic", parent, xyz, axis, lower, upper))
        parent = f"{name}_link"
    for name, xyz, axis in (("swing", "0 0 -0.2", "0 0 1"), ("bend", "0 0 -0.4", "0 1 0")):
        joints.append((name, "revolute", parent, xyz, axis, -3, 3))
        parent = f"{name}_link"
    text = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{carrier}"/><child link="{name}_link"/>'
        f'<origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f'<limit effort="0" lower="{lower}" upper="{upper}" velocity="1"/></joint>'
        for name, kind, carrier, xyz, axis, lower, upper in joints
    )
    text += (
        f'<joint name="flange" type="fixed"><parent link="{parent}"/><child link="flange_link"/>'
        '<origin xyz="0 0 -0.5"/></joint>'
    )
    file = tmp_path / "gantry.urdf"
    file.write_text(f'<robot name="gantry">{links}{text}</robot>')
    return arm_frame(job({"file": str(file), "tip": "flange_link"}))


def moved(points, pose):
    return points @ pose[:3, :3].T + pose[:3, 3]


def postures(dof, count=6):
    q = np.random.default_rng(5).uniform(-1.0, 1.0, (count, dof))
    q[0] = 0.0
    return q


def test_bodies_of_a_cell_move_with_their_axes():
    drawing = Drawing(arm_frame(cell()))
    joints = drawing.header["joints"]
    columns = {x["name"]: x["column"] for x in joints}
    rest = np.zeros(len(joints))
    for q in postures(len(joints)):
        tilted = turn(TILT["axis"], TILT["origin"], q[columns["tilt"]])
        turned = tilted @ turn(TURN["axis"], TURN["origin"], q[columns["turn"]])
        slid = np.eye(4)
        slid[1, 3] = q[columns["rail"]]
        # Each joint has a body that moves with it, and one on its parent.
        expected = {
            "rail": [slid, np.eye(4)],
            "turn": [turned, tilted],
            "tilt": [tilted, tilted, tilted, np.eye(4)],
            "stand": [np.eye(4)],
        }
        for name, poses in expected.items():
            found = drawing.named(name, q)
            start = drawing.named(name, rest)
            assert len(found) == len(poses)
            for now, before, pose in zip(found, start, poses, strict=True):
                np.testing.assert_allclose(now, moved(before, pose), atol=1e-6)


def test_a_rail_carries_the_arm_over_its_whole_range():
    drawing = Drawing(arm_frame(cell()))
    dof = len(drawing.header["joints"])
    column = next(x["column"] for x in drawing.header["joints"] if x["name"] == "rail")
    for at in (RAIL["lower"], 0.7, RAIL["upper"]):
        q = np.zeros(dof)
        q[column] = at
        carriage, beam = drawing.named("rail", q)
        base = np.concatenate(drawing.named("base_link_inertia", q, "link"))
        # The arm stands on the carriage, and the carriage on the beam.
        assert carriage[:, 2].max() == pytest.approx(base[:, 2].min(), abs=1e-6)
        assert beam[:, 2].max() == pytest.approx(carriage[:, 2].min(), abs=1e-6)
        assert beam[:, 1].min() <= carriage[:, 1].min() + 1e-6
        assert carriage[:, 1].max() <= beam[:, 1].max() + 1e-6
        middle = (carriage.max(axis=0) + carriage.min(axis=0)) / 2
        np.testing.assert_allclose(middle[:2], [0.0, at], atol=1e-6)
    # The beam is little longer than the range.
    assert RAIL["upper"] - RAIL["lower"] < np.ptp(beam[:, 1]) < RAIL["upper"] - RAIL["lower"] + 0.5


@pytest.mark.parametrize("floor", [None, -0.4, -0.1, -0.03, 0.0])
def test_a_structure_stands_on_the_floor_and_is_visible(floor):
    scene = {} if floor is None else {"scene": {"floor": floor}}
    drawing = Drawing(arm_frame(cell(**scene)))
    ground = drawing.header["ground"]
    q = np.zeros(len(drawing.header["joints"]))
    _, beam = drawing.named("rail", q)
    stands = drawing.named("stand", q)
    lowest = min(x[:, 2].min() for x in [beam, *stands])
    assert lowest == pytest.approx(ground, abs=1e-6)
    assert beam[:, 2].max() > ground + 0.005
    assert ground == (
        pytest.approx(floor, abs=1e-9) if floor is not None else pytest.approx(lowest)
    )
    if floor is None:
        assert ground < 0.0


def test_the_part_stands_on_the_faceplate():
    vice = {"type": "box", "name": "vice", "size": [0.3, 0.2, 0.1], "at": [0.02, 0, -0.06]}
    job_with_part = cell(scene={"obstacles": [vice | {"fixed_to": "part"}]})
    along = np.array(TURN["axis"]) / np.linalg.norm(TURN["axis"])
    for made in (cell(), job_with_part):
        drawing = Drawing(arm_frame(made))
        q = np.zeros(len(drawing.header["joints"]))
        plate = drawing.named("turn", q)[0] - TURN["origin"]
        part = drawing.corners(q, lambda x: x["colour"] == "part")
        # Without a part, the plate is at the origin of the axis, and the path above.
        heights = (np.concatenate(part) - TURN["origin"]) @ along if part else np.zeros(1)
        assert (plate @ along).max() == pytest.approx(min(0.0, heights.min()), abs=1e-6)
        # Its axis is that of the joint.
        away = plate - np.outer(plate @ along, along)
        assert np.ptp(np.linalg.norm(away, axis=1)) < 1e-6


def test_a_headstock_holds_the_part_at_its_end():
    axis = {"name": "head", "axis": [0, 1, 0], "origin": [0.8, 0.0, 0.6], **RANGE}
    path = {"points": [[0, 0.1, 0.1], [0, 0.9, 0.1]], "orientation": {"axis": [0, 0, -1]}}
    arm = {"name": "ur10e", "positioner": {"axes": [axis]}}
    made = job(arm, path=path | {"frame": {"position": [0.8, 0.0, 0.6]}})
    drawing = Drawing(arm_frame(made))
    plate, housing = drawing.named("head", np.zeros(7))
    assert plate[:, 1].max() == pytest.approx(0.0, abs=1e-6)
    assert housing[:, 1].max() == pytest.approx(plate[:, 1].min(), abs=1e-6)
    (stand,) = drawing.named("stand", np.zeros(7))
    assert stand[:, 1].max() < plate[:, 1].max()
    assert stand[:, 2].min() == pytest.approx(0.0, abs=1e-6)


def test_beams_of_a_gantry_are_where_its_joints_move(tmp_path):
    drawing = Drawing(gantry(tmp_path))
    lower = np.array([x[2] for x in SLIDES.values()], dtype=float)
    upper = np.array([x[3] for x in SLIDES.values()], dtype=float)
    for share in ([0, 0, 0], [1, 1, 1], [0.3, 0.8, 0.1]):
        slides = lower + np.array(share) * (upper - lower)
        q = np.array([*slides, 0.4, 0.2])
        ram, sleeve = drawing.named("gz", q)
        bridge_carriage, bridge = drawing.named("gy", q)
        runway = drawing.named("gx", q)
        # The ram ends at the arm, and its other end never leaves the sleeve.
        end = np.array([slides[0], slides[1], HEIGHT - slides[2]])
        middle = (ram.max(axis=0) + ram.min(axis=0)) / 2
        np.testing.assert_allclose(middle[:2], end[:2], atol=1e-6)
        assert ram[:, 2].min() == pytest.approx(end[2], abs=1e-6)
        assert ram[:, 2].min() <= sleeve[:, 2].min() + 1e-6
        assert ram[:, 2].max() >= sleeve[:, 2].max() - 1e-6
        # The carriage of the bridge stays on the bridge, that of the runways on the runways.
        assert bridge[:, 1].min() <= bridge_carriage[:, 1].min() + 1e-6
        assert bridge_carriage[:, 1].max() <= bridge[:, 1].max() + 1e-6
        carriages = runway[0::2]
        beams = runway[1::2]
        assert len(carriages) == len(beams) == 2
        for carriage, beam in zip(carriages, beams, strict=True):
            assert beam[:, 0].min() <= carriage[:, 0].min() + 1e-6
            assert carriage[:, 0].max() <= beam[:, 0].max() + 1e-6
            assert carriage[:, 2].max() == pytest.approx(bridge[:, 2].min(), abs=1e-6)
            assert bridge[:, 1].min() <= carriage[:, 1].max()
            assert carriage[:, 1].min() <= bridge[:, 1].max()
        stands = drawing.named("stand", q)
        assert len(stands) == 4
        for stand in stands:
            assert stand[:, 2].min() == pytest.approx(0.0, abs=1e-6)
            assert stand[:, 2].max() == pytest.approx(beams[0][:, 2].min(), abs=1e-6)


def test_links_without_shapes_are_sticks_between_the_joints(tmp_path):
    frame = gantry(tmp_path)
    drawing = Drawing(frame)
    q = np.array([1.0, 2.0, 0.5, 0.0, np.pi / 2])
    sticks = drawing.corners(q, lambda x: x["colour"] == "link")
    start = np.array([1.0, 2.0, HEIGHT - 0.5])
    ends = [start, start - [0, 0, 0.2], start - [0, 0, 0.6], start - [0.5, 0, 0.6]]
    assert len(sticks) == 3
    for stick, a, b in zip(sticks, ends[:-1], ends[1:], strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        heights = (stick - a) @ along
        assert heights.min() == pytest.approx(0.0, abs=1e-6)
        assert heights.max() == pytest.approx(np.linalg.norm(b - a), abs=1e-6)
        away = np.linalg.norm(stick - a - np.outer(heights, along), axis=1)
        assert 0.001 < away.min() and np.ptp(away) < 1e-6
    assert any("sticks" in x for x in frame.header["notes"])


def test_a_tool_with_shapes_has_no_cone():
    torch = [
        {"type": "cylinder", "name": "torch", "at": [0, 0, 0.1], "radius": 0.02, "length": 0.2}
    ]
    plain = {"name": "ur10e", "tool": {"position": [0, 0, 0.3]}}
    for tool, names in ((plain["tool"], ["tool"]), (plain["tool"] | {"shapes": torch}, ["torch"])):
        bodies = arm_frame(job(plain | {"tool": tool})).header["bodies"]
        assert [x["name"] for x in bodies if x["colour"] == "tool"] == names


def test_axes_whose_links_have_shapes_are_not_drawn_twice():
    bare = cell()
    assert len(Drawing(arm_frame(bare)).named("tilt", np.zeros(9))) == 4
    table = {"link": "turn", "name": "table", "type": "box", "size": [0.4, 0.4, 0.05]}
    slab = {
        "link": "base",
        "name": "slab",
        "type": "box",
        "size": [0.4, 3, 0.1],
        "at": [0, 1, -0.06],
    }
    positioner = {"axes": [TILT | RANGE, TURN | RANGE]}
    arm = {"name": "ur10e", "rail": RAIL, "positioner": positioner, "shapes": [table, slab]}
    header = arm_frame(job(arm, path=PATH | {"frame": FRAME})).header
    assert not [x for x in header["bodies"] if x["colour"] == "axis"]
    assert header["notes"] == []


def test_the_base_of_an_arm_on_a_rail_is_at_its_origin():
    origin = np.array([0.3, -0.1, 0.5])
    arm = ac.load_arm("ur10e")
    on_rail = arm.with_rail(
        ac.Rail(axis=(0, 1, 0), upper=2.0, velocity=1.0, acceleration=1.0, origin=origin)
    )
    before = {x.name: x.place for x in arm.shapes.shapes if x.link == 0}
    after = {x.name: x for x in on_rail.shapes.shapes if x.link == 1}
    assert before and set(before) == set(after)
    for name, place in before.items():
        np.testing.assert_allclose(after[name].place.position, place.position + origin, atol=1e-12)


def test_a_turntable_on_a_slide_stays_on_its_beam():
    usual = {"velocity": 1.0, "acceleration": 2.0}
    slide = ac.PositionerAxis(
        name="slide", axis=(1, 0, 0), origin=(0.8, 0, 0.4), lower=-0.3, upper=0.6, prismatic=True,
        **usual,
    )  # fmt: skip
    table = ac.PositionerAxis(
        name="table", axis=(0, 0, 1), origin=(0.8, 0, 0.5), lower=-3, upper=3, **usual
    )
    arm = ac.load_arm("ur10e").with_positioner(ac.Positioner(axes=(slide, table)))
    path = job("ur10e").program
    drawing = Drawing(arm_frame(SimpleNamespace(arm=arm, scene=None, program=path)))
    columns = {x["name"]: x["column"] for x in drawing.header["joints"]}
    for at in (-0.3, 0.2, 0.6):
        q = np.zeros(arm.dof)
        q[columns["slide"]] = at
        plate, housing = drawing.named("table", q)
        carriage, beam = drawing.named("slide", q)
        middles = [(x.max(axis=0) + x.min(axis=0)) / 2 for x in (plate, housing, carriage)]
        for middle in middles:
            np.testing.assert_allclose(middle[:2], [0.8 + at, 0.0], atol=1e-6)
        assert beam[:, 0].min() <= carriage[:, 0].min() + 1e-6
        assert carriage[:, 0].max() <= beam[:, 0].max() + 1e-6
        assert carriage[:, 2].max() == pytest.approx(housing[:, 2].min(), abs=1e-6)
