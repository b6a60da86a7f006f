"""What a job file may say: the core's dataclasses, and what is written in another form."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from armcontour._memory import DEFAULT
from armcontour._quantities import (
    Angle,
    AtLeast,
    Choice,
    Distance,
    Duration,
    Interval,
    Length,
    Memory,
    Pole,
    Ratio,
    Time,
)
from armcontour.arms import Limits
from armcontour.arms.chain import Payload
from armcontour.compensation import compensator
from armcontour.geometry import Demand
from armcontour.io.drawings.reading import OFFSETS, UNKNOWN
from armcontour.io.forms import Place, Point
from armcontour.io.keys import Given, Number
from armcontour.io.units import parse
from armcontour.jobs import Experiment, Goal, Rounding
from armcontour.program import Process
from armcontour.servo import ServoModel
from armcontour.timing import planner

Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Direction = Annotated[list[Number], Field(min_length=3, max_length=3)]
Poles = Annotated[list[Pole], Field(min_length=3, max_length=3)]
RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]


def _joint_position(value: Any) -> Any:
    """The position of a joint as it is written, refused if it is neither an angle nor a length."""
    if isinstance(value, str):
        try:
            parse(value, "m")
            return value
        except ValueError:
            pass
    parse(value, "rad")
    return value


# Which of the two it must be is up to its joint.
JointPosition = Annotated[
    float | str,
    BeforeValidator(_joint_position),
    WithJsonSchema(
        {
            "description": "A number in rad (in m of a joint that slides), or text with a unit.",
            "anyOf": [{"type": "number"}, {"type": "string"}],
            "examples": ["10 deg", "20 mm"],
        }
    ),
]


@dataclass(frozen=True, slots=True, kw_only=True)
class RotationModel:
    """Either `rpy` or `quaternion`.

    Args:
        rpy: Roll, pitch and yaw about fixed x, y and z [rad].
        quaternion: As x, y, z, w.
    """

    rpy: Angles | None = None
    quaternion: Quaternion | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameModel(RotationModel):
    """A place and how it is turned; what is not given is zero.

    Args:
        position: The place [m].
    """

    position: Place | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ArmModel:
    """An arm by `name` or `file`, and how it is equipped. Files are looked for beside the job.

    Args:
        name: A built-in arm: `armcontour arms` lists them.
        file: A .urdf, .xacro or .yaml file; .xacro only if `--trust-xacro` allows it.
        tip: Link at the end; .urdf and .xacro only.
        base: Link that stands still; .urdf and .xacro only.
        joint_limits: A joint_limits.yaml of MoveIt; goes before what the arm's file says.
        tool: The tool in the frame of the tip.
        work: The frame of the path in the frame of the base.
        payload: What the tip carries.
        locked: Joints that are held still, and where; .urdf and .xacro only.
    """

    name: str | None = None
    file: str | None = None
    tip: str | None = None
    base: str | None = None
    joint_limits: str | None = None
    tool: FrameModel | None = None
    work: FrameModel | None = None
    payload: Payload | None = None
    locked: dict[str, JointPosition] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SegmentModel(Demand):
    """A line `to` a point, an arc `via` a point `to` another, or one around a `center`.

    Args:
        to: End of a line or an arc [m].
        via: A point on an arc [m].
        center: Centre of an arc [m].
        angle: Angle of that arc, counter-clockwise positive; a full circle has 360 deg [rad].
        normal: Axis of that arc, in space.
    """

    to: Point | None = None
    via: Point | None = None
    center: Point | None = None
    angle: Angle | None = None
    normal: list[float] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SplineModel:
    """A cubic spline through `points`, run as arcs within `tolerance` of it.

    Args:
        points: What it leads through [m].
        closed: Whether it is closed: the last point repeats the first.
        tolerance: Largest distance of the arcs from it [m].
    """

    points: list[Point]
    closed: bool = False
    tolerance: Distance = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class FollowModel(RotationModel):
    """The tool at a fixed angle to the tangent: x of the path's frame is the tangent, z is `up`.

    `rpy` or `quaternion` hold the tool in that frame; by default its axis points against `up`.

    Args:
        up: Direction of z.
    """

    up: Direction


@dataclass(frozen=True, slots=True, kw_only=True)
class OrientationModel(RotationModel):
    """How the tool is held: one of `rpy`, `quaternion`, `axis` and `follow_tangent`.

    Args:
        axis: Direction of the tool axis; turning about it is free.
        follow_tangent: A fixed angle to the tangent.
        axis_only: Whether only the tool axis counts; turning about it is free.
    """

    axis: Direction | None = None
    follow_tangent: FollowModel | None = None
    axis_only: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SkipModel:
    """Words of G-code to leave out.

    Args:
        skip: Codes and letters of G-code, such as M6 or T.
    """

    skip: list[str]


@dataclass(frozen=True, slots=True, kw_only=True)
class PathModel:
    """One of `points`, `start` and `segments`, `spline`, and `file`; the rest says how to read it.

    Args:
        points: Corner points of a polyline, `[x, y]` or `[x, y, z]` each [m].
        start: Where the first segment starts [m].
        segments: A chain of lines and arcs.
        spline: A cubic spline.
        file: A drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode, .tap, .cnc), or waypoints (.csv,
            .parquet), beside the job.
        units: Unit of the file's lengths, such as mm, where it gives none; of a drawing also in
            the place of what it gives.
        scale: Factor of its lengths.
        frame: Where its origin lies, and how it is turned.
        layers: Only contours on these; or a mapping to what contours on them are run with where
            their segments have nothing of their own, of which a drawing need not have all.
        names: Only contours with these names: the report lists them.
        flat: Whether to leave z out, and with it how the file has the tool held.
        chord_tolerance: Largest distance between a curve and the arcs that it becomes [m].
        join_tolerance: Ends nearer than this are one point [m].
        unknown: Whether to refuse what the reader does not know, or to skip it with a note; for
            G-code, `{skip: [T, M6]}` leaves out these words.
        offsets: For G-code, `file` reads only offsets that the file gives; `zero` states that all
            offsets in the table of the controller are zero.
        orientation: How the tool is held in space: once for the whole path, or one per waypoint;
            of a file, in the coordinates of the drawing.
    """

    points: list[Point] | None = None
    start: Point | None = None
    segments: list[SegmentModel] | None = None
    spline: SplineModel | None = None
    file: str | None = None
    units: str | None = None
    scale: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)] = 1.0
    frame: FrameModel | None = None
    layers: list[str] | dict[str, Demand] | None = None
    names: list[str] | None = None
    flat: bool = False
    chord_tolerance: Distance = 1e-5
    join_tolerance: Distance = 1e-5
    unknown: Annotated[str, Choice(UNKNOWN)] | SkipModel = "refuse"
    offsets: Annotated[str, Choice(OFFSETS)] = "file"
    orientation: OrientationModel | list[OrientationModel] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ExperimentModel(Experiment):
    """Runs executed on the arm's rigid bodies too, with default drive gains.

    Args:
        runs: Names of runs; all by default.
    """

    runs: list[str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TimingModel:
    """How the path is timed.

    Args:
        method: The fastest timing, the paper's, or uniform speed.
        knots: Laps per line, of the method mac.
        intervals: Intervals of the grid, about, of the method optimal.
        reserve: Share of the limits of joint acceleration and torque that the plan leaves to the
            servo. Without one a servo that has fallen back cannot catch up.
    """

    method: Annotated[str, Choice(planner.METHODS)] = "optimal"
    knots: Annotated[int, AtLeast(8)] | None = None
    intervals: Annotated[int, AtLeast(2)] | None = None
    reserve: Ratio = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class CompensationModel:
    """How the servo's delay is compensated.

    Args:
        method: The servo's exact inverse, or pole placement, for a servo of order second only.
        poles: Two regulator poles and the observer pole of pole_placement [1/s], or one such triple
            per joint.
    """

    method: Annotated[str, Choice(compensator.METHODS)] = "pole_placement"
    poles: Poles | list[Poles] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RunModel:
    """A run; what it does not say it takes from the job.

    Args:
        timing: How the path is timed.
        compensation: How the servo's delay is compensated.
        limits, corners, command_interval, ignore_jerk: As of the job, for this run only.
        until: End of the time that errors cover [s]; by default when the tool has come to rest.
    """

    timing: TimingModel = TimingModel()
    compensation: CompensationModel = CompensationModel()
    limits: Annotated[dict[str, Any], Given(Limits)] = field(default_factory=dict)
    corners: Rounding | Literal["sharp"] | None = None
    command_interval: Interval | None = None
    ignore_jerk: bool | None = None
    until: Interval | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeStampsModel:
    """Published times of a run's switching points.

    Args:
        run: Name of the run.
        values: The times [s].
    """

    run: str
    values: list[Duration]


@dataclass(frozen=True, slots=True, kw_only=True)
class FiguresModel:
    """Published figures of a run.

    Args:
        contour_error_rms: Root mean square of the contour error [m].
        contour_error_max: Largest contour error [m].
        duration: Duration of the motion [s].
        settled: Time until the tool rests [s].
    """

    contour_error_rms: Length
    contour_error_max: Length
    duration: Time
    settled: Time


@dataclass(frozen=True, slots=True, kw_only=True)
class PublishedModel:
    """Published figures of the same job, to stand beside ours.

    Args:
        source: Where they stand.
        runs: Figures by the names of the job's runs.
        time_stamps: Published times of switching points.
        notes: Sentences on what to make of the differences.
    """

    source: str
    runs: dict[str, Annotated[dict[str, Any], Given(FiguresModel)]] = field(default_factory=dict)
    time_stamps: TimeStampsModel | None = None
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True, kw_only=True)
class JobModel:
    """A job file.

    Args:
        name: Short name, printable, of at most 80 characters.
        title: For people, of at most 200 characters; the name by default.
        arm: A built-in arm (`armcontour arms` lists them), a .yaml, .urdf or .xacro file beside the
            job, or a mapping.
        branch: Branch of the inverse kinematics of an arm in the plane: `positive` (default) or
            `negative`, the sign of theta2.
        start: Joint positions near to those to start in [rad], of an arm in space; by default the
            configuration that is fastest along the path.
        path: The objective path.
        process: What is added to contours: leads, overlaps, events.
        limits: Limits; those of the joints are the arm's own unless given here, and null lifts one.
        ignore_jerk: Whether to plan in spite of limits of jerk, which no method keeps yet.
        corners: How corners are rounded; `sharp` leaves them as they are.
        servo: The nominal servo.
        plant: The real servo, where it differs from the nominal one.
        experiment: Runs that are executed on the arm's rigid bodies too.
        command_interval: Time between set-points [s].
        runs: The runs to compare, by name.
        published: Published figures of the same job.
        certificate: What `armcontour certify` and `armcontour sweep` hold.
        memory: What the program may take for the job [bytes].
    """

    name: str
    title: str | None = None
    arm: str | ArmModel
    branch: str | None = None
    start: list[Angle] | None = None
    path: PathModel
    process: Process | None = None
    limits: Annotated[dict[str, Any], Given(Limits)] = field(default_factory=dict)
    ignore_jerk: bool = False
    corners: Rounding | Literal["sharp"] = "sharp"
    servo: ServoModel
    plant: Annotated[dict[str, Any], Given(ServoModel, null=True)] | None = None
    experiment: ExperimentModel | None = None
    command_interval: Interval = 4e-3
    runs: Annotated[dict[RunName, RunModel], Field(min_length=1)]
    published: PublishedModel | None = None
    certificate: Goal | None = None
    memory: Memory = DEFAULT


@dataclass(frozen=True, slots=True, kw_only=True)
class CellModel(JobModel):
    """A job file into which a drawing is put: its name and its path may be left out."""

    name: str = ""
    path: PathModel = field(default_factory=PathModel)
