"""Readers of job files (YAML), and of drawings in a cell, which make a `Job`."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import LONGEST_NAME, FloatArray
from armcontour.core.errors import (
    ArmContourError,
    ArmMismatch,
    InvalidInput,
    error_context,
    key_context,
)
from armcontour.core.fields import checked
from armcontour.core.file_access import read_text
from armcontour.core.progress import Progress
from armcontour.core.quantities import PartialFields
from armcontour.core.source_file import SourceFile
from armcontour.core.text import Keys, key_text, make_printable, shorten, show
from armcontour.core.yaml_loader import load
from armcontour.files.drawings.path_reader import YAML
from armcontour.files.file_keys import Patch, read_keys
from armcontour.files.job_arm import arm_of
from armcontour.files.job_model import CellModel, JobModel, PathModel
from armcontour.files.job_patch import apply_patch, write_patch
from armcontour.files.job_path import OF_FACES, is_model, part_of, parts_of, path_of, read_drawing
from armcontour.files.job_process import add_process
from armcontour.files.job_run import run_of
from armcontour.files.job_text_edits import REMOVE, line_of, move_files
from armcontour.files.model.edge_rules import MODELS
from armcontour.files.scene_file import SceneModel, scene_of
from armcontour.files.sources import recording_sources
from armcontour.geometry import Path
from armcontour.jobs import Exports, Job
from armcontour.jobs.job import LONGEST_TITLE, required_servo
from armcontour.program import Program
from armcontour.robot import Arm, PlanarTwoLink
from armcontour.robot.scene import Scene
from armcontour.robot.servo import ServoModel
from armcontour.verification.clearance.body_pairs import can_measure

# Keys of `path` that define the geometry of a job. A drawing replaces them.
GEOMETRY_KEYS = ("points", "start", "segments")
SCHEMA = FilePath(__file__).with_name("job.schema.json")
# Folder of the built-in cells.
CELLS = FilePath(__file__).with_name("cells")


def job_text(file: FilePath) -> str:
    """Read the text of a job file."""
    return read_text(file, "job file")


@checked
def parse_job(
    text: str,
    *,
    source: str = "job",
    folder: FilePath | None = None,
    patch: Patch | None = None,
    reading: Progress | None = None,
) -> Job:
    """Read a job from YAML text.

    Args:
        text: The text.
        source: Name of the text in messages.
        folder: Folder against which relative file names are resolved.
        patch: As in `read_job`.
        reading: As in `read_job`.

    Raises:
        InvalidInput: As in `read_job`.
    """
    data = read_job_mapping(text, source)
    origin = SourceFile.from_text(source, text)
    with file_context(text, source, patch), recording_sources(origin, patch) as with_sources:
        model: JobModel = read_keys(JobModel, apply_patch(data, patch or {}))
        return with_sources(job_of(model, folder or FilePath(), reading))


@contextmanager
def file_context(text: str, source: str, patch: Patch | None = None) -> Iterator[None]:
    """Context that adds the name of a file, and the line of the wrong key, to the message.

    Args:
        text: Text of the file.
        source: Name of the file.
        patch: Patch of the file, whose keys have no line.
    """
    try:
        with error_context(source):
            yield
    except ArmContourError as error:
        line = line_of(text, error.key) if error.key and error.key not in (patch or ()) else None
        if line is not None:
            sentence = str(error)
            stop = sentence[-1] if sentence[-1:] == "." else ""
            error.args = (f"{sentence.removesuffix('.')} (line {line}){stop}",)
        raise


def read_job_mapping(text: str, source: str) -> dict[str, Any]:
    """Read the text of a job file as a mapping, whose keys are not checked."""
    data = load(text, source)
    if not isinstance(data, dict):
        raise InvalidInput(f"{source} must be a mapping of keys such as name, arm, path and runs.")
    return data


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of job files as a dictionary."""
    schema: dict[str, Any] = json.loads(SCHEMA.read_text(encoding="utf-8"))
    return schema


