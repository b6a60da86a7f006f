"""Output-error method: fits the simulated motion to the measured motion of the logs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.control.identification.bodies.body_model import (
    CENTER,
    DELAY_STEP,
    LEAST_MASS,
    RobotUnknowns,
)
from armcontour.control.identification.bodies.log_grid import LogGrid, largest_noise
from armcontour.control.identification.estimates import LOGARITHMIC
from armcontour.control.identification.least_squares import (
    Precision,
    allowed_deviation,
    normalize,
    solve,
)
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import ExecutionError, InvalidInput
from armcontour.core.sampling import interpolate
from armcontour.robot.drives.response import NominalMotion, simulate

# A search ends when an iteration reduces the sum of squares by less than this share. For 20,000
# residuals, this is an error of 0.04 standard deviations of an unknown.
LEAST_REDUCTION = 1e-7
# Largest number of simulations of a search, and largest number of searches, each with new weights
# of the joints.
MAX_SIMULATIONS, MAX_SEARCHES = 50, 3
# The weights of the joints are final if the RMS residual of every joint changes by less than this
# share.
SCATTER_CHANGE = 0.01
# Bounds of the gains in a search, as a factor of their initial values.
LARGEST_FACTOR = 8.0
# Lower bound of the RMS residual of a joint, because smaller residuals are rounding errors [rad].
ROUNDING = 1e-9
# Unknowns with the lower bound 0.
NONNEGATIVE = ("coulomb", "payload_mass", "armature")
# An unknown is determined if its standard deviation is at most one of the following values, however
# small the unknown is. For viscous friction and drive inertia: share of a joint's damping and
# inertia.
DAMPING_SHARE = 0.10
# For Coulomb friction: the torque that deflects the position loop of the joint by this angle [rad].
FRICTION_ANGLE = 1e-4
MASS_SD = 0.05  # For the mass of the payload [kg]
CENTER_SD = 0.01  # For the centre of the payload [m]
DELAY_SD = 0.5e-3  # For the dead time [s]
# If only a combination of unknowns is determined, the unknown with the largest ratio of standard
# deviation to tolerance becomes nominal. Ratios of gains are multiplied by this factor, because
# nominal gains are more reliable than a nominal load or nominal friction.
GAIN_TRUST = 2.0
# Another gravity feed-forward is chosen only if it reduces the cost by this share. If the nominal
# arm has the true load, "nominal" and "loaded" fit equally well.
LEAST_GAIN = 0.05
# Residuals below this multiple of the encoder noise count as noise.
NOISE_MULTIPLE = 2.0
# A search has converged in an unknown if the next step of the unknown is at most this share of its
# standard deviation. Otherwise the unknown becomes nominal.
MAX_NEXT_STEP = 0.5
# Smallest share of the squared tracking error of each joint that a model must explain. If a log has
# two joints exchanged, the model explains at most this share for one of them.
LEAST_EXPLAINED = 0.99
# Replaces LEAST_REDUCTION in the search for the gravity feed-forward.
COARSE_REDUCTION = 1e-3
# A joint does not move if its command spans at most this angle [rad].
LEAST_MOTION = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SimulatedLogs:
    """Simulated motions of all logs for values of the unknowns, and their residuals."""

    values: FloatArray  # Values of the unknowns
    motions: tuple[NominalMotion, ...]  # Simulated motion of every log
    # Measured less simulated positions of every log [rad], (samples, dof) each.
    residuals: tuple[FloatArray, ...]

    @property
    def scatter(self) -> FloatArray:
        """RMS residual of each joint over all logs [rad], at least ROUNDING, (dof,)."""
        every = np.concatenate(self.residuals)
        return np.asarray(np.maximum(np.sqrt(np.mean(every**2, axis=0)), ROUNDING))

    def cost(self, scatter: FloatArray) -> float:
        """Sum of the squares of the residuals divided by `scatter` [rad], (dof,)."""
        return float(sum(np.sum((x / scatter) ** 2) for x in self.residuals))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class OutputError:
    """Result of a fit: values of the unknowns with the smallest weighted residuals."""

    trial: SimulatedLogs  # The simulated motions for the fitted values
    free: BoolArray  # Mask of the fitted unknowns; the others have nominal values, (unknowns,)
    # jacobian: derivatives of the simulated positions by the unknowns, divided by `scatter`,
    # (samples, dof, unknowns).
    jacobian: FloatArray
    residuals: FloatArray  # Residuals of all logs, divided by `scatter`, (samples, dof)
    scatter: FloatArray  # RMS residual of each joint [rad], (dof,)
    remaining: FloatArray  # Next linear step of each unknown, 0 at a bound, (unknowns,)

    @property
    def precision(self) -> Precision:
        """Fisher information about the unknowns, for correlated residuals."""
        return Precision.correlated(self.jacobian, self.residuals)


def simulate_logs(
    model: RobotUnknowns,
    grids: list[LogGrid],
    values: FloatArray,
    before: SimulatedLogs | None = None,
) -> SimulatedLogs:
    """Simulate all logs with some values of the unknowns; starts from the motions `before`."""
    drives, delay = model.drives(values), float(values[-1])
    motions, residuals = [], []
    for k, grid in enumerate(grids):
        motion = simulate(
            drives,
            grid.command(delay + model.lag),
            grid.t,
            grid.smoothed if before is None else before.motions[k].q,
            speed=grid.speed,
            viscous=model.viscous(values),
            lag=model.lag,
        )
        motions.append(motion)
        residuals.append(grid.measured - grid.sampled(motion.q))
    return SimulatedLogs(values=values, motions=tuple(motions), residuals=tuple(residuals))


def position_derivatives(
    model: RobotUnknowns, grids: list[LogGrid], trial: SimulatedLogs
) -> FloatArray:
    """Derivatives of the simulated positions by the unknowns, (samples, dof, unknowns)."""
    parts = []
    for grid, motion in zip(grids, trial.motions, strict=True):
        delay = float(trial.values[-1]) + model.lag
        early, later = (grid.command(delay + s * DELAY_STEP) for s in (-1, 1))
        lead, slope = (early + later) / 2 - motion.q, (early - later) / (2 * DELAY_STEP)
        torque = model.torques(trial.values, motion, lead, slope)
        parts.append(grid.sampled(motion.to_torque(torque)))
    return np.concatenate(parts)


def fit(
    model: RobotUnknowns,
    grids: list[LogGrid],
    values: FloatArray,
    free: BoolArray,
    near: float = LEAST_REDUCTION,
) -> OutputError:
    """Fit the free unknowns by bounded least squares, with joints weighted by 1 / RMS residual."""
    # The search ends when an iteration reduces the sum of squares by less than the share `near`.
    gains = model.mask(*LOGARITHMIC)
    lowest = np.where(model.mask(*NONNEGATIVE), 0.0, -np.inf)
    low = np.where(gains, values - np.log(LARGEST_FACTOR), lowest)
    high = np.where(gains, values + np.log(LARGEST_FACTOR), np.inf)
    trial, ends = simulate_logs(model, grids, values), ~free
    scatter = trial.scatter

    def move(unknowns: FloatArray) -> SimulatedLogs:
        nonlocal trial
        if (unknowns != trial.values[free]).any():
            values = trial.values.copy()
            values[free] = unknowns
            trial = simulate_logs(model, grids, values, trial)
        return trial

    def residuals(unknowns: FloatArray) -> FloatArray:
        """Simulated less measured positions, weighted; nan if the robot cannot be simulated."""
        try:
            errors = move(unknowns).residuals
        except (ExecutionError, InvalidInput):
            return np.array([np.nan])
        return np.asarray(-(np.concatenate(errors) / scatter).ravel())

    def slopes(unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
        columns = position_derivatives(model, grids, move(unknowns)) / scatter[:, None]
        return residuals(unknowns), columns[:, :, free].reshape(-1, len(unknowns))

    for _ in range(MAX_SEARCHES if free.any() else 0):
        bounds = low[free], high[free]
        solution = solve(residuals, slopes, trial.values[free], bounds, MAX_SIMULATIONS, near)
        before, scatter, ends = scatter, move(solution.x).scatter, ~free
        ends[free] = solution.active_mask != 0
        if (np.abs(scatter / before - 1) < SCATTER_CHANGE).all():
            break
    jacobian = position_derivatives(model, grids, trial) / scatter[:, None]
    errors, remaining = np.concatenate(trial.residuals) / scatter, np.zeros(len(free))
    columns, size = normalize(jacobian[:, :, ~ends].reshape(errors.size, -1))
    remaining[~ends] = np.linalg.lstsq(columns, errors.ravel(), rcond=1e-6)[0] / size
    return OutputError(
        trial=trial,
        free=free,
        jacobian=jacobian,
        residuals=errors,
        scatter=scatter,
        remaining=remaining,
    )


def allowed_deviations(model: RobotUnknowns, values: FloatArray) -> FloatArray:
    """Largest standard deviation with which each unknown is determined, (unknowns,)."""
    drives, mass = model.drives(values), float(model.value(values, "payload_mass")[0])
    j = model.joints
    also: dict[str, Any] = {
        "armature": DAMPING_SHARE * drives.inertia[j] * (j >= 0),
        "viscous": DAMPING_SHARE * drives.damping[j],
        "coulomb": FRICTION_ANGLE * drives.stiffness[j],
        "payload_mass": MASS_SD,
        "dead_time": DELAY_SD,
    }
    smallest = np.select([model.mask(x) for x in also], list(also.values()))
    deviations = allowed_deviation(np.where(model.relative, 1.0, values), smallest)
    return np.where(model.mask(*CENTER), CENTER_SD * mass, deviations)


def mask_moved(model: RobotUnknowns, grids: list[LogGrid]) -> BoolArray:
    """Mask of the unknowns of the whole robot and of the joints that a log moves, (unknowns,)."""
    # Joints that are not commanded to move are excluded. Their response to other joints shows that
    # friction holds them, but not the magnitude of this friction.
    ranges = np.max([np.ptp(x.log.command, axis=0) for x in grids], axis=0)
    return np.asarray((model.joints < 0) | (ranges > LEAST_MOTION)[model.joints])


def mask_observable(model: RobotUnknowns, grids: list[LogGrid], values: FloatArray) -> BoolArray:
    """Mask of unknowns that the logs determine if errors are encoder noise only, (unknowns,)."""
    jacobian = position_derivatives(model, grids, simulate_logs(model, grids, values))
    scaled = jacobian / largest_noise(grids)[:, None]
    precision = Precision.from_jacobian(scaled.reshape(-1, len(values)))
    # A payload below 1 kg counts as 1 kg, because the payload is not known yet.
    bold = np.where(model.mask("payload_mass"), np.maximum(values, 1.0), values)
    limit = allowed_deviations(model, bold) * np.where(model.mask(*LOGARITHMIC), 1.0, 2.0)
    return mask_determined(model, precision, mask_moved(model, grids), limit)


def mask_determined(
    model: RobotUnknowns, precision: Precision, free: BoolArray, limit: FloatArray
) -> BoolArray:
    """Mask of free unknowns that are determined if all other unknowns are nominal, (unknowns,)."""
    # The least determined unknown becomes nominal until the standard deviations of all others are
    # at most `limit`, (unknowns,).
    free = free.copy()
    trust = np.where(model.mask(*LOGARITHMIC), GAIN_TRUST, 1.0)
    while free.any():
        with np.errstate(invalid="ignore", divide="ignore"):
            worse = np.where(free, precision.sd(free) / limit, 0.0)
        worse[np.isnan(worse)] = math.inf
        if worse.max() <= 1.0:
            break
        free[np.argmax(trust * worse)] = False
        free &= mask_defined(model, free)
    return free


def mask_defined(model: RobotUnknowns, free: BoolArray) -> BoolArray:
    """Mask of defined unknowns: the payload's centre requires a fitted or nominal payload mass."""
    has_mass = free[model.mask("payload_mass")] | (model.load.mass > LEAST_MASS)
    return ~model.mask(*CENTER) | has_mass


