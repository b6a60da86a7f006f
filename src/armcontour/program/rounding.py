"""Corner rounding of whatever holds paths."""

from __future__ import annotations

import dataclasses
from typing import overload

import numpy.typing as npt

from armcontour.geometry import Path, RoundedPath
from armcontour.geometry import round_corners as round_path
from armcontour.program.moves import Contour, Program


@overload
def round_corners(
    path: Path,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
) -> RoundedPath: ...
@overload
def round_corners(
    path: Program,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
) -> Program: ...
def round_corners(
    path: Path | Program,
    *,
    tolerance: npt.ArrayLike | None = None,
    speed: npt.ArrayLike | None = None,
    acceleration: npt.ArrayLike | None = None,
    angular_tolerance: float | None = None,
) -> Path | Program:
    """Round every corner of a path, or of every contour of a program.

    A corner needs `tolerance` (case II), or `speed` and `acceleration` (case I).
    `armcontour.geometry.round_corners` says what each case does.

    Args:
        path: The objective path, or the program.
        tolerance: Largest corner error [m]. For a path one value, or one per vertex; for a program
            one value for all corners, which is true of the next two as well.
        speed: Lowest speed on a corner [m/s].
        acceleration: Centripetal acceleration at that speed [m/s²]. With `tolerance` alone this
            value only sets the corner speeds that are reported.
        angular_tolerance: Largest angle by which the tool orientation may be off [rad].

    Raises:
        InvalidInput: Neither case is given, a value is negative, the number of values is wrong, or
            the orientation needs an angular tolerance and there is none.
    """
    program = Program.of(path, "round_corners needs a Path or a Program")
    moves = [
        _with_path(
            x,
            round_path(
                x.path,
                tolerance=tolerance,
                speed=speed,
                acceleration=acceleration,
                angular_tolerance=angular_tolerance,
            ),
        )
        if isinstance(x, Contour)
        else x
        for x in program.moves
    ]
    rounded = dataclasses.replace(program, moves=tuple(moves))
    # Whoever gives a path gets a path.
    return rounded if program is path else rounded.path


def _with_path(contour: Contour, path: RoundedPath) -> Contour:
    """The contour on its rounded path, with its events and its work moved to their new places."""
    places = path.place([x.s for x in contour.events])
    events = tuple(
        dataclasses.replace(x, s=float(s)) for x, s in zip(contour.events, places, strict=True)
    )
    work = None
    if contour.work is not None:
        begin, end = path.place(contour.work)
        work = (float(begin), float(end))
    return dataclasses.replace(contour, path=path, events=events, work=work)
