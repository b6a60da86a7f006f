"""Checks on sampled motions from files: times, values, units, gaps, ranges and speeds.

The checks take times `t` [s], (n,), and joint values, (n, dof). Each raises InvalidInput for the
first wrong sample. `source` and `column` name the file and its column in the message.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import joint_units
from armcontour.core.sampled_data import white_noise
from armcontour.core.text import clock
from armcontour.robot import Arm

# Smallest time step [s]. Controllers sample at 1 MHz at most, and times are printed with at most
# nine decimals, so a shorter step means damaged data. Divisions by the square of a very short step
# can overflow.
SHORTEST_LOG_STEP = 1e-9
# The difference of two times that are printed a nanosecond apart may be this fraction of it.
ROUNDED_STEP = 0.999
# Smallest distinguishable difference of two times, in units in the last place.
STEP_ULPS = 4
# Largest time [s]: 300 years. It admits seconds since 1970, and rejects milliseconds since 1970.
LATEST = 1e10
# Largest joint positions [rad], velocities [rad/s] and accelerations [rad/s²]. 10,000 rad are 1,600
# turns. The other bounds only keep sums and squares finite; the limits are checked elsewhere.
LARGEST = {"q": 1e4, "dq": 1e9, "ddq": 1e12}
# Function that names a value for messages, from the name of its array, its row and its column.
NameOfValue = Callable[[str, int, int], str]
JOINT_UNITS = {"q": "rad", "dq": "rad/s", "ddq": "rad/s²"}
# A step longer than this multiple of the usual step is a gap, in which the command is unknown.
GAP = 3.0
# Fraction of gaps above which the times come in bursts.
MAX_GAPS = 0.05
# Joint positions [rad] above this require a unit in the column title, because they may be degrees.
# No arm of the library turns by more than two turns.
MAX_RADIANS = 4 * math.pi
# Times that increase by this [s] or more per sample (median) may be milliseconds. They require a
# unit in the column title if the joints would be slow; see MIN_SPEED.
LONG_TIME_STEP = 1.0
# With long steps, times require a unit in the column title if all joints are slower than this
# [rad/s].
MIN_SPEED = 0.01
# A jump that differs from a whole turn by less than this angle [rad] indicates a wrapped angle.
NEAR_A_TURN = 0.6
# Shortest and longest sample interval for identification [s]. No robot controller samples faster
# than 20 kHz. Below 10 Hz, the loops settle between two samples.
INTERVALS = (5e-5, 0.1)
# Largest fraction of a recording that may be gaps, for learning.
MAX_MISSING = 0.1
# Largest distance of a measured position from the range of its joint [rad].
RANGE_MARGIN = 0.1
# Largest speed of a joint [rad/s]. The last joint of a fast delta robot turns at 60 rad/s.
FASTEST_JOINT = 100.0
# Velocities are averaged over so many samples that noise causes at most this fraction of
# FASTEST_JOINT.
NOISE_SHARE = 0.05
# Smallest number of sample intervals over which velocities are averaged.
MIN_INTERVALS = 5


def check_time_range(
    t: FloatArray, describe: NameOfValue, rename: Callable[[str], str] = str
) -> None:
    """Check that times `t` are small enough to be seconds.

    Args:
        t: Times [s], (n,).
        describe: Function that names a value by its array, row and column.
        rename: Function that writes a new column title as the user must, for the advice.
    """
    distant = np.flatnonzero(np.abs(t) > LATEST)
    if len(distant):
        i = int(distant[0])
        unit = next((x for x, y in (("ms", 1e-3), ("us", 1e-6)) if abs(t[i]) * y < LATEST), "ns")
        raise InvalidInput(
            f"{describe('t', i, 0)} is {t[i]:.3g} s, but times must stay within {LATEST:g} s. "
            f"Correct the number, or specify the unit of time, such as {rename(f't [{unit}]')}.",
            index=i,
            t=float(t[i]),
        )


def check_samples(t: FloatArray, arrays: Mapping[str, FloatArray], describe: NameOfValue) -> None:
    """Check that times and joint values are possible for a robot.

    Args:
        t: Times [s], (n,).
        arrays: Positions "q", velocities "dq" and accelerations "ddq" that are known, (n, dof).
        describe: Function that names a value by its array, row and column.
    """
    check_time_range(t, describe)
    # Rounding depends on the later time. A step back is below any bound.
    rounding = STEP_ULPS * np.finfo(np.float64).eps * np.abs(t[1:])
    shortest = np.maximum(ROUNDED_STEP * SHORTEST_LOG_STEP, rounding)
    short = np.flatnonzero(~(np.diff(t) >= shortest))
    if len(short):
        i = int(short[0]) + 1
        before, after = (f"{float(x)!r} s" for x in t[i - 1 : i + 1])
        raise InvalidInput(
            f"{describe('t', i, 0)} is {after}, but times must increase by at least 1 ns and by "
            f"more than their rounding, and the previous time is {before}. Remove repeated "
            "samples, or print the times with more digits.",
            index=i,
            t=float(t[i]),
        )
    for name, values in arrays.items():
        kind = name if name in LARGEST else "q"
        large = np.argwhere(~(np.abs(values) <= LARGEST[kind]))
        if len(large):
            i, j = map(int, large[0])
            unit = JOINT_UNITS[kind]
            raise InvalidInput(
                f"{describe(name, i, j)} is {values[i, j]:.3g} {unit}, but joint values must not "
                f"be more than {LARGEST[kind]:g} {unit}. Correct the number, or specify its unit, "
                "such as q1 [deg].",
                index=i,
                t=float(t[i]),
                joint=j,
            )


def describe_bursts(t: FloatArray, source: str) -> str:
    """Return a warning if times `t` come in bursts, as arrival times do; otherwise ""."""
    steps = np.diff(t)
    if len(steps) < 10 or np.mean(steps > GAP * np.median(steps)) < MAX_GAPS:
        return ""
    return (
        f"The times of {source} come in bursts, usually {np.median(steps):.3g} s apart, but with "
        f"gaps of up to {steps.max():.3g} s. They are probably the times at which messages "
        "arrived, so speeds computed from them are wrong. Use the controller's own times."
    )


def check_angle_unit(column: str, values: FloatArray, fix: str) -> None:
    """Reject joint positions without a unit that are probably degrees.

    Args:
        column: Where the values are, for the message.
        values: Joint positions, assumed to be in rad.
        fix: Value of --columns that sets the unit to degrees, for the message.
    """
    low, high = values.min(), values.max()
    if MAX_RADIANS < max(-low, high) <= LARGEST["q"]:
        raise InvalidInput(
            f"{column} has no unit. Its values from {low:.4g} to {high:.4g} would be up to "
            f"{max(-low, high) / (2 * math.pi):.3g} turns in rad. Specify the unit, such as "
            f"--columns '{fix}' for degrees ([rad] for radians)."
        )


def check_time_unit(column: str, title: str, t: FloatArray, q: FloatArray) -> None:
    """Reject times without a unit that are probably not seconds, because joints are too slow.

    Args:
        column: Where the times are, for the message.
        title: Title of their column.
        t: Times, assumed to be in s, (n,).
        q: Joint positions [rad], (n, dof).
    """
    steps = np.diff(t)
    usable = steps > 0
    if not usable.any() or not q.shape[1] or np.median(steps[usable]) < LONG_TIME_STEP:
        return
    speed = float((np.abs(np.diff(q, axis=0)[usable]) / steps[usable][:, None]).max())
    if 0 < speed < MIN_SPEED:
        unit = next((x for x, y in (("ms", 1e-3), ("us", 1e-6)) if speed / y > MIN_SPEED), "ns")
        raise InvalidInput(
            f"{column} has no unit. In seconds, its step is {np.median(steps[usable]):g} s, and "
            f"the fastest joint has only {speed:.2g} rad/s. Specify the unit, such as --columns "
            f"'t [{unit}]={title}' ('t [s]={title}' for seconds)."
        )


def check_interval(source: str, t: FloatArray) -> None:
    """Check that a log with times `t` is sampled fast enough to identify a servo."""
    low, high = INTERVALS
    interval = float(np.median(np.diff(t)))
    # The factors allow for rounded times.
    if not low * (1 - 1e-6) <= interval <= high * (1 + 1e-6):
        raise InvalidInput(
            f"The sample interval of {source} must be from {low:g} to {high:g} s, but is "
            f"{interval:.3g} s, so the log lasts {t[-1] - t[0]:.3g} s. Specify the unit of the "
            "time column, such as t [s], or record at another rate.",
            needed=interval,
            allowed=high if interval > high else low,
        )


def check_gaps(source: str, t: FloatArray) -> None:
    """Check that the times `t` of a recording have few gaps, and do not come in bursts."""
    steps = np.diff(t)
    if bursts := describe_bursts(t, source):
        raise InvalidInput(bursts)
    missed = float(steps[steps > GAP * np.median(steps)].sum())
    allowed = MAX_MISSING * float(np.ptp(t))
    if missed > allowed:
        i = int(np.argmax(steps))
        raise InvalidInput(
            f"The gaps of {source} must total at most {allowed:.3g} s, but total {missed:.3g} s. "
            f"The longest gap is {steps[i]:.3g} s at t = {clock(t[i])} s. Record the run again.",
            index=i,
            t=float(t[i]),
            needed=missed,
            allowed=allowed,
        )


def find_wrap(values: FloatArray) -> int | None:
    """Return the index before a jump of an angle by a whole turn; None without one.

    - `values`: angles of one joint [rad], (n,).
    """
    steps = np.diff(values)
    i = int(np.argmax(np.abs(steps)))
    # A joint that really moves by a turn between two samples has a range above one turn.
    wraps = abs(abs(steps[i]) - 2 * math.pi) < NEAR_A_TURN and np.ptp(values) < 2 * math.pi + 1e-3
    return i if wraps else None


def refuse_wrapped(position: str, t: FloatArray, values: FloatArray, joint: int) -> None:
    """Raise InvalidInput if the angle of a joint jumps by a whole turn.

    - `position`: name of the position, for the message.
    - `t`: times [s], (n,).
    - `values`: angles of the joint [rad], (n,).
    - `joint`: index of the joint.
    """
    i = find_wrap(values)
    if i is not None:
        raise InvalidInput(
            f"{position} jumps by {values[i + 1] - values[i]:.4g} rad at t = {clock(t[i])} s, "
            "which is a wrapped angle. Unwrap the positions, such as with numpy.unwrap.",
            index=i,
            t=float(t[i]),
            joint=joint,
        )


def check_range_of_log(
    source: str,
    t: FloatArray,
    positions: Mapping[str, FloatArray],
    joint_names: Sequence[str],
    arm: Arm,
    *,
    margin: float = RANGE_MARGIN,
    degrees_only: bool = False,
) -> None:
    """Raise InvalidInput if positions are outside the joint ranges.

    Args:
        source: Where the positions come from, for messages.
        t: Times [s], (n,).
        positions: Positions by their names, such as "measured" [rad], (n, dof).
        joint_names: Names of the joints in the file.
        arm: The arm with the ranges.
        margin: Allowed distance from a joint range [rad].
        degrees_only: Raise the error only if all positions would be within the ranges as degrees.
    """
    low, high = arm.limits.joint_range(arm.dof)
    for name, values in positions.items():
        beyond = np.maximum(low - values, values - high)
        i, j = map(int, np.unravel_index(np.argmax(beyond), beyond.shape))
        converted = np.where(arm.chain.slides, values, np.radians(values))
        fits_as_degrees = bool(
            (converted >= low - RANGE_MARGIN).all() and (converted <= high + RANGE_MARGIN).all()
        )
        if beyond[i, j] <= margin or (degrees_only and not fits_as_degrees):
            continue
        hint = "Correct the number, or specify the arm of the file"
        unit = arm.chain.unit("rad", j)
        if fits_as_degrees:
            hint = (
                "All joints are within their ranges if the positions are in degrees. If they are, "
                "specify this unit for all positions and rates, such as q1 [deg] and dq1 [deg/s]"
            )
        raise InvalidInput(
            f"{source}: the {name} of {joint_names[j]} is {values[i, j]:.4g} {unit} at "
            f"t = {clock(t[i])} s, outside the range of {arm.name} from {low[j]:.4g} to "
            f"{high[j]:.4g} {unit}. {hint}.",
            t=float(t[i]),
            joint=j,
        )


def check_speeds(
    source: str, t: FloatArray, q: FloatArray, joint_names: Sequence[str], prismatic: Sequence[bool]
) -> None:
    """Raise InvalidInput if a joint is faster than the joints of any robot.

    Velocities are averaged over so many samples that noise contributes little.

    Args:
        source: Where the positions come from, for messages.
        t: Times [s], (n,).
        q: Joint positions [rad], (n, dof).
        joint_names: Names of the joints.
        prismatic: Whether each joint is prismatic.
    """
    noise = white_noise(q)
    interval = float(np.median(np.diff(t)))
    for j, positions in enumerate(q.T):
        window = math.ceil(2 * float(noise[j]) / (NOISE_SHARE * FASTEST_JOINT * interval))
        k = min(max(window, MIN_INTERVALS), len(positions) - 1)
        speeds = np.abs(positions[k:] - positions[:-k]) / (t[k:] - t[:-k])
        i = int(np.argmax(speeds))
        if speeds[i] > FASTEST_JOINT:
            unit = joint_units("rad/s", prismatic)[j]
            raise InvalidInput(
                f"{source}: {joint_names[j]} moves at {speeds[i]:.3g} {unit} at t = {clock(t[i])} "
                f"s, but no joint is faster than {FASTEST_JOINT:g} {unit}. Specify the units of "
                "the columns, such as t [s].",
                joint=j,
                t=float(t[i]),
                needed=float(speeds[i]),
                allowed=FASTEST_JOINT,
            )


def check_completeness(source: str, t: FloatArray, duration: float, slack: float) -> None:
    """Raise InvalidInput if a recording does not cover a whole motion.

    Args:
        source: Where the recording comes from, for messages.
        t: Times since the start of the motion [s], (n,).
        duration: Duration of the motion [s].
        slack: Time that may be missing at either end [s].
    """
    if t[0] > slack or t[-1] < duration - slack:
        raise InvalidInput(
            f"{source} covers the plan from {t[0]:.4g} s to {t[-1]:.4g} s, but the plan lasts from "
            f"0 to {duration:.4g} s. Record the whole run, from before its first set-point until "
            "the arm rests."
        )
