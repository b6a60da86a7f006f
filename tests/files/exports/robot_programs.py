r"""Interpreters of the written KRL, RAPID and URScript programs, and the kinematics of a UR5e.

They know only the languages, and share no code with the writers. Time passes as the program states:
blocks of a spline, `\T` of RAPID, `t` of `servoj`, and pauses. The slow move to the start takes no
time.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

NUMBER = r"-?\d+(?:\.\d+)?"
# Denavit-Hartenberg parameters of a UR5e: a [m], d [m], alpha [rad]
# (https://www.universal-robots.com/articles/ur/application-installation/dh-parameters-for-calculations-of-kinematics-and-dynamics/).
UR5E = (
    (0.0, 0.1625, np.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, np.pi / 2),
    (0.0, 0.0997, -np.pi / 2),
    (0.0, 0.0996, 0.0),
)
# A program that takes longer has no end [s].
ENDLESS = 1000.0


@dataclass(frozen=True)
class Action:
    """What a program does apart from motions: it sets an output, or waits for an input.

    - `kind`: "set" or "wait".
    - `name`: number or name of the output or input; analog outputs begin with "analog".
    - `value`: value of the output; for a wait, whether the input came in time.
    - `t`: time at which it is done; for a wait, at which it ends [s].
    - `waited`: time of a wait [s].
    - `q`: joint positions [rad], (6,).
    - `stands`: whether the robot is at rest.
    """

    kind: str
    name: str
    value: bool | float
    t: float
    q: np.ndarray
    stands: bool
    waited: float = 0.0


@dataclass
class Robot:
    """A robot that executes a program.

    `inputs`: functions from the robot to the state of an input, by number or name.
    """

    inputs: Mapping[str, Callable[[Robot], bool]] = field(default_factory=dict)
    t: float = 0.0
    q: np.ndarray = field(default_factory=lambda: np.full(6, np.nan))
    stands: bool = True
    times: list[float] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)
    actions: list[Action] = field(default_factory=list)
    outputs: dict[str, bool | float] = field(default_factory=dict)
    message: str = ""
    ended: str = ""

    def start(self, q: np.ndarray) -> None:
        """Move slowly to the first point."""
        self.q = q
        self.times.append(self.t)
        self.points.append(q)

    def move(self, q: np.ndarray, duration: float, *, stops: bool) -> None:
        """Move to a point, and stop there or pass it."""
        self.t += duration
        self.q = q
        self.stands = stops
        self.times.append(self.t)
        self.points.append(q)

    def pause(self, duration: float) -> None:
        """Let time pass."""
        self.t += duration
        assert self.t < ENDLESS, "the program has no end"

    def set(self, name: str, value: bool | float) -> None:
        """Set an output."""
        self.outputs[name] = value
        self.actions.append(Action("set", name, value, self.t, self.q, self.stands))

    def is_on(self, name: str) -> bool:
        """Read an input."""
        return bool(self.inputs[name](self))

    def wait(self, name: str, begin: float, came: bool) -> None:
        """Record a wait that began at a time and ends now."""
        action = Action("wait", name, came, self.t, self.q, self.stands, self.t - begin)
        self.actions.append(action)


def axes_of(text: str) -> np.ndarray:
    """Read six axes in degrees as numbers in rad."""
    return np.radians([float(x) for x in re.findall(rf"(?<![\w.])({NUMBER})", text)[:6]])


def run_krl(text: str, robot: Robot) -> Robot:
    """Execute a KRL program."""
    lines = [x.strip() for x in text.splitlines()]
    code = [x for x in lines if x and not x.startswith((";", "&", "DECL", "DEF", "BAS"))]
    assert code[-1] == "END"
    counter = 0
    waits: dict[str, float] = {}
    index = 0
    while code[counter] != "END":
        line = code[counter]
        counter += 1
        if line.startswith("PTP {"):
            robot.start(krl_axes(line))
        elif line == "PTP_SPLINE":
            end = code.index("ENDSPLINE", counter)
            krl_spline(code[counter:end], robot)
            counter = end + 1
        elif match := re.fullmatch(rf"WAIT SEC ({NUMBER})", line):
            robot.pause(float(match[1]))
        elif match := re.fullmatch(r"\$(OUT|ANOUT)\[(\d+)\] = (\S+)", line):
            krl_set(match[1], match[2], match[3], robot)
        elif line == "I = 0":
            index = 0
        elif line == "I = I + 1":
            index += 1
        elif match := re.fullmatch(r"WHILE NOT \$IN\[(\d+)\]", line):
            waits.setdefault(match[1], robot.t)
            if robot.is_on(match[1]):
                robot.wait(match[1], waits.pop(match[1]), True)
                counter = after(code, counter, "WHILE", "ENDWHILE")
        elif line == "ENDWHILE":
            counter = before(code, counter - 1, "WHILE", "ENDWHILE")
        elif match := re.fullmatch(r"IF I >= (\d+) THEN", line):
            if index < int(match[1]):
                counter = after(code, counter, "IF", "ENDIF")
            else:
                ((name, begin),) = waits.items()
                robot.wait(name, begin, False)
        elif match := re.fullmatch(r'MESSAGE = \{.*MSG_TXT\[\] "(.*)"\}', line):
            robot.message = match[1]
        elif line.startswith("FOR I"):
            counter = after(code, counter, "FOR", "ENDFOR")
        elif line == "LOOP":
            # Only a program that cannot be continued has a loop.
            assert code[counter : counter + 2] == ["HALT", "ENDLOOP"]
            robot.ended = "halt"
            return robot
        else:
            known = ("OPTIONS = ", "HANDLE = SET_KRLMSG(#QUIT", "ENDIF")
            assert line.startswith(known), f"unknown: {line}"
    robot.ended = "end"
    return robot


def krl_axes(line: str) -> np.ndarray:
    """Read the axes of a point."""
    return np.radians([float(x) for x in re.findall(rf"A\d ({NUMBER})", line)])


def krl_set(kind: str, number: str, value: str, robot: Robot) -> None:
    """Set a digital or an analog output."""
    if kind == "ANOUT":
        robot.set(f"analog {number}", float(value))
        return
    assert value in ("TRUE", "FALSE")
    robot.set(number, value == "TRUE")


def krl_spline(code: Sequence[str], robot: Robot) -> None:
    """Execute a spline block, whose points share its time by percentages."""
    begin = robot.t
    points: list[np.ndarray] = []
    percents = [0.0]
    triggers: list[tuple[int, float, str, str, str]] = []
    duration = np.nan
    for line in code:
        if line.startswith("SPTP {"):
            points.append(krl_axes(line))
        elif match := re.fullmatch(rf"TIME_BLOCK PART = ({NUMBER})", line):
            percents.append(percents[-1] + float(match[1]))
        elif match := re.fullmatch(rf"TIME_BLOCK END = ({NUMBER})", line):
            duration = float(match[1])
        elif match := re.fullmatch(
            rf"TRIGGER WHEN PATH = 0 ONSTART DELAY = ({NUMBER}) "
            r"DO \$(OUT|ANOUT)\[(\d+)\] = (\S+)",
            line,
        ):
            triggers.append((len(points), 1e-3 * float(match[1]), *match.groups()[1:]))
        else:
            assert line == "TIME_BLOCK START", f"unknown: {line}"
    assert len(percents) == len(points)
    times = [begin + x / 100 * duration for x in (*percents, 100.0)]
    due = [(times[k] + delay, 0, words) for k, delay, *words in triggers]
    due += [(t, 1, q) for t, q in zip(times[1:], points, strict=True)]
    for t, is_point, what in sorted(due, key=lambda x: x[:2]):
        if is_point:
            robot.move(what, t - robot.t, stops=t == times[-1])
        else:
            robot.stands = False
            robot.t = t
            krl_set(*what, robot)


def after(code: Sequence[str], counter: int, opening: str, closing: str) -> int:
    """Return the index after the end of the block that begins before a line."""
    depth = 1
    while depth:
        depth += code[counter].startswith(f"{opening} ") - (code[counter] == closing)
        counter += 1
    return counter


def before(code: Sequence[str], counter: int, opening: str, closing: str) -> int:
    """Return the index of the beginning of the block that ends at a line."""
    depth = 1
    while depth:
        counter -= 1
        depth += (code[counter] == closing) - code[counter].startswith(f"{opening} ")
    return counter


def run_rapid(text: str, robot: Robot) -> Robot:
    """Execute a RAPID program."""
    lines = [x.strip() for x in text.splitlines()]
    begin = next(i for i, x in enumerate(lines) if x.startswith("PROC "))
    code = [x for x in lines[begin + 1 : lines.index("ENDPROC")] if x and not x.startswith("!")]
    timed_out = False
    counter = 0
    while counter < len(code):
        line = code[counter]
        counter += 1
        if match := re.fullmatch(
            rf"MoveAbsJ \[\[(.*?)\], .*\], (slow|v1000 \\T:=({NUMBER})), (fine|z1), tool0;", line
        ):
            if match[2] == "slow":
                robot.start(axes_of(match[1]))
            else:
                robot.move(axes_of(match[1]), float(match[3]), stops=match[4] == "fine")
        elif match := re.fullmatch(r"SetDO (\w+), ([01]);", line):
            robot.set(match[1], match[2] == "1")
        elif match := re.fullmatch(rf"SetAO (\w+), ({NUMBER});", line):
            robot.set(f"analog {match[1]}", float(match[2]))
        elif match := re.fullmatch(rf"WaitTime ({NUMBER});", line):
            robot.pause(float(match[1]))
        elif match := re.fullmatch(
            rf"WaitDI (\w+), 1 \\MaxTime:=({NUMBER}) \\TimeFlag:=timed_out;", line
        ):
            begin_time = robot.t
            end_time = begin_time + float(match[2])
            while not robot.is_on(match[1]) and robot.t < end_time:
                robot.pause(min(0.01, end_time - robot.t))
            timed_out = not robot.is_on(match[1])
            robot.wait(match[1], begin_time, not timed_out)
        elif line == "IF timed_out THEN":
            counter = counter if timed_out else code.index("ENDIF", counter)
        elif match := re.fullmatch(r'TPWrite "(.*)";', line):
            robot.message = match[1]
        elif line == "EXIT;":
            robot.ended = "halt"
            return robot
        else:
            assert line in ("ENDIF", "VAR bool timed_out;"), f"unknown: {line}"
    robot.ended = "end"
    return robot


def run_urscript(text: str, robot: Robot) -> Robot:
    """Execute a URScript program; `while` blocks contain an `if` block only."""
    lines = [x.split("#")[0].strip() for x in text.splitlines()]
    first = next(i for i, x in enumerate(lines) if x.startswith("def "))
    code = [x for x in lines[first + 1 :] if x]
    counter = 0
    cycles = 0
    waits: dict[str, float] = {}
    while code[counter] != "end" or waits:
        line = code[counter]
        counter += 1
        if match := re.fullmatch(r"movej\(\[(.*)\], .*\)", line):
            robot.start(np.array([float(x) for x in match[1].split(",")]))
        elif match := re.fullmatch(rf"servoj\(\[(.*)\], 0, 0, ({NUMBER}), lookahead, gain\)", line):
            q = np.array([float(x) for x in match[1].split(",")])
            robot.move(q, float(match[2]), stops=bool((q == robot.q).all()))
        elif match := re.fullmatch(r"set_standard_digital_out\((\d), (True|False)\)", line):
            robot.set(match[1], match[2] == "True")
        elif match := re.fullmatch(rf"set_standard_analog_out\((\d), ({NUMBER})\)", line):
            robot.set(f"analog {match[1]}", float(match[2]))
        elif match := re.fullmatch(r"while not get_standard_digital_in\((\d)\):", line):
            waits.setdefault(match[1], robot.t)
            if robot.is_on(match[1]):
                robot.wait(match[1], waits.pop(match[1]), True)
                counter = ur_after(code, counter)
            loop = counter - 1
        elif match := re.fullmatch(r"if cycles >= (\d+):", line):
            if cycles < int(match[1]):
                counter = ur_after(code, counter)
            else:
                ((name, begin),) = waits.items()
                robot.wait(name, begin, False)
        elif line == "cycles = 0":
            cycles = 0
        elif line == "cycles = cycles + 1":
            cycles += 1
        elif line == "end":
            counter = loop
        elif match := re.fullmatch(r'popup\("(.*)", title="armcontour", .*blocking=True\)', line):
            robot.message = match[1]
        elif line == "halt":
            robot.ended = "halt"
            return robot
        else:
            known = ("lookahead = ", "gain = ", "stopj(", "textmsg(")
            assert line.startswith(known), f"unknown: {line}"
    robot.ended = "end"
    return robot


def ur_after(code: Sequence[str], counter: int) -> int:
    """Return the index after the `end` of the block that begins before a line."""
    depth = 1
    while depth:
        depth += code[counter].startswith(("while ", "if ")) - (code[counter] == "end")
        counter += 1
    return counter


RUN = {"kuka": run_krl, "abb": run_rapid, "urscript": run_urscript}
ENDING = {"kuka": "src", "abb": "mod", "urscript": "script"}


def tool_poses(q: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m], (n, 3), and rotations, (n, 3, 3), of a UR5e's tool of a length [m]."""
    pose = np.tile(np.eye(4), (len(q), 1, 1))
    for angle, (a, d, alpha) in zip(np.asarray(q).T, UR5E, strict=True):
        cos = np.cos(angle)
        sin = np.sin(angle)
        zero = np.zeros_like(angle)
        one = np.ones_like(angle)
        ca = np.cos(alpha)
        sa = np.sin(alpha)
        step = np.array(
            [
                [cos, -sin * ca, sin * sa, a * cos],
                [sin, cos * ca, -cos * sa, a * sin],
                [zero, one * sa, one * ca, one * d],
                [zero, zero, zero, one],
            ]
        )
        pose = pose @ np.moveaxis(step, 2, 0)
    rotation = pose[:, :3, :3]
    return pose[:, :3, 3] + length * rotation[:, :, 2], rotation


def off_polyline(points: np.ndarray, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance of each point from a polyline [m], (n,), and the arc length there."""
    begin = vertices[:-1]
    along = vertices[1:] - begin
    squares = np.maximum((along**2).sum(axis=1), 1e-30)
    starts = np.concatenate([[0.0], np.cumsum(np.sqrt(squares))])[:-1]
    distances = np.empty(len(points))
    lengths = np.empty(len(points))
    for i, point in enumerate(points):
        share = np.clip(((point - begin) * along).sum(axis=1) / squares, 0.0, 1.0)
        apart = np.linalg.norm(begin + share[:, None] * along - point, axis=1)
        k = int(apart.argmin())
        distances[i] = apart[k]
        lengths[i] = starts[k] + share[k] * np.sqrt(squares[k])
    return distances, lengths
