"""Names that users guess, and the right form of each, for messages about unknown names.

A name is looked up in this order: the forms of its owner in `FORMS`, the names of the same quantity
in `SAME`, the functions of `armcontour` (a user writes `path.plan(arm)` for `ac.plan(path, arm)`),
and names that are spelled similarly.
"""

from __future__ import annotations

import difflib
from abc import ABCMeta
from collections.abc import Iterable
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Smallest similarity of a misspelled name.
SIMILARITY = 0.65
# Largest number of names that a message lists.
MAX_LISTED = 16
PACKAGE = "armcontour"

# Names for the same quantity: guess -> names of this package, of which an owner has at most one.
SAME: dict[str, tuple[str, ...]] = {
    "base_frame": ("base",),
    "base_link": ("base",),
    "ee_link": ("tip",),
    "end_link": ("tip",),
    "flange": ("tip",),
    "tcp_link": ("tip",),
    "tip_link": ("tip",),
    "tool_link": ("tip",),
    "acc": ("ddq", "joint_acceleration"),
    "acceleration": ("joint_acceleration", "ddq", "acceleration_limit"),
    "accelerations": ("ddq", "joint_acceleration"),
    "center_of_mass": ("center",),
    "closed_loop": ("closed",),
    "com": ("center",),
    "concat": ("joined",),
    "concatenate": ("joined",),
    "curvature": ("curvatures",),
    "delay": ("dead_time",),
    "dt": ("cycle", "interval"),
    "end_effector": ("tool", "tip"),
    "fk": ("forward",),
    "forward_kinematics": ("forward",),
    "get_jacobian": ("jacobian",),
    "ik": ("inverse",),
    "inverse_dynamics": ("torque",),
    "inverse_kinematics": ("inverse",),
    "jerk": ("joint_jerk", "jerk"),
    "joint_positions": ("q",),
    "joint_speed": ("joint_velocity",),
    "joint_speeds": ("joint_velocity", "dq"),
    "joint_velocities": ("dq", "joint_velocity"),
    "joints": ("q", "dof", "joint_names"),
    "kd": ("kv",),
    "lengths": ("links",),
    "link_lengths": ("links",),
    "lower": ("joint_lower",),
    "max_acceleration": ("joint_acceleration",),
    "max_jerk": ("joint_jerk",),
    "max_speed": ("speed", "tool_speed"),
    "max_torque": ("joint_torque",),
    "max_velocity": ("joint_velocity",),
    "n_joints": ("dof",),
    "names": ("joint_names",),
    "num_joints": ("dof",),
    "offset_time": ("dead_time",),
    "period": ("cycle", "interval"),
    "position": ("q",),
    "position_gain": ("kp",),
    "positions": ("q",),
    "qd": ("dq",),
    "qdd": ("ddq",),
    "qddot": ("ddq",),
    "qdot": ("dq",),
    "reverse": ("reversed",),
    "sample_time": ("cycle", "interval"),
    "set_limits": ("with_limits",),
    "set_tool": ("with_tool",),
    "solve_ik": ("inverse",),
    "speed": ("speed", "tool_speed", "path_velocity"),
    "speeds": ("tool_speed",),
    "tangent": ("tangents",),
    "tcp_speed": ("tool_speed", "speed"),
    "tcp_velocity": ("tool_speed", "speed"),
    "time": ("t", "duration"),
    "time_step": ("cycle", "interval"),
    "times": ("t",),
    "timestamps": ("t",),
    "tolerance_mm": ("tolerance",),
    "torque": ("joint_torque", "torque"),
    "torques": ("torque", "joint_torque"),
    "total_time": ("duration",),
    "upper": ("joint_upper",),
    "vel": ("dq", "joint_velocity"),
    "velocities": ("dq", "joint_velocity"),
    "velocity": ("joint_velocity", "dq"),
    "velocity_gain": ("kv",),
    "vmax": ("joint_velocity",),
    "amax": ("joint_acceleration",),
}
_READ = "ac.read_path(file)"
_LOAD = "ac.load_arm(name)"
_PLAN = "ac.plan(path, arm)"
_EXPORT = "ac.export(data, file)"
_PLACED = "path.placed(frame)"
_TURNED = "path.placed(ac.Frame.rpy((x, y, z), angles))"
_VERTICES = "path.vertices"
_POINTS = "ac.Path.polyline(points)"
_ROUND = "ac.round_corners(path, tolerance=radius)"
_TOOL = "arm.with_tool((x, y, z))"
_POSES = "arm.forward(q)"
_ERROR = "ac.evaluate(executed, path).contour_error.max"
_SCALED = "arm.limits.replace(joint_velocity=factor * arm.limits.joint_velocity)"
_ROWS = "planned.sample(cycle)"
_LEARN = "ac.learn(set_points, executed, arm=arm, servo=servo)"
# Right forms, as expressions of Python, by owner (a class, `armcontour`, or a function for its
# arguments) and guess. Tests evaluate each of them.
FORMS: dict[str, dict[str, str]] = {
    PACKAGE: {
        **dict.fromkeys(
            (
                "from_csv from_dxf from_gcode from_svg load_csv load_drawing load_dxf load_gcode "
                "load_path load_svg open_path read_csv read_drawing read_dxf read_gcode read_step "
                "read_svg import_dxf read_toolpath load_toolpath"
            ).split(),
            _READ,
        ),
        **dict.fromkeys(
            (
                "Robot RobotArm from_urdf get_arm get_robot load_robot load_urdf make_arm "
                "read_arm read_urdf robot URDF Manipulator"
            ).split(),
            _LOAD,
        ),
        **dict.fromkeys(
            "arms available_arms list_arms list_robots robots".split(), "ac.arm_names()"
        ),
        **dict.fromkeys(
            "Tool TCP EndEffector".split(), "ac.load_arm(name, tool=ac.Frame((x, y, z)))"
        ),
        **dict.fromkeys("Pose Transform SE3 Transformation".split(), "ac.Frame((x, y, z))"),
        **dict.fromkeys("Rotation Orientation".split(), "ac.Frame.rpy((x, y, z), angles)"),
        **dict.fromkeys("Polyline Point Points Waypoint Waypoints polyline".split(), _POINTS),
        "Circle": "ac.Path.circle(point, radius)",
        "Spline": "ac.Path.spline(points)",
        **dict.fromkeys(
            (
                "optimize parametrize parameterize plan_path plan_trajectory retime time_optimal "
                "time_parameterize toppra topp timing generate_trajectory compute_trajectory "
                "optimize_trajectory"
            ).split(),
            _PLAN,
        ),
        **dict.fromkeys("blend fillet round smooth smooth_corners blend_corners".split(), _ROUND),
        **dict.fromkeys("ik inverse_kinematics solve_ik".split(), "arm.inverse(pose)"),
        **dict.fromkeys("fk forward_kinematics".split(), _POSES),
        **dict.fromkeys(
            "Servo Controller PID Gains ServoGains".split(), "ac.ServoModel(kp=kp, kv=kv)"
        ),
        **dict.fromkeys(
            "Simulator Plant Simulation SimulatedRobot".split(), "ac.ServoPlant(arm, servo)"
        ),
        **dict.fromkeys(
            "save write write_csv to_csv save_csv export_csv to_urscript".split(), _EXPORT
        ),
        **dict.fromkeys("plot show draw visualize animate".split(), "planned.plot()"),
        **dict.fromkeys(
            "Constant ConstantSpeed ConstantVelocity Uniform UniformSpeed".split(),
            "ac.plan(path, arm, ac.Limits(speed=speed), ac.Conventional())",
        ),
        **dict.fromkeys("report html_report make_report".split(), "ac.write_report(planned, file)"),
        **dict.fromkeys("contour_error compute_error error errors".split(), _ERROR),
        **dict.fromkeys("load open read".split(), "ac.load_arm(name), ac.read_path(file)"),
        **dict.fromkeys("load_job Config from_yaml load_yaml".split(), "ac.read_job(file)"),
        **dict.fromkeys("load_log".split(), "ac.read_log(file)"),
        **dict.fromkeys(
            "identify_servo fit_servo system_identification".split(), "ac.identify(logs)"
        ),
        "Load": "ac.Payload(mass, (x, y, z))",
        "Toolpath": _READ,
    },
    "Path": {
        **dict.fromkeys(
            "from_csv from_dxf from_file from_gcode from_step from_svg load read open".split(),
            _READ,
        ),
        **dict.fromkeys("from_list from_points from_waypoints from_array".split(), _POINTS),
        **dict.fromkeys(
            "translate translated move moved shift shifted offset_by".split(),
            "path.placed((x, y, z))",
        ),
        **dict.fromkeys("transform transformed apply place".split(), _PLACED),
        **dict.fromkeys("rotate rotated turn turned".split(), _TURNED),
        **dict.fromkeys("scale scaled".split(), "path.placed((x, y, z), scale=factor)"),
        **dict.fromkeys(
            "points waypoints_xyz coordinates xyz corners knots nodes".split(), _VERTICES
        ),
        **dict.fromkeys(
            "at evaluate position point sample interpolate eval pose point_at position_at".split(),
            "path(s)",
        ),
        **dict.fromkeys("tangent tangent_at derivative direction".split(), "path(s, 1)"),
        **dict.fromkeys("curvature curvature_at".split(), "path(s, 2)"),
        **dict.fromkeys("bounds bounding_box bbox extents".split(), "path.vertices.min(axis=0)"),
        **dict.fromkeys("closed is_closed".split(), "np.allclose(path.start, path.end)"),
        **dict.fromkeys("round rounded fillet blend smooth".split(), _ROUND),
        **dict.fromkeys("append extend concat concatenate add join".split(), "path.joined(other)"),
        **dict.fromkeys(
            "offset kerf offset_curve parallel".split(),
            "ac.prepare(path, ac.Process(kerf=width, kerf_side='left'))",
        ),
        **dict.fromkeys(
            "with_orientation orient set_orientation".split(), "path.oriented(rotation)"
        ),
        **dict.fromkeys("point_down tool_axis with_tool_axis".split(), "path.pointing((0, 0, -1))"),
        **dict.fromkeys("n_segments num_segments".split(), "len(path)"),
        **dict.fromkeys("show draw visualize figure".split(), "path.plot()"),
        **dict.fromkeys("save to_csv write".split(), _EXPORT),
        "flip": "path.reversed()",
        "from_urdf": _LOAD,
    },
    "Path.arc": {
        "radius": "ac.Path([ac.Arc.through(start, via, end)])",
        "center": "ac.Path.circle(point, radius)",
    },
    "Path.polyline": {
        "units": "ac.Path.polyline(1e-3 * np.array(points))",
        "unit": "ac.Path.polyline(1e-3 * np.array(points))",
        **dict.fromkeys(
            "orientation tool_axis direction".split(),
            "ac.Path.polyline(points).pointing((0, 0, -1))",
        ),
        "speed": "ac.Path.polyline(points, segment_limits=ac.SegmentLimits(speed=speed))",
    },
    "read_path": {
        **dict.fromkeys("tolerance corner_tolerance radius".split(), _ROUND),
        **dict.fromkeys("kerf offset".split(), "ac.prepare(path, ac.Process(kerf=width))"),
        **dict.fromkeys("unit units".split(), "ac.read_path(file, ac.ReadOptions(units='mm'))"),
        **dict.fromkeys(
            "layer layers".split(), "ac.read_path(file, ac.ReadOptions(layers=layers))"
        ),
        **dict.fromkeys("edge edges".split(), "ac.read_path(file, ac.ReadOptions(edges=edges))"),
    },
    "load_arm": {
        **dict.fromkeys(
            "acceleration joint_acceleration limits velocity joint_velocity".split(),
            "ac.load_arm(name, joint_limits=limits_file)",
        ),
    },
    "Program": {
        **dict.fromkeys(
            "translate translated move moved shift shifted".split(), "program.placed((x, y, z))"
        ),
        **dict.fromkeys("transform transformed place".split(), "program.placed(frame)"),
        **dict.fromkeys(
            "rotate rotated turn turned".split(),
            "program.placed(ac.Frame.rpy((x, y, z), angles))",
        ),
        **dict.fromkeys("scale scaled".split(), "program.placed((x, y, z), scale=factor)"),
        **dict.fromkeys(
            "bounds bounding_box bbox extents size".split(),
            "np.concatenate([x.path.vertices for x in program.contours]).min(axis=0)",
        ),
        **dict.fromkeys("paths curves shapes".split(), "program.contours"),
        **dict.fromkeys(
            "vertices points corners".split(), "[x.path.vertices for x in program.contours]"
        ),
        **dict.fromkeys("show draw visualize figure".split(), "program.plot()"),
    },
    "Picture": {
        **dict.fromkeys(
            "save savefig write write_image to_html to_png to_svg".split(),
            "planned.plot().write_html(file)",
        ),
        # A notebook shows the last expression of a cell.
        "show": "planned.plot()",
    },
    "JointPath": {
        **dict.fromkeys("joints points positions q values".split(), "ac.trace(path, arm)(s)"),
    },
    "Trajectory": {
        **dict.fromkeys(
            "at evaluate eval position interpolate position_at positions_at".split(), "planned(t)"
        ),
        **dict.fromkeys("velocity velocity_at".split(), "planned(t, 1)"),
        **dict.fromkeys("acceleration acceleration_at".split(), "planned(t, 2)"),
        **dict.fromkeys(
            "samples resample to_array to_numpy to_dataframe to_pandas as_array".split(), _ROWS
        ),
        **dict.fromkeys(
            "save to_csv to_file write to_urscript export_csv".split(), "ac.export(planned, file)"
        ),
        **dict.fromkeys("show draw visualize figure".split(), "planned.plot()"),
        **dict.fromkeys(
            "max_velocity peak_velocity max_joint_velocity".split(), "abs(planned.dq).max(axis=0)"
        ),
        **dict.fromkeys(
            "max_acceleration peak_acceleration".split(), "abs(planned.ddq).max(axis=0)"
        ),
        **dict.fromkeys("tool_speed speed path_speed tcp_speed".split(), "planned.speed_at(s)"),
        **dict.fromkeys(
            "tool_path tcp tool tool_positions cartesian".split(), "arm.tool_position(planned.q)"
        ),
        **dict.fromkeys("slow_down scale scaled stretch".split(), "planned.stretched(factor)"),
        **dict.fromkeys(
            "active_limits active_limit limited_by limiting bottleneck bottlenecks".split(),
            "planned.explain()",
        ),
        **dict.fromkeys("info report stats statistics summary".split(), "print(planned)"),
        **dict.fromkeys("from_file load read".split(), _PLAN),
        "jerk": "planned(t, 3)",
    },
    "SetPoints": {
        **dict.fromkeys(
            "save to_csv to_file to_urscript write".split(), "ac.export(set_points, file)"
        ),
        **dict.fromkeys("positions joints values data".split(), "set_points.q"),
        **dict.fromkeys("duration total_time".split(), "set_points.t[-1]"),
        **dict.fromkeys("plot show figure draw".split(), "set_points.trajectory.plot()"),
        **dict.fromkeys(
            "as_array dataframe to_array to_dataframe to_numpy to_pandas".split(),
            "np.column_stack([set_points.t, set_points.q])",
        ),
    },
    "Execution": {
        **dict.fromkeys(
            "tcp tool_path tool_positions tool_position cartesian".split(), "executed.tool"
        ),
        **dict.fromkeys("contour_error error errors max_error".split(), _ERROR),
        **dict.fromkeys("show draw visualize figure".split(), "executed.plot()"),
        **dict.fromkeys("to_csv save".split(), "ac.export(executed.set_points, file)"),
        **dict.fromkeys("log to_log learn".split(), _LEARN),
        "duration": "executed.t[-1]",
    },
    "ErrorProfile": {
        "mean": "error.values.mean()",
        **dict.fromkeys("percentile quantile".split(), "np.percentile(error.values, 95)"),
        **dict.fromkeys("draw plot show".split(), "evaluation.plot('error')"),
    },
    "Evaluation": {
        **dict.fromkeys(
            "max max_contour_error max_error maximum peak worst".split(),
            "evaluation.contour_error.max",
        ),
        **dict.fromkeys(
            "rms rms_error rmse contour_rms mean".split(), "evaluation.contour_error.rms"
        ),
        **dict.fromkeys("error errors contour".split(), "evaluation.contour_error"),
        **dict.fromkeys("show draw visualize figure".split(), "evaluation.plot('error')"),
    },
    "Identification": {
        **dict.fromkeys(
            "gains kp kv model order dead_time servo parameters".split(),
            "ac.identify(logs).servo_model()",
        ),
        **dict.fromkeys("unexplained error fit".split(), "ac.identify(logs).joints"),
    },
    "Arm": {
        **dict.fromkeys("from_urdf from_file load from_name".split(), _LOAD),
        **dict.fromkeys("pose tool_pose fkine end_effector_pose tcp_pose".split(), _POSES),
        **dict.fromkeys("tcp tool flange ee".split(), _TOOL),
        **dict.fromkeys(
            "with_payload payload set_payload".split(),
            "ac.load_arm(name, payload=ac.Payload(mass, (x, y, z)))",
        ),
        **dict.fromkeys("with_base base set_base".split(), "arm.with_work((x, y, z))"),
        **dict.fromkeys("joint_limits position_limits q_limits".split(), "arm.limits.joint_lower"),
        **dict.fromkeys(
            "velocity_limits joint_velocity_limits".split(), "arm.limits.joint_velocity"
        ),
        **dict.fromkeys("gravity gravity_torque".split(), "arm.torque(q, 0 * q, 0 * q)"),
        **dict.fromkeys("rne inverse_dynamics".split(), "arm.torque(q, 0 * q, 0 * q)"),
        **dict.fromkeys("mass_matrix inertia".split(), "arm.dynamics"),
        **dict.fromkeys("home zero home_position q_home q0".split(), "arm.inverse(pose)"),
        **dict.fromkeys("reach workspace max_reach".split(), "arm.span"),
    },
    "Limits": {
        **dict.fromkeys("scale scaled".split(), _SCALED),
        **dict.fromkeys("copy with_ update set".split(), "arm.limits.replace(speed=speed)"),
        **dict.fromkeys(
            "from_yaml from_file load".split(), "ac.load_arm(name, joint_limits=limits_file)"
        ),
        **dict.fromkeys("position positions joint_position".split(), "arm.limits.joint_lower"),
        "path_speed": "ac.Limits(speed=speed)",
        "feed_rate": "ac.Limits(speed=speed)",
        "feed": "ac.Limits(speed=speed)",
    },
    "plan": {
        **dict.fromkeys(
            "max_velocity velocity velocity_limits ".split(),
            "ac.plan(path, arm, ac.Limits(joint_velocity=velocity))",
        ),
        **dict.fromkeys(
            "max_acceleration acceleration ".split(),
            "ac.plan(path, arm, ac.Limits(joint_acceleration=acceleration))",
        ),
        **dict.fromkeys(
            "max_speed feed feed_rate".split(), "ac.plan(path, arm, ac.Limits(speed=speed))"
        ),
        **dict.fromkeys(
            "jerk max_jerk jerk_limit ".split(), "ac.plan(path, arm, ac.Limits(joint_jerk=jerk))"
        ),
        **dict.fromkeys(
            "tolerance corner_tolerance blend_radius".split(),
            "ac.plan(ac.round_corners(path, tolerance=radius), arm)",
        ),
        **dict.fromkeys(
            "tool tcp payload".split(), "ac.plan(path, ac.load_arm(name, tool=ac.Frame((x, y, z))))"
        ),
        **dict.fromkeys("robot urdf".split(), _PLAN),
    },
    "round_corners": {
        **dict.fromkeys("radius blend_radius blend max_error error distance".split(), _ROUND),
    },
    "run": {
        **dict.fromkeys("cell arm robot".split(), "ac.run(ac.read_job(file, cell='ur5e'))"),
        "out": "ac.write_report(planned, file)",
    },
    "JobResult": {
        **dict.fromkeys("show draw figure".split(), "result.plot()"),
        **dict.fromkeys(
            "report save write_report to_html".split(), "ac.write_report(result, file)"
        ),
    },
}

