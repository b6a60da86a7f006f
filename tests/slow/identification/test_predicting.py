"""A model of six axes of a real robot."""

from pathlib import Path

import numpy as np

import armcontour as ac
from armcontour.io.log_file import read_log

KR300 = Path(__file__).parents[2] / "identification" / "kuka_kr300"


def test_a_real_robot_is_predicted_or_refused():
    """KUKA KR300, programs A and B, both multisines (see its LICENSE)."""
    a, b = read_log(KR300 / "A.csv"), read_log(KR300 / "B.csv")
    both = ac.identify([a, b])
    written = np.array([x.written for x in both.joints])
    assert written[[0, 3]].all()
    # Gravity is not modelled.
    assert not written[1]
    for log in (a, b):
        found = both.predict(log)
        assert (found.rms <= 0.3 * found.tracking_rms)[written].all()
    # From one program: never worse than no model on the other one.
    found = ac.identify(a).predict(b)
    assert (found.rms <= found.tracking_rms * (1 + 1e-9)).all()
