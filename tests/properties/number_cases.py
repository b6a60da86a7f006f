"""Every number of job files, and what is put there that breaks programs.

Fields are found in the published schema of job files: one that is added later is covered without a
change here, or a test says that it needs a base.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator
from typing import Any

from soak.step_box import step_box

from armcontour.files import json_schema

Place = tuple[str | int, ...]
# What no field may take without a result or one sentence: as YAML has it.
HOSTILE: dict[str, Any] = {
    "nan": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "-1": -1,
    "-0": -0.0,
    "0": 0,
    "1e308": 1e308,
    "1e300": 1e300,
    "5e-324": 5e-324,
    "1e-12": 1e-12,
    "1e9": 1e9,
    "1e15": 1e15,
    "10^30": 10**30,
    "text": "many",
}
# Any key of a mapping.
ANY = "*"
# Files next to the job, to which the base jobs refer.
DRAWING = b"""<svg xmlns="http://www.w3.org/2000/svg"
width="100mm" height="100mm" viewBox="0 0 100 100"
xmlns:inkscape="http://www.inkscape.org/namespaces/inkscape"><g inkscape:groupmode="layer"
inkscape:label="cut"><path d="M10 10 L40 10 L40 30 L10 30 Z"/></g></svg>
"""
ROBOT = b"""<robot name="three"><link name="base"/>
<link name="one"/><link name="two"/><link name="three"/><link name="four"/><link name="tcp"/>
<joint name="lift" type="revolute"><parent link="base"/><child link="one"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<joint name="left" type="revolute"><parent link="one"/><child link="two"/>
<origin xyz="0.1 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<joint name="right" type="revolute"><parent link="two"/><child link="three"/>
<origin xyz="0.25 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<joint name="high" type="revolute"><parent link="three"/><child link="four"/>
<origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" velocity="2" effort="50"/></joint>
<joint name="end" type="fixed"><parent link="four"/><child link="tcp"/>
<origin xyz="0.18 0 0"/></joint></robot>
"""
# A gantry with two wrist axes, and a table that turns.
_JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{0}"/>
<axis xyz="{3}"/><limit lower="-2" upper="2" velocity="1" effort="50"/></joint><link name="{0}"/>"""
_MOVED = [
    *(("x", "prismatic", "floor", "1 0 0"), ("y", "prismatic", "x", "0 1 0")),
    *(("z", "prismatic", "y", "0 0 1"), ("a", "revolute", "z", "1 0 0")),
    *(("b", "revolute", "a", "0 1 0"), ("table", "revolute", "floor", "0 0 1")),
]
GANTRY = f"""<robot name="cell"><link name="floor"/>{"".join(_JOINT.format(*x) for x in _MOVED)}
<link name="tcp"/><joint name="end" type="fixed"><parent link="b"/><child link="tcp"/>
<origin rpy="3.14159265358979 0 0"/></joint></robot>""".encode()
# Waypoints with tool axes.
POINTS = b"x,y,z,ax,ay,az\n0.45,0,0.2,0,0,-1\n0.5,0,0.2,0.01,0,-1\n0.55,0,0.2,0,0,-1\n"
# A tetrahedron.
MESH = b"v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
FILES = {
    "part.svg": DRAWING,
    "points.csv": POINTS,
    "robot.urdf": ROBOT,
    "cell.urdf": GANTRY,
    "body.obj": MESH,
    "box.step": step_box((40.0, 30.0, 20.0)).encode(),
}

SERVO = {"kp": 25.0, "kv": 150.0}
# An arm in the plane and a path of two lines, of which a run takes a moment.
PLANE: dict[str, Any] = {
    "name": "plane",
    "arm": "pmk3s",
    "path": {"points": [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]},
    "limits": {"speed": 0.10, "centripetal_acceleration": 0.09},
    "corners": {"tolerance": 2e-3},
    "accuracy": 2e-4,
    "servo": SERVO,
    "cycle": 4e-3,
    "speed_factor": 0.5,
    "runs": {"one": {}},
}
SPACE: dict[str, Any] = {
    "name": "space",
    "arm": {
        "name": "ur5e",
        "tool": {"position": [0.0, 0.0, 0.1], "rpy": [0.0, 0.0, 0.0]},
        "work": {"position": [0.0, 0.0, 0.0], "rpy": [0.0, 0.0, 0.0]},
        "payload": {
            "mass": 1.0,
            "center": [0.0, 0.0, 0.05],
            "inertia": [0.01, 0, 0, 0.01, 0, 0.01],
        },
    },
    "seed": [0.0, -1.5, 1.5, -1.5, -1.5, 0.0],
    "path": {
        "points": [[0.45, 0.0, 0.2], [0.50, 0.0, 0.2], [0.50, 0.03, 0.2]],
        "orientation": {"rpy": [math.pi, 0.0, 0.0]},
    },
    "limits": {"speed": 0.10, "tool_acceleration": 1.0, "angular_speed": 1.0},
    "corners": {"tolerance": 1e-3, "angular_tolerance": 0.05},
    "servo": SERVO,
    "runs": {"one": {}},
}


