"""Job files: YAML in, a `Job` out. The models below are the published schema."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from armcontour.arms import Arm, load_arm
from armcontour.errors import InvalidInput
from armcontour.geometry import Arc, Demand, Line, Path
from armcontour.io.units import (
    Acceleration,
    Angle,
    Duration,
    Gain,
    JointAcceleration,
    JointVelocity,
    Length,
    Speed,
    parse,
)
from armcontour.io.yaml_text import load
from armcontour.servo import ServoModel
from armcontour.study import Job, Published, Rounding, Run

Point = Annotated[list[Length], Field(min_length=2, max_length=3)]
RunName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$")]
PublishedName = Literal["contour_error_rms", "contour_error_max", "duration", "settled"]
PUBLISHED_UNITS = {
    "contour_error_rms": "m",
    "contour_error_max": "m",
    "duration": "s",
    "settled": "s",
}


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SegmentModel(_Model):
    """One segment: a line `to` a point, or an arc around a `center` by an `angle`."""

    to: Point | None = None
    center: Point | None = None
    angle: Angle | None = None
    normal: list[float] | None = None
    speed: Speed | None = None
    tolerance: Length | None = None
    tag: str | None = None


class PathModel(_Model):
    """Either the `points` of a polyline, or a `start` and `segments`."""

    points: list[Point] | None = None
    start: Point | None = None
    segments: list[SegmentModel] | None = None


class LimitsModel(_Model):
    """Limits; those of the joints are the arm's own unless given here."""

    speed: Speed | None = None
    tool_acceleration: Acceleration | None = None
    centripetal_acceleration: Acceleration | None = None
    joint_acceleration: JointAcceleration | list[JointAcceleration] | None = None
    joint_deceleration: JointAcceleration | list[JointAcceleration] | None = Field(
        default=None, description="in the negative direction, where it differs"
    )
    joint_velocity: JointVelocity | list[JointVelocity] | None = None


class CornersModel(_Model):
    """Case II: `tolerance`. Case I: `speed` and `acceleration`."""

    tolerance: Length | None = None
    speed: Speed | None = None
    acceleration: Acceleration | None = None


class ServoModelModel(_Model):
    """Gains of the joint servo, one for all joints or one per joint."""

    kp: Gain | list[Gain]
    kv: Gain | list[Gain]
    interpolation: Literal["linear", "step"] = "linear"


class TimingModel(_Model):
    """How the path is timed."""

    method: str = Field(default="optimal", description="optimal, mac or conventional")
    knots: int | None = Field(default=None, description="mac: laps per line")
    intervals: int | None = Field(default=None, description="optimal: intervals of the grid, about")


class CompensationModel(_Model):
    """How the servo's delay is compensated."""

    method: str = "pole_placement"
    poles: list[Gain] | list[list[Gain]] | None = Field(
        default=None, description="pole_placement: two regulator poles and the observer pole"
    )


class RunModel(_Model):
    """One way to do the job; what it does not say it takes from the job."""

    timing: TimingModel = TimingModel()
    compensation: CompensationModel = CompensationModel()
    limits: LimitsModel = LimitsModel()
    corners: CornersModel | Literal["sharp"] | None = None
    command_interval: Duration | None = None
    until: Duration | None = Field(default=None, description="end of the time that errors cover")


class TimeStampsModel(_Model):
    """Published times of a run's switching points."""

    run: str
    values: list[Duration]


class PublishedModel(_Model):
    """Published figures of the same job, to stand beside ours."""

    source: str
    runs: dict[str, dict[PublishedName, float | str]] = {}
    time_stamps: TimeStampsModel | None = None
    notes: list[str] = []


class JobModel(_Model):
    """A job file."""

    name: str
    title: str | None = None
    arm: str = Field(description="a built-in arm, or the path of a .yaml file")
    branch: str | None = None
    path: PathModel
    limits: LimitsModel = LimitsModel()
    corners: CornersModel | Literal["sharp"] = "sharp"
    servo: ServoModelModel
    plant: ServoModelModel | None = Field(
        default=None, description="the real servo, where it differs from the nominal one"
    )
    command_interval: Duration = 4e-3
    runs: dict[RunName, RunModel] = Field(min_length=1)
    published: PublishedModel | None = None


def read_job(file: str | FilePath) -> Job:
    """The job in a YAML file.

    Raises:
        InvalidInput: No such file, not YAML, an unknown key, a value without its unit, or values
            that do not make a job; one sentence that names the key.
    """
    place = FilePath(file)
    try:
        text = place.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise InvalidInput(f"Cannot read the job file {place}: {reason}.") from None
    return parse_job(text, source=place.name, folder=place.parent)


def parse_job(text: str, *, source: str = "job", folder: FilePath | None = None) -> Job:
    """The job in YAML text.

    Args:
        text: The text.
        source: What to call it in errors.
        folder: Where a relative arm file is looked for.

    Raises:
        InvalidInput: As in `read_job`.
    """
    data = load(text, source)
    if not isinstance(data, dict):
        raise InvalidInput(
            f"{source} must hold a mapping of keys such as name, arm, path and runs."
        )
    try:
        model = JobModel.model_validate(data)
    except ValidationError as error:
        raise InvalidInput(f"{source}: {first_problem(error)}") from None
    try:
        return _job(model, folder or FilePath())
    except InvalidInput as error:
        raise InvalidInput(f"{source}: {error}") from None


