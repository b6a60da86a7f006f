"""Joint paths along which dq_ds of all joints vanishes somewhere, with a parameter that suits.

Such a place is a fault of the parameter, not of the curve: `q = d s³` is a straight line. Near it,
ds has no bound although the joints are slow, so nothing can be planned in s. In place of s:

- `q ~ s²` can keep s: ds is finite there, while the joints rest.
- Straight pieces take the length in joint space, exactly. They turn round at a full stop, and pass
  a place at which they do not turn. So do straight pieces whose dq_ds nearly vanishes: there, ds is
  so large that no affordable grid resolves how it changes.
- Bent pieces with `q ~ s³` or `s⁴` take p with `s ~ p^(2/3)` or `p^(1/2)` near that place, so that
  `q ~ p²`. The curvature of the curve has no bound there, so that the joints have to rest.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import comb

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.motion import JointPath, quintic
from armcontour.planning._vanishing import moves_on, standing_breaks

# dq_ds counts as zero below this share of the sum of its terms: a double root is known to 1e-8.
VANISHED = 1e-9
# In straight pieces, dq_ds nearly vanishes below this share.
SMALL = 1e-2
# A piece is straight if it leaves its line by no more than rounding [rad], or by this share.
STRAIGHT = 1e-12
ROUNDING = 4e-15
# Bent pieces are replaced up to this share of their length, by quintics between p in ratio RATIO
# from the share FIRST on. They leave the curve by at most 1e-12 of the piece's size.
LAST, FIRST, RATIO = 0.05, 1e-3, 0.8

# Takes coefficients in x to those in 1 - x.
REVERSED = np.array([[comb(k, m) * (-1.0) ** m for k in range(6)] for m in range(6)])

Polynomials = tuple[FloatArray, FloatArray]  # lengths, (n,), and coefficients, (n, 6, dof)


def stands_at(joint_path: JointPath) -> BoolArray:
    """Whether dq_ds of all joints vanishes at each break, (n + 1,): joints rest there at any ds."""
    return standing_breaks(joint_path.coefficients, VANISHED)


def reparametrize(joint_path: JointPath) -> tuple[JointPath, FloatArray]:
    """The same curve with a parameter in which a plan can be made; most paths are returned as is.

    And the places of the breaks of the path in the new parameter, (pieces + 1,).

    Args:
        joint_path: A joint path without a tool path; traced ones, along which the tool moves
            evenly, are returned as they are.

    Raises:
        InvalidInput: No joint moves along the whole path.
    """
    same = joint_path, joint_path.breaks
    if joint_path.tool_path is not None:
        return same
    coefficients = joint_path.coefficients
    moving = np.empty(len(coefficients), np.bool_)
    if moves_on(coefficients, VANISHED, SMALL, moving):
        return same
    if not coefficients[:, 1:].any():
        raise InvalidInput("No joint moves along the joint path: there is nothing to plan.")
    # Only straight pieces, and those that begin or end with x³ or more, may be unsuited.
    doubtful = np.flatnonzero(~moving)
    c = coefficients[doubtful]
    both = np.stack([np.linalg.norm(_terms(x), axis=2) for x in (c, REVERSED @ c)])
    slow = (both[..., :2] <= VANISHED * both.sum(axis=2, keepdims=True)).all(axis=2).any(axis=0)
    suspect = doubtful[slow | _straight(c)[0]]
    found = {int(i): _Piece.of(joint_path, int(i)) for i in suspect}
    unsuited = {i for i, x in found.items() if x.is_unsuited()}
    if not unsuited:
        return same
    pieces = {i: _Piece.of(joint_path, i) for i in range(len(coefficients))}
    return _with(joint_path, {i: x for i, x in pieces.items() if x.is_straight or i in unsuited})


def _with(joint_path: JointPath, changed: dict[int, _Piece]) -> tuple[JointPath, FloatArray]:
    """The path with some of its pieces replaced, and the places of its breaks; stops stay."""
    straight = [x for x in changed.values() if x.is_straight]
    # Where nothing else says how fast p is, straight pieces keep their length on the whole.
    total = sum(x.width for x in straight)
    slope = (
        sum(float(np.abs(np.diff(_turns(x.along, x.inner)[1])).sum()) for x in straight) / total
        if total
        else 1.0
    )
    lengths, coefficients, starts = [], [], []
    width = np.diff(joint_path.breaks)
    count = 0
    for i in range(len(width)):
        starts.append(count)
        own = (width[i : i + 1], joint_path.coefficients[i : i + 1])
        free = [k in changed and changed[k].is_straight for k in (i - 1, i + 1)]
        for length, polynomial in changed[i].replaced(slope, free) if i in changed else (own,):
            lengths.append(length)
            coefficients.append(polynomial)
            count += len(length)
    if not count:
        raise InvalidInput("No joint moves along the joint path: there is nothing to plan.")
    breaks = joint_path.breaks[0] + np.concatenate([[0.0], np.cumsum(np.concatenate(lengths))])
    stops = breaks[np.array(starts)[np.searchsorted(joint_path.breaks, joint_path.stops)]]
    inner = stops[(stops > breaks[0]) & (stops < breaks[-1])]
    path = JointPath(
        breaks=breaks, coefficients=np.concatenate(coefficients), stops=np.unique(inner)
    )
    return path, breaks[[*starts, count]]


@dataclass(frozen=True, slots=True)
class _Piece:
    """One polynomial piece, as a function of x from 0 to 1.

    Args:
        width: Its length in s.
        coefficients: Of q, (6, dof).
        line: Direction in which it moves most, a unit vector, (dof,).
        along: Coefficients of the position along this direction, (6,).
        is_straight: Whether it moves along this direction only.
        inner: Places x inside at which the velocity along this direction vanishes.
        degrees: Lowest power of x in q at both ends: 1 where dq_ds does not vanish.
    """

    width: float
    coefficients: FloatArray
    line: FloatArray
    along: FloatArray
    is_straight: bool
    inner: FloatArray
    degrees: tuple[int, int]

    @classmethod
    def of(cls, joint_path: JointPath, i: int) -> _Piece:
        """Examine one piece."""
        c = joint_path.coefficients[i]
        (straight,), (line,) = _straight(c[None])
        along = np.concatenate([[0.0], c[1:] @ line])
        return cls(
            float(joint_path.breaks[i + 1] - joint_path.breaks[i]),
            c,
            line,
            along,
            bool(straight),
            _critical(along),
            (_degree(c), _degree(_reversed(c))),
        )

    def is_unsuited(self) -> bool:
        """Whether no plan can be made in s, or none as good as along the length of a line."""
        return max(self.degrees) > 2 or self.is_straight and _is_slow(self.along)

    def replaced(self, slope: float, free: Sequence[bool]) -> Iterator[Polynomials]:
        """Polynomials in another parameter, in order.

        Args:
            slope: Size of dq_dp at ends that are free.
            free: Whether the start, and the end, need not go on as evenly as s.
        """
        if self.is_straight:
            yield from self._runs(slope, free)
        else:
            yield from self._eased()

    def _runs(self, slope: float, free: Sequence[bool]) -> Iterator[Polynomials]:
        """A straight piece from reversal to reversal, with dq_dp linear in p.

        At ends that are not free dq_dp is dq_ds, so that p goes on as s does, unless it vanishes.
        """
        x, at = _turns(self.along, self.inner)
        q = x[:, None] ** np.arange(6) @ self.coefficients
        slopes = np.full((len(x), 2), slope)
        if self.degrees[0] == 1 and not free[0]:
            slopes[0] = abs(self.along[1]) / self.width
        if self.degrees[1] == 1 and not free[1]:
            slopes[-1] = abs(float(np.arange(6) @ self.along)) / self.width
        for k in range(len(x) - 1):
            rise, (begin, end) = abs(at[k + 1] - at[k]), (slopes[k, 1], slopes[k + 1, 0])
            if rise == 0:
                continue
            c, way = np.zeros((1, 6, len(self.line))), q[k + 1] - q[k]
            c[0, 0] = q[k]
            c[0, 1], c[0, 2] = way * 2 * begin / (begin + end), way * (end - begin) / (begin + end)
            yield np.array([2 * rise / (begin + end)]), c

    def _eased(self) -> Iterator[Polynomials]:
        """A bent piece, with p in place of s next to ends at which q begins with x³ or x⁴."""
        first, last = (LAST if degree > 2 else 0.0 for degree in self.degrees)
        if first:
            yield _ease(self.coefficients, self.degrees[0], self.width)
        yield np.array([self.width * (1 - first - last)]), _cut(self.coefficients, first, 1 - last)
        if last:
            width, c = _ease(_reversed(self.coefficients), self.degrees[1], self.width)
            yield width[::-1], np.stack([_reversed(x) for x in c[::-1]])


def _ease(c: FloatArray, degree: int, width: float) -> Polynomials:
    """The first part of a piece that begins with x³ or x⁴, where p is x to the half of that power.

    At the end of the part, p grows as s does.
    """
    power = 2 / degree
    count = int(np.ceil(np.log(FIRST / LAST) / power / np.log(RATIO))) + 1
    x = np.append(0.0, np.geomspace(FIRST, LAST, count))
    # x = LAST (p / whole)^power, with dx/dp = 1 at the end; p = 0 has its limits.
    whole = LAST * power
    p = whole * (x / LAST) ** (1 / power)
    inner = x[1:]
    dx = (inner / LAST) ** (1 - 1 / power)
    ddx = (power - 1) * dx / p[1:]
    powers = [np.polynomial.polynomial.polyvander(inner, 5 - k) for k in range(3)]
    slopes = _derived(c)
    q, slope, bend = powers[0] @ c, powers[1] @ slopes, powers[2] @ _derived(slopes)
    begins = 2 * c[degree] * (LAST / whole**power) ** degree
    q = np.vstack([c[0], q])
    first = np.vstack([np.zeros_like(c[0]), slope * dx[:, None]])
    second = np.vstack([begins, bend * dx[:, None] ** 2 + slope * ddx[:, None]])
    begin, end = (q[:-1], first[:-1], second[:-1]), (q[1:], first[1:], second[1:])
    return np.diff(p) * width, quintic(np.diff(p), begin, end)


def _straight(c: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Whether pieces move along a line only, (n,), and in which direction, (n, dof).

    Args:
        c: Coefficients of the pieces, (n, 6, dof).
    """
    size = np.linalg.norm(c[:, 1:], axis=2)
    most = size.max(axis=1)
    largest = c[np.arange(len(c)), 1 + size.argmax(axis=1)]
    line = largest / np.where(most > 0, most, 1.0)[:, None]
    along = np.einsum("nkj,nj->nk", c[:, 1:], line)
    off = np.abs(c[:, 1:] - along[..., None] * line[:, None]).max(axis=(1, 2))
    return off <= ROUNDING * (1 + np.abs(c[:, 0]).max(axis=1)) + STRAIGHT * most, line


