"""The order of contours: by hand, against exhaustive search, and against lower bounds."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armcontour.errors import InvalidInput
from armcontour.geometry import Arc, Path
from armcontour.program import Contour, Event, Lead, Process, Program, prepare
from armcontour.program.ordering import begin_places

WASTE = Lead(length=1e-3, shape="arc")
CUTTING = Process(lead_in=WASTE)
SQUARE = Path.polyline([[0, 0], [0.1, 0], [0.1, 0.06], [0, 0.06], [0, 0]])


def circle(x: float, y: float, radius: float, name: str = "") -> Contour:
    return Contour(path=Path.from_segments([Arc.circle((x + radius, y), (x, y))]), name=name)


def line(a: tuple[float, float], b: tuple[float, float], name: str = "") -> Contour:
    return Contour(path=Path.polyline([a, b]), name=name)


def names(program: Program) -> list[str]:
    return [x.name for x in program.contours]


def gaps(program: Program) -> float:
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


@pytest.mark.parametrize("process", [CUTTING, Process(order="inside_first")])
def test_what_lies_inside_comes_first_and_part_after_part(process: Process) -> None:
    done = prepare(Program(moves=PARTS), process)
    assert names(done) == ["island", "window", "mark", "outline", "hole", "second"]
    assert not done.notes


def test_only_a_cutting_process_changes_the_order_of_itself() -> None:
    for process in (
        Process(),
        Process(lead_in=Lead(length=1e-3)),
        Process(lead_in=Lead(length=1e-3, shape="arc", side="left")),
    ):
        done = prepare(Program(moves=PARTS), process)
        assert names(done) == [x.name for x in PARTS] and not done.notes


def test_a_warning_names_what_is_cut_too_early() -> None:
    drawn = Process(lead_in=WASTE, order="drawn")
    (note,) = prepare(Program(moves=PARTS), drawn).notes
    for words in ("contour outline is cut before contour window", "so are 3 more", "inside_first"):
        assert words in note
    # The order of G-code has a meaning, and stays.
    moves = (PARTS[0], Event(name="gas"), PARTS[1])
    done = prepare(Program(moves=moves), CUTTING)
    assert names(done) == ["outline", "window"] and len(done.notes) == 1
    assert not prepare(Program(moves=moves[::-1]), CUTTING).notes


@pytest.mark.parametrize("order", ["nearest", "shortest"])
@given(seed=st.integers(0, 10_000))
@settings(max_examples=10)
def test_whatever_is_cut_what_lies_inside_comes_before(order: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    contours, inner = [], {}
    for i, center in enumerate(rng.permutation(16)[:6]):
        x, y = 0.1 * (center % 4), 0.1 * (center // 4)
        for k, radius in enumerate((0.04, 0.02, 0.01)[: rng.integers(1, 4)]):
            contours.append(circle(x, y, radius, f"{i}{k}"))
            inner[f"{i}{k}"] = f"{i}{k - 1}"
    process = Process(lead_in=WASTE, order=order)
    program = Program(moves=tuple(contours[i] for i in rng.permutation(len(contours))))
    found = names(prepare(program, process))
    assert sorted(found) == sorted(inner)
    for name, outer in inner.items():
        assert outer not in found or found.index(name) < found.index(outer)


# ------------------------------------------------------------------------------------- shortest


@given(seed=st.integers(0, 10_000), turned=st.booleans())
@settings(max_examples=15)
def test_the_shortest_order_of_few_contours_is_that_of_all_orders(seed: int, turned: bool) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.uniform(0, 0.3, (6, 2, 2))
    drawn = Program(moves=tuple(line(a, b, str(i)) for i, (a, b) in enumerate(ends)))
    done = prepare(drawn, Process(order="shortest", reverse_open=turned))
    options = [[x, x[::-1]] if turned else [x] for x in ends]

    @functools.cache
    def least(i: int, k: int, left: frozenset[int]) -> float:
        """The shortest way from option k of contour i over all that are left."""
        ways = (
            float(np.linalg.norm(options[j][m][0] - options[i][k][1])) + least(j, m, left - {j})
            for j in left
            for m in range(len(options[j]))
        )
        return min(ways, default=0.0)

    every = frozenset(range(6))
    shortest = min(least(i, k, every - {i}) for i in every for k in range(len(options[i])))
    assert gaps(done) <= 1.05 * shortest
    assert gaps(done) >= shortest - 1e-12
    assert sorted(names(done)) == [str(i) for i in range(6)]


def test_closed_contours_begin_where_the_way_is_short() -> None:
    rings = [circle(0.1 * i, 0, 0.04, str(i)) for i in (0, 2, 1, 3)]
    done = prepare(Program(moves=tuple(rings)), Process(order="shortest"))
    assert names(done) in (["0", "1", "2", "3"], ["3", "2", "1", "0"])
    # From the right of the first circle to the left of the last one: in and out of each of the two
    # between at one place, in the best case on the straight line.
    assert 0.22 - 1e-12 <= gaps(done) <= 0.3
    for x in done.contours:
        assert x.closed and x.path.length == pytest.approx(0.08 * np.pi, abs=1e-9)
    kept = prepare(Program(moves=tuple(rings)), Process(order="shortest", begin="drawn"))
    for x in kept.contours:
        np.testing.assert_allclose(x.path(0.0), [0.1 * int(x.name) + 0.04, 0])


def test_contours_begin_away_from_their_corners() -> None:
    places = begin_places(SQUARE, 24)
    corners = SQUARE.breaks
    nearest = np.abs(places[:, None] - corners).min(axis=1)
    assert len(places) > 4 and nearest.min() > 0.25 * 0.06
    round_ones = begin_places(circle(0, 0, 0.01).path, 24)
    assert len(round_ones) == 24 and round_ones[0] == 0


@pytest.mark.parametrize("closed", [True, False])
def test_five_hundred_contours_come_within_the_stated_share_of_a_lower_bound(closed: bool) -> None:
    rng = np.random.default_rng(5)
    contours = []
    for i, (x, y) in enumerate(rng.uniform(0, 1, (500, 2))):
        step = 1e-5 * np.array([np.cos(i), np.sin(i)])
        contours.append(circle(x, y, 4e-3) if closed else line((x, y), (x + step[0], y + step[1])))
    begin = "drawn" if closed else "auto"
    done = prepare(Program(moves=tuple(contours)), Process(order="shortest", begin=begin))
    # It is no warning: nothing is wrong.
    (note,) = done.remarks
    assert not done.notes
    share = float(note.split("at most ")[1].split(" %")[0])
    assert 0 < share <= 5
    assert f"{gaps(done):.4g} m apart" in note


def test_open_contours_run_backwards_only_where_they_may() -> None:
    drawn = Program(moves=(line((0, 0), (1, 0), "a"), line((1, 0.1), (0, 0.1), "b")))
    turned = Program(moves=(drawn.contours[0], line((0, 0.1), (1, 0.1), "b")))
    kept = prepare(turned, Process(order="nearest"))
    assert gaps(kept) == pytest.approx(np.hypot(1, 0.1))
    for order in ("nearest", "shortest"):
        done = prepare(turned, Process(order=order, reverse_open=True))
        assert gaps(done) == pytest.approx(0.1)
    switched = Contour(path=turned.contours[1].path, events=(Event(name="gas", s=0.2),))
    with_event = Program(moves=(drawn.contours[0], switched))
    found = prepare(with_event, Process(order="shortest", reverse_open=True))
    assert found.contours[-1].events[0].s == pytest.approx(0.2) or gaps(found) > 0.1


@pytest.mark.parametrize("order", ["inside_first", "nearest", "shortest"])
def test_a_given_order_is_refused_where_order_has_a_meaning(
    refuses: Callable[..., None], order: str
) -> None:
    moves = (PARTS[0], Event(name="x"), PARTS[1])
    refuses(lambda: prepare(Program(moves=moves), Process(order=order)), InvalidInput, order)
