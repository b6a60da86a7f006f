"""Quantities with units."""

import itertools
import math
import subprocess
import sys
import time

import numpy as np
import pint
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armcontour._quantities import Quantity
from armcontour.io.units import (
    MOST_CHARACTERS,
    PERCENT,
    QUANTITY,
    USUAL,
    parse,
    read_quantity,
    share,
    unit_of,
    write_like,
)


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
        ("5 m²³", "not a quantity"),
        ("5 m⁹⁹⁹⁹⁹⁹", "not a quantity"),
        ("1_0 mm", "not a quantity"),
        ("٣ mm", "not a quantity"),
        ("9" * 20_000 + "!", "20001 characters"),
        ([1] * 1_000_000, r"must be a number in m .*\.\.\."),
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


POWERS_OF_POWERS = ("4 s**9**9**9", "1 mm**9**9**9", "1 m^9^9^9", "2 m**-9**9**9", "1 m**9 m**9**9")


def test_powers_of_powers_are_not_worked_out():
    # In a process of its own: nothing can interrupt what they would compute.
    code = f"""
from armcontour.io.units import parse
for text in {POWERS_OF_POWERS}:
    for value, unit in ((text, "s"), (text, "m")):
        try:
            parse(value, unit)
        except ValueError as error:
            assert "not a quantity" in str(error), error
        else:
            raise AssertionError(text)
"""
    done = subprocess.run([sys.executable, "-c", code], timeout=30, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


REPEATS = (
    "9",
    "9.",
    "1 ",
    "m ",
    "m*",
    "m/",
    "m**2 ",
    "m^-2 ",
    "m²",
    "m·",
    "e",
    "1e9",
    "_",
    "°",
    "-",
)


@pytest.mark.parametrize("repeat", REPEATS)
@pytest.mark.parametrize("begin", ["", "1 ", "1 m", "1e"])
def test_the_time_to_look_at_a_text_grows_with_its_length(begin, repeat):
    # Far longer than what is looked at; time that grew with the square would be minutes here.
    text = begin + repeat * (40_000 // len(repeat)) + "!"
    start = time.perf_counter()
    assert not QUANTITY.fullmatch(text) and not PERCENT.fullmatch(text)
    assert time.perf_counter() - start < 1.0


def test_no_text_above_the_bound_is_looked_at():
    text = "5" + " " * (MOST_CHARACTERS - 3) + "mm"
    assert len(text) == MOST_CHARACTERS and parse(text, "m") == 5e-3
    with pytest.raises(ValueError, match="101 characters, more than the 100"):
        parse(text + " ", "m")
    assert share("5" + " " * (MOST_CHARACTERS - 2) + "%") == 0.05
    with pytest.raises(ValueError, match="percentage"):
        share("5" + " " * (MOST_CHARACTERS - 1) + "%")


@pytest.mark.parametrize(
    ("text", "unit", "expected"),
    [
        ("5 N m", "N m", 5.0),
        ("5 N·m", "N m", 5.0),
        ("3 m ** 2 / m", "m", 3.0),
        ("2 kg m^2", "kg m^2", 2.0),
        ("7 s**-1", "1/s", 7.0),
        ("90 deg/s", "rad/s", math.pi / 2),
    ],
)
def test_products_quotients_and_powers(text, unit, expected):
    assert parse(text, unit) == pytest.approx(expected, rel=1e-15)


def test_usual_units_are_those_of_pint():
    registry = pint.UnitRegistry(cache_folder=None)
    for unit, names in USUAL.items():
        for name, number in itertools.product(names, ("5", "-.25", "+3.7e-2", "123456789.")):
            text = f" {number}{' ' if name == '1/s' else ''}{name} "
            assert parse(text, unit) == float(registry.Quantity(text).to(unit).magnitude)


def test_usual_quantities_do_not_start_pint():
    code = (
        "import sys; from armcontour.io.units import parse; parse('5 mm', 'm'); "
        "assert 'pint' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


LENGTH, SHARE = Quantity("m", "5 mm"), Quantity("1", "10 %")


@pytest.mark.parametrize(
    ("value", "old", "kind", "written"),
    [
        (0.2, "0.15 m/s", Quantity("m/s", "0.15 m/s"), "0.2 m/s"),
        (0.3525, "350 mm", LENGTH, "352.5 mm"),
        (0.1 + 0.2, "350mm", LENGTH, "300mm"),
        (0.1 + 0.2, 0.35, LENGTH, 0.3),
        (4.0, 3, LENGTH, 4),
        (2e-6, "0.1 m", LENGTH, "0.000002 m"),
        (np.pi / 3, "90 deg", Quantity("rad", "90 deg"), "60 deg"),
        (np.pi / 3, "90°", Quantity("rad", "90 deg"), "60°"),
        (0.25, "10 %", SHARE, "25 %"),
        (0.0254, "5 inch", LENGTH, "1 inch"),
        (0.002, None, LENGTH, "2 mm"),
        (-0.0, "5 mm", LENGTH, "0 mm"),
        (0.002, "sharp", LENGTH, "2 mm"),
    ],
)
def test_a_quantity_is_written_as_another_one(value, old, kind, written) -> None:
    found = write_like(value, old, kind)
    assert found == written and type(found) is type(written)


@given(st.floats(-1e4, 1e4), st.sampled_from(["1 mm", "2.5 m", "3 um", 0.5, "7 thou"]))
def test_what_is_written_is_read_again(value, old) -> None:
    exact = read_quantity(write_like(value, old, LENGTH), LENGTH)
    assert exact == pytest.approx(value, rel=3e-15, abs=0)
    # Fewer digits where that is enough.
    rough = write_like(value, old, LENGTH, within=1e-4)
    assert abs(read_quantity(rough, LENGTH) - value) <= 1e-4 * (1 + 1e-9)
    assert len(str(rough)) <= len(str(write_like(value, old, LENGTH))) + 2


def test_the_unit_of_a_quantity_is_the_one_written() -> None:
    assert unit_of("350 mm", LENGTH) == ("mm", 1e-3)
    assert unit_of(0.35, LENGTH) == ("m", 1.0)
    assert unit_of(None, SHARE) == ("%", 0.01)


def test_degrees_without_their_unit_are_refused_where_angles_are_within_a_turn() -> None:
    turn = Quantity("rad", "90 deg", "turn")
    with pytest.raises(ValueError, match="but is 180 rad: for 180 degrees write 180 deg"):
        read_quantity(180, turn)
    assert read_quantity("720 deg", turn) == pytest.approx(4 * math.pi)
    assert read_quantity("7 rad", turn) == 7.0 and read_quantity(-6.2832, turn) == -6.2832
