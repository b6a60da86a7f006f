"""Random valid programs with parameters, formulas, O words, cycles, offsets and references.

Every program is valid by construction: arcs are drawn by their angles, divisors stay away from
zero, every coordinate system that is used has its origin from the program, and cycles go down.
"""

import math
import random


class Author:
    """Writes one program; the same seed gives the same text."""

    def __init__(self, seed):
        self.r = random.Random(seed)
        self.lines, self.label, self.depth = [], 100, 0
        self.names = ["31", "32", "<_wide>", "<own>"]
        self.style = self.r.choice(["O words", "numbers"])
        self.subs = []

    def text(self):
        r = self.r
        if r.random() < 0.5:
            self.lines.append(f"O{r.randint(1, 99)} (PART)")
        self.lines.append(r.choice(["G21 G90", "G90 G0 G80 G40 G49", "G20 G17 G90"]))
        for name in self.names:
            self.lines.append(f"#{name} = {self.number(1, 9)}")
        self.lines.append(f"F{self.number(100, 900)}")
        self.systems()
        if self.style == "O words":
            for _ in range(r.randint(0, 2)):
                self.subs.append(self.sub())
        self.lines.append(f"G0 X{self.number()} Y{self.number()} Z{self.number(1, 5)}")
        self.body(r.randint(6, 14))
        if self.style == "numbers":
            self.lines.append(f"M98 P1000 L{r.randint(1, 3)}")
        self.lines.append("G1 X1.5 Y2.5 Z3.5 F200")
        self.lines.append(r.choice(["M2", "M30"]))
        if self.style == "numbers":
            self.lines.append("O1000")
            self.body(r.randint(1, 3))
            self.lines.append("M99")
        return "\n".join(self.lines) + "\n"

    def number(self, low=-20, high=20):
        return f"{self.r.uniform(low, high):.4f}"

    def systems(self):
        """Origins of some systems: all before the first move, so that each is known."""
        r = self.r
        if r.random() < 0.3:
            self.lines.append(f"G92 X{self.number()} Y{self.number()} Z{self.number(1, 3)}")
            self.known = [None]
            return
        self.known = [1]
        for i in (1, 2, 3, 9):
            if i == 1 or r.random() < 0.6:
                turn = f" R{self.number(-90, 90)}" if r.random() < 0.3 else ""
                x, y, z = (self.number() for _ in range(3))
                self.lines.append(f"G10 L2 P{i} X{x} Y{y} Z{z}{turn}")
                self.known.append(i)

    def parameter(self):
        return "#" + self.r.choice(self.names)

    def formula(self, depth=0):
        """A formula whose value is small."""
        r = self.r
        kind = r.randrange(9) if depth < 3 else r.randrange(2)
        if kind == 0:
            return self.number(0.1, 5)
        if kind == 1:
            return self.parameter()
        a, b = self.formula(depth + 1), self.formula(depth + 1)
        if kind == 2:
            return f"[{a} {r.choice('+-')} {b} {r.choice('+-')} {self.number(0, 1)}]"
        if kind == 3:
            return f"[SIN[{a} * 10] * {self.number(1, 3)} - COS[{b}] MOD 3]"
        if kind == 4:
            return f"[{self.number(0.5, 2)} * {self.number(1, 2)} ** 2 / {self.number(1, 4)} + {a}]"
        if kind == 5:
            return f"SQRT[ABS[{a}] + {self.number(0.1, 1)}]"
        if kind == 6:
            return f"[ATAN[{a}]/[{self.number(1, 3)}] / 20]"
        if kind == 7:
            what = r.choice(["FIX", "FUP", "ROUND"])
            return f"[{what}[{self.number(-3, 3)}] + [{a} {self.compare()} {b}]]"
        return f"-[{r.choice(['LN', 'EXP'])}[{self.number(0.2, 1.5)}] + TAN[{self.number(5, 40)}]]"

    def compare(self):
        return self.r.choice("EQ NE GT GE LT LE AND OR XOR".split())

    def bounded(self):
        """A formula of at most 40 in amount."""
        return f"[40 * SIN[{self.formula()} * 3]]"

    def value(self):
        return self.r.choice([self.number, self.bounded])()

    def body(self, count):
        makers = [
            *[self.move] * 4, *[self.arc] * 2, *[self.assign] * 2, self.cycle, self.condition,
            self.loop, self.offset, self.system, self.reference, self.switch, self.feed, self.call,
        ]  # fmt: skip
        for _ in range(count):
            self.r.choice(makers)()

    def indented(self, text):
        self.lines.append("  " * self.depth + text)

    def move(self):
        r = self.r
        letters = r.choice(["X", "Y", "Z", "XY", "XY", "XYZ"])
        code = r.choice(["G0", "G1", "G1"])
        relative = r.random() < 0.2
        values = "".join(f" {x}{self.number(-5, 5) if relative else self.value()}" for x in letters)
        if relative:
            self.indented("G91")
        self.indented(f"{code}{values}")
        if relative:
            self.indented("G90")

    def arc(self):
        """From the current point, by its centre; the end from the angle, all in formulas."""
        r = self.r
        plane, (i, j) = r.choice([("G17", "XY"), ("G17", "XY"), ("G18", "ZX"), ("G19", "YZ")])
        if plane != "G17" and self.turned():
            return
        radius, start = r.uniform(1, 20), r.uniform(0, 360)
        end = start + r.choice([-1, 1]) * r.uniform(20, 250)
        code = "G3" if end > start else "G2"
        offsets = {"X": "I", "Y": "J", "Z": "K"}
        cx, cy = -radius * math.cos(math.radians(start)), -radius * math.sin(math.radians(start))
        dx = cx + radius * math.cos(math.radians(end))
        dy = cy + radius * math.sin(math.radians(end))
        self.indented(f"#33 = {dx:.6f} #34 = {dy:.6f}")
        center = f"{offsets[i]}{cx:.6f} {offsets[j]}[{cy:.6f}]"
        self.indented(f"{plane} G91 {code} {i}#33 {j}#34 {center}")
        self.indented("G90 G17")

    def turned(self):
        return any(" R" in x for x in self.lines if x.startswith("G10"))

    def assign(self):
        self.indented(f"{self.parameter()} = [5 * COS[{self.formula()} * 7] + 6]")

    def cycle(self):
        r = self.r
        code = r.choice([81, 81, 82, 83, 73, 85, 89, 86, 84])
        if code == 86:
            self.indented("M3")
        top = r.uniform(0, 3)
        words = f"Z{self.number(-6, -1)} R{top:.4f}"
        words += f" Q{self.number(0.4, 2)}" if code in (73, 83) else ""
        words += " P0.5" if code in (82, 89, 86, 84) else ""
        self.indented(f"G{r.choice([98, 99])} G{code} X{self.value()} Y{self.value()} {words}")
        for _ in range(r.randint(0, 2)):
            self.indented(f"X{self.value()}" + (f" Y{self.value()}" if r.random() < 0.5 else ""))
        if r.random() < 0.3:
            self.indented(f"G91 G81 X{self.number(1, 4)} Y1 Z-2 R{self.number(-1, 1)} L3")
            self.indented("G90")
        self.indented("G80")

    def next_label(self):
        self.label += 1
        return self.r.choice([f"o{self.label}", f"o<block {self.label}>"])

    def nested(self, count):
        self.depth += 1
        if self.depth < 4:
            self.body(count)
        else:
            self.move()
        self.depth -= 1

    def condition(self):
        label = self.next_label()
        self.indented(f"{label} if [{self.formula()} {self.compare()} {self.formula()}]")
        self.nested(1)
        if self.r.random() < 0.4:
            self.indented(f"{label} elseif [{self.parameter()} GT {self.number(1, 9)}]")
            self.nested(1)
        if self.r.random() < 0.6:
            self.indented(f"{label} else")
            self.nested(1)
        self.indented(f"{label} endif")

    def loop(self):
        r = self.r
        label, count = self.next_label(), f"#{50 + self.label % 900 + 1}"
        kind = r.choice(["while", "do", "repeat"])
        self.indented(f"{count} = 0")
        start = {"while": f"while [{count} LT {r.randint(0, 3)}]", "do": "do", "repeat": ""}[kind]
        self.indented(f"{label} {start or f'repeat [{r.randint(0, 3)}]'}")
        self.indented(f"  {count} = [{count} + 1]")
        self.nested(r.randint(1, 2))
        if r.random() < 0.3:
            inner = self.next_label()
            self.indented(f"{inner} if [{count} EQ {r.randint(1, 3)}]")
            self.indented(f"  {label} {r.choice(['break', 'continue'])}")
            self.indented(f"{inner} endif")
        self.move()
        end = {"while": "endwhile", "repeat": "endrepeat", "do": f"while [{count} LE 2]"}[kind]
        self.indented(f"{label} {end}")

    def offset(self):
        r = self.r
        kind = r.randrange(4)
        if kind == 0:
            self.indented(f"G92 X{self.number()} Z{self.number(-2, 2)}")
        elif kind == 1 and self.known != [None]:
            self.indented(f"G52 X{self.number(-3, 3)} Y{self.number(-3, 3)}")
        elif kind == 2 and self.known != [None]:
            self.indented(r.choice(["G92.1", "G92.2", "G92.3"]))
        elif kind == 3 and not self.turned():
            self.indented(f"G10 L20 P0 X{self.number()} Y{self.number()}")

    def system(self):
        if self.known != [None]:
            i = self.r.choice(self.known)
            self.indented({1: "G54", 2: "G55", 3: "G56", 9: "G59.3"}[i])

    def reference(self):
        r = self.r
        code = r.choice([28, 30])
        if r.random() < 0.5:
            self.indented(f"G{code}.1")
            self.move()
            self.indented(f"G{code}" + r.choice(["", f" X{self.number()}", " G91 Z0"]))
        else:
            self.indented(f"G{code} Z{self.number(4, 9)}")
        self.indented(f"G90 G0 X{self.value()} Y{self.value()} Z{self.number(1, 5)}")

    def switch(self):
        words = "M3 M5 M8 M9 S900 T3 M6 M64P1 M65P1 M0".split()
        self.indented(self.r.choice([*words, "M67 E1 Q2.5", "G4 P.5", "G4 S1", "M101", "M117 a"]))

    def feed(self):
        r = self.r
        if r.random() < 0.5:
            self.indented(f"G93 G1 X{self.value()} Y{self.value()} F{self.number(1, 9)}")
            self.indented(f"G94 F{self.number(100, 900)}")
        else:
            self.indented(f"F[{self.number(100, 300)} + ABS[{self.formula()}]]")

    def sub(self):
        """A subprogram of its arguments, that may return early."""
        self.label += 1
        name = f"o<part{self.label}>"
        self.lines.append(f"{name} sub")
        self.depth, kept = 2, self.names
        self.names = ["1", "2", "<_wide>"]
        self.lines.append(f"  G1 X#1 Y[#2 * {self.number(-2, 2)}]")
        self.body(2)
        if self.r.random() < 0.4:
            inner = self.next_label()
            self.lines.append(f"  {inner} if [#1 GT #2]")
            self.lines.append(f"    {name} return [#1 + #2]")
            self.lines.append(f"  {inner} endif")
        self.lines.append(f"  G1 Z{self.number(1, 5)}")
        self.depth, self.names = 0, kept
        self.lines.append(f"{name} endsub [#1 - 1]")
        return name

    def call(self):
        if self.subs and self.depth < 2:
            name = self.r.choice(self.subs)
            self.indented(f"{name} call [{self.value()}] [{self.parameter()}]")
            self.indented("#31 = [ABS[#<_value>] MOD 7 + 1]")


