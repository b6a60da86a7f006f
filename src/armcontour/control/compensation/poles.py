"""Compensator poles: lag, peaking and demand, and the fastest poles without saturation."""

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

# Largest magnitude of the poles [1 / cycle]. The lag of these poles is a tenth of the cycle, so
# faster poles have no benefit.
LARGEST_POLE = 20.0
# Relative precision of the bisection for the fastest poles.
PRECISION = 1e-3
# Duration of the step response [time constants of the slowest pole], and number of its times.
STEP_DURATION = 36.0
STEP_TIMES = 20_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoleBehaviour(Checked):
    """Properties of F G, the transfer function of compensator and servo, for each joint."""

    # lag: time lag behind a plan of constant velocity, without dead time [s], (dof,).
    lag: FloatArray
    peaking: FloatArray  # Largest magnitude of F G over all frequencies, (dof,); 1 if no resonance
    # demand: largest ratio of the demanded acceleration to the largest acceleration of the plan,
    # (dof,). It is the integral of the absolute impulse response. If it is 1, a plan can use the
    # whole acceleration limit.
    demand: FloatArray


def pole_behaviour(servo: ServoModel, poles: npt.ArrayLike) -> PoleBehaviour:
    """Lag, peaking and demand of a servo of order "second" that is compensated with poles [1/s]."""
    kv = np.atleast_1d(_second_order(servo))
    placed = check_poles(poles, len(kv))
    x, c = transfer(kv, placed)
    # F G = (x s + c0) / (s³ + c2 s² + c1 s + c0).
    frequency = 1j * np.geomspace(1e-3, 1e3, STEP_TIMES)[:, None] * np.abs(placed).max(axis=1)
    magnitude = np.abs(
        (x * frequency + c[0]) / (frequency**3 + c[2] * frequency**2 + c[1] * frequency + c[0])
    )
    slowest, fastest = np.abs(placed.real).min(), np.abs(placed).max()
    times = np.append(0.0, np.geomspace(1e-4 / fastest, STEP_DURATION / slowest, STEP_TIMES))
    ones = np.zeros((STEP_TIMES, 6, len(placed)))
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
    """Find the fastest poles whose set-points do not saturate the servo.

    The poles are `m1 = m2 = -p, g = -K_v`. Then every joint has the transfer function
    `F G = p² / (s + p)²` and the lag 2 / p, and the demand exceeds the acceleration of the plan
    only at the corners of the interpolated command. This excess increases with p. Therefore p is
    found by bisection, from the demand of the interpolated set-points at all times.

    Args:
        servo: Servo model of order "second".
        trajectory: Trajectory that the joints should follow.
        limits: Limits with the joint accelerations of the servo, instead of the limits of the plan.
        cycle: Cycle [s].

    Returns:
        The poles m1, m2 and g of each joint [1/s], (dof, 3), for `PolePlacement(poles=...)`; p is
        at most 20 / cycle.

    Raises:
        CompensationError: A joint saturates even with the lag of the servo itself,
            `2 / p = 1 / K_p`.
        InvalidInput: There is no limit of joint acceleration, or the servo is not of order
            "second".
    """
    interval = check_cycle(cycle)
    limits = trajectory.limits_for(limits)
    if limits.joint_acceleration is None:
        raise InvalidInput(
            "fastest_poles requires a limit of joint acceleration, because it finds the fastest "
            "poles that do not saturate. Specify joint_acceleration.",
            limit="joint_acceleration",
        )
    lower, upper = limits.acceleration_bounds(trajectory.dof)
    model = servo.for_joints(trajectory.dof)
    kv = _second_order(model)

    def use(p: float) -> FloatArray:
        """Largest demand of each joint as a share of its acceleration limit, (dof,)."""
        _, q = pole_placement(trajectory, model, interval, pole_family(kv, p))
        demands = np.stack(extreme_demands(model, q, interval))
        return use_of("joint_acceleration", limits, demands).largest

    low = 2 * float(model.kp.min())
    high = max(LARGEST_POLE / interval, low)
    if use(high).max() <= 1:
        low = high
    elif (worst := use(low)).max() > 1:
        j = int(np.argmax(worst))
        allowed = float(min(-lower[j], upper[j]))
        needed = float(worst[j]) * allowed
        raise CompensationError(
            f"Joint {j + 1} saturates with any poles. Even with regulator poles at -{low:.4g} 1/s, "
            f"which have the lag of the servo itself, its demand is {needed:.6g} rad/s², but its "
            f"limit is {allowed:.6g} rad/s². Plan with a joint_acceleration that is lower by at "
            f"least {needed - allowed:.1g} rad/s², or use a shorter cycle.",
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
    """Lowest and highest demand of each joint without saturation [rad/s²], (dof,) each."""
    kv = _second_order(servo)
    prompt = ServoModel(kp=servo.kp, kv=kv, interpolation=servo.interpolation, dead_time=0 * kv)
    run = ServoSimulation(q, cycle, prompt).run(0, len(q) - 1, q[0].copy(), np.zeros(len(kv)))
    return run.lowest, run.highest


def _second_order(servo: ServoModel) -> FloatArray:
    """Velocity loop gains K_v of a servo [1/s]; raises an error if it is not of order "second"."""
    servo.check_orders("Pole placement, (26),")
    assert servo.kv is not None
    return servo.kv
