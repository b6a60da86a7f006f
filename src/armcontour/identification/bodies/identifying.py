"""`identify_robot`: what logs tell of an arm with masses and of its drives."""

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
from armcontour.identification.bodies.describing import describe, fitted_of, refuse_misfit
from armcontour.identification.bodies.fitting import BodyFit, Trial, expected_fit, fit
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import GRAVITIES, LOGARITHMIC, Model
from armcontour.identification.bodies.precision import (
    OF_JOINTS,
    allowed,
    also_told,
    moved,
    reachable,
    told,
    unsettled,
    with_mass,
    worst,
)
from armcontour.identification.bodies.results import RobotIdentification
from armcontour.identification.bodies.starting import start
from armcontour.identification.fitting import noise_of
from armcontour.motion import Log
from armcontour.servo import ServoModel

# Gains at which the search starts without a nominal servo [1/s].
KP, KV = 25.0, 150.0
# Joints forget where they started in this many time constants of their position loops,
FORGOTTEN = 10.0
# and in no less than this time [s].
SETTLED = 0.3
# Step of the simulations from which the search starts, and which tell what the controller adds
# against gravity [s],
COARSE = 5e-3
# and the number of steps of that search: the wrong gravity leaves errors many times larger.
FEW_STEPS = 3
# Another gravity must leave errors that are smaller by this share: with a load that the controller
# knows, all are alike.
SURELY = 0.05
# A joint whose errors are this many times larger than the others', in multiples of their noise, is
# sought again, this often.
LEFT_OUT, MOST_RESTARTS = 5.0, 2
# Errors below this many times the noise leave nothing to be explained.
ALL_NOISE = 2.0
# Smallest noise of an encoder [rad]: less is rounding.
LEAST_NOISE = 1e-7
# A fit is repeated without unknowns that it does not tell, until it tells all that it seeks. What
# was left out may come back so many times: earlier values may have hidden what logs tell.
SECOND_CHANCES = 3
# In the first rounds a search that does not come to rest goes on without one unknown, later without
# all in which it does not.
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
        gravity: One of GRAVITIES; None for what the logs speak for.
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
    if gravity is None:
        tell(Step(("gravity",)))
        model, values = _choose_gravity(model, coarse, values)
    tell(Step(("coarse fit",)))
    near = _approach(model, coarse, values)
    refuse_misfit(fitted_of(coarse, near))
    values = near.values
    tell(Step(("fit",)))
    found, restless = _fit(model, grids, values)
    return describe(model, grids, found, restless, delays, gains_known=servo is not None)


def _choose_gravity(
    model: Model, grids: list[Gridded], values: FloatArray
) -> tuple[Model, FloatArray]:
    """The model whose gravity feed-forward leaves the smallest errors, and its values."""
    best: tuple[float, Model, FloatArray] | None = None
    scatter = np.ones(model.arm.dof)
    for name in GRAVITIES:
        trial = replace(model, gravity=name)
        try:
            free = _seen(trial, grids, values)
            found = fit(trial, grids, values, free, most=FEW_STEPS).trial
        except ExecutionError:
            continue
        if (found.scatter < ALL_NOISE * _noise(grids)).all():
            return trial, found.values
        if best is None:
            scatter = found.scatter
        cost = found.cost(scatter)
        if best is None or cost < (1 - SURELY) * best[0]:
            best = cost, trial, found.values
    return (model, values) if best is None else best[1:]


def _approach(model: Model, grids: list[Gridded], values: FloatArray) -> Trial:
    """A trial near that with the smallest errors.

    Friction that holds a joint hides its other unknowns: where a joint is left with errors far
    above the others', the search is repeated with nominal values of this joint.

    Raises:
        InvalidInput: The robot cannot be simulated.
    """
    try:
        found = _settle(model, grids, values, _seen(model, grids, values)).trial
        for _ in range(MOST_RESTARTS):
            noisy = found.scatter / _noise(grids)
            poor = noisy > LEFT_OUT * max(float(np.median(noisy)), 1.0)
            if not poor.any():
                break
            of_poor = [
                x.name in OF_JOINTS and x.index >= 0 and poor[x.index] for x in model.unknowns
            ]
            again = np.where(of_poor, model.nominal, found.values)
            tried = fit(model, grids, again, _seen(model, grids, again)).trial
            if tried.cost(found.scatter) >= found.cost(found.scatter):
                break
            found = tried
    except ExecutionError as error:
        raise InvalidInput(f"The log does not fit the arm and its servo: {error}") from None
    return found


def _settle(model: Model, grids: list[Gridded], values: FloatArray, free: BoolArray) -> BodyFit:
    """A fit; if it does not come to rest, one that starts with nominal gains.

    Without gravity, only links of known mass tell the scale of all torques. Far from the truth the
    way along it is too bent for linear steps.

    Args:
        model: The robot.
        grids: The logs.
        values: Where the search starts.
        free: Unknowns that are sought, (unknowns,).

    Raises:
        ExecutionError: The robot cannot be simulated.
    """
    found = fit(model, grids, values, free)
    gains = np.array([x.name in LOGARITHMIC for x in model.unknowns])
    if not (free & gains).any() or unsettled(found).max() <= 1.0:
        return found
    near = np.where(gains, model.nominal, found.trial.values)
    near = fit(model, grids, near, free & ~gains).trial.values
    again = fit(model, grids, near, free)
    better = again.trial.cost(found.scatter) < found.trial.cost(found.scatter)
    return again if better else found


def _fit(model: Model, grids: list[Gridded], values: FloatArray) -> tuple[BodyFit, BoolArray]:
    """The fit of what the logs tell; the rest stays nominal.

    Returns:
        The fit, and which unknowns were left out since the search did not come to rest in them.

    Raises:
        InvalidInput: The robot cannot be simulated.
    """
    try:
        free = _seen(model, grids, values)
        some, settled = moved(model, grids), np.ones(len(values), dtype=bool)
        for k in itertools.count():
            values = np.where(free, values, model.nominal)
            found = _settle(model, grids, values, free)
            values = found.trial.values
            limit = allowed(model, values)
            known = told(model, found, free, limit)
            if k < SECOND_CHANCES:
                known = also_told(model, found, known, some & settled, limit)
            if (known == free).all():
                moves = unsettled(found)
                if moves.max() <= 1.0:
                    break
                if k < FEW_LEFT_OUT:
                    settled[worst(model, moves)] = False
                else:
                    settled &= moves <= 1.0
                known = free & settled
            free = known & with_mass(model, known)
    except ExecutionError as error:
        raise InvalidInput(f"The log does not fit the arm and its servo: {error}") from None
    return found, ~settled


def _seen(model: Model, grids: list[Gridded], values: FloatArray) -> BoolArray:
    """Unknowns that the logs would tell if there were only the noise of the encoders."""
    ideal = expected_fit(model, grids, values, _noise(grids))
    some = moved(model, grids)
    return told(model, ideal, some, reachable(model, values), noise_only=True)


def _noise(grids: list[Gridded]) -> FloatArray:
    """Standard deviation of each joint's encoder [rad], (dof,)."""
    found = [[noise_of(x) for x in grid.log.measured.T] for grid in grids]
    return np.asarray(np.maximum(np.max(found, axis=0), LEAST_NOISE))
