"""Reparametrization of joint paths on which dq_ds of all joints vanishes at some point.

The point is a property of the parameter, not of the curve: `q = d s³` is a straight line. Near the
point, ds is unbounded although the joints are slow, so the path cannot be planned in s:

- Pieces with `q ~ s²` keep the parameter s, because ds is finite at the point. The joints rest.
- Straight pieces use the length in joint space. The motion stops where the piece reverses, and does
  not stop at other points. Straight pieces whose dq_ds nearly vanishes also use the length, because
  ds is so large there that no affordable grid resolves its change.
- Curved pieces with `q ~ s³` or `s⁴` use p with `s ~ p^(2/3)` or `p^(1/2)` near that point, so that
  `q ~ p²`. The curvature is unbounded there, so the joints rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.kernels import compiled
from armcontour.motion import JointPath, quintic

# A piece is curved if its distance from a straight line exceeds this value [rad] plus this share of
# its size.
CURVED = 1e-6
# Converts coefficients of dq/dx, of powers 0 to 4, to Bernstein coefficients, which enclose dq/dx.
BERNSTEIN = np.array([[comb(i, k) / comb(4, k) for k in range(5)] for i in range(5)])


@compiled()
def moves_one_way(
    coefficients: FloatArray, vanished: float, small: float, moving: BoolArray
) -> bool:
    """True if on every piece some joint moves in one direction, so that dq_ds cannot vanish."""
    # `coefficients`: coefficients of the joint path, (n, 6, dof); `vanished`: smallest dq/dx of the
    # joint on a curved piece, as a share of the sum of its terms; `small`: the same for a straight
    # piece; `moving`: output, mask of the pieces on which a joint moves in one direction, (n,).
    n, dof = coefficients.shape[0], coefficients.shape[2]
    everywhere = True
    for i in range(n):
        sizes, longest, k0 = 0.0, 0.0, 1
        for k in range(1, 6):
            square = 0.0
            for j in range(dof):
                square += coefficients[i, k, j] ** 2
            sizes += k * math.sqrt(square)
            if square > longest:
                longest, k0 = square, k
        deviation = 0.0
        for k in range(1, 6):
            along = 0.0
            for j in range(dof):
                along += coefficients[i, k, j] * coefficients[i, k0, j]
            for j in range(dof):
                difference = coefficients[i, k, j] * longest - along * coefficients[i, k0, j]
                deviation = max(deviation, abs(difference))
        is_bent = deviation > CURVED * longest * (1.0 + math.sqrt(longest))
        threshold = (vanished if is_bent else small) * sizes
        moving[i] = False
        for j in range(dof):
            low, high = math.inf, -math.inf
            for row in range(5):
                value = 0.0
                for k in range(row + 1):
                    value += BERNSTEIN[row, k] * (k + 1) * coefficients[i, k + 1, j]
                low, high = min(low, value), max(high, value)
            if max(low, -high) > threshold:
                moving[i] = True
                break
        everywhere &= moving[i]
    return everywhere


@compiled()
def resting_breaks(coefficients: FloatArray, vanished: float) -> BoolArray:
    """Mask of breaks at which dq_ds of all joints vanishes on both sides, (n + 1,)."""
    # `coefficients`: coefficients of the joint path, (n, 6, dof); `vanished`: dq_ds counts as zero
    # below this share of the sum of its terms.
    n, dof = coefficients.shape[0], coefficients.shape[2]
    resting = np.empty(n + 1, np.bool_)
    for i in range(n + 1):
        resting[i] = True
    for i in range(n):
        sizes = 0.0
        for k in range(1, 6):
            square = 0.0
            for j in range(dof):
                square += (k * coefficients[i, k, j]) ** 2
            sizes += math.sqrt(square)
        start = end = 0.0
        for j in range(dof):
            slope = 0.0
            for k in range(1, 6):
                slope += k * coefficients[i, k, j]
            start += coefficients[i, 1, j] ** 2
            end += slope**2
        resting[i] &= math.sqrt(start) <= vanished * sizes
        resting[i + 1] &= math.sqrt(end) <= vanished * sizes
    return resting


# dq_ds counts as zero below this share of the sum of its terms. A double root is accurate to 1e-8.
VANISHED = 1e-9
# dq_ds of a straight piece nearly vanishes if it is below this share of the sum of its terms.
NEARLY_VANISHED = 1e-2
# A piece is straight if its distance from a line is at most the share STRAIGHT of its size plus the
# share ROUNDING of its position.
STRAIGHT = 1e-12
ROUNDING = 4e-15
# At an end at which q begins with x³ or x⁴, the share LAST of a curved piece is replaced by
# quintics in p. The first quintic ends at x = FIRST; the p of successive breaks have the ratio
# RATIO. The error of the quintics is at most 1e-12 of the size of the piece.
LAST, FIRST, RATIO = 0.05, 1e-3, 0.8

# Converts coefficients in x to coefficients in 1 - x.
REVERSED = np.array([[comb(k, m) * (-1.0) ** m for k in range(6)] for m in range(6)])

Polynomials = tuple[FloatArray, FloatArray]  # Lengths, (n,), and coefficients, (n, 6, dof)


def rests_at_breaks(joint_path: JointPath) -> BoolArray:
    """Mask of breaks at which dq_ds vanishes, so that joints rest at any ds, (n + 1,)."""
    return resting_breaks(joint_path.coefficients, VANISHED)


def reparametrize(
    joint_path: JointPath, free_ends: tuple[bool, bool]
) -> tuple[JointPath, FloatArray]:
    """Replace the parameter of a joint path that cannot be planned in s."""
    # `free_ends`: True for the start and the end if the motion rests there, so that dq_dp is free.
    # Returns the path, and the old breaks in the new parameter, (pieces + 1,).
    same = joint_path, joint_path.breaks
    if joint_path.tool_path is not None:
        return same
    coefficients = joint_path.coefficients
    moving = np.empty(len(coefficients), np.bool_)
    if moves_one_way(coefficients, VANISHED, NEARLY_VANISHED, moving):
        return same
    if not coefficients[:, 1:].any():
        raise InvalidInput("No joint moves along the joint path, so there is nothing to plan.")
    # Only straight pieces, and pieces whose polynomial begins or ends with x³ or a higher power,
    # may need another parameter.
    doubtful = np.flatnonzero(~moving)
    c = coefficients[doubtful]
    both = np.stack([np.linalg.norm(_terms(x), axis=2) for x in (c, REVERSED @ c)])
    slow = (both[..., :2] <= VANISHED * both.sum(axis=2, keepdims=True)).all(axis=2).any(axis=0)
    suspect = doubtful[slow | _straight(c)[0]]
    suspects = {int(i): _Piece.from_path(joint_path, int(i)) for i in suspect}
    unsuited = {i for i, x in suspects.items() if x.is_unsuited()}
    if not unsuited:
        return same
    pieces = {i: _Piece.from_path(joint_path, i) for i in range(len(coefficients))}
    return _replace_pieces(
        joint_path, {i: x for i, x in pieces.items() if x.is_straight or i in unsuited}, free_ends
    )


def _replace_pieces(
    joint_path: JointPath, changed: dict[int, _Piece], free_ends: tuple[bool, bool]
) -> tuple[JointPath, FloatArray]:
    """Replace some pieces of a path; returns the path, with its stops, and its old breaks."""
    straight = [x for x in changed.values() if x.is_straight]
    # By default, |dq_dp| is such that the straight pieces have the same total length in p as in s.
    total = sum(x.width for x in straight)
    slope = (
        sum(float(np.abs(np.diff(_find_reversals(x.along, x.inner)[1])).sum()) for x in straight)
        / total
        if total
        else 1.0
    )
    lengths, coefficients, starts = [], [], []
    width = np.diff(joint_path.breaks)
    count = 0
    for i in range(len(width)):
        starts.append(count)
        unchanged = (width[i : i + 1], joint_path.coefficients[i : i + 1])
        ends = {-1: free_ends[0], len(width): free_ends[1]}
        free = [ends.get(k, k in changed and changed[k].is_straight) for k in (i - 1, i + 1)]
        for length, polynomial in (
            changed[i].reparametrized_parts(slope, free) if i in changed else (unchanged,)
        ):
            lengths.append(length)
            coefficients.append(polynomial)
            count += len(length)
    if not count:
        raise InvalidInput("No joint moves along the joint path, so there is nothing to plan.")
    breaks = joint_path.breaks[0] + np.concatenate([[0.0], np.cumsum(np.concatenate(lengths))])
    stops = breaks[np.array(starts)[np.searchsorted(joint_path.breaks, joint_path.stops)]]
    inner = stops[(stops > breaks[0]) & (stops < breaks[-1])]
    path = JointPath(
        breaks=breaks, coefficients=np.concatenate(coefficients), stops=np.unique(inner)
    )
    return path, breaks[[*starts, count]]


@dataclass(frozen=True, slots=True)
class _Piece:
    """One polynomial piece, as a function of x from 0 to 1."""

    width: float
    coefficients: FloatArray  # Coefficients of q, (6, dof)
    line: FloatArray  # Direction of the largest motion, a unit vector, (dof,)
    along: FloatArray  # Coefficients of the position along this direction, (6,)
    is_straight: bool  # True if the piece moves along this direction only
    inner: FloatArray  # Points x inside at which the velocity along this direction vanishes
    degrees: tuple[int, int]  # Lowest power of x in q at both ends: 1 if dq_ds does not vanish

    @classmethod
    def from_path(cls, joint_path: JointPath, i: int) -> _Piece:
        c = joint_path.coefficients[i]
        (straight,), (line,) = _straight(c[None])
        along = np.concatenate([[0.0], c[1:] @ line])
        return cls(
            float(joint_path.breaks[i + 1] - joint_path.breaks[i]),
            c,
            line,
            along,
            bool(straight),
            _find_stationary(along),
            (_degree(c), _degree(_reversed(c))),
        )

    def is_unsuited(self) -> bool:
        """Test whether the piece needs another parameter than s."""
        return max(self.degrees) > 2 or self.is_straight and _is_slow(self.along)

    def reparametrized_parts(self, slope: float, free: Sequence[bool]) -> Iterator[Polynomials]:
        """Yield the polynomials of the piece in another parameter, in order."""
        # `slope`: |dq_dp| at reversals and at free ends. `free`: True for an end if the
        # neighbouring piece is straight and replaced, too, or if the motion rests there, so that
        # dq_dp need not equal dq_ds.
        if self.is_straight:
            yield from self._split_at_reversals(slope, free)
        else:
            yield from self._ease_ends()

    def _split_at_reversals(self, slope: float, free: Sequence[bool]) -> Iterator[Polynomials]:
        """Yield the parts of a straight piece between its reversals, with dq_dp linear in p."""
        # At an end that is not free, dq_dp equals dq_ds, unless dq_ds vanishes.
        x, values = _find_reversals(self.along, self.inner)
        q = x[:, None] ** np.arange(6) @ self.coefficients
        slopes = np.full((len(x), 2), slope)
        if self.degrees[0] == 1 and not free[0]:
            slopes[0] = abs(self.along[1]) / self.width
        if self.degrees[1] == 1 and not free[1]:
            slopes[-1] = abs(float(np.arange(6) @ self.along)) / self.width
        for k in range(len(x) - 1):
            rise, (begin, end) = abs(values[k + 1] - values[k]), (slopes[k, 1], slopes[k + 1, 0])
            if rise == 0:
                continue
            c, step = np.zeros((1, 6, len(self.line))), q[k + 1] - q[k]
            c[0, 0] = q[k]
            c[0, 1], c[0, 2] = (
                step * 2 * begin / (begin + end),
                step * (end - begin) / (begin + end),
            )
            yield np.array([2 * rise / (begin + end)]), c

    def _ease_ends(self) -> Iterator[Polynomials]:
        """Yield a curved piece, with p instead of s near ends at which q begins with x³ or x⁴."""
        first, last = (LAST if degree > 2 else 0.0 for degree in self.degrees)
        if first:
            yield _ease(self.coefficients, self.degrees[0], self.width)
        yield np.array([self.width * (1 - first - last)]), _cut(self.coefficients, first, 1 - last)
        if last:
            width, c = _ease(_reversed(self.coefficients), self.degrees[1], self.width)
            yield width[::-1], np.stack([_reversed(x) for x in c[::-1]])


def _ease(c: FloatArray, degree: int, width: float) -> Polynomials:
    """First part of a piece that begins with x³ or x⁴, in p ~ x^(degree / 2)."""
    # At the end of the part, dp equals dx.
    power = 2 / degree
    count = int(np.ceil(np.log(FIRST / LAST) / power / np.log(RATIO))) + 1
    x = np.append(0.0, np.geomspace(FIRST, LAST, count))
    # x = LAST (p / whole)^power, with dx/dp = 1 at the end. Derivatives at p = 0 are limits.
    whole = LAST * power
    p = whole * (x / LAST) ** (1 / power)
    inner = x[1:]
    dx = (inner / LAST) ** (1 - 1 / power)
    ddx = (power - 1) * dx / p[1:]
    powers = [np.polynomial.polynomial.polyvander(inner, 5 - k) for k in range(3)]
    slopes = _derived(c)
    q, slope, curvature = powers[0] @ c, powers[1] @ slopes, powers[2] @ _derived(slopes)
    begins = 2 * c[degree] * (LAST / whole**power) ** degree
    q = np.vstack([c[0], q])
    first = np.vstack([np.zeros_like(c[0]), slope * dx[:, None]])
    second = np.vstack([begins, curvature * dx[:, None] ** 2 + slope * ddx[:, None]])
    begin, end = (q[:-1], first[:-1], second[:-1]), (q[1:], first[1:], second[1:])
    return np.diff(p) * width, quintic(np.diff(p), begin, end)


def _straight(c: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Mask of pieces that move along a line only, (n,), and their directions, (n, dof)."""
    size = np.linalg.norm(c[:, 1:], axis=2)
    largest_size = size.max(axis=1)
    largest = c[np.arange(len(c)), 1 + size.argmax(axis=1)]
    line = largest / np.where(largest_size > 0, largest_size, 1.0)[:, None]
    along = np.einsum("nkj,nj->nk", c[:, 1:], line)
    deviation = np.abs(c[:, 1:] - along[..., None] * line[:, None]).max(axis=(1, 2))
    return deviation <= ROUNDING * (1 + np.abs(c[:, 0]).max(axis=1)) + STRAIGHT * largest_size, line


