"""Printed reports: figures are low enough to fit below the section before them."""

import re

import pytest
from tools.studio_page import write_job

import armcontour as ac
from armcontour.report import render_report

pytestmark = pytest.mark.browser
# Heights of the plots over time, of a drawing of an executed path, and of that on the first page.
HEIGHTS = """() => ["#time .plots canvas", "#paths .drawing", ".front .drawing"].map(
    (x) => document.querySelector(x).getBoundingClientRect().height)"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    folder = tmp_path_factory.mktemp("printed")
    job = ac.read_job(write_job(folder / "job.yaml", "conventional", "proposed", "optimal"))
    file = folder / "report.html"
    file.write_text(render_report(ac.run(job)))
    return file


def test_printed_figures_fill_pages_and_are_as_before_on_the_screen(browser, report):
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.goto(report.as_uri())
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 718, "height": 1000})
    # An A4 page has a height of 1,123 px at 96 dpi, with margins 1,040 px.
    over_time, path, first = page.evaluate(HEIGHTS)
    error = page.evaluate(
        "[...document.querySelectorAll('#time .plots .u-over')].at(-1).clientHeight"
    )
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    page.emulate_media(media="screen")
    page.set_viewport_size({"width": 1200, "height": 900})
    for name in ("time", "paths"):
        page.locator(f"#{name} > summary").click()
    on_screen = page.evaluate(HEIGHTS)
    assert over_time < 0.8 * on_screen[0]
    # The title of the error axis, of at least 18 letters, is not longer than its plot.
    assert error > 18 * 6
    # Three executed paths with their words fit on a page; the drawing of the first page is larger.
    assert path < 1040 / 4 < first
    # Three runs with figures, paths and joints need no more than five pages.
    page.emulate_media(media="print")
    pages = re.findall(rb"/Type\s*/Page\b", page.pdf(format="A4"))
    assert 2 <= len(pages) <= 5
    page.close()


def test_a_button_prints_a_report(browser, report):
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.add_init_script("window.print = () => (document.body.dataset.printed = 'yes')")
    page.goto(report.as_uri())
    page.get_by_role("button", name="Print").click()
    page.wait_for_selector("body[data-printed=yes]")
    page.emulate_media(media="print")
    assert not page.get_by_role("button", name="Print").is_visible()
    page.close()