def series(seed):
    """A program of drilling: series of holes in three planes, with both return levels, G90 and G91.

    A line may change the cycle, the distance mode or the return level within its series; R and Z
    are chosen so that no hole is above its R.
    """
    r = random.Random(seed)
    lines = [f"{r.choice(['G21', 'G20'])} G90 G64 F{r.uniform(50, 500):.3f}", "M3 S800"]
    for _ in range(r.randint(1, 4)):
        plane, (a, b, c) = r.choice([("G17", "XYZ"), ("G18", "ZXY"), ("G19", "YZX")])
        start = r.uniform(-3, 30)
        lines.append(f"G80 G90 G0 X{r.uniform(-9, 9):.4f} Y{r.uniform(-9, 9):.4f} Z1")
        lines.append(f"G0 {c}{start:.4f} {plane}")
        relative, last, code = False, False, None
        for _ in range(r.randint(1, 7)):
            words = []
            if r.random() < 0.3:
                relative = not relative
                words.append("G91" if relative else "G90")
            if r.random() < 0.4:
                words.append(r.choice(["G98", "G99"]))
            new = code is None or r.random() < 0.3
            if new:
                code = r.choice([73, 74, 81, 82, 83, 84, 85, 86, 89])
                words.append(f"G{code}")
            # The same R and Z mean other heights after G90 or G91.
            if new or relative != last or r.random() < 0.2:
                top = r.uniform(-2, 8)
                bottom = -r.uniform(0.5, 6) if relative else top - r.uniform(0.5, 6)
                words += [f"R{top:.4f}", f"{c}{bottom:.4f}"]
                if code in (73, 83):
                    words.append(f"Q{r.uniform(0.3, 2):.4f}")
                if code in (74, 82, 84, 86, 89):
                    words.append(f"P{r.choice(['0', '.5'])}")
            last = relative
            places = r.choice([a, b, a + b])
            words += [f"{x}{r.uniform(-9, 9):.4f}" for x in places]
            if r.random() < 0.3:
                words.append(f"L{r.randint(1, 4)}")
            head = [x for x in words if x[0] == "G"]
            tail = words[len(head) :]
            r.shuffle(tail)
            lines.append(" ".join(head + tail))
        if r.random() < 0.7:
            lines.append("G80")
            lines.append(f"G90 G0 {a}{r.uniform(-9, 9):.4f}")
    return "\n".join([*lines, "G80 G90 G17", "G1 X1 Y2 Z3", "M2"]) + "\n"


def program(seed):
    """The text of the program of a seed."""
    return Author(seed).text()
