"""Acceleration and jerk as polynomials in Bernstein form: against numpy's polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.special import comb

from armcontour.timing.jerk._polynomials import basis, motion_rows, raised, to_bernstein

RNG = np.random.default_rng(5)


def bernstein(points, x):
    """Value at x of control points, by the definition."""
    n = len(points) - 1
    return sum(comb(n, k) * x**k * (1 - x) ** (n - k) * points[k] for k in range(n + 1))


@pytest.mark.parametrize("degree", [2, 3, 5])
def test_control_points_of_powers(degree):
    powers = RNG.normal(size=degree + 1)
    for x in (0.0, 0.3, 1.0):
        assert bernstein(to_bernstein(degree) @ powers, x) == pytest.approx(Polynomial(powers)(x))


# Where a part lies in its cell, from 0 to 1.
@pytest.mark.parametrize("part", [(0.0, 1.0), (0.25, 0.5), (0.999999, 1e-6)])
@pytest.mark.parametrize("degree", [3, 5])
def test_rows_are_acceleration_and_jerk(part, degree):
    breaks, width = np.array([0.0, 2.0]), 0.8
    coefficients = np.zeros((1, 6, 2))
    coefficients[0, : degree + 1] = RNG.normal(size=(degree + 1, 2))
    # A cell from 0.7 to 1.5, of which one part counts.
    s = 0.7 + width * np.array([part[0], part[0] + part[1]])
    on = basis(np.array([part[0]]), np.array([part[1]]), np.array([width]))
    both = np.arange(2)
    found = np.empty((1, 2 * (degree + 1), 3)), np.empty((1, 2 * degree, 3))
    of_powers = to_bernstein(degree), to_bernstein(degree - 1)
    piece = np.zeros(1, dtype=np.intp)
    motion_rows(coefficients, breaks, piece, s, on, degree, of_powers, (both, both), found)
    points = RNG.uniform(0.5, 1.5, 3)
    square = Polynomial([1, -2, 1]) * points[0] + Polynomial([0, 2, -2]) * points[1]
    square = (square + Polynomial([0, 0, 1]) * points[2])(Polynomial([-0.7, 1]) / width)
    rate = square.deriv() / 2
    for j in both:
        q = Polynomial(coefficients[0, :, j])(Polynomial([0, 0.5]))
        first, second, third = (q.deriv(k) for k in (1, 2, 3))
        acceleration = second * square + first * rate
        jerk = third * square + 3 * second * rate + first * rate.deriv()
        for k, (expected, rows) in enumerate(zip((acceleration, jerk), found, strict=True)):
            control = rows[0].reshape(2, -1, 3)[j] @ points
            assert len(control) == degree + 1 - k
            for x in (0.0, 0.4, 1.0):
                at = s[0] + x * (s[1] - s[0])
                assert bernstein(control, x) == pytest.approx(expected(at), rel=1e-9, abs=1e-9)


def test_the_basis_of_a_part_continues_that_of_its_cell():
    points = RNG.uniform(0.5, 1.5, 3)
    halves = basis(np.array([0.0, 0.5]), np.array([0.5, 0.5]), np.array([3.0, 3.0]))
    for x in (0.0, 0.2, 1.0):
        for part, start in enumerate((0.0, 0.5)):
            assert bernstein(raised(halves, 4)[part] @ points, x) == pytest.approx(
                bernstein(points, start + x / 2)
            )
    for k in (0, 1):  # ds² and dds
        assert halves.at_end(1)[k][0] @ points == pytest.approx(halves.at_end(0)[k][1] @ points)
