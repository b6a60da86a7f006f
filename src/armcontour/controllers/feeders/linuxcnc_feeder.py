"""Feeder for LinuxCNC's HAL: sends rows to a streamer, and reads samples from a sampler.

It is run by the Python of the system, for which LinuxCNC's module `hal` is compiled.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterable

import hal  # type: ignore[import-not-found]

from armcontour.controllers.feeders.feeder import PAUSE, DeviceError, Row, Sample, main_guarded

COMPONENT = "armcontour-play"
# Signal of the HAL file that enables the drives.
ENABLE = "armcontour-enable"
# Timeout of the servo thread: it counts as dead after this time without a sample [s].
SILENCE = 1.0
# Largest motion of a disabled joint between a connection and the first motion [rad].
STILL = 1e-3
# Number of successive equal readings of the FIFO that are required.
AGREEING = 5
# Time between two readings of the FIFO [s].
LOOK = 1.7e-3
PROGRAM = "/usr/bin/rtapi_app"
# Beginnings of lines that halcmd always prints.
USUAL = ("Running with fallback_uid", "Note: Using POSIX")


class LinuxCNCDevice:
    """HAL with a streamer of n + 1 floats and a sampler of 2 n + 1.

    The first float of both is the cycle of the motion, -1 at rest. The others are the commands of
    the joints, and in the sampler their measured positions [rad].

    Args:
        file: HAL file that loads components and threads; `start` is called after it.
        ahead: Rows that the FIFO holds, against pauses of this process.
        dof: Number of joints.
    """

    def __init__(self, file: str, ahead: int, dof: int) -> None:
        self.file = file
        self.ahead = ahead
        self.dof = dof
        self.waiting = self.enabled = self.is_used = False

    def connect(self) -> Row:
        """Load the HAL file, start threads, and command the measured position; drives are off."""
        components = self.halcmd("list", "comp").split()
        self.is_used = not all(x.startswith("halcmd") for x in components)
        if self.is_used:
            raise DeviceError("HAL is in use. End LinuxCNC first (halrun -U unloads its rest)")
        self.halcmd("-f", self.file)
        self.attach(COMPONENT)
        self.halcmd("start")
        self.held = self.hold()
        return self.held

    def hold(self) -> Row:
        """Command the measured position, and return it."""
        held = self.next_sample()[3]
        self.write(-1, held)
        while self.next_sample()[2] != held:
            pass
        return held

    def attach(self, name: str) -> None:
        """Open the FIFOs."""
        self.component = hal.component(name)
        self.component.ready()
        self.out = hal.stream(self.component, hal.streamer_base, "f" * (self.dof + 1))
        self.back = hal.stream(self.component, hal.sampler_base, "f" * (2 * self.dof + 1))
        self.heard = time.monotonic()

    def take_over(self) -> int:
        """Continue a motion; returns the number of rows received, or one less if the FIFO wraps."""
        self.attach(f"{COMPONENT}-guard")
        self.waiting = True
        seen: list[int] = []
        # The thread may have read a row but not yet set its pins, so several readings must agree.
        while len(seen) < AGREEING or len(set(seen[-AGREEING:])) > 1:
            depth = int(self.out.depth)
            k = int(hal.get_value("streamer.0.pin.0"))
            if depth == int(self.out.depth):
                seen.append(k + depth + 1)
            time.sleep(LOOK)
        return seen[-1]

    def next_sample(self) -> Sample:
        """The next sample of the thread."""
        while not self.back.readable:
            self.check_alive()
            time.sleep(1e-3)
        return next(iter(self.exchange()))

    def check_alive(self) -> None:
        """Raise DeviceError if the thread writes no samples."""
        if time.monotonic() - self.heard > SILENCE:
            raise DeviceError(f"HAL's servo thread has written no sample for {SILENCE:g} s")

    def halcmd(self, *words: str) -> str:
        """Run halcmd and return its output, without a pipe: rtapi_app would keep it open."""
        name = os.path.join(os.path.dirname(self.file), "halcmd.txt")
        with open(name, "w") as output:
            done = subprocess.run(
                ["halcmd", *words], stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        with open(name, errors="replace") as output:
            printed = "".join(x for x in output if not x.startswith(USUAL)).strip()
        if done.returncode:
            raise DeviceError(printed.replace(f"{os.path.dirname(self.file)}/", ""))
        return printed

    def start(self) -> None:
        """Enable the drives, and disable the streamer until the FIFO is filled."""
        if not self.enabled:
            # Disabled joints may have moved since the connection.
            moved = max(abs(a - b) for a, b in zip(self.hold(), self.held, strict=True))
            if moved > STILL:
                raise DeviceError(f"a joint has moved by {moved:.4f} rad while drives were off")
            self.halcmd("sets", ENABLE, "1")
            self.enabled = True
        hal.set_p("streamer.0.enable", "0")
        self.waiting = True

    def room(self) -> int:
        """Number of rows that fill the FIFO up to `ahead`."""
        return max(self.ahead - int(self.out.depth), 0)

    def write(self, k: int, row: Row) -> None:
        """Put one row into the FIFO."""
        self.out.write((float(k), *row))

    def is_done(self) -> bool:
        """Return whether the FIFO is empty."""
        return int(self.out.depth) == 0

    def exchange(self) -> Iterable[Sample]:
        """Samples of the thread; the first call in a motion enables the streamer."""
        if self.waiting:
            hal.set_p("streamer.0.enable", "1")
            self.waiting = False
        if not self.back.readable:
            self.check_alive()
        while self.back.readable:
            self.heard = time.monotonic()
            values = self.back.read()
            yield (
                int(self.back.sampleno),
                int(values[0]),
                tuple(values[1 : 1 + self.dof]),
                tuple(values[1 + self.dof :]),
            )

    def finish(self) -> None:
        """Hold the last row, with -1 as its cycle."""
        names = (f"streamer.0.pin.{j + 1}" for j in range(self.dof))
        self.write(-1, tuple(float(hal.get_value(x)) for x in names))

    def wait(self) -> None:
        """Pause: the FIFO contains rows for many cycles."""
        time.sleep(PAUSE)

    def close(self) -> None:
        """Stop the threads and unload HAL, unless another program uses it."""
        if self.is_used:
            return
        for name in ("out", "back"):
            self.__dict__.pop(name, None)
        if hasattr(self, "component"):
            self.component.exit()
        no = subprocess.DEVNULL
        disable = ("halcmd", "sets", ENABLE, "0")
        for words in (disable, ("halcmd", "stop"), ("halcmd", "unload", "all"), (PROGRAM, "exit")):
            subprocess.run(words, stdin=no, stdout=no, stderr=no)


if __name__ == "__main__":
    main_guarded(LinuxCNCDevice(sys.argv[2], int(sys.argv[3]), int(sys.argv[4])))
