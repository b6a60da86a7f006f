"""Values of analog outputs over time, computed from the planned tool speed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry import ShapedPath
from armcontour.motion import TimedEvent, Trajectory
from armcontour.motion.trajectory import Span
from armcontour.program import Analog, Process, Program, contour_called
from armcontour.program.moves import SPINDLE_SPEED, SWITCHED_ON, events_of
from armcontour.robot import Limits

Values = Callable[[FloatArray], FloatArray]
# Names of G-code outputs that do not belong to the process.
COOLANT = {"coolant"}


def analog_outputs(
    program: Program, trajectory: Trajectory, process: Process, limits: Limits
) -> Mapping[str, Values]:
    """Map the names of analog outputs to their values as functions of the plan's time.

    A function takes increasing times [s], (n,), where the plan starts at 0, and gives (n,). While
    the process works on a contour and no output that `Analog.follows` names is off, the value
    belongs to the planned tool speed v: rest + (full - rest) min(v / v_full, 1). v_full is the
    output's speed, by default the assigned velocity. If the output is proportional to S, this is
    multiplied by S / `full_s`. Otherwise the value is `Analog.off`. If the process stays off, the
    mapping is empty.

    Raises:
        InvalidInput: An output depends on the assigned velocity, and a contour has none; or it
            depends on S of G-code, and the program has no S or an S above `full_s`.
    """
    if process.off:
        return {}
    check_analog(program, process, limits)
    states = _States(trajectory, process)
    functions: dict[str, Values] = {}
    for name in process.analog_names:
        # None for a contour whose process lacks the output.
        outputs = [_output(process.of_contour(x), name) for x in program.contours]
        idle = next(x.off for own in process.variants if (x := _output(own, name)) is not None)
        functions[name] = partial(_values, program, trajectory, states, limits, outputs, idle)
    return functions


def _output(process: Process, name: str) -> Analog | None:
    """Find the process's analog output with this name; None if it does not exist."""
    return next((x for x in process.analog if x.name == name), None)


