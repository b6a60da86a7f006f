"""The one door to the compensators: from a realizable trajectory to taught data."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.compensation.set_points import inverse_servo, set_point_times
from armcontour.errors import InvalidInput
from armcontour.motion import TaughtData, Trajectory
from armcontour.servo import ServoModel

METHODS = ("inverse", "pole_placement", "none")


def compensate(
    trajectory: Trajectory,
    servo: ServoModel,
    *,
    method: str = "pole_placement",
    period: float = 4e-3,
    **options: Any,
) -> TaughtData:
    """Set-points with which the servo shall make the joints follow `trajectory`.

    Args:
        trajectory: What the joints shall do.
        servo: The model whose delay is compensated.
        method: "pole_placement" is the paper's compensator (26); "inverse" the exact inverse of the
            unsaturated servo from the trajectory's derivatives (right-sided where they jump), which
            saturates it where accelerations jump at their limits; "none" gives the trajectory
            itself.
        period: Command interval [s].
        options: For "pole_placement": `poles` [1/s].

    Raises:
        InvalidInput: An unknown method or option, or gains that do not fit the joints.
        CompensationError: Unstable poles.
    """
    _checks.choice("method", method, METHODS)
    interval = _checks.positive("command interval", period, "s")
    known = ("poles",) if method == "pole_placement" else ()
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise InvalidInput(
            f"The method {method} takes {'the option poles' if known else 'no options'}, "
            f"not {unknown[0]}."
        )
    model = servo.for_joints(trajectory.dof)
    if method == "pole_placement":
        from armcontour.compensation.pole_placement import pole_placement

        set_points = pole_placement(trajectory, model, interval, **options)
    else:
        set_points = _without_filter(trajectory, model, interval, method)
    return TaughtData(period=interval, q=set_points, trajectory=trajectory, method=method)


def _without_filter(
    trajectory: Trajectory, servo: ServoModel, period: float, method: str
) -> FloatArray:
    t = set_point_times(trajectory, period).inside
    q = trajectory(t)
    if method == "inverse":
        q = inverse_servo(servo, q, trajectory(t, 1), trajectory(t, 2))
    return np.concatenate([q, trajectory([trajectory.duration], side="left")])
