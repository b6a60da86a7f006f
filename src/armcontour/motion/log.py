"""A recorded motion: commanded and measured positions of each joint, in the order of an arm."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import field, replace
from itertools import product
from os.path import commonprefix
from typing import Annotated, Any, NoReturn

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Axes, Choice, Name, Quantity
from armcontour.core.text import clock, count_noun, list_some, short_repr, show
from armcontour.motion.log_checks import GAP, check_samples, refuse_wrapped
from armcontour.motion.time_finding import TimeFinding
from armcontour.robot import Arm

# Interpolation of the command between two samples of a log.
INTERPOLATIONS = ("linear", "step")
POSITIONS = ("command", "measured")
# Smallest number of samples; fewer samples cannot separate four parameters and the noise.
FEWEST = 50
# Separates the words of a joint's name.
SEPARATOR = re.compile(r"[\W_]")
# Largest number of names in one message.
MAX_LISTED_NAMES = 8


@declared(eq=False)
class Log(Checked):
    """Set-points and measured positions of joints at the same times.

    A log may have gaps, as from lost packets, in which the commands are unknown.

    >>> t = np.arange(250) * 4e-3
    >>> ac.Log(t=t, command=np.sin(t)[:, None], measured=np.sin(t - 0.01)[:, None]).dof
    1

    Args:
        t: Times [s], increasing, (n,).
        command: Set-points [rad], (n, dof).
        measured: Measured positions [rad], (n, dof).
        velocity: Measured velocities [rad/s], (n, dof), which show wrong times; None if they were
            not recorded.
        joint_names: One per joint; "joint 1", ... by default.
        interpolation: Interpolation of the controller between set-points, "linear" or "step"; None
            if unknown.
        source: Where the log comes from, for messages.
        notes: What the reader recognised and ignored in the file.
        prismatic: Whether each joint is prismatic, with m instead of rad; by default none is.
        plan_time: Time of the plan at each sample [s], (n,), of a motion that `play` has recorded;
            None if unknown.
        findings: What was wrong with the times, and was repaired.

    Raises:
        InvalidInput: Times do not increase or are too near to each other, angles wrap, or there are
            too few samples.
    """

    t: Annotated[FloatArray, Quantity("s"), Axes("n")] = field(kw_only=False)
    command: Annotated[FloatArray, Quantity("rad"), Axes(...)] = field(kw_only=False)
    measured: Annotated[FloatArray, Quantity("rad"), Axes(...)]
    velocity: Annotated[FloatArray, Quantity("rad/s"), Axes(...)] | None = None
    joint_names: tuple[Name, ...] = ()
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None
    source: str = "the log"
    notes: tuple[str, ...] = ()
    prismatic: tuple[bool, ...] = ()
    plan_time: Annotated[FloatArray, Quantity("s"), Axes("n")] | None = None
    findings: tuple[TimeFinding, ...] = ()

    def _check_together(self) -> None:
        if len(self.t) < FEWEST:
            raise InvalidInput(
                f"{self.source} has {len(self.t)} samples, but at least {FEWEST} are needed. "
                "Record a longer motion."
            )
        for name in (*POSITIONS, *["velocity"] * (self.velocity is not None)):
            object.__setattr__(self, name, self._check_rows(name))
        dof = self.dof
        if self.measured.shape[1] != dof:
            raise InvalidInput(
                f"{self.source} has commands for {dof} joints, but measured positions of "
                f"{self.measured.shape[1]} joints. Both need the same joints."
            )
        if self.velocity is not None and self.velocity.shape[1] != dof:
            raise InvalidInput(
                f"{self.source} has {dof} joints, but velocities of {self.velocity.shape[1]} "
                "joints. Both need the same joints."
            )
        names = self.joint_names or tuple(f"joint {j + 1}" for j in range(dof))
        if len(names) != dof or len(set(names)) != dof:
            raise InvalidInput(
                f"{self.source} needs {dof} different joint names, not {', '.join(names)}."
            )
        if self.plan_time is not None and len(self.plan_time) != len(self.t):
            raise InvalidInput(
                f"{self.source} has {len(self.t)} samples, but {len(self.plan_time)} times of the "
                "plan. Both need the same number."
            )
        slides = self.prismatic or (False,) * dof
        if len(slides) != dof:
            raise InvalidInput(f"prismatic of {self.source} must have one value per joint.")
        object.__setattr__(self, "joint_names", names)
        object.__setattr__(self, "prismatic", slides)
        arrays = {x: getattr(self, x) for x in POSITIONS}
        if self.velocity is not None:
            arrays["dq"] = self.velocity
        check_samples(self.t, arrays, self._name_value)
        for j, name in product(range(dof), POSITIONS):
            position = f"{self.source}: the {name} position of {names[j]}"
            if not slides[j]:
                refuse_wrapped(position, self.t, getattr(self, name)[:, j], j)

    __repr__ = short_repr

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.command.shape[1])

    @property
    def interval(self) -> float:
        """The usual time between two samples [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def gaps(self) -> IntArray:
        """Indices of the samples after which there is a gap, (gaps,)."""
        return np.flatnonzero(np.diff(self.t) > GAP * self.interval)

    def between(self, start: float = -math.inf, end: float = math.inf) -> Log:
        """Return the part of the log from `start` to `end` [s].

        Args:
            start: First time to keep [s]; by default from the first sample.
            end: Last time to keep [s]; by default until the last sample.
        """
        return self.at(_time_mask(self.t, start, end, self.source))

    def at(self, used: BoolArray) -> Log:
        """Return the part of the log with some samples.

        Args:
            used: Mask of the samples, (n,).

        Raises:
            InvalidInput: `used` is not an array of True and False, one per sample.
        """
        mask = np.asarray(checks.check_type("used", used, np.ndarray))
        if mask.dtype != np.bool_ or mask.shape != self.t.shape:
            raise InvalidInput(
                f"used must be an array of True and False with one value for each of the "
                f"{len(self.t)} samples, but has the shape {mask.shape}."
            )
        return replace(
            self,
            t=self.t[mask],
            command=self.command[mask],
            measured=self.measured[mask],
            velocity=None if self.velocity is None else self.velocity[mask],
            plan_time=None if self.plan_time is None else self.plan_time[mask],
        )

    @property
    def lowest_override(self) -> float:
        """Smallest share of the planned speed at which the motion was executed; 1 if unknown."""
        if self.plan_time is None:
            return 1.0
        return min(float((np.diff(self.plan_time) / np.diff(self.t)).min()), 1.0)

    def _check_rows(self, name: str) -> FloatArray:
        """Return positions as a read-only array, (n, dof); raise InvalidInput for other shapes."""
        values = getattr(self, name)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) != len(self.t) or values.shape[1] == 0:
            raise InvalidInput(
                f"{self.source}: {name} has shape {values.shape}, but must have one row for "
                f"each of the {len(self.t)} times and one column per joint."
            )
        return checks.frozen_array(np.ascontiguousarray(values))

    def _name_value(self, name: str, i: int, j: int) -> str:
        """Return the name of a time or a position for messages.

        - `name`: "t", "dq", or a name in POSITIONS.
        - `i`, `j`: row and column of the value.
        """
        if name == "t":
            return f"{self.source}: the time of sample {i + 1}"
        position = f"the {name} position of {self.joint_names[j]}"
        if name == "dq":
            position = f"the measured velocity of {self.joint_names[j]}"
        return f"{self.source}: {position} at t = {clock(self.t[i])} s"


