"""The loop of a feeder: sends the rows of a motion to a controller, and samples back.

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
| `E` | end of the rows |
| `G` | play the motion |
| `S` | take the next stop |
| (empty) | the sender is alive |
| `Q` | quit |

Lines from a feeder: `R q1 q2 ...` connected, at these commanded positions; `s number k command
measured` a sample of the controller's clock, k is -1 between motions; `X k` a stop from cycle k on;
`D` the motion has ended; `A` no later stop has come, so the last one is taken; `W` no sign of life,
so the next stop is taken; `V` the sender or a process of the feeder is gone, so the next stop is
taken; `F message` the controller failed. A cycle that a sample repeats had no row in time.
"""

from __future__ import annotations

import gc
import mmap
import os
import select
import signal
import sys
import time
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from typing import Protocol

# Longest time without a line from the sender before the next stop is taken [s].
SILENCE = 0.5
# Longest pause of a guarded feeder before its guard takes its place [s].
HALT = 0.2
# Stops that a guard keeps.
KEPT = 8
# Pause of the loop between two looks at the controller [s].
PAUSE = 1e-3
BLOCK = 1 << 20
# Largest number of lines that are obeyed in a loop of a motion: about 0.2 ms.
LINES = 60
Row = tuple[float, ...]
# Number by the controller's clock, cycle of the motion, command and measured positions.
Sample = tuple[int, int, Row, Row]


class DeviceError(Exception):
    """The controller failed."""


class Device(Protocol):
    """Interface of a controller for its feeder."""

    def connect(self) -> Row:
        """Connect, hold the position, and return the commanded joint positions."""

    def start(self) -> None:
        """Prepare a motion."""

    def room(self) -> int:
        """Number of rows that the controller takes now."""

    def write(self, k: int, row: Row) -> None:
        """Send the row of cycle k."""

    def is_done(self) -> bool:
        """True if all rows that were sent are executed."""

    def samples(self) -> Iterable[Sample]:
        """Samples since the last call."""

    def finish(self) -> None:
        """End a motion."""

    def wait(self) -> None:
        """Wait until there may be room or samples, one cycle of the controller at most."""

    def close(self) -> None:
        """Disconnect."""


class GuardedDevice(Device, Protocol):
    """A controller that holds rows, so that another process can go on where one has ended."""

    def take_over(self) -> int:
        """Connect to the moving controller; number of rows of the motion that it has got."""


class Output(Protocol):
    """Output for lines, with an unlimited buffer."""

    def write(self, text: str, /) -> object:
        """Keep a text."""

    def flush(self) -> object:
        """Send as much as is taken now."""

    def close(self) -> object:
        """Send all."""


class Pipe:
    """A pipe to the sender. A sender that does not read does not halt a motion."""

    def __init__(self, descriptor: int) -> None:
        self.descriptor, self.unsent = descriptor, bytearray()
        os.set_blocking(descriptor, False)

    def write(self, text: str, /) -> None:
        """Keep a text."""
        self.unsent += text.encode()

    def flush(self) -> None:
        """Send as much as the pipe takes."""
        try:
            while self.unsent:
                del self.unsent[: os.write(self.descriptor, self.unsent)]
        except BlockingIOError:
            pass

    def close(self) -> None:
        """Send all."""
        os.set_blocking(self.descriptor, True)
        self.flush()


