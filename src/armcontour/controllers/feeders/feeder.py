"""The loop of a feeder: sends rows of joint positions to a controller, and samples to the sender.

A feeder is a process between `Controller` and a robot. The rows that it holds always end at rest on
the path, so a motion ends there even if the process that started it is gone. It needs only the
standard library and the client library of its controller, since LinuxCNC's is compiled for the
Python of the system.

Lines to a feeder, with the cycle k of a motion counted from 0:

| line | meaning |
|---|---|
| `M` | a new motion; its first block follows |
| `C number k more` | a block: rows from cycle k on; `more` is 0 if the motion ends there, else 1 |
| `P q1 q2 ...` | a row: joint positions [rad] |
| `H n` | the last row n times more |
| `E` | end of the rows |
| `G` | play the motion |
| `S` | the motion ends with the rows that the feeder has |
| (empty) | the sender is alive |
| `Q` | quit: the motion ends with its rows |

Lines from a feeder: `R q1 q2 ...` connected, at these commanded positions; `s number k command
measured` a sample of the controller's clock, k is -1 between motions; `K number` the block is kept;
`B number` the block came too late, or the motion ends with the rows before, so it is ignored; `D`
the motion has ended. For the following events, the motion ends with the rows that the feeder has:
`W` no sign of life, `V` the sender or a process of the feeder is gone, `N reason` the record cannot
be written, `C p` the speed slider of the controller was set to p %. `U k` the controller had no row
for cycle k, so it ended the motion by itself; `L t` if the feeder is gone, the controller has
stopped the joints after the time t [s]; `F message` the controller failed.
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
from typing import Any, NamedTuple, Protocol

# Timeout of the sender: after this time without a line, the motion ends with its rows [s].
SENDER_TIMEOUT = 0.5
# Timeout of a guarded feeder: after this time without a pass of its loop, its guard ends it and
# stops the motion [s].
LOOP_TIMEOUT = 0.2
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
# motion is played, number of rows sent, and the first of the last answers to blocks.
STATE_LOOPS, STATE_PLAYING, STATE_SENT, STATE_ANSWERS = range(4)
# Number of answers that the state holds. The answer to block n is at index n modulo this number: n
# if the block was kept, -n if it was not. Numbers of blocks begin with 1.
ANSWERS = 12
# Size of this state, integers of 8 bytes [bytes].
STATE_SIZE = 8 * (STATE_ANSWERS + ANSWERS)
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
            rows: Rows of a block with the two rows before it.
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


class Block(NamedTuple):
    """Rows that replace those of a motion from a cycle on."""

    number: int
    k: int
    # Whether another block can follow the rest at the end of the rows.
    more: bool
    rows: list[Row]


class Feeder:
    """Reads commands from stdin, plays motions on a device, and prints samples and events.

    Args:
        device: The controller.
        record: File of all samples.
        out: What gets the lines.
        state: Memory shared with a guard: integers with the indices STATE_LOOPS, STATE_PLAYING,
            STATE_SENT, and from STATE_ANSWERS on. None without a guard.
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
        self.block = Block(0, 0, False, [])
        self.rest = b""
        self.lines: deque[bytes] = deque()
        self.sent = 0
        # Whether another block can follow the last row, which is held until then.
        self.more = False
        self.playing = self.sender_lost = self.quitting = self.ended = False
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
        """Continue without a sender, whose connection has failed: end the motion, then quit."""
        if not self.quitting:
            self.send_line("V")
        self.sender_lost = self.quitting = True
        self.more = False

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
        if is_silent and self.playing and self.more:
            self.send_line("W")
            self.more = False

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
            self.block.rows.append(tuple(map(float, words[1:])))
        elif kind == "H":
            self.block.rows.extend(self.block.rows[-1:] * int(words[1]))
        elif kind == "M":
            self.rows = []
            self.sent = 0
            self.more = True
        elif kind == "C":
            number, k, more = map(int, words[1:])
            self.block = Block(number, k, bool(more), [])
        elif kind == "E":
            self.end_block()
        elif kind == "G":
            self.start()
        elif kind == "S":
            self.more = False
        elif kind == "Q":
            self.quitting = True
            self.more = False

    def start(self) -> None:
        """Play the motion."""
        if self.record.error:
            raise DeviceError(f"{self.record.file} cannot be written: {self.record.error}")
        self.send_line("L", self.device.take_limits(self.rows, new=True))
        self.device.start()
        self.record.begun = True
        self.playing = True
        self.ended = False

    def end_block(self) -> None:
        """Keep the received rows, unless they come too late or the motion ends without them."""
        block = self.block
        is_kept = self.more and self.sent <= block.k
        self.answer(block.number, is_kept)
        if is_kept:
            self.keep(block)
            if self.playing:
                rows = self.rows[max(block.k - 2, 0) :]
                self.send_line("L", self.device.take_limits(rows, new=False))

    def answer(self, number: int, is_kept: bool) -> None:
        """Say whether a block is kept."""
        self.state[STATE_ANSWERS + number % ANSWERS] = number if is_kept else -number
        self.send_line("K" if is_kept else "B", number)

    def keep(self, block: Block) -> None:
        """Replace the rows from the first cycle of a block on."""
        self.hold_until(block.k)
        self.rows[block.k :] = block.rows
        self.more = block.more

    def hold_until(self, k: int) -> None:
        """Repeat the last row, a rest, until a cycle."""
        self.rows.extend(self.rows[-1:] * (k - len(self.rows)))

    def feed(self) -> None:
        """Send the next rows of the motion, and hold the last one while more can follow."""
        if not self.playing:
            return
        missed = self.device.missed(self.sent == len(self.rows))
        if missed is not None and not self.ended:
            self.end_motion(missed)
        for _ in range(self.device.room()):
            if self.sent == len(self.rows):
                if not self.more:
                    break
                self.hold_until(self.sent + 1)
            self.device.write(self.sent, self.rows[self.sent])
            self.sent += 1
            self.state[STATE_SENT] = self.sent
        if self.sent == len(self.rows) and not self.more and self.device.is_done():
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
        self.more = False
        self.ended = True

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
            self.more = False


class Guard(Feeder):
    """Forwards lines to a feeder (its child process); ends the motion if the feeder fails.

    If the guard ends, the feeder ends the motion, since it then has no sender.
    """

    device: GuardedDevice

    def __init__(self, child: int, pipe: Pipe, *of_feeder: Any) -> None:
        super().__init__(*of_feeder)
        self.child = child
        self.pipe = pipe
        # Blocks that the feeder has not answered yet.
        self.unanswered: deque[Block] = deque()

    def obey(self, words: list[str]) -> None:
        """Store the blocks of a motion, as the feeder does."""
        if words[0] in "PHMC":
            super().obey(words)
        elif words[0] == "E":
            self.unanswered.append(self.block)

    def follow(self) -> None:
        """Keep the blocks that the feeder has kept."""
        while self.unanswered:
            block = self.unanswered[0]
            answer = self.state[STATE_ANSWERS + block.number % ANSWERS]
            if abs(answer) < block.number:
                return
            self.unanswered.popleft()
            if answer == block.number:
                self.keep(block)

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
            self.follow()
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
            self.follow()
            self.lose_sender()
            self.record.begun = True
            if self.state[STATE_PLAYING]:
                # Each of the two counts may lack the last row.
                self.sent = max(self.device.take_over(), self.state[STATE_SENT])
                self.hold_until(self.sent)
                self.playing = True
                self.device.take_limits(self.rows[max(self.sent - 2, 0) :], new=False)
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
