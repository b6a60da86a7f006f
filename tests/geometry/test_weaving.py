"""Weaving along seams, compared with densely sampled sines."""

import itertools

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation
from tests.geometry.tables import each, line, path_of, refused

from armcontour.geometry import Arc, Path, SegmentLimits
from armcontour.geometry.weave import Weave, weave_seam

WIDTH = 4e-3  # m, from edge to edge of the weave
PITCH = 5e-3  # m, along the seam per wave
SLOW = {"speed": 0.01, "tolerance": 1e-4, "tag": "weld"}
LINE = path_of(line([0.1, 0.2], [0.15, 0.2], **SLOW))
# A line and a quarter of a circle, tangent to each other.
BEND = Arc(start=[0.03, 0.0], center=[0.03, 0.02], angle=np.pi / 2)
BENT = path_of(line([0.0, 0.0], [0.03, 0.0], **SLOW), BEND)


def weave_path(path, **options):
    return weave_seam(path, Weave(**options))[0]


def offset(share, waves):
    """Height of the wave over the share of the seam, written out."""
    u = np.minimum(np.minimum(share, 1 - share) * waves / 0.5, 1)
    return WIDTH / 2 * np.sin(2 * np.pi * waves * share) * (3 * u**2 - 2 * u**3)


def exact(path, count):
    """Points of the woven seams LINE and BENT, from their geometry alone."""
    share = np.linspace(0, 1, count)
    lateral = offset(share, path.length / PITCH)
    s = share * path.length
    if path is LINE:
        return np.column_stack([0.1 + s, 0.2 + lateral])
    angle = np.maximum(s - 0.03, 0) / 0.02
    x = np.minimum(s, 0.03) + (0.02 - lateral) * np.sin(angle)
    return np.column_stack([x, 0.02 - (0.02 - lateral) * np.cos(angle)])


@each("tolerance", [1e-5, 1e-6])
@each("path", [LINE, BENT])
def test_a_woven_sine_is_within_its_tolerance_and_has_no_corner(path, tolerance):
    woven = weave_path(path, width=WIDTH, pitch=PITCH, tolerance=tolerance)
    points = exact(path, 400_001)
    assert woven.project(points[::20]).distance.max() <= tolerance
    # Samples of the sine are 0.3 um apart or less.
    points_on_woven = woven(np.linspace(0, woven.length, 20_001))
    assert cKDTree(points).query(points_on_woven)[0].max() <= tolerance + 2e-7
    assert len(woven.stops) == 0
    for s in (0.0, 1.0):
        tangents = path(s * path.length, 1, side="left"), woven(s * woven.length, 1, side="left")
        np.testing.assert_allclose(*tangents, atol=1e-9)
    # The speed is along the seam, and what belongs to the seam stays.
    assert woven.length > 1.3 * path.length
    assert woven.tags[0] == "weld" and np.isnan(woven.speeds[-1]) == (path is BENT)
    if path is LINE:
        assert (woven.lengths / woven.speeds).sum() == pytest.approx(path.length / 0.01)


def test_corners_of_a_seam_remain_and_short_parts_are_not_woven():
    path = Path.polyline([[0.0, 0.0], [0.02, 0.0], [0.02, 0.002], [0.06, 0.002]])
    woven = weave_path(path, width=WIDTH, pitch=PITCH)
    corners = woven(woven.stops)
    np.testing.assert_allclose(corners, [[0.02, 0.0], [0.02, 0.002]], atol=1e-12)
    closed = Path(segments=[Arc.circle((0.03, 0.0), (0.0, 0.0))])
    around = weave_path(closed, width=WIDTH, pitch=PITCH)
    np.testing.assert_allclose(around(0.0), around(around.length), atol=1e-12)
    np.testing.assert_allclose(around(0.0, 1), around(around.length, 1, side="left"), atol=1e-9)


def test_the_orientation_of_a_woven_tool_follows_the_seam():
    half = Arc(start=[0.05, 0, 0.1], center=[0, 0, 0.1], angle=np.pi, normal=[0, 0, 1])
    ring = path_of(half).following_tangent([0, 0, 1])
    woven = weave_path(ring, width=WIDTH, pitch=PITCH)
    assert not woven.orientation.follows and len(woven.stops) == 0
    s = np.linspace(0, woven.length, 1001)
    x, y, _ = woven(s).T
    share = np.clip(np.abs(np.arctan2(y, x)) / np.pi, 0, 1)
    needed = Rotation.from_matrix(ring.orientation(share * ring.length))
    turn = Rotation.from_matrix(woven.orientation(s)) * needed.inv()
    # Less than half a pitch of seam ahead or behind; measured 0.142 pitches, at both ends.
    assert turn.magnitude().max() <= 0.15 * PITCH / 0.05


