"""Dataclasses with the keys of job files; some keys use dataclasses of other packages."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from armcontour.control.compensation import CompensationOptions
from armcontour.core.quantities import (
    Angle,
    AtLeast,
    ConeAngle,
    Convert,
    Distance,
    Interval,
    Items,
    JointAccelerations,
    JointJerks,
    JointRanges,
    JointVelocities,
    Key,
    Length,
    PartialFields,
    SpeedFactor,
)
from armcontour.core.text import show
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.files.file_keys import Methods
from armcontour.files.model.tool_axis import Bisector, FaceNormal
from armcontour.files.robots.urdf_tree import ArmOptions
from armcontour.files.scene_file import (
    BodyModel,
    Direction,
    LinkShapeModel,
    Place,
    RotationModel,
    SceneModel,
)
from armcontour.files.servo_presets import ServoKey
from armcontour.geometry import SegmentLimits
from armcontour.jobs import CertificateGoal, Experiment, Exports, Rounding
from armcontour.jobs.methods import COMPENSATIONS, TIMINGS
from armcontour.planning import FASTEST, PlanOptions
from armcontour.program import ContourProcess, Process
from armcontour.robot import Limits
from armcontour.robot.bodies import Payload
from armcontour.robot.external_axes import Positioner, Rail
from armcontour.robot.preferences import Prefer, Weight
from armcontour.robot.servo import ServoModel

Point = Annotated[list[Length], Items(2, 3)]
# Names of runs, which are names of files.
RUN_NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
# Results of an identification, which are no parameters of a plant.
IDENTIFIED = (
    "model_error",
    "logged_velocity",
    "logged_acceleration",
    "logged_frequency",
    "contour_ratio",
    "program_ratio",
    "programs",
    "kp_spread",
    "kv_spread",
    "source",
)
Timing = Annotated[
    PlanOptions,
    Methods(
        "Timing of the path.",
        "The fastest timing (optimal), the paper's (paper), or uniform speed (conventional).",
        tuple(TIMINGS.values()),
    ),
]
Compensation = Annotated[
    CompensationOptions,
    Methods(
        "Compensation of the servo's delay.",
        "The exact inverse of the servo, pole placement (servo of order second only), inverse "
        "dynamics of drives and arm (arm with masses, servo of order second), or none. By default "
        "inverse_dynamics for a run with an experiment, if arm and servo permit it, else inverse.",
        tuple(COMPENSATIONS.values()),
        has_default=False,
    ),
]


def _run_name(name: str) -> str:
    """Check the name of a run."""
    if not re.match(RUN_NAME, name):
        raise ValueError(
            "the name must consist of at most 64 letters, digits, - and _, and must begin with a "
            f"letter or a digit, but is {show(name)}"
        )
    return name


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameModel(RotationModel):
    """A position and a rotation; both are zero by default.

    Args:
        position: The position [m].
    """

    position: Place | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ToolModel(FrameModel):
    """The tool frame relative to the tip of the arm, and the shapes of the tool.

    Args:
        shapes: Shapes of the tool, and of a part in the gripper, in the frame of the tip.
    """

    shapes: list[BodyModel] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PreferenceModel:
    """How one joint of the arm should move, if the path leaves a choice.

    Args:
        hold: Position at which the joint stays for the whole job: an angle such as `10 deg`, or for
            a linear axis a length such as `0.3 m`; by default it moves. A plain number is in rad or
            m.
        weight: Cost of its motion relative to the other joints. A joint with a larger weight moves
            less.
        range: Lower and upper end of a range that is narrower than the joint's own, as angles or
            lengths; by default its own.
        still: Whether the joint stays still within each contour, and moves between contours only.
    """

    hold: float | str | None = None
    weight: Weight = 1.0
    range: Annotated[list[float | str], Items(2, 2)] | None = None
    still: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmModel(ArmOptions):
    """An arm by `name` or `file`, with its tool, work frame, payload and additional shapes.

    File names are relative to the job file.

    Args:
        name: A built-in arm: `armcontour arms` lists them.
        file: A .urdf or .yaml file.
        tool: The tool: its frame relative to the tip, and its shapes.
        work: The frame of the path relative to the base; by default that of the link `part`, or the
            base.
        payload: Payload at the tip.
        shapes: Additional shapes of links, such as hoses and cameras, in the frames of the links.
        rail: A linear axis that carries the arm.
        positioner: Axes between the floor and the part.
        preferences: How joints should move, by their names: joints of the arm, `rail`, axes of the
            positioner and joints of a description.
        prefer: What the planner prefers if the arm can follow a path in several ways: the shortest
            duration (`fastest`), or the least weighted motion of the joints (`least motion`). By
            default the least motion among those that are almost as fast as the fastest one.
    """

    name: str | None = None
    file: str | None = None
    tool: ToolModel | None = None
    work: FrameModel | None = None
    payload: Payload | None = None
    shapes: list[LinkShapeModel] | None = None
    rail: Rail | None = None
    positioner: Positioner | None = None
    preferences: dict[str, PreferenceModel] = field(default_factory=dict)
    prefer: Prefer | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentModel(SegmentLimits):
    """A line `to` a point, an arc `via` a point `to` another, or an arc around a `center`.

    Args:
        to: End of a line or an arc [m].
        via: A point on an arc [m].
        center: Centre of an arc [m].
        angle: Angle of an arc around a centre, counter-clockwise positive; a full circle has 360
            deg [rad].
        normal: Axis of an arc around a centre, in space.
    """

    to: Point | None = None
    via: Point | None = None
    center: Point | None = None
    angle: Angle | None = None
    normal: list[float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowModel(RotationModel):
    """A fixed tool orientation relative to the tangent, which is the x axis of the moving frame.

    `rpy` or `quaternion` specify the tool orientation in this frame; by default the tool axis
    points opposite to `up`.

    Args:
        up: Direction of the z axis of the moving frame.
    """

    up: Direction


@dataclass(frozen=True, slots=True, kw_only=True)
class OrientationModel(RotationModel):
    """The required tool orientation: one of the keys except `axis_only` and `cone`.

    Args:
        axis: Direction of the tool axis; rotation about the tool axis is free.
        follow_tangent: A fixed orientation relative to the tangent.
        bisector: For edges of a model, the axis points from the middle between both faces into the
            edge; the default for models.
        face: For edges of a model, the axis is perpendicular to one face at the edge.
        axis_only: Whether only the direction of the tool axis is required; rotation about the tool
            axis is free.
        cone: Largest angle by which the tool may lean from its required axis, whose rotation must
            be free; the tool point stays on the path. Alone for a file with tool axes.
    """

    axis: Direction | None = None
    follow_tangent: FollowModel | None = None
    bisector: Bisector | None = None
    face: FaceNormal | None = None
    axis_only: bool = False
    cone: ConeAngle = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RepeatModel:
    """Copies of a drawing in columns along its x axis and rows along its y axis.

    Args:
        columns: Number of copies along x.
        rows: Number of copies along y.
        column_spacing: Distance from one column to the next [m]; negative for the direction -x.
        row_spacing: Distance from one row to the next [m]; negative for the direction -y.
    """

    columns: Annotated[int, AtLeast(1)] = 1
    rows: Annotated[int, AtLeast(1)] = 1
    column_spacing: Length | None = None
    row_spacing: Length | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PathModel(ReadOptions):
    """One of `points`, `start` with `segments`, and `file`; other keys are options.

    Args:
        points: Corner points of a polyline, `[x, y]` or `[x, y, z]` each [m].
        start: Start point of the first segment [m].
        segments: A chain of lines and arcs.
        file: A drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode, .tap, .cnc), waypoints (.csv), or a
            CAD model (.step, .stp); the name is relative to the job file.
        frame: Position and rotation of the origin of the file, or of points and segments.
        contours: Values for single contours, by their name, as in `names`, or their number in the
            drawing, from 1. They have priority over those of the layer, and those of `process`.
        repeat: Copies of the drawing in columns and rows, after `scale` and before `frame`; their
            contours have names such as `hole [2,1]` (row, column).
        orientation: The required tool orientation in space (tilt, work angle, push or drag angle of
            a torch): one for the whole path, or one per waypoint; for a file, in the coordinates of
            the drawing.
    """

    points: list[Point] | None = None
    start: Point | None = None
    segments: list[SegmentModel] | None = None
    file: str | None = None
    frame: FrameModel | None = None
    contours: dict[
        int | str, Annotated[dict[str, Any], PartialFields(ContourProcess, null=True)]
    ] = field(default_factory=dict)
    repeat: RepeatModel | None = None
    orientation: OrientationModel | list[OrientationModel] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class StartModel:
    """A taught position from which the motion begins.

    Args:
        joints: Joint positions [rad], in the order of the joints or by their names; linear axes in
            m, without a unit.
    """

    joints: list[Angle] | dict[str, Angle]


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandLimitsModel:
    """Limits of the set-points; compensation moves set-points to the nearest ones within them.

    Args:
        joint_velocity: Largest first difference of set-points divided by the cycle [rad/s], one
            value, one per joint, or a lower and an upper bound per joint.
        joint_acceleration: Largest second difference of set-points divided by the cycle squared
            [rad/s²], in the same forms; by default the controller's limit, or an assumed one of 3
            times the joint_acceleration of `limits`. `inf` removes the assumed limit.
        joint_jerk: Largest third difference of set-points divided by the cycle cubed [rad/s³], one
            value or one per joint.
        joint_lower, joint_upper: Range of the set-points of each joint [rad].
    """

    joint_velocity: JointVelocities | None = None
    joint_acceleration: JointAccelerations | None = None
    joint_jerk: JointJerks | None = None
    joint_lower: JointRanges | None = None
    joint_upper: JointRanges | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedModel:
    """Keys of a job that a run can override.

    Args:
        limits: Limits that replace limits of the arm; `inf` removes a limit.
        command_limits: Limits of the set-points, as the controller checks them. The ranges and
            velocities in `limits` and the controller's limits apply, too: the smaller one counts.
        corners: Rounding of corners; `sharp`, the default, means no rounding.
        cycle: Time between set-points [s]; by default 4 ms.
        speed_factor: Fraction of the planned speed, for a first, slow run on the robot: contours,
            rapids and everything else along the same joint path; by default 100 %, but 10 % for
            `armcontour play`. Dwells keep their durations, and events their lead times.
    """

    limits: Annotated[dict[str, Any], PartialFields(Limits)] = field(default_factory=dict)
    command_limits: Annotated[dict[str, Any], PartialFields(CommandLimitsModel)] = field(
        default_factory=dict
    )
    corners: Rounding | Literal["sharp"] | None = None
    cycle: Interval | None = None
    speed_factor: SpeedFactor | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunModel(SharedModel):
    """A run; missing keys have the values of the job.

    Args:
        timing: Timing of the path.
        compensation: Compensation of the servo's delay; by default the inverse of the plant that
            judges the run.
        end_time: End of the time over which errors are evaluated [s]; by default the time at which
            all joints are at rest.
        duration: Duration of the motion [s]; by default the shortest possible duration.
    """

    timing: Timing = FASTEST
    compensation: Compensation | None = None
    end_time: Interval | None = None
    duration: Interval | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class JobModel(SharedModel):
    """A job file.

    Args:
        name: Short name, printable, of at most 80 characters.
        title: Title for reports, of at most 200 characters; the name by default.
        arm: A built-in arm (`armcontour arms` lists them), a .yaml or .urdf file relative
            to the job file, or a mapping.
        seed: Joint positions near the start configuration [rad], in the order of the joints or by
            their names; by default the configuration with the fastest motion along the path.
        start_from: A taught position. The motion begins there with a rapid in joint space, and the
            first contour has its configuration. By default the motion begins at the first contour.
        path: The objective path.
        process: Leads, overlaps and events that are added to contours.
        accuracy: Largest allowed distance of the tool from the drawing [m]. By default corner
            errors may reach their tolerances, and the contour error a tenth of the smallest one.
        servo: The nominal servo: a measured one by its name, such as `ur5e-servoj`, or a mapping.
            Required, unless all formats of `export` are programs such as kuka and abb.
        plant: Parameters of the real servo that differ from the nominal servo. The key
            `experiment`, not this key, adds a simulation of the rigid bodies.
        experiment: Additional simulation of runs on the rigid bodies of the arm.
        runs: The runs to compare, by name.
        certificate: Requirements for `armcontour certify`.
        scene: Obstacles in the cell, and minimum distances of the arm to them and to itself.
        export: Files for robot controllers that `armcontour run` writes.
    """

    name: str
    title: str | None = None
    arm: str | ArmModel
    seed: list[Angle] | dict[str, Angle] | None = None
    start_from: StartModel | None = None
    path: PathModel
    process: Process | None = None
    accuracy: Distance | None = None
    servo: Annotated[ServoModel | None, Key(hint=ServoKey)] = None
    plant: (
        Annotated[dict[str, Any], PartialFields(ServoModel, null=True, omit=IDENTIFIED)] | None
    ) = None
    experiment: Experiment | None = None
    runs: Annotated[dict[Annotated[str, Convert(_run_name)], RunModel], Items(1)]
    certificate: CertificateGoal | None = None
    scene: SceneModel | None = None
    export: Exports | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class CellModel(JobModel):
    """A job file that is combined with a drawing: name and path are optional."""

    name: str = ""
    path: PathModel = field(default_factory=PathModel)
