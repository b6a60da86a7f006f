"""Quantities with units, and units in column titles."""

import itertools
import math

import numpy as np
import pint
import pytest
from tests.files.tables import refusals

from armcontour.core.quantities import (
    UNIT_FACTORS,
    Quantity,
    parse_quantity,
    read_quantity,
    unit_of,
    write_like,
)
from armcontour.files.csv_table import Title, read_table


def test_quantities_are_read_from_numbers_and_texts():
    for value, unit, expected in (
        (0.25, "m/s", 0.25),
        ("5 mm", "m", 5e-3),
        ("150mm/s", "m/s", 0.15),
        ("90 deg", "rad", math.pi / 2),
        ("25 1/s", "1/s", 25.0),
        ("41.25 deg/s^2", "rad/s^2", math.radians(41.25)),
        ("30 °", "rad", math.radians(30)),
        ("0.09 m/s²", "m/s^2", 0.09),
        ("5 µm", "m", 5e-6),
        ("0.72 rad/s**2", "rad/s^2", 0.72),
        # Products, quotients and powers.
        ("5 N·m", "N m", 5.0),
        ("3 m ** 2 / m", "m", 3.0),
        ("7 s**-1", "1/s", 7.0),
    ):
        assert parse_quantity(value, unit) == pytest.approx(expected, rel=1e-15), value


# These would take for ever if they were worked out, and nothing can interrupt that.
POWERS = ("4 s**9**9**9", "1 mm**9**9**9", "1 m^9^9^9", "2 m**-9**9**9", "1 m**9 m**9**9")
REFUSED = {
    "no unit": ("5", "1e-3"),
    "must be a quantity in m": ("5 s",),
    "not a quantity": (
        *("5 parsecs per", "five", "2**99999999999 m", "(1 + 1) m", "5 m**99", "5 m²³"),
        *("5 m⁹⁹⁹⁹⁹⁹", "1_0 mm", "٣ mm", *POWERS),
    ),
    "quantity|finite": ("", "nan m"),
    "20001 characters": ("9" * 20_000 + "!",),
    "hundreds of digits": (10**400,),
    "finite": (float("nan"), float("inf")),
    "must be a number": (True, None, [1], [1] * 1_000_000),
}


def test_invalid_quantities_are_refused():
    for words, values in REFUSED.items():
        for value in values:
            with pytest.raises(ValueError, match=words) as caught:
                parse_quantity(value, "m")
            assert len(str(caught.value)) < 500
    for text in POWERS:
        with pytest.raises(ValueError, match="not a quantity"):
            parse_quantity(text, "s")


def test_units_have_the_factors_of_pint():
    registry = pint.UnitRegistry(cache_folder=None)
    for unit, names in UNIT_FACTORS.items():
        for name, number in itertools.product(names, ("5", "-.25", "+3.7e-2", "123456789.")):
            text = f" {number}{' ' if name == '1/s' else ''}{name} "
            assert parse_quantity(text, unit) == float(registry.Quantity(text).to(unit).magnitude)


LENGTH = Quantity("m", "5 mm")
SHARE = Quantity("1", "10 %")


def test_a_written_quantity_has_the_unit_of_the_one_that_it_replaces():
    for value, old, kind, written in (
        (0.2, "0.15 m/s", Quantity("m/s", "0.15 m/s"), "0.2 m/s"),
        (0.3525, "350 mm", LENGTH, "352.5 mm"),
        (0.1 + 0.2, "350mm", LENGTH, "300mm"),
        (4.0, 3, LENGTH, 4),
        (np.pi / 3, "90 deg", Quantity("rad", "90 deg"), "60 deg"),
        (0.25, "10 %", SHARE, "25 %"),
        (0.002, None, LENGTH, "2 mm"),
        (-0.0, "5 mm", LENGTH, "0 mm"),
        (0.002, "sharp", LENGTH, "2 mm"),
    ):
        quantity = write_like(value, old, kind)
        assert (quantity, type(quantity)) == (written, type(written)), (value, old)


def test_the_written_unit_of_a_quantity_is_found():
    assert unit_of("350 mm", LENGTH) == ("mm", 1e-3)
    assert unit_of(0.35, LENGTH) == ("m", 1.0)
    assert unit_of(None, SHARE) == ("%", 0.01)
    # Degrees without their unit are refused where angles are within a turn.
    turn = Quantity("rad", "90 deg", "turn")
    with pytest.raises(ValueError, match="but is 180 rad. For 180 degrees, write 180 deg"):
        read_quantity(180, turn)
    assert read_quantity("720 deg", turn) == pytest.approx(4 * math.pi)
    assert read_quantity("7 rad", turn) == 7.0 and read_quantity(-6.2832, turn) == -6.2832


SI = {"t": "s", "q": "rad", "dq": "rad/s", "x": "m", "name": None}


def titles(*names):
    def title_of(name):
        key, _, suffix = name.partition("_")
        return Title(key, SI[key], suffix or None) if key in SI else None

    # A single title may have blanks.
    line = ";".join(names if len(names) > 1 else [*names, "-"])
    return read_table(line, "a.csv", title_of, example="t,q", columns=None, option="--columns")


def test_a_unit_in_a_column_title_scales_the_column_to_si():
    for title, key, factor in (
        ("t", "t", 1.0),
        ("t [ms]", "t", 1e-3),
        ("q [deg]", "q", math.pi / 180),
        ("q_mrad", "q", 1e-3),
        ("dq [rpm]", "dq", math.pi / 30),
        ("x_mm", "x", 1e-3),
        ("x [ in ]", "x", 0.0254),
        ("name", "name", 1.0),
    ):
        table = titles("other", title, "something [V]")
        assert table.unknown == ("other", "something [V]")
        ((key_read, column),) = table.columns.items()
        assert (key_read, column.index, column.title) == (key, 1, title)
        assert column.factor == pytest.approx(factor, rel=1e-12), title


BAD = """
1|-2.5e3 => the first line must name the columns, such as t,q
t|q|q [deg] => the columns 'q' and 'q [deg]' have the same quantity
t|t => the columns 't' and 't' have the same quantity
q [1/s] => the unit '1/s' of the column 'q [1/s]' must be convertible to rad
t [-ms] => must be convertible to s
name [m] => the unit 'm' of the column 'name [m]' must be removed
q_deg [rad] => the column 'q_deg [rad]' has two units
"""


def test_invalid_column_titles_are_refused():
    refusals(lambda x: titles(*x.split("|")), BAD, "a.csv, line 1: ", without="m" * 300)
