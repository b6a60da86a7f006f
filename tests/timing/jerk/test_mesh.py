"""Cells of plans with limits of jerk, and polynomials on them, against those of numpy."""

import numpy as np
import pytest

import armcontour as ac
from armcontour.timing.jerk.mesh import End, Mesh, place_mesh

LIMITS = ac.Limits(joint_velocity=[1.0] * 2, joint_acceleration=[4.0] * 2)
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
    found = mesh([(end(True), end(True))], cells)
    assert np.isin(BREAKS, found.grid.s).all() and np.isin(found.nodes, found.grid.s).all()
    assert (np.diff(found.nodes) > 1e-6).all() and (np.diff(found.cell) >= 0).all()
    # Every part lies in its cell, and in one piece of the joint path.
    middle = (found.grid.s[:-1] + found.grid.s[1:]) / 2
    assert (found.nodes[found.cell] < middle).all() and (middle < found.nodes[found.cell + 1]).all()
    np.testing.assert_array_equal(found.grid.piece, LAW.joint_path.locate(middle))
    assert cells * 0.9 < len(found.nodes) < cells + 400
    np.testing.assert_array_equal(np.flatnonzero(found.ramps), [0, len(found.nodes) - 2])


def test_new_cells_that_nearly_end_at_a_break_end_there():
    brk = float(np.nextafter(0.5, 1.0))
    path = ac.JointPath.spline(POINTS[[0, 1, 4]], [0.0, brk, 2.0])
    nodes = np.array([0.0, 0.25, 0.75, 1.5, 2.0])
    whole = Mesh.through(path, nodes, np.array([0, 4]), np.array([[True, True]]))
    found = whole.split(np.full(len(whole.grid), 2.0))
    # A part of 1e-16 m would have no second differences but rounding errors.
    assert found.grid.width.min() > 0.2 and brk in found.nodes and 0.5 not in found.nodes
    assert np.isin(nodes, found.nodes).all()
