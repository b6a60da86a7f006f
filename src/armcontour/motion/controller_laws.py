"""How robot controllers interpolate a trajectory's points into commands.

Plants, checks and the command line share `CONTROLLERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import Choice, Frequency
from armcontour.core.quintics import evaluate, quintic, solve_banded
from armcontour.motion.cycle import check_cycle
from armcontour.motion.laws import Law
from armcontour.motion.trajectory import Trajectory

# Intervals of regular points may differ by this fraction, because times are printed with 6 to 12
# digits.
REGULAR = 1e-4
# A time that differs from a cycle by at most this fraction of a cycle counts as on the cycle.
ON_CYCLE = 1e-6
# Largest number of commands, half an hour at 1 kHz. A check of more commands takes gigabytes.
MAX_COMMANDS = 2_000_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InterpolatedLaw(Law):
    """Polynomials of degree 5 or less between points.

    Args:
        breaks: Times of the points, from 0 [s], (n + 1,).
        coefficients: Polynomial coefficients in x, the time in an interval divided by its length,
            (n, 6, dof).
    """

    breaks: FloatArray
    coefficients: FloatArray

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Return the derivative `order` of the positions at `t` [s] of intervals `i`, (n, dof)."""
        width = self.breaks[i + 1] - self.breaks[i]
        return evaluate(self.coefficients[i], width, t - self.breaks[i], order)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CommandCurve(Frozen):
    """The curve, through or near points, from which a controller takes its commands.

    Args:
        controller: Name of the controller in `CONTROLLERS`.
        law: Name of the interpolation, such as "quintics".
        curve: The curve, from its own time 0.
        origin: Time of the curve at which the first point is due [s].
        lag: How much later than its points are due the controller sends the curve [s].
        ahead: How many cycles earlier the controller sends its commands.
    """

    controller: str
    law: str
    curve: Trajectory
    origin: float = 0.0
    lag: float = 0.0
    ahead: int = 0

    def __call__(self, t: FloatArray, order: int = 0) -> FloatArray:
        """Return positions of the curve or a derivative, (n, dof); at rest before and after it.

        Args:
            t: Times since the first point is due [s], (n,).
            order: Order of the derivative.
        """
        inside = np.clip(t + self.origin, 0.0, self.curve.duration)
        values = self.curve(inside, order)
        if order:
            values[inside != t + self.origin] = 0.0
        return values

    @checked
    def commands(self, rate: Frequency) -> tuple[FloatArray, FloatArray]:
        """Return the times [s], (n,), at which the controller sends commands [rad], (n, dof).

        Times count from the start of the trajectory in the controller. The first and the last two
        commands are at rest.

        Args:
            rate: Rate of the controller [1/s].

        Raises:
            InvalidInput: The cycle is too short or too long, or there are too many commands.
        """
        cycle = 1.0 / rate
        check_cycle(cycle)
        delay = self.lag - self.ahead * cycle
        last = np.ceil((self.curve.duration - self.origin + delay) / cycle - ON_CYCLE)
        if last > MAX_COMMANDS:
            raise InvalidInput(
                f"At {rate:g} Hz the trajectory has {last:.0f} commands, but at most "
                f"{MAX_COMMANDS} are supported. Specify a lower rate, or a part of the trajectory."
            )
        t = np.arange(-self.ahead - 1, int(last) + 2) * cycle
        # Times are rounded to 1 ns as in controllers, so a command at the time of a point is not
        # evaluated before this point.
        return np.asarray(t, dtype=np.float64), self(np.round(t - delay, 9))


class Interpolation(NamedTuple):
    """How points become a curve.

    Args:
        law: Name of the interpolation, such as "quintics".
        curve: The curve, from its own time 0.
        origin: Time of the curve at which the first point is due [s].
        lag: How much later than its points are due the controller sends the curve [s].
    """

    law: str
    curve: Trajectory
    origin: float = 0.0
    lag: float = 0.0


class ControllerLaw(NamedTuple):
    """How one controller interpolates.

    Args:
        title: Name of the controller for messages.
        interpolate: Function that interpolates points.
        ahead: How many cycles earlier the controller sends its commands.
    """

    title: str
    interpolate: Callable[[_Points], Interpolation]
    ahead: int = 0


