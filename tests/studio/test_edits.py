"""Edits, handles and fields of a job."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.files.tables import change_text

from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.quantities import parse_quantity
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job
from armcontour.files.file_keys import in_si, quantity_of, read_keys
from armcontour.files.job_file import cell_names, cell_text
from armcontour.files.job_model import JobModel
from armcontour.files.job_patch import full_key, key_of, locate_key
from armcontour.files.job_text_edits import change_data, value_at
from armcontour.files.scene_file import SceneModel, scene_of
from armcontour.studio import server
from armcontour.studio.capped_speeds import capped_speeds
from armcontour.studio.description import shown_values, slider_rows
from armcontour.studio.edits import EDITS, changes_of
from armcontour.studio.edits.keys import format_value
from armcontour.studio.edits.layout import tilt_ignored, tilt_of
from armcontour.studio.handles import EditState, blank_handles, handles_of, is_blank
from armcontour.studio.preview import CoarsePlanner

HEAD = "name: a\narm: {arm}\n"
TAIL = """\
limits: {speed: 0.15 m/s, joint_acceleration: 0.72 rad/s^2}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs:
  paper: {timing: {method: paper, knots: 600}, compensation: {method: none}}
  own: {limits: {speed: 20 mm/s}, corners: sharp, cycle: 0.002}
"""
PLANE = HEAD.replace("{arm}", "pmk3s") + (
    "path: {points: [[0.30, 0.20], [360 mm, 20 cm], [0.36, 0.26]]}\n" + TAIL
)
TURNED = PLANE.replace(
    "path: {", "path: {frame: {position: [10 mm, 0.02, 0], rpy: [0, 0, 30 deg]}, "
)
CHAIN = (
    HEAD.replace("{arm}", "pmk3s")
    + """\
path:
  start: [0.30, 0.20]
  segments:
    - {to: [0.36, 0.20], speed: 0.1 m/s}
    - {via: [0.37, 0.21], to: [0.38, 0.20]}
    - {center: [0.38, 0.22], angle: 90 deg}
    - {to: [0.36, 0.26]}
"""
    + TAIL
)
SPACE = (
    HEAD.replace("{arm}", "ur5e")
    + """\
path:
  points: [[0.45, 0.0, 0.2], [500 mm, 0.0, 0.2], [0.50, 0.03, 0.2]]
  frame: {position: [0, 0, 0.05], rpy: [10 deg, -5 deg, 20 deg]}
  orientation: [{rpy: [180 deg, 0, 0]}, {rpy: [3, 0, 0]}, {rpy: [3.1, 0, 0]}]
