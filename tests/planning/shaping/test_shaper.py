"""Shaped programs before an independent judge, in space too, and what cannot be shaped."""

import functools
import math
import pickle

import numpy as np
import pytest
from soak.shaping import Problem, judge

import armcontour as ac
from armcontour.planning import trace_program
from armcontour.planning.shaping import search, shape, shaper


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


def test_other_processes_shape_the_same(arm, limits, pickled, monkeypatch):
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


CUTS = np.array([10, 20])


@pytest.fixture(scope="module")
def program():
    """Rows that rest keeps, so that there is a solution with nodes that stay."""
    rng = np.random.default_rng(1)
    n, k = 30, 2
    rows = rng.normal(size=(n, 8, 3 * k))
    return rng.normal(size=(n, k)), rows, rng.uniform(0.1, 1.0, (n, 8)), np.full((n, k), 0.1)


def test_chunks_keep_rows_and_the_number_of_threads_changes_nothing(program):
    x = search.solve_in_chunks(*program, CUTS)
    assert np.abs(x[[10, 11, 20, 21]]).max() < 1e-12
    assert np.abs(np.delete(x, [10, 11, 20, 21], axis=0)).max(axis=1).min() > 1e-3
    beyond = np.pad(x, ((1, 1), (0, 0)))
    around = np.concatenate([beyond[:-2], beyond[1:-1], beyond[2:]], axis=1)
    assert float((np.einsum("nrj,nj->nr", program[1], around) - program[2]).max()) < 1e-6
    solutions = [search.solve_in_chunks(*program, CUTS, threads=x) for x in (1, 2, 5)]
    assert np.array_equal(solutions[0], solutions[1]) and np.array_equal(solutions[0], solutions[2])


def test_a_long_path_is_about_as_fast_as_in_one_piece(arm, limits, monkeypatch):
    corners = np.stack([np.linspace(0.15, 0.35, 9), 0.22 + 0.02 * (-1.0) ** np.arange(9)], axis=1)
    options = {"tolerance": 2e-3}
    path = ac.Path.polyline(corners)
    problem = Problem(seed=0, kind="", objective=path, arm=arm, limits=limits, options=options)

    def plan():
        more = {"iterations": 12, "intervals": 1000}
        return ac.plan(path, arm, limits, ac.Shaped(**options, **more))

    whole = plan()
    monkeypatch.setattr(search, "LONG_PATH", 4)
    monkeypatch.setattr(search, "CORNERS", 4)
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


def test_corners_of_a_short_segment_use_half_of_its_length(arm, limits):
    # A vertex that was drawn twice does not keep the rest from being shaped.
    for gap in (2e-6, 2e-4):
        twice = ac.Path.polyline([*LINES[:2], (LINES[1][0] + gap, LINES[1][1]), *LINES[2:]])
        shaped = ac.shape(twice, arm, limits, ac.Shaped(tolerance=1e-3, iterations=8))
        durations = dict(shaped.outcome.durations)
        assert durations.pop("shaped") < min(durations.values()), gap
        distances = shaped.objective.project(shaped(np.linspace(0, shaped.length, 20_001))).distance
        assert distances.max() < 1e-3 + 1e-9
        near = shaped.project(twice(twice.breaks[1:3])).distance
        assert (near <= gap / 2 + 1e-9).all(), gap


def test_the_tolerance_of_a_contour_depends_on_its_lines_and_not_on_chords_of_curves(arm, limits):
    short = ac.Path.polyline([(0.2, 0.2), (0.201, 0.2), (0.201, 0.21)])
    program = ac.Program(
        moves=(ac.Contour(path=ac.Path.polyline(LINES)), ac.Contour(path=short, name="notch"))
    )
    shaped = ac.shape(program, arm, limits, ac.Shaped(tolerance=2e-3, iterations=3))
    distances = shaped.contours[1].path.project(short(short.breaks)).distance
    assert distances[1] <= 0.5e-3 + 1e-9
    angle = np.linspace(0, np.pi, 200)
    chords = np.stack([0.3 + 0.02 * np.cos(angle), 0.2 + 0.02 * np.sin(angle)], axis=1)
    shaped = ac.shape(
        ac.Path.polyline(chords), arm, limits, ac.Shaped(tolerance=1e-3, iterations=0)
    )
    assert shaped.outcome.durations["shaped"] <= min(shaped.outcome.durations.values())


@pytest.mark.parametrize("tolerance", [1e-7, 1e-9])
def test_a_tiny_tolerance_ends_the_search_early_with_a_warning(arm, limits, tolerance):
    objective = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30), (0.35, 0.35)])
    with pytest.warns(UserWarning) as caught:
        path = ac.shape(objective, arm, limits, ac.Shaped(tolerance=tolerance))
        ac.plan(objective, arm, limits, ac.Shaped(tolerance=tolerance))
    assert [x.filename for x in caught] == [__file__, __file__]
    assert path.outcome.unfinished
    assert path.outcome.durations["shaped"] <= min(path.outcome.durations.values())
    s = np.linspace(0, path.length, 2001)
    places = path.objective(np.interp(s, path.places[:, 1], path.places[:, 0]))
    assert np.linalg.norm(path(s) - places, axis=1).max() <= tolerance * (1 + 1e-6)
    assert not ac.check(ac.plan(path, arm, limits), arm, limits).violated
