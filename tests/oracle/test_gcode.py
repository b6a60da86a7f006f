"""The reader of G-code against an independent interpreter, on the corpus and on random programs."""

import itertools
import math
import random
from pathlib import Path

import numpy as np
import pytest
from tests.oracle import gcode_interpreter as oracle

from armcontour.files.drawings.gcode import read_gcode
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.program import Contour, Dwell, Event, Rapid

CORPUS = Path(__file__).parents[1] / "files" / "drawings" / "gcode"
SHARES = np.linspace(0.0, 1.0, 9)
NANOMETRE = 1e-9
# `make soak` compares 20,000.
PROGRAMS = 40


def read(text, **options):
    """Read a program without the repair of vertices, which other tests check."""
    read_options = ReadOptions(repair_vertices=0.0, **options)
    return read_gcode(text.encode("latin-1"), source="part.ngc", options=read_options)


def compare(program, moves, chord_tolerance=1e-5):
    """Every move, point, length, speed, tolerance and event."""
    kinds = {Contour: oracle.Contour, Rapid: oracle.Rapid, Dwell: oracle.Dwell, Event: oracle.Event}
    assert [kinds[type(x)] for x in program.moves] == [type(x) for x in moves]
    for move, expected in zip(program.moves, moves, strict=True):
        if isinstance(move, Dwell):
            assert move.duration == expected.duration
        elif isinstance(move, Event):
            assert (move.name, move.value) == (expected.name, expected.value)
        elif isinstance(move, Rapid):
            compare_points(move.path.vertices, np.array(expected.points))
        else:
            compare_contour(move, expected, chord_tolerance)


def compare_points(actual, expected):
    assert actual.shape[0] == expected.shape[0]
    d = actual.shape[1]
    assert np.abs(actual - expected[:, :d]).max() <= NANOMETRE
    assert d == 3 or np.abs(expected[:, 2]).max() <= NANOMETRE


def compare_contour(contour, expected, chord_tolerance):
    assert contour.name == expected.name
    path = contour.path
    i = 0
    places = []
    for segment in expected.segments:
        places.append(path.breaks[i])
        n = 1
        if segment.kind == "helix":
            n = compare_helix(path, i, segment, chord_tolerance)
        else:
            assert abs(path.lengths[i] - segment.length) <= NANOMETRE
            assert (path.curvatures[i] > 0) == (segment.kind == "arc")
            u = SHARES * path.lengths[i]
            points = path.on_segment(np.full(len(u), i), u)
            compare_points(points, np.array([segment.at(x) for x in SHARES]))
        assert path.speeds[i : i + n] == pytest.approx(segment.speed, rel=1e-9, nan_ok=True)
        tolerances = path.tolerances[i : i + n]
        assert tolerances == pytest.approx(segment.tolerance, rel=1e-12, nan_ok=True)
        i += n
    assert i == len(path)
    places.append(path.breaks[i])
    events = [(name, value, places[index]) for index, name, value in expected.events]
    assert [(e.name, e.value, e.s) for e in contour.events] == events


def compare_helix(path, i, segment, chord_tolerance):
    """Its transitions: ends on the helix at even shares, all within the tolerance; how many."""
    end = np.array(segment.at(1.0))
    vertices = path.vertices[i:]
    # The first vertex there: the path may come by again.
    n = int(np.argmax(np.linalg.norm(vertices - end, axis=1) <= NANOMETRE))
    assert n > 0
    compare_points(vertices[: n + 1], np.array([segment.at(k / n) for k in range(n + 1)]))
    for k in range(n):
        u = np.array([0.25, 0.5, 0.75]) * path.lengths[i + k]
        points = path.on_segment(np.full(len(u), i + k), u)
        # Near points of the helix, because the arc length of a spiral is not even in its angle.
        shares = np.linspace(k / n, (k + 1) / n, 2001)
        helix = np.array([segment.at(x) for x in shares])
        distances = np.linalg.norm(points[:, None] - helix, axis=2).min(axis=1)
        spacing = np.linalg.norm(np.diff(helix, axis=0), axis=1).max()
        assert (distances <= chord_tolerance + spacing / 2).all()
    return n


