"""Quantities with units."""

import math

import pytest

from armcontour.io.units import parse


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (5, "m", 5.0),
        (0.25, "m/s", 0.25),
        ("5 mm", "m", 5e-3),
        ("0.15 m/s", "m/s", 0.15),
        ("150mm/s", "m/s", 0.15),
        ("90 deg", "rad", math.pi / 2),
        ("25 1/s", "1/s", 25.0),
        ("-150 1/s", "1/s", -150.0),
        ("41.25 deg/s^2", "rad/s^2", math.radians(41.25)),
        ("4 ms", "s", 4e-3),
        ("1e-3 m", "m", 1e-3),
        ("30 °", "rad", math.radians(30)),
        ("0.09 m/s²", "m/s^2", 0.09),
        ("5 µm", "m", 5e-6),
        ("0.72 rad/s**2", "rad/s^2", 0.72),
    ],
)
def test_reads_numbers_and_text(value: float | str, unit: str, expected: float) -> None:
    assert parse(value, unit) == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ("5", "no unit"),
        ("1e-3", "no unit"),
        ("5 s", "must be a quantity in m"),
        ("5 parsecs per", "not a quantity"),
        ("five", "not a quantity"),
        ("", "not a quantity|must be a quantity"),
        ("nan m", "finite|not a quantity"),
        ("2**99999999999 m", "not a quantity"),
        ("(1 + 1) m", "not a quantity"),
        ("5 m**99", "not a quantity"),
        (10**400, "hundreds of digits"),
        (float("nan"), "finite"),
        (float("inf"), "finite"),
        (True, "must be a number"),
        (None, "must be a number"),
        ([1], "must be a number"),
    ],
)
def test_refuses(value: object, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse(value, "m")
