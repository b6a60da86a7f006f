"""The compiled part of robustness: one execution after the other, with its contour error.

Joints move exactly from event to event, as in `execution/_servo.py`; but the instants at which
saturation starts come from the demand's cubic through its values and slopes at a step's ends, not
from bisection. A step is half a time constant at most, where that cubic is off by a few millionths
of the limit; and both motions accelerate alike at the instant itself, so that what it is off by
counts in the second order only.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.execution._pieces import advance_under_cubic
from armcontour.execution._servo import MOST_STEPS, _modes

# Products may be added without rounding in between, which is faster and no less exact.
FUSED = {"contract"}
# Instants closer than this many command intervals are one.
SNAP = 1e-9
# Command intervals run at a time: their results stay in the processor's nearest memory.
CHUNK = 64
# The tool rests below this speed [m/s], as in `evaluation`, and stands still below that one.
REST_SPEED = 1e-3
STILL_SPEED = 1e-9
# Beyond the window of time, the nearest place is looked for from joint to joint as long as these
# are within this many distances of the tool.
REACH = 5.0
# Sines are continued over this angle [rad], as far as their series is exact to rounding.
NEAR_ANGLE = 0.125
# A longer step can hold two extrema of the demand of an underdamped servo.
LONGEST_STEP = 2.0
# Between two results next to a corner of the path the error is looked at so many times more, since
# it comes to a point there; where the path turns by less than this [rad], its point is blunt.
FINER = 16
CORNER = 1e-3
# Columns of the accumulator.
INTEGRAL, SQUARE, X, Y, Z, PEAK, END, END_INTEGRAL, END_PEAK, DX, DY, DZ, COLUMNS = range(13)


@compiled(fastmath=FUSED)
def _to_segment(x: float, y: float, z: float, g: FloatArray, i: int) -> float:
    """Squared distance to segment i: start, tangent, inward, curvature, length; turn; end."""
    gx, gy, gz = x - g[i, 0], y - g[i, 1], z - g[i, 2]
    along = gx * g[i, 3] + gy * g[i, 4] + gz * g[i, 5]
    k = g[i, 9]
    if k == 0.0:
        if 0.0 <= along <= g[i, 10]:
            gx, gy, gz = gx - along * g[i, 3], gy - along * g[i, 4], gz - along * g[i, 5]
            return float(gx * gx + gy * gy + gz * gz)
    else:
        inward = gx * g[i, 6] + gy * g[i, 7] + gz * g[i, 8]
        a, b = k * along, 1 - k * inward  # sine and cosine of the angle around the centre
        before_end = a * g[i, 13] - b * g[i, 12] <= 0.0
        inside = (a >= 0.0 and before_end) if g[i, 14] < math.pi else (a >= 0.0 or before_end)
        if inside:
            # Distance from the centre less the radius, without cancellation.
            around = 1 + math.sqrt(a * a + b * b)
            radial = (k * (along * along + inward * inward) - 2 * inward) / around
            gx -= along * g[i, 3] + inward * g[i, 6]
            gy -= along * g[i, 4] + inward * g[i, 7]
            gz -= along * g[i, 5] + inward * g[i, 8]
            return float(radial * radial + gx * gx + gy * gy + gz * gz)
    return min(_to_joint(x, y, z, g, i, 0), _to_joint(x, y, z, g, i, 15))


@compiled(fastmath=FUSED)
def _to_joint(x: float, y: float, z: float, g: FloatArray, i: int, first: int) -> float:
    """Squared distance to an end of segment i, in its columns from `first` on."""
    gx, gy, gz = x - g[i, first], y - g[i, first + 1], z - g[i, first + 2]
    return float(gx * gx + gy * gy + gz * gz)


@compiled(fastmath=FUSED)
def _march(
    x: float,
    y: float,
    z: float,
    table: FloatArray,
    around: float,
    segment: int,
    forward: bool,
    stop: float,
    best: float,
) -> tuple[float, int]:
    """Search from a segment on in one direction.

    Until the arc length `stop`, and beyond that until a joint that is further than `REACH`
    distances. Arc length grows at least as fast as the distance: what is nearer than `best` from a
    joint at the distance D is at least D - best further along, and all before that is passed over.
    `around` is the length of a closed path, on which the search goes round; 0 of an open one.
    """
    n = len(table)
    sign = 1.0 if forward else -1.0
    first = 0 if forward else 15
    found, d, turn, free, j = segment, math.sqrt(best), 0.0, -math.inf, segment
    far2 = REACH * REACH * best
    for _ in range(n - 1):
        j += 1 if forward else -1
        if j == n or j < 0:
            if around == 0.0:
                break
            j = 0 if forward else n - 1
            turn += sign * around
        begin = sign * (turn + table[j, 11] + (0.0 if forward else table[j, 10]))
        inside = begin <= sign * stop
        if inside and begin + table[j, 10] <= free:
            continue
        gap2 = _to_joint(x, y, z, table, j, first)
        if not inside and gap2 > far2:
            break
        free = max(free, begin + math.sqrt(gap2) - d)
        if begin + table[j, 10] <= free:
            continue
        d2 = _to_segment(x, y, z, table, j)
        if d2 < best:
            best, found, d = d2, j, math.sqrt(d2)
    return best, found


@compiled(fastmath=FUSED)
def _nearest(
    x: float,
    y: float,
    z: float,
    table: FloatArray,
    around: float,
    segment: int,
    low: float,
    high: float,
) -> tuple[float, int]:
    """Squared distance to the path's part around a segment, and the segment of the nearest place.

    That part holds the arc lengths from `low` to `high`, and what `_march` adds to it.
    """
    best = _to_segment(x, y, z, table, segment)
    found = segment
    far2 = REACH * REACH * best
    begin, end = table[segment, 11], table[segment, 11] + table[segment, 10]
    ahead = end <= high or _to_joint(x, y, z, table, segment, 15) <= far2
    behind = begin >= low or _to_joint(x, y, z, table, segment, 0) <= far2
    if ahead:
        best, found = _march(x, y, z, table, around, segment, True, high, best)
    if behind:
        less, other = _march(x, y, z, table, around, segment, False, low, best)
        if less < best:
            best, found = less, other
    return best, found


@compiled(fastmath=FUSED)
def _turned(q: float, anchors: FloatArray, j: int) -> tuple[float, float]:
    """Sine and cosine of joint j's angle, from those of an angle near by, which are kept."""
    x = q - anchors[j, 0]
    if not -NEAR_ANGLE < x < NEAR_ANGLE:
        anchors[j, 0], anchors[j, 1], anchors[j, 2] = q, math.sin(q), math.cos(q)
        return anchors[j, 1], anchors[j, 2]
    y = x * x
    s = x * (1 - y / 6 * (1 - y / 20 * (1 - y / 42 * (1 - y / 72))))
    c = 1 - y / 2 * (1 - y / 12 * (1 - y / 30 * (1 - y / 56 * (1 - y / 90))))
    return anchors[j, 1] * c + anchors[j, 2] * s, anchors[j, 2] * c - anchors[j, 1] * s


