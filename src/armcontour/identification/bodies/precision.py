"""Standard deviations of the unknowns, and which unknowns logs determine."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.identification.bodies.fitting import BodyFit, attempt, derivatives
from armcontour.identification.bodies.grid import Gridded, noise_of
from armcontour.identification.bodies.model import LEAST_MASS, LOGARITHMIC, SHIFT, Model

# Standard deviations up to which an unknown is determined: this share of a gain, a friction, the
# payload mass or a drive inertia,
SHARE = 0.10
# or, if that is more, this share of a joint's damping and of its inertia, the friction that moves a
# joint by this angle [rad], a mass [kg], the payload's centre [m], a dead time [s].
OF_DAMPING = 0.10
ANGLE = 1e-4
MASS = 0.05
CENTER = 0.01
DELAY = 0.5e-3
# Of unknowns that are only determined together, a gain keeps its nominal value rather than a load
# or friction, if its standard deviation over the allowed one is the largest after this factor.
TRUSTED = 2.0
# Lowest lines of the spectrum of the scores, and samples for each line (Müller, Econometrica 2007).
LINES, PER_LINE = 24, 4
OF_JOINTS = ("kp", "kv", "viscous", "coulomb", "armature")
# A joint whose command moves by less than this [rad] does not move.
MOVES = 1e-3


class Precision(NamedTuple):
    """Information of the logs about the unknowns, in units in which each has the information 1.

    Args:
        information: Products of the scaled derivatives, (unknowns, unknowns).
        scores: Covariance of derivatives times residuals, (unknowns, unknowns).
        size: Units, (unknowns,).
        freedom: Degrees of freedom of the covariance.
    """

    information: FloatArray
    scores: FloatArray
    size: FloatArray
    freedom: int = 0

    @classmethod
    def of(cls, jacobian: FloatArray, residuals: FloatArray | None = None) -> Precision:
        """The precision of a fit with scaled residuals; white noise of size 1 by default.

        The residuals may be correlated: the covariance of the sum of the scores is that of the
        lowest lines of their spectrum.

        Args:
            jacobian: Scaled derivatives, (samples, dof, unknowns).
            residuals: Scaled residuals, (samples, dof).
        """
        size = np.maximum(np.sqrt(np.sum(jacobian**2, axis=(0, 1))), 1e-300)
        unit = jacobian / size
        flat = unit.reshape(-1, len(size))
        information = flat.T @ flat
        if residuals is None:
            return cls(information, information, size)
        # Samples without information take no time.
        weights = np.sum(unit**2, axis=(1, 2))
        clock = (np.cumsum(weights) - weights / 2) / max(float(np.sum(weights)), 1e-300)
        lines = max(min(LINES, len(clock) // PER_LINE), 2)
        waves = np.sqrt(2) * np.cos(np.pi * np.outer(clock, np.arange(1, lines + 1)))
        found = np.einsum("sjp,sj->ps", unit, residuals) @ waves
        return cls(information, found @ found.T / lines, size, lines)

    @property
    def quantile(self) -> float:
        """Half of the width of a 95 % interval, in standard deviations."""
        from scipy.special import stdtrit

        return float(stdtrit(self.freedom, 0.975))

    def covariance(self, free: BoolArray) -> FloatArray:
        """Covariance if only some unknowns are sought, 0 for the others, (unknowns, unknowns)."""
        values, vectors = np.linalg.eigh(self.information[np.ix_(free, free)])
        good = values > 1e-12 * values.max(initial=0.0)
        inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T
        part = inverse @ self.scores[np.ix_(free, free)] @ inverse
        lost = np.sum(vectors[:, ~good] ** 2, axis=1) > 1e-6
        part[lost, lost] = math.inf
        found = np.zeros_like(self.information)
        found[np.ix_(free, free)] = part / np.outer(self.size[free], self.size[free])
        return found

    def sd(self, free: BoolArray) -> FloatArray:
        """Standard deviations if only some unknowns are sought, (unknowns,)."""
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance(free)), 0.0)))


def allowed(model: Model, values: FloatArray) -> FloatArray:
    """Standard deviations up to which each unknown is determined, (unknowns,)."""
    drives = model.drives(values)
    mass = float(model.value(values, "payload_mass")[0])
    found = []
    for x, value in zip(model.unknowns, values.tolist(), strict=True):
        j, share = x.index, SHARE * abs(value)
        if x.name in LOGARITHMIC or (x.name == "armature" and j < 0):
            share = SHARE
        elif x.name == "payload_center":
            share = CENTER * mass
        else:
            least = {
                "armature": OF_DAMPING * float(drives.inertia[j]),
                "viscous": OF_DAMPING * float(drives.damping[j]),
                "coulomb": ANGLE * float(drives.stiffness[j]),
                "payload_mass": MASS,
                "dead_time": DELAY,
            }
            share = max(share, least[x.name])
        found.append(share)
    return np.array(found)


def moved(model: Model, grids: list[Gridded]) -> BoolArray:
    """Unknowns except those of joints that no log moves, (unknowns,).

    A joint that only others shake shows that friction holds it, but not how strong friction is.
    """
    ranges = np.max([np.ptp(x.log.command, axis=0) for x in grids], axis=0)
    own = [x.index if x.name in OF_JOINTS else -1 for x in model.unknowns]
    return np.array([j < 0 or ranges[j] > MOVES for j in own])


def seen(model: Model, grids: list[Gridded], values: FloatArray) -> BoolArray:
    """Unknowns that the logs would determine if there were only the noise of the encoders.

    Args:
        model: The robot.
        grids: The logs.
        values: Values of the unknowns; they may be far from the true ones.

    Raises:
        ExecutionError: A joint runs away.
    """
    jacobian = derivatives(model, grids, attempt(model, grids, values))
    known = Precision.of(jacobian / noise_of(grids)[:, None])
    # A load that is not known yet counts as 1 kg.
    bold = np.array(values)
    mass = [x.name == "payload_mass" for x in model.unknowns]
    bold[mass] = np.maximum(bold[mass], 1.0)
    logarithmic = np.array([x.name in LOGARITHMIC for x in model.unknowns])
    limit = allowed(model, bold) * np.where(logarithmic, 1.0, 2.0)
    return determined(model, known, moved(model, grids), limit)


def determined(model: Model, known: Precision, free: BoolArray, limit: FloatArray) -> BoolArray:
    """Unknowns that logs determine; the worst becomes nominal until all others are determined.

    Args:
        model: The robot.
        known: The precision of a fit.
        free: Unknowns that are sought, (unknowns,).
        limit: Largest standard deviations, (unknowns,).
    """
    free = free.copy()
    trust = [TRUSTED if x.name in LOGARITHMIC else 1.0 for x in model.unknowns]
    while free.any():
        with np.errstate(invalid="ignore", divide="ignore"):
            worse = np.where(free, known.sd(free) / limit, 0.0)
        worse[np.isnan(worse)] = math.inf
        if worse.max() <= 1.0:
            break
        free[np.argmax(trust * worse)] = False
        free &= with_mass(model, free)
    return free


def with_mass(model: Model, free: BoolArray) -> BoolArray:
    """Unknowns but for the centre of a payload whose mass is neither sought nor nominal."""
    names = [x.name for x in model.unknowns]
    mass = free[names.index("payload_mass")] or model.load.mass > LEAST_MASS
    return np.array([bool(mass) or x != "payload_center" for x in names])


def doubts(model: Model, grids: list[Gridded], found: BodyFit) -> FloatArray:
    """Bias of the unknowns, to first order, due to two assumptions of the model, (unknowns,).

    It is the change of the estimates if commands had their bends between the samples instead of at
    them, or held set-points came an interval sooner, and if the drives' cycle were half as long
    again. Without it, 95 % intervals contained the truth in 60 to 80 % of the cases.
    """
    drives = model.drives(found.trial.values)
    delay = float(found.trial.values[-1]) + model.lag
    changes = []
    for x, motion in zip(grids, found.trial.motions, strict=True):
        command = x.command(delay)
        sooner = x.command(delay - x.log.interval) if x.held else x.bent_command(delay)
        rate = (x.command(delay - SHIFT) - x.command(delay + SHIFT)) / (2 * SHIFT)
        late = drives.stiffness * (motion.dq - rate) + drives.damping * motion.ddq
        torque = np.stack([drives.stiffness * (sooner - command), model.lag / 2 * late], axis=-1)
        changes.append(x.sampled(motion.to_torque(torque)))
    change = np.concatenate(changes) / found.scatter[:, None]
    shift = np.zeros(len(found.free))
    if found.free.any():
        a = found.jacobian[:, :, found.free].reshape(found.residuals.size, -1)
        both = np.linalg.lstsq(a, change.reshape(len(a), 2), rcond=None)[0]
        shift[found.free] = np.abs(both).sum(axis=1)
    return shift
