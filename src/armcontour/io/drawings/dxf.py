"""DXF drawings, read from their model space into a program of contours."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from armcontour._progress import Progress
from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings._dxf_document import line_of_handle, open_document, silence_log
from armcontour.io.drawings._dxf_walk import Found, Walk
from armcontour.io.drawings.affine import WITHOUT_Z
from armcontour.io.drawings.chaining import Piece, chain_pieces
from armcontour.io.drawings.clipping import clip_path
from armcontour.io.drawings.colors import count_names
from armcontour.io.drawings.mending import mend, printed_in_dxf
from armcontour.io.drawings.reading import WALKED, Reading, Tell, tell_share
from armcontour.io.drawings.shapes import Outline, paths_of
from armcontour.program import Program
from armcontour.program.moves import describe_not_run

# Lengths of the units of $INSUNITS [m], by the DXF reference; 0 is a drawing without a unit.
UNITS = {
    1: 0.0254,
    2: 0.3048,
    3: 1609.344,
    4: 1e-3,
    5: 1e-2,
    6: 1.0,
    7: 1e3,
    8: 25.4e-9,
    9: 25.4e-6,
    10: 0.9144,
    11: 1e-10,
    12: 1e-9,
    13: 1e-6,
    14: 0.1,
    15: 10.0,
    16: 100.0,
    21: 1200 / 3937,
    22: 100 / 3937,
    23: 3600 / 3937,
    24: 6336000 / 3937,
}


def read_dxf(
    data: bytes, *, source: str, reading: Reading, progress: Progress | None = None
) -> Program:
    """Read the contours of a DXF drawing.

    Lines and arcs are kept; ellipses and splines become arcs within the chord tolerance. If all
    points have z = 0, the program is in the plane, otherwise in space. A contour is named after
    the handle of its first entity; in a block, the handle of the INSERT comes before.

    Args:
        data: Content of the file, ASCII or binary.
        source: Name of the file.
        reading: Settings of the reader.
        progress: Called from time to time with the name of the source and the share of it that is
            read.

    Raises:
        InvalidInput: The file is not readable as DXF, the unit is not known, an entity is unknown
            and unknown entities are refused, or there is no contour.
    """
    with silence_log(), np.errstate(all="ignore"):
        skip = reading.unknown == "skip"
        document, notes = open_document(data, source, skip=skip)
        walk = Walk(
            document=document,
            source=source,
            skip=skip,
            line_of=partial(line_of_handle, data),
            wanted=reading.layers,
            colors=reading.colors,
            texts=reading.texts == "contours",
        )
        tell = tell_share(progress, source)
        unit = _unit(document, source, reading)
        found = list(walk.shapes(unit, tell))
        pieces = _pieces(found, walk, source, reading, tell)
    notes += walk.notes
    if not pieces:
        if walk.elsewhere:
            wanted = ", ".join(repr(x) for x in sorted(reading.layers or ()))
            there = list_some([repr(x) for x in sorted(walk.elsewhere)], 12)
            raise InvalidInput(
                f"{source} has no contour on the layer {wanted}: it has entities on {there}."
            )
        if walk.others:
            notes.append(f"Of other colours than chosen: {count_names(walk.others)}.")
        left_out = f" ({' '.join(notes).rstrip('.')})" if notes else ""
        raise InvalidInput(f"{source} has no contour to follow in its model space{left_out}.")
    contours, chaining_notes = chain_pieces(pieces, reading.join_tolerance)
    if not contours:
        raise InvalidInput(
            f"{source} has no contour that is longer than the join tolerance of "
            f"{reading.join_tolerance:g} m."
        )
    notes = [*notes, *chaining_notes]
    program = Program(
        moves=tuple(contours),
        source=source,
        notes=tuple(notes),
        remarks=describe_not_run(walk.elsewhere),
    )
    printed = printed_in_dxf(data, unit)
    return mend(program, lambda _: printed, reading)


def _unit(document: Any, source: str, reading: Reading) -> float:
    """Length of the drawing's unit [m].

    Raises:
        InvalidInput: Neither the reading nor the drawing has a known unit.
    """
    if reading.unit is not None:
        return reading.unit
    code = document.header.get("$INSUNITS", 0)
    if code in UNITS:
        return UNITS[code]
    why = "does not say its unit" if code == 0 else f"has the unit {code!r}, which is not known"
    raise InvalidInput(f"{source} {why} ($INSUNITS): give it, such as `units: mm` or --units mm.")


def _pieces(
    found: list[Found], walk: Walk, source: str, reading: Reading, tell: Tell
) -> list[Piece]:
    """Paths of the shapes, in the plane if all z are 0, otherwise in space.

    Raises:
        InvalidInput: A shape makes no path.
    """
    flat = all(np.abs(x.shape.reach[:, 2]).max() <= REPEATED_POINT for x in found)
    outlines = [Outline([x.shape.place(WITHOUT_Z) if flat else x.shape]) for x in found]
    try:
        paths = paths_of(
            outlines,
            reading.chord_tolerance,
            tell=lambda share: tell(WALKED + (1 - WALKED) * share),
        )
    except InvalidInput as error:
        assert error.index is not None
        x, reason = found[error.index], str(error)
        raise InvalidInput(
            f"{source}: {x.kind} {x.name} on layer {x.layer!r} makes no contour: "
            f"{reason[:1].lower()}{reason[1:]}"
        ) from None
    pieces: list[Piece] = []
    for x, path in zip(found, paths, strict=True):
        if path is None:
            walk.empty.append(x.name)
            continue
        parts = [path]
        for clip in x.clips:
            if not flat or np.abs(clip.corners[:, 2]).max() > REPEATED_POINT:
                raise InvalidInput(
                    f"{source}: {x.kind} {x.name} on layer {x.layer!r} is in a block that is "
                    "clipped in space, which is not read: clip drawings at z = 0 only."
                )
            parts = [y for part in parts for y in clip_path(part, clip.place(WITHOUT_Z))]
        names = [x.name] if len(parts) == 1 else [f"{x.name}[{k + 1}]" for k in range(len(parts))]
        pieces += [
            Piece(path=part, name=name, layer=x.layer)
            for part, name in zip(parts, names, strict=True)
        ]
    return pieces
