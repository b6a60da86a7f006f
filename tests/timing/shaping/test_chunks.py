"""Long paths: chunks of quadratic programs, and corners that go back alone."""

from __future__ import annotations

import numpy as np
import pytest
from soak.shape_judge import judge
from soak.shape_problems import Problem

import armcontour as ac
from armcontour.timing.shaping import chunks

CUTS = np.array([10, 20])


@pytest.fixture(scope="module")
def program():
    """Rows that rest keeps, so that there is a solution with nodes that stay."""
    rng = np.random.default_rng(1)
    n, k = 30, 2
    rows = rng.normal(size=(n, 8, 3 * k))
    return rng.normal(size=(n, k)), rows, rng.uniform(0.1, 1.0, (n, 8)), np.full((n, k), 0.1)


def test_chunks_keep_rows_and_leave_the_nodes_between(program):
    x = chunks.solve_in_chunks(*program, CUTS)
    assert np.abs(x[[10, 11, 20, 21]]).max() < 1e-12
    assert np.abs(np.delete(x, [10, 11, 20, 21], axis=0)).max(axis=1).min() > 1e-3
    beyond = np.pad(x, ((1, 1), (0, 0)))
    around = np.concatenate([beyond[:-2], beyond[1:-1], beyond[2:]], axis=1)
    assert float((np.einsum("nrj,nj->nr", program[1], around) - program[2]).max()) < 1e-6


def test_the_number_of_threads_changes_nothing(program):
    found = [chunks.solve_in_chunks(*program, CUTS, threads=x) for x in (1, 2, 5)]
    assert np.array_equal(found[0], found[1]) and np.array_equal(found[0], found[2])


def test_cuts_move_and_short_paths_have_none():
    group = np.repeat(np.arange(60), 9)
    cuts = [chunks.place_cuts(group, i) for i in range(chunks.CORNERS)]
    assert len({tuple(x) for x in cuts}) == chunks.CORNERS
    assert all((np.diff(x) == 9 * chunks.CORNERS).all() and len(x) > 5 for x in cuts)
    assert not len(chunks.place_cuts(group[group < chunks.LONG], 0))


def test_a_long_path_is_about_as_fast_as_in_one_piece(arm, limits, monkeypatch):
    corners = np.stack([np.linspace(0.15, 0.35, 9), 0.22 + 0.02 * (-1.0) ** np.arange(9)], axis=1)
    problem = Problem(
        seed=0,
        kind="",
        objective=ac.Path.polyline(corners),
        arm=arm,
        limits=limits,
        options={"tolerance": 2e-3},
    )

    def plan() -> ac.Trajectory:
        options = {"tolerance": 2e-3, "iterations": 16, "intervals": 1000}
        return ac.plan(problem.objective, arm, limits, method="shaped", **options)

    whole = plan()
    monkeypatch.setattr(chunks, "LONG", 4)
    monkeypatch.setattr(chunks, "CORNERS", 4)
    parts = plan()
    assert parts.duration < 1.005 * whole.duration
    history = parts.path.outcome.history
    assert (np.diff(history) <= 0).all() and len(history) > 5
    assert judge(parts, problem) == []
