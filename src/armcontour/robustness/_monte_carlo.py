"""The compiled part of robustness: one execution after the other, with its contour error.

Joints respond as in execution, by `servo/_response.py`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import FUSED, compiled
from armcontour.arms._tool_point import Robot, tool_in_plane, tool_in_space, tool_point
from armcontour.robustness._nearest_place import find_nearest
from armcontour.servo._command import SNAP, Cubic, shift
from armcontour.servo._response import Motion, Servo, respond, transition
from armcontour.servo._simulation import Parts, divide, prepare, run_joint

# Command intervals run at a time: their results stay in the processor's nearest memory.
CHUNK = 64
# The tool rests below this speed [m/s], as in `evaluation`, and stands still below that one.
REST_SPEED = 1e-3
STILL_SPEED = 1e-9
# Between two results next to a corner of the path the error is looked at so many times more, since
# it comes to a point there; where the path turns by less than this [rad], its point is blunt.
FINER = 16
CORNER = 1e-3
# How an execution ends.
SETTLED, RESTLESS, STUCK = 0, 1, 2


class Line(NamedTuple):
    """The path.

    Its table, its length if it is closed, else 0, and the arc lengths between which the tool may be
    in every command interval [m].
    """

    table: FloatArray
    around: float
    low: FloatArray
    high: FloatArray


class Clock(NamedTuple):
    """The times [s].

    Time of the first set-point, command interval, results in it, start and end of the time that
    errors cover, and whether that end is fixed; else they go on until the tool rests.
    """

    start: float
    period: float
    steps: int
    begin: float
    finish: float
    fixed: bool


class Drive(NamedTuple):
    """What all robots are told and have in common.

    Commands (dof, n + 1, 4), inertia of 1 kg at the tip over each joint's own (dof, n) [1/kg],
    whether commands are straight, and acceleration bounds (dof,) [rad/s²].
    """

    commands: FloatArray
    inertia: FloatArray
    straight: bool
    lower: FloatArray
    upper: FloatArray


class Rest(NamedTuple):
    """Reach of the arm [m], and the time by which it must have come to rest [s]."""

    reach: float
    patience: float


class Samples(NamedTuple):
    """What differs between robots.

    kp, kv and dead time (samples, dof), payload (samples,) [kg], and by how much set-points are
    late (samples, n or 0) [s].
    """

    kp: FloatArray
    kv: FloatArray
    dead_time: FloatArray
    payload: FloatArray
    jitter: FloatArray


class Found(NamedTuple):
    """Results, (samples,) each.

    RMS and largest error [m], end of the errors [s], saturated share, demand over its limit, and
    how the execution ended.
    """

    rms: FloatArray
    max: FloatArray
    until: FloatArray
    saturated: FloatArray
    demand_ratio: FloatArray
    status: IntArray


class States(NamedTuple):
    """Position, velocity, time in saturation and largest demand over its limit, (dof,) each."""

    q: FloatArray
    w: FloatArray
    saturated: FloatArray
    ratio: FloatArray


class Errors(NamedTuple):
    """Squared errors so far.

    Integral, the last one and the largest one; the tool's last point and its last move; and what
    the sums were at the end of the time that errors cover.
    """

    integral: float
    square: float
    peak: float
    x: float
    y: float
    z: float
    dx: float
    dy: float
    dz: float
    end: float
    end_integral: float
    end_peak: float


@compiled(fastmath=FUSED)
def _load_servo(servo: Servo, load: float, inertia: FloatArray, k: int) -> Servo:
    """The servo under a payload: more inertia and the same torques leave less gain and limit."""
    share = 1 / (1 + load * inertia[min(k, len(inertia) - 1)])
    return Servo(servo.kp, servo.kv * share, servo.lower * share, servo.upper * share)


@compiled(fastmath=FUSED)
def _motion(states: States, j: int, servo: Servo) -> Motion:
    """The motion of a joint so far; smaller demands than before do not count."""
    limit = min(-servo.lower, servo.upper)
    most = states.ratio[j] * limit if limit < math.inf else math.inf
    return Motion(states.q[j], states.w[j], states.saturated[j], -most, most)


@compiled(fastmath=FUSED)
def _keep(m: Motion, servo: Servo, states: States, j: int) -> bool:
    """Write a motion into the states; whether it could be computed."""
    limit = min(-servo.lower, servo.upper)
    states.q[j], states.w[j], states.saturated[j] = m.q, m.w, m.saturated
    states.ratio[j] = max(-m.lowest, m.highest) / limit if limit < math.inf else 0.0
    return math.isfinite(m.q + m.w)


@compiled(fastmath=FUSED)
def _run_evenly(
    servo: Servo,
    drive: Drive,
    parts: Parts,
    load: float,
    j: int,
    begin: int,
    end: int,
    states: States,
    out: FloatArray,
) -> bool:
    """Run a joint through command intervals whose set-points come at even times.

    Writes results into `out`, as `run_joint` does; whether the motion could be computed.
    """
    command, inertia = drive.commands[j], drive.inertia[j]
    if load == 0.0:
        m = run_joint(servo, command, parts, j, begin, end, _motion(states, j, servo), out)
        return _keep(m, servo, states, j)
    steps = parts.width.shape[1] - 1
    for k in range(begin, end):
        loaded = _load_servo(servo, load, inertia, k)
        if not prepare(loaded, drive.straight, parts, j):
            return False
        rows = out[(k - begin) * steps : (k - begin + 1) * steps]
        m = run_joint(loaded, command, parts, j, k, k + 1, _motion(states, j, loaded), rows)
        if not _keep(m, loaded, states, j):
            return False
    return True


@compiled(fastmath=FUSED)
def _play(command: FloatArray, i: int, rate: float, t: float) -> Cubic:
    """The cubic of interval i, played at a rate, from its time t on."""
    b, c, d = command[i, 1] * rate, command[i, 2] * rate**2, command[i, 3] * rate**3
    return shift(Cubic(command[i, 0], b, c, d), t)


@compiled(fastmath=FUSED)
def _run_unevenly(
    servo: Servo,
    drive: Drive,
    clock: Clock,
    dead: float,
    late: FloatArray,
    load: float,
    j: int,
    begin: int,
    end: int,
    states: States,
    out: FloatArray,
) -> bool:
    """As `_run_evenly`, where set-point k comes `dead + late[k]` after its time.

    What the controller does between two set-points it does in the time between them.
    """
    command, inertia = drive.commands[j], drive.inertia[j]
    period, steps = clock.period, clock.steps
    last = len(command) - 1
    now = begin * period
    # The command's interval that holds at `now`; `at - 1` is the set-point that begins it.
    at = min(max(begin - int((dead + late[0]) / period) - 2, 0), last)
    loaded = servo
    m = _motion(states, j, servo)
    for row in range((end - begin) * steps):
        until = begin * period + (row + 1) * (period / steps)
        if load != 0.0:
            _keep(m, loaded, states, j)
            loaded = _load_servo(servo, load, inertia, begin + row // steps)
            m = _motion(states, j, loaded)
        while until - now > SNAP * period:
            come = at * period + dead + late[at] if at < last else math.inf
            if come - now <= SNAP * period:
                at += 1
                continue
            stop = min(until, come)
            if 0 < at < last:
                came = (at - 1) * period + dead + late[at - 1]
                u = _play(command, at, period / (come - came), now - came)
            else:
                u = Cubic(command[at, 0], 0.0, 0.0, 0.0)
            step = transition(loaded.kp, loaded.kv, stop - now, drive.straight)
            m = respond(loaded, step, u, m)
            now = stop
        now = until
        out[row, 0] = m.q
    return _keep(m, loaded, states, j)


@compiled(fastmath=FUSED)
def _sharpen(
    line: Line,
    k: int,
    segment: int,
    x: float,
    y: float,
    z: float,
    d2: float,
    peak: float,
    e: Errors,
) -> float:
    """Largest squared error up to this result, looked at more closely next to a corner.

    The tool's path between them is the parabola through the last three results.
    """
    dx, dy, dz = x - e.x, y - e.y, z - e.z
    moved = math.sqrt(dx * dx + dy * dy + dz * dz)
    if math.sqrt(e.square) + math.sqrt(d2) + moved <= 2 * math.sqrt(peak):
        return peak  # A distance grows no faster than the tool moves.
    for i in range(1, FINER):
        a = i / FINER
        b = a * (a - 1) / 2
        found, _ = find_nearest(
            e.x + a * dx + b * (dx - e.dx),
            e.y + a * dy + b * (dy - e.dy),
            e.z + a * dz + b * (dz - e.dz),
            line.table,
            line.around,
            segment,
            line.low[k],
            line.high[k],
        )
        peak = max(peak, found)
    return peak


@compiled(fastmath=FUSED)
def _add(
    clock: Clock, e: Errors, peak: float, t: float, x: float, y: float, z: float, d2: float
) -> Errors:
    """Add the result at the time t up: the tool's point and its squared distance to the path."""
    h = clock.period / clock.steps
    dx, dy, dz = x - e.x, y - e.y, z - e.z
    end, end_integral, end_peak = e.end, e.end_integral, e.end_peak
    # A result when errors start to count is before that, whatever the rounding of its time says.
    begin = clock.begin + SNAP * h
    if t <= begin:
        # Errors do not count yet.
        return Errors(0.0, d2, 0.0, x, y, z, dx, dy, dz, end, end_integral, end_peak)
    square, width = e.square, h
    if t - h <= begin:
        # The first trapezoid begins between two results.
        width = t - clock.begin
        d = width / h * math.sqrt(e.square) + (1 - width / h) * math.sqrt(d2)
        square = d * d
        peak = max(peak, square)
    if t - h < clock.finish <= t:
        # The last trapezoid ends between two results.
        share = (clock.finish - (t - width)) / width
        d = (1 - share) * math.sqrt(square) + share * math.sqrt(d2)
        end = clock.finish
        end_integral = e.integral + 0.5 * share * width * (square + d * d)
        end_peak = max(e.peak, square, d * d)
    integral = e.integral + 0.5 * width * (square + d2)
    moving = dx * dx + dy * dy + dz * dz > (REST_SPEED * h) ** 2
    if moving and t > clock.finish and not clock.fixed:
        end, end_integral, end_peak = t, integral, peak
    return Errors(integral, d2, peak, x, y, z, dx, dy, dz, end, end_integral, end_peak)


