"""Compiled simulation of joints over command intervals."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._kernels import FUSED, compiled
from armcontour.servo._command import Cubic, divide_interval, shift
from armcontour.servo._response import (
    LARGEST_STEP,
    Motion,
    Servo,
    Step,
    demand,
    fastest_rate,
    progresses,
    respond,
    transition,
)

# Steps may exceed their largest length by rounding errors.
SLACK = 1 - 1e-9


class Joints(NamedTuple):
    """Gains and acceleration bounds of all joints, (dof,) each, as in `Servo`."""

    kp: FloatArray
    kv: FloatArray
    lower: FloatArray
    upper: FloatArray


class Parts(NamedTuple):
    """Parts of a command interval of each joint.

    `number` is the number of parts, (dof,); `width, local, late, due` are as in `divide_interval`,
    (dof, parts); each part is simulated in `repeats` equal steps, (dof, parts), with the free
    motions `steps`, (dof, parts, 11).
    """

    number: IntArray
    width: FloatArray
    local: FloatArray
    late: IntArray
    due: IntArray
    repeats: IntArray
    steps: FloatArray


class Run(NamedTuple):
    """Simulated motion of all joints.

    `states` are position, velocity and demand at n results, (dof, n, 3); the others are time in
    saturation, lowest and highest demand, and True if the motion could not be computed, (dof,).
    """

    states: FloatArray
    saturated: FloatArray
    lowest: FloatArray
    highest: FloatArray
    stuck: BoolArray


@compiled(fastmath=FUSED)
def divide(period: float, steps: int, dead_time: FloatArray) -> Parts:
    """The parts of a command interval, with room for repeats and free motions.

    Args:
        period: Command interval [s].
        steps: Number of results per interval.
        dead_time: Dead time of each joint [s], (dof,).
    """
    dof, most = len(dead_time), steps + 1
    width, local = np.empty((dof, most)), np.empty((dof, most))
    late, due = np.empty((dof, most), np.intp), np.empty((dof, most), np.intp)
    number, repeats = np.empty(dof, np.intp), np.empty((dof, most), np.intp)
    for j in range(dof):
        number[j] = divide_interval(
            period, steps, dead_time[j], width[j], local[j], late[j], due[j]
        )
    return Parts(number, width, local, late, due, repeats, np.empty((dof, most, 11)))


@compiled(inner=True, fastmath=FUSED)
def prepare(servo: Servo, straight: bool, parts: Parts, j: int) -> bool:
    """Compute the free motions of the parts of one joint.

    Args:
        servo: Gains of the joint.
        straight: Whether the command is a straight line in every interval.
        parts: Parts from `divide`; `repeats` and `steps` are written.
        j: Index of the joint, from 0.

    Returns:
        False if the gains are too large to simulate.
    """
    fast = fastest_rate(servo.kp, servo.kv)
    for i in range(parts.number[j]):
        width = parts.width[j, i]
        if not progresses(servo.kp, servo.kv, width):
            return False
        repeats = max(int(math.ceil(width * fast / LARGEST_STEP * SLACK)), 1)
        parts.repeats[j, i] = repeats
        write_step(transition(servo.kp, servo.kv, width / repeats, straight), parts.steps[j, i])
    return True


@compiled(inner=True, fastmath=FUSED)
def write_step(s: Step, row: FloatArray) -> None:
    """Write a free motion into an array, (11,)."""
    row[0], row[1], row[2], row[3], row[4], row[5] = s.time, s.qq, s.qw, s.wq, s.ww, s.q1
    row[6], row[7], row[8], row[9], row[10] = s.q2, s.q3, s.w1, s.w2, s.w3


@compiled(inner=True, fastmath=FUSED)
def run_joint(
    servo: Servo,
    command: FloatArray,
    parts: Parts,
    j: int,
    begin: int,
    end: int,
    motion: Motion,
    out: FloatArray,
) -> Motion:
    """Simulate one joint over command intervals.

    Args:
        servo: Gains and acceleration bounds of the joint.
        command: Command of the joint from `servo.command.polynomials`, (n + 1, 4).
        parts: Parts from `prepare`.
        j: Index of the joint, from 0.
        begin: Index of the first interval; 0 starts at the first set-point.
        end: Index after that of the last interval.
        motion: State at the start.
        out: Output: position, velocity and demand at the results, (n, 3).

    Returns:
        State at the end.
    """
    m = motion
    row = 0
    # numba counts references to arrays in tuples and function arguments at every use, which would
    # double the time: the loop has neither.
    number, _, local, late, due, repeats, x = parts
    last = len(command) - 1
    for k in range(begin, end):
        for i in range(number[j]):
            # The command is constant before the first set-point and after the last one.
            n = min(max(k - late[j, i] + 1, 0), last)
            t = local[j, i] if 0 < n < last else 0.0
            u = shift(Cubic(command[n, 0], command[n, 1], command[n, 2], command[n, 3]), t)
            of_state = x[j, i, 0], x[j, i, 1], x[j, i, 2], x[j, i, 3], x[j, i, 4]
            of_command = x[j, i, 5], x[j, i, 6], x[j, i, 7], x[j, i, 8], x[j, i, 9], x[j, i, 10]
            step = Step(*of_state, *of_command)
            for _ in range(repeats[j, i]):
                m = respond(servo, step, u, m)
                u = shift(u, step.time)
            if due[j, i] == 1:
                out[row, 0], out[row, 1], out[row, 2] = m.q, m.w, demand(servo, u, m.q, m.w)
                row += 1
    return m


@compiled(fastmath=FUSED)
def run_joints(
    joints: Joints,
    commands: FloatArray,
    parts: Parts,
    steps: int,
    begin: int,
    end: int,
    q: FloatArray,
    dq: FloatArray,
) -> Run:
    """Simulate all joints over command intervals.

    Args:
        joints: Gains and acceleration bounds.
        commands: Commands from `servo.command.polynomials`, (dof, n + 1, 4).
        parts: Parts from `prepare_joints`.
        steps: Number of results per interval.
        begin: Index of the first interval; 0 starts at the first set-point.
        end: Index after that of the last interval.
        q: Positions at the start [rad], (dof,).
        dq: Velocities at the start [rad/s], (dof,).
    """
    dof = len(q)
    states = np.empty((dof, (end - begin) * steps, 3))
    saturated, lowest, highest = np.empty(dof), np.empty(dof), np.empty(dof)
    stuck = np.empty(dof, np.bool_)
    for j in range(dof):
        servo = Servo(joints.kp[j], joints.kv[j], joints.lower[j], joints.upper[j])
        m = Motion(q[j], dq[j], 0.0, 0.0, 0.0)
        m = run_joint(servo, commands[j], parts, j, begin, end, m, states[j])
        saturated[j], lowest[j], highest[j] = m.saturated, m.lowest, m.highest
        stuck[j] = not math.isfinite(m.q + m.w)
    return Run(states, saturated, lowest, highest, stuck)


@compiled(fastmath=FUSED)
def prepare_joints(joints: Joints, straight: bool, parts: Parts) -> int:
    """Compute the free motions of all joints; returns the first joint that fails, or -1.

    Args:
        joints: Gains and acceleration bounds.
        straight: Whether the command is a straight line in every interval.
        parts: Parts from `divide`; `repeats` and `steps` are written.
    """
    for j in range(len(joints.kp)):
        servo = Servo(joints.kp[j], joints.kv[j], joints.lower[j], joints.upper[j])
        if not prepare(servo, straight, parts, j):
            return j
    return -1