def check_analog(program: Program, process: Process, limits: Limits) -> None:
    """Raise InvalidInput if an analog output depends on a velocity or S that is missing."""
    events = list(events_of(program.moves))
    for variant in process.variants:
        events += variant.events
    s_words = [x.value for x in events if x.name == SPINDLE_SPEED]
    largest = max((float(x) for x in s_words if not isinstance(x, str)), default=None)
    for output in chain.from_iterable(variant.analog for variant in process.variants):
        if output.full_s is not None and (largest is None or largest > output.full_s):
            found = "no S" if largest is None else f"S up to {largest:g}"
            raise InvalidInput(
                f"process.analog: {output.name} is proportional to S up to full_s = "
                f"{output.full_s:g}, but {program.source or 'the program'} has {found}. Set full_s "
                "to the S of full power, or remove it."
            )
    if limits.speed is not None:
        return
    for k, contour in enumerate(program.contours):
        layer = process.layers.get(contour.layer)
        if (layer is not None and layer.speed) or not np.isnan(contour.path.speeds).any():
            continue
        for output in process.of_contour(contour).analog:
            if output.speed is None and output.rest != output.full:
                raise InvalidInput(
                    f"The analog output {output.name} depends on the assigned velocity, but "
                    f"{contour_called(contour, k)} has none. Specify limits.speed, or a speed for "
                    "the output."
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
    """Compute the values of an analog output at increasing times, (n,).

    - `outputs`: the output of each contour; None for a contour whose process lacks it.
    - `idle`: value while no process works.
    - `t`: times of the plan [s], (n,).
    """
    times = np.asarray(t, dtype=np.float64)
    values = np.full(len(times), float(idle))
    spans = trajectory.contour_spans
    for contour, span, output in zip(program.contours, spans, outputs, strict=True):
        if output is None:
            continue
        process = states.process.of_contour(contour)
        begin, end = _times_on(span, process, trajectory)
        # The output is switched earlier than the tool arrives, by the lead time.
        lead = output.lead_time
        first, last = np.searchsorted(times, [begin - lead, end - lead])
        # Times at which the tool is where the output applies.
        inside = np.clip(times[first:last] + lead, begin, end)
        if len(inside):
            s = trajectory.s(inside) - span.s[0]
            path = contour.path
            speeds = trajectory.s(inside, 1)
            full = output.speed
            if isinstance(path, ShapedPath) and path.curve is not None:
                # On a smooth curve, s is the arc length along arcs that approximate it. Therefore
                # |dx/ds| differs from 1 by a few parts per million.
                speeds = speeds * np.linalg.norm(path(s, 1), axis=1)
            active: FloatArray | float = output.full
            if output.rest != output.full:
                share = speeds / (path.assigned_speeds(limits.speed, s) if full is None else full)
                active = output.rest + (output.full - output.rest) * np.minimum(share, 1.0)
            is_on = states.is_on(process, output, np.clip(inside, *span.t))
            if output.full_s is not None:
                active = active * states.s_words(np.clip(inside, *span.t)) / output.full_s
            values[first:last] = np.where(is_on, active, output.off)
    return values


def _times_on(span: Span, process: Process, trajectory: Trajectory) -> tuple[float, float]:
    """Return the times at which a contour's process is switched on and off [s]."""
    assert span.work is not None
    begin, end = span.work
    if process.begins_on:
        begin = span.t[0] - (0.0 if process.pierce is None else process.pierce.time)
    late_waits = process.waits_at(SWITCHED_ON)
    if late_waits:
        # The last waits before the contour are its own.
        starts = [x.t for x in trajectory.waits if x.t < span.t[0]]
        begin = starts[-len(late_waits)]
    return begin, span.t[1] if process.ends_on else end


class _States:
    """On/off outputs and the word S over a plan's time, without lead times."""

    def __init__(self, trajectory: Trajectory, process: Process) -> None:
        events: dict[str, list[TimedEvent]] = {}
        for event in sorted(trajectory.events, key=lambda x: x.due):
            events.setdefault(event.name, []).append(event)
        # By output: times of its events [s], (n,), and its state before, between and after the
        # events, (n + 1,). The state before the first event is the opposite of its value.
        self.outputs: dict[str, tuple[FloatArray, BoolArray]] = {}
        for name, switchings in events.items():
            if any(isinstance(x.value, bool | np.bool_) for x in switchings):
                dues = np.array([x.due for x in switchings])
                values = [bool(x.value) for x in switchings]
                states = np.array([not values[0], *values])
                self.outputs[name] = (dues, states)
        s_events = events.get(SPINDLE_SPEED, [])
        # Times at which S changes [s], (n,), and S before, between and after them, (n + 1,).
        self._s_words = (
            np.array([x.due for x in s_events]),
            np.array([0.0, *(float(x.value) for x in s_events)]),
        )
        self.process = process
        self.switches = {x.switch.name for x in process.variants if x.switch is not None}
        # Outputs that the drawing switches, such as those of G-code.
        self.outputs_of_drawing = set(self.outputs) - COOLANT
        for variant in process.variants:
            self.outputs_of_drawing -= {x.name for x in variant.events}

    def s_words(self, t: FloatArray) -> FloatArray:
        """Return the G-code word S at increasing times [s]; 0 before the first one."""
        dues, values = self._s_words
        return np.asarray(values[np.searchsorted(dues, t, side="right")])

    def is_on(self, process: Process, output: Analog, t: FloatArray) -> BoolArray:
        """Return whether the process of a contour is on at increasing times t [s], (n,)."""
        switch = process.switch
        names = self.outputs_of_drawing
        if output.follows:
            names = {output.follows}
        elif switch is not None:
            names = names - self.switches | {switch.name}
        is_on = np.ones(len(t), dtype=np.bool_)
        for name in names:
            # An output without events is off at all times.
            dues, values = self.outputs.get(name, ((), np.array([False])))
            is_on &= values[np.searchsorted(dues, t, side="right")]
        return is_on
