"""A slow, obvious interpreter of the G-code that docs/guides/gcode.md describes.

It reads character by character, turns arcs as complex numbers and shares nothing with the package:
formulas go through reverse Polish notation, O words become a tree of nested blocks that is walked
by recursion, and coordinates go through 4 x 4 matrices from the program to the machine.
It takes valid programs only: what is to be refused is not its business.
"""

import cmath
import math
import operator
import re
from dataclasses import dataclass, field, make_dataclass
from fractions import Fraction

import numpy as np

NANOMETRE = 1e-9


@dataclass
class Segment:
    """One move: `at(share)` is its point, for shares from 0 to 1 of its length."""

    kind: str
    at: object
    length: float
    speed: float
    tolerance: float


@dataclass
class Contour:
    line: int
    name: str = ""
    segments: list = field(default_factory=list)
    events: list = field(default_factory=list)  # (number of segments before it, name, value)


Rapid = make_dataclass("Rapid", ["points"])
Event = make_dataclass("Event", ["name", "value"])
Dwell = make_dataclass("Dwell", ["duration"])


def number(text):
    """The double nearest to a decimal number."""
    sign = -1 if text[:1] == "-" else 1
    whole, _, decimals = text.lstrip("+-").partition(".")
    return sign * float(Fraction(int((whole + decimals) or "0"), 10 ** len(decimals)))


def bare(line):
    """A line in upper case without spaces and comments, character by character."""
    found, depth = "", False
    for char in line:
        if depth:
            depth = char != ")"
        elif char == "(":
            depth = True
        elif char == ";":
            break
        elif not char.isspace():
            found += char.upper()
    return found


WORDS = ("ATAN ACOS ASIN ABS COS EXP FIX FUP LN ROUND SIN SQRT TAN EXISTS").split()
BINARY = {
    "**": (5, operator.pow), "*": (4, operator.mul), "/": (4, operator.truediv),
    "MOD": (4, lambda a, b: math.fmod(a, b) + (abs(b) if math.fmod(a, b) < 0 else 0)),
    "+": (3, operator.add), "-": (3, operator.sub),
    "EQ": (2, lambda a, b: float(abs(a - b) < 1e-6)),
    "NE": (2, lambda a, b: float(not abs(a - b) < 1e-6)),
    "GT": (2, lambda a, b: float(a > b)), "GE": (2, lambda a, b: float(a >= b)),
    "LT": (2, lambda a, b: float(a < b)), "LE": (2, lambda a, b: float(a <= b)),
    "AND": (1, lambda a, b: float(bool(a) and bool(b))),
    "OR": (1, lambda a, b: float(bool(a) or bool(b))),
    "XOR": (1, lambda a, b: float(bool(a) != bool(b))),
}  # fmt: skip


def rounded(x):
    """To the nearest whole number, halves away from zero."""
    return float(int(x + (0.5 if x > 0 else -0.5)))


UNARY = {
    "ABS": abs, "EXP": math.exp, "FIX": math.floor, "FUP": math.ceil, "LN": math.log,
    "ROUND": rounded, "SQRT": math.sqrt,
    "ACOS": lambda x: math.acos(x) * 180 / math.pi,
    "ASIN": lambda x: math.asin(x) * 180 / math.pi,
    "COS": lambda x: math.cos(x * math.pi / 180),
    "SIN": lambda x: math.sin(x * math.pi / 180),
    "TAN": lambda x: math.tan(x * math.pi / 180),
}  # fmt: skip


