"""Functions that cut out a part of a path, and join paths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.geometry.path import Path
from armcontour.geometry.segments import REPEATED_POINT


def cut_path(path: Path, begin: float, end: float) -> Path:
    """The part of a path between two arc lengths, with speeds, tolerances and orientation.

    Args:
        path: The path.
        begin: Arc length at which the part starts [m].
        end: Arc length at which the part ends [m].

    Raises:
        InvalidInput: An arc length is outside the path, or the part has no length.
    """
    for name, s in (("begin", begin), ("end", end)):
        value = _checks.number(name, s, "m")
        if not -REPEATED_POINT <= value <= path.length + REPEATED_POINT:
            raise InvalidInput(
                f"{name} of a part must lie within the path of {path.length:.9g} m, but is "
                f"{value:.9g} m.",
                s=value,
                allowed=path.length,
            )
    begin, end = max(begin, 0.0), min(end, path.length)
    # Remainders of segments shorter than the resolution of a point are left out.
    first = int(path.locate(begin + REPEATED_POINT))
    last = int(path.locate(end - REPEATED_POINT, side="left"))
    if end - begin <= REPEATED_POINT or first > last:
        raise InvalidInput(f"There is no path between {begin:.9g} and {end:.9g} m along it.")
    # The orientation is cut at the same arc lengths as the segments.
    begin = max(begin, float(path.breaks[first]))
    end = min(end, float(path.breaks[last + 1]))
    i = np.arange(first, last + 1)
    u0, u1 = np.zeros(len(i)), path.lengths[i].copy()
    u0[0] = begin - path.breaks[first]
    u1[-1] = min(end - path.breaks[last], u1[-1])
    orientation = path.orientation
    if orientation is not None:
        orientation = orientation.cut(begin, float((u1 - u0).sum()), REPEATED_POINT)
    cut = path.segments.cut(i, u0, u1).replace(checked=True)
    return Path(segments=cut, orientation=orientation)


def join_paths(paths: Sequence[Path]) -> Path:
    """One path made of several, each of which starts where the one before it ends.

    Args:
        paths: The paths in order.

    Raises:
        InvalidInput: There is a gap or no path, or only some of the paths have an orientation.
    """
    if not paths:
        raise InvalidInput("There is no path to join.")
    return paths[0].joined(*paths[1:])
