"""What is wrong with columns is told, and nothing where nothing is wrong."""

import numpy as np
import pytest

from armcontour.motion.misreading import find_misreading

T = np.arange(4000) * 2e-3
WANTED = np.stack(
    [np.sin(2 * T) + 0.4, 0.5 * np.sin(3.1 * T + 1) - 1.0, 0.3 * np.cos(1.3 * T) + 2.0], axis=1
)
CHANGES = {
    "in the order b, a, c,": lambda q: q[:, [1, 0, 2]],
    "of b have opposite signs": lambda q: q * [1, -1, 1],
    "measured positions look like degrees": np.degrees,
    "look like radians, but those they belong to like degrees": np.radians,
}


def _follow(u, lag=0.05, delay=0.02):
    late = np.stack([np.interp(T - delay, T, x) for x in u.T], axis=1)
    found = np.array(late)
    for i in range(len(T) - 1):
        found[i + 1] += np.exp(-2e-3 / lag) * (found[i] - late[i + 1])
    return found


@pytest.mark.parametrize("late", [None, 0.25])
def test_what_is_wrong(late):
    q = WANTED if late is None else _follow(WANTED) + [0.01, 0.0, -0.02]
    for words, change in CHANGES.items():
        assert words in find_misreading(T, change(q), WANTED, names="abc", late=late)
    for right in (q, np.roll(q[::-1], 777, axis=0) ** 3):
        assert not find_misreading(T, right, WANTED, names="abc", late=late)


def test_exchanged_columns_are_found_and_delays_are_no_turned_signs():
    q = _follow(WANTED)
    assert "are exchanged" in find_misreading(T, WANTED, q, late=0.25)
    assert not find_misreading(T, WANTED, q)
    u = np.sin(2 * np.pi * 2.0 * T)[:, None]
    late = np.interp(T - 0.25, T, u[:, 0])[:, None]
    assert not find_misreading(T, late, u, late=0.25)
