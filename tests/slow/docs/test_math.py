"""Formulas on the pages: what code hosts, MyST and the site's MathML all understand."""

import re
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[3] / "docs"
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
TEXTS = {x: CODE.sub("", x.read_text(encoding="utf-8")) for x in sorted(DOCS.rglob("*.md"))}
FORMULAS = {
    x: formulas for x, y in TEXTS.items() if (formulas := [a or b for a, b in MATH.findall(y)])
}


def test_dollars_are_in_pairs_and_stand_alone():
    assert len(FORMULAS) >= 15
    for page in FORMULAS:
        text = TEXTS[page]
        assert "$" not in MATH.sub("", text), page
        # A dollar beside a letter or a digit is no begin or end of a formula on code hosts.
        for line in text.splitlines():
            between = MATH.split(line)[::3]
            assert not any(re.search(r"\w$", x) for x in between[:-1]), (page, line)
            assert not any(re.match(r"\w", x) for x in between[1:]), (page, line)
        for match in re.finditer(r"\$\$", text):
            line = text[text.rfind("\n", 0, match.start()) + 1 : text.find("\n", match.end())]
            assert line.strip() == "$$", (page, line)


def test_formulas_are_what_all_readers_know_and_become_mathml():
    convert = pytest.importorskip("latex2mathml.converter").convert
    for page, x in ((page, x) for page, formulas in FORMULAS.items() for x in formulas):
        # Markdown would take a bar in a table, and HTML an angle bracket, for its own.
        assert x.isascii() and not set(x) & set("|<>*"), (page, x)
        assert set(COMMAND.findall(x)) <= KNOWN, (page, x)
        made = convert(x)
        assert made.startswith("<math") and "\\" not in made, (page, x)
