"""The start page and the pen, each shape and each key, in a real browser."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tests.browser.test_starting import started
from tools.studio_page import serving, write_job

__all__ = ["started"]

pytestmark = pytest.mark.browser


@pytest.mark.parametrize(("colours", "width"), [("light", 1400), ("dark", 500)])
def test_the_start_page_is_accessible_and_operable_by_keys(started, pages, colours, width):
    studio = pages(started.server, colours=colours, size=(width, 900))
    studio.wait_for("#start[open]")
    load_axe(studio.page)
    page_faults = faults(studio.page)
    # By keys: an arm is chosen with arrows, a card with Tab and Enter.
    keys = studio.page.keyboard
    assert studio.page.evaluate("() => document.activeElement.value") == "ur5e"
    keys.press("ArrowLeft")
    keys.press("Tab")
    with studio.renewing():
        keys.press("Enter")
    assert "ur10e" in studio.text
    expect(studio.find("rect.pen")).to_be_visible()
    page_faults += faults(studio.page)
    assert not page_faults, "\n".join(page_faults)


def test_the_first_start_says_that_it_compiles(pages, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "compiled"))
    with serving(write_job(tmp_path / "job.yaml", "optimal"), folder=tmp_path) as server:
        studio = pages(server)
        work = studio.find("#messages .work")
        told = re.compile(r"only this once: \d+ (s so far|of about \d+ s)")
        expect(work).to_contain_text(told)
        expect(studio.find("#tab-contours")).not_to_contain_text("No contour")
        studio.rest()
        expect(work).to_be_hidden()
