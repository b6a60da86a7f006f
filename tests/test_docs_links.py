"""Links between pages, tables, and entries of the site."""

import functools
import itertools
import re
from pathlib import Path

from docs.gallery import pages as gallery
from docs.reference import controller_facts, job_keys
from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
# What `make docs` writes: the site is judged by docs/site/test_built.py.
BUILT = {DOCS / "_build", DOCS / "reference" / "pages", gallery.FOLDER}
FILES = [x for x in sorted(DOCS.rglob("*")) if x.is_file() and not BUILT & set(x.parents)]
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *(x for x in FILES if x.suffix == ".md"),
    *sorted((ROOT / "examples").rglob("*.md")),
]
# Code that draws the figures, and makes the site, is no page.
CODE = (".py", ".css", ".js")
SHORTEST = 30  # characters that say what a picture shows
ELSEWHERE = re.compile(r"https://[\w.-]+/|mailto:")


@functools.cache
def parsed(page):
    return MarkdownIt().enable("table").parse(page.read_text(encoding="utf-8"))


def links(page):
    """Targets of all links and pictures of a page."""
    inline = [x for token in parsed(page) for x in token.children or ()]
    links_of_page = [x.attrGet("href") for x in inline if x.type == "link_open"]
    links_of_page += [x.attrGet("src") for x in inline if x.type == "image"]
    return [str(x) for x in links_of_page]


@functools.cache
def anchors(page):
    """Anchors of the headings, as code hosts and site builders make them."""
    tokens = parsed(page)
    slugs: set[str] = set()
    for head, text in zip(tokens[:-1], tokens[1:], strict=True):
        if head.type == "heading_open":
            words = "".join(x.content for x in text.children or ())
            slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
            again = sum(x == slug or re.fullmatch(rf"{slug}-\d+", x) is not None for x in slugs)
            slugs.add(f"{slug}-{again}" if again else slug)
    return slugs


def faults(page):
    """Links that lead nowhere or are left as text, and rows that are cut off from their table."""
    for link in [x for x in links(page) if not ELSEWHERE.match(x)]:
        file, _, anchor = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        if file.startswith("/") or ":" in file or not target.is_relative_to(ROOT):
            yield link
        elif not target.exists() or (anchor and anchor not in anchors(target)):
            yield link
    for token in parsed(page):
        texts = [x.content for x in token.children or () if x.type == "text"]
        yield from (x for x in texts if re.search(r"\]\(|\]\[|https?://", x))
        if token.type == "inline" and token.level < 3 and token.content.startswith("|"):
            yield token.content


def test_links_have_targets_and_tables_have_equal_columns():
    wrong = [f"{page.relative_to(ROOT)}: {x}" for page in PAGES for x in faults(page)]
    assert not wrong, "\n".join(wrong)


def test_commands_of_make_on_pages_are_targets_and_the_readme_has_the_two_that_set_up_all():
    goals = set(re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.M))
    named = {
        x: set(re.findall(r"^make ([\w-]+)", x.read_text(encoding="utf-8"), re.M)) for x in PAGES
    }
    assert {x: y - goals for x, y in named.items() if y - goals} == {}
    assert named[ROOT / "README.md"] == {"demo", "test"}


def test_files_that_the_page_for_developers_names_exist():
    text = (DOCS / "develop.md").read_text(encoding="utf-8")
    named = re.findall(r"`([\w./]+\.py|[\w./]+/)`", text)
    tops = [ROOT / x for x in ("src", "tests", "docs", "examples", "tools", "soak")]
    tree = [f"/{x.as_posix()}" for top in tops for x in (top, *top.rglob("*"))]
    missing = [x for x in named if not any(y.endswith(f"/{x.rstrip('/')}") for y in tree)]
    assert len(named) > 20 and missing == []


def test_pages_that_are_generated_are_up_to_date():
    generated = job_keys.published() | controller_facts.published()
    old = [x for x, text in generated.items() if x.read_text(encoding="utf-8") != text]
    assert not old, "make docs writes them again"


def test_links_of_the_gallery_lead_to_pages():
    targets = [x for shown in gallery.SHOWN.values() for x in shown.more.values()]
    assert [x for x in targets if not (gallery.FOLDER / x).is_file()] == []


def test_every_picture_of_the_gallery_has_its_script_and_leads_to_it():
    drawn = sorted(x.stem for x in gallery.FOLDER.glob("*.svg"))
    assert drawn == sorted(gallery.SHOWN)
    assert all((gallery.EXAMPLES / f"{name}.py").is_file() for name in drawn)
    for page in PAGES:
        for token in parsed(page):
            for before, x in itertools.pairwise([token, *(token.children or ())]):
                source = (page.parent / str(x.attrGet("src") or "")).resolve()
                if x.type == "image" and source.parent == gallery.FOLDER:
                    target = (page.parent / str(before.attrGet("href") or "")).resolve()
                    assert target == gallery.EXAMPLES / f"{source.stem}.py", (page, source.name)


def test_every_picture_is_described_in_words():
    for page in PAGES:
        inline = [x for token in parsed(page) for x in token.children or ()]
        for x in [x for x in inline if x.type == "image"]:
            assert len(x.content) >= SHORTEST or page == DOCS / "paper.md", (page, x.content)


def test_every_page_is_linked_from_the_first_page():
    visited: set[Path] = set()
    todo = [DOCS / "index.md"]
    while todo:
        page = todo.pop()
        if page in visited:
            continue
        visited.add(page)
        if page.suffix == ".md":
            files = (x.partition("#")[0] for x in links(page) if not ELSEWHERE.match(x))
            todo += [(page.parent / x).resolve() for x in files if x]
    files = {x for x in FILES if x.suffix not in CODE and "__pycache__" not in x.parts}
    assert sorted(x.relative_to(ROOT).as_posix() for x in files - visited) == []
    # From the README all of it is found too.
    assert "docs/index.md" in {x.partition("#")[0] for x in links(ROOT / "README.md")}
