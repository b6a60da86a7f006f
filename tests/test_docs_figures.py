"""Figures of the pages: drawn by a module that `make figures` knows, and said in words."""

import re

from tests.drawn_figures import FIGURES, drawn, names

CONCEPTS = sorted((FIGURES.parent / "concepts").glob("*.md"))
PICTURE = re.compile(r"!\[([^\]]*)\]\(\.\./figures/(\w+)\.svg\)")
SHORTEST = 30  # characters that say what is seen


def test_every_concept_has_a_figure_and_its_words():
    for page in CONCEPTS:
        pictures = PICTURE.findall(page.read_text(encoding="utf-8"))
        assert pictures, page.name
        assert {file for _, file in pictures} <= drawn(), page.name
        assert all(len(words) >= SHORTEST for words, _ in pictures), page.name


def test_every_drawing_has_its_module():
    modules = {x.stem for x in FIGURES.glob("*.py") if "\ndef draw()" in x.read_text("utf-8")}
    assert modules == set(names())
