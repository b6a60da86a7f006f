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
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Annotated, ClassVar, Self

import numpy as np

from armcontour.controllers.rolling_rows import Chunk, RollingRows
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmContourError, ControllerLost, ControllerRefused, InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Axes, Quantity
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
# Time between two reports of the place in the plan [s].
SHOWN_PERIOD = 0.1
# First estimate of the time for computing and sending a chunk [s], and its largest value.
FIRST_LEAD = 0.03
LONGEST_LEAD = 2.0
# The lead follows from the times of this number of last chunks, without the longest one: a single
# halt of this machine does not delay the chunks after it.
MEASURED_CHUNKS = 5
# A chunk is replaced so long before its stop begins [s].
CHUNK_MARGIN = 0.2
# Time between two chunks if the wanted override changes continuously [s].
SHORTEST_CHUNK = 0.05
# The feeder must answer a chunk within this time [s].
ANSWER_TIMEOUT = 5.0
# The allowed deviation of a joint depends on the largest override in this time before [s].
OVERRIDE_MEMORY = 2.0
# Smallest capacity of the table with the rows of a motion.
FIRST_CAPACITY = 4096
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
class Motion(Checked):
    """A motion at the cycles of a controller.

    Args:
        q: Joint positions at full speed [rad], (n, dof), from rest to rest.
        rows: Computes the rows that are sent, by the wanted override; None if the motion is so
            short that it is not stopped: then `q` is sent. Called by another thread while the
            motion is played.
        predicted: Measured positions that are expected at full speed [rad], (n, dof).
        band: Largest difference of each joint from its predicted position at rest before the motion
            is stopped [rad], (dof,); None if it is unlimited.
        moving_band: What is added to the band at full speed [rad], (dof,); at a lower speed it is
            proportional to the override. None for nothing.
    """

    q: Positions
    rows: RollingRows | None = None
    predicted: Positions | None = None
    band: Annotated[FloatArray, Quantity("rad"), Axes("joints")] | None = None
    moving_band: Annotated[FloatArray, Quantity("rad"), Axes("joints")] | None = None

    def band_at(self, override: FloatArray) -> FloatArray:
        """Return the band [rad], (n, dof).

        Args:
            override: Shares of the planned speed, (n,).
        """
        band = np.full(self.q.shape[1], np.inf) if self.band is None else self.band
        moving = 0.0 if self.moving_band is None else self.moving_band
        return np.asarray(band + override[:, None] * moving)


@declared(eq=False)
class PlayedMotion(Checked):
    """Record of a motion by its controller.

    Args:
        t: Times by the controller's clock, 0 at the first set-point [s], (n,).
        command: Set-points that the controller used [rad], (n, dof).
        measured: Measured positions [rad], (n, dof).
        plan_time: Time of the plan at each sample [s], (n,): it goes on more slowly than the clock
            if the override is below 100 %.
        predicted: Measured positions that were expected [rad], (n, dof).
        stopped: Cycle from which on a stop replaced the motion, or from which on it was not played
            or not recorded because of a failure; None if it was played to its end.
        faithful: Whether the controller used the set-points as they were sent, each in its cycle.
        deviated: Whether it was stopped because a joint left the band around its prediction.
        cause: Why the motion was stopped, as sentences; empty if that was requested, or if it was
            not stopped.
        notes: Sentences on what differs from the ideal: late rows, lost samples, following errors.
    """

    t: Annotated[FloatArray, Quantity("s"), Axes("n")]
    command: Positions
    measured: Positions
    plan_time: Annotated[FloatArray, Quantity("s"), Axes("n")]
    predicted: Positions
    stopped: int | None = None
    faithful: bool = True
    deviated: bool = False
    cause: str = ""
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
        # Number of the last block that the feeder has answered, and whether it has kept it.
        self.answer = (0, False)
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
            elif kind in ("K", "B"):
                self.answer = (int(words[0]), kind == "K")
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