class Feeder:
    """Reads lines from stdin, plays motions on a device, and prints lines.

    Args:
        device: The controller.
        record: File that gets every sample, which remains if the sender is gone.
        out: What gets the lines.
        state: Memory shared with a guard: number of loops, whether a motion is played, number of
            rows sent, and 1 + the cycle of the stop that was taken.
    """

    def __init__(
        self, device: Device, record: str, out: Output, state: memoryview | None = None
    ) -> None:
        self.device, self.record, self.out = device, open(record, "a"), out
        self.state = memoryview(bytearray(32)).cast("q") if state is None else state
        self.rows: list[Row] = []
        self.stops: dict[int, list[Row]] = {}
        self.block: list[Row] = []
        self.block_start: int | None = None
        self.rest = b""
        self.lines: deque[bytes] = deque()
        self.sent = 0
        self.playing = self.stop_requested = self.orphaned = self.quitting = self.stopped = False
        self.heard = time.monotonic()

    def say(self, *words: object) -> None:
        """Print a line; nothing if no process reads."""
        try:
            self.out.write(" ".join(map(str, words)) + "\n")
        except BrokenPipeError:
            self.lose_reader()

    def flush(self) -> None:
        """Send printed lines."""
        try:
            self.out.flush()
        except BrokenPipeError:
            self.lose_reader()

    def lose_reader(self) -> None:
        """Print to nowhere, and go on alone."""
        self.out = open(os.devnull, "w")
        self.lose_sender()

    def lose_sender(self) -> None:
        """Go on alone: take the next stop, then quit."""
        if not self.quitting:
            self.say("V")
        self.orphaned = self.stop_requested = self.quitting = True

    def run(self) -> None:
        """Connect and obey until the end."""
        # Ctrl-C of a terminal reaches all processes; the sender decides.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.set_blocking(0, False)
        try:
            self.say("R", *self.device.connect())
            self.flush()
            self.loop()
        except DeviceError as error:
            self.say("F", str(error).replace("\n", " | "))
        finally:
            self.state[1] = 0
            self.end()

    def end(self) -> None:
        """Disconnect, and send what is left."""
        self.flush()
        self.record.close()
        self.device.close()
        with suppress(BrokenPipeError):
            self.out.close()

    def loop(self) -> None:
        """Obey and feed until the end."""
        while not self.quitting or self.playing:
            # Controllers wait for rows, so lines come after them.
            self.feed()
            self.report()
            self.flush()
            self.read()
            self.state[0], self.state[1] = self.state[0] + 1, int(self.playing)
            self.device.wait()

    def read(self) -> None:
        """Obey the lines that have arrived."""
        if not self.orphaned and select.select([0], [], [], 0)[0]:
            data = os.read(0, BLOCK)
            if data:
                self.take(data)
            else:
                self.lose_sender()
        else:
            self.obey_lines()
        if (
            not self.orphaned
            and self.playing
            and not self.stop_requested
            and time.monotonic() - self.heard > SILENCE
        ):
            self.say("W")
            self.stop_requested = True

    def take(self, data: bytes) -> None:
        """Receive data, and obey its lines."""
        self.heard = time.monotonic()
        *lines, self.rest = (self.rest + data).split(b"\n")
        self.lines.extend(filter(None, lines))
        self.obey_lines()

    def obey_lines(self) -> None:
        """Obey the lines that have arrived; during a motion a few of them."""
        obeyed = 0
        while self.lines and not (self.playing and obeyed >= LINES):
            self.obey(self.lines.popleft().decode().split())
            obeyed += 1

    def obey(self, words: list[str]) -> None:
        """Obey one line."""
        kind = words[0]
        if kind == "P":
            self.block.append(tuple(map(float, words[1:])))
        elif kind in "MT":
            self.block, self.block_start = [], int(words[1]) if kind == "T" else None
        elif kind == "E" and self.block_start is None:
            self.rows, self.stops, self.stopped = self.block, {}, False
        elif kind == "E" and not self.stopped:
            self.stops[self.block_start or 0] = self.block
        elif kind == "G":
            self.device.start()
            self.sent, self.playing, self.stop_requested = 0, True, False
            self.state[3] = 0
        elif kind == "S":
            self.stop_requested = self.playing
        elif kind == "Q":
            self.quitting, self.stop_requested = True, self.playing

    def feed(self) -> None:
        """Send rows, or the rows of the next stop."""
        if not self.playing:
            return
        self.stops = {k: rows for k, rows in self.stops.items() if k >= self.sent}
        # Rows after the last stop in hand are not sent: then nothing could stop on the path.
        last = max(self.stops, default=len(self.rows))
        if self.stops and not self.stop_requested and last == self.sent < len(self.rows):
            self.say("A")
            self.stop_requested = True
        if self.stop_requested and self.stops:
            k = min(self.stops)
            self.take_stop(k)
            self.state[3] = k + 1
            self.say("X", k)
            last = len(self.rows)
        for _ in range(min(self.device.room(), last - self.sent, len(self.rows) - self.sent)):
            self.device.write(self.sent, self.rows[self.sent])
            self.sent += 1
            self.state[2] = self.sent
        if self.sent == len(self.rows) and self.device.is_done():
            self.report()
            self.device.finish()
            self.playing = False
            self.say("D")

    def take_stop(self, k: int) -> None:
        """Replace the rows from cycle k on. Other stops leave the motion that was replaced."""
        self.rows = self.rows[:k] + self.stops[k]
        self.stops, self.stop_requested, self.stopped = {}, False, True

    def report(self) -> None:
        """Print the samples."""
        for number, k, command, measured in self.device.samples():
            line = " ".join(map(repr, (number, k, *command, *measured)))
            self.record.write(line + "\n")
            self.say("s", line)


