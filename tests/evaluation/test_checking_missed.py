"""The other direction of a check: places of the path that the tool does not reach."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac

ERROR = 5e-3
LIMITS = ac.Limits(speed=0.15, joint_acceleration=0.72)


@pytest.fixture(scope="module")
def rounded_motion(arm, objective):
    return ac.plan(ac.round_corners(objective, tolerance=ERROR), arm, LIMITS)


def test_a_rounded_corner_is_missed_by_its_corner_error(arm, objective, rounded_motion):
    # The middles of the arcs are nearer to the lines than to the corners, so the tool alone is
    # within less than the corner error.
    check = partial(ac.check, arm=arm, limits=LIMITS, path=objective)
    found = check(rounded_motion, deviation=4e-3, missed=ERROR)
    assert found.verdict == "kept"
    missed = found["path_missed"]
    assert missed.value == pytest.approx(ERROR, rel=1e-6)
    assert np.abs(objective.breaks[1:3] - missed.s).min() < 1.1 * ERROR
    (use,) = check(rounded_motion, missed=0.99 * ERROR).violations
    assert use.name == "path_missed"
    # Its own path misses nothing.
    own = ac.check(rounded_motion, arm, LIMITS, rounded_motion.path, missed=1e-6)
    assert own.verdict == "kept"
    # Samples are judged as laws are.
    found = check(rounded_motion.sample(4e-3), missed=1.001 * ERROR)
    assert found["path_missed"].value == pytest.approx(ERROR, rel=1e-3) and not found.violated
    assert check(rounded_motion.sample(4e-3), missed=0.9 * ERROR).violated


def test_a_tip_that_is_left_out_by_hand(arm):
    """Out and back along a line, but only to 3 mm before its end."""
    path = ac.Path.polyline([[0.30, 0.20], [0.36, 0.20], [0.30, 0.20]])
    x = np.concatenate([np.linspace(0.30, 0.357, 200), np.linspace(0.357, 0.30, 200)[1:]])
    q = arm.inverse(np.stack([x, np.full_like(x, 0.20)], axis=1))
    log = SimpleNamespace(t=np.linspace(0.0, 4.0, len(x)), q=q)
    found = ac.check(log, arm, ac.Limits(), path, deviation=1e-6, missed=2e-3)
    assert found.path_deviation is not None and found.path_deviation.distance < 1e-9
    assert found["path_missed"].value == pytest.approx(3e-3, rel=1e-9)
    assert found.verdict == "violated"


def test_a_program_counts_all_of_its_contours(arm):
    corner = [[0.30, 0.20], [0.36, 0.20], [0.36, 0.26]]
    other = [[0.30, 0.26], [0.33, 0.26], [0.33, 0.29]]
    moves = [ac.Contour(path=ac.Path.polyline(x)) for x in (corner, other)]
    objective = ac.Program(moves=(moves[0], ac.Rapid(), moves[1]))
    motion = ac.plan(ac.round_corners(objective, tolerance=1e-3), arm, LIMITS)
    found = ac.check(motion, arm, LIMITS, objective, missed=1e-3)
    assert found.verdict == "kept"
    assert found["path_missed"].value == pytest.approx(1e-3, rel=1e-6)