def _terms(coefficients: FloatArray) -> FloatArray:
    """The terms of dq/dx at x = 1, (..., 5, dof)."""
    return np.asarray(coefficients[..., 1:, :] * np.arange(1.0, 6.0)[:, None])


def _derived(c: FloatArray) -> FloatArray:
    """Coefficients of the derivative."""
    return np.asarray((c[1:].T * np.arange(1.0, len(c))).T)


def _reversed(c: FloatArray) -> FloatArray:
    """Coefficients in 1 - x of the polynomial with the coefficients c in x."""
    return np.asarray(REVERSED @ c)


def _cut(c: FloatArray, first: float, last: float) -> FloatArray:
    """Coefficients on the part from x = first to last, as a function from 0 to 1, (1, 6, dof)."""
    found = np.zeros_like(c)
    for row in c[::-1]:
        # Horner's rule for polynomials: times `first + (last - first) x`, plus the next one.
        found[1:] = found[1:] * first + found[:-1] * (last - first)
        found[0] = found[0] * first + row
    return found[None]


def _degree(c: FloatArray) -> int:
    """Lowest power of x that is more than rounding, beyond the constant; 5 if there is none."""
    size = np.linalg.norm(_terms(c[None])[0], axis=1)
    above = np.flatnonzero(size > VANISHED * size.sum())
    return 1 + int(above[0]) if len(above) else 5