# How users make or load an object of a class, for messages about an argument of another class.
MADE_BY = {
    "Contour": "ac.Contour(path)",
    "Execution": "ac.simulate(set_points, plant)",
    "Frame": "ac.Frame((x, y, z))",
    "Job": "ac.read_job(file)",
    "Limits": "ac.Limits(speed=speed)",
    "Log": "ac.read_log(file)",
    "Path": _POINTS,
    "Payload": "ac.Payload(mass)",
    "Plant": "ac.ServoPlant(arm, servo)",
    "Program": _READ,
    "ServoModel": "ac.ServoModel(kp=kp, kv=kv)",
    "SetPoints": "ac.compensate(planned, servo)",
    "Trajectory": _PLAN,
}


def made_by(kinds: Iterable[type]) -> str:
    """Write how the first of some classes is made, as ", such as ..."; empty if none is known."""
    for kind in kinds:
        if kind.__name__ in MADE_BY and kind.__module__.startswith(PACKAGE):
            return f", such as {MADE_BY[kind.__name__]},"
    return ""


def suggest(name: str, valid: Iterable[str], otherwise: str) -> str:
    """Ask whether the most similar valid name is meant; if none is similar, return `otherwise`.

    >>> suggest("kpp", ["kp", "kv"], "")
    'did you mean kp?'
    """
    names = list(valid)
    meant = _same(name, names) or difflib.get_close_matches(name, names, n=1, cutoff=SIMILARITY)
    return f"did you mean {meant[0]}?" if meant else otherwise


