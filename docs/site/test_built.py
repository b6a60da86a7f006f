"""The site as it was built: `make site` runs this after the build.

Links lead somewhere, nothing comes from other sites, every public name is found; and in a browser
no page has a serious fault of accessibility, nor is anything cut off.
"""

from __future__ import annotations

import functools
import inspect
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote, urlsplit

import pytest
from docs.site.names import by_room
from tests.browser.axe_faults import faults, load_axe
from tools.studio_page import browsing, find_browser

if TYPE_CHECKING:
    from playwright.sync_api import Browser

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs" / "_build" / "html"
# One page of each kind.
KINDS = (
    "index",
    "tutorials/own_arm",
    "gallery/index",
    "guides/compensations",
    "reference/job_keys",
    "reference/pages/api/planning",
    "reference/pages/commands/run",
    "search",
)
WIDTHS = (1400, 900, 500)
# What a page loads by itself, not only when somebody clicks.
LOADS = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}
# Links that say what a page belongs to, and load nothing.
ONLY_SAID = ("canonical", "next", "prev", "index", "search", "genindex")


class Parts(HTMLParser):
    """The anchors, links and loaded files of a page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take what a tag has of them."""
        has = {key: value or "" for key, value in attrs}
        self.anchors |= {has[x] for x in ("id", "name") if x in has}
        if tag == "a" and "href" in has:
            self.links.append(has["href"])
        loaded = has.get(LOADS.get(tag, ""))
        if loaded and has.get("rel") not in ONLY_SAID:
            self.loads.append(loaded)


@functools.cache
def parts(file: Path) -> Parts:
    """The parts of a page of the site."""
    return Parts(file.read_text(encoding="utf-8"))


HTML = sorted(SITE.rglob("*.html"))
every_page = pytest.mark.parametrize("page", HTML, ids=lambda x: x.relative_to(SITE).as_posix())


def test_the_site_is_built() -> None:
    assert len(HTML) > 80, f"{SITE} has no site: make docs builds one."


@every_page
def test_links_lead_somewhere(page: Path) -> None:
    wrong = []
    for link in parts(page).links:
        to = urlsplit(link)
        if to.scheme or to.netloc:
            assert to.scheme in ("https", "mailto"), link
            continue
        target = (page.parent / unquote(to.path)).resolve() if to.path else page
        if not target.is_file():
            wrong.append(link)
        elif to.fragment and target.suffix == ".html":
            wrong += [link] * (unquote(to.fragment) not in parts(target).anchors)
    assert wrong == []


@every_page
def test_a_page_loads_nothing_from_other_sites(page: Path) -> None:
    for load in parts(page).loads:
        to = urlsplit(load)
        assert to.scheme in ("", "data") and not to.netloc, load
        if not to.scheme:
            assert (page.parent / unquote(to.path)).is_file(), load


def test_styles_load_nothing_from_other_sites() -> None:
    for file in SITE.rglob("*.css"):
        text = file.read_text(encoding="utf-8")
        matches = re.findall(r"url\(\s*[\"']?([^\"')]+)|@import\s+[\"']([^\"']+)", text)
        places = [x or y for x, y in matches]
        assert [x for x in places if urlsplit(x).scheme not in ("", "data")] == [], file


def test_every_public_name_and_its_members_are_found() -> None:
    anchors = set().union(*(parts(x).anchors for x in SITE.rglob("reference/pages/api/*.html")))
    missing = []
    for name, value in (x for members in by_room().values() for x in members):
        missing += [name] * (name not in anchors)
        if inspect.isclass(value):
            homes = [name, *(f"armcontour.{x.__name__}" for x in value.__mro__[1:])]
            homes += [x for x in anchors if x.rpartition(".")[2] in _bases(value)]
            missing += [
                f"{name}.{member}"
                for member in _members(value)
                if not any(f"{home}.{member}" in anchors for home in homes)
            ]
    assert missing == []


def _bases(value: type) -> set[str]:
    return {x.__name__ for x in value.__mro__[1:]}


