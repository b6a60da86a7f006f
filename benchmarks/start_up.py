"""Start `armcontour --help`, against importing numba and scipy.interpolate."""

from __future__ import annotations

import sys

from benchmarks.measured import Bar, Line, Pair, spawned


def lines() -> list[Line]:
    """Return the lines for whole processes, with their files in the system's cache."""
    return [
        Line("help", "armcontour --help", "import numba, scipy", _prepare, Bar(ratio=0.25)),
    ]


def _prepare() -> Pair:
    ours = [sys.executable, "-m", "armcontour", "--help"]
    peer = [sys.executable, "-c", "import numba, scipy.interpolate"]
    return Pair(spawned(lambda: ours), spawned(lambda: peer))
