"""Jobs of a plan: the data of a job file with the values of parameters, and what identifies it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any

from armcontour._version import __version__
from armcontour.batches.columns import CERTIFY, PLACE
from armcontour.core import file_access
from armcontour.core.checks import raise_if
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.text import show
from armcontour.files.cell import cell_data
from armcontour.files.job_arm import ARM_FILES
from armcontour.files.job_edits import Keys
from armcontour.files.job_file import assemble_job, job_text, model_of, parts_of, read_data
from armcontour.files.job_model import JobModel
from armcontour.files.patch import apply_patch
from armcontour.files.si_data import in_si
from armcontour.geometry import Path
from armcontour.jobs import Job
from armcontour.program import Program
from armcontour.robot import Arm
from armcontour.robot.scene import Scene

# Keys of a job that read files, and keys inside of these that name them.
WITH_FILES = ("arm", "tools", "path", "scene")
FILE_KEYS = ("file", "files", "joint_limits")
# Keys of a job that may choose the run, by what is done with it.
CHOOSERS = {CERTIFY: "certificate", PLACE: "placement"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Base:
    """A job before its parameters have values.

    Args:
        name: Name of the job in results.
        source: Name of its file in messages.
        folder: Folder of relative file names.
        data: The data of its file, in SI units, with one run only.
        run: Name of that run; None lets the certificate or the placement choose.
        files: Digests of files that it reads and that no key names, such as meshes.
        dimension: Dimension of its arm's work space.
    """

    name: str
    source: str
    folder: FilePath
    data: Mapping[str, Any]
    run: str | None
    files: tuple[str, ...] = ()
    dimension: int = 0

    def at(self, keys: Sequence[Keys], values: Sequence[Any]) -> dict[str, Any]:
        """The data with values of parameters.

        Args:
            keys: The keys that lead to each value.
            values: The values.

        Raises:
            InvalidInput: A key inside of something that has no keys.
        """
        with error_context(self.source):
            data: dict[str, Any] = apply_patch(
                self.data, dict(zip(keys, values, strict=True)), self.run
            )
        return data

    def model(self, data: Mapping[str, Any]) -> JobModel:
        """The keys of a job.

        Raises:
            InvalidInput: An unknown key, or an invalid value.
        """
        return model_of(JobModel, data, self.source)

    def job(self, data: Mapping[str, Any], *, trust_xacro: bool = False) -> Job:
        """The job of some data; arm and path are made once while their data stay the same.

        Args:
            data: The data.
            trust_xacro: As in `read_job`.

        Raises:
            InvalidInput: Values that do not make a job.
        """
        model = self.model(data)
        with error_context(self.source):
            text = _text([data.get(x) for x in WITH_FILES])
            return assemble_job(model, *_made(text, _Made(model, self.folder, trust_xacro)))

    def key(self, data: Mapping[str, Any], asked: Sequence[str]) -> str:
        """A digest of all that the results of a job depend on.

        That are its data, the files that it reads, what is done, and the version of the package.

        Args:
            data: The data.
            asked: What is done, and the columns.

        Raises:
            InvalidInput: A file that a key names is missing.
        """
        with error_context(self.source):
            named = [_digest_of(self.folder / x) for x in named_files(data)]
        text = _text([__version__, asked, data, named, self.files])
        return hashlib.sha256(text.encode()).hexdigest()

    def heard(self, data: Mapping[str, Any], *, trust_xacro: bool) -> Base:
        """The same with its arm's dimension, and digests of files that arm, path and scene read.

        Args:
            data: Its data with values of all parameters.
            trust_xacro: As in `read_job`.

        Raises:
            InvalidInput: A file is missing, or an arm or a path is wrong.
        """
        found: dict[FilePath, str] = {}

        def hear(file: FilePath, content: bytes) -> None:
            found[file.resolve()] = hashlib.sha256(content).hexdigest()

        with file_access.hear_reading(hear), error_context(self.source):
            arm, *_ = _Made(self.model(data), self.folder, trust_xacro).make()
            # Reads the meshes, which are read when shapes are first asked for.
            arm.knows_shapes  # noqa: B018
        for x in named_files(data):
            found.pop((self.folder / x).resolve(), None)
        return replace(self, files=tuple(sorted(found.values())), dimension=arm.dimension)


@dataclass(frozen=True, slots=True)
class _Made:
    """Makes arm, path and scene; equal to every other, so that a cache goes by their text."""

    model: JobModel = field(compare=False)
    folder: FilePath
    trust_xacro: bool

    def make(self) -> tuple[Arm, Path | Program, Scene | None]:
        """The arm, the path and the scene."""
        return parts_of(self.model, self.folder, trust_xacro=self.trust_xacro)


@lru_cache(maxsize=4)
def _made(text: str, made: _Made) -> tuple[Arm, Path | Program, Scene | None]:
    """The arm, the path and the scene of some data; the last ones are kept."""
    return made.make()


def read_base(job: str | Mapping[str, str], folder: FilePath, run: str | None, work: str) -> Base:
    """Read a job that a plan names.

    Args:
        job: A job file, or a drawing and a cell.
        folder: Folder of relative file names.
        run: Name of the run; None for the only one.
        work: What is done with it.

    Raises:
        InvalidInput: An invalid job, or no such run.
    """
    if isinstance(job, str):
        place = folder / job
        data, source, home = read_data(job_text(place), place.name), place.name, place.parent
        name = place.stem
    else:
        cell = job["cell"]
        cell = str(folder / cell) if cell.lower().endswith((".yaml", ".yml")) else cell
        drawing = folder / job["drawing"]
        data, source, home = cell_data(cell, drawing)
        name = drawing.stem
    model_of(JobModel, data, source)
    reduced, chosen = _with_run(data, source, run, work)
    found = in_si(reduced, JobModel)
    return Base(name=name, source=source, folder=home.absolute(), data=found, run=chosen)


def _with_run(
    data: Mapping[str, Any], source: str, run: str | None, work: str
) -> tuple[dict[str, Any], str | None]:
    """The data of a job without other runs, and without what they are compared with.

    Raises:
        InvalidInput: There is no such run, or several to choose from.
    """
    runs, names = data["runs"], ", ".join(data["runs"])
    name = run or (data.get(CHOOSERS.get(work, "")) or {}).get("run")
    if name is None and len(runs) == 1:
        (name,) = runs
    unknown = f"run: {source} has no run {show(name)}: it has {names}."
    raise_if(name not in (None, *runs), unknown)
    missing = f"run is missing: {source} has several runs, so say which: {names}."
    raise_if(name is None and work not in CHOOSERS, missing)
    found = dict(data) if work == CERTIFY else _without(data, "certificate")
    if name is None:
        return found, None
    found["runs"] = {name: runs[name]}
    for key in CHOOSERS.values():
        if found.get(key):
            found[key] = _without(found[key], "run")
    experiment = found.get("experiment")
    if isinstance(experiment, dict) and experiment.get("runs") is not None:
        if name in experiment["runs"]:
            found["experiment"] = _without(experiment, "runs")
        else:
            del found["experiment"]
    return found, name


def _without(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    """The data without one key."""
    return {key: x for key, x in data.items() if key != name}


def check_placed(base: Base, data: Mapping[str, Any]) -> None:
    """Refuse a job that does not say where its part is to be placed.

    Args:
        base: The job.
        data: Its data with the first values of all parameters.

    Raises:
        InvalidInput: There is no key placement.over.
    """
    asked = data.get("placement") or {}
    if not asked.get("over"):
        raise InvalidInput(
            f"do: place needs the key placement.over of {base.source}, which says where to look, "
            "such as placement: {over: {x: {from: -100 mm, to: 100 mm, places: 5}}}."
        )


def named_files(data: Mapping[str, Any]) -> Iterator[str]:
    """The files that keys of a job name."""
    arm = data.get("arm")
    if isinstance(arm, str) and arm.lower().endswith(ARM_FILES):
        yield arm
    for x in WITH_FILES:
        yield from _files_in(data.get(x))


def _files_in(data: Any) -> Iterator[str]:
    """The files that some data name."""
    if isinstance(data, list):
        for x in data:
            yield from _files_in(x)
    elif isinstance(data, Mapping):
        for key, x in data.items():
            if key in FILE_KEYS:
                yield from (y for y in (x if isinstance(x, list) else [x]) if isinstance(y, str))
            yield from _files_in(x)


def _text(value: Any) -> str:
    """A value as JSON, the same for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def _digest_of(file: FilePath) -> str:
    """The digest of a file.

    Raises:
        InvalidInput: It cannot be read.
    """
    try:
        state = file.stat()
    except OSError:
        # Reading says what is wrong.
        return _digest(file, (0, 0))
    return _digest(file, (state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=10_000)
def _digest(file: FilePath, state: tuple[int, int]) -> str:
    """The digest of a file of a size and time."""
    return hashlib.sha256(file_access.read_bytes(file, "file", most=file_access.LARGE)).hexdigest()