def _with(base: dict[str, Any], **changes: Any) -> dict[str, Any]:
    """A base with some of its keys replaced; mappings are merged, and None takes a key out."""
    data = copy.deepcopy(base)
    for key, value in changes.items():
        if value is None:
            data.pop(key, None)
        elif isinstance(value, dict) and isinstance(data.get(key), dict):
            data[key] = _with(data[key], **value)
        else:
            data[key] = copy.deepcopy(value)
    return data


def _path(**path: Any) -> dict[str, Any]:
    data = copy.deepcopy(PLANE)
    data["path"] = path
    return data


def _oriented(orientation: Any) -> dict[str, Any]:
    return _with(SPACE, path={"orientation": None}) | {
        "path": {"points": SPACE["path"]["points"], "orientation": orientation}
    }


_RAIL: dict[str, Any] = {
    **{"axis": [0.0, 1.0, 0.0], "origin": [0.0, -0.5, 0.0], "lower": 0.0, "upper": 1.0},
    **{"velocity": 1.0, "acceleration": 2.0, "jerk": 50.0, "force": 5e3, "mass": 50.0},
}
# Preferences of the rail, one after the other because they exclude each other.
_PREFERRED: list[dict[str, Any]] = [{"weight": 5.0, "range": [0.2, 0.8]}, {"hold": 0.5}]
_TABLE: dict[str, Any] = {
    "part": {"mass": 1.0, "center": [0.0, 0.0, 0.0], "inertia": [0.01, 0, 0, 0.01, 0, 0.01]},
    "tilt": 1.5,
    "axes": [
        {
            **{"name": "turn", "axis": [0.0, 0.0, 1.0], "origin": [0.4, 0.0, 0.1]},
            **{"lower": -3.0, "upper": 3.0, "velocity": 1.0, "acceleration": 2.0, "jerk": 50.0},
            **{"torque": 500.0, "mass": 20.0, "center": [0.4, 0.0, 0.1]},
            "inertia": [0.1, 0, 0, 0.1, 0, 0.1],
        }
    ],
}
_CLOSED = {"points": [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23], [0.30, 0.20]]}
_LINE: dict[str, Any] = {"to": [0.34, 0.20], "speed": 0.05, "tolerance": 1e-3}
_DRAWN: dict[str, Any] = {
    "file": "part.svg",
    "units": "mm",
    "scale": 1.0,
    "frame": {"position": [0.28, 0.20, 0.0], "rpy": [0.0, 0.0, 0.0]},
    "chord_tolerance": 1e-5,
    "join_tolerance": 1e-5,
    "repair_vertices": 1e-6,
}
_FRAMED = {"position": [0.0, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]}
_UP = {"up": [0.0, 0.0, 1.0]}
_GIVEN = [[math.pi, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0]]
_ORIENTED = [
    {"quaternion": _GIVEN[1]},
    {"axis": _GIVEN[2], "cone": 0.1},
    {"follow_tangent": {**_UP, "rpy": _GIVEN[0]}},
    {"follow_tangent": {**_UP, "quaternion": _GIVEN[1]}},
]
_POWER = {
    **{"name": "power", "rest": 0.2, "full": 1.0, "speed": 0.1, "off": 0.0, "lead_time": 0.0},
    "full_s": 1e3,
}
_PROCESS = {
    "lead_in": {"length": 5e-3},
    "lead_out": {"length": 5e-3},
    "overlap": 1e-3,
    "dwell": 0.01,
    "switch": {"on_lead": 0.01, "off_lead": 0.01},
    "events": [
        {"name": "tool", "value": 1.0, "at": 1e-3, "lead_time": 0.01},
        {"name": "spindle speed", "value": 500.0},
    ],
    "analog": [_POWER],
    "resume_at": 0.0,
    "rejoin": 0.0,
    "lift": 0.0,
}
_CUT = {
    "overlap": 1e-3,
    "lead_in": {"length": 5e-3},
    "lead_out": {"length": 5e-3},
    "dwell": 0.01,
    "switch": {"value": 1.0, "on_lead": 0.01, "off_lead": 0.01},
    "events": [
        {"name": "tool", "value": 1.0, "at": 0.02, "lead_time": 0.01},
        {"name": "spindle speed", "value": 500.0},
    ],
    "analog": [_POWER],
    "passes": 1,
    "tabs": {"count": 1, "width": 1e-3},
}
_WAIT = {"input": "clamp", "within": 2.0, "rest": 0.1}
_PIERCED = {"switch": {}, "pierce": {"time": 0.1, "height": 1e-3}}
_WOVEN = {"weave": {"width": 1e-3, "pitch": 0.01}}
_TIMED = {"weave": {"width": 2e-3, "frequency": 2.0, "dwell": 0.05, "speed": 0.01}}
_SPACED = {"switch": {}, "tabs": {"spacing": 0.1, "width": 1e-3}}
_JOINTS = {
    "joint_velocity": 2.0,
    "joint_acceleration": 0.7,
    "joint_lower": -3.0,
    "joint_upper": 3.0,
}
_REAL = {
    "friction": 0.0, "drive_cycle": 1e-3, "acceleration_limit": 5.0, "offset": 1e-4,
}  # fmt: skip
_IDENTIFIED = {
    "model_error": 1e-4, "logged_velocity": 2.0, "logged_acceleration": 9.0,
    "logged_frequency": 4.5, "contour_ratio": 0.2, "program_ratio": 0.1, "programs": 2,
    "kp_spread": 0.1, "kv_spread": 0.1,
}  # fmt: skip
_FED = {"velocity_feedforward": 1.0, "acceleration_feedforward": 0.5}
_UR5E = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
_BY_NAME = dict(zip((f"{x}_joint" for x in _UR5E), SPACE["seed"], strict=True))
_TURNED = {"rpy": None, "quaternion": [0.0, 0.0, 0.0, 1.0]}
_ABOUT = {
    "start": [0.45, 0.0, 0.2],
    "segments": [{"center": [0.45, 0.03, 0.2], "angle": 0.5, "normal": [0.0, 0.0, 1.0]}],
    "orientation": {"rpy": [math.pi, 0.0, 0.0]},
}
_LATE = {"dead_time": 0.01}
_CERTIFIED = {
    "tolerance": 2e-3,
    "servo_error": 1e-4,
    "rms": 1e-4,
    "box": {"gains": 0.01, "dead_time": 1e-4},
}
_FREE = {"shape": "free"}
_POLED = {"method": "pole_placement"}
_INVERSE = {"one": {"compensation": {"method": "inverse_dynamics"}}}
_PLACED = [_FRAMED | {"position": [0.28, 0.20, 0.0]}]
_SIZES: dict[str, dict[str, Any]] = {
    "box": {"size": [0.1, 0.1, 0.1]},
    "capsule": {"radius": 0.05, "length": 0.1},
    "halfspace": {},
}
_BODY_TURNS: tuple[dict[str, Any], ...] = (
    {"rpy": [0.0, 0.0, 0.0]},
    {"quaternion": [0.0, 0.0, 0.0, 1.0]},
)