@compiled(fastmath=FUSED)
def _tool_in_plane(
    planar: FloatArray, places: FloatArray, row: int, anchors: FloatArray
) -> tuple[float, float]:
    """Tool point of a planar arm at joint positions `places[:, row]`."""
    s, c = _turned(places[0, row], anchors, 0)
    s2, c2 = _turned(places[0, row] + places[1, row], anchors, 1)
    return planar[0] + planar[1] * s + planar[2] * s2, planar[1] * c + planar[2] * c2


@compiled(fastmath=FUSED)
def _tool_in_space(
    rotations: FloatArray,
    positions: FloatArray,
    axes: FloatArray,
    base: FloatArray,
    end: FloatArray,
    places: FloatArray,
    row: int,
    anchors: FloatArray,
) -> tuple[float, float, float]:
    """Tool point of a serial arm at joint positions `places[:, row]`, from its end to its base."""
    x, y, z = end[0, 3], end[1, 3], end[2, 3]
    for j in range(len(places) - 1, -1, -1):
        s, c = _turned(places[j, row], anchors, j)
        a, b, d = axes[j, 0], axes[j, 1], axes[j, 2]
        along = (a * x + b * y + d * z) * (1 - c)
        x, y, z = (
            c * x + s * (b * z - d * y) + along * a,
            c * y + s * (d * x - a * z) + along * b,
            c * z + s * (a * y - b * x) + along * d,
        )
        r, p = rotations, positions
        x, y, z = (
            p[j, 0] + r[j, 0, 0] * x + r[j, 0, 1] * y + r[j, 0, 2] * z,
            p[j, 1] + r[j, 1, 0] * x + r[j, 1, 1] * y + r[j, 1, 2] * z,
            p[j, 2] + r[j, 2, 0] * x + r[j, 2, 1] * y + r[j, 2, 2] * z,
        )
    return (
        base[0, 3] + base[0, 0] * x + base[0, 1] * y + base[0, 2] * z,
        base[1, 3] + base[1, 0] * x + base[1, 1] * y + base[1, 2] * z,
        base[2, 3] + base[2, 0] * x + base[2, 1] * y + base[2, 2] * z,
    )


