"""Compiled executions of many robots, each with its contour error; joints respond by `march`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import FUSED, compiled
from armcontour.arms._tool_point import Robot, tool_in_plane, tool_in_space, tool_point
from armcontour.robustness._nearest_place import find_nearest
from armcontour.servo._response import Motion, Servo
from armcontour.servo._simulation import march

# Number of command intervals simulated at a time: their results fit in the processor's cache.
CHUNK = 64
# The tool is at rest below the first speed [m/s], as in `evaluation`; below the second one it no
# longer moves.
REST_SPEED = 1e-3
STILL_SPEED = 1e-9
# Between two results next to a corner of the path the contour error has a sharp peak, so it is
# evaluated at this many finer steps. A vertex with a smaller turn than CORNER [rad] is no corner.
FINER = 16
CORNER = 1e-3
# Times that differ by less than this many intervals between results are equal.
SNAP = 1e-9


class Line(NamedTuple):
    """The path.

    Attributes:
        table: The segments, as `monte_carlo._table` packs them.
        around: Length of a closed path [m]; 0 for an open one.
        low, high: Smallest and largest arc length at which the tool can be, per command interval
            [m].
    """

    table: FloatArray
    around: float
    low: FloatArray
    high: FloatArray


class Clock(NamedTuple):
    """The times of an execution.

    Attributes:
        start: Time of the first set-point [s].
        period: Command interval [s].
        steps: Number of results per command interval.
        finish: End of the time over which errors are evaluated [s].
        fixed: Whether this end is fixed; otherwise largest errors are evaluated until the joints
            rest, and root mean squares until the tool is slower than `REST_SPEED`.
    """

    start: float
    period: float
    steps: int
    begin: float
    finish: float
    fixed: bool


class Drive(NamedTuple):
    """The commands and the properties that all robots share.

    Attributes:
        commands: Polynomials of the commands, (dof, n + 1, 4).
        rates, bends: What feed-forward adds to them, times `kp` and `kp kv` (`kp` for a servo of
            first order); (dof, 0, 4) without.
        inertia: Inertia of 1 kg at the tool over each joint's own, (dof, n) [1/kg].
        kind: Kind of the commands, as in `march`.
        lower, upper: Acceleration bounds [rad/s²], (dof,).
    """

    commands: FloatArray
    rates: FloatArray
    bends: FloatArray
    inertia: FloatArray
    kind: int
    lower: FloatArray
    upper: FloatArray


class Rest(NamedTuple):
    """When an execution ends.

    Attributes:
        reach: Largest distance of the tool from a joint [m].
        patience: Time at which an execution ends that does not come to rest [s].
    """

    reach: float
    patience: float


class Samples(NamedTuple):
    """The parameters in which the robots differ.

    Attributes:
        kp, kv: Servo gains [1/s], (samples, dof).
        dead_time: Dead times [s], (samples, dof).
        payload: Additional mass at the tool [kg], (samples,).
        jitter: Delays of the set-points [s], (samples, n), or (samples, 0) without jitter.
    """

    kp: FloatArray
    kv: FloatArray
    dead_time: FloatArray
    payload: FloatArray
    jitter: FloatArray


class Found(NamedTuple):
    """Results of the executions, (samples,) each.

    Attributes:
        rms, max: RMS and largest contour error [m].
        until: End of the time over which errors are evaluated [s].
        saturated: Fraction of this time in saturation.
        demand_ratio: Largest demand over its limit.
        stuck: 1 where time steps as short as the servo needs make no progress, else 0.
    """

    rms: FloatArray
    max: FloatArray
    until: FloatArray
    saturated: FloatArray
    demand_ratio: FloatArray
    stuck: IntArray


class States(NamedTuple):
    """The states of all joints, (dof,) each.

    Attributes:
        q, w: Position [rad] and velocity [rad/s].
        saturated: Time in saturation [s].
        ratio: Largest demand over its limit.
    """

    q: FloatArray
    w: FloatArray
    saturated: FloatArray
    ratio: FloatArray


class Errors(NamedTuple):
    """Accumulated contour errors of one execution.

    Attributes:
        integral: Integral of the squared error over time [m² s].
        square, peak: Last and largest squared error [m²].
        x, y, z: Last tool point [m].
        dx, dy, dz: Last displacement of the tool [m].
        end: End of the time over which errors are evaluated [s].
        end_integral, end_peak: Integral and largest squared error at that time.
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


