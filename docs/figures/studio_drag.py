"""The moving picture of the Studio's guide: a drag in the Studio, frame by frame. Needs a Chromium.

`python -m docs.figures.studio_drag` drives a real Studio: the mouse moves a step, the page answers,
and what it shows then is a frame. So every frame is true, but the pace is the picture's own;
`python -m benchmarks.studio_page` measures how fast the page is.
"""

from __future__ import annotations

import io
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from PIL import Image, ImageDraw
from soak.studio_page import Studio, browsing, serving

FILE = Path(__file__).with_name("studio_drag.gif")
JOB = """
name: seam
title: A seam on a UR5e
arm: {name: ur5e, tool: {position: [0, 0, 150 mm]}, work: {position: [0.42, -0.1, 0.1]}}
path:
  points: [[0, 0, 0], [0.14, 0, 0], [0.14, 0.12, 0], [0.04, 0.2, 0], [0, 0.12, 0]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 0.5 m/s, joint_acceleration: 6 rad/s^2}
corners: {tolerance: 2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
command_interval: 4 ms
runs: {optimal: {timing: {reserve: 0.05}, compensation: {method: pole_placement}}}
"""
SIZE = (1280, 700)
STEP, REST, LAST = 80, 900, 1500  # ms that a frame is shown
# Colours of surfaces, and of thin lines, which have few pixels.
SURFACES, LINES = 192, 64
# The mouse's arrow [px].
ARROW = ((0, 0), (0, 17), (4, 13), (7, 20), (10, 19), (7, 12), (12, 12))


class Recorder:
    """Frames of a page, with the mouse drawn into them.

    Args:
        studio: The page.
    """

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.at = (0.62 * SIZE[0], 0.9 * SIZE[1])
        self.frames: list[Image.Image] = []
        self.durations: list[int] = []

    def take(self, duration: int = STEP) -> None:
        """Take what is shown as a frame."""
        frame = Image.open(io.BytesIO(self.studio.page.screenshot())).convert("RGB")
        arrow = [(x + self.at[0], y + self.at[1]) for x, y in ARROW]
        ImageDraw.Draw(frame).polygon(arrow, fill="black", outline="white")
        self.frames.append(frame)
        self.durations.append(duration)

    def go(self, to: tuple[float, float], steps: int) -> None:
        """Move the mouse in steps, each of which is answered and then taken."""
        begin = self.at
        for k in range(1, steps + 1):
            share = 0.5 - 0.5 * math.cos(math.pi * k / steps)
            self.step(*(a + share * (b - a) for a, b in zip(begin, to, strict=True)))

    def step(self, x: float, y: float) -> None:
        """Move the mouse, wait for the answer, and take it."""
        self.at = (x, y)
        self.studio.page.mouse.move(x, y)
        self.wait()
        self.take()

    def wait(self) -> None:
        """Wait until what is drawn is of the newest edit."""
        self.studio.page.wait_for_timeout(60)
        rev = self.studio.told("body", "rev")
        self.studio.wait("#view2d", rev=rev, stale="false")
        self.studio.page.wait_for_timeout(120)

    def save(self, file: Path) -> None:
        """Write all frames, in one palette, so that equal pixels stay equal."""
        several = self.frames[:: max(1, len(self.frames) // 6)]
        sheet = Image.new("RGB", (SIZE[0], SIZE[1] * len(several)))
        for k, frame in enumerate(several):
            sheet.paste(frame, (0, k * SIZE[1]))
        palette = Image.new("P", (1, 1))
        palette.putpalette(
            _colours(sheet, SURFACES, Image.Quantize.MEDIANCUT)
            + _colours(sheet, LINES, Image.Quantize.MAXCOVERAGE)
        )
        frames = [x.quantize(palette=palette, dither=Image.Dither.NONE) for x in self.frames]
        frames[0].save(
            file, save_all=True, append_images=frames[1:], duration=self.durations, loop=0
        )


def _colours(image: Image.Image, count: int, method: Image.Quantize) -> list[int]:
    found = image.quantize(count, method, dither=Image.Dither.NONE).getpalette()
    assert found is not None
    return found[: 3 * count]


def drag(studio: Studio) -> Recorder:
    """A waypoint goes round, a corner's tolerance grows, and the arm moves along the path."""
    studio.find("#dock-toggle").click()
    studio.find("#viewbar").get_by_role("button", name="Both").click()
    studio.find("#viewbar").get_by_role("button", name="Fit").click()
    studio.rest()
    studio.page.wait_for_timeout(2000)
    # The arm's shapes are there now.
    studio.find("#view3d").get_by_role("button", name="fit").click()
    studio.page.wait_for_timeout(1000)
    found = Recorder(studio)
    found.take(REST)
    x, y = studio.middle(studio.handle("waypoint", 2))
    found.go((x, y), 8)
    studio.page.mouse.down()
    for dx, dy in loop(x, y, 34):
        found.step(dx, dy)
    studio.page.mouse.up()
    studio.rest()
    found.take(REST)
    x, y = studio.middle(studio.handle("corner", 2))
    found.go((x, y), 6)
    studio.page.mouse.down()
    found.go((x - 60, y + 40), 16)
    studio.page.mouse.up()
    studio.rest()
    found.take(REST)
    box = studio.find("#playback input.scrub").bounding_box()
    assert box is not None
    y = box["y"] + box["height"] / 2
    found.go((box["x"] + 8, y), 6)
    studio.page.mouse.down()
    found.go((box["x"] + box["width"] - 8, y), 30)
    studio.page.mouse.up()
    found.take(LAST)
    return found


def loop(x: float, y: float, steps: int) -> Iterator[tuple[float, float]]:
    """Places on a loop that begins and ends at a place [px]."""
    for k in range(1, steps + 1):
        turn = 2 * math.pi * k / steps
        yield x + 55 * math.sin(turn), y + 40 * (1 - math.cos(turn)) - 30 * math.sin(turn)


def main() -> int:
    """Make the picture."""
    with browsing() as browser, tempfile.TemporaryDirectory() as name:
        job = Path(name) / "seam.yaml"
        job.write_text(JOB, encoding="utf-8")
        with serving(job.name, folder=Path(name)) as server:
            studio = Studio(browser, server, size=SIZE)
            studio.begin()
            found = drag(studio)
            studio.close()
    found.save(FILE)
    print(FILE.name, f"{len(found.frames)} frames, {FILE.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
