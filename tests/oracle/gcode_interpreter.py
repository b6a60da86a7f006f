"""A slow, obvious interpreter of the G-code that docs/guides/gcode.md describes.

It reads character by character, turns arcs as complex numbers and shares nothing with the package.
It takes valid programs only: what is to be refused is not its business.
"""

import cmath
import math
import re
from dataclasses import dataclass, field, make_dataclass
from fractions import Fraction

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
    code = ""
    depth = False
    for char in line:
        if depth:
            depth = char != ")"
        elif char == "(":
            depth = True
        elif char == ";":
            break
        elif not char.isspace():
            code += char.upper()
    return code


def words_of(text):
    """Letters and numbers of a line; letters without a number and texts are None and nothing."""
    position = 0
    words = []
    while position < len(text) and text[position] != "*":
        letter = text[position]
        position += 1
        if letter == '"':
            position = text.index('"', position) + 1
            continue
        end = position
        while end < len(text) and text[end] in "+-.0123456789":
            end += 1
        words.append((letter, number(text[position:end]) if end > position else None))
        position = end
    return words


class Interpreter:
    def __init__(self, unit=1e-3):
        self.unit = unit
        self.x = [0.0, 0.0, 0.0]
        self.plane = (0, 1, 2)
        self.motion = None
        self.relative = self.centers_absolute = False
        self.speed = self.tolerance = math.nan
        self.moves = []
        self.contour = None
        self.rapid = None
        self.started = False
        self.states = {}
        self.lost = set()
        self.gap = False
        self.feed = None
        self.tool = None

    def run(self, text):
        self.m6 = any("M6" in re.findall(r"[A-Z][0-9.]+", bare(x)) for x in text.split("\n"))
        frames = 0
        for i, line in enumerate(text.split("\n"), 1):
            if line.strip().startswith("%"):
                frames += 1
                if frames == 2 or any(bare(x) for x in text.split("\n")[: i - 1]):
                    break
            elif self.line(line, i):
                break
        self.halt()
        counts = {}
        for x in self.moves:
            if isinstance(x, Contour):
                counts[x.line] = counts.get(x.line, 0) + 1
                more = f" ({counts[x.line]})" if counts[x.line] > 1 else ""
                x.name = f"line {x.line}{more}"
        return self.moves

    def line(self, text, line):
        """Carries out a line; whether it ends the program."""
        if text.strip().startswith("/") or re.match(r"(N\d+)?O\d+$", bare(text)):
            return False
        head = re.match(r"(N\d+)?M([0-9.]+)", bare(text))
        if head and float(head[2]) not in KNOWN_M:
            return False
        m = []
        codes = []
        v = {}
        for letter, value in words_of(bare(text)):
            if letter == "G":
                codes.append(round(value, 4))
            elif letter == "M":
                m.append(round(value, 4))
            elif letter != "N":
                v[letter] = value
        if 80 in codes and (0 in codes or 1 in codes):
            codes.remove(80)
        return self.step(codes, m, v, line)

    def step(self, codes, m, v, line):
        self.set_feed(codes, v)
        if "S" in v and not (4 in codes and "P" not in v):
            self.switch("spindle speed", v["S"])
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
        if 4 in codes:
            self.halt()
            duration = next(v.pop(k) for k in "PSX" if k in v)
            if duration > 0:
                self.moves.append(Dwell(duration))
        for code in codes:
            self.set_mode(code, v)
        if not self.once(codes, v, line):
            self.perform(v, line)
        for code, value in ((0, True), (1, "optional")):
            if code in m:
                self.halt()
                self.moves.append(Event("pause", value))
        if 2 in m or 30 in m:
            for name in ("spindle", "coolant"):
                if self.states.get(name):
                    self.switch(name, False)
            return True
        return False

    def set_feed(self, codes, v):
        if 20 in codes:
            unit = 0.0254
        elif 21 in codes:
            unit = 1e-3
        else:
            unit = self.unit
        if "F" in v:
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
                self.switch(name, value)

    def set_mode(self, code, v):
        if code in (17, 18, 19):
            self.plane = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}[code]
        elif code in (20, 21):
            self.unit = {20: 0.0254, 21: 0.001}[code]
        elif code == 61:
            self.tolerance = 0.0
        elif code == 64:
            self.tolerance = v["P"] * self.unit if "P" in v else math.nan
        elif code in (90, 91):
            self.relative = code == 91
        elif code in (90.1, 91.1):
            self.centers_absolute = code == 90.1

    def once(self, codes, v, line):
        """Codes that have the coordinates of their line to themselves."""
        axes = {i: v[k] * self.unit for i, k in enumerate("XYZ") if v.get(k) is not None}
        if 28 in codes:
            if axes:
                before = self.motion
                self.motion = 0
                self.straight(self.target(axes), 0)
                self.motion = before
            self.leave({i for i, k in enumerate("XYZ") if k in v} or {0, 1, 2})
            return True
        if 53 in codes:
            self.motion = 0
            self.leave(set(axes))
            return True
        self.motion = next((c for c in codes if c in MOTIONS), self.motion)
        return False

    def leave(self, named):
        """To a place that the program does not give."""
        self.halt()
        if self.started:
            self.lost |= named
            self.gap = True
        else:
            self.x = [0.0 if i in named else self.x[i] for i in range(3)]

    def target(self, axes):
        if self.relative:
            return [a + axes.get(i, 0.0) for i, a in enumerate(self.x)]
        self.lost -= set(axes)
        return [axes.get(i, self.x[i]) for i in range(3)]

    def perform(self, v, line):
        axes = {i: v[k] * self.unit for i, k in enumerate("XYZ") if k in v}
        arc = self.motion in (2, 3) and any(k in v for k in "XYZIJKR")
        if not arc and not axes:
            return
        end = self.target(axes)
        if arc:
            self.arc(self.x, end, v, line)
            self.x = end
        else:
            self.straight(end, line)

    def straight(self, end, line):
        start = self.x
        self.x = end
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
            point_at = lambda u: [a + (b - a) * u for a, b in between]  # noqa: E731
            self.add("line", point_at, math.dist(start, end), line)

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

    def add(self, kind, point_at, length, line):
        if not self.contour:
            self.flush()
            self.contour = Contour(line)
            self.started = True
        speed = math.nan if self.feed is None else self.feed
        self.contour.segments.append(Segment(kind, point_at, length, speed, self.tolerance))

    def arc(self, start, end, v, line):
        a, b, c = self.plane
        s = complex(start[a], start[b])
        e = complex(end[a], end[b])
        way = 1 if self.motion == 3 else -1
        if "R" in v:
            center = self.by_radius(s, e, v["R"] * self.unit, way)
        else:
            offset = complex(v.get("IJK"[a], 0.0), v.get("IJK"[b], 0.0)) * self.unit
            center = offset if self.centers_absolute else s + offset

        def place(z, height):
            point = [0.0, 0.0, 0.0]
            point[a] = z.real
            point[b] = z.imag
            point[c] = height
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
        # As in LinuxCNC, each P above 1 is one more full turn.
        circles = round(v.get("P", 1.0)) - 1
        if abs(end[c] - start[c]) > NANOMETRE:
            total = sweep + 2 * math.pi * circles
            growth = 1 if full else abs(e - center) / abs(s - center)

            def helix(u):
                z = center + (s - center) * (1 + (growth - 1) * u) * cmath.exp(1j * way * total * u)
                return place(z, start[c] + (end[c] - start[c]) * u)

            self.add("helix", helix, math.nan, line)
            return
        # Along the chord the centre is moved to its middle, across it stays.
        moved = center if full else s + (e - s) * complex(0.5, ((center - s) / (e - s)).imag)
        if full:
            parts = [(center, s, 2 * math.pi)]
        elif sweep > 1.5 * math.pi and abs(moved - center) > NANOMETRE:
            middle = center + (s - center) * cmath.exp(1j * way * sweep / 2)
            # Where the radius through the middle meets the bisector of middle and end: a point
            # middle + t (center - middle) as far from the end as from the middle.
            p = center - middle
            q = e - middle
            second = middle + p * abs(q) ** 2 / (2 * (p * q.conjugate()).real)
            rest = (way * cmath.phase((e - second) / (middle - second))) % (2 * math.pi)
            parts = [(center, s, sweep / 2), (second, middle, rest)]
        else:
            angle = (way * cmath.phase((e - moved) / (s - moved))) % (2 * math.pi)
            parts = [(moved, s, angle)]
        for middle, begin, angle in [(center, s, 2 * math.pi)] * circles + parts:
            self.add("arc", turned(middle, begin, angle), angle * abs(begin - middle), line)

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


KNOWN_M = {*range(10), 30, *range(62, 66), 67, 68}
MOTIONS = (0, 1, 2, 3, 80)


def interpret(text, unit=1e-3):
    """The moves of a program, lengths in metres."""
    return Interpreter(unit).run(text)
