"""Reports in a real browser: accessible, and no text truncated at any width."""

import dataclasses
import functools
import re
from contextlib import contextmanager
from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.browser.axe_faults import ALL, faults, load_axe
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.core.result import Data, Row
from armcontour.files import parse_job
from armcontour.files.job_file import read_cell
from armcontour.jobs import CertificateGoal
from armcontour.jobs.run_learning import LearnedRun, learn_logs, plan_run
from armcontour.report import (
    render_demo,
    render_learning,
    render_placement,
    render_report,
)
from armcontour.report.batch_report import BatchEntry, render_batch
from armcontour.report.identification import render_identification
from armcontour.report.origin import Origin

pytestmark = pytest.mark.browser
DRAWINGS = FilePath(__file__).parents[3] / "examples" / "drawings"
# Two parts of a drawing on the UR5e, before a table; two runs whose rapids differ.
PARTS = """
name: parts
title: Two parts on the UR5e
arm: {name: ur5e, work: {position: [0.4, -0.05, 0.2], rpy: [0, 0.2, 0.5]}}
path: {points: [[0, 0, 0], [0.02, 0, 0]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.25, centripetal_acceleration: 1}
corners: {tolerance: 0.5 mm}
servo: {kp: 25, kv: 150}
cycle: 4 ms
runs:
  set_points: {compensation: {method: inverse}}
  slower: {limits: {speed: 0.1}}
scene: {obstacles: [{type: halfspace, name: table, at: [0, 0, -0.1]}]}
"""


def parts():
    """A job of two contours, one of them with a corner."""
    bend = ac.Path.polyline([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0]]).pointing([0, 0, -1])
    line = ac.Path.polyline([[0.04, 0, 0], [0.05, 0.01, 0]]).pointing([0, 0, -1])
    contours = tuple(ac.Contour(path=x, name=n) for x, n in ((bend, "bend"), (line, "tick")))
    return dataclasses.replace(parse_job(PARTS), path=ac.Program(moves=contours))


def bend():
    return parse_job(CORNER_JOB)


def gasket():
    """Ten contours of a drawing on the UR5e, as in the README."""
    return read_cell("ur5e", DRAWINGS / "gasket.dxf")


def identified():
    """Six joints from two programs; the fourth joint does not move."""
    arm = ac.load_arm("ur5e")
    robot = ac.ServoPlant(arm, ac.ServoModel(kp=23.0, kv=150.0, dead_time=0.012))
    t = np.arange(0.0, 4.0, 4e-3)
    logs = []
    frequencies = np.arange(0.5, 20.0, 0.25)
    for program in (1, 2):
        random = np.random.default_rng(program)
        phases = random.uniform(0.0, 2 * np.pi, (6, len(frequencies)))
        u = np.cos(2 * np.pi * t[:, None, None] * frequencies + phases).sum(axis=2)
        u *= 5e-3 / np.abs(u).max()
        u[:, 3] = 0.0
        u += [0.0, -1.2, 1.4, -1.0, -1.5, 0.2]
        rest = ac.Trajectory(laws=(ac.dwell_law(u[0], t[-1]),), method="rest")
        set_points = ac.SetPoints(cycle=4e-3, q=u, trajectory=rest, method="shaking")
        execution = ac.simulate(set_points, robot)
        q = np.stack([np.interp(t, execution.t, x) for x in execution.q.T], axis=1)
        q += 1e-5 * random.standard_normal(q.shape)
        logs.append(ac.Log(t=t, command=u, measured=q, interpolation="linear"))
    return render_identification(ac.identify(logs))


def placed():
    grid = {"x": [-0.01, 0.01], "y": [-0.01, 1.0]}
    placement = ac.place(bend(), grid, processes=1)
    (plan,) = ac.run(placement.placed(), simulate=False).runs.values()
    return render_placement(placement, plan)


def learned():
    """Two runs on a simulated robot with other gains."""
    job = bend()
    plan = plan_run(job, None)
    robot = ac.ServoPlant(job.arm, job.servo.replace(kp=24.0))
    lesson = plan.set_points
    for _ in range(2):
        lesson = learn_logs(job, plan, [ac.simulate(lesson, robot)], set_points=lesson)
    return render_learning(LearnedRun(job=job, plan=plan, lesson=lesson))


def batched():
    words = {True: "kept", False: "NOT KEPT"}
    rows = []
    entries = []
    for k in range(1, 40):
        kept = k % 3 > 0
        speed = f"{10 * k} mm/s"
        shown = (
            Row("kept", kept, "verdict", "verdict"),
            Row("off_drawing", 1e-6 * k**2, "m", "off the drawing"),
            Row("duration", 40 / k, "s", "motion"),
        )
        rows.append((str(k), speed, words[kept], f"{40 / k:.3g} s", ""))
        entries.append(BatchEntry(name=str(k), values=f"speed {speed}", data=Data("", shown)))
    error = "The path is out of reach. " * 4
    rows.append(("40", "0.4 m/s", "refused", "-", error))
    entries.append(BatchEntry(name="40", values="speed 0.4 m/s", data=Data(""), error=error))
    header = ("job", "limits.speed", "verdict", "motion", "")
    return render_batch("Batch", "40 jobs", header, rows, entries, Origin(job="gasket.dxf"))


