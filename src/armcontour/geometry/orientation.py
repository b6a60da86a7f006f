"""Tool orientation over arc length, with exact derivatives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import angle_between, exp

# Orientations closer than this are one orientation [rad].
SAME_ORIENTATION = 1e-9
# Rates of turning closer than this part of their size are one rate; so are rates below the floor
# [rad/m], at which a metre of path turns the tool by no more than one orientation's play.
SAME_RATE = 1e-9
RATE_FLOOR = 1e-9
# Of an arc length, in parts of it.
ROUNDING = 1e-15
LINEAR = _checks.lock_floats([0.0, 1.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orientation:
    """Rotations along a path, piece by piece.

    On piece i, at distance u after its start, the tool's axes are the columns of
    `exp(g(u) second[i]) exp(f(u) first[i]) starts[i]`; f and g are cubic polynomials. A piece that
    turns evenly has f(u) = u and g = 0.

    Args:
        breaks: Arc lengths of the pieces' ends, from 0 [m], (n + 1,).
        starts: Rotation matrices at the starts of the pieces, (n, 3, 3).
        first: Rotation vectors per unit of f [rad/m], (n, 3).
        second: Rotation vectors per unit of g [rad/m], (n, 3).
        f: Coefficients of 1, u, u², u³, (n, 4).
        g: Coefficients of 1, u, u², u³, (n, 4).
        axis_only: Only the tool axis, the third column, counts: turning about it is free.
        follows: The orientation follows the tangent of its path.

    Attributes:
        fixed: The tool does not turn on any piece.

    Raises:
        InvalidInput: Arrays that do not fit.
    """

    breaks: FloatArray
    starts: FloatArray
    first: FloatArray
    second: FloatArray
    f: FloatArray
    g: FloatArray
    axis_only: bool = False
    follows: bool = False
    fixed: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = len(self.starts)
        for name, shape in (
            ("breaks", (n + 1,)),
            ("starts", (n, 3, 3)),
            ("first", (n, 3)),
            ("second", (n, 3)),
            ("f", (n, 4)),
            ("g", (n, 4)),
        ):
            array = _checks.lock_floats(getattr(self, name))
            if array.shape != shape or not np.isfinite(array).all():
                raise InvalidInput(f"{name} of an orientation must be finite, of shape {shape}.")
            object.__setattr__(self, name, array)
        object.__setattr__(self, "fixed", not (self.first.any() or self.second.any()))
        if n == 0 or self.breaks[0] != 0 or not (np.diff(self.breaks) > 0).all():
            raise InvalidInput("The breaks of an orientation must start at 0 and increase.")

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
        """Pieces that turn evenly.

        Args:
            lengths: Of the pieces [m], (n,).
            starts: Rotations at their starts, (n, 3, 3).
            rates: Rotation vectors per length [rad/m], (n, 3).
            axis_only: Turning about the tool axis is free.
            follows: It follows the tangent.
        """
        n = len(lengths)
        return cls(
            breaks=np.concatenate([[0.0], np.cumsum(lengths)]),
            starts=starts,
            first=rates,
            second=np.zeros((n, 3)),
            f=np.tile(LINEAR, (n, 1)),
            g=np.zeros((n, 4)),
            axis_only=axis_only,
            follows=follows,
        )

    @classmethod
    def join(cls, parts: Sequence[Orientation], lengths: Sequence[float]) -> Orientation:
        """One orientation of several in order.

        Args:
            parts: The orientations, each along a path of its own.
            lengths: Lengths of these paths [m].
        """
        offsets = np.concatenate([[0.0], np.cumsum(lengths)])
        breaks = [x.breaks[:-1] + offset for x, offset in zip(parts, offsets, strict=False)]
        return cls(
            breaks=np.concatenate([*breaks, offsets[-1:]]),
            **{
                name: np.concatenate([getattr(x, name) for x in parts])
                for name in ("starts", "first", "second", "f", "g")
            },
            axis_only=all(x.axis_only for x in parts),
            follows=all(x.follows for x in parts),
        )

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self.starts)

    def __call__(self, s: npt.ArrayLike, *, side: str = "right") -> FloatArray:
        """Rotation matrices at arc lengths, `s.shape + (3, 3)`."""
        at = np.asarray(s, dtype=np.float64)
        i = self.locate(at, side=side)
        return self.on_piece(i, at - self.breaks[i])

    def rates(self, s: npt.ArrayLike, *, side: str = "right") -> tuple[FloatArray, FloatArray]:
        """How the tool turns: rate [rad/m] and its derivative [rad/m²], `s.shape + (3,)` each.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the piece after a break, "left" for the piece before the break.
        """
        at = np.asarray(s, dtype=np.float64)
        i = self.locate(at, side=side)
        return self.rates_on_piece(i, at - self.breaks[i])

    def locate(self, s: npt.ArrayLike, *, side: str = "right") -> IntArray:
        """Index of the piece that contains each arc length.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the piece after a break, "left" for the piece before the break.
        """
        found = np.searchsorted(self.breaks, s, side=_checks.side(side)) - 1
        return np.clip(found, 0, len(self) - 1)

    def on_piece(self, i: IntArray, u: FloatArray) -> FloatArray:
        """Rotation matrices at distance `u` after the start of piece `i`.

        Args:
            i: Indices of pieces, (n,).
            u: Distances from the starts of these pieces [m], (n,).
        """
        if self.fixed:
            return np.array(self.starts[i])
        turn = exp(_value(self.f[i], u)[..., None] * self.first[i])
        back = exp(_value(self.g[i], u)[..., None] * self.second[i])
        return np.asarray(back @ turn @ self.starts[i])

    def rates_on_piece(self, i: IntArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Rate of turning and its derivative at distance `u` after the start of piece `i`.

        Args:
            i: Indices of pieces, (n,).
            u: Distances from the starts of these pieces [m], (n,).
        """
        if self.fixed:
            return np.zeros((*np.shape(u), 3)), np.zeros((*np.shape(u), 3))
        g, dg, ddg = (_value(self.g[i], u, order)[..., None] for order in range(3))
        df, ddf = (_value(self.f[i], u, order)[..., None] for order in (1, 2))
        second = self.second[i]
        # The first rotation's axis is carried round by the second rotation.
        first = np.einsum("...ij,...j->...i", exp(g * second), self.first[i])
        rate = dg * second + df * first
        change = ddg * second + ddf * first + df * dg * np.cross(second, first)
        return np.asarray(rate), np.asarray(change)

    @property
    def jumps(self) -> FloatArray:
        """Angle by which the orientation jumps at every inner break [rad], (n - 1,)."""
        i = np.arange(len(self) - 1)
        before = self.on_piece(i, np.diff(self.breaks)[:-1])
        after = self.on_piece(i + 1, np.zeros(len(i)))
        if self.axis_only:
            return angle_between(before[:, :, 2], after[:, :, 2])
        size = np.linalg.norm(before - after, axis=(1, 2)) / np.sqrt(8)
        return np.asarray(2 * np.arcsin(np.minimum(size, 1.0)))

    @property
    def kinks(self) -> FloatArray:
        """Amount by which the rate jumps at every inner break [rad/m], 0 for rounding, (n - 1,)."""
        if self.fixed:
            return np.zeros(len(self) - 1)
        i = np.arange(len(self) - 1)
        before, ending = self.rates_on_piece(i, np.diff(self.breaks)[:-1])
        after, beginning = self.rates_on_piece(i + 1, np.zeros(len(i)))
        step = after - before
        if self.axis_only:
            axis = self.on_piece(i + 1, np.zeros(len(i)))[:, :, 2]
            step = step - np.sum(step * axis, axis=1, keepdims=True) * axis
        kink = np.linalg.norm(step, axis=1)
        size = np.linalg.norm(before, axis=1) + np.linalg.norm(after, axis=1)
        # On a tight corner a rate changes by much within the last digit of an arc length.
        change = np.linalg.norm(ending, axis=1) + np.linalg.norm(beginning, axis=1)
        play = SAME_RATE * size + RATE_FLOOR + ROUNDING * self.breaks[1:-1] * change
        return np.asarray(np.where(kink > play, kink, 0.0))

    @property
    def stops(self) -> FloatArray:
        """Arc lengths at which the rate jumps, (k,): no motion passes them moving."""
        return self.breaks[1:-1][(self.kinks > 0) | (self.jumps > SAME_ORIENTATION)]

    def cut(self, begin: float, length: float, shortest: float) -> Orientation:
        """The orientation along a part of the path.

        Args:
            begin: Arc length at which the part starts [m].
            length: Length of the part [m].
            shortest: Pieces up to this length are left out [m].
        """
        breaks = self.breaks - begin
        i = np.flatnonzero((breaks[1:] > shortest) & (breaks[:-1] < length - shortest))
        rows = {x: getattr(self, x)[i].copy() for x in ("starts", "first", "second", "f", "g")}
        before = max(-float(breaks[i[0]]), 0.0)
        if before > 0:
            # A piece starts with its own rotation; what g has turned so far carries the axis of f.
            rows["starts"][0] = self.on_piece(i[:1], np.array([before]))[0]
            for c in (rows["f"], rows["g"]):
                c[0] = _shift_cubic(c[0], before)
            turned = exp(rows["g"][0, 0] * self.second[i[:1]])[0]
            rows["first"][0] = turned @ rows["first"][0]
            rows["f"][0, 0] = rows["g"][0, 0] = 0.0
        ends = np.concatenate([[0.0], breaks[i[1:]], [length]])
        return dataclasses.replace(self, breaks=ends, **rows)

    def reverse(self) -> Orientation:
        """From its end to its start; each piece starts with the rotation that it ends with."""
        lengths = np.diff(self.breaks)
        at_end = [
            np.array([_shift_cubic(c, u) for c, u in zip(x, lengths, strict=True)])
            for x in (self.f, self.g)
        ]
        back = exp(at_end[1][:, :1] * self.second)
        # f(end) - f(end - u), about the axis turned round.
        f, g = (-x * [0, -1, 1, -1] for x in at_end)
        return dataclasses.replace(
            self,
            breaks=np.concatenate([[0.0], np.cumsum(lengths[::-1])]),
            starts=self.on_piece(np.arange(len(self)), lengths)[::-1],
            first=-np.einsum("nij,nj->ni", back, self.first)[::-1],
            second=-self.second[::-1],
            f=f[::-1],
            g=g[::-1],
        )

    def place(self, rotation: FloatArray, scale: float) -> Orientation:
        """The orientation along a path that is scaled and then turned.

        Args:
            rotation: Rotation matrix, (3, 3).
            scale: Factor of lengths.
        """
        return dataclasses.replace(
            self,
            breaks=self.breaks * scale,
            starts=rotation @ self.starts,
            first=self.first @ rotation.T,
            second=self.second @ rotation.T,
            f=self.f / scale ** np.arange(4),
            g=self.g / scale ** np.arange(4),
        )


def _shift_cubic(c: FloatArray, by: float) -> FloatArray:
    """Coefficients of the cubic polynomial with `u + by` in the place of u."""
    a0, a1, a2, a3 = c
    return np.array(
        [
            a0 + by * (a1 + by * (a2 + by * a3)),
            a1 + by * (2 * a2 + 3 * by * a3),
            a2 + 3 * by * a3,
            a3,
        ]
    )


def _value(c: FloatArray, u: FloatArray, order: int = 0) -> FloatArray:
    """A cubic polynomial or its derivative; coefficients (..., 4)."""
    if order == 0:
        return np.asarray(c[..., 0] + u * (c[..., 1] + u * (c[..., 2] + u * c[..., 3])))
    if order == 1:
        return np.asarray(c[..., 1] + u * (2 * c[..., 2] + u * 3 * c[..., 3]))
    return np.asarray(2 * c[..., 2] + u * 6 * c[..., 3])