def with_units_of(log: Log, arm: Arm) -> Log:
    """Return the log with the units of an arm's joints.

    Raises:
        ArmMismatch: A column of the file has a unit of length, but the joint is revolute.
    """
    prismatic = arm.chain.prismatic or log.prismatic
    joints = zip(log.joint_names, log.prismatic, prismatic, strict=True)
    for name, has_length_unit, is_prismatic in joints:
        if has_length_unit and not is_prismatic:
            raise ArmMismatch(
                f"{log.source}: {name} has a unit of length, but this joint of {arm.name} is "
                "revolute. Correct the unit in the column title."
            )
    return log if log.prismatic == prismatic else replace(log, prismatic=prismatic)


def cut_log(
    t: FloatArray,
    command: FloatArray,
    measured: FloatArray,
    window: tuple[float, float],
    *,
    source: str = "the log",
    velocity: FloatArray | None = None,
    plan_time: FloatArray | None = None,
    **fields: Any,
) -> Log:
    """Make a log from a part of arrays; the complete arrays need not be a valid log.

    Args:
        t: Times [s], (n,).
        command: Set-points [rad], (n, dof).
        measured: Measured positions [rad], (n, dof).
        window: First and last time to use [s].
        source: Where the arrays come from, for messages.
        velocity: Measured velocities [rad/s], (n, dof); None if unknown.
        plan_time: Times of the plan [s], (n,); None if unknown.
        fields: Other fields of `Log`.

    Raises:
        InvalidInput: The window has no samples, or `Log` refuses them.
    """
    used = _time_mask(t, *window, source)
    command = np.asarray(command)[used]
    measured = np.asarray(measured)[used]
    return Log(
        t=np.asarray(t)[used],
        command=command,
        measured=measured,
        source=source,
        velocity=None if velocity is None else velocity[used],
        plan_time=None if plan_time is None else plan_time[used],
        **fields,
    )


