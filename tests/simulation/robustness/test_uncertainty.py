"""Boxes of errors."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.simulation.robustness import Uncertainty


def test_the_payload_is_a_range():
    np.testing.assert_array_equal(Uncertainty(payload=0.4).payload, [-0.4, 0.4])
    np.testing.assert_array_equal(Uncertainty(payload=[0.0, 2.0]).payload, [0.0, 2.0])
    described = str(Uncertainty(gains=0.1, payload=[0.0, 2.0], jitter=1e-4))
    for words in (
        "gains ±10.00 % (independent for each joint)",
        "payload 0 to 2 kg",
        "jitter ±0.1 ms",
    ):
        assert words in described


@pytest.mark.parametrize(
    "wrong",
    [
        *({"payload": x} for x in ([2.0, 0.0], [0.0, 1.0, 2.0], -1.0)),
        *({"gains": x} for x in (-0.1, 1.0)),
        {"dead_time": -1e-3},
    ],
)
def test_refusals(wrong):
    with pytest.raises(ac.InvalidInput):
        Uncertainty(**wrong)
