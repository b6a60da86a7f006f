"""`identify_robot`: payload, friction, drive inertias, gains and dead time from logs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._progress import Progress, Step, under
from armcontour.arms import Arm
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.identification.bodies.checking import check_logs
from armcontour.identification.bodies.describing import describe, refuse_misfit
from armcontour.identification.bodies.fitting import BodyFit, fit
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import GRAVITIES, Model
from armcontour.identification.bodies.precision import (
    Precision,
    allowed,
    determined,
    seen,
    unsettled,
    with_mass,
    worst,
)
from armcontour.identification.bodies.results import RobotIdentification
from armcontour.identification.bodies.starting import start
from armcontour.motion import Log
from armcontour.servo import ServoModel

# Gains at which the search starts without a nominal servo [1/s].
KP, KV = 25.0, 150.0
# Joints forget where they started in this many time constants of their position loops,
FORGOTTEN = 10.0
# and in no less than this time [s].
SETTLED = 0.3
# Step of the simulations of the first search, and of the choice of the gravity feed-forward [s],
COARSE = 5e-3
# and the share of the sum of squares below which a reduction ends these searches.
COARSE_NEAR = 1e-3
# Another gravity must leave errors that are smaller by this share: with a load that the controller
# knows, all are alike.
SURELY = 0.05
# Errors below this many times the noise leave nothing to be explained.
ALL_NOISE = 2.0
# A search that does not converge goes on without one unknown, after so many rounds without all that
# do not converge.
FEW_LEFT_OUT = 8


def identify_robot(
    logs: Sequence[Log],
    arm: Arm,
    servo: ServoModel | None,
    *,
    gravity: str | None,
    interpolation: str,
    delays: tuple[float, float],
    drive_cycle: float,
    progress: Progress | None,
) -> RobotIdentification:
    """Identify payload, friction, drive inertias, gains and dead time of a robot.

    Args:
        logs: The logs, of joints in the order of the arm.
        arm: The nominal arm, with masses.
        servo: The nominal servo of order "second", or None.
        gravity: One of GRAVITIES; None for the one that the logs support.
        interpolation: "linear" or "step".
        delays: Smallest and largest dead time of the search [s].
        drive_cycle: Time for which the drives keep their torque [s].
        progress: Called with steps.

    Raises:
        InvalidInput: The arm has no masses, or the logs do not fit the arm.
    """
    tell = under(progress)
    guess = ServoModel(kp=KP, kv=KV) if servo is None else servo
    guess = guess.for_joints(arm.dof).replace(interpolation=interpolation)
    check_logs(logs, arm)
    model = Model(
        arm=arm,
        servo=guess,
        keep_kv=servo is not None,
        gravity=gravity or "nominal",
        lag=drive_cycle / 2,
    )
    settled = max(FORGOTTEN / float(guess.kp.min()), SETTLED)
    tell(Step(("start",)))
    grids = [Gridded.of(x, interpolation, settled) for x in logs]
    values = start(model, grids, delays)
    coarse = [Gridded.of(x, interpolation, settled, step=COARSE) for x in logs]
    noise = np.max([x.noise for x in grids], axis=0)
    try:
        if gravity is None:
            tell(Step(("gravity",)))
            model, values = _choose_gravity(model, coarse, values, noise)
        tell(Step(("coarse fit",)))
        free = seen(model, coarse, values, noise)
        near = fit(model, coarse, values, free, COARSE_NEAR).trial
        refuse_misfit(coarse, near)
        tell(Step(("fit",)))
        found, restless = _fit(model, grids, near.values, noise)
    except ExecutionError as error:
        raise InvalidInput(f"The log does not fit the arm and its servo: {error}") from None
    return describe(model, grids, found, restless, delays, gains_known=servo is not None)


def _choose_gravity(
    model: Model, grids: list[Gridded], values: FloatArray, noise: FloatArray
) -> tuple[Model, FloatArray]:
    """The model whose gravity feed-forward leaves the smallest errors, and its values."""
    best, least, scatter = (model, values), np.inf, np.ones(model.arm.dof)
    for name in GRAVITIES:
        trial = replace(model, gravity=name)
        try:
            free = seen(trial, grids, values, noise)
            found = fit(trial, grids, values, free, COARSE_NEAR).trial
        except ExecutionError:
            continue
        if (found.scatter < ALL_NOISE * noise).all():
            return trial, found.values
        scatter = found.scatter if np.isinf(least) else scatter
        cost = found.cost(scatter)
        if cost < (1 - SURELY) * least:
            best, least = (trial, found.values), cost
    return best


def _fit(
    model: Model, grids: list[Gridded], values: FloatArray, noise: FloatArray
) -> tuple[BodyFit, BoolArray]:
    """The fit of the unknowns that the logs determine; the others stay nominal.

    Returns:
        The fit, and the unknowns in which the search did not converge.

    Raises:
        ExecutionError: The robot cannot be simulated.
    """
    free = seen(model, grids, values, noise)
    settled = np.ones(len(values), dtype=bool)
    for k in itertools.count():
        found = fit(model, grids, np.where(free, values, model.nominal), free)
        values = found.trial.values
        precision = Precision.of(found.jacobian, found.residuals)
        known = determined(model, precision, free, allowed(model, values))
        if (known == free).all():
            moves = unsettled(found)
            if moves.max() <= 1.0:
                return found, ~settled
            if k < FEW_LEFT_OUT:
                settled[worst(model, moves)] = False
            else:
                settled &= moves <= 1.0
            known = free & settled
        free = known & with_mass(model, known)
    raise AssertionError
