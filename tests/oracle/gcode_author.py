"""Random valid programs with drilling cycles, G92, reference moves, switches and G93.

Every program is valid by construction: arcs are drawn by their angles, and cycles go down.
"""

import math
import random


class Author:
    """Writes one program; the same seed gives the same text."""

    def __init__(self, seed):
        self.r = random.Random(seed)
        self.lines = []

    def text(self):
        r = self.r
        if r.random() < 0.5:
            self.lines.append(f"O{r.randint(1, 99)} (PART)")
        self.lines.append(r.choice(["G21 G90", "G90 G0 G80 G40 G49", "G20 G17 G90"]))
        self.lines.append(f"F{self.number(100, 900)}")
        if r.random() < 0.3:
            self.lines.append(f"G92 X{self.number()} Y{self.number()} Z{self.number(1, 3)}")
        else:
            self.lines.append(r.choice(["G54", "G55", "G59.3"]))
        self.lines.append(f"G0 X{self.number()} Y{self.number()} Z{self.number(1, 5)}")
        makers = [
            *[self.move] * 4, *[self.arc] * 2, self.cycle, self.shift, self.reference,
            self.switch, self.feed,
        ]  # fmt: skip
        for _ in range(r.randint(12, 28)):
            r.choice(makers)()
        # The place of the tool is known even where G92 was taken back last.
        self.lines += ["G92 X0 Y0 Z0", "G1 X1.5 Y2.5 Z3.5 F200", r.choice(["M2", "M30"])]
        return "\n".join(self.lines) + "\n"

    def number(self, low=-20, high=20):
        return f"{self.r.uniform(low, high):.4f}"

    def move(self):
        r = self.r
        letters = r.choice(["X", "Y", "Z", "XY", "XY", "XYZ"])
        code, relative = r.choice(["G0", "G1", "G1"]), r.random() < 0.2
        size = 5 if relative else 20
        values = "".join(f" {x}{self.number(-size, size)}" for x in letters)
        self.lines += ["G91", f"{code}{values}", "G90"] if relative else [f"{code}{values}"]

    def arc(self):
        """From the current point, by its centre; the end from the angle."""
        r = self.r
        plane, (i, j) = r.choice([("G17", "XY"), ("G17", "XY"), ("G18", "ZX"), ("G19", "YZ")])
        radius, start = r.uniform(1, 20), r.uniform(0, 360)
        end = start + r.choice([-1, 1]) * r.uniform(20, 250)
        code = "G3" if end > start else "G2"
        offsets = {"X": "I", "Y": "J", "Z": "K"}
        cx, cy = -radius * math.cos(math.radians(start)), -radius * math.sin(math.radians(start))
        dx = cx + radius * math.cos(math.radians(end))
        dy = cy + radius * math.sin(math.radians(end))
        center = f"{offsets[i]}{cx:.6f} {offsets[j]}{cy:.6f}"
        self.lines.append(f"{plane} G91 {code} {i}{dx:.6f} {j}{dy:.6f} {center}")
        self.lines.append("G90 G17")

    def cycle(self):
        r = self.r
        code = r.choice([81, 82, 83])
        words = f"Z{self.number(-6, -1)} R{self.number(0, 3)}"
        words += {81: "", 82: " P0.5", 83: f" Q{self.number(0.4, 2)}"}[code]
        level = r.choice([98, 99])
        self.lines.append(f"G{level} G{code} X{self.number()} Y{self.number()} {words}")
        for _ in range(r.randint(0, 2)):
            self.lines.append(f"X{self.number()}" + r.choice(["", f" Y{self.number()}"]))
        if r.random() < 0.3:
            self.lines.append(f"G91 G81 X{self.number(1, 4)} Y1 Z-2 R{self.number(-1, 1)} L3")
            self.lines.append("G90")
        self.lines.append("G80")

    def shift(self):
        self.lines.append(f"G92 X{self.number()} Z{self.number(-2, 2)}")
        if self.r.random() < 0.3:
            self.lines.append(self.r.choice(["G92.1", "G92.2"]))
            self.lines.append(f"G92 X{self.number()} Y{self.number()} Z{self.number(-2, 2)}")

    def reference(self):
        r = self.r
        words = r.choice(["", f" X{self.number()}", " G91 Z0", f" Z{self.number(4, 9)}"])
        self.lines.append(r.choice([f"G{r.choice([28, 30])}{words}", "G53 G0 Z0"]))
        self.lines.append(f"G90 G0 X{self.number()} Y{self.number()} Z{self.number(1, 5)}")

    def switch(self):
        words = "M3|M5|M8|M9|S900|T3|M6|M64P1|M65P1|M0|M67 E1 Q2.5|G4 P.5|G4 S1|M101|M117 a"
        self.lines.append(self.r.choice(words.split("|")))

    def feed(self):
        if self.r.random() < 0.5:
            self.lines.append(f"G93 G1 X{self.number()} Y{self.number()} F{self.number(1, 9)}")
            self.lines.append(f"G94 F{self.number(100, 900)}")
        else:
            self.lines.append(f"F{self.number(100, 400)}")


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
                code = r.choice([81, 82, 83])
                words.append(f"G{code}")
            # The same R and Z mean other heights after G90 or G91.
            if new or relative != last or r.random() < 0.2:
                top = r.uniform(-2, 8)
                bottom = -r.uniform(0.5, 6) if relative else top - r.uniform(0.5, 6)
                words += [f"R{top:.4f}", f"{c}{bottom:.4f}"]
                if code == 83:
                    words.append(f"Q{r.uniform(0.3, 2):.4f}")
                if code == 82:
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
