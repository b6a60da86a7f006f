"""Formulas on the pages: what code hosts, MyST and the site's MathML all understand."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
PAGES = {x.relative_to(DOCS).as_posix(): x for x in sorted(DOCS.rglob("*.md"))}
CODE = re.compile(r"```.*?```|`[^`]+`", re.DOTALL)
MATH = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", re.DOTALL)
COMMAND = re.compile(r"\\([a-zA-Z]+|.)")
# Letters, and what both MathJax and latex2mathml draw.
KNOWN = set(
    "alpha beta delta Delta theta kappa lambda mu pi sigma tau varphi varepsilon omega "
    "dot ddot dddot tilde hat bar frac sqrt left right lvert rvert text mathrm "
    "sin cos tan sinh cosh tanh arcsin arctan max min sum int partial cdot times pm sim top "
    "lt gt le ge ne quad qquad ldots".split()
)


def without_code(page: str) -> str:
    return CODE.sub("", PAGES[page].read_text(encoding="utf-8"))


def formulas(page: str) -> list[str]:
    return [block or inline for block, inline in MATH.findall(without_code(page))]


WITH_MATH = [x for x in PAGES if formulas(x)]
with_math = pytest.mark.parametrize("page", WITH_MATH)


def test_there_are_formulas() -> None:
    assert len(WITH_MATH) >= 15


@with_math
def test_dollars_are_in_pairs_and_stand_alone(page: str) -> None:
    text = without_code(page)
    assert "$" not in MATH.sub("", text)
    # A dollar beside a letter or a digit is no begin or end of a formula on code hosts.
    for line in text.splitlines():
        between = MATH.split(line)[::3]
        assert not any(re.search(r"\w$", x) for x in between[:-1]), line
        assert not any(re.match(r"\w", x) for x in between[1:]), line
    for found in re.finditer(r"\$\$", text):
        line = text[text.rfind("\n", 0, found.start()) + 1 : text.find("\n", found.end())]
        assert line.strip() == "$$", line


@with_math
def test_formulas_use_what_all_readers_know(page: str) -> None:
    for x in formulas(page):
        # Markdown would take a bar in a table, and HTML an angle bracket, for its own.
        assert x.isascii() and not set(x) & set("|<>*"), x
        assert set(COMMAND.findall(x)) <= KNOWN, x


@with_math
def test_formulas_become_mathml(page: str) -> None:
    convert = pytest.importorskip("latex2mathml.converter").convert
    for x in formulas(page):
        made = convert(x)
        assert made.startswith("<math") and "\\" not in made, x