def _members(value: type) -> list[str]:
    """Public methods and properties that the package itself defines."""
    members = []
    for owner in value.__mro__:
        if not owner.__module__.startswith("armcontour"):
            continue
        for name, x in vars(owner).items():
            is_member = inspect.isroutine(x) or isinstance(x, property)
            if is_member and not name.startswith("_"):
                members.append(name)
    return members


def test_equations_are_drawn() -> None:
    drawn = 0
    for page in HTML:
        text = page.read_text(encoding="utf-8")
        drawn += text.count("<math")
        prose = re.sub(r"<(pre|code|script|annotation)\b.*?</\1>", "", text, flags=re.DOTALL)
        assert not re.search(r"\\(frac|sqrt|dot|ddot|text|mathrm|left|begin)\b|\$\$", prose), page
    assert drawn > 0 or not any(
        "$$" in x.read_text(encoding="utf-8") for x in (ROOT / "docs/concepts").glob("*.md")
    )


@pytest.mark.parametrize("word", ["kerf", "jerk", "interpolate_point", "command_limit", "servoj"])
def test_the_search_knows_words_of_pages_names_and_keys(word: str) -> None:
    text = (SITE / "searchindex.js").read_text(encoding="utf-8")
    index: dict[str, Any] = json.loads(text.removeprefix("Search.setIndex(").rstrip(";\n)"))
    assert any(x.startswith(word) for x in index["terms"])


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all tests of this file."""
    if find_spec("playwright") is None or find_browser() is None:
        pytest.skip("Pages are not looked at: that needs Chromium, and armcontour[browser].")
    with browsing() as chromium:
        yield chromium


# What reaches over the right edge, and is not in a box that scrolls and that the tab key reaches.
CUT_OFF = """() => {
  const wide = document.documentElement.clientWidth
  const found = []
  if (document.documentElement.scrollWidth > wide) found.push('the page itself')
  for (const x of document.querySelectorAll('article *')) {
    if (x.getClientRects().length === 0 || x.getBoundingClientRect().right <= wide + 1) continue
    let box = x
    while (box && !['auto', 'scroll'].includes(getComputedStyle(box).overflowX)) {
      box = box.parentElement
    }
    const reached = box && box !== document.documentElement && box.tabIndex === 0
    if (!reached) found.push(x.outerHTML.slice(0, 120))
  }
  return found
}"""


# What follows the size of the page has followed by then.
TWO_FRAMES = "() => new Promise(x => requestAnimationFrame(() => requestAnimationFrame(x)))"


@pytest.mark.parametrize("name", KINDS)
def test_a_page_has_no_serious_fault_and_nothing_cut_off(browser: Browser, name: str) -> None:
    page = browser.new_page(offline=True)
    page.goto((SITE / f"{name}.html").as_uri())
    load_axe(page)
    faults_found = []
    for width in WIDTHS:
        page.set_viewport_size({"width": width, "height": 900})
        for colours in ("light", "dark"):
            page.emulate_media(color_scheme=colours)
            page.evaluate(TWO_FRAMES)
            page_faults = [f"cut off: {x}" for x in page.evaluate(CUT_OFF)] + faults(page, rules=())
            faults_found += [f"{width} px, {colours}: {x}" for x in page_faults]
    page.close()
    assert faults_found == [], "\n".join(faults_found)


def test_what_is_cut_off_would_be_seen(browser: Browser) -> None:
    page = browser.new_page(viewport={"width": 500, "height": 900})
    page.set_content("<article><p style='width: 900px'>wide</p></article>")
    assert page.evaluate(CUT_OFF)
    page.set_content(
        "<article><div style='overflow-x: auto'><p style='width: 900px'>wide</article>"
    )
    assert page.evaluate(CUT_OFF)
    page.set_content(
        "<article><div style='overflow-x: auto' tabindex=0><p style='width: 900px'>wide</article>"
    )
    assert page.evaluate(CUT_OFF) == []
    page.close()


def test_the_search_finds_pages_without_a_network(browser: Browser) -> None:
    page = browser.new_page(offline=True)
    page.goto((SITE / "search.html").as_uri() + "?q=kerf")
    page.wait_for_selector("#search-results li a")
    assert page.locator("#search-results li a").count() > 1
    page.close()