def estimate_bias(model: RobotUnknowns, grids: list[LogGrid], fit: OutputError) -> FloatArray:
    """Magnitude of the bias of the unknowns due to two assumptions, to first order, (unknowns,)."""
    # The first part is the change of the estimates if interpolated commands have their corners
    # midway between the samples instead of at the samples, or if held set-points come one interval
    # earlier. The second part is the change if the drive cycle is longer by half. If this bias is
    # not added, 95 % intervals contain the true value in only 60 to 80 % of the cases.
    drives = model.drives(fit.trial.values)
    delay = float(fit.trial.values[-1]) + model.lag
    changes = []
    for grid, motion in zip(grids, fit.trial.motions, strict=True):
        command = grid.command(delay)
        sooner = (
            grid.command(delay - grid.log.interval)
            if grid.held
            else grid.shifted_corner_command(delay)
        )
        rate = (grid.command(delay - DELAY_STEP) - grid.command(delay + DELAY_STEP)) / (
            2 * DELAY_STEP
        )
        delayed = drives.stiffness * (motion.dq - rate) + drives.damping * motion.ddq
        torque = np.stack([drives.stiffness * (sooner - command), model.lag / 2 * delayed], axis=-1)
        changes.append(grid.sampled(motion.to_torque(torque)))
    change = np.concatenate(changes) / fit.scatter[:, None]
    shift = np.zeros(len(fit.free))
    if fit.free.any():
        a = fit.jacobian[:, :, fit.free].reshape(fit.residuals.size, -1)
        both = np.linalg.lstsq(a, change.reshape(len(a), 2), rcond=None)[0]
        shift[fit.free] = np.abs(both).sum(axis=1)
    return shift


