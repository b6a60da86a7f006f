"""Time commands in their own processes: long programs, drawings, the paper's job, a first run.

Warm commands run after a command of their kind. Cold commands start with an empty folder for
numba's compiled functions. The peak memory is that of the largest process.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks import reference
from benchmarks.measured import Bar, Line, Pair, Taken, spawned, timed

GASKET = Path(__file__).parents[1] / "examples" / "drawings" / "gasket.dxf"
# Mean length of a G-code line [mm].
STEP = 0.5
# Standard deviation of the noise on each coordinate of a line's end [mm].
NOISE = 0.01
# Mean distance of neighbouring circles' centres in a row and between rows [mm].
APART = 6.0
# Smallest and largest radius of circles [mm].
RADII = (1.2, 2.2)
# Runs of the reference work beside a command, at least.
REFERENCES = 20


@dataclass(frozen=True)
class Drawn:
    """Drawings of a kind: the ending of their file, its text for so many parts, options."""

    ending: str
    text: Callable[[int], str]
    parts: str
    warm: int
    options: tuple[str, ...]


def gcode(lines: int) -> str:
    """Return the lines of a wavy spiral, run in and out within 120 x 120 mm."""
    rng = np.random.default_rng(1)
    radius = 35 + 24 * np.sin(np.linspace(0, lines / 2500, lines))
    angle = np.cumsum(STEP * rng.uniform(0.5, 1.5, lines) / radius)
    x = 75 + radius * np.cos(angle) + rng.normal(0, NOISE, lines)
    y = 75 + radius * np.sin(angle) + rng.normal(0, NOISE, lines)
    head = f"G21 G90 G17 G64 P0.05\nG0 X{x[0]:.3f} Y{y[0]:.3f}\nM3\nF6000\n"
    body = "".join(f"G1 X{a:.3f} Y{b:.3f}\n" for a, b in zip(x[1:], y[1:], strict=True))
    return f"{head}{body}M5\nM2\n"


def circles(count: int, scale: float = 1.0) -> str:
    """Draw circles in rows as SVG, none exactly on a grid."""
    rng = np.random.default_rng(2)
    columns = int(np.ceil(np.sqrt(1.2 * count)))
    size = APART * (columns + 2)
    row, column = np.divmod(np.arange(count), columns)
    x, y = (APART * (1.5 + k) + rng.uniform(-0.5, 0.5, count) for k in (column, row))
    circles_svg = [
        f'<circle cx="{a:.3f}" cy="{b:.3f}" r="{r:.3f}"/>'
        for a, b, r in zip(x, y, rng.uniform(*RADII, count), strict=True)
    ]
    side = scale * size
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{side}mm" height="{side}mm" '
    return f'{head}viewBox="0 0 {size} {size}">{"".join(circles_svg)}</svg>'


SET_POINTS = ("--no-simulation", "--export", "csv")
GCODE = Drawn("ngc", gcode, "lines of G-code", 2000, SET_POINTS)
CIRCLES = Drawn("svg", circles, "circles", 30, ("--no-simulation",))
# 10,000 of them are within reach of a UR5e.
SMALL = Drawn("svg", partial(circles, scale=0.5), "small circles", 30, ("--no-simulation",))


def lines() -> list[Line]:
    """Return the lines for long programs (the longest only if named), then shorter commands."""
    # Processor time, as programs may be planned on several cores; the bars are by the clock.
    return [
        _long("gcode/pmk3s", GCODE, 150_000, "pmk3s", _by_clock(15, 2e9)),
        _long("gcode/ur5e", GCODE, 15_000, "ur5e", _by_clock(6, 2e9)),
        _long("gcode/ur5e/full", GCODE, 150_000, "ur5e", _by_clock(60, 2e9), full=True),
        _long("circles/ur5e", CIRCLES, 300, "ur5e", Bar()),
        _long("circles/ur5e/full", CIRCLES, 3000, "ur5e", _by_clock(8), full=True),
        _long("contours/1", SMALL, 1, "ur5e", Bar()),
        _long("contours/100", SMALL, 100, "ur5e", Bar()),
        _long("contours/10000", SMALL, 10_000, "ur5e", Bar(), full=True),
        Line("gasket/warm", "run, gasket, ur5e", reference.NAME, _gasket, Bar(seconds=2.6)),
        Line("gasket/cold", "first run, gasket, ur5e", reference.COMPILED, _cold, Bar(seconds=30)),
        Line("demo", "armcontour demo", reference.NAME, _demo, _by_clock(4)),
    ]


def _by_clock(seconds: float, memory: float | None = None) -> Bar:
    return Bar(seconds=seconds, memory=memory, clock=True)


def _long(name: str, drawn: Drawn, count: int, cell: str, bar: Bar, full: bool = False) -> Line:
    title = f"run, {count:,} {drawn.parts}, {cell}"
    return Line(name, title, reference.NAME, partial(_drawn, drawn, count, cell), bar, full)


def _drawn(drawn: Drawn, count: int, cell: str) -> Pair:
    folder = tempfile.TemporaryDirectory()
    file = Path(folder.name) / f"part.{drawn.ending}"
    command = partial(_run, folder, file, "--cell", cell, *drawn.options)
    file.write_text(drawn.text(drawn.warm))
    spawned(command)(1)
    file.write_text(drawn.text(count))
    return _against_reference(command)


def _gasket() -> Pair:
    folder = tempfile.TemporaryDirectory()
    command = partial(_run, folder, GASKET, "--cell", "ur5e")
    spawned(command)(1)
    return _against_reference(command)


def _cold() -> Pair:
    folder = tempfile.TemporaryDirectory()

    def empty() -> dict[str, str]:
        return {"NUMBA_CACHE_DIR": tempfile.mkdtemp(dir=folder.name)}

    ours = partial(_run, folder, GASKET, "--cell", "ur5e")
    code = "from benchmarks.reference import compile_function; compile_function()"
    peer = [sys.executable, "-c", code]
    return Pair(spawned(ours, empty), spawned(lambda: peer, empty), warm=True)


def _demo() -> Pair:
    folder = tempfile.TemporaryDirectory()

    def command() -> list[str]:
        out = str(Path(folder.name) / "out")
        return [sys.executable, "-m", "armcontour", "demo", "--out", out, "--force"]

    spawned(command)(1)
    return _against_reference(command)


def _run(folder: tempfile.TemporaryDirectory[str], file: Path, *options: str) -> list[str]:
    """Return the command that runs a file, with its results in a folder that it replaces."""
    out = str(Path(folder.name) / "out")
    return [sys.executable, "-m", "armcontour", "run", str(file), *options, "--out", out, "--force"]


def _against_reference(command: Callable[[], list[str]]) -> Pair:
    work = timed(reference.work)

    def peer(times: int) -> list[Taken]:
        return work(max(times, REFERENCES))

    return Pair(spawned(command), peer, warm=True)
