"""Entry point `compensate`: from a realizable trajectory to taught data."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour import _checks, _memory
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Limits
from armcontour.compensation.command_limits import refuse_commands
from armcontour.compensation.set_points import (
    SETTLING,
    SetPointTimes,
    advance_set_points,
    inverse_servo,
    leads,
    set_point_times,
)
from armcontour.errors import InvalidInput
from armcontour.motion import TaughtData, Trajectory, check_interval
from armcontour.servo import ServoModel

# What a set-point of one joint takes while it is computed [bytes], measured: most of it are the
# states of the compensator's filter and the polynomials that it is fed with.
SET_POINT = {"pole_placement": 230.0, "inverse": 100.0, "none": 60.0}
METHODS = ("inverse", "pole_placement", "none")


def compensate(
    trajectory: Trajectory,
    servo: ServoModel,
    *,
    method: str = "pole_placement",
    period: float = 4e-3,
    limits: Limits | None = None,
    memory: float = _memory.DEFAULT,
    **options: Any,
) -> TaughtData:
    """Set-points with which the servo shall make the joints follow `trajectory`.

    Commands lead the plan by the servo's dead time, and by half an interval more where set-points
    are held: the taught data then begins before 0, with the position in which the plan begins.

    Args:
        trajectory: What the joints shall do.
        servo: The model whose delay is compensated.
        method: "pole_placement" is the paper's compensator (26); "inverse" the exact inverse of the
            unsaturated servo from the trajectory's derivatives (right-sided where they jump), which
            saturates it where accelerations jump at their limits; "none" gives the trajectory
            itself, when it is due.
        period: Command interval [s].
        limits: What the controller takes: set-points within joint_lower and joint_upper, and from
            one to the next not faster than joint_velocity. By default they are not looked at.
        memory: What the program may take while it computes them [bytes].
        options: For "pole_placement": `poles` [1/s].

    Raises:
        InvalidInput: An unknown method or option, gains that do not fit the joints or the interval,
            or more set-points than the memory takes.
        CompensationError: Unstable poles, pole placement for a servo of first order, or set-points
            beyond the limits.
    """
    _checks.choice("method", method, METHODS)
    interval = check_interval(period)
    _refuse_options(method, options)
    model = servo.for_joints(trajectory.dof)
    model.refuse_too_fast(interval)
    count = set_point_count(trajectory.duration, model, interval, method, options.get("poles"))
    _refuse_too_many(count, count * trajectory.dof * SET_POINT[method], interval, memory)
    start, q = _set_points(trajectory, model, interval, method, options)
    taught = TaughtData(
        period=interval, q=q, trajectory=trajectory, method=method, start_time=start
    )
    if limits is not None:
        refuse_commands(taught, limits.for_joints(trajectory.dof))
    return taught


def _refuse_options(method: str, options: dict[str, Any]) -> None:
    known = ("poles",) if method == "pole_placement" else ()
    unknown = sorted(set(options) - set(known))
    if unknown:
        raise InvalidInput(
            f"The method {method} takes {'the option poles' if known else 'no options'}, "
            f"not {unknown[0]}."
        )


def _refuse_too_many(count: float, size: float, period: float, memory: float) -> None:
    _memory.refuse_above(
        memory,
        size,
        f"{count * period:.4g} s of motion at a command interval of {period:g} s, {count:.3g} "
        "set-points,",
        "take a longer command interval or a higher speed",
    )


def _set_points(
    trajectory: Trajectory, servo: ServoModel, period: float, method: str, options: dict[str, Any]
) -> tuple[float, FloatArray]:
    """Time of the first set-point [s], and set-points, (n, dof) [rad]."""
    if method == "pole_placement":
        from armcontour.compensation.pole_placement import pole_placement

        return pole_placement(trajectory, servo, period, **options)
    if method == "inverse":
        return _inverse(trajectory, servo, period)
    return 0.0, _as_planned(trajectory, period)


def set_point_count(
    duration: float, servo: ServoModel, period: float, method: str, poles: Any | None = None
) -> float:
    """How many set-points a motion takes, about.

    Args:
        duration: Of the motion [s].
        servo: The model whose delay is compensated, with values per joint.
        period: Command interval [s].
        method: As in `compensate`.
        poles: As in `compensate`.

    Raises:
        InvalidInput: Poles that are none.
        CompensationError: Poles that are not stable.
    """
    total = duration
    if method != "none":
        total += float(servo.dead_time.max()) + period
    if method == "pole_placement" and servo.kv is not None:
        from armcontour.compensation.pole_placement import check_poles

        slowest = float(servo.kv.min())
        if poles is not None:
            slowest = float(np.abs(check_poles(poles, len(servo.kv)).real).min())
        total += SETTLING / slowest
    return total / period + 1


def _as_planned(trajectory: Trajectory, period: float) -> FloatArray:
    t = set_point_times(trajectory, period).inside
    return np.concatenate([trajectory(t), trajectory([trajectory.duration], side="left")])


def _inverse(trajectory: Trajectory, servo: ServoModel, period: float) -> tuple[float, FloatArray]:
    final = trajectory([trajectory.duration], side="left")

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        t = times.inside
        found = inverse_servo(servo, trajectory(t), trajectory(t, 1), trajectory(t, 2))
        return np.concatenate([found, final])[:, joints]

    return advance_set_points(trajectory, leads(servo, period), period, command)
