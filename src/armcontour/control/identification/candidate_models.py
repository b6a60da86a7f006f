"""Candidate models of a joint's servo, and the range of their parameters."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour.control.identification.estimate import LOGARITHMIC
from armcontour.core.checks import FloatArray
from armcontour.robot.servo.simulation import JointServo

# Names of the parameters of a joint's servo, as in `JointServo`.
KP = "kp"
KV = "kv"
KI = "ki"
FEED = "velocity_feedforward"
ACCELERATION = "acceleration_feedforward"
DELAY = "dead_time"
FRICTION = "friction"
LIMIT = "acceleration_limit"
# Lower bound of K_p and k_i in the search [1/s].
MIN_GAIN = 0.1
# Upper bound of K_p and K_v in the search [1/s], because velocity loops of drives have bandwidths
# below 160 Hz. The upper bound of k_i is a tenth of it.
MAX_GAIN = 1000.0


class Model(NamedTuple):
    """The order of a servo, and the names of its parameters in `JointServo`."""

    order: str
    free: tuple[str, ...]


class Search(NamedTuple):
    """The range of models that are searched."""

    longest: float  # Longest dead time [s]
    drive_cycle: float  # Cycle of the drives [s]; 0 for continuous loops
    orders: tuple[str, ...] = ()  # Allowed orders

    @property
    def fastest(self) -> float:
        """Largest gain of the search [1/s]."""
        return min(MAX_GAIN, 2 / self.drive_cycle) if self.drive_cycle else MAX_GAIN

    def bounds(self, model: Model) -> tuple[FloatArray, FloatArray]:
        """Return bounds of a model's parameters, (m,) each, as logarithms for LOGARITHMIC."""
        fastest = self.fastest
        lead = 3.0 if model.order == "second" else 0.3
        ranges = JointServo(
            (MIN_GAIN, fastest), (0.5, fastest), (0.0, 3.0), (0.0, lead), (0.0, self.longest),
            (0.01, 1e5), (0.0, 0.1), (MIN_GAIN, MAX_GAIN / 10),
        )  # fmt: skip
        bounds = np.array([getattr(ranges, x) for x in model.free]).reshape(-1, 2).T
        logarithmic = np.array([x in LOGARITHMIC for x in model.free], dtype=bool)
        bounds[:, logarithmic] = np.log(bounds[:, logarithmic])
        return bounds[0], bounds[1]


# Candidate models, from simple to rich.
CANDIDATES = (
    Model("delay", (DELAY,)),
    Model("first", (KP, DELAY)),
    Model("first", (KP, FEED, DELAY)),
    Model("second", (KP, KV, DELAY)),
    Model("second", (KP, KV, FEED, DELAY)),
    Model("first", (KP, FEED, ACCELERATION, DELAY)),
    Model("second", (KP, KV, FEED, ACCELERATION, DELAY)),
    Model("second", (KP, KV, KI, FEED, DELAY, FRICTION)),
    Model("second", (KP, KV, KI, FEED, ACCELERATION, DELAY, FRICTION)),
    Model("second", (KP, KV, FEED, DELAY, LIMIT)),
)
