"""Initial parameters with which candidate models are fitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from armcontour.control.identification.candidate_models import (
    ACCELERATION,
    DELAY,
    FEED,
    FRICTION,
    KI,
    KP,
    KV,
    LIMIT,
    Model,
)
from armcontour.control.identification.joint_fit import Fit
from armcontour.control.identification.log_segments import LogSegment

# Upper bound of the initial dead time in the fit of a saturating joint [s].
USUAL_DELAY = 0.01
# Difference of the initial dead times of a pure delay [s].
DELAY_STEP = 4e-3
# Lower bound of the lag from which gains are computed [s], and of these gains [1/s].
LEAST_LAG = 1e-4
LEAST_GAIN = 0.5
# Times over which accelerations are measured [s]: a short time for fast motion, and a long time for
# small motion in noise.
ACCELERATION_TIMES = (8e-3, 40e-3)
# This percentile of accelerations, without their signs, counts as the largest acceleration.
ACCELERATION_PERCENTILE = 99
# The acceleration limit is also searched from this multiple of the largest acceleration.
LIMIT_MULTIPLE = 3


class Loop(NamedTuple):
    """Initial values of a servo; the initial K_p is `kp + kp_times_lag / lag`."""

    kp: float  # 1/s
    kp_times_lag: float
    kv: float  # 1/s
    ki: float  # 1/s
    feed: float  # Velocity feed-forward, which matters only in loops that saturate
    delay_share: float  # Dead time divided by the lag


LOOPS = (
    Loop(10.0, 0.0, 20.0, 5.0, 1.0, 0.8),
    Loop(1.0, 0.0, 100.0, 5.0, 1.0, 1.0),
    Loop(40.0, 0.0, 150.0, 5.0, 0.6, 0.5),
    Loop(30.0, 0.0, 100.0, 5.0, 0.0, 0.3),
    Loop(150.0, 0.0, 60.0, 5.0, 0.6, 0.9),
    Loop(0.0, 0.8, 60.0, 5.0, 0.0, 0.1),
    Loop(0.0, 1.5, 150.0, 12.0, 0.0, 0.3),
    Loop(0.0, 4.0, 100.0, 5.0, 0.0, 0.7),
)
# The loops from which models with an acceleration limit are also searched.
LIMITED_LOOPS = LOOPS[2:4]


def initial_parameters(
    model: Model, lag: float, fits: Mapping[Model, Fit], segments: Sequence[LogSegment]
) -> list[dict[str, float]]:
    """Return the initial parameters of a fit: generic loops, or the fit of a simpler model.

    - `lag`: delay of the command with the smallest tracking error [s].
    - `fits`: fits of the simpler models.
    """
    order, free = model
    if order == "delay":
        return [{DELAY: lag}, {DELAY: max(lag - DELAY_STEP, 0.0)}]
    new = {FRICTION} if FRICTION in free else {ACCELERATION, LIMIT} & set(free)
    if KI in free or not new:
        return [_parameters_of(x, lag) for x in LOOPS]
    simpler = fits[Model(order, tuple(x for x in free if x not in new))]
    initial = simpler.servo._asdict()
    if LIMIT not in new:
        return [initial]
    return _limited_parameters(initial, lag, segments)


def _parameters_of(loop: Loop, lag: float) -> dict[str, float]:
    """Return the parameters of a generic loop for a joint with a lag [s]."""
    gain = max(1 / (lag + LEAST_LAG), LEAST_GAIN)
    return {
        KP: loop.kp + loop.kp_times_lag * gain,
        KV: loop.kv,
        KI: loop.ki,
        FEED: loop.feed,
        DELAY: loop.delay_share * lag,
    }


def _limited_parameters(
    unlimited: dict[str, float], lag: float, segments: Sequence[LogSegment]
) -> list[dict[str, float]]:
    """Return initial parameters with several acceleration limits.

    If a joint often saturates, the fit without a limit is a useless start. Therefore generic loops
    are also tried.
    """
    loops = [unlimited]
    for loop in LIMITED_LOOPS:
        parameters = _parameters_of(loop, lag)
        loops.append({**parameters, DELAY: min(parameters[DELAY], USUAL_DELAY)})
    accelerations = []
    for time in ACCELERATION_TIMES:
        accelerations.append(max(_largest_acceleration(s, time) for s in segments))
    limits = (*accelerations, LIMIT_MULTIPLE * max(accelerations))
    return [{**x, LIMIT: limit} for x, limit in product(loops, limits)]


def _largest_acceleration(s: LogSegment, time: float) -> float:
    """Return the largest acceleration [rad/s²], see ACCELERATION_PERCENTILE.

    - `time`: time between the positions whose second difference is the acceleration [s].
    """
    t = s.command.t
    interval = float(np.median(np.diff(t)))
    k = min(max(int(round(time / interval)), 1), (len(t) - 1) // 2)
    second = s.y[2 * k :] - 2 * s.y[k:-k] + s.y[: -2 * k]
    return float(np.percentile(np.abs(second), ACCELERATION_PERCENTILE)) / (k * interval) ** 2
