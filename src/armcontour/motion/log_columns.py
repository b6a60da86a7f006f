"""Joints of logs in the order of an arm, and positions that a recorder repeats."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.text import count_noun, list_some, show
from armcontour.motion.log import Log

# Largest number of names in one message.
MAX_NAMED = 8
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
    """Return whether one of two names is the other name with a prefix."""
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
    notes = []
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
