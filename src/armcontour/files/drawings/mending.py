"""Mending of vertices that the rounded coordinates of a drawing have bent."""

from __future__ import annotations

import dataclasses
import math

from armcontour.core.describing import digits
from armcontour.files.drawings.options import ReadOptions
from armcontour.geometry.tangent_repair import RepairedPath, repair_tangents
from armcontour.program import Contour, Program
from armcontour.program.moves import Move


def repair(program: Program, options: ReadOptions) -> Program:
    """The program with vertices made tangent that rounded coordinates can have bent.

    Contours with a tool orientation stay.

    Args:
        program: The program as it was read.
        options: How the drawing is read.
    """
    moves: list[Move] = list(program.moves)
    tolerances, changed = options.layer_tolerances, []
    for i, x in enumerate(moves):
        if not isinstance(x, Contour) or x.path.orientation is not None:
            continue
        most = tolerances.get(x.layer, math.inf)
        mended = repair_tangents(x.path, options.mend_vertices, most)
        if mended is not None:
            changed.append(mended)
            events = tuple(dataclasses.replace(y, s=float(mended.place(y.s))) for y in x.events)
            moves[i] = dataclasses.replace(x, path=mended.path, events=events)
    if not changed:
        return program
    notes = (*program.notes, _note(changed))
    return dataclasses.replace(program, moves=tuple(moves), notes=notes)


def _note(done: list[RepairedPath]) -> str:
    """A sentence on all that was mended."""
    count = sum(x.count for x in done)
    kink, deviation = (max(getattr(x, y) for x in done) for y in ("kink", "deviation"))
    what = f"{count} vertices, at which" if count > 1 else "1 vertex, at which"
    return (
        f"Mended {what} rounded coordinates can explain the turn of at most "
        f"{digits(math.degrees(kink), 2)}°: the path is tangent there, at most "
        f"{digits(deviation * 1e3, 2)} mm from the file's (path.mend_vertices: 0 mm keeps such "
        "turns, at which the tool stops)."
    )