@compiled(inner=True, fastmath=FUSED)
def _load_servo(servo: Servo, load: float, inertia: FloatArray, k: int) -> Servo:
    """The servo with a payload: more inertia at the same torque reduces gain and limits.

    Args:
        servo: The servo without the payload.
        load: Additional mass at the tool [kg].
        inertia: Inertia of 1 kg over the joint's own at the set-points, (n,) [1/kg].
        k: Index of the command interval.
    """
    share = 1 / (1 + load * inertia[min(k, len(inertia) - 1)])
    return Servo(servo.kp, servo.kv * share, servo.lower * share, servo.upper * share)


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _commands_of(
    drive: Drive, clock: Clock, kp: FloatArray, kv: FloatArray, dead: FloatArray, late: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The commands of a robot, (dof, n + 1, 4), and the times of set-points at it, (dof, n) [s].

    Args:
        drive: What all robots share.
        clock: The times.
        kp: Position gains [1/s], (dof,).
        kv: Velocity gains [1/s], (dof,).
        dead: Dead times [s], (dof,).
        late: Delays of the set-points [s], (n,), or (0,) without jitter. The controller
            interpolates between two set-points over the time between their arrivals.
    """
    commands = drive.commands.copy()
    dof, n = len(commands), commands.shape[1] - 1
    starts = np.empty((dof, n))
    for j in range(dof):
        if drive.rates.shape[1]:
            a = 1 / kp[j]
            commands[j] += a * drive.rates[j] + (a / kv[j] if kv[j] > 0.0 else a) * drive.bends[j]
        for k in range(n):
            starts[j, k] = k * clock.period + dead[j] + (late[k] if len(late) else 0.0)
            if len(late) and k > 0:
                rate = clock.period / (starts[j, k] - starts[j, k - 1])
                commands[j, k, 1] *= rate
                commands[j, k, 2] *= rate**2
                commands[j, k, 3] *= rate**3
    return commands, starts


@compiled(inner=True, fastmath=FUSED)
def _motion(states: States, j: int, servo: Servo) -> Motion:
    """The motion of a joint so far; its range of demands is plus and minus the largest so far."""
    limit = min(-servo.lower, servo.upper)
    most = states.ratio[j] * limit if limit < math.inf else math.inf
    return Motion(states.q[j], states.w[j], 0.0, states.saturated[j], -most, most)


@compiled(inner=True, fastmath=FUSED)
def _keep(m: Motion, servo: Servo, states: States, j: int) -> bool:
    """Write the motion of a joint into the states; returns whether it is finite."""
    limit = min(-servo.lower, servo.upper)
    states.q[j], states.w[j], states.saturated[j] = m.q, m.w, m.saturated
    states.ratio[j] = max(-m.lowest, m.highest) / limit if limit < math.inf else 0.0
    return math.isfinite(m.q + m.w)


@compiled(inner=True, fastmath=FUSED)
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
    """Largest squared error up to this result, with finer sampling since the last result.

    Between the results the tool follows the parabola through the last three results.

    Args:
        line: The path.
        k: Index of the command interval.
        segment: Segment of the last nearest point.
        x: Coordinate x of the tool point [m].
        y: Coordinate y of the tool point [m].
        z: Coordinate z of the tool point [m].
        d2: Squared error of this result [m²].
        peak: Largest squared error of all results up to this one [m²].
        e: Errors up to the last result.
    """
    dx, dy, dz = x - e.x, y - e.y, z - e.z
    moved = math.sqrt(dx * dx + dy * dy + dz * dz)
    if math.sqrt(e.square) + math.sqrt(d2) + moved <= 2 * math.sqrt(peak):
        return peak  # The distance to the path grows at most as fast as the tool moves.
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


@compiled(inner=True, fastmath=FUSED)
def _add(
    clock: Clock, e: Errors, peak: float, t: float, x: float, y: float, z: float, d2: float
) -> Errors:
    """Add the result at time t to the accumulated errors.

    Args:
        clock: The times.
        e: Errors up to the last result.
        peak: Largest squared error up to this result [m²].
        t: Time of this result [s].
        x: Coordinate x of the tool point [m].
        y: Coordinate y of the tool point [m].
        z: Coordinate z of the tool point [m].
        d2: Squared error of this result [m²].
    """
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


@compiled(inner=True, allocates=True, fastmath=FUSED)
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
    """Accumulate the contour errors of some command intervals.

    Args:
        robot: The arm.
        line: The path.
        clock: The times.
        begin: First interval.
        end: The interval after the last one.
        segment: Segment of the last nearest point.
        places: Results of the joints, with positions in column 0, (dof, n, 3).
        anchors: As in `tool_point`.
        e: Errors so far.

    Returns:
        Segment of the last nearest point, and the accumulated errors.
    """
    h = clock.period / clock.steps
    # Tuples of arrays are unpacked outside of the loop: unpacking takes as long as all the rest.
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


@compiled(inner=True, fastmath=FUSED)
def _bound_speed(kp: FloatArray, kv: FloatArray, goal: FloatArray, states: States) -> float:
    """Bound on the sum of all later joint velocities once the command is constant [rad/s].

    Args:
        kp: Position gains [1/s], (dof,).
        kv: Velocity gains [1/s], (dof,); 0 for a servo of first order.
        goal: Last set-point [rad], (dof,).
        states: States of all joints.
    """
    total = 0.0
    for j in range(len(goal)):
        e, w = states.q[j] - goal[j], states.w[j]
        # The energy of a joint decreases, whether the joint is saturated or not.
        if kv[j] > 0.0:
            total += math.sqrt(w * w + kp[j] * kv[j] * e * e)
        elif e != 0.0:
            total += kp[j] * abs(e)
    return total


@compiled(inner=True, allocates=True, fastmath=FUSED)
def _advance_joints(
    clock: Clock,
    drive: Drive,
    gains: tuple[FloatArray, FloatArray, float],
    commands: FloatArray,
    starts: FloatArray,
    begin: int,
    end: int,
    states: States,
    places: FloatArray,
) -> bool:
    """Simulate all joints of a robot over command intervals; returns whether it was possible.

    Args:
        clock: The times.
        drive: What all robots share.
        gains: Gains kp and kv [1/s], (dof,) each, and additional mass at the tool [kg].
        commands: The commands of the robot.
        starts: The times of its set-points.
        begin: First command interval.
        end: The interval after the last one.
        states: States of all joints, updated.
        places: Output: results of all joints.
    """
    kp, kv, load = gains
    steps = clock.steps
    times = np.empty((end - begin) * steps + 1)
    for i in range(len(times)):
        times[i] = begin * clock.period + i * (clock.period / steps)
    # A payload changes gain and limits in every interval.
    chunk = end - begin if load == 0.0 else 1
    for j in range(len(commands)):
        servo = Servo(kp[j], kv[j], drive.lower[j], drive.upper[j])
        for k in range(begin, end, chunk):
            own = servo if load == 0.0 else _load_servo(servo, load, drive.inertia[j], k)
            first, last = (k - begin) * steps, (k - begin + chunk) * steps
            m = _motion(states, j, own)
            some = times[first : last + 1]
            m = march(own, drive.kind, commands[j], starts[j], some, m, places[j, first:last])
            if not _keep(m, own, states, j):
                return False
    return True


@compiled(inner=True, allocates=True, fastmath=FUSED)
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
    """Execute sample i; returns its contour errors, and whether it is stuck.

    The other arguments are those of `run`; `states` and `anchors` are memory for the states of the
    joints and for `tool_point`.
    """
    period = clock.period
    kp, kv, dead = samples.kp[i], samples.kv[i], samples.dead_time[i]
    commands, starts = _commands_of(drive, clock, kp, kv, dead, samples.jitter[i])
    dof, knots = len(commands), commands.shape[1] - 1
    gains = kp, kv, samples.payload[i]
    places = np.empty((dof, CHUNK * clock.steps, 3))
    for j in range(dof):
        states.q[j] = places[j, 0, 0] = commands[j, 0, 0]
        states.w[j] = states.saturated[j] = states.ratio[j] = 0.0
    x, y, z = tool_point(robot, places[:, 0, 0], anchors)
    d2, segment = find_nearest(x, y, z, line.table, line.around, 0, line.low[0], line.high[0])
    e = Errors(0.0, d2, d2, x, y, z, 0.0, 0.0, 0.0, clock.finish, 0.0, 0.0)
    # From this interval on all commands are constant.
    quiet = knots + int(math.ceil(dead.max() / period)) + 1
    fixed = int(math.ceil((clock.finish - clock.start) / period))
    stop = fixed if clock.fixed else np.iinfo(np.int64).max
    done = 0
    while True:
        end = min(done + CHUNK, stop)
        if not _advance_joints(clock, drive, gains, commands, starts, done, end, states, places):
            return e, 1
        segment, e = _measure(robot, line, clock, done, end, segment, places, anchors, e)
        done = end
        now = clock.start + done * period
        speed = rest.reach * _bound_speed(kp, kv, commands[:, knots, 0], states)
        if done >= quiet and speed < STILL_SPEED:
            if now < clock.finish:
                return _finish(e, (clock.finish - now) * e.square), 0
            return e, 0
        if done == stop or now > rest.patience:
            return e, 0


@compiled(inner=True, fastmath=FUSED)
def _finish(e: Errors, more: float) -> Errors:
    """The errors of a tool that no longer moves; `more` is added to the integral."""
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
        rest: Conditions for the end of an execution.
        samples: The parameters of the robots.
        found: Output: the results.
    """
    dof = len(drive.commands)
    states = States(np.empty(dof), np.empty(dof), np.empty(dof), np.empty(dof))
    anchors = np.empty((dof, 3))
    anchors[:, :2], anchors[:, 2] = 0.0, 1.0
    for i in range(len(samples.kp)):
        e, stuck = _execute(i, robot, line, clock, drive, rest, samples, states, anchors)
        found.rms[i] = math.sqrt(e.end_integral / (e.end - max(clock.begin, 0.0)))
        # A tool that is slower than REST_SPEED can still leave the path.
        found.max[i] = math.sqrt(e.end_peak if clock.fixed else e.peak)
        found.until[i] = e.end
        found.saturated[i] = states.saturated.max() / e.end
        found.demand_ratio[i] = states.ratio.max()
        found.stuck[i] = stuck
