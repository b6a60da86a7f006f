"""Compiled simulation of joints under piecewise polynomial commands."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernels import FUSED, compiled
from armcontour.robot.servo.cascade import march_cascade, march_lines
from armcontour.robot.servo.joint_response import (
    LARGEST_STEP,
    Cubic,
    FreeMotionMap,
    Motion,
    Servo,
    advance_freely,
    demand,
    fastest_rate,
    progresses,
    respond,
    shift,
    transition,
)

# Factor for the number of steps in a time span, so that rounding errors do not add a step.
SLACK = 1 - 1e-9
# Times and time spans [s] that differ by less than this are equal; rounding errors are smaller.
NEAR = 4e-12
# Number of cached free motions, and number of columns of one: span, repetitions, and map of a step.
KEPT, COLUMNS = 4, 13


class Joints(NamedTuple):
    """Gains and acceleration bounds of all joints, (rows,) each, as in `Servo`."""

    kp: FloatArray
    kv: FloatArray
    lower: FloatArray
    upper: FloatArray
    ki: FloatArray


class JointMotions(NamedTuple):
    """Simulated motion of all joints."""

    # states: position, velocity and demand at n results, (rows, n, 3). saturated: time in
    # saturation [s]. lowest, highest: extremes of the demand. held: the acceleration or velocity
    # that a drive with a cycle holds at the end; with an integrator the demand. stuck: True if the
    # simulation failed. (rows,) each except for states.

    states: FloatArray
    saturated: FloatArray
    lowest: FloatArray
    highest: FloatArray
    held: FloatArray
    stuck: BoolArray


@compiled(inner=True, fastmath=FUSED)
def piece_at(pieces: FloatArray, starts: FloatArray, piece: int, now: float) -> Cubic:
    """Command in its piece `piece`, with the time origin at `now` [s]."""
    u = Cubic(pieces[piece, 0], pieces[piece, 1], pieces[piece, 2], pieces[piece, 3])
    # The command is constant before the first set-point and after the last one.
    return shift(u, now - starts[piece - 1]) if 0 < piece < len(starts) else u


@compiled(inner=True, fastmath=FUSED)
def write_step(kp: float, kv: float, span: float, straight: bool, row: FloatArray) -> bool:
    """Write span, repetitions and map of a step of a free motion; False if steps are too many."""
    if not progresses(kp, kv, span):
        return False
    repeats = max(int(math.ceil(span * fastest_rate(kp, kv) / LARGEST_STEP * SLACK)), 1)
    s = transition(kp, kv, span / repeats, straight)
    row[0], row[1] = span, repeats
    row[2], row[3], row[4], row[5], row[6], row[7] = s.time, s.qq, s.qw, s.wq, s.ww, s.q1
    row[8], row[9], row[10], row[11], row[12] = s.q2, s.q3, s.w1, s.w2, s.w3
    return True


@compiled(inner=True, fastmath=FUSED)
def march_held(
    servo: Servo,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    m: Motion,
    piece: int,
    out: FloatArray,
) -> Motion:
    """Simulate a joint whose drive holds acceleration or velocity in each piece; as `march`."""
    # `piece` is the number of pieces that have begun at times[0]. The integral changes once per
    # piece, by the equation in `cascade.py`, before the demand is computed.
    q, w, held, saturated, lowest, highest = m
    first, last, now = servo.kv == 0.0, len(starts), times[0]
    kp, kv, ki = servo.kp, servo.kv, servo.ki
    if 0 < piece and starts[piece - 1] > now - NEAR:
        piece -= 1
    z, x, drive_cycle = held, 0.0, starts[1] - starts[0] if last > 1 else 0.0
    if ki > 0.0 and piece > 0:
        # The integral follows from the demand of the last cycle and the position at its start.
        held = min(max(z, servo.lower), servo.upper)
        t = now - starts[piece - 1]
        v = w - t * held
        p = q - t * (w + v) / 2
        x = (z / kv - kp * (pieces[piece, 0] - p) + v) / ki - drive_cycle * (z - held) / kv
    for row in range(1, len(times)):
        until = times[row]
        while until - now > NEAR:
            if piece < last and starts[piece] - now <= NEAR:
                piece += 1
                if first:
                    held, z = kp * (pieces[piece, 0] - q), 0.0
                else:
                    if ki > 0.0:
                        x += drive_cycle * (kp * (pieces[piece, 4] - q) - w)
                    z = kv * (kp * (pieces[piece, 0] - q) - w + ki * x)
                    held = min(max(z, servo.lower), servo.upper)
                    x -= drive_cycle * (z - held) / kv
                lowest, highest = min(lowest, z), max(highest, z)
                continue
            stop = starts[piece] if piece < last and starts[piece] < until - NEAR else until
            h = stop - now
            if first:
                q, w = q + h * held, held
            else:
                q, w = q + h * (w + h / 2 * held), w + h * held
                saturated += h if z != held else 0.0
            now = stop
        now = until
        out[row - 1, 0], out[row - 1, 1], out[row - 1, 2] = q, w, z
    return Motion(q, w, z if ki > 0.0 else held, saturated, lowest, highest)


@compiled(inner=True, allocates=True, fastmath=FUSED)
def march(
    servo: Servo,
    kind: int,
    pieces: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    motion: Motion,
    out: FloatArray,
) -> Motion:
    """Simulate one joint from times[0] on; results are not finite if steps are too short."""
    # kind 0: held or linear commands; 1: cubics; 2: a drive holds its acceleration in each piece;
    # 3: as 0, without saturation, with positions as the only results. An infinite kp means a pure
    # delay. pieces: coefficients of the command, (n + 1, 4), of which the first and the last are
    # constant; with an integrator also of the command v of `cascade.py`, (n + 1, 8). starts: times
    # at which all pieces but the first reach the joint [s], (n,). times: start, and times of the
    # results [s], (m + 1,). out: position, velocity and demand, (m, 3).
    if servo.ki > 0.0 and kind != 2:
        return march_cascade(servo, pieces, starts, times, motion, out)
    m, delays, last, now = motion, math.isinf(servo.kp), len(starts), times[0]
    # Number of pieces that have begun, by bisection.
    piece, high = 0, last
    while piece < high:
        middle = (piece + high) // 2
        if starts[middle] <= now + NEAR:
            piece = middle + 1
        else:
            high = middle
    if kind == 2 and not delays:
        return march_held(servo, pieces, starts, times, m, piece, out)
    cache, oldest = np.empty((KEPT, COLUMNS)), 0
    for i in range(KEPT):
        cache[i, 0] = -1.0
    for row in range(1, len(times)):
        until = times[row]
        u = piece_at(pieces, starts, piece, now)
        while until - now > NEAR:
            if piece < last and starts[piece] - now <= NEAR:
                piece += 1
                u = piece_at(pieces, starts, piece, now)
                continue
            stop = starts[piece] if piece < last and starts[piece] < until - NEAR else until
            span, now, slot = stop - now, stop, -1
            if delays:
                continue
            for i in range(KEPT):
                if abs(cache[i, 0] - span) <= NEAR:
                    slot = i
            if slot < 0:
                slot, oldest = oldest, (oldest + 1) % KEPT
                if not write_step(servo.kp, servo.kv, span, kind != 1, cache[slot]):
                    return Motion(math.nan, math.nan, 0.0, m.saturated, m.lowest, m.highest)
            x = cache[slot]
            step = FreeMotionMap(
                x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11], x[12]
            )
            for _ in range(int(x[1])):
                if kind == 3:
                    q, w = advance_freely(step, u, m.q, m.w)
                    m = Motion(q, w, 0.0, m.saturated, m.lowest, m.highest)
                else:
                    m = respond(servo, step, u, m)
                u = shift(u, step.time)
        now = until
        if delays:
            u, z = piece_at(pieces, starts, piece, now), 0.0
            m = Motion(u.value, u.rate, 0.0, m.saturated, m.lowest, m.highest)
            out[row - 1, 2] = 2 * u.second
        else:
            out[row - 1, 2] = z = demand(servo, u, m.q, m.w)
        out[row - 1, 0], out[row - 1, 1] = m.q, m.w
        m = Motion(m.q, m.w, 0.0, m.saturated, min(m.lowest, z), max(m.highest, z))
    return m


@compiled(fastmath=FUSED)
def run_joints(
    joints: Joints,
    kind: int,
    commands: FloatArray,
    starts: FloatArray,
    times: FloatArray,
    states: FloatArray,
) -> JointMotions:
    """Simulate all joints, or one joint with several sets of parameters, row by row."""
    # kind and pieces as in `march`. commands: (rows, n + 1, 4 or 8). starts: (rows, n) [s]. times:
    # (m + 1,) [s]. states: initial position [rad], velocity [rad/s] and value that a drive holds,
    # (3, rows).
    rows = len(joints.kp)
    out = np.empty((rows, len(times) - 1, 3))
    saturated, lowest, highest, held = np.empty((4, rows))
    stuck = np.empty(rows, np.bool_)
    for j in range(rows):
        bounds = joints.lower[j], joints.upper[j]
        servo = Servo(joints.kp[j], joints.kv[j], bounds[0], bounds[1], joints.ki[j])
        m = Motion(states[0, j], states[1, j], states[2, j], 0.0, 0.0, 0.0)
        if joints.ki[j] > 0.0 and kind == 3:
            m = march_lines(servo, commands[j], starts[j], times, m, out[j])
        else:
            m = march(servo, kind, commands[j], starts[j], times, m, out[j])
        saturated[j], lowest[j], highest[j], held[j] = m.saturated, m.lowest, m.highest, m.held
        stuck[j] = not math.isfinite(m.q + m.w)
    return JointMotions(out, saturated, lowest, highest, held, stuck)