class _Table:
    """Rows of a motion that a feeder has kept, with what is expected in each cycle.

    Attributes:
        count: Number of rows.
    """

    def __init__(self, dof: int) -> None:
        self.count = 0
        self._columns = {
            "q": np.empty((FIRST_CAPACITY, dof)),
            "predicted": np.empty((FIRST_CAPACITY, dof)),
            "plan_time": np.empty(FIRST_CAPACITY),
            "rate": np.empty(FIRST_CAPACITY),
        }

    def replace(self, chunk: Chunk) -> None:
        """Replace the rows from the first cycle of a chunk on; before it, the last row is held."""
        end = chunk.k + len(chunk.q)
        for name, column in self._columns.items():
            if len(column) < end:
                more = np.empty((end, *column.shape[1:]))
                column = self._columns[name] = np.concatenate([column, more])
            column[self.count : chunk.k] = column[self.count - 1]
            column[chunk.k : end] = getattr(chunk, name)
        self.count = end

    def at(self, name: str, k: IntArray) -> FloatArray:
        """Return a column in some cycles, (n, ...); after the end, the last row is held."""
        return np.asarray(self._columns[name][np.minimum(k, self.count - 1)])

    def highest_rate(self, k: IntArray, cycles: int) -> FloatArray:
        """Return the largest override in some cycles and in `cycles` before each, (n,)."""
        first = max(int(k.min()) - cycles, 0)
        return np.full(len(k), self.at("rate", np.arange(first, int(k.max()) + 1)).max())


