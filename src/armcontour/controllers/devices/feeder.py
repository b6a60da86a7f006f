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
`D` the motion has ended; `W` no sign of life, so the next stop is taken; `F message` the controller
failed. A cycle that a sample repeats had no row in time.
"""

from __future__ import annotations

import gc
import os
import select
import signal
import sys
import time
from collections import deque
from collections.abc import Iterable
from typing import Protocol

# Longest time without a line from the sender before the next stop is taken [s].
SILENCE = 0.5
# Pause of the loop between two looks at the controller [s].
PAUSE = 1e-3
BLOCK = 1 << 20
# Largest number of lines that are obeyed between two cycles of a motion: about 0.2 ms.
LINES = 60
Row = tuple[float, ...]
# Number by the controller's clock, cycle of the motion, command and measured positions.
Sample = tuple[int, int, Row, Row]


class DeviceError(Exception):
    """The controller failed."""


class Device(Protocol):
    """What a feeder needs of a controller."""

    def connect(self) -> Row:
        """Connect, hold the position, and return the commanded joint positions."""

    def start(self) -> None:
        """Prepare a motion."""

    def room(self) -> int:
        """Number of rows that the controller takes now."""

    def write(self, k: int, row: Row) -> None:
        """Send the row of cycle k."""

    def is_done(self) -> bool:
        """Whether all rows that were sent are executed."""

    def samples(self) -> Iterable[Sample]:
        """Samples since the last call."""

    def finish(self) -> None:
        """End a motion."""

    def wait(self) -> None:
        """Wait until there may be room or samples: a cycle of the controller at most, about."""

    def close(self) -> None:
        """Disconnect."""


class Feeder:
    """Reads lines from stdin, plays motions on a device, and prints lines.

    Args:
        device: The controller.
        record: File that gets every sample, which remains if the sender is gone.
    """

    def __init__(self, device: Device, record: str) -> None:
        self.device, self.record = device, open(record, "w")
        # Libraries may print to stdout, which is the channel to the sender. A sender that does not
        # read must not halt a motion.
        self.out, self.unsent = os.dup(1), bytearray()
        os.set_blocking(self.out, False)
        os.dup2(2, 1)
        self.lines: deque[bytes] = deque()
        self.rows: list[Row] = []
        self.stops: dict[int, list[Row]] = {}
        self.block: list[Row] = []
        self.block_start: int | None = None
        self.rest = b""
        self.sent = 0
        self.playing = self.stop_wanted = self.orphaned = self.quitting = False
        self.heard = time.monotonic()

    def say(self, *words: object) -> None:
        """Print a line; nothing if no process reads."""
        if not self.orphaned:
            self.unsent += (" ".join(map(str, words)) + "\n").encode()

    def flush(self) -> None:
        """Send as much of the printed lines as the sender takes."""
        try:
            while self.unsent:
                del self.unsent[: os.write(self.out, self.unsent)]
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self.lose_sender()

    def lose_sender(self) -> None:
        """Go on alone: take the next stop, then quit."""
        self.orphaned = self.stop_wanted = True
        self.unsent.clear()

    def run(self) -> None:
        """Connect and obey until the end."""
        # Ctrl-C of a terminal reaches all processes; the sender decides.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.set_blocking(0, False)
        try:
            self.say("R", *self.device.connect())
            self.flush()
            while not self.quitting or self.playing:
                self.read()
                self.feed()
                self.report()
                self.flush()
                self.device.wait()
        except DeviceError as error:
            self.say("F", str(error).replace("\n", " | "))
        finally:
            self.device.close()
            self.record.close()
            os.set_blocking(self.out, True)
            self.flush()

    def read(self) -> None:
        """Obey the lines that have arrived."""
        while not self.orphaned and select.select([0], [], [], 0)[0]:
            data = os.read(0, BLOCK)
            if not data:
                self.lose_sender()
                break
            self.heard = time.monotonic()
            *lines, self.rest = (self.rest + data).split(b"\n")
            self.lines.extend(filter(None, lines))
        obeyed = 0
        while self.lines and not (self.playing and obeyed >= LINES):
            self.obey(self.lines.popleft().decode().split())
            obeyed += 1
        if self.orphaned:
            self.quitting = True
        elif self.playing and not self.stop_wanted and time.monotonic() - self.heard > SILENCE:
            self.say("W")
            self.stop_wanted = True

    def obey(self, words: list[str]) -> None:
        """Obey one line."""
        kind = words[0]
        if kind == "P":
            self.block.append(tuple(map(float, words[1:])))
        elif kind in "MT":
            self.block, self.block_start = [], int(words[1]) if kind == "T" else None
        elif kind == "E" and self.block_start is None:
            self.rows, self.stops = self.block, {}
        elif kind == "E":
            self.stops[self.block_start or 0] = self.block
        elif kind == "G":
            self.device.start()
            self.sent, self.playing, self.stop_wanted = 0, True, False
        elif kind == "S":
            self.stop_wanted = self.playing
        elif kind == "Q":
            self.quitting, self.stop_wanted = True, self.playing

    def feed(self) -> None:
        """Send rows, or the rows of the next stop."""
        if not self.playing:
            return
        self.stops = {k: rows for k, rows in self.stops.items() if k >= self.sent}
        if self.stop_wanted and self.stops:
            k = min(self.stops)
            self.rows = self.rows[:k] + self.stops[k]
            self.stops, self.stop_wanted = {}, False
            self.say("X", k)
        for _ in range(min(self.device.room(), len(self.rows) - self.sent)):
            self.device.write(self.sent, self.rows[self.sent])
            self.sent += 1
        if self.sent == len(self.rows) and self.device.is_done():
            self.device.finish()
            self.report()
            self.playing = False
            self.say("D")

    def report(self) -> None:
        """Print the samples."""
        for number, k, command, measured in self.device.samples():
            line = " ".join(map(repr, (number, k, *command, *measured)))
            self.record.write(line + "\n")
            self.say("s", line)


def main(device: Device) -> None:
    """Run a feeder whose first argument is the file that gets the samples."""
    # A collection takes longer than a cycle, and there is nothing to collect.
    gc.disable()
    Feeder(device, sys.argv[1]).run()