"""
    + TAIL
)


@cache
def state_of(text, run="own"):
    data = load(text, "")
    return EditState(data=data, run=run, handles=handles_of(parse_job(text), data))


def edited(text, run="own", **edit):
    changes = changes_of(edit, state := state_of(text, run))
    return change_data(state.data, changes)


def again(text, run="own", **edit):
    new = change_text(text, changes_of(edit, state_of(text, run)))
    job = parse_job(new)
    return job, handles_of(job, load(new, ""))


WORDS = ("", ".", "limits.speed", "5 mm", "1", "add", "change", "box", "own", "paper")
JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.sampled_from(WORDS),
    lambda x: st.lists(x, max_size=3) | st.dictionaries(st.sampled_from(WORDS), x, max_size=2),
    max_leaves=4,
)
VALID = (
    {"do": "set", "key": "limits.speed", "value": 0.1},
    {"do": "unset", "key": "limits.speed"},
    {"do": "tilt", "angle": 10},
    {"do": "add_run", "name": "new"},
    {"do": "order", "orders": [["A", 2], [1, 3]]},
    {"do": "move_waypoint", "index": 1, "to": [0.3, 0.2], "step": 1e-4},
    {"do": "set_waypoint", "index": 1, "value": ["1 mm", 2]},
    {"do": "insert_waypoint", "index": 1, "at": [0.3, 0.2]},
    {"do": "remove_waypoint", "index": 1},
    {"do": "place", "by": [0.1, 0], "turn": 0.1, "about": [0, 0]},
    {"do": "obstacle", "action": "change", "index": 0, "size": [1, 1, 1]},
    {"do": "allow", "bodies": ["box", "tool"]},
    {"do": "draw", "start": [0.36, 0.26], "segments": [{"to": [0.3, 0.2]}]},
    {"do": "pick", "edge": 0, "like": True},
    {"do": "unpick", "edge": 0, "like": True},
)
BOXED = PLANE + "scene: {obstacles: [{type: box, name: box, size: [1, 1 m, 1], at: [0, 0, 0]}]}\n"


@given(st.sampled_from(VALID), st.sampled_from([BOXED, CHAIN]), st.data())
def test_every_message_of_a_page_is_executed_or_refused_in_one_sentence(valid, text, draw):
    fields = [x for x in valid if x != "do"] or ["do"]
    edit = {**valid, draw.draw(st.sampled_from(fields)): draw.draw(JSON)}
    state = state_of(text)
    try:
        changed_data = change_data(state.data, changes_of(edit, state))
    except InvalidInput as error:
        assert str(error).endswith((".", "?"))
    else:
        assert isinstance(changed_data, dict)
    assert {x["do"] for x in VALID} == set(EDITS)


def set_to(key, value, run="own", text=PLANE):
    return edited(text, run, do="set", key=key, value=value)


def test_a_servo_that_is_edited_is_no_preset():
    preset = SPACE.replace("{kp: 25 1/s, kv: 150 1/s}", "ur5e-servoj")
    for key, value in (("servo.kp", "12 1/s"), ("servo.kp.1", 12), ("servo.dead_time", "4 ms")):
        servo = again(preset, do="set", key=key, value=value)[0].servo
        assert servo.source == ""
        np.testing.assert_array_equal(servo.kv, 28.8)
    named = SPACE.replace("150 1/s}", "150 1/s, dead_time: 4 ms, source: identified from a.csv}")
    assert again(named, do="set", key="cycle", value="2 ms")[0].servo.source
    assert again(named, do="set", key="servo", value="ur5e-servoj")[0].servo.kp[0] == 9.72
    assert not again(named, do="unset", key="servo.dead_time")[0].servo.source


def test_the_order_of_many_contours_is_one_edit():
    # A message has at most 100 edits, but a drawing has more contours.
    orders = [[k, 200 - k] for k in range(1, 151)] + [["CUT-1", 7]]
    contours = edited(PLANE, "own", do="order", orders=orders)["path"]["contours"]
    assert contours == {key: {"order": order} for key, order in orders}
    for wrong in (3, [1], [[1]], [[1, "x"]], [[1, 2.5]], [[{}, 1]]):
        with pytest.raises(InvalidInput):
            edited(PLANE, "own", do="order", orders=wrong)


def test_an_output_that_is_typed_as_a_number_is_a_number():
    text = PLANE + "export: {outputs: {laser: doLaser}}\n"
    for typed, output in (("17", 17), ("doGas", "doGas"), ({"kuka": 17}, {"kuka": 17})):
        new = set_to("export.outputs.laser", typed, text=text)
        assert new["export"] == {"outputs": {"laser": output}}


def test_values_are_set_in_the_run_or_job_in_the_written_unit():
    assert set_to("limits.speed", 0.05)["runs"]["own"]["limits"]["speed"] == "50 mm/s"
    changes = set_to("limits.speed", 0.2, "paper")
    assert changes["limits"]["speed"] == "0.2 m/s" and "limits" not in changes["runs"]["paper"]
    assert set_to("limits.joint_acceleration", 0.5)["limits"]["joint_acceleration"] == "0.5 rad/s^2"
    assert set_to("cycle", 1e-3)["runs"]["own"]["cycle"] == 1e-3
    assert set_to("cycle", 1e-3, "paper")["cycle"] == "1 ms"
    assert set_to("corners.tolerance", 1e-3)["runs"]["own"]["corners"] == {"tolerance": "1 mm"}
    assert set_to("corners.tolerance", 1e-3, "paper")["corners"] == {"tolerance": "1 mm"}
    assert set_to("timing.reserve", 0.1)["runs"]["own"]["timing"] == {"reserve": "10 %"}
    assert set_to("runs.paper.timing.knots", 100)["runs"]["paper"]["timing"]["knots"] == 100
    assert set_to("limits.speed", "3 m/min")["runs"]["own"]["limits"]["speed"] == "3 m/min"
    # A number without a unit has that of the old value.
    assert set_to("limits.speed", "30")["runs"]["own"]["limits"]["speed"] == "30 mm/s"
    assert set_to("limits.tool_acceleration", "2")["limits"]["tool_acceleration"] == "2 m/s^2"
    assert set_to("cycle", "0.001")["runs"]["own"]["cycle"] == 1e-3
    assert set_to("limits.joint_velocity", None)["limits"]["joint_velocity"] is None
    gone = edited(PLANE, do="unset", key="limits.speed")
    assert "limits" not in gone["runs"]["own"] and gone["limits"]["speed"] == "0.15 m/s"
    assert edited(PLANE, do="unset", key="limits.joint_jerk") == load(PLANE, "")
    assert set_to("servo.kp.1", 30.0)["servo"]["kp"] == ["25 1/s", "30 1/s"]
    listed = PLANE.replace("kp: 25 1/s", "kp: [25 1/s, 26.0]")
    assert set_to("servo.kp.1", 30.0, text=listed)["servo"]["kp"] == ["25 1/s", 30.0]
    for key, words in (("servo.kp.2", "number of the joint"), ("name.1", "a value per joint")):
        with pytest.raises(InvalidInput, match=words):
            set_to(key, 1.0)
    changes = set_to("timing.method", "optimal", "paper")
    assert changes["runs"]["paper"]["timing"] == {"method": "optimal"}
    poles = PLANE.replace("{method: none}", "{method: pole_placement, poles: [-9, -9, -9]}")
    changes = set_to("compensation.method", "inverse", "paper", poles)
    assert changes["runs"]["paper"]["compensation"] == {"method": "inverse"}
    assert set_to("corners.shape", "sharp", "paper")["corners"] == "sharp"
    assert set_to("corners.shape", "free", "paper")["corners"]["shape"] == "free"
    changes = set_to("corners.shape", "arc")["runs"]["own"]["corners"]
    assert changes == {"shape": "arc", "tolerance": "1 mm"}


@pytest.mark.parametrize("contour", ["CUT-3", 3])
def test_values_of_a_contour_are_set_and_removed(contour):
    key = ["path", "contours", contour]
    edits = [
        {"do": "set", "key": [*key, "speed"], "value": "20"},
        {"do": "set", "key": [*key, "tabs", "width"], "value": 0.002},
        {"do": "set", "key": [*key, "kerf"], "value": None},
        {"do": "set", "key": [*key, "speed"], "value": "30"},
    ]
    text = PLANE
    state = state_of(PLANE)
    for edit in edits:
        text = change_text(text, changes_of(edit, replace(state, data=load(text, ""))))
    own = load(text, "")["path"]["contours"]
    assert own == {contour: {"speed": "30 mm/s", "tabs": {"width": "2 mm"}, "kerf": None}}
    for name in (["speed"], ["kerf"], ["tabs", "width"]):
        edit = {"do": "unset", "key": [*key, *name]}
        text = change_text(text, changes_of(edit, replace(state, data=load(text, ""))))
    assert text == PLANE


def test_obstacles_are_added_changed_and_removed():
    def boxes(text, action, **more):
        return edited(text, do="obstacle", action=action, **more)["scene"].get("obstacles")

    def with_boxes(*boxes):
        return f"{PLANE}scene: {{obstacles: [{', '.join(boxes)}]}}\n"

    size = [0.1, "2 cm", 0.3]
    box = "{type: box, name: box, size: [1, 1, 1]}"
    written = {"size": ["100 mm", "2 cm", "300 mm"], "at": ["0 mm", "0 mm", "500 mm"]}
    assert boxes(PLANE, "add", type="box", size=size, at=[0, 0, 0.5]) == [
        {"type": "box", "name": "box", **written}
    ]
    text = with_boxes(box, "{type: box, name: b, size: [1 m, 2, 3]}")
    one = with_boxes(box)
    assert boxes(text, "add", type="box", size=size)[2]["name"] == "box 2"
    more = {"size": [1.5, 2, 3], "at": [0.1, 0, 0], "name": "c"}
    obstacles = boxes(text, "change", index=1, **more)
    written = {"size": ["1.5 m", 2, 3], "at": ["100 mm", "0 mm", "0 mm"]}
    assert obstacles[1] == {"type": "box", "name": "c", **written}
    assert len(boxes(text, "remove", index=0)) == 1 and boxes(one, "remove", index=0) is None
    for action, more in (("remove", {"index": 1}), ("add", {"size": [1, 1, 1]})):
        with pytest.raises(InvalidInput):
            boxes(one, action, **more)


@pytest.mark.parametrize("text", [PLANE, TURNED, CHAIN, SPACE])
def test_the_pen_continues_a_path_at_its_end(text):
    before = state_of(text).handles
    end = before.ends[-1].uv
    count = len(before.ends)
    a, b, c = (end + x for x in ([0.01, 0.02], [0.02, 0.0], [0.0, -0.01]))
    lines = [{"to": a.tolist()}, {"to": b.tolist()}]
    job, handles = again(text, do="draw", start=end.tolist(), segments=lines)
    assert handles.kind == before.kind and len(handles.ends) == count + 2
    np.testing.assert_allclose([x.uv for x in handles.ends[-2:]], [a, b], atol=1e-12)
    # A shape elsewhere is reached by a line.
    arc = {"via": b.tolist(), "to": c.tolist()}
    circle = {"center": b.tolist()}
    job, handles = again(text, do="draw", start=a.tolist(), segments=[arc])
    path = job.program.contours[0].path
    assert len(path) == len(state_of(text).handles.job.program.contours[0].path) + 2
    np.testing.assert_allclose([x.uv for x in handles.ends[-2:]], [a, c], atol=1e-12)
    job, handles = again(text, do="draw", start=a.tolist(), segments=[circle])
    path = job.program.contours[0].path
    assert path.lengths[-1] == pytest.approx(2 * np.pi * np.linalg.norm(b - a), rel=1e-9)
    np.testing.assert_allclose([x.uv for x in handles.ends[-2:]], [a, a], atol=1e-9)
    if text == SPACE:
        assert job.program.contours[0].path.orientation is not None


def test_the_pen_begins_a_path_and_does_not_draw_splines_or_files(tmp_path):
    for arm in cell_names():
        data = load(cell_text(arm), arm)
        handles = blank_handles(data, lambda x: parse_job(json.dumps(x)))
        assert is_blank(data) and handles.editable and not handles.waypoints
        start = handles.centre + [0.01, 0]
        corners = [start + x for x in ([0.1, 0], [0.1, 0.05], [0, 0.05], [0, 0])]
        rectangle = {"start": start, "segments": [{"to": x} for x in corners]}
        state = EditState(data=data, run="compensated", handles=handles)
        changed_data = change_data(data, changes_of({"do": "draw", **rectangle}, state))
        drawn = handles_of(parse_job(json.dumps(changed_data)), changed_data)
        assert not is_blank(changed_data)
        np.testing.assert_allclose([x.uv for x in drawn.ends], [start, *corners], atol=1e-12)
        (contour,) = drawn.job.program.contours
        assert contour.path.length == pytest.approx(0.3)


@pytest.mark.parametrize("text", [PLANE, TURNED, CHAIN, SPACE])
@given(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(-3, 3))
def test_the_part_is_moved_and_turned_as_a_whole(text, u, v, turn):
    handles = state_of(text).handles
    about = handles.waypoints[1].uv + [0.01, -0.02]
    data = edited(text, do="place", by=[u, v], turn=turn, about=about.tolist())
    moved = handles_of(handles.job, data)
    c, s = math.cos(turn), math.sin(turn)
    for before, after in zip(handles.waypoints, moved.waypoints, strict=True):
        if before.why_not is None:
            expected = about + np.array([[c, -s], [s, c]]) @ (before.uv - about) + [u, v]
            np.testing.assert_allclose(handles.plane.uv(after.point), expected, atol=1e-12)
    height = data["path"]["frame"]["position"][2]
    assert height in (0, "0 mm") or text == SPACE
    # By default it is turned about its centre.
    centre = handles.centre.tolist()
    turned = edited(text, do="place", turn=turn)
    assert turned == edited(text, do="place", turn=turn, about=centre)


@given(st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), st.floats(-3, 3))
def test_part_rises_along_the_normal_of_the_picture(rise, u, turn):
    handles = state_of(SPACE).handles
    data = edited(SPACE, do="place", by=[u, 0.0], rise=rise, turn=turn)
    flat = edited(SPACE, do="place", by=[u, 0.0], turn=turn)
    up = [handles_of(handles.job, x).frame.position for x in (flat, data)]
    np.testing.assert_allclose(up[1] - up[0], rise * handles.plane.normal, atol=1e-12)
    # A rise alone keeps the coordinates and angles that do not change, as they are written.
    raised = edited(SPACE, do="place", rise=0.01)["path"]["frame"]
    assert raised["rpy"] == ["10 deg", "-5 deg", "20 deg"]


def test_planar_arm_has_no_height():
    with pytest.raises(InvalidInput, match="no height"):
        edited(PLANE, do="place", rise=0.01)
    assert edited(PLANE, do="place", rise=0) == edited(PLANE, do="place")


KINDS = {
    "box": {"size": [0.1, 0.2, 0.3]},
    "cylinder": {"radius": 0.05, "length": 0.2},
    "sphere": {"radius": 0.05},
    "capsule": {"radius": 0.05, "length": 0.2},
    "mesh": {"file": "block.stl", "unit": "mm"},
}


@pytest.mark.parametrize("kind", list(KINDS))
def test_obstacles_of_every_kind_are_added(kind):
    data = edited(SPACE, do="obstacle", action="add", type=kind, at=[0.1, 0, 0.2], **KINDS[kind])
    (body,) = in_si(data["scene"], SceneModel)["obstacles"]
    at = {"type": kind, "name": kind, "at": [0.1, 0.0, 0.2]}
    assert {key: x for key, x in body.items() if x} == {**at, **KINDS[kind]}


@pytest.mark.parametrize(
    "written",
    [
        "rpy: [10 deg, 0.2, 30 deg]",
        "at: [0, 0, 1 m]",
        "quaternion: [0.1, 0.2, 0.3, 0.9273618495495703]",
    ],
)
@given(st.floats(-3, 3))
def test_obstacle_turns_about_the_vertical_through_its_origin(written, turn):
    text = f"{SPACE}scene: {{obstacles: [{{type: box, name: b, size: [1, 1, 1], {written}}}]}}\n"
    before = load(text, "")["scene"]
    after = edited(text, do="obstacle", action="change", index=0, turn=turn)["scene"]
    old, new = (
        scene_of(read_keys(SceneModel, x), Path(), Frame()).obstacles[0].place
        for x in (before, after)
    )
    c, s = math.cos(turn), math.sin(turn)
    expected = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ old.rotation
    np.testing.assert_allclose(new.rotation, expected, atol=1e-12)
    np.testing.assert_array_equal(new.position, old.position)
    if written.startswith("rpy"):
        assert after["obstacles"][0]["rpy"][:2] == ["10 deg", 0.2]


def test_half_space_with_normal_is_not_turned():
    text = f"{SPACE}scene: {{obstacles: [{{type: halfspace, name: w, normal: [1, 0, 0]}}]}}\n"
    with pytest.raises(InvalidInput, match="normal"):
        edited(text, do="obstacle", action="change", index=0, turn=0.1)


def test_one_pair_at_a_time_is_allowed_to_touch():
    bodies = "{type: sphere, name: ball, radius: 1}, {type: sphere, name: b, radius: 1, allow: [w]}"
    text = f"{SPACE}scene: {{obstacles: [{bodies}]}}\n"

    def allowed(*names):
        return [
            x.get("allow") for x in edited(text, do="allow", bodies=[*names])["scene"]["obstacles"]
        ]

    # The order of the names does not matter, and an allowed link stays allowed.
    assert allowed("ball", "wrist_3") == allowed("wrist_3", "ball") == [["wrist_3"], ["w"]]
    assert allowed("b", "tool") == [None, ["w", "tool"]]
    assert allowed("b", "w") == [None, ["w"]]
    for names in (["wrist_3", "upper_arm"], ["ball"], "ball", [1, 2]):
        with pytest.raises(InvalidInput):
            edited(text, do="allow", bodies=names)


@pytest.mark.parametrize("text", [PLANE, TURNED, CHAIN, SPACE])
@given(st.integers(0, 8), st.floats(-0.05, 0.05), st.floats(-0.05, 0.05))
def test_a_moved_point_gets_its_new_position(text, index, u, v):
    handles = state_of(text).handles
    index %= len(handles.waypoints)
    point = handles.waypoints[index]
    to = point.uv + [u, v]
    if point.why_not is not None:
        with pytest.raises(InvalidInput, match="Waypoint 4 cannot be moved. The centre"):
            edited(text, do="move_waypoint", index=index, to=to.tolist())
        return
    data = edited(text, do="move_waypoint", index=index, to=to.tolist())
    moved = handles_of(handles.job, data).waypoints[index]
    # The plane of the first picture: that of the new points may be another one.
    np.testing.assert_allclose(handles.plane.uv(moved.point), to, rtol=0, atol=1e-12)
    height = (moved.point - point.point) @ handles.plane.normal
    assert abs(height) <= 1e-12


def test_points_are_inserted_and_removed_with_orientations():
    data = edited(PLANE, do="insert_waypoint", index=1, at=[0.33, 0.21])
    # In the form of the point that is there.
    assert data["path"]["points"][1] == ["330 mm", "21 cm"] and len(data["path"]["points"]) == 4
    data = edited(SPACE, do="insert_waypoint", index=3, at=[0.5, 0.1])
    assert len(data["path"]["orientation"]) == len(data["path"]["points"]) == 4
    data = edited(SPACE, do="remove_waypoint", index=1)
    assert data["path"]["orientation"] == [{"rpy": ["180 deg", 0, 0]}, {"rpy": [3.1, 0, 0]}]
    two = PLANE.replace(", [0.36, 0.26]", "")
    with pytest.raises(InvalidInput, match="a path needs two points"):
        edited(two, do="remove_waypoint", index=0)


def test_points_are_inserted_into_segments_and_removed():
    point = {"at": [0.33, 0.19]}
    job, handles = again(CHAIN, do="insert_waypoint", index=1, **point)
    assert len(handles.ends) == 6 and handles.ends[1].written == (0.33, 0.19)
    assert job.path.speeds[:2].tolist() == [0.1, 0.1]
    job, handles = again(CHAIN, do="insert_waypoint", index=0, **point)
    assert [x.written for x in handles.ends[:2]] == [(0.33, 0.19), (0.3, 0.2)]
    _, handles = again(CHAIN, do="insert_waypoint", index=5, **point)
    assert len(handles.ends) == 6 and handles.ends[5].written == (0.33, 0.19)
    _, handles = again(CHAIN, do="remove_waypoint", index=0)
    assert len(handles.ends) == 4 and handles.ends[0].written == (0.36, 0.2)
    _, handles = again(CHAIN, do="remove_waypoint", index=3)
    assert [x.role for x in handles.waypoints] == ["point"] * 4 + ["via"]
    with pytest.raises(InvalidInput, match="Segment 2 is an arc"):
        edited(CHAIN, do="insert_waypoint", index=2, **point)
    with pytest.raises(InvalidInput, match="the via point of an arc"):
        edited(CHAIN, do="remove_waypoint", index=5)


TEXT = """\
name: a
arm: pmk3s
path: {points: [[0.30, 0.20], [0.36, 0.20], [0.36, 0.26]]}
limits: {speed: 0.15 m/s, joint_acceleration: [0.72 rad/s^2, 41 deg/s^2]}
corners: {tolerance: 5 mm}
servo: {kp: 25 1/s, kv: 150}
runs:
  paper: {timing: {method: paper}, compensation: {method: none}}
  own: {limits: {speed: 20 mm/s}, corners: sharp, cycle: 0.002}
