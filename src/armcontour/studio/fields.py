"""Values and ranges of the fields of a job's form that have a slider."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from armcontour.files.job_edits import Keys, value_at
from armcontour.files.job_form import usual_ranges
from armcontour.files.job_model import JobModel
from armcontour.files.patch import full_key, locate_key
from armcontour.files.si_data import quantity_of
from armcontour.files.units import unit_of
from armcontour.jobs import Job
from armcontour.studio.edits.keys import run_of, value_of


@cache
def quantities() -> dict[Keys, tuple[float, float]]:
    """The keys that have a slider, with their usual range: not those of the real servo."""
    every = usual_ranges().items()
    return {keys: x for keys, x in every if len(keys) <= 2 and keys[0] != "plant"}


def values_of(data: Mapping[str, Any], job: Job, run: str) -> dict[str, dict[str, Any]]:
    """Values of quantities with a usual range, for the run that is shown, by their keys.

    Args:
        data: The data of the job file, as written.
        job: The job.
        run: The name of the run.

    Returns:
        The `value` in SI units, None if it is not limited; the `unit` in which it is written and
        its `factor` to SI units; `min`, `max` and whether they are a range of sizes (`log`); and
        whether the arm has the value if the job does not (`arm`). A quantity with different values
        of joints has one per joint.

    Raises:
        InvalidInput: There is no such run.
    """
    return dict(x for keys in quantities() for x in _quantity(keys, data, job, run))


def _quantity(
    asked: Keys, data: Mapping[str, Any], job: Job, run: str
) -> Iterator[tuple[str, dict[str, Any]]]:
    """The row of a quantity, or those of all joints, where they have different values."""
    written, value = (
        value_at(data, locate_key(asked, data, run)),
        value_of(asked, job, run_of(job, run)),
    )
    key = ".".join(map(str, asked))
    if not isinstance(value, np.ndarray):
        yield key, _row(asked, value, written)
        return
    # Lower and upper bounds are typed.
    if value.ndim == 2:
        return
    # A joint without such a loop has no gain to slide.
    finite = np.flatnonzero(np.isfinite(value) & (value > 0))
    if isinstance(written, list) or len(set(value.tolist())) > 1 or not len(finite):
        for k in finite.tolist():
            text = written[k] if isinstance(written, list) else written
            yield f"{key}.{k}", _row(asked, float(value[k]), text)
    else:
        yield key, _row(asked, float(value[0]), written)


def _row(asked: Keys, value: float | None, written: Any) -> dict[str, Any]:
    """A value and the range of its slider."""
    kind = quantity_of(JobModel, full_key(asked))
    assert kind is not None
    unit, factor = unit_of(written, kind)
    low, high = usual = quantities()[asked]
    if value is not None and value > 0 and low > 0:
        low = min(low, 10.0 ** math.floor(math.log10(value)))
        high = max(high, 10.0 ** math.ceil(math.log10(value)))
    of_arm = str(asked[-1]).startswith("joint_") and value is not None
    return {
        **{"value": value, "unit": unit, "factor": factor, "arm": of_arm},
        **{"min": low, "max": high, "log": usual[0] > 0},
    }
