"""Doubts about measured frames: mistakes that explain the touches better than their noise.

The residuals of a fit hide mistakes, because the fit follows them. Therefore the touches are
compared with what typical mistakes would give, and the frame with the planned one.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Literal, get_args

import numpy as np

from armcontour.core.checks import FloatArray, Frozen, IntArray, raise_if
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import Frame
from armcontour.core.text import capitalise, list_some
from armcontour.robot.touch_fit import (
    FrameFit,
    LeftOut,
    fit_frame,
    fitted_scale,
    leave_one_out,
    unknowns_of_frame,
)

# Names of doubts, by which they are accepted.
DoubtName = Literal["turned_over", "mirrored", "scaled", "order", "touch"]
DOUBTS: tuple[DoubtName, ...] = get_args(DoubtName)
# Smallest decrease of the root of the sum of squares by which a mistake explains the touches,
# divided by the noise. Noise alone reaches it once in ten million touches.
CLEAR_DECREASE = 6.0
# Largest ratio of residuals to the stated noise, both as standard deviations.
MAX_NOISE_RATIO = 4.0
# Largest deviation of the drawing's scale: this many standard deviations, and this fraction, which
# is that of an arm whose model is wrong by 0.5 mm and 1 mrad per joint.
MAX_SCALE_DEVIATIONS = 4.0
MAX_SCALE_ERROR = 0.004
# Smallest rotation from the planned frame at which other orders of the touches are tried [rad].
TURNED = np.radians(30.0)
# Maximum number of touches of which all orders are tried; of more, exchanges and shifts.
MAX_PERMUTED = 7
# Maximum number of touches of which other orders are tried.
MAX_REORDERED = 30
# Number of orders whose frames are fitted, by how well their distances match.
TRIED_ORDERS = 24
# Maximum number of touches that a message lists.
MAX_LISTED = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Doubt(Frozen):
    """A probable mistake.

    Args:
        name: Name by which the doubt is accepted.
        reason: What is probably wrong, with values, and how to correct it: sentences.
        index: Index of the mistaken touch, from 0; None if it is not one touch.
        mistake: Error of that touch [m], (dimension,).
        squares: Sum of squares of the residuals with this explanation [m²].
        unknowns: Number of unknowns of this explanation.
    """

    name: DoubtName
    reason: str
    index: int | None = None
    mistake: FloatArray | None = None
    squares: float = 0.0
    unknowns: int = 0

    def to_error(self) -> InvalidInput:
        """Return the error that names the doubt."""
        return InvalidInput(
            f"{self.reason} If the measurement is right, accept the doubt {self.name}.",
            index=self.index,
            limit=self.name,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Alternative(Frozen):
    """A frame that would be measured if a mistake were corrected.

    Args:
        correction: The correction: "with the opposite sign of y".
        rotation: Rotation of the frame, (dimension, dimension).
        is_order: Whether the touches are in another order.
    """

    correction: str
    rotation: FloatArray
    is_order: bool


def read_accepted(accept: Collection[str]) -> frozenset[str]:
    """Check names of accepted doubts."""
    for name in accept:
        raise_if(
            name not in DOUBTS,
            f'The doubts that you can accept are {", ".join(DOUBTS)}, not "{name}".',
        )
    return frozenset(accept)


def require_accepted(doubts: Sequence[Doubt], accepted: Collection[str]) -> tuple[str, ...]:
    """Raise the first doubt that is not accepted; return the names of the others."""
    for doubt in doubts:
        if doubt.name not in accepted:
            raise doubt.to_error()
    return tuple(doubt.name for doubt in doubts)


def doubt_of_fit(
    drawn: FloatArray, touched: FloatArray, fit: FrameFit, noise: float
) -> Doubt | None:
    """Return the mistake that explains the residuals of a part best, if one is probable.

    Args:
        drawn: Points of the drawing [m], (n, dimension).
        touched: Touched points [m], (n, dimension).
        fit: The fit to all touches.
        noise: Standard deviation of each coordinate of a touch [m].
    """
    found = [
        _doubt_of_order(drawn, touched, fit, noise),
        _doubt_of_mirror(drawn, touched, fit, noise),
        _doubt_of_scale(drawn, touched, fit, noise),
    ]
    count, dimension = drawn.shape
    if count > dimension:
        left_out = leave_one_out(lambda keep: fit_frame(drawn, touched, keep).apart, count)
        labels = [f"its point {point_text(x)}" for x in drawn]
        found.append(doubt_of_touch(fit.squares, left_out, noise, labels))
    probable = [x for x in found if x is not None]
    if not probable:
        return None
    # As in Akaike's criterion, an explanation pays for its unknowns.
    best = min(probable, key=lambda x: x.squares / noise**2 + 2 * x.unknowns)
    freedom = drawn.size - unknowns_of_frame(dimension)
    is_explained = best.squares <= freedom * (MAX_NOISE_RATIO * noise) ** 2
    return best if is_explained else None


def doubt_of_touch(
    squares: float, left_out: LeftOut, noise: float, labels: Sequence[str]
) -> Doubt | None:
    """Return the doubt about the touch without which the others fit clearly better.

    Args:
        squares: Sum of squares of the fit to all touches [m²].
        left_out: Fits without one touch.
        noise: Standard deviation of each coordinate of a touch [m].
        labels: What each touch should fit: "its point (0, 0, 0) mm".
    """
    if not _is_clear(squares - left_out.squares.min(), noise):
        return None
    mistaken = int(left_out.squares.argmin())
    # Touches that explain the residuals equally well.
    limit = left_out.squares[mistaken] + (MAX_NOISE_RATIO * noise) ** 2
    suspects = np.flatnonzero(left_out.squares <= limit)
    increase = np.sqrt(squares / max(left_out.squares[mistaken], len(labels) * noise**2))
    apart = float(np.linalg.norm(left_out.apart[mistaken])) * 1e3
    if len(suspects) == 1:
        reason = (
            f"Touch {mistaken + 1} does not fit {labels[mistaken]}: it is {apart:.3g} mm from "
            f"where the other touches put it, and makes residuals {increase:.2g} times as large. "
            "Correct its row, or touch it again."
        )
    else:
        numbers = list_some([str(i + 1) for i in suspects], MAX_LISTED)
        reason = (
            f"One of the touches {numbers} is probably wrong: residuals are {increase:.2g} times "
            "as large as without it, but do not show which one it is. Touch them again, and touch "
            "one more point."
        )
    return Doubt(
        name="touch",
        reason=f"{reason} If all touches are so inexact, state their noise.",
        index=mistaken,
        mistake=left_out.apart[mistaken],
        squares=float(left_out.squares[mistaken]),
        unknowns=left_out.apart.shape[1],
    )


def doubts_of_plan(
    rotation: FloatArray, plan: Frame, alternatives: Sequence[Alternative]
) -> list[Doubt]:
    """Return the doubts that arise from the planned rotation of a part.

    A drawing with points in one plane and its mirror image fit touches equally well, if the part is
    turned over. So do other orders of the touches of a symmetric drawing. Only the plan tells.

    Args:
        rotation: Measured rotation, (dimension, dimension).
        plan: Planned frame.
        alternatives: Frames that fit the touches as well.
    """
    planned = plan.rotation[: len(rotation), : len(rotation)]
    angle = rotation_angle(rotation, planned)
    if len(rotation) == 3 and rotation[:, 2] @ planned[:, 2] < 0.0:
        tilt = np.degrees(angle_of_z(rotation, planned))
        reason = (
            f"The part is upside down: its z axis is {tilt:.3g} deg from that of the planned "
            f"frame, as if the drawing were mirrored. {_advice(alternatives, planned)}"
        )
        return [Doubt(name="turned_over", reason=reason)]
    orders = [x for x in alternatives if x.is_order]
    smallest = min((rotation_angle(x.rotation, planned) for x in orders), default=np.inf)
    if not is_planned(plan) or angle < TURNED or smallest > angle / 2:
        return []
    reason = (
        f"The measured frame is turned by {np.degrees(angle):.3g} deg from the planned one, and "
        f"the drawing is symmetric. {_advice(orders, planned)}"
    )
    return [Doubt(name="order", reason=reason)]


def is_planned(plan: Frame | None) -> bool:
    """Return whether a planned frame differs from that of a job that does not state one."""
    return plan is not None and not np.array_equal(plan.homogeneous, np.eye(4))


def _advice(alternatives: Sequence[Alternative], planned: FloatArray) -> str:
    """Return how to correct a table of touches, so that the frame is as planned."""
    if not alternatives:
        return "Check the order of the touches and the signs of their coordinates."
    nearest = min(alternatives, key=lambda x: rotation_angle(x.rotation, planned))
    turn = np.degrees(rotation_angle(nearest.rotation, planned))
    return (
        f"{capitalise(nearest.correction)}, the frame is turned by {turn:.2g} deg from the planned "
        "one: check these in the table."
    )


def alternatives_of_points(
    drawn: FloatArray, touched: FloatArray, fit: FrameFit, noise: float
) -> list[Alternative]:
    """Return frames of mirrored or reordered points that fit the touches as well as the points."""
    limit = fit.squares + (CLEAR_DECREASE * noise) ** 2
    found = []
    for axis, name in enumerate("xy"):
        signs = np.ones(drawn.shape[1])
        signs[axis] = -1.0
        mirrored = fit_frame(drawn * signs, touched)
        if mirrored.squares <= limit:
            correction = f"with the opposite sign of {name}"
            found.append(
                Alternative(correction=correction, rotation=mirrored.rotation, is_order=False)
            )
    for order in _likely_orders(drawn, touched):
        other = fit_frame(drawn[order], touched)
        if other.squares <= limit:
            found.append(
                Alternative(
                    correction=f"with the points in the order {_order_text(order)}",
                    rotation=other.rotation,
                    is_order=True,
                )
            )
    return found


def rotation_angle(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between two rotations of 2 or 3 dimensions [rad]."""
    between = first.T @ second
    trace = float(np.trace(between))
    cosine = trace / 2 if len(first) == 2 else (trace - 1) / 2
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))