def job_of(
    model: JobModel,
    folder: FilePath,
    reading: Progress | None,
    drawing: Program | None = None,
) -> Job:
    """Make a job from its model; reads the files of its arm, drawing and scene.

    Args:
        model: Keys of the job.
        folder: Folder against which relative file names are resolved.
        reading: Called with the progress of reading the drawing.
        drawing: Program of the drawing, if it is already read.

    Raises:
        InvalidInput: As in `read_job`; the error has the key path of the wrong value.
    """
    if model.export is not None:
        # Templates are relative to the job file.
        formats = [str(folder / x) if x.endswith(".j2") else x for x in model.export.formats]
        model = dataclasses.replace(
            model, export=dataclasses.replace(model.export, formats=formats)
        )
    part = part_of(model.path)
    with error_context("", "arm"):
        arm = arm_of(model.arm, folder, part)
    with error_context("", "path"):
        path = path_of(model.path, folder, arm.dimension, reading, drawing)
    with error_context("", "scene"):
        scene = job_scene(model, folder, arm)
    return assemble_job(model, arm, path, scene)


def job_scene(model: JobModel, folder: FilePath, arm: Arm) -> Scene | None:
    """Return the scene of a job: its obstacles, and the parts of a CAD model.

    Without the key `scene`, the parts are a scene if distances to the arm can be computed.

    Args:
        model: Keys of the job.
        folder: Folder against which relative file names are resolved.
        arm: Arm of the job.

    Raises:
        InvalidInput: An obstacle is wrong, or its file cannot be read.
    """
    keys = model.scene
    if keys is None:
        if not (is_model(model.path) and arm.knows_shapes and can_measure()):
            return None
        keys = SceneModel()
    parts = parts_of(model.path, folder, keys.model)
    return scene_of(keys, folder, part_of(model.path), parts)


def _joint_positions(positions: list[float] | dict[str, float], arm: Arm, *keys: str) -> FloatArray:
    """Return positions of a key in the order of the arm's joints [rad], (dof,).

    - `positions`: a list, or positions by the names of the joints.
    - `keys`: path of the key.
    """
    key = key_text(keys)
    if isinstance(positions, list):
        with error_context("", *keys):
            return checks.per_joint(key, positions, arm.dof, "rad")
    if set(positions) != set(arm.joint_names):
        raise ArmMismatch(
            f"{key} names the joints {', '.join(map(show, positions))}, but the joints of "
            f"{arm.name} are {', '.join(arm.joint_names)}. Name each of these joints once, or "
            "write a list.",
            key=keys,
        )
    return np.array([positions[x] for x in arm.joint_names])


def assemble_job(model: JobModel, arm: Arm, drawn: Path | Program, scene: Scene | None) -> Job:
    """Make a job from its model and the parts that may need other files.

    Args:
        model: Keys of the job.
        arm: Arm.
        drawn: Path or program in the coordinates of the part frame, without the process.
        scene: Scene; None if obstacles are unknown.

    Raises:
        InvalidInput: A value is wrong. The error has its key path.
    """
    path, process = add_process(drawn, model.process, model.path)
    export = model.export or Exports()
    nominal = required_servo(model.servo, export)
    servo = _servo("servo", nominal, arm)
    if model.certificate is not None and model.certificate.run is not None:
        _check_run_name(("certificate", "run"), model.certificate.run, model)
    seed = None if model.seed is None else _joint_positions(model.seed, arm, "seed")
    start = None
    if model.start_from is not None:
        start = _joint_positions(model.start_from.joints, arm, "start_from", "joints")
    configuration = None
    if seed is not None and isinstance(arm, PlanarTwoLink):
        configuration = arm.configuration_of(seed)
        seed = None
    return Job(
        name=model.name,
        title=model.title or model.name,
        arm=arm,
        path=path,
        process=process,
        configuration=configuration,
        seed=seed,
        start_from=start,
        servo=servo,
        plant_servo=servo if model.plant is None else _plant(model.plant, nominal, arm),
        runs=tuple(run_of(name, run, model, arm) for name, run in model.runs.items()),
        certificate=model.certificate,
        scene=scene,
        export=export,
        part=part_of(model.path),
    )


