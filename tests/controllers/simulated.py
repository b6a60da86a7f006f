"""A controller without processes and clocks: drives by LinuxCNC's law, each motion at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armcontour.controllers import Controller, Motion, PlayedMotion
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerLost
from armcontour.robot import Arm


class Simulated(Controller):
    """Position and velocity loops of a cycle, which saturate and integrate to positions.

    Args:
        kp: Position loop gain [1/s].
        kv: Velocity loop gain [1/s].
        ki: Integral gain of the velocity loop [1/s].
        friction: Dry friction [rad/s²].
        acceleration: Largest acceleration [rad/s²].
        late: Whether loops see the commands of the cycle before.
        noise: Standard deviation of measured positions [rad].
        at: Joint positions at the begin [rad]; by default those of the first motion.
        cycle: Cycle of set-points and loops [s].
        trip: Cycle of each motion from which on the drives are off.
    """

    name = "simulated"
    simulates = True

    def __init__(
        self, kp: float = 25.0, kv: float = 150.0, *, ki: float = 0.0, friction: float = 0.0,
        acceleration: float = 0.72, late: bool = True, noise: float = 0.0,
        at: FloatArray | None = None, cycle: float = 1e-3, trip: float = np.inf,
    ) -> None:  # fmt: skip
        super().__init__()
        self.kp = kp
        self.kv = kv
        self.ki = ki
        self.friction = friction
        self.acceleration = acceleration
        self.late = late
        self.noise = noise
        self.at = at
        self.cycle = cycle
        self.trip = trip
        self.rng = np.random.default_rng(1)
        self.motions: list[Motion] = []

    def connect(self, arm: Arm, start: FloatArray) -> None:
        """Stand at the start."""
        self.held = np.array(start if self.at is None else self.at)

    def position(self) -> FloatArray:
        """The commanded positions."""
        return self.held

    def stream(
        self, motion: Motion, stop_requested: Callable[[], bool] = lambda: False
    ) -> PlayedMotion:
        """Play a motion; `stop_requested` is asked in every cycle."""
        self._check_motion(motion)
        self.motions.append(motion)
        command = motion.q.copy()
        stopped = None
        measured = []
        dt = self.cycle
        q = self.held.copy()
        speed = np.zeros_like(self.held)
        total = np.zeros_like(self.held)
        u_before = self.held
        w_before = np.zeros_like(self.held)
        clipped = np.zeros_like(self.held)
        asked = None
        k = 0
        notes: tuple[str, ...] = ()
        while k < len(command):
            u = command[k]
            measured.append(q + self.noise * self.rng.standard_normal(len(q)))
            far = motion.band is not None and bool(
                (
                    np.abs(measured[-1] - motion.predicted[min(k, len(motion.predicted) - 1)])
                    > motion.band
                ).any()
            )
            if asked is None and motion.next_stop is not None and (far or stop_requested()):
                asked = motion.next_stop(k + 100)
                stopped = asked.k
                command = np.concatenate([command[:stopped], asked.q])
                notes = ("A joint was too far from its predicted position.",) if far else ()
            w = self.kp * ((u_before if self.late else u) - q)
            error = (w_before if self.late else w) - speed
            # HAL's pid does not wind up in saturation.
            total = total + np.where(error * clipped <= 0, error * dt, 0.0)
            demand = self.kv * (error + self.ki * total)
            a = np.clip(demand, -self.acceleration, self.acceleration)
            clipped = np.sign(demand - a)
            a = a - np.clip(500 * speed, -self.friction, self.friction)
            speed = speed + a * dt if k < self.trip else 0 * speed
            q = q + speed * dt
            u_before = u
            w_before = w
            k = k + 1
        self.held = command[-1]
        return PlayedMotion(
            t=np.arange(len(command)) * dt,
            command=command,
            measured=np.array(measured),
            stopped=stopped,
            deviated=bool(notes),
            notes=notes,
        )

    def close(self) -> None:
        """Nothing to disconnect."""


class Lost(Simulated):
    """A controller that is lost in one of its motions.

    Args:
        cycles: Number of cycles after which it is lost.
        motion: Index of the motion in which it is lost.
    """

    def __init__(self, cycles: int, motion: int = 0) -> None:
        super().__init__(late=False)
        self.cycles = cycles
        self.motion = motion

    def stream(
        self, motion: Motion, stop_requested: Callable[[], bool] = lambda: False
    ) -> PlayedMotion:
        """Play a motion, or raise ControllerLost with the record until then."""
        record = super().stream(motion, stop_requested)
        if len(self.motions) - 1 < self.motion:
            return record
        n = self.cycles
        lost = ControllerLost("simulated was lost: its process has ended")
        lost.record = replace(
            record, t=record.t[:n], command=record.command[:n], measured=record.measured[:n],
            stopped=n,
        )  # fmt: skip
        if self.record_file is not None:
            with open(self.record_file, "a") as file:
                file.write("".join(f"{1e-3 * k},2,-2,2,-2,{k}\n" for k in range(60)))
        raise lost