# Rules that select edges of the box, and tool axes along them.
_RULES: tuple[dict[str, Any], ...] = (
    {"near": [0.02, 0.0, 0.02]},
    {"face": {"near": [0.02, 0.01, 0.02]}},
    {"index": 1},
)
_FACES = {"work": 0.1, "travel": -0.1, "blend": 5e-3}


def _modelled(edges: Any, **path: Any) -> dict[str, Any]:
    """A job along edges of the box."""
    return {**SPACE, "path": {"file": "box.step", "edges": edges, **path}}


def _body(kind: str, **more: Any) -> list[dict[str, Any]]:
    """A body below everything."""
    return [{"type": kind, "name": "a", "at": [0.0, 0.0, -2.0], **_SIZES[kind], **more}]


_MOVING = ("box", "capsule")
_FACE_ANGLES = ("work", "travel", "blend")
# The schema allows these keys, but their mapping is refused for any number.
NEVER: set[Place] = {
    # The drawing has no colour.
    ("path", "colors", 0),
    ("path", "orientation", 0, "follow_tangent", "rpy", 0),
    ("path", "orientation", 0, "follow_tangent", "quaternion", 0),
    ("path", "orientation", 0, "follow_tangent", "up", 0),
    # The box has no circle and no seam, and the orientation of a model is no list.
    *(("path", "edges", key) for key in ("radius", "open")),
    *(("path", "edges", 0, key) for key in ("radius", "open")),
    *(("path", "orientation", 0, x, key) for x in ("bisector", "face") for key in _FACE_ANGLES),
    ("path", "orientation", 0, "face", "up", 0),
    # Half-spaces cannot move.
    ("arm", "tool", "shapes", 0, "normal", 0),
}
_COMMANDS = {
    "joint_velocity": 2.0,
    "joint_acceleration": 10.0,
    "joint_jerk": 1e4,
    "joint_lower": -3.0,
    "joint_upper": 3.0,
}
# The first base that has a field is the one it is tried in; what no base has is added to the first.
BASES: list[dict[str, Any]] = [
    PLANE,
    _with(
        PLANE,
        plant={**SERVO, "dead_time": 0.0, "inertia": 1.0, "ki": 1.0, **_FED},
        servo={"dead_time": 0.0, "inertia": 1.0, "ki": 1.0, **_FED},
        experiment={
            "step": 2.5e-4,
            "payload": {"mass": 1.0, "center": [0.0] * 3, "inertia": [0.01, 0, 0, 0.01, 0, 0.01]},
        },
    ),
    _with(PLANE, servo={**_REAL, **_IDENTIFIED}, plant={**SERVO, **_REAL}),
    *(
        _with(SPACE, arm={"rail": _RAIL, "preferences": {"rail": x}}, seed=[0.5, *SPACE["seed"]])
        for x in _PREFERRED
    ),
    _with(SPACE, arm={"positioner": _TABLE}, seed=[0.0, *SPACE["seed"]]),
    _with(_oriented({"axis": [0.0, 0.0, -1.0]}), arm=None, seed=None)
    | {"arm": {"file": "cell.urdf", "tip": "tcp", "part": "table", "tilt": 1.5}},
    _with(PLANE, servo=_LATE, certificate=_CERTIFIED),
    _with(PLANE, limits={"joint_torque": 50.0}, runs=_INVERSE),
    _with(PLANE, command_limits=_COMMANDS),
    _with(PLANE, command_limits={key: [x, x] for key, x in _COMMANDS.items()}),
    _with(PLANE, runs={"one": {"timing": {"method": "paper", "knots": 50}}}),
    _with(PLANE, runs={"one": {"compensation": _POLED | {"poles": [-100.0, -100.0, -150.0]}}}),
    _with(PLANE, corners=_FREE),
    _with(PLANE, corners={"continuity": "curvature"}),
    _with(PLANE, corners={"tolerance": None, "speed": 0.03, "acceleration": 0.05}),
    *(
        _with(PLANE, **{
            key: {"joint_velocity": [[-2.0, 1.0]], "joint_acceleration": [[-0.7, 0.7]]}
        })
        for key in ("limits", "command_limits")
    ),
    _with(PLANE, limits={"joint_jerk": 100.0}),
    _with(SPACE, seed=None) | {"seed": _BY_NAME},
    _with(SPACE, seed=None) | {"start_from": {"joints": SPACE["seed"]}},
    _with(SPACE, seed=None) | {"start_from": {"joints": _BY_NAME}},
    _path(start=[0.30, 0.20], segments=[_LINE]),
    _path(start=[0.30, 0.20], segments=[{"via": [0.32, 0.21], "to": [0.34, 0.20]}]),
    _path(start=[0.30, 0.20], segments=[{"center": [0.30, 0.23], "angle": 1.5}]),
    _path(**_DRAWN),
    _path(**_DRAWN, layers={"cut": {"speed": 0.05, "tolerance": 1e-3}}) | {"process": _PROCESS},
    _path(**{**_DRAWN, "frame": _PLACED[0]}),
    _path(**_DRAWN, colors=[7]),
    _path(**_DRAWN, words={"M101": {"arc": 2.5}}),
    _path(**{**_DRAWN, "units": 1e-3}),
    _path(**_DRAWN, repeat={"columns": 2, "column_spacing": 0.04, "rows": 1, "row_spacing": 0.03}),
    _with(PLANE, process=_PROCESS),
    _with(PLANE, process={"begin": 0.01}, path=_CLOSED),
    _with(PLANE, process={"kerf": 2e-4, "by_layer": {"": {"kerf": 2e-4}}}, path=_CLOSED),
    _with(PLANE, process={**_CUT, "by_layer": {"": _CUT}}, path=_CLOSED),
    _with(PLANE, process={"wait": _WAIT, "by_layer": {"": {"wait": _WAIT}}}),
    _with(PLANE, process={"wait": [_WAIT], "by_layer": {"": {"wait": [_WAIT]}}}),
    _with(PLANE, process={"only": [1]}),
    _with(PLANE, process={**_TIMED, "by_layer": {"": _TIMED}}),
    _with(PLANE, process={**_WOVEN, "by_layer": {"": _WOVEN}}),
    _with(PLANE, process={**_SPACED, "by_layer": {"": _SPACED}}, path=_CLOSED),
    _with(PLANE, process={"begin": [0.3, 0.2]}, path=_CLOSED),
    _with(PLANE, process={"events": [{"name": "tool", "at": 0.02}]}),
    SPACE,
    _with(SPACE, process={"approach": 0.01, "retract": 0.01}),
    _with(SPACE, process={"rapid_speed": 0.5, "approach_speed": 0.1}),
    _with(SPACE, process={**_PIERCED, "by_layer": {"": _PIERCED}}),
    _with(SPACE, limits={"angular_acceleration": 10.0, "joint_torque": 100.0}),
    _with(SPACE, arm={"tool": _TURNED, "work": _TURNED}),
    *(_oriented(x) for x in _ORIENTED),
    *(_oriented([x] * 3) for x in ({"rpy": _GIVEN[0]}, *_ORIENTED)),
    _with(PLANE, runs={"one": {"timing": {"reserve": 0.1}, "end_time": 5.0, "duration": 4.0}}),
    _with(PLANE, servo={"inertia": 0.1}, plant={"inertia": 0.1}),
    _with(PLANE, limits=_JOINTS),
    _with(PLANE, limits={key: [x, x] for key, x in _JOINTS.items()}),
    _with(PLANE, servo=_LATE, certificate=_CERTIFIED | {"box": {"gains": [[0.01] * 2] * 2}}),
    _with(PLANE, certificate=_CERTIFIED | {"box": {"dead_time": 1e-4, "shared": True}}),
    _with(PLANE, certificate=_CERTIFIED | {"slowest": 1.5}),
    _with(PLANE, runs={"one": {"compensation": _POLED | {"poles": [[-99.0, -99.0, -150.0]] * 2}}}),
    _with(PLANE, export={"formats": ["urscript"], "outputs": {"a": {"urscript": 1}},
                         "inputs": {"a": {"urscript": 1}},
                         "servoj": {"gain": 300.0, "lookahead": 0.1}}),
    _with(PLANE, export={"formats": ["ros-yaml"], "outputs": {"a": 1}, "inputs": {"a": 1},
                         "tolerances": 2.0,
                         "points": 9, "point_tolerance": 1e-3, "cycle": 0.01, "derivatives": 1}),
    {**SPACE, "path": _ABOUT},
    *(
        _with(SPACE, scene={"obstacles": _body(kind, margin=0.01, **x)})
        for kind in _SIZES
        for x in _BODY_TURNS
    ),
    _with(SPACE, scene={"obstacles": _body("halfspace", normal=[0.0, 0.0, 1.0])}),
    _with(SPACE, scene={"margins": {"environment": 0.01, "own": 0.001, "tool": 0.001}}),
    _with(SPACE, scene={"floor": -0.4}),
    *(
        _with(SPACE, arm=arm)
        for kind in _MOVING
        for x in _BODY_TURNS
        for arm in (
            {"tool": {"shapes": _body(kind, **x)}},
            {"shapes": _body(kind, link="base", **x)},
        )
    ),
    _with(SPACE, arm={"tool": {"shapes": _body("halfspace", normal=[0.0, 0.0, 1.0])}}),
    _with(SPACE, arm={"shapes": _body("halfspace", link="base", normal=[0.0, 0.0, 1.0])}),
    *(_modelled(x) for x in _RULES),
    *(_modelled([x]) for x in _RULES),
    _modelled({"kind": "circle", "radius": 5e-3}),
    _modelled([{"kind": "circle", "radius": 5e-3}]),
    _modelled({"seams": ["box", "post"], "open": 0.1}),
    _modelled([{"seams": ["box", "post"], "open": 0.1}]),
    *(
        _modelled(_RULES[0], orientation=x)
        for x in ({"bisector": _FACES}, {"face": {"up": [0.0, 0.0, 1.0], **_FACES}})
    ),
    *(_oriented([{x: {"up": [0.0, 0.0, 1.0], **_FACES}}]) for x in ("face",)),
    _oriented([{"bisector": _FACES}]),
    _with(_modelled(_RULES[0]), scene={"model": {"margin": 1e-3}}),
]  # fmt: skip
_OWN = {"speed": 0.05, "tolerance": 1e-3, "order": 1}
BASES.append(_with(PLANE, path={"contours": {"1": _OWN}}))
# What a layer can have, a contour can have.
BASES += [
    _with(x, path={"contours": {"1": x["process"]["by_layer"][""]}})
    for x in BASES
    if "by_layer" in x.get("process", {})
]


