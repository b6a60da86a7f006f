"""Two variants of a job side by side: the shown run, and another run or the job before an edit."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.studio.tasks.request import Request
from armcontour.studio.wire import Frame

if TYPE_CHECKING:
    from armcontour.core.checks import FloatArray
    from armcontour.jobs import RunResult

# Points of each curve.
POINTS = 2_000


def compare(x: Request) -> Frame:
    """The shown run and another one: differences by limit, speeds and errors on one axis.

    Raises:
        InvalidInput: The job was not edited yet.
    """
    from armcontour.core.render import cells, number
    from armcontour.jobs.differences import differences
    from armcontour.studio.view import short

    other = x.option("with", "")
    if other:
        names, that = (str(x.run), other), replace(x, run=other)
    else:
        names, text = ("now", "before"), x.option("text", "")
        if not text:
            raise InvalidInput("There is no edit yet: edit the job, or choose another run.")
        that = replace(x, text=text)
    results = x.result, that.result
    found = differences(results[0].to_data(), results[1].to_data(), names)
    saved = results[1].trajectory.duration - results[0].trajectory.duration
    words = "shorter" if saved > 0 else "longer"
    sentence = f"The motion is {number(abs(saved), 's')} {words}: {names[0]} against {names[1]}."
    length = max(y.path.length for y in results)
    duration = max(y.motion.t[-1] for y in results)
    s, t = np.linspace(0, length, POINTS), np.linspace(0, duration, POINTS)
    arrays = {"s": s, "t": t}
    for k, result in enumerate(results):
        arrays[f"speed_{k}"], arrays[f"error_{k}"] = _speed(result, s), _error(result, t)
    header = {"run": x.run, "sentence": sentence, "names": names, "table": cells(found)}
    return Frame("result", header, {name: short(y) for name, y in arrays.items()})


def _speed(result: RunResult, s: FloatArray) -> FloatArray:
    """Planned tool speeds at arc lengths, NaN behind the end [m/s]."""
    within = s <= result.path.length
    found = np.full(len(s), np.nan)
    found[within] = result.trajectory.speed_at(s[within])
    return found


def _error(result: RunResult, t: FloatArray) -> FloatArray:
    """Contour errors at times, NaN where there is none [m]."""
    assert result.evaluation is not None
    e = result.evaluation.contour_error
    return np.interp(t, e.t, e.values, left=np.nan, right=np.nan)