class _Points(NamedTuple):
    """A controller's points: times from 0 [s], (n,), positions and known derivatives, (n, dof)."""

    t: FloatArray
    q: FloatArray
    dq: FloatArray | None
    ddq: FloatArray | None

    @property
    def interval(self) -> float:
        """Length of the first interval [s]."""
        return float(self.t[1])


def _interpolate_jtc(points: _Points) -> Interpolation:
    """Interpolate by quintics with accelerations, cubics with velocities, otherwise lines."""
    q = points.q
    dq = points.dq
    ddq = points.ddq
    if dq is None and ddq is not None:
        raise InvalidInput(
            "joint_trajectory_controller takes no accelerations without velocities. Add velocities "
            "to the points, or remove the accelerations."
        )
    if dq is None:
        return _polynomials("lines", points.t, _powers(q[:-1], np.diff(q, axis=0)))
    if ddq is None:
        return _polynomials("cubics", points.t, _cubics(points.t, q, dq))
    begin = [x[:-1] for x in (q, dq, ddq)]
    end = [x[1:] for x in (q, dq, ddq)]
    return _polynomials("quintics", points.t, quintic(np.diff(points.t), begin, end))


def _interpolate_jtc_spline(points: _Points) -> Interpolation:
    """Interpolate positions by a clamped cubic spline.

    Points with velocities are interpolated as by `_interpolate_jtc`.
    """
    if points.dq is not None:
        return _interpolate_jtc(points)
    dq = _spline_velocities(points.t, points.q)
    return _polynomials("clamped spline", points.t, _cubics(points.t, points.q, dq))


def _interpolate_jtc_none(points: _Points) -> Interpolation:
    """Hold the next point in every interval, after one interval at the first point."""
    t = np.append(0.0, points.t + points.interval)
    held = _polynomials("next point", t, _powers(points.q))
    return held._replace(origin=points.interval)


def _interpolate_linuxcnc(points: _Points) -> Interpolation:
    """Interpolate by the uniform cubic B-spline whose control points are the points.

    The controller has a queue of four points, which is filled with the first point at the start,
    and with the last point at the end. The current interval starts two points before the newest
    point.
    """
    intervals = np.diff(points.t)
    irregular = np.abs(intervals - points.interval) > REGULAR * points.interval
    # The last interval of an exported plan can be shorter; the queue takes the last point in its
    # next cycle.
    if irregular[:-1].any() or intervals[-1] > (1 + REGULAR) * points.interval:
        raise InvalidInput(
            "LinuxCNC takes points at regular times, but the intervals between the points are "
            f"{intervals.min():g} s to {intervals.max():g} s. Sample the trajectory at a fixed "
            "cycle."
        )
    first = points.q[:1]
    last = points.q[-1:]
    control_points = np.concatenate([first, first, points.q, last, last])
    # Positions and velocities of the B-spline at its knots.
    q = (control_points[:-2] + 4 * control_points[1:-1] + control_points[2:]) / 6
    dq = (control_points[2:] - control_points[:-2]) / (2 * points.interval)
    t = np.arange(len(q), dtype=np.float64) * points.interval
    spline = _polynomials("uniform B-spline", t, _cubics(t, q, dq))
    return spline._replace(origin=points.interval, lag=2 * points.interval)


def _interpolate_hold(points: _Points) -> Interpolation:
    """Hold the newest point in every interval."""
    t = np.append(points.t, 2 * points.t[-1] - points.t[-2])
    return _polynomials("held", t, _powers(points.q))


CONTROLLERS: Mapping[str, ControllerLaw] = MappingProxyType(
    {
        "jtc": ControllerLaw("joint_trajectory_controller of ROS 2", _interpolate_jtc, ahead=1),
        "jtc_spline": ControllerLaw(
            "joint_trajectory_controller of ROS 2 with positions_upsampling",
            _interpolate_jtc_spline,
            ahead=1,
        ),
        "jtc_none": ControllerLaw(
            "joint_trajectory_controller of ROS 2 with interpolation_method: none",
            _interpolate_jtc_none,
            ahead=1,
        ),
        "linuxcnc": ControllerLaw(
            "LinuxCNC's cubic interpolation (cubic.c)", _interpolate_linuxcnc
        ),
        "hold": ControllerLaw("a controller that holds the newest point", _interpolate_hold),
    }
)
NAMES = tuple(CONTROLLERS)


