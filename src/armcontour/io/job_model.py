"""What a job file may say: these models are the published schema."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictBool, StrictInt

from armcontour._memory import DEFAULT
from armcontour.io.units import (
    Acceleration,
    Angle,
    AngularAcceleration,
    AngularDistance,
    AngularSpeed,
    Distance,
    Duration,
    Gain,
    Inertia,
    Interval,
    JointAcceleration,
    JointJerk,
    JointPosition,
    JointVelocity,
    Length,
    Mass,
    Memory,
    Pole,
    Ratio,
    Speed,
    Torque,
    quantity,
)

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Point = Annotated[list[Length], Field(min_length=2, max_length=3)]
Place = Annotated[list[Length], Field(min_length=3, max_length=3)]
Angles = Annotated[list[Angle], Field(min_length=3, max_length=3)]
Quaternion = Annotated[list[Number], Field(min_length=4, max_length=4)]
Direction = Annotated[list[Number], Field(min_length=3, max_length=3)]
Triple = Annotated[list[Pole], Field(min_length=3, max_length=3)]
RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
PublishedName = Literal["contour_error_rms", "contour_error_max", "duration", "settled"]


class Model(BaseModel):
    """What all parts of a file share: no unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class RotationModel(Model):
    """Either `rpy` or `quaternion`."""

    rpy: Angles | None = Field(
        default=None, description="roll, pitch and yaw about fixed x, y and z"
    )
    quaternion: Quaternion | None = Field(default=None, description="x, y, z, w")


class FrameModel(RotationModel):
    """A place and how it is turned; what is not given is zero."""

    position: Place | None = None


class PayloadModel(Model):
    """What the tip carries, in the frame of the tip."""

    mass: Mass
    center: Place | None = Field(default=None, description="centre of mass")
    inertia: Annotated[list[Inertia], Field(min_length=6, max_length=6)] | None = Field(
        default=None, description="xx, xy, xz, yy, yz, zz about the centre of mass; else a point"
    )


class ArmModel(Model):
    """An arm by `name` or `file`, and how it is equipped. Files are looked for beside the job."""

    name: str | None = Field(default=None, description="a built-in arm")
    file: str | None = Field(default=None, description="a .urdf, .xacro or .yaml file")
    tip: str | None = Field(default=None, description="link at the end; .urdf and .xacro only")
    base: str | None = Field(
        default=None, description="link that stands still; .urdf and .xacro only"
    )
    joint_limits: str | None = Field(default=None, description="a joint_limits.yaml of MoveIt")
    tool: FrameModel | None = Field(default=None, description="the tool in the frame of the tip")
    work: FrameModel | None = Field(
        default=None, description="the frame of the path in the frame of the base"
    )
    payload: PayloadModel | None = None
    locked: dict[str, JointPosition] | None = Field(
        default=None, description="joints that are held still, and where; .urdf and .xacro only"
    )


class SegmentModel(Model):
    """A line `to` a point, an arc `via` a point `to` another, or one around a `center`."""

    to: Point | None = None
    via: Point | None = None
    center: Point | None = None
    angle: Angle | None = None
    normal: list[Number] | None = None
    speed: Speed | None = None
    tolerance: Distance | None = None
    tag: str | None = None


class SplineModel(Model):
    """A cubic spline through `points`, run as arcs within `tolerance` of it."""

    points: list[Point]
    closed: StrictBool = Field(default=False, description="the last point repeats the first")
    tolerance: Distance = 1e-6


class FollowModel(RotationModel):
    """The tool at a fixed angle to the tangent: x of the path's frame is the tangent, z is `up`.

    `rpy` or `quaternion` hold the tool in that frame; by default its axis points against `up`.
    """

    up: Direction


class OrientationModel(RotationModel):
    """How the tool is held: one of `rpy`, `quaternion`, `axis` and `follow_tangent`."""

    axis: Direction | None = Field(
        default=None, description="direction of the tool axis; turning about it is free"
    )
    follow_tangent: FollowModel | None = None
    axis_only: StrictBool = Field(
        default=False, description="only the tool axis counts; turning about it is free"
    )


class LayerModel(Model):
    """What contours on a layer are run with, where the drawing itself says nothing."""

    speed: Speed | None = Field(default=None, description="assigned velocity")
    tolerance: Distance | None = Field(default=None, description="largest corner error")


class SkipModel(Model):
    """Words of G-code to leave out."""

    skip: list[str] = Field(description="codes and letters of G-code, such as M6 or T")