def _terms(coefficients: FloatArray) -> FloatArray:
    return np.asarray(coefficients[..., 1:, :] * np.arange(1.0, 6.0)[:, None])


def _derived(c: FloatArray) -> FloatArray:
    return np.asarray((c[1:].T * np.arange(1.0, len(c))).T)


def _reversed(c: FloatArray) -> FloatArray:
    """Coefficients in 1 - x of the polynomial with the coefficients c in x."""
    return np.asarray(REVERSED @ c)


def _cut(c: FloatArray, first: float, last: float) -> FloatArray:
    """Coefficients on the part from x = first to last, as a function from 0 to 1, (1, 6, dof)."""
    coefficients = np.zeros_like(c)
    for row in c[::-1]:
        # Horner's rule with polynomials: multiply by `first + (last - first) x`, then add the next
        # row.
        coefficients[1:] = coefficients[1:] * first + coefficients[:-1] * (last - first)
        coefficients[0] = coefficients[0] * first + row
    return coefficients[None]


def _degree(c: FloatArray) -> int:
    """Lowest power of x, from 1, with a coefficient above rounding; 5 if there is none."""
    size = np.linalg.norm(_terms(c[None])[0], axis=1)
    above = np.flatnonzero(size > VANISHED * size.sum())
    return 1 + int(above[0]) if len(above) else 5


