"""Base jobs of a plan: job data, substitution of parameter values, and digests for the cache."""

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
from armcontour.files.job_file import assemble_job, job_text, model_of, parts_of, read_data
from armcontour.files.job_model import JobModel
from armcontour.files.job_text_edits import Keys
from armcontour.files.patch import apply_patch
from armcontour.files.si_data import in_si
from armcontour.geometry import Path
from armcontour.jobs import Job
from armcontour.program import Program
from armcontour.robot import Arm
from armcontour.robot.scene import Scene

# Sections of a job that can name files, and the keys in these sections whose values are file names.
FILE_SECTIONS = ("arm", "path", "scene")
FILE_KEYS = ("file", "files", "joint_limits")
# For some kinds of work, the section of a job whose key `run` selects the run.
RUN_SELECTORS = {CERTIFY: "certificate", PLACE: "placement"}


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseJob:
    """Job of a plan, before the parameters of the plan replace its values."""

    # Name of the job in results
    name: str
    # Name of the file in messages
    source: str
    # Folder against which relative file names are resolved
    folder: FilePath
    # Data of the file in SI units, with only the selected run; with all runs if `run` is None
    data: Mapping[str, Any]
    # Name of the selected run; None if the certificate or the placement selects the run
    run: str | None
    # Digests of files that the job reads but no key names, such as meshes
    files: tuple[str, ...] = ()
    # Dimension of the arm's work space, 2 or 3; 0 before `with_digests`
    dimension: int = 0

    def data_with(self, keys: Sequence[Keys], values: Sequence[Any]) -> dict[str, Any]:
        """Data of the job with the values of parameters."""
        with error_context(self.source):
            data: dict[str, Any] = apply_patch(
                self.data, dict(zip(keys, values, strict=True)), self.run
            )
        return data

    def model(self, data: Mapping[str, Any]) -> JobModel:
        """Check the data of a job, and return its model."""
        return model_of(JobModel, data, self.source)

    def job(self, data: Mapping[str, Any]) -> Job:
        """Create the job of some data; equal data of arm, path and scene are read only once."""
        model = self.model(data)
        with error_context(self.source):
            text = _canonical_json([data.get(x) for x in FILE_SECTIONS])
            return assemble_job(model, *_cached_parts(text, _PartFactory(model, self.folder)))

    def key(self, data: Mapping[str, Any], request: Sequence[str]) -> str:
        """Digest of everything that the results of a job depend on."""
        with error_context(self.source):
            named = [_digest_of(self.folder / x) for x in named_files(data)]
        text = _canonical_json([__version__, request, data, named, self.files])
        return hashlib.sha256(text.encode()).hexdigest()

    def with_digests(self, data: Mapping[str, Any]) -> BaseJob:
        """Copy with the arm's dimension and digests of files that no key names."""
        digests: dict[FilePath, str] = {}

        def add_digest(file: FilePath, content: bytes) -> None:
            digests[file.resolve()] = hashlib.sha256(content).hexdigest()

        with file_access.listen_to_reading(add_digest), error_context(self.source):
            arm, *_ = _PartFactory(self.model(data), self.folder).make()
            # Meshes are read at the first access to the shapes.
            arm.knows_shapes  # noqa: B018
        for name in named_files(data):
            digests.pop((self.folder / name).resolve(), None)
        return replace(self, files=tuple(sorted(digests.values())), dimension=arm.dimension)


@dataclass(frozen=True, slots=True)
class _PartFactory:
    """Factory of arm, path and scene; `model` is not compared, because the cache compares texts."""

    model: JobModel = field(compare=False)
    folder: FilePath

    def make(self) -> tuple[Arm, Path | Program, Scene | None]:
        """Create the arm, the path and the scene."""
        return parts_of(self.model, self.folder)


@lru_cache(maxsize=4)
def _cached_parts(text: str, factory: _PartFactory) -> tuple[Arm, Path | Program, Scene | None]:
    """Arm, path and scene of a job, cached by the text of its data."""
    return factory.make()