def test_the_corpus_is_read_like_the_oracle_does():
    programs = {x: x.read_bytes() for x in sorted(CORPUS.rglob("*.ngc"))}
    accepted = {x: y for x, y in programs.items() if b"refused in line" not in y[:400]}
    assert len(accepted) > 35
    for file, data in accepted.items():
        if file.parent.name != "refused":
            print(file)  # pytest shows it of a failure
            program = read_gcode(data, source=file.name, options=ReadOptions(repair_vertices=0.0))
            text = data.decode("latin-1").replace("\r\n", "\n").replace("\r", "\n")
            compare(program, oracle.interpret(text.removeprefix("\xef\xbb\xbf")))


class Author:
    """Writes a random valid program of all features."""

    def __init__(self, seed):
        self.r = random.Random(seed)
        self.unit = 1.0  # mm
        self.at = [0.0, 0.0, 0.0]  # mm
        self.absolute = True
        self.centers_absolute = False
        self.plane = 17
        self.motion = None
        self.flat = self.r.random() < 0.3
        self.lines = []

    def text(self):
        r = self.r
        self.write(["G" + self.code(r.choice(["21", "17", "90"])), "F" + self.number(600.0)])
        makers = [*[self.straight] * 6, *[self.rapid] * 2, *[self.arc] * 6, *[self.mode] * 3]
        switches = "M3 M4 M5 M7 M8 M9 S100 S2000.5 M0 M1".split()
        noise = ["", "  ", "(nothing)", "/ G1 X1", "; G0", "G40"]
        makers += [
            lambda: self.write([r.choice(switches)]),
            lambda: self.write(["G4", r.choice(["P0", "P.25", "P1"])]),
            lambda: self.write(["F" + self.number(r.uniform(1, 3000))]),
            lambda: self.lines.append(r.choice(noise)),
        ]
        for _ in range(r.randint(20, 50)):
            r.choice(makers)()
        self.straight()
        self.write([r.choice(["M2", "M30", "m02"])])
        return "\n".join(self.lines) + "\n"

    def write(self, words):
        r = self.r
        r.shuffle(words)
        if r.random() < 0.15:
            words.insert(r.randrange(len(words) + 1), "(a; comment)")
        line = r.choice(["", " ", "\t"]).join(words)
        if r.random() < 0.2:
            line = line.lower()
        if r.random() < 0.15:
            line = f"N{r.randrange(10000)} {line}"
        if r.random() < 0.1:
            line += " ; F1 (no word"
        if r.random() < 0.1 and "(" not in line and ";" not in line:
            line = " ".join(line)
        self.lines.append(line)

    def code(self, code):
        return "0" + code if len(code) == 1 and self.r.random() < 0.3 else code

    def number(self, value, places=5):
        text = f"{value:.{places}f}"
        r = self.r
        if r.random() < 0.3 and "." in text:
            text = text.rstrip("0") or "0"
        if r.random() < 0.2:
            text = text.replace("0.", ".", 1) if text.lstrip("-").startswith("0.") else text
        if r.random() < 0.1 and not text.startswith("-"):
            text = "+" + text
        return text if text not in (".", "-.", "+.") else "0"

    def word(self, letter, value, places=5):
        """A word of a length [mm], and the length that it says."""
        text = self.number(value / self.unit, places)
        return letter + text, float(text) * self.unit

    def goto(self, target, letters, places=5):
        """Words to a target [mm] by some of its coordinates; the tool is there afterwards."""
        words = []
        for i, letter in enumerate("XYZ"):
            if letter in letters:
                origin = 0.0 if self.absolute else self.at[i]
                word, value = self.word(letter, target[i] - origin, places)
                words.append(word)
                self.at[i] = origin + value
        return words

    def moving(self, code):
        same = self.motion == code and self.r.random() < 0.6
        self.motion = code
        return [] if same else ["G" + self.code(str(code))]

    def letters(self):
        if self.flat:
            return self.r.choice(["X", "Y", "XY", "XY"])
        return self.r.choice(["X", "Y", "Z", "XY", "XY", "XYZ", "YZ"])

    def straight(self):
        target = [x + self.r.uniform(-20, 20) for x in self.at]
        if self.r.random() < 0.1:
            target = list(self.at)
        self.write(self.moving(1) + self.goto(target, self.letters()))

    def rapid(self):
        target = [self.r.uniform(-50, 50) for _ in self.at]
        self.write(self.moving(0) + self.goto(target, self.letters()))

    def arc(self):
        r = self.r
        axes = {17: "XYZ", 18: "ZXY", 19: "YZX"}[self.plane]
        if self.flat and self.plane != 17:
            return
        a, b, c = ("XYZ".index(x) for x in axes)
        way = r.choice([2, 3])
        radius = math.exp(r.uniform(math.log(0.5), math.log(200)))
        turn = r.uniform(0, 2 * math.pi)
        sweep = r.choice([r.uniform(0.02, 6.26), r.uniform(0.3, 4), 2 * math.pi - 1e-3, math.pi])
        full = r.random() < 0.15
        begin = list(self.at)
        center = [begin[a] + radius * math.cos(turn), begin[b] + radius * math.sin(turn)]
        z = (begin[a] - center[0], begin[b] - center[1])
        sign = 1 if way == 3 else -1
        angle = 0.0 if full else sweep * sign
        target = list(begin)
        target[a] = center[0] + z[0] * math.cos(angle) - z[1] * math.sin(angle)
        target[b] = center[1] + z[0] * math.sin(angle) + z[1] * math.cos(angle)
        helical = not self.flat and r.random() < 0.2
        target[c] += r.uniform(-5, 5) if helical else 0.0
        words = self.moving(way)
        letters = (axes[:2] if not full else "") + (axes[2] if helical else "")
        # Three decimals leave centres that do not fit their ends.
        places = r.choice([3, 5])
        if not full and 0.3 < sweep < 5.9 and abs(sweep - math.pi) > 0.3 and r.random() < 0.4:
            words += self.goto(target, letters, places)
            words.append(self.word("R", radius if sweep < math.pi else -radius, places)[0])
        else:
            for i, origin in ((a, center[0]), (b, center[1])):
                value = origin - (0.0 if self.centers_absolute else begin[i])
                words.append(self.word("IJK"[i], value, 5)[0])
            words += self.goto(target, letters, places)
        self.write(words)

    def mode(self):
        words = [self.r.choice(["G61", "G64"])]
        kind = self.r.randrange(6)
        if kind == 0:
            self.absolute = not self.absolute
            words = ["G90" if self.absolute else "G91"]
        elif kind == 1:
            self.centers_absolute = not self.centers_absolute
            words = ["G90.1" if self.centers_absolute else "G91.1"]
        elif kind == 2:
            self.plane = self.r.choice([17, 18, 19])
            words = [f"G{self.plane}"]
        elif kind == 3:
            self.unit = 26.4 - self.unit
            words = ["G21" if self.unit == 1.0 else "G20"]
        elif kind == 4:
            words = ["G64", "P" + self.number(self.r.uniform(0.01, 1))]
        self.write(words)