"""
ROBOT = """\
name: a
arm: ur5e
path: {points: [[0.45, 0, 0.2], [0.5, 0, 0.2]], orientation: {axis: [0, 0, -1]}}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {own: {}}
"""


# A joint of order delay has no gain to slide.
MIXED = TEXT.replace(
    "{kp: 25 1/s, kv: 150}", "{order: [second, delay], kp: [25, none], kv: [150, none]}"
)


@pytest.mark.parametrize(
    ("text", "run"), [(TEXT, "paper"), (TEXT, "own"), (ROBOT, "own"), (MIXED, "paper")]
)
def test_every_field_can_be_set_and_then_has_that_value(text, run):
    data = load(text, "")
    job = parse_job(text)
    state = EditState(data=data, run=run, handles=handles_of(job, data))
    for key, x in slider_rows(data, job, run).items():
        target = 0.8 * x["max"]
        changes = changes_of({"do": "set", "key": key, "value": target}, state)
        new = change_data(data, changes)
        written = change_text(text, changes)
        assert load(written, "") == new
        if key in ("cycle", "servo.kp"):
            # These values go with others only.
            continue
        try:
            field = slider_rows(new, parse_job(written), run)[key]
        except InvalidInput as error:
            assert "joint_jerk" in str(error) or "jerk" in str(error)
            continue
        assert field["value"] == pytest.approx(target, rel=3e-15)
        value_in_job = value_at(new, locate_key(key_of(key), new, run))
        assert value_in_job is not None
        if x["unit"] not in ("", "%") and isinstance(value_in_job, str):
            assert parse_quantity(value_in_job, unit_in_si(key)) == pytest.approx(target)


CAPPED = """\
name: capped
arm: pmk3s
path:
  points: [[0.35, 0.1], [0.4, 0.15], [0.35, 0.2]]
  contours: {1: {speed: 120 mm/s}, 2: {speed: 0.1}, 3: {tolerance: 1 mm}}
