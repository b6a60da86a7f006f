"""Corner rounding of whatever holds paths."""

from __future__ import annotations

import dataclasses
from typing import Any, overload

from armcontour.geometry import Path, RoundedPath
from armcontour.geometry import round_corners as round_path
from armcontour.program.moves import Contour, Move, Program


@overload
def round_corners(path: Path, **options: Any) -> RoundedPath: ...
@overload
def round_corners(path: Program, **options: Any) -> Program: ...
def round_corners(path: Path | Program, **options: Any) -> RoundedPath | Program:
    """Round every corner of a path, or of every contour of a program.

    Args:
        path: The objective path, or the program.
        options: As in `armcontour.geometry.round_corners`: `tolerance`, `speed`, `acceleration`,
            `angular_tolerance`; for a program one value for all corners.

    Raises:
        InvalidInput: As there.
    """
    if isinstance(path, Path):
        return round_path(path, **options)
    moves: list[Move] = []
    for x in path.moves:
        moves.append(_rounded(x, options) if isinstance(x, Contour) else x)
    return dataclasses.replace(path, moves=tuple(moves))


def _rounded(contour: Contour, options: dict[str, Any]) -> Contour:
    path = round_path(contour.path, **options)
    places = path.place([x.s for x in contour.events])
    events = tuple(
        dataclasses.replace(x, s=float(s)) for x, s in zip(contour.events, places, strict=True)
    )
    work = None
    if contour.work is not None:
        begin, end = path.place(contour.work)
        work = (float(begin), float(end))
    return dataclasses.replace(contour, path=path, events=events, work=work)
