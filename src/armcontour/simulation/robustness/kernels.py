"""Compiled simulation of one robot with its contour error; joints respond by `march`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import FUSED, compiled
from armcontour.geometry.kernels import Point, search_along
from armcontour.robot.kernels import tool_point
from armcontour.robot.servo.joint_response import Motion, Servo
from armcontour.robot.servo.march import march

# Number of cycles per block: their results fit in the processor's cache.
CHUNK = 64
# The tool is at rest below the first speed [m/s], as in `evaluation`; below the second one it no
# longer moves.
REST_SPEED = 1e-3
STILL_SPEED = 1e-9
# Between two results next to a corner of the path the contour error has a sharp peak, so it is
# evaluated at this many finer steps, as it is next to results near the largest squared error. A
# vertex that turns by less than CORNER [rad] is no corner.
FINER = 16
CORNER = 1e-3
NEAR_PEAK = 0.96
# Approximate largest factor by which a joint with an integrator accelerates before it rests.
OVERSHOOT = 10.0
# Times that differ by less than this many intervals between results are equal.
SNAP = 1e-9


class SearchedPath(NamedTuple):
    """The path."""

    rows: FloatArray  # The segments, as `nearest.pack` packs them
    corners: FloatArray  # Turn at the vertex before each segment [rad], (segments,)
    around: float  # Length of a closed path [m]; 0 for an open one
    # low, high: smallest and largest possible arc length of the tool, per cycle [m].
    low: FloatArray
    high: FloatArray


class Clock(NamedTuple):
    """The times of an execution."""

    start: float  # Time of the first set-point [s]
    cycle: float  # Cycle [s]
    steps: int  # Number of results per cycle
    begin: float  # Start of the time over which errors are evaluated [s]
    finish: float  # End of that time [s]
    # True if this end is fixed; otherwise largest errors are evaluated until the joints rest, and
    # root mean squares until the tool is slower than `REST_SPEED`.
    fixed: bool
    patience: float  # Time at which an execution ends that does not come to rest [s]


class Setting(NamedTuple):
    """Data shared by all robots."""

    robot: FloatArray  # Numbers of the links, as `arm.link_table` has them
    reach: float  # Largest distance of the tool from a joint [m]
    line: SearchedPath
    clock: Clock
    kind: int  # Kind of the commands, as in `march`
    # Inertia of 1 kg at the tool relative to the joint's inertia, (dof, n) [1/kg].
    inertia: FloatArray
    # lower, upper: acceleration bounds [rad/s²], (dof,).
    lower: FloatArray
    upper: FloatArray


class Sample(NamedTuple):
    """The parameters of one robot."""

    # kp, kv, ki: servo gains [1/s], (dof,); kv is 0 for a servo of first order, and ki without
    # integrator.
    kp: FloatArray
    kv: FloatArray
    ki: FloatArray
    load: float  # Additional mass at the tool [kg]
    commands: FloatArray  # Polynomials of the commands, as in `march`, (dof, n + 1, 4 or 8)
    starts: FloatArray  # Times of the set-points at the joints [s], (dof, n)


class Errors(NamedTuple):
    """Accumulated contour errors of one execution."""

    integral: float  # Integral of the squared error over time [m² s]
    # square, peak: last and largest squared error [m²].
    square: float
    peak: float
    tool: Point  # Last tool point [m]
    moved: Point  # Last displacement of the tool [m]
    end: float  # End of the time over which errors are evaluated [s]
    # end_integral, end_peak: integral and largest squared error at that time.
    end_integral: float
    end_peak: float


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _measure(
    setting: Setting,
    begin: int,
    size: int,
    segment: int,
    results: FloatArray,
    anchors: FloatArray,
    e: Errors,
) -> tuple[int, Errors]:
    """Accumulate the contour errors of some cycles."""
    # Returns segment of the last nearest point, and the accumulated errors.
    # Tuples of arrays are unpacked outside of the loop because unpacking is slow.
    line, clock = setting.line, setting.clock
    rows, corners, around, low, high = line
    h, q = clock.cycle / clock.steps, np.empty(len(results))
    # A result at the start of the evaluated time belongs to the time before, despite rounding.
    counted = clock.begin + SNAP * h
    for row in range(size * clock.steps):
        for j in range(len(q)):
            q[j] = results[j, row, 0]
        p = tool_point(setting.robot, q, anchors)
        k = min(begin + row // clock.steps, len(low) - 1)
        d2, now = search_along(p, rows, around, segment, low[k], high[k])
        t = clock.start + (begin * clock.steps + row + 1) * h
        dx, dy, dz = p[0] - e.tool[0], p[1] - e.tool[1], p[2] - e.tool[2]
        far2, last, peak = dx * dx + dy * dy + dz * dz, e.square, max(e.peak, d2)
        # The distance to the path grows at most as fast as the tool moves.
        higher = math.sqrt(last) + math.sqrt(d2) + math.sqrt(far2) > 2 * math.sqrt(peak)
        turned = now != segment and (abs(now - segment) > 1 or corners[max(now, segment)] > CORNER)
        passed = last >= d2 and last > NEAR_PEAK * e.peak and t - 2 * h > counted
        if higher and (turned or passed):
            # Between the results the tool follows the parabola through the last three results.
            for i in range(1 - FINER if passed else 1, FINER):
                a = i / FINER
                b = a * (a - 1) / 2
                between = (
                    e.tool[0] + a * dx + b * (dx - e.moved[0]),
                    e.tool[1] + a * dy + b * (dy - e.moved[1]),
                    e.tool[2] + a * dz + b * (dz - e.moved[2]),
                )
                between2, _ = search_along(between, rows, around, segment, low[k], high[k])
                peak = max(peak, between2)
        segment, moved = now, (dx, dy, dz)
        end, end_integral, end_peak = e.end, e.end_integral, e.end_peak
        if t <= counted:
            # Errors before the evaluated time are ignored.
            e = Errors(0.0, d2, 0.0, p, moved, end, end_integral, end_peak)
            continue
        width = h
        if t - h <= counted:
            # The first trapezoid begins between two results.
            width = t - clock.begin
            last = (width / h * math.sqrt(last) + (1 - width / h) * math.sqrt(d2)) ** 2
            peak = max(peak, last)
        if t - h < clock.finish <= t:
            # The last trapezoid ends between two results.
            fraction = (clock.finish - (t - width)) / width
            final = ((1 - fraction) * math.sqrt(last) + fraction * math.sqrt(d2)) ** 2
            end = clock.finish
            end_integral = e.integral + 0.5 * fraction * width * (last + final)
            end_peak = max(e.peak, last, final)
        integral = e.integral + 0.5 * width * (last + d2)
        if far2 > (REST_SPEED * h) ** 2 and t > clock.finish and not clock.fixed:
            end, end_integral, end_peak = t, integral, peak
        e = Errors(integral, d2, peak, p, moved, end, end_integral, end_peak)
    return segment, e


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _advance_joints(
    setting: Setting, sample: Sample, begin: int, size: int, states: FloatArray, results: FloatArray
) -> float:
    """Simulate all joints of a robot over cycles."""
    # Returns A bound on the sum of all later joint velocities once the command is constant [rad/s];
    # NaN if the simulation makes no progress.
    clock, total = setting.clock, 0.0
    steps, count = clock.steps, size * clock.steps
    times = np.empty(count + 1)
    for i in range(len(times)):
        times[i] = begin * clock.cycle + i * (clock.cycle / steps)
    # A payload adds inertia at the same torque, which reduces gain and limits in every cycle.
    chunk = count if sample.load == 0.0 else steps
    for j in range(len(states)):
        kp, kv, ki, scale = sample.kp[j], sample.kv[j], sample.ki[j], 1.0
        for first in range(0, count, chunk):
            if sample.load != 0.0:
                k = min(begin + first // steps, setting.inertia.shape[1] - 1)
                scale = 1 / (1 + sample.load * setting.inertia[j, k])
            servo = Servo(kp, kv * scale, setting.lower[j] * scale, setting.upper[j] * scale, ki)
            limited = servo.upper < math.inf
            lowest = states[j, 3] * servo.lower if limited else -math.inf
            highest = states[j, 3] * servo.upper if limited else math.inf
            m = march(
                servo,
                setting.kind,
                sample.commands[j],
                sample.starts[j],
                times[first : first + chunk + 1],
                Motion(
                    states[j, 0], states[j, 1], scale * states[j, 4], states[j, 2], lowest, highest
                ),
                results[j, first : first + chunk],
            )
            if not math.isfinite(m.q + m.w):
                return math.nan
            states[j, 0], states[j, 1], states[j, 2] = m.q, m.w, m.saturated
            states[j, 4] = m.held / scale
            states[j, 3] = max(m.lowest / servo.lower, m.highest / servo.upper) if limited else 0.0
        # The energy of a joint decreases, whether the joint is saturated or not.
        offset, w = states[j, 0] - sample.commands[j, -1, 0], states[j, 1]
        if ki > 0.0:
            # An integrator supplies energy, too.
            rate = max(kv, math.sqrt(kv * (kp + ki)))
            total += OVERSHOOT * (abs(w) + rate * abs(offset) + abs(states[j, 4]) / rate)
        elif kv > 0.0:
            total += math.sqrt(w * w + kp * kv * offset * offset)
        elif offset != 0.0:
            total += kp * abs(offset)
    return total


@compiled(fastmath=FUSED)
def simulate_sample(setting: Setting, sample: Sample) -> tuple[float, float, float, float, float]:
    """Execute set-points: RMS and largest contour error [m], end [s], saturation, demand."""
    # The end is that of the time over which errors are evaluated; saturation is a fraction of this
    # time, and the demand the largest one over its limit. The RMS is NaN if time steps as short as
    # the servo needs make no progress.
    line, clock, dof = setting.line, setting.clock, len(sample.commands)
    cycle, knots = clock.cycle, sample.commands.shape[1] - 1
    anchors, states = np.zeros((dof, 3)), np.zeros((dof, 5))
    anchors[:, 2] = 1.0
    results, delay = np.empty((dof, CHUNK * clock.steps, 3)), 0.0
    for j in range(dof):
        states[j, 0] = results[j, 0, 0] = sample.commands[j, 0, 0]
        delay = max(delay, sample.starts[j, 0])
    p = tool_point(setting.robot, results[:, 0, 0], anchors)
    d2, segment = search_along(p, line.rows, line.around, 0, line.low[0], line.high[0])
    e = Errors(0.0, d2, d2, p, (0.0, 0.0, 0.0), clock.finish, 0.0, 0.0)
    # From this cycle on all commands are constant.
    quiet = knots + int(math.ceil(delay / cycle)) + 1
    fixed = int(math.ceil((clock.finish - clock.start) / cycle))
    stop = fixed if clock.fixed else np.iinfo(np.int64).max
    done, resting = 0, 0.0
    while True:
        size = min(CHUNK, stop - done)
        speed = _advance_joints(setting, sample, done, size, states, results)
        if math.isnan(speed):
            return math.nan, math.nan, e.end, 0.0, 0.0
        segment, e = _measure(setting, done, size, segment, results, anchors, e)
        done += size
        now = clock.start + done * cycle
        if done >= quiet and setting.reach * speed < STILL_SPEED:
            resting = max(clock.finish - now, 0.0)
            break
        if done == stop or now > clock.patience:
            break
    # A tool that rests before the end of the time keeps its error.
    integral = e.integral + resting * e.square if resting > 0.0 else e.end_integral
    # A tool that is slower than REST_SPEED can still leave the path.
    peak = e.end_peak if clock.fixed and resting == 0.0 else e.peak
    rms = math.sqrt(integral / (e.end - max(clock.begin, 0.0)))
    return rms, math.sqrt(peak), e.end, states[:, 2].max() / e.end, states[:, 3].max()