def angle_of_z(first: FloatArray, second: FloatArray) -> float:
    """Return the angle between the z axes of two rotations [rad]."""
    return float(np.arccos(np.clip(first[:, 2] @ second[:, 2], -1.0, 1.0)))


def point_text(point: FloatArray, decimals: int | None = None) -> str:
    """Write a point in mm, such as "(40, 20, 0) mm"; by default with four digits."""
    form = "z.4g" if decimals is None else f"z.{decimals}f"
    return f"({', '.join(f'{x * 1e3:{form}}' for x in point)}) mm"


def _is_clear(decrease: float, noise: float) -> bool:
    """Return whether a sum of squares decreases by more than noise explains."""
    return decrease > (CLEAR_DECREASE * noise) ** 2


def _doubt_of_order(
    drawn: FloatArray, touched: FloatArray, fit: FrameFit, noise: float
) -> Doubt | None:
    """Return the doubt that the rows are in a wrong order."""
    orders = _likely_orders(drawn, touched)
    if len(orders) == 0:
        return None
    fits = [fit_frame(drawn[order], touched) for order in orders]
    best = int(np.argmin([x.squares for x in fits]))
    if not _is_clear(fit.squares - fits[best].squares, noise):
        return None
    before = np.sqrt(fit.squares / len(drawn)) * 1e3
    after = np.sqrt(fits[best].squares / len(drawn)) * 1e3
    return Doubt(
        name="order",
        reason="The points were probably touched in another order: with the points in the order "
        f"{_order_text(orders[best])}, residuals are {after:.2g} mm instead of {before:.2g} mm. "
        "Correct the order of the points.",
        squares=fits[best].squares,
    )