def _same(name: str, valid: list[str]) -> list[str]:
    """Return the valid names of the quantity that users also call `name`, the best one first."""
    known = [x for x in SAME.get(name, ()) if x in valid]
    # These words are used for the same quantity.
    plain = name.lower().replace("velocity", "speed")
    return known or [x for x in valid if x.lower().replace("velocity", "speed") == plain]


def form_of(owners: Iterable[str], name: str) -> str:
    """Write how the first of the owners with a form for this name does it; empty if none has."""
    for owner in owners:
        if name in FORMS.get(owner, {}):
            return f"write {FORMS[owner][name]}"
    return ""


def explain_attribute(owner: type, name: str) -> str:
    """Explain that a class and its instances do not have an attribute, and what is right."""
    parents = [x.__name__ for x in owner.__mro__]
    names = [x for x in dir(owner) if not x.startswith("_")]
    functions = import_module(PACKAGE).__all__
    hint = form_of(parents, name)
    if not hint and _same(name, names):
        hint = suggest(name, names, "")
    if not hint and name in functions and name.islower():
        hint = f"{name} is a function: write ac.{name}(...)"
    shown = ", ".join(names[:MAX_LISTED])
    more = f" and {len(names) - MAX_LISTED} more" if len(names) > MAX_LISTED else ""
    hint = hint or suggest(name, names, f"it has {shown}{more}")
    return f"{owner.__name__} has no attribute {name!r} ({hint})."