def choose_model(
    models: list[RobotUnknowns], grids: list[LogGrid]
) -> tuple[RobotUnknowns, SimulatedLogs]:
    """Model whose gravity feed-forward has the smallest residuals, and its simulated motions."""
    best, failure = None, ExecutionError("it cannot be simulated.")
    for model in models:
        start = np.array(model.nominal)
        try:
            trial = fit(
                model, grids, start, mask_observable(model, grids, start), COARSE_REDUCTION
            ).trial
        except ExecutionError as error:
            failure = error
            continue
        if (trial.scatter < NOISE_MULTIPLE * largest_noise(grids)).all():
            return model, trial
        scatter = trial.scatter if best is None else best[1].scatter
        if best is None or trial.cost(scatter) < (1 - LEAST_GAIN) * best[1].cost(scatter):
            best = model, trial
    if best is None:
        raise failure
    return best


def fit_determined(
    model: RobotUnknowns, grids: list[LogGrid], values: FloatArray
) -> tuple[OutputError, BoolArray]:
    """Fit of the determined unknowns, and mask of the unknowns in which it did not converge."""
    # All other unknowns become nominal.
    free, unconverged = mask_observable(model, grids, values), np.zeros(len(values), dtype=bool)
    while True:
        result = fit(model, grids, np.where(free, values, model.nominal), free)
        values = result.trial.values
        precision = result.precision
        accepted = mask_determined(model, precision, free, allowed_deviations(model, values))
        if (accepted == free).all():
            sd = np.maximum(precision.sd(free), 1e-300)
            accepted = free & ~(np.abs(result.remaining) > MAX_NEXT_STEP * sd)
            unconverged |= free & ~accepted
            if (accepted == free).all():
                return result, unconverged
        free = accepted & mask_defined(model, accepted)


