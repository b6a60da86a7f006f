"""Tool orientation as a function of arc length, with exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from functools import lru_cache
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray, copy_unchecked
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.frames import angle_between, exp, log
from armcontour.core.quantities import Axes, ConeAngle, Quantity
from armcontour.core.quintics import rescale
from armcontour.core.text import short_repr

# Orientations that differ by less than this angle [rad] count as equal.
SAME_ORIENTATION = 1e-9
# Angular rates that differ by less than this relative difference, or less than the floor [rad/m],
# count as equal, because over a metre of path the floor turns the tool by SAME_ORIENTATION only.
SAME_RATE = 1e-9
RATE_FLOOR = 1e-9
# Relative rounding error of an arc length.
RELATIVE_LENGTH_ROUNDING = 1e-15
WHOLE_ROTATION = (
    "A cone allows other directions of the tool axis, so the rotation about this axis must be "
    "free. Specify only the tool axis (in a job, path.orientation.axis, or axis_only: true; in "
    "Python, path.pointing(direction), or axis_only=True), or remove the cone."
)
# Coefficients of f(u) = u.
LINEAR = checks.frozen_array([0.0, 1.0, 0.0, 0.0])
# Fields of `Orientation` with rotations: one matrix or one rotation vector per piece.
ROTATIONS = ("starts", "first", "second", "third")
# Fields of `Orientation` with polynomial coefficients, one row per piece.
POLYNOMIALS = ("f", "g", "h")


# Coefficients of fast rotations are large, so any finite value is accepted.
FINITE = Quantity("", within=(-np.finfo(np.float64).max, np.finfo(np.float64).max))


@declared(eq=False)
class Orientation(Checked):
    """Tool orientation along a path, in n pieces.

    On piece i, at distance u after its start, the tool's axes are the columns of
    `exp(h(u) third[i]) exp(g(u) second[i]) exp(f(u) first[i]) starts[i]`. f, g and h are
    polynomials of degree 3, or 5 where the derivative of the angular rate must not jump. A piece of
    constant angular rate has f(u) = u and g = h = 0. Only splines of rotations need h.

    Args:
        breaks: Arc lengths at which the pieces start and end, from 0 [m], (n + 1,).
        starts: Rotation matrices at the starts of the pieces, (n, 3, 3).
        first: Rotation vectors per unit of f [rad/m], (n, 3).
        second: Rotation vectors per unit of g [rad/m], (n, 3).
        third: Rotation vectors per unit of h [rad/m], (n, 3).
        f: Coefficients of 1, u, u², ... in f, (n, 4) or (n, 6).
        g: Coefficients of 1, u, u², ... in g, of the same shape.
        h: Coefficients of 1, u, u², ... in h, of the same shape.
        axis_only: Only the tool axis, the third column, is prescribed; rotation about it is free.
            By default, the whole rotation is prescribed.
        follows: The orientation follows the tangent of its path.
        cone: Largest angle allowed between the tool axis and the prescribed one [rad]; above 0, the
            planner chooses the angle. Only with `axis_only`.

    Attributes:
        fixed: The tool does not turn on any piece.

    Raises:
        InvalidInput: The arrays have wrong shapes, are not finite, or breaks do not increase; or a
            cone is specified for a whole rotation.
    """

    breaks: Annotated[FloatArray, FINITE, Axes("breaks")]
    starts: Annotated[FloatArray, FINITE, Axes("n", 3, 3)]
    first: Annotated[FloatArray, FINITE, Axes("n", 3)]
    second: Annotated[FloatArray, FINITE, Axes("n", 3)]
    third: Annotated[FloatArray, FINITE, Axes("n", 3)]
    f: Annotated[FloatArray, FINITE, Axes("n", "terms")]
    g: Annotated[FloatArray, FINITE, Axes("n", "terms")]
    h: Annotated[FloatArray, FINITE, Axes("n", "terms")]
    axis_only: bool = False
    follows: bool = False
    cone: ConeAngle = 0.0
    fixed: bool = field(init=False, repr=False)

    __repr__ = short_repr

    def _check_together(self) -> None:
        n = len(self.starts)
        if len(self.breaks) != n + 1 or self.f.shape[1] not in (4, 6):
            raise InvalidInput(
                f"An orientation of {n} pieces needs {n + 1} breaks, and f, g and h with 4 or "
                f"6 columns, but has {len(self.breaks)} breaks and {self.f.shape[1]} columns."
            )
        turns = self.first.any() or self.second.any() or self.third.any()
        object.__setattr__(self, "fixed", not turns)
        if n == 0 or self.breaks[0] != 0 or not (self.breaks[1:] > self.breaks[:-1]).all():
            raise InvalidInput("The breaks of an orientation must start at 0 and increase.")
        if self.cone > 0 and not self.axis_only:
            raise InvalidInput(WHOLE_ROTATION)

    @classmethod
    def even(
        cls,
        lengths: FloatArray,
        starts: FloatArray,
        rates: FloatArray,
        *,
        axis_only: bool = False,
        follows: bool = False,
    ) -> Orientation:
        """Return an orientation with a constant angular rate on each piece.

        Args:
            lengths: Lengths of the pieces [m], (n,).
            starts: Rotation matrices at the starts of the pieces, (n, 3, 3).
            rates: Angular rates of the pieces [rad/m], (n, 3).
            axis_only: Rotation about the tool axis is free.
            follows: The orientation follows the tangent of its path.
        """
        n = len(lengths)
        return cls(
            breaks=np.concatenate([[0.0], np.cumsum(lengths)]),
            starts=starts,
            first=rates,
            **_constant_rate_columns(n),
            axis_only=axis_only,
            follows=follows,
            cone=0.0,
        )

    @classmethod
    def join(cls, parts: Sequence[Orientation], lengths: Sequence[float]) -> Orientation:
        """Join the orientations of consecutive paths.

        Args:
            parts: The orientations in order.
            lengths: Lengths of their paths [m].
        """
        offsets = np.concatenate([[0.0], np.cumsum(lengths)])
        breaks = [x.breaks[:-1] + offset for x, offset in zip(parts, offsets, strict=False)]
        size = max(x.f.shape[1] for x in parts)
        columns = {name: [getattr(x, name) for x in parts] for name in ROTATIONS}
        for name in POLYNOMIALS:
            columns[name] = [raise_degree(getattr(x, name), size - 1) for x in parts]
        joined: dict[str, Any] = {name: np.concatenate(x) for name, x in columns.items()}
        joined["breaks"] = np.concatenate([*breaks, offsets[-1:]])
        joined["axis_only"] = all(x.axis_only for x in parts)
        joined["follows"] = all(x.follows for x in parts)
        joined["cone"] = min(x.cone for x in parts)
        if all(x.fixed for x in parts):
            return copy_unchecked(parts[0], **joined)
        return cls(**joined)

    @checked
    def with_cone(self, cone: ConeAngle) -> Orientation:
        """Return the orientation with another cone around the tool axis.

        Args:
            cone: Largest angle between the tool axis and the prescribed one [rad].

        Raises:
            InvalidInput: The whole rotation is prescribed, or the angle is out of range.
        """
        return self if cone == self.cone else replace(self, cone=cone)

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.starts)

    def __call__(self, s: npt.ArrayLike, *, side: str = "right") -> FloatArray:
        """Return rotation matrices at arc lengths, `s.shape + (3, 3)`."""
        arc_lengths = checks.floats("arc lengths", s, "m")
        i = self.locate(arc_lengths, side=side)
        return self.on_piece(i, arc_lengths - self.breaks[i])

    def rates(self, s: npt.ArrayLike, *, side: str = "right") -> tuple[FloatArray, FloatArray]:
        """Return the angular rate [rad/m] and its derivative [rad/m²], `s.shape + (3,)` each.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the piece after a break, "left" for the piece before the break.
        """
        arc_lengths = checks.floats("arc lengths", s, "m")
        i = self.locate(arc_lengths, side=side)
        return self.rates_on_piece(i, arc_lengths - self.breaks[i])

    def locate(self, s: npt.ArrayLike, *, side: str = "right") -> IntArray:
        """Return the index of the piece that contains each arc length.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the piece after a break, "left" for the piece before the break.
        """
        return checks.locate(self.breaks, s, side)

    def on_piece(self, i: IntArray, u: FloatArray) -> FloatArray:
        """Return rotation matrices at distance `u` after the start of piece `i`.

        Args:
            i: Indices of pieces, (n,).
            u: Distances from the starts of these pieces [m], (n,).
        """
        if self.fixed:
            return np.array(self.starts[i])
        first = exp(evaluate_polynomials(self.f[i], u)[..., None] * self.first[i])
        second = exp(evaluate_polynomials(self.g[i], u)[..., None] * self.second[i])
        turned = second @ first @ self.starts[i]
        third = self.third[i]
        if third.any():
            turned = exp(evaluate_polynomials(self.h[i], u)[..., None] * third) @ turned
        return np.asarray(turned)

    def rates_on_piece(self, i: IntArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the angular rate [rad/m] and its derivative [rad/m²] on piece `i`, (n, 3) each.

        Args:
            i: Indices of pieces, (n,).
            u: Distances from the starts of these pieces [m], (n,).
        """
        if self.fixed:
            return np.zeros((*np.shape(u), 3)), np.zeros((*np.shape(u), 3))
        g, dg, ddg = (evaluate_polynomials(self.g[i], u, order)[..., None] for order in range(3))
        df, ddf = (evaluate_polynomials(self.f[i], u, order)[..., None] for order in (1, 2))
        second = self.second[i]
        # The second rotation also rotates the axis of the first rotation.
        first = rotate(exp(g * second), self.first[i])
        rate = dg * second + df * first
        change = ddg * second + ddf * first + df * dg * np.cross(second, first)
        third = self.third[i]
        if third.any():
            # The third rotation also rotates the rate of the other two.
            h, dh, ddh = (
                evaluate_polynomials(self.h[i], u, order)[..., None] for order in range(3)
            )
            turn = exp(h * third)
            rate = rotate(turn, rate)
            change = rotate(turn, change) + ddh * third + dh * np.cross(third, rate)
            rate = rate + dh * third
        return np.asarray(rate), np.asarray(change)

    @property
    def constant(self) -> bool:
        """True if the orientation is the same along the whole path."""
        single = len(self.starts) == 1
        return self.fixed and (single or bool((self.starts[1:] == self.starts[:-1]).all()))

    @property
    def jumps(self) -> FloatArray:
        """Angle by which the orientation jumps at every inner break [rad], (n - 1,)."""
        if self.constant:
            return np.zeros(len(self) - 1)
        i = np.arange(len(self) - 1)
        before = self.on_piece(i, np.diff(self.breaks)[:-1])
        after = self.on_piece(i + 1, np.zeros(len(i)))
        if self.axis_only:
            return angle_between(before[:, :, 2], after[:, :, 2])
        size = np.linalg.norm(before - after, axis=(1, 2)) / np.sqrt(8)
        return np.asarray(2 * np.arcsin(np.minimum(size, 1.0)))

    @property
    def kinks(self) -> FloatArray:
        """Jumps of the angular rate at inner breaks [rad/m], 0 for rounding errors, (n - 1,)."""
        if self.fixed:
            return np.zeros(len(self) - 1)
        i = np.arange(len(self) - 1)
        before, slope_before = self.rates_on_piece(i, np.diff(self.breaks)[:-1])
        after, slope_after = self.rates_on_piece(i + 1, np.zeros(len(i)))
        step = after - before
        if self.axis_only:
            axis = self.on_piece(i + 1, np.zeros(len(i)))[:, :, 2]
            step = step - np.sum(step * axis, axis=1, keepdims=True) * axis
        kink = np.linalg.norm(step, axis=1)
        size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
        # At a tight corner the rate changes strongly within the rounding error of an arc length.
        slope = np.linalg.norm(slope_before, axis=1) + np.linalg.norm(slope_after, axis=1)
        rounding = (
            SAME_RATE * size + RATE_FLOOR + RELATIVE_LENGTH_ROUNDING * self.breaks[1:-1] * slope
        )
        return np.asarray(np.where(kink > rounding, kink, 0.0))

    @property
    def stops(self) -> FloatArray:
        """Arc lengths at which orientation or angular rate jumps, so the tool stops [m], (k,)."""
        inner = self.breaks[1:-1].copy()
        return inner[(self.kinks > 0) | (self.jumps > SAME_ORIENTATION)] if len(inner) else inner

    def cut(self, begin: float, length: float, shortest: float) -> Orientation:
        """Return the orientation along a part of its path.

        Args:
            begin: Arc length at which the part starts [m].
            length: Length of the part [m].
            shortest: Pieces up to this length are discarded [m].
        """
        breaks = self.breaks - begin
        i = np.flatnonzero((breaks[1:] > shortest) & (breaks[:-1] < length - shortest))
        rows = copy_pieces(self, i)
        before = max(-float(breaks[i[0]]), 0.0)
        ends = np.concatenate([[0.0], breaks[i[1:]], [length]])
        if self.fixed:
            # The tool does not turn, so the rotations do not depend on where a piece starts.
            return copy_unchecked(self, breaks=ends, **rows)
        if before > 0:
            # The first piece now starts inside its former range. Its start rotation is the
            # orientation at this point. The later rotations up to this point rotate the axes of
            # the earlier ones.
            rows["starts"][0] = self.on_piece(i[:1], np.array([before]))[0]
            for name in POLYNOMIALS:
                rows[name][:1] = shift_polynomials(rows[name][:1], np.array([before]))
            second = exp(rows["g"][0, 0] * self.second[i[:1]])[0]
            third = exp(rows["h"][0, 0] * self.third[i[:1]])[0]
            rows["first"][0] = third @ second @ rows["first"][0]
            rows["second"][0] = third @ rows["second"][0]
            for name in POLYNOMIALS:
                rows[name][0, 0] = 0.0
        return replace(self, breaks=ends, **rows)

    def reverse(self) -> Orientation:
        """Return the orientation along the reversed path."""
        lengths = np.diff(self.breaks)
        at_end = [shift_polynomials(x, lengths) for x in (self.f, self.g, self.h)]
        second = exp(at_end[1][:, :1] * self.second)
        third = exp(at_end[2][:, :1] * self.third)
        # The reversed f is f(end) - f(end - u), about the reversed axis.
        f, g, h = (-x * [0, -1, 1, -1, 1, -1][: x.shape[1]] for x in at_end)
        return replace(
            self,
            breaks=np.concatenate([[0.0], np.cumsum(lengths[::-1])]),
            starts=self.on_piece(np.arange(len(self)), lengths)[::-1],
            first=-rotate(third @ second, self.first)[::-1],
            second=-rotate(third, self.second)[::-1],
            third=-self.third[::-1],
            f=f[::-1],
            g=g[::-1],
            h=h[::-1],
        )

    def place(self, rotation: FloatArray, scale: float) -> Orientation:
        """Return the orientation along the scaled and rotated path.

        Args:
            rotation: Rotation matrix, (3, 3).
            scale: Factor of all lengths.
        """
        if self.fixed and scale == 1.0:
            return copy_unchecked(self, starts=rotation @ self.starts)
        return replace(
            self,
            breaks=self.breaks * scale,
            starts=rotation @ self.starts,
            first=self.first @ rotation.T / scale,
            second=self.second @ rotation.T / scale,
            third=self.third @ rotation.T / scale,
            f=self.f / scale ** (np.arange(self.f.shape[1]) - 1.0),
            g=self.g / scale ** (np.arange(self.g.shape[1]) - 1.0),
            h=self.h / scale ** (np.arange(self.h.shape[1]) - 1.0),
        )


