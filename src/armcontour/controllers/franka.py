"""The Franka Control Interface (FCI) as a controller: joint positions every 1 ms."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path as FilePath

import numpy as np

from armcontour.controllers.controller import Command, Controller, Motion, PlayedMotion
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused, InvalidInput
from armcontour.core.render import number
from armcontour.core.result import Row
from armcontour.motion.nearest_commands import find_excess
from armcontour.robot import Arm, Limits
from armcontour.robot.limits import or_unlimited

CYCLE = 1e-3
DOF = 7
# Margin that libfranka subtracts from each of its limits: kLimitEps.
EPS = 1e-3


@dataclass(frozen=True, slots=True)
class FrankaLimits:
    """Limits of libfranka, beyond which it changes or refuses joint positions.

    The velocity limit of a joint at q is `min(speed, sqrt(slope (upper_zero - q)) - offset)`, and
    for negative velocities the same of `q - lower_zero`.

    Args:
        lower: Ends of the joint ranges [rad].
        upper: The same.
        acceleration: Largest accelerations [rad/s²].
        jerk: Largest jerks [rad/s³].
        speed: Largest velocities [rad/s].
        offset: Offsets of the velocity limit [rad/s].
        slope: Its slopes [rad/s²]; infinite for a constant limit.
        lower_zero: Positions at which its root is zero [rad].
        upper_zero: The same.
    """

    lower: FloatArray
    upper: FloatArray
    acceleration: FloatArray
    jerk: FloatArray
    speed: FloatArray
    offset: FloatArray
    slope: FloatArray
    lower_zero: FloatArray
    upper_zero: FloatArray

    def velocities(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lower and upper velocity limits at joint positions [rad/s], (n, 7) each."""
        low, high = (
            np.minimum(self.speed, np.sqrt(self.slope * np.maximum(x, 0.0)) - self.offset)
            for x in (q - self.lower_zero, self.upper_zero - q)
        )
        return EPS - np.maximum(low, 0.0), np.maximum(high, 0.0) - EPS

    def compare(self, q: FloatArray) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Derivatives of joint positions every 1 ms, and their limits, by name, (n, 7) each.

        Differences are those of libfranka's `limitRate` (src/rate_limiting.cpp 76 to 125), which
        changes no position if no value is above its limit. Velocities count with the acceleration
        of the cycle going on for `acceleration / jerk`, since it limits accelerations to
        `jerk / acceleration` times the distance from the velocity limit.
        """
        q = np.concatenate([np.repeat(q[:1], 3, axis=0), q])
        v = np.diff(q, axis=0) / CYCLE
        a = np.diff(v, axis=0) / CYCLE
        j = np.diff(a, axis=0) / CYCLE
        low, high = self.velocities(q[2:-1])
        ahead = v[1:-1] + a[1:] * self.acceleration / self.jerk
        return {
            "velocity": (np.abs(ahead), np.where(ahead >= 0, high, -low)),
            "acceleration": (np.abs(a[1:]), np.broadcast_to(self.acceleration, j.shape)),
            "jerk": (np.abs(j), np.broadcast_to(self.jerk, j.shape)),
        }


_PANDA_ACCELERATION = np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]) - EPS
LIMITS = {
    "fr3": FrankaLimits(
        # franka_description, robots/fr3/joint_limits.yaml.
        lower=np.array([-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159]),
        upper=np.array([2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159]),
        # libfranka 0.15.0, include/franka/rate_limiting.h: kMaxJointAcceleration, kMaxJointJerk,
        # computeUpperLimitsJointVelocity, computeLowerLimitsJointVelocity.
        acceleration=np.full(DOF, 10.0) - EPS,
        jerk=np.full(DOF, 5000.0) - EPS,
        speed=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
        offset=np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]),
        slope=np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0]),
        lower_zero=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
        upper_zero=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    ),
    "panda": FrankaLimits(
        # franka_ros, franka_description/robots/panda/joint_limits.yaml.
        lower=np.array([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]),
        upper=np.array([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]),
        # libfranka 0.9.2, include/franka/rate_limiting.h: kMaxJointAcceleration, kMaxJointJerk, and
        # kMaxJointVelocity, which leaves room for three lost packets (kTolNumberPacketsLost).
        acceleration=_PANDA_ACCELERATION,
        jerk=np.array([7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]) - EPS,
        speed=np.array([2.175] * 4 + [2.61] * 3) - 3 * CYCLE * _PANDA_ACCELERATION,
        offset=np.zeros(DOF),
        slope=np.full(DOF, np.inf),
        lower_zero=np.full(DOF, -1e3),
        upper_zero=np.full(DOF, 1e3),
    ),
}
UNITS = {"velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3"}


class Franka(Controller):
    """A Franka Research 3 or a Panda, controlled by the Franka Control Interface (FCI).

    It needs pylibfranka, `armcontour[franka]`, and a real-time kernel for a robot; a simulator on a
    loopback address needs none.

    Args:
        address: Address of the robot.
        model: Limits of the robot: fr3 or panda.
    """

    name = "franka"
    cycle = CYCLE
    ahead = 5

    def __init__(self, address: str, *, model: str = "fr3") -> None:
        super().__init__()
        if model not in LIMITS:
            raise InvalidInput(f"model must be {' or '.join(LIMITS)}, but is {model}.")
        self.address, self.model = address, model

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare arm, limits and set-points with those of the FCI."""
        self._check_joints(arm, DOF)
        allowed = LIMITS[self.model]
        # Stops have the limits of the plan, so these limits are compared, too.
        for name, most in (("acceleration", allowed.acceleration), ("jerk", allowed.jerk)):
            values = or_unlimited(getattr(limits, f"joint_{name}"), DOF)
            values = np.broadcast_to(values, DOF)
            j = int(np.argmax(values / most))
            if values[j] > most[j]:
                given = number(values[j], UNITS[name]) if np.isfinite(values[j]) else "unlimited"
                raise ControllerRefused(
                    f"The limit joint_{name} of joint {j + 1} is {given}, but the FCI allows "
                    f"{number(most[j], UNITS[name])}: reduce joint_{name}.",
                    joint=j,
                    allowed=float(most[j]),
                )
        return self._compare(q)

    def stream(
        self, motion: Motion, stop_requested: Callable[[], bool] = lambda: False
    ) -> PlayedMotion:
        """Play a motion and record it, after a check that the FCI accepts its set-points."""
        self._compare(motion.q)
        return super().stream(motion, stop_requested)

    def _compare(self, q: FloatArray) -> list[Row]:
        """Largest share of each FCI limit that set-points use, one row per derivative."""
        # Raises `ControllerRefused` for a value above a limit or a position outside the range.
        limits = LIMITS[self.model]
        excess = find_excess(q, CYCLE, np.array([[limits.lower, limits.upper]]))
        if excess is not None:
            raise ControllerRefused(
                f"Joint {excess.joint + 1} is at {number(excess.needed, 'rad')} {_at(excess.row)}, "
                f"outside the robot's range, which ends at {number(excess.allowed, 'rad')}: move "
                "the path, or choose another configuration.",
                joint=excess.joint,
                needed=excess.needed,
                allowed=excess.allowed,
            )
        rows = []
        for name, (values, most) in limits.compare(q).items():
            with np.errstate(divide="ignore"):
                use = np.where(most > 0, values / most, np.inf)
            i, j = divmod(int(use.argmax()), DOF)
            if use[i, j] > 1:
                unit = UNITS[name]
                raise ControllerRefused(
                    f"The {name} of joint {j + 1} is {number(values[i, j], unit)} {_at(i)}, above "
                    f"the {number(most[i, j], unit)} of the FCI: reduce the limit joint_{name}, or "
                    "increase timing.reserve. Compensated set-points need more jerk than the FCI "
                    "allows: use compensation method none.",
                    joint=j,
                    needed=float(values[i, j]),
                    allowed=float(most[i, j]),
                )
            rows.append(Row(f"fci.{name}", float(use[i, j]), "1", f"{name} of the FCI's limit"))
        return rows

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> Command:
        if find_spec("pylibfranka") is None:
            raise ControllerRefused(
                'pylibfranka is not installed: pip install "armcontour[franka]" (Linux on x86-64, '
                "Python 3.11 and 3.12)"
            )
        words = [sys.executable, "-m", "armcontour.controllers.feeders.franka_feeder"]
        return Command([*words, str(folder / "samples.txt"), self.address])


def _at(i: int) -> str:
    """Time of cycle i, as text."""
    return f"at {number(i * CYCLE, 's')}"