class Guard(Feeder):
    """Passes lines on to a feeder, its child process, and stops in its place if it ends or halts.

    If the guard ends, the feeder stops, since it then has no sender.
    """

    device: GuardedDevice

    def __init__(
        self,
        device: GuardedDevice,
        record: str,
        out: Output,
        state: memoryview,
        child: int,
        pipe: int,
    ) -> None:
        super().__init__(device, record, out, state)
        self.child, self.pipe = child, pipe
        self.waiting = b""

    def obey(self, words: list[str]) -> None:
        """Keep rows and the latest stops, which the feeder has, too."""
        if words[0] in "PMTE":
            super().obey(words)
        while len(self.stops) > KEPT:
            del self.stops[min(self.stops)]

    def run(self) -> None:
        """Pass lines on until the feeder ends."""
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)
        os.set_blocking(self.pipe, False)
        loops, moved = -1, 0.0
        while True:
            if select.select([] if self.orphaned else [0], [], [], PAUSE)[0]:
                data = os.read(0, BLOCK)
                self.orphaned = not data
                self.take(data)
                self.waiting += data
            self.pass_on()
            if loops != self.state[0] or not self.state[1]:
                loops, moved = self.state[0], time.monotonic()
            if self.state[1] and self.state[3] - 1 in self.stops:
                self.take_stop(self.state[3] - 1)
            ended, status = os.waitpid(self.child, os.WNOHANG)
            if not ended and time.monotonic() - moved > HALT:
                os.kill(self.child, signal.SIGKILL)
                ended, status = os.waitpid(self.child, 0)
            if ended:
                break
        if os.WIFSIGNALED(status):
            self.stop()
        sys.exit(os.waitstatus_to_exitcode(status))

    def pass_on(self) -> None:
        """Send as much to the feeder as it takes."""
        try:
            while self.waiting:
                self.waiting = self.waiting[os.write(self.pipe, self.waiting) :]
        except BlockingIOError:
            return
        except OSError:
            self.waiting = b""
        if self.orphaned and self.pipe >= 0:
            os.close(self.pipe)
            self.pipe = -1

    def stop(self) -> None:
        """Stop the motion in place of the feeder, and disconnect."""
        # The feeder may have ended within a line.
        self.say("")
        try:
            self.lose_sender()
            if self.state[1]:
                # Both counts may miss the last row.
                self.sent = max(self.device.take_over(), self.state[2])
                self.playing = True
                self.loop()
        except DeviceError as error:
            self.say("F", str(error).replace("\n", " | "))
        finally:
            self.end()


def take_stdout() -> Output:
    """The channel to the sender; what libraries print goes to stderr."""
    out = Pipe(os.dup(1))
    os.dup2(2, 1)
    return out


def main(device: Device) -> None:
    """Run a feeder whose first argument is the file that gets the samples."""
    # A collection takes longer than a cycle, and there is nothing to collect.
    gc.disable()
    Feeder(device, sys.argv[1], take_stdout()).run()


def main_guarded(device: GuardedDevice) -> None:
    """Run a feeder behind a guard; the first argument is the file that gets the samples."""
    out = take_stdout()
    lines, pipe = os.pipe()
    state = memoryview(mmap.mmap(-1, 32)).cast("q")
    child = os.fork()
    if child:
        os.close(lines)
        Guard(device, sys.argv[1], out, state, child, pipe).run()
    os.dup2(lines, 0)
    os.close(lines)
    os.close(pipe)
    Feeder(device, sys.argv[1], out, state).run()
