"""Output error: the unknowns with which the simulated robot moves most like the real one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.drives.simulation import Simulation, simulate
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import LOGARITHMIC, SHIFT, Model

# A search ends when a step reduces the sum of squares by less than this share: 0.04 standard
# deviations of an unknown with 20,000 residuals.
NEAR = 1e-7
# Largest number of simulations of a search, and of searches with new weights of the joints.
MOST_SIMULATIONS, SEARCHES = 50, 3
# Weights of the joints are final if the scatter of no joint changes by more than this share.
SAME_SCATTER = 0.01
# Gains stay within this factor of where the search starts.
LARGEST_FACTOR = 8.0
# Residuals below this [rad] are rounding.
ROUNDING = 1e-9
# Unknowns that are never below zero.
POSITIVE = ("coulomb", "payload_mass", "armature")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """The simulated motion of every log, and its difference from the measured motion.

    Args:
        values: Values of the unknowns.
        motions: The simulated motions.
        residuals: Measured less simulated positions of every log [rad], (samples, dof) each.
    """

    values: FloatArray
    motions: tuple[Simulation, ...]
    residuals: tuple[FloatArray, ...]

    @property
    def scatter(self) -> FloatArray:
        """Root mean square of the residuals of each joint [rad], (dof,)."""
        every = np.concatenate(self.residuals)
        return np.asarray(np.maximum(np.sqrt(np.mean(every**2, axis=0)), ROUNDING))

    def cost(self, scatter: FloatArray) -> float:
        """Sum of the squared residuals in multiples of `scatter` [rad]."""
        return float(sum(np.sum((x / scatter) ** 2) for x in self.residuals))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyFit:
    """Unknowns with the smallest errors.

    Args:
        trial: The motion with these values.
        free: Unknowns that were sought; the others are nominal.
        jacobian: Derivatives of the simulated positions in multiples of `scatter`,
            (samples, dof, unknowns).
        residuals: Residuals in multiples of `scatter`, (samples, dof).
        scatter: Root mean square of the residuals of each joint [rad], (dof,).
        left: The next linear step of the unknowns, (unknowns,).
    """

    trial: Trial
    free: BoolArray
    jacobian: FloatArray
    residuals: FloatArray
    scatter: FloatArray
    left: FloatArray


def attempt(
    model: Model, grids: list[Gridded], values: FloatArray, before: Trial | None = None
) -> Trial:
    """Simulate all logs with some values of the unknowns.

    Args:
        model: The robot.
        grids: The logs.
        values: Values of the unknowns.
        before: A trial with similar values.

    Raises:
        ExecutionError: A joint runs away.
    """
    drives, delay = model.drives(values), float(values[-1])
    motions, residuals = [], []
    for k, x in enumerate(grids):
        motion = simulate(
            drives,
            x.command(delay + model.lag),
            x.t,
            x.near if before is None else before.motions[k].q,
            speed=x.speed,
            viscous=model.viscous(values),
            lag=model.lag,
        )
        motions.append(motion)
        residuals.append(x.measured - x.sampled(motion.q))
    return Trial(values=values, motions=tuple(motions), residuals=tuple(residuals))


def derivatives(model: Model, grids: list[Gridded], trial: Trial) -> FloatArray:
    """Derivatives of the positions by the unknowns at all samples, (samples, dof, unknowns)."""
    found = []
    for x, motion in zip(grids, trial.motions, strict=True):
        delay = float(trial.values[-1]) + model.lag
        early, late = (x.command(delay + s * SHIFT) for s in (-1, 1))
        lead, slope = (early + late) / 2 - motion.q, (early - late) / (2 * SHIFT)
        torque = model.torques(trial.values, motion, lead, slope)
        found.append(x.sampled(motion.to_torque(torque)))
    return np.concatenate(found)


def fit(
    model: Model, grids: list[Gridded], values: FloatArray, free: BoolArray, near: float = NEAR
) -> BodyFit:
    """Fit the unknowns by bounded least squares, each joint weighted by its scatter.

    Args:
        model: The robot.
        grids: The logs.
        values: Values from which the search starts.
        free: Unknowns that are sought, (unknowns,).
        near: Share of the sum of squares below which a reduction ends the search.

    Raises:
        ExecutionError: The robot cannot be simulated at the start.
    """
    from scipy.optimize import least_squares

    low = np.array([0.0 if x.name in POSITIVE else -np.inf for x in model.unknowns])
    gains = np.array([x.name in LOGARITHMIC for x in model.unknowns])
    low[gains] = values[gains] - np.log(LARGEST_FACTOR)
    high = np.where(gains, values + np.log(LARGEST_FACTOR), np.inf)
    trial, ends = attempt(model, grids, values), ~free
    scatter = trial.scatter

    def move(x: FloatArray) -> Trial:
        nonlocal trial
        if (x != trial.values[free]).any():
            values = trial.values.copy()
            values[free] = x
            trial = attempt(model, grids, values, trial)
        return trial

    def scaled_residuals(x: FloatArray) -> FloatArray:
        """Nan where the robot cannot be simulated."""
        try:
            left = move(x).residuals
        except (ExecutionError, InvalidInput):
            return np.full(sum(y.size for y in trial.residuals), np.nan)
        return np.asarray(-(np.concatenate(left) / scatter).ravel())

    def scaled_slopes(x: FloatArray) -> FloatArray:
        slopes = derivatives(model, grids, move(x)) / scatter[:, None]
        return slopes[:, :, free].reshape(-1, len(x))

    for _ in range(SEARCHES if free.any() else 0):
        found = least_squares(
            scaled_residuals, trial.values[free], scaled_slopes,
            bounds=(low[free], high[free]), method="trf", x_scale="jac",
            ftol=near, xtol=None, gtol=None, max_nfev=MOST_SIMULATIONS,
        )  # fmt: skip
        before, scatter, ends = scatter, move(found.x).scatter, ~free
        ends[free] = found.active_mask != 0
        if (np.abs(scatter / before - 1) < SAME_SCATTER).all():
            break
    jacobian = derivatives(model, grids, trial) / scatter[:, None]
    residuals, left = np.concatenate(trial.residuals) / scatter, np.zeros(len(free))
    a = jacobian[:, :, ~ends].reshape(residuals.size, -1)
    size = np.maximum(np.sqrt(np.sum(a**2, axis=0)), 1e-300)
    left[~ends] = np.linalg.lstsq(a / size, residuals.ravel(), rcond=1e-6)[0] / size
    return BodyFit(
        trial=trial, free=free, jacobian=jacobian, residuals=residuals, scatter=scatter, left=left
    )
