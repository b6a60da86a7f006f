"""What the decimals of a drawing can hold, and the mending of vertices that printing has bent."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Mapping
from itertools import islice

from armcontour._describing import digits
from armcontour.geometry.mending import Mended, Printed, mend_vertices
from armcontour.io.drawings.options import ReadOptions
from armcontour.program import Contour, Program
from armcontour.program.moves import Move

# Longest part of a file in which decimals are counted [bytes], and most numbers of other texts.
COUNTED = 100_000
MOST_NUMBERS = 10_000
# Numbers are printed with as many decimals as this share of them has at most: zeros at the end may
# be cut off, and single numbers may be written in another way.
MOST = 0.95
DECIMALS = re.compile(r"\.([0-9]+)(?:[eE]([-+]?[0-9]{1,3}))?")
GCODE = re.compile(rb"[XYZIJKRxyzijkr][ \t]*[-+]?[0-9]*\.([0-9]+)")
RADIUS = re.compile(rb"[Gg][ \t]*0?[23][ \t]*[A-Za-z][^\r\n(;]*[Rr][ \t]*[-+]?[0-9.]")
# Group codes of DXF: coordinates, bulges, and angles of arcs.
DXF_POINT = re.compile(rb"\n[ \t]*[123][0-8][ \t]*\r?\n[ \t]*[-+]?[0-9]*\.([0-9]+)")
DXF_BULGE = re.compile(rb"\n[ \t]*42[ \t]*\r?\n[ \t]*[-+]?[0-9]*\.([0-9]+)")
DXF_ANGLE = re.compile(rb"\n[ \t]*5[01][ \t]*\r?\n[ \t]*[-+]?[0-9]*\.([0-9]+)")


def half_a_place(texts: Iterable[str]) -> float:
    """Half of the last decimal place of the numbers in some texts."""
    found = islice((x for text in texts for x in DECIMALS.findall(text)), MOST_NUMBERS)
    return _half_a_place([len(digits) - int(exponent or 0) for digits, exponent in found])


def printed_in_gcode(data: bytes, unit: float) -> Printed:
    """What the coordinates of G-code can hold, in a unit of so many metres."""
    part = data[:COUNTED]
    by_radius = RADIUS.search(part) is not None
    return Printed(point=_half_a_place_of(GCODE, part) * unit, by_radius=by_radius)


def printed_in_dxf(data: bytes, unit: float) -> Printed:
    """What coordinates, bulges and angles of DXF can hold, in a unit of so many metres.

    A binary file holds numbers to their last digit.
    """
    # The header has numbers of other formats.
    begin = data.find(b"ENTITIES")
    if begin < 0 or b"\0" in data[:COUNTED]:
        return Printed(point=0.0)
    part = data[begin : begin + COUNTED]
    # A bulge is the tangent of a quarter of the angle: either end turns by twice its error.
    bulge = 2 * _half_a_place_of(DXF_BULGE, part) if DXF_BULGE.search(part) else 0.0
    angle = math.radians(_half_a_place_of(DXF_ANGLE, part)) if DXF_ANGLE.search(part) else 0.0
    return Printed(point=_half_a_place_of(DXF_POINT, part) * unit, angle=max(bulge, angle))


def _half_a_place_of(pattern: re.Pattern[bytes], data: bytes) -> float:
    """Half of the last decimal place of the numbers that a pattern finds."""
    return _half_a_place([len(x) for x in pattern.findall(data)])


def _half_a_place(places: list[int]) -> float:
    """Half of the last decimal place of numbers with so many places each; 0.5 without numbers."""
    most = sorted(places)[math.ceil(MOST * len(places)) - 1] if places else 0
    # Exponents can overflow; a file of such numbers has no decimals.
    return 0.5 * 10.0 ** -max(most, 0)


def mend(
    program: Program, printed: Printed | Mapping[str, Printed], options: ReadOptions
) -> Program:
    """The program with vertices made tangent again that printing has bent.

    Contours with a tool orientation stay.

    Args:
        program: The program as it was read.
        printed: What the coordinates can hold, each for itself: of all contours, or by their names.
        options: How the drawing is read.
    """
    if options.mend_vertices == 0:
        return program
    moves: list[Move] = list(program.moves)
    tolerances, changed = options.layer_tolerances, []
    for i, x in enumerate(moves):
        if not isinstance(x, Contour) or x.path.orientation is not None:
            continue
        own = printed if isinstance(printed, Printed) else printed[x.name]
        most = tolerances.get(x.layer, math.inf)
        mended = mend_vertices(x.path, _held(own, x.path.dimension, options), most)
        if mended is not None:
            changed.append(mended)
            events = tuple(dataclasses.replace(y, s=float(mended.place(y.s))) for y in x.events)
            moves[i] = dataclasses.replace(x, path=mended.path, events=events)
    if not changed:
        return program
    notes = (*program.notes, _note(changed))
    return dataclasses.replace(program, moves=tuple(moves), notes=notes)


def _held(printed: Printed, dimension: int, options: ReadOptions) -> Printed:
    """What coordinates can hold, from half of their last place or as the reading says it."""
    point = options.mend_vertices
    if point is None:
        # Every coordinate of a point can be off.
        point = min(math.sqrt(dimension) * printed.point, options.fit_tolerance)
    return dataclasses.replace(printed, point=point)


def _note(done: list[Mended]) -> str:
    """A sentence on all that was mended."""
    count = sum(x.count for x in done)
    kink, deviation = (max(getattr(x, y) for x in done) for y in ("kink", "deviation"))
    what = f"{count} vertices, at which" if count > 1 else "1 vertex, at which"
    return (
        f"Mended {what} the decimals of the file leave a turn of at most "
        f"{digits(math.degrees(kink), 2)}°: the path is tangent there, at most "
        f"{digits(deviation * 1e3, 2)} mm from the file's (path.mend_vertices: 0 mm keeps such "
        "turns, at which the tool stops)."
    )
