"""Nearest points: 100,000 queries on 10,000 segments against one vectorised distance."""

from __future__ import annotations

import numpy as np

import armcontour as ac
from benchmarks.measured import Measured, paired

SEGMENTS = 10_000
QUERIES = 100_000


def measure() -> list[Measured]:
    """Three paths: a spiral, a random walk, and chords thrown across the whole square."""
    rng = np.random.default_rng(0)
    turn = np.linspace(0, 20 * np.pi, SEGMENTS + 1)
    spiral = np.column_stack([turn * np.cos(turn), turn * np.sin(turn)]) / (40 * np.pi) + 0.5
    paths = {
        "spiral": spiral,
        "random walk": np.cumsum(rng.normal(size=(SEGMENTS + 1, 2)), axis=0) * 5e-3,
        "random chords": rng.random((SEGMENTS + 1, 2)),
    }
    queries = rng.random((QUERIES, 2))
    found = []
    for name, points in paths.items():
        path = ac.Path.polyline(points)

        def ours(path: ac.Path = path) -> object:
            return path.project(queries)

        def peer(path: ac.Path = path) -> object:
            offset = queries - path.starts[0]
            along = np.clip(offset @ path.tangents[0], 0, path.lengths[0])
            return np.sqrt(((offset - along[:, None] * path.tangents[0]) ** 2).sum(axis=1))

        times = paired(ours, peer, 7)
        found.append(
            Measured(f"project on {name}", times[0], "one segment, numpy", times[1], "< 40")
        )
    return found
