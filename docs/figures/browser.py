"""Pictures of the Studio and of reports, by a browser: `python -m docs.figures.browser [PAGE ...]`.

Pages are "studio" and those of `REPORTS`, which are done as a reader does them. Needs a Chromium.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import sys
import tempfile
from pathlib import Path

from docs.pages import ROOT, read_page
from PIL import Image
from playwright.sync_api import Browser
from tools.studio_page import Studio, browsing, serving

FOLDER = Path(__file__).parent
BRACKET = ROOT / "examples" / "drawings" / "bracket.step"
GASKET = ROOT / "examples" / "drawings" / "gasket.dxf"
CELLS = ROOT / "src" / "armcontour" / "files" / "cells"
# Cells in which the servos of the simulated robot have gains that differ by 1 % from the assumed
# ones, up and down from joint to joint; numbers of joints by cell.
JOINTS = {"ur5e": 6, "ur10e_positioner": 9}
KP, KV = 25.0, 150.0  # assumed gains of these cells [1/s]
DRAWN = 2000.0  # time in which plots draw themselves [ms]
FRAMES = 40  # of the moving picture
LONGEST_FRAME = 250  # [ms], so that a slow motion is shown faster
SMALLER = (1080, 675)  # size of the moving picture [px]
COLOURS = 64  # of a picture of a report, which has few
# The first plot of a report, or of a section.
PLOT = ".plotted"
# The report and its part, as a selector, of each picture of a page.
REPORTS = {
    "start/first_result": {
        "tutorial_first": ("bracket/report.html", ".front"),
        "tutorial_binds": ("bracket/report.html", f"#time {PLOT}"),
    },
    "tutorials/own_arm": {"tutorial_seam": ("seam/report.html", "#paths .drawn")},
    "tutorials/true_on_a_robot": {
        "tutorial_identified": ("identified/report.html", ".front"),
        "tutorial_learned": ("third/report.html", ".front"),
    },
}


def save(name: str, picture: bytes, *, colours: int = 256) -> None:
    """Write a small PNG."""
    file = FOLDER / f"{name}.png"
    with Image.open(io.BytesIO(picture)) as image:
        small = image.convert("RGB").quantize(colours, dither=Image.Dither.NONE)
        small.save(file, optimize=True)
    print(file.name, f"{file.stat().st_size / 1e3:.0f} kB")


def show_reports(browser: Browser, page: str, folder: Path) -> None:
    """Save the pictures of a page whose commands were run in a folder."""
    with contextlib.chdir(folder):
        for _ in read_page(ROOT / "docs" / f"{page}.md"):
            pass
    for name, (report, selector) in REPORTS[page].items():
        view = browser.new_page(viewport={"width": 1000, "height": 1200})
        view.goto((folder / report).as_uri())
        # Figures are drawn when their section is open.
        view.evaluate("() => document.querySelectorAll('details').forEach((x) => (x.open = true))")
        part = view.locator(selector).first
        part.scroll_into_view_if_needed()
        view.wait_for_timeout(DRAWN)
        save(name, part.screenshot(), colours=COLOURS)
        view.close()


def show_demo(studio: Studio) -> None:
    """Show the paper's job, and a waypoint out of reach."""
    studio.choose_run("optimal")
    studio.wait("#view2d", run="optimal")
    studio.rest()
    save("studio_demo", studio.page.screenshot())
    # The edge of the drawing is out of reach, once it shows more than the path.
    for _ in range(2):
        studio.find("#viewbar").get_by_role("button", name="−").click()
    with studio.grabbing(studio.handle("waypoint", 1)) as (_, y):
        box = studio.find("#view2d").bounding_box()
        assert box is not None
        studio.page.mouse.move(box["x"] + box["width"] - 20, y - 20, steps=12)
        studio.wait("body", refused="true")
        studio.page.wait_for_timeout(DRAWN)
        save("studio_refused", studio.page.screenshot())
        studio.page.keyboard.press("Escape")
    studio.wait("body", refused="false")


