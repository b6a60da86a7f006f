"""Commands that a controller interpolates from exported set-points, for simulated plants."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from armcontour.core.fields import checked
from armcontour.core.quantities import AtLeast, Choice, Frequency
from armcontour.files.exports.table import make_table
from armcontour.motion import SetPoints
from armcontour.motion.controller_laws import NAMES, interpolate_points


@checked
def interpolate_set_points(
    set_points: SetPoints,
    controller: Annotated[str, Choice(NAMES)],
    rate: Frequency,
    *,
    derivatives: Annotated[int, AtLeast(0, 2)] = 2,
) -> SetPoints:
    """Commands that a controller sends to its drives for exported set-points.

    A plant executes the commands as set-points with the controller's cycle. The interpolation of
    the plant is "linear", with a dead time of one cycle, for a drive that moves linearly to each
    command within one cycle. It is "step" for a drive that holds each command (zero-order hold).

    Args:
        set_points: The exported set-points.
        controller: Name of the controller, as in
            `armcontour.motion.controller_laws.interpolate_points`.
        rate: Rate of the controller [1/s].
        derivatives: Derivatives of the points, as in `export`: 2, 1 or 0.

    Raises:
        InvalidInput: The controller does not support these points.
    """
    table = make_table(set_points, name="set-points", derivatives=derivatives)
    t, q = interpolate_points(table, controller).commands(rate)
    start = set_points.start_time + float(t[0])
    changed: dict[str, Any] = {"cycle": 1.0 / rate, "q": q, "start_time": start}
    return replace(set_points, **changed, command_limits=None, limit_cost=None)