@compiled(fastmath=FUSED)
def transition(kp: float, kv: float, t: float, out: FloatArray, row: int) -> None:
    """Write the free motion over `t` into a row: [[a, b], [c, d]], then t; (n, 5).

    kv is 0 for a servo of first order.
    """
    out[row, 4] = t
    if kv == 0.0:
        out[row, 0] = math.exp(-kp * t)
        return
    c, s = _modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    out[row, 0], out[row, 1] = c + kv / 2 * s, s
    out[row, 2], out[row, 3] = -kp * kv * s, c - kv / 2 * s


@compiled(fastmath=FUSED)
def _hermite(z: float, dz: float, end: float, dend: float, h: float, x: float) -> float:
    """The cubic through values and slopes at both ends of a step h, at the share x of it."""
    a, b = h * dz, h * dend
    return z + x * (a + x * (3 * (end - z) - 2 * a - b + x * (2 * (z - end) + a + b)))


@compiled(fastmath=FUSED)
def _turn(z: float, dz: float, end: float, dend: float, h: float) -> float:
    """Share of a step at which that cubic turns, if its slopes differ in sign; else 1."""
    if dz * dend >= 0.0:
        return 1.0
    a, b = h * dz, h * dend
    second, first = 3 * (2 * (z - end) + a + b), 3 * (end - z) - 2 * a - b
    root = math.sqrt(max(first * first - second * a, 0.0))
    s = -(first + math.copysign(root, first))
    x = s / second if second != 0.0 else 2.0
    if not 0.0 < x < 1.0:
        x = a / s if s != 0.0 else 0.5
    return x if 0.0 < x < 1.0 else 0.5


@compiled(fastmath=FUSED)
def _crossing(
    z: float, dz: float, end: float, dend: float, h: float, limit: float, low: float, high: float
) -> float:
    """Share in [low, high] of a step at which that cubic reaches a limit, monotone between them."""
    left = _hermite(z, dz, end, dend, h, low) - limit
    right = _hermite(z, dz, end, dend, h, high) - limit
    if left * right > 0.0:
        return low
    a, b = h * dz, h * dend
    second, third = 3 * (end - z) - 2 * a - b, 2 * (z - end) + a + b
    x = low + (high - low) * left / (left - right) if left != right else low
    for _ in range(60):
        value = z + x * (a + x * (second + x * third)) - limit
        if value * left > 0.0:
            low = x
        else:
            high = x
        slope = a + x * (2 * second + x * 3 * third)
        step = x - value / slope if slope != 0.0 else low
        if not low <= step <= high:
            step = 0.5 * (low + high)
        if abs(step - x) < 1e-10:
            return step
        x = step
    return x


@compiled(fastmath=FUSED)
def _entry(
    z: float, dz: float, end: float, dend: float, t: float, lower: float, upper: float
) -> tuple[float, float, float]:
    """When a demand first leaves its bounds: time (t if never), its sign, and its largest amount.

    Until then; in the second case 0 for the sign.
    """
    peak, low = abs(z), 0.0
    turn = _turn(z, dz, end, dend, t)
    for i in range(2):
        stop = turn if i == 0 else 1.0
        value = _hermite(z, dz, end, dend, t, stop) if stop < 1.0 else end
        if not lower <= value <= upper:
            limit = upper if value > 0.0 else lower
            at = _crossing(z, dz, end, dend, t, limit, low, stop)
            return at * t, math.copysign(1.0, value), max(peak, abs(limit))
        peak = max(peak, abs(value))
        if stop == 1.0:
            break
        low = stop
    return t, 0.0, peak


@compiled(fastmath=FUSED)
def _freely(kp: float, kv: float, e: float, de: float, t: float) -> tuple[float, float]:
    """A free motion after the time t."""
    c, s = _modes(kv * kv / 4 - kp * kv, -kv / 2, t)
    return e * c + (de + kv / 2 * e) * s, de * c - (kp * kv * e + kv / 2 * de) * s