def show_start(studio: Studio) -> None:
    """Show the start page."""
    studio.wait_for("#start[open]")
    studio.page.wait_for_timeout(DRAWN)
    save("studio_start", studio.find("#start").screenshot())


def show_gasket(studio: Studio) -> None:
    """Show a gasket on the UR5e in space."""
    studio.rest()
    studio.wait_for("#view3d[data-frames]")
    studio.page.wait_for_timeout(DRAWN)
    save("studio_gasket", studio.page.screenshot())
    save_moving("studio_moving", studio)


def go_to(studio: Studio, share: float) -> None:
    """Show a time, as a share of the motion's duration."""
    slider = studio.find("#playback .scrub")
    box = slider.bounding_box()
    assert box is not None
    slider.click(position={"x": box["width"] * share, "y": box["height"] / 2})
    slider.blur()


def save_moving(name: str, studio: Studio) -> None:
    """Write a moving picture of the whole motion."""
    pictures = []
    duration = float(studio.find("#playback .scrub").get_attribute("aria-valuemax") or 0)
    for k in range(FRAMES):
        go_to(studio, k / FRAMES)
        studio.page.wait_for_timeout(DRAWN / 2)
        pictures.append(Image.open(io.BytesIO(studio.page.screenshot())).resize(SMALLER))
    file = FOLDER / f"{name}.webp"
    each = min(int(1e3 * duration / FRAMES), LONGEST_FRAME)
    more = {"save_all": True, "append_images": pictures[1:], "duration": each, "loop": 0}
    pictures[0].save(file, quality=50, method=6, **more)
    print(file.name, f"{file.stat().st_size / 1e3:.0f} kB")


def show_edges(studio: Studio) -> None:
    """Show the edges of a model, with the seam around the foot of a tube."""
    studio.wait(".edge-box", state="ready")
    box = studio.find(".edge-box")
    # The last edges are the seams inside and outside of the tube.
    for _ in range(2):
        box.get_by_role("button", name="Edge before").click()
    with studio.changing():
        box.get_by_role("button", name="Add").click()
    # The tool is at the other side, so that it does not hide the arrows.
    go_to(studio, 0.4)
    studio.find("#view3d [data-view=Part]").click()
    studio.page.wait_for_timeout(DRAWN)
    save("studio_edges", studio.page.screenshot())
    studio.find("#view3d [data-view=Cell]").click()
    save_moving("studio_weld", studio)


def show_studio(browser: Browser, folder: Path) -> None:
    """Save the pictures of the Studio."""
    paper = ROOT / "src" / "armcontour" / "jobs" / "library" / "paper.yaml"
    # Nothing was opened before.
    os.environ["XDG_STATE_HOME"] = str(folder / "state")
    for file in (GASKET, BRACKET, paper):
        shutil.copy(file, folder)
    for cell, count in JOINTS.items():
        off = [0.01 * (-1) ** k for k in range(count)]
        plant = {"kp": [KP * (1 + x) for x in off], "kv": [KV * (1 - x) for x in off]}
        text = (CELLS / f"{cell}.yaml").read_text(encoding="utf-8")
        (folder / f"{cell}.yaml").write_text(f"{text}\nplant: {plant}\n", encoding="utf-8")
    for show, arguments in (
        (show_start, ()),
        (show_demo, (paper.name,)),
        (show_gasket, (GASKET.name, "--cell", "ur5e.yaml")),
        (show_edges, (BRACKET.name, "--cell", "ur10e_positioner.yaml")),
    ):
        with serving(*arguments, folder=folder) as server:
            studio = Studio(browser, server, size=(1440, 900))
            studio.begin()
            show(studio)
            studio.close()


if __name__ == "__main__":
    with browsing() as browser:
        for page in sys.argv[1:] or ["studio", *REPORTS]:
            with tempfile.TemporaryDirectory() as name:
                if page == "studio":
                    show_studio(browser, Path(name))
                else:
                    show_reports(browser, page, Path(name))
