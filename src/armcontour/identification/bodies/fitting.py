"""Output error: the unknowns with which the simulated robot moves most like the real one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.drives.simulation import Simulation, simulate
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import LOGARITHMIC, SHIFT, Model

# The iteration ends when a step moves no unknown by more than this share of a standard deviation.
NEAR = 0.02
MOST_ITERATIONS = 50
# It gives up after this many steps in a row that gain less than this share of what they should: the
# response to small torques does not hold where a joint that rests would slip.
FUTILE_STEPS, FUTILE = 4, 0.05
# Damping by Levenberg and Marquardt: of the first step, next to none, so that steps are those of
# Gauss and Newton; its factors after a step that helps and after one that does not; its range.
FIRST_DAMPING, LOWER, RAISE = 1e-8, 100.0, 10.0
LEAST_DAMPING, MOST_DAMPING = 1e-12, 1e4
# A gain changes by no more than this factor in one step, and a payload by no more than this [kg].
LARGEST_FACTOR, LARGEST_MASS = 2.0, 5.0
# Residuals below this [rad] are rounding.
ROUNDING = 1e-9
LOWEST = {"coulomb": 0.0, "payload_mass": 0.0, "armature": 0.0}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trial:
    """The simulated motion of every log, and what it differs from the measured one.

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
        free: Which unknowns were sought; the others are nominal.
        jacobian: Derivatives of the simulated positions in multiples of `scatter`,
            (samples, dof, unknowns).
        residuals: Residuals in multiples of `scatter`, (samples, dof).
        scatter: Root mean square of the residuals of each joint [rad], (dof,).
        left: What a next step would add to the unknowns, if responses were linear, (unknowns,).
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


def expected_fit(
    model: Model, grids: list[Gridded], values: FloatArray, noise: FloatArray
) -> BodyFit:
    """The fit of all unknowns if they had some values, and there were only white noise.

    Args:
        model: The robot.
        grids: The logs.
        values: Values of the unknowns.
        noise: Standard deviation of each joint's encoder [rad], (dof,).

    Raises:
        ExecutionError: A joint runs away.
    """
    trial = attempt(model, grids, values)
    jacobian = derivatives(model, grids, trial) / noise[:, None]
    return BodyFit(
        trial=trial, free=np.ones(len(values), dtype=bool), jacobian=jacobian,
        residuals=np.zeros(jacobian.shape[:2]), scatter=noise, left=np.zeros(len(values)),
    )  # fmt: skip


def fit(
    model: Model,
    grids: list[Gridded],
    values: FloatArray,
    free: BoolArray,
    *,
    most: int = MOST_ITERATIONS,
) -> BodyFit:
    """Seek the unknowns by steps of Levenberg and Marquardt.

    Args:
        model: The robot.
        grids: The logs.
        values: Where the search starts.
        free: Which unknowns are sought, (unknowns,).
        most: Largest number of steps.

    Raises:
        ExecutionError: The robot cannot be simulated at the start.
    """
    trial, damping, futile = attempt(model, grids, values), FIRST_DAMPING, 0
    for k in range(most + 1):
        scatter = trial.scatter
        jacobian = derivatives(model, grids, trial) / scatter[:, None]
        residuals = np.concatenate(trial.residuals) / scatter
        normal = _Normal(model, trial.values, jacobian, residuals, free)
        found = BodyFit(
            trial=trial, free=free, jacobian=jacobian, residuals=residuals, scatter=scatter,
            left=normal.left,
        )  # fmt: skip
        if normal.size <= NEAR or k == most or futile == FUTILE_STEPS:
            return found
        better = _improve(model, grids, trial, normal, scatter, damping)
        if better is None:
            return found
        gain = trial.cost(scatter) - better[0].cost(scatter)
        futile = futile + 1 if gain < FUTILE * normal.gain else 0
        trial, damping = better
    return found


class _Normal:
    """Normal equations of a step, of unknowns that can move.

    Attributes:
        left: The step without damping, (unknowns,).
        size: Its size in standard deviations of white residuals.
        gain: What it would take off the cost, if responses were linear.
    """

    def __init__(
        self,
        model: Model,
        values: FloatArray,
        jacobian: FloatArray,
        residuals: FloatArray,
        free: BoolArray,
    ) -> None:
        a = jacobian.reshape(-1, jacobian.shape[-1])
        slope = a.T @ residuals.ravel()
        low = np.array([LOWEST.get(x.name, -np.inf) for x in model.unknowns])
        # What is at its end and would leave its range stays.
        self.moves = free & ~((values <= low) & (slope < 0))
        a = a[:, self.moves]
        self.scale = np.sqrt(np.sum(a**2, axis=0))
        self.scale[self.scale == 0] = 1.0
        self.matrix = (a.T @ a) / np.outer(self.scale, self.scale)
        self.slope = slope[self.moves] / self.scale
        self.most = np.array([_longest(x.name) for x in model.unknowns])
        inverse = np.linalg.pinv(self.matrix, rcond=1e-12, hermitian=True)
        sd = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
        step = inverse @ self.slope
        self.left = np.zeros(len(free))
        self.left[self.moves] = step / self.scale
        self.size = float(np.max(np.abs(step) / sd, initial=0.0))
        self.gain = float(self.slope @ step)

    def step(self, damping: float) -> FloatArray:
        """A step of all unknowns, (unknowns,)."""
        found = np.zeros(len(self.moves))
        damped = self.matrix + damping * np.eye(len(self.scale))
        found[self.moves] = np.linalg.lstsq(damped, self.slope, rcond=1e-12)[0] / self.scale
        return found / max(float(np.max(np.abs(found) / self.most, initial=0.0)), 1.0)


def _longest(name: str) -> float:
    """Longest step of an unknown."""
    if name in LOGARITHMIC:
        return float(np.log(LARGEST_FACTOR))
    return LARGEST_MASS if name == "payload_mass" else np.inf


def _improve(
    model: Model,
    grids: list[Gridded],
    trial: Trial,
    normal: _Normal,
    scatter: FloatArray,
    damping: float,
) -> tuple[Trial, float] | None:
    """A trial with smaller errors, and the next damping; None if there is none."""
    low = np.array([LOWEST.get(x.name, -np.inf) for x in model.unknowns])
    cost = trial.cost(scatter)
    while damping < MOST_DAMPING:
        values = np.maximum(trial.values + normal.step(damping), low)
        try:
            found = attempt(model, grids, values, trial)
        except (ExecutionError, InvalidInput):
            # It runs away, or a value is beyond all bounds.
            found = None
        if found is not None and found.cost(scatter) < cost:
            return found, max(damping / LOWER, LEAST_DAMPING)
        damping *= RAISE
    return None
