"""The command of a joint servo: set-points interpolated by polynomials, delayed by dead time.

The dead time shifts the command in continuous time.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.servo.model import ServoModel, lead_of, sliding

# Times closer to a set-point than this, in command intervals, count as the set-point's time.
SNAP = 1e-9


def polynomials(q: FloatArray, period: float, servo: ServoModel) -> FloatArray:
    """The command in each interval, as a cubic in the time since the interval's start.

    It is the command to which a servo without feed-forward and friction responds in the same way:
    what these add is a part of it. Interval k lies between set-points k - 1 and k. The first
    interval is before all set-points and the last after them; the command is constant there.

    Args:
        q: Set-points [rad], (n, dof).
        period: Command interval [s].
        servo: Servo model; its interpolation, feed-forward and friction count, but no cycle.

    Returns:
        Coefficients [rad, rad/s, rad/s², rad/s³], (dof, n + 1, 4).
    """
    command, first, second = command_and_rates(q, period, servo.interpolation)
    if servo.has_feedforward:
        a, b = (np.broadcast_to(x, q.shape[1:])[:, None, None] for x in servo.lead)
        command += a * first + b * second
    if servo.friction.any():
        command[:, 1:-1, 0] -= np.broadcast_to(servo.friction, q.shape[1:])[:, None] * sliding(
            np.diff(q, axis=0).T / period
        )
    return command


def cycle_commands(
    pieces: FloatArray, period: float, servo: ServoModel, first: int, count: int
) -> FloatArray:
    """The commands that drives with a cycle hold [rad], with feed-forward and friction.

    Args:
        pieces: Coefficients of the command from `command_and_rates`, (dof, n + 1, 4).
        period: Command interval [s].
        servo: Servo model with values per joint and a cycle.
        first: The first cycle; cycle 0 begins at the first set-point.
        count: Number of cycles.

    Returns:
        Commands, (dof, count).
    """
    times = np.asarray((first + np.arange(-2, count)) * servo.cycle, np.float64)
    u = sample_command(pieces, period, servo.dead_time, times).T
    return cycle_feedforward(u, servo.cycle, servo)


def cycle_feedforward(u: FloatArray, cycle: float, servo: ServoModel | JointServo) -> FloatArray:
    """Commands of cycles with feed-forward and friction, from those of two more before.

    Args:
        u: Commands [rad], (rows, count + 2).
        cycle: Cycle [s].
        servo: Parameters of all rows.

    Returns:
        Commands [rad], (rows, count).
    """
    du, ddu = np.diff(u, axis=1)[:, 1:] / cycle, np.diff(u, 2, axis=1) / cycle**2
    a, b, c = (np.broadcast_to(x, len(u))[:, None] for x in (*servo.lead, servo.friction))
    return np.asarray(u[:, 2:] + a * du + b * ddu - c * sliding(du))


class JointServo(NamedTuple):
    """Parameters of the servo of one joint, as in `ServoModel`; numbers, or arrays (rows,)."""

    kp: Any
    kv: Any = np.inf
    velocity_feedforward: Any = 0.0
    acceleration_feedforward: Any = 0.0
    dead_time: Any = 0.0
    acceleration_limit: Any = np.inf
    friction: Any = 0.0

    @property
    def lead(self) -> tuple[FloatArray, FloatArray]:
        """As `ServoModel.lead`."""
        feed = self.velocity_feedforward, self.acceleration_feedforward
        return lead_of(self.kp, self.kv, *feed)


class LoggedCommand:
    """The command of one joint in a log, at any times.

    Args:
        t: Times of the set-points [s], increasing, (n,).
        u: Set-points [rad], (n,).
        interpolation: "linear" or "step".
    """

    def __init__(self, t: FloatArray, u: FloatArray, interpolation: str = "linear") -> None:
        self.t, self.u, self.linear = np.array(t), np.array(u), interpolation == "linear"
        width = np.diff(t)
        chord = np.diff(u) / width
        self.pieces = np.zeros((len(t) + 1, 4))
        self.pieces[:, 0] = np.append(u[0], u)
        self.rate, self.bend = np.zeros((2, len(t) + 1))
        if self.linear:
            self.pieces[1:-1, 1] = self.rate[1:-1] = chord
            self.bend[2:-1] = np.diff(chord) / width[1:]
        else:
            self.rate[2:] = chord
        self.slide = sliding(self.rate)

    def for_servo(self, servo: JointServo, rows: int) -> FloatArray:
        """Pieces with feed-forward and friction of some servos, (rows, n + 1, 4)."""
        found = np.tile(self.pieces, (rows, 1, 1))
        a, b, c = (np.broadcast_to(x, rows)[:, None] for x in (*servo.lead, servo.friction))
        found[:, :, 0] += a * self.rate + b * self.bend - c * self.slide
        return found

    def at(self, t: FloatArray) -> FloatArray:
        """The command at some times [rad]."""
        if self.linear:
            return np.interp(t, self.t, self.u)
        k = np.searchsorted(self.t, t + SNAP * 1e-3, side="right") - 1
        return np.asarray(self.u[np.maximum(k, 0)])


def command_and_rates(
    q: FloatArray, period: float, interpolation: str
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The command without feed-forward, its velocity and its acceleration, as in `ServoModel`.

    Args:
        q: Set-points [rad], (n, dof).
        period: Command interval [s].
        interpolation: As in `ServoModel`.

    Returns:
        Coefficients of the three in the intervals of `polynomials`, (dof, n + 1, 4) each.
    """
    n, dof = q.shape
    found = np.zeros((3, dof, n + 1, 4))
    command, first, second = found
    command[:, 0, 0] = q[0]
    command[:, 1:, 0] = q.T
    if n == 1:
        return command, first, second
    inner = slice(1, -1)
    chord = np.diff(q, axis=0).T / period
    before = np.concatenate([np.zeros((dof, 1)), chord[:, :-1]], axis=1)
    if interpolation == "step":
        first[:, inner, 0] = before
    elif interpolation == "linear":
        command[:, inner, 1] = first[:, inner, 0] = chord
        second[:, inner, 0] = (chord - before) / period
    else:
        slope = np.zeros_like(q.T)
        slope[:, 1:-1] = (q[2:] - q[:-2]).T / (2 * period)
        start, end = slope[:, :-1], slope[:, 1:]
        command[:, inner, 1] = start
        command[:, inner, 2] = (3 * chord - 2 * start - end) / period
        command[:, inner, 3] = (start + end - 2 * chord) / period**2
        first[:, :, :3] = command[:, :, 1:] * [1, 2, 3]
        second[:, :, :2] = first[:, :, 1:3] * [1, 2]
    return command, first, second


