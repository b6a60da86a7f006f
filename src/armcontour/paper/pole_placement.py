"""`PolePlacement`: the paper's compensator (26), corrected, of third order by pole placement."""

# With `X = (K_v + g)(m1 + m2) + K_v² + m1 m2 + K_v g`, the numerator of the compensator F factors:
#
#     F(s) = G(s)⁻¹ H(s),    H(s) = (X s - m1 m2 g) / ((s - m1)(s - m2)(s - g)).
#
# G is the servo, and H = F G is the response of compensator and servo together. H is applied to the
# trajectory exactly. G⁻¹ is applied to the result, whose derivatives are known. See
# docs/concepts/compensation.md.

from __future__ import annotations

from typing import Annotated

import numpy as np
import numpy.typing as npt

from armcontour.control.compensation.method import CompensationOptions
from armcontour.control.compensation.set_point_times import (
    SETTLING,
    SetPointTimes,
    advance_set_points,
    time_advances,
)
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import CompensationError, InvalidInput
from armcontour.core.fields import declared
from armcontour.core.kernel_cache import compiled
from armcontour.core.quantities import Items, Key, Pole
from armcontour.motion import Trajectory, quintic
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import GAINS, MAX_TIME_CONSTANTS

# Largest step of the Taylor series of the filter's state [shortest time constants of the filter].
LARGEST_STEP = 0.25
# Largest number of terms of the series, with which its error is below rounding errors.
TERMS = 22
# The series ends at a term below this fraction of the state.
NEGLIGIBLE = 1e-20
# Imaginary parts below this fraction of the largest pole are rounding errors of real values.
IMAGINARY_ROUNDING = 1e-9
# Form of the poles in a file: three numbers, or three per joint.
POLES = Key(
    hint=Annotated[list[Pole], Items(3, 3)] | list[Annotated[list[Pole], Items(3, 3)]] | None
)
ComplexArray = npt.NDArray[np.complex128]


