"""Corner rounding of a path or of all contours of a program."""

from __future__ import annotations

import dataclasses
from typing import overload

import numpy.typing as npt

from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.geometry import round_corners as round_path
from armcontour.geometry.rounding import Continuity
from armcontour.program.moves import Contour, Program


@overload
def round_corners(
    path: Path,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> RoundedPath: ...
@overload
def round_corners(
    path: Program,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> Program: ...
def round_corners(
    path: Path | Program,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
    continuity: Continuity = "tangent",
) -> Path | Program:
    """Round every corner of a path, or of every contour of a program.

    A corner needs `tolerance` (case II), or `speed` and `acceleration` (case I).
    `armcontour.geometry.round_corners` describes both cases.

    Args:
        path: The objective path, or the program.
        tolerance: Largest corner error [m]. This and the next two arguments are one value for all
            corners or, for a path, one value per vertex between segments.
        speed: Lowest speed on a corner [m/s].
        acceleration: Centripetal acceleration at that speed [m/s²]. With `tolerance` alone this
            value only sets the corner speeds that are reported.
        angular_tolerance: Largest angle between the tool orientation and its value at the vertex
            [rad].
        continuity: "tangent", or "curvature" for corners that can be run without stopping under a
            limit of jerk.

    Raises:
        InvalidInput: Neither case is given, a value is negative, the number of values is wrong, or
            the orientation needs an angular tolerance and there is none.
    """
    program = Program.of(path, "round_corners needs a Path or a Program")
    moves = [
        put_on_path(
            x,
            round_path(
                x.path,
                tolerance=tolerance,
                speed=speed,
                acceleration=acceleration,
                angular_tolerance=angular_tolerance,
                continuity=continuity,
            ),
        )
        if isinstance(x, Contour)
        else x
        for x in program.moves
    ]
    rounded = dataclasses.replace(program, moves=tuple(moves))
    # Whoever gives a path gets a path.
    return rounded if program is path else rounded.path


def put_on_path(contour: Contour, path: RoundedPath | ShapedPath) -> Contour:
    """The contour on the path that replaces its own, with events and work at their places there.

    Args:
        contour: The contour on its objective path.
        path: The path that replaces the objective path.
    """
    arc_lengths = path.place([x.s for x in contour.events])
    events = tuple(
        dataclasses.replace(x, s=float(s)) for x, s in zip(contour.events, arc_lengths, strict=True)
    )
    work = None
    if contour.work is not None:
        start, end = path.place(contour.work)
        work = (float(start), float(end))
    return dataclasses.replace(contour, path=path, events=events, work=work)
