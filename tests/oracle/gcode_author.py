"""Random valid programs with reference moves, switches, arcs and words that are left out.

Every program is valid by construction: arcs are drawn by their angles.
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
        self.lines.append(r.choice(["G54", "G55", "G59", "G92 E0"]))
        self.lines.append(f"G0 X{self.number()} Y{self.number()} Z{self.number(1, 5)}")
        makers = [
            *[self.move] * 4, *[self.arc] * 2, self.reference, self.switch, self.feed,
        ]  # fmt: skip
        for _ in range(r.randint(12, 28)):
            r.choice(makers)()
        self.lines += ["G1 X1.5 Y2.5 Z3.5 F200", r.choice(["M2", "M30"])]
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

    def reference(self):
        r = self.r
        words = r.choice(["", f" X{self.number()}", " G91 Z0", f" Z{self.number(4, 9)}"])
        self.lines.append(r.choice([f"G28{words}", "G53 G0 Z0"]))
        self.lines.append(f"G90 G0 X{self.number()} Y{self.number()} Z{self.number(1, 5)}")

    def switch(self):
        words = (
            "M3|M5|M8|M9|S900|T3|M6|M64P1|M65P1|M0|M67 E1 Q2.5|G4 P.5|G4 S1|M101|M117 a|G43 H1|G49"
        )
        self.lines.append(self.r.choice(words.split("|")))

    def feed(self):
        self.lines.append(self.r.choice(["", "G94 ", "G99 "]) + f"F{self.number(100, 400)}")


def program(seed):
    """The text of the program of a seed."""
    return Author(seed).text()
