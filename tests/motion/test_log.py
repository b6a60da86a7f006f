"""Valid logs and refused logs."""

import numpy as np

from armcontour.core.errors import InvalidInput
from armcontour.motion.log import Log

T = np.arange(100) * 1e-3
U = np.sin(T)
WRAPPED = np.mod(U + 6.25, 2 * np.pi)


def _log(**changes):
    return Log(**({"t": T, "command": U, "measured": U} | changes))


def test_a_log_can_be_cut_to_a_time_interval():
    log = _log()
    assert log.command.shape == (100, 1) and not log.t.flags.writeable
    assert log.joint_names == ("joint 1",) and log.dof == 1
    part = log.between(0.02, 0.08)
    np.testing.assert_allclose([log.interval, *part.t[[0, -1]]], [1e-3, 0.02, 0.08])


def test_invalid_logs_are_refused(refuses):
    for changes, *words in (
        ({"t": T[:20], "command": U[:20], "measured": U[:20]}, "20 samples"),
        ({"t": T[::-1]}, "sample 2"),
        ({"command": np.zeros((100, 2))}, "2 joints", "of 1"),
        ({"measured": U[:-1]}, "100 times"),
        ({"measured": np.where(T > 0.05, np.nan, U)}, "measured"),
        ({"joint_names": ("a", "b")}, "1 different joint names"),
        ({"interpolation": "cubic"},),
        ({"measured": WRAPPED}, "measured", "wrapped", "numpy.unwrap"),
        ({"command": WRAPPED}, "command", "wrapped"),
    ):
        refuses(lambda x=changes: _log(**x), InvalidInput, *words)
