"""Measure the Studio's answers in a browser: `python -m benchmarks.studio_page [--only NAME]`.

A time runs from the mouse event to the end of the drawing that shows its answer. The page measures
it itself, without the time that the screen needs after it. The machine must be quiet, because bars
are wall-clock times on two processors. The exit code is 1 if a bar is missed.
"""

from __future__ import annotations

import argparse
import compileall
import math
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from rich.console import Console
from rich.table import Table
from tools.studio_page import SQUARE, Studio, browsing, serving, write_job, write_shapes

import armcontour
from benchmarks.commands import gcode

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Mouse

# How long each motion of the mouse lasts [s].
SECONDS = 5.0
# How often the mouse moves [Hz].
RATE = 60.0
# Lines of the G-code that is opened.
LINES = 150_000
# Segments of the drawing that is panned and zoomed.
SEGMENTS = 10_000
# Contours of the drawing that is planned and moved.
CONTOURS = 2_000
# Frames while the motion plays: their median with software rendering [ms], and its ratio to that of
# the drawing alone, at most.
PLAY_FRAME = 80.0
PLAY_RATIO = 1.3


@dataclass(frozen=True)
class Found:
    """A measured figure with its bar.

    Args:
        what: What was measured.
        value: The figure.
        bar: What it may be at most, or at least; None for what is only told.
        unit: Unit of both.
        least: Whether the bar is a least value.
        more: What else is to be said.
    """

    what: str
    value: float
    bar: float | None
    unit: str
    least: bool = False
    more: str = ""

    @property
    def kept(self) -> bool:
        """Whether the bar is kept."""
        if self.bar is None:
            return True
        return self.value >= self.bar if self.least else self.value <= self.bar


Measure: TypeAlias = "Callable[[Browser, FilePath], Iterator[Found]]"


