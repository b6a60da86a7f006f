"""Reports in a real browser: no serious fault of accessibility, nothing cut off at any width."""

import dataclasses
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.io import parse_job
from armcontour.report import sections
from armcontour.report.figure import render_page
from armcontour.report.identification import render_identification
from armcontour.report.sections.batch import Axis, BatchView

if TYPE_CHECKING:
    pass
from tests.browser.axe_faults import faults, load_axe

pytestmark = pytest.mark.browser
# Two parts of a drawing on the UR5e, before a table; two runs whose rapids differ.
PARTS = """
name: parts
title: Two parts on the UR5e
arm: {name: ur5e, work: {position: [0.4, -0.05, 0.2], rpy: [0, 0.2, 0.5]}}
path: {points: [[0, 0, 0], [0.02, 0, 0]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.25, centripetal_acceleration: 1}
corners: {tolerance: 0.5 mm}
servo: {kp: 25, kv: 150}
command_interval: 4 ms
runs:
  taught: {compensation: {method: inverse}}
  slower: {limits: {speed: 0.1}}
scene: {halfspaces: [{name: table, at: [0, 0, -0.1]}]}
"""


def parts():
    """A job of two contours, one of them with a corner."""
    bend = ac.Path.polyline([[0, 0, 0], [0.02, 0, 0], [0.02, 0.02, 0]]).pointing([0, 0, -1])
    line = ac.Path.polyline([[0.04, 0, 0], [0.05, 0.01, 0]]).pointing([0, 0, -1])
    contours = tuple(ac.Contour(path=x, name=n) for x, n in ((bend, "bend"), (line, "tick")))
    return dataclasses.replace(parse_job(PARTS), path=ac.Program(moves=contours))


def bend():
    return parse_job(CORNER_JOB)


def bends():
    speeds, errors = np.array([0.01, 0.02, 0.04]), np.array([1e-3, 2e-3, np.nan])
    return BatchView(
        name="bends",
        about="3 jobs",
        counts={"done": 2, "refused": 1},
        errors={"Unreachable": 1},
        axes=(Axis("limits.speed", "m/s", speeds, False),),
        figures=(Axis("contour_error.max", "m", errors, True),),
        status=("done", "done", "refused"),
        done="done",
        stride=1,
    )


def every_kind():
    """A page with sections of all kinds of reports."""
    study = ac.run(parts())
    over = {"x": (-0.01, 0.01, 2), "y": (-0.01, 0.01, 2)}
    space = sections.space(study)
    assert space is not None
    found = [
        sections.certificate(ac.certify(bend())),
        sections.overview(study),
        sections.program(study),
        # Scenes are slow without a graphics card.
        dataclasses.replace(space, figures=space.figures[-1:]),
        sections.tool_speed(study),
        sections.joints(study),
        sections.placement(ac.place(bend(), ac.PlaceSearch(over=over, refined=False))),
        sections.batch(bends()),
    ]
    return render_page("report.html", job=study.job, title="", about="", source="", sections=found)


def identified():
    t = np.linspace(0.0, 1.0, 501)
    command = 0.1 * np.sin(2 * t[:, None]) ** 2
    measured = command + 1e-5 * np.random.default_rng(0).standard_normal(command.shape)
    return render_identification(ac.identify(ac.Log(t=t, command=command, measured=measured)))


# What lies outside of its page or its figure, but for what has a box of its own to scroll in.
CUT_OFF = """() => {
  const found = [], wide = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth > wide) found.push("the page");
  for (const text of document.querySelectorAll(".js-plotly-plot text, main p, li, figcaption, b")) {
    if (text.closest(".wide")) continue;
    const own = text.getBoundingClientRect();
    const box = text.closest(".js-plotly-plot, section")?.getBoundingClientRect();
    if (!box || !own.width || text.closest("[hidden], details:not([open])")) continue;
    if (own.left < box.left - 1 || own.right > box.right + 1
        || own.top < box.top - 1 || own.bottom > box.bottom + 1) found.push(text.textContent);
  }
  for (const box of document.querySelectorAll(".scroll")) {
    const goesOn = box.scrollWidth > box.clientWidth + 1;
    const hinted = box.nextElementSibling.getBoundingClientRect().height > 0;
    if (goesOn !== hinted || goesOn !== (box.tabIndex === 0)) found.push(box.textContent);
  }
  return found;
}"""