class Formula:
    """Values in compact text; brackets become lists, and lists reverse Polish notation."""

    def __init__(self, text, memory):
        self.text, self.at, self.memory = text, 0, memory

    def starts(self, *choices):
        return next((x for x in choices if self.text.startswith(x, self.at)), None)

    def value(self):
        """One number, parameter, function or bracket, with its signs."""
        if self.starts("-", "+"):
            self.at += 1
            return -self.value() if self.text[self.at - 1] == "-" else self.value()
        if self.starts("["):
            return self.bracket()
        if self.starts("#"):
            return self.memory.read(self.name())
        word = self.starts(*WORDS)
        if word:
            self.at += len(word)
            if word == "EXISTS":
                self.at += 1
                key = self.name()
                self.at += 1
                return float(self.memory.has(key))
            first = self.bracket()
            if word != "ATAN":
                return UNARY[word](first)
            self.at += 1
            return cmath.phase(complex(self.bracket(), first)) * 180 / math.pi
        digits = ""
        while self.text[self.at : self.at + 1] in tuple("0123456789."):
            digits += self.text[self.at]
            self.at += 1
        return number(digits)

    def name(self):
        """What stands after a #: a number, or a name."""
        self.at += 1
        if self.starts("<"):
            end = self.text.index(">", self.at)
            found = self.text[self.at + 1 : end].lower()
            self.at = end + 1
            return found
        return round(self.value())

    def bracket(self):
        self.at += 1
        found = self.row()
        self.at += 1
        return found

    def row(self):
        """Operations one after the other, by the shunting yard."""
        values, waiting = [self.value()], []

        def apply():
            b, a = values.pop(), values.pop()
            values.append(BINARY[waiting.pop()][1](a, b))

        # XOR before OR, and ** before *.
        while sign := self.starts("**", "XOR", *BINARY):
            self.at += len(sign)
            while waiting and BINARY[waiting[-1]][0] >= BINARY[sign][0]:
                apply()
            waiting.append(sign)
            values.append(self.value())
        while waiting:
            apply()
        return values[0]


class Memory:
    """Parameters; each subprogram has a dictionary of its own for #1 to #30 and local names."""

    def __init__(self, machine):
        self.machine, self.common, self.own = machine, {}, [{}]

    def place(self, key):
        local = key <= 30 if isinstance(key, int) else key[0] != "_"
        return self.own[-1] if local else self.common

    def read(self, key):
        found = self.place(key).get(key)
        return self.machine.state(key) if found is None else found

    def has(self, key):
        return key in self.place(key) or self.machine.state(key, None) is not None

    def write(self, key, value):
        self.place(key)[key] = value


class Leaving(Exception):
    """How a break, a continue, a return or the end of the program leaves its blocks."""

    def __init__(self, kind, label="", value=None):
        self.kind, self.label, self.value = kind, label, value


O_LINE = re.compile(r"(?:N\d+)?O(?:0*(\d+)|<(.*?)>)(.*)$")
ENDS = {
    "SUB": ("ENDSUB",), "DO": ("WHILE",), "REPEAT": ("ENDREPEAT",), "WHILE": ("ENDWHILE",),
    "IF": ("ELSEIF", "ELSE", "ENDIF"), "ELSEIF": ("ELSEIF", "ELSE", "ENDIF"), "ELSE": ("ENDIF",),
}  # fmt: skip
KINDS = "SUB ENDSUB RETURN CALL IF ELSEIF ELSE ENDIF WHILE ENDWHILE DO REPEAT".split()
KINDS += ["ENDREPEAT", "BREAK", "CONTINUE"]


class Tree:
    """Lines as nested blocks: (kind, label, rest, line, body, next branch)."""

    def __init__(self, text):
        self.lines = text.split("\n")
        self.at = 0
        self.subs, self.numbered = {}, {}
        for i, line in enumerate(self.lines):
            found = O_LINE.match(bare(line))
            if found and not found[3] and found[1]:
                self.numbered[found[1]] = i + 1
        self.body = self.block(())[0]

    def block(self, ends, label=""):
        """Nodes up to one of the ends that has the label, and that end."""
        nodes = []
        while self.at < len(self.lines):
            i, line = self.at, self.lines[self.at]
            self.at += 1
            found = None if line.strip().startswith("/") else O_LINE.match(bare(line))
            if not found:
                nodes.append(("LINE", "", line, i + 1, [], None))
                continue
            name, rest = found[1] or found[2].lower(), found[3]
            kind = next((k for k in sorted(KINDS, key=len)[::-1] if rest.startswith(k)), "NUMBER")
            rest = rest[len(kind) :] if kind != "NUMBER" else rest
            if name == label and kind in ends:
                return nodes, (kind, rest, i + 1)
            node = self.node(kind, name, rest, i + 1)
            if kind == "SUB":
                self.subs[name] = node
            else:
                nodes.append(node)
        return nodes, (None, "", len(self.lines))

    def node(self, kind, name, rest, line):
        if kind not in ENDS:
            return (kind, name, rest, line, [], None)
        body, (end, after, at) = self.block(ENDS[kind], name)
        if kind == "DO" or kind == "SUB":
            rest = after
        branch = self.node(end, name, after, at) if end in ("ELSEIF", "ELSE") else None
        return (kind, name, rest, line, body, branch)


