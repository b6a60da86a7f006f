"""Start values of the fit: a coarse scan of gains and dead times on a part of the log."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np

from armcontour._checks import FloatArray
from armcontour._pool import map_in_threads, split_evenly
from armcontour.identification import _joint
from armcontour.identification.fitting import Data, State, fit

# Grid of the scan, coarser than the width of the valleys of the likelihood; fits refine it.
KP = (2.0, 4.0, 8.0, 14.0, 25.0, 45.0, 80.0, 150.0)
KV = (12.0, 35.0, 90.0, 250.0, 700.0, 2000.0)
DELAY_STEP = 10e-3
# The limit, in parts of the largest acceleration that is seen.
LIMIT = (0.5, 0.8, 1.0, 1.25)
# The scan uses at most this many samples, and the fits from its best places this many.
SCANNED = 2000
FITTED = 8000
# Places from which it is fitted, and iterations of these fits.
PLACES, ROUGH = 6, 12
# So many parts of the grid are scanned one after the other by each free thread.
PARTS = 16
# Samples over which an acceleration or a velocity is estimated.
SMOOTHED = 41


def first_states(
    data: Data, order: str, start: str, *, limited: bool = False, feed: float | None = None
) -> list[State]:
    """Find start values for the fit of the whole log from a scan of a part of it, best first.

    Args:
        data: One joint.
        order: "first" or "second".
        start: As in `State`.
        limited: Whether to scan limits too.
        feed: The first value of velocity feed-forward; None is without.
    """
    begin, end = liveliest(data)
    piece = data.part(begin, end)
    # The kind of start is known only at the start of the log.
    how = start if begin == 0 else "moving"
    thin = piece.part(0, len(piece.t), max(1, math.ceil(len(piece.t) / SCANNED)))
    seed = replace(initial(thin, order, how), feed=feed)
    trials = _trials(data.delays, order, _accelerations(piece) if limited else None)
    y, rest = thin.y - (data.offset or 0.0), how == "rest"
    log = (thin.t, thin.u, y, thin.linear, seed.first, thin.last, rest)
    every = np.array([_with(seed, x).given for x in trials])

    def scan(some: slice) -> FloatArray:
        return np.asarray(_joint.scan(*log, every[some]))

    sums = np.concatenate(map_in_threads(scan, split_evenly(len(trials), PARTS)))
    seed = replace(initial(piece, order, how), feed=feed)
    places = [_with(seed, trials[i]) for i in _spread(trials, sums)]
    fits = sorted((fit(piece, x, most=ROUGH) for x in places), key=lambda x: x.sse)
    whole = initial(data, order, start)
    found: list[State] = []
    for s in (x.state for x in fits[:3]):
        given = replace(whole, kp=s.kp, kv=s.kv, delay=s.delay)
        found.append(replace(given, limit=s.limit, offset=s.offset, feed=s.feed))
    return found


def initial(data: Data, order: str, start: str, first: int | None = None) -> State:
    """A state with the measured position and velocity at its start, and no parameters yet."""
    if first is None:
        first = 0 if start != "moving" else known_from(data, data.delays[1])
    n = min(SMOOTHED // 2, max(len(data.t) - first, 2))
    t, y = data.t[first : first + n] - data.t[first], data.y[first : first + n]
    # A joint at rest may start to move at once: only its first position shows where it was.
    q0, dq0 = (float(y[0]), 0.0) if start == "rest" else np.polyfit(t, y, 1)[::-1].tolist()
    return State(
        offset=data.offset,
        order=order,
        start=start,
        first=first,
        kp=math.nan,
        kv=math.inf,
        delay=math.nan,
        limit=math.inf,
        q0=q0 - (data.offset or 0.0),
        dq0=dq0,
    )


def known_from(data: Data, delay: float) -> int:
    """The first sample whose set-point, `delay` ago, is in the log."""
    return int(np.searchsorted(data.t, data.t[0] + max(delay, 0.0) * (1 + 1e-12)))


def liveliest(data: Data) -> tuple[int, int]:
    """Start and end of the part of the log, of `FITTED` samples, in which commands move most."""
    n = len(data.t)
    if n <= FITTED:
        return 0, n
    moved = np.concatenate([[0.0], np.cumsum(np.diff(data.u) ** 2)])
    starts = np.arange(0, n - FITTED, FITTED // 8)
    best_start = int(starts[np.argmax(moved[starts + FITTED - 1] - moved[starts])])
    # The joint still responds to commands before the part.
    return max(best_start - FITTED // 8, 0), min(best_start + FITTED, n)


def _trials(delays: tuple[float, float], order: str, top: float | None) -> FloatArray:
    count = max(int(math.ceil((delays[1] - max(delays[0], 0.0)) / DELAY_STEP)), 1) + 1
    dead = np.linspace(max(delays[0], 0.0), delays[1], count)
    kv = KV if order == "second" else (math.inf,)
    limits = (math.inf,) if top is None else tuple(x * top for x in LIMIT)
    # With a limit there is more to scan: every second dead time will do.
    steps = dead if top is None else dead[::2]
    return np.array(list(product(KP, kv, steps, limits)))


def _accelerations(data: Data) -> float:
    """About the largest acceleration of the measured motion [rad/s²]."""
    from scipy.signal import savgol_filter

    window = min(SMOOTHED, (len(data.t) - 1) // 2 * 2 - 1)
    step = data.interval
    # As short as the noise allows: a long window would flatten the peaks.
    tops = [
        float(np.percentile(np.abs(savgol_filter(data.y, w, 2, deriv=2, delta=step)), 99.5))
        for w in {window, max(window // 2 | 1, 5)}
    ]
    return max(min(tops), 1e-3)


def _spread(trials: FloatArray, sums: FloatArray) -> list[int]:
    """The best trials, no two of them neighbours."""
    chosen: list[int] = []
    for i in np.argsort(sums, kind="stable"):
        near = False
        for k in chosen:
            a, b = trials[i], trials[k]
            ratio = abs(math.log(a[0] / b[0]))
            # An infinite kv is the same infinite kv.
            ratio = max(ratio, 0.0 if a[1] == b[1] else abs(math.log(a[1] / b[1])) / 2)
            near |= ratio < 0.7 and abs(a[2] - b[2]) < 1.5 * DELAY_STEP
        if not near:
            chosen.append(int(i))
        if len(chosen) == PLACES:
            break
    return chosen


def _with(seed: State, trial: FloatArray) -> State:
    kp, kv, delay, limit = trial.tolist()
    return replace(seed, kp=kp, kv=kv, delay=delay, limit=limit)
