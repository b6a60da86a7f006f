"""Paths that weave to both sides of a seam, for welds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import NO_KEY, Duration, Frequency, Size, Speed, Tolerance
from armcontour.core.text import Keys
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.path import Path, cut_path
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments

UP = checks.frozen_array([0.0, 0.0, 1.0])
# Number of points per pitch on a sine at first; it is doubled until the tolerance is satisfied.
SAMPLES = 64
# The number of points on a sine is doubled at most this number of times.
MAX_DOUBLINGS = 6
# Largest number of points on a sine.
MAX_POINTS = 2_000_000
# Smallest sine of the angle between the tool axis and the tangent. Below it, the direction of the
# weave is undefined.
PARALLEL = 1e-6
# Fractions between two samples at which the sine is compared with its spline.
TEST_FRACTIONS = np.array([0.25, 0.5, 0.75])
# A vertex with a larger turn than this [rad] is a corner of the seam. A vertex that is not a corner
# is a waypoint of a smooth seam.
CORNER_TURN = np.radians(30.0)
# A vertex with a larger turn than this [rad] is a corner of the seam if its turn also exceeds
# CORNER_RATIO times the turns of its neighbours.
SMALL_CORNER_TURN = np.radians(5.0)
# Ratio to the turns of its neighbours above which the turn of a vertex stands out as a corner.
CORNER_RATIO = 3.0
# Waypoints closer than this multiple of the pitch are removed, if the smooth seam passes close
# enough to them; see SEAM_DEVIATION.
CLOSE_WAYPOINTS = 0.25
# Largest distance of the smooth seam from removed waypoints, as a fraction of the weave's width.
SEAM_DEVIATION = 0.005
# Largest turn of an arc between two waypoints [rad].
MAX_TURN = np.radians(10.0)
# Number of places per pitch at which the distance of the smooth seam from the path is measured.
PLACES_PER_PITCH = 16
# Relative rounding error of lengths.
LENGTH_ROUNDING = 1e-12
# If at least this fraction of a seam is too short for the weave, nothing is woven.
NOTHING_WOVEN = 0.999
# Remedies for a weave with neither pitch nor frequency, and with both.
FIRST_PITCH: tuple[dict[Keys, str], ...] = ({("pitch",): "2 mm"},)
ONE_OF_BOTH: tuple[dict[Keys, None], ...] = ({("frequency",): None}, {("pitch",): None})
# Columns of the seam's segments that its weave has unchanged.
SEAM_COLUMNS = ("tolerances", "tags", "origins")
# Largest fraction of the pitch for both dwells of a wave.
MAX_DWELL = 0.8


@declared()
class Weave(Checked):
    """Weaving to both sides of a seam, perpendicular to the seam and to the tool axis.

    Args:
        width: Distance between the crests on both sides [m].
        pitch: Length of the seam per wave [m]; specify this or the frequency.
        frequency: Waves per second at the assigned velocity [1/s].
        dwell: Time at each edge, during which the tool moves along the seam at its assigned
            velocity [s].
        speed: Assigned velocity along the seam [m/s]; by default that of the contour.
        tolerance: Largest distance of the arcs from the sine [m].
    """

    width: Size = field(kw_only=False)
    pitch: Size | None = None
    frequency: Frequency | None = None
    dwell: Duration = 0.0
    speed: Speed | None = None
    tolerance: Annotated[Tolerance, NO_KEY] = 1e-5

    def _check_together(self) -> None:
        if (self.pitch is None) == (self.frequency is None):
            raise InvalidInput(
                "A weave needs exactly one of pitch and frequency.",
                remedies=FIRST_PITCH if self.pitch is None else ONE_OF_BOTH,
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Woven:
    """Seam, crests and parameters of a woven path."""

    seam: Path
    crests: FloatArray  # Arc lengths of the seam at the crests that have the full width [m], (n,)
    width: float  # Distance between the crests on both sides [m]
    pitch: float  # Length of the seam per wave [m]
    # Waves per second at the assigned velocity [1/s]; NaN if the velocity changes along the seam
    frequency: float
    left_out: float  # Total length of seam parts that are too short for the weave [m]
    # Largest distance of the smooth seam, about which the path weaves, from the path [m]
    deviation: float


def weave_seam(path: Path, weave: Weave) -> tuple[Path, Woven]:
    """Weave perpendicular to a seam and to the tool axis; also return the weave's data.

    Vertices that turn by no more than 30° are waypoints of a smooth seam, a spline through them,
    unless a vertex turns by more than 5° and three times as much as both of its neighbours. All
    others are corners. Each part between two corners starts and ends on the seam. The amplitude of
    a sine rises within the first half pitch and decays within the last one, so the sine is tangent
    to the seam at both ends. A part of less than half a pitch is not woven. Speeds are along the
    seam, so each woven piece has an assigned velocity that is greater by the ratio of the lengths.
    Tolerances, tags and the tool orientation are those of the seam. A seam in space without
    orientation is woven perpendicular to z.
    """
    if weave.speed is not None:
        segments = path.segments.replace(speeds=np.full(len(path), weave.speed))
        path = replace(path, segments=segments)
    pitch, dwell_length = _pitch_and_dwell_length(path, weave)
    if path.length / pitch * SAMPLES > MAX_POINTS:
        raise InvalidInput(
            f"A weave with a pitch of {pitch * 1e3:.4g} mm has {path.length / pitch:.3g} waves on "
            f"a seam of {path.length:.4g} m, but at most {MAX_POINTS // SAMPLES} are supported. "
            "Specify a longer pitch."
        )
    ends = [0.0, *path.breaks[1:-1][_find_corners(path)].tolist(), path.length]
    parts = []
    seams = []
    crests = []
    left_out = 0.0
    seam_length = 0.0
    deviation = 0.0
    for begin, end in zip(ends[:-1], ends[1:], strict=True):
        part = path if len(ends) == 2 else cut_path(path, begin, end)
        seam, matched_s = _smooth_seam(part, pitch, weave.width)
        wave = _Wave(
            part=part,
            seam=seam,
            places=matched_s,
            width=weave.width,
            pitch=pitch,
            edge=dwell_length,
        )
        seams.append(seam)
        if part.length < pitch / 2:
            left_out += part.length
            parts.append(part)
        else:
            _check_radius(seam, weave.width)
            deviation = max(deviation, _distance_from_path(seam, part, pitch))
            crests.append(seam_length + wave.full_crests())
            parts.append(_weave_part(wave, weave.tolerance))
        seam_length += seam.length
    if left_out >= NOTHING_WOVEN * path.length:
        raise InvalidInput(
            f"The seam of {path.length * 1e3:.4g} mm has no part between corners that is as long "
            f"as half of the weave's pitch of {pitch * 1e3:.4g} mm, so nothing is woven. Specify a "
            "shorter pitch, or weave: null for this layer.",
            needed=pitch / 2,
            allowed=path.length,
        )
    assigned = float(path.speeds[0]) if (path.speeds == path.speeds[0]).all() else np.nan
    woven = Woven(
        seam=seams[0].joined(*seams[1:]),
        crests=np.concatenate(crests),
        width=weave.width,
        pitch=pitch,
        frequency=assigned / pitch,
        left_out=left_out,
        deviation=deviation,
    )
    return parts[0].joined(*parts[1:]), woven


def _pitch_and_dwell_length(path: Path, weave: Weave) -> tuple[float, float]:
    """Return the seam length per wave, and per dwell at an edge [m].

    Raises InvalidInput if the assigned velocity changes along a seam whose weave is defined over
    time, or if the dwells take too much of the pitch.
    """
    pitch = weave.pitch
    frequency = weave.frequency
    dwell = weave.dwell
    speed = float(path.speeds[0])
    if (frequency is not None or dwell) and not (path.speeds == speed).all():
        raise InvalidInput(
            "A weave with a frequency or a dwell needs one assigned velocity along the whole seam, "
            "because its waves are defined over time. Specify the velocity in the weave, such as "
            "weave: {speed: 6 mm/s}, or for the layer or file."
        )
    if frequency is not None:
        pitch = speed / frequency
    assert pitch is not None
    dwell_length = speed * dwell if dwell else 0.0
    if 2 * dwell_length > MAX_DWELL * pitch:
        raise InvalidInput(
            f"Two dwells of {dwell:.4g} s take {2e3 * dwell_length:.4g} mm of the weave's pitch of "
            f"{pitch * 1e3:.4g} mm at {speed * 1e3:.4g} mm/s, but at most {MAX_DWELL:.0%} of the "
            f"pitch is allowed. The dwell must be at most {MAX_DWELL * pitch / speed / 2:.4g} s.",
            needed=dwell,
            allowed=MAX_DWELL * pitch / speed / 2,
        )
    return pitch, dwell_length


def _find_corners(path: Path) -> npt.NDArray[np.bool_]:
    """Return the mask of inner vertices that are seam corners, (segments - 1,)."""
    turns = np.concatenate([[0.0], path.turns, [0.0]])
    neighbours = np.maximum(turns[:-2], turns[2:])
    sharp = (turns[1:-1] > SMALL_CORNER_TURN) & (turns[1:-1] > CORNER_RATIO * neighbours)
    return np.asarray((turns[1:-1] > CORNER_TURN) | sharp)


def _smooth_seam(path: Path, pitch: float, width: float) -> tuple[Path, FloatArray]:
    """Return the smooth seam, and corresponding arc lengths on seam and path [m], (n, 2).

    - `path`: a part of the seam without corners.
    - `pitch`, `width`: pitch and width of the weave [m].
    """
    from armcontour.geometry.spline import fit_spline

    if not (path.turns > TANGENT_TOLERANCE).any():
        ends = np.repeat([[0.0], [path.length]], 2, axis=1)
        return replace(path, orientation=None), ends
    parts = np.maximum(1, np.ceil(path.curvatures * path.lengths / MAX_TURN)).astype(int)
    steps = np.repeat(path.lengths / parts, parts)
    s = np.append(np.concatenate([[0.0], np.cumsum(steps)])[:-1], path.length)
    points = path(s)
    closed = path.segments.closed
    chosen = _select_waypoints(s, CLOSE_WAYPOINTS * pitch)
    while True:
        table, vertices = fit_spline(
            points[chosen], SEAM_DEVIATION * width / 10, closed, ends="not-a-knot"
        )
        seam = Path(segments=table)
        if chosen.all():
            break
        deviations = np.where(chosen, 0.0, seam.project(points).distance)
        if deviations.max() <= SEAM_DEVIATION * width:
            break
        # The farthest point of each interval is added to the waypoints of the spline.
        interval = np.cumsum(chosen)
        order = np.lexsort((-deviations, interval))
        farthest = order[np.unique(interval[order], return_index=True)[1]]
        chosen[farthest[deviations[farthest] > SEAM_DEVIATION * width]] = True
    return seam, np.column_stack([table.breaks[vertices], s[chosen]])


def _distance_from_path(seam: Path, path: Path, pitch: float) -> float:
    """Return the largest distance of a smooth seam from its path, between waypoints, too [m]."""
    count = int(PLACES_PER_PITCH * seam.length / pitch) + 2
    points = seam(np.linspace(0.0, seam.length, count))
    return float(path.project(points).distance.max())


def _select_waypoints(s: FloatArray, distance: float) -> npt.NDArray[np.bool_]:
    """Return the mask of the arc lengths at which a smooth seam has waypoints, (n,).

    They are the first arc length in each cell, and the last arc length.

    - `s`: increasing arc lengths [m], (n,).
    - `distance`: length of a cell [m].
    """
    chosen = np.append(np.diff(np.floor(s / distance), prepend=-1) > 0, True)[: len(s)]
    chosen[-1] = True
    # The last but one is not chosen if the spline would be short, and therefore curved, after it.
    inner = np.flatnonzero(chosen[:-1])
    if s[-1] - s[inner[-1]] < distance / 2 and len(inner) > 2:
        chosen[inner[-1]] = False
    return chosen


@dataclass(frozen=True, slots=True, kw_only=True)
class _Wave:
    """A weave along a part of a seam without corners."""

    part: Path
    seam: Path
    places: FloatArray  # Corresponding arc lengths of the seam and of the part [m], (n, 2)
    width: float  # Distance between crests [m]
    pitch: float  # Length of the seam per wave [m]
    edge: float  # Length of an edge: a part of the seam at a crest with constant offset [m]

    def on_part(self, s: FloatArray) -> FloatArray:
        """Return arc lengths on the part for arc lengths on the seam [m], (n,)."""
        return np.asarray(np.interp(s, *self.places.T))

    def offset_points(self, s: FloatArray, offset: FloatArray) -> FloatArray:
        """Return points at distance `offset` to the left of the seam [m], (n, dimension)."""
        tangents = self.seam(s, 1)
        if self.seam.dimension == 2:
            side = np.column_stack([-tangents[:, 1], tangents[:, 0]])
        else:
            up = UP
            orientation = self.part.orientation
            if orientation is not None:
                # The tool axis points from the tool to the work.
                up = -orientation(self.on_part(s))[:, :, 2]
            side = np.cross(up, tangents)
            size = np.linalg.norm(side, axis=1)
            if size.min() < PARALLEL:
                k = int(np.argmin(size))
                raise InvalidInput(
                    f"The weave has no direction at {s[k] * 1e3:.4g} mm along the seam, because "
                    "the seam is parallel to the tool axis there, or to z without one."
                )
            side /= size[:, None]
        return np.asarray(self.seam(s) + offset[:, None] * side)

    def turning_points(self) -> FloatArray:
        """Return the arc lengths at both ends of each edge that fits on the seam [m], (k, 2)."""
        count = int(np.ceil(self.seam.length / self.pitch))
        middles = (2 * np.arange(2 * count) + 1) / 4 * self.pitch
        edges = middles[:, None] + np.array([-0.5, 0.5]) * self.edge
        last_end = self.seam.length * (1 + LENGTH_ROUNDING) - (self.pitch / 2 - self.edge) / 2
        return np.asarray(edges[edges[:, 1] <= last_end])

    def full_crests(self) -> FloatArray:
        """Return the arc lengths of the edges' middles with full amplitude [m], (crests,)."""
        middle = self.turning_points().mean(axis=1)
        half = (self.pitch + self.edge) / 2
        return np.asarray(middle[(middle >= half) & (middle <= self.seam.length - half)])

    def sine(self, s: FloatArray) -> FloatArray:
        """Return points of the sine, (n, dimension); it rises and decays over half a pitch."""
        # The phase is constant along an edge, half of which is this fraction of the pitch.
        half_edge = self.edge / self.pitch / 2
        knots = [0.0, 0.25 - half_edge, 0.25 + half_edge, 0.75 - half_edge, 0.75 + half_edge, 1.0]
        phase = np.interp(s / self.pitch % 1, knots, [0.0, 0.25, 0.25, 0.75, 0.75, 1.0])
        # The amplitude rises smoothly from 0 to 1 within half a pitch of both ends.
        x = np.clip(2 * np.minimum(s, self.seam.length - s) / self.pitch, 0.0, 1.0)
        amplitude = x**2 * (3 - 2 * x)
        offset = self.width / 2 * amplitude * np.sin(2 * np.pi * phase)
        return self.offset_points(s, offset)


