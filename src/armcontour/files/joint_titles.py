"""The table of names that columns of motion have, and the reader of one title."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import cache
from typing import NamedTuple

from armcontour.files.csv_table import Title

# Words of titles by their meaning, in the singular: names of PlotJuggler, ROS, controllers and
# their clients (UR's RTDE, KUKA's RSI, ABB's EGM, libfranka), in English and German.
TABLE = {
    "t": "t time timestamp stamp clock ipoc zeit zeitstempel",
    "fraction": "nanosec nsec nanosecond usec microsec microsecond",
    "command": "command commanded cmd u setpoint target reference ref desired des planned plan set "
    "nominal nom demand demanded goal soll sollwert lagesollwert sollposition as",
    "measured": "measured meas msr actual act feedback fb fbk encoder present ist istwert "
    "lageistwert istposition observed ai",
    "q": "q position pos angle joint axis axes j a theta achse gelenk winkel position lage",
    "dq": "dq qd qdot dot velocity vel velo speed omega geschwindigkeit drehzahl",
    "ddq": "ddq qdd qddot ddot acceleration acc accel beschleunigung",
    # Columns of other quantities, which are never joints.
    "other": "x y z rx ry rz qx qy qz qw current cur torque effort tau moment momentum force "
    "wrench jerk voltage temperature temp power energy pwm tcp pose tool cartesian orientation "
    "orient quaternion euler bit digital analog register mode status error err deviation ratio "
    "scaling scale fraction factor override output input counter count seq id line program load "
    "mass payload gain kp ki kd stiffness damping correction korr external accelerometer kraft "
    "strom drehmoment spannung temperatur fehler abweichung safety rist rsol rkorr",
    # Names of messages and files around the joints; not names of joints.
    "topic": "state controller trajectory header field robot arm data msg message value from start "
    "elapsed ros system host sample since nc plc to",
}
_MEANING = {word: what for what, words in TABLE.items() for word in words.split()}
# Units that end a title, such as q1_deg, and those of times by their symbols.
ANGLES = "rad mrad urad µrad deg degree degrees radian radians turn turns rev rpm"
TIMES = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **{"us": "us", "µs": "us", "ns": "ns"},
}
_SUFFIX = re.compile(
    r"(?P<name>.+?)(?:[ _/.]+|(?<=\d)|(?<=[a-z])(?=[A-Z]))"
    rf"(?P<unit>(?i:{'|'.join((*ANGLES.split(), *TIMES))})(?:(?:/|_per_)\w+(?:\^2|²)?)?|°)"
)
_RUN = re.compile(r"[^\W\d_]+|\d+")
# Parts of a word in which capitals begin the next word, such as AxisSet.
_CAPITALS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[^\W\d_A-Z]+")
_PARTS = re.compile(r"[/.:|]+")
# Angles of a tool, if no other word is in the title; wrist_roll is a joint.
TOOL_ANGLES = ("roll", "pitch", "yaw", "a", "b", "c")
# Axes of the tool's positions, words that may be with the axis, and units that end a title.
AXES = ("x", "y", "z")
TOOL_WORDS = ("tool", "tcp", "actual", "measured", "position", "pos")
LENGTHS = ("m", "mm", "um", "cm")
# Longest number of a joint.
MOST_DIGITS = 9
# SI units of the kinds of columns.
SI = {"t": "s", "fraction": "s", "q": "rad", "dq": "rad/s", "ddq": "rad/s^2"}


class Key(NamedTuple):
    """What a column of motion holds.

    Args:
        kind: "t", "fraction" (of the second, in a column of its own), "q", "dq" or "ddq"; "x", "y"
            or "z" of the tool.
        role: "command" or "measured"; empty for times.
        joint: Number of the joint as in the file, or its name; empty for times.
    """

    kind: str
    role: str = ""
    joint: str = ""

    def __str__(self) -> str:
        """A title of the column, for messages."""
        return f"{self.kind}{self.joint}"

    @property
    def si(self) -> str:
        """The SI unit."""
        return SI.get(self.kind, "m")


TIME = Key("t")
FRACTION = Key("fraction")


class _Word(NamedTuple):
    """A word of a title, its meaning (None for a name or a number), and what links it."""

    text: str
    meaning: str | None
    link: str


def read_joint_title(
    name: str, has_unit: bool, joint_names: Sequence[str] = ()
) -> Title[Key] | None:
    """Read a title without its unit in brackets; None if it is no time and no joint motion.

    Args:
        name: The title, such as `/joint_states/position[0]` or `target_q_0`.
        has_unit: Whether a unit in brackets follows; else the name may end with one.
        joint_names: Names of the joints of the arm, if it is known.
    """
    name, joint = _take_joint(name.strip(), joint_names)
    unit = None
    match = None if has_unit else _SUFFIX.fullmatch(name)
    if not has_unit and name.lower() in TIMES and len(name) > 1:
        name, unit = "t", TIMES[name.lower()]
    elif match and match["unit"].lower() in TIMES:
        # Else it is part of a name, such as joint_1_s.
        title = None if joint else read_joint_title(match["name"], True)
        if title is not None and title.key == TIME:
            return title._replace(unit=TIMES[match["unit"].lower()])
    elif match:
        name, unit = match["name"], match["unit"].replace("_per_", "/").lower()
    parts = [words for part in _PARTS.split(name) if (words := list(_words(part)))]
    words = [word for part in parts for word in part]
    meanings = [x.meaning for x in words]
    # What is before the last two parts is the name of a topic, such as /tool_controller.
    if any(x.meaning == "other" for part in parts[-2:] for x in part):
        return None
    if not joint and ("t" in meanings or "fraction" in meanings):
        return _time(words, unit)
    kind = next((x for x in ("ddq", "dq", "q") if x in meanings), "")
    roles = [x for x in meanings if x in ("command", "measured")]
    named = joint
    if not joint:
        joint = _joint(parts) if kind or roles else ""
    if not joint and kind == "q":
        return Title(Key("q", roles[-1] if roles else "measured", "1"), "rad", unit, 2)
    of_tool = not (kind or named) and joint.lower() in TOOL_ANGLES
    if not joint or of_tool or (joint.isdigit() and len(joint) > MOST_DIGITS):
        return None
    # Motors are no joints, and the state of a drive is preferred to the copy of a command.
    rank = (roles.count("command") > 1) + any(x.text.lower() == "theta" for x in words)
    key = Key(kind or "q", roles[-1] if roles else "measured", joint)
    return Title(key, key.si, unit, rank)


def read_tool_title(name: str, has_unit: bool) -> Title[Key] | None:
    """Read a title without its unit in brackets; None if it is no time and no axis of the tool."""
    words = [x.lower() for x in _RUN.findall(name)]
    unit = words.pop() if not has_unit and len(words) > 1 and words[-1] in LENGTHS else None
    axis = [x for x in words if x not in TOOL_WORDS]
    if len(axis) == 1 and axis[0] in AXES:
        return Title(Key(axis[0]), "m", unit)
    title = read_joint_title(name, has_unit)
    return title if title is not None and title.key in (TIME, FRACTION) else None


def _take_joint(name: str, joint_names: Sequence[str]) -> tuple[str, str]:
    """A title without the name of a joint of the arm, which may have any words, and that name."""
    if not joint_names or _are_numbers(tuple(joint_names)):
        return name, ""
    for joint in sorted(joint_names, key=len, reverse=True):
        if found := re.search(rf"(?<![^\W_]){re.escape(joint)}(?![^\W_])", name):
            before, after = name[: found.start()], name[found.end() :]
            beside = f"{_PARTS.split(before)[-1]} {_PARTS.split(after)[0]}"
            names = [x.text for x in _words(beside) if x.meaning is None]
            if set(map(str.lower, names)) <= {*ANGLES.split(), *TIMES}:
                return f"{before} {after}".strip(), joint
    return name, ""


@cache
def _are_numbers(joint_names: tuple[str, ...]) -> bool:
    """Whether the names of joints are their numbers, such as joint_1, joint_2."""
    found = [read_joint_title(x, True) for x in joint_names]
    numbers = [x.key.joint if x else "" for x in found]
    return numbers == [str(k) for k in range(1, len(numbers) + 1)]


def _time(words: Sequence[_Word], unit: str | None) -> Title[Key] | None:
    """The title of a time, or of the nanoseconds or microseconds of a time in two columns."""
    if not {x.meaning for x in words} <= {"t", "fraction", "topic", "q", "measured"}:
        return None
    for x in words:
        if x.meaning == "fraction":
            unit = "ns" if x.text.lower().startswith("n") else "us"
            return Title(FRACTION, "s", unit, len(words))
    return Title(TIME, "s", unit, len(words) - 1)


def _joint(parts: Sequence[Sequence[_Word]]) -> str:
    """Number or name of the joint, in the last part of a title that has any; "" without."""
    for part in reversed(parts):
        own = [x for x in part if x.meaning is None]
        if own and all(x.text.isdigit() for x in own):
            return own[-1].text.lstrip("0") or "0"
        if own:
            named = [x for x in part if x.meaning is None or x.text.lower() in ("joint", "axis")]
            return named[0].text + "".join(x.link + x.text for x in named[1:])
    return ""


def _words(part: str) -> Iterator[_Word]:
    """The words of one part of a title, with their meanings."""
    before, end = None, 0
    runs = list(_RUN.finditer(part))
    for match, later in zip(runs, [*runs[1:], None], strict=False):
        run, following = match[0], later[0] if later else ""
        link, end = "_" if match.start() > end else "", match.end()
        texts = [run] if run.isdigit() or _meaning(run) else _CAPITALS.findall(run)
        for text in texts:
            meaning = _meaning(text)
            if text.lower() in ("a", "j") and not following.isdigit():
                meaning = None
            if text == "d" and before in ("q", "dq", "ddq") and following.isdigit():
                meaning = "command"
            if text.lower() == "current" and _meaning(following) == "q":
                meaning = "measured"
            yield _Word(text, meaning, link)
            before, link = meaning, ""


@cache
def _meaning(word: str) -> str | None:
    """Meaning of a word, also in the plural; None if it is not in the table."""
    low = word.lower()
    singular = f"{low[:-3]}y" if low.endswith("ies") else low.removesuffix("s")
    return _MEANING.get(low) or _MEANING.get(singular)