def _time_mask(t: FloatArray, start: float, end: float, source: str) -> BoolArray:
    """Return the mask of the samples from `start` to `end`, (n,); InvalidInput if none."""
    for name, value in (("first", start), ("last", end)):
        # NaN fails the comparison; NumPy cannot compare larger integers.
        largest = checks.LARGEST_NUMBER if isinstance(value, int) else math.inf
        if not (isinstance(value, int | float | np.number) and abs(value) <= largest):
            raise InvalidInput(
                f"The {name} time of {source} must be a number in s, not {show(value)}."
            )
    used = (np.asarray(t) >= start) & (np.asarray(t) <= end)
    if len(t) and not used.any():
        raise InvalidInput(
            f"{source} has no sample from {start:g} s to {end:g} s. Its times are from "
            f"{clock(np.min(t))} s to {clock(np.max(t))} s."
        )
    return np.asarray(used)


def match_joints(names: Sequence[str], requested: Sequence[str], source: str) -> list[int] | None:
    """Return the index in `names` of each requested joint; None unless all are found.

    Names match if they are equal, or if one of them is the other one with a prefix. If this does
    not match all joints, the words are compared that are left without a common prefix and a common
    suffix of all joints, on both sides. At least one letter must be left.

    >>> from armcontour.motion.log import match_joints
    >>> match_joints(["left_elbow", "left_wrist"], ["wrist", "elbow"], "log.csv")
    [1, 0]
    >>> match_joints(["r1/elbow", "r1/wrist"], ["left_wrist", "left_elbow"], "log.csv")
    [1, 0]

    Args:
        names: Names in a file.
        requested: Joint names of the arm, in its order.
        source: Name of the file, for messages.

    Raises:
        InvalidInput: Two names match one joint.
    """
    if not requested:
        return None
    if set(requested) <= set(names):
        return [names.index(x) for x in requested]
    indices = []
    for joint in requested:
        alike = [i for i, x in enumerate(names) if x == joint]
        alike = alike or [i for i, x in enumerate(names) if _is_prefixed(x, joint)]
        if len(alike) > 1:
            # The pattern of the longer name does not match the shorter one.
            alike = sorted(alike[:2], key=lambda i: len(names[i]))
            other = names[alike[1]].removesuffix(joint)
            raise InvalidInput(
                f"{source}: {' and '.join(show(names[i]) for i in alike)} can both be the "
                f"joint {joint}. Ignore the other one with --columns '-=*{other}*'."
            )
        indices += alike
    if len(set(indices)) == len(requested):
        return indices
    return _match_words(names, requested, source)


def _match_words(names: Sequence[str], requested: Sequence[str], source: str) -> list[int] | None:
    """Match joints by the words without a common prefix and suffix, as `match_joints` does."""
    for words in _without_affixes(requested):
        frames = [x for x in _frames_of(words[0], names) if _has_all(x, words, names)]
        if len(frames) > 1:
            # The pattern of the longer frame does not match names with the shorter one.
            frames = sorted(frames[:2], key=lambda x: len(x[0] + x[1]))
            both = " and ".join(show(prefix + words[0] + suffix) for prefix, suffix in frames)
            ignored = "*".join(filter(None, frames[1]))
            raise InvalidInput(
                f"{source}: {both} can both be the joint {requested[0]}. Ignore the other one "
                f"with --columns '-=*{ignored}*'."
            )
        if frames:
            ((prefix, suffix),) = frames
            return [names.index(prefix + x + suffix) for x in words]
    return None


def _without_affixes(names: Sequence[str]) -> Iterator[list[str]]:
    """Yield names without prefixes and suffixes that all have, the shortest affixes first.

    Affixes consist of whole words. All names keep a letter.
    """
    shared_prefix = commonprefix(names)
    shared_suffix = commonprefix([x[::-1] for x in names])[::-1]
    starts = [0, *(x.end() for x in SEPARATOR.finditer(shared_prefix))]
    ends = [0, *(len(shared_suffix) - x.start() for x in SEPARATOR.finditer(shared_suffix))]
    for start, end in sorted(product(starts, sorted(ends)), key=sum):
        words = [x[start : len(x) - end] for x in names]
        if all(any(y.isalpha() for y in x) for x in words):
            yield words