def fields() -> list[Place]:
    """Every place of a job that takes a number: keys, 0 for any item of a list, ANY for any key."""
    schema = json_schema()
    return list(dict.fromkeys(_numbers_in(schema, schema, ())))


def _numbers_in(schema: dict[str, Any], node: dict[str, Any], place: Place) -> Iterator[Place]:
    while "$ref" in node:
        rest = {key: value for key, value in node.items() if key != "$ref"}
        node = schema["$defs"][node["$ref"].split("/")[-1]] | rest
    if node.get("type") in ("number", "integer"):
        yield place
        return
    for kind in (*node.get("anyOf", ()), *node.get("oneOf", ())):
        yield from _numbers_in(schema, kind, place)
    for key, value in node.get("properties", {}).items():
        yield from _numbers_in(schema, value, (*place, key))
    inside = node.get("additionalProperties")
    for value in (inside, *node.get("patternProperties", {}).values()):
        if isinstance(value, dict):
            yield from _numbers_in(schema, value, (*place, ANY))
    for value in (node.get("items"), *node.get("prefixItems", ())):
        if value is not None:
            yield from _numbers_in(schema, value, (*place, 0))


def base_of(place: Place) -> dict[str, Any]:
    """A small valid job that has a number in a place.

    Raises:
        LookupError: No base has it, and it cannot be made up: BASES needs one.
    """
    for base in BASES:
        if _number_at(base, place):
            return copy.deepcopy(base)
    return _made_up(place)


