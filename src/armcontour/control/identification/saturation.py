"""Plateaus of acceleration or velocity at which a joint saturates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.control.identification.log_segments import LogSegment
from armcontour.control.identification.measured_motion import TOP_PERCENTILE, Demand, MeasuredMotion
from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.quantities import shared_unit

# A limit is first searched within this fraction of the guess above and below it.
PLATEAU_RANGE = 0.1
# A value is at a limit if it differs from the limit by at most this fraction of the limit.
PLATEAU_SHARE = 0.01
# Number of medians within PLATEAU_SHARE by which the limit is refined.
MEDIAN_ITERATIONS = 5
# A value is also at a limit if it differs from the limit by at most so many standard deviations of
# noise.
PLATEAU_SIGMAS = 4.0
# Smallest number of successive samples in a plateau.
FEWEST_SAMPLES = 4
# Shortest duration of a plateau [s].
SHORTEST_PLATEAU = 5e-3
# On a saturated plateau, the commanded acceleration exceeds the measured acceleration by more than
# this fraction of the largest acceleration. Velocities less than this fraction below a velocity
# limit are saturated too.
EXCESS = 0.05
# On a saturated plateau, the commanded acceleration also exceeds the measured acceleration by more
# than this multiple of the RMS difference between them at the unsaturated samples.
EXCESS_ERRORS = 4.0
# Smallest fraction of saturated samples that counts as saturation.
LEAST_SHARE = 2e-3
# If a joint is at its acceleration limit for more than this fraction of the time, models with
# undetermined K_p are rejected.
MAX_LIMIT_TIME = 0.5
# If the unsaturated samples of such a joint determine no model, the times of the reversals must
# determine it. This number of reversals is sufficient, one for each of K_p, K_v, feed-forward and
# dead time.
FEWEST_REVERSALS = 4
# Margin before and after saturated samples [s], because drives react up to one drive cycle later.
MARGIN = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Saturation:
    """Acceleration or velocity limit at which a joint saturates, and the affected samples."""

    kind: str  # "acceleration" or "velocity"
    limit: float  # The limit [rad/s² or rad/s]
    sd: float  # Standard deviation of the limit [rad/s² or rad/s]
    time: float  # Time at the limit [s]
    duration: float  # Total duration of the segments [s]
    reversals: int  # Number of changes between the positive and the negative limit
    clipped: tuple[BoolArray, ...]  # Mask of the samples that the limit affects, for each segment

    @property
    def hides(self) -> bool:
        """True if the joint is at its acceleration limit for too much time, see MAX_LIMIT_TIME."""
        return self.kind == "acceleration" and self.time > MAX_LIMIT_TIME * self.duration

    @property
    def determines_servo(self) -> bool:
        """True if a model with the limit can be fitted to all samples, see FEWEST_REVERSALS."""
        few = self.hides and self.reversals < FEWEST_REVERSALS
        return self.kind == "acceleration" and not few

    def describe(self, name: str, *, prismatic: bool = False) -> str:
        """Return a clause such as "joint 2 saturates at 3 rad/s² for 0.4 s of 10 s"."""
        unit = shared_unit("rad/s²" if self.kind == "acceleration" else "rad/s", [prismatic])
        limit = f"{self.limit:.3g} {unit}"
        return f"{name} saturates at {limit} for {self.time:.2g} s of {self.duration:.3g} s"

    def explain_no_model(self, name: str, *, prismatic: bool = False) -> str:
        """Return the note on a joint whose other samples do not determine its servo."""
        lower = "accelerations" if self.kind == "acceleration" else "velocities"
        cause = self.describe("it", prismatic=prismatic)
        return (
            f"{name} has no model, because {cause}, and the other samples do not "
            f"determine its servo. Record more motion at lower {lower}."
        )


class _PlateauSearch(NamedTuple):
    """A search for plateaus in a derivative of the positions."""

    order: int  # Order of the derivative
    kind: str  # "acceleration" or "velocity"
    share: float  # Fraction of the first guess within which the limit is searched
    # Time before and after a plateau in which the limit also applies, because the joint accelerates
    # to it [s].
    transient: float


# The narrow search finds a limit above a planned plateau.
SEARCHES = (
    _PlateauSearch(2, "acceleration", PLATEAU_RANGE, 0.0),
    _PlateauSearch(2, "acceleration", 2 * PLATEAU_SHARE, 0.0),
    _PlateauSearch(1, "velocity", PLATEAU_RANGE, 0.05),
)


def find_saturation(segments: Sequence[LogSegment]) -> Saturation | None:
    """Find plateaus of acceleration or velocity that the loop commands to exceed; None if none.

    The commanded acceleration is linear in position, velocity and command. Its coefficients are
    fitted to the samples outside the plateaus. Therefore a planned plateau that the joint follows
    is not saturation.
    """
    motion = MeasuredMotion(segments)
    for search in SEARCHES:
        saturation = _find_saturated_plateaus(motion, search)
        if saturation is not None:
            return saturation
    return None


def _find_saturated_plateaus(motion: MeasuredMotion, search: _PlateauSearch) -> Saturation | None:
    """Find the saturated plateaus of one derivative; None if there are none."""
    # The test of a velocity plateau also requires the acceleration.
    windows = [motion.window(x) for x in {2, search.order}]
    if not all(windows):
        return None
    k = max(windows)
    values = motion.derive(search.order, k)
    noise = motion.noise(search.order, k)
    limit, plateaus = _find_plateaus(values, noise, search.share, motion.interval)
    if not plateaus.any():
        return None
    excluded = _widen(plateaus, 2 * k + round(search.transient / motion.interval))
    demand = motion.predict_acceleration(k, ~excluded)
    if demand is None:
        return None
    clipped = _exceeded_plateaus(values, plateaus, motion.derive(2, k), demand)
    if np.mean(clipped) < LEAST_SHARE:
        return None
    sizes = np.abs(values[clipped])
    if search.order == 2:
        slack = max(EXCESS_ERRORS * demand.error, EXCESS * PLATEAU_SHARE * limit)
        affected = clipped | (np.abs(demand.acceleration) > limit + slack)
    else:
        affected = clipped | (np.abs(values) > (1 - EXCESS) * limit)
    margin = k + max(round((MARGIN + search.transient) / motion.interval), 1)
    return Saturation(
        kind=search.kind,
        limit=limit,
        sd=float(np.std(sizes) * np.sqrt((2 * k + 1) / len(sizes))),
        time=float(np.sum(clipped)) * motion.interval,
        duration=sum(float(t[-1] - t[0]) for t in motion.times),
        reversals=int(np.sum(np.diff(np.sign(values[clipped])) != 0)),
        clipped=motion.at_samples(_widen(affected, margin), k),
    )


def _exceeded_plateaus(
    values: FloatArray, plateaus: BoolArray, acceleration: FloatArray, demand: Demand
) -> BoolArray:
    """Return the mask of the plateaus that the loop commands to exceed, (n,).

    - `values`: velocities or accelerations, (n,).
    - `plateaus`: mask of the samples in plateaus, (n,).
    - `acceleration`: measured acceleration [rad/s²], (n,).
    """
    excess = np.sign(values) * (demand.acceleration - acceleration)
    largest = float(np.percentile(np.abs(acceleration), TOP_PERCENTILE))
    threshold = max(EXCESS * largest, EXCESS_ERRORS * demand.error)
    exceeded = np.full(len(values), False)
    for i, j in find_spans(plateaus):
        exceeded[i:j] = np.median(excess[i:j]) > threshold
    return exceeded


def _find_plateaus(
    values: FloatArray, noise: float, first_share: float, interval: float
) -> tuple[float, BoolArray]:
    """Find the limit of a derivative, and the mask of the samples in plateaus at this limit.

    - `values`: the derivative, (n,).
    - `noise`: standard deviation of its noise.
    - `first_share`: fraction of the first guess within which the limit is searched.
    - `interval`: sample interval [s].
    """
    sizes = np.abs(values)
    limit = float(np.percentile(sizes, TOP_PERCENTILE))
    width = PLATEAU_SIGMAS * noise
    plateaus = np.full(len(sizes), False)
    # The limit is the median of the values near it, in a range that becomes narrower.
    for share in (first_share, first_share / 2, *[PLATEAU_SHARE] * MEDIAN_ITERATIONS):
        is_near = np.abs(sizes - limit) <= max(share * limit, width)
        if not is_near.any():
            return limit, plateaus
        limit = float(np.median(sizes[is_near]))
    is_near = np.abs(sizes - limit) <= max(PLATEAU_SHARE * limit, width)
    fewest = max(FEWEST_SAMPLES, round(SHORTEST_PLATEAU / interval))
    for sign in (1.0, -1.0):
        for i, j in find_spans(is_near & (np.sign(values) == sign)):
            plateaus[i:j] = j - i >= fewest
    return limit, plateaus


def find_spans(mask: BoolArray) -> list[tuple[int, int]]:
    """Return start and end index (exclusive) of each sequence of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.intp)))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _widen(mask: BoolArray, by: int) -> BoolArray:
    """Return the mask with its sequences of true values extended by `by` samples on both sides."""
    return np.asarray(np.convolve(mask, np.ones(2 * by + 1))[by : len(mask) + by] > 0.5)