def _servo(key: str, servo: ServoModel, arm: Arm, **changes: Any) -> ServoModel:
    """Return a servo model with changed parameters, and with one value per joint.

    - `key`: key of the job, for messages.
    - `changes`: new values of parameters, by name.
    """
    with key_context(key):
        return dataclasses.replace(servo, **changes).for_joints(arm.dof)


def _plant(parameters: dict[str, Any], nominal: ServoModel, arm: Arm) -> ServoModel:
    """Return the plant's servo: the nominal servo with the values of `plant` that are not null."""
    changes = {key: value for key, value in parameters.items() if value is not None}
    # The values of the user are assumed.
    changes["source"] = ""
    if changes.get("order") == "first":
        # A first-order servo has no gain kv, which the nominal servo may have.
        changes.setdefault("kv", None)
    return _servo("plant", nominal, arm, **changes)


def _check_run_name(keys: Keys, name: str, job: JobModel) -> None:
    """Check that the job has the named run."""
    if name not in job.runs:
        raise InvalidInput(
            f"{key_text(keys)} names the run {name}, but the runs of the job are "
            f"{', '.join(job.runs)}.",
            key=keys,
        )


def cell_names() -> tuple[str, ...]:
    """Return the names of the built-in cells."""
    return tuple(sorted(x.stem for x in CELLS.glob("*.yaml")))


def cell_text(name: str) -> str:
    """Return the text of a built-in cell with its comments. A cell is a job file without a path.

    Args:
        name: Name of the cell, as in `cell_names`.

    Raises:
        InvalidInput: There is no such cell.
    """
    names = cell_names()
    if name not in names:
        raise InvalidInput(
            f"There is no cell {name!r}. Name a job file (.yaml), or one of {', '.join(names)}."
        )
    return (CELLS / f"{name}.yaml").read_text(encoding="utf-8")


@checked
def read_job(
    file: str | FilePath,
    *,
    cell: str | FilePath | None = None,
    patch: Patch | None = None,
    reading: Progress | None = None,
) -> Job:
    """Read a job from a YAML file, or from a drawing and a cell.

    >>> job = ac.read_job("job.yaml")
    >>> job.name
    'corner'
    >>> ac.read_job("part.csv", cell="pmk3s").arm.name
    'PMK-3s'

    Args:
        file: The job file; with a cell, a drawing, G-code or waypoints.
        cell: Cell for a drawing: a built-in cell such as "ur5e", or a job file, whose path the
            drawing replaces.
        patch: Values by keys that replace the file's own, such as {("limits", "speed"): 0.2}.
        reading: Called with the progress of reading the job's drawing, as in `read_path`.

    Raises:
        InvalidInput: The file does not exist or is not YAML, a key is unknown, a value has no unit,
            or the values are invalid; the message names the key.
    """
    location = FilePath(file)
    if cell is not None:
        return read_cell(cell, location, patch=patch, reading=reading)
    return parse_job(
        job_text(location),
        source=location.name,
        folder=location.parent,
        patch=patch,
        reading=reading,
    )


@dataclass(frozen=True, slots=True)
class _Cell:
    """A cell or job file whose keys are not checked."""

    text: str
    source: str  # Name for messages
    folder: FilePath  # Folder against which relative file names are resolved


def _open_cell(cell: str) -> _Cell:
    """Read a built-in cell, or a job file."""
    file = FilePath(cell)
    if file.suffix.lower() in YAML:
        return _Cell(job_text(file), file.name, file.parent)
    return _Cell(cell_text(cell), f"the cell {cell}", FilePath())


