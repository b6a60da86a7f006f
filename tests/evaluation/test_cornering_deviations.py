"""Cornering deviations after ISO 9283 on tool motions made by hand."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.evaluation.cornering_deviations import corner_deviations

RIGHT_ANGLE = ac.Path.polyline([(0, 0), (1, 0), (1, 1)])


def dense(points, count=401):
    """Samples along straight lines through points."""
    path = ac.Path.polyline(points)
    return path(np.unique(np.concatenate([np.linspace(0, path.length, count), path.breaks])))


def test_corners_by_hand():
    (found,) = corner_deviations(dense([(0, 0), (1, 0), (1, 1)]), RIGHT_ANGLE)
    assert found.vertex == 1 and found.point == (1.0, 0.0)
    assert found.rounding == 0.0 and found.overshoot == 0.0
    # A chamfer from 20 mm before to 20 mm after misses the corner by 20 mm / sqrt(2).
    tool = dense([(0, 0), (0.98, 0), (1, 0.02), (1, 1)], 8001)
    (found,) = corner_deviations(tool, RIGHT_ANGLE)
    assert found.rounding == pytest.approx(0.02 / np.sqrt(2), rel=1e-3)
    assert found.overshoot == 0.0
    # 30 mm too far, back on the line 0.1 m later: beyond the leaving line, through the corner.
    tool = dense([(0, 0), (1.03, 0), (1, 0.1), (1, 1)])
    (found,) = corner_deviations(tool, RIGHT_ANGLE)
    assert found.overshoot == pytest.approx(0.03)
    assert found.rounding < 2e-3
    path = ac.Path.polyline([(0, 0, 0), (1, 0, 0), (1, 0, 1)])
    (found,) = corner_deviations(dense([(0, 0, 0), (1.01, 0, 0), (1.01, 0, 1)]), path)
    assert found.overshoot == pytest.approx(0.01)
    path = ac.Path.polyline([(0, 0), (1, 0), (0.2, 0)])
    (found,) = corner_deviations(dense([(0, 0), (1.02, 0), (0.2, 0)]), path)
    assert found.overshoot == pytest.approx(0.02)
    path = ac.round_corners(RIGHT_ANGLE, tolerance=0.01)
    assert corner_deviations(dense([(0, 0), (1, 0)]), path) == ()


def test_overshoot_is_measured_across_the_leaving_line():
    for turn in (0.5, 1.0, 2.0, 2.8, -1.2):
        leaving = np.array([np.cos(turn), np.sin(turn)])
        path = ac.Path.polyline([(-1, 0), (0, 0), tuple(leaving)])
        beyond = np.array([np.sin(turn), -np.cos(turn)]) * np.sign(turn)
        tool = np.concatenate([dense([(-1, 0), (0, 0)]), 0.1 * leaving + np.outer([0.01], beyond)])
        (found,) = corner_deviations(tool, path)
        assert found.overshoot == pytest.approx(0.01, rel=1e-9), turn


def test_every_corner_of_many_has_its_own_region():
    rng = np.random.default_rng(0)
    points = np.column_stack([np.arange(60.0), rng.normal(size=60)])
    path = ac.Path.polyline(points)
    tool = path(np.linspace(0, path.length, 9001)) + 0.02 * rng.normal(size=(9001, 2))
    s = path.project(tool).s
    found = corner_deviations(tool, path)
    assert len(found) == 58
    for x in found:
        low = path.breaks[x.vertex] - path.lengths[x.vertex - 1] / 2
        high = path.breaks[x.vertex] + path.lengths[x.vertex] / 2
        near = tool[(s >= low) & (s <= high)] - x.point
        assert x.rounding == np.linalg.norm(near, axis=1).min()
