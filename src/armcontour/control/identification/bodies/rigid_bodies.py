"""Identification of rigid bodies: payload, friction, drive inertias, gains and dead time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armcontour.control.identification.bodies.body_identification import (
    BodyIdentification,
    BodyJoint,
)
from armcontour.control.identification.bodies.body_model import (
    CENTER,
    JOINT_UNKNOWNS,
    LEAST_MASS,
    RobotUnknowns,
)
from armcontour.control.identification.bodies.log_grid import LogGrid
from armcontour.control.identification.bodies.output_error import (
    NONNEGATIVE,
    OutputError,
    check_fit,
    choose_model,
    estimate_bias,
    fit_determined,
    mask_moved,
)
from armcontour.control.identification.estimates import LOGARITHMIC, UNITS, Estimate
from armcontour.control.identification.fit_options import (
    GRAVITIES,
    BodyFit,
    choose_interpolation,
    dead_time_range,
    list_logs,
)
from armcontour.control.identification.servo_identification import changes_velocity
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ExecutionError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.motion.log import Log
from armcontour.motion.log_checks import arrange_joints, check_logs
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel

BODY_FIT = BodyFit()
# Initial gains if there is no nominal servo [1/s].
KP, KV = 25.0, 150.0
# Samples at the start of a log are not compared, because they depend on the initial state: number
# of time constants of the slowest position loop, and shortest time [s].
SETTLING, SETTLING_TIME = 10.0, 0.3
# Time step of the simulations that choose the gravity feed-forward [s].
COARSE_STEP = 5e-3


@checked
def identify_bodies(
    logs: Log | Sequence[Log],
    arm: Arm,
    servo: ServoModel | None = None,
    options: BodyFit = BODY_FIT,
    *,
    progress: Progress | None = None,
) -> BodyIdentification:
    """Identify payload, friction and drives of an arm with masses from logs.

    The model consists of the rigid bodies of the arm, a payload, viscous and Coulomb friction, and
    drives with the torques `J K_v (K_p (u(t - dead time) - q) - dq)` and gravity feed-forward.
    Parameters that the logs do not determine have their nominal values.

    >>> log = ac.Log(t=set_points.t, command=set_points.q, measured=set_points.q)
    >>> ac.identify_bodies(log, arm)
    Traceback (most recent call last):
        ...
    armcontour.core.errors.InvalidInput: the log covers 1.66 s, but identification needs ...

    Args:
        logs: A log of all joints of the arm, or several.
        arm: The nominal arm, with masses, payload, friction and drive inertias.
        servo: The nominal servo, of order "second". Its K_v is fixed and viscous friction is
            identified, because a log determines only the sum of J K_v and viscous friction. Without
            a servo, the viscous friction of the arm is fixed and K_v is identified.
        options: Options, such as `BodyFit(gravity="nominal")`.
        progress: Called with a step that names the stage, before each stage.

    Raises:
        InvalidInput: The sample interval of a log is too long, a log is too short, or the logs do
            not belong to the arm.
    """
    every = [arrange_joints(x, arm.joint_names) for x in list_logs(logs)]
    for log in every:
        log.check_gaps()
    report = subprogress(progress)
    interpolation = choose_interpolation(every, options.interpolation)
    guess = ServoModel(kp=KP, kv=KV) if servo is None else servo
    guess = guess.for_joints(arm.dof).replace(interpolation=interpolation)
    settled, lag = max(SETTLING / float(guess.kp.min()), SETTLING_TIME), options.drive_cycle / 2
    try:
        check_logs(every, arm)
        models = [
            RobotUnknowns(arm=arm, servo=guess, fixed_kv=servo is not None, gravity=x, lag=lag)
            for x in (GRAVITIES if options.gravity is None else [options.gravity])
        ]
        report(Step(("gravity",)))
        coarse = [LogGrid.from_log(x, interpolation, settled, step=COARSE_STEP) for x in every]
        model, near = choose_model(models, coarse)
        check_fit(coarse, near)
        report(Step(("fit",)))
        grids = [LogGrid.from_log(x, interpolation, settled) for x in every]
        fit, unconverged = fit_determined(model, grids, near.values)
        delays = dead_time_range(every, options.longest_dead_time)
        return _describe(model, grids, fit, unconverged, delays)
    except (ExecutionError, InvalidInput) as error:
        names = ", ".join(dict.fromkeys(x.source for x in every))
        positions = ((x.t - x.t[0], y) for x in every for y in (*x.command.T, *x.measured.T))
        if not any(changes_velocity(*x) for x in positions):
            raise InvalidInput(
                f"Every joint in {names} rests or moves at a uniform velocity, which determines no "
                "gains, dead time or inertias. Record a motion whose velocity changes, such as a "
                "multisine around the bandwidth of the position loops."
            ) from None
        if isinstance(error, InvalidInput):
            raise
        raise InvalidInput(f"The log does not fit the arm and its servo: {error}") from None


def _describe(
    model: RobotUnknowns,
    grids: list[LogGrid],
    fit: OutputError,
    unconverged: BoolArray,
    delays: tuple[float, float],
) -> BodyIdentification:
    """Make the result of the identification from a fit."""
    # unconverged: mask of unknowns in which the search did not converge. delays: range in which the
    # dead time is searched [s].
    explained, values = check_fit(grids, fit.trial), fit.trial.values
    common, *every = _list_estimates(model, grids, fit)
    # Logs determine only the sum of J K_v and viscous friction, so one of the two is nominal.
    tied, nominal = "kv", np.asarray(model.servo.kv)
    if not model.fixed_kv:
        tied, nominal = "viscous", np.asarray(model.arm.dynamics.chain.viscous)
    joints = []
    for j, name in enumerate(model.arm.joint_names):
        estimates = every[j] | {
            tied: Estimate(name=tied, unit=UNITS[tied], value=float(nominal[j]))
        }
        rests = []
        for grid, errors in zip(grids, fit.trial.residuals, strict=True):
            rests.append(np.full(len(grid.log.t), np.nan))
            rests[-1][grid.rows] = errors[:, j]
        joints.append(
            BodyJoint(
                name=name,
                parameters={x: estimates[x] for x in JOINT_UNKNOWNS if x in estimates},
                rms=float(fit.trial.scatter[j]),
                explained=float(explained[j]),
                rests=tuple(rests),
            )
        )
    arm, gains = make_robot(model, values)
    return BodyIdentification(
        logs=tuple(x.log for x in grids),
        interpolation=model.servo.interpolation,
        joints=tuple(joints),
        parameters=common,
        nominal=model.arm,
        gravity=model.gravity,
        arm=arm,
        notes=_list_notes(model, values, unconverged & mask_moved(model, grids), delays),
        gains=gains,
        gains_known=model.fixed_kv,
    )


def make_robot(model: RobotUnknowns, values: FloatArray) -> tuple[Arm, ServoModel]:
    """Arm and servo with the values of the unknowns."""
    # Negative viscous friction becomes 0 and reduces K_v instead, because only the sum of both has
    # an effect.
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


def _list_estimates(
    model: RobotUnknowns, grids: list[LogGrid], fit: OutputError
) -> list[dict[str, Estimate]]:
    """Estimates by name, first of the robot, then of each joint."""
    precision, doubt = fit.precision, estimate_bias(model, grids, fit)
    values, covariance = fit.trial.values, precision.covariance(fit.free)
    m = int(np.argmax(model.mask("payload_mass")))
    mass, centers = float(values[m]), dict(zip(CENTER, model.load.center.tolist(), strict=True))
    estimates: list[dict[str, Estimate]] = [{} for _ in range(1 + model.arm.dof)]
    for k, (name, j) in enumerate(zip(model.names.tolist(), model.joints.tolist(), strict=True)):
        value, free, bias = float(values[k]), bool(fit.free[k]), float(doubt[k])
        # row: derivatives of the estimate by the unknowns, (unknowns,).
        row = np.eye(len(values))[k]
        if name in CENTER:
            # The unknown is the mass times the deviation of the centre from its nominal position.
            free = free and mass > LEAST_MASS
            away = value / mass if free else 0.0
            value = centers[name] + away
            if free:
                row[m] = -away
                row, bias = row / mass, bias / mass
        elif name in LOGARITHMIC:
            value = math.exp(value)
        unit = "1" if name == "armature" and j < 0 else UNITS[name]
        one = Estimate(name=name, unit=unit, value=value)
        if free:
            sd = math.sqrt(max(float(row @ covariance @ row), 0.0))
            reach = precision.quantile * sd + bias
            ends = -min(reach, value) if name in NONNEGATIVE else -reach, reach
            sd = math.hypot(sd, bias)
            one = Estimate.from_interval(name, value, sd, ends, unit=unit, determined=True)
        estimates[1 + j][name] = one
    return estimates


def _list_notes(
    model: RobotUnknowns, values: FloatArray, unconverged: BoolArray, delays: tuple[float, float]
) -> tuple[str, ...]:
    """Sentences about convergence, dead time and negative friction."""
    notes = []
    if unconverged.any():
        names = [
            name.replace("_", " ") + (f" of joint {j + 1}" if j >= 0 else "")
            for name, j in zip(model.names[unconverged], model.joints[unconverged], strict=True)
        ]
        notes.append(f"The search did not converge for {', '.join(names)}.")
    if not delays[0] < float(values[-1]) < delays[1]:
        notes.append(
            f"The dead time is outside the search range of {delays[0] * 1e3:g} to "
            f"{delays[1] * 1e3:g} ms."
        )
    negative = np.flatnonzero(model.viscous(values) < 0) + 1
    if model.fixed_kv and len(negative):
        notes.append(
            f"The fitted viscous friction of joint {', '.join(map(str, negative))} is negative, so "
            "it is set to 0 and K_v is reduced instead."
        )
    return tuple(notes)