def sample_command(
    pieces: FloatArray, period: float, dead_time: FloatArray, t: FloatArray
) -> FloatArray:
    """The delayed command that reaches the joints' servos at given times [rad], (len(t), dof).

    Args:
        pieces: Coefficients from `polynomials`, (dof, n + 1, 4).
        period: Command interval [s].
        dead_time: Dead time of each joint [s], (dof,).
        t: Times since the first set-point [s].
    """
    found = np.empty((len(t), len(pieces)))
    for j, own in enumerate(pieces):
        at = (t - dead_time[j]) / period
        k = np.clip(np.floor(at + SNAP), -1, len(own) - 2).astype(np.intp)
        # The command is constant in the first and the last interval.
        x = np.where((k < 0) | (k > len(own) - 3), 0.0, np.maximum(at - k, 0.0) * period)
        a = own[k + 1]
        found[:, j] = a[:, 0] + x * (a[:, 1] + x * (a[:, 2] + x * a[:, 3]))
    return found


def command_weights(
    count: int, period: float, interpolation: str, t: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Weights of the set-points in the command without dead time and feed-forward.

    Args:
        count: Number of set-points.
        period: Command interval [s].
        interpolation: As in `ServoModel`.
        t: Times since the first set-point [s], (n,).

    Returns:
        Indices of four set-points, which may repeat, and their weights, (n, 4) each.
    """
    at = np.clip(t / period, 0.0, count - 1)
    k = np.minimum(np.floor(at + SNAP), max(count - 2, 0)).astype(np.intp)
    x = np.clip(at - k, 0.0, 1.0)
    index = np.clip(k[:, None] + np.arange(-1, 3), 0, count - 1)
    weight = np.zeros((len(t), 4))
    if interpolation != "cubic":
        # The last set-point is reached at the end of the last interval.
        end = x if interpolation == "linear" else (x >= 1 - SNAP).astype(np.float64)
        weight[:, 1], weight[:, 2] = 1 - end, end
        return index, weight
    end = x * x * (3 - 2 * x)
    weight[:, 1], weight[:, 2] = 1 - end, end
    # The slopes at the first and the last set-point are 0.
    slope = np.where(k > 0, x * (1 - x) ** 2, 0.0) / 2
    weight[:, 0] -= slope
    weight[:, 2] += slope
    slope = np.where(k < count - 2, -x * x * (1 - x), 0.0) / 2
    weight[:, 1] -= slope
    weight[:, 3] += slope
    return index, weight
