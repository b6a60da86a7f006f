"""Numbers in exported tables: the compiled function writes the text of Python's % operator."""

import numpy as np
import pytest

from armcontour.files.exports import export_table
from armcontour.files.exports.number_text import RowForm

RANDOM = np.random.default_rng(7)


def written(form, values):
    """Texts of one number per row: by the compiled function and by Python."""
    row = f"{form}\n"
    rows = np.asarray(values, dtype=float)[:, None]
    return RowForm(row).write_compiled(rows), row * len(rows) % tuple(rows.ravel().tolist())


@pytest.mark.parametrize("decimals", [1, 4, 6, 7, 8, 9, 12])
def test_numbers_of_all_sizes_are_rounded_as_python_rounds_them(decimals):
    sizes = 10.0 ** RANDOM.integers(-15, 4, 20_000)
    values = RANDOM.normal(size=20_000) * sizes
    values = values[np.abs(values) < 4000]
    mine, python = written(f"%.{decimals}f", values)
    assert mine == python


@pytest.mark.parametrize("decimals", [1, 3, 7, 12])
def test_numbers_halfway_between_two_texts_and_their_neighbours_are_exact(decimals):
    # Multiples of 2^-(decimals + 1) are ties where they are odd; decimal halves are nearly ties.
    binary = np.ldexp(RANDOM.integers(-(2**20), 2**20, 3000), -decimals - 1)
    decimal = (RANDOM.integers(-3000, 3000, 3000) + 0.5) * 10.0**-decimals
    middles = np.concatenate([binary, decimal])
    middles = middles[np.abs(middles) < 4000]
    values = [np.nextafter(middles, -9e9), middles, np.nextafter(middles, 9e9)]
    mine, python = written(f"%.{decimals}f", np.concatenate(values))
    assert mine == python


def test_zeros_and_carries_keep_their_signs_and_digits():
    values = [0.0, -0.0, -1e-300, 0.9999999999, -9.99999999999, 99.96, 999.9999999999999]
    mine, python = written("%.4f", values)
    assert mine == python


@pytest.mark.parametrize("value", [1e300, 5e9, np.inf, np.nan, -np.inf])
def test_numbers_that_do_not_fit_are_written_by_python(value):
    mine, python = written("%.7f", [1.5, value])
    assert mine == python


def test_text_between_numbers_may_have_any_characters():
    row = "  servoj([%.7f, %.6f], gain=5)  # 100 %% of ½ m\n"
    values = RANDOM.normal(size=(50, 2))
    assert RowForm(row).write_compiled(values) == row * 50 % tuple(values.ravel().tolist())


def test_long_tables_have_their_exceptions_in_their_rows():
    count = export_table.COMPILED_FROM // 2 + 10
    values = RANDOM.normal(size=(count, 2))
    exceptions = {0: "%.1f,%.1f first\n", 700: "%.2f,%.2f\nbetween\n", count - 1: "%.3f,%.3f end\n"}
    pieces = export_table.format_rows("%.7f,%.7f\n", values[:, 0], values[:, 1:], lines=exceptions)
    expected = [exceptions.get(k, "%.7f,%.7f\n") % tuple(x) for k, x in enumerate(values.tolist())]
    assert "".join(pieces) == "".join(expected)