def certified():
    certificate = ac.certify(gasket(), goal=CertificateGoal(servo_error=0.02e-3))
    return render_report(certificate.job_result, certificate=certificate)


PAGES = {
    "run": lambda: render_report(ac.run(gasket())),
    "runs": lambda: render_report(ac.run(parts())),
    "certify": certified,
    "identify": identified,
    "learn": learned,
    "place": placed,
    "batch": batched,
    "two jobs": lambda: render_demo([ac.run(bend()), ac.run(parts())]),
}


@functools.cache
def text_of(name):
    return PAGES[name]()


# Elements outside their page or figure, except inside a box that scrolls.
CUT_OFF = """() => {
  const found = [], wide = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth > wide) found.push("the page");
  const words = ".drawing text, .map text, main p, dd, li, figcaption, b, summary span";
  for (const text of document.querySelectorAll(words)) {
    if (text.closest(".wide") || !text.checkVisibility()) continue;
    const own = text.getBoundingClientRect();
    const box = text.closest("section, details")?.getBoundingClientRect();
    if (!box || !own.width) continue;
    if (own.left < box.left - 1 || own.right > box.right + 1
        || own.top < box.top - 1 || own.bottom > box.bottom + 1) found.push(text.textContent);
  }
  for (const box of document.querySelectorAll(".scroll")) {
    if (!box.checkVisibility()) continue;
    const goesOn = box.scrollWidth > box.clientWidth + 1 || box.scrollHeight > box.clientHeight + 1;
    const hinted = box.nextElementSibling.getBoundingClientRect().height > 0;
    if (goesOn !== hinted || goesOn !== (box.tabIndex === 0)) found.push(box.textContent);
  }
  return found;
}"""
DRAWN = "body[data-drawn]"


@contextmanager
def opened(browser, text, folder, width, **options):
    """A page whose visible figures are drawn; fails if it reports an error or loads a file."""
    file = folder / "report.html"
    file.write_text(text, encoding="utf-8")
    page = browser.new_page(viewport={"width": width, "height": 900}, **options)
    errors = []
    page.on("pageerror", lambda x: errors.append(str(x)))
    page.on("console", lambda x: errors.append(x.text) if x.type == "error" else None)
    page.on(
        # Packed data of the page are read as a blob.
        "request",
        lambda x: x.url.startswith((file.as_uri(), "blob:")) or errors.append(x.url),
    )
    page.goto(file.as_uri())
    if options.get("java_script_enabled", True):
        page.wait_for_selector(DRAWN, state="attached", timeout=120_000)
    yield page
    assert not errors, errors
    page.close()


def open_all(page):
    """Open every section, and wait until its figures are drawn."""
    page.evaluate("() => document.querySelectorAll('details').forEach((x) => { x.open = true; })")
    page.wait_for_function(
        "() => [...document.querySelectorAll('.plots')].every("
        "(x) => !x.checkVisibility() || x.querySelector('canvas'))",
        timeout=120_000,
    )
    page.wait_for_selector(DRAWN, state="attached", timeout=120_000)


@pytest.mark.parametrize("name", PAGES)
def test_a_report_is_accessible_and_no_text_is_truncated(browser, tmp_path, name):
    page_faults = []
    for width, colours in ((1400, "light"), (900, "dark"), (500, "light")):
        with opened(browser, text_of(name), tmp_path, width, color_scheme=colours) as page:
            for state in ("closed", "opened"):
                if state == "opened":
                    open_all(page)
                cut = page.evaluate(CUT_OFF)
                page_faults += [f"{width} {state}: cut off: {x}" for x in cut]
            load_axe(page)
            page_faults += [f"{width}: {x}" for x in faults(page, impacts=ALL)]
    assert not page_faults, "\n".join(page_faults)


