"""Compiled simulation of one robot and its contour error; `march` simulates the joints."""

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

# Number of cycles per block, so that the results of a block fit in the processor's cache.
CHUNK = 64
# The RMS error is evaluated until the tool is slower than this [m/s], as in `contour_errors`.
REST_SPEED = 1e-3
# The execution ends when the tool is slower than this [m/s].
STILL_SPEED = 1e-9
# The contour error is evaluated at FINE_STEPS steps between two results if it can have a peak
# there, at a corner of the path or next to a result whose squared error exceeds the share
# PEAK_SHARE of the largest one. A vertex is a corner if the tangent turns by more than LEAST_CORNER
# [rad].
FINE_STEPS = 16
LEAST_CORNER = 1e-3
PEAK_SHARE = 0.96
# Approximate bound of the factor by which the speed of a joint with an integrator can grow.
SPEED_GROWTH = 10.0
# Times that differ by less than this share of the time between results are equal.
SNAP = 1e-9


class SearchedPath(NamedTuple):
    """The path, and the range of arc lengths in which the nearest point is searched."""

    rows: FloatArray  # The segments in the form of `pack_arcs`, (segments, 15)
    corners: FloatArray  # Turn of the tangent at the start of each segment [rad], (segments,)
    around: float  # Length of a closed path [m]; 0 for an open path
    low: FloatArray  # Smallest possible arc length of the tool in each cycle [m]
    high: FloatArray  # Largest possible arc length of the tool in each cycle [m]


class Clock(NamedTuple):
    """Times of an execution and of the evaluation of errors."""

    start: float  # Time of the first set-point [s]
    cycle: float  # Time between two set-points [s]
    steps: int  # Number of results per cycle
    begin: float  # Start of the evaluation of errors [s]
    finish: float  # End of the evaluation, or if not `fixed` its earliest end [s]
    # fixed: if False, the largest error is evaluated until the joints are at rest, and the RMS
    # until the tool is slower than REST_SPEED.
    fixed: bool
    patience: float  # Time at which an execution ends if it has not come to rest [s]


class Setting(NamedTuple):
    """Data that all robots have in common."""

    robot: FloatArray  # Parameters of the links, `link_table` of the arm
    reach: float  # Largest distance of the tool from a joint [m]
    line: SearchedPath
    clock: Clock
    kind: int  # Kind of interpolation of the commands, see `march`
    # inertia: inertia of 1 kg at the tool divided by the inertia of each joint [1/kg], (dof, n).
    inertia: FloatArray
    lower: FloatArray  # Lower acceleration bounds [rad/s²], (dof,)
    upper: FloatArray  # Upper acceleration bounds [rad/s²], (dof,)


class Sample(NamedTuple):
    """The parameters of one robot."""

    kp: FloatArray  # Gains of the position loops [1/s], (dof,)
    kv: FloatArray  # Gains of the velocity loops [1/s], (dof,); 0 for order "first"
    ki: FloatArray  # Integral gains [1/s], (dof,); 0 without an integrator
    load: float  # Additional mass at the tool [kg]
    commands: FloatArray  # Polynomials of the commands, see `march`, (dof, n + 1, 4 or 8)
    starts: FloatArray  # Times at which the set-points reach the joints [s], (dof, n)


class Errors(NamedTuple):
    """Accumulated contour errors of one execution."""

    integral: float  # Integral of the squared error over time [m² s]
    square: float  # Squared error at the last result [m²]
    peak: float  # Largest squared error [m²]
    tool: Point  # Tool point at the last result [m]
    moved: Point  # Displacement of the tool from the result before it [m]
    end: float  # End of the evaluation of errors [s]
    end_integral: float  # `integral` at this end [m² s]
    end_peak: float  # `peak` at this end [m²]


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
    """Accumulate contour errors over `size` cycles; returns the nearest segment and the errors."""
    # segment: segment of the last nearest point, at which the search starts.
    # Tuples of arrays are unpacked outside of the loop, because unpacking is slow.
    line, clock = setting.line, setting.clock
    rows, corners, around, low, high = line
    h, q = clock.cycle / clock.steps, np.empty(len(results))
    # Results up to this time are not evaluated; the tolerance allows for rounding errors.
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
        # The distance to the path grows at most as fast as the tool moves. So between the results
        # it is at most half the sum of the distances at both results and the displacement of the
        # tool.
        higher = math.sqrt(last) + math.sqrt(d2) + math.sqrt(far2) > 2 * math.sqrt(peak)
        turned = now != segment and (
            abs(now - segment) > 1 or corners[max(now, segment)] > LEAST_CORNER
        )
        passed = last >= d2 and last > PEAK_SHARE * e.peak and t - 2 * h > counted
        if higher and (turned or passed):
            # Between the results, the tool is on the parabola through the last three tool points.
            for i in range(1 - FINE_STEPS if passed else 1, FINE_STEPS):
                a = i / FINE_STEPS
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
            # Errors before the start of the evaluation are discarded.
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
    """Simulate all joints over `size` cycles; returns a bound of the later joint speeds [rad/s]."""
    # The bound of the sum of all later joint speeds is valid if the command is constant. NaN is
    # returned if the simulation makes no progress.
    clock, total = setting.clock, 0.0
    steps, count = clock.steps, size * clock.steps
    times = np.empty(count + 1)
    for i in range(len(times)):
        times[i] = begin * clock.cycle + i * (clock.cycle / steps)
    # Because a payload adds inertia, K_v and the acceleration limits are reduced in every cycle.
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
        # The energy of a joint decreases with and without saturation, which bounds its speed.
        offset, w = states[j, 0] - sample.commands[j, -1, 0], states[j, 1]
        if ki > 0.0:
            # An integrator can supply energy, so the bound is larger.
            rate = max(kv, math.sqrt(kv * (kp + ki)))
            total += SPEED_GROWTH * (abs(w) + rate * abs(offset) + abs(states[j, 4]) / rate)
        elif kv > 0.0:
            total += math.sqrt(w * w + kp * kv * offset * offset)
        elif offset != 0.0:
            total += kp * abs(offset)
    return total


@compiled(fastmath=FUSED)
def simulate_sample(setting: Setting, sample: Sample) -> tuple[float, float, float, float, float]:
    """Execute set-points: RMS and largest contour error [m], end [s], saturation, demand."""
    # Other results: end of the evaluation of errors, share of this time in saturation, and largest
    # ratio of demand to its limit. The RMS is NaN if the simulation makes no progress, because the
    # servo requires time steps that are too short.
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
    # quiet: cycle from which all commands are constant.
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
    # If the tool rests before the end of the evaluation, its error remains constant.
    integral = e.integral + resting * e.square if resting > 0.0 else e.end_integral
    # The largest error includes the time after `end`, because a slow tool can still leave the path.
    peak = e.end_peak if clock.fixed and resting == 0.0 else e.peak
    rms = math.sqrt(integral / (e.end - max(clock.begin, 0.0)))
    return rms, math.sqrt(peak), e.end, states[:, 2].max() / e.end, states[:, 3].max()