@compiled(fastmath=FUSED)
def _saturating(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    u: float,
    r: float,
    q: float,
    w: float,
    span: float,
) -> tuple[float, float, float, float]:
    """Run one joint for `span` under the command `u + r t`, (7), between two accelerations."""
    now = saturated = peak = mode = 0.0
    z = kv * (kp * (u - q) - w)
    if not lower <= z <= upper:
        mode = math.copysign(1.0, z)
    longest = LONGEST_STEP / (kv if kv >= 4 * kp else math.sqrt(kp * kv))
    count = 0
    while now < span:
        count += 1
        if count > MOST_STEPS:
            return math.nan, math.nan, math.nan, peak
        left = span - now
        command = u + r * now
        z = kv * (kp * (command - q) - w)
        peak = max(peak, abs(z))
        if mode != 0.0:
            limit = upper if mode > 0.0 else -lower
            bend = kv * kp * limit / 2
            # Over the limit by excess + z1 t - bend t², until that is 0 again.
            excess = max(mode * z - limit, 0.0)
            z1 = kv * (kp * mode * (r - w) - limit)
            t = (z1 + math.sqrt(z1 * z1 + 4.0 * bend * excess)) / (2.0 * bend)
            ends = t < left
            t = min(t, left)
            top = z1 / (2 * bend)
            if 0.0 < top < t:
                peak = max(peak, limit + excess + z1 * top - bend * top * top)
            q += t * (w + mode * limit * t / 2)
            w += mode * limit * t
            saturated += t
            now = now + t if ends else span
            mode = 0.0
            continue
        t = min(left, longest)
        e, de = q - command + r / kp, w - r
        end, dend = _freely(kp, kv, e, de, t)
        last = -kv * (kp * end + dend)
        at, mode, most = _entry(
            z, kv * (kp * (r - w) - z), last, -kv * (kp * dend + last), t, lower, upper
        )
        peak = max(peak, most)
        if at < t:
            end, dend = _freely(kp, kv, e, de, at)
        q, w = command + r * at - r / kp + end, r + dend
        now = now + at if at < left else span
    return q, w, saturated, peak


@compiled(fastmath=FUSED)
def _straight(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    u: float,
    r: float,
    q: float,
    w: float,
    free: FloatArray,
    i: int,
) -> tuple[float, float, float, float]:
    """One step of a joint of second order under the command `u + r t`.

    Args:
        kp: Position loop gain [1/s].
        kv: Velocity loop gain [1/s].
        lower: Acceleration bound [rad/s²].
        upper: Acceleration bound [rad/s²].
        u: Command [rad].
        r: Its rate [rad/s].
        q: Position [rad].
        w: Velocity [rad/s].
        free: Steps, as `transition` writes them.
        i: Which of them.

    Returns:
        Position, velocity, time in saturation, largest amount of the demand.
    """
    t = free[i, 4]
    e, de = q - u + r / kp, w - r
    end, dend = free[i, 0] * e + free[i, 1] * de, free[i, 2] * e + free[i, 3] * de
    z, last = -kv * (kp * e + de), -kv * (kp * end + dend)
    dz, dlast = -kv * (kp * de + z), -kv * (kp * dend + last)
    peak = max(abs(z), abs(last))
    inside = lower <= z <= upper and lower <= last <= upper
    if inside and dz * dlast < 0.0:
        turn = _hermite(z, dz, last, dlast, t, _turn(z, dz, last, dlast, t))
        inside = lower <= turn <= upper
        peak = max(peak, abs(turn))
    if inside:
        return u + r * t - r / kp + end, r + dend, 0.0, peak
    return _saturating(kp, kv, lower, upper, u, r, q, w, t)


@compiled(fastmath=FUSED)
def _bent(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    u: FloatArray,
    q: float,
    w: float,
    free: FloatArray,
    i: int,
) -> tuple[float, float, float, float]:
    """As `_straight`, under a cubic command: it is followed with a lag that is a series in G(s)."""
    a, b, t = 1 / kp, 1 / (kp * kv), free[i, 4]
    g1, g2, g3 = -a, a * a - b, a * (2 * b - a * a)
    d1, d2, d3 = u[1], 2 * u[2], 6 * u[3]
    e, de = q - (u[0] + g1 * d1 + g2 * d2 + g3 * d3), w - (d1 + g1 * d2 + g2 * d3)
    z = kv * (kp * (u[0] - q) - w)
    dz = kv * (kp * (u[1] - w) - z)
    u1 = u[0] + t * (u[1] + t * (u[2] + t * u[3]))
    d1, d2 = d1 + t * (d2 + t * d3 / 2), d2 + t * d3
    end = u1 + g1 * d1 + g2 * d2 + g3 * d3 + free[i, 0] * e + free[i, 1] * de
    dend = d1 + g1 * d2 + g2 * d3 + free[i, 2] * e + free[i, 3] * de
    last = kv * (kp * (u1 - end) - dend)
    dlast = kv * (kp * (d1 - dend) - last)
    turn = _hermite(z, dz, last, dlast, t, _turn(z, dz, last, dlast, t))
    if lower <= min(z, last, turn) and max(z, last, turn) <= upper:
        return end, dend, 0.0, max(abs(z), abs(last), abs(turn))
    q, w, time, low, high = advance_under_cubic(kp, kv, lower, upper, u, q, w, t)
    return q, w, time, max(-low, high)