@checked
def interpolate_points(points: Any, controller: Annotated[str, Choice(NAMES)]) -> CommandCurve:
    """Return the curve from which a controller takes its commands between points.

    - `jtc`: quintics through points with accelerations, cubics through points with velocities, else
      lines; one cycle ahead
    - `jtc_spline`: clamped cubic spline through points without velocities, else as `jtc`; one cycle
      ahead
    - `jtc_none`: the next point; one cycle ahead
    - `linuxcnc`: the uniform cubic B-spline; two intervals of the points later
    - `hold`: the newest point, when it is due

    Sources: `trajectory.cpp` and `joint_trajectory_controller.cpp` of ros2_controllers 6.9.0
    (94e74de), `cubic.c` of LinuxCNC 2.9.

    Args:
        points: An object with increasing times `t` [s], (n,), and joint positions `q` [rad], (n,
            dof); optionally with `dq` [rad/s] and `ddq` [rad/s²].
        controller: Name of the controller.

    Raises:
        InvalidInput: There are fewer than two points, or the controller does not support them.
    """
    t = _column(points, "t", (None,))
    q = None if t is None else _column(points, "q", (len(t), None))
    if t is None or q is None:
        raise InvalidInput("Points of a controller must have times t and joint positions q.")
    if len(t) < 2 or not (np.diff(t) > 0).all():
        raise InvalidInput("A controller needs at least two points at increasing times.")
    derivatives = {name: _column(points, name, q.shape) for name in ("dq", "ddq")}
    checked_points = _Points(t=np.round(t - t[0], 9), q=q, **derivatives)
    controller_law = CONTROLLERS[controller]
    interpolation = controller_law.interpolate(checked_points)
    return CommandCurve(
        controller=controller,
        law=interpolation.law,
        curve=interpolation.curve,
        origin=interpolation.origin,
        lag=interpolation.lag,
        ahead=controller_law.ahead,
    )


def _column(points: Any, name: str, shape: tuple[int | None, ...]) -> FloatArray | None:
    """Read the attribute `name` of points as finite numbers; None if it is missing."""
    values = getattr(points, name, None)
    if values is None:
        return None
    return checks.shaped(name, checks.check_numbers(name, values), shape)


def _polynomials(law: str, t: FloatArray, coefficients: FloatArray) -> Interpolation:
    """Return the interpolation by polynomials.

    - `law`: name of the interpolation.
    - `t`: times of the breaks [s], (n + 1,).
    - `coefficients`: coefficients as in `InterpolatedLaw`, (n, 6, dof).
    """
    polynomials = InterpolatedLaw(breaks=t, coefficients=coefficients)
    return Interpolation(law, Trajectory(laws=(polynomials,), method=law))


def _powers(*powers: FloatArray) -> FloatArray:
    """Return polynomial coefficients, (n, 6, dof), from those of 1, x, x², ..., (n, dof) each."""
    coefficients = np.zeros((len(powers[0]), 6, powers[0].shape[1]))
    for k, x in enumerate(powers):
        coefficients[:, k] = x
    return coefficients


def _cubics(t: FloatArray, q: FloatArray, dq: FloatArray) -> FloatArray:
    """Return coefficients of cubics with positions and velocities at both ends, (n, 6, dof)."""
    width = np.diff(t)[:, None]
    step = np.diff(q, axis=0)
    begin = dq[:-1] * width
    end = dq[1:] * width
    return _powers(q[:-1], begin, 3 * step - 2 * begin - end, begin + end - 2 * step)


def _spline_velocities(t: FloatArray, q: FloatArray) -> FloatArray:
    """Return the velocities at the points of the cubic spline that rests at both ends, (n, dof).

    A continuous acceleration gives one linear equation per inner point, with the intervals h:
    v[i-1] / h[i-1] + 2 (1 / h[i-1] + 1 / h[i]) v[i] + v[i+1] / h[i]
    = 3 (q[i] - q[i-1]) / h[i-1]² + 3 (q[i+1] - q[i]) / h[i]².
    """
    v = np.zeros_like(q)
    inverse = 1 / np.diff(t)
    if len(t) > 2:
        slopes = 3 * np.diff(q, axis=0) * inverse[:, None] ** 2
        right_side = np.ascontiguousarray(slopes[:-1] + slopes[1:])
        bands = np.stack([2 * (inverse[:-1] + inverse[1:]), inverse[1:]], axis=1)
        solve_banded(bands, right_side)
        v[1:-1] = right_side
    return v
