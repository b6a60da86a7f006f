"""Estimates, findings, the identified arm and its servo from a fit of rigid bodies."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._sampling import interpolate
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.identification.bodies.fitting import BodyFit, Trial
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import AXES, LEAST_MASS, LOGARITHMIC, UNITS, Model
from armcontour.identification.bodies.precision import (
    MOVES,
    doubts,
    is_white,
    moved,
    precision,
)
from armcontour.identification.bodies.results import Fitted, RobotIdentification, RobotJoint
from armcontour.identification.fitting import noise_of
from armcontour.identification.results import Estimate
from armcontour.servo import ServoModel

# A model that explains less than this share of the lag behind the command is of another robot: with
# two joints exchanged it explains 0.99 or less of one of them.
EXPLAINS = 0.99
# Unknowns that are never below zero.
POSITIVE = ("coulomb", "payload_mass", "armature")


def describe(
    model: Model,
    grids: list[Gridded],
    found: BodyFit,
    unsettled: BoolArray,
    delays: tuple[float, float],
    *,
    gains_known: bool,
) -> RobotIdentification:
    """Estimates and findings of a fit.

    Args:
        model: The robot.
        grids: The logs.
        found: The fit.
        unsettled: Unknowns that were fixed because the search did not converge in them.
        delays: Smallest and largest dead time of the search [s].
        gains_known: Whether a nominal servo was given.

    Raises:
        InvalidInput: The model does not explain the motion.
    """
    fitted = fitted_of(grids, found.trial)
    explained = refuse_misfit(fitted)
    values = found.trial.values
    of = _list_estimates(model, grids, found)
    arm, gains = identified(model, values)
    every = np.concatenate([x.residuals for x in fitted])
    tied = {
        "kv": np.asarray(model.servo.kv),
        "viscous": np.asarray(model.arm.dynamics.chain.viscous),
    }
    joints = []
    for j, name in enumerate(model.arm.joint_names):
        # Logs show only the sum of J K_v and viscous friction: one of the two is nominal.
        kv, viscous = (of.get((x, j)) or _make(x, float(y[j]), UNITS[x]) for x, y in tied.items())
        joints.append(
            RobotJoint(
                name=name,
                kp=of["kp", j],
                kv=kv,
                viscous=viscous,
                coulomb=of["coulomb", j],
                armature=of.get(("armature", j)),
                rms=float(np.sqrt(np.mean(every[:, j] ** 2))),
                explained=float(explained[j]),
            )
        )
    return RobotIdentification(
        nominal=model.arm,
        gravity=model.gravity,
        interpolation=model.servo.interpolation,
        joints=tuple(joints),
        payload_mass=of["payload_mass", -1],
        payload_center=(of["payload_center", 0], of["payload_center", 1], of["payload_center", 2]),
        armature=of.get(("armature", -1)),
        dead_time=of["dead_time", -1],
        arm=arm,
        fitted=fitted,
        notes=_list_findings(model, found, unsettled & moved(model, grids), delays),
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


def _list_estimates(
    model: Model, grids: list[Gridded], found: BodyFit
) -> dict[tuple[str, int], Estimate]:
    """Estimates by names and indices of the unknowns; what is not determined is nominal."""
    known, doubt = precision(found, found.free), doubts(model, grids, found, found.free)
    values, covariance = found.trial.values, known.covariance
    m = next(k for k, x in enumerate(model.unknowns) if x.name == "payload_mass")
    mass = float(values[m])
    estimates = {}
    for k, x in enumerate(model.unknowns):
        name, free = x.name, bool(found.free[k])
        unit = "1" if name == "armature" and x.index < 0 else UNITS[name]
        value, sd, bias = float(values[k]), float(known.sd[k]), float(doubt[k])
        if x.name == "payload_center":
            # The unknown is the mass times the deviation from the nominal centre.
            name, nominal = f"payload_center_{AXES[x.index]}", float(model.load.center[x.index])
            free = free and mass > LEAST_MASS
            away = value / mass if free else 0.0
            value = nominal + away
            if free:
                own, both, other = covariance[k, k], covariance[k, m], covariance[m, m]
                sd = math.sqrt(max(own - 2 * away * both + away**2 * other, 0.0)) / mass
                bias /= mass
        if not free:
            value = math.exp(value) if name in LOGARITHMIC else value
            estimates[x.name, x.index] = _make(name, value, unit)
            continue
        reach, sd = known.quantile * sd + bias, math.hypot(sd, bias)
        low, high = value - reach, value + reach
        if name in LOGARITHMIC:
            value, low, high = math.exp(value), math.exp(low), math.exp(high)
            sd *= value
        elif name in POSITIVE:
            low = max(low, 0.0)
        estimates[x.name, x.index] = Estimate(
            name=name, unit=unit, value=value, sd=sd, low=low, high=high, determined=True
        )
    return estimates


def _make(name: str, value: float, unit: str) -> Estimate:
    """The estimate of an unknown that keeps its nominal value."""
    return Estimate(
        name=name, unit=unit, value=value, sd=math.nan, low=-math.inf,
        high=math.inf, determined=False,
    )  # fmt: skip


def _list_findings(
    model: Model, found: BodyFit, unsettled: BoolArray, delays: tuple[float, float]
) -> tuple[str, ...]:
    """Findings on the fit, as sentences."""
    notes = []
    if not is_white(found.residuals):
        notes.append("The residuals are correlated, and the intervals allow for that.")
    names = [
        x.name.replace("_", " ") + (f" of joint {x.index + 1}" if x.index >= 0 else "")
        for x in model.unknowns
    ]
    if unsettled.any():
        which = ", ".join(np.array(names)[unsettled])
        notes.append(f"The search did not converge in {which}.")
    values = found.trial.values
    if not delays[0] < float(values[-1]) < delays[1]:
        notes.append(f"The dead time is outside the search range, up to {delays[1] * 1e3:g} ms.")
    negative = np.flatnonzero(model.viscous(values) < 0) + 1
    if model.keep_kv and len(negative):
        notes.append(
            f"The viscous friction of joint {', '.join(map(str, negative))} would be below zero, "
            "so K_v is reduced instead."
        )
    return tuple(notes)