def _critical(along: FloatArray) -> FloatArray:
    """Places inside, at which the derivative of a polynomial vanishes; double ones count too."""
    derivative = _derived(along)
    real = _inner_roots(derivative)
    value = np.polynomial.polynomial.polyval(real, derivative)
    return np.asarray(real[np.abs(value) <= VANISHED * np.abs(derivative).sum()])


def _is_slow(along: FloatArray) -> bool:
    """Whether the derivative of a polynomial nearly vanishes at an end or where it is extreme."""
    derivative = _derived(along)
    x = np.concatenate([[0.0], _inner_roots(_derived(derivative)), [1.0]])
    least = np.abs(np.polynomial.polynomial.polyval(x, derivative)).min()
    return bool(least <= SMALL * np.abs(derivative).sum())


def _inner_roots(c: FloatArray) -> FloatArray:
    """Real parts, between 0 and 1, of the roots of a polynomial with these coefficients."""
    if not c.any():
        return np.empty(0)
    real = np.polynomial.polynomial.polyroots(np.trim_zeros(c, "b")).real
    return np.unique(real[(real > 0) & (real < 1)])


def _turns(along: FloatArray, inner: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places and values of the ends and reversals of a polynomial on [0, 1]."""
    x = np.concatenate([[0.0], inner, [1.0]])
    value = np.polynomial.polynomial.polyval(x, along)
    small = STRAIGHT * float(np.abs(along).sum())
    kept = [0]
    for k in range(1, len(x)):
        step = value[k] - value[kept[-1]]
        if len(kept) > 1 and step * (value[kept[-1]] - value[kept[-2]]) >= 0:
            kept[-1] = k  # it goes on in the same direction
        elif abs(step) > small:
            kept.append(k)
    if kept[-1] != len(x) - 1:
        kept[-1 if len(kept) > 1 else 0] = len(x) - 1
    return x[kept], value[kept]
