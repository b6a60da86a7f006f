"""Pictures of the tutorials: what their reports show, after doing them.

`python -m docs.figures.tutorials [PAGE ...]` makes those of some pages, or all; needs a Chromium.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from docs.pages import ROOT, read_page
from PIL import Image
from playwright.sync_api import Browser
from soak.studio_page import browsing

FOLDER = Path(__file__).parent
WIDTH, HEIGHT = 1000, 1200  # of the window [pixels]
DRAWN = 2000.0  # time in which plots draw themselves [ms]
COLOURS = 64  # of a picture; reports have few


@dataclass(frozen=True)
class Picture:
    """A part of a report.

    Args:
        name: Name of the file, without its ending.
        report: The report, in the folder in which the page was done.
        part: What is shown, as a selector.
    """

    name: str
    report: str
    part: str


# The first plot of a report, or of a section.
PLOT = ".js-plotly-plot"
PICTURES = {
    "start/first_result": [
        Picture("tutorial_first", "bracket/report.html", "#overview"),
        Picture("tutorial_binds", "bracket/report.html", "#bindings"),
    ],
    "tutorials/dxf_to_ur5e": [Picture("tutorial_program", "first/report.html", f"#program {PLOT}")],
    "tutorials/own_arm": [Picture("tutorial_seam", "seam/report.html", f"#paths {PLOT} >> nth=1")],
    "tutorials/true_on_a_robot": [
        Picture("tutorial_identified", "identified/report.html", PLOT),
        Picture("tutorial_learned", "third/report.html", PLOT),
    ],
    "tutorials/placement_and_clearance": [
        Picture("tutorial_map", "placed/report.html", PLOT),
        Picture("tutorial_clearance", "there/report.html", f"#clearance {PLOT}"),
    ],
    "tutorials/batch_on_a_cluster": [Picture("tutorial_batch", "bends/report.html", PLOT)],
}


@contextmanager
def done(page: str) -> Iterator[Path]:
    """A folder in which a page was done, as long as the block lasts."""
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as name:
        os.chdir(name)
        try:
            for _ in read_page(ROOT / "docs" / f"{page}.md"):
                pass
            yield Path(name)
        finally:
            os.chdir(before)


def save(browser: Browser, folder: Path, picture: Picture) -> None:
    """Save a part of a report as a small PNG."""
    page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
    page.goto((folder / picture.report).as_uri())
    part = page.locator(picture.part).first
    part.scroll_into_view_if_needed()
    page.wait_for_timeout(DRAWN)
    file = FOLDER / f"{picture.name}.png"
    part.screenshot(path=file)
    page.close()
    with Image.open(file) as image:
        image.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
    print(file.name, f"{file.stat().st_size / 1e3:.0f} kB")


def main(names: list[str]) -> int:
    """Make the pictures of the named pages, or all; returns an exit code."""
    with browsing() as browser:
        for page in names or PICTURES:
            with done(page) as folder:
                for picture in PICTURES[page]:
                    save(browser, folder, picture)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
