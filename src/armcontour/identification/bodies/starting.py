"""Where the search starts: the lag of every joint behind its smoothed command."""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.identification.bodies.grid import CUT, Gridded, filtered
from armcontour.identification.bodies.model import LOGARITHMIC, Model

# Dead times that are tried are this far apart [s].
APART = 4e-3
# Smoothing spoils this much of both ends [s].
EDGE = 0.5
# Lags of a joint [s]: outside, the nominal one is taken.
LAGS = (2e-3, 1.0)
# A joint that moves less than this [rad] does not move.
MOVES = 1e-3
# Friction that starts above this share of what moves a joint would hold it.
MOST_FRICTION = 0.5
# K_v starts within these multiples of K_p.
RATIOS = (2.0, 20.0)


def start(model: Model, grids: list[Gridded], delays: tuple[float, float]) -> FloatArray:
    """First values of the unknowns, (unknowns,).

    Of every joint, `u(t - dead time) - q = a T + b dq + c sign(dq) + d` is solved by least squares.
    T is the torque that the nominal arm needs, so a is one by the stiffness of its loops, b the
    time by which they lag, and c friction by stiffness. The load stays nominal.

    Args:
        model: What is sought.
        grids: The logs.
        delays: Smallest and largest dead time [s].
    """
    parts = [_Part(model, x) for x in grids]
    tried = np.arange(delays[0], delays[1] + APART / 2, APART)
    fits = [_solve(parts, float(x)) for x in tried]
    best = int(np.argmin([x[1] for x in fits]))
    lead = np.concatenate([x.lead(float(tried[best])) for x in parts])
    moves = np.ptp(np.concatenate([x.q for x in parts]), axis=0) > MOVES
    values = _values(model, fits[best][0], moves, MOST_FRICTION * np.abs(lead).max(axis=0))
    values[-1] = tried[best]
    return values


class _Part:
    """The smoothed motion of a log, and the torque that the nominal arm needs for it."""

    def __init__(self, model: Model, grid: Gridded) -> None:
        q, step = grid.near, grid.step
        edge = min(int(EDGE / step), len(q) // 4)
        self.rows = slice(edge, len(q) - edge, max(int(0.25 / (CUT * step)), 1))
        dq = np.gradient(q, step, axis=0)
        ddq = np.gradient(dq, step, axis=0)
        sign = filtered(np.sign(dq), step)[self.rows]
        self.q, self.dq = q[self.rows], dq[self.rows]
        drives = model.drives(model.nominal)
        torque = drives.moving_torque(self.q, 0 * self.dq, ddq[self.rows])
        one = np.ones_like(torque)
        self.columns = np.stack([torque, self.dq, sign, one], axis=-1)
        self.grid = grid

    def lead(self, delay: float) -> FloatArray:
        """Smoothed command less position [rad], (rows, dof)."""
        command = filtered(self.grid.command(delay), self.grid.step)
        return np.asarray(command[self.rows] - self.q)


def _solve(parts: list[_Part], delay: float) -> tuple[FloatArray, float]:
    """The coefficients of every joint for one dead time, (dof, 4), and the sum of the misfits."""
    lead = np.concatenate([x.lead(delay) for x in parts])
    columns = np.concatenate([x.columns for x in parts])
    found, misfit = [], 0.0
    for j in range(lead.shape[1]):
        a, b = columns[:, j], lead[:, j]
        size = np.maximum(np.sqrt(np.sum(a**2, axis=0)), 1e-300)
        x = np.linalg.lstsq(a / size, b, rcond=1e-6)[0] / size
        found.append(x)
        misfit += float(np.sum((a @ x - b) ** 2) / max(float(np.sum(b**2)), 1e-300))
    return np.array(found), misfit


def _values(model: Model, found: FloatArray, moves: BoolArray, most: FloatArray) -> FloatArray:
    """Values of the unknowns from the coefficients of the joints.

    Args:
        model: What is sought.
        found: The coefficients, (dof, 4).
        moves: Which joints move, (dof,).
        most: Largest friction by stiffness [rad], (dof,).
    """
    values, servo, inertia = np.array(model.nominal), model.servo, model.inertia
    viscous = model.viscous(model.nominal)
    kv = np.array(servo.kv)
    stiffness = inertia * kv * servo.kp
    for j, (per_torque, lag, friction, _) in enumerate(found):
        if not moves[j] or not LAGS[0] <= lag <= LAGS[1]:
            continue
        if not model.keep_kv:
            kv[j] = np.clip(lag / max(inertia[j] * per_torque, 1e-300), *(x / lag for x in RATIOS))
        stiffness[j] = (inertia[j] * kv[j] + viscous[j]) / lag
        known = {"kp": stiffness[j] / (inertia[j] * kv[j]), "kv": kv[j]}
        known["coulomb"] = min(max(friction, 0.0), most[j]) * stiffness[j]
        for k, x in enumerate(model.unknowns):
            if x.index == j and x.name in known:
                own = known[x.name]
                values[k] = np.log(own) if x.name in LOGARITHMIC else own
    return values
