"""The loop of a feeder: sends rows of joint positions to a controller, and samples to the sender.

A feeder is a process between `Controller` and a robot. It holds the whole motion and the next stops
on the path, so it ends a motion on the path even if the process that started it is gone. It needs
only the standard library and the client library of its controller, since LinuxCNC's is compiled for
the Python of the system.

Lines to a feeder, with the cycle k of a motion counted from 0:

| line | meaning |
|---|---|
| `M` | a new motion; its rows follow |
| `T k` | a stop that replaces the motion from cycle k on; its rows follow |
| `P q1 q2 ...` | a row: joint positions [rad] |
| `H n` | the last row n times more |
| `E` | end of the rows |
| `G` | play the motion |
| `S` | take the next stop |
| (empty) | the sender is alive |
| `Q` | quit |

Lines from a feeder: `R q1 q2 ...` connected, at these commanded positions; `s number k command
measured` a sample of the controller's clock, k is -1 between motions; `X k` a stop from cycle k on;
`D` the motion has ended; `A` no later stop has come, so the last one is taken; `W` no sign of life,
so the next stop is taken; `V` the sender or a process of the feeder is gone, so the next stop is
taken; `N reason` the record cannot be written, so the next stop is taken; `U k` the controller had
no row for cycle k, so it ended the motion by itself; `C p` the speed slider of the controller was
set to p %, so the next stop is taken; `L t` if the feeder is gone, the controller
has stopped the joints after the time t [s]; `F message` the controller failed.
"""

from __future__ import annotations

import gc
import mmap
import os
import select
import signal
import sys
import time
import traceback
from collections import deque
from collections.abc import Iterable, Sequence
from contextlib import suppress
from typing import Any, Protocol

# Timeout of the sender: after this time without a line, the feeder executes the next stop [s].
SENDER_TIMEOUT = 0.5
# Timeout of a guarded feeder: after this time without a pass of its loop, its guard ends it and
# stops the motion [s].
LOOP_TIMEOUT = 0.2
# Number of stops that a guard stores.
GUARDED_STOPS = 8
# Time between two writes to the record [s].
RECORD_PERIOD = 0.05
# A controller without a FIFO is recorded at rest in every REST_RECORD_EVERY-th cycle.
REST_RECORD_EVERY = 50
# Pause of the loop between two readings of the controller [s].
LOOP_PAUSE = 1e-3
READ_SIZE = 1 << 20
# Maximum number of lines that the loop processes per pass during a motion: about 0.2 ms.
MAX_LINES_PER_PASS = 60
# Indices of the state that a feeder shares with its guard: number of passes of the loop, whether a
# motion is played, number of rows sent, and 1 + the first cycle of the stop that was taken.
STATE_LOOPS, STATE_PLAYING, STATE_SENT, STATE_TAKEN_STOP = range(4)
# Size of this state, four integers of 8 bytes [bytes].
STATE_SIZE = 32
Row = tuple[float, ...]
# Sample: count of the controller's clock, cycle of the motion, commanded and measured positions.
Sample = tuple[int, int, Row, Row]


class DeviceError(Exception):
    """The controller failed."""


class Device(Protocol):
    """Interface through which the feeder uses a controller."""

    def connect(self) -> Row:
        """Connect and hold the position; return the commanded joint positions [rad]."""

    def start(self) -> None:
        """Prepare a motion."""

    def take_limits(self, rows: Sequence[Row], new: bool) -> float:
        """Set the accelerations of a controller that stops by itself to the largest of some rows.

        Args:
            rows: Rows of a motion, or of a stop with the two rows before it.
            new: Whether a motion begins; else, limits are only increased.

        Returns:
            The time after which the controller has stopped if the feeder is gone [s].
        """

    def missed(self, all_sent: bool) -> int | None:
        """Return the first cycle without a row, so that the controller ended the motion; or None.

        Args:
            all_sent: Whether all rows of the motion were sent.
        """

    def room(self) -> int:
        """Return how many rows the controller can receive now."""

    def write(self, k: int, row: Row) -> None:
        """Send the row of cycle k."""

    def is_done(self) -> bool:
        """Return whether the controller has executed all rows that were sent."""

    def exchange(self) -> Iterable[Sample]:
        """Return the samples since the last call."""

    def finish(self) -> None:
        """End a motion."""

    def wait(self) -> None:
        """Wait for room or samples, for at most one cycle of the controller."""

    def close(self) -> None:
        """Disconnect."""


