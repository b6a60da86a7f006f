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
from armcontour.planning.shaping.quadratic_program import solve_program


def square(x):
    corners = np.array([(0.0, 0.0), (0.02, 0.0), (0.02, 0.02), (0.0, 0.02)])
    return ac.Contour(path=ac.Path.polyline(corners + (x, 0.2)))


@pytest.fixture
def pickled(monkeypatch):
    """Two or more contours are shaped as in worker processes: all data is pickled."""

    def send(work, items, done):
        replies = []
        for i, item in enumerate(items):
            done(i)
            replies.append(pickle.loads(pickle.dumps(work(pickle.loads(pickle.dumps(item))))))
        return replies

    monkeypatch.setattr("armcontour.core.pool.map_in_processes", send)
    monkeypatch.setattr(shaper, "MANY_CONTOURS", 2)


def shape_two_squares(arm, limits):
    """Shape a program of two squares; return the program and the steps of the progress."""
    program = ac.Program(moves=(square(0.2), square(0.3)))
    options = ac.Shaped(tolerance=1e-3, iterations=2)
    steps = []
    shaped = shape(program, arm, limits, options, progress=steps.append)
    return shaped, [step.done for step in steps if step.names == ("shaping",)]


def test_shaping_in_worker_processes_gives_the_same_paths(arm, limits, pickled, monkeypatch):
    by_workers, progress_by_contour = shape_two_squares(arm, limits)
    monkeypatch.setattr(shaper, "MANY_CONTOURS", 3)
    in_this_process, progress_by_iteration = shape_two_squares(arm, limits)
    for a, b in zip(by_workers.contours, in_this_process.contours, strict=True):
        assert np.array_equal(a.path.breaks, b.path.breaks)
        assert a.path.outcome.durations == b.path.outcome.durations
    assert progress_by_contour == [0, 0.5, 1]
    assert progress_by_iteration == sorted(progress_by_iteration)
    assert len(progress_by_iteration) > 4 and progress_by_iteration[-1] == 1


def test_errors_of_worker_processes_name_the_contour(arm, limits, pickled, monkeypatch):
    def fail(objective, tube, timer, wishes):
        raise ac.NotRealizable("No motion.", s=0.5)

    monkeypatch.setattr(shaper, "make_searches", fail)
    program = ac.Program(moves=(square(0.2), square(0.3)))
    with pytest.raises(ac.NotRealizable, match="contour 1.*No motion") as error:
        shape(program, arm, limits, ac.Shaped(tolerance=1e-3))
    assert error.value.s == 0.5


def zigzag(corners):
    x = np.linspace(0.15, 0.35, corners + 2)
    return ac.Path.polyline(np.stack([x, 0.22 + 0.02 * (-1.0) ** np.arange(corners + 2)], axis=1))


def test_each_corner_of_a_long_path_is_shaped_until_it_has_converged(arm, limits, monkeypatch):
    path = zigzag(14)
    options = {"tolerance": 1e-3}
    problem = Problem(seed=0, kind="", objective=path, arm=arm, limits=limits, options=options)
    sizes = []

    def count(cost, *program):
        sizes.append(len(cost))
        return solve_program(cost, *program)

    monkeypatch.setattr(shape_search, "solve_program", count)
    planned = ac.plan(path, arm, limits, ac.Shaped(**options))
    history = planned.path.outcome.history
    assert (np.diff(history) <= 0).all() and len(history) > 5
    assert judge(planned, problem) == []
    assert planned.duration < 0.98 * planned.path.outcome.durations["parabolas"]
    # The first programs contain all nodes, later ones only those near corners that still improve.
    assert min(sizes) < 0.7 * max(sizes)
    assert sizes[0] == max(sizes)


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
