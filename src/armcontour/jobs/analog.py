"""Values of analog outputs over the time of a plan, from the planned tool speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Limits
from armcontour.errors import InvalidInput
from armcontour.motion import Trajectory
from armcontour.program import Analog, Contour, Process, Program, contour_called

Values = Callable[[FloatArray], FloatArray]


def analog_outputs(
    program: Program, trajectory: Trajectory, process: Process, limits: Limits
) -> Mapping[str, Values]:
    """Functions from times of a plan to the values of the analog outputs of its process.

    A function takes increasing times [s], (n,), where the plan starts at 0, and gives (n,). The
    value is that of the planned tool speed while the process is at work on a contour and has not
    been switched off along it, and the value of `Analog.off` otherwise.

    Args:
        program: The program that was planned, with rounded corners.
        trajectory: Its plan.
        process: The process with the outputs.
        limits: Limits of the plan; their speed is the assigned velocity where contours have none.

    Raises:
        InvalidInput: An output depends on the assigned velocity, and a contour has none.
    """
    found: dict[str, Values] = {}
    for output in process.analog:
        for k, contour in enumerate(program.contours):
            _refuse_open_speed(output, contour, k, limits)
        found[output.name] = partial(_values, program, trajectory, process, limits, output)
    return found


def _refuse_open_speed(output: Analog, contour: Contour, number: int, limits: Limits) -> None:
    """Refuse an output that depends on the assigned velocity for a contour that has none."""
    if output.speed is None and limits.speed is None and np.isnan(contour.path.speeds).any():
        raise InvalidInput(
            f"The analog output {output.name} follows the assigned velocity, which "
            f"{contour_called(contour, number)} does not have: give limits.speed, or the output a "
            "speed."
        )


def _values(
    program: Program,
    trajectory: Trajectory,
    process: Process,
    limits: Limits,
    output: Analog,
    t: FloatArray,
) -> FloatArray:
    """Values of an output at increasing times of the plan, (n,)."""
    # The output leads the tool by its lead time.
    at = np.asarray(t, dtype=np.float64) + output.lead_time
    values = np.full(len(at), output.off)
    for contour, span in zip(program.contours, trajectory.contour_spans, strict=True):
        assert span.work is not None
        first, last = np.searchsorted(at, span.work)
        here = at[first:last]
        if len(here):
            speeds = trajectory.s(here, 1)
            s = trajectory.s(here) - span.s[0]
            full = _full_speeds(contour, s, limits, output)
            share = np.minimum(speeds / full, 1.0)
            worth = output.rest + (output.full - output.rest) * share
            on = _switched_on(contour, s, process)
            values[first:last] = np.where(on, worth, output.off)
    return values


def _full_speeds(
    contour: Contour, s: FloatArray, limits: Limits, output: Analog
) -> FloatArray | float:
    """Tool speeds at which an output has its full value, at arc lengths of a contour [m/s]."""
    if output.speed is not None:
        return output.speed
    most = np.inf if limits.speed is None else limits.speed
    return np.asarray(np.fmin(contour.path.speeds, most)[contour.path.locate(s)])


def _switched_on(contour: Contour, s: FloatArray, process: Process) -> BoolArray:
    """Whether the process has not been switched off along a contour, at arc lengths [m]."""
    name = None if process.switch is None else process.switch.name
    own = [x for x in contour.events if x.name == name]
    places = [x.s for x in own]
    on = np.array([True, *(x.value is not False for x in own)])
    return np.asarray(on[np.searchsorted(places, s, side="right")])
