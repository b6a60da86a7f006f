"""Estimates, notes, the identified arm and its servo from a fit of rigid bodies."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._sampling import interpolate
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.identification.bodies.fitting import POSITIVE, BodyFit, Trial
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import AXES, LEAST_MASS, LOGARITHMIC, UNITS, Model
from armcontour.identification.bodies.precision import MOVES, Precision, doubts, moved
from armcontour.identification.bodies.results import Fitted, RobotIdentification, RobotJoint
from armcontour.identification.results import Estimate
from armcontour.servo import ServoModel

# A model that explains less than this share of the lag behind the command is of another robot: with
# two joints exchanged it explains 0.99 or less of one of them.
EXPLAINS = 0.99


def describe(
    model: Model,
    grids: list[Gridded],
    found: BodyFit,
    restless: BoolArray,
    delays: tuple[float, float],
    *,
    gains_known: bool,
) -> RobotIdentification:
    """Estimates and notes of a fit.

    Args:
        model: The robot.
        grids: The logs.
        found: The fit.
        restless: Unknowns that were fixed because the search did not converge in them.
        delays: Smallest and largest dead time of the search [s].
        gains_known: Whether a nominal servo was given.

    Raises:
        InvalidInput: The model does not explain the motion.
    """
    explained = refuse_misfit(grids, found.trial)
    of = _list_estimates(model, grids, found)
    # Logs show only the sum of J K_v and viscous friction: one of the two is nominal.
    viscous = np.asarray(model.arm.dynamics.chain.viscous)
    for name, values in (("kv", np.asarray(model.servo.kv)), ("viscous", viscous)):
        for j, value in enumerate(values.tolist()):
            of.setdefault((name, j), Estimate(name=name, unit=UNITS[name], value=value))
    joints = [
        RobotJoint(
            name=name,
            **{x: of[x, j] for x in ("kp", "kv", "viscous", "coulomb")},
            armature=of.get(("armature", j)),
            rms=float(rms),
            explained=float(share),
        )
        for j, (name, rms, share) in enumerate(
            zip(model.arm.joint_names, found.trial.scatter, explained, strict=True)
        )
    ]
    arm, gains = identified(model, found.trial.values)
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
        fitted=tuple(
            Fitted(log=x.log, t=x.log.t[x.rows], measured=x.measured, simulated=x.measured - left)
            for x, left in zip(grids, found.trial.residuals, strict=True)
        ),
        notes=_list_notes(model, found.trial.values, restless & moved(model, grids), delays),
        gains=gains,
        gains_known=gains_known,
    )


def identified(model: Model, values: FloatArray) -> tuple[Arm, ServoModel]:
    """The arm and the servo that have some values of the unknowns.

    Viscous friction below zero is taken from K_v: only their sum matters.
    """
    drives, viscous = model.drives(values), model.viscous(values)
    lower = np.minimum(viscous, 0.0)
    kv = (drives.damping + lower) / model.inertia
    kv = np.maximum(kv, 1e-3 * np.asarray(drives.servo.kv))
    chain, load = drives.arm.dynamics.chain, model.payload(values)
    unloaded = model.arm.dynamics.chain.payload is None and load.mass == 0
    arm = drives.arm.with_dynamics(
        payload=None if unloaded else chain.payload, viscous=viscous - lower
    )
    servo = drives.servo.replace(
        kv=kv, kp=drives.stiffness / (model.inertia * kv), dead_time=max(float(values[-1]), 0.0)
    )
    return arm, servo


def refuse_misfit(grids: list[Gridded], trial: Trial) -> FloatArray:
    """Share of the mean square lag behind the commands that the model explains, (dof,).

    Raises:
        InvalidInput: The model does not explain the motion of a joint.
    """
    left = np.zeros(grids[0].log.dof)
    lags, ranges = 0 * left, 0 * left
    for x, residuals in zip(grids, trial.residuals, strict=True):
        # The model need not explain the noise of the encoders.
        left += np.sum(residuals**2, axis=0) - len(residuals) * x.noise**2
        lags += np.sum((interpolate(x.log.t[x.rows], x.log.t, x.log.command) - x.measured) ** 2, 0)
        ranges = np.maximum(ranges, np.ptp(x.log.command, axis=0))
    explained = np.asarray(1 - np.maximum(left, 0.0) / np.maximum(lags, 1e-300))
    poor = (ranges > MOVES) & (explained < EXPLAINS)
    if poor.any():
        j = int(np.argmin(np.where(poor, explained, np.inf)))
        log = grids[0].log
        raise InvalidInput(
            f"{log.source}: the model explains {max(float(explained[j]), 0.0) * 100:.0f} % of the "
            f"lag of {log.joint_names[j]} behind its command, and {EXPLAINS:.0%} are needed: give "
            "the log of this arm, with its joints in the arm's order.",
            joint=j,
        )
    return explained


def _list_estimates(
    model: Model, grids: list[Gridded], found: BodyFit
) -> dict[tuple[str, int], Estimate]:
    """Estimates by names and indices of the unknowns; what is not determined is nominal."""
    known, doubt = Precision.of(found.jacobian, found.residuals), doubts(model, grids, found)
    values, covariance = found.trial.values, known.covariance(found.free)
    m = next(k for k, x in enumerate(model.unknowns) if x.name == "payload_mass")
    mass = float(values[m])
    estimates = {}
    for k, x in enumerate(model.unknowns):
        name, free, unit = x.name, bool(found.free[k]), UNITS[x.name]
        if name == "armature" and x.index < 0:
            unit = "1"
        # The estimate is a linear function of the unknowns.
        row = np.eye(len(values))[k]
        value, bias = float(values[k]), float(doubt[k])
        if name == "payload_center":
            # The unknown is the mass times the deviation from the nominal centre.
            name, free = f"payload_center_{AXES[x.index]}", free and mass > LEAST_MASS
            away = value / mass if free else 0.0
            value = float(model.load.center[x.index]) + away
            if free:
                row[m] = -away
                row, bias = row / mass, bias / mass
        if not free:
            value = math.exp(value) if name in LOGARITHMIC else value
            estimates[x.name, x.index] = Estimate(name=name, unit=unit, value=value)
            continue
        sd = math.sqrt(max(float(row @ covariance @ row), 0.0))
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


def _list_notes(
    model: Model, values: FloatArray, restless: BoolArray, delays: tuple[float, float]
) -> tuple[str, ...]:
    """Notes on the fit, as sentences."""
    notes = []
    if restless.any():
        names = [
            x.name.replace("_", " ") + (f" of joint {x.index + 1}" if x.index >= 0 else "")
            for x, y in zip(model.unknowns, restless, strict=True)
            if y
        ]
        notes.append(f"The search did not converge in {', '.join(names)}.")
    if not delays[0] < float(values[-1]) < delays[1]:
        notes.append(f"The dead time is outside the search range, up to {delays[1] * 1e3:g} ms.")
    negative = np.flatnonzero(model.viscous(values) < 0) + 1
    if model.keep_kv and len(negative):
        notes.append(
            f"The viscous friction of joint {', '.join(map(str, negative))} would be below zero, "
            "so K_v is reduced instead."
        )
    return tuple(notes)
