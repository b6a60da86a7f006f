"""Piecewise polynomial path in joint space."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.quantities import Axes, Choice
from armcontour.core.quintics import evaluate, quintic
from armcontour.core.text import short_repr
from armcontour.geometry import Path
from armcontour.motion.kernels import JointDerivatives, examine_pieces, joint_motions, spline_pieces

# Rounding error in differences between arc lengths, divided by the largest arc length.
ARC_LENGTH_ROUNDING = 4 * float(np.finfo(np.float64).eps)
# Largest permitted jump of a position at a break [rad]; no robot resolves it.
LARGEST_JUMP = 1e-6
# Smallest difference between two spline parameters, divided by the largest one. Points that are
# repeated up to rounding errors have parameters that differ by less.
REPEATED = 1e-12
# Largest relative jump of dq_ds at a break without a stop; traced paths have errors of this size.
LARGEST_SLOPE_JUMP = 1e-6
# A dq_ds below this fraction of its summed terms is a rounding error, whose direction is random.
NO_DIRECTION = 1e-12
NO_STOPS = checks.frozen_array([])


@declared(eq=False)
class JointPath(Checked):
    """Joint positions as a function of arc length, a quintic per interval, with derivatives.

    In interval i, `q(s) = sum_k coefficients[i, k] x^k` with `x = (s - breaks[i]) / width_i`.

    >>> joint_path = ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)])
    >>> joint_path(joint_path.length / 2).shape
    (2,)

    Args:
        breaks: Arc lengths at the interval ends [m], (n + 1,); without a tool path, values of any
            parameter s.
        coefficients: Coefficients of the quintics [rad], (n, 6, dof).
        stops: Breaks at which the motion must stop [m], by default none; breaks at which dq_ds
            jumps are added.
        tool_path: The tool path that was traced, or None.

    Raises:
        InvalidInput: The arrays have wrong shapes or are not finite, breaks do not increase, a
            stop is not an inner break, or a position jumps.
    """

    breaks: Annotated[FloatArray, Axes("breaks")]
    coefficients: Annotated[FloatArray, Axes("intervals", 6, "joints")]
    stops: Annotated[FloatArray, Axes("stops")] = field(default_factory=lambda: NO_STOPS)
    tool_path: Path | None = None

    def _check_together(self) -> None:
        n = len(self.breaks) - 1
        if n < 1 or len(self.coefficients) != n:
            raise InvalidInput(
                "coefficients of a joint path must be of shape (intervals, 6, dof), with one "
                f"interval less than breaks, but there are {len(self.coefficients)} intervals and "
                f"{len(self.breaks)} breaks."
            )
        kinks = np.empty(n - 1, dtype=np.bool_)
        sound, jump = examine_pieces(
            self.breaks, self.coefficients, LARGEST_SLOPE_JUMP, NO_DIRECTION, kinks
        )
        if not sound:
            raise InvalidInput("A joint path must be finite and its breaks must increase.")
        if jump > LARGEST_JUMP:
            jumps = np.abs(self.coefficients[:-1].sum(axis=1) - self.coefficients[1:, 0])
            i, j = (int(x) for x in np.unravel_index(int(np.argmax(jumps)), jumps.shape))
            s = float(self.breaks[i + 1])
            raise InvalidInput(
                f"Joint {j + 1} jumps by {jump:.3g} rad or m at s = {s:g}. A joint path must be "
                "continuous.",
                s=s,
                joint=j,
                needed=jump,
                allowed=LARGEST_JUMP,
            )
        if len(self.stops) or kinks.any():
            object.__setattr__(self, "stops", checks.frozen_array(self._all_stops(kinks)))

    __repr__ = short_repr

    def _all_stops(self, kinks: BoolArray) -> FloatArray:
        """Return the specified stops, and the inner breaks at which dq_ds jumps."""
        inner = self.breaks[1:-1]
        is_break = np.isin(self.stops, inner)
        if not is_break.all():
            stop = self.stops[np.argmin(is_break)]
            raise InvalidInput(
                f"The stops must be inner breaks of the joint path, but s = {stop:g} is not one of "
                "them."
            )
        return np.union1d(self.stops, inner[kinks]) if kinks.any() else self.stops

    @classmethod
    def hermite(
        cls,
        breaks: FloatArray,
        begin: tuple[FloatArray, FloatArray, FloatArray],
        end: tuple[FloatArray, FloatArray, FloatArray],
        *,
        stops: FloatArray = NO_STOPS,
        tool_path: Path | None = None,
    ) -> JointPath:
        """Make the path of quintics with specified q, dq_ds and d2q_ds2 at all interval ends.

        Args:
            breaks: Arc lengths at the interval ends [m], (n + 1,).
            begin: q, dq_ds and d2q_ds2 at the start of every interval, (n, dof) each.
            end: q, dq_ds and d2q_ds2 at the end of every interval, (n, dof) each.
            stops: Arc lengths at which the motion must stop [m], (m,); by default none.
            tool_path: The tool path that was traced, or None.

        Raises:
            InvalidInput: As for the class, or the shapes differ.
        """
        knots = checks.shaped("breaks of a joint path", breaks, (None,))
        checks.raise_if(len(knots) < 2, "A joint path needs at least two breaks.")
        first = _check_ends("begin", begin, (len(knots) - 1, None))
        last = _check_ends("end", end, first[0].shape)
        all_stops = checks.shaped("stops", stops, (None,), "m")
        if tool_path is not None:
            checks.check_type("tool_path", tool_path, Path)
        rounding = ARC_LENGTH_ROUNDING * float(np.abs(knots).max())
        # The coefficients become read-only without a copy, because a long path has many.
        joint_path = checks.make_unchecked(
            cls,
            breaks=checks.frozen_array(knots),
            coefficients=quintic(np.diff(knots), first, last, rounding),
            stops=checks.frozen_array(all_stops),
            tool_path=tool_path,
        )
        joint_path._check_together()
        return joint_path

    @classmethod
    @checked
    def spline(
        cls,
        points: npt.ArrayLike,
        s: npt.ArrayLike | None = None,
        *,
        ends: Annotated[str, Choice(("natural", "clamped"))] = "natural",
    ) -> JointPath:
        """Interpolate joint positions by a cubic spline.

        >>> ac.JointPath.spline([(0.0, 0.0), (0.3, 0.4)]).length
        0.5

        Args:
            points: At least two joint positions [rad], (n, dof).
            s: Increasing parameters of the points, (n,); by default the chord length in joint
                space [rad].
            ends: "natural", with d2q_ds2 zero at both ends, or "clamped", with dq_ds zero there.

        Raises:
            InvalidInput: There are fewer than two points, the parameters do not increase, or `ends`
                is not one of these names.
        """
        clamped = ends == "clamped"
        knots = checks.check_numbers("joint positions", points, "rad")
        if knots.ndim != 2 or len(knots) < 2:
            raise InvalidInput("A spline needs at least two rows of joint positions.")
        if s is None:
            parameters = np.concatenate(
                [[0], np.cumsum(np.linalg.norm(knots[1:] - knots[:-1], axis=1))]
            )
        else:
            parameters = checks.check_numbers("spline parameters", s)
        coefficients = np.zeros((len(knots) - 1, 6, knots.shape[1]))
        points = np.ascontiguousarray(knots)
        fits = parameters.shape == (len(knots),)
        if not (fits and spline_pieces(parameters, points, clamped, REPEATED, coefficients)):
            raise InvalidInput(
                "Spline parameters must be one per point and increase. Remove repeated points."
            )
        # The shapes are right, so only the pieces are examined.
        spline = checks.make_unchecked(
            cls, breaks=parameters, coefficients=coefficients, stops=NO_STOPS, tool_path=None
        )
        spline._check_together()
        return spline

    @property
    def length(self) -> float:
        """Length in s [m]."""
        return float(self.breaks[-1] - self.breaks[0])

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.coefficients.shape[2])

    def __call__(self, s: npt.ArrayLike, order: int = 0, *, side: str = "right") -> FloatArray:
        """Return joint positions or their derivatives with respect to s, `s.shape + (dof,)`.

        >>> ac.JointPath.spline([(0.0, 0.0), (0.3, 0.4)])(0.25, order=1)
        array([0.6, 0.8])

        Args:
            s: Arc lengths [m], any shape.
            order: Order of the derivative, 0 for the position.
            side: At a break, "right" for the interval after it, "left" for the interval before it.

        Raises:
            InvalidInput: An arc length is no number or outside the path, or the order is invalid.
        """
        low = float(self.breaks[0])
        high = float(self.breaks[-1])
        arc_lengths = checks.clip_within("arc length", s, low, high, "m", "the joint path")
        return self.on_interval(
            self.locate(arc_lengths, side=side), arc_lengths, checks.derivative(order)
        )

    def locate(self, s: npt.ArrayLike, *, side: str = "right") -> IntArray:
        """Return the index of the interval that contains each arc length.

        Args:
            s: Arc lengths [m], any shape.
            side: "right" for the interval after a break, "left" for the interval before the break.
        """
        return checks.locate(self.breaks, s, side)

    def on_interval(self, i: IntArray, s: FloatArray, order: int = 0) -> FloatArray:
        """Return the polynomial of interval `i`, or a derivative, at arc length `s`, (n, dof).

        Args:
            i: Indices of intervals, (n,).
            s: Arc lengths from the start of the path [m], (n,).
            order: Order of the derivative, 0 for the position.
        """
        width = self.breaks[i + 1] - self.breaks[i]
        return evaluate(self.coefficients[i], width, s - self.breaks[i], order)

    def motion(self, i: IntArray, s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return q, dq_ds and d2q_ds2 of interval `i` at arc length `s`, (n, dof) each.

        Args:
            i: Indices of intervals, (n,).
            s: Arc lengths from the start of the path [m], (n,).

        Raises:
            InvalidInput: An interval is invalid, or their number differs from the arc lengths.
        """
        arc_lengths = np.require(np.ravel(checks.floats("arc lengths", s, "m")), np.float64, ["W"])
        pieces = np.require(np.ravel(checks.indices("intervals", i)), np.intp, ["W"])
        last = len(self.breaks) - 2
        # Without this check, compiled code could read beyond the end of the arrays.
        if pieces.shape != arc_lengths.shape:
            raise InvalidInput(
                f"A joint path needs one interval for each arc length, but got {len(pieces)} for "
                f"{len(arc_lengths)}."
            )
        if len(pieces) and not 0 <= pieces.min() <= pieces.max() <= last:
            raise InvalidInput(
                f"Intervals must be from 0 to {last}, but are from {pieces.min()} to "
                f"{pieces.max()}."
            )
        q, first, second = np.empty((3, len(arc_lengths), self.dof))
        # The chain rule is applied with s as the time, and with each piece as a separate path.
        along = np.zeros((4, len(arc_lengths)))
        end = self.breaks[pieces + 1]
        along[0] = arc_lengths
        along[1] = 1.0
        end.setflags(write=False)
        out = JointDerivatives(q, first, second, np.empty((0, self.dof)))
        rows = np.arange(last + 2)
        joint_motions(along, end, pieces, rows, self.breaks, self.coefficients, out)
        q, first, second = (x.reshape(*np.shape(s), self.dof) for x in (q, first, second))
        return q, first, second


def _check_ends(
    name: str, ends: tuple[FloatArray, FloatArray, FloatArray], shape: tuple[int | None, ...]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return q, dq_ds and d2q_ds2 as arrays of the same shape, without a copy if possible."""
    is_sequence = isinstance(ends, tuple | list) or np.ndim(ends) > 0
    checks.raise_if(
        not is_sequence or len(ends) != 3,
        f"{name} must be three arrays of one shape (intervals, dof): q, dq_ds and d2q_ds2.",
    )
    q = checks.shaped(name, ends[0], shape)
    return q, checks.shaped(name, ends[1], q.shape), checks.shaped(name, ends[2], q.shape)
