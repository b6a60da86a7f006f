"""Points near other points, by both ways to find them."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from armcontour.io.drawings import _neighbours
from armcontour.io.drawings._neighbours import join_pairs, nearest_few, pairs_within


@pytest.mark.parametrize("few", [0, 1000])
def test_pairs_within_a_distance_are_all_such_pairs(few, monkeypatch):
    monkeypatch.setattr(_neighbours, "FEW", few)
    points = np.random.default_rng(0).uniform(size=(200, 3))
    found = {tuple(sorted(x)) for x in pairs_within(points, 0.15).tolist()}
    wanted = {
        (i, j)
        for i in range(200)
        for j in range(i + 1, 200)
        if np.linalg.norm(points[i] - points[j]) <= 0.15
    }
    assert found == wanted and len(wanted) > 50


@pytest.mark.parametrize("few", [0, 1000])
@pytest.mark.parametrize(("count", "among"), [(4, 150), (1, 150), (9, 3), (9, 0)])
def test_the_nearest_points_are_those_within_the_distance(few, count, among, monkeypatch):
    monkeypatch.setattr(_neighbours, "FEW", few)
    rng = np.random.default_rng(1)
    points, queries = rng.uniform(size=(among, 2)), rng.uniform(size=(40, 2))
    if among == 0:
        queries = queries[:0]
    of, found = nearest_few(points, queries, count, 0.2)
    for i, x in enumerate(queries):
        apart = np.linalg.norm(points - x, axis=1)
        wanted = [k for k in np.argsort(apart)[:count] if apart[k] < 0.2]
        assert found[of == i].tolist() == wanted


def test_things_are_joined_through_any_number_of_pairs():
    rng = np.random.default_rng(2)
    order = rng.permutation(500)
    # Three chains: 300, 150 and 50 things.
    groups = np.split(order, [300, 450])
    pairs = np.concatenate([np.column_stack([x[:-1], x[1:]]) for x in groups])
    pairs = rng.permuted(pairs[rng.permutation(len(pairs))], axis=1)
    found = join_pairs(pairs, 502)
    for group in groups:
        assert (found[group] == group.min()).all()
    assert found[500:].tolist() == [500, 501]


def test_small_drawings_are_read_without_scipy(tmp_path):
    drawing = tmp_path / "part.svg"
    lines = "".join(f'<path d="M {k} 0 h 1"/>' for k in range(5))
    drawing.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">{lines}</svg>')
    code = (
        "import sys\n"
        "from armcontour.io.drawings.read import read_path\n"
        f"found = read_path({str(drawing)!r})\n"
        "assert len(found.contours) == 1, found\n"
        "assert 'scipy.spatial' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
