"""Measured positions of the tool, as joints that would take it there."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.learning.aligning import Clock, fit_to
from armcontour.learning.estimating import white_noise
from armcontour.learning.lifted import Lifted

# A tracker is in another frame, or tracks another point, if the tool is this far away [m]: no
# elastic joint gives way by so much.
FAR = 0.05


def add_tool(
    tool: tuple[npt.ArrayLike, npt.ArrayLike],
    lifted: Lifted,
    error: FloatArray,
    clock: Clock | None,
) -> tuple[FloatArray, FloatArray]:
    """Errors of the joints that explain what encoders and a tracker have measured.

    What the tracker sees and the encoders do not, as links that give way, is added as the smallest
    motion of the joints that explains it; with noise, less.

    Args:
        tool: Times [s], (m,), and positions of the tool point in the frame of the path [m],
            (m, dimension).
        lifted: The model.
        error: Errors of the joints by encoders [rad], (n, dof).
        clock: The tracker's clock, if known; otherwise it is found from the motion.

    Returns:
        Errors of the joints [rad], (n, dof), and the standard deviation of the white noise that the
        tracker adds to them [rad], (dof,).

    Raises:
        InvalidInput: The positions are not those of this tool along this motion.
    """
    arm = lifted.nominal.arm
    t, points = _check(tool, arm.dimension)
    seen = arm.forward(lifted.planned + error)
    if clock is None:
        clock = fit_to(t, points, lifted.t, seen)
    at = clock.plan_time(t)
    if at[0] > 2 * np.diff(at).max() or at[-1] < lifted.plan.duration - 2 * np.diff(at).max():
        raise InvalidInput(
            f"The positions of the tool cover the plan from {at[0]:.4g} s to {at[-1]:.4g} s, but "
            f"it lasts from 0 to {lifted.plan.duration:.4g} s: track the whole run."
        )
    off = lifted.at_times(at, points, seen) - seen
    largest = float(np.linalg.norm(off, axis=1).max())
    if largest > FAR:
        raise InvalidInput(
            f"The measured tool is {1e3 * largest:.4g} mm from where the joints say it is, and "
            f"more than {1e3 * FAR:g} mm is not compliance: give positions of the tool point in "
            "the frame of the path, in metres.",
            needed=largest,
            allowed=FAR,
        )
    noise = float(np.mean(white_noise(points - lifted.between(at, seen)) ** 2))
    inverse = _inverse(arm.jacobian(lifted.planned), off, noise)
    found = np.einsum("njd,nd->nj", inverse, off)
    spread = np.sqrt(noise * (inverse**2).sum(axis=2).mean(axis=0))
    return error + found, spread * np.sqrt(max(np.median(np.diff(at)) / lifted.step, 1.0))


def _inverse(jacobian: FloatArray, off: FloatArray, noise: float) -> FloatArray:
    """The most probable motion of the joints for a motion of the tool, (n, dof, dimension).

    Joints are as likely to give way as makes the tool move as it does.

    Args:
        jacobian: Tool motion per joint motion, (n, dimension, dof).
        off: Motion of the tool that is to be explained [m], (n, dimension).
        noise: Variance of the noise in it [m²].
    """
    product = jacobian @ np.swapaxes(jacobian, 1, 2)
    reach = float(np.trace(product, axis1=1, axis2=2).mean())
    likely = max(float(np.mean((off**2).sum(axis=1))) / reach, 1e-300)
    damped = product + noise / likely * np.eye(off.shape[1])
    return np.asarray(np.swapaxes(jacobian, 1, 2) @ np.linalg.pinv(damped, hermitian=True))


def _check(
    tool: tuple[npt.ArrayLike, npt.ArrayLike], dimension: int
) -> tuple[FloatArray, FloatArray]:
    """Times [s] and positions [m] of a tracker, checked.

    Raises:
        InvalidInput: They are not arrays of the right form.
    """
    if len(tool) != 2:
        raise InvalidInput("tool must be two arrays: times, and positions of the tool.")
    t, points = _checks.numbers("tool times", tool[0], "s"), _checks.points("tool", tool[1])
    if t.ndim != 1 or len(t) < 5 or points.shape != (len(t), dimension):
        raise InvalidInput(
            f"The positions of the tool have shape {points.shape}, but must have {dimension} "
            f"coordinates at each of the {t.size} times, five at least."
        )
    if (np.diff(t) <= 0).any():
        raise InvalidInput("The times of the tool's positions must increase.")
    return t, points
