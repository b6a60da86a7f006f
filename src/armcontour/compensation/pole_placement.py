"""The paper's compensator (26), as corrected: third order, by pole placement.

With `X = (K_v + g)(m1 + m2) + K_v² + m1 m2 + K_v g` its numerator factors, so that

    F(s) = G(s)⁻¹ H(s),    H(s) = (X s - m1 m2 g) / ((s - m1)(s - m2)(s - g)).

H is the response of compensator and servo together. H is applied to the trajectory exactly, and
G⁻¹ to the result, whose derivatives are known. See docs/concepts/compensation.md.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour._checks import FloatArray
from armcontour.compensation._filter import run_filter
from armcontour.compensation.set_points import (
    SETTLING,
    SetPointTimes,
    advance_set_points,
    time_advances,
)
from armcontour.errors import CompensationError, InvalidInput
from armcontour.motion import Trajectory, quintic
from armcontour.servo import ServoModel
from armcontour.servo.model import GAINS, MOST_TIME_CONSTANTS

ComplexArray = npt.NDArray[np.complex128]


def default_poles(servo: ServoModel) -> ComplexArray:
    """Poles for which F G is equal on all joints and has no negative impulse response.

    The observer pole at -K_v cancels the zero, so that F G = p² / (s + p)² does not depend on the
    joint's K_v. An equal lag of all joints causes no contour error. The demand is a weighted mean
    of the plan's acceleration, so it never exceeds the plan's largest acceleration. p is the
    smallest K_v of all joints.

    Args:
        servo: Servo model of order "second" with gains per joint.

    Returns:
        m1, m2 and g of each joint [1/s], (dof, 3).
    """
    assert servo.kv is not None
    poles = np.empty((len(servo.kv), 3), dtype=np.complex128)
    poles[:, :2] = -servo.kv.min()
    poles[:, 2] = -servo.kv
    return poles


def pole_placement(
    trajectory: Trajectory, servo: ServoModel, period: float, poles: npt.ArrayLike | None = None
) -> tuple[float, FloatArray]:
    """Set-points by pole placement, (26).

    Args:
        trajectory: Trajectory that the joints should follow.
        servo: Servo model with values per joint.
        period: Command interval [s].
        poles: m1, m2 (real, or complex conjugates) and g [1/s], one triple or one per joint; by
            default those of `default_poles`.

    Returns:
        Time of the first set-point [s], and set-points [rad], (n, dof).

    Raises:
        CompensationError: The poles are not stable.
        InvalidInput: The poles have a wrong shape, are not conjugate, or are too fast for the
            command interval; or a joint is not of order "second", or has friction or a cycle.
    """
    servo.refuse_mixed("Pole placement, (26),")
    placed = default_poles(servo) if poles is None else check_poles(poles, trajectory.dof)
    _refuse_too_fast(placed, period)
    return advance_set_points(
        trajectory,
        time_advances(servo, period),
        period,
        lambda times, joints: _set_points(trajectory, servo, period, placed, times)[:, joints],
    )


def _set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    period: float,
    placed: ComplexArray,
    times: SetPointTimes,
) -> FloatArray:
    """The compensator's output at the times, and on until the end of its own tail."""
    assert servo.kv is not None
    knots = np.union1d(trajectory.breaks, times.inside)
    tail = int(np.ceil(SETTLING / float(np.abs(placed.real).min()) / period))
    # From the end of the motion to the next set-point, then from set-point to set-point.
    after = np.append(times.after_end, np.full(tail, period))
    motion = _polynomials(trajectory, knots, len(after))

    x, (c0, c1, c2) = transfer(servo.kv, placed)
    rate = np.cbrt(c0)
    states = run_filter(
        np.concatenate([np.diff(knots), after]),
        motion,
        np.stack([c1 / rate**2, c2 / rate], axis=1),
        rate,
        np.abs(placed).max(axis=1),
        motion[0, 0],
    )
    at = np.append(np.searchsorted(knots, times.inside), len(knots) + np.arange(tail + 1))
    x1, x2, x3 = np.moveaxis(states[at], 2, 0)
    # Each quintic begins at its knot; the last rest has no further one.
    source = motion[np.minimum(at, len(motion) - 1), 0]
    x4 = source - x1 - c1 / rate**2 * x2 - c2 / rate * x3
    lead = x / rate**2
    y = x1 + lead * x2
    dy = rate * (x2 + lead * x3)
    ddy = rate**2 * (x3 + lead * x4)
    set_points = servo.command(y, dy, ddy)
    set_points[-1] = motion[-1, 0]
    return set_points


