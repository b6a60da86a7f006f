"""Job files: YAML in, a `Job` out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from pydantic import ValidationError

from armcontour._files import read_text
from armcontour._progress import Progress
from armcontour._yaml import load
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput
from armcontour.io.job_arm import arm_of
from armcontour.io.job_model import (
    BoxModel,
    CertificateModel,
    CornersModel,
    ExperimentModel,
    JobModel,
    LimitsModel,
    PlantModel,
    PublishedModel,
    RunModel,
    ServoModelModel,
    given,
    given_limits,
)
from armcontour.io.job_path import path_of
from armcontour.io.job_process import with_process
from armcontour.io.problems import first_problem
from armcontour.io.units import parse
from armcontour.jobs import Experiment, Goal, Job, Published, Rounding, Run
from armcontour.robustness.monte_carlo import Box
from armcontour.servo import ServoModel

Changes = Callable[[dict[str, Any]], dict[str, Any]]
# Which method takes which option.
TIMING_OPTIONS = {"knots": "mac", "intervals": "optimal"}
COMPENSATION_OPTIONS = {"poles": "pole_placement"}
PUBLISHED_UNITS = {
    "contour_error_rms": "m",
    "contour_error_max": "m",
    "duration": "s",
    "settled": "s",
}


def read_job(
    file: str | FilePath, *, reading: Progress | None = None, trust_xacro: bool = False
) -> Job:
    """The job in a YAML file.

    Args:
        file: The file.
        reading: Called while the drawing that it names is read, as by `read_path`.
        trust_xacro: Whether its arm may be a .xacro file, which is a program; no job can say so.

    Raises:
        InvalidInput: No such file, not YAML, an unknown key, a value without its unit, or values
            that do not make a job; one sentence that names the key.
    """
    place = FilePath(file)
    return parse_job(
        job_text(place),
        source=place.name,
        folder=place.parent,
        reading=reading,
        trust_xacro=trust_xacro,
    )


def job_text(file: FilePath) -> str:
    """The text of a job file.

    Raises:
        InvalidInput: No such file, no regular file, too large, or not text.
    """
    return read_text(file, "job file")


def parse_job(
    text: str,
    *,
    source: str = "job",
    folder: FilePath | None = None,
    changes: Changes | None = None,
    reading: Progress | None = None,
    trust_xacro: bool = False,
) -> Job:
    """The job in YAML text.

    Args:
        text: The text.
        source: What to call it in errors.
        folder: Where relative files are looked for.
        changes: Applied to the data before it is looked at, such as what a command line overrides.
        reading: As in `read_job`.
        trust_xacro: As in `read_job`.

    Raises:
        InvalidInput: As in `read_job`.
    """
    data = load(text, source)
    if not isinstance(data, dict):
        raise InvalidInput(
            f"{source} must hold a mapping of keys such as name, arm, path and runs."
        )
    if changes is not None:
        data = changes(data)
    try:
        model = JobModel.model_validate(data)
    except ValidationError as error:
        raise InvalidInput(f"{source}: {first_problem(error, JobModel)}") from None
    try:
        return _job(model, folder or FilePath(), reading, trust_xacro)
    except InvalidInput as error:
        raise InvalidInput(f"{source}: {error}") from None


def json_schema() -> dict[str, Any]:
    """The JSON Schema of job files."""
    schema = JobModel.model_json_schema()
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _job(model: JobModel, folder: FilePath, reading: Progress | None, trust_xacro: bool) -> Job:
    arm = arm_of(model.arm, folder, trust_xacro=trust_xacro)
    path, process = with_process(
        path_of(model.path, folder, arm.dimension, reading), model.process, model.path
    )
    servo = _servo("servo", model.servo, arm)
    if model.experiment is not None:
        _refuse_unknown("experiment.runs", model.experiment.runs or [], model)
    runs = tuple(_run(name, run, model, arm) for name, run in model.runs.items())
    return Job(
        name=model.name,
        title=model.title or model.name,
        arm=arm,
        path=path,
        process=process,
        branch=model.branch,
        start=None if model.start is None else np.array(model.start),
        servo=servo,
        plant_servo=servo if model.plant is None else _plant(model.plant, model.servo, arm),
        runs=runs,
        published=None if model.published is None else _published(model.published, model),
        certificate=None if model.certificate is None else _goal(model.certificate, model),
        memory=model.memory,
    )


def _servo(key: str, model: ServoModelModel, arm: Arm) -> ServoModel:
    try:
        return ServoModel(
            kp=np.array(model.kp),
            kv=None if model.kv is None else np.array(model.kv),
            interpolation=model.interpolation,
            dead_time=np.array(model.dead_time),
            order=model.order,
        ).for_joints(arm.dof)
    except InvalidInput as error:
        raise InvalidInput(f"{key}: {error}") from None


def _plant(model: PlantModel, nominal: ServoModelModel, arm: Arm) -> ServoModel:
    """The real servo: the nominal one but for what the job says of it."""
    differs = given(model)
    if model.order == "first" and model.kv is None:
        differs["kv"] = None
    return _servo("plant", nominal.model_copy(update=differs), arm)


def _run(name: str, model: RunModel, job: JobModel, arm: Arm) -> Run:
    corners = job.corners if model.corners is None else model.corners
    limits = _limits("limits", job.limits, arm.limits, arm)
    limits = _limits(f"runs.{name}.limits", model.limits, limits, arm)
    if not isinstance(corners, str) and limits.centripetal_acceleration is None:
        # Case I names the same quantity for the corners' radius: it holds for their speed too.
        limits = limits.replace(centripetal_acceleration=corners.acceleration)
    if not isinstance(corners, str) and corners.tolerance is None:
        _refuse_no_speed(f"runs.{name}." if model.corners else "", corners, limits)
    options: dict[str, Any] = given(model.timing)
    method = options.pop("method")
    _refuse_options(f"runs.{name}", model)
    period = job.command_interval if model.command_interval is None else model.command_interval
    reserve = options.pop("reserve")
    if method == "mac":
        options["period"] = period
    return Run(
        name=name,
        timing=method,
        compensation=model.compensation.method,
        limits=limits,
        rounding=None if isinstance(corners, str) else Rounding(**given(corners)),
        period=period,
        timing_options=options,
        compensation_options=(
            {} if model.compensation.poles is None else {"poles": model.compensation.poles}
        ),
        until=model.until,
        reserve=reserve,
        ignore_jerk=job.ignore_jerk if model.ignore_jerk is None else model.ignore_jerk,
        experiment=_experiment(name, job.experiment),
    )


def _limits(key: str, model: LimitsModel, limits: Limits, arm: Arm) -> Limits:
    """Limits with some of them replaced or lifted, one value per joint."""
    try:
        return limits.replace(**given_limits(model)).for_joints(arm.dof)
    except InvalidInput as error:
        raise InvalidInput(f"{key}: {error}") from None


def _refuse_no_speed(where: str, corners: CornersModel, limits: Limits) -> None:
    """Refuse corners that nothing says the size of."""
    if corners.speed is None or limits.centripetal_acceleration is None:
        raise InvalidInput(
            f"{where}corners needs tolerance, the largest corner error, or speed and acceleration."
        )


def _refuse_options(key: str, model: RunModel) -> None:
    """Refuse options of another method than the chosen one."""
    for name, methods in (("timing", TIMING_OPTIONS), ("compensation", COMPENSATION_OPTIONS)):
        chosen = getattr(model, name)
        for option, method in methods.items():
            if getattr(chosen, option) is not None and chosen.method != method:
                raise InvalidInput(
                    f"{key}.{name}.{option} goes with the method {method}, not {chosen.method}."
                )


def _experiment(run: str, model: ExperimentModel | None) -> Experiment | None:
    """The experiment of a run, if it has one."""
    if model is None or (model.runs is not None and run not in model.runs):
        return None
    return Experiment(**model.model_dump(exclude={"runs"}))


def _published(model: PublishedModel, job: JobModel) -> Published:
    named = [*model.runs, *([model.time_stamps.run] if model.time_stamps else [])]
    _refuse_unknown("published", named, job)
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


def _goal(model: CertificateModel, job: JobModel) -> Goal:
    if model.run is not None:
        _refuse_unknown("certificate.run", [model.run], job)
    values = model.model_dump(exclude={"box"})
    try:
        return Goal(box=None if model.box is None else _box(model.box), **values)
    except InvalidInput as error:
        raise InvalidInput(f"certificate: {error}") from None


def _box(model: BoxModel) -> Box:
    return Box(
        gains=np.array(model.gains),
        dead_time=np.array(model.dead_time),
        dead_time_shared=model.shared,
        payload=model.payload,
        jitter=model.jitter,
    )


def _refuse_unknown(key: str, names: Sequence[str], job: JobModel) -> None:
    for name in names:
        if name not in job.runs:
            raise InvalidInput(f"{key} names the run {name}, which the job does not have.")