class GuardedDevice(Device, Protocol):
    """A controller that buffers rows, so that another process can continue a motion."""

    def take_over(self) -> int:
        """Connect during a motion; return how many rows the controller has received."""


class Pipe:
    """A pipe to the sender; a sender that does not read does not block the motion."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor = descriptor
        self.unsent = bytearray()
        os.set_blocking(descriptor, False)

    def write(self, text: str) -> None:
        """Append a text to the buffer."""
        self.unsent += text.encode()

    def flush(self) -> None:
        """Send as much of the buffer as the pipe accepts without waiting."""
        try:
            while self.unsent:
                del self.unsent[: os.write(self.descriptor, self.unsent)]
        except BlockingIOError:
            pass

    def close(self) -> None:
        """Send the whole buffer, and close."""
        os.set_blocking(self.descriptor, True)
        self.flush()
        os.close(self.descriptor)


class Record:
    """CSV file of all samples from the first motion on, which remains if the sender is gone.

    A line has the time by the controller's clock [s], the commanded and measured positions of all
    joints [rad], and the cycle of the motion. After an error of the disk, whole lines remain.

    Args:
        file: The file; lines are appended.
        cycle: Cycle of the controller's clock [s].

    Attributes:
        begun: Whether the first motion has begun; samples before are ignored.
        error: Why the file could not be written; empty if there was no error.
    """

    def __init__(self, file: str, cycle: float) -> None:
        self.file = file
        self.cycle = cycle
        self.begun = False
        self.error = ""
        self._descriptor = -1
        self._unwritten = bytearray()
        self._written_at = 0.0

    def add(self, sample: Sample) -> None:
        """Add a sample."""
        if not self.begun or self.error:
            return
        number, k, command, measured = sample
        values = (number * self.cycle, *command, *measured)
        line = ",".join(format(x, ".17g") for x in values)
        self._unwritten += f"{line},{k}\n".encode()

    def write(self, at_once: bool = False) -> None:
        """Write the samples if enough time has passed, or `at_once`; keep an error in `error`."""
        now = time.monotonic()
        if (
            self.error
            or not self._unwritten
            or (now - self._written_at < RECORD_PERIOD and not at_once)
        ):
            return
        self._written_at = now
        try:
            if self._descriptor < 0:
                flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
                self._descriptor = os.open(self.file, flags, 0o644)
            whole = os.fstat(self._descriptor).st_size
            try:
                while self._unwritten:
                    del self._unwritten[: os.write(self._descriptor, self._unwritten)]
            except OSError:
                # A pipe or a device cannot be truncated.
                with suppress(OSError):
                    os.ftruncate(self._descriptor, whole)
                raise
        except OSError as error:
            self.error = error.strerror or str(error)

    def close(self) -> None:
        """Write the rest, and close the file."""
        self.write(at_once=True)
        if self._descriptor >= 0:
            with suppress(OSError):
                os.close(self._descriptor)
            self._descriptor = -1


class Feeder:
    """Reads commands from stdin, plays motions on a device, and prints samples and events.

    Args:
        device: The controller.
        record: File of all samples.
        out: What gets the lines.
        state: Memory shared with a guard: integers with the indices STATE_LOOPS,
            STATE_PLAYING, STATE_SENT and STATE_TAKEN_STOP. None without a guard.
    """

    def __init__(
        self, device: Device, record: Record, out: Pipe, state: memoryview | None = None
    ) -> None:
        self.device = device
        self.record = record
        self.out = out
        self.guarded = state is not None
        self.state = memoryview(bytearray(STATE_SIZE)).cast("q") if state is None else state
        self.rows: list[Row] = []
        self.stops: dict[int, list[Row]] = {}
        self.block: list[Row] = []
        self.block_start: int | None = None
        self.rest = b""
        self.lines: deque[bytes] = deque()
        self.sent = 0
        self.playing = self.stop_requested = self.sender_lost = self.quitting = self.stopped = False
        self.ended = False
        self.heard = time.monotonic()

    def send_line(self, letter: str, *words: object) -> None:
        """Buffer a line for the sender; the docstring of this module explains its letter."""
        self.out.write(" ".join(map(str, (letter, *words))) + "\n")

    def flush(self) -> None:
        """Send buffered lines, if a reader exists."""
        try:
            self.out.flush()
        except BrokenPipeError:
            self.lose_reader()

    def lose_reader(self) -> None:
        """Discard further output, and continue as if the sender were lost."""
        self.out = Pipe(os.open(os.devnull, os.O_WRONLY))
        self.lose_sender()

    def lose_sender(self) -> None:
        """Continue without a sender, whose connection has failed: take the next stop, then quit."""
        if not self.quitting:
            self.send_line("V")
        self.sender_lost = self.stop_requested = self.quitting = True

    def run(self) -> None:
        """Connect, then process commands until the end."""
        # Ctrl-C on a terminal reaches all processes; only the sender reacts to it.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.set_blocking(0, False)
        try:
            self.send_line("R", *self.device.connect())
            self.flush()
            self.loop()
        except (DeviceError, OSError) as error:
            self.send_line("F", str(error).replace("\n", " | "))
        except Exception:
            traceback.print_exc()
            if self.guarded and self.playing:
                # The guard stops the motion on its path, which this process no longer can.
                os.kill(os.getpid(), signal.SIGKILL)
            raise
        finally:
            self.state[STATE_PLAYING] = 0
            self.end()

    def end(self) -> None:
        """Disconnect, and send the rest of the output."""
        self.flush()
        self.record.close()
        self.device.close()
        with suppress(BrokenPipeError):
            self.out.close()

    def loop(self) -> None:
        """Process commands and send rows until the end."""
        while not self.quitting or self.playing:
            # Rows are urgent, so they are sent before lines are read.
            self.feed()
            self.report()
            self.flush()
            self.read()
            self.state[STATE_LOOPS] = self.state[STATE_LOOPS] + 1
            self.state[STATE_PLAYING] = int(self.playing)
            self.device.wait()

    def read(self) -> None:
        """Read from stdin, and process the lines that have arrived."""
        if not self.sender_lost and select.select([0], [], [], 0)[0]:
            data = os.read(0, READ_SIZE)
            if data:
                self.take(data)
            else:
                self.lose_sender()
        else:
            self.obey_lines()
        is_silent = time.monotonic() - self.heard > SENDER_TIMEOUT
        if is_silent and self.playing and not self.sender_lost and not self.stop_requested:
            self.send_line("W")
            self.stop_requested = True

    def take(self, data: bytes) -> None:
        """Append received data to the buffer, and process its lines."""
        self.heard = time.monotonic()
        *lines, self.rest = (self.rest + data).split(b"\n")
        self.lines.extend(filter(None, lines))
        self.obey_lines()

    def obey_lines(self) -> None:
        """Process the buffered lines; during a motion, only a few."""
        count = 0
        while self.lines and not (self.playing and count >= MAX_LINES_PER_PASS):
            self.obey(self.lines.popleft().decode().split())
            count += 1

    def obey(self, words: list[str]) -> None:
        """Process one line of the sender; the docstring of this module explains its letter."""
        kind = words[0]
        if kind == "P":
            self.block.append(tuple(map(float, words[1:])))
        elif kind == "H":
            self.block += self.block[-1:] * int(words[1])
        elif kind in "MT":
            self.block = []
            self.block_start = int(words[1]) if kind == "T" else None
        elif kind == "E":
            self.end_block()
        elif kind == "G":
            if self.record.error:
                raise DeviceError(f"{self.record.file} cannot be written: {self.record.error}")
            self.send_line("L", self.device.take_limits(self.rows, new=True))
            self.extend_limits()
            self.device.start()
            self.record.begun = True
            self.sent = 0
            self.playing = True
            self.stop_requested = self.ended = False
            self.state[STATE_TAKEN_STOP] = 0
        elif kind == "S":
            self.stop_requested = self.playing
        elif kind == "Q":
            self.quitting = True
            self.stop_requested = self.playing

    def end_block(self) -> None:
        """Store the received rows as a motion or as a stop."""
        if self.block_start is None:
            self.rows = self.block
            self.stops = {}
            self.stopped = False
        elif not self.stopped:
            self.stops[self.block_start] = self.block
            if self.playing:
                self.extend_limits()

    def extend_limits(self) -> None:
        """Raise the controller's limits to those of the stop received last."""
        k = max(self.stops, default=len(self.rows))
        if k < len(self.rows):
            rows = self.rows[max(k - 2, 0) : k] + self.stops[k]
            settling = self.device.take_limits(rows, new=False)
            if self.playing:
                self.send_line("L", settling)

    def feed(self) -> None:
        """Send the next rows of the motion, or of the stop that replaces it."""
        if not self.playing:
            return
        missed = self.device.missed(self.sent == len(self.rows))
        if missed is not None and not self.ended:
            self.end_motion(missed)
        self.stops = {k: rows for k, rows in self.stops.items() if k >= self.sent}
        # Rows from the first cycle of the last received stop on are not sent, because then the
        # motion could no longer stop on the path.
        last = max(self.stops, default=len(self.rows))
        if self.stops and not self.stop_requested and last == self.sent < len(self.rows):
            self.send_line("A")
            self.stop_requested = True
        if self.stop_requested and self.stops:
            k = min(self.stops)
            self.take_stop(k)
            self.state[STATE_TAKEN_STOP] = k + 1
            self.send_line("X", k)
            last = len(self.rows)
        for _ in range(min(self.device.room(), last - self.sent, len(self.rows) - self.sent)):
            self.device.write(self.sent, self.rows[self.sent])
            self.sent += 1
            self.state[STATE_SENT] = self.sent
        if self.sent == len(self.rows) and self.device.is_done():
            self.report()
            self.device.finish()
            self.playing = False
            self.send_line("D")

    def end_motion(self, k: int) -> None:
        """Discard the rows from cycle k on, because the controller has ended the motion."""
        # At rest, no row is missing.
        if k == 0 or any(row != self.rows[k - 1] for row in self.rows[k:]):
            self.send_line("U", k)
        self.rows = self.rows[:k]
        self.sent = len(self.rows)
        self.stops = {}
        self.stop_requested = False
        self.ended = self.stopped = True

    def take_stop(self, k: int) -> None:
        """Replace the rows from cycle k on, and discard the stops of the old rows."""
        self.rows = self.rows[:k] + self.stops[k]
        self.stops = {}
        self.stop_requested = False
        self.stopped = True

    def report(self) -> None:
        """Record the new samples, and print them for the parent process."""
        for sample in self.device.exchange():
            number, k, command, measured = sample
            self.record.add(sample)
            self.send_line("s", number, k, *command, *measured)
        had_error = bool(self.record.error)
        self.record.write()
        if self.record.error and not had_error:
            self.send_line("N", self.record.error)
            self.stop_requested = self.stop_requested or self.playing


