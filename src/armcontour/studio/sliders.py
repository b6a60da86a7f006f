"""Which quantities of a job can be set, where they are written, and in which range."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import numpy as np

from armcontour._quantities import About, Quantity
from armcontour.compensation import compensator
from armcontour.io.job_edits import Keys, value_at
from armcontour.io.job_model import JobModel, RunModel
from armcontour.io.job_options import settings
from armcontour.io.patch import place
from armcontour.io.si_data import quantity_of
from armcontour.io.units import unit_of, write_like
from armcontour.jobs import Job, Run
from armcontour.jobs.job import SHAPES
from armcontour.studio.edits.keys import SHARP, run_of, value_of
from armcontour.timing import METHODS

JOB, RUN, ARM, DEFAULT = "job", "run", "arm", "default"
# What can be chosen: label, group, choices.
CHOICES: dict[Keys, tuple[str, str, tuple[str, ...]]] = {
    ("timing", "method"): ("timing", "run", tuple(METHODS)),
    ("compensation", "method"): ("compensation", "run", tuple(compensator.METHODS)),
    ("corners", "shape"): ("corners", "path", (SHARP, *SHAPES)),
}


@cache
def quantities() -> dict[Keys, About]:
    """The keys that have a slider: not those of the real servo, nor those further inside."""
    every = ((keys, x) for of in (JobModel, RunModel) for keys, x, *_ in settings(of) if x.panel)
    return {keys: x for keys, x in every if keys[0] != "plant" and len(keys) <= 2}


def sliders_of(data: Mapping[str, Any], job: Job, run: str) -> list[dict[str, Any]]:
    """What can be set of a job, for the run that is shown.

    Args:
        data: The data of the job file, as written.
        job: The job.
        run: The name of the run.

    Returns:
        Per quantity its key, label and group; its value in SI units, None if it is not limited, and
        as `written`; the `unit` in which it is written and its `factor` to SI units; `min`, `max`
        and whether they are a range of sizes (`log`); and `from` where its value is: the run, the
        job, the arm or a default. Choices have a value and `choices` instead of a range.

    Raises:
        InvalidInput: There is no such run.
    """
    this = run_of(job, run)
    rows = [
        x for keys, about in quantities().items() for x in _sliders(keys, about, data, job, this)
    ]
    return rows + [_choice(keys, data, job, this) for keys in CHOICES]


def _choice(asked: Keys, data: Mapping[str, Any], job: Job, run: Run) -> dict[str, Any]:
    """What is chosen, and what can be."""
    keys, value = place(asked, data, run.name), value_of(asked, job, run)
    label, group, choices = CHOICES[asked]
    return {
        "key": ".".join(map(str, asked)),
        "label": label,
        "group": group,
        "value": SHARP if value is None else value,
        "written": value_at(data, keys),
        "choices": list(choices),
        # A mapping may leave it out.
        "from": _source(keys, value, value_at(data, keys[:-1])),
    }


def _sliders(
    asked: Keys, about: About, data: Mapping[str, Any], job: Job, run: Run
) -> Iterator[dict[str, Any]]:
    """The slider of a quantity, or those of all joints, where they have different values."""
    keys, value = place(asked, data, run.name), value_of(asked, job, run)
    written = value_at(data, keys)
    kind = quantity_of(JobModel, keys)
    assert kind is not None
    row = {
        "key": ".".join(map(str, asked)),
        "label": about.label or str(asked[-1]).replace("_", " "),
        "group": about.panel,
        "from": _source(keys, value, written),
    }
    if isinstance(value, np.ndarray):
        # Lower and upper bounds are typed.
        if value.ndim == 2:
            return
        # A joint without such a loop has no gain to slide.
        finite = np.flatnonzero(np.isfinite(value) & (value > 0))
        if isinstance(written, list) or len(set(value.tolist())) > 1 or not len(finite):
            for k in finite.tolist():
                text = written[k] if isinstance(written, list) else written
                joint = {"key": f"{row['key']}.{k}", "label": f"{row['label']} {k + 1}"}
                yield row | joint | _range(about, float(value[k]), text, kind)
            return
        value = float(value[0])
    yield row | _range(about, value, written, kind)


def _range(about: About, value: float | None, written: Any, kind: Quantity) -> dict[str, Any]:
    """The value of a slider, as number and as written, and its range."""
    unit, factor = unit_of(written, kind)
    low, high = about.usual
    if value is not None and value > 0 and low > 0:
        low = min(low, 10.0 ** math.floor(math.log10(value)))
        high = max(high, 10.0 ** math.ceil(math.log10(value)))
    text = written
    if value is not None and (written is None or isinstance(written, list)):
        text = write_like(value, None, kind)
    return {
        "value": value,
        "written": None if text is None else str(text),
        "unit": unit,
        "factor": factor,
        "min": low,
        "max": high,
        "log": about.usual[0] > 0,
    }


def _source(keys: Keys, value: Any, written: Any) -> str:
    """Where a value is written."""
    if written is not None:
        return RUN if keys[0] == "runs" else JOB
    of_arm = keys[-2] == "limits" and str(keys[-1]).startswith("joint_") if keys[1:] else False
    return ARM if of_arm and value is not None else DEFAULT