def _frames_of(word: str, names: Sequence[str]) -> list[tuple[str, str]]:
    """Return prefix and suffix of each name that contains a word between separators."""
    frames = []
    for name in names:
        for match in re.finditer(rf"(?<![^\W_]){re.escape(word)}(?![^\W_])", name):
            frames.append((name[: match.start()], name[match.end() :]))
    return frames


def _has_all(frame: tuple[str, str], words: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether all words with a prefix and a suffix are names."""
    prefix, suffix = frame
    return {prefix + x + suffix for x in words} <= set(names)


def _is_prefixed(long: str, short: str) -> bool:
    """Return whether one of two names is the other name with a prefix."""
    if len(long) < len(short):
        long, short = short, long
    return not short.isdigit() and re.fullmatch(rf".*[_\W]{re.escape(short)}", long) is not None


def is_same_joint(name: str, joint: str) -> bool:
    """Return whether a name in a file is that of a joint, also with a prefix."""
    return name == joint or _is_prefixed(name, joint)


def raise_other_joints(
    source: str,
    names: Sequence[str],
    joint_names: Sequence[str],
    titles: Sequence[str] = (),
    notes: Sequence[str] = (),
) -> NoReturn:
    """Raise ArmMismatch for joints that an arm does not have.

    Args:
        source: Name of the file, for the message.
        names: Joint names in the file.
        joint_names: Joint names of the arm.
        titles: Column titles for --columns, one per name.
        notes: Sentences that end the message.
    """
    have = list_some([show(x) for x in names], MAX_LISTED_NAMES)
    arm = list_some([show(x) for x in joint_names], MAX_LISTED_NAMES)
    fix = "Add the other joints to the file"
    if len(names) >= len(joint_names):
        fix = "Name the joints in the file like those of the arm"
        missing = [x for x in joint_names if x not in names]
        spare = [title for x, title in zip(names, titles, strict=False) if x not in joint_names]
        if len(missing) == len(spare) == 1:
            fix = f"{fix} (for example with --columns '{missing[0]}={spare[0]}')"
        elif missing and spare:
            # Only the user knows which of them belong together.
            pairs = ",".join(f"{x}=NAME" for x in missing[:MAX_LISTED_NAMES])
            names_left = list_some([show(x) for x in spare], MAX_LISTED_NAMES)
            fix = f"{fix} (with --columns '{pairs}', where each NAME is one of {names_left})"
    sentence = (
        f"{source} has {count_noun(len(names), 'joint')} ({have}), but the arm has "
        f"{len(joint_names)} ({arm}). {fix}, or specify the arm of the file (--arm)."
    )
    raise ArmMismatch(" ".join((sentence, *notes)), needed=len(names), allowed=len(joint_names))


def arrange_joints(log: Log, joint_names: Sequence[str]) -> Log:
    """Sort the joints of a log in the order of an arm's `joint_names`, as `match_joints` does.

    Numbered joints keep their order. Joints that the arm does not have are left out.

    Raises:
        ArmMismatch: The log lacks a joint.
    """
    names = log.joint_names
    source = log.source
    order = match_joints(names, joint_names, source)
    is_numbered = all(re.fullmatch(r"joint \d+", name) for name in names)
    has_all_numbers = is_numbered and len(names) == len(joint_names)
    if order is None and has_all_numbers:
        return log
    if order is None or (is_numbered and not has_all_numbers):
        raise_other_joints(source, names, joint_names, notes=log.notes)
    notes = []
    if renamed := [x for x in zip(order, joint_names, strict=True) if names[x[0]] != x[1]]:
        pairs = list_some([f"{show(names[i])} is {x}" for i, x in renamed], MAX_LISTED_NAMES)
        notes.append(f"Joints of {source} are matched by parts of their names: {pairs}.")
    if spare := [name for i, name in enumerate(names) if i not in order]:
        ignored = list_some(spare, MAX_LISTED_NAMES)
        notes.append(f"Joints of {source} that the arm does not have are ignored: {ignored}.")
    return replace(
        log,
        command=log.command[:, order],
        measured=log.measured[:, order],
        velocity=None if log.velocity is None else log.velocity[:, order],
        joint_names=tuple(names[i] for i in order),
        prismatic=tuple(log.prismatic[i] for i in order),
        notes=(*log.notes, *notes),
    )