def _doubt_of_mirror(
    drawn: FloatArray, touched: FloatArray, fit: FrameFit, noise: float
) -> Doubt | None:
    """Return the doubt that the coordinates are those of the mirrored part."""
    mirrored = fit_frame(drawn * np.array([1.0, -1.0, 1.0])[: drawn.shape[1]], touched)
    if not _is_clear(fit.squares - mirrored.squares, noise):
        return None
    before = np.sqrt(fit.squares / len(drawn)) * 1e3
    after = np.sqrt(mirrored.squares / len(drawn)) * 1e3
    return Doubt(
        name="mirrored",
        reason=f"The drawing is probably mirrored: residuals are {after:.2g} mm with one "
        f"coordinate's sign changed, instead of {before:.2g} mm. Check whether y of the drawing "
        "points up, and change the sign of that coordinate in all rows.",
        squares=mirrored.squares,
    )


def _doubt_of_scale(
    drawn: FloatArray, touched: FloatArray, fit: FrameFit, noise: float
) -> Doubt | None:
    """Return the doubt that the part is larger or smaller than the drawing."""
    scale = fitted_scale(drawn, touched, fit)
    deviation = noise / float(np.linalg.norm(drawn - drawn.mean(axis=0)))
    if abs(scale - 1) <= max(MAX_SCALE_DEVIATIONS * deviation, MAX_SCALE_ERROR):
        return None
    scaled = fit_frame(drawn * scale, touched)
    return Doubt(
        name="scaled",
        reason=f"The part is {scale:.4g} times as large as the drawing (noise explains "
        f"{deviation:.1g}). Check the units and the scale of the points, and the tool of the arm.",
        squares=scaled.squares,
        unknowns=1,
    )


def _likely_orders(drawn: FloatArray, touched: FloatArray) -> IntArray:
    """Return other orders of the points, those whose distances match the touches best, (k, n)."""
    count = len(drawn)
    if count > MAX_REORDERED:
        return np.empty((0, count), dtype=int)
    orders = _orders(count)
    drawn_distances = np.linalg.norm(drawn[:, None] - drawn, axis=-1)
    touched_distances = np.linalg.norm(touched[:, None] - touched, axis=-1)
    reordered = drawn_distances[orders[:, :, None], orders[:, None, :]]
    mismatch = ((reordered - touched_distances) ** 2).sum(axis=(1, 2))
    return np.asarray(orders[np.argsort(mismatch, kind="stable")[:TRIED_ORDERS]])


def _orders(count: int) -> IntArray:
    """Return orders to try: all permutations, of many touches exchanges and shifts, (k, n)."""
    rows = np.arange(count)
    if count <= MAX_PERMUTED:
        return np.array(list(permutations(range(count)))[1:])
    orders = [np.roll(rows, k) for k in range(1, count)]
    orders += [np.roll(rows[::-1], k) for k in range(count)]
    for first, second in combinations(range(count), 2):
        exchanged = rows.copy()
        exchanged[[first, second]] = [second, first]
        orders.append(exchanged)
    return np.array(orders)


def _order_text(order: IntArray) -> str:
    """Write the order of rows, from 1: "2, 1, 3, 4"."""
    return ", ".join(str(i + 1) for i in order)
