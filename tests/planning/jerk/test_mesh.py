"""Cells of plans with limits of jerk, and polynomials on them, against those of numpy."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.special import comb

import armcontour as ac
from armcontour.planning.jerk.mesh import End, JerkMesh, place_mesh
from armcontour.planning.jerk.mesh_rows import control_points
from armcontour.planning.jerk.polynomials import basis, motion_rows, raised, to_bernstein
from armcontour.planning.topp.limit_forms import Intervals

LIMITS = ac.Limits.only(joint_velocity=[1.0] * 2, joint_acceleration=[4.0] * 2)
# Breaks of the path lie close together around 1.2.
BREAKS = [0.0, 0.5, 1.2, 1.2 + 1e-7, 2.0]
POINTS = np.array([(0.0, 0.0), (0.4, 0.1), (0.5, 0.8), (0.5, 0.8 + 1e-7), (0.1, 1.4)])
LAW = ac.plan(ac.JointPath.spline(POINTS, BREAKS), limits=LIMITS).laws[0]


def end(rest, square=0.0, jerk=40.0):
    return End(rest, square, acceleration=4.0, jerk=jerk, speed=1.0, even=np.inf)


def mesh(ends, cells=200, places=(0.0, 2.0)):
    return place_mesh(LAW, LAW.s, cells, np.array(places), ends)


@pytest.mark.parametrize("cells", [60, 1000])
def test_parts_end_at_all_breaks_and_cells_are_not_tiny(cells):
    graded = mesh([(end(True), end(True))], cells)
    assert np.isin(BREAKS, graded.grid.s).all() and np.isin(graded.nodes, graded.grid.s).all()
    assert (np.diff(graded.nodes) > 1e-6).all() and (np.diff(graded.cell) >= 0).all()
    # Every part lies in its cell, and in one piece of the joint path.
    middle = (graded.grid.s[:-1] + graded.grid.s[1:]) / 2
    assert (graded.nodes[graded.cell] < middle).all() and (
        middle < graded.nodes[graded.cell + 1]
    ).all()
    np.testing.assert_array_equal(graded.grid.piece, LAW.joint_path.locate(middle))
    assert cells * 0.9 < len(graded.nodes) < cells + 400
    np.testing.assert_array_equal(np.flatnonzero(graded.ramps), [0, len(graded.nodes) - 2])


def test_the_first_cell_is_a_share_of_the_build_up_of_acceleration():
    # In a / j = 0.1 s the way is j t³ / 6.
    assert end(True).first_cell(100.0) == pytest.approx(0.3 * 40 * 0.1**3 / 6)
    # The speed is reached before the acceleration where a / j is longer than the root of v / j.
    fast = End(True, 0.0, acceleration=4e3, jerk=40.0, speed=1.0, even=np.inf)
    assert fast.first_cell(100.0) == pytest.approx(0.3 * 40 * (1 / 40) ** 1.5 / 6)
    assert end(True, jerk=np.inf).first_cell(100.0) == pytest.approx(1e-9 * 100)
    bent = End(True, 0.0, acceleration=4.0, jerk=40.0, speed=1.0, even=1e-5)
    assert bent.first_cell(100.0) == 1e-5


def test_the_slope_of_the_square_is_continuous():
    graded = mesh([(end(True), end(True)), (end(True), end(False, 0.3))], places=(0.0, 0.5, 2.0))
    begin, last = control_points(graded)
    d = np.random.default_rng(1).uniform(0.5, 1.0, len(graded.width) + 2)
    for first, end_, (start, stop) in zip(
        graded.sections[:-1], graded.sections[1:], graded.at_rest, strict=True
    ):
        cells = np.arange(first + start, end_ - stop)
        around = np.stack([d[cells - 1], d[cells], d[cells + 1]])
        if start:
            around[0, 0] = 0.0
        low, high = (np.sum(x[cells].T * around, axis=0) for x in (begin, last))
        h = graded.width[cells]
        np.testing.assert_allclose(high[:-1], low[1:])
        slope = 2 * (d[cells] - low) / h, 2 * (high - d[cells]) / h
        np.testing.assert_allclose(slope[1][:-1], slope[0][1:], rtol=1e-6)
        if start:
            # Uniform jerk: ds² ~ s^(4/3).
            assert slope[0][0] == pytest.approx(4 / 3 * low[0] / graded.width[first])


def test_new_cells_that_nearly_end_at_a_break_end_there():
    brk = float(np.nextafter(0.5, 1.0))
    path = ac.JointPath.spline(POINTS[[0, 1, 4]], [0.0, brk, 2.0])
    nodes = np.array([0.0, 0.25, 0.75, 1.5, 2.0])
    whole = JerkMesh.through(path, nodes, np.array([0, 4]), np.array([[True, True]]))
    refined = whole.split(np.full(len(whole.grid), 2.0))
    # A part of 1e-16 m would have no second differences but rounding errors.
    assert refined.grid.width.min() > 0.2 and brk in refined.nodes and 0.5 not in refined.nodes
    assert np.isin(nodes, refined.nodes).all()


RNG = np.random.default_rng(5)


def bernstein(points, x):
    """Value at x of control points, by the definition."""
    n = len(points) - 1
    return sum(comb(n, k) * x**k * (1 - x) ** (n - k) * points[k] for k in range(n + 1))


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
    motion = np.empty((1, 2 * (degree + 1), 3)), np.empty((1, 2 * degree, 3))
    of_powers = to_bernstein(degree), to_bernstein(degree - 1)
    flat, piece = coefficients.ravel(), np.zeros(1, dtype=np.intp)
    grid = Intervals(s, piece, breaks, flat, flat, 2)
    motion_rows(grid, on, degree, of_powers, (both, both), motion)
    points = RNG.uniform(0.5, 1.5, 3)
    square = Polynomial([1, -2, 1]) * points[0] + Polynomial([0, 2, -2]) * points[1]
    square = (square + Polynomial([0, 0, 1]) * points[2])(Polynomial([-0.7, 1]) / width)
    rate = square.deriv() / 2
    for j in both:
        q = Polynomial(coefficients[0, :, j])(Polynomial([0, 0.5]))
        first, second, third = (q.deriv(k) for k in (1, 2, 3))
        acceleration = second * square + first * rate
        jerk = third * square + 3 * second * rate + first * rate.deriv()
        for k, (expected, rows) in enumerate(zip((acceleration, jerk), motion, strict=True)):
            control = rows[0].reshape(2, -1, 3)[j] @ points
            assert len(control) == degree + 1 - k
            for x in (0.0, 0.4, 1.0):
                u = s[0] + x * (s[1] - s[0])
                assert bernstein(control, x) == pytest.approx(expected(u), rel=1e-9, abs=1e-9)


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
