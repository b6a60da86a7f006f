"""Figures of the pages: drawn by a module that `make figures` knows, small, and said in words."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from docs.figures.__main__ import NAMES

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
CONCEPTS = sorted((FIGURES.parent / "concepts").glob("*.md"))
PICTURE = re.compile(r"!\[([^\]]*)\]\(\.\./figures/(\w+)\.svg\)")
OF_MODULE = re.compile(r'^FILE = "(\w+)"$', re.MULTILINE)
LARGEST = 150_000  # bytes
SHORTEST = 30  # characters that say what is seen


def drawn() -> set[str]:
    """Names of the files that the figures' modules write."""
    found = set()
    for name in NAMES:
        text = (FIGURES / f"{name}.py").read_text(encoding="utf-8")
        own = OF_MODULE.search(text)
        found.add(own[1] if own else name)
    return found


@pytest.mark.parametrize("page", CONCEPTS, ids=lambda x: x.stem)
def test_every_concept_has_a_small_figure_and_its_words(page: Path) -> None:
    pictures = PICTURE.findall(page.read_text(encoding="utf-8"))
    assert pictures
    for words, file in pictures:
        assert file in drawn(), file
        assert len(words) >= SHORTEST, words
        assert (FIGURES / f"{file}.svg").stat().st_size <= LARGEST, file


def test_every_drawing_has_its_module() -> None:
    files = {x.stem for x in FIGURES.glob("*.svg")}
    assert files == drawn()
