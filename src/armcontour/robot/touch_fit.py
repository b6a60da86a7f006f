"""Least-squares fits to touches, and what the other touches say about each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, Frozen

# Smallest redundancy of a touch, in its worst direction, at which the other touches check it. A
# mistake of 30 times the noise then changes the root of the sum of squares by 9 times the noise.
MIN_REDUNDANCY = 0.09


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FrameFit(Frozen):
    """The frame (R, t) that maps points of a drawing to touched points best.

    Args:
        rotation: Rotation R, (dimension, dimension).
        position: Position t [m], (dimension,).
        apart: Mapped minus touched point of all touches, also of those that were left out [m],
            (n, dimension).
        squares: Sum of squares of the touches that were fitted [m²].
    """

    rotation: FloatArray
    position: FloatArray
    apart: FloatArray = field(repr=False)
    squares: float


def fit_frame(drawn: FloatArray, touched: FloatArray, keep: BoolArray | None = None) -> FrameFit:
    """Return the frame with the smallest sum of |R x_i + t - p_i|² (Kabsch 1976).

    Args:
        drawn: Points x_i of the drawing [m], (n, dimension).
        touched: Touched points p_i [m], (n, dimension).
        keep: Touches that are fitted, (n,); by default all.
    """
    kept = np.ones(len(drawn), dtype=bool) if keep is None else keep
    drawn_centre = drawn[kept].mean(axis=0)
    touched_centre = touched[kept].mean(axis=0)
    covariance = (drawn[kept] - drawn_centre).T @ (touched[kept] - touched_centre)
    left, _, right = np.linalg.svd(covariance)
    # The factor -1 on the weakest direction turns a reflection into the nearest rotation.
    signs = np.ones(drawn.shape[1])
    signs[-1] = np.sign(np.linalg.det(left) * np.linalg.det(right))
    rotation = right.T @ (signs[:, None] * left.T)
    position = touched_centre - rotation @ drawn_centre
    apart = drawn @ rotation.T + position - touched
    return FrameFit(
        rotation=rotation,
        position=position,
        apart=apart,
        squares=float((apart[kept] ** 2).sum()),
    )


def fitted_scale(drawn: FloatArray, touched: FloatArray, fit: FrameFit) -> float:
    """Return the factor of the drawing that fits the touches best (Umeyama 1991).

    It is the sum of (R x_i)·p_i divided by that of |x_i|², both from their centres.
    """
    from_centre = drawn - drawn.mean(axis=0)
    products = (from_centre @ fit.rotation.T) * (touched - touched.mean(axis=0))
    return float(products.sum() / (from_centre**2).sum())


def unknowns_of_frame(dimension: int) -> int:
    """Return the number of unknowns of a frame: its position and its rotation."""
    return 3 if dimension == 2 else 6


def frame_derivatives(points: FloatArray) -> FloatArray:
    """Return the derivatives of points by a frame's unknowns, (n, dimension, unknowns)."""
    count, dimension = points.shape
    derivatives = np.zeros((count, dimension, unknowns_of_frame(dimension)))
    derivatives[:, :, :dimension] = np.eye(dimension)
    if dimension == 2:
        derivatives[:, 0, 2] = -points[:, 1]
        derivatives[:, 1, 2] = points[:, 0]
        return derivatives
    for axis in range(3):
        derivatives[:, :, 3 + axis] = np.cross(np.eye(3)[axis], points)
    return derivatives


def unchecked_directions(derivatives: FloatArray) -> FloatArray:
    """Return projections on directions in which the other touches do not check a touch, (n, d, d).

    An error a of touch i changes its own residual by (I - H_ii) a, where H = A A⁺ and A has the
    derivatives of all touches by the unknowns. The eigenvalues of I - H_ii are its redundancy
    (Baarda 1968): with 0, the fit follows the error, and no residual shows it.

    Args:
        derivatives: Derivatives of touches by the unknowns, (n, d, unknowns).
    """
    count, dimension, unknowns = derivatives.shape
    inverse = np.linalg.pinv(derivatives.reshape(-1, unknowns))
    influence = inverse.reshape(unknowns, count, dimension)
    own = np.einsum("ndk,kne->nde", derivatives, influence)
    redundancy, directions = np.linalg.eigh(np.eye(dimension) - own)
    missing = directions * (redundancy < MIN_REDUNDANCY)[:, None, :]
    return np.asarray(missing @ directions.transpose(0, 2, 1))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LeftOut(Frozen):
    """Fits that leave out one touch each.

    Args:
        squares: Sum of squares of the other touches [m²], (n,).
        apart: From the touch to where the others put it [m], (n, dimension).
    """

    squares: FloatArray
    apart: FloatArray


def leave_one_out(apart_by: Callable[[BoolArray], FloatArray], count: int) -> LeftOut:
    """Fit all touches but one, for each touch.

    Args:
        apart_by: Function of the touches to fit, (n,), that returns the errors of all touches [m],
            (n, dimension).
        count: Number of touches n.
    """
    squares = []
    own = []
    for i in range(count):
        keep = np.arange(count) != i
        apart = apart_by(keep)
        squares.append((apart[keep] ** 2).sum())
        own.append(apart[i])
    return LeftOut(squares=np.array(squares), apart=np.array(own))
