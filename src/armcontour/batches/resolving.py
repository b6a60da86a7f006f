"""Jobs of a plan: the data of a job file with the values of parameters, and what identifies it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any

from armcontour import _files
from armcontour._text import show
from armcontour._version import __version__
from armcontour._yaml import load
from armcontour.arms import Arm
from armcontour.batches.columns import CERTIFY, PLACE
from armcontour.errors import InvalidInput, locate_errors
from armcontour.geometry import Path
from armcontour.io.cell import cell_data
from armcontour.io.job_arm import ARM_FILES
from armcontour.io.job_edits import meet
from armcontour.io.job_file import job_on, job_text, parts_of, read_model
from armcontour.io.job_model import JobModel
from armcontour.io.keys import Keys, read_keys
from armcontour.io.si_data import in_si
from armcontour.jobs import Job
from armcontour.program import Program
from armcontour.scene import Scene

# Keys of a job that read files, and keys inside of these that name them.
WITH_FILES = ("arm", "path", "scene")
FILE_KEYS = ("file", "files", "joint_limits")
# A leaf of data: the keys that lead there, and its value as text.
Leaf = tuple[tuple[str, ...], str]


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

    def at(self, keys: Sequence[tuple[str, ...]], values: Sequence[Any]) -> dict[str, Any]:
        """The data with values of parameters.

        Args:
            keys: The keys that lead to each value.
            values: The values.

        Raises:
            InvalidInput: A key inside of something that has no keys.
        """
        data = dict(self.data)
        for parts, value in zip(keys, values, strict=True):
            with locate_errors(self.source):
                _put(data, parts, value)
        return data

    def model(self, data: Mapping[str, Any]) -> JobModel:
        """The keys of a job.

        Raises:
            InvalidInput: An unknown key, or an invalid value.
        """
        model: JobModel = read_keys(Keys(JobModel), dict(data), self.source)
        return model

    def job(self, data: Mapping[str, Any], *, trust_xacro: bool = False) -> Job:
        """The job of some data; arm and path are made once while their data stay the same.

        Args:
            data: The data.
            trust_xacro: As in `read_job`.

        Raises:
            InvalidInput: Values that do not make a job.
        """
        model = self.model(data)
        with locate_errors(self.source):
            text = _text([data.get(x) for x in WITH_FILES])
            return job_on(model, *_made(text, _Made(model, self.folder, trust_xacro)))

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

        with _files.hear_reading(hear), locate_errors(self.source):
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
        text = job_text(place)
        read_model(JobModel, text, place.name)
        data, source, home = load(text, place.name), place.name, place.parent
        name = place.stem
    else:
        cell = job["cell"]
        cell = str(folder / cell) if cell.lower().endswith((".yaml", ".yml")) else cell
        drawing = folder / job["drawing"]
        data, source, home = cell_data(cell, drawing)
        name = drawing.stem
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
    runs, goal = data["runs"], data.get("certificate") or {}
    asked = {CERTIFY: goal, PLACE: data.get("placement") or {}}.get(work, {})
    name = run or asked.get("run")
    if name is None and len(runs) == 1:
        (name,) = runs
    if name is not None and name not in runs:
        raise InvalidInput(f"run: {source} has no run {show(name)}: it has {', '.join(runs)}.")
    if name is None and work not in (CERTIFY, PLACE):
        raise InvalidInput(
            f"run is missing: {source} has several runs, so say which: {', '.join(runs)}."
        )
    found = {key: x for key, x in data.items() if work == CERTIFY or key != "certificate"}
    if name is None:
        return found, None
    found["runs"] = {name: runs[name]}
    for of in ("certificate", "placement"):
        if found.get(of):
            found[of] = {key: x for key, x in found[of].items() if key != "run"}
    experiment = found.get("experiment")
    if isinstance(experiment, dict) and experiment.get("runs") is not None:
        if name in experiment["runs"]:
            found["experiment"] = {key: x for key, x in experiment.items() if key != "runs"}
        else:
            del found["experiment"]
    return found, name


def refuse_without_effect(base: Base, keys: Sequence[str]) -> None:
    """Refuse parameters that the run of a job does not see, since it has values of its own.

    Args:
        base: The job.
        keys: The parameters.

    Raises:
        InvalidInput: There is such a parameter.
    """
    if base.run is None:
        return
    own = base.data["runs"][base.run] or {}
    for key in keys:
        first, *rest = key.split(".")
        if first == "runs" and (not rest or rest[0] != base.run):
            raise InvalidInput(
                f"over.{key} has no effect, because the run of {base.source} is {base.run}: write "
                f"runs.{base.run}, or name another run."
            )
        hidden = own.get(first)
        if first == "limits" and rest:
            hidden = (hidden or {}).get(rest[0])
        if first in ("limits", "corners", "command_interval") and hidden is not None:
            raise InvalidInput(
                f"over.{key} has no effect, because the run {base.run} of {base.source} has its "
                f"own: write runs.{base.run}.{key}."
            )


def refuse_unplaced(base: Base, data: Mapping[str, Any]) -> None:
    """Refuse a job that does not say where its part is to be placed, or that compares arms.

    Args:
        base: The job.
        data: Its data with the first values of all parameters.

    Raises:
        InvalidInput: There is no key placement.over, or arms or tools are to be compared.
    """
    asked = data.get("placement") or {}
    if not asked.get("over"):
        raise InvalidInput(
            f"do: place needs the key placement.over of {base.source}, which says where to look, "
            "such as placement: {over: {x: {from: -100 mm, to: 100 mm, places: 5}}}."
        )
    for name, key in (("arms", "arm"), ("tools", "arm.tool")):
        if asked.get(name):
            raise InvalidInput(
                f"placement.{name} of {base.source} is for the command place: a batch compares "
                f"them by over: {{{key}: [...]}}, so leave it out."
            )


def _put(data: dict[str, Any], parts: Sequence[str], value: Any) -> None:
    """Put a value into data, whose inner mappings are copied; missing mappings are made."""
    for k, name in enumerate(parts[:-1]):
        inner = data.get(name)
        if inner is not None and not isinstance(inner, dict):
            raise InvalidInput(
                f"{'.'.join(parts[: k + 1])} is {show(inner)} there, which has no key "
                f"{parts[k + 1]}: give {'.'.join(parts[: k + 1])} whole, as a list of mappings."
            )
        own = dict(inner or {})
        data[name] = own
        data = own
    data[parts[-1]] = value


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


def flatten(data: Any, parts: tuple[str, ...] = ()) -> Iterator[Leaf]:
    """The leaves of data: values that are no mappings, and empty mappings."""
    if isinstance(data, Mapping) and data:
        for key, x in data.items():
            yield from flatten(x, (*parts, str(key)))
    else:
        yield parts, _text(data)


def _text(value: Any) -> str:
    """A value as JSON, the same for the same value."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), default=str)


