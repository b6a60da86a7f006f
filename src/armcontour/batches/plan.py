"""Plans of many jobs: the keys of a plan file, and the jobs of the plan."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from armcontour.batches.base_job import BaseJob, check_placement_axes, named_files, read_base
from armcontour.batches.columns import COLUMNS, PLACE, RUN, WORKS, read_columns
from armcontour.batches.parameters import Parameter, read_parameter
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.file_access import read_text
from armcontour.core.quantities import AtLeast, Choice
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import MappingKeys, read_keys

PRODUCT, ZIP = "product", "zip"
# Maximum number of jobs of a plan; their rows need about 1 kB each.
MAX_JOBS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingModel:
    """A drawing and its cell."""

    # File name of the drawing, relative to the plan file
    drawing: str
    # Name of a built-in cell, or a job file relative to the plan
    cell: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SamplesModel:
    """Samples of a Sobol sequence, which covers all ranges uniformly."""

    # Number of samples; powers of 2 give the most uniform coverage
    sobol: Annotated[int, AtLeast(1)]
    # Random seed for the scrambling of the sequence
    seed: Annotated[int, AtLeast(0)] = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanModel:
    """A plan of many jobs."""

    # Name of the plan; by default the name of its file
    name: str | None = None
    # A job file relative to the plan, or a drawing and its cell
    job: str | DrawingModel | None = None
    # Several job files or drawings; each is combined with all parameter values
    jobs: Annotated[list[str | DrawingModel], Field(min_length=1)] | None = None
    # Name of the run to execute; optional if the jobs have only one run
    run: str | None = None
    # Kind of work: `compensate` plans and compensates, `run` also simulates, `certify` finds the
    # fastest plan that satisfies the job's certificate, `place` finds the best placement
    do: Annotated[str, Choice(WORKS)] = RUN
    # Values of parameters by key path in the job file, such as "path.corner_error"
    over: dict[str, Any] = field(default_factory=dict)
    # Combination of the values: `product` makes a job for each combination, `zip` combines values
    # with the same index; a mapping such as {sobol: 64} draws samples from ranges
    combine: Literal["product", "zip"] | SamplesModel = "product"
    # Names of the stored results of each job; docs/guides/batches.md lists them
    columns: list[str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """Sequence of many jobs, each of which is a base job with values of all parameters.

    Args:
        name: Name of the plan.
        bases: Base jobs, without values of parameters.
        parameters: The parameters.
        work: Kind of work: "compensate", "run", "certify" or "place".
        columns: Names of the stored figures.
        combine: "product" or "zip"; not used with samples.
        samples: Values of the sampled parameters, (n, sampled); None without samples.
    """

    name: str
    bases: tuple[BaseJob, ...]
    parameters: tuple[Parameter, ...]
    work: str
    columns: tuple[str, ...]
    combine: str = PRODUCT
    samples: FloatArray | None = None

    @property
    def each(self) -> int:
        """Number of jobs per base job."""
        if self.samples is not None:
            return len(self.samples)
        counts = [len(x.values) for x in self.parameters]
        return max(counts, default=1) if self.combine == ZIP else math.prod(counts)

    def __len__(self) -> int:
        return len(self.bases) * self.each

    @property
    def keys(self) -> tuple[tuple[str | int, ...], ...]:
        """Key path of each parameter in the job file."""
        return tuple(x.parts for x in self.parameters)

    @property
    def varied(self) -> tuple[Parameter, ...]:
        """The parameters with more than one value."""
        return tuple(x for x in self.parameters if len(x.values) > 1)

    @property
    def units(self) -> dict[str, str]:
        """SI units of the numeric columns of results, by name."""
        units = {x.key: x.unit for x in self.parameters if x.unit is not None}
        return units | {x: COLUMNS[x].unit for x in self.columns}

    def base(self, index: int) -> int:
        """Index of the base job from which a job is created."""
        return index // self.each

    def values(self, index: int) -> tuple[Any, ...]:
        """Values of the parameters of a job, in SI units.

        Args:
            index: Index of the job, from 0.
        """
        position = index % self.each
        if self.samples is not None:
            sampled = iter(self.samples[position].tolist())
            return tuple(next(sampled) if x.sampled else x.values[0] for x in self.parameters)
        if self.combine == ZIP:
            return tuple(x.values[position if len(x.values) > 1 else 0] for x in self.parameters)
        values: list[Any] = []
        for parameter in reversed(self.parameters):
            position, k = divmod(position, len(parameter.values))
            values.append(parameter.values[k])
        return tuple(reversed(values))

    def data(self, index: int) -> dict[str, Any]:
        """Data of the job file of a job, in SI units.

        Args:
            index: Index of the job, from 0.
        """
        return self.bases[self.base(index)].data_with(self.keys, self.values(index))

    def job_keys(self) -> list[str]:
        """Key of each job, a digest of everything that its row depends on.

        Raises:
            InvalidInput: A missing file, or two equal jobs.
        """
        request = [self.work, *self.columns]
        indices = dict[str, int]()
        for index in range(len(self)):
            key = self.bases[self.base(index)].key(self.data(index), request)
            first = indices.setdefault(key, index)
            if first != index:
                raise InvalidInput(
                    f"The jobs {first + 1} and {index + 1} of the plan are equal. Remove one of "
                    "the repeated values or files."
                )
        return list(indices)


def read_plan(plan: str | FilePath | Mapping[str, Any]) -> Plan:
    """Read a plan of many jobs.

    Args:
        plan: A plan file (YAML), or its data; then files are relative to the current folder.

    Raises:
        InvalidInput: No such file, an unknown key, an empty range, or an invalid job.
    """
    if isinstance(plan, Mapping):
        data, source, folder = dict(plan), "the plan", FilePath()
    else:
        file = FilePath(plan)
        source, folder = file.name, file.parent
        data = load(read_text(file, "plan"), source)
        if not isinstance(data, dict):
            raise InvalidInput(
                f"{source} must contain a mapping of keys such as job, run and over."
            )
    model: PlanModel = read_keys(MappingKeys(PlanModel), data, source)
    with error_context(source):
        return _make_plan(model, folder, FilePath(source).stem)


def _make_plan(model: PlanModel, folder: FilePath, name: str) -> Plan:
    """Create a plan from its model, and check the jobs with their parameter values."""
    if (model.job is None) == (model.jobs is None):
        raise InvalidInput("a plan must have either the key job, or the key jobs with a list.")
    sampled = isinstance(model.combine, SamplesModel)
    parameters = tuple(read_parameter(k, x, sampled=sampled) for k, x in model.over.items())
    _refuse_overlaps([x.key for x in parameters])
    columns = read_columns(model.columns, model.do)
    bases = tuple(
        read_base(
            x if isinstance(x, str) else {"drawing": x.drawing, "cell": x.cell},
            folder,
            model.run,
            model.do,
        )
        for x in ([model.job] if model.job is not None else model.jobs or [])
    )
    for base in bases:
        if model.do == PLACE:
            check_placement_axes(base, _first_data(base, parameters))
        _refuse_unreadable(base, parameters)
    plan = Plan(
        name=checks.check_name("name of the plan", model.name or name),
        bases=tuple(x.with_digests(_first_data(x, parameters)) for x in bases),
        parameters=parameters,
        work=model.do,
        columns=columns,
        combine=PRODUCT if isinstance(model.combine, SamplesModel) else model.combine,
        samples=_samples(model.combine, parameters),
    )
    _refuse_uneven(plan)
    if len(plan) > MAX_JOBS:
        raise InvalidInput(
            f"the plan has {len(plan)} jobs, but at most {MAX_JOBS} are allowed. Use fewer steps, "
            "or samples with combine: {sobol: 4096}."
        )
    return plan


def _first_data(base: BaseJob, parameters: Sequence[Parameter]) -> dict[str, Any]:
    """Data of a base job with the first values of all parameters."""
    return base.data_with([x.parts for x in parameters], [x.values[0] for x in parameters])


def _refuse_overlaps(keys: Sequence[str]) -> None:
    """Reject two parameters if the key of one contains the key of the other."""
    for key in keys:
        for other in keys:
            if other.startswith(f"{key}."):
                raise InvalidInput(
                    f"over.{key} contains over.{other}, so both set the same value. Remove one of "
                    "them."
                )


def _refuse_uneven(plan: Plan) -> None:
    """Reject zipped parameters with different numbers of values, except single values."""
    if plan.combine != ZIP:
        return
    counts = {x.key: len(x.values) for x in plan.varied}
    if len(set(counts.values())) > 1:
        named = ", ".join(f"{key} has {n}" for key, n in counts.items())
        raise InvalidInput(
            f"combine: zip requires the same number of values for all parameters, but {named}. "
            "Make the numbers equal, or write combine: product."
        )


def _refuse_unreadable(base: BaseJob, parameters: Sequence[Parameter]) -> None:
    """Reject parameter keys and values that are invalid in a job file."""
    keys = [x.parts for x in parameters]
    for k, parameter in enumerate(parameters):
        # Of a range, only the first and the last value are checked.
        tried = {0, len(parameter.values) - 1} if parameter.ranged else range(len(parameter.values))
        for i in sorted(tried):
            location = (
                f"over.{parameter.key} (item {i + 1})"
                if len(parameter.values) > 1
                else f"over.{parameter.key}"
            )
            problem = _find_problem(base, [parameter.parts], [parameter.values[i]])
            if problem is None:
                continue
            # Some values are valid only together with certain values of other parameters. Therefore
            # the first values are tried, then the values with the same index.
            problems = []
            for j in (0, i):
                values = [y.values[min(j, len(y.values) - 1)] for y in parameters]
                values[k] = parameter.values[i]
                problems.append(_find_problem(base, keys, values))
            if None not in problems:
                raise problem.with_location(location)


def _find_problem(
    base: BaseJob, keys: Sequence[tuple[str | int, ...]], values: Sequence[Any]
) -> InvalidInput | None:
    """Error that parameter values cause in a job; None if the values are valid."""
    try:
        data = base.data_with(keys, values)
        base.model(data)
    except InvalidInput as error:
        return error
    missing = [x for x in named_files(data) if not (base.folder / x).is_file()]
    if missing:
        return InvalidInput(f"The file {base.folder / missing[0]} does not exist.")
    return None


def _samples(combine: Any, parameters: Sequence[Parameter]) -> FloatArray | None:
    """Values of the sampled parameters in SI units, (n, sampled); None without samples."""
    if not isinstance(combine, SamplesModel):
        return None
    ranges = [x for x in parameters if x.sampled]
    if not ranges:
        raise InvalidInput(
            "combine.sobol requires a range in over, but over has none. Write a range as {from: "
            "..., to: ...}."
        )
    if combine.sobol > MAX_JOBS:
        raise InvalidInput(f"combine.sobol must be at most {MAX_JOBS}, but is {combine.sobol}.")
    from scipy.stats import qmc

    sequence = qmc.Sobol(len(ranges), scramble=True, seed=combine.seed)
    fractions = sequence.random_base2(math.ceil(math.log2(combine.sobol)))[: combine.sobol]
    return np.column_stack([x.values_at(fractions[:, k]) for k, x in enumerate(ranges)])
