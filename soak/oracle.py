"""What printed samples prove of a motion, by intervals: shares nothing with `armcontour check`.

Every printed number stands for an interval, half of its last digit wide to either side. A motion
through any values in these intervals has, between two samples, the mean velocity of the chord, and
over three samples twice the difference of two chords by their common time as a mean acceleration.
Where even the smallest of these means is above the limit, the samples prove a violation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# A proof counts from this part above the limit on, and what is below it by this part is no proof:
# between them floating point decides.
HAIR = 1e-6
# Joints move by this much to tell the direction in which the tool goes [rad].
SMALL = 1e-5


@dataclass(frozen=True)
class Interval:
    """Numbers that are known from `low` to `high`."""

    low: np.ndarray
    high: np.ndarray

    @classmethod
    def around(cls, value, half):
        """Numbers that are off by `half` at most."""
        return cls(value - half, value + half)

    def __sub__(self, other):
        return Interval(self.low - other.high, self.high - other.low)

    def __mul__(self, other):
        ends = [x * y for x in (self.low, self.high) for y in (other.low, other.high)]
        return Interval(np.minimum.reduce(ends), np.maximum.reduce(ends))

    def __truediv__(self, other):
        """Divided by what is above zero; where that may be zero, nothing is known."""
        good = other.low > 0
        safe = np.where(good, other.low, 1.0), np.where(good, other.high, 1.0)
        found = self * Interval(1 / safe[1], 1 / safe[0])
        return Interval(np.where(good, found.low, -np.inf), np.where(good, found.high, np.inf))

    def __getitem__(self, rows):
        return Interval(self.low[rows], self.high[rows])

    @property
    def least(self):
        """The smallest amount that a number may have."""
        return np.maximum(np.maximum(self.low, -self.high), 0.0)


@dataclass(frozen=True)
class Log:
    """Printed samples: t (n, 1), q, dq, ddq (n, dof) as intervals; dq, ddq may be missing."""

    t: Interval
    q: Interval
    dq: Interval | None = None
    ddq: Interval | None = None

    def __len__(self):
        return len(self.t.low)


def proven_velocity(log):
    """Per joint, the largest velocity that the samples prove [rad/s]."""
    best = np.zeros(log.q.low.shape[1])
    if log.dq is not None:
        best = log.dq.least.max(axis=0)
    for k in range(1, len(log)):
        best = np.maximum(best, _chords(log, log.q, k).least.max(axis=0))
    return best


def proven_acceleration(log):
    """Per joint, the largest acceleration that the samples prove [rad/s²]."""
    best = np.zeros(log.q.low.shape[1])
    if log.ddq is not None:
        best = log.ddq.least.max(axis=0)
    for k in range(1, len(log)):
        span = log.t[slice(k, None)] - log.t[slice(None, -k)]
        found = []
        if log.dq is not None:
            found.append(_chords(log, log.dq, k))
            step = log.q[slice(k, None)] - log.q[slice(None, -k)]
            half = Interval(span.low**2 / 2, span.high**2 / 2)
            half = Interval(np.where(span.low > 0, half.low, 0.0), half.high)
            for v in (log.dq[slice(None, -k)], log.dq[slice(k, None)]):
                found.append((step - v * span) / half)
        if 2 * k < len(log):
            chords = _chords(log, log.q, k)
            span = log.t[slice(2 * k, None)] - log.t[slice(None, -2 * k)]
            change = chords[slice(k, None)] - chords[slice(None, -k)]
            found.append(change / Interval(span.low / 2, span.high / 2))
        for x in found:
            best = np.maximum(best, np.nan_to_num(x.least, nan=0.0).max(axis=0))
    return best


def proven_position(log):
    """Per joint, the largest amount of a position that the samples prove [rad]."""
    return log.q.least.max(axis=0)


def proven_speed(log, forward, reach):
    """The smallest and the largest tool speed that the samples may prove [m/s].

    `forward` gives the tool's points (n, dimension), `reach` how far a joint may be from the tool.
    The first number is proven, as a joint that is off by an angle moves the tool by no more than
    the angle times the reach. The second is what exact numbers would prove.
    """
    middle = (log.q.low + log.q.high) / 2
    off = ((log.q.high - log.q.low) / 2 * reach).sum(axis=1)
    points = forward(middle)
    low = high = 0.0
    for k in range(1, len(log)):
        span = log.t[slice(k, None)] - log.t[slice(None, -k)]
        length = np.linalg.norm(points[k:] - points[:-k], axis=1)
        least = np.maximum(length - off[k:] - off[:-k], 0.0)
        low = max(low, float((least / span.high[:, 0]).max()))
        high = max(high, float((length / np.maximum(span.low[:, 0], 1e-300)).max()))
    if log.dq is not None:
        speed, off = _sample_speeds(log, middle, forward, reach)
        low, high = max(low, float((speed - off).max())), max(high, float(speed.max()))
    return low, high


def _sample_speeds(log, q, forward, reach):
    """Tool speeds at the samples, and a bound on their errors [m/s], (n,)."""
    dq = (log.dq.low + log.dq.high) / 2
    # Steps of the same length in joint positions, whatever the velocities.
    step = SMALL / np.maximum(np.abs(dq).max(axis=1), 1e-12)[:, None]
    speed = np.linalg.norm(forward(q + dq * step) - forward(q - dq * step), axis=1)
    angle = ((log.q.high - log.q.low) / 2).sum(axis=1)
    # A joint that is off turns the tool's velocity with it, and moves the axes of those after it.
    off = ((log.dq.high - log.dq.low) / 2 * reach).sum(axis=1)
    off += (
        2 * angle * (np.maximum(np.abs(log.dq.low), np.abs(log.dq.high)) * reach.max()).sum(axis=1)
    )
    return speed / (2 * step[:, 0]), off


def _chords(log, y, k):
    step = y[slice(k, None)] - y[slice(None, -k)]
    return step / (log.t[slice(k, None)] - log.t[slice(None, -k)])


def pmk3s(q):
    """The tool of the paper's arm, (1) [m]."""
    first, both = q[:, 0], q[:, 0] + q[:, 1]
    x = 0.135 + 0.250 * np.sin(first) + 0.215 * np.sin(both)
    return np.column_stack([x, 0.250 * np.cos(first) + 0.215 * np.cos(both)])


def ur5e(q):
    """The flange of a UR5e, from the manufacturer's Denavit-Hartenberg parameters [m]."""
    a = (0.0, -0.425, -0.3922, 0.0, 0.0, 0.0)
    d = (0.1625, 0.0, 0.0, 0.1333, 0.0997, 0.0996)
    alpha = (np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0)
    frame = np.tile(np.eye(4), (len(q), 1, 1))
    for j in range(6):
        c, s, ca, sa = np.cos(q[:, j]), np.sin(q[:, j]), np.cos(alpha[j]), np.sin(alpha[j])
        link = np.zeros((len(q), 4, 4))
        link[:, 0] = np.column_stack([c, -s * ca, s * sa, a[j] * c])
        link[:, 1] = np.column_stack([s, c * ca, -c * sa, a[j] * s])
        link[:, 2] = [0.0, sa, ca, d[j]]
        link[:, 3, 3] = 1.0
        frame = frame @ link
    return frame[:, :3, 3]