limits: {speed: 100 mm/s}
corners: {tolerance: 1 mm}
servo: {kp: 25, kv: 150}
runs:
  slow: {limits: {speed: 0.05}}
  shared: {}
"""


@pytest.mark.parametrize(
    ("run", "expected"),
    [
        ("shared", {"path.contours.1.speed": "120 mm/s"}),
        ("slow", {"path.contours.1.speed": 0.12, "path.contours.2.speed": 0.1}),
    ],
)
def test_speeds_above_that_of_the_run_are_found_and_the_remedy_raises_it(run, expected):
    # One contour is enough for a job; the speeds of the others are only in its data.
    text = CAPPED.replace("2: {speed: 0.1}, 3: {tolerance: 1 mm}", "")
    data = load(CAPPED, "")
    job = parse_job(text)
    rows = capped_speeds(data, job, run)
    assert {key: x["raised"] for key, x in rows.items()} == expected
    limit = "100 mm/s" if run == "shared" else "50 mm/s"
    assert all(limit in x["sentence"] for x in rows.values())
    state = EditState(data=data, run=run, handles=handles_of(job, data))
    edit = {"do": "set", "key": "limits.speed", "value": rows["path.contours.1.speed"]["raised"]}
    raised = change_data(data, changes_of(edit, state))
    assert not capped_speeds(raised, parse_job(change_text(text, changes_of(edit, state))), run)


def unit_in_si(key):
    kinds = {"speed": "m/s", "tolerance": "m", "acceleration": "m/s^2", "kv": "1/s"}
    joints = {"joint_velocity": "rad/s", "joint_acceleration": "rad/s^2", "joint_jerk": "rad/s^3"}
    name = key.split(".")[1]
    return joints.get(name) or kinds[name.rpartition("_")[2]]


@pytest.mark.parametrize(
    "orientation",
    [
        "{axis: [0, 0, -1]}",
        "{rpy: [180 deg, 0, 0]}",
        "{quaternion: [1, 0, 0, 0]}",
        "{follow_tangent: {up: [0, 0, 1]}}",
    ],
)
def test_tilting_the_tool_works_for_every_form_of_orientation(orientation):
    text = ROBOT.replace("{axis: [0, 0, -1]}", orientation)
    for name, value, expected in (("angle", "10", (10, 0)), ("towards", "90 deg", (10, 90))):
        data = load(text, "")
        job = parse_job(text)
        state = EditState(data=data, run="own", handles=handles_of(job, data))
        text = change_text(text, changes_of({"do": "tilt", name: value}, state))
        new = load(text, "")
        tilt = tilt_of(handles_of(parse_job(text), new), new)
        assert (tilt["angle"], tilt["towards"]) == pytest.approx(expected, abs=1e-6)
    (form,) = (x for x in ("axis", "rpy", "quaternion", "follow_tangent") if x in orientation)
    assert list(new["path"]["orientation"]) == [form]


DOWN = {"orientation": {"axis": [0, 0, -1]}}


@pytest.mark.parametrize(
    ("columns", "values", "keys", "is_ignored"),
    [
        (",ax,ay,az", ",0,0,-1", DOWN, True),
        (",ax,ay,az", ",0,0,-1", {}, True),
        ("", "", DOWN, False),
    ],
)
def test_a_tilt_that_the_file_overrides_is_refused(columns, values, keys, is_ignored, tmp_path):
    table = f"x [mm],y [mm],z [mm]{columns}\n450,0,200{values}\n480,0,200{values}\n"
    (tmp_path / "points.csv").write_text(table)
    data = {**load(ROBOT, ""), "path": {"file": "points.csv", **keys}}
    job = CoarsePlanner(tmp_path).job(data)
    state = EditState(data=data, run="own", handles=handles_of(job, data))
    edit = {"do": "tilt", "angle": "10"}
    assert (tilt_ignored(job, data) is not None) == is_ignored
    if not is_ignored:
        assert changes_of(edit, state)
        return
    with pytest.raises(InvalidInput, match=r"points\.csv"):
        changes_of(edit, state)


def test_lists_of_numbers_are_typed_as_text_or_numbers():
    """A direction has no unit."""
    for value in (["0", "1", "0"], [0, 1, 0], [0.0, 1.0, 0.0]):
        rail = set_to("arm.rail.axis", value, text=SPACE)["arm"]["rail"]
        assert rail["axis"] == [0, 1, 0]
    origin = set_to("arm.rail.origin", ["0", "100", "0 m"], text=SPACE)["arm"]["rail"]["origin"]
    assert origin == ["0 mm", "100 mm", "0 m"]


def typed_fields(field, keys):
    """Yield the fields with a unit for typed numbers, with their keys."""
    for inner in field.get("fields", ()):
        yield from typed_fields(inner, (*keys, inner["name"]))
    if "each" in field:
        yield from typed_fields(field["each"], (*keys, "name"))
    if "typed" in field:
        yield field, (*keys, 0) if field.get("list") else keys


FORM = json.loads((server.STATIC / "form.json").read_text("utf-8"))
TYPED = [
    (keys, field["typed"])
    for group in FORM["groups"]
    for whole in group["fields"]
    for field, keys in typed_fields(whole, tuple(whole["at"].split(".")))
]


def test_number_typed_for_an_unset_key_has_the_unit_that_the_form_shows():
    assert len(TYPED) > 60
    # Lists of coordinates are in mm, not in the m of plain numbers in a file.
    assert ("path", "frame", "position", 0) in dict(TYPED)
    for keys, unit in TYPED:
        place = full_key(keys)
        written = format_value("2", None, place)
        number, _, own = str(written).partition(" ")
        kind = quantity_of(JobModel, place)
        same = parse_quantity(f"1 {unit}", kind.unit) / parse_quantity(f"1 {own}", kind.unit)
        assert (float(number), same) == (2, pytest.approx(1)), keys


@pytest.mark.parametrize(
    ("key", "written", "typed", "result"),
    [
        ("limits.joint_velocity", "60 deg/s", "50", "50 deg/s"),
        ("limits.speed", "2 in/s", "3", "3 in/s"),
        ("limits.speed", "50 mm/s", "40", "40 mm/s"),
        ("limits.speed", "0.1", "0.2", 0.2),
        ("accuracy", "0.5 mm", "0.3", "0.3 mm"),
        (
            "path.frame.position",
            "[1 in, 2 in, 0 in]",
            ["1", "3", "0.5 m"],
            ["1 in", "3 in", "0.5 m"],
        ),
        ("path.frame.position", "[0.1, 0.2, 0]", ["0.1", "0.3", "5 mm"], [0.1, 0.3, "5 mm"]),
    ],
)
def test_typed_number_has_the_unit_of_the_written_value(key, written, typed, result):
    first = key.partition(".")[0]
    base = "" if first == "path" else f"{first}: "
    names = key.split(".")
    value = written
    for name in reversed(names[1:]):
        value = f"{{{name}: {value}}}"
    if first == "path":
        text = ROBOT.replace(
            "orientation: {axis: [0, 0, -1]}}",
            f"orientation: {{axis: [0, 0, -1]}}, {value[1:-1]}}}",
        )
    else:
        text = f"{ROBOT}{base}{value}\n"
    changed = set_to(key, typed, text=text)
    for name in names:
        changed = changed[name]
    assert changed == result


CELL = """
name: cell
arm:
  name: ur5e
  rail: {axis: [0, 1, 0], lower: -500 mm, upper: 1.5, velocity: 0.8 m/s, acceleration: 1.5}
  positioner:
    axes:
      - {name: turn, axis: [0, 0, 1], origin: [0.9, 0, 400 mm], lower: -1.5707963267948966,
         upper: 90 deg, velocity: 1 rad/s, acceleration: 100 deg/s^2}
