"""Which quantities of a job can be set, where they are written, and in which range."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._quantities import Quantity
from armcontour.compensation import compensator
from armcontour.io.job_edits import Keys, value_at
from armcontour.io.job_model import JobModel
from armcontour.io.si_data import quantity_of
from armcontour.io.units import unit_of, write_like
from armcontour.jobs import Job, Run
from armcontour.jobs.job import SHAPES
from armcontour.studio.edits.keys import SHARP, joint_values, place_of, run_of
from armcontour.timing import METHODS

JOB, RUN, ARM, DEFAULT = "job", "run", "arm", "default"


@dataclass(frozen=True, slots=True)
class Slider:
    """A quantity that can be set.

    Args:
        key: Its key; limits, corners and the command interval are those of the run if it has them.
        label: Its name on the page.
        group: What it belongs to.
        low, high: Its usual range [SI].
        log: Whether its range is one of sizes.
    """

    key: str
    label: str
    group: str
    low: float
    high: float
    log: bool = True


SLIDERS = (
    Slider("corners.tolerance", "tolerance", "path", 1e-5, 2e-2),
    Slider("limits.speed", "speed", "path", 1e-3, 2.0),
    Slider("limits.centripetal_acceleration", "centripetal acceleration", "path", 1e-2, 20.0),
    Slider("limits.tool_acceleration", "tool acceleration", "path", 1e-2, 50.0),
    Slider("limits.joint_velocity", "joint velocity", "joints", 1e-2, 10.0),
    Slider("limits.joint_acceleration", "joint acceleration", "joints", 1e-2, 100.0),
    Slider("limits.joint_jerk", "joint jerk", "joints", 1.0, 1e4),
    Slider("servo.kp", "gain kp", "servo", 1.0, 500.0),
    Slider("servo.kv", "gain kv", "servo", 1.0, 2e3),
    Slider("servo.ki", "gain ki", "servo", 0.1, 2e2),
    Slider("command_interval", "command interval", "servo", 1e-4, 2e-2),
    Slider("timing.reserve", "reserve", "run", 0.0, 0.9, log=False),
)
CHOICES = (
    ("timing.method", "timing", "run", tuple(METHODS)),
    ("compensation.method", "compensation", "run", tuple(compensator.METHODS)),
    ("corners.shape", "corners", "path", (SHARP, *SHAPES)),
)


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
    numbers = [x for slider in SLIDERS for x in _sliders(slider, data, job, this)]
    return numbers + [_choice(*x, data=data, run=this) for x in CHOICES]


def _sliders(
    slider: Slider, data: Mapping[str, Any], job: Job, run: Run
) -> Iterator[dict[str, Any]]:
    """The slider of a quantity, or those of all joints, where they have different values."""
    keys = place_of(slider.key, data, run.name)
    written = value_at(data, keys)
    value = _value(slider.key, job, run)
    kind = quantity_of(JobModel, keys)
    assert kind is not None
    if isinstance(value, np.ndarray):
        # Lower and upper bounds are typed.
        if value.ndim == 2:
            return
        # A joint without such a loop has no gain to slide.
        given = np.flatnonzero(np.isfinite(value) & (value > 0))
        if isinstance(written, list) or len(set(value.tolist())) > 1 or not len(given):
            for k in given.tolist():
                own = written[k] if isinstance(written, list) else written
                yield _slider(slider, float(value[k]), own, kind, (data, job, run), joint=k)
            return
        value = float(value[0])
    yield _slider(slider, value, written, kind, (data, job, run))


def _slider(
    slider: Slider,
    value: float | None,
    written: Any,
    kind: Quantity,
    where: tuple[Mapping[str, Any], Job, Run],
    joint: int | None = None,
) -> dict[str, Any]:
    """One slider, of one joint or of all."""
    unit, factor = unit_of(written, kind)
    low, high = slider.low, slider.high
    if value is not None and value > 0 and slider.log:
        low = min(low, 10.0 ** math.floor(math.log10(value)))
        high = max(high, 10.0 ** math.ceil(math.log10(value)))
    text = written
    if value is not None and (written is None or isinstance(written, list)):
        text = write_like(value, None, kind)
    of_joint = "" if joint is None else f" {joint + 1}"
    return {
        "key": slider.key if joint is None else f"{slider.key}.{joint}",
        "label": slider.label + of_joint,
        "group": slider.group,
        "value": value,
        "written": None if text is None else str(text),
        "unit": unit,
        "factor": factor,
        "min": low,
        "max": high,
        "log": slider.log,
        "from": _source(slider.key, value, *where),
    }


def _source(key: str, value: float | None, data: Mapping[str, Any], job: Job, run: Run) -> str:
    """Where a value is written."""
    keys = place_of(key, data, run.name)
    if value_at(data, keys) is not None:
        return RUN if keys[0] == "runs" else JOB
    of_arm = key.startswith("limits.joint_") and value is not None
    return ARM if of_arm else DEFAULT


def _value(key: str, job: Job, run: Run) -> Any:
    """The value of a quantity in SI units, (dof,) for those of joints; None if it is not given."""
    keys: Keys = tuple(key.split("."))
    if keys == ("command_interval",):
        return run.period
    if keys == ("timing", "reserve"):
        return run.timing.reserve
    if keys[0] == "corners":
        return None if run.rounding is None else run.rounding.tolerance
    values = joint_values(keys, job, run.name)
    if values is None and keys[0] == "limits":
        return getattr(run.limits, str(keys[-1]))
    return values


def _choice(
    key: str,
    label: str,
    group: str,
    known: tuple[str, ...],
    *,
    data: Mapping[str, Any],
    run: Run,
) -> dict[str, Any]:
    """What can be chosen from a few."""
    corners = SHARP if run.rounding is None else run.rounding.shape
    values = {
        "timing.method": run.timing.method,
        "compensation.method": run.compensation.method,
    }
    value = values.get(key, corners)
    keys = place_of(key, data, run.name)
    return {
        "key": key,
        "label": label,
        "group": group,
        "value": value,
        "written": value,
        "choices": list(known),
        "from": DEFAULT
        if value_at(data, keys[:-1]) is None
        else (RUN if keys[0] == "runs" else JOB),
    }
