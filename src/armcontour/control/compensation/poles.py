"""Choice of compensator poles: lag and peaking, and the fastest poles without saturation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour.control.compensation.pole_placement import (
    check_poles,
    pole_family,
    pole_placement,
    run_poles,
    transfer,
)
from armcontour.core.checks import FloatArray
from armcontour.core.errors import CompensationError, InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.motion import DEFAULT_CYCLE, Trajectory, check_cycle
from armcontour.robot import Limits
from armcontour.robot.limit_use import use_of
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import ServoSimulation

# Fastest poles in units of 1 / T. Their lag is a tenth of the cycle T, so faster poles have no
# benefit.
FASTEST = 20.0
# Relative precision of the fastest poles.
PRECISION = 1e-3
# Length of the step response, in slowest time constants, and number of its times.
FOLLOWED = 36.0
TIMES = 20_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoleBehaviour(Checked):
    """Properties of F G, the response of compensator and servo together, for each joint."""

    # Time lag relative to a plan of constant velocity, without dead time [s], (dof,).
    lag: FloatArray
    peaking: FloatArray  # Largest magnitude of F G at any frequency, (dof,); 1 without resonance
    # Largest demand for a plan of acceleration at most 1, which is the integral of the absolute
    # impulse response, (dof,). If it is 1, a plan may use its whole limit.
    demand: FloatArray


def pole_behaviour(servo: ServoModel, poles: npt.ArrayLike) -> PoleBehaviour:
    """Lag, peaking and demand of a servo of order "second" compensated with given poles [1/s]."""
    kv = np.atleast_1d(_second_order(servo))
    placed = check_poles(poles, len(kv))
    x, c = transfer(kv, placed)
    # F G = (x s + c0) / (s³ + c2 s² + c1 s + c0).
    frequency = 1j * np.geomspace(1e-3, 1e3, TIMES)[:, None] * np.abs(placed).max(axis=1)
    magnitude = np.abs(
        (x * frequency + c[0]) / (frequency**3 + c[2] * frequency**2 + c[1] * frequency + c[0])
    )
    slowest, fastest = np.abs(placed.real).min(), np.abs(placed).max()
    times = np.append(0.0, np.geomspace(1e-4 / fastest, FOLLOWED / slowest, TIMES))
    ones = np.zeros((TIMES, 6, len(placed)))
    ones[:, 0] = 1.0
    moved, lead, *_ = run_poles(kv, placed, np.diff(times), ones, np.zeros(len(placed)))
    step = moved[:, :, 0] + lead * moved[:, :, 1]
    return PoleBehaviour(
        lag=(c[1] - x) / c[0],
        peaking=np.maximum(magnitude.max(axis=0), 1.0),
        demand=np.abs(np.diff(step, axis=0)).sum(axis=0),
    )


@checked
def fastest_poles(
    servo: ServoModel,
    trajectory: Trajectory,
    limits: Limits | None = None,
    cycle: float = DEFAULT_CYCLE,
) -> FloatArray:
    """The fastest poles whose set-points do not saturate the servo.

    The poles are `m1 = m2 = -p, g = -K_v`, for which `F G = p² / (s + p)²` on every joint: all
    joints have the lag 2 / p, and the demand exceeds the plan's only at the corners of the
    interpolated command. This excess grows with p, so p is found by bisection, from the demand of
    the interpolated set-points at all times.

    Args:
        servo: Servo model of order "second".
        trajectory: Trajectory that the joints should follow.
        limits: Limits with the joint accelerations of the servo, instead of those of the plan.
        cycle: Cycle [s].

    Returns:
        m1, m2 and g of each joint [1/s], (dof, 3), for `PolePlacement(poles=...)`; p is at most
        20 / cycle.

    Raises:
        CompensationError: Even with the lag of the servo itself, `2 / p = 1 / K_p`, a joint would
            saturate.
        InvalidInput: There is no limit of joint acceleration, or the servo is not of order
            "second".
    """
    interval = check_cycle(cycle)
    limits = trajectory.limits_for(limits)
    if limits.joint_acceleration is None:
        raise InvalidInput(
            "The fastest poles are those that do not saturate: give joint_acceleration.",
            limit="joint_acceleration",
        )
    lower, upper = limits.acceleration_bounds(trajectory.dof)
    model = servo.for_joints(trajectory.dof)
    kv = _second_order(model)

    def use(p: float) -> FloatArray:
        """Largest commanded share of each joint's acceleration limit, (dof,)."""
        _, q = pole_placement(trajectory, model, interval, pole_family(kv, p))
        demands = np.stack(extreme_demands(model, q, interval))
        return use_of("joint_acceleration", limits, demands).largest

    low = 2 * float(model.kp.min())
    high = max(FASTEST / interval, low)
    if use(high).max() <= 1:
        low = high
    elif (worst := use(low)).max() > 1:
        j = int(np.argmax(worst))
        allowed = float(min(-lower[j], upper[j]))
        needed = float(worst[j]) * allowed
        raise CompensationError(
            f"Joint {j + 1} saturates with any poles: even with the regulator poles at -{low:.4g} "
            f"1/s, with the lag of the servo itself, its demand is {needed:.6g} rad/s², above "
            f"its limit of {allowed:.6g} rad/s²; plan with a joint_acceleration lower by at least "
            f"{needed - allowed:.1g} rad/s², or take a shorter cycle.",
            joint=j,
            limit="joint_acceleration",
            needed=needed,
            allowed=allowed,
        )
    while high > low * (1 + PRECISION):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if use(middle).max() <= 1 else (low, middle)
    return pole_family(kv, low).real


def extreme_demands(
    servo: ServoModel, q: FloatArray, cycle: float
) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest demand of each joint for set-points, without saturation [rad/s²]."""
    kv = _second_order(servo)
    prompt = ServoModel(kp=servo.kp, kv=kv, interpolation=servo.interpolation, dead_time=0 * kv)
    run = ServoSimulation(q, cycle, prompt).run(0, len(q) - 1, q[0].copy(), np.zeros(len(kv)))
    return run.lowest, run.highest


def _second_order(servo: ServoModel) -> FloatArray:
    """Velocity loop gains of a servo of order "second" [1/s]."""
    servo.check_orders("Pole placement, (26),")
    assert servo.kv is not None
    return servo.kv
