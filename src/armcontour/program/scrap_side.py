"""The scrap side of contours: inside of holes, outside of outer contours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray
from armcontour.program.moves import Contour
from armcontour.program.nesting import nest


def waste_sides(contours: Sequence[Contour], up: FloatArray) -> list[str]:
    """The scrap side of every contour in its direction of travel, "left" or "right".

    Closed contours inside an odd number of other contours of their layer are holes. The scrap side
    of open contours is "left".

    Args:
        contours: The contours in their direction of travel.
        up: In space, the direction from which the contours are viewed, (3,).
    """
    found = nest(contours, up)
    layers = np.array([x.layer for x in contours])
    depths = (found.holds & (layers[:, None] == layers[None, :])).sum(axis=0)
    left = ((depths % 2 == 1) == (found.areas > 0)) | (found.areas == 0)
    return ["left" if x else "right" for x in left.tolist()]
