"""A slow, obvious interpreter of the G-code that docs/guides/gcode.md describes.

It reads character by character, turns arcs as complex numbers and shares nothing with the package.
It takes valid programs only: what is to be refused is not its business.
"""

import cmath
import math
from dataclasses import dataclass, field
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
    segments: list = field(default_factory=list)
    events: list = field(default_factory=list)  # (number of segments before it, name, value)


@dataclass
class Rapid:
    points: list


@dataclass
class Event:
    name: str
    value: object


@dataclass
class Dwell:
    duration: float


def number(text):
    """The double nearest to a decimal number."""
    sign = -1 if text[:1] == "-" else 1
    whole, _, decimals = text.lstrip("+-").partition(".")
    return sign * float(Fraction(int((whole + decimals) or "0"), 10 ** len(decimals)))


def words(line):
    """Pairs of a letter and a value, character by character."""
    found, letter, digits, in_comment = [], None, "", False
    for char in line + " ;":
        if in_comment:
            in_comment = char != ")"
        elif char in " \t":
            continue
        elif char in "+-.0123456789":
            digits += char
        else:
            if letter is not None:
                found.append((letter, number(digits)))
            letter, digits = None, ""
            if char == ";":
                return found
            if char == "(":
                in_comment = True
            else:
                letter = char.upper()
    return found