class _ChunkSender(threading.Thread):
    """Thread that computes and sends the chunks of a motion, until the motion ends.

    Attributes:
        played: Last cycle of the motion that the controller has played.
        table: Rows that the feeder has kept.
        chunk: The last chunk that the feeder has kept.
        braked: Number of chunks that came so late that the motion had begun to stop.
        error: Why no further chunk can be computed; empty without an error.
        lead: Time from the begin of computing a chunk to its first row [s].
    """

    chunk: Chunk

    def __init__(
        self,
        channel: _Channel,
        rows: RollingRows,
        controller: Controller,
        override: Callable[[], float],
        pause_after: Callable[[], bool],
    ) -> None:
        super().__init__(daemon=True)
        self.channel = channel
        self.rows = rows
        self.cycle = controller.cycle
        self.ahead = controller.ahead
        self.override = override
        self.pause_after = pause_after
        self.played = 0
        self.table = _Table(rows.q.shape[1])
        self.braked = 0
        self.error = ""
        self.lead = FIRST_LEAD
        self._durations: deque[float] = deque(maxlen=MEASURED_CHUNKS)
        self._number = 0
        self._target = 0.0
        self._pauses_after = False
        self._sent_at = 0.0
        # Whether the motion is to stop and to end there, and whether the chunk for it was kept.
        self._stopping = False
        self._stop_sent = False
        self._ended = threading.Event()

    @property
    def due(self) -> int:
        """Return the first cycle that a chunk computed from now on can still replace."""
        return self.played + self.ahead + round(self.lead / self.cycle) + 1

    def start(self) -> None:
        """Send the first chunk, and start the thread; measure the time that a chunk takes."""
        self._target = self._wanted()
        tried = self.rows.first(self._target)
        # The first call compiles functions.
        self.rows.next(tried, len(tried.q) // 2, self._target)
        for _ in range(2):
            begin = time.monotonic()
            self.rows.next(tried, len(tried.q) // 2, self._target)
            self._measure(begin)
        ahead = self.ahead * self.cycle + self.lead
        if not self._send(self.rows.first(self._target, ahead)):
            raise ControllerLost(f"The feeder was lost: {self.channel.describe_failure()}")
        super().start()

    def stop(self) -> None:
        """Stop the motion on its path, and end it there."""
        self._stopping = True

    def end(self) -> None:
        """Send no further chunks."""
        self._ended.set()
        if self.is_alive():
            self.join()

    def run(self) -> None:
        """Send chunks until the motion has ended."""
        try:
            while not self._ended.is_set():
                if self._is_due():
                    self._send_next()
                else:
                    self._ended.wait(READING_PERIOD)
        except ArmContourError as error:
            self.error = f"No further set-points can be computed: {error}"
        except Exception as error:  # noqa: BLE001 - the motion ends, and the cause must be known
            fault = f"{type(error).__name__}: {error}"
            self.error = f"No further set-points can be computed, because of a fault: {fault}"

    def _wanted(self) -> float:
        """Return the wanted override."""
        return 0.0 if self._stopping else self.override()

    def _is_due(self) -> bool:
        """Return whether the next chunk must be sent."""
        chunk = self.chunk
        if self._stop_sent or (chunk.pace.is_complete and self.due > chunk.brake):
            return False
        if self._stopping:
            return True
        wanted = self._wanted()
        if wanted != self._target or self.pause_after() != self._pauses_after:
            return wanted == 0.0 or time.monotonic() > self._sent_at + SHORTEST_CHUNK
        if wanted == 0.0 or chunk.pauses:
            # The motion rests at the end of the chunk until it is to go on.
            return False
        return self.due >= chunk.brake - round(CHUNK_MARGIN / self.cycle)

    def _send_next(self) -> None:
        """Compute and send the next chunk."""
        begin = time.monotonic()
        stopping = self._stopping
        target = self._wanted()
        pause_after = self.pause_after()
        k = max(self.due, self.chunk.k)
        chunk = self.rows.next(self.chunk, k, target, ends=stopping, pause_after=pause_after)
        self._measure(begin)
        self._sent_at = begin
        if self._send(chunk):
            self.braked += chunk.braked and self._target > 0.0
            self._target = target
            self._pauses_after = pause_after
            self._stop_sent = stopping

    def _measure(self, begin: float) -> None:
        """Set the lead to twice the longest time of the last computations, but one.

        - `begin`: time at which the last computation has begun [s].
        """
        self._durations.append(time.monotonic() - begin)
        second = sorted(self._durations)[-2:][0]
        self.lead = min(max(FIRST_LEAD, 2 * second + READING_PERIOD), LONGEST_LEAD)

    def _send(self, chunk: Chunk) -> bool:
        """Send a chunk; return whether the feeder has kept it."""
        self._number += 1
        head = f"C {self._number} {chunk.k} {int(not chunk.ends)}"
        self.channel.send([head, *rows_as_lines(chunk.q), "E"])
        end = time.monotonic() + ANSWER_TIMEOUT
        while self.channel.answer[0] < self._number:
            if not self.channel.alive or "D" in self.channel.events or time.monotonic() > end:
                return False
            time.sleep(1e-3)
        is_kept = self.channel.answer[1]
        if is_kept:
            self.chunk = chunk
            self.table.replace(chunk)
        return is_kept


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
        self,
        motion: Motion,
        stop_requested: Callable[[], bool] = lambda: False,
        override: Callable[[], float] = lambda: 1.0,
        show: Callable[[float], None] = lambda plan_time: None,
        pause_after: Callable[[], bool] = lambda: False,
    ) -> PlayedMotion:
        """Play a motion and record it.

        Args:
            motion: The motion, which begins at the commanded position.
            stop_requested: Called often; True stops the motion on its path, and ends it there.
            override: Called often by another thread; returns the wanted share of the speed, from 0
                (a pause on the path) to 1.
            show: Called ten times per second with the time of the plan that is executed [s].
            pause_after: Called often by another thread; while it returns True, the motion pauses
                at the end of the contour.

        Raises:
            ControllerRefused: The motion begins elsewhere; nothing moves.
            ControllerLost: The controller failed, or its process ended; with the record until then.
        """
        channel = self._connected()
        self._check_motion(motion)
        channel.events.clear()
        channel.answer = (0, False)
        first_sample = len(channel.samples)
        channel.send(["M"])
        sender = None
        if motion.rows is None:
            channel.send(["C 1 0 0", *rows_as_lines(motion.q), "E"])
        else:
            sender = _ChunkSender(channel, motion.rows, self, override, pause_after)
            sender.start()
        channel.send(["G"])
        notes: list[str] = []
        try:
            is_deviating = self._watch(motion, sender, first_sample, stop_requested, show, notes)
        finally:
            if sender is not None:
                sender.end()
        record = self._record(first_sample, motion, sender, notes)
        return replace(record, deviated=is_deviating)

    def _watch(
        self,
        motion: Motion,
        sender: _ChunkSender | None,
        first_sample: int,
        stop_requested: Callable[[], bool],
        show: Callable[[float], None],
        notes: list[str],
    ) -> bool:
        """Watch a motion until its end, and stop it if necessary; add the reason to the notes.

        Returns whether a joint has left its band.

        - `first_sample`: index of the first sample since the motion was sent.
        """
        channel = self._connected()
        # Number of samples whose deviation was checked.
        checked = first_sample
        is_stopping = sender is None
        has_begun = False
        shown_at = -SHOWN_PERIOD
        deviation = ""
        while "D" not in channel.events:
            if not channel.alive:
                lost = ControllerLost(f"{self.name} was lost: {channel.describe_failure()}")
                lost.record = self._record(first_sample, motion, sender, notes, lost=True)
                raise lost
            # An empty line shows the feeder that this process is alive.
            channel.send([""])
            rows = channel.samples[checked:]
            checked += len(rows)
            if not has_begun:
                # Samples before the first set-point belong to the motion before.
                rows = rows[next((i for i, x in enumerate(rows) if x[1] == 0), len(rows)) :]
                has_begun = bool(rows)
            if rows and sender is not None:
                sender.played = max(sender.played, int(rows[-1][1]))
                if time.monotonic() - shown_at > SHOWN_PERIOD:
                    shown_at = time.monotonic()
                    show(float(sender.table.at("plan_time", np.array([sender.played]))[0]))
                deviation = deviation or self._deviation(rows, motion, sender.table)
            if sender is not None and not is_stopping:
                reason = deviation or sender.error
                if reason or stop_requested():
                    is_stopping = True
                    sender.stop()
                    if reason:
                        notes.append(reason)
            if sender is not None and sender.error:
                # The motion ends with the rows that the feeder has.
                channel.send(["S"])
            time.sleep(READING_PERIOD)
        return bool(deviation)

    def _deviation(self, rows: Sequence[Sequence[float]], motion: Motion, table: _Table) -> str:
        """Say which joint left the band around its prediction; return "" if none did.

        `rows`: samples of the feeder, with the cycle in the second column.
        """
        samples = np.array(rows)
        samples = samples[samples[:, 1] >= 0]
        if not len(samples):
            return ""
        k = samples[:, 1].astype(int)
        measured = samples[:, 2 + motion.q.shape[1] :]
        errors = np.abs(measured - table.at("predicted", k))
        override = table.highest_rate(k, round(OVERRIDE_MEMORY / self.cycle))
        band = motion.band_at(override)
        if (errors <= band).all():
            return ""
        i, j = np.unravel_index(int((errors - band).argmax()), errors.shape)
        unit = unit_of(self._arm, "rad", int(j))
        return (
            f"Joint {j + 1} was {number(errors[i, j], unit)} from its predicted position in cycle "
            f"{k[i]}, above the allowed {number(band[i, j], unit)}. Check its drive, or identify "
            "its servo."
        )

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
        sender: _ChunkSender | None,
        notes: list[str],
        *,
        lost: bool = False,
    ) -> PlayedMotion:
        """Make the record of a motion from its samples.

        - `first_sample`: index of the first sample since the motion was sent.
        - `sender`: what has sent its chunks; None if the whole motion was sent at once.
        - `notes`: why the motion was stopped.
        - `lost`: whether the controller was lost, so that the motion is not recorded to its end.
        """
        channel = self._connected()
        dof = motion.q.shape[1]
        samples = np.array(channel.samples[first_sample:], dtype=float).reshape(-1, 2 + 2 * dof)
        # Before the first set-point, the controller may still hold the last set-point of another
        # motion.
        samples = samples[np.logical_or.accumulate(samples[:, 1] == 0) & (samples[:, 1] >= 0)]
        clock = samples[:, 0]
        k = samples[:, 1].astype(int)
        t = (clock - (clock[0] if len(clock) else 0.0)) * self.cycle
        command = samples[:, 2 : 2 + dof]
        stopped = None
        if sender is None:
            last = len(motion.q) - 1
            sent = predicted = motion.q[np.minimum(k, last)]
            plan_time = t
        else:
            last = sender.table.count - 1
            sent = sender.table.at("q", k)
            predicted = sender.table.at("predicted", k)
            plan_time = sender.table.at("plan_time", k)
            if not sender.chunk.pace.is_complete:
                stopped = max(sender.chunk.brake, 0)
        if lost and len(k):
            stopped = int(k[-1]) + 1
        if "U" in channel.events:
            ended = int(channel.events["U"][0])
            stopped = ended if stopped is None else min(stopped, ended)
            last = min(last, max(ended, 1) - 1)
            sent = sent[np.searchsorted(k, np.minimum(k, last))]
        missing = int((np.diff(clock) - 1).sum()) if len(clock) else 0
        # A motion ends with a rest, so repeated samples of the last row are not late.
        late = int((np.diff(k[k < last]) == 0).sum())
        deviations = np.abs(command - sent).max(axis=0, initial=0.0)
        deviation = float(deviations.max())
        notes = [*notes, *self._event_notes()]
        cause = "" if stopped is None else " ".join(notes)
        braked = 0 if sender is None else sender.braked
        if braked:
            notes.append(
                f"Set-points were computed too late {count_noun(braked, 'time')}, so the motion "
                "slowed down on its path and went on."
            )
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
        is_faithful = not (late or missing or braked or "U" in channel.events)
        return PlayedMotion(
            t=t,
            command=command,
            measured=samples[:, 2 + dof :],
            plan_time=plan_time,
            predicted=predicted,
            stopped=stopped,
            faithful=is_faithful and deviation <= RECORDED_TOLERANCE,
            cause=cause,
            notes=tuple(notes),
        )

    def _event_notes(self) -> Iterator[str]:
        """Yield the sentences for the events of the last motion."""
        events = self._connected().events
        for kind, sentence in EVENTS.items():
            if kind in events:
                yield sentence.format(" ".join(events[kind]))


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
