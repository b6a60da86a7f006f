"""Dead time by more seeds and amounts of noise."""

import pytest
from tests.learning.test_aligning import TRUE, found, taught  # noqa: F401


@pytest.mark.parametrize("noise", [1e-5, 1e-4])
def test_friction_and_noise_are_no_dead_time(arm, taught, noise):  # noqa: F811
    for seed in range(3):
        assert abs(found(arm, taught, 0.0, noise, seed, **TRUE)) < 0.3e-3


@pytest.mark.parametrize("noise", [0.0, 1e-5])
def test_dead_time_is_found(arm, taught, noise):  # noqa: F811
    assert found(arm, taught, 5e-3, noise, **TRUE) == pytest.approx(5e-3, abs=1.5e-3)