def _find_stationary(along: FloatArray) -> FloatArray:
    """Points x in (0, 1) at which the derivative of a polynomial vanishes, (points,)."""
    derivative = _derived(along)
    real = _inner_roots(derivative)
    value = np.polynomial.polynomial.polyval(real, derivative)
    return np.asarray(real[np.abs(value) <= VANISHED * np.abs(derivative).sum()])


def _is_slow(along: FloatArray) -> bool:
    """Test whether the derivative of a polynomial nearly vanishes at an end or at an extreme."""
    derivative = _derived(along)
    x = np.concatenate([[0.0], _inner_roots(_derived(derivative)), [1.0]])
    smallest = np.abs(np.polynomial.polynomial.polyval(x, derivative)).min()
    return bool(smallest <= NEARLY_VANISHED * np.abs(derivative).sum())


def _inner_roots(c: FloatArray) -> FloatArray:
    if not c.any():
        return np.empty(0)
    real = np.polynomial.polynomial.polyroots(np.trim_zeros(c, "b")).real
    return np.unique(real[(real > 0) & (real < 1)])


def _find_reversals(along: FloatArray, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Positions x and values of the ends and the reversals of a polynomial on [0, 1]."""
    x = np.concatenate([[0.0], inner, [1.0]])
    value = np.polynomial.polynomial.polyval(x, along)
    small = STRAIGHT * float(np.abs(along).sum())
    indices = [0]
    for k in range(1, len(x)):
        step = value[k] - value[indices[-1]]
        if len(indices) > 1 and step * (value[indices[-1]] - value[indices[-2]]) >= 0:
            indices[-1] = k  # the direction does not change
        elif abs(step) > small:
            indices.append(k)
    if indices[-1] != len(x) - 1:
        indices[-1 if len(indices) > 1 else 0] = len(x) - 1
    return x[indices], value[indices]
