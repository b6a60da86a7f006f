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
        self,
        motion: Motion,
        stop_requested: Callable[[], bool] = lambda: False,
        override: Callable[[], float] = lambda: 1.0,
        show: Callable[[float], None] = lambda plan_time: None,
        pause_after: Callable[[], bool] = lambda: False,
    ) -> PlayedMotion:
        """Play a motion; asks `stop_requested` in every cycle, and `override` for each chunk."""
        self._check_motion(motion)
        self.motions.append(motion)
        sent = Sent(motion, self.cycle, override, pause_after)
        measured = []
        dt = self.cycle
        q = self.held.copy()
        speed = np.zeros_like(self.held)
        total = np.zeros_like(self.held)
        u_before = self.held
        w_before = np.zeros_like(self.held)
        clipped = np.zeros_like(self.held)
        k = 0
        notes: tuple[str, ...] = ()
        while k < sent.end:
            u = sent.q[k]
            measured.append(q + self.noise * self.rng.standard_normal(len(q)))
            band = motion.band_at(np.array([sent.highest_rate(k)]))[0]
            far = bool((np.abs(measured[-1] - sent.predicted[k]) > band).any())
            if not sent.stopping and (far or stop_requested()):
                sent.stop()
                notes = ("A joint was too far from its predicted position.",) if far else ()
            sent.advance(k)
            show(float(sent.plan_time[k]))
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
        self.held = sent.q[k - 1]
        return PlayedMotion(
            t=np.arange(k) * dt,
            command=sent.q[:k],
            measured=np.array(measured),
            plan_time=sent.plan_time[:k],
            predicted=sent.predicted[:k],
            stopped=sent.stopped,
            deviated=bool(notes),
            cause=" ".join(notes),
            notes=notes,
        )

    def close(self) -> None:
        """Nothing to disconnect."""


class Sent:
    """Rows of a motion that a feeder has, chunk by chunk.

    Args:
        motion: The motion.
        cycle: Cycle of the controller [s].
        override: The wanted override.
        pause_after: Whether the motion pauses at the end of the contour.
    """

    # A chunk replaces the rows from this time later on [s].
    AHEAD = 0.1
    # Time between two chunks [s].
    INTERVAL = 0.1

    def __init__(
        self,
        motion: Motion,
        cycle: float,
        override: Callable[[], float],
        pause_after: Callable[[], bool] = lambda: False,
    ) -> None:
        self.rows = motion.rows
        self.cycle = cycle
        self.override = override
        self.pause_after = pause_after
        self.pauses_after = False
        self.stopping = False
        self._asked = False
        if self.rows is None:
            self.q = motion.q
            self.predicted = motion.q
            self.plan_time = np.arange(len(motion.q)) * cycle
            self.rate = np.ones(len(motion.q))
            self.ends = True
            return
        self.target = override()
        self.chunk = self.rows.first(self.target)
        self.ends = self.chunk.ends
        for name in ("q", "predicted", "plan_time", "rate"):
            setattr(self, name, getattr(self.chunk, name))

    @property
    def end(self) -> float:
        """Number of rows; infinite while another chunk can follow."""
        return len(self.q) if self.ends else np.inf

    @property
    def stopped(self) -> int | None:
        """Cycle from which on the motion stops before the end of its plan."""
        if self.rows is None or self.chunk.pace.is_complete:
            return None
        return self.chunk.brake

    def stop(self) -> None:
        """Stop the motion on its path."""
        self.stopping = True

    def highest_rate(self, k: int) -> float:
        """Return the largest override in the 2 s until a cycle."""
        return float(self.rate[max(k - round(2.0 / self.cycle), 0) : k + 1].max())

    def advance(self, k: int) -> None:
        """Compute the next chunk if it is due in a cycle, and hold the last row if none is left."""
        if self.rows is not None and not (self._asked and self.stopping):
            wanted = 0.0 if self.stopping else self.override()
            is_due = k % round(self.INTERVAL / self.cycle) == 0 and wanted > 0.0
            is_due = is_due and not self.chunk.pauses
            is_due = is_due or self.pause_after() != self.pauses_after
            later = k + round(self.AHEAD / self.cycle)
            over = self.chunk.pace.is_complete and later > self.chunk.brake
            if not over and (is_due or wanted != self.target or self.stopping):
                self._next(later, wanted)
        if k + 1 >= len(self.q) and not self.ends:
            self._hold(k + 2)

    def _next(self, k: int, wanted: float) -> None:
        self._asked = self.stopping
        self.target = wanted
        self.pauses_after = self.pause_after()
        self.chunk = self.rows.next(
            self.chunk, k, wanted, ends=self.stopping, pause_after=self.pauses_after
        )
        self._hold(k)
        self.ends = self.chunk.ends
        for name in ("q", "predicted", "plan_time", "rate"):
            before = getattr(self, name)
            setattr(self, name, np.concatenate([before[:k], getattr(self.chunk, name)]))

    def _hold(self, count: int) -> None:
        """Repeat the last row until there are `count` rows."""
        for name in ("q", "predicted", "plan_time", "rate"):
            before = getattr(self, name)
            more = max(count - len(before), 0)
            setattr(self, name, np.concatenate([before, np.repeat(before[-1:], more, axis=0)]))


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
        self,
        motion: Motion,
        stop_requested: Callable[[], bool] = lambda: False,
        override: Callable[[], float] = lambda: 1.0,
        show: Callable[[float], None] = lambda plan_time: None,
        pause_after: Callable[[], bool] = lambda: False,
    ) -> PlayedMotion:
        """Play a motion, or raise ControllerLost with the record until then."""
        record = super().stream(motion, stop_requested, override, show, pause_after)
        if len(self.motions) - 1 < self.motion:
            return record
        n = self.cycles
        lost = ControllerLost("simulated was lost: its process has ended")
        lost.record = replace(
            record, t=record.t[:n], command=record.command[:n], measured=record.measured[:n],
            plan_time=record.plan_time[:n], predicted=record.predicted[:n], stopped=n,
        )  # fmt: skip
        if self.record_file is not None:
            with open(self.record_file, "a") as file:
                file.write("".join(f"{1e-3 * k},2,-2,2,-2,{k}\n" for k in range(60)))
        raise lost