@compiled(fastmath=FUSED)
def _lag(
    kp: float, u: FloatArray, q: float, free: FloatArray, i: int
) -> tuple[float, float, float, float]:
    """One step of a joint of first order under a cubic command."""
    a, t = 1 / kp, free[i, 4]
    d1, d2, d3 = u[1], 2 * u[2], 6 * u[3]
    e = q - (u[0] - a * d1 + a * a * d2 - a * a * a * d3)
    peak = abs(kp * (u[1] - kp * (u[0] - q)))
    u1 = u[0] + t * (u[1] + t * (u[2] + t * u[3]))
    d1, d2 = d1 + t * (d2 + t * d3 / 2), d2 + t * d3
    end = u1 - a * d1 + a * a * d2 - a * a * a * d3 + free[i, 0] * e
    w = kp * (u1 - end)
    return end, w, 0.0, max(peak, abs(kp * (d1 - w)))


@compiled(fastmath=FUSED)
def _step(
    kp: float,
    kv: float,
    lower: float,
    upper: float,
    straight: bool,
    u: FloatArray,
    q: float,
    w: float,
    free: FloatArray,
    i: int,
) -> tuple[float, float, float, float]:
    """One step under the command u, whatever the servo."""
    if kv == 0.0:
        return _lag(kp, u, q, free, i)
    if straight:
        return _straight(kp, kv, lower, upper, u[0], u[1], q, w, free, i)
    return _bent(kp, kv, lower, upper, u, q, w, free, i)


@compiled(fastmath=FUSED)
def _parts(
    period: float,
    steps: int,
    dead_time: float,
    width: FloatArray,
    local: FloatArray,
    kind: IntArray,
) -> int:
    """How results and late set-points divide a command interval; the number of parts.

    Args:
        period: Command interval [s].
        steps: Results in it.
        dead_time: [s].
        width: Takes the parts' lengths [s].
        local: Takes the times since the set-point before each part [s].
        kind: Takes by how many intervals that is late, and 0 where a result is due behind, (n, 2).
    """
    whole = int(math.floor(dead_time / period + SNAP))
    late = max(dead_time - whole * period, 0.0)
    span, near = period / steps, SNAP * period
    count, begin = 0, 0.0
    for i in range(steps):
        end = (i + 1) * span
        for due in (False, True):
            if not due and not begin + near < late < end - near:
                continue
            stop = end if due else late
            before = begin < late - near
            width[count] = stop - begin
            local[count] = begin + period - late if before else max(begin - late, 0.0)
            kind[count, 0] = whole + 1 if before else whole
            kind[count, 1] = 0 if due else 1
            begin = stop
            count += 1
    return count


@compiled(fastmath=FUSED)
def _even(
    joint: Any,
    drive: Any,
    parts: Any,
    load: float,
    begin: int,
    end: int,
    state: FloatArray,
    out: FloatArray,
) -> None:
    """Run one joint through command intervals whose set-points come at even times.

    Writes results into `out`; updates `state`: position, velocity, time in saturation, largest
    share of the acceleration limit asked for.
    """
    kp, nominal, lowest, highest, straight = joint
    command, inertia, u = drive
    count, width, local, kind, free = parts
    q, w, saturated, most = state[0], state[1], state[2], state[3]
    last = len(command) - 1
    kv, lower, upper = nominal, lowest, highest
    simple, over = straight and kv > 0.0, 1 / min(-lowest, highest)
    row = 0
    for k in range(begin, end):
        if load != 0.0:
            # More inertia, and the same torques: less of both gain and limit.
            share = 1 / (1 + load * inertia[min(k, len(inertia) - 1)])
            kv, lower, upper = nominal * share, lowest * share, highest * share
            over = 1 / min(-lower, upper)
            for i in range(count):
                transition(kp, kv, width[i], free, i)
        for i in range(count):
            at = min(max(k - kind[i, 0] + 1, 0), last)
            t = local[i] if 0 < at < last else 0.0
            if simple:
                r = command[at, 1]
                q, w, time, peak = _straight(
                    kp, kv, lower, upper, command[at, 0] + r * t, r, q, w, free, i
                )
            else:
                _seen(command, at, 1.0, t, u)
                q, w, time, peak = _step(kp, kv, lower, upper, straight, u, q, w, free, i)
            saturated += time
            most = max(most, peak * over)
            if kind[i, 1] == 0:
                out[row] = q
                row += 1
    state[0], state[1], state[2], state[3] = q, w, saturated, most


