"""Values of the fields of a job's form that the file does not write: of the arm, and defaults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from armcontour._quantities import Quantity
from armcontour.io.job_edits import Keys, value_at
from armcontour.io.job_model import JobModel, RunModel
from armcontour.io.job_options import settings
from armcontour.io.patch import place
from armcontour.io.si_data import quantity_of
from armcontour.io.units import unit_of, write_like
from armcontour.jobs import Job
from armcontour.studio.edits.keys import SHARP, run_of, value_of

JOB, RUN, ARM, DEFAULT = "job", "run", "arm", "default"
CHOICES: tuple[Keys, ...] = (
    ("timing", "method"),
    ("compensation", "method"),
    ("corners", "shape"),
)


@cache
def quantities() -> dict[Keys, tuple[float, float]]:
    """The keys that have a slider, with their usual range: not those of the real servo."""
    every = ((keys, x) for of in (JobModel, RunModel) for keys, x, *_ in settings(of))
    return {
        keys: x.usual for keys, x in every if x.usual[1] and len(keys) <= 2 and keys[0] != "plant"
    }


def values_of(data: Mapping[str, Any], job: Job, run: str) -> dict[str, dict[str, Any]]:
    """Values of fields, for the run that is shown, by their keys.

    Args:
        data: The data of the job file, as written.
        job: The job.
        run: The name of the run.

    Returns:
        Per quantity its `value` in SI units, None if it is not limited, and as `written`; the
        `unit` in which it is written and its `factor` to SI units; `min`, `max` and whether they
        are a range of sizes (`log`); and `from`: the run, the job, the arm or a default. A quantity
        with different values of joints has one per joint. Choices have `value` and `from`.

    Raises:
        InvalidInput: There is no such run.
    """
    rows = dict(x for keys in quantities() for x in _quantity(keys, data, job, run))
    for asked in CHOICES:
        value = value_of(asked, job, run_of(job, run))
        source = _source(asked, value, data, run)
        rows[_text(asked)] = {"value": SHARP if value is None else value, "from": source}
    return rows


def _text(keys: Keys) -> str:
    """The keys as the page writes them."""
    return ".".join(map(str, keys))


def _quantity(
    asked: Keys, data: Mapping[str, Any], job: Job, run: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The row of a quantity, or those of all joints, where they have different values."""
    written, value = value_at(data, place(asked, data, run)), value_of(asked, job, run_of(job, run))
    kind = quantity_of(JobModel, asked) or quantity_of(RunModel, asked)
    assert kind is not None
    source = {"from": _source(asked, value, data, run)}
    if isinstance(value, np.ndarray):
        # Lower and upper bounds are typed.
        if value.ndim == 2:
            return
        # A joint without such a loop has no gain to slide.
        finite = np.flatnonzero(np.isfinite(value) & (value > 0))
        if isinstance(written, list) or len(set(value.tolist())) > 1 or not len(finite):
            for k in finite.tolist():
                text = written[k] if isinstance(written, list) else written
                yield _text((*asked, k)), source | _row(asked, float(value[k]), text, kind)
            return
        value = float(value[0])
    yield _text(asked), source | _row(asked, value, written, kind)


def _row(asked: Keys, value: float | None, written: Any, kind: Quantity) -> dict[str, Any]:
    """A value, as number and as text, and the range of its slider."""
    unit, factor = unit_of(written, kind)
    low, high = usual = quantities()[asked]
    if value is not None and value > 0 and low > 0:
        low = min(low, 10.0 ** math.floor(math.log10(value)))
        high = max(high, 10.0 ** math.ceil(math.log10(value)))
    text = written
    if value is not None and (written is None or isinstance(written, list)):
        text = write_like(value, None, kind)
    return {
        **{"value": value, "written": None if text is None else str(text)},
        **{"unit": unit, "factor": factor, "min": low, "max": high, "log": usual[0] > 0},
    }


def _source(asked: Keys, value: Any, data: Mapping[str, Any], run: str) -> str:
    """Where a value is written."""
    keys = place(asked, data, run)
    # A mapping may leave a choice out.
    written = value_at(data, keys[:-1] if asked in CHOICES else keys)
    if written is not None:
        return RUN if keys[0] == "runs" else JOB
    of_arm = asked[0] == "limits" and str(asked[-1]).startswith("joint_")
    return ARM if of_arm and value is not None else DEFAULT
