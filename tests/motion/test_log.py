"""What a log must be, and how a bad one is refused."""

from __future__ import annotations

import numpy as np
import pytest

from armcontour.errors import InvalidInput
from armcontour.motion.log import Log, cut

T = np.arange(100) * 1e-3
U = np.sin(T)


def _log(**changes):
    return Log(**({"t": T, "command": U, "measured": U} | changes))


def test_arrays_are_copied_and_locked():
    log = _log()
    assert log.command.shape == (100, 1)
    assert not log.t.flags.writeable
    assert log.joint_names == ("joint 1",)
    assert log.dof == 1
    assert log.interval == pytest.approx(1e-3)


def test_a_part_of_a_log():
    part = _log().between(0.02, 0.08)
    assert part.t[0] == pytest.approx(0.02)
    assert part.t[-1] == pytest.approx(0.08)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"t": T[:20], "command": U[:20], "measured": U[:20]}, ["20 samples", "record more"]),
        ({"t": T[::-1]}, ["must increase", "sample 2"]),
        ({"command": np.zeros((100, 2))}, ["2 joints", "of 1"]),
        ({"measured": U[:-1]}, ["shape", "100 times"]),
        ({"measured": np.where(T > 0.05, np.nan, U)}, ["measured", "finite"]),
        ({"joint_names": ("a", "b")}, ["1 different joint names"]),
        ({"interpolation": "cubic"}, ["interpolation"]),
        ({"measured": np.mod(U + 6.25, 2 * np.pi)}, ["measured", "wrapped", "unwrap it"]),
        ({"command": np.mod(U + 6.25, 2 * np.pi)}, ["command", "wrapped"]),
    ],
)
def test_refusals(refuses, changes, words):
    refuses(lambda: _log(**changes), InvalidInput, *words)


def test_angles_are_unwrapped_on_demand_and_end_in_the_same_turn():
    wrapped = np.mod(U + 6.25, 2 * np.pi)
    log = cut(T, U[:, None], wrapped[:, None], -np.inf, np.inf, unwrap=True)
    np.testing.assert_allclose(log.measured - log.command, 6.25 - 2 * np.pi)
