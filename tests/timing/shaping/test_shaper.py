"""Programs of many contours, which other processes shape."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.shaping import shape, shaper


def square(x: float) -> ac.Contour:
    corners = np.array([(0.0, 0.0), (0.02, 0.0), (0.02, 0.02), (0.0, 0.02)])
    return ac.Contour(path=ac.Path.polyline(corners + (x, 0.2)))


@pytest.fixture
def pickled(monkeypatch):
    """Contours are shaped as in other processes, from two on."""

    def send(work, items, done):
        found = []
        for i, item in enumerate(items):
            done(i)
            found.append(pickle.loads(pickle.dumps(work(pickle.loads(pickle.dumps(item))))))
        return found

    monkeypatch.setattr(shaper, "map_in_processes", send)
    monkeypatch.setattr(shaper, "MANY", 2)


def test_other_processes_shape_the_same(arm, limits, pickled, monkeypatch):
    program = ac.Program(moves=(square(0.2), square(0.3)))
    steps = []
    there = shape(program, arm, limits, tolerance=1e-3, iterations=2, progress=steps.append)
    monkeypatch.setattr(shaper, "MANY", 3)
    here = shape(program, arm, limits, tolerance=1e-3, iterations=2, progress=steps.append)
    for a, b in zip(there.contours, here.contours, strict=True):
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
        shape(program, arm, limits, tolerance=1e-3)
    assert error.value.s == 0.5