@contextmanager
def opened(browser, text, folder, width):
    """A page whose figures are drawn, and that has had no trouble."""
    file = folder / "report.html"
    file.write_text(text, encoding="utf-8")
    page = browser.new_page(viewport={"width": width, "height": 900})
    troubles = []
    page.on("pageerror", lambda x: troubles.append(str(x)))
    page.on("console", lambda x: troubles.append(x.text) if x.type == "error" else None)
    page.on("request", lambda x: None if x.url == file.as_uri() else troubles.append(x.url))
    page.goto(file.as_uri())
    page.wait_for_selector("body[data-drawn]", state="attached", timeout=120_000)
    yield page
    assert not troubles, troubles
    page.close()


@pytest.mark.parametrize(("make", "widths"), [(every_kind, (1400, 900, 500)), (identified, (500,))])
def test_a_page_has_no_serious_fault_and_nothing_is_cut_off(browser, tmp_path, make, widths):
    with opened(browser, make(), tmp_path, widths[0]) as page:
        load_axe(page)
        assert page.locator(".js-plotly-plot").count() == page.locator("figure").count() > 0
        found = []
        for width in widths:
            page.set_viewport_size({"width": width, "height": 900})
            page.evaluate("fitPage()")
            found += [f"{width}: cut off: {x}" for x in page.evaluate(CUT_OFF)]
            # What plotly draws is the same at any width, and a page has ten thousand pieces of it.
            without = [] if width == widths[0] else [".js-plotly-plot svg"]
            found += [f"{width}: {x}" for x in faults(page, without=without)]
        assert not found, "\n".join(found)


# Words of figures that their tools cover, and tools that are cut off themselves.
COVERED = """() => [...document.querySelectorAll(".js-plotly-plot")].flatMap((plot) => {
  const groups = [...plot.querySelectorAll(".modebar-group")].map((x) => x.getBoundingClientRect());
  const meets = (x) => groups.some((tools) => x.left < tools.right && tools.left < x.right
    && x.top < tools.bottom && tools.top < x.bottom);
  const words = [...plot.querySelectorAll("text"), ...document.querySelectorAll("figcaption")];
  const found = words.filter((x) => meets(x.getBoundingClientRect())).map((x) => x.textContent);
  const box = plot.closest(".scroll").getBoundingClientRect();
  const seen = groups.length && groups.every((x) => x.top >= box.top && x.right <= box.right + 1);
  return seen ? found : [...found, "cut off"];
})"""
RATIO = "() => document.querySelector('#paths .js-plotly-plot').layout.scene.aspectratio.x"


def of_paths(section):
    """A page with one section."""
    assert section is not None
    return render_page("report.html", job=bend(), title="", about="", source="", sections=[section])


def test_the_tools_of_a_figure_cover_no_words(browser, tmp_path):
    # The titles of enlarged corners are where the tools would be.
    points = [(0.35, 0.1), (0.41, 0.15), (0.28, 0.3), (0.35, 0.35)]
    job = dataclasses.replace(bend(), path=ac.Path.polyline(points))
    with opened(browser, of_paths(sections.paths(ac.run(job))), tmp_path, 1400) as page:
        assert page.evaluate(COVERED) == []


def test_scenes_on_a_narrow_page_leave_room_for_their_ticks(browser, tmp_path):
    text, ratios = of_paths(sections.space(ac.run(parts()))), []
    for width in (1400, 500):
        with opened(browser, text, tmp_path, width) as page:
            ratios.append(page.evaluate(RATIO))
    assert ratios[1] == pytest.approx(0.8 * ratios[0])