def paper(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Drag a waypoint of the paper's job, then sliders."""
    job = write_job(
        folder / "job.yaml", "optimal", changes=[("interval: 4 ms", "interval: 0.2 ms")]
    )
    with _studio(browser, job) as studio:
        with _measuring(studio) as drawn:
            _circle(studio, 1, 40.0)
        yield from _latencies("drag, paper's job", drawn, 60.0, 100.0)
        for key in ("limits.speed", "servo.kp"):
            with _measuring(studio) as drawn:
                _shake(studio, key)
            yield from _latencies(f"slider {key}", drawn, 100.0, 100.0, rate=None)
        yield Found("server after that", studio.server.memory / 1e6, None, "MB")


def square(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Drag a corner of the UR5e's square, with the arm's torque limits."""
    job = folder / "square.yaml"
    job.write_text(SQUARE)
    with _studio(browser, job) as studio, _measuring(studio) as drawn:
        _circle(studio, 2, 20.0)
    yield from _latencies("drag, UR5e square with torques", drawn, 150.0, 150.0, rate=None)


def segments(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Pan and zoom a drawing of 10,000 segments."""
    file = folder / "part.ngc"
    file.write_text(gcode(SEGMENTS))
    with _studio(browser, file, "--cell", "pmk3s") as studio:
        mouse, pan = _panning(studio)

        def zoom(t: float) -> None:
            mouse.wheel(0, 60 * math.cos(2 * t))

        for name, act in (("pan", pan), ("zoom", zoom)):
            if name == "pan":
                mouse.down()
            frames = _frames(studio, act)
            mouse.up()
            slowest = f"95 % of the frames within {_share(frames, 0.95):.0f} ms"
            rate = 1e3 * len(frames) / sum(frames)
            title = f"{name} {SEGMENTS:,} segments"
            yield Found(title, rate, 30.0, "frames/s", least=True, more=slowest)


def corner(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Drag a corner of a 54 s motion while its exact figures are computed."""
    strokes = 24
    points = [[0.1 * ((k + 1) // 2 % 2), 4e-3 * (k // 2), 0.0] for k in range(2 * strokes)]
    job = folder / "long.yaml"
    head, _, rest = SQUARE.partition("  points:")
    rest = rest.partition("\n")[2].replace("speed: 0.25", "speed: 0.05")
    job.write_text(f"{head}  points: {points}\n{rest}")
    with _studio(browser, job) as studio, _measuring(studio) as drawn:
        studio.find("#view2d").hover()
        _circle(studio, 8, 10.0, "corner")
    yield from _latencies("drag a corner, 54 s", drawn, 150.0, math.inf, rate=None)


def contours(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Open and plan 2,000 contours, and move them on the screen."""
    file = write_shapes(folder / "shapes.dxf", CONTOURS, 50, 8.0, 2.5)
    with serving(file, "--cell", "ur5e", folder=folder) as server:
        begin = time.perf_counter()
        studio = Studio(browser, server)
        studio.wait_for("#messages .work:not([hidden])")
        yield Found("2,000 contours: progress", time.perf_counter() - begin, 1.0, "s")
        studio.wait_for("#view2d[data-tier='1']")
        yield Found("its outline", time.perf_counter() - begin, 1.0, "s")
        studio.begin()
        studio.wait_for("[data-figure=duration]:not([data-value=''])", timeout=6e5)
        yield Found("its plan", time.perf_counter() - begin, None, "s")
        for name, wheel in (("all of it", 0), ("closer", -900)):
            studio.page.wait_for_timeout(3000)
            yield from _moved(studio, name, wheel)
        studio.close()


def _panning(studio: Studio) -> tuple[Mouse, Callable[[float], None]]:
    """Return the mouse in the middle of the drawing, and a function that moves it around."""
    x, y = studio.middle(studio.find("#view2d"))
    mouse = studio.page.mouse
    mouse.move(x, y)
    return mouse, lambda t: mouse.move(x + 80 * math.sin(3 * t), y + 60 * math.cos(2 * t))


def _moved(studio: Studio, title: str, wheel: float) -> Iterator[Found]:
    """Measure screen frames while the drawing is panned and zoomed, and the pointer moves."""
    mouse, move = _panning(studio)
    mouse.wheel(0, wheel)
    for name, act, bar in (
        ("pan", move, 50.0),
        ("zoom", lambda t: mouse.wheel(0, 60 * math.cos(2 * t)), 100.0),
        ("hover", move, 100.0),
    ):
        studio.page.wait_for_timeout(1500)
        if name == "pan":
            mouse.down()
        frames = _frames(studio, act)
        mouse.up()
        more = f"p50 {_share(frames, 0.5):.0f}, max {max(frames):.0f}"
        yield Found(f"{name}, {title}: frames, p95", _share(frames, 0.95), bar, "ms", more=more)


def program(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Open G-code of 150,000 lines."""
    job = write_job(folder / "job.yaml", "optimal")
    file = folder / "long.ngc"
    file.write_text(gcode(LINES))
    with _studio(browser, job) as studio:
        began = time.perf_counter()
        with studio.renewing():
            studio.open(file, "")
        rev = studio.told("body", "rev")
        studio.wait("#view2d", rev=rev)
        took = time.perf_counter() - began
        yield Found(f"G-code of {LINES:,} lines: first picture", took, 2.0, "s")
        studio.page.wait_for_timeout(2000)
        yield Found("its page, objects", studio.memory / 1e6, 400.0, "MB")
        yield Found("its page, whole process", _process(browser) / 1e6, 400.0, "MB")
        yield Found("its server", studio.server.memory / 1e6, None, "MB")


def start(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Measure the time from the command to a usable page, and to the first plan."""
    # As a package that was installed; a source tree may be kept from being compiled.
    compileall.compile_dir(FilePath(armcontour.__file__).parent, quiet=2)
    usable = []
    planned = []
    whole = []
    paper = folder / "paper.yaml"
    shutil.copy(FilePath(armcontour.__file__).parent / "jobs" / "library" / "paper.yaml", paper)
    for _ in range(4):
        with serving(paper, folder=folder) as server:
            studio = Studio(browser, server)
            studio.wait("body", link="open")
            usable.append(time.perf_counter() - server.begin)
            studio.wait_for("#view2d[data-tier='1'], #view2d[data-tier='2']")
            planned.append(time.perf_counter() - server.begin)
            studio.wait("body", regions="all")
            whole.append(time.perf_counter() - server.begin)
            studio.close()
    # The first start fills the system's cache of files.
    yield Found("start: usable page", max(usable[1:]), 1.5, "s")
    yield Found("start: first plan", max(planned[1:]), 3.0, "s")
    yield Found("start: charts, tables and tasks", max(whole[1:]), None, "s")


def playing(browser: Browser, folder: FilePath) -> Iterator[Found]:
    """Play the motion of a drawing as the drawing, as both views, and as the arm.

    The drawing takes less than a period of the screen, whose clock then determines the time between
    frames. How long the drawing itself takes is measured with `--unpaced`, to which the bar of the
    ratio does not apply.
    """
    drawing = FilePath(__file__).parents[1] / "examples" / "drawings" / "gasket.dxf"
    with _studio(browser, drawing, "--cell", "ur5e") as studio:
        plane = 0.0
        for name, label in (("2d", "2D"), ("both", "Both"), ("3d", "3D")):
            studio.find("#viewbar").get_by_role("button", name=label, exact=True).click()
            # The viewer is loaded, and its picture at rest is drawn.
            studio.page.wait_for_timeout(3000)
            frames, work = _played(browser, studio)
            median = _share(frames, 0.5)
            plane = plane or median
            more = f"p95 {_share(frames, 0.95):.0f}, {work:.0f} ms of processor time"
            yield Found(f"play, {name}: frames, p50", median, PLAY_FRAME, "ms", more=more)
            if name != "2d":
                title = f"play, {name}: frames as a ratio to 2d"
                yield Found(title, median / plane, PLAY_RATIO, "")


def _played(browser: Browser, studio: Studio) -> tuple[list[float], float]:
    """Play the motion slowly; return the times between frames, and processor time per frame [ms].

    The processor time of all processes of the browser depends little on the machine's load.
    """
    studio.find("#playback select").last.select_option("0.25")
    studio.page.keyboard.press("Home")
    studio.find("#playback .play").click()
    studio.wait("#playback", state="playing")
    # The first frames compile code and upload geometry.
    studio.page.wait_for_timeout(500)
    before = _processor_time(browser)
    frames = _frames(studio, lambda t: None)
    work = 1e3 * (_processor_time(browser) - before) / len(frames)
    assert studio.told("#playback", "state") == "playing", "The motion ended too early."
    studio.find("#playback .play").click()
    studio.wait("#playback", state="paused")
    return frames, work


def _processor_time(browser: Browser) -> float:
    """Return the processor time of the browser's processes [s]; Linux only."""
    total = 0
    for process in _processes(browser):
        fields = FilePath(f"/proc/{process['id']}/stat").read_text().rpartition(")")[2].split()
        total += int(fields[11]) + int(fields[12])
    return total / os.sysconf("SC_CLK_TCK")


MEASURES: dict[str, Measure] = {
    "paper": paper,
    "square": square,
    "segments": segments,
    "corner": corner,
    "contours": contours,
    "program": program,
    "start": start,
    "playing": playing,
}


@contextmanager
def _studio(browser: Browser, *arguments: str | FilePath) -> Iterator[Studio]:
    """Open a page that shows a job, at rest; anything that goes wrong in it is an error."""
    with serving(*arguments) as server:
        studio = Studio(browser, server)
        studio.begin()
        studio.wait_for("#view2d[data-tier='2']")
        studio.page.wait_for_timeout(1000)
        yield studio
        assert not studio.troubles, studio.troubles
        studio.close()


@dataclass
class Drawn:
    """What a page has drawn: by kind, how long after the event [ms], and of which message."""

    after: dict[str, list[float]]
    messages: dict[str, list[int]]
    seconds: float = 0.0


@contextmanager
def _measuring(studio: Studio) -> Iterator[Drawn]:
    """Collect what is drawn during the block."""
    studio.page.evaluate("() => performance.clearMeasures()")
    frames = Drawn({}, {})
    begin = time.perf_counter()
    yield frames
    frames.seconds = time.perf_counter() - begin
    entries = studio.page.evaluate(
        "() => performance.getEntriesByType('measure').map((e) => [e.name, e.duration, e.detail])"
    )
    for name, duration, message in entries:
        frames.after.setdefault(name, []).append(duration)
        frames.messages.setdefault(name, []).append(message)


def _latencies(
    title: str, drawn: Drawn, first: float, second: float, rate: float | None = 30.0
) -> Iterator[Found]:
    """Return how late after the event plan and executed error are drawn, and how often."""
    for kind, name, bar in (("picture", "plan", first), ("executed", "executed error", second)):
        after = drawn.after.get(f"drawn {kind}", [math.inf])
        order = drawn.messages.get(f"drawn {kind}", [])
        per = len(order) / drawn.seconds
        details = f"p50 {_share(after, 0.5):.0f}, max {max(after):.0f}, {per:.0f}/s"
        yield Found(f"{title}: {name}, p95", _share(after, 0.95), bar, "ms", more=details)
        if kind == "picture" and rate is not None:
            yield Found(f"{title}: updates", per, rate, "1/s", least=True)
        back = sum(a > b for a, b in zip(order, order[1:], strict=False))
        if back:
            yield Found(f"{title}: older after newer", back, 0.0, "times")


def _share(values: Sequence[float], share: float) -> float:
    """Return the value that this share of the values does not exceed."""
    return float(np.quantile(np.asarray(values), share, method="inverted_cdf"))


def _every_frame(act: Callable[[float], None]) -> None:
    """Call a function with the time since its start, at 60 Hz for a while."""
    begin = time.perf_counter()
    for k in range(int(SECONDS * RATE)):
        time.sleep(max(0.0, begin + k / RATE - time.perf_counter()))
        act(time.perf_counter() - begin)
        if time.perf_counter() - begin > 1.5 * SECONDS:
            return


def _circle(studio: Studio, index: int, radius: float, kind: str = "waypoint") -> None:
    """Drag a handle in a circle [px]."""
    with studio.grabbing(studio.handle(kind, index)) as (x, y):
        mouse = studio.page.mouse
        _every_frame(
            lambda t: mouse.move(
                x - radius + radius * math.cos(4 * t), y + 0.7 * radius * math.sin(5 * t)
            )
        )


def _shake(studio: Studio, key: str) -> None:
    """Drag the thumb of a slider to and fro."""
    thumb = studio.slider(key).locator("input[type=range]")
    with studio.grabbing(thumb) as (x, y):
        mouse = studio.page.mouse
        _every_frame(lambda t: mouse.move(x + 30 * math.sin(4 * t), y))


def _frames(studio: Studio, act: Callable[[float], None]) -> list[float]:
    """Return the times between the page's frames while something is done [ms]."""
    studio.page.evaluate(
        """() => {
            const seen = [];
            const see = (now) => {
                seen.push(now);
                if (window.frames_seen === seen) requestAnimationFrame(see);
            };
            window.frames_seen = seen;
            requestAnimationFrame(see);
        }"""
    )
    _every_frame(act)
    times = studio.page.evaluate("() => window.frames_seen")
    return list(np.diff(times))


def _processes(browser: Browser) -> list[dict[str, Any]]:
    """List the processes of the browser."""
    session = browser.new_browser_cdp_session()
    processes: list[dict[str, Any]] = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return processes


def _process(browser: Browser) -> float:
    """Return the memory of a page's largest process [bytes]; Linux only."""
    sizes = [
        int(FilePath(f"/proc/{x['id']}/statm").read_text().split()[1])
        for x in _processes(browser)
        if x["type"] == "renderer"
    ]
    return float(max(sizes) * os.sysconf("SC_PAGE_SIZE"))


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure; answers 1 if a bar is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.studio_page", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=MEASURES, default=list(MEASURES))
    parser.add_argument(
        "--unpaced", action="store_true", help="draw without waiting for the clock of a screen"
    )
    options = parser.parse_args(arguments)
    table = Table("what", "found", "bar", "", "")
    figures = []
    with browsing(is_paced=not options.unpaced) as browser:
        for name in options.only:
            with tempfile.TemporaryDirectory() as folder:
                for x in MEASURES[name](browser, FilePath(folder)):
                    figures.append(x)
                    sign = "≥" if x.least else "≤"
                    bar = "" if x.bar is None else f"{sign} {x.bar:g} {x.unit}"
                    missed = "" if x.kept else "missed"
                    table.add_row(x.what, f"{x.value:.3g} {x.unit}", bar, missed, x.more)
    Console(width=130).print(table)
    print(f"Load of the machine: {os.getloadavg()[0]:.1f}.")
    return 0 if all(x.kept for x in figures) else 1


if __name__ == "__main__":
    sys.exit(main())
