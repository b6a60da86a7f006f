"""Checks of logs: joints, ranges and speeds of the arm, and columns that are read wrongly."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.describing import clock, count_noun
from armcontour.core.errors import InvalidInput
from armcontour.core.sampling import white_noise
from armcontour.core.text import list_some, show
from armcontour.motion.log import Log
from armcontour.robot import Arm

# Names of joints that one message lists.
MOST_NAMED = 8
# Shortest log [s] and longest sample interval [s] from which a robot is identified: between samples
# farther apart the command is not known well enough.
SHORTEST = 2.0
COARSEST = 20e-3
# Longest time of all its logs together [s], for memory: derivatives take 2 kB for a time and joint.
LONGEST = 240.0
# A joint may measure a little beyond its range [rad].
BEYOND = 0.1
# No joint of an arm is faster than this [rad/s]: the last one of a fast delta robot turns at 60.
FASTEST = 100.0
# Velocities are taken over so many samples that noise alone shows this share of it,
NOISY = 0.05
# and over no fewer than these.
FEWEST = 5
# A joint moves if it moves by more than this [rad].
MOVES = 1e-3
# Share of the variance of a position that a command with a lag explains, if the joint follows it.
FOLLOWS = 0.5
# Longest dead time of a joint that follows the command of another joint [s].
LONGEST_DEAD_TIME = 0.25

# Another reading of the numbers explains them if it leaves at most this share of the difference.
BETTER = 0.3
# and of the variance of what moves, this: a lag is not all that a joint does.
UNEXPLAINED = 0.2
# A joint follows its command like a lag of one of these times [s], or none, after a dead time.
LAGS = (0.0, 0.01, 0.014, 0.02, 0.028, 0.04, 0.056, 0.08, 0.11, 0.16)
# Dead times that are tried, and neighbouring samples that are compared.
DEAD_TIMES = 26
SAMPLES = 8000
# Of two orders of columns that are as good, that of the file is preferred by this share.
AS_GOOD = 1e-6


def match_joints(names: Sequence[str], wanted: Sequence[str], source: str) -> list[int] | None:
    """Indices of the wanted joints by equal names, or by names with a prefix; None without.

    Raises:
        InvalidInput: Several names end with that of a joint.
    """
    if set(wanted) <= set(names):
        return [names.index(x) for x in wanted]
    found = []
    for joint in wanted:
        alike = [i for i, x in enumerate(names) if x == joint]
        alike = alike or [i for i, x in enumerate(names) if _is_prefixed(x, joint)]
        if len(alike) > 1:
            other = names[alike[1]].removesuffix(joint)
            raise InvalidInput(
                f"{source}: {' and '.join(show(names[i]) for i in alike[:2])} both may be the "
                f"joint {joint}: leave the other out with --columns '-=*{other}*'."
            )
        found += alike
    return found if len(set(found)) == len(wanted) and wanted else None


def _is_prefixed(long: str, short: str) -> bool:
    """Whether one of two names is the other one with a prefix."""
    if len(long) < len(short):
        long, short = short, long
    return not short.isdigit() and re.fullmatch(rf".*[_\W]{re.escape(short)}", long) is not None


def describe_match(names: Sequence[str], wanted: Sequence[str], order: Sequence[int]) -> list[str]:
    """A note on joints that were matched by names with a prefix; none for equal names."""
    if not wanted or names[order[0]] == wanted[0]:
        return []
    return [
        f"Joints are matched by the ends of their names, such as {names[order[0]]} = {wanted[0]}."
    ]


def arrange(log: Log, joint_names: Sequence[str]) -> Log:
    """The log with its joints in the order of an arm, by equal names or by names with a prefix.

    Otherwise joints stay in their order, also those with numbers.

    Args:
        log: The log.
        joint_names: Names of the arm's joints.

    Raises:
        InvalidInput: The log has more or fewer joints, or only some names of the arm, at other
            places.
    """
    names, source = log.joint_names, log.source
    numbered = all(re.fullmatch(r"joint \d+", x) for x in names)
    order = match_joints(names, joint_names, source)
    if order is None or (numbered and len(names) != len(joint_names)):
        own, other = (list_some(x, MOST_NAMED) for x in (names, joint_names))
        if len(names) != len(joint_names):
            raise InvalidInput(
                f"{source} has {count_noun(len(names), 'joint')} ({own}), but the arm has "
                f"{len(joint_names)} ({other}): name its columns as the arm's joints, or give "
                f"the arm of the log. {' '.join(log.notes)}".rstrip()
            )
        places = zip(names, joint_names, strict=True)
        if not numbered and any(x != y and x in joint_names for x, y in places):
            unknown = next(x for x in names if x not in joint_names)
            raise InvalidInput(
                f"{source} has a joint {unknown}, but the joints of the arm are {other}: name all "
                "joints as the arm does, or give the arm of the log."
            )
        return log
    notes = describe_match(names, joint_names, order)
    if spare := [x for i, x in enumerate(names) if i not in order]:
        left_out = list_some(spare, MOST_NAMED)
        notes.append(f"Joints of {source} that the arm does not have are left out: {left_out}.")
    return replace(
        log,
        command=log.command[:, order],
        measured=log.measured[:, order],
        joint_names=tuple(names[i] for i in order),
        notes=(*log.notes, *notes),
    )


def check_logs(logs: Sequence[Log], arm: Arm) -> None:
    """Refuse logs from which the arm cannot be identified.

    Args:
        logs: Logs with as many joints as the arm.
        arm: The nominal arm.

    Raises:
        InvalidInput: A log is too short, too coarse or too long, or its positions are not those of
            the arm.
    """
    for log in logs:
        duration = float(log.t[-1] - log.t[0])
        if duration < SHORTEST:
            raise InvalidInput(
                f"{log.source} covers {duration:.3g} s, but a robot is identified only from "
                f"{SHORTEST:g} s or more: record more.",
                needed=SHORTEST,
                allowed=duration,
            )
        if log.interval > COARSEST * (1 + 1e-6):
            raise InvalidInput(
                f"{log.source} has a sample every {log.interval * 1e3:.3g} ms, but a robot is "
                f"identified only from samples every {COARSEST * 1e3:g} ms or less: record faster.",
                needed=log.interval,
                allowed=COARSEST,
            )
        check_distance(log, arm)
        check_leading_rest(log)
    total = sum(float(x.t[-1] - x.t[0]) for x in logs)
    if total > LONGEST:
        raise InvalidInput(
            f"The logs cover {total:.4g} s, but at most {LONGEST:g} s are used: choose a part, by "
            "--from and --to or Log.between.",
            needed=total,
            allowed=LONGEST,
        )


def check_distance(log: Log, arm: Arm) -> None:
    """Refuse a log with positions that the arm cannot have.

    Args:
        log: The log, with as many joints as the arm.
        arm: The arm.

    Raises:
        InvalidInput: A joint is outside its range.
    """
    both = {"set-point": log.command, "measured position": log.measured}
    check_range_of_log(log.source, log.t, both, log.joint_names, arm)


def check_range_of_log(
    source: str,
    t: FloatArray,
    positions: Mapping[str, FloatArray],
    joint_names: Sequence[str],
    arm: Arm,
    *,
    margin: float = BEYOND,
    degrees_only: bool = False,
) -> None:
    """Refuse positions that the arm cannot have.

    Args:
        source: Where they come from, for messages.
        t: Times [s], (n,).
        positions: Positions [rad], (n, dof), by their names.
        joint_names: Names of their joints.
        arm: The arm.
        margin: Allowed distance from the range of a joint [rad].
        degrees_only: Whether to refuse only what would be within all ranges in degrees.

    Raises:
        InvalidInput: A joint is outside its range.
    """
    low, high = arm.limits.joint_range(arm.dof)
    for name, values in positions.items():
        beyond = np.maximum(low - values, values - high)
        i, j = map(int, np.unravel_index(np.argmax(beyond), beyond.shape))
        turned = np.radians(values)
        degrees = bool((turned >= low - BEYOND).all() and (turned <= high + BEYOND).all())
        if beyond[i, j] <= margin or (degrees_only and not degrees):
            continue
        hint = "correct the number, or give the arm of the file"
        if degrees:
            hint = (
                "all joints are within their ranges if the positions are degrees: are they? Then "
                "give all positions and rates that unit, such as q1 [deg] and dq1 [deg/s]"
            )
        raise InvalidInput(
            f"{source}: the {name} of {joint_names[j]} is {values[i, j]:.4g} rad at "
            f"t = {clock(t[i])} s, outside the range of {arm.name} from {low[j]:.4g} to "
            f"{high[j]:.4g} rad: {hint}.",
            t=float(t[i]),
            joint=j,
        )


def check_speeds(log: Log) -> None:
    """Refuse a log in which a joint moves faster than any does.

    Raises:
        InvalidInput: It does: its times are too short.
    """
    noise = white_noise(log.measured)
    for j, y in enumerate(log.measured.T):
        window = math.ceil(2 * float(noise[j]) / (NOISY * FASTEST * log.interval))
        k = min(max(window, FEWEST), len(y) - 1)
        speeds = np.abs(y[k:] - y[:-k]) / (log.t[k:] - log.t[:-k])
        i = int(np.argmax(speeds))
        if speeds[i] > FASTEST:
            raise InvalidInput(
                f"{log.source}: {log.joint_names[j]} moves at {speeds[i]:.3g} rad/s at t = "
                f"{clock(log.t[i])} s, but no joint is faster than {FASTEST:g} rad/s: give the "
                "columns the units that they have, such as t [s].",
                joint=j,
                t=float(log.t[i]),
                needed=float(speeds[i]),
                allowed=FASTEST,
            )


def check_leading_rest(log: Log) -> None:
    """Refuse a log that only another order, unit or direction of its columns explains.

    Raises:
        InvalidInput: A joint moves, but does not follow its command with a lag.
    """
    for j, (command, measured) in enumerate(zip(log.command.T, log.measured.T, strict=True)):
        rate, left = np.gradient(command), measured - command
        a = np.stack([rate, np.ones_like(rate)], axis=1)
        left = left - a @ np.linalg.lstsq(a, left, rcond=None)[0]
        moves = max(np.ptp(command), np.ptp(measured)) >= MOVES
        if not moves or np.sum(left**2) < (1 - FOLLOWS) * np.sum((measured - measured.mean()) ** 2):
            continue
        check_units(log, LONGEST_DEAD_TIME, j, alone=False)


def check_units(log: Log, longest: float, j: int, *, alone: bool = True) -> None:
    """Refuse a log whose joint j does not follow its command, if another reading explains it.

    Args:
        log: The log.
        longest: Largest dead time [s].
        j: The joint, from 0.
        alone: Whether to consider other units and directions of this joint alone, too.

    Raises:
        InvalidInput: Its columns are in another order, unit or direction.
    """
    for some in (slice(None), slice(j, j + 1))[: 1 + alone]:
        q, u, names = log.measured[:, some], log.command[:, some], log.joint_names[some]
        if found := find_misreading(log.t, q, u, names=names, late=longest):
            raise InvalidInput(
                f"{log.source}: {log.joint_names[j]} does not follow its commands: {found}.",
                joint=j,
            )


def check_is_whole(source: str, t: FloatArray, duration: float, slack: float) -> None:
    """Refuse a recording that does not cover a whole motion.

    Args:
        source: Where it comes from, for messages.
        t: Its times from the start of the motion [s], (n,).
        duration: Duration of the motion [s].
        slack: Time that may be missing at either end [s].

    Raises:
        InvalidInput: More is missing.
    """
    if t[0] > slack or t[-1] < duration - slack:
        raise InvalidInput(
            f"{source} covers the plan from {t[0]:.4g} s to {t[-1]:.4g} s, but the plan lasts from "
            f"0 to {duration:.4g} s: record the whole run, from before its first set-point until "
            "the arm rests."
        )


def find_misreading(
    t: FloatArray,
    measured: FloatArray,
    wanted: FloatArray,
    *,
    names: Sequence[str] = (),
    late: float | None = None,
) -> str:
    """What explains measured positions better than that they are read rightly, and what mends it.

    Units, signs and the order of columns are tried; a reading is believed only if it leaves far
    less.

    Args:
        t: Times [s], (n,).
        measured: Measured positions [rad], (n, dof).
        wanted: What the joints should do [rad], or, with `late`, what they are told, (n, dof).
        names: Names of the joints; their numbers by default.
        late: Largest dead time of joints that follow commands, with any lag and offset [s]; without
            it positions are compared as they are.

    Returns:
        What is wrong, as a part of a sentence; empty if no other reading explains the positions.
    """
    names = names or [str(j + 1) for j in range(wanted.shape[1])]
    if late is not None:
        piece = _liveliest(wanted)
        t, measured, wanted = t[piece], measured[piece], wanted[piece]
    found = _Comparison(t, measured, wanted, late)
    plain = found.apart()
    own, turn = np.diag(plain), 180 / math.pi
    enough = np.minimum(BETTER**2 * own.mean(), UNEXPLAINED * found.power.mean())
    for factor, what in (
        (1 / turn, "the measured positions look like degrees"),
        (turn, "the measured positions look like radians, but those they belong to like degrees"),
    ):
        # As a share of what is measured, whatever its unit.
        left = np.diag(found.apart(factor)).mean() / factor**2
        if left < min(BETTER * own.mean(), UNEXPLAINED * found.power.mean()):
            return f"{what}, so give their columns the right unit"
    order = _order(plain)
    if plain[order, np.arange(len(order))].mean() < enough:
        return (
            f"its columns fit the joints in the order {', '.join(names[k] for k in order)}, so "
            "name them, or put them in that order"
        )
    mirrored = np.diag(found.apart(-1.0))
    turned = mirrored < np.minimum(BETTER**2 * own, UNEXPLAINED * found.power)
    if np.where(turned, mirrored, own).mean() < enough:
        of = ", ".join(x for x, y in zip(names, turned, strict=True) if y)
        return f"commands and measured positions of {of} have opposite signs, so turn one of them"
    if late is not None:
        back = _Comparison(t, wanted, measured, late)
        left = np.diag(back.apart()).mean()
        if left < min(BETTER**2 * own.mean(), UNEXPLAINED * back.power.mean()):
            return "commands and measured positions are exchanged, so exchange their names"
    return ""


class _Comparison:
    """Second moments of measured and wanted positions, for every way in which joints may follow.

    Attributes:
        power: Mean squares of the measured columns [rad²], (dof,).
    """

    def __init__(self, t: FloatArray, y: FloatArray, u: FloatArray, late: float | None) -> None:
        pairs = [(y, u)] if late is None else _followed(t, y, u, late)
        self._yy = np.array([(a**2).mean(axis=0) for a, _ in pairs])[:, :, None]
        self._uu = np.array([(b**2).mean(axis=0) for _, b in pairs])[:, None, :]
        self._yu = np.array([a.T @ b / len(a) for a, b in pairs])
        self.power = self._yy[0, :, 0]

    def apart(self, factor: float = 1.0) -> FloatArray:
        """Mean squares by which each measured column, times a factor, is off each wanted one."""
        off = factor**2 * self._yy - 2 * factor * self._yu + self._uu
        return np.asarray(np.maximum(off, 0.0).min(axis=0))


def _followed(
    t: FloatArray, y: FloatArray, u: FloatArray, late: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Measured positions, and what joints do that follow u, both without their means."""
    step, pairs = float(t[-1] - t[0]) / (len(t) - 1), []
    delays = np.unique(np.round(np.linspace(0.0, late, DEAD_TIMES) / step).astype(int))
    for lag in LAGS:
        x = _lagged(t, u, lag)
        for k in delays[delays < len(t) // 2]:
            a, b = y[k:], x[: len(x) - k]
            pairs.append((a - a.mean(axis=0), b - b.mean(axis=0)))
    return pairs


def _lagged(t: FloatArray, u: FloatArray, lag: float) -> FloatArray:
    """Commands after a first-order lag [s], at rest before, (n, dof)."""
    from scipy.linalg import solve_banded

    if lag == 0.0:
        return u
    share = np.exp(-np.diff(t) / lag)
    # Row by row: what is left of the position before, and the rest of the command.
    matrix = np.ones((2, len(u)))
    matrix[1, :-1] = -share
    driven = np.array(u)
    driven[1:] *= 1 - share[:, None]
    return np.asarray(solve_banded((1, 0), matrix, driven))


def _liveliest(u: FloatArray) -> slice:
    """As many samples as are compared, where commands move most."""
    moved = np.concatenate([[0.0], np.cumsum(np.sum(np.diff(u, axis=0) ** 2, axis=1))])
    count = min(SAMPLES, len(u))
    first = int(np.argmax(moved[count - 1 :] - moved[: len(moved) - count + 1]))
    return slice(first, first + count)


def _order(apart: FloatArray) -> list[int]:
    """Which column fits each joint best, all in all."""
    from scipy.optimize import linear_sum_assignment

    other = AS_GOOD * apart.max() * (1 - np.eye(len(apart)))
    return [int(k) for k in linear_sum_assignment((apart + other).T)[1]]
