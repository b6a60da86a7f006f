"""Figures of the pages: drawn by a module that `make figures` knows, small, and said in words."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import numpy as np
import pytest

import armcontour as ac

FIGURES = Path(__file__).parents[1] / "docs" / "figures"
CONCEPTS = sorted((FIGURES.parent / "concepts").glob("*.md"))
PICTURE = re.compile(r"!\[([^\]]*)\]\(\.\./figures/(\w+)\.svg\)")
OF_MODULE = re.compile(r'^FILE = "(\w+)"$', re.MULTILINE)
LARGEST = 150_000  # bytes
SHORTEST = 30  # characters that say what is seen


def names() -> tuple[str, ...]:
    """Names of the modules that `make figures` runs; to import them takes matplotlib."""
    text = (FIGURES / "__main__.py").read_text(encoding="utf-8")
    found = re.search(r"^NAMES = (\(.+?\))$", text, re.MULTILINE | re.DOTALL)
    assert found
    return tuple(ast.literal_eval(found[1]))


def drawn() -> set[str]:
    """Names of the files that the figures' modules write."""
    found = set()
    for name in names():
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
    assert {x.stem for x in FIGURES.glob("*.svg")} == drawn()
    modules = {x.stem for x in FIGURES.glob("*.py") if "\ndef draw()" in x.read_text("utf-8")}
    assert modules == set(names())


def test_the_figure_that_looks_into_the_planner_has_a_backward_pass() -> None:
    pytest.importorskip("matplotlib")
    from docs.figures import job, optimal

    traced = ac.trace(job.ROUNDED, job.ARM)
    s, _, most = optimal.ceiling_and_backward_pass(traced)
    plan = ac.plan(traced, job.ARM, job.LIMITS)
    assert most[-1] == 0 and len(s) == len(most)
    # No plan that ends at rest is faster, up to the grid; near its end this one is as fast.
    speed = plan.speed_at(s)
    assert (speed <= np.sqrt(most) * (1 + 1e-3) + 1e-6).all()
    assert speed[-20:] == pytest.approx(np.sqrt(most[-20:]), rel=1e-2, abs=1e-6)