def _weave_part(wave: _Wave, tolerance: float) -> Path:
    """Weave along a part, with its speeds, tolerances, tags, origins and orientation."""
    part = wave.part
    seam = wave.seam
    pieces = np.unique([0.0, *wave.turning_points().ravel(), seam.length])
    segments, vertices = _fit_sine(wave, pieces, tolerance)
    ratio = np.repeat(np.diff(segments.breaks[vertices]) / np.diff(pieces), np.diff(vertices))
    seam_s = np.interp(segments.breaks, segments.breaks[vertices], pieces)
    rows = part.locate(wave.on_part((seam_s[:-1] + seam_s[1:]) / 2))
    columns = {name: getattr(part.segments, name)[rows] for name in SEAM_COLUMNS}
    segments = segments.replace(speeds=part.speeds[rows] * ratio, **columns)
    orientation = _orient_along(wave)
    if orientation is None:
        return Path(segments=segments)
    # The orientation follows the fraction of the woven path's length, so the tool turns evenly and
    # not with each wave.
    stretched = orientation.place(np.eye(3), segments.breaks[-1] / orientation.breaks[-1])
    breaks = np.append(stretched.breaks[:-1], segments.breaks[-1])
    return Path(segments=segments, orientation=replace(stretched, breaks=breaks))


