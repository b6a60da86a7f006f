"""Corner rounding and curvature smoothing for a path or all contours of a program."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from typing import Any, Literal, TypeAlias, get_args, overload

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray
from armcontour.core.fields import checked, texts_to_si
from armcontour.core.memory import content_key, is_remembering, remembered
from armcontour.core.quantities import Quantity
from armcontour.core.text import capitalise
from armcontour.geometry import Path, RoundedPath, round_path
from armcontour.geometry.rounding.rounded_path import describe_large_tolerance
from armcontour.program.moves import Contour, Move, Program, put_on_path

# Continuity of a rounded path: only the tangent is continuous, or also the curvature.
Continuity: TypeAlias = Literal["tangent", "curvature"]
CONTINUITIES: tuple[Continuity, ...] = get_args(Continuity)


@overload
def round_corners(
    path: Path,
    tolerance: npt.ArrayLike | None = None,
    *,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> RoundedPath: ...
@overload
def round_corners(
    path: Program,
    tolerance: npt.ArrayLike | Callable[[Path], npt.ArrayLike] | None = None,
    *,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> Program: ...
@checked
def round_corners(
    path: Path | Program,
    tolerance: npt.ArrayLike | Callable[[Path], npt.ArrayLike] | None = None,
    *,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> Path | Program:
    """Round every corner of a path, or of every contour of a program.

    A corner needs `tolerance` (case II), or `speed` and `acceleration` (case I).
    `armcontour.geometry.round_path` describes both cases.

    >>> rounded = ac.round_corners(objective, tolerance=1e-3)
    >>> rounded.length < objective.length
    True

    Args:
        path: The objective path, or the program.
        tolerance: Largest corner error [m]. This and the next two arguments are one value for all
            corners or, for a path, one value per vertex between segments. For a program,
            `tolerance` may be a function that gives these values for the path of a contour.
        speed: Lowest speed on a corner [m/s].
        acceleration: Centripetal acceleration at that speed [m/s²]. With `tolerance` alone this
            value only sets the reported corner speeds.
        angular_tolerance: Largest angle between the tool orientation and its value at the vertex
            [rad].
        continuity: "tangent", or "curvature" for corners that a motion with a jerk limit passes
            without a stop.

    Raises:
        InvalidInput: Neither case is specified, a value is negative, their number is wrong, or
            the orientation needs an angular tolerance.

    Warns:
        UserWarning: The tolerance is larger than the path.
    """
    tolerance = texts_to_si(tolerance, Quantity("m", "1 mm"), "tolerance")
    speed = texts_to_si(speed, Quantity("m/s", "50 mm/s"), "speed")
    acceleration = texts_to_si(acceleration, Quantity("m/s^2", "1 m/s^2"), "acceleration")

    options: dict[str, Any] = {
        "speed": speed,
        "acceleration": acceleration,
        "angular_tolerance": angular_tolerance,
        "curve": "smooth" if continuity == "curvature" else "arc",
    }
    key: tuple[Hashable, ...] = ()
    if is_remembering():
        key = "rounded", content_key((None if callable(tolerance) else tolerance, options))

    def rounded(path: Path) -> RoundedPath:
        """Round the corners of one path."""
        if callable(tolerance):
            return round_path(path, tolerance=tolerance(path), **options)
        return remembered((*key, path), lambda: round_path(path, tolerance=tolerance, **options))

    if isinstance(path, Path):
        rounded_path = rounded(path)
        for doubt in () if callable(tolerance) else describe_large_tolerance(path, tolerance):
            warnings.warn(capitalise(doubt), stacklevel=3)
        return rounded_path
    program = Program.from_path(path)
    moves: list[Move] = []
    for move in program.moves:
        if isinstance(move, Contour):
            rounded_path = rounded(move.path)
            moves.append(put_on_path(move, rounded_path, rounded_path.place))
        else:
            moves.append(move)
    return replace(program, moves=tuple(moves))


@overload
def smooth_curvature(path: Path, *, tolerance: float) -> Path: ...
@overload
def smooth_curvature(path: Program, *, tolerance: float) -> Program: ...
@checked
def smooth_curvature(path: Path | Program, *, tolerance: float) -> Path | Program:
    """Insert transitions where the curvature of a path, or of a program's contours, jumps.

    Where lines and arcs meet without a corner the curvature jumps, so a motion with a jerk limit
    stops there. A transition uses as much of both segments as the tolerance and their lengths
    allow. Its deviation from the path is proven to be at most the tolerance. Corners are not
    changed: round them with `round_corners` and continuity "curvature", before or after. The jump
    remains where less than a micrometre is available for a transition, or where the tool
    orientation requires a stop.

    Speeds, tolerances and tags stay on their sides of each vertex; events and the tool orientation
    keep their positions.

    Args:
        path: The path, or the program.
        tolerance: Largest distance of either path from the other [m]; tolerances of the path's own
            segments cap it.

    Raises:
        InvalidInput: The tolerance is not above zero; or a path was shaped, or its tool orientation
            was rounded.
    """
    from armcontour.geometry.rounding.curvature_smoothing import smooth_curvature as smooth_path

    program = Program.from_path(path)
    moves = []
    for move in program.moves:
        if isinstance(move, Contour):
            smoothed, pairs = smooth_path(move.path, tolerance)
            move = put_on_path(move, smoothed, partial(_interpolate, pairs))
        moves.append(move)
    smooth = replace(program, moves=tuple(moves))
    return smooth if program is path else smooth.path


def draw_with_arcs(contour: Contour) -> Contour:
    """Replace the transitions of a contour's path by arcs."""
    from armcontour.geometry.arc_fit import draw_with_arcs as draw_path

    if not contour.path.segments.is_transition.any():
        return contour
    path, pairs = draw_path(contour.path)
    return put_on_path(contour, path, partial(_interpolate, pairs))


def _interpolate(pairs: FloatArray, s: FloatArray) -> FloatArray:
    """Return arc lengths on the second path that correspond to those on the first path [m], (m,).

    - `pairs`: corresponding arc lengths on both paths [m], (n, 2).
    - `s`: arc lengths on the first path [m], (m,).
    """
    return np.interp(s, pairs[:, 0], pairs[:, 1])
