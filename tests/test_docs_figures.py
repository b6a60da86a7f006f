"""Figures of the pages: drawn by a module that `make figures` knows, and said in words."""

from __future__ import annotations

import re

import numpy as np
import pytest
from tests.drawn_figures import FIGURES, drawn, names

import armcontour as ac

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


def test_the_figure_that_looks_into_the_planner_has_a_backward_pass():
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
