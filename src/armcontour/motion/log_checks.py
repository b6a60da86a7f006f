"""Checks of logs: joints, ranges and speeds of the arm, and units, signs and order of columns."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampling import white_noise
from armcontour.core.text import clock, count_noun, list_some, show
from armcontour.motion.log import Log
from armcontour.robot import Arm

# A longer sequence of equal positions is a rest of the joint [samples].
LONGEST_REPEAT = 10
# Smallest fraction of repeated positions in motion.
LEAST_REPEATED = 0.1
# A joint that repeats positions because of a coarse encoder or of sticking friction is slow: the
# next position differs by less than RESOLUTIONS times the smallest difference of the log, or by
# less than SLOW times the difference of two positions without repeats (medians).
RESOLUTIONS, SLOW = 4.0, 0.5
# Differences of positions up to this fraction of their range are rounding errors.
ROUNDING = 1e-9


def renew_positions(log: Log) -> tuple[Log, tuple[str, ...]]:
    """Replace measured positions that repeat previous ones, and describe them.

    Args:
        log: A log.

    Returns:
        The log with interpolated positions and without rows that only repeat the previous row, and
        a sentence if positions were repeated.
    """
    q = log.measured
    repeated = np.stack([_find_repeats(x) for x in q.T], axis=1)
    joints = np.flatnonzero(repeated.any(axis=0))
    if not len(joints):
        return log, ()
    from scipy.interpolate import CubicSpline

    rows = np.concatenate([log.command, q], axis=1)
    same = np.append(False, (np.diff(rows, axis=0) == 0).all(axis=1))
    kept = ~(same & repeated.any(axis=1))
    filled = q.copy()
    for j in joints:
        new = ~repeated[:, j]
        filled[:, j] = CubicSpline(log.t[new], q[new, j])(log.t)
    names = ", ".join(log.joint_names[j] for j in joints)
    return replace(log, t=log.t[kept], command=log.command[kept], measured=filled[kept]), (
        f"{log.source} repeats {repeated[:, joints].mean():.0%} of the measured positions of "
        f"{names}. Interpolation between the new positions replaces them.",
    )


def _find_repeats(q: FloatArray) -> BoolArray:
    """Mask of the positions of a moving joint that were not renewed, (n,)."""
    repeated, steps = np.full(len(q), False), np.abs(np.diff(q))
    changes = np.flatnonzero(steps > ROUNDING * np.ptp(q))
    lengths = np.diff(changes)
    jumps = steps[changes[1:]]
    moving = lengths <= LONGEST_REPEAT
    held, single = moving & (lengths > 1), lengths == 1
    if held.sum() <= LEAST_REPEATED * moving.sum():
        return repeated
    jump = float(np.median(jumps[held]))
    ordinary = float(np.median(jumps[single])) if single.any() else 0.0
    if jump < RESOLUTIONS * jumps.min() or jump < SLOW * ordinary:
        return repeated
    starts, ends = changes[:-1][held] + 1, changes[1:][held] + 1
    # The log may end before the next new position.
    if held[-1] and len(q) - 1 - changes[-1] <= lengths[-1]:
        starts, ends = np.append(starts, changes[-1] + 1), np.append(ends, len(q))
    for start, end in zip(starts, ends, strict=True):
        repeated[start + 1 : end] = True
    return repeated


# Largest number of names in one message.
MAX_NAMED = 8
# Largest distance of a measured position from the range of its joint [rad].
RANGE_MARGIN = 0.1
# Largest speed of a joint [rad/s]. The last joint of a fast delta robot turns at 60 rad/s.
FASTEST = 100.0
# Velocities are averaged over so many samples that noise causes at most this fraction of FASTEST.
NOISE_SHARE = 0.05
# Smallest number of sample intervals over which velocities are averaged.
MIN_INTERVALS = 5

# Another unit, sign or order explains the columns only if the remaining difference is at most this
# fraction of the original difference.
MAX_REMAINING = 0.3
# The remaining difference must also be at most this fraction of the variance, which allows for the
# difference between a joint and a pure lag.
MAX_UNEXPLAINED = 0.2
# Candidates for the lag of a joint after its dead time [s].
LAGS = (0.0, 0.01, 0.014, 0.02, 0.028, 0.04, 0.056, 0.08, 0.11, 0.16)
# Number of candidates for the dead time, and number of consecutive samples that are compared.
DEAD_TIMES = 26
SAMPLES = 8000
# Fraction by which another order of columns must be better than the order of the file.
ORDER_PREFERENCE = 1e-6


def match_joints(names: Sequence[str], requested: Sequence[str], source: str) -> list[int] | None:
    """Index in `names` of each requested joint, by equal or prefixed name; None unless all fit."""
    if set(requested) <= set(names):
        return [names.index(x) for x in requested]
    indices = []
    for joint in requested:
        alike = [i for i, x in enumerate(names) if x == joint]
        alike = alike or [i for i, x in enumerate(names) if _is_prefixed(x, joint)]
        if len(alike) > 1:
            other = names[alike[1]].removesuffix(joint)
            raise InvalidInput(
                f"{source}: {' and '.join(show(names[i]) for i in alike[:2])} can both be the "
                f"joint {joint}. Ignore the other one with --columns '-=*{other}*'."
            )
        indices += alike
    return indices if len(set(indices)) == len(requested) and requested else None


def _is_prefixed(long: str, short: str) -> bool:
    """True if one of two names is the other name with a prefix."""
    if len(long) < len(short):
        long, short = short, long
    return not short.isdigit() and re.fullmatch(rf".*[_\W]{re.escape(short)}", long) is not None


def raise_other_joints(
    source: str,
    names: Sequence[str],
    joint_names: Sequence[str],
    titles: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> NoReturn:
    """Raise InvalidInput for joints that an arm does not have; `titles` are names for --columns."""
    have, arm = (list_some([show(x) for x in y], MAX_NAMED) for y in (names, joint_names))
    fix = "Add the other joints to the file"
    if len(names) >= len(joint_names):
        fix = "Name the joints in the file like those of the arm"
        missing = [x for x in joint_names if x not in names]
        spare = [title for x, title in zip(names, titles, strict=False) if x not in joint_names]
        if missing and spare:
            fix = f"{fix} (for example with --columns '{missing[0]}={spare[0]}')"
    sentence = (
        f"{source} has {count_noun(len(names), 'joint')} ({have}), but the arm has "
        f"{len(joint_names)} ({arm}). {fix}, or specify the arm of the file (--arm)."
    )
    raise InvalidInput(" ".join((sentence, *notes)), needed=len(names), allowed=len(joint_names))


def describe_match(
    names: Sequence[str], requested: Sequence[str], order: Sequence[int]
) -> list[str]:
    """A note on joints that were matched by names with a prefix; empty for equal names."""
    if not requested or names[order[0]] == requested[0]:
        return []
    return [
        "Joints are matched by the ends of their names, such as "
        f"{names[order[0]]} = {requested[0]}."
    ]


def arrange_joints(log: Log, joint_names: Sequence[str]) -> Log:
    """Sort the joints of a log in the order of an arm, by equal names or names with a prefix."""
    # If the names do not match but the number of joints does, the order remains unchanged.
    names, source = log.joint_names, log.source
    numbered = all(re.fullmatch(r"joint \d+", x) for x in names)
    order = match_joints(names, joint_names, source)
    if order is None or (numbered and len(names) != len(joint_names)):
        pairs = list(zip(names, joint_names, strict=False))
        mixed = not numbered and any(x != y and x in joint_names for x, y in pairs)
        if mixed or len(names) != len(joint_names):
            raise_other_joints(source, names, joint_names, notes=log.notes)
        return log
    notes = describe_match(names, joint_names, order)
    if spare := [x for i, x in enumerate(names) if i not in order]:
        ignored = list_some(spare, MAX_NAMED)
        notes.append(f"Joints of {source} that the arm does not have are ignored: {ignored}.")
    return replace(
        log,
        command=log.command[:, order],
        measured=log.measured[:, order],
        joint_names=tuple(names[i] for i in order),
        notes=(*log.notes, *notes),
    )


def check_distance(log: Log, arm: Arm) -> None:
    """Raise InvalidInput if positions of a log are outside the joint ranges."""
    # `log`: the log, with as many joints as the arm.
    both = {"set-point": log.command, "measured position": log.measured}
    check_range_of_log(log.source, log.t, both, log.joint_names, arm)


def check_range_of_log(
    source: str,  # Origin of the positions, for messages
    t: FloatArray,  # Times [s], (n,)
    positions: Mapping[str, FloatArray],  # Positions [rad], (n, dof), by their names
    joint_names: Sequence[str],
    arm: Arm,
    *,
    margin: float = RANGE_MARGIN,  # Allowed distance from the range of a joint [rad]
    degrees_only: bool = False,
) -> None:
    """Raise InvalidInput if positions are outside the joint ranges."""
    # `degrees_only`: true to raise only if all positions are within the ranges as degrees.
    low, high = arm.limits.joint_range(arm.dof)
    for name, values in positions.items():
        beyond = np.maximum(low - values, values - high)
        i, j = map(int, np.unravel_index(np.argmax(beyond), beyond.shape))
        turned = np.radians(values)
        degrees = bool(
            (turned >= low - RANGE_MARGIN).all() and (turned <= high + RANGE_MARGIN).all()
        )
        if beyond[i, j] <= margin or (degrees_only and not degrees):
            continue
        hint = "Correct the number, or specify the arm of the file"
        if degrees:
            hint = (
                "All joints are within their ranges if the positions are in degrees. If they are, "
                "specify this unit for all positions and rates, such as q1 [deg] and dq1 [deg/s]"
            )
        raise InvalidInput(
            f"{source}: the {name} of {joint_names[j]} is {values[i, j]:.4g} rad at "
            f"t = {clock(t[i])} s, outside the range of {arm.name} from {low[j]:.4g} to "
            f"{high[j]:.4g} rad. {hint}.",
            t=float(t[i]),
            joint=j,
        )


def check_speeds(log: Log) -> None:
    """Raise InvalidInput if a joint of a log is faster than any robot."""
    noise = white_noise(log.measured)
    for j, y in enumerate(log.measured.T):
        window = math.ceil(2 * float(noise[j]) / (NOISE_SHARE * FASTEST * log.interval))
        k = min(max(window, MIN_INTERVALS), len(y) - 1)
        speeds = np.abs(y[k:] - y[:-k]) / (log.t[k:] - log.t[:-k])
        i = int(np.argmax(speeds))
        if speeds[i] > FASTEST:
            raise InvalidInput(
                f"{log.source}: {log.joint_names[j]} moves at {speeds[i]:.3g} rad/s at t = "
                f"{clock(log.t[i])} s, but no joint is faster than {FASTEST:g} rad/s. Specify the "
                "units of the columns, such as t [s].",
                joint=j,
                t=float(log.t[i]),
                needed=float(speeds[i]),
                allowed=FASTEST,
            )


def check_units(log: Log, longest: float, j: int) -> None:
    """Raise InvalidInput if another order, unit or sign of columns explains joint j."""
    # `longest`: largest dead time [s]. Joint j is also tested alone for another unit or sign.
    for some in (slice(None), slice(j, j + 1)):
        q, u, names = log.measured[:, some], log.command[:, some], log.joint_names[some]
        if reading := find_misreading(log.t, q, u, names=names, longest_delay=longest):
            raise InvalidInput(
                f"{log.source}: {log.joint_names[j]} does not follow its commands, because "
                f"{reading}.",
                joint=j,
            )


def check_completeness(source: str, t: FloatArray, duration: float, slack: float) -> None:
    """Raise InvalidInput if a recording does not cover a whole motion."""
    # `source`: origin of the recording, for messages; `t`: times of the recording from the start of
    # the motion [s], (n,); `duration`: duration of the motion [s]; `slack`: time that may be
    # missing at either end [s].
    if t[0] > slack or t[-1] < duration - slack:
        raise InvalidInput(
            f"{source} covers the plan from {t[0]:.4g} s to {t[-1]:.4g} s, but the plan lasts from "
            f"0 to {duration:.4g} s. Record the whole run, from before its first set-point until "
            "the arm rests."
        )


def find_misreading(
    t: FloatArray,  # Times [s], (n,)
    measured: FloatArray,  # Measured positions [rad], (n, dof)
    reference: FloatArray,
    *,
    names: Sequence[str] = (),  # Names of the joints; their numbers by default
    longest_delay: float | None = None,
) -> str:
    """Clause for a message: the column error that explains the positions, and its correction."""
    # The clause is empty if no error explains the positions. Candidates are other units, orders and
    # signs of the columns and, with `longest_delay`, exchanged commands and measured positions. A
    # candidate is reported only if it makes the differences much smaller.
    # `reference`: reference positions [rad], or, with `longest_delay`, commands [rad], (n, dof);
    # `longest_delay`: largest dead time with which joints follow commands, with any lag and offset
    # [s]; without it positions are compared directly.
    names = names or [str(j + 1) for j in range(reference.shape[1])]
    if longest_delay is not None:
        piece = _find_most_motion(reference)
        t, measured, reference = t[piece], measured[piece], reference[piece]
    comparison = _Comparison(t, measured, reference, longest_delay)
    plain = comparison.differences()
    plain_errors, turn = np.diag(plain), 180 / math.pi
    enough = np.minimum(
        MAX_REMAINING**2 * plain_errors.mean(), MAX_UNEXPLAINED * comparison.power.mean()
    )
    for factor, description in (
        (1 / turn, "the measured positions look like degrees"),
        (turn, "the measured positions look like radians, but the expected ones like degrees"),
    ):
        # The residual is relative to the measured positions, so it does not depend on their unit.
        residual = np.diag(comparison.differences(factor)).mean() / factor**2
        if residual < min(
            MAX_REMAINING * plain_errors.mean(), MAX_UNEXPLAINED * comparison.power.mean()
        ):
            return f"{description}, so specify the unit of their columns"
    order = _assign_columns(plain)
    if plain[order, np.arange(len(order))].mean() < enough:
        return (
            f"its columns fit the joints in the order {', '.join(names[k] for k in order)}, so "
            "name the columns, or sort them in this order"
        )
    mirrored = np.diag(comparison.differences(-1.0))
    turned = mirrored < np.minimum(
        MAX_REMAINING**2 * plain_errors, MAX_UNEXPLAINED * comparison.power
    )
    if np.where(turned, mirrored, plain_errors).mean() < enough:
        joints = ", ".join(x for x, y in zip(names, turned, strict=True) if y)
        return (
            f"commands and measured positions of {joints} have opposite signs, so change the sign "
            "of one of them"
        )
    if longest_delay is not None:
        back = _Comparison(t, reference, measured, longest_delay)
        residual = np.diag(back.differences()).mean()
        if residual < min(
            MAX_REMAINING**2 * plain_errors.mean(), MAX_UNEXPLAINED * back.power.mean()
        ):
            return "commands and measured positions are exchanged, so exchange their names"
    return ""


class _Comparison:
    """Second moments of measured and reference positions, for all candidate lags and dead times."""

    def __init__(
        self, t: FloatArray, y: FloatArray, u: FloatArray, longest_delay: float | None
    ) -> None:
        # `power`: mean squares of the measured columns [rad²], (dof,).
        pairs = [(y, u)] if longest_delay is None else _candidate_responses(t, y, u, longest_delay)
        self._yy = np.array([(a**2).mean(axis=0) for a, _ in pairs])[:, :, None]
        self._uu = np.array([(b**2).mean(axis=0) for _, b in pairs])[:, None, :]
        self._yu = np.array([a.T @ b / len(a) for a, b in pairs])
        self.power = self._yy[0, :, 0]

    def differences(self, factor: float = 1.0) -> FloatArray:
        """Smallest mean squares of scaled measured minus reference columns, (dof, dof)."""
        deviations = factor**2 * self._yy - 2 * factor * self._yu + self._uu
        return np.asarray(np.maximum(deviations, 0.0).min(axis=0))


def _candidate_responses(
    t: FloatArray, y: FloatArray, u: FloatArray, longest_delay: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Measured positions, and commands after each lag and dead time, both without their means."""
    step, pairs = float(t[-1] - t[0]) / (len(t) - 1), []
    delays = np.unique(np.round(np.linspace(0.0, longest_delay, DEAD_TIMES) / step).astype(int))
    for lag in LAGS:
        response = _apply_lag(t, u, lag)
        for k in delays[delays < len(t) // 2]:
            a, b = y[k:], response[: len(response) - k]
            pairs.append((a - a.mean(axis=0), b - b.mean(axis=0)))
    return pairs


def _apply_lag(t: FloatArray, u: FloatArray, lag: float) -> FloatArray:
    """Response of a first-order lag [s] to commands, from rest, (n, dof)."""
    from scipy.linalg import solve_banded

    if lag == 0.0:
        return u
    share = np.exp(-np.diff(t) / lag)
    # Each row is the decayed previous position plus the remaining part of the command.
    matrix = np.ones((2, len(u)))
    matrix[1, :-1] = -share
    driven = np.array(u)
    driven[1:] *= 1 - share[:, None]
    return np.asarray(solve_banded((1, 0), matrix, driven))


def _find_most_motion(u: FloatArray) -> slice:
    """Slice of the SAMPLES consecutive samples in which the commands move most."""
    moved = np.concatenate([[0.0], np.cumsum(np.sum(np.diff(u, axis=0) ** 2, axis=1))])
    count = min(SAMPLES, len(u))
    first = int(np.argmax(moved[count - 1 :] - moved[: len(moved) - count + 1]))
    return slice(first, first + count)


def _assign_columns(differences: FloatArray) -> list[int]:
    """Assign measured columns to joints with the smallest total difference; returns indices."""
    from scipy.optimize import linear_sum_assignment

    other = ORDER_PREFERENCE * differences.max() * (1 - np.eye(len(differences)))
    return [int(k) for k in linear_sum_assignment((differences + other).T)[1]]