def test_random_programs_are_read_like_the_oracle_does():
    for seed in range(PROGRAMS):
        text = Author(seed).text()
        print(f"seed {seed}:\n{text}")  # pytest shows it of a failure
        compare(read(text), oracle.interpret(text))


def test_random_g_code_programs_use_every_feature():
    texts = [Author(seed).text().upper() for seed in range(PROGRAMS)]
    programs = [oracle.interpret(x) for x in texts]
    moves = list(itertools.chain.from_iterable(programs))
    with_segments = [x.segments for x in moves if hasattr(x, "segments")]
    kinds = {x.kind for x in itertools.chain.from_iterable(with_segments)}
    assert kinds == {"line", "arc", "helix"}
    assert {type(x) for x in moves} == {oracle.Contour, oracle.Rapid, oracle.Dwell, oracle.Event}
    for feature in ("G20", "G91", "G90.1", "G18", "G19", "G61", "G64", "R-", "(", ";", "\n/"):
        assert any(feature in x.replace(" ", "") for x in texts)
    assert {read(x).dimension for x in texts} == {2, 3}


def test_the_comparison_detects_a_changed_program():
    text = (
        "F600\nG1 X10\nG64 P.05\nM8\nG3 Y10 I-2 J5\nG2 X20 R-10\nG4 P1\nG18 G3 X30 I5\n"
        "G17 G3 X20 Y0 I-5 J-5 Z2\nG0 X0\nG1 X5\nM2\n"
    )
    compare(read(text), oracle.interpret(text))
    for old, new in (
        ("X10", "X10.00001"), ("G3", "G2"), ("F600", "F601"), ("P.05", "P.06"), ("M8", "M7"),
        ("G1 X10\nG64 P.05\nM8", "M8\nG1 X10\nG64 P.05"), ("G4 P1", "G4 P2"), ("R-10", "R10"),
        ("G18", "G17"), ("Z2", "Z2.00001"), ("G0 X0", "G0 X0.00001"),
    ):  # fmt: skip
        changed = text.replace(old, new, 1)
        assert changed != text
        with pytest.raises(AssertionError):
            compare(read(changed), oracle.interpret(text))
