"""Pictures of the Studio, made by driving it: `python -m docs.figures.studio`; needs a Chromium."""

from __future__ import annotations

import shutil
import sys
import tempfile
from pathlib import Path

from soak.studio_page import Studio, browsing, serving

FOLDER = Path(__file__).parent
GASKET = FOLDER.parents[1] / "examples" / "drawings" / "gasket.dxf"
SIZE = (1280, 820)


def save(studio: Studio, name: str) -> None:
    """Save what the page shows."""
    studio.page.wait_for_timeout(800)
    file = FOLDER / f"studio_{name}.png"
    studio.page.screenshot(path=file)
    print(file.name, f"{file.stat().st_size / 1e3:.0f} kB")


def demo(studio: Studio) -> None:
    """The paper's job: what is seen, and a waypoint out of reach."""
    studio.choose_run("optimal")
    studio.wait("#view2d", run="optimal")
    studio.rest()
    save(studio, "demo")
    # Farther than the arm reaches.
    with studio.grabbing(studio.handle("waypoint", 1)) as (x, y):
        studio.page.mouse.move(x + 230, y - 20, steps=12)
        studio.wait("body", refused="true")
        save(studio, "refused")
        studio.page.keyboard.press("Escape")
    studio.wait("body", refused="false")


def gasket(studio: Studio) -> None:
    """A gasket on the UR5e: placed by the map, and seen in space."""
    studio.rest()
    studio.do("place", {"x": "120", "y": "120", "steps": "5"})
    studio.wait_for(".task-result[data-task=place][data-state=done]", timeout=300_000)
    studio.find("#viewbar").get_by_role("button", name="Both").click()
    studio.wait_for("#view3d[data-frames]")
    studio.find("#viewbar").get_by_role("button", name="Fit").click()
    save(studio, "gasket")


def main() -> int:
    """Make all pictures."""
    with browsing() as browser, tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copy(GASKET, folder)
        for act, arguments in ((demo, ()), (gasket, (GASKET.name, "--cell", "ur5e"))):
            with serving(*arguments, folder=folder) as server:
                studio = Studio(browser, server, size=SIZE)
                studio.begin()
                act(studio)
                studio.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