# ------------------------------------------------------------- seams as waypoints, over time


def waves(path, woven, offset):
    """Widths from crest to crest and frequencies, of offsets from the seam at even places.

    The first and the last two half waves, which grow and fade, are left out.
    """
    s = np.linspace(0, woven.length, len(offset))
    speeds = woven.speeds[woven.locate((s[1:] + s[:-1]) / 2)]
    t = np.concatenate([[0.0], np.cumsum(np.diff(s) / speeds)])
    zeros = np.flatnonzero(np.diff(np.sign(offset)) != 0)[2:-2]
    peaks = np.array([np.abs(offset[i:j]).max() for i, j in itertools.pairwise(zeros)])
    times = t[zeros]
    return peaks[1:] + peaks[:-1], 1 / (times[2:] - times[:-2])


@each("spacing", [0.2e-3, 1e-3, 4e-3, 20e-3])
@each("radius", [50e-3, 200e-3, 500e-3, np.inf])
def test_waypoints_are_woven_as_the_curve_through_them(radius, spacing):
    s = np.linspace(0, 0.1, round(0.1 / spacing) + 1)
    if np.isinf(radius):
        points = np.column_stack([s, np.zeros_like(s)])
    else:
        points = radius * np.column_stack([np.sin(s / radius), 1 - np.cos(s / radius)])
    path = Path.polyline(points, segment_limits=SegmentLimits(**SLOW))
    woven = weave_path(path, width=WIDTH, frequency=2.0)
    x, y = woven(np.linspace(0, woven.length, 40_001)).T
    lateral = y if np.isinf(radius) else radius - np.hypot(x, y - radius)
    width, frequency = waves(path, woven, lateral)
    assert len(width) > 30 and len(woven.stops) == 0
    np.testing.assert_allclose(width, WIDTH, rtol=5e-3)
    np.testing.assert_allclose(frequency, 2.0, rtol=0.02)


@each("spacing", [0.5e-3, 5e-3, 20e-3])
def test_a_saddle_is_woven_perpendicular_to_the_tool(spacing):
    def saddle(angle):
        x, y = 0.05 * np.cos(angle), 0.05 * np.sin(angle)
        return np.column_stack([x, y, np.sqrt(0.01 - y**2)])

    def axis(angle):
        return -np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)]) / np.sqrt(2)

    angles = np.linspace(0, 2 * np.pi, round(0.33 / spacing) + 1)
    path = Path.polyline(saddle(angles), segment_limits=SegmentLimits(**SLOW)).pointing(
        axis(angles)
    )
    woven = weave_path(path, width=WIDTH, pitch=PITCH, dwell=0.05)
    dense = np.linspace(0, 2 * np.pi, 100_001)
    seam = saddle(dense)
    points = woven(np.linspace(0, woven.length, 20_001))
    near = cKDTree(seam).query(points)[1]
    tangent = np.gradient(seam, dense, axis=0)[near]
    out = axis(dense[near])
    normal = np.cross(-out, tangent)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    lateral = np.sum((points - seam[near]) * normal, axis=1)
    width, frequency = waves(path, woven, lateral)
    np.testing.assert_allclose(width, WIDTH, rtol=3e-3)
    np.testing.assert_allclose(frequency, 0.01 / PITCH, rtol=0.01)
    assert np.abs(np.sum((points - seam[near]) * out, axis=1)).max() < 1e-2 * WIDTH
    assert woven.orientation is not None
    turned = woven.orientation(np.linspace(0, woven.length, 20_001))[:, :, 2]
    assert np.degrees(np.arccos(np.sum(turned * out, axis=1).clip(-1, 1))).max() < 1.0


def test_the_tool_stays_at_the_edges_for_the_dwell():
    woven = weave_path(LINE, width=WIDTH, frequency=1.0, dwell=0.1, speed=0.005)
    y = woven((woven.breaks[1:] + woven.breaks[:-1]) / 2)[:, 1]
    at_edge = np.abs(np.abs(y - 0.2) - WIDTH / 2) < 1e-5
    times = (woven.lengths / woven.speeds)[at_edge]
    # Ten waves at 5 mm/s; a sine has its full width except at the first and last crest.
    assert times.sum() == pytest.approx(0.1 * 18, rel=0.03)
    np.testing.assert_allclose(woven.speeds[at_edge], 0.005, rtol=1e-3)