class PathModel(Model):
    """One of `points` of a polyline, `start` and `segments`, `spline`, and a `file`.

    What stands after `file` here says how that is read.
    """

    points: list[Point] | None = None
    start: Point | None = None
    segments: list[SegmentModel] | None = None
    spline: SplineModel | None = None
    file: str | None = Field(
        default=None,
        description="a drawing (.dxf, .svg), G-code (.ngc, ...), or waypoints (.csv, "
        ".parquet); it is looked for beside the job",
    )
    units: str | None = Field(
        default=None, description="unit of the file's lengths, such as mm, where it does not say"
    )
    scale: Annotated[float, Field(strict=True, gt=0, allow_inf_nan=False)] = 1.0
    frame: FrameModel | None = Field(default=None, description="where the drawing lies")
    layers: list[str] | dict[str, LayerModel] | None = Field(
        default=None, description="only contours on these; or what those on them are run with"
    )
    names: list[str] | None = Field(default=None, description="only contours with these names")
    flat: StrictBool = Field(default=False, description="leave z out")
    chord_tolerance: Distance = Field(
        default=1e-5, description="largest distance between a curve and the arcs it becomes"
    )
    join_tolerance: Distance = Field(
        default=1e-5, description="ends nearer than this are one point"
    )
    unknown: Literal["refuse", "skip"] | SkipModel = Field(
        default="refuse", description="what the reader does not know; of G-code, words to leave out"
    )
    offsets: Literal["file", "zero"] = Field(
        default="file",
        description="offsets of G-code that are in the table of the controller: only those that "
        "the file gives, or all zero",
    )
    orientation: OrientationModel | list[OrientationModel] | None = Field(
        default=None,
        description="in space: once for the whole path, or one per waypoint; of a file, in the "
        "coordinates of the drawing",
    )


class LeadModel(Model):
    """A piece of path along which the tool is off."""

    length: Annotated[Literal["auto"] | Distance, Field(union_mode="left_to_right")] = Field(
        default="auto", description="as long as the arm needs for the assigned velocity"
    )
    shape: Literal["line", "arc"] = "line"
    side: Literal["left", "right", "waste"] = Field(
        default="waste",
        description="of an arc: inside of holes and outside of outlines, or seen along the contour",
    )


class SwitchModel(Model):
    """Events that turn the process on where a contour begins, and off where it ends."""

    name: str = "tool"
    on_lead: Duration = Field(default=0.0, description="on so much earlier")
    off_lead: Duration = Field(default=0.0, description="off so much earlier")


class EventModel(Model):
    """Something that is switched at a place of every contour."""

    name: Annotated[str, Field(min_length=1)]
    value: StrictBool | Number | str = True
    at: Distance = 0.0
    lead_time: Annotated[float, *quantity("s", "20 ms")] = 0.0
    lead_distance: Length = 0.0


class ProcessModel(Model):
    """What is added to contours."""

    begin: Annotated[
        Literal["auto", "drawn"] | Distance | Point, Field(union_mode="left_to_right")
    ] = Field(
        default="auto",
        description="where closed contours begin: off a corner, as drawn, at an arc length, or at "
        "the place nearest to a point",
    )
    overlap: Distance = Field(default=0.0, description="of closed contours")
    lead_in: LeadModel | None = None
    lead_out: LeadModel | None = None
    approach: Distance = Field(default=0.0, description="straight down from so high")
    retract: Distance = Field(default=0.0, description="straight up so high")
    dwell: Duration = Field(default=0.0, description="standing still before every contour")
    switch: SwitchModel | None = None
    off_between: list[str] = Field(
        default=[], description="what is on over rapids of the file and shall not be, as a laser"
    )
    events: list[EventModel] = []
    order: Literal["drawn", "nearest"] = "drawn"
    from_s: Distance = Field(
        default=0.0, description="where to resume: arc length of all contours together"
    )


class LimitsModel(Model):
    """Limits; those of the joints are the arm's own unless given here, and null lifts one."""

    speed: Speed | None = None
    tool_acceleration: Acceleration | None = None
    centripetal_acceleration: Acceleration | None = None
    angular_speed: AngularSpeed | None = None
    angular_acceleration: AngularAcceleration | None = None
    joint_acceleration: JointAcceleration | list[JointAcceleration] | None = None
    joint_deceleration: JointAcceleration | list[JointAcceleration] | None = Field(
        default=None, description="in the negative direction, where it differs"
    )
    joint_velocity: JointVelocity | list[JointVelocity] | None = None
    joint_torque: Torque | list[Torque] | None = None
    joint_jerk: JointJerk | list[JointJerk] | None = None
    joint_lower: Angle | list[Angle] | None = None
    joint_upper: Angle | list[Angle] | None = None


class CornersModel(Model):
    """Case II: `tolerance`. Case I: `speed` and `acceleration`."""

    tolerance: Distance | None = None
    speed: Speed | None = None
    acceleration: Acceleration | None = None
    angular_tolerance: AngularDistance | None = Field(
        default=None, description="largest angle by which the tool's orientation may be off"
    )


class ServoModelModel(Model):
    """The joint servo; gains and dead time are one for all joints or one per joint."""

    kp: Gain | list[Gain]
    kv: Gain | list[Gain] | None = Field(default=None, description="for the order second only")
    order: Literal["second", "first"] = "second"
    dead_time: Duration | list[Duration] = 0.0
    interpolation: Literal["linear", "step", "cubic"] = "linear"


class PlantModel(Model):
    """The real servo, where it differs from the nominal one; the rest is as in `servo`."""

    kp: Gain | list[Gain] | None = None
    kv: Gain | list[Gain] | None = None
    order: Literal["second", "first"] | None = None
    dead_time: Duration | list[Duration] | None = None
    interpolation: Literal["linear", "step", "cubic"] | None = None


