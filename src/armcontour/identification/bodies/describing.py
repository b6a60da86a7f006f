"""From a fit of rigid bodies to estimates, the identified arm and its servo."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._describing import digits
from armcontour._sampling import interpolate
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.identification.bodies.fitting import BodyFit, Trial
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import (
    AXES,
    LEAST_MASS,
    LOGARITHMIC,
    UNITS,
    Model,
    Unknown,
)
from armcontour.identification.bodies.precision import (
    MOVES,
    Precision,
    allowed,
    is_white,
    moved,
    precision,
)
from armcontour.identification.bodies.results import Fitted, RobotIdentification, RobotJoint
from armcontour.identification.correlation import whiteness
from armcontour.identification.fitting import noise_of
from armcontour.identification.results import Estimate
from armcontour.servo import ServoModel

# A model that explains less than this share of the lag behind the command is of another robot: with
# two joints exchanged it explains 0.99 or less of one of them.
EXPLAINS = 0.99
SYMBOLS = {
    "kp": "K_p",
    "kv": "K_v",
    "viscous": "viscous friction",
    "coulomb": "Coulomb friction",
    "payload_mass": "the mass of the payload",
    "payload_center": "the payload's centre of mass",
    "armature": "the drives' inertia",
    "dead_time": "the dead time",
}
TIED = {
    "kv": "A log shows only the sum of J K_v and viscous friction: K_v keeps its nominal value, "
    "and viscous friction is what is left.",
    "viscous": "A log shows only the sum of J K_v and viscous friction: viscous friction keeps "
    "its nominal value, and K_v is what is left; with a nominal servo it is the other way round.",
}
HELD = {
    "nominal": "The controller holds the nominal arm against gravity, without its load.",
    "loaded": "The controller holds the arm against gravity, with its load.",
    "none": "The controller adds no torque against gravity.",
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Known:
    """A fit, how well it knows the unknowns, and how well it should.

    Args:
        model: The robot.
        values: Values of the unknowns.
        free: Which were sought.
        unsettled: Which were left out since the search did not come to rest in them.
        precision: Standard deviations.
        limit: Standard deviations that count as told.
        sought: Standard deviations if that unknown had been sought too.
        moved: Unknowns but for those of joints that no log moves.
    """

    model: Model
    values: FloatArray
    free: BoolArray
    unsettled: BoolArray
    precision: Precision
    limit: FloatArray
    sought: FloatArray
    moved: BoolArray


def describe(
    model: Model,
    grids: list[Gridded],
    found: BodyFit,
    unsettled: BoolArray,
    delays: tuple[float, float],
    *,
    gains_known: bool,
) -> RobotIdentification:
    """What a fit says of the robot.

    Args:
        model: The robot.
        grids: The logs.
        found: The fit.
        unsettled: Unknowns that were left out since the search did not come to rest in them.
        delays: Smallest and largest dead time of the search [s].
        gains_known: Whether a nominal servo was given.

    Raises:
        InvalidInput: The model does not explain the motion.
    """
    fitted = fitted_of(grids, found.trial)
    explained = refuse_misfit(fitted)
    values = found.trial.values
    known = _Known(
        model=model,
        values=values,
        free=found.free,
        unsettled=unsettled,
        precision=precision(found, found.free),
        limit=allowed(model, values),
        sought=_sought(found),
        moved=moved(model, grids),
    )
    arm, gains = identified(model, values)
    of = {(x.name, x.index): k for k, x in enumerate(model.unknowns)}
    every = np.concatenate([x.residuals for x in fitted])
    joints = tuple(
        RobotJoint(
            name=name,
            kp=_estimate(known, of["kp", j]),
            kv=_tied(known, "kv", j) if model.keep_kv else _estimate(known, of["kv", j]),
            viscous=_estimate(known, of["viscous", j])
            if model.keep_kv
            else _tied(known, "viscous", j),
            coulomb=_estimate(known, of["coulomb", j]),
            armature=None if model.scales else _estimate(known, of["armature", j]),
            rms=float(np.sqrt(np.mean(every[:, j] ** 2))),
            explained=float(explained[j]),
            whiteness=whiteness(np.ascontiguousarray(every[:, j])),
        )
        for j, name in enumerate(model.arm.joint_names)
    )
    x, y, z = (_center(known, of, i) for i in range(3))
    return RobotIdentification(
        nominal=model.arm,
        gravity=model.gravity,
        interpolation=model.servo.interpolation,
        joints=joints,
        payload_mass=_estimate(known, of["payload_mass", -1]),
        payload_center=(x, y, z),
        armature=_estimate(known, of["armature", -1]) if model.scales else None,
        dead_time=_estimate(known, of["dead_time", -1]),
        arm=arm,
        fitted=fitted,
        notes=_notes(model, found, known, delays),
        model=model,
        fit=found,
        gains=gains,
        gains_known=gains_known,
    )


def identified(model: Model, values: FloatArray) -> tuple[Arm, ServoModel]:
    """The arm and the servo that have some values of the unknowns.

    Viscous friction below zero is taken from K_v: only their sum matters.

    Args:
        model: The robot.
        values: Values of the unknowns.
    """
    drives, viscous = model.drives(values), model.viscous(values)
    lower = np.minimum(viscous, 0.0)
    damping = drives.damping + lower
    kv = np.maximum(damping / model.inertia, 1e-3 * np.asarray(drives.servo.kv))
    chain = drives.arm.dynamics.chain
    nothing = model.arm.dynamics.chain.payload is None and float(model.payload(values).mass) == 0
    arm = model.arm.with_dynamics(
        payload=None if nothing else chain.payload,
        armature=chain.armature,
        coulomb=chain.coulomb,
        viscous=viscous - lower,
    )
    servo = drives.servo.replace(
        kv=kv,
        kp=drives.stiffness / (model.inertia * kv),
        dead_time=max(float(values[-1]), 0.0),
    )
    return arm, servo


def fitted_of(grids: list[Gridded], trial: Trial) -> tuple[Fitted, ...]:
    """The logs with their simulated motion.

    Args:
        grids: The logs.
        trial: The motion.
    """
    return tuple(
        Fitted(log=x.log, t=x.log.t[x.rows], measured=x.measured, simulated=x.measured - residuals)
        for x, residuals in zip(grids, trial.residuals, strict=True)
    )


def _sought(found: BodyFit) -> FloatArray:
    """Standard deviations of unknowns, of each if it had been sought beside the others."""
    sd = np.array(precision(found, found.free).sd)
    for k in np.flatnonzero(~found.free):
        sd[k] = precision(found, found.free | (np.arange(len(sd)) == k)).sd[k]
    return sd


def _lags(fitted: tuple[Fitted, ...]) -> FloatArray:
    """Commands less measured positions [rad], (samples, dof)."""
    commands = [interpolate(x.t, x.log.t, x.log.command) for x in fitted]
    return np.asarray(np.concatenate(commands) - np.concatenate([x.measured for x in fitted]))


def _explained(fitted: tuple[Fitted, ...]) -> FloatArray:
    """Share of the mean square lag behind the commands that the model explains, (dof,)."""
    left = np.sum(np.concatenate([x.residuals for x in fitted]) ** 2, axis=0)
    # What the encoders add is not the model's to explain.
    noise = np.array([[noise_of(y) for y in x.log.measured.T] for x in fitted])
    left = np.maximum(left - np.array([len(x.t) for x in fitted]) @ noise**2, 0.0)
    return np.asarray(1 - left / np.maximum(np.sum(_lags(fitted) ** 2, axis=0), 1e-300))


def refuse_misfit(fitted: tuple[Fitted, ...]) -> FloatArray:
    """Shares of the lags that the model explains, (dof,).

    Args:
        fitted: The logs with their simulated motion.

    Raises:
        InvalidInput: The model does not explain the motion of a joint.
    """
    explained = _explained(fitted)
    ranges = np.max([np.ptp(x.log.command, axis=0) for x in fitted], axis=0)
    poor = (ranges > MOVES) & (explained < EXPLAINS)
    if poor.any():
        j = int(np.argmin(np.where(poor, explained, np.inf)))
        log = fitted[0].log
        raise InvalidInput(
            f"{log.source}: of what {log.joint_names[j]} lags behind its command, the model "
            f"explains {max(float(explained[j]), 0.0) * 100:.0f} % only, so nothing is told: is it "
            "the log of this arm, with its joints in the arm's order?",
            joint=j + 1,
        )
    return explained


def _estimate(known: _Known, k: int) -> Estimate:
    """The estimate of an unknown; one that is not told has its nominal value."""
    x, value, sd = known.model.unknowns[k], float(known.values[k]), float(known.precision.sd[k])
    if not known.free[k]:
        return _not_told(known, k)
    reach = known.precision.quantile * sd
    low, high = value - reach, value + reach
    if x.name in LOGARITHMIC:
        value, low, high = math.exp(value), math.exp(low), math.exp(high)
        sd *= value
    elif x.name in ("coulomb", "payload_mass", "armature"):
        low = max(low, 0.0)
    return _made(x.name, value, sd, low, high, factor=_is_factor(x))


def _is_factor(x: Unknown) -> bool:
    """Whether an unknown is the factor of all nominal drive inertias."""
    return x.name == "armature" and x.index < 0


def _made(
    name: str,
    value: float,
    sd: float,
    low: float,
    high: float,
    advice: str = "",
    *,
    factor: bool = False,
) -> Estimate:
    unit = UNITS["payload_center"] if name.startswith("payload_center") else UNITS[name]
    unit = "1" if factor else unit
    return Estimate(
        name=name, unit=unit, value=value, sd=sd, low=low, high=high, determined=not advice,
        advice=advice,
    )  # fmt: skip


def _not_told(known: _Known, k: int) -> Estimate:
    """An unknown that keeps its nominal value, and why."""
    x, model = known.model.unknowns[k], known.model
    value, sd, limit = float(known.values[k]), float(known.sought[k]), float(known.limit[k])
    logarithmic = x.name in LOGARITHMIC
    value = math.exp(value) if logarithmic else value
    symbol = SYMBOLS[x.name]
    share = logarithmic or _is_factor(x)
    if not known.moved[k]:
        why = f"The joint is not told to move, so the log does not show {symbol}"
    elif known.unsettled[k]:
        why = (
            f"The search did not come to rest in {symbol}, as if the robot did something that the "
            "model does not"
        )
    elif not math.isfinite(sd) or (share and sd > 1):
        why = f"The log does not show {symbol} at all"
    else:
        scale, unit = (100.0, "%") if share else (1.0, UNITS[x.name])
        scale, unit = (1e3, "ms") if x.name == "dead_time" else (scale, unit)
        why = (
            f"The log tells {symbol} to {digits(sd * scale, 2)} {unit} only, and "
            f"{digits(limit * scale, 2)} {unit} are needed"
        )
    gain = x.name in LOGARITHMIC
    kept = "a guess" if gain and not model.keep_kv else "its nominal value"
    advice = f"{why}, so it keeps {kept}."
    return _made(x.name, value, math.nan, -math.inf, math.inf, advice, factor=_is_factor(x))


def _tied(known: _Known, name: str, j: int) -> Estimate:
    """K_v or viscous friction, of which a log shows only the sum."""
    if name == "kv":
        value = float(np.asarray(known.model.servo.kv)[j])
    else:
        value = float(np.asarray(known.model.arm.dynamics.chain.viscous)[j])
    return _made(name, value, math.nan, -math.inf, math.inf, TIED[name])


def _center(known: _Known, of: dict[tuple[str, int], int], i: int) -> Estimate:
    """The payload's centre along one axis of the tip, from its first moment."""
    k, m = of["payload_center", i], of["payload_mass", -1]
    name = f"payload_center_{AXES[i]}"
    nominal = float(known.model.load.center[i])
    mass, moment = float(known.values[m]), float(known.values[k])
    if not known.free[k] or mass <= LEAST_MASS:
        sd = float(known.sought[k])
        why = (
            "There is no payload whose centre the log could show"
            if mass <= LEAST_MASS
            else "The search did not come to rest in it"
            if known.unsettled[k]
            else f"The log tells it to {digits(sd / mass * 1e3, 2)} mm only, and "
            f"{digits(known.limit[k] / mass * 1e3, 2)} mm are needed"
            if math.isfinite(sd)
            else "The log does not show it at all"
        )
        kept = f"{why}, so it keeps its nominal value."
        return _made(name, nominal, math.nan, -math.inf, math.inf, kept)
    away, cov = moment / mass, known.precision.covariance
    variance = cov[k, k] - 2 * away * cov[k, m] + away**2 * cov[m, m]
    sd = math.sqrt(max(variance, 0.0)) / mass
    reach = known.precision.quantile * sd
    value = nominal + away
    return _made(name, value, sd, value - reach, value + reach)


