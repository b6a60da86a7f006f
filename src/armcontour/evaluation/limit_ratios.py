"""The largest used share of every limit in a planned motion.

Between two breaks a law is smooth. Shares of limits are computed on both sides of every break and
at places between them; where the parabola through three of these is highest, they are computed
again, with narrower parabolas. The formulas are those of `check`, which asks many random places
instead.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm, Limits
from armcontour.evaluation.checking_laws import (
    CHUNK,
    find_known_jerks,
    offer_path_jerk,
    offer_states,
)
from armcontour.evaluation.tally import Tally, share_of
from armcontour.motion import PathLaw, Trajectory

# Places in each interval of a law, its ends included: so many at least, and no more unless all
# intervals together have fewer than FEWEST; those with fewer than ENOUGH have more than the least.
LEAST_PLACES, MOST_PLACES = 3, 20
FEWEST, ENOUGH = 4000, 12_000
# So many of the highest parabolas are looked at more closely, so often, each time so much narrower.
PEAKS, ROUNDS, NARROWER = 12, 2, 1 / 16
# They are at least this share of an interval away from its ends, which are known.
INSIDE = 1e-9


def measure_limit_ratios(trajectory: Trajectory, arm: Arm, limits: Limits) -> dict[str, float]:
    """Measure the largest used share of every limit: 1 is the limit.

    In a program, limits of the tool count along contours, limits of the joints in every move.

    Args:
        trajectory: The planned motion.
        arm: The arm.
        limits: The limits, with one value per joint.

    Returns:
        A share for the field of every limit that is given and can be judged.
    """
    found: dict[str, float] = {}
    for motion, bounds in _parts(trajectory, limits):
        for name, ratio in _largest_shares(motion, _Shares(arm, bounds)).items():
            found[name] = max(ratio, found.get(name, ratio))
    return found


def _parts(trajectory: Trajectory, limits: Limits) -> Iterator[tuple[Trajectory, Limits]]:
    """Motions, each with the limits that hold in all of it."""
    if all(x.kind == "contour" for x in trajectory.spans):
        yield trajectory, limits
        return
    yield trajectory, limits.of_joints
    for span in trajectory.contour_spans:
        if span.trajectory is not None:
            yield span.trajectory, limits.of_tool


class _Shares(Tally):
    """A tally that keeps all shares instead of the largest ones.

    Attributes:
        shares: The shares of each limit that were offered last, (n, joints or 1).
    """

    def __init__(self, arm: Arm, limits: Limits) -> None:
        super().__init__(arm, limits, None, None)
        self.shares: dict[str, FloatArray] = {}

    def offer(
        self,
        name: str,
        t: FloatArray,
        value: FloatArray,
        limit: npt.ArrayLike,
        q: FloatArray,
        error: npt.ArrayLike = 0.0,
        zero: FloatArray | float = 0.0,
    ) -> float:
        """Keep the shares of a limit; arguments as of every tally."""
        if value.size:
            self.shares[name] = share_of(value, limit, zero).reshape(len(value), -1)
        return 0.0

    def centripetal(
        self,
        t: FloatArray,
        velocity: FloatArray,
        acceleration: FloatArray,
        q: FloatArray,
        error: FloatArray,
        where: BoolArray,
    ) -> float:
        """Keep the shares of tool accelerations normal to `velocity`: 0 where the tool rests."""
        name = "centripetal_acceleration"
        super().centripetal(t, velocity, acceleration, q, error, where)
        if name in self.shares:
            moving = self.shares[name]
            self.shares[name] = np.zeros((len(t), 1))
            self.shares[name][where] = moving
        return 0.0

    def at(self, motion: Trajectory, right: FloatArray, left: FloatArray) -> dict[str, FloatArray]:
        """Shares of all limits on the right side of times, then on the left side of others [s]."""
        self.shares = {}
        jerks = find_known_jerks(motion, self.limits, motion.starts[:1])
        states = offer_states(motion, self, right, left, jerks)
        if "path_jerk" in jerks:
            offer_path_jerk(motion, self, right, left, states)
        return self.shares


def _largest_shares(motion: Trajectory, shares: _Shares) -> dict[str, float]:
    """The largest share of every limit in a motion."""
    breaks = _smooth_pieces(motion)
    few, enough = (-(-x // (len(breaks) - 1)) for x in (FEWEST, ENOUGH))
    places = max(LEAST_PLACES, few, min(MOST_PLACES, enough))
    part = np.linspace(0.0, 1.0, places)[:, None]
    size = max(1, CHUNK // places)
    best: dict[str, float] = {}
    peaks: dict[str, list[FloatArray]] = {}
    for first in range(0, len(breaks) - 1, size):
        ends = breaks[first : first + size + 1]
        t = ends[:-1] + part * np.diff(ends)
        t[-1] = ends[1:]
        for name, values in shares.at(motion, t[:-1].ravel(), t[-1]).items():
            best[name] = max(best.get(name, -np.inf), float(values.max()))
            found = _find_peaks(t, values.reshape(*t.shape, -1), best[name])
            peaks.setdefault(name, []).append(found)
    _climb(motion, shares, best, {x: _highest(np.hstack(y)) for x, y in peaks.items()})
    return best


def _smooth_pieces(motion: Trajectory) -> FloatArray:
    """Times between which both the laws and their joint paths are smooth [s]."""
    found = [motion.breaks]
    for law, start in zip(motion.laws, motion.starts[:-1], strict=True):
        if isinstance(law, PathLaw):
            # Those of most laws are breaks of the law, too.
            passed = np.setdiff1d(law.joint_path.breaks, law.s)
            passed = passed[(passed > law.s[0]) & (passed < law.s[-1])]
            found.append(start + law.reach(passed)[1])
    return np.unique(np.concatenate(found))


def _find_peaks(t: FloatArray, values: FloatArray, least: float) -> FloatArray:
    """The highest parabolas through three neighbouring places of an interval, above `least`.

    Args:
        t: Evenly spaced times of every interval [s], (places, n).
        values: Shares there, (places, n, columns).
        least: Lower parabolas do not count.

    Returns:
        Of each the height, when it is highest [s], half its width [s], the ends of its interval [s]
        and the column, (6, m).
    """
    before, middle, after = values[:-2], values[1:-1], values[2:]
    bend, tilt = before - 2 * middle + after, (after - before) / 2
    # Elsewhere the highest place is an end.
    round_ = np.flatnonzero((bend < 0) & (np.abs(tilt) < -bend))
    bend, tilt = bend.flat[round_], tilt.flat[round_]
    height = middle.flat[round_] - tilt**2 / (2 * bend)
    at, which, column = np.unravel_index(round_, middle.shape)
    half = t[1, which] - t[0, which]
    when = t[at + 1, which] - tilt / bend * half
    rows = np.stack([height, when, half, t[0, which], t[-1, which], column])
    return _highest(rows[:, height > least])


def _highest(peaks: FloatArray) -> FloatArray:
    """The highest of the peaks from `_find_peaks`."""
    return peaks[:, np.argsort(-peaks[0], kind="stable")[:PEAKS]]


def _climb(
    motion: Trajectory, shares: _Shares, best: dict[str, float], peaks: dict[str, FloatArray]
) -> None:
    """Raise the largest shares to those at peaks from `_find_peaks`."""
    rows = np.hstack([np.zeros((6, 0)), *peaks.values()])
    if not rows.size:
        return
    _, t, half, low, high, column = rows
    of = np.repeat(np.arange(len(peaks)), [x.shape[1] for x in peaks.values()])
    margin = INSIDE * (high - low)
    for _ in range(ROUNDS):
        t = np.clip(t, low + margin, high - margin)
        half = np.minimum(NARROWER * half, np.minimum(t - low, high - t) / 2)
        found = shares.at(motion, (t + half * [[-1], [0], [1]]).ravel(), np.zeros(0))
        for k, name in enumerate(peaks):
            mine = np.flatnonzero(of == k)
            values = found[name].reshape(3, len(t), -1)[:, mine, column[mine].astype(np.intp)]
            best[name] = max(best[name], float(values.max(initial=-np.inf)))
            bend, tilt = values[0] - 2 * values[1] + values[2], (values[2] - values[0]) / 2
            with np.errstate(divide="ignore", invalid="ignore"):
                step = np.where(bend < 0, np.clip(-tilt / bend, -1, 1), np.sign(tilt))
            t[mine] += step * half[mine]