path: {points: [[0, 0, 0], [0.1, 0, 0]], orientation: {axis: [0, 0, -1]}}
servo: {kp: 25, kv: 150}
runs: {own: {}}
"""


def test_external_axes_are_shown_in_mm_and_degrees_and_written_in_the_units_of_the_file():
    shown = {key: x["text"] for key, x in shown_values(load(CELL, "")).items()}
    turn = "arm.positioner.axes.0"
    expected = {
        "arm.rail.lower": "-500 mm",
        "arm.rail.upper": "1500 mm",
        "arm.rail.velocity": "800 mm/s",
        f"{turn}.origin": "900, 0, 400",
        f"{turn}.lower": "-90 deg",
        f"{turn}.upper": "90 deg",
    }
    assert {x: shown[x] for x in expected} == expected
    rate = shown[f"{turn}.velocity"].split()
    assert float(rate[0]) == pytest.approx(math.degrees(1.0), rel=1e-12) and rate[1] == "deg/s"
    # Accelerations have no other unit in results than in SI.
    assert set(shown) == {*expected, f"{turn}.velocity"}
    edits = [
        ("arm.rail.upper", "1600", 1.6),
        ("arm.rail.upper", "1600 mm", 1.6),
        ("arm.rail.upper", "1.7 m", 1.7),
        ("arm.rail.lower", "-600", "-600 mm"),
        ("arm.rail.lower", "-0.6 m", "-600 mm"),
        ("arm.rail.velocity", "900", "0.9 m/s"),
        ("arm.rail.velocity", "0.90 m/s", "0.90 m/s"),
        ("arm.rail.acceleration", "2", 2.0),
        ("arm.rail.origin", ["0", "100", "0.2 m"], ["0 mm", "100 mm", "0.2 m"]),
        (f"{turn}.origin", ["850", "10", "300"], [0.85, 0.01, "300 mm"]),
        (f"{turn}.upper", "120", "120 deg"),
        (f"{turn}.velocity", "2 rad/s", "2 rad/s"),
        (f"{turn}.acceleration", "50", "50 deg/s^2"),
        ("arm.rail.upper", "far", "far"),
    ]
    for key, typed, written in edits:
        assert value_at(set_to(key, typed, text=CELL), key_of(key)) == written
    lower = value_at(set_to(f"{turn}.lower", "-45 deg", text=CELL), key_of(f"{turn}.lower"))
    assert lower == pytest.approx(-math.pi / 4, rel=1e-12)
    rate = value_at(set_to(f"{turn}.velocity", "90", text=CELL), key_of(f"{turn}.velocity"))
    number, unit = rate.split()
    assert float(number) == pytest.approx(math.pi / 2, rel=1e-12) and unit == "rad/s"
    # The text of a value, sent unchanged, does not change the file's value.
    for key, text in shown.items():
        sent = text.split(", ") if ", " in text else text
        new = value_at(in_si(set_to(key, sent, text=CELL), JobModel), key_of(key))
        old = value_at(in_si(load(CELL, ""), JobModel), key_of(key))
        np.testing.assert_allclose(new, old, rtol=1e-12)


def test_limits_of_joints_have_names_and_a_rail_has_units_of_length():
    rows = slider_rows(load(CELL, ""), parse_job(CELL), "own")
    rail, turn = (rows[f"limits.joint_velocity.{k}"] for k in (1, 0))
    assert (rail["joint"], rail["unit"], rail["linear"]) == ("rail", "mm/s", True)
    assert rail["value"] / rail["factor"] == pytest.approx(800)
    assert (turn["joint"], turn["unit"], turn["linear"]) == ("turn", "rad/s", False)
    assert rows["limits.joint_acceleration.1"]["unit"] == "m/s²"
    # What a user types for the rail is in the shown unit, and the job has it in SI units.
    changed = CELL
    for typed, expected in (("700", 0.7), ("0.6 m/s", 0.6), ("650 mm/s", 0.65), (0.5, 0.5)):
        data = set_to("limits.joint_velocity.1", typed, text=changed)
        assert data["limits"]["joint_velocity"][1] == pytest.approx(expected)
        velocity = in_si(data, JobModel)["limits"]["joint_velocity"]
        assert velocity[0] == pytest.approx(1.0)
        # A second edit finds the list that the first one wrote.
        changed = CELL.replace("servo:", f"limits: {{joint_velocity: {velocity}}}\nservo:")
    with pytest.raises(InvalidInput, match="m/s"):
        set_to("limits.joint_velocity.1", "50 deg/s", text=CELL)
    assert (
        set_to("limits.joint_velocity.0", "50 deg/s", text=CELL)["limits"]["joint_velocity"][0]
        == "50 deg/s"
    )
