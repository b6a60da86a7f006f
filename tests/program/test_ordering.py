"""Order of contours, and the first problems of the soak of programs."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import minimum_spanning_tree
from soak import outputs
from tests.geometry.tables import refused

from armcontour.geometry import Arc, Path
from armcontour.program import Contour, Event, Lead, Process, Program, prepare
from armcontour.program.contour_order import find_start_candidates

WASTE = Lead(length=1e-3, shape="arc")
SQUARE = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])


def circle(x, y, radius, name=""):
    return Contour(path=Path(segments=[Arc.circle((x + radius, y), (x, y))]), name=name)


def line(a, b, name="", **values):
    return Contour(path=Path.polyline([a, b]), name=name, **values)


def ordered(moves, **process):
    return prepare(Program(moves=tuple(moves)), Process(**process))


def names(program):
    return [x.name for x in program.contours]


def gaps(program):
    """Straight ways between the contours."""
    paths = [x.path for x in program.contours]
    return sum(float(np.linalg.norm(b(0.0) - a(a.length))) for a, b in itertools.pairwise(paths))


# --------------------------------------------------------------------------------- inside first

PARTS = (
    circle(0, 0, 0.05, "outline"),
    circle(0, 0.02, 0.02, "window"),
    circle(0.2, 0, 0.03, "second"),
    circle(0, 0.02, 0.01, "island"),
    line((-0.02, -0.02), (-0.01, -0.02), "mark"),
    circle(0.2, 0, 0.01, "hole"),
)


def test_inner_contours_come_first_part_by_part():
    for process in ({"lead_in": WASTE}, {"order": "inside_first"}):
        arranged = ordered(PARTS, **process)
        assert names(arranged) == ["island", "window", "mark", "outline", "hole", "second"]
        assert not arranged.notes
    # Only a cutting process changes the order of itself.
    straight = Lead(length=1e-3)
    arc_lead = Lead(length=1e-3, shape="arc", side="left")
    for process in ({}, {"lead_in": straight}, {"lead_in": arc_lead}):
        arranged = ordered(PARTS, **process)
        assert names(arranged) == [x.name for x in PARTS] and not arranged.notes


def test_a_warning_names_contours_that_are_cut_too_early():
    (note,) = ordered(PARTS, lead_in=WASTE, order="drawn").notes
    assert "(outline) is cut before contour " in note and "likewise 3 more" in note
    # The order of G-code has a meaning, and stays.
    moves = PARTS[0], Event(name="gas"), PARTS[1]
    arranged = ordered(moves, lead_in=WASTE)
    assert names(arranged) == ["outline", "window"] and len(arranged.notes) == 1
    assert not ordered(moves[::-1], lead_in=WASTE).notes
    orders = "inside_first", "nearest", "shortest"
    refused(*((lambda x=x: ordered(moves, order=x), x) for x in orders))


@given(order=st.sampled_from(["nearest", "shortest"]), seed=st.integers(0, 10_000))
@settings(max_examples=12)
def test_inner_contours_are_cut_first_in_any_order(order, seed):
    rng = np.random.default_rng(seed)
    contours = []
    inner = {}
    for i, center in enumerate(rng.permutation(16)[:6]):
        x = 0.1 * (center % 4)
        y = 0.1 * (center // 4)
        for k, radius in enumerate((0.04, 0.02, 0.01)[: rng.integers(1, 4)]):
            contours.append(circle(x, y, radius, f"{i}{k}"))
            inner[f"{i}{k}"] = f"{i}{k - 1}"
    moves = (contours[i] for i in rng.permutation(len(contours)))
    order_found = names(ordered(moves, lead_in=WASTE, order=order))
    assert sorted(order_found) == sorted(inner)
    for name, outer in inner.items():
        assert outer not in order_found or order_found.index(name) < order_found.index(outer)


# ------------------------------------------------------------------------------------- shortest


def test_the_start_of_a_closed_contour_shortens_the_rapid():
    rings = [circle(0.1 * i, 0, 0.04, str(i)) for i in (0, 2, 1, 3)]
    arranged = ordered(rings, order="shortest")
    assert names(arranged) in (["0", "1", "2", "3"], ["3", "2", "1", "0"])
    # From the right of the first circle to the left of the last one: in and out of each of the two
    # between at one place, in the best case on the straight line.
    assert 0.22 - 1e-12 <= gaps(arranged) <= 0.3
    for x in arranged.contours:
        assert x.closed and x.path.length == pytest.approx(0.08 * np.pi, abs=1e-9)
    for x in ordered(rings, order="shortest", begin="drawn").contours:
        np.testing.assert_allclose(x.path(0.0), [0.1 * int(x.name) + 0.04, 0])
    # They begin away from their corners.
    places = find_start_candidates(SQUARE, 24)
    nearest = np.abs(places[:, None] - SQUARE.breaks).min(axis=1)
    assert len(places) > 4 and nearest.min() > 0.25 * 0.06
    round_ones = find_start_candidates(circle(0, 0, 0.01).path, 24)
    assert len(round_ones) == 24 and round_ones[0] == 0


def test_outputs_are_on_only_along_the_contour():
    assert sum(outputs.judge_program(seed) for seed in range(30)) > 3000


def held_karp(places, upper):
    """The lower bound of Held and Karp (1970) for an open tour: 1-trees with weights."""
    n = len(places)
    links = np.linalg.norm(places[:, None] - places, axis=2)
    weight = np.zeros(n)
    best = 0.0
    step = 2.0
    for _ in range(150):
        # Zeros are no links of a sparse graph.
        tree = minimum_spanning_tree(links + weight[:, None] + weight + 10.0).tocoo()
        ends = np.argsort(weight)[:2]
        degree = np.bincount([*tree.row, *tree.col, *ends], minlength=n) - 2
        bound = tree.data.sum() - 10.0 * (n - 1) + weight[ends].sum() - 2 * weight.sum()
        best = max(best, bound)
        step = 0.97 * step
        weight = weight + step * max(upper - bound, 0.0) / max((degree**2).sum(), 1) * degree
    return best


@pytest.mark.parametrize("closed", [True, False])
def test_the_rapids_of_hundreds_of_contours_are_near_a_lower_bound(closed):
    rng = np.random.default_rng(5)
    contours = []
    for i, (x, y) in enumerate(rng.uniform(0, 1, (250, 2))):
        end = x + 1e-5 * np.cos(i), y + 1e-5 * np.sin(i)
        contours.append(circle(x, y, 4e-3) if closed else line((x, y), end))
    arranged = ordered(contours, order="shortest", begin="drawn" if closed else "auto")
    assert not arranged.notes
    starts = np.array([x.path(0.0) for x in arranged.contours])
    bound = held_karp(starts, gaps(arranged))
    assert 0.99 * bound < gaps(arranged) <= 1.1 * bound