def explain_module_name(package: str, name: str, names: list[str]) -> str:
    """Explain that a package does not have a name, and what is right."""
    hint = form_of((package,), name) or suggest(name, names, f"see help({package})")
    return f"module {package!r} has no attribute {name!r} ({hint})"


class UnknownName(AttributeError):
    """An attribute that does not exist; its message is written when it is shown."""

    def __init__(self, owner: type, attribute: str) -> None:
        super().__init__(owner, attribute)
        self.owner = owner
        self.attribute = attribute

    def __str__(self) -> str:
        """Explain what is right; not earlier, because `hasattr` never shows the message."""
        return explain_attribute(self.owner, self.attribute)


class ExplainedType(type):
    """Type of classes whose unknown attributes are explained."""

    if not TYPE_CHECKING:

        def __getattr__(cls, name: str) -> Any:
            """Explain an unknown attribute of the class, such as Path.from_dxf."""
            if name.startswith("_"):
                raise AttributeError(f"type object {cls.__name__!r} has no attribute {name!r}")
            raise UnknownName(cls, name)


class ExplainedABC(ExplainedType, ABCMeta):
    """Type of abstract classes whose unknown attributes are explained."""


class Explained(metaclass=ExplainedType):
    """Base of classes whose instances explain unknown attributes."""

    __slots__ = ()

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Explain an unknown attribute, such as planned.positions."""
            kind = type(self)
            if name.startswith("_") or any(name in vars(x) for x in kind.__mro__):
                # The name exists, but its value is missing or its property raised this error.
                return object.__getattribute__(self, name)
            raise UnknownName(kind, name)