def test_invalid_weaves_are_refused():
    def woven(path=LINE, **values):
        return lambda: weave_path(path, **{"width": WIDTH, "pitch": PITCH, **values})

    tall = Path.polyline([[0, 0, 0], [0, 0, 0.1]])
    comb = Path.polyline([[k * 1e-3, 1e-3 * (k % 2)] for k in range(20)])
    refused(
        (woven(BENT, width=0.04), "40 mm", "20 mm"),
        (woven(pitch=1e-9), "longer pitch"),
        (woven(width=-1.0), "width"),
        (woven(pitch=0.0), "pitch"),
        (woven(tall), "parallel"),
        (woven(pitch=None), "pitch and frequency"),
        (woven(BENT, pitch=None, frequency=2.0), "assigned velocity"),
        (woven(dwell=0.3), "0.2 s"),
        (woven(comb), "nothing is woven"),
        (woven(BENT, tolerance=1e-14), "tolerance"),
    )


# --------------------------------------------------- tool orientations per waypoint of a seam


def leaning(turn, *, axis_only):
    """Rotations whose tool axis points down and leans outwards by 0.3 rad, at angles [rad]."""
    lean = Rotation.from_rotvec([0.0, np.pi - 0.3, 0.0])
    about_z = Rotation.from_rotvec(np.column_stack([0 * turn, 0 * turn, turn]))
    return (about_z * lean).as_matrix()


@each("axis_only", [True, False])
@each("closed", [True, False])
def test_the_tool_turns_smoothly_through_the_waypoints_of_a_seam(axis_only, closed):
    turn = np.linspace(0, 2 * np.pi if closed else 2.0, 61)
    radius = 0.05 * (1 + 0.1 * np.cos(3 * turn))
    points = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), 0.01 * np.cos(turn)])
    rotations = leaning(turn, axis_only=axis_only)
    path = Path.polyline(points).oriented(rotations, axis_only=axis_only)
    woven = weave_path(path, width=WIDTH, pitch=PITCH)
    assert len(woven.stops) == 0
    # At each waypoint, the tool has the orientation of this waypoint.
    wave = np.column_stack([woven.breaks[:-1], woven(woven.breaks[:-1])])
    for point, rotation in zip(points[1:-1], rotations[1:-1], strict=True):
        near = wave[np.linalg.norm(wave[:, 1:] - point, axis=1) < 1.2 * WIDTH, 0]
        angles = [angle_of(woven.orientation(s), rotation, axis_only) for s in near]
        # The nearest vertex of the wave is less than a pitch of seam away.
        assert min(angles) <= PITCH / 0.045


def angle_of(first, second, axis_only):
    """Angle between two rotations [rad], or between their tool axes."""
    if axis_only:
        return np.arccos(np.clip(first[:, 2] @ second[:, 2], -1, 1))
    return (Rotation.from_matrix(first) * Rotation.from_matrix(second).inv()).magnitude()


def test_a_straight_seam_with_two_tool_axes_is_woven_without_a_stop():
    points = [[0.0, 0, 0], [0.03, 0, 0], [0.07, 0, 0]]
    axes = [[0.0, 0.0, -1], [0.0, 0.3, -1], [0.2, 0.3, -1]]
    woven = weave_path(Path.polyline(points).pointing(axes), width=WIDTH, pitch=PITCH)
    assert len(woven.stops) == 0
    middle = woven.length * 3 / 7
    needed = np.array(axes[1]) / np.linalg.norm(axes[1])
    # The woven length is not exactly proportional to that of the seam, near both ends.
    assert angle_of(woven.orientation(middle), needed[:, None] * [[0, 0, 1]], True) <= 0.02
    np.testing.assert_allclose(woven.orientation(woven.length)[:, 2] @ axes[2], 1.063, atol=1e-3)


def test_a_seam_of_waypoints_keeps_the_angle_to_its_tangent():
    turn = np.linspace(0, 1.5, 40)
    points = np.column_stack([0.1 * np.sin(turn), 0.06 * np.cos(turn), 0 * turn])
    path = Path.polyline(points).following_tangent([0, 0, 1])
    woven = weave_path(path, width=WIDTH, pitch=PITCH)
    assert len(woven.stops) == 0
    # Tangents of the ellipse at waypoints, away from the ends of the weave.
    for k in range(5, 35):
        tangent = np.array([0.1 * np.cos(turn[k]), -0.06 * np.sin(turn[k]), 0.0])
        tangent /= np.linalg.norm(tangent)
        s = woven.project(points[k : k + 1]).s
        assert np.arccos(woven.orientation(s)[0, :, 0] @ tangent) <= PITCH / 0.036