def json_schema() -> dict[str, Any]:
    """The JSON Schema of job files."""
    schema = JobModel.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def first_problem(error: ValidationError) -> str:
    """The first problem as a sentence, and how many more there are."""
    problems = error.errors()
    # Where a key may hold one of two things, the message of the one that came closest says most.
    first = max(
        problems, key=lambda x: (x["type"] == "value_error", x["type"] == "extra_forbidden")
    )
    key = ".".join(str(x) for x in first["loc"] if not _is_type_name(x)) or "the file"
    if first["type"] == "extra_forbidden":
        sentence = f"unknown key {key}: see `armcontour schema` for those that it takes."
    elif first["type"] == "missing":
        sentence = f"the key {key} is missing."
    else:
        sentence = f"{key}: {_lower(first['msg'].removeprefix('Value error, '))}."
    keys = {tuple(y for y in x["loc"] if not _is_type_name(y)) for x in problems}
    more = len(keys) - 1
    return sentence + (f" ({more} more problem{'s' if more > 1 else ''}.)" if more else "")


def _is_type_name(part: int | str) -> bool:
    """Whether a part of an error's place names a type and not a key."""
    return isinstance(part, str) and any(c in part for c in "[(") or str(part) in _TYPE_NAMES


_TYPE_NAMES = {"CornersModel", "function-before", "float", "str", "literal['sharp']"}


def _lower(message: str) -> str:
    return message[:1].lower() + message[1:]


def _job(model: JobModel, folder: FilePath) -> Job:
    arm = load_arm(str(folder / model.arm) if model.arm.endswith((".yaml", ".yml")) else model.arm)
    servo = _servo(model.servo, arm)
    runs = tuple(_run(name, run, model, arm) for name, run in model.runs.items())
    return Job(
        name=model.name,
        title=model.title or model.name,
        arm=arm,
        path=_path(model.path),
        branch=model.branch,
        servo=servo,
        plant_servo=servo if model.plant is None else _servo(model.plant, arm),
        runs=runs,
        published=None if model.published is None else _published(model.published, model),
    )


def _servo(model: ServoModelModel, arm: Arm) -> ServoModel:
    servo = ServoModel(
        kp=np.array(model.kp), kv=np.array(model.kv), interpolation=model.interpolation
    )
    return servo.for_joints(arm.dof)


def _run(name: str, model: RunModel, job: JobModel, arm: Arm) -> Run:
    corners = job.corners if model.corners is None else model.corners
    limits = arm.limits.replace(**_given(job.limits)).replace(**_given(model.limits))
    if not isinstance(corners, str) and limits.centripetal_acceleration is None:
        # Case I names the same quantity for the corners' radius: it holds for their speed too.
        limits = limits.replace(centripetal_acceleration=corners.acceleration)
    options: dict[str, Any] = _given(model.timing)
    method = options.pop("method")
    period = job.command_interval if model.command_interval is None else model.command_interval
    if method == "mac":
        options["period"] = period
    return Run(
        name=name,
        timing=method,
        compensation=model.compensation.method,
        limits=limits.for_joints(arm.dof),
        rounding=None if isinstance(corners, str) else Rounding(**_given(corners)),
        period=period,
        timing_options=options,
        compensation_options=(
            {} if model.compensation.poles is None else {"poles": model.compensation.poles}
        ),
        until=model.until,
    )


def _given(model: BaseModel) -> dict[str, Any]:
    return model.model_dump(exclude_none=True)


def _path(model: PathModel) -> Path:
    if model.points is not None and model.start is None and model.segments is None:
        if not model.points:
            raise InvalidInput("the points of path are empty: a path needs at least two.")
        if len({len(x) for x in model.points}) > 1:
            raise InvalidInput("the points of path must all have 2 or all have 3 coordinates.")
        return Path.polyline(np.array(model.points).reshape(len(model.points), -1))
    if model.points is not None or model.start is None or not model.segments:
        raise InvalidInput("path takes either points, or start and segments.")
    segments: list[Line | Arc] = []
    here = list(model.start)
    for i, x in enumerate(model.segments):
        demand = Demand(speed=x.speed, tolerance=x.tolerance, tag=x.tag)
        if x.to is not None and x.center is None and x.angle is None and x.normal is None:
            segments.append(Line(start=here, end=x.to, demand=demand))
        elif x.to is None and x.center is not None and x.angle is not None:
            segments.append(
                Arc(start=here, center=x.center, angle=x.angle, normal=x.normal, demand=demand)
            )
        else:
            raise InvalidInput(
                f"path.segments.{i} takes either to (a line), or center and angle (an arc)."
            )
        here = Path.from_segments(segments[-1:]).vertices[-1].tolist()
    return Path.from_segments(segments)


def _published(model: PublishedModel, job: JobModel) -> Published:
    named = [*model.runs, *([model.time_stamps.run] if model.time_stamps else [])]
    for name in named:
        if name not in job.runs:
            raise InvalidInput(f"published names the run {name}, which the job does not have.")
    try:
        runs: dict[str, dict[str, float]] = {
            name: {str(key): parse(value, PUBLISHED_UNITS[key]) for key, value in figures.items()}
            for name, figures in model.runs.items()
        }
    except ValueError as error:
        raise InvalidInput(f"published: a figure {error}.") from None
    return Published(
        source=model.source,
        runs=runs,
        time_stamps=tuple(model.time_stamps.values) if model.time_stamps else (),
        time_stamps_of=model.time_stamps.run if model.time_stamps else None,
        notes=tuple(model.notes),
    )
