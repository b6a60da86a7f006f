"""Shaped programs before an independent judge, in space too, and what cannot be shaped."""

import functools
import math
import pickle

import numpy as np
import pytest
from soak.shaping import Problem, judge

import armcontour as ac
from armcontour.planning import trace_program
from armcontour.planning.shaping import shape, shape_search, shaper


def square(x):
    corners = np.array([(0.0, 0.0), (0.02, 0.0), (0.02, 0.02), (0.0, 0.02)])
    return ac.Contour(path=ac.Path.polyline(corners + (x, 0.2)))


@pytest.fixture
def pickled(monkeypatch):
    """Contours are shaped as in other processes, from two on."""

    def send(work, items, done):
        replies = []
        for i, item in enumerate(items):
            done(i)
            replies.append(pickle.loads(pickle.dumps(work(pickle.loads(pickle.dumps(item))))))
        return replies

    monkeypatch.setattr("armcontour.core.pool.map_in_processes", send)
    monkeypatch.setattr(shaper, "MANY_CONTOURS", 2)


def test_shaping_in_other_processes_gives_the_same_paths(arm, limits, pickled, monkeypatch):
    program = ac.Program(moves=(square(0.2), square(0.3)))
    steps = []
    there = shape(
        program, arm, limits, ac.Shaped(tolerance=1e-3, iterations=2), progress=steps.append
    )
    monkeypatch.setattr(shaper, "MANY_CONTOURS", 3)
    local = shape(
        program, arm, limits, ac.Shaped(tolerance=1e-3, iterations=2), progress=steps.append
    )
    for a, b in zip(there.contours, local.contours, strict=True):
        assert np.array_equal(a.path.breaks, b.path.breaks)
        assert a.path.outcome.durations == b.path.outcome.durations
    done = [x.done for x in steps if x.names == ("shaping",)]
    # By contours in other processes, by iterations here.
    assert done[:3] == [0, 0.5, 1]
    assert done[3:] == sorted(done[3:]) and len(done) > 7 and done[-1] == 1


def test_errors_of_other_processes_name_the_contour(arm, limits, pickled, monkeypatch):
    def fail(objective, tube, timer, wishes):
        raise ac.NotRealizable("No motion.", s=0.5)

    monkeypatch.setattr(shaper, "make_searches", fail)
    program = ac.Program(moves=(square(0.2), square(0.3)))
    with pytest.raises(ac.NotRealizable, match="contour 1.*No motion") as error:
        shape(program, arm, limits, ac.Shaped(tolerance=1e-3))
    assert error.value.s == 0.5


@pytest.fixture(scope="module")
def program():
    """Rows that rest keeps, so that there is a solution with nodes that stay."""
    rng = np.random.default_rng(1)
    n = 30
    k = 2
    rows = rng.normal(size=(n, 8, 3 * k))
    return rng.normal(size=(n, k)), rows, rng.uniform(0.1, 1.0, (n, 8)), np.full((n, k), 0.1)


def test_a_long_path_shaped_in_parts_is_about_as_fast_as_in_one_part(arm, limits, monkeypatch):
    corners = np.stack([np.linspace(0.15, 0.35, 9), 0.22 + 0.02 * (-1.0) ** np.arange(9)], axis=1)
    options = {"tolerance": 2e-3}
    path = ac.Path.polyline(corners)
    problem = Problem(seed=0, kind="", objective=path, arm=arm, limits=limits, options=options)

    def plan():
        more = {"iterations": 12, "intervals": 1000}
        return ac.plan(path, arm, limits, ac.Shaped(**options, **more))

    whole = plan()
    monkeypatch.setattr(shape_search, "MANY_CORNERS", 4)
    monkeypatch.setattr(shape_search, "CHUNKED", 4)
    monkeypatch.setattr(shape_search, "CORNERS", 4)
    parts = plan()
    assert parts.duration < 1.005 * whole.duration
    history = parts.path.outcome.history
    assert (np.diff(history) <= 0).all() and len(history) > 5
    assert judge(parts, problem) == []


LINES = [(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)]


def test_wrong_options_are_refused(arm, limits, refuses):
    for wrong, data in (
        *(({"tolerance": x}, {}) for x in (-1e-3, math.nan)),
        *(({"iterations": x}, {}) for x in (-1, 2.5)),
    ):
        options = {"tolerance": 1e-3, **wrong}
        refuses(functools.partial(ac.Shaped, **options), ac.InvalidInput, **data)
    refuses(ac.Shaped, ac.InvalidInput, "tolerance")
    refuses(lambda: ac.Shaped(tolerance=1e-3, duration=9.0), ac.InvalidInput, "duration")
    path = ac.Path.polyline(LINES)
    for traced in (ac.trace(path, arm), trace_program(ac.Program.from_path(path), arm, limits)):
        plan_traced = functools.partial(ac.plan, traced, arm, limits, ac.Shaped(tolerance=1e-3))
        refuses(plan_traced, ac.InvalidInput)
    refuses(lambda: ac.shape(path, arm, limits, ac.Optimal()), ac.InvalidInput, "Shaped")