class ExperimentModel(Model):
    """Runs executed on the arm's rigid bodies too, by drives that nobody tuned to the job."""

    step: Interval = Field(default=2.5e-4, description="cycle of the drives")
    gravity_feedforward: StrictBool = True
    friction: StrictBool = True
    noise: AngularDistance = Field(
        default=0.0, description="standard deviation of measured positions"
    )
    seed: Annotated[StrictInt, Field(ge=0)] = 0
    runs: list[str] | None = Field(default=None, description="names of runs; all by default")


class TimingModel(Model):
    """How the path is timed."""

    method: Literal["optimal", "mac", "conventional"] = "optimal"
    knots: Annotated[StrictInt, Field(ge=8)] | None = Field(
        default=None, description="mac: laps per line"
    )
    intervals: Annotated[StrictInt, Field(ge=2)] | None = Field(
        default=None, description="optimal: intervals of the grid, about"
    )
    reserve: Ratio = Field(
        default=0.0, description="share of joint acceleration and torque left to the servo"
    )


class CompensationModel(Model):
    """How the servo's delay is compensated."""

    method: Literal["inverse", "pole_placement", "none"] = Field(
        default="pole_placement", description="for a servo of the order first: inverse or none"
    )
    poles: Triple | list[Triple] | None = Field(
        default=None,
        description="pole_placement: two regulator poles and the observer pole, or one such "
        "triple per joint",
    )


class RunModel(Model):
    """One way to do the job; what it does not say it takes from the job."""

    timing: TimingModel = TimingModel()
    compensation: CompensationModel = CompensationModel()
    limits: LimitsModel = LimitsModel()
    corners: CornersModel | Literal["sharp"] | None = None
    command_interval: Interval | None = None
    ignore_jerk: StrictBool | None = None
    until: Interval | None = Field(default=None, description="end of the time that errors cover")


class TimeStampsModel(Model):
    """Published times of a run's switching points."""

    run: str
    values: list[Duration]


class PublishedModel(Model):
    """Published figures of the same job, to stand beside ours."""

    source: str
    runs: dict[str, dict[PublishedName, float | str]] = {}
    time_stamps: TimeStampsModel | None = None
    notes: list[str] = []


class BoxModel(Model):
    """How far the real robot may be from its model, in plus and minus."""

    gains: Ratio | list[Ratio] | list[list[Ratio]] = Field(
        default=0.0, description="of servo gains; one, one per joint, or two rows for kp and kv"
    )
    dead_time: Duration | list[Duration] = 0.0
    shared: StrictBool = Field(
        default=True, description="all joints' dead times err together, and not each by itself"
    )
    payload: Mass = 0.0
    jitter: Duration = Field(default=0.0, description="of the time at which a set-point arrives")


class CertificateModel(Model):
    """What `armcontour certify` is to hold: `tolerance`, `servo` or both."""

    tolerance: Length | None = Field(
        default=None, description="largest distance of the tool from the objective path"
    )
    servo: Length | None = Field(
        default=None, description="largest contour error that servo and command interval may make"
    )
    rms: Length | None = Field(default=None, description="largest root mean square of that error")
    saturation: Literal["refuse", "report"] = "refuse"
    box: BoxModel | None = None
    samples: StrictInt = Field(default=10_000, description="robots drawn from the box")
    seed: StrictInt = 0
    run: str | None = Field(
        default=None, description="the run to certify; by default the only optimal one"
    )
    slowest: Number = Field(
        default=2.0, description="as a ratio to the uncertified optimum; slower plans are refused"
    )


class JobModel(Model):
    """A job file."""

    name: str
    title: str | None = None
    arm: str | ArmModel = Field(
        description="a built-in arm, or a .yaml, .urdf or .xacro file; or a mapping"
    )
    branch: str | None = Field(default=None, description="of an arm in the plane")
    start: list[Angle] | None = Field(
        default=None, description="joint positions near to those to start in, of an arm in space"
    )
    path: PathModel
    process: ProcessModel | None = Field(
        default=None, description="what is added to contours: leads, overlaps, events"
    )
    limits: LimitsModel = LimitsModel()
    ignore_jerk: StrictBool = Field(default=False, description="plan in spite of limits of jerk")
    corners: CornersModel | Literal["sharp"] = "sharp"
    servo: ServoModelModel
    plant: PlantModel | None = None
    experiment: ExperimentModel | None = None
    command_interval: Interval = 4e-3
    runs: dict[RunName, RunModel] = Field(min_length=1)
    published: PublishedModel | None = None
    certificate: CertificateModel | None = None
    memory: Memory = Field(default=DEFAULT, description="what the program may take for the job")


def given(model: BaseModel) -> dict[str, Any]:
    """What a model says, without what it leaves out; null says nothing."""
    return model.model_dump(exclude_none=True)


def given_limits(model: LimitsModel) -> dict[str, Any]:
    """The limits that a model gives, None where it lifts one."""
    return model.model_dump(exclude_unset=True)