@declared(eq=False)
class PolePlacement(CompensationOptions):
    """The paper's compensator (26) for servos of order "second"; extends `CompensationOptions`.

    >>> slow = ac.plan(path, arm, limits.replace(speed=0.02))
    >>> ac.compensate(slow, servo, ac.PolePlacement()).method
    'pole_placement'

    Args:
        poles: Two regulator poles and the observer pole [1/s], (3,), or three per joint, (dof, 3);
            by default all joints have the lag of the joint with the smallest K_v.
    """

    method = "pole_placement"
    poles: Annotated[npt.ArrayLike | None, POLES] = None

    def set_points(
        self, trajectory: Trajectory, servo: ServoModel, cycle: float, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """Compute set-points by the compensator (26)."""
        return place_poles(trajectory, servo, cycle, self.poles)

    def settling(self, servo: ServoModel) -> float:
        """Return the time in which the slowest pole settles [s]."""
        if servo.kv is None:
            # `set_points` refuses this servo.
            return 0.0
        slowest = float(servo.kv.min())
        if self.poles is not None:
            slowest = float(np.abs(check_poles(self.poles, len(servo.kv)).real).min())
        return SETTLING / slowest


@compiled()
def run_filter(
    width: FloatArray,
    coefficients: FloatArray,
    damping: FloatArray,
    rate: FloatArray,
    fastest: FloatArray,
    start: FloatArray,
) -> FloatArray:
    """Return the states of `x''' / p³ + d2 x'' / p² + d1 x' / p + x = q` at all interval ends.

    The states are x, x' / p and x'' / p², (n + 1, dof, 3). In each step, the Taylor series of the
    state is summed up to a negligible term.

    - `width`: durations of the intervals [s], (n,).
    - `coefficients`: polynomials of q over the intervals, (n, 6, dof).
    - `damping`: d1 and d2, (dof, 2).
    - `rate`: p [1/s], (dof,).
    - `fastest`: largest magnitude of the poles [1/s], (dof,).
    - `start`: initial x, at rest, (dof,).
    """
    n = len(width)
    dof = len(rate)
    states = np.empty((n + 1, dof, 3))
    series = np.empty((TERMS + 1, 3))
    state = np.empty(3)
    input_terms = np.empty(6)
    for j in range(dof):
        p = rate[j]
        d1 = damping[j, 0]
        d2 = damping[j, 1]
        state[0] = start[j]
        state[1] = 0.0
        state[2] = 0.0
        for c in range(3):
            states[0, j, c] = state[c]
        for i in range(n):
            steps = max(int(np.ceil(width[i] * fastest[j] / LARGEST_STEP)), 1)
            h = width[i] / steps
            for step in range(steps):
                # Coefficients of the input q over this step, in a variable from 0 to 1.
                step_start = step / steps
                step_width = 1.0 / steps
                for k in range(6):
                    input_terms[k] = 0.0
                for k in range(5, -1, -1):
                    for m in range(5, 0, -1):
                        input_terms[m] = (
                            input_terms[m] * step_start + input_terms[m - 1] * step_width
                        )
                    input_terms[0] = input_terms[0] * step_start + coefficients[i, k, j]
                x1 = state[0]
                x2 = state[1]
                x3 = state[2]
                negligible = NEGLIGIBLE * (abs(x1) + abs(x2) + abs(x3) + abs(input_terms[0]))
                terms = TERMS
                for k in range(TERMS):
                    series[k, 0] = x1
                    series[k, 1] = x2
                    series[k, 2] = x3
                    input_term = input_terms[k] if k < 6 else 0.0
                    scale = p * h / (k + 1)
                    x1, x2, x3 = (
                        scale * x2,
                        scale * x3,
                        scale * (input_term - x1 - d1 * x2 - d2 * x3),
                    )
                    if k > 5 and abs(x1) + abs(x2) + abs(x3) <= negligible:
                        terms = k + 1
                        break
                series[terms, 0] = x1
                series[terms, 1] = x2
                series[terms, 2] = x3
                x1 = x2 = x3 = 0.0
                for k in range(terms, -1, -1):
                    x1 += series[k, 0]
                    x2 += series[k, 1]
                    x3 += series[k, 2]
                state[0] = x1
                state[1] = x2
                state[2] = x3
            for c in range(3):
                states[i + 1, j, c] = state[c]
    return states


def default_poles(servo: ServoModel) -> ComplexArray:
    """Return the poles with which F G is equal for all joints [1/s], (dof, 3).

    The impulse response of F G is then nowhere negative.
    """
    # The observer pole at -K_v cancels the zero. Therefore F G = p² / (s + p)² does not depend on
    # the joint's K_v. An equal lag of all joints causes no contour error. The demand is a weighted
    # mean of the plan's acceleration, so it does not exceed the plan's largest acceleration. p is
    # the smallest K_v of all joints.
    assert servo.kv is not None
    poles = np.full((len(servo.kv), 3), -servo.kv.min(), dtype=np.complex128)
    poles[:, 2] = -servo.kv
    return poles


def place_poles(
    trajectory: Trajectory, servo: ServoModel, cycle: float, poles: npt.ArrayLike | None = None
) -> tuple[float, FloatArray]:
    """Return the time of the first set-point [s], and set-points by (26) [rad], (n, dof).

    `poles` are m1, m2 (real, or complex conjugates) and g [1/s], (3,) or (dof, 3).
    """
    servo.check_orders("Pole placement, (26),")
    placed = default_poles(servo) if poles is None else check_poles(poles, trajectory.dof)
    fastest = float(np.abs(placed).max())
    checks.raise_if(
        fastest * cycle > MAX_TIME_CONSTANTS,
        f"The magnitude of poles must be at most {MAX_TIME_CONSTANTS / cycle:g} 1/s with a cycle "
        f"of {cycle:g} s, but is {fastest:g} 1/s. Use slower poles or a shorter cycle.",
    )
    return advance_set_points(
        trajectory,
        time_advances(servo, cycle),
        cycle,
        lambda times, joints: _set_points(trajectory, servo, cycle, placed, times)[:, joints],
    )


def _set_points(
    trajectory: Trajectory,
    servo: ServoModel,
    cycle: float,
    placed: ComplexArray,
    times: SetPointTimes,
) -> FloatArray:
    """Return the set-points at the times, and until the transient has decayed [rad], (n, dof).

    - `placed`: m1, m2 and g of each joint [1/s], (dof, 3).
    """
    assert servo.kv is not None
    knots = np.union1d(trajectory.breaks, times.inside)
    settling_cycles = int(np.ceil(SETTLING / float(np.abs(placed.real).min()) / cycle))
    # Durations from the end of the motion to the next set-point, then between set-points.
    rest_durations = np.append(times.after_end, np.full(settling_cycles, cycle))
    # The planned motion, and then the rest, as quintics between knots.
    begin = trajectory.motion(knots[:-1])
    end = trajectory.motion(knots[1:], side="left")
    moving = quintic(np.diff(knots), begin, end)
    resting = np.zeros((len(rest_durations), *moving.shape[1:]))
    resting[:, 0] = end[0][-1]
    motion = np.concatenate([moving, resting])
    durations = np.concatenate([np.diff(knots), rest_durations])
    # States of the filter at the set-points.
    rate, damping, numerator = _filter_parameters(servo.kv, placed)
    fastest = np.abs(placed).max(axis=1)
    states = run_filter(durations, motion, damping, rate, fastest, motion[0, 0])
    resting_indices = len(knots) + np.arange(settling_cycles + 1)
    indices = np.append(np.searchsorted(knots, times.inside), resting_indices)
    x1, x2, x3 = np.moveaxis(states[indices], 2, 0)
    # Each polynomial begins at its knot. The end of the last polynomial uses the same value,
    # because the joints rest there.
    q = motion[np.minimum(indices, len(motion) - 1), 0]
    x4 = q - x1 - damping[:, 0] * x2 - damping[:, 1] * x3
    # y = H q and its derivatives, to which the inverse of the servo is applied.
    y = x1 + numerator * x2
    dy = rate * (x2 + numerator * x3)
    ddy = rate**2 * (x3 + numerator * x4)
    set_points = servo.command(y, dy, ddy)
    set_points[-1] = motion[-1, 0]
    return set_points


def _filter_parameters(
    kv: FloatArray, placed: ComplexArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parameters of F G: p [1/s], (dof,), d1 and d2, (dof, 2), and numerator, (dof,).

    With z = s / p, F G is `(1 + numerator z) / (1 + d1 z + d2 z² + z³)`.

    - `kv`: K_v of each joint [1/s], (dof,).
    - `placed`: m1, m2 and g of each joint [1/s], (dof, 3).
    """
    m1, m2, g = placed.T
    # Characteristic polynomial s³ + c2 s² + c1 s + c0, and X.
    c0 = (-m1 * m2 * g).real
    c1 = (m1 * m2 + (m1 + m2) * g).real
    c2 = -(m1 + m2 + g).real
    x = ((kv + g) * (m1 + m2) + kv**2 + m1 * m2 + kv * g).real
    rate = np.cbrt(c0)
    return rate, np.stack([c1 / rate**2, c2 / rate], axis=1), x / rate**2


def check_poles(poles: npt.ArrayLike, dof: int) -> ComplexArray:
    """Return m1, m2 and g of each joint [1/s], (dof, 3); raise an error for invalid poles."""
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
            "poles must be three finite numbers [1/s] (two regulator poles and the observer pole), "
            f"or {dof} rows of three numbers."
        )
    m1, m2, g = placed.T
    largest = float(np.abs(placed).max())
    # Values that must be real, with their order of magnitude.
    real_values = ((m1 + m2, largest), (g, largest), (m1 * m2, largest * largest))
    checks.raise_if(
        any((np.abs(x.imag) > IMAGINARY_ROUNDING * size).any() for x, size in real_values),
        "The regulator poles must be real or complex conjugates, and the observer pole real.",
    )
    unstable = (placed.real >= 0).any(axis=1)
    if unstable.any():
        j = int(np.argmax(unstable))
        joint_poles = placed[j] if placed[j].imag.any() else placed[j].real
        raise CompensationError(
            f"The poles of joint {j + 1} must have negative real parts, because otherwise the "
            f"set-points grow without bound, but are {joint_poles.tolist()} 1/s.",
            joint=j,
        )
    low, high = GAINS
    outside = ((-placed.real < low) | (np.abs(placed) > high)).any(axis=1)
    if outside.any():
        j = int(np.argmax(outside))
        raise InvalidInput(
            f"The poles of joint {j + 1} must be from -{high:g} to -{low:g} 1/s, which is the "
            f"range of servo gains, but are {placed[j].tolist()} 1/s."
        )
    return placed
