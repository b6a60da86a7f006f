"""Random input for the Studio at 60 Hz, after which every step is undone.

Nothing may fail: no exception in page or server, no message in the console, no request to another
server. Server and page may grow by at most 50 MB. After every step is undone, the text must have
its original bytes, and the figures their original values.
"""

from __future__ import annotations

import random
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path as FilePath

from tools.studio_page import Server, Studio, browsing, serving, write_job

from soak import Outcome

# Rate of actions [Hz].
RATE = 60.0
# How much the memory of server and page may grow, each [bytes].
GROWTH = 50e6
SECONDS = 300.0
# The share of the time after which memory is measured first: by then all is loaded.
WARM = 0.2
# In a shorter run not everything is loaded, so memory is reported but not judged [s].
LONG = 40.0
HANDLES = ("g.handle.waypoint", "g.handle.corner", "g.handle.middle", "g.place .handle")
BUTTONS = "#viewbar button, #tabs [role=tab], #playback button, #undo, #redo"
KEYS = (
    *("ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "Shift+ArrowUp", "Alt+ArrowLeft"),
    *("Tab", "Shift+Tab", "Escape", "Control+z", "Control+Shift+z", "Delete", "Insert", "Space"),
    *("e", "f", "m", "v", "d", "+", "-", "?", "[", "]", "{", "}", ".", "Home", "End"),
)
BOXES = """(all) => all.map((x) => {
    const box = x.getBoundingClientRect();
    return [box.x, box.y, box.width, box.height];
})"""
TEXTS = ("0.1 m/s", "3 mm", "0", "-1", "none", "", "1e400", "7 apples", "ⅷ", "80 mm/s", "2 rad/s^2")


class Monkey:
    """Does something random, one small step at a time."""

    def __init__(self, studio: Studio, seed: int) -> None:
        self.studio = studio
        self.random = random.Random(seed)
        self.done = 0
        self._plays: tuple[tuple[int, Callable[[], Iterator[None]]], ...] = (
            (8, self._drag),
            (4, self._slide),
            (3, self._press_keys),
            (2, self._zoom),
            (2, self._click),
            (2, self._type),
            (1, self._choose),
            (1, self._hover),
        )

    def run(self, seconds: float) -> None:
        """Run for a time, at 60 Hz if the machine is fast enough."""
        begin = time.perf_counter()
        steps = self._steps()
        while (now := time.perf_counter() - begin) < seconds:
            next(steps)
            self.done += 1
            # If it is late, it continues at once, but does not catch up.
            time.sleep(max(0.0, 1 / RATE - (time.perf_counter() - begin - now)))
        self.studio.page.mouse.up()

    def _steps(self) -> Iterator[None]:
        weights = [weight for weight, _ in self._plays]
        while True:
            _, play = self.random.choices(self._plays, weights)[0]
            yield from play()
            self._leave_dialog()

    def _leave_dialog(self) -> None:
        if self.studio.page.locator("dialog[open]").count():
            self.studio.page.keyboard.press("Escape")

    def _one(self, selector: str) -> tuple[float, float] | None:
        """Return the middle of one of the visible elements [px]."""
        # All boxes are read at once, because a handle may disappear at any moment.
        centers = [
            (x + wide / 2, y + high / 2)
            for x, y, wide, high in self.studio.page.locator(selector).evaluate_all(BOXES)
            if wide and 0 < y < 900
        ]
        return self.random.choice(centers) if centers else None

    def _drag(self) -> Iterator[None]:
        """Drag a handle, or the ground; sometimes it is let go by Escape."""
        mouse = self.studio.page.mouse
        to = self._one(self.random.choice(HANDLES))
        x, y = to or (self.random.uniform(50, 1000), self.random.uniform(150, 550))
        mouse.move(x, y)
        mouse.down()
        for _ in range(self.random.randrange(3, 40)):
            x += self.random.gauss(0, 12)
            y += self.random.gauss(0, 12)
            mouse.move(x, y)
            yield
        if self.random.random() < 0.15:
            self.studio.page.keyboard.press("Escape")
        mouse.up()
        yield

    def _slide(self) -> Iterator[None]:
        mouse = self.studio.page.mouse
        slider = self._one("#panel input[type=range], .scrub")
        if slider is None:
            return
        mouse.move(*slider)
        mouse.down()
        for _ in range(self.random.randrange(3, 25)):
            mouse.move(slider[0] + self.random.uniform(-140, 140), slider[1])
            yield
        mouse.up()

    def _press_keys(self) -> Iterator[None]:
        for _ in range(self.random.randrange(1, 12)):
            self.studio.page.keyboard.press(self.random.choice(KEYS))
            yield

    def _zoom(self) -> Iterator[None]:
        self.studio.page.mouse.move(self.random.uniform(50, 1000), self.random.uniform(150, 550))
        for _ in range(self.random.randrange(2, 15)):
            self.studio.page.mouse.wheel(0, self.random.uniform(-200, 200))
            yield
        self.studio.page.keyboard.press("f")

    def _click(self) -> Iterator[None]:
        button = self._one(BUTTONS)
        if button is not None:
            self.studio.page.mouse.click(*button)
        yield

    def _type(self) -> Iterator[None]:
        entry = self._one("#panel input[type=text], #tab-waypoints input")
        if entry is not None:
            self.studio.page.mouse.click(*entry, click_count=3)
            yield
            self.studio.page.keyboard.insert_text(self.random.choice(TEXTS))
            self.studio.page.keyboard.press("Enter")
        yield

    def _choose(self) -> Iterator[None]:
        """Choose another run, or another value of a list."""
        page = self.studio.page
        lists = page.locator("#run, #panel select:visible, #playback select")
        if count := lists.count():
            chosen = lists.nth(self.random.randrange(count))
            if options := chosen.locator("option:not([disabled])").count():
                chosen.select_option(index=self.random.randrange(options), timeout=2000)
        yield

    def _hover(self) -> Iterator[None]:
        for _ in range(self.random.randrange(5, 30)):
            self.studio.page.mouse.move(self.random.uniform(0, 1400), self.random.uniform(0, 900))
            yield


def undo_all(studio: Studio) -> int:
    """Undo until nothing is left; returns the number of steps."""
    steps = 0
    studio.page.keyboard.press("Escape")
    # Text that was typed but not applied is not a step of undo.
    studio.page.evaluate("() => [...document.querySelectorAll('#tab-text button')].at(-1).click()")
    while not studio.find("#undo").is_disabled():
        with studio.renewing():
            studio.find("#undo").click()
        steps += 1
    return steps


def let_loose(studio: Studio, seconds: float, seed: int) -> list[str]:
    """Let a monkey at a page that shows the run `optimal`; returns what went wrong."""
    text = studio.text
    figures = [studio.figure(x) for x in ("duration", "contour_error.rms")]
    monkey = Monkey(studio, seed)
    server = studio.server
    monkey.run(WARM * seconds)
    warm = server.memory, studio.memory
    monkey.run((1 - WARM) * seconds)
    grown = server.memory - warm[0], studio.memory - warm[1]
    steps = undo_all(studio)
    same = studio.text == text
    studio.choose_run("optimal")
    studio.wait("#view2d", run="optimal")
    studio.rest()
    again = [studio.figure(x) for x in ("duration", "contour_error.rms")]
    print(
        f"seed {seed}: {monkey.done} inputs in {seconds:g} s, {steps} steps undone; "
        f"the server grew by {grown[0] / 1e6:.1f} MB, the page by {grown[1] / 1e6:.1f} MB"
    )
    return [
        *studio.troubles,
        *(() if same else ("The text is not what it was.",)),
        *(() if again == figures else (f"Figures {figures} became {again}.",)),
        *(
            f"{name} grew by {x / 1e6:.0f} MB."
            for name, x in zip(("The server", "The page"), grown, strict=True)
            if x > GROWTH and seconds >= LONG
        ),
    ]


def run(seed: int) -> Outcome:
    """Let random actions of a user loose on the Studio for some minutes."""
    with tempfile.TemporaryDirectory() as name, browsing() as browser:
        folder = FilePath(name)
        job = write_job(folder / "job.yaml", "conventional", "proposed", "optimal")
        with serving(job, folder=folder) as server:
            notes = let_loose(begin(browser, server), SECONDS, seed)
    return Outcome(result="undone", notes=notes)


def begin(browser: object, server: Server) -> Studio:
    """Open a page that shows the run `optimal`, at rest."""
    studio = Studio(browser, server)  # type: ignore[arg-type]
    studio.begin()
    studio.choose_run("optimal")
    studio.wait("#view2d", run="optimal")
    studio.rest()
    return studio