class Guard(Feeder):
    """Forwards lines to a feeder (its child process); stops the motion if the feeder fails.

    If the guard ends, the feeder stops, since it then has no sender.
    """

    device: GuardedDevice

    def __init__(self, child: int, pipe: Pipe, *of_feeder: Any) -> None:
        super().__init__(*of_feeder)
        self.child = child
        self.pipe = pipe

    def obey(self, words: list[str]) -> None:
        """Store rows and the latest stops, as the feeder does."""
        if words[0] in "PHMTE":
            super().obey(words)
        while len(self.stops) > GUARDED_STOPS:
            del self.stops[min(self.stops)]

    def run(self) -> None:
        """Forward lines until the feeder ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        # Number of passes of the feeder's loop, and the time of the last change [s].
        passes = -1
        passed_at = 0.0
        while True:
            if select.select([] if self.sender_lost else [0], [], [], LOOP_PAUSE)[0]:
                data = os.read(0, READ_SIZE)
                self.sender_lost = not data
                self.take(data)
                self.pipe.unsent += data
            self.pass_on()
            if passes != self.state[STATE_LOOPS] or not self.state[STATE_PLAYING]:
                passes = self.state[STATE_LOOPS]
                passed_at = time.monotonic()
            if self.state[STATE_PLAYING] and self.state[STATE_TAKEN_STOP] - 1 in self.stops:
                self.take_stop(self.state[STATE_TAKEN_STOP] - 1)
            ended, status = os.waitpid(self.child, os.WNOHANG)
            if not ended and time.monotonic() - passed_at > LOOP_TIMEOUT:
                os.kill(self.child, signal.SIGKILL)
                ended, status = os.waitpid(self.child, 0)
            if ended:
                break
        if os.WIFSIGNALED(status):
            self.stop()
        sys.exit(os.waitstatus_to_exitcode(status))

    def pass_on(self) -> None:
        """Send as much to the feeder as it accepts without waiting."""
        # A feeder that has failed has closed its end.
        with suppress(OSError):
            self.pipe.flush()
            if self.sender_lost and not self.pipe.unsent:
                self.pipe.close()

    def stop(self) -> None:
        """Stop the motion in place of the failed feeder, and disconnect."""
        # The last line of the feeder may be incomplete.
        self.send_line("")
        try:
            self.lose_sender()
            self.record.begun = True
            if self.state[STATE_PLAYING]:
                # Each of the two counts may lack the last row.
                self.sent = max(self.device.take_over(), self.state[STATE_SENT])
                self.playing = True
                for k, rows in self.stops.items():
                    self.device.take_limits(self.rows[max(k - 2, 0) : k] + rows, new=False)
                self.loop()
        except DeviceError as error:
            self.send_line("F", str(error).replace("\n", " | "))
        finally:
            self.end()


def take_stdout() -> Pipe:
    """Return the pipe to the sender on stdout; redirect prints of libraries to stderr."""
    out = Pipe(os.dup(1))
    os.dup2(2, 1)
    return out


def new_record() -> Record:
    """Make the record for the file and the cycle in the first two command-line arguments."""
    return Record(sys.argv[1], float(sys.argv[2]))


def main(device: Device, kind: type[Feeder] = Feeder) -> None:
    """Run a feeder of a kind; the first two command-line arguments are those of its record."""
    # A garbage collection can take longer than a cycle. The loop creates no cyclic garbage.
    gc.disable()
    kind(device, new_record(), take_stdout()).run()


def main_guarded(device: GuardedDevice) -> None:
    """Run a feeder behind a guard; the first two command-line arguments are those of its record."""
    out = take_stdout()
    lines, pipe = os.pipe()
    state = memoryview(mmap.mmap(-1, STATE_SIZE)).cast("q")
    child = os.fork()
    if child:
        os.close(lines)
        Guard(child, Pipe(pipe), device, new_record(), out, state).run()
    os.dup2(lines, 0)
    os.close(lines)
    os.close(pipe)
    Feeder(device, new_record(), out, state).run()