def read_cell(
    cell: str | FilePath,
    drawing: str | FilePath,
    *,
    patch: Patch | None = None,
    reading: Progress | None = None,
) -> Job:
    """Make a job from a cell or job file and a drawing.

    The drawing replaces the geometry of a job file, but not its frame and its reader options. A CAD
    model also replaces a tool orientation that does not follow the faces at its edges.

    Args:
        cell: As in `read_job`.
        drawing: The drawing.
        patch: As in `read_job`.
        reading: As in `read_job`.

    Raises:
        InvalidInput: As in `read_job`.
    """
    opened = _open_cell(str(cell))
    data = read_job_mapping(opened.text, opened.source)
    file = FilePath(drawing)
    drawn = drawing_patch(file, str(file.absolute()), data)
    with error_context(opened.source):
        model: CellModel = read_keys(CellModel, apply_patch(data, {**drawn, **(patch or {})}))
    origin = SourceFile.from_text(opened.source, opened.text)
    with recording_sources(origin, patch) as with_sources:
        # Messages of errors in the drawing name only the drawing, not the cell.
        program = read_drawing(model.path, str(model.path.file), opened.folder, reading)
        with error_context(opened.source):
            return with_sources(job_of(model, opened.folder, reading, program))


def read_cell_scene(cell: str | FilePath) -> tuple[Arm | None, Scene]:
    """Read arm (None if not specified) and scene of a cell or job; other keys may be missing."""
    opened = _open_cell(str(cell))
    data = read_job_mapping(opened.text, opened.source)
    with file_context(opened.text, opened.source):
        specified = read_keys(PartialFields(CellModel), data)
    model = specified.get("arm")
    path = specified.get("path", PathModel())
    scene = specified.get("scene")
    with error_context(opened.source):
        part = part_of(path)
        arm = None if model is None else arm_of(model, opened.folder, part)
        if scene is None:
            return arm, Scene()
        parts = parts_of(path, opened.folder, scene.model)
        return arm, scene_of(scene, opened.folder, part, parts)


def drawing_text(cell: str | FilePath, drawing: str | FilePath, to: FilePath) -> str:
    """Write a job file for a drawing in a cell; comments of the cell stay.

    Args:
        cell: Built-in cell or job file.
        drawing: The drawing.
        to: Folder of the new job file, to which its file names are relative.

    Raises:
        InvalidInput: The cell does not exist or is not valid YAML.
    """
    opened = _open_cell(str(cell))
    location = FilePath(drawing).absolute()
    file = FilePath(os.path.relpath(location, to)).as_posix()
    text = move_files(opened.text, opened.folder, to)
    data = read_job_mapping(opened.text, opened.source)
    return write_patch(text, drawing_patch(location, file, data), opened.source)


def drawing_patch(drawing: FilePath, file: str, job: Mapping[str, Any]) -> Patch:
    """Return the patch that sets path, name and title of a job for a drawing.

    Args:
        drawing: The drawing, whose name becomes name and title.
        file: Name of the drawing's file for the key `path.file`.
        job: Keys of the job before the patch, which are not checked.
    """
    removed = list(GEOMETRY_KEYS)
    path = job.get("path")
    orientation = path.get("orientation") if isinstance(path, dict) else None
    follows_faces = isinstance(orientation, dict) and not orientation.keys().isdisjoint(OF_FACES)
    if drawing.suffix.lower() in MODELS and not follows_faces:
        # A fixed orientation of a cell is for flat drawings.
        removed.append("orientation")
    return {
        **{("path", key): REMOVE for key in removed},
        ("path", "file"): file,
        # A file name may be too long for a job name, and may have unprintable characters.
        ("name",): shorten(make_printable(drawing.stem), LONGEST_NAME),
        ("title",): shorten(make_printable(drawing.name), LONGEST_TITLE),
    }
