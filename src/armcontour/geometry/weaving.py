"""Paths that weave to both sides of a seam, for welds."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.frames import log
from armcontour.geometry.cutting import cut_path, join_paths
from armcontour.geometry.fit import fit_arcs
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.path import Path
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments

SHAPES = ("sine", "zigzag")
UP = _checks.lock_floats([0.0, 0.0, 1.0])
# Points of a sine per pitch at first, how often their number may double, and the most points.
SAMPLES, MOST_DOUBLINGS, MOST_POINTS = 64, 6, 2_000_000
# Smallest sine of the angle between up and the tangent: below it a seam has no sides.
UPRIGHT = 1e-6
# Points between two samples at which a sine is compared with its spline, as fractions.
BETWEEN = np.array([0.25, 0.5, 0.75])


def weave_path(
    path: Path,
    *,
    width: float,
    pitch: float,
    shape: str = "sine",
    up: npt.ArrayLike = UP,
    tolerance: float = 1e-5,
) -> Path:
    """The path that weaves along a seam, square to it and to `up`.

    Every part of the seam between two corners gets a whole number of waves, of about the pitch; a
    part of less than half a pitch is not woven. Parts start and end on the seam. A sine grows from
    nothing within the first half of its first wave and fades in the last half, so that it leaves
    and meets the seam along its tangent. Speeds are along the seam, as a mean over waves: the
    assigned velocity of the woven path is greater by the ratio of its length to that of the seam.
    Tolerances, tags and the tool orientation are those of the seam at the same share of the length,
    which is less than half a pitch off.

    Args:
        path: The seam.
        width: Distance between the crests on both sides [m].
        pitch: Length of the seam per wave [m].
        shape: "sine", as tangent arcs, or "zigzag", as lines from crest to crest.
        up: For a seam in space, the direction that weaving is square to, (3,).
        tolerance: Largest distance of the arcs from the sine [m].

    Raises:
        InvalidInput: A value is not valid, the seam goes straight up, or an arc of the seam has a
            radius of no more than half the width.
    """
    _checks.positive("width of a weave", width, "m")
    _checks.positive("pitch of a weave", pitch, "m")
    _checks.choice("shape of a weave", shape, SHAPES)
    _checks.positive("tolerance of a weave", tolerance, "m")
    direction = _checks.numbers("up", up)
    if direction.shape != (3,) or not np.linalg.norm(direction) > 0:
        raise InvalidInput("up must be a direction in space.")
    _refuse_tight(path, width)
    if path.length / pitch * SAMPLES > MOST_POINTS:
        raise InvalidInput(
            f"A weave with a pitch of {pitch * 1e3:.4g} mm has {path.length / pitch:.3g} waves on "
            f"a seam of {path.length:.4g} m, more than {MOST_POINTS // SAMPLES}: take a longer "
            "pitch."
        )
    ends = [0.0, *path.breaks[1:-1][path.turns > TANGENT_TOLERANCE].tolist(), path.length]
    parts = []
    for begin, end in zip(ends[:-1], ends[1:], strict=True):
        seam = path if len(ends) == 2 else cut_path(path, begin, end)
        waves = round(seam.length / pitch)
        wave = _Wave(seam=seam, width=width, waves=waves, up=direction / np.linalg.norm(direction))
        parts.append(_woven(wave, shape, tolerance) if waves else seam)
    return join_paths(parts)


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Wave:
    """A weave along a part of a seam without corners.

    Args:
        seam: The part.
        width: Distance between crests [m].
        waves: Number of waves.
        up: Unit vector, (3,).
    """

    seam: Path
    width: float
    waves: int
    up: FloatArray

    def beside(self, s: FloatArray, off: FloatArray) -> FloatArray:
        """Points at distances to the left of the seam [m], (n, dimension)."""
        tangents = self.seam(s, 1)
        if self.seam.dimension == 2:
            left = np.column_stack([-tangents[:, 1], tangents[:, 0]])
        else:
            left = np.cross(self.up, tangents)
            size = np.linalg.norm(left, axis=1)
            if size.min() < UPRIGHT:
                raise InvalidInput("A seam that goes straight up has no sides to weave to.")
            left /= size[:, None]
        return np.asarray(self.seam(s) + off[:, None] * left)

    def sine(self, s: FloatArray) -> FloatArray:
        """Points of the sine, which grows and fades over half a wave, (n, dimension)."""
        phase = s / self.seam.length * self.waves
        grown = np.clip(2 * np.minimum(phase, self.waves - phase), 0.0, 1.0)
        off = self.width / 2 * grown**2 * (3 - 2 * grown) * np.sin(2 * np.pi * phase)
        return self.beside(s, off)

    def crests(self) -> FloatArray:
        """Start, crests and end of the zigzag, (2 waves + 2, dimension)."""
        crest = np.arange(2 * self.waves)
        s = (2 * crest + 1) / (4 * self.waves) * self.seam.length
        off = np.where(crest % 2, -1.0, 1.0) * self.width / 2
        return np.concatenate(
            [self.seam([0.0]), self.beside(s, off), self.seam([self.seam.length])]
        )


def _woven(wave: _Wave, shape: str, tolerance: float) -> Path:
    """The woven path of a part, with speeds, tolerances, tags and orientation of the seam."""
    seam = wave.seam
    if shape == "zigzag":
        segments = Segments.lines(wave.crests())
    else:
        segments = _fit_sine(wave, tolerance)
    breaks = segments.breaks
    ratio = float(breaks[-1]) / seam.length
    rows = seam.locate((breaks[:-1] + breaks[1:]) / 2 / ratio)
    orientation = None
    if seam.orientation is not None:
        orientation = _stretch(seam.orientation, segments, breaks / breaks[-1] * seam.length)
    columns = {name: getattr(seam.segments, name)[rows] for name in ("tolerances", "tags")}
    segments = segments.replace(speeds=seam.speeds[rows] * ratio, **columns)
    return Path(segments=segments, orientation=orientation)


def _stretch(orientation: Orientation, segments: Segments, s: FloatArray) -> Orientation:
    """The orientation of a seam on woven segments, which end at arc lengths `s` of the seam [m]."""
    starts = orientation(s[:-1])
    ends = orientation(s[1:], side="left")
    rates = log(ends @ starts.transpose(0, 2, 1)) / segments.lengths[:, None]
    if orientation.fixed:
        rates = np.zeros_like(rates)
    return Orientation.even(segments.lengths, starts, rates, axis_only=orientation.axis_only)


def _fit_sine(wave: _Wave, tolerance: float) -> Segments:
    """Tangent arcs along the sine of a part.

    Where the curvature of the seam jumps, the sine has a slight bend, which a cubic spline through
    its points rounds.

    Raises:
        InvalidInput: The tolerance is too small.
    """
    from scipy.interpolate import CubicSpline

    length = wave.seam.length
    ends = wave.seam([0.0, length], 1, side="left")
    for doubling in range(MOST_DOUBLINGS + 1):
        count = SAMPLES * 2**doubling * wave.waves
        if count > MOST_POINTS:
            break
        s = np.linspace(0.0, length, count + 1)
        spline = CubicSpline(s, wave.sine(s), bc_type=((1, ends[0]), (1, ends[1])))
        at = (s[:-1, None] + BETWEEN * (length / count)).ravel()
        off = np.linalg.norm(spline(at) - wave.sine(at), axis=1)
        if off.max() <= tolerance / 2:
            quarters = np.linspace(0.0, length, 4 * wave.waves + 1)
            return fit_arcs(partial(_derivative, spline), quarters, tolerance / 2)
    raise InvalidInput(
        f"The tolerance of {tolerance:g} m of a weave is too small for its seam: take a larger one."
    )


def _derivative(spline: object, s: FloatArray, order: int) -> FloatArray:
    """Point or derivative of a spline, as `fit_arcs` asks for it."""
    return np.asarray(spline(s, order))  # type: ignore[operator]


def _refuse_tight(path: Path, width: float) -> None:
    """Refuse arcs around whose centre a weave would turn back."""
    tightest = float(path.curvatures.max())
    if tightest * width / 2 >= 1:
        raise InvalidInput(
            f"A weave of {width * 1e3:.4g} mm is too wide for a seam that has an arc with a radius "
            f"of {1e3 / tightest:.4g} mm: half of the width must be less.",
            needed=width / 2,
            allowed=1 / tightest,
        )
