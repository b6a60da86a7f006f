"""Transitions: segments along which the curvature changes, so that it does not jump at their ends.

A transition is a chain of quintics over arc length. Neighbours share point, tangent and curvature
to the last digit, and so do the segments beside the chain; between its ends a quintic runs along
the curve that it stands for, at a speed that is 1 within `UNEVEN`.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._quintics import evaluate, quintic
from armcontour._sampling import number_parts
from armcontour.geometry.biarcs import biarcs, dot, length, unit
from armcontour.geometry.segments import Segments, largest_bend

# Largest relative difference between the arc length and the parameter of a transition.
UNEVEN = 1e-6
# Arcs that stand for transitions are within this of them: no arm resolves a nanometre [m].
DRAWN = 1e-9
# Distance of a biarc from a curve whose curvature changes evenly by d over a length w, over d w²;
# and how much more parts are made than that needs.
BIARC = 1 / 324
MORE = 1.25

# Points, unit tangents and curvature vectors of n places, (n, dimension) each.
Contact = tuple[FloatArray, FloatArray, FloatArray]


def join_up(begin: Contact, end: Contact, lengths: FloatArray) -> Segments:
    """One quintic from each of n places to another, without speeds, tolerances and tags.

    Args:
        begin: Where the quintics begin.
        end: Where they end; the points relative to those where they begin, so that even tiny ones
            keep their digits.
        lengths: Their arc lengths [m], (n,).
    """
    none = np.zeros_like(begin[0])
    coefficients = quintic(lengths, (none, *begin[1:]), end)
    bend = length(begin[2])
    normals = np.divide(begin[2], bend[:, None], out=none.copy(), where=bend[:, None] > 0)
    return Segments(
        starts=begin[0],
        tangents=begin[1],
        normals=normals,
        curvatures=largest_bend(coefficients, lengths),
        lengths=lengths,
        quintics=coefficients,
    )


def draw_arcs(segments: Segments) -> tuple[Segments, FloatArray]:
    """Segments with arcs for their transitions, within `DRAWN` of them.

    Returns:
        Lines and arcs, which are the given segments if there are no transitions; and the arc
        lengths of the given segments at which they start [m], (n,). None is longer than the part
        that it stands for, from whose length it may differ as far as transitions are uneven.
    """
    bent = segments.bent
    if not bent.any():
        return segments, segments.breaks[:-1]
    quintics, lengths = segments.quintics[bent], segments.lengths[bent]
    need = lengths * np.cbrt(MORE * BIARC * largest_change(quintics, lengths) / DRAWN)
    count = np.maximum(np.ceil(need), 1).astype(np.intp)
    row, number = number_parts(count)
    step = (lengths / count)[row]
    ends = [
        evaluate(quintics[row], lengths[row], k * step, order)
        for k in (number, number + 1)
        for order in (0, 1)
    ]
    ends[1::2] = (unit(x) for x in ends[1::2])
    with np.errstate(invalid="ignore"):  # straight ones have no normal
        halves = biarcs(*ends)
    of = np.flatnonzero(bent)[row]
    columns = {x: getattr(segments, x)[of] for x in ("speeds", "tolerances", "tags")}
    share = step / (halves[0].lengths + halves[1].lengths)
    breaks, rest = segments.breaks, np.flatnonzero(~bent)
    first = breaks[of] + number * step
    middle = first + share * halves[0].lengths
    drawn = [
        x.replace(
            starts=x.starts + segments.starts[of],
            lengths=x.lengths * np.minimum(share, 1.0),
            **columns,
        )
        for x in halves
    ]
    none = np.zeros(len(rest), dtype=np.intp)
    order = np.lexsort(
        [
            np.concatenate([none, np.zeros_like(row), np.ones_like(row)]),
            np.concatenate([none, number, number]),
            np.concatenate([rest, of, of]),
        ]
    )
    plain = segments[~bent].replace(quintics=np.empty((len(rest), 0, 0)))
    begin = np.concatenate([breaks[rest], first, middle])
    return Segments.join([plain, *drawn])[order], begin[order]


def contact_of(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit tangents and curvature vectors [1/m], by first and second derivatives of curves."""
    speed2 = dot(first, first)
    across = second - (dot(first, second) / speed2)[..., None] * first
    return first / np.sqrt(speed2)[..., None], across / speed2[..., None]


def largest_change(quintics: FloatArray, lengths: FloatArray) -> FloatArray:
    """Largest third derivatives of quintics by arc length, or slightly more [1/m²], (n,)."""
    c3, c4, c5 = quintics[:, 3], quintics[:, 4], quintics[:, 5]
    control = np.stack([6 * c3, 6 * c3 + 12 * c4, 6 * c3 + 24 * c4 + 60 * c5], axis=1)
    return np.asarray(np.linalg.norm(control, axis=2).max(axis=1) / lengths**3)