@lru_cache(maxsize=16)
def _constant_rate_columns(n: int) -> Mapping[str, FloatArray]:
    """Return the columns `second`, `third`, `f`, `g` and `h` of n pieces with constant rates.

    Many orientations share them.
    """
    columns = {"second": np.zeros((n, 3)), "f": np.tile(LINEAR, (n, 1)), "g": np.zeros((n, 4))}
    frozen = {name: checks.frozen_array(x) for name, x in columns.items()}
    return {**frozen, **no_third_rotation(n, 4)}


@lru_cache(maxsize=16)
def no_third_rotation(n: int, terms: int) -> Mapping[str, FloatArray]:
    """Return read-only columns `third` and `h` for n pieces without a third rotation.

    - `n`: number of pieces.
    - `terms`: number of coefficients per polynomial, 4 or 6.
    """
    columns = {"third": np.zeros((n, 3)), "h": np.zeros((n, terms))}
    return {name: checks.frozen_array(x) for name, x in columns.items()}


def rotate(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return vectors turned by rotation matrices, (..., 3, 3) and (..., 3) to (..., 3)."""
    return np.asarray(np.einsum("...ij,...j->...i", rotations, vectors))


def shift_polynomials(c: FloatArray, by: FloatArray) -> FloatArray:
    """Return the coefficients of c(u + by) from those of c(u), (n, degree + 1).

    - `c`: coefficients of 1, u, u², ..., (n, degree + 1).
    - `by`: the shifts, (n,).
    """
    return rescale(c[:, :, None], by, np.ones(len(c)))[:, :, 0]


def turns_between(first: FloatArray, second: FloatArray, *, axis_only: bool) -> FloatArray:
    """Return angles between rotations [rad], (n,); between their third axes if `axis_only`.

    - `first`, `second`: rotation matrices, (n, 3, 3) each.
    """
    if axis_only:
        return angle_between(first[:, :, 2], second[:, :, 2])
    return np.asarray(np.linalg.norm(log(first @ np.swapaxes(second, 1, 2)), axis=1))


def fit_cubics(
    width: FloatArray, begin: tuple[FloatArray, FloatArray], end: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Return the coefficients of cubics with given values and slopes at both ends, (n, 4).

    - `width`: lengths of the intervals, (n,).
    - `begin`: value and slope at the start of each interval, (n,) each.
    - `end`: value and slope at its end, (n,) each.
    """
    start_value, start_slope = begin
    end_value, end_slope = end
    mean_slope = (end_value - start_value) / width
    c2 = (3 * mean_slope - 2 * start_slope - end_slope) / width
    c3 = (start_slope + end_slope - 2 * mean_slope) / width**2
    return np.stack([start_value, start_slope, c2, c3], axis=1)


def raise_degree(c: FloatArray, degree: int) -> FloatArray:
    """Return coefficients of the same polynomials up to a higher degree, (n, degree + 1)."""
    if c.shape[1] == degree + 1:
        return c
    return np.pad(c, ((0, 0), (0, degree + 1 - c.shape[1])))


def evaluate_polynomials(c: FloatArray, u: FloatArray, order: int = 0) -> FloatArray:
    """Return polynomials, or their derivatives of an order, at u, by Horner's rule.

    The shape is that of `c[..., 0]` and `u` broadcast together.

    - `c`: coefficients of 1, u, u², ..., (..., degree + 1).
    - `u`: values of the variable.
    """
    values = np.zeros(np.broadcast_shapes(c.shape[:-1], np.shape(u)))
    for k in range(c.shape[-1] - 1, order - 1, -1):
        values = values * u + math.perm(k, order) * c[..., k]
    return values


def copy_pieces(orientation: Orientation, pieces: IntArray) -> dict[str, Any]:
    """Copy the rotations and polynomials of some pieces, {name of the field: array}.

    - `pieces`: indices of the pieces, (m,).
    """
    return {x: getattr(orientation, x)[pieces] for x in (*ROTATIONS, *POLYNOMIALS)}