# Sections whose contents paper does not have, and figures that are not drawn or wider than paper.
NOT_PRINTED = """() => {
  const found = [];
  const paper = document.body.getBoundingClientRect().right + 1;
  for (const x of document.querySelectorAll("details")) {
    const inside = [...x.children].find((y) => y.tagName !== "SUMMARY");
    if (inside && !inside.checkVisibility({ contentVisibilityAuto: true })) found.push(x.id);
  }
  const all = (selector) => [...document.querySelectorAll(selector)];
  found.push(...all(".plots").filter((x) => !x.querySelector("canvas")).map((x) => x.id));
  found.push(...all("table").filter((x) => !x.checkVisibility()).map((x) => x.textContent));
  found.push(...all(".still").filter((x) => !x.checkVisibility()).map(() => "no arm"));
  found.push(...all(".space, .player").filter((x) => x.checkVisibility()).map(() => "3-D"));
  // Paper has no mouse, and a line in each legend.
  const hints = /double-click|drag a rectangle|or press Improve/gi;
  found.push(...(document.body.innerText.match(hints) ?? []));
  for (const x of all(".keys .swatch"))
    if (!parseFloat(getComputedStyle(x).borderTopWidth)) found.push(`swatch: ${x.outerHTML}`);
  for (const x of document.querySelectorAll(".plots canvas, table, svg"))
    if (x.getBoundingClientRect().right > paper) found.push(`wide: ${x.outerHTML.slice(0, 80)}`);
  return found;
}"""


@pytest.mark.parametrize("name", PAGES)
def test_a_report_is_printed_whole(browser, tmp_path, name):
    with opened(browser, text_of(name), tmp_path, 1400) as page:
        was_open = page.locator("details[open]").count()
        page.evaluate("() => { window.dispatchEvent(new Event('beforeprint')); }")
        page.emulate_media(media="print")
        page.set_viewport_size({"width": 718, "height": 1000})
        assert page.evaluate(NOT_PRINTED) == []
        # The first page begins with the verdict or the first figure below the title.
        first = page.locator(".front").first.bounding_box()
        assert first["y"] < 250
        page.emulate_media(media="screen")
        page.evaluate("() => { window.dispatchEvent(new Event('afterprint')); }")
        assert page.locator("details[open]").count() == was_open
        assert page.locator("body.paper").count() == 0
        assert len(page.pdf(format="A4")) > 10_000


def test_a_point_of_a_batch_opens_its_run(browser, tmp_path):
    with opened(browser, text_of("batch"), tmp_path, 1400) as page:
        section = page.locator("#job-2")
        assert section.get_attribute("open") is None
        page.locator(".scatter a[href='#job-2']").click()
        assert section.get_attribute("open") is not None
        assert section.locator("table").first.is_visible()
        red = page.locator("td.not-kept").first
        assert red.inner_text() == "NOT KEPT"
        colour, grey = (
            x.evaluate("e => getComputedStyle(e).color") for x in (red, page.locator("td").nth(1))
        )
        assert colour != grey


def test_figures_and_drawings_react_to_the_pointer(browser, tmp_path):
    with opened(browser, text_of("run"), tmp_path, 1400) as page:
        # An important value leads to its place, which is enlarged.
        drawing = page.locator(".front svg.drawing")
        whole = drawing.get_attribute("viewBox")
        page.locator("a.tile").first.click()
        assert page.locator(".place:target").is_visible()
        assert drawing.get_attribute("viewBox") != whole
        assert "distance from the drawing" in page.locator(".front output").inner_text()
        drawing.dblclick(position={"x": 5, "y": 5})
        assert drawing.get_attribute("viewBox") == whole
        page.locator("#time summary").click()
        page.wait_for_selector("#time canvas")
        plot = page.locator("#time .u-over").first
        plot.scroll_into_view_if_needed()
        box = plot.bounding_box()
        page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        tip = page.locator("#time .tip").inner_text()
        assert re.search(r"time [\d.]+.*compensated: [\d.]+", tip, re.DOTALL)
        # All plots of a figure are enlarged together.
        ends = "() => [...drawn.values()].flat().map((u) => u.scales.x.max)"
        before = page.evaluate(ends)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] * 0.7, box["y"] + 20, steps=4)
        page.mouse.up()
        after = page.evaluate(ends)
        assert len(after) == 3 and all(x < y for x, y in zip(after, before, strict=True))
    with opened(browser, text_of("run"), tmp_path, 1400) as page:
        page.wait_for_selector(".space canvas", timeout=120_000)
        slider = page.locator(".player input")
        clock = page.locator(".clock")
        assert clock.inner_text().startswith("0 of")
        before = page.locator(".space").screenshot()
        page.locator(".player .play").click()
        page.wait_for_function("() => document.querySelector('.player input').valueAsNumber > 0.5")
        page.locator(".player .play").click()
        assert page.locator(".player .play").inner_text() == "Play"
        assert float(slider.input_value()) == pytest.approx(
            float(clock.inner_text().split()[0]), rel=1e-3
        )
        assert page.locator(".space").screenshot() != before
        page.get_by_role("button", name="Top").click()
        assert page.locator("[data-view=Top]").get_attribute("aria-pressed") == "true"
        slider.fill("0")
        assert clock.inner_text().startswith("0 of")
    with opened(browser, text_of("run"), tmp_path, 1400, java_script_enabled=False) as page:
        page.locator("#time summary").click()
        assert page.locator("#time noscript").is_visible()
