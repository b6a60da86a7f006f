"""`identify_robot`: payload, friction, drive inertias, gains and dead time from logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._progress import Progress, Step, under
from armcontour.arms import Arm
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.identification.bodies.describing import describe, refuse_misfit
from armcontour.identification.bodies.fitting import BodyFit, Trial, fit
from armcontour.identification.bodies.grid import Gridded, noise_of
from armcontour.identification.bodies.model import GRAVITIES, Model
from armcontour.identification.bodies.precision import (
    Precision,
    allowed,
    determined,
    seen,
    with_mass,
)
from armcontour.identification.bodies.results import RobotIdentification
from armcontour.motion import Log
from armcontour.motion.log_checks import check_logs
from armcontour.servo import ServoModel

# Gains at which the search starts without a nominal servo [1/s].
KP, KV = 25.0, 150.0
# Joints forget where they started in this many time constants of their position loops,
FORGOTTEN = 10.0
# and in no less than this time [s].
SETTLED = 0.3
# Step of the simulations of the first search, which chooses the gravity feed-forward [s],
COARSE = 5e-3
# and the share of the sum of squares below which a reduction ends these searches.
COARSE_NEAR = 1e-3
# Another gravity must leave errors that are smaller by this share: with a load that the controller
# knows, all are alike.
SURELY = 0.05
# Errors below this many times the noise leave nothing to be explained.
ALL_NOISE = 2.0
# A search has converged in an unknown if its next step is at most this share of a standard
# deviation; otherwise the unknown stays nominal.
REST = 0.5


def identify_robot(
    logs: Sequence[Log],
    arm: Arm,
    servo: ServoModel | None,
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
    settled = max(FORGOTTEN / float(guess.kp.min()), SETTLED)
    coarse = [Gridded.of(x, interpolation, settled, step=COARSE) for x in logs]
    models = [
        Model(arm=arm, servo=guess, keep_kv=servo is not None, gravity=x, lag=drive_cycle / 2)
        for x in (GRAVITIES if gravity is None else [gravity])
    ]
    try:
        tell(Step(("gravity",)))
        model, near = _choose_model(models, coarse)
        refuse_misfit(coarse, near)
        tell(Step(("fit",)))
        grids = [Gridded.of(x, interpolation, settled) for x in logs]
        found, restless = _fit(model, grids, near.values)
    except ExecutionError as error:
        raise InvalidInput(f"The log does not fit the arm and its servo: {error}") from None
    return describe(model, grids, found, restless, delays, gains_known=servo is not None)


def _choose_model(models: list[Model], grids: list[Gridded]) -> tuple[Model, Trial]:
    """The model whose gravity feed-forward leaves the smallest errors, and its motion.

    Raises:
        ExecutionError: The robot cannot be simulated with any of them.
    """
    best, why = None, ExecutionError("it cannot be simulated.")
    for model in models:
        start = np.array(model.nominal)
        try:
            found = fit(model, grids, start, seen(model, grids, start), COARSE_NEAR).trial
        except ExecutionError as error:
            why = error
            continue
        if (found.scatter < ALL_NOISE * noise_of(grids)).all():
            return model, found
        scatter = found.scatter if best is None else best[1].scatter
        if best is None or found.cost(scatter) < (1 - SURELY) * best[1].cost(scatter):
            best = model, found
    if best is None:
        raise why
    return best


def _fit(model: Model, grids: list[Gridded], values: FloatArray) -> tuple[BodyFit, BoolArray]:
    """The fit of the unknowns that the logs determine; the others stay nominal.

    Returns:
        The fit, and the unknowns in which the search did not converge.

    Raises:
        ExecutionError: The robot cannot be simulated.
    """
    free, restless = seen(model, grids, values), np.zeros(len(values), dtype=bool)
    while True:
        found = fit(model, grids, np.where(free, values, model.nominal), free)
        values = found.trial.values
        precision = Precision.of(found.jacobian, found.residuals)
        known = determined(model, precision, free, allowed(model, values))
        if (known == free).all():
            sd = np.maximum(precision.sd(free), 1e-300)
            known = free & ~(np.abs(found.left) > REST * sd)
            restless |= free & ~known
            if (known == free).all():
                return found, restless
        free = known & with_mass(model, known)
