"""Values of analog outputs over the time of a plan, from the planned tool speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry import ShapedPath
from armcontour.motion import TimedEvent, Trajectory
from armcontour.motion.trajectory import Span
from armcontour.program import Analog, Contour, Process, Program, contour_called
from armcontour.robot import Limits

Values = Callable[[FloatArray], FloatArray]
# Outputs of G-code that are not the process.
COOLANT = {"coolant"}


def analog_outputs(
    program: Program, trajectory: Trajectory, process: Process, limits: Limits
) -> Mapping[str, Values]:
    """Functions from times of a plan to the values of the analog outputs of its process.

    A function takes increasing times [s], (n,), where the plan starts at 0, and gives (n,). The
    value is that of the planned tool speed while the process is at work on a contour and no output
    that `Analog.follows` names is off, and the value of `Analog.off` otherwise.

    Raises:
        InvalidInput: An output depends on the assigned velocity, and a contour has none.
    """
    check_speeds(program, process, limits)
    states = _States(trajectory, process)
    functions: dict[str, Values] = {}
    for name in process.analog_names:
        # Contours of a layer without the output get None.
        outputs = [_output(process.of_layer(x.layer), name) for x in program.contours]
        idle = next(x.off for own in process.variants if (x := _output(own, name)) is not None)
        functions[name] = partial(_values, program, trajectory, states, limits, outputs, idle)
    return functions


def _output(process: Process, name: str) -> Analog | None:
    """The analog output of a name, if the process has one."""
    return next((x for x in process.analog if x.name == name), None)


def check_speeds(program: Program, process: Process, limits: Limits) -> None:
    """Check that contours have an assigned velocity if an analog output depends on it."""
    if limits.speed is not None or not process.analog_names:
        return
    for k, contour in enumerate(program.contours):
        layer = process.layers.get(contour.layer)
        if (layer is not None and layer.speed) or not np.isnan(contour.path.speeds).any():
            continue
        for output in process.of_layer(contour.layer).analog:
            if output.speed is None and output.rest != output.full:
                raise InvalidInput(
                    f"The analog output {output.name} follows the assigned velocity, which "
                    f"{contour_called(contour, k)} does not have: give limits.speed, or the output "
                    "a speed."
                )


def _values(
    program: Program,
    trajectory: Trajectory,
    states: _States,
    limits: Limits,
    outputs: Sequence[Analog | None],
    idle: float,
    t: FloatArray,
) -> FloatArray:
    """Values of an output at increasing times [s]; `outputs` has it for each contour, or None."""
    times = np.asarray(t, dtype=np.float64)
    values = np.full(len(times), float(idle))
    spans = trajectory.contour_spans
    for contour, span, output in zip(program.contours, spans, outputs, strict=True):
        if output is None:
            continue
        process = states.process.of_layer(contour.layer)
        begin, end = _times_on(span, process)
        # The output leads the tool by its lead time.
        lead = output.lead_time
        first, last = np.searchsorted(times, [begin - lead, end - lead])
        inside = np.clip(times[first:last] + lead, begin, end)
        if len(inside):
            s = trajectory.s(inside) - span.s[0]
            speeds = _tool_speeds(contour, s, trajectory.s(inside, 1))
            worth = _worth(output, speeds, _full_speeds(contour, s, limits, output))
            on = states.on(contour.layer, output, np.clip(inside, *span.t))
            values[first:last] = np.where(on, worth, output.off)
    return values


def _times_on(span: Span, process: Process) -> tuple[float, float]:
    """Times at which the process of a contour goes on and off [s]."""
    assert span.work is not None
    begin, end = span.work
    if process.begins_on:
        begin = span.t[0] - (0.0 if process.pierce is None else process.pierce.time)
    return begin, span.t[1] if process.ends_on else end


def _tool_speeds(contour: Contour, s: FloatArray, rates: FloatArray) -> FloatArray:
    """Tool speeds at arc lengths of a contour [m], given their rates of change [m/s], (n,)."""
    path = contour.path
    if not isinstance(path, ShapedPath) or path.curve is None:
        return rates
    # Arc lengths of a smooth curve are those of its arcs, to a few parts of a million.
    return np.asarray(rates * np.linalg.norm(path(s, 1), axis=1))


def _worth(output: Analog, speed: FloatArray, full: FloatArray | float) -> FloatArray | float:
    """Values of an output at tool speeds [m/s], whose full speeds are given [m/s]."""
    if output.rest == output.full:
        return output.full
    return output.rest + (output.full - output.rest) * np.minimum(speed / full, 1.0)


def _full_speeds(
    contour: Contour, s: FloatArray, limits: Limits, output: Analog
) -> FloatArray | float:
    """Tool speeds at which an output has its full value, at arc lengths of a contour [m/s]."""
    if output.speed is not None:
        return output.speed
    fastest = np.inf if limits.speed is None else limits.speed
    return np.asarray(np.fmin(contour.path.speeds, fastest)[contour.path.locate(s)])


class _States:
    """On/off outputs over the time of a plan, by the position of the tool, without lead times."""

    def __init__(self, trajectory: Trajectory, process: Process) -> None:
        events: dict[str, list[TimedEvent]] = {}
        for event in sorted(trajectory.events, key=lambda x: x.due):
            events.setdefault(event.name, []).append(event)
        # Times of the events of each output, and whether it is on before, between and after them;
        # before its first event, an output has the opposite value.
        self.outputs = {
            name: (
                np.array([x.due for x in own]),
                np.array([not own[0].value, *(bool(x.value) for x in own)]),
            )
            for name, own in events.items()
            if any(isinstance(x.value, bool | np.bool_) for x in own)
        }
        self.process = process
        self.switches = {x.switch.name for x in process.variants if x.switch is not None}
        self.drawn = set(self.outputs) - COOLANT
        self.drawn -= {x.name for own in process.variants for x in own.events}

    def on(self, layer: str, output: Analog, t: FloatArray) -> BoolArray:
        """Mask of increasing times [s] at which the process of a layer is on."""
        switch, names = self.process.of_layer(layer).switch, self.drawn
        if output.follows:
            names = {output.follows}
        elif switch is not None:
            names = names - self.switches | {switch.name}
        on = np.ones(len(t), dtype=np.bool_)
        for name in names:
            # An output without events is never on.
            dues, values = self.outputs.get(name, ((), np.array([False])))
            on &= values[np.searchsorted(dues, t, side="right")]
        return on
