"""A model of the first three axes of a real robot."""

from pathlib import Path

import armcontour as ac
from armcontour.identification import Log
from armcontour.io.log_file import read_log

KR300 = Path(__file__).parents[2] / "identification" / "kuka_kr300"


def test_a_real_robot_is_predicted():
    """KUKA KR300, axes 1 to 3: program B from program A, both multisines (see its LICENSE).

    Bounds are RMS errors about the mean that were found, in mrad, and 20 % more.
    """
    logs = [
        Log(t=x.t, command=x.command[:, :3], measured=x.measured[:, :3], source=x.source)
        for x in (read_log(KR300 / "A.csv"), read_log(KR300 / "B.csv"))
    ]
    found = ac.identify(logs)
    for log, bounds in zip(logs, ((0.7, 2.4, 1.8), (0.5, 2.0, 2.2)), strict=True):
        predicted = found.predict(log)
        assert (predicted.rms * 1e3 < bounds).all()
        assert (predicted.explained[[0, 2]] > 0.6).all()
    # Nothing is called determined while another parameter is at the edge of the search.
    for joint in found.joints:
        assert not any(x.determined for x in joint.estimates)