def _orient_along(wave: _Wave) -> Orientation | None:
    """Return the tool orientation along the seam of a weave, None if it has none.

    On a smooth seam, the tool turns at a continuous rate through the orientations of the waypoints,
    so it does not stop there.
    """
    from armcontour.geometry.prescribed_orientation import carry_frame
    from armcontour.geometry.spline_orientation import turn_through

    orientation = wave.part.orientation
    if orientation is None:
        return None
    if orientation.follows:
        start = orientation.starts[0]
        carried = carry_frame(wave.seam.segments, start, axis_only=orientation.axis_only)
        return replace(carried, follows=False, cone=orientation.cone)
    on_part, on_seam = wave.places.T[::-1]
    is_same_curve = len(on_seam) == 2
    if orientation.fixed or (is_same_curve and not len(orientation.stops)):
        return orientation
    breaks = orientation.breaks
    s = np.interp(breaks, on_part, on_seam)
    rotations = orientation(breaks, side="left")
    turned = turn_through(s, rotations, axis_only=orientation.axis_only)
    return turned.with_cone(orientation.cone)


def _fit_sine(
    wave: _Wave, pieces: FloatArray, tolerance: float
) -> tuple[Segments, npt.NDArray[np.intp]]:
    """Fit tangent arcs to a part's sine; also return the vertex index at each of `pieces`.

    - `pieces`: arc lengths on the seam at which the arcs have a vertex [m], (k,).
    - `tolerance`: largest distance of the arcs from the sine [m].
    """
    # Where the curvature of the seam jumps, the sine has a slight kink. A cubic spline through its
    # points removes the kink.
    from scipy.interpolate import CubicSpline

    from armcontour.geometry.arc_fit import fit_through

    length = wave.seam.length
    end_tangents = wave.seam([0.0, length], 1, side="left")
    for doubling in range(MAX_DOUBLINGS + 1):
        count = int(np.ceil(SAMPLES * 2**doubling * length / wave.pitch))
        if count > MAX_POINTS:
            break
        s = np.linspace(0.0, length, count + 1)
        spline = CubicSpline(s, wave.sine(s), bc_type=((1, end_tangents[0]), (1, end_tangents[1])))
        midpoints = (s[:-1, None] + TEST_FRACTIONS * (length / count)).ravel()
        deviations = np.linalg.norm(spline(midpoints) - wave.sine(midpoints), axis=1)
        if deviations.max() <= tolerance / 2:
            return fit_through(spline, pieces, tolerance / 2)
    raise InvalidInput(
        f"The tolerance of a weave, {tolerance:g} m, is too small for its seam. Specify a larger "
        "tolerance."
    )


def _check_radius(seam: Path, width: float) -> None:
    """Raise InvalidInput for a seam with a radius below half the width."""
    middle = (seam.breaks[:-1] + seam.breaks[1:]) / 2
    samples = np.concatenate([seam.breaks, middle])
    tightest = float(np.linalg.norm(seam(samples, 2), axis=1).max())
    if tightest * width / 2 >= 1:
        raise InvalidInput(
            f"A weave of {width * 1e3:.4g} mm is too wide for its seam. Half of the width must be "
            f"less than the smallest radius of the seam, {1e3 / tightest:.4g} mm.",
            needed=width / 2,
            allowed=1 / tightest,
        )
