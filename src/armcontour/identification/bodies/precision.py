"""How well the unknowns are known, and which of them a log cannot tell."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray
from armcontour.identification.bodies.fitting import BodyFit
from armcontour.identification.bodies.grid import Gridded
from armcontour.identification.bodies.model import LEAST_MASS, LOGARITHMIC, SHIFT, Model
from armcontour.identification.correlation import WHITE, long_run, whiteness

# Standard deviations with which a log tells an unknown: a share of gains, viscous and Coulomb
# friction, payload mass and drive inertias,
SHARE = 0.10
# and if that is less, a share of a joint's damping and of its inertia, the friction that moves a
# joint by this angle [rad], a mass [kg], the payload's centre [m], a dead time [s].
OF_DAMPING = 0.10
ANGLE = 1e-4
MASS = 0.05
CENTER = 0.01
DELAY = 0.5e-3
# Of unknowns that only together are not told, a gain keeps its nominal value rather than a load or
# friction, if its standard deviation in multiples of what is allowed by this factor is the largest.
TRUSTED = 2.0
# A search that would go on by more than this share of a standard deviation has not come to rest.
REST = 0.5

OF_JOINTS = ("kp", "kv", "viscous", "coulomb", "armature")
# A joint that is told to move by less than this [rad] does not move.
MOVES = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Precision:
    """Standard deviations of the unknowns.

    Args:
        sd: Standard deviations, infinite for what is not sought, (unknowns,).
        quantile: Half of the width of a 95 % interval, in standard deviations.
        covariance: Covariance of all unknowns, 0 for what is not sought, (unknowns, unknowns).
    """

    sd: FloatArray
    quantile: float
    covariance: FloatArray

    def __post_init__(self) -> None:
        for name in ("sd", "covariance"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))


def precision(found: BodyFit, free: BoolArray, *, noise_only: bool = False) -> Precision:
    """The precision of a fit, if only some unknowns had been sought.

    Where residuals are not white, their correlation is taken into account, as for servos.

    Args:
        found: The fit.
        free: Unknowns that are sought, (unknowns,).
        noise_only: Whether the residuals will be white noise with the standard deviation `scatter`.
    """
    from scipy.special import stdtrit

    a = found.jacobian[:, :, free]
    scale = np.sqrt(np.sum(a**2, axis=(0, 1)))
    lost = scale <= 1e-9 * float(scale.max(initial=1e-300))
    size = np.where(lost, 1.0, scale)
    unit = a / size
    flat = unit.reshape(found.residuals.size, unit.shape[-1])
    values, vectors = np.linalg.eigh(flat.T @ flat)
    good = values > 1e-12 * values.max(initial=0.0)
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
    lost |= np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-6
    if noise_only:
        freedom, middle = found.residuals.size, inverse
    elif is_white(found.residuals):
        freedom = max(found.residuals.size - unit.shape[-1], 1)
        middle = inverse * float(np.sum(found.residuals**2)) / freedom
    else:
        scores = np.einsum("sjp,sj->ps", unit, found.residuals)
        total, freedom = long_run(scores, np.sum(unit**2, axis=(1, 2)), 0)
        middle = inverse @ total @ inverse
    part = middle / np.outer(size, size)
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = part
    sd = np.full(len(free), math.inf)
    sd[free] = np.where(lost, math.inf, np.sqrt(np.maximum(np.diag(part), 0.0)))
    return Precision(sd=sd, quantile=float(stdtrit(freedom, 0.975)), covariance=covariance)


def is_white(residuals: FloatArray) -> bool:
    """Whether the residuals of all joints are noise alone, as far as one can see."""
    least = min(whiteness(np.ascontiguousarray(x)) for x in residuals.T)
    return bool(least >= WHITE / residuals.shape[1])


def allowed(model: Model, values: FloatArray) -> FloatArray:
    """Standard deviations with which each unknown counts as told, (unknowns,)."""
    drives = model.drives(values)
    mass = float(model.value(values, "payload_mass")[0])
    found = []
    for x, value in zip(model.unknowns, values.tolist(), strict=True):
        share, least = SHARE * abs(value), 0.0
        if x.name in LOGARITHMIC or (x.name == "armature" and x.index < 0):
            share = SHARE
        elif x.name == "armature":
            least = OF_DAMPING * float(drives.inertia[x.index])
        elif x.name == "viscous":
            least = OF_DAMPING * float(drives.damping[x.index])
        elif x.name == "coulomb":
            least = ANGLE * float(drives.stiffness[x.index])
        elif x.name == "payload_mass":
            least = MASS
        elif x.name == "payload_center":
            share, least = 0.0, CENTER * mass
        elif x.name == "dead_time":
            least = DELAY
        found.append(max(share, least))
    return np.array(found)


def reachable(model: Model, values: FloatArray) -> FloatArray:
    """What would be told of unknowns whose values are not known yet, such as a load of 1 kg."""
    bold = np.array(values)
    for k, x in enumerate(model.unknowns):
        if x.name == "payload_mass":
            bold[k] = max(bold[k], 1.0)
    found = allowed(model, bold)
    logarithmic = np.array([x.name in LOGARITHMIC for x in model.unknowns])
    return np.where(logarithmic, found, 2 * found)


def moved(model: Model, grids: list[Gridded]) -> BoolArray:
    """Unknowns but for those of joints that no log moves, (unknowns,).

    A joint that only others shake shows that friction holds it, but not how strong friction is.
    """
    ranges = np.max([np.ptp(x.log.command, axis=0) for x in grids], axis=0)
    own = [x.index if x.name in OF_JOINTS else -1 for x in model.unknowns]
    return np.array([j < 0 or ranges[j] > MOVES for j in own])


def told(
    model: Model,
    found: BodyFit,
    free: BoolArray,
    limit: FloatArray,
    *,
    noise_only: bool = False,
) -> BoolArray:
    """Which of the unknowns a log tells; the least known is left out until all others are known.

    Args:
        model: The robot.
        found: A fit.
        free: Unknowns that are sought, (unknowns,).
        limit: Largest standard deviations, (unknowns,).
        noise_only: As in `precision`.
    """
    free = free.copy()
    while free.any():
        sd = precision(found, free, noise_only=noise_only).sd
        with np.errstate(invalid="ignore", divide="ignore"):
            worse = np.where(free, sd / limit, 0.0)
        worse[np.isnan(worse)] = math.inf
        if worse.max() <= 1.0:
            break
        free[worst(model, worse)] = False
        free &= with_mass(model, free)
    return free


def also_told(
    model: Model, found: BodyFit, free: BoolArray, some: BoolArray, limit: FloatArray
) -> BoolArray:
    """What a log tells, and what else it tells beside that.

    Args:
        model: The robot.
        found: A fit.
        free: Unknowns that are told, (unknowns,).
        some: Unknowns that may be sought, too, (unknowns,).
        limit: Largest standard deviations, (unknowns,).
    """
    for k in np.flatnonzero(some & ~free):
        more = free | (np.arange(len(free)) == k)
        more &= with_mass(model, more)
        if (precision(found, more).sd[more] <= limit[more]).all():
            free = more
    return free


def worst(model: Model, worse: FloatArray) -> int:
    """The unknown that should keep its nominal value.

    Args:
        model: The robot.
        worse: How much worse than allowed each unknown is known, (unknowns,).
    """
    gains = np.array([x.name in LOGARITHMIC for x in model.unknowns])
    return int(np.argmax(np.where(gains, TRUSTED * worse, worse)))


def with_mass(model: Model, free: BoolArray) -> BoolArray:
    """Unknowns but for the centre of a payload whose mass is neither sought nor nominal."""
    names = [x.name for x in model.unknowns]
    mass = free[names.index("payload_mass")] or model.load.mass > LEAST_MASS
    return np.array([bool(mass) or x != "payload_center" for x in names])


def unsettled(found: BodyFit) -> FloatArray:
    """How far from rest the search of a fit ended: above 1 for an unknown that still moves.

    Returns:
        What a next step would add, in multiples of what may be left, (unknowns,).
    """
    sd = precision(found, found.free).sd
    return np.asarray(np.where(found.free, np.abs(found.left) / (REST * sd), 0.0))


def doubts(model: Model, grids: list[Gridded], found: BodyFit, free: BoolArray) -> FloatArray:
    """Bias of the unknowns, to first order, due to two assumptions of the model.

    It is the change of the estimates if commands had their bends between the samples instead of at
    them, or held set-points came an interval sooner, and if the drives' cycle were half as long
    again. Without it, 95 % intervals contained the truth in 60 to 80 % of the cases.

    Args:
        model: The robot.
        grids: The logs.
        found: The fit.
        free: Unknowns that are sought, (unknowns,).
    """
    drives = model.drives(found.trial.values)
    delay = float(found.trial.values[-1]) + model.lag
    moved = []
    for x, motion in zip(grids, found.trial.motions, strict=True):
        command = x.command(delay)
        sooner = x.command(delay - x.log.interval) if x.held else x.bent_command(delay)
        rate = (x.command(delay - SHIFT) - x.command(delay + SHIFT)) / (2 * SHIFT)
        late = drives.stiffness * (motion.dq - rate) + drives.damping * motion.ddq
        torque = np.stack([drives.stiffness * (sooner - command), model.lag / 2 * late], axis=-1)
        moved.append(x.sampled(motion.to_torque(torque)))
    change = np.concatenate(moved) / found.scatter[:, None]
    shift = np.zeros(len(free))
    if free.any():
        a = found.jacobian[:, :, free].reshape(-1, int(free.sum()))
        both = np.linalg.lstsq(a, change.reshape(-1, 2), rcond=None)[0]
        shift[free] = np.abs(both).sum(axis=1)
    return shift
