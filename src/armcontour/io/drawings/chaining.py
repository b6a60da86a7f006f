"""Pieces of a drawing chained end to end into contours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, IntArray, positive
from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings._ends import Ends, find_partners
from armcontour.io.drawings._pieces import Pieces
from armcontour.program import Contour

# Two pieces are the same if no point of one is further from the other [m]; the grid on which
# candidates are looked for is coarser.
SAME_PIECE = 1e-9
CANDIDATES = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """One entity of a drawing.

    Args:
        path: Its path [m].
        name: What it is called in its source.
        layer: The layer it is on.
        apart: Pieces with different numbers are never chained.
    """

    path: Path
    name: str
    layer: str
    apart: int = 0


def chain_pieces(pieces: Sequence[Piece], tolerance: float) -> tuple[list[Contour], list[str]]:
    """Contours of pieces of the same layer whose ends are nearer than a tolerance.

    A piece may be turned round; a contour has the direction, the name and the place in the order
    of its first piece. Closed pieces stay alone. Where more than two ends meet, the two that go on
    with the smallest turn are joined first, ends that touch before ends with a gap, and of equals
    those of earlier pieces. A gap is closed in its middle: the end of a line is moved, an arc keeps
    its angle and changes its size; where it would move too far, a short line closes the gap. No
    point moves by more than the tolerance.

    Pieces that lie exactly on others of their layer are left out, and so are open contours shorter
    than the tolerance, whose ends are one point.

    Args:
        pieces: All of them in the plane or all in space, without orientation.
        tolerance: Ends nearer than this are one point [m].

    Returns:
        The contours, and sentences on what was left out.

    Raises:
        InvalidInput: A tolerance that is not above zero, or pieces that do not fit.
    """
    positive("join tolerance", tolerance, "m")
    if not pieces:
        return [], []
    if len({x.path.dimension for x in pieces}) > 1:
        raise InvalidInput("Pieces to chain must all be in the plane or all in space.")
    if any(x.path.orientation is not None for x in pieces):
        raise InvalidInput("Pieces to chain must not have an orientation.")
    table = Pieces.of([x.path for x in pieces])
    # Not by numpy, whose texts are all as long as the longest.
    numbers: dict[tuple[str, int], int] = {}
    layers = np.array(
        [numbers.setdefault((x.layer, x.apart), len(numbers)) for x in pieces], dtype=np.intp
    )
    again = _find_repeated(pieces, table, layers)
    lengths = table.lengths
    ends = Ends.of(table, layers, again)
    partner = find_partners(ends, tolerance)
    contours, short = [], []
    for chain, closed in _chains(partner, again):
        first = pieces[min(chain) // 2]
        alone = len(chain) == 1 and not closed
        total = lengths[np.array(chain) // 2].sum()
        if total <= tolerance and not ((closed or alone) and _touches(ends, chain)):
            short.append(first.name)
            continue
        path = first.path if alone else table.join(chain, closed, tolerance)
        contours.append(Contour(path=path, name=first.name, layer=first.layer))
    return contours, _notes(pieces, again, short, tolerance)


def _touches(ends: Ends, chain: Sequence[int]) -> bool:
    """Whether all ends in a closed chain meet exactly."""
    entries = np.array(chain)
    gaps = ends.points[entries ^ 1] - ends.points[np.roll(entries, -1)]
    return bool((np.linalg.norm(gaps, axis=1) <= REPEATED_POINT).all())


def _chains(partner: IntArray, left_out: BoolArray) -> list[tuple[list[int], bool]]:
    """Ends at which the pieces of each chain are entered, and whether it is closed.

    End 2 i is the start of piece i, end 2 i + 1 its end.
    """
    joined = partner.tolist()
    used = left_out.tolist()
    chains = []
    for i in range(len(used)):
        if used[i]:
            continue
        # Back to the beginning, or once around.
        entry = 2 * i
        while joined[entry] >= 0:
            entry = joined[entry] ^ 1
            if entry == 2 * i:
                break
        closed = joined[entry] >= 0
        chain = []
        while entry >= 0 and not used[entry // 2]:
            used[entry // 2] = True
            chain.append(entry)
            entry = joined[entry ^ 1]
        chains.append((chain, closed))
    return chains


def _find_repeated(pieces: Sequence[Piece], table: Pieces, layers: IntArray) -> BoolArray:
    """Pieces that lie exactly on an earlier one of their layer."""
    n = len(pieces)
    feature = np.column_stack([table.starts + table.ends, table.middles, table.lengths])
    cell = np.column_stack([layers, np.round(feature / CANDIDATES)])
    group = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(group, kind="stable")
    runs = np.flatnonzero(np.diff(group[order], prepend=-1))
    again = np.zeros(n, dtype=bool)
    for run in np.split(order, runs[1:]):
        if len(run) > 1:
            first = pieces[run[0]].path
            again[run[1:]] = [_same(first, pieces[i].path) for i in run[1:]]
    return again


def _same(a: Path, b: Path) -> bool:
    if len(a) != len(b):
        return False
    share = np.linspace(0, 1, 2 * len(a) + 5)
    one, other = a(share * a.length), b(share * b.length)
    return any(float(np.abs(one - x).max(initial=0.0)) <= SAME_PIECE for x in (other, other[::-1]))


def _notes(
    pieces: Sequence[Piece], again: BoolArray, short: Sequence[str], tolerance: float
) -> list[str]:
    notes = []
    if again.any():
        names = [pieces[i].name for i in np.flatnonzero(again).tolist()]
        notes.append(f"Left out because they lie exactly on others: {list_some(names, 6)}.")
    if short:
        notes.append(
            f"Left out because their ends are one point within {tolerance:g} m: "
            f"{list_some(short, 6)}."
        )
    return notes
