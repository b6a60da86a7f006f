"""Grids of the planner: where their points lie."""

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.motion import JointPath
from armcontour.timing.grid import AT_REST, EVEN_SHARE, finer_at_rests, place_grid

# Two joints that turn by different amounts on pieces of different lengths.
CURVE = JointPath.spline([[0.0, 0.0], [0.3, 0.2], [0.35, 0.6], [1.0, 0.5], [1.1, 0.9]])


def test_pieces_have_shares_by_their_length_and_by_how_much_they_turn():
    breaks, pieces = CURVE.breaks, np.arange(len(CURVE.breaks) - 1)
    places = np.stack([breaks[:-1], (breaks[:-1] + breaks[1:]) / 2, breaks[1:]])
    _, first, second = CURVE.motion(np.broadcast_to(pieces, places.shape), places)
    size = np.linalg.norm(first, axis=2)
    assert (size > AT_REST * size.max()).all()
    turn = np.diff(breaks) * (np.linalg.norm(second, axis=2) / size).mean(axis=0)
    share = EVEN_SHARE * np.diff(breaks) / breaks[-1] + (1 - EVEN_SHARE) * turn / turn.sum()
    grid = place_grid(CURVE, 1000)
    assert np.abs(np.bincount(grid.piece) - 1000 * share).max() <= 0.5 + 1e-9
    assert np.array_equal(np.unique(grid.piece), pieces)
    assert set(breaks) <= set(grid.s)
    for k in pieces:
        assert grid.width[grid.piece == k] == pytest.approx(grid.width[grid.piece == k][0])


def test_intervals_are_finer_the_nearer_they_are_to_a_rest_of_a_joint_that_moves():
    grid = place_grid(CURVE, 4000)
    at = [0, 1700, len(grid)]
    found = finer_at_rests(grid, grid.s[at])
    count = np.bincount(np.searchsorted(grid.s, found.s[:-1], side="right") - 1)
    away = np.min([[i - a if i >= a else a - 1 - i for i in range(len(grid))] for a in at], axis=0)
    # 8 x 8 parts next to a rest, 8 for the one after it, fewer farther away, down to none.
    assert (count[away == 0] == 64).all() and (count[away == 1] == 8).all()
    assert np.array_equal(count[away > 0], np.ceil(8 / np.sqrt(away[away > 0])))
    for places in (np.empty(0), CURVE.breaks.repeat(100)):
        assert finer_at_rests(grid, places) is grid
    still = JointPath(breaks=np.array([0.0, 1.0]), coefficients=np.zeros((1, 6, 2)))
    with pytest.raises(InvalidInput, match="No joint moves along the joint path"):
        place_grid(still)
