"""The Franka Control Interface (FCI) as a controller: joint positions every 1 ms."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path as FilePath
from typing import cast

import numpy as np

from armcontour.controllers.controller import Controller, FeederCommand, Motion
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused
from armcontour.core.render import number
from armcontour.core.result import Row
from armcontour.motion.controller_facts import ControllerFacts, facts_of_player
from armcontour.robot import Arm, Limits
from armcontour.robot.limits import or_unlimited

CYCLE = 1e-3
DOF = 7
# Margin that libfranka subtracts from each of its limits: kLimitEps.
LIMIT_MARGIN = 1e-3
# Limits of libfranka 0.15.0, less its margin, beyond which it changes or refuses joint positions.
LIMITS = cast(ControllerFacts, facts_of_player("franka")).limits
# Ends of the joint ranges [rad].
LOWER, UPPER = LIMITS.joint_range(DOF)
SPEED_LIMIT = LIMITS.bounds("joint_velocity", DOF)[1]
ACCELERATION_LIMIT = LIMITS.bounds("joint_acceleration", DOF)[1]
JERK_LIMIT = LIMITS.bounds("joint_jerk", DOF)[1]
# include/franka/rate_limiting.h, computeUpperLimitsJointVelocity and
# computeLowerLimitsJointVelocity [rad/s, rad]: at q, a joint's velocity limit is
# `min(SPEED_LIMIT, sqrt(SLOPE (UPPER_ZERO - q)) - OFFSET - LIMIT_MARGIN)`; for negative
# velocities, `q - LOWER_ZERO` replaces `UPPER_ZERO - q`.
OFFSET = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
SLOPE = np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0])
LOWER_ZERO = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])
UPPER_ZERO = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3"}


def compare(q: FloatArray) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Return derivatives of joint positions every 1 ms, and their limits, by name, (n, 7) each.

    The values are those that libfranka's `limitRate` compares (src/rate_limiting.cpp 76 to 125). It
    changes no position if no value exceeds its limit. With the limits A and J of acceleration and
    jerk, it limits accelerations to J / A times the distance from the velocity limit. Therefore the
    velocity compared is v + a A / J: the acceleration a of the cycle goes on for the time A / J.
    """
    q = np.concatenate([np.repeat(q[:1], 3, axis=0), q])
    v = np.diff(q, axis=0) / CYCLE
    a = np.diff(v, axis=0) / CYCLE
    j = np.diff(a, axis=0) / CYCLE
    ahead = v[1:-1] + a[1:] * ACCELERATION_LIMIT / JERK_LIMIT
    room = np.where(ahead >= 0, UPPER_ZERO - q[2:-1], q[2:-1] - LOWER_ZERO)
    near_end = np.maximum(np.sqrt(SLOPE * np.maximum(room, 0.0)) - OFFSET, 0.0) - LIMIT_MARGIN
    return {
        "velocity": (np.abs(ahead), np.minimum(SPEED_LIMIT, near_end)),
        "acceleration": (np.abs(a[1:]), np.full_like(j, ACCELERATION_LIMIT)),
        "jerk": (np.abs(j), np.full_like(j, JERK_LIMIT)),
    }


class Franka(Controller):
    """A Franka Research 3, controlled by the Franka Control Interface (FCI).

    It needs pylibfranka, `armcontour[franka]`, and a real-time kernel for a robot; a simulator on a
    loopback address needs none.

    Args:
        address: Address of the robot.
    """

    name = "franka"
    cycle = CYCLE
    ahead = 5

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare arm, limits and set-points with those of the FCI."""
        self._check_joints(arm, DOF)
        # Stops have the limits of the plan, so these limits are also compared.
        for name, most in (("acceleration", ACCELERATION_LIMIT), ("jerk", JERK_LIMIT)):
            values = np.broadcast_to(or_unlimited(getattr(limits, f"joint_{name}"), DOF), DOF)
            j = int(np.argmax(values - most))
            if values[j] > most[j]:
                given = number(values[j], UNITS[name]) if np.isfinite(values[j]) else "unlimited"
                raise ControllerRefused(
                    f"The limit joint_{name} of joint {j + 1} is {given}, but the FCI allows "
                    f"{number(most[j], UNITS[name])}. Reduce joint_{name}.",
                    joint=j,
                    allowed=float(most[j]),
                )
        return self._compare(q)

    def _check_motion(self, motion: Motion) -> None:
        """Also refuse set-points that the FCI would change."""
        super()._check_motion(motion)
        self._compare(motion.q)

    def _compare(self, q: FloatArray) -> list[Row]:
        """Return the largest fraction of each FCI limit that set-points use."""
        self._check_within(q, np.array([[LOWER, UPPER]]))
        rows = []
        for name, (values, allowed) in compare(q).items():
            with np.errstate(divide="ignore"):
                use = np.where(allowed > 0, values / allowed, np.inf)
            i, j = divmod(int(use.argmax()), DOF)
            if use[i, j] > 1:
                unit = UNITS[name]
                raise ControllerRefused(
                    f"The {name} of joint {j + 1} is {number(values[i, j], unit)} at "
                    f"{number(i * CYCLE, 's')}, but the limit of the FCI is "
                    f"{number(allowed[i, j], unit)}. Reduce the limit joint_{name}, or increase "
                    "timing.reserve.",
                    joint=j,
                    needed=float(values[i, j]),
                    allowed=float(allowed[i, j]),
                )
            rows.append(Row(f"fci.{name}", float(use[i, j]), "1", f"{name} of the FCI's limit"))
        return rows

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> FeederCommand:
        """Return the command of the feeder; refuse a missing client library."""
        if find_spec("pylibfranka") is None:
            raise ControllerRefused(
                'pylibfranka is not installed. Install it with: pip install "armcontour[franka]" '
                "(Linux on x86-64, Python 3.11 and 3.12)"
            )
        return super()._command(arm, start, folder)
