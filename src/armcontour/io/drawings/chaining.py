"""Chaining of a drawing's pieces end to end into contours."""

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

# Two pieces are the same if their points differ by at most this [m]; candidates for the comparison
# have equal features on a coarser grid [m].
SAME_PIECE = 1e-9
CANDIDATES = 1e-8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Piece:
    """One entity of a drawing.

    Args:
        path: Path of the entity.
        name: Name of the entity in the drawing.
        layer: Layer of the entity.
        apart: A number; pieces with different numbers are never chained.
    """

    path: Path
    name: str
    layer: str
    apart: int = 0


def chain_pieces(pieces: Sequence[Piece], tolerance: float) -> tuple[list[Contour], list[str]]:
    """Contours made of pieces of the same layer whose ends are closer than a tolerance.

    A piece may be reversed. The first piece of a contour gives its direction, its name and its
    position in the order. Closed pieces are not joined to others. Where more than two ends meet,
    ends that touch are joined before ends with a gap, then pairs with a smaller turn first, then
    earlier pieces first. A gap is closed in its middle: the end of a line is moved; an arc keeps
    its angle and changes its size. If an arc would move too far, a short line closes the gap. No
    point moves by more than the tolerance.

    Pieces that lie exactly on others of their layer are left out, and so are open contours shorter
    than the tolerance, whose ends are one point.

    Args:
        pieces: Pieces without orientation, all in the plane or all in space.
        tolerance: Ends closer than this are one point [m].

    Returns:
        The contours, and sentences on the pieces that were left out.

    Raises:
        InvalidInput: The tolerance is not above zero, the pieces have different dimensions, or a
            piece has an orientation.
    """
    positive("join tolerance", tolerance, "m")
    if not pieces:
        return [], []
    _refuse_pieces(pieces)
    table = Pieces.of([x.path for x in pieces])
    layers = _layer_numbers(pieces)
    repeated = _find_repeated(pieces, table, layers)
    lengths = table.lengths
    ends = Ends.of(table, layers, repeated)
    partner = find_partners(ends, tolerance)
    contours, short = [], []
    for chain, closed in _chains(partner, repeated):
        first = pieces[min(chain) // 2]
        alone = len(chain) == 1 and not closed
        total = lengths[np.array(chain) // 2].sum()
        if total <= tolerance and not ((closed or alone) and _meets_exactly(ends, chain)):
            short.append(first.name)
            continue
        path = first.path if alone else table.join(chain, closed, tolerance)
        contours.append(Contour(path=path, name=first.name, layer=first.layer))
    return contours, _notes(pieces, repeated, short, tolerance)


def _refuse_pieces(pieces: Sequence[Piece]) -> None:
    """Refuse pieces that cannot be chained.

    Raises:
        InvalidInput: The pieces have different dimensions, or a piece has an orientation.
    """
    if len({x.path.dimension for x in pieces}) > 1:
        raise InvalidInput("Pieces to chain must all be in the plane or all in space.")
    if any(x.path.orientation is not None for x in pieces):
        raise InvalidInput("Pieces to chain must not have an orientation.")


def _layer_numbers(pieces: Sequence[Piece]) -> IntArray:
    """A number for each piece, equal for pieces that may be chained, (n,)."""
    # A dictionary and not numpy, which stores every text with the length of the longest one.
    numbers: dict[tuple[str, int], int] = {}
    return np.array(
        [numbers.setdefault((x.layer, x.apart), len(numbers)) for x in pieces], dtype=np.intp
    )


def _meets_exactly(ends: Ends, chain: Sequence[int]) -> bool:
    """Whether all ends in a closed chain meet without gaps."""
    entries = np.array(chain)
    gaps = ends.points[entries ^ 1] - ends.points[np.roll(entries, -1)]
    return bool((np.linalg.norm(gaps, axis=1) <= REPEATED_POINT).all())


def _chains(partner: IntArray, left_out: BoolArray) -> list[tuple[list[int], bool]]:
    """All chains of joined pieces.

    Args:
        partner: The end to which each end is joined, -1 for none, (2 n,).
        left_out: Pieces that are in no chain, (n,).

    Returns:
        For each chain the ends at which its pieces are entered (2 i for the start of piece i,
        2 i + 1 for its last point), and whether the chain is closed.
    """
    joined = partner.tolist()
    used = left_out.tolist()
    chains = []
    for i in range(len(used)):
        if used[i]:
            continue
        # Go back to the start of the chain, or once around a closed chain.
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
    """Which pieces lie exactly on an earlier piece of their layer, (n,).

    Args:
        pieces: The pieces.
        table: The segments of the pieces.
        layers: Number of the layer of each piece, (n,).
    """
    n = len(pieces)
    feature = np.column_stack([table.starts + table.ends, table.middles, table.lengths])
    cell = np.column_stack([layers, np.round(feature / CANDIDATES)])
    group = np.unique(cell, axis=0, return_inverse=True)[1].ravel()
    order = np.argsort(group, kind="stable")
    runs = np.flatnonzero(np.diff(group[order], prepend=-1))
    repeated = np.zeros(n, dtype=bool)
    for run in np.split(order, runs[1:]):
        if len(run) > 1:
            first = pieces[run[0]].path
            repeated[run[1:]] = [_same(first, pieces[i].path) for i in run[1:]]
    return repeated


def _same(a: Path, b: Path) -> bool:
    """Whether two paths are the same within `SAME_PIECE`, in the same or opposite direction."""
    # One may be cut into more segments than the other.
    share = np.linspace(0, 1, 2 * max(len(a), len(b)) + 5)
    one, other = a(share * a.length), b(share * b.length)
    return any(float(np.abs(one - x).max(initial=0.0)) <= SAME_PIECE for x in (other, other[::-1]))


def _notes(
    pieces: Sequence[Piece], repeated: BoolArray, short: Sequence[str], tolerance: float
) -> list[str]:
    """Sentences on the pieces and the short contours that were left out."""
    notes = []
    if repeated.any():
        names = [pieces[i].name for i in np.flatnonzero(repeated).tolist()]
        notes.append(f"Left out because they lie exactly on others: {list_some(names, 6)}.")
    if short:
        notes.append(
            f"Left out because their ends are one point within {tolerance:g} m: "
            f"{list_some(short, 6)}."
        )
    return notes
