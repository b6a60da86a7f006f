"""The Studio in a real browser: its server as a process, its page, and actions of a user.

Used by the tests, the soak, the benchmark and the pictures of the documentation. The page reports
its state in attributes, because its content security policy forbids `eval`.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

# Names of browsers to search for; ARMCONTOUR_CHROMIUM overrides them.
NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
# Timeout of the page [ms], on a shared machine.
PATIENCE = 60_000
# Waits until a page has drawn two frames.
TWO_FRAMES = "() => new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))"
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/#[0-9a-f]{32}")
# A square on a UR5e, whose joint torques are limits; its only run is `optimal`.
SQUARE = """
name: square
arm: {name: ur5e, work: {position: [0.4, -0.05, 0.2]}}
path:
  points: [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0], [0, 0, 0]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 0.25}
corners: {tolerance: 1 mm}
servo: {kp: 25, kv: 150}
cycle: 4 ms
runs: {optimal: {}}
"""


def find_browser() -> str | None:
    """Find the browser for tests; return its path, or None."""
    named = os.environ.get("ARMCONTOUR_CHROMIUM")
    return named or next(filter(None, map(shutil.which, NAMES)), None)


class Server:
    """`armcontour studio` as a process.

    Args:
        *arguments: Its arguments.
        folder: Its current folder.
    """

    def __init__(self, *arguments: str | FilePath, folder: FilePath | None = None) -> None:
        command = [sys.executable, "-m", "armcontour", "studio", "--no-open", *map(str, arguments)]
        self.begin = time.perf_counter()
        self.process = subprocess.Popen(
            command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        match = ADDRESS.search(self.process.stdout.readline())
        if match is None:
            raise RuntimeError(f"The Studio did not start: {self.stop()}")
        self.address = match[0]
        self.port = int(self.address.split(":")[2].split("/")[0])

    def stop(self) -> str:
        """End the process as Ctrl+C does; returns its error output."""
        # A process started in the background, as by `make test &`, ignores the signal of Ctrl+C.
        self.process.terminate()
        try:
            return self.process.communicate(timeout=20)[1]
        except subprocess.TimeoutExpired:
            self.process.kill()
            errors = self.process.communicate()[1]
            raise AssertionError(f"The server did not end at SIGTERM.\n{errors}") from None

    @property
    def memory(self) -> float:
        """Memory of the server process [bytes]; Linux only."""
        fields = FilePath(f"/proc/{self.process.pid}/statm").read_text().split()
        return int(fields[1]) * os.sysconf("SC_PAGE_SIZE")


@contextmanager
def serving(*arguments: str | FilePath, folder: FilePath | None = None) -> Iterator[Server]:
    """Return a context with a server, which must report no error.

    Raises:
        AssertionError: It wrote a traceback, or did not end within 20 s.
    """
    server = Server(*arguments, folder=folder)
    try:
        yield server
    finally:
        errors = server.stop() if server.process.poll() is None else server.process.communicate()[1]
    assert "Traceback" not in errors, errors


@contextmanager
def browsing(*, is_paced: bool = True) -> Iterator[Browser]:
    """Return a context with a browser.

    `is_paced`: whether pictures wait for the clock of a screen (60 Hz).
    """
    from playwright.sync_api import sync_playwright

    # Chromium has no sandbox for root.
    options = ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    if not is_paced:
        options += ["--disable-frame-rate-limit", "--disable-gpu-vsync"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=find_browser(), args=[*options, "--enable-precise-memory-info"]
        )
        try:
            yield browser
        finally:
            browser.close()


class Studio:
    """A page of the Studio; records errors of the console and requests to other hosts.

    Args:
        browser: The browser.
        server: The server, or an address.
        colours: "light" or "dark".
        size: Width and height of the page [px].
    """

    def __init__(
        self,
        browser: Browser,
        server: Server,
        *,
        colours: str = "light",
        size: tuple[int, int] = (1400, 900),
    ) -> None:
        context = browser.new_context(
            viewport={"width": size[0], "height": size[1]},
            color_scheme=colours,  # type: ignore[arg-type]
            accept_downloads=True,
        )
        context.set_default_timeout(PATIENCE)
        self.server = server
        self.troubles: list[str] = []
        # Set by tests that stop the server, after which the console reports errors.
        self.is_cut_off = False
        self.page: Page = context.new_page()
        self.page.on("console", self._hear)
        self.page.on("pageerror", lambda error: self.troubles.append(f"exception: {error}"))
        self.page.on("request", self._watch)
        self.page.goto(server.address)

    def _hear(self, message: Any) -> None:
        """Record errors, including violations of the content security policy."""
        if message.type == "error" and not self.is_cut_off:
            self.troubles.append(f"console: {message.text}")

    def _watch(self, request: Any) -> None:
        allowed = (f"http://127.0.0.1:{self.server.port}/", "data:", "blob:")
        if not request.url.startswith(allowed):
            self.troubles.append(f"foreign request: {request.url}")

    def close(self) -> None:
        """Close the page."""
        self.page.context.close()

    # Contents of the page.

    def find(self, selector: str) -> Locator:
        """Find the element of a selector."""
        return self.page.locator(selector)

    def told(self, selector: str, name: str) -> str:
        """Return an element's attribute `data-...`."""
        return self.find(selector).get_attribute(f"data-{name}") or ""

    def wait(self, selector: str, **facts: str) -> None:
        """Wait until attributes `data-...` of an element have values."""
        names = {name.replace("_", "-"): value for name, value in facts.items()}
        self.wait_for(selector + "".join(f'[data-{k}="{v}"]' for k, v in names.items()))

    def wait_for(self, selector: str, timeout: float = PATIENCE) -> None:
        """Wait until an element exists, visible or not.

        Unlike `expect`, this checks in every frame of the page.
        """
        self.page.wait_for_selector(selector, state="attached", timeout=timeout)

    def begin(self) -> None:
        """Wait for the first document and all regions of the page."""
        self.wait_for("body[data-link=open][data-rev][data-regions=all]")

    def rest(self) -> None:
        """Wait until the displayed results are exact, as those of `armcontour run`.

        Raises:
            AssertionError: It does not come to rest; says in what state the page is.
        """
        from playwright.sync_api import TimeoutError as LateError

        self.begin()
        try:
            # Keys that were pressed before may still change the document, and a view may be drawn
            # one frame before the figures.
            is_at_rest = False
            while not is_at_rest:
                rev = self.told("body", "rev")
                exact = (
                    f'body[data-busy=false][data-rev="{rev}"]:has(#figures[data-exact=true])'
                    f':has(#view2d[data-rev="{rev}"][data-stale=false])'
                )
                self.wait_for(f'body:not([data-rev="{rev}"]), {exact}')
                self.page.evaluate(TWO_FRAMES)
                is_at_rest = self.find(exact).count() == 1
        except LateError as error:
            selectors = ("body", "#view2d", "#figures")
            state = [self.find(x).evaluate("e => JSON.stringify(e.dataset)") for x in selectors]
            raise AssertionError(
                f"The page is not up to date: {state}, {self.refusal!r}"
            ) from error

    @contextmanager
    def renewing(self) -> Iterator[None]:
        """Return a context that waits until the document has changed."""
        before = self.told("body", "rev")
        yield
        self.wait_for(f'body:not([data-rev="{before}"])')

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Return a context that waits until the document has changed and its results are exact."""
        with self.renewing():
            yield
        self.rest()

    def figure(self, name: str) -> float:
        """Return a figure in SI units, not rounded."""
        return float(self.told(f"[data-figure='{name}']", "value"))

    @property
    def text(self) -> str:
        """Text of the job file in the page."""
        return self.find("#tab-text textarea").input_value()

    @property
    def refusal(self) -> str:
        """Sentence of the displayed refusal."""
        return self.find("#messages .refusal > span").first.inner_text()

    @property
    def memory(self) -> float:
        """Return the memory of the page's objects after garbage collection [bytes]."""
        session = self.page.context.new_cdp_session(self.page)
        session.send("HeapProfiler.collectGarbage")
        used = session.send("Runtime.getHeapUsage")
        session.detach()
        # Typed arrays are stored outside the heap.
        return float(used["usedSize"] + used.get("backingStorageSize", 0))

    # Actions of a user.

    def open(self, file: FilePath, cell: str | None = None) -> None:
        """Open a file with the file picker; `cell` is chosen for drawings."""
        with self.renewing():
            self.find("#picker").set_input_files(file)
            dialog = self.find("#question")
            if cell is not None:
                dialog.locator("select").select_option(cell)
            if cell is not None or self.told("body", "dirty") == "true":
                dialog.get_by_role("button", name="Open").click()
        # Discard the draft, to open the file unchanged.
        if self.told("body", "draft"):
            dialog.get_by_role("button", name="Throw them away").click()
            self.wait("body", draft="")

    def tab(self, name: str) -> None:
        """Open a tab of the settings, or below the drawing; narrow settings are a drawer."""
        in_drawer = self.find(f"#panel #tab-button-{name}").count() > 0
        is_narrow = self.find("#panel-open").is_visible()
        if in_drawer and is_narrow and self.told("body", "drawer") != "open":
            self.find("#panel-open").click()
        if not in_drawer and is_narrow and self.told("body", "drawer") == "open":
            self.find("#panel-close").click()
        self.find(f"#tab-button-{name}").click()

    def select_contour(self, row: int) -> None:
        """Select the contour of a row of the list, which a click on a selected one would undo."""
        self.tab("contours")
        button = self.find("ol.contours button[aria-pressed]").nth(row)
        if button.get_attribute("aria-pressed") == "false":
            button.click()
        self.wait_for("ol.contours button[aria-pressed=true]")

    def choose_run(self, name: str) -> None:
        """Show another run."""
        self.find("#run").select_option(name)

    def handle(self, kind: str, index: int) -> Locator:
        """Handle on the drawing: "waypoint", "corner" or "middle"."""
        return self.find(f"g.handle.{kind}[data-index='{index}']")

    def middle(self, element: Locator) -> tuple[float, float]:
        """Return the centre of an element that has stopped moving [px]."""
        element.element_handle().wait_for_element_state("stable")
        box = element.bounding_box()
        assert box is not None
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    @contextmanager
    def grabbing(self, element: Locator) -> Iterator[tuple[float, float]]:
        """Return a context in which the mouse button is down on an element."""
        x, y = self.middle(element)
        mouse = self.page.mouse
        mouse.move(x, y)
        mouse.down()
        try:
            yield x, y
        finally:
            mouse.up()

    def drag(self, element: Locator, by: tuple[float, float], steps: int = 8) -> None:
        """Drag an element to the right and down [px]."""
        with self.grabbing(element) as (x, y):
            self.page.mouse.move(x + by[0], y + by[1], steps=steps)

    def slider(self, key: str) -> Locator:
        """Return the row of a quantity in the settings."""
        return self.find(f"#panel .setting[data-key='{key}']")

    def type(self, key: str, text: str) -> None:
        """Type a quantity."""
        field = self.slider(key).locator("input[type=text]")
        field.fill(text)
        field.press("Enter")

    def slide(self, key: str, fraction: float) -> None:
        """Drag the thumb of a slider to a fraction of its length."""
        box = self.slider(key).locator("input[type=range]").bounding_box()
        assert box is not None
        y = box["y"] + box["height"] / 2
        self.page.mouse.move(box["x"] + 0.5 * box["width"], y)
        self.page.mouse.down()
        self.page.mouse.move(box["x"] + fraction * box["width"], y, steps=8)
        self.page.mouse.up()

    def do(self, task: str, fields: Mapping[str, str] | None = None) -> Locator:
        """Start a task by its button; returns the element of its result."""
        self.tab("tasks")
        form = self.find(f"#tasks form[data-task={task}]")
        for name, value in (fields or {}).items():
            field = form.locator(f"[name={name}]")
            if field.evaluate("e => e.tagName") == "SELECT":
                field.select_option(value)
            else:
                field.fill(value)
        form.locator("button[type=submit]").click()
        return self.find(f".task-result[data-task={task}]").first

    def save_file(self, button: Locator) -> tuple[str, bytes]:
        """Press a button that saves a file; returns its name and content."""
        with self.page.expect_download() as waiting:
            button.click()
        return waiting.value.suggested_filename, FilePath(waiting.value.path()).read_bytes()


