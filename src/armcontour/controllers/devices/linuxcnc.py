"""Feeder for LinuxCNC's HAL: rows to a streamer, samples from a sampler.

It is run by the Python of the system, for which LinuxCNC's module `hal` is compiled.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterable

import hal  # type: ignore[import-not-found]

from armcontour.controllers.devices.feeder import PAUSE, DeviceError, Row, Sample, main

COMPONENT = "armcontour-play"
# Rows of the position that the FIFO holds before the thread starts.
HELD = 20
PROGRAM = "/usr/bin/rtapi_app"


class LinuxCNC:
    """HAL with a streamer of n + 1 floats and a sampler of 2 n + 1.

    The first float of both is the cycle of the motion, -1 at rest. The others are the commands of
    the joints, and in the sampler their measured positions [rad].

    Args:
        file: HAL file that loads components and threads; `start` is called after it.
        ahead: Rows that the FIFO holds, against pauses of this process.
        start: Joint positions at the start [rad].
    """

    def __init__(self, file: str, ahead: int, start: Row) -> None:
        self.file, self.ahead, self.start_row, self.dof = file, ahead, start, len(start)

    def connect(self) -> Row:
        """Load the HAL file, fill the FIFO with the start, and start the threads."""
        _halcmd("-f", self.file)
        self.component = hal.component(COMPONENT)
        self.component.ready()
        self.out = hal.stream(self.component, hal.streamer_base, "f" * (self.dof + 1))
        self.back = hal.stream(self.component, hal.sampler_base, "f" * (2 * self.dof + 1))
        for _ in range(HELD):
            self.out.write((-1.0, *self.start_row))
        _halcmd("start")
        return self.start_row

    def start(self) -> None:
        """The FIFO takes rows at any time."""

    def room(self) -> int:
        """Rows until the FIFO holds `ahead`."""
        return max(self.ahead - int(self.out.depth), 0)

    def write(self, k: int, row: Row) -> None:
        """Put one row into the FIFO."""
        self.out.write((float(k), *row))
        self.held = row

    def is_done(self) -> bool:
        """Whether the FIFO is empty."""
        return int(self.out.depth) == 0

    def samples(self) -> Iterable[Sample]:
        """Samples of the thread."""
        while self.back.readable:
            values = self.back.read()
            yield (
                int(self.back.sampleno),
                int(values[0]),
                tuple(values[1 : 1 + self.dof]),
                tuple(values[1 + self.dof :]),
            )

    def finish(self) -> None:
        """Hold the last row, as no cycle of a motion."""
        self.out.write((-1.0, *self.held))

    def wait(self) -> None:
        """Pause; the FIFO holds rows for many cycles."""
        time.sleep(PAUSE)

    def close(self) -> None:
        """Stop the threads and unload HAL."""
        for name in ("out", "back"):
            self.__dict__.pop(name, None)
        if hasattr(self, "component"):
            self.component.exit()
        for words in (("halcmd", "stop"), ("halcmd", "unload", "all"), (PROGRAM, "exit")):
            subprocess.run(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.STDOUT
            )


def _halcmd(*words: str) -> None:
    """Run halcmd; rtapi_app keeps what it inherits, so it must not get a pipe."""
    with open("halcmd.txt", "w") as output:
        done = subprocess.run(
            ["halcmd", *words], stdin=subprocess.DEVNULL, stdout=output, stderr=output, check=False
        )
    if done.returncode:
        with open("halcmd.txt") as output:
            raise DeviceError(f"halcmd {' '.join(words)}: {output.read().strip()}")


if __name__ == "__main__":
    main(LinuxCNC(sys.argv[2], int(sys.argv[3]), tuple(map(float, sys.argv[4:]))))
