"""Find nearest points: 100,000 queries on 10,000 segments, against one vectorised distance."""

from __future__ import annotations

from functools import partial

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from benchmarks.measured import Bar, Line, Pair, timed

SEGMENTS = 10_000
QUERIES = 100_000


def lines() -> list[Line]:
    """Return the lines for three paths: a spiral, a random walk, and chords across a square."""
    peer = "one segment, numpy"
    # Boxes of chords overlap everywhere, so that they exclude fewer segments.
    bars = {"spiral": 40, "random walk": 40, "random chords": 55}
    return [
        Line(
            f"project/{name.split()[-1]}",
            f"project on {name}",
            peer,
            partial(_pair, name),
            Bar(ratio=bar),
        )
        for name, bar in bars.items()
    ]


def _pair(name: str) -> Pair:
    path = ac.Path.polyline(_points(name))
    queries = np.random.default_rng(1).random((QUERIES, 2))

    def peer() -> object:
        offset = queries - path.starts[0]
        along = np.clip(offset @ path.tangents[0], 0, path.lengths[0])
        return np.sqrt(((offset - along[:, None] * path.tangents[0]) ** 2).sum(axis=1))

    return Pair(timed(lambda: path.project(queries)), timed(peer))


def _points(name: str) -> FloatArray:
    rng = np.random.default_rng(0)
    if name == "spiral":
        turn = np.linspace(0, 20 * np.pi, SEGMENTS + 1)
        around = np.column_stack([turn * np.cos(turn), turn * np.sin(turn)])
        return np.asarray(around / (40 * np.pi) + 0.5)
    if name == "random walk":
        return np.asarray(np.cumsum(rng.normal(size=(SEGMENTS + 1, 2)), axis=0) * 5e-3)
    return rng.random((SEGMENTS + 1, 2))