def check_fit(grids: list[LogGrid], trial: SimulatedLogs) -> FloatArray:
    """Share of the squared tracking error that the model explains, (dof,); error if too small."""
    errors = np.zeros(grids[0].log.dof)
    lags, ranges = 0 * errors, 0 * errors
    for grid, residuals in zip(grids, trial.residuals, strict=True):
        # The noise of the encoders is subtracted, because the model cannot explain it.
        errors += np.sum(residuals**2, axis=0) - len(residuals) * grid.noise**2
        lags += np.sum(
            (interpolate(grid.log.t[grid.rows], grid.log.t, grid.log.command) - grid.measured) ** 2,
            0,
        )
        ranges = np.maximum(ranges, np.ptp(grid.log.command, axis=0))
    explained = np.asarray(1 - np.maximum(errors, 0.0) / np.maximum(lags, 1e-300))
    poor = (ranges > LEAST_MOTION) & (explained < LEAST_EXPLAINED)
    if poor.any():
        j = int(np.argmin(np.where(poor, explained, np.inf)))
        log = grids[0].log
        raise InvalidInput(
            f"{log.source}: the model must explain at least {LEAST_EXPLAINED:.0%} of the squared "
            f"tracking error of {log.joint_names[j]}, but explains "
            f"{max(float(explained[j]), 0.0) * 100:.0f} %. Specify a log of this arm, with the "
            "joints in the order of the arm.",
            joint=j,
        )
    return explained