class Interpreter:
    def __init__(self, unit=1e-3):
        self.unit = unit
        self.x = [0.0, 0.0, 0.0]
        self.plane = (0, 1, 2)
        self.relative = self.centers_absolute = False
        self.motion = None
        self.speed = None
        self.tolerance = math.nan
        self.moves, self.contour, self.rapid = [], None, None
        self.started = False
        self.state = {}

    def run(self, text):
        frames = 0
        for count, line in enumerate(text.split("\n"), 1):
            bare = line.strip()
            if bare == "%":
                frames += 1
                if frames == 2:
                    break
                continue
            if bare.startswith("/"):
                continue
            if self.step(words(line), count):
                break
        self.halt()
        return self.moves

    def step(self, found, line):
        codes = [v for k, v in found if k == "G"]
        m = [v for k, v in found if k == "M"]
        v = {k: value for k, value in found if k not in "GMN"}
        if "F" in v:
            self.speed = v["F"] * self.unit / 60
        if "S" in v:
            self.switch("spindle speed", v["S"])
        for code, name, value in (
            (3, "spindle", True),
            (4, "spindle", "reverse"),
            (5, "spindle", False),
            (7, "coolant", "mist"),
            (8, "coolant", "flood"),
            (9, "coolant", False),
        ):
            if code in m:
                other = {"mist": "flood", "flood": "mist"}.get(value)
                if (
                    name == "coolant"
                    and value
                    and self.state.get(name) in (other, "mist and flood")
                ):
                    value = "mist and flood"
                self.switch(name, value)
        if 4 in codes:
            self.halt()
            if v["P"] > 0:
                self.moves.append(Dwell(v["P"]))
        for code in codes:
            if code == 17:
                self.plane = (0, 1, 2)
            elif code == 18:
                self.plane = (2, 0, 1)
            elif code == 19:
                self.plane = (1, 2, 0)
            elif code == 20:
                self.unit = 0.0254
            elif code == 21:
                self.unit = 0.001
            elif code in (61, 61.1):
                self.tolerance = 0.0
            elif code == 64:
                self.tolerance = v["P"] * self.unit if "P" in v else math.nan
            elif code in (90, 91):
                self.relative = code == 91
            elif code in (90.1, 91.1):
                self.centers_absolute = code == 90.1
            elif code in (0, 1, 2, 3):
                self.motion = code
            elif code == 80:
                self.motion = None
        arc = self.motion in (2, 3) and any(k in v for k in "XYZIJKR")
        if arc or any(k in v for k in "XYZ"):
            self.move(v, line)
        for code, value in ((0, True), (1, "optional")):
            if code in m:
                self.halt()
                self.moves.append(Event("pause", value))
        if 2 in m or 30 in m:
            for name in ("spindle", "coolant"):
                if self.state.get(name):
                    self.switch(name, False)
            return True
        return False

    def switch(self, name, value):
        if self.state.get(name, "never") == value and name in self.state:
            return
        self.state[name] = value
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

    def move(self, v, line):
        start = self.x
        end = [
            (start[i] if self.relative else 0.0) + v[k] * self.unit if k in v else start[i]
            for i, k in enumerate("XYZ")
        ]
        if self.motion in (2, 3):
            self.arc(start, end, v, line)
        elif math.dist(start, end) <= NANOMETRE:
            return
        elif self.motion == 0:
            if self.contour:
                self.halt()
            if self.started:
                self.rapid = self.rapid or Rapid([start])
                self.rapid.points.append(end)
        else:
            self.add(
                "line",
                lambda u: [a + (b - a) * u for a, b in zip(start, end, strict=True)],
                math.dist(start, end),
                line,
            )
        self.x = end

    def add(self, kind, at, length, line):
        if not self.contour:
            self.flush()
            self.contour = Contour(line)
            self.started = True
        self.contour.segments.append(Segment(kind, at, length, self.speed, self.tolerance))

    def arc(self, start, end, v, line):
        a, b, c = self.plane
        s, e = complex(start[a], start[b]), complex(end[a], end[b])
        way = 1 if self.motion == 3 else -1
        turns = round(v.get("P", 1))
        if "R" in v:
            center = self.by_radius(s, e, v["R"] * self.unit, way)
        else:
            offset = complex(v.get("IJK"[a], 0.0), v.get("IJK"[b], 0.0)) * self.unit
            center = offset if self.centers_absolute else s + offset

        def place(z, height):
            point = [0.0, 0.0, 0.0]
            point[a], point[b], point[c] = z.real, z.imag, height
            return point

        def turned(center, s, angle):
            return lambda u: place(
                center + (s - center) * cmath.exp(1j * way * angle * u), start[c]
            )

        full = abs(e - s) <= NANOMETRE
        sweep = (
            2 * math.pi
            if full
            else (way * cmath.phase((e - center) / (s - center))) % (2 * math.pi)
        )
        if sweep * abs(s - center) <= NANOMETRE:
            sweep += 2 * math.pi
        if abs(end[c] - start[c]) > NANOMETRE:
            total = sweep + 2 * math.pi * (turns - 1)
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
            p, q = center - middle, e - middle
            second = middle + p * abs(q) ** 2 / (2 * (p * q.conjugate()).real)
            rest = (way * cmath.phase((e - second) / (middle - second))) % (2 * math.pi)
            parts = [(center, s, sweep / 2), (second, middle, rest)]
        else:
            angle = (way * cmath.phase((e - moved) / (s - moved))) % (2 * math.pi)
            parts = [(moved, s, angle)]
        first = parts[0]
        for _ in range(turns - 1):
            self.add(
                "arc",
                turned(first[0], s, 2 * math.pi),
                2 * math.pi * abs(s - first[0]),
                line,
            )
        for middle, begin, angle in parts:
            self.add("arc", turned(middle, begin, angle), angle * abs(begin - middle), line)

    @staticmethod
    def by_radius(s, e, radius, way):
        """Of the two centres at that distance from both ends, the one for the shorter way round."""
        half = abs(e - s) / 2
        across = cmath.rect(1, cmath.phase(e - s) + math.pi / 2)
        height = math.sqrt(max(radius**2 - half**2, 0.0))
        candidates = [(s + e) / 2 + across * height, (s + e) / 2 - across * height]
        sweeps = [
            (way * cmath.phase((e - x) / (s - x))) % (2 * math.pi) if height else math.pi
            for x in candidates
        ]
        pick = min if radius > 0 else max
        return candidates[sweeps.index(pick(sweeps))]


def interpret(text, unit=1e-3):
    """The moves of a program, lengths in metres."""
    return Interpreter(unit).run(text)
