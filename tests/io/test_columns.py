"""Titles of columns, by what all files have in common."""

from __future__ import annotations

import math

import pytest

from armcontour.errors import InvalidInput
from armcontour.io.columns import Column, read_titles

SI = {"t": "s", "q": "rad", "dq": "rad/s", "x": "m", "name": None}


def titles(*given: str) -> dict[str, Column[str]]:
    def key_of(name: str, has_unit: bool) -> tuple[str, str | None] | None:
        key, _, suffix = name.partition("_")
        return (key, suffix or None) if key in SI else None

    return read_titles(
        given,
        where="a.csv, line 1",
        example="t,q",
        key_of=key_of,
        si_of=SI.get,
        unknown=left_out.append,
    )


left_out: list[str] = []


@pytest.mark.parametrize(
    ("title", "key", "factor"),
    [
        ("t", "t", 1.0),
        ("t [ms]", "t", 1e-3),
        ("t(us)", "t", 1e-6),
        ("q [deg]", "q", math.pi / 180),
        ("q [°]", "q", math.pi / 180),
        ("q_mrad", "q", 1e-3),
        ("q [turn]", "q", 2 * math.pi),
        ("dq [rpm]", "dq", math.pi / 30),
        ("dq [deg/s]", "dq", math.pi / 180),
        ("x_mm", "x", 1e-3),
        ("x [ in ]", "x", 0.0254),
        ("name", "name", 1.0),
    ],
)
def test_units_become_factors(title: str, key: str, factor: float) -> None:
    left_out.clear()
    found = titles("other", title, "something [V]")
    assert left_out == ["other", "something [V]"]
    assert list(found) == [key]
    assert (found[key].index, found[key].title) == (1, title)
    assert found[key].factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("1", "-2.5e3"), "the first line must name the columns, such as t,q"),
        (("t", "q", "q [deg]"), "the columns 'q' and 'q [deg]' hold the same"),
        (("t", "t"), "there are two columns 't'"),
        (("q [1/s]",), "the unit '1/s' of the column 'q [1/s]' is not one that converts to rad"),
        (("q []",), "the unit '' of the column 'q []' is not one that converts to rad"),
        (("q [1]",), "the unit '1' of the column 'q [1]' is not one that converts to rad"),
        (("dq [1/s]",), "not one that converts to rad/s"),
        (("dq [Hz]",), "not one that converts to rad/s"),
        (("t [-ms]",), "not one that converts to s"),
        (("x [deg]",), "not one that converts to m"),
        (("name [m]",), "the unit 'm' of the column 'name [m]' is not wanted"),
        (("q_deg [rad]",), "the column 'q_deg [rad]' has two units"),
        ((f"x [{'m' * 9999}]",), "the unit 'mmmm"),
    ],
)
def test_titles_that_are_refused(given: tuple[str, ...], words: str) -> None:
    with pytest.raises(InvalidInput) as caught:
        titles(*given)
    message = str(caught.value)
    assert message.startswith("a.csv, line 1: ") and words in message and message.endswith(".")
    assert len(message) < 300