def write_shapes(file: FilePath, count: int, columns: int, pitch: float, radius: float) -> FilePath:
    """Write a drawing of circles, squares and ellipses in rows from left to right [mm]."""
    import ezdxf

    drawing = ezdxf.new()
    drawing.units = ezdxf.units.MM
    space = drawing.modelspace()
    r = radius
    for k in range(count):
        x = pitch * (k % columns)
        y = pitch * (k // columns)
        if k % 3 == 0:
            space.add_circle((x, y), r)
        elif k % 3 == 1:
            corners = [(x - r, y - r), (x + r, y - r), (x + r, y + r), (x - r, y + r)]
            space.add_lwpolyline(corners, close=True)
        else:
            space.add_ellipse((x, y), major_axis=(r, 0, 0), ratio=0.5)
    drawing.saveas(file)
    return file


def write_job(file: FilePath, *runs: str, changes: Sequence[tuple[str, str]] = ()) -> FilePath:
    """Write the paper's job with some of its runs, a cycle of 4 ms and no experiment.

    Args:
        file: Where it is written.
        *runs: Names of the remaining runs, in the order of the file.
        changes: Texts and their replacements.
    """
    from importlib.resources import files

    text = files("armcontour.jobs").joinpath("library", "paper.yaml").read_text(encoding="utf-8")
    head, _, runs_text = text.partition("\nruns:\n")
    blocks = re.split(r"(?m)^(?=  [\w-]+:)", runs_text)
    chosen = "".join(x for x in blocks if x.strip().partition(":")[0] in runs)
    text = f"{head}\nruns:\n{chosen}".replace("experiment: {}\n", "")
    for old, new in (("cycle: 0.2 ms", "cycle: 4 ms"), *changes):
        assert old in text, old
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")
    return file