def read_base(
    job: str | Mapping[str, str], folder: FilePath, run: str | None, work: str
) -> BaseJob:
    """Read a base job of a plan: a job file, or a drawing and its cell."""
    if isinstance(job, str):
        file = folder / job
        data, source, home = read_data(job_text(file), file.name), file.name, file.parent
        name = file.stem
    else:
        cell = job["cell"]
        cell = str(folder / cell) if cell.lower().endswith((".yaml", ".yml")) else cell
        drawing = folder / job["drawing"]
        data, source, home = cell_data(cell, drawing)
        name = drawing.stem
    model_of(JobModel, data, source)
    reduced, chosen = _select_run(data, source, run, work)
    si_data = in_si(reduced, JobModel)
    return BaseJob(name=name, source=source, folder=home.absolute(), data=si_data, run=chosen)


def _select_run(
    data: Mapping[str, Any], source: str, run: str | None, work: str
) -> tuple[dict[str, Any], str | None]:
    """Data with the selected run only, and its name; with all runs and None if none is selected."""
    runs, names = data["runs"], ", ".join(data["runs"])
    name = run or (data.get(RUN_SELECTORS.get(work, "")) or {}).get("run")
    if name is None and len(runs) == 1:
        (name,) = runs
    unknown = f"run: {source} has no run {show(name)}. It has the runs {names}."
    raise_if(name not in (None, *runs), unknown)
    missing = f"run is missing: {source} has several runs. Choose one of {names}."
    raise_if(name is None and work not in RUN_SELECTORS, missing)
    reduced = dict(data) if work == CERTIFY else _remove_key(data, "certificate")
    if name is None:
        return reduced, None
    reduced["runs"] = {name: runs[name]}
    for key in RUN_SELECTORS.values():
        if reduced.get(key):
            reduced[key] = _remove_key(reduced[key], "run")
    experiment = reduced.get("experiment")
    if isinstance(experiment, dict) and experiment.get("runs") is not None:
        if name in experiment["runs"]:
            reduced["experiment"] = _remove_key(experiment, "runs")
        else:
            del reduced["experiment"]
    return reduced, name


def _remove_key(data: Mapping[str, Any], name: str) -> dict[str, Any]:
    return {key: x for key, x in data.items() if key != name}


def check_placement_axes(base: BaseJob, data: Mapping[str, Any]) -> None:
    """Check that a job has axes for the placement search."""
    placement = data.get("placement") or {}
    if not placement.get("over"):
        raise InvalidInput(
            f"do: place requires the key placement.over in {base.source}, which defines the axes "
            "of the search, such as placement: {over: {x: {from: -100 mm, to: 100 mm, places: 5}}}."
        )


def named_files(data: Mapping[str, Any]) -> Iterator[str]:
    """Yield the names of the files that keys of a job name."""
    arm = data.get("arm")
    if isinstance(arm, str) and arm.lower().endswith(ARM_FILES):
        yield arm
    for key in FILE_SECTIONS:
        yield from _iterate_file_names(data.get(key))


def _iterate_file_names(data: Any) -> Iterator[str]:
    if isinstance(data, list):
        for value in data:
            yield from _iterate_file_names(value)
    elif isinstance(data, Mapping):
        for key, value in data.items():
            if key in FILE_KEYS:
                yield from (
                    y for y in (value if isinstance(value, list) else [value]) if isinstance(y, str)
                )
            yield from _iterate_file_names(value)


def _canonical_json(value: Any) -> str:
    """Canonical JSON of a value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


def _digest_of(file: FilePath) -> str:
    """Digest of a file, cached by its size and modification time."""
    try:
        state = file.stat()
    except OSError:
        # `_digest` reads the file and raises the error.
        return _digest(file, (0, 0))
    return _digest(file, (state.st_size, state.st_mtime_ns))


@lru_cache(maxsize=10_000)
def _digest(file: FilePath, state: tuple[int, int]) -> str:
    """Digest of a file; a new `state` (size, modification time) makes the cache read it again."""
    return hashlib.sha256(
        file_access.read_bytes(file, "file", maximum=file_access.LARGE)
    ).hexdigest()