@compiled(fastmath=FUSED)
def _seen(command: FloatArray, i: int, rate: float, t: float, u: FloatArray) -> None:
    """Write the cubic of interval i, played at a rate, in powers of the time behind t into u."""
    b, c, d = command[i, 1] * rate, command[i, 2] * rate**2, command[i, 3] * rate**3
    u[0] = command[i, 0] + t * (b + t * (c + t * d))
    u[1] = b + t * (2 * c + t * 3 * d)
    u[2] = c + 3 * d * t
    u[3] = d


@compiled(fastmath=FUSED)
def _uneven(
    joint: Any,
    drive: Any,
    when: Any,
    load: float,
    begin: int,
    end: int,
    state: FloatArray,
    out: FloatArray,
) -> None:
    """As `_even`, where set-point k comes `late[k]` after its time.

    What the controller does between two set-points it does in the time between them.
    """
    kp, nominal, lowest, highest, straight = joint
    command, inertia, u = drive
    period, steps, late, free = when
    q, w = state[0], state[1]
    last = len(command) - 1
    now = begin * period
    # The command's interval that holds at `now`; `at - 1` is the set-point that begins it.
    at = min(max(begin - int(late[0] / period) - 2, 0), last)
    for row in range((end - begin) * steps):
        until = begin * period + (row + 1) * (period / steps)
        share = 1 / (1 + load * inertia[min(begin + row // steps, len(inertia) - 1)])
        kv, lower, upper = nominal * share, lowest * share, highest * share
        while until - now > SNAP * period:
            come = at * period + late[at] if at < last else math.inf
            if come - now <= SNAP * period:
                at += 1
                continue
            stop = min(until, come)
            if 0 < at < last:
                came = (at - 1) * period + late[at - 1]
                _seen(command, at, period / (come - came), now - came, u)
            else:
                _seen(command, at, 1.0, 0.0, u)
            transition(kp, kv, stop - now, free, 0)
            q, w, time, peak = _step(kp, kv, lower, upper, straight, u, q, w, free, 0)
            state[2] += time
            state[3] = max(state[3], peak / min(-lower, upper))
            now = stop
        now = until
        out[row] = q
    state[0], state[1] = q, w


@compiled(fastmath=FUSED)
def _keep(acc: FloatArray, t: float) -> None:
    acc[END], acc[END_INTEGRAL], acc[END_PEAK] = t, acc[INTEGRAL], acc[PEAK]


@compiled(fastmath=FUSED)
def _sharpen(
    table: FloatArray,
    around: float,
    segment: int,
    low: float,
    high: float,
    x: float,
    y: float,
    z: float,
    d2: float,
    acc: FloatArray,
) -> None:
    """Look for the largest error between the last result and this one, next to a corner.

    The tool's way between them is the parabola through the last three results.
    """
    dx, dy, dz = x - acc[X], y - acc[Y], z - acc[Z]
    way = math.sqrt(dx * dx + dy * dy + dz * dz)
    if math.sqrt(acc[SQUARE]) + math.sqrt(d2) + way <= 2 * math.sqrt(acc[PEAK]):
        return  # A distance grows no faster than the tool moves.
    for i in range(1, FINER):
        a = i / FINER
        b = a * (a - 1) / 2
        found, _ = _nearest(
            acc[X] + a * dx + b * (dx - acc[DX]),
            acc[Y] + a * dy + b * (dy - acc[DY]),
            acc[Z] + a * dz + b * (dz - acc[DZ]),
            table,
            around,
            segment,
            low,
            high,
        )
        acc[PEAK] = max(acc[PEAK], found)


@compiled(fastmath=FUSED)
def _measure(
    robot: Any,
    line: Any,
    clock: Any,
    begin: int,
    end: int,
    segment: int,
    places: FloatArray,
    anchors: FloatArray,
    acc: FloatArray,
) -> int:
    """Add the contour errors of some command intervals up.

    Args:
        robot: The arm.
        line: The path: its table, length if closed, and windows per interval.
        clock: Start, command interval, results in it, end of errors, whether that is fixed.
        begin: First interval.
        end: Behind the last.
        segment: That of the last nearest place.
        places: Joint positions at the results, (dof, n).
        anchors: Angles and their sines and cosines, for `_turned`.
        acc: The sums.

    Returns:
        Segment of the nearest place at the end.
    """
    table, around, low, high = line
    planar, rotations, positions, axes, base, tip = robot
    flat = planar[1] > 0.0
    z = 0.0
    start, period, steps, finish, fixed = clock
    h = period / steps
    for row in range((end - begin) * steps):
        # Tuples are taken apart outside: that costs as much as the rest.
        if flat:
            x, y = _tool_in_plane(planar, places, row, anchors)
        else:
            x, y, z = _tool_in_space(rotations, positions, axes, base, tip, places, row, anchors)
        k = min(begin + row // steps, len(low) - 1)
        d2, now = _nearest(x, y, z, table, around, segment, low[k], high[k])
        before, t = start + (begin * steps + row) * h, start + (begin * steps + row + 1) * h
        dx, dy, dz = x - acc[X], y - acc[Y], z - acc[Z]
        if before < finish <= t:
            # The last trapezoid ends between two results.
            share = (finish - before) / h
            d = (1 - share) * math.sqrt(acc[SQUARE]) + share * math.sqrt(d2)
            acc[END] = finish
            acc[END_INTEGRAL] = acc[INTEGRAL] + 0.5 * share * h * (acc[SQUARE] + d * d)
            acc[END_PEAK] = max(acc[PEAK], d * d)
        acc[INTEGRAL] += 0.5 * h * (acc[SQUARE] + d2)
        acc[PEAK] = max(acc[PEAK], d2)
        if now != segment:
            if abs(now - segment) > 1 or table[max(now, segment), 18] > CORNER:
                _sharpen(table, around, segment, low[k], high[k], x, y, z, d2, acc)
            segment = now
        acc[DX], acc[DY], acc[DZ] = dx, dy, dz
        acc[SQUARE], acc[X], acc[Y], acc[Z] = d2, x, y, z
        moving = dx * dx + dy * dy + dz * dz > (REST_SPEED * h) ** 2
        if moving and t > finish and not fixed:
            _keep(acc, t)
    return segment


@compiled(fastmath=FUSED)
def _begin(robot: Any, line: Any, places: FloatArray, anchors: FloatArray, acc: FloatArray) -> int:
    """Put the tool where it stands at first into the sums; the segment of its nearest place."""
    table, around, low, high = line
    planar, rotations, positions, axes, base, tip = robot
    z = 0.0
    if planar[1] > 0.0:
        x, y = _tool_in_plane(planar, places, 0, anchors)
    else:
        x, y, z = _tool_in_space(rotations, positions, axes, base, tip, places, 0, anchors)
    d2, segment = _nearest(x, y, z, table, around, 0, low[0], high[0])
    acc[X], acc[Y], acc[Z], acc[SQUARE], acc[PEAK] = x, y, z, d2, d2
    return segment


@compiled(fastmath=FUSED)
def _rest(kp: FloatArray, kv: FloatArray, goal: FloatArray, state: FloatArray) -> float:
    """Sum of the largest rates that joints can still take on, once the command rests [rad/s]."""
    total = 0.0
    for j in range(len(goal)):
        e, w = state[j, 0] - goal[j], state[j, 1]
        # Their energy falls, whether they are saturated or not.
        total += kp[j] * abs(e) if kv[j] == 0.0 else math.sqrt(w * w + kp[j] * kv[j] * e * e)
    return total


@compiled(fastmath=FUSED)
def _execute(
    i: int,
    robot: Any,
    line: Any,
    clock: Any,
    drive: Any,
    bounds: Any,
    values: Any,
    state: FloatArray,
    anchors: FloatArray,
    acc: FloatArray,
) -> bool:
    """Execute one sample; whether it comes to rest."""
    commands, _, _ = drive
    _, _, reach, patience = bounds
    kp, kv, dead, _, jitter = values
    start, period, steps, finish, fixed = clock
    dof, knots = len(commands), commands.shape[1] - 1
    work = _prepared(i, clock, values, dof)
    places = np.empty((dof, CHUNK * steps))
    for j in range(dof):
        state[j, 0] = places[j, 0] = commands[j, 0, 0]
    segment = _begin(robot, line, places, anchors, acc)
    # Behind this interval no command moves any more.
    quiet = knots + int(math.ceil(dead[i].max() / period)) + 1
    stop = int(math.ceil((finish - start) / period)) if fixed else np.iinfo(np.int64).max
    done = 0
    while True:
        end = min(done + CHUNK, stop)
        _advance_joints(i, clock, drive, bounds, values, work, done, end, state, places)
        segment = _measure(robot, line, clock, done, end, segment, places, anchors, acc)
        done = end
        now = start + done * period
        speed = reach * _rest(kp[i], kv[i], commands[:, knots, 0], state)
        if done >= quiet and speed < (STILL_SPEED if fixed else REST_SPEED):
            if now < finish:
                acc[END_INTEGRAL] = acc[INTEGRAL] + (finish - now) * acc[SQUARE]
                acc[END_PEAK] = acc[PEAK]
            return True
        if done == stop:
            return True
        if now > patience:
            return False


@compiled(fastmath=FUSED)
def _prepared(i: int, clock: Any, values: Any, dof: int) -> Any:
    """What one sample's joints need beside their state: parts of an interval, and arrival times."""
    _, period, steps, _, _ = clock
    kp, kv, dead, _, jitter = values
    free, u, count = np.zeros((dof, steps + 1, 5)), np.empty(4), np.empty(dof, np.intp)
    width, local = np.empty((dof, steps + 1)), np.empty((dof, steps + 1))
    kind = np.empty((dof, steps + 1, 2), np.intp)
    late = np.empty((dof, jitter.shape[1]))
    for j in range(dof):
        count[j] = _parts(period, steps, dead[i, j], width[j], local[j], kind[j])
        for p in range(count[j]):
            transition(kp[i, j], kv[i, j], width[j, p], free[j], p)
        for k in range(jitter.shape[1]):
            late[j, k] = dead[i, j] + jitter[i, k]
    return count, width, local, kind, free, u, late


@compiled(fastmath=FUSED)
def _advance_joints(
    i: int,
    clock: Any,
    drive: Any,
    bounds: Any,
    values: Any,
    work: Any,
    done: int,
    end: int,
    state: FloatArray,
    places: FloatArray,
) -> None:
    """Run all joints of a sample through the next command intervals."""
    commands, inertias, straight = drive
    lower, upper, _, _ = bounds
    kp, kv, _, payload, jitter = values
    _, period, steps, _, _ = clock
    count, width, local, kind, free, u, late = work
    for j in range(len(commands)):
        joint = kp[i, j], kv[i, j], lower[j], upper[j], straight
        own = commands[j], inertias[j], u
        if jitter.shape[1]:
            when = period, steps, late[j], free[j]
            _uneven(joint, own, when, payload[i], done, end, state[j], places[j])
        else:
            parts = count[j], width[j], local[j], kind[j], free[j]
            _even(joint, own, parts, payload[i], done, end, state[j], places[j])


@compiled(fastmath=FUSED)
def run(
    first: int,
    last: int,
    robot: Any,
    line: Any,
    clock: Any,
    drive: Any,
    bounds: Any,
    values: Any,
    out: FloatArray,
) -> None:
    """Execute samples from `first` to before `last`.

    Args:
        first: First sample.
        last: Behind the last one.
        robot: Planar arm (base and links; links 0 for a chain), and the chain's arrays.
        line: As `_measure` takes it.
        clock: Likewise.
        drive: Commands (dof, n + 1, 4), inertia of 1 kg at the tip over each joint's own
            (dof, n) [1/kg], whether commands are straight.
        bounds: Lower and upper accelerations (dof,), reach of the arm [m], patience [s].
        values: kp, kv, dead time (samples, dof), payload (samples,), jitter (samples, n or 0).
        out: Takes RMS, largest error, end of the errors, saturated share, demand over its limit;
            (samples, 5). The end is NaN for one that does not come to rest.
    """
    finish = clock[3]
    dof = len(drive[0])
    state, acc = np.empty((dof, 4)), np.empty(COLUMNS)
    anchors = np.zeros((dof, 3))
    anchors[:, 2] = 1.0
    for i in range(first, last):
        acc[:] = 0.0
        _keep(acc, finish)
        state[:] = 0.0
        settled = _execute(i, robot, line, clock, drive, bounds, values, state, anchors, acc)
        end = acc[END] if settled else math.nan
        out[i, 0] = math.sqrt(acc[END_INTEGRAL] / acc[END])
        out[i, 1] = math.sqrt(acc[END_PEAK])
        out[i, 2] = end
        out[i, 3] = state[:, 2].max() / acc[END]
        out[i, 4] = state[:, 3].max()
