"""Errors over time: weighted by time, cut and prolonged."""

import numpy as np
import pytest

from armcontour.evaluation import ErrorProfile

T = np.array([0.0, 1.0, 1.5, 4.0])
VALUES = np.array([0.0, 2.0, 2.0, 1.0])
S = np.array([0.0, 0.1, 0.2, 0.3])


def test_by_hand_until_a_time_later_earlier_or_of_a_sample():
    found = ErrorProfile.over_time(T, VALUES, S, 4.0)
    # Trapezoids of the squares 0, 4, 4, 1.
    assert found.rms == pytest.approx(np.sqrt((2.0 + 2.0 + 6.25) / 4))
    assert (found.max, found.t_max, found.s_max) == (2.0, 1.0, 0.1)
    found = ErrorProfile.over_time(T, VALUES, S, 10.0)
    assert found.rms == pytest.approx(np.sqrt((2.0 + 2.0 + 6.25 + 6.0) / 10))
    np.testing.assert_array_equal(found.t, [0, 1, 1.5, 4, 10])
    np.testing.assert_array_equal(found.values, [0, 2, 2, 1, 1])
    assert found.s[-1] == 0.3
    found = ErrorProfile.over_time(T, VALUES, S, 0.5)
    np.testing.assert_array_equal(found.t, [0, 0.5])
    np.testing.assert_allclose(found.values, [0, 1])
    np.testing.assert_allclose(found.s, [0, 0.05])
    assert (found.max, found.t_max) == (1.0, 0.5)
    assert found.rms == pytest.approx(np.sqrt(0.5))
    found = ErrorProfile.over_time(T, VALUES, S, 1.5)
    np.testing.assert_array_equal(found.t, [0, 1, 1.5])


def test_time_counts_not_samples_and_a_profile_may_be_one_value():
    dense = np.unique(np.concatenate([np.linspace(0, 1, 1001), [4.0]]))
    found = ErrorProfile.over_time(dense, (dense > 1).astype(float) * 3.0, dense, 4.0)
    # 1001 samples of zero weigh one second, two samples weigh three.
    assert found.rms == pytest.approx(np.sqrt(9 * 3 / 2 / 4), rel=1e-12)
    found = ErrorProfile.over_time(T + 1.0, VALUES + 3.0, S, 0.999)
    assert (found.rms, found.max, found.t_max) == (3.0, 3.0, 0.999)
    whole = ErrorProfile.over_time(T, VALUES, S, 4.0)
    assert ErrorProfile.join([found, whole]).rms == whole.rms
    assert ErrorProfile.join([found, found]).rms == 3.0
