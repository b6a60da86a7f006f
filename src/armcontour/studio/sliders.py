"""Which quantities of a job can be set, where they are written, and in which range."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._quantities import Quantity
from armcontour.compensation import compensator
from armcontour.io.job_edits import Keys, value_at
from armcontour.io.job_model import JobModel
from armcontour.io.patch import key_of, place
from armcontour.io.si_data import quantity_of
from armcontour.io.units import unit_of, write_like
from armcontour.jobs import Job, Run
from armcontour.jobs.job import SHAPES
from armcontour.studio.edits.keys import SHARP, run_of
from armcontour.timing import METHODS

JOB, RUN, ARM, DEFAULT = "job", "run", "arm", "default"


@dataclass(frozen=True, slots=True)
class Slider:
    """A quantity or a choice that can be set.

    Args:
        key: Its key; limits, corners and the command interval are those of the run if it has them.
        label: Its name on the page.
        group: What it belongs to.
        value: Its value in a job and a run [SI]; None if it is not given.
        low, high: Its usual range [SI].
        log: Whether its range is one of sizes.
        choices: What can be chosen, if it is no quantity.
    """

    key: str
    label: str
    group: str
    value: Callable[[Job, Run], Any]
    low: float = 0.0
    high: float = 0.0
    log: bool = True
    choices: tuple[str, ...] = ()

    @property
    def keys(self) -> Keys:
        """Its key, part by part."""
        return key_of(self.key)


def _limit(name: str, group: str, low: float, high: float) -> Slider:
    """A limit of the run."""
    label = name.replace("_", " ")
    return Slider(
        f"limits.{name}", label, group, lambda _, run: getattr(run.limits, name), low, high
    )


def _gain(name: str, low: float, high: float) -> Slider:
    """A gain of the servo."""
    value: Callable[[Job, Run], Any] = lambda job, _: getattr(job.servo, name)  # noqa: E731
    return Slider(f"servo.{name}", f"gain {name}", "servo", value, low, high)


def _tolerance(_: Job, run: Run) -> float | None:
    """The corner tolerance of a run [m]."""
    return None if run.rounding is None else run.rounding.tolerance


def _shape(_: Job, run: Run) -> str:
    """The shape of the corners of a run."""
    return SHARP if run.rounding is None else run.rounding.shape


SLIDERS = (
    Slider("corners.tolerance", "tolerance", "path", _tolerance, 1e-5, 2e-2),
    _limit("speed", "path", 1e-3, 2.0),
    _limit("centripetal_acceleration", "path", 1e-2, 20.0),
    _limit("tool_acceleration", "path", 1e-2, 50.0),
    _limit("joint_velocity", "joints", 1e-2, 10.0),
    _limit("joint_acceleration", "joints", 1e-2, 100.0),
    _limit("joint_jerk", "joints", 1.0, 1e4),
    _gain("kp", 1.0, 500.0),
    _gain("kv", 1.0, 2e3),
    _gain("ki", 0.1, 2e2),
    Slider("command_interval", "command interval", "servo", lambda _, run: run.period, 1e-4, 2e-2),
    Slider("timing.reserve", "reserve", "run", lambda _, run: run.timing.reserve, 0.0, 0.9,
           log=False),
    Slider("timing.method", "timing", "run", lambda _, run: run.timing.method,
           choices=tuple(METHODS)),
    Slider("compensation.method", "compensation", "run", lambda _, run: run.compensation.method,
           choices=tuple(compensator.METHODS)),
    Slider("corners.shape", "corners", "path", _shape, choices=(SHARP, *SHAPES)),
)  # fmt: skip


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
    return [x for slider in SLIDERS for x in _sliders(slider, data, job, this)]


def _sliders(
    slider: Slider, data: Mapping[str, Any], job: Job, run: Run
) -> Iterator[dict[str, Any]]:
    """The slider of a quantity, or those of all joints, where they have different values."""
    keys = place(slider.keys, data, run.name)
    value, written = slider.value(job, run), value_at(data, keys)
    source = _source(keys, value, data, chosen=bool(slider.choices))
    kind = quantity_of(JobModel, keys)
    if kind is None:
        yield {
            **{"key": slider.key, "label": slider.label, "group": slider.group, "value": value},
            **{"written": value, "choices": list(slider.choices), "from": source},
        }
        return
    if isinstance(value, np.ndarray):
        # Lower and upper bounds are typed.
        if value.ndim == 2:
            return
        # A joint without such a loop has no gain to slide.
        finite = np.flatnonzero(np.isfinite(value) & (value > 0))
        if isinstance(written, list) or len(set(value.tolist())) > 1 or not len(finite):
            for k in finite.tolist():
                text = written[k] if isinstance(written, list) else written
                yield _slider(slider, float(value[k]), text, kind, source, joint=k)
            return
        value = float(value[0])
    yield _slider(slider, value, written, kind, source)


def _slider(
    slider: Slider,
    value: float | None,
    written: Any,
    kind: Quantity,
    source: str,
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
        "from": source,
    }


def _source(keys: Keys, value: Any, data: Mapping[str, Any], *, chosen: bool) -> str:
    """Where a value is written; a choice is its mapping's, which may leave it out."""
    if value_at(data, keys[:-1] if chosen else keys) is not None:
        return RUN if keys[0] == "runs" else JOB
    of_arm = keys[-2] == "limits" and str(keys[-1]).startswith("joint_") if keys[1:] else False
    return ARM if of_arm and value is not None else DEFAULT