class Identity:
    """What identifies the jobs of a base: a digest of all that their results depend on.

    That are the values of its job, in SI units, the files that it reads, what is done, the columns
    and the version of the package.

    Args:
        base: The base.
        keys: The keys that lead to the values of the parameters.
        asked: What is done, and the columns.
    """

    def __init__(self, base: Base, keys: Sequence[tuple[str, ...]], asked: Sequence[str]) -> None:
        self._base, self._keys = base, tuple(keys)
        self._digests: dict[str, str] = {}
        self._own = [k for k, parts in enumerate(keys) if parts[0] in WITH_FILES]
        self._known: dict[str, str] = {}
        self._order = sorted(range(len(keys)), key=lambda k: keys[k])
        fixed = sorted(x for x in flatten(base.data) if not any(meet(x[0], y) for y in keys))
        head = [f"armcontour {__version__}", *asked, *(f"file {x}" for x in base.files)]
        # Between the values of two parameters stand the leaves between their keys.
        ends = [sum(x[0] < keys[k] for x in fixed) for k in self._order]
        parts = [fixed[a:b] for a, b in zip([0, *ends], [*ends, len(fixed)], strict=True)]
        lines = [["".join(map(_line, x))] for x in parts]
        lines[0].insert(0, "".join(f"{x}\n" for x in head))
        self._fixed = ["".join(x).encode() for x in lines]

    def of(self, values: Sequence[Any]) -> bytes:
        """The digest of a job.

        Args:
            values: The values of the parameters.

        Raises:
            InvalidInput: A file that a value names is missing.
        """
        digest = hashlib.sha256(self._fixed[0])
        for k, after in zip(self._order, self._fixed[1:], strict=True):
            leaves = sorted(flatten(values[k], self._keys[k]))
            digest.update("".join(map(_line, leaves)).encode())
            digest.update(after)
        digest.update(self._files(values).encode())
        return digest.digest()

    def _files(self, values: Sequence[Any]) -> str:
        """Digests of the files that keys name."""
        chosen = [values[k] for k in self._own]
        text = _text(chosen)
        if text not in self._known:
            data = self._base.at([self._keys[k] for k in self._own], chosen)
            files = sorted(map(self._digest, named_files(data)))
            self._known[text] = "".join(f"file {x}\n" for x in files)
        return self._known[text]

    def _digest(self, name: str) -> str:
        """The digest of a file."""
        if name not in self._digests:
            with locate_errors(self._base.source):
                content = _files.read_bytes(self._base.folder / name, "file", most=_files.LARGE)
            self._digests[name] = hashlib.sha256(content).hexdigest()
        return self._digests[name]


def _line(leaf: Leaf) -> str:
    """A leaf as a line."""
    return f"{_text(leaf[0])} {leaf[1]}\n"
