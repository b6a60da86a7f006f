"""Reading with continuous curvature: fit and transitions together keep the chord tolerance."""

from __future__ import annotations

import numpy as np
import pytest

import armcontour as ac

SVG = """<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="100mm" viewBox="0 0 100 100">
<path id="curve" d="M 10 50 C 20 10, 60 10, 80 50 S 90 90, 50 80"/></svg>"""
GCODE = "G21 G90 G17\nF1000\nG0 X0 Y0\nG1 X50\nG3 X50 Y30 J15\nG1 X0\nG3 X0 Y0 J-15\nM30\n"


def curve(t):
    """Points of the two cubics of the drawing [m], t from 0 to 2."""
    first = [(10, 50), (20, 10), (60, 10), (80, 50)]
    second = [(80, 50), (100, 90), (90, 90), (50, 80)]
    control = np.where((t < 1)[:, None, None], first, second)
    x = np.where(t < 1, t, t - 1)[:, None]
    a, b, c, d = (control[:, k] for k in range(4))
    at = (1 - x) ** 3 * a + 3 * x * (1 - x) ** 2 * b + 3 * x**2 * (1 - x) * c + x**3 * d
    return at * [1e-3, -1e-3] + [0, 0.1]


def jumps(path):
    n = np.arange(len(path))
    ends = path.on_segment(n, path.lengths, 2)
    starts = path.on_segment(n, np.zeros(len(path)), 2)
    return np.linalg.norm(ends[:-1] - starts[1:], axis=1).max() / np.abs(starts).max()


@pytest.mark.parametrize("tolerance", [1e-6, 1e-4])
def test_a_curve_of_svg_is_smooth_within_the_chord_tolerance(tmp_path, tolerance):
    file = tmp_path / "curve.svg"
    file.write_text(SVG)
    path = ac.read_path(file, chord_tolerance=tolerance, continuity="curvature").path
    assert jumps(path) < 1e-9
    away = path.project(curve(np.linspace(0, 2, 4001))).distance.max()
    assert away <= tolerance + 1.1e-9
    assert jumps(ac.read_path(file, chord_tolerance=tolerance).path) > 1e-3


def test_lines_and_arcs_of_g_code_get_transitions(tmp_path):
    file = tmp_path / "slot.ngc"
    file.write_text(GCODE)
    plain = ac.read_path(file)
    smooth = ac.read_path(file, continuity="curvature", scale=2.0)
    assert jumps(smooth.path) < 1e-11
    twice = plain.placed(ac.Frame(), scale=2.0).path
    s = np.linspace(0, smooth.path.length, 9001)
    # Half of the chord tolerance, and twice of it for the scale.
    assert 0.9e-5 < twice.project(smooth.path(s)).distance.max() < 1e-5 + 1.1e-9
    assert (smooth.path.speeds == plain.path.speeds[0]).all()


def test_another_continuity_is_refused(tmp_path, refuses):
    file = tmp_path / "slot.ngc"
    file.write_text(GCODE)
    refuses(lambda: ac.read_path(file, continuity="smooth"), ac.InvalidInput, "tangent, curvature")