@compiled(fastmath=FUSED)
def _measure(
    robot: Robot,
    line: Line,
    clock: Clock,
    begin: int,
    end: int,
    segment: int,
    places: FloatArray,
    anchors: FloatArray,
    e: Errors,
) -> tuple[int, Errors]:
    """Add the contour errors of some command intervals up.

    Args:
        robot: The arm.
        line: The path.
        clock: The times.
        begin: First interval.
        end: The one after the last.
        segment: That of the last nearest place.
        places: Joint positions at the results, (dof, n, 3).
        anchors: As in `tool_point`.
        e: Errors so far.

    Returns:
        Segment of the nearest place at the end, and the errors.
    """
    h = clock.period / clock.steps
    # Tuples of arrays are taken apart outside of loops: that costs as much as the rest.
    table, around, low, high = line
    planar, rotations, positions, axes, base, tip = robot
    flat = planar[1] > 0.0
    q = np.empty(len(places))
    for row in range((end - begin) * clock.steps):
        for j in range(len(q)):
            q[j] = places[j, row, 0]
        if flat:
            x, y, z = tool_in_plane(planar, q, anchors)
        else:
            x, y, z = tool_in_space(rotations, positions, axes, base, tip, q, anchors)
        k = min(begin + row // clock.steps, len(low) - 1)
        d2, now = find_nearest(x, y, z, table, around, segment, low[k], high[k])
        peak = max(e.peak, d2)
        if now != segment:
            if abs(now - segment) > 1 or table[max(now, segment), 18] > CORNER:
                peak = _sharpen(line, k, segment, x, y, z, d2, peak, e)
            segment = now
        t = clock.start + (begin * clock.steps + row + 1) * h
        e = _add(clock, e, peak, t, x, y, z, d2)
    return segment, e


@compiled(fastmath=FUSED)
def _bound_speed(kp: FloatArray, kv: FloatArray, goal: FloatArray, states: States) -> float:
    """Sum of the largest rates that joints can still take on, once the command rests [rad/s]."""
    total = 0.0
    for j in range(len(goal)):
        e, w = states.q[j] - goal[j], states.w[j]
        # Their energy falls, whether they are saturated or not.
        total += kp[j] * abs(e) if kv[j] == 0.0 else math.sqrt(w * w + kp[j] * kv[j] * e * e)
    return total


@compiled(fastmath=FUSED)
def _advance_joints(
    i: int,
    clock: Clock,
    drive: Drive,
    samples: Samples,
    parts: Parts,
    begin: int,
    end: int,
    states: States,
    places: FloatArray,
) -> bool:
    """Run all joints of a sample through the next command intervals; whether that was possible."""
    s, load = samples, samples.payload[i]
    for j in range(len(drive.commands)):
        servo = Servo(s.kp[i, j], s.kv[i, j], drive.lower[j], drive.upper[j])
        if s.jitter.shape[1]:
            dead, own = s.dead_time[i, j], s.jitter[i]
            done = _run_unevenly(
                servo, drive, clock, dead, own, load, j, begin, end, states, places[j]
            )
        else:
            done = _run_evenly(servo, drive, parts, load, j, begin, end, states, places[j])
        if not done:
            return False
    return True


@compiled(fastmath=FUSED)
def _execute(
    i: int,
    robot: Robot,
    line: Line,
    clock: Clock,
    drive: Drive,
    rest: Rest,
    samples: Samples,
    states: States,
    anchors: FloatArray,
) -> tuple[Errors, int]:
    """Execute one sample; its errors and how it ends."""
    commands, period = drive.commands, clock.period
    dof, knots = len(commands), commands.shape[1] - 1
    kp, kv, dead = samples.kp[i], samples.kv[i], samples.dead_time[i]
    parts = divide(period, clock.steps, dead)
    places = np.empty((dof, CHUNK * clock.steps, 3))
    ready = True
    for j in range(dof):
        servo = Servo(kp[j], kv[j], drive.lower[j], drive.upper[j])
        ready = prepare(servo, drive.straight, parts, j) and ready
        states.q[j] = places[j, 0, 0] = commands[j, 0, 0]
        states.w[j] = states.saturated[j] = states.ratio[j] = 0.0
    x, y, z = tool_point(robot, places[:, 0, 0], anchors)
    d2, segment = find_nearest(x, y, z, line.table, line.around, 0, line.low[0], line.high[0])
    e = Errors(0.0, d2, d2, x, y, z, 0.0, 0.0, 0.0, clock.finish, 0.0, 0.0)
    if not ready:
        return e, STUCK
    # After this interval no command moves any more.
    quiet = knots + int(math.ceil(dead.max() / period)) + 1
    fixed = int(math.ceil((clock.finish - clock.start) / period))
    stop = fixed if clock.fixed else np.iinfo(np.int64).max
    done = 0
    while True:
        end = min(done + CHUNK, stop)
        if not _advance_joints(i, clock, drive, samples, parts, done, end, states, places):
            return e, STUCK
        segment, e = _measure(robot, line, clock, done, end, segment, places, anchors, e)
        done = end
        now = clock.start + done * period
        speed = rest.reach * _bound_speed(kp, kv, commands[:, knots, 0], states)
        if done >= quiet and speed < (STILL_SPEED if clock.fixed else REST_SPEED):
            if now < clock.finish:
                return _finish(e, (clock.finish - now) * e.square), SETTLED
            return e, SETTLED
        if done == stop:
            return e, SETTLED
        if now > rest.patience:
            return e, RESTLESS


@compiled(fastmath=FUSED)
def _finish(e: Errors, more: float) -> Errors:
    """The errors of a tool that stands still to the end, where the integral grows by `more`."""
    integral = e.integral + more
    return Errors(
        integral, e.square, e.peak, e.x, e.y, e.z, e.dx, e.dy, e.dz, e.end, integral, e.peak
    )


@compiled(fastmath=FUSED)
def run(
    robot: Robot,
    line: Line,
    clock: Clock,
    drive: Drive,
    rest: Rest,
    samples: Samples,
    found: Found,
) -> None:
    """Execute samples one after the other.

    Args:
        robot: The arm.
        line: The path.
        clock: The times.
        drive: Commands and bounds.
        rest: When an execution has ended.
        samples: The servos.
        found: Takes the results.
    """
    dof = len(drive.commands)
    states = States(np.empty(dof), np.empty(dof), np.empty(dof), np.empty(dof))
    anchors = np.empty((dof, 3))
    anchors[:, :2], anchors[:, 2] = 0.0, 1.0
    for i in range(len(samples.kp)):
        e, status = _execute(i, robot, line, clock, drive, rest, samples, states, anchors)
        found.rms[i] = math.sqrt(e.end_integral / (e.end - max(clock.begin, 0.0)))
        found.max[i] = math.sqrt(e.end_peak)
        found.until[i] = e.end
        found.saturated[i] = states.saturated.max() / e.end
        found.demand_ratio[i] = states.ratio.max()
        found.status[i] = status
