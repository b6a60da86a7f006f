"""Dry friction, which the servo model lacks: found in what a fit leaves over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.identification import _joint
from armcontour.identification.correlation import long_run
from armcontour.identification.covariance import is_white
from armcontour.identification.fitting import Data, Fit, simulated

# Friction this many standard deviations above zero is told: by chance, in three logs of a thousand.
SURE = 3.0
# Shifts that leave a parameter undetermined: shares of gains, and seconds of the dead time. They
# are estimated themselves, to first order, so less is allowed than of a standard deviation.
SHIFT = 0.05
SHIFT_OF_DELAY = 0.5e-3
# A joint that is slower than this share of its largest velocity stands still.
STANDSTILL = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Friction:
    """Friction that a fit has left out.

    Args:
        size: Acceleration with which it brakes [rad/s²].
        sd: Standard deviation of the size [rad/s²].
        shifts: What leaving it out does to estimates: shares of gains, and seconds of the delay.
    """

    size: float
    sd: float
    shifts: dict[str, float]

    def spoils(self, name: str) -> bool:
        """Whether a parameter is too far off without it."""
        allowed = SHIFT_OF_DELAY if name == "delay" else SHIFT
        return abs(self.shifts.get(name, 0.0)) > allowed

    @property
    def spoils_any(self) -> bool:
        """Whether any parameter is too far off without it."""
        return any(map(self.spoils, self.shifts))


def find_friction(data: Data, found: Fit) -> Friction | None:
    """Find dry friction: a part of the residuals that the sign of the velocity explains.

    To first order, friction and the errors that it causes in the parameters are estimated together.

    Args:
        data: The log of the joint.
        found: Its fit, of the second order.

    Returns:
        The friction; None if the residuals do not surely show any.
    """
    response = _respond(data, found)
    inverse = np.linalg.pinv(found.jacobian @ found.jacobian.T, hermitian=True)
    along = inverse @ (found.jacobian @ response)
    own = response - along @ found.jacobian
    power = float(own @ own)
    if power <= 1e-12 * float(response @ response):
        return None
    size = float(own @ found.residuals) / power
    rest = found.residuals - size * own
    if is_white(found):
        sd = math.sqrt(float(rest @ rest) / (found.count * power))
    else:
        total, _ = long_run((own * rest)[None, :], own**2, found.period)
        sd = math.sqrt(float(total[0, 0])) / power
    if not size > SURE * sd:
        return None
    shifts = dict(zip(found.state.free, (along * size).tolist(), strict=True))
    return Friction(
        size=size, sd=sd, shifts={x: shifts[x] for x in ("kp", "kv", "delay") if x in shifts}
    )


def _respond(data: Data, found: Fit) -> FloatArray:
    """Positions per unit of friction [s²]: the loop's response to a braking acceleration, (n,)."""
    state = found.state
    q = simulated(data, state)[0][0]
    t = np.ascontiguousarray(data.t[state.first : data.last])
    velocity = np.gradient(q, t)
    # At standstill, where a simulated joint only settles, friction has no direction.
    moves = np.abs(velocity) > STANDSTILL * np.abs(velocity).max()
    against = np.where(moves, -np.sign(velocity), 0.0)
    # An acceleration acts as a set-point does that asks for it.
    command = np.ascontiguousarray(against / (state.kp * state.kv))
    given = np.array([state.kp, state.kv, 0.0, 0.0, 0.0, math.inf, 0.0])
    out: FloatArray = _joint.second_order(t, command, False, 0, len(t), False, given, 1)[0]
    return np.asarray(out[0])