def put(base: dict[str, Any], place: Place, value: Any) -> dict[str, Any]:
    """The job with a value in a place."""
    data = copy.deepcopy(base)
    inner: Any = data
    for key in place[:-1]:
        inner = inner[_key(inner, key)]
    inner[_key(inner, place[-1])] = value
    return data


def shown(place: Place) -> str:
    """A place for people."""
    return ".".join(map(str, place))


def _key(inner: Any, key: str | int) -> Any:
    return next(iter(inner)) if key == ANY else key


def _number_at(base: Any, place: Place) -> bool:
    for key in place:
        if isinstance(base, dict) and isinstance(key, str):
            base = base.get(_key(base, key)) if base else None
        elif isinstance(base, list) and key == 0 and base:
            base = base[0]
        else:
            return False
    return isinstance(base, int | float) and not isinstance(base, bool)


def _made_up(place: Place) -> dict[str, Any]:
    """The first base with a place added: the runs' own keys take what the job has there."""
    if (
        place[:2] == ("runs", ANY)
        and len(place) > 2
        and place[2] in ("limits", "command_limits", "corners", "cycle", "speed_factor")
    ):
        outer = base_of(place[2:])
        value = outer[str(place[2])]
        return put(_with(outer, runs={"one": {str(place[2]): value}}), ("runs", "one", *place[2:]),
                   _value_at(outer, place[2:]))  # fmt: skip
    if place[-1] == 0:
        # One number per joint where a base has one for all.
        outer = base_of(place[:-1])
        joints = 2 if outer["arm"] == "pmk3s" else 6
        return put(outer, place[:-1], [_value_at(outer, place[:-1])] * joints)
    raise LookupError(f"no base of tests/properties/number_cases.py has {shown(place)}: add one")


def _value_at(base: Any, place: Place) -> Any:
    for key in place:
        base = base[_key(base, key)]
    return base