def _notes(
    model: Model, found: BodyFit, known: _Known, delays: tuple[float, float]
) -> tuple[str, ...]:
    notes = [HELD[model.gravity]]
    notes.append(
        "Gains are those of loops that scale by J, the nominal inertia of "
        f"{'the servo' if model.servo.inertia is not None else 'the arm'}: a log shows only their "
        "products with J, and masses of links count as known."
    )
    if not is_white(found.residuals):
        notes.append(
            "The residuals are not white: the encoder is coarse, or the robot does something that "
            "the model does not. Intervals allow for their correlation, not for what is missing."
        )
    if (known.moved & ~known.free & np.isfinite(known.sought)).any():
        notes.append(
            "Intervals count what keeps its nominal value as true: with a gain that is off by 1 %, "
            "friction and loads may be off by as much."
        )
    delay = float(known.values[-1])
    if delay <= delays[0] or delay >= delays[1]:
        notes.append(f"The dead time is outside of those looked for, up to {delays[1] * 1e3:g} ms.")
    negative = np.flatnonzero(model.viscous(known.values) < 0) + 1
    if model.keep_kv and len(negative):
        notes.append(
            f"Viscous friction of joint {', '.join(map(str, negative))} comes out below zero: the "
            "sum of J K_v and friction is less than the nominal J K_v, so K_v is lowered instead."
        )
    return tuple(notes)
