"""Base class of controllers: plays a motion through a feeder process, and records it."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Annotated, ClassVar, Self

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ArmContourError, ControllerLost, ControllerRefused, InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import AtLeast, Axes, Quantity
from armcontour.core.render import number
from armcontour.core.result import Row
from armcontour.core.text import count_noun
from armcontour.motion.nearest_commands import find_excess
from armcontour.robot import Arm, Limits
from armcontour.robot.arm import unit_of

# Timeout of connecting [s].
CONNECT_TIMEOUT = 20.0
# Timeout of ending the feeder process, which may first stop the robot [s].
CLOSE_TIMEOUT = 60.0
# Period of reading new samples [s].
READING_PERIOD = 5e-3
# First estimate of the time for computing and sending a stop [s].
FIRST_STOP_LEAD = 0.15
# Time from the first cycle of a stop to that of the next stop [s].
STOP_INTERVAL = 0.2
# Maximum distance of a revolute joint from the first set-point when a motion starts [rad].
START_TOLERANCE = 1e-3
# The same for a linear axis [m].
START_TOLERANCE_LINEAR = 1e-3
# Tolerance between the set-points and the commands that the controller recorded [rad].
RECORDED_TOLERANCE = 1e-9
# Maximum length of a feeder's error message [characters].
MAX_ERROR_LENGTH = 600
# Sentences for the record, by the letter with which a feeder reports an event.
EVENTS = {
    "W": "The feeder received nothing from the sending process, and stopped the motion.",
    "A": "The next stop was not ready in time, so the feeder executed the previous one.",
    "V": "A process of the feeder ended or halted, and the other one stopped the motion.",
    "N": "The feeder could not write its record ({}), and stopped the motion.",
    "C": "The speed slider was set to {} %, so the feeder stopped the motion. Set it to 100 %.",
    "U": (
        "The controller had no set-point for cycle {}, because the feeder halted or came late. It "
        "braked the joints off the path, and the motion ended."
    ),
}
# Name of the record that remains in a result folder if a command ends during a motion.
UNFINISHED = "unfinished.csv"

Positions = Annotated[FloatArray, Quantity("rad"), Axes("n", "joints")]
# Command of a feeder process, and its additional environment variables.
FeederCommand = tuple[list[str], dict[str, str]]


@declared(eq=False)
class Stop(Checked):
    """Set-points that replace those of a motion from a cycle on, and end at rest on the path.

    Args:
        k: The first cycle that they replace, counted from 0.
        q: Joint positions at the controller's cycles from k on [rad], (n, dof).
    """

    k: Annotated[int, AtLeast(0)]
    q: Positions


@declared(eq=False)
class Motion(Checked):
    """Set-points at the cycles of a controller, with its stops.

    Args:
        q: Joint positions [rad], (n, dof), from rest to rest.
        next_stop: Computes the stop from a cycle on, or from a later one; None if the motion is so
            short that it is not stopped. Called by another thread while the motion is played.
        predicted: Measured positions that are expected at these cycles [rad], (n, dof).
        band: Largest difference of each joint from `predicted` before the motion is stopped [rad],
            (dof,); None if it is unlimited.
    """

    q: Positions
    next_stop: Callable[[int], Stop] | None = None
    predicted: Positions | None = None
    band: Annotated[FloatArray, Quantity("rad"), Axes("joints")] | None = None


@declared(eq=False)
class PlayedMotion(Checked):
    """Record of a motion by its controller.

    Args:
        t: Times by the controller's clock, 0 at the first set-point [s], (n,).
        command: Set-points that the controller used [rad], (n, dof).
        measured: Measured positions [rad], (n, dof).
        stopped: Cycle from which on a stop replaced the motion, or from which on it was not played
            or not recorded because of a failure; None if it was played to its end.
        faithful: Whether the controller used the set-points as they were sent, each in its cycle.
        deviated: Whether it was stopped because a joint left the band around its prediction.
        notes: Sentences on what differs from the ideal: late rows, lost samples, following errors.
    """

    t: Annotated[FloatArray, Quantity("s"), Axes("n")]
    command: Positions
    measured: Positions
    stopped: int | None = None
    faithful: bool = True
    deviated: bool = False
    notes: tuple[str, ...] = ()


class _Channel:
    """A feeder process, and the lines that it has sent."""

    def __init__(self, command: FeederCommand, clean_up: Sequence[str], folder: FilePath) -> None:
        words, environment = command
        self.folder = folder
        self.clean_up = clean_up
        self.environment = os.environ | environment
        with open(folder / "stderr.txt", "w") as errors:
            self.process = subprocess.Popen(
                words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                env=self.environment,
                text=True,
                start_new_session=True,
            )
        assert self.process.stdin is not None and self.process.stdout is not None
        self.stdin = self.process.stdin
        self.stdout = self.process.stdout
        self.samples: list[tuple[float, ...]] = []
        # Letter of an event -> its words, for the last event with this letter in this motion.
        self.events: dict[str, list[str]] = {}
        self.positions: list[float] = []
        self.failure = ""
        # Time after which the controller has stopped the joints if the process has ended [s].
        self.settling = 0.0
        self.alive = True
        self._lock = threading.Lock()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        """Store the lines of the feeder, whose letters its module explains, until it ends."""
        for line in self.stdout:
            # The last line of a killed process may be incomplete.
            kind, *words = line.split() or [""]
            if kind == "s" and len(words) == 2 + 2 * len(self.positions):
                self.samples.append(tuple(map(float, words)))
            elif kind == "R":
                self.positions = [float(x) for x in words]
            elif kind == "F":
                self.failure = " ".join(words)
            elif kind == "L":
                self.settling = float(words[0])
            else:
                self.events[kind] = words
        self.alive = False

    def send(self, lines: Iterable[str]) -> None:
        """Send lines; if the process has ended, they are lost and `alive` becomes False."""
        text = "".join(f"{x}\n" for x in lines)
        with self._lock, suppress(OSError, ValueError):
            self.stdin.write(text)
            self.stdin.flush()

    def describe_failure(self) -> str:
        """Return why the process has ended: its error message, if it has sent one."""
        if self.failure:
            return self.failure
        errors = (self.folder / "stderr.txt").read_text(errors="replace").split()
        return " ".join(errors)[-MAX_ERROR_LENGTH:] or "its process has ended"

    def close(self) -> None:
        """End the process; a motion that is played first stops on the path."""
        self.send(["Q"])
        with suppress(OSError):
            self.stdin.close()
        try:
            self.process.wait(CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            os.killpg(self.process.pid, signal.SIGTERM)
            self.process.wait()
        # If the guard has ended, the feeder may still be stopping the robot.
        self._listener.join(CLOSE_TIMEOUT)
        self.stdout.close()
        if self.process.returncode and self.clean_up:
            # If the process failed or was killed, programs of the controller may still run. They
            # are ended after they have stopped the joints.
            time.sleep(self.settling)
            null = subprocess.DEVNULL
            subprocess.run(
                self.clean_up, env=self.environment, stdin=null, stdout=null, stderr=null
            )
        shutil.rmtree(self.folder, ignore_errors=True)


class _StopSender(threading.Thread):
    """Thread that computes and sends stops ahead of the motion, until the motion ends.

    Attributes:
        played: Last cycle of the motion that the controller has played.
        sent: Set-points of the stops that were sent [rad], (n, dof), by their first cycle.
        error: Why no further stop can be computed; empty without an error.
        lead: Time that computing and sending a stop takes at most [s].
    """

    def __init__(self, channel: _Channel, motion: Motion, ahead: int, cycle: float) -> None:
        super().__init__(daemon=True)
        self.channel = channel
        self.motion = motion
        self.ahead = ahead
        self.cycle = cycle
        self.played = 0
        self.sent: dict[int, FloatArray] = {}
        self.error = ""
        self.lead = FIRST_STOP_LEAD
        self._ended = threading.Event()

    @property
    def due(self) -> int:
        """Return the first cycle that a stop computed from now on can still replace."""
        return self.played + self.ahead + round(self.lead / self.cycle)

    def start(self) -> None:
        """Measure the time for computing a stop, send the first stop, and start the thread."""
        assert self.motion.next_stop is not None
        # The first call compiles functions.
        for _ in range(2):
            begin = time.monotonic()
            self.motion.next_stop(len(self.motion.q) // 2)
        self._measure(begin)
        self.send_next()
        super().start()

    def _measure(self, begin: float) -> None:
        """Increase the lead to twice the time that the computation begun at `begin` [s] took."""
        self.lead = max(self.lead, 2 * (time.monotonic() - begin) + READING_PERIOD)

    def send_next(self) -> int:
        """Compute and send the next stop, and return its cycle."""
        assert self.motion.next_stop is not None
        begin = time.monotonic()
        played = self.played
        if "X" not in self.channel.events:
            # Discard stops whose first cycle has passed, because a long motion has thousands of
            # stops.
            self.sent = {k: q for k, q in self.sent.items() if k >= played}
        stop = self.motion.next_stop(self.due + round(STOP_INTERVAL / self.cycle))
        self.sent[stop.k] = stop.q
        self.channel.send([f"T {stop.k}", *rows_as_lines(stop.q), "E"])
        self._measure(begin)
        return stop.k

    def run(self) -> None:
        """Send stops until the motion has ended."""
        try:
            while not self._ended.is_set():
                k = self.send_next()
                if k >= len(self.motion.q):
                    return
                while self.due < k:
                    if self._ended.wait(READING_PERIOD):
                        return
        except ArmContourError as error:
            self.error = f"No further stop can be computed: {error}"
        except Exception as error:  # noqa: BLE001 - the motion ends, and the cause must be known
            kind = type(error).__name__
            self.error = f"No further stop can be computed, because of a fault: {kind}: {error}"

    def end(self) -> None:
        """Send no further stops."""
        self._ended.set()
        if self.is_alive():
            self.join()


class Controller:
    """Base class of robot controllers that receive joint positions in every cycle.

    Args:
        address: Address of the robot; empty for a controller of this machine.

    Attributes:
        name: Name of the controller.
        cycle: Its cycle [s].
        ahead: Number of rows that are sent before they are due, and can no longer be replaced.
        simulates: Whether it simulates the drives, so that no machine moves.
        clean_up: Command that ends its programs after the feeder process has failed.
        record_file: File to which the feeder process writes all samples while the robot is
            connected; None for a temporary file.
    """

    name: ClassVar[str]
    cycle: float = 1e-3
    ahead: int = 0
    simulates: bool = False
    clean_up: tuple[str, ...] = ()

    def __init__(self, address: str = "") -> None:
        self.address = address
        self.record_file: FilePath | None = None
        self._channel: _Channel | None = None
        self._arm: Arm | None = None

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> FeederCommand:
        """Return the command of the feeder process, which writes its files to `folder`."""
        feeder = f"armcontour.controllers.feeders.{self.name}_feeder"
        return [sys.executable, "-m", feeder, *self._record_arguments(folder), self.address], {}

    def _record_arguments(self, folder: FilePath) -> list[str]:
        """Return a feeder's first two arguments: file of the samples, and cycle [s]."""
        file = folder / "samples.csv" if self.record_file is None else self.record_file
        return [str(file), repr(self.cycle)]

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare arm, limits and set-points with those of the controller.

        Args:
            arm: The arm of the plan.
            limits: Limits of the plan.
            q: Set-points at the controller's cycles [rad], (n, dof).

        Returns:
            Rows with what was compared, for a table.

        Raises:
            ControllerRefused: Something differs.
        """
        return []

    def connect(self, arm: Arm, start: FloatArray) -> None:
        """Connect to the controller and hold the position.

        Args:
            arm: The arm of the plan.
            start: Joint positions at which a simulated robot is set up [rad], (dof,).

        Raises:
            ControllerRefused: The controller cannot be reached, or has other joints.
        """
        self._arm = arm
        folder = FilePath(tempfile.mkdtemp(prefix="armcontour-play-"))
        try:
            command = self._command(arm, start, folder)
        except Exception:
            shutil.rmtree(folder)
            raise
        channel = self._channel = _Channel(command, self.clean_up, folder)
        end = time.monotonic() + CONNECT_TIMEOUT
        while not channel.positions and channel.alive and time.monotonic() < end:
            time.sleep(READING_PERIOD)
        try:
            if not channel.positions:
                reason = "it does not answer" if channel.alive else channel.describe_failure()
                raise ControllerRefused(f"{self.name} cannot be reached: {reason}")
            self._check_joints(arm, len(channel.positions))
        except ControllerRefused:
            self.close()
            raise

    def position(self) -> FloatArray:
        """Return the commanded joint positions [rad], (dof,)."""
        channel = self._connected()
        row = channel.samples[-1][2:] if channel.samples else channel.positions
        return np.array(row[: len(channel.positions)])

    def stream(
        self, motion: Motion, stop_requested: Callable[[], bool] = lambda: False
    ) -> PlayedMotion:
        """Play a motion and record it.

        Args:
            motion: The motion, which begins at the commanded position.
            stop_requested: Called often; True stops the motion on its path.

        Raises:
            ControllerRefused: The motion begins elsewhere; nothing moves.
            ControllerLost: The controller failed, or its process ended; with the record until then.
        """
        channel = self._connected()
        self._check_motion(motion)
        channel.events.clear()
        first_sample = len(channel.samples)
        channel.send(["M", *rows_as_lines(motion.q), "E"])
        stops = _StopSender(channel, motion, self.ahead, self.cycle)
        if motion.next_stop is not None:
            # The motion starts after the first stop has been sent.
            stops.start()
        channel.send(["G"])
        notes: list[str] = []
        # Number of samples whose deviation was checked.
        checked = first_sample
        has_begun = False
        is_stopping = False
        deviation = ""
        try:
            while "D" not in channel.events:
                if not channel.alive:
                    lost = ControllerLost(f"{self.name} was lost: {channel.describe_failure()}")
                    lost.record = self._record(first_sample, motion, stops.sent, notes, lost=True)
                    raise lost
                # An empty line shows the feeder that this process is alive.
                channel.send([""])
                rows = channel.samples[checked:]
                checked += len(rows)
                if not has_begun:
                    # Samples before the first set-point belong to the motion before.
                    rows = rows[next((i for i, x in enumerate(rows) if x[1] == 0), len(rows)) :]
                    has_begun = bool(rows)
                if rows:
                    stops.played = max(stops.played, int(rows[-1][1]))
                # After a stop by the feeder itself, joints deviate from their predictions.
                is_stopping = is_stopping or "X" in channel.events
                if not is_stopping:
                    deviation = _deviation(rows, motion, self._arm)
                    reason = deviation or stops.error
                    if reason or stop_requested():
                        channel.send(["S"])
                        is_stopping = True
                        if reason:
                            notes.append(reason)
                time.sleep(READING_PERIOD)
        finally:
            stops.end()
        record = self._record(first_sample, motion, stops.sent, notes)
        return replace(record, deviated=bool(deviation))

    def close(self) -> None:
        """End the connection; a motion that is played first stops on its path."""
        if self._channel is not None:
            self._channel.close()
            self._channel = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _connected(self) -> _Channel:
        """Return the channel to the feeder; refuse a controller that is not connected."""
        if self._channel is None:
            raise InvalidInput(f"{self.name} is not connected. Call connect first.")
        return self._channel

    def _check_joints(self, arm: Arm, dof: int) -> None:
        """Refuse an arm that has not as many joints as the controller."""
        if arm.dof != dof:
            raise ControllerRefused(
                f"{self.name} has {count_noun(dof, 'joint')}, but the arm {arm.name} has "
                f"{count_noun(arm.dof, 'joint')}."
            )

    def _check_within(self, q: FloatArray, bounds: FloatArray) -> None:
        """Refuse set-points outside the bounds of the robot.

        - `q`: set-points [rad], (n, dof).
        - `bounds`: lowest and highest positions [rad], and optionally velocities [rad/s], of each
          joint, (1 or 2, 2, dof).
        """
        excess = find_excess(q, self.cycle, bounds[:1]) or find_excess(q, self.cycle, bounds)
        if excess is None:
            return
        joint = excess.joint
        needed = excess.needed
        allowed = excess.allowed
        time = number(excess.row * self.cycle, "s")
        unit = unit_of(self._arm, "rad/s" if excess.order else "rad", joint)
        raise ControllerRefused(
            f"Joint {joint + 1} {'moves with' if excess.order else 'is at'} "
            f"{number(needed, unit)} at {time}, beyond the limit {number(allowed, unit)} of the "
            "robot. Move the path, reduce joint_velocity, or increase timing.reserve.",
            joint=joint,
            needed=needed,
            allowed=allowed,
        )

    def _check_motion(self, motion: Motion) -> None:
        """Refuse a motion whose first set-point differs from the commanded position."""
        distance = np.abs(motion.q[0] - self.position())
        allowed = per_joint(self._arm, START_TOLERANCE, START_TOLERANCE_LINEAR, len(distance))
        j = int((distance / allowed).argmax())
        if distance[j] > allowed[j]:
            unit = unit_of(self._arm, "rad", j)
            raise ControllerRefused(
                f"Joint {j + 1} is commanded to {number(self.position()[j], unit)}, "
                f"{number(distance[j], unit)} from the first set-point, but at most "
                f"{number(allowed[j], unit)} are allowed. Move the robot there first.",
                joint=j,
                needed=float(distance[j]),
                allowed=float(allowed[j]),
            )

    def _record(
        self,
        first_sample: int,
        motion: Motion,
        stops: Mapping[int, FloatArray],
        notes: list[str],
        *,
        lost: bool = False,
    ) -> PlayedMotion:
        """Make the record of a motion from its samples.

        - `first_sample`: index of the first sample since the motion was sent.
        - `stops`: set-points of the stops that were sent, by their first cycle.
        - `notes`: why the motion was stopped.
        - `lost`: whether the controller was lost, so that the motion is not recorded to its end.
        """
        channel = self._connected()
        dof = motion.q.shape[1]
        table = np.array(channel.samples[first_sample:], dtype=float).reshape(-1, 2 + 2 * dof)
        # Before the first set-point, the controller may still hold the last set-point of another
        # motion.
        table = table[np.logical_or.accumulate(table[:, 1] == 0) & (table[:, 1] >= 0)]
        clock = table[:, 0]
        k = table[:, 1].astype(int)
        stopped = int(k[-1]) + 1 if lost and len(k) else None
        q = motion.q
        if "X" in channel.events:
            stopped = int(channel.events["X"][0])
            q = np.concatenate([q[:stopped], stops[stopped]])
        if "U" in channel.events:
            ended = int(channel.events["U"][0])
            stopped = ended if stopped is None else min(stopped, ended)
            q = q[: max(ended, 1)]
        notes = list(notes)
        missing = int((np.diff(clock) - 1).sum()) if len(clock) else 0
        # A motion ends with a rest, so repeated samples of the last row are not late.
        late = int((np.diff(k[k < len(q) - 1]) == 0).sum())
        command = table[:, 2 : 2 + dof]
        deviations = np.abs(command - q[np.minimum(k, len(q) - 1)]).max(axis=0, initial=0.0)
        deviation = float(deviations.max())
        for kind, sentence in EVENTS.items():
            if kind in channel.events:
                notes.append(sentence.format(" ".join(channel.events[kind])))
        if missing:
            notes.append(f"{count_noun(missing, 'sample')} of the record are missing.")
        if late:
            notes.append(f"{count_noun(late, 'set-point')} came late.")
        if deviation > RECORDED_TOLERANCE:
            unit = unit_of(self._arm, "rad", int(deviations.argmax()))
            notes.append(
                "The controller used other set-points than those sent, by up to "
                f"{number(deviation, unit)}."
            )
        return PlayedMotion(
            t=(clock - (clock[0] if len(clock) else 0.0)) * self.cycle,
            command=command,
            measured=table[:, 2 + dof :],
            stopped=stopped,
            faithful=not (late or missing or "U" in channel.events)
            and deviation <= RECORDED_TOLERANCE,
            notes=tuple(notes),
        )


def per_joint(arm: Arm | None, angular: float, linear: float, dof: int) -> FloatArray:
    """Return `angular` [rad] for revolute joints and `linear` [m] for the others, (dof,).

    The joints of an unknown arm are revolute.
    """
    if arm is None:
        return np.full(dof, angular)
    return np.where(arm.chain.slides, linear, angular)


def rows_as_lines(q: FloatArray) -> list[str]:
    """Return a feeder's lines for set-points [rad], (n, dof), and the length of the final rest."""
    moving = np.flatnonzero((q != q[-1]).any(axis=1))
    n = moving[-1] + 2 if len(moving) else 1
    return [*("P " + " ".join(map(repr, row)) for row in q[:n].tolist()), f"H {len(q) - n}"]


def _deviation(rows: Sequence[Sequence[float]], motion: Motion, arm: Arm | None) -> str:
    """Say which joint left the band around its prediction; return "" if none did.

    `rows`: samples of the feeder, with the cycle in the second column.
    """
    if not rows or motion.predicted is None or motion.band is None:
        return ""
    table = np.array(rows)
    table = table[table[:, 1] >= 0]
    k = np.minimum(table[:, 1].astype(int), len(motion.predicted) - 1)
    errors = np.abs(table[:, 2 + motion.q.shape[1] :] - motion.predicted[k])
    if (errors <= motion.band).all():
        return ""
    i, j = np.unravel_index(int((errors - motion.band).argmax()), errors.shape)
    unit = unit_of(arm, "rad", int(j))
    return (
        f"Joint {j + 1} was {number(errors[i, j], unit)} from its predicted position in cycle "
        f"{k[i]}, above the allowed {number(motion.band[j], unit)}. Check its drive, or identify "
        "its servo."
    )