def turn_about_z(angle, shift):
    """A 4 x 4 matrix: turned about z by an angle in degrees, then shifted."""
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    found = np.eye(4)
    found[:2, :2] = [[c, -s], [s, c]]
    found[:3, 3] = shift
    return found


class Interpreter:
    def __init__(self, unit=1e-3):
        self.unit = unit
        self.x = [0.0, 0.0, 0.0]
        self.plane, self.motion = (0, 1, 2), None
        self.relative = self.centers_absolute = False
        self.speed = self.tolerance = math.nan
        self.moves, self.contour, self.rapid = [], None, None
        self.started, self.states, self.memory = False, {}, Memory(self)
        self.system = 1
        self.systems = {k: [[0.0, 0.0, 0.0], 0.0] for k in range(1, 10)}
        self.shift, self.kept = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self.touched, self.machine_known = set(), set()
        self.homes, self.lost, self.gap = {}, set(), False
        self.feed_mode, self.feed = 94, None
        self.retract_to_r = False
        self.cycle, self.sticky, self.series = None, {}, {}
        self.tool = self.spindle_rpm = None
        self.extruded, self.extruder_absolute, self.m83 = 0.0, True, False
        self.saved = []

    # Where the program's coordinates are in the machine.

    def matrix(self):
        origin, angle = self.systems[self.system]
        return turn_about_z(angle, origin) @ turn_about_z(0, self.shift)

    def outside(self, point):
        return list((self.matrix() @ [*point, 1.0])[:3])

    def inside(self, point):
        return list(np.linalg.solve(self.matrix(), [*point, 1.0])[:3])

    def state(self, key, default=0.0):
        if isinstance(key, int) and 5420 <= key <= 5422:
            return self.inside(self.x)[key - 5420] / self.unit
        if key in ("_x", "_y", "_z"):
            return self.inside(self.x)["xyz".index(key[1])] / self.unit
        if isinstance(key, str) and key.startswith("_hal["):
            return math.nan
        named = {"_metric": float(self.unit == 1e-3), "_absolute": float(not self.relative)}
        named |= {"_feed": (self.feed or 0.0) * 60 / self.unit, "_task": 0.0, "_value": 0.0}
        return named.get(key, default)

    # The tree.

    def run(self, text):
        self.m6 = any("M6" in re.findall(r"[A-Z][0-9.]+", bare(x)) for x in text.split("\n"))
        feeding = re.compile(r"G0*[123](?![0-9.])[^M]*(?<![A-Z])E-?[0-9.]")
        self.prints = any(feeding.search(bare(x)) for x in text.split("\n"))
        frames, kept, marks = 0, [], set()
        for i, line in enumerate(text.split("\n"), 1):
            if line.strip().startswith("%") and frames < 2:
                frames += 1
                kept.append("M2" if frames == 2 or any(bare(x) for x in kept) else "")
                marks |= {i} if kept[-1] else set()
            else:
                kept.append(line)
        self.percent = marks
        self.tree = Tree("\n".join(kept))
        try:
            self.walk(self.tree.body)
        except Leaving:
            pass
        self.halt()
        counts = {}
        for x in self.moves:
            if isinstance(x, Contour):
                counts[x.line] = counts.get(x.line, 0) + 1
                more = f" ({counts[x.line]})" if counts[x.line] > 1 else ""
                x.name = f"line {x.line}{more}"
        return self.moves

    def value(self, text):
        return Formula(text, self.memory).value()

    def walk(self, nodes):
        for node in nodes:
            kind, label, rest, line, body, branch = node
            if kind == "LINE":
                self.line(rest, line)
            elif kind in ("BREAK", "CONTINUE"):
                raise Leaving(kind, label)
            elif kind == "RETURN":
                raise Leaving(kind, label, self.value(rest) if rest else None)
            elif kind == "CALL":
                self.call(label, rest)
            elif kind == "NUMBER":
                if any(re.search(rf"M98P0*{label}(?!\d)", bare(x)) for x in self.tree.lines):
                    return self.after_number(nodes, node)
            elif kind == "IF":
                self.choose(node)
            else:
                self.loop(kind, label, rest, body)
        return None

    def after_number(self, nodes, node):
        """A numbered subprogram that is met in sequence is passed over."""
        rest = nodes[nodes.index(node) + 1 :]
        while rest and not re.search(r"M99(?!\d)", bare(rest[0][2])):
            rest = rest[1:]
        self.walk(rest[1:])

    def choose(self, node):
        while node is not None:
            kind, _, rest, _, body, branch = node
            if kind == "ELSE" or self.value(rest):
                return self.walk(body)
            node = branch
        return None

    def loop(self, kind, label, rest, body):
        times = round(self.value(rest)) if kind == "REPEAT" else None
        first = kind == "DO"
        while first or (times > 0 if kind == "REPEAT" else self.value(rest)):
            first = False
            if times is not None:
                times -= 1
            try:
                self.walk(body)
            except Leaving as leaving:
                if leaving.label != label or leaving.kind == "RETURN":
                    raise
                if leaving.kind == "BREAK":
                    return

    def call(self, label, rest):
        formula, arguments = Formula(rest, self.memory), []
        while formula.at < len(rest):
            arguments.append(formula.value())
        _, _, after, _, body, _ = self.tree.subs[label]
        own = {k: v for k, v in self.memory.own[-1].items() if isinstance(k, int)}
        self.memory.own.append(own | dict(enumerate(arguments, 1)))
        self.saved.append(None)
        result = None
        try:
            self.walk(body)
            result = self.value(after) if after else None
        except Leaving as leaving:
            if leaving.kind != "RETURN":
                raise
            result = leaving.value
        self.memory.own.pop()
        self.saved.pop()
        self.memory.common["_value"] = result or 0.0
        self.memory.common["_value_returned"] = float(result is not None)

    def call_number(self, label, times):
        start = end = self.tree.numbered[label]
        while not re.search(r"M99(?!\d)", bare(self.tree.lines[end])):
            end += 1
        # Empty lines before keep the numbers of the lines.
        part = Tree("\n".join([""] * start + self.tree.lines[start:end]))
        for _ in range(times):
            self.walk(part.body)

    # A line.

    def line(self, text, line):
        if text.strip().startswith("/"):
            return None
        if re.match(r"(N\d+)?M11[78](?!\d)", bare(text)):
            return None
        m, codes, v, sets, before = [], [], {}, [], {}
        formula = Formula(bare(text), self.memory)
        while formula.at < len(formula.text):
            letter = formula.text[formula.at]
            if letter == "*":
                break
            if letter == '"':
                formula.at = formula.text.index('"', formula.at + 1) + 1
                continue
            if letter == "#":
                key = formula.name()
                formula.at += 1
                sets.append((key, formula.row()))
                continue
            formula.at += 1
            value = formula.value()
            if letter == "G":
                codes.append(round(value, 4))
            elif letter == "M":
                m.append(round(value, 4))
                before = before or dict(v)
            elif letter != "N":
                v[letter] = value
        for key, value in sets:
            self.memory.write(key, value)
        if any(x not in KNOWN_M for x in m):
            keep = before if not set(codes) & {*MOTIONS, 10, 28, 30, 52, 53, 92} else v
            v = {k: x for k, x in v.items() if k in keep and k not in "DEHLOPQST"}
        if 80 in codes and (0 in codes or 1 in codes):
            codes.remove(80)
        if 98 in m:
            self.call_number(str(round(v["P"])), round(v.get("L", 1)))
            return None
        if 99 in m:
            return "back"
        if self.step(codes, m, v, line):
            raise Leaving("END")
        return None

    def step(self, codes, m, v, line):
        if {0, 1, 2, 3, 80} & set(codes):
            # Any other motion ends the series of holes.
            self.series = {}
        self.set_feed(codes, v)
        number = round(v.pop("$", 0))
        self.spindle = f"spindle {number}" if number else "spindle"
        if "S" in v and not (4 in codes and "P" not in v):
            self.switch(f"{self.spindle} speed", v["S"])
            self.spindle_rpm = v["S"]
        if "T" in v:
            self.tool = v["T"]
        for code, on in ((62, True), (63, False), (64, True), (65, False)):
            if code in m:
                self.switch(f"output {round(v['P'])}", on)
        if 67 in m or 68 in m:
            self.switch(f"analog output {round(v.pop('E'))}", v.pop("Q"))
        if 6 in m or ("T" in v and not self.m6):
            self.halt()
            if self.tool is None:
                self.states.pop("tool", None)
            self.switch("tool", True if self.tool is None else self.tool)
        self.switches(m)
        if 70 in m or 73 in m:
            self.saved_modes = self.modes()
        if 72 in m:
            vars(self).update(self.saved_modes)
        if {82, 83} & set(m):
            self.m83 = 83 in m
        if {82, 83} & set(m) or {90, 91} & set(codes):
            self.extruder_absolute = not (self.m83 or 91 in codes)
        if 4 in codes:
            self.halt()
            duration = next(v.pop(k) for k in "PSXU" if k in v)
            if duration > 0:
                self.moves.append(Dwell(duration))
        for code in codes:
            self.set_mode(code, v)
        if not self.once(codes, v, line):
            self.perform(v, line)
        for code, value in ((0, True), (60, True), (1, "optional")):
            if code in m:
                self.halt()
                self.moves.append(Event("pause", value))
        if 2 in m or 30 in m:
            if line not in self.percent:
                spindles = [x for x in self.states if x[:7] == "spindle" and x[-5:] != "speed"]
                for name in ("extruder", *spindles, "coolant"):
                    if self.states.get(name):
                        self.switch(name, False)
            return True
        return False

    def set_feed(self, codes, v):
        for code in (93, 94, 95):
            if code in codes and code != self.feed_mode:
                self.feed_mode, self.feed = code, None
        unit = 0.0254 if 20 in codes else 1e-3 if 21 in codes else self.unit
        if self.feed_mode == 93:
            self.feed = v.get("F")
        elif "F" in v:
            self.feed = v["F"] * unit / 60

    def switches(self, m):
        for code, name, value in (
            (3, "spindle", True), (4, "spindle", "reverse"), (5, "spindle", False),
            (7, "coolant", "mist"), (8, "coolant", "flood"), (9, "coolant", False),
        ):  # fmt: skip
            if code in m:
                both = ({"mist": "flood", "flood": "mist"}.get(value), "mist and flood")
                if name == "coolant" and value and self.states.get(name) in both:
                    value = "mist and flood"
                self.switch(self.spindle if name == "spindle" else name, value)

    def modes(self):
        names = "unit plane relative centers_absolute tolerance system feed_mode feed retract_to_r"
        return {k: getattr(self, k) for k in names.split()}

    def set_mode(self, code, v):
        if code in (17, 18, 19):
            self.plane = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}[code]
        elif code in (20, 21):
            self.unit = {20: 0.0254, 21: 0.001}[code]
        elif code in (61, 61.1):
            self.tolerance = 0.0
        elif code == 64:
            self.tolerance = v["P"] * self.unit if "P" in v else math.nan
        elif code in (90, 91):
            self.relative = code == 91
        elif code in (90.1, 91.1):
            self.centers_absolute = code == 90.1
        elif code in (98, 99):
            self.retract_to_r = code == 99
        elif 54 <= code <= 59.3:
            self.system = round(code) - 53 if code < 59.05 else 6 + round(code * 10) - 590

    def once(self, codes, v, line):
        """Codes that have the coordinates of their line to themselves."""
        axes = {i: v[k] * self.unit for i, k in enumerate("XYZ") if k in v}
        for code in (28, 30):
            if code in codes:
                self.to_reference(code, axes)
                return True
            if code + 0.1 in codes:
                self.homes[code] = list(self.x)
                return True
        if 10 in codes:
            self.set_system(axes, v)
        elif 52 in codes:
            for i, value in axes.items():
                self.shift[i] = value
            self.kept = list(self.shift)
        elif 92 in codes:
            if "E" in v:
                self.extruded = v.pop("E")
            self.set_here(axes)
        elif 92.1 in codes or 92.2 in codes:
            self.shift = [0.0] * 3
            if 92.1 in codes:
                self.kept = [0.0] * 3
            return False
        elif 92.3 in codes:
            self.shift = list(self.kept)
            return False
        elif 53 in codes:
            self.motion = next((c for c in codes if c in (0, 1)), self.motion)
            if not set(axes) <= self.machine_known:
                self.leave(set(axes))
                return True
            end = [axes.get(i, self.x[i]) for i in range(3)]
            self.straight(end, line)
        elif 43.1 in codes:
            pass
        else:
            self.motion = next((c for c in codes if c in MOTIONS), self.motion)
            return False
        return True

    def set_here(self, axes):
        for i, value in axes.items():
            if i not in self.touched:
                self.x[i] = value + self.shift[i] + self.systems[self.system][0][i]
                self.touched.add(i)
            else:
                self.shift[i] += self.inside(self.x)[i] - value
        self.kept = list(self.shift)

    def set_system(self, axes, v):
        if "L" not in v or round(v["L"]) not in (2, 20):
            return
        which = round(v.get("P", 0)) or self.system
        origin, angle = self.systems[which]
        if "R" in v:
            angle = v["R"]
        for i, value in axes.items():
            if round(v["L"]) == 2:
                self.machine_known |= {i} - self.touched
                origin[i] = value
            elif i not in self.touched and which == self.system:
                self.x[i], origin[i] = value + self.shift[i], 0.0
                self.touched.add(i)
            else:
                origin[i] = self.x[i] - value - self.shift[i]
        self.systems[which] = [origin, angle]

    def to_reference(self, code, axes):
        if axes and not all(math.isnan(x) for x in axes.values()):
            self.motion, before = 0, self.motion
            self.straight(self.target(axes), 0)
            self.motion = before
        named = set(axes) or {0, 1, 2}
        if code in self.homes:
            before, self.motion = self.motion, 0
            home = self.homes[code]
            self.lost -= named
            self.straight([home[i] if i in named else self.x[i] for i in range(3)], 0)
            self.motion = before
        else:
            self.leave(named)

    def leave(self, named):
        """To a place that the program does not give."""
        self.halt()
        if self.started:
            self.lost |= named
            self.gap = True
        else:
            zero = self.outside([0.0] * 3)
            self.x = [zero[i] if i in named else self.x[i] for i in range(3)]

    def target(self, axes):
        if self.relative:
            turn = turn_about_z(self.systems[self.system][1], [0, 0, 0])
            step = turn @ [*(axes.get(i, 0.0) for i in range(3)), 1.0]
            return [a + b for a, b in zip(self.x, step[:3], strict=True)]
        self.touched |= set(axes)
        self.lost -= set(axes)
        here = self.inside(self.x)
        there = self.outside([axes.get(i, here[i]) for i in range(3)])
        turned = self.systems[self.system][1] != 0
        moved = set(axes) | ({0, 1} if turned and {0, 1} & set(axes) else set())
        return [there[i] if i in moved else self.x[i] for i in range(3)]

    def perform(self, v, line):
        axes = {i: v[k] * self.unit for i, k in enumerate("XYZ") if k in v}
        arc = self.motion in (2, 3) and any(k in v for k in "XYZIJKR")
        fed = 0.0
        if "E" in v and self.motion is not None:
            fed = v["E"] - self.extruded if self.extruder_absolute else v["E"]
            self.extruded += fed
        if not arc and not axes:
            if fed:
                if self.states.get("extruder"):
                    self.switch("extruder", False)
                self.halt()
                self.moves.append(Event("extruder feed", round(fed * self.unit * 1e3, 4)))
                if self.feed and self.feed_mode == 94:
                    self.moves.append(Dwell(abs(fed) * self.unit / self.feed))
            return
        if self.motion not in (0, 1, 2, 3):
            self.drill(axes, v, line)
            return
        if fed > 0 or self.states.get("extruder"):
            self.switch("extruder", fed > 0)
        end = self.target(axes)
        if arc:
            self.arc(self.x, end, v, line)
            self.x = end
        elif self.motion == 1 and fed <= 0 and self.prints and not self.started:
            # A printer's way to where its print begins.
            self.motion = 0
            self.straight(end, line)
            self.motion = 1
        else:
            self.straight(end, line)

    def drill(self, axes, v, line):
        """Canned cycles, as a list of moves along the axis of the plane."""
        a, b, c = self.plane
        if self.cycle != self.motion:
            self.cycle, self.sticky = self.motion, {}
        self.sticky.update({k: x for k, x in v.items() if k in "RQPD"})
        if c in axes:
            self.sticky["Z"] = axes.pop(c) / self.unit
        kept = {k: x * (1 if k == "P" else self.unit) for k, x in self.sticky.items()}
        initial = self.series.setdefault(c, self.x[c])
        self.series = {c: initial}
        if self.relative:
            top = initial + kept["R"]
            bottom = top + kept["Z"]
        else:
            add = self.outside([0.0] * 3)[c]
            top, bottom = kept["R"] + add, kept["Z"] + add
        first = max(self.x[c], top)
        back = top if self.retract_to_r else max(initial, top)
        gap = kept.get("D", 0.254e-3)
        down, up, stand = [], [("G0", back)], [("P", kept.get("P", 0.0))]
        if self.motion in (73, 83):
            count = math.ceil((top - bottom) / kept["Q"] - 1e-12) - 1
            for i in range(1, count + 1):
                depth = top - kept["Q"] * i
                down += [("G1", depth)] + ([("G0", top)] if self.motion == 83 else [])
                down += [("G0", depth + gap)]
        down += [("G1", bottom)]
        now = self.states.get("spindle")
        plans = {
            **dict.fromkeys((81, 73, 83), down + up),
            82: down + stand + up,
            85: [*down, ("G1", top), *up],
            89: down + stand + [("G1", back)],
            86: [*down, *stand, ("spindle", False), *up, ("spindle", now)],
            84: [*down, ("spindle", False), ("spindle", "reverse"), *stand, ("G1", back)],
            74: [*down, ("spindle", False), ("spindle", True), *stand, ("G1", back)],
        }
        plan = plans[self.motion]
        if self.motion in (84, 74) and now is not None:
            plan = [*plan, ("spindle", now)]
        code = self.motion
        self.along(c, "G0", first, line)
        for _ in range(round(v.get("L", 1))):
            self.motion = 0
            end = self.target(axes)
            end[c] = self.x[c]
            self.straight(end, line)
            self.along(c, "G0", top, line)
            for what, value in plan:
                if what == "P":
                    self.halt()
                    if value > 0:
                        self.moves.append(Dwell(value))
                elif what == "spindle":
                    self.switch("spindle", value)
                else:
                    self.along(c, what, value, line)
        self.motion = code

    def along(self, c, what, height, line):
        self.motion = 0 if what == "G0" else 1
        self.straight([height if i == c else self.x[i] for i in range(3)], line)

    def straight(self, end, line):
        start, self.x = self.x, end
        if self.motion == 1:
            self.touched |= {0, 1, 2}
        if self.motion == 0 and self.gap:
            if not self.lost:
                self.gap = False
                self.halt()
            return
        if math.dist(start, end) <= NANOMETRE:
            return
        if self.motion == 0:
            if self.contour:
                self.halt()
            if self.started:
                self.rapid = self.rapid or Rapid([start])
                self.rapid.points.append(end)
        else:
            between = list(zip(start, end, strict=True))
            at = lambda u: [a + (b - a) * u for a, b in between]  # noqa: E731
            self.add("line", at, math.dist(start, end), line)

    def speed_of(self, length):
        if self.feed is None:
            return math.nan
        if self.feed_mode == 93:
            return length * self.feed / 60
        return self.feed * (self.spindle_rpm if self.feed_mode == 95 else 1)

    def switch(self, name, value):
        if self.states.get(name, "never") == value and name in self.states:
            return
        self.states[name] = value
        if self.contour:
            self.contour.events.append((len(self.contour.segments), name, value))
        else:
            self.flush()
            self.moves.append(Event(name, value))

    def flush(self):
        if self.rapid:
            self.moves.append(self.rapid)
        self.rapid = None

    def halt(self):
        if self.contour:
            self.moves.append(self.contour)
        self.contour = None
        self.flush()

    def add(self, kind, at, length, line, speed=None):
        if not self.contour:
            self.flush()
            self.contour = Contour(line)
            self.started = True
        speed = self.speed_of(length) if speed is None else speed
        self.contour.segments.append(Segment(kind, at, length, speed, self.tolerance))

    def arc(self, start, end, v, line):
        self.touched |= {0, 1, 2}
        a, b, c = self.plane
        s, e = complex(start[a], start[b]), complex(end[a], end[b])
        way = 1 if self.motion == 3 else -1
        turns = round(v.get("P", 1))
        if "R" in v:
            center = self.by_radius(s, e, v["R"] * self.unit, way)
        else:
            offset = complex(v.get("IJK"[a], 0.0), v.get("IJK"[b], 0.0)) * self.unit
            angle = math.radians(self.systems[self.system][1])
            if self.centers_absolute:
                point = [0.0, 0.0, 0.0]
                point[a], point[b] = offset.real, offset.imag
                point = self.outside(point)
                center = complex(point[a], point[b])
            else:
                center = s + offset * cmath.exp(1j * angle)

        def place(z, height):
            point = [0.0, 0.0, 0.0]
            point[a], point[b], point[c] = z.real, z.imag, height
            return point

        def turned(center, s, angle):
            to = s - center
            return lambda u: place(center + to * cmath.exp(1j * way * angle * u), start[c])

        full = abs(e - s) <= NANOMETRE
        sweep = 2 * math.pi
        if not full:
            sweep = (way * cmath.phase((e - center) / (s - center))) % (2 * math.pi)
        if sweep * abs(s - center) <= NANOMETRE:
            sweep += 2 * math.pi
        if abs(end[c] - start[c]) > NANOMETRE:
            total = sweep + 2 * math.pi * (turns - 1)
            growth = 1 if full else abs(e - center) / abs(s - center)

            def helix(u):
                z = center + (s - center) * (1 + (growth - 1) * u) * cmath.exp(1j * way * total * u)
                return place(z, start[c] + (end[c] - start[c]) * u)

            radius = abs(s - center) * (1 + growth) / 2
            speed = self.speed_of(math.hypot(radius * total, end[c] - start[c]))
            self.add("helix", helix, math.nan, line, speed)
            return
        # Along the chord the centre is moved to its middle, across it stays.
        moved = center if full else s + (e - s) * complex(0.5, ((center - s) / (e - s)).imag)
        if full:
            parts = [(center, s, 2 * math.pi)]
        elif sweep > 1.5 * math.pi and abs(moved - center) > NANOMETRE:
            middle = center + (s - center) * cmath.exp(1j * way * sweep / 2)
            # Where the radius through the middle meets the bisector of middle and end: a point
            # middle + t (center - middle) as far from the end as from the middle.
            p, q = center - middle, e - middle
            second = middle + p * abs(q) ** 2 / (2 * (p * q.conjugate()).real)
            rest = (way * cmath.phase((e - second) / (middle - second))) % (2 * math.pi)
            parts = [(center, s, sweep / 2), (second, middle, rest)]
        else:
            angle = (way * cmath.phase((e - moved) / (s - moved))) % (2 * math.pi)
            parts = [(moved, s, angle)]
        first = parts[0]
        circle = 2 * math.pi * abs(s - first[0])
        speed = self.speed_of(circle * (turns - 1) + sum(abs(y - x) * t for x, y, t in parts))
        for _ in range(turns - 1):
            self.add("arc", turned(first[0], s, 2 * math.pi), circle, line, speed)
        for middle, begin, angle in parts:
            self.add("arc", turned(middle, begin, angle), angle * abs(begin - middle), line, speed)

    @staticmethod
    def by_radius(s, e, radius, way):
        """Of the two centres at that distance from both ends, the one for the shorter way round."""
        half = abs(e - s) / 2
        across = cmath.rect(1, cmath.phase(e - s) + math.pi / 2)
        height = math.sqrt(max(radius**2 - half**2, 0.0))
        candidates = [(s + e) / 2 + across * height, (s + e) / 2 - across * height]
        sweeps = [math.pi] * 2
        if height:
            turns = [cmath.phase((e - x) / (s - x)) for x in candidates]
            sweeps = [(way * x) % (2 * math.pi) for x in turns]
        pick = min if radius > 0 else max
        return candidates[sweeps.index(pick(sweeps))]


KNOWN_M = {*range(10), 30, 60, *range(62, 66), 67, 68, 70, 71, 72, 73, 82, 83, 98, 99}
MOTIONS = (0, 1, 2, 3, 73, 74, 80, 81, 82, 83, 84, 85, 86, 89)


def interpret(text, unit=1e-3):
    """The moves of a program, lengths in metres."""
    return Interpreter(unit).run(text)