def _polynomials(trajectory: Trajectory, knots: FloatArray, after: int) -> FloatArray:
    """Quintics between knots, and rest for so many intervals after them, (n, 6, dof)."""
    q, dq, ddq = trajectory.motion(knots[:-1])
    end, dend, ddend = trajectory.motion(knots[1:], side="left")
    motion = quintic(np.diff(knots), (q, dq, ddq), (end, dend, ddend))
    rest = np.zeros((after, *motion.shape[1:]))
    rest[:, 0] = end[-1]
    return np.concatenate([motion, rest])


def transfer(
    kv: FloatArray, placed: ComplexArray
) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray]]:
    """Coefficients of `F G = (x s + c0) / (s³ + c2 s² + c1 s + c0)` of each joint.

    Args:
        kv: Velocity loop gains [1/s], (dof,).
        placed: Poles m1, m2 and g of each joint [1/s], (dof, 3).

    Returns:
        x, (dof,), and (c0, c1, c2), (dof,) each.
    """
    m1, m2, g = placed.T
    c0, c1, c2 = (-m1 * m2 * g).real, (m1 * m2 + (m1 + m2) * g).real, -(m1 + m2 + g).real
    x = ((kv + g) * (m1 + m2) + kv**2 + m1 * m2 + kv * g).real
    return x, (c0, c1, c2)


def check_poles(poles: npt.ArrayLike, dof: int) -> ComplexArray:
    """Checked poles of each joint [1/s], (dof, 3).

    Args:
        poles: m1, m2 and g [1/s], one triple or one per joint.
        dof: Number of joints.

    Raises:
        CompensationError: The poles are not stable.
        InvalidInput: The poles have a wrong shape, are not conjugate, or are outside GAINS.
    """
    try:
        placed = np.array(poles, dtype=np.complex128)
    except (TypeError, ValueError, OverflowError) as error:
        raise InvalidInput(
            f"poles must be three finite numbers [1/s]: {str(error).split('. ')[0].rstrip('.')}."
        ) from None
    if placed.shape == (3,):
        placed = np.tile(placed, (dof, 1))
    if placed.shape != (dof, 3) or not np.isfinite(placed).all():
        raise InvalidInput(
            f"poles must be three finite numbers [1/s], or {dof} rows of three: two regulator "
            "poles and the observer pole."
        )
    _refuse_unpaired(placed)
    _refuse_range(placed)
    return placed


def _refuse_unpaired(placed: ComplexArray) -> None:
    """Refuse poles that no real compensator has.

    Raises:
        InvalidInput: Such poles.
    """
    total, product, observer = (
        placed[:, 0] + placed[:, 1],
        placed[:, 0] * placed[:, 1],
        placed[:, 2],
    )
    small = 1e-9 * np.abs(placed).max()
    if (
        (np.abs(total.imag) > small).any()
        or (np.abs(observer.imag) > small).any()
        or (np.abs(product.imag) > small * np.abs(placed).max()).any()
    ):
        raise InvalidInput(
            "The regulator poles must be real or complex conjugates, and the observer pole real."
        )


def _refuse_range(placed: ComplexArray) -> None:
    """Refuse poles that are not stable, or smaller or larger than gains of servos.

    Raises:
        CompensationError: Poles that are not stable.
        InvalidInput: Poles outside GAINS.
    """
    if (placed.real >= 0).any():
        j = int(np.flatnonzero((placed.real >= 0).any(axis=1))[0])
        shown = placed[j] if placed[j].imag.any() else placed[j].real
        raise CompensationError(
            f"The compensator's poles of joint {j + 1} are {shown.tolist()} 1/s: they must "
            "have negative real parts, or the set-points grow without bound.",
            joint=j,
        )
    low, high = GAINS
    if (-placed.real < low).any() or (np.abs(placed) > high).any():
        j = int(np.flatnonzero(((-placed.real < low) | (np.abs(placed) > high)).any(axis=1))[0])
        raise InvalidInput(
            f"The poles of joint {j + 1} must lie between -{high:g} and -{low:g} 1/s, as gains of "
            f"servos do, but are {placed[j].tolist()} 1/s."
        )


def _refuse_too_fast(placed: ComplexArray, period: float) -> None:
    """Refuse poles that are too fast for the command interval.

    Raises:
        InvalidInput: The interval is longer than MOST_TIME_CONSTANTS time constants of a pole.
    """
    fastest = float(np.abs(placed).max())
    if fastest * period > MOST_TIME_CONSTANTS:
        raise InvalidInput(
            f"A pole of {fastest:g} 1/s is {fastest * period:.3g} time constants in a command "
            f"interval of {period:g} s, but at most {MOST_TIME_CONSTANTS:g} are computed: take "
            f"poles up to {MOST_TIME_CONSTANTS / period:g} 1/s, or a shorter command interval."
        )
