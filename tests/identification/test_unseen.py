"""Logs that are samples of a command: between them nothing is known; intervals allow for that."""

import numpy as np
from soak.identification import sampled

from armcontour.identification import identify
from armcontour.identification.unseen import BENT, sharpened


def _held(log, truth):
    """Which of the intervals of kp, kv and dead time hold the truth."""
    found = identify(log).joints[0].estimates
    return [x.low <= y <= x.high for x, y in zip(found, truth, strict=False)]


def test_intervals_hold_the_truth_where_bends_are_between_samples():
    # `python -m soak identification` has the full bar. Taken for set-points, none held the truth.
    assert all(_held(*sampled("multisine", "cubic", 1, 0.5, 1)))
    assert not any(_held(*sampled("multisine", "cubic", 1, 0.5, 1, set_points=True)))
    # A held command is seen late.
    assert all(_held(*sampled("multisine", "step", 2, 0.5, 1)))


def test_set_points_leave_nothing_open():
    log, truth = sampled("multisine", "linear", 1, 0.0, 1, set_points=True)
    (joint,) = identify(log).joints
    assert all(x.low <= y <= x.high for x, y in zip(joint.estimates, truth, strict=False))
    assert joint.kv.determined
    (open_one,) = identify(sampled("multisine", "linear", 1, 0.0, 1)[0]).joints
    assert not open_one.kv.determined and "8 ms apart" in open_one.kv.advice
    assert open_one.kv.value == joint.kv.value and open_one.kv.sd > 2 * joint.kv.sd


def test_samples_in_the_middle_of_set_points_become_these():
    t = np.arange(400) * 8e-3
    for frequency in (1.0, 10.0, 20.0):
        u = np.sin(2 * np.pi * frequency * t)
        wanted = u / np.cos(np.pi * frequency * 8e-3)
        error = np.abs(sharpened(u, BENT) - wanted)[5:-5].max()
        assert error < 0.2 * np.abs(wanted - u).max()
