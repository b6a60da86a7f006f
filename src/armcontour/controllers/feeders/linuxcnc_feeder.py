"""Feeder for LinuxCNC's HAL: sends rows to a streamer, and reads samples from a sampler.

It is run by the Python of the system, for which LinuxCNC's module `hal` is compiled.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress

import hal  # type: ignore[import-not-found]

from armcontour.controllers.feeders.feeder import LOOP_PAUSE, DeviceError, Row, Sample, main_guarded

COMPONENT = "armcontour-play"
# Signals of the HAL file that pins of this process drive, and their pins.
DRIVEN = {"heartbeat": hal.HAL_BIT, "on": hal.HAL_BIT, "off": hal.HAL_BIT, "play": hal.HAL_BIT}
DRIVEN |= {"timeout": hal.HAL_FLOAT}
# Signals of the HAL file that pins of this process read: whether the streamer plays, and whether
# the drives are enabled.
READ = ("playing", "enable")
# Prefix of these signals.
SIGNAL_PREFIX = "armcontour-"
# Time between two edges of the heartbeat [s].
HEARTBEAT_PERIOD = 0.02
# After this time without an edge, when the FIFO is empty and the joints rest, HAL disables the
# drives [s].
HEARTBEAT_TIMEOUT = 0.5
# HAL must obey a changed pin within this time [s].
PIN_TIMEOUT = 2.0
# HAL of a command before is unloaded within this time [s].
UNLOAD_TIMEOUT = 5.0
# Timeout of the servo thread between motions: it counts as dead after this time without a sample
# [s].
REST_THREAD_TIMEOUT = 1.0
# Largest motion of a disabled joint between a connection and the first motion [rad].
DISABLED_MOTION = 1e-3
# The FIFO's length counts after so many equal readings.
AGREEING_READINGS = 5
# Time for which the threads still run after the drives were disabled, so that their hardware and
# other samplers notice it before HAL is unloaded [s].
DISABLED_TIME = 0.1
# Time between two readings of the FIFO [s].
FIFO_PERIOD = 1.7e-3
# Margins of an acceleration limit against rounding: relative, and absolute [rad/s²].
ACCELERATION_MARGINS = (1e-6, 1e-6)
# Time in which HAL's limit3 brakes to rest and moves back to the last row, in multiples of velocity
# over acceleration.
BRAKING_TIMES = 2.5
# The joints rest if the command has not changed for this time [s].
REST_TIME = 0.2
# A pin keeps each level for at least this number of cycles, so that the thread sees its edges.
LEVEL_CYCLES = 2
# The motion from the held position to the first row has at most this number of rows.
MAX_ALIGNING_ROWS = 2000
# Largest second derivative of the smooth motion between 0 and 1 in a time of 1.
PEAK_SECOND_DERIVATIVE = 5.78
REAL_TIME_PROGRAM = "/usr/bin/rtapi_app"
# Beginnings of lines that halcmd always prints.
USUAL_OUTPUT = ("Running with fallback_uid", "Note: Using POSIX")


class LinuxCNCDevice:
    """HAL with a streamer of n + 1 floats and a sampler of 2 n + 1 floats.

    The first float of both is the motion's cycle, -1 at rest and less before row 0. The others are
    the joints' commands, and in the sampler also their measured positions [rad].

    HAL stops the joints without this process: when the FIFO is empty, the streamer is switched off
    until the next motion, and a `limit3` per joint keeps the acceleration of the command below the
    limit. Pins that are used in a motion belong to this process, because HAL's other functions
    take a lock, which a killed process would keep.

    Args:
        cycle: Period of the thread [s].
        file: HAL file that loads components and threads; `start` is called after it.
        ahead: Rows that the FIFO holds, against pauses of this process.
        dof: Number of joints.
        silence: Timeout of the thread in a motion [s].
    """

    def __init__(self, cycle: float, file: str, ahead: int, dof: int, silence: float) -> None:
        self.cycle = cycle
        self.file = file
        self.ahead = ahead
        self.dof = dof
        self.silence = silence
        self.enabled = self.is_used = False
        # Whether the streamer has to be switched on, and whether it was in this motion.
        self.waiting = self.has_played = False
        # Number of rows that were written since the streamer was off.
        self.unread = 0
        # First cycle of the motion without a row, after the FIFO has become empty.
        self.end: int | None = None
        self.beat_at = 0.0
        # Time of the last edge of the pins `on` and `play` [s].
        self.toggled_at = 0.0
        self.heard = time.monotonic()
        self.limits: Row = (0.0,) * dof
        # The last command of a sample, and number of samples with it.
        self.command: Row = ()
        self.repetitions = 0

    def connect(self) -> Row:
        """Load the HAL file, start threads, and command the measured position; drives are off."""
        end = time.monotonic() + UNLOAD_TIMEOUT
        while self.is_unloading():
            if time.monotonic() > end:
                raise DeviceError("HAL of another program is still being unloaded. Try again later")
            time.sleep(0.1)
        self.halcmd("-f", self.file)
        self.attach(COMPONENT)
        self.component["off"] = True
        self.component["timeout"] = HEARTBEAT_TIMEOUT
        self.halcmd("start")
        self.held = self.hold()
        return self.held

    def is_unloading(self) -> bool:
        """Return whether the HAL of another program is just being unloaded; False if HAL is free.

        Raises:
            DeviceError: HAL is used by another program, or was left by one that has ended.
        """
        # Each line has number, type, name, process and state; a real-time component has no process.
        lines = [x.split() for x in self.halcmd("-s", "show", "comp").splitlines()]
        names = [x[2] for x in lines if len(x) > 2]
        self.is_used = not all(x.startswith("halcmd") for x in names)
        if not self.is_used:
            return False
        programs = [(x[2], x[3]) for x in lines if len(x) > 3 and x[1] == "User"]
        running = [(x, pid) for x, pid in programs if os.path.exists(f"/proc/{pid}")]
        for name, pid in running:
            if name.startswith(COMPONENT):
                raise DeviceError(
                    "another armcontour command uses HAL and may be moving the robot (its feeder "
                    f"is process {pid}). Wait until it has ended, or end it with q on its terminal"
                )
        if running:
            name, pid = running[0]
            raise DeviceError(
                f"HAL is in use by {name} (process {pid}), which may be moving the robot. End "
                "LinuxCNC there first"
            )
        pid = real_time_process()
        if pid:
            raise DeviceError(
                f"a program that has ended has left HAL loaded. If the robot rests, `kill {pid}` "
                "unloads it"
            )
        return True

    def hold(self) -> Row:
        """Command the measured position, and return it."""
        held = self.next_sample()[3]
        self.put(-1, held)
        self.settle()
        while self.next_sample()[2] != held:
            pass
        return held

    def settle(self) -> None:
        """Wait until the row of a held position is played, and the streamer is off again."""
        if self.waiting:
            self.obey(lambda: not self.waiting, "streamer.0 plays no row", self.switch_on)
        self.obey(lambda: not self.component["playing"], f"{SIGNAL_PREFIX}playing remains true")

    def attach(self, name: str, replaces: str = "") -> None:
        """Open the FIFOs, and link the pins of this process to the signals of the HAL file.

        `replaces`: name of a component whose pins are unlinked.
        """
        self.component = hal.component(name)
        self.driven = DRIVEN | {f"acceleration-{j + 1}": hal.HAL_FLOAT for j in range(self.dof)}
        for pin, kind in self.driven.items():
            self.component.newpin(pin, kind, hal.HAL_OUT)
        for pin in READ:
            self.component.newpin(pin, hal.HAL_BIT, hal.HAL_IN)
        self.component.ready()
        self.out = hal.stream(self.component, hal.streamer_base, "f" * (self.dof + 1))
        self.back = hal.stream(self.component, hal.sampler_base, "f" * (2 * self.dof + 1))
        for pin in self.driven:
            if replaces:
                hal.disconnect(f"{replaces}.{pin}")
            # A signal takes the value of the pin that drives it.
            self.component[pin] = hal.get_value(f"{SIGNAL_PREFIX}{pin}")
        for pin in (*self.driven, *READ):
            hal.connect(f"{name}.{pin}", f"{SIGNAL_PREFIX}{pin}")
        self.heard = time.monotonic()

    def take_over(self) -> int:
        """Continue a motion; return the rows received, or one less if the FIFO wraps."""
        self.attach(f"{COMPONENT}-guard", replaces=COMPONENT)
        self.limits = tuple(self.component[f"acceleration-{j + 1}"] for j in range(self.dof))
        self.has_played = self.enabled = True
        seen: list[int] = []
        # The thread may have read a row but not yet set its pins, so several readings must agree.
        while len(seen) < AGREEING_READINGS or len(set(seen[-AGREEING_READINGS:])) > 1:
            self.beat()
            depth = int(self.out.depth)
            k = int(hal.get_value("streamer.0.pin.0"))
            if depth == int(self.out.depth):
                seen.append(k + depth + (1 if k >= 0 else 2))
            time.sleep(FIFO_PERIOD)
        if k == -1:
            raise DeviceError("the feeder has failed before the motion")
        return seen[-1]

    def next_sample(self) -> Sample:
        """Wait for the thread's next sample, and return it."""
        while not self.back.readable:
            self.check_alive()
            self.beat()
            time.sleep(1e-3)
        return next(iter(self.exchange()))

    def check_alive(self) -> None:
        """Raise DeviceError if the thread writes no samples."""
        silence = self.silence if self.has_played else REST_THREAD_TIMEOUT
        if time.monotonic() - self.heard > silence:
            raise DeviceError(f"HAL's servo thread has written no sample for {silence:g} s")

    def beat(self) -> None:
        """Show HAL that this process is alive."""
        now = time.monotonic()
        if now - self.beat_at > HEARTBEAT_PERIOD:
            self.beat_at = now
            self.component["heartbeat"] = not self.component["heartbeat"]

    def halcmd(self, *words: str) -> str:
        """Run halcmd and return its output, without a pipe: rtapi_app would keep it open."""
        name = os.path.join(os.path.dirname(self.file), "halcmd.txt")
        with open(name, "w") as output:
            done = subprocess.run(
                ["halcmd", *words], stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
        with open(name, errors="replace") as output:
            printed = "".join(x for x in output if not x.startswith(USUAL_OUTPUT)).strip()
        if done.returncode:
            raise DeviceError(printed.replace(f"{os.path.dirname(self.file)}/", ""))
        return printed

    def start(self) -> None:
        """Enable the drives, and keep the streamer off until the FIFO is filled."""
        if self.end is not None:
            raise DeviceError("it has ended a motion by itself. Connect again")
        if self.enabled and not self.component["enable"]:
            raise DeviceError(
                f"the drives were disabled, because the feeder halted for {HEARTBEAT_TIMEOUT:g} s "
                "or the HAL file disables them on a condition. Connect again"
            )
        # The last row of the motion before.
        self.settle()
        if not self.enabled:
            # Disabled joints may have moved since the connection.
            distance = max(abs(a - b) for a, b in zip(self.hold(), self.held, strict=True))
            if distance > DISABLED_MOTION:
                raise DeviceError(f"a joint has moved by {distance:.4f} rad while drives were off")
            self.enable()
        self.has_played = False
        self.waiting = True
        self.unread = 0

    def enable(self) -> None:
        """Enable the drives by a rising edge of `on`, repeated until the thread sees it."""
        self.component["off"] = False

        self.obey(
            lambda: bool(self.component["enable"]),
            f"{SIGNAL_PREFIX}enable remains false",
            lambda: self.toggle("on"),
        )
        self.component["on"] = False
        self.enabled = True

    def toggle(self, pin: str) -> None:
        """Change a pin, unless its last edge is so recent that the thread may not have seen it."""
        now = time.monotonic()
        if now - self.toggled_at >= LEVEL_CYCLES * self.cycle:
            self.toggled_at = now
            self.component[pin] = not self.component[pin]

    def obey(
        self, done: Callable[[], bool], failure: str, act: Callable[[], None] = lambda: None
    ) -> None:
        """Call `act` repeatedly until HAL has obeyed; raise DeviceError if it does not."""
        end = time.monotonic() + PIN_TIMEOUT
        while not done():
            if time.monotonic() > end:
                raise DeviceError(f"{failure}. Compare the HAL file with that of the documentation")
            act()
            self.beat()
            time.sleep(2 * LOOP_PAUSE)

    def take_limits(self, rows: Sequence[Row], new: bool) -> float:
        """Set the limits of `limit3` to accelerations of rows, and the timeout of the drives."""
        period = self.cycle
        limits = [0.0] * self.dof if new else [*self.limits]
        speeds = [0.0] * self.dof
        for a, b, c in zip(rows, rows[1:], rows[2:], strict=False):
            if a is c:
                # The rest at the end.
                continue
            for j in range(self.dof):
                limits[j] = max(limits[j], abs(a[j] - 2 * b[j] + c[j]) / period**2)
                speeds[j] = max(speeds[j], abs(c[j] - b[j]) / period)
        self.limits = tuple(limits)
        braking = 0.0
        for j in range(self.dof):
            limit = limits[j] * (1 + ACCELERATION_MARGINS[0]) + ACCELERATION_MARGINS[1]
            self.component[f"acceleration-{j + 1}"] = limit
            braking = max(braking, BRAKING_TIMES * speeds[j] / limit)
        timeout = self.ahead * period + braking + HEARTBEAT_TIMEOUT
        self.component["timeout"] = timeout if new else max(timeout, self.component["timeout"])
        settling = float(self.component["timeout"]) + DISABLED_TIME
        # Before row 0, the FIFO may also hold rows of the motion to it.
        return settling + MAX_ALIGNING_ROWS * period * new

    def missed(self, all_sent: bool) -> int | None:
        """Return the first cycle without a row, once the FIFO has become empty in a motion."""
        if self.end is None and self.has_played and not self.component["playing"]:
            # Rows that are written after the FIFO was empty are not played.
            if not all_sent or int(self.out.depth):
                self.end = max(int(hal.get_value("streamer.0.pin.0")) + 1, 0)
        return self.end

    def room(self) -> int:
        """Return how many rows fill the FIFO up to `ahead`."""
        return max(self.ahead - int(self.out.depth), 0)

    def write(self, k: int, row: Row) -> None:
        """Put one row into the FIFO."""
        if k == 0:
            self.align(row)
        self.put(k, row)

    def put(self, k: int, row: Row) -> None:
        """Put one row into the FIFO; the streamer has to be on to play the held position."""
        self.out.write((float(k), *row))
        self.unread += 1
        if k == -1:
            self.unread = 1
            self.waiting = True

    def align(self, row: Row) -> None:
        """Put rows of a smooth motion from the held position to row 0 into the FIFO."""
        steps = [b - a for a, b in zip(self.command, row, strict=True)]
        count = 0
        for step, limit in zip(steps, self.limits, strict=True):
            if step:
                shortest = (
                    PEAK_SECOND_DERIVATIVE * abs(step) / max(limit, ACCELERATION_MARGINS[1])
                ) ** 0.5
                count = max(count, min(int(shortest / self.cycle) + 2, MAX_ALIGNING_ROWS))
        for i in range(1, count):
            x = i / count
            w = x**3 * (10 - x * (15 - 6 * x))
            self.put(
                i - count - 1, tuple(a + w * s for a, s in zip(self.command, steps, strict=True))
            )
        self.component["timeout"] += count * self.cycle

    def is_done(self) -> bool:
        """Return whether the FIFO is empty, and the joints rest if HAL has stopped them."""
        if self.end is not None:
            return self.repetitions * self.cycle > REST_TIME
        return int(self.out.depth) == 0

    def switch_on(self) -> None:
        """Switch the streamer on by a rising edge of `play`, repeated until the thread sees it.

        After each falling edge it is checked that no row was played, so a streamer that has played
        all its rows, while this process was halted, is never switched on again.
        """
        # HAL counts one row too few if the FIFO wraps.
        read = int(self.out.depth) + (self.unread > 1) < self.unread
        if read or self.component["playing"]:
            self.component["play"] = False
            self.waiting = False
            self.has_played = True
        else:
            self.toggle("play")

    def exchange(self) -> Iterable[Sample]:
        """Return the thread's samples; the first calls in a motion switch the streamer on."""
        self.beat()
        if self.waiting and self.unread:
            self.switch_on()
        if not self.back.readable:
            self.check_alive()
        while self.back.readable:
            self.heard = time.monotonic()
            values = self.back.read()
            command = tuple(values[1 : 1 + self.dof])
            self.repetitions = self.repetitions + 1 if command == self.command else 0
            self.command = command
            yield int(self.back.sampleno), int(values[0]), command, tuple(values[1 + self.dof :])

    def finish(self) -> None:
        """Hold the last row, with -1 as its cycle."""
        self.settle()
        # Rows that came too late stay in the FIFO, so that no other motion is possible.
        if self.end is None or not int(self.out.depth):
            self.end = None
            names = (f"streamer.0.pin.{j + 1}" for j in range(self.dof))
            self.put(-1, tuple(float(hal.get_value(x)) for x in names))

    def wait(self) -> None:
        """Wait without watching HAL: the FIFO contains rows for many cycles."""
        time.sleep(LOOP_PAUSE)

    def close(self) -> None:
        """Disable the drives, stop the threads and unload HAL, unless another program uses it."""
        if self.is_used:
            return
        if hasattr(self, "component"):
            self.disable()
            time.sleep(DISABLED_TIME)
        for name in ("out", "back"):
            self.__dict__.pop(name, None)
        if hasattr(self, "component"):
            self.component.exit()
        no = subprocess.DEVNULL
        for words in (("halcmd", "stop"), ("halcmd", "unload", "all"), (REAL_TIME_PROGRAM, "exit")):
            subprocess.run(words, stdin=no, stdout=no, stderr=no)

    def disable(self) -> None:
        """Disable the drives; if the thread no longer does it, set the signal itself."""
        self.component["off"] = True
        end = time.monotonic() + 10 * FIFO_PERIOD
        while self.component["enable"] and time.monotonic() < end:
            time.sleep(LOOP_PAUSE)
        if self.component["enable"]:
            name = f"{SIGNAL_PREFIX}enable"
            for signal in hal.get_info_signals():
                if signal["NAME"] == name and signal["DRIVER"]:
                    hal.disconnect(signal["DRIVER"])
            with suppress(DeviceError):
                self.halcmd("sets", name, "0")


def real_time_process() -> str:
    """Return the number of the process that runs HAL's threads; empty if none is found."""
    name = os.path.basename(REAL_TIME_PROGRAM)
    # A process with other shared memory, such as that of simulated drives, has a HAL of its own.
    memory = os.readlink("/proc/self/ns/ipc")
    for pid in filter(str.isdigit, os.listdir("/proc")):
        with suppress(OSError), open(f"/proc/{pid}/comm") as file:
            is_own = os.readlink(f"/proc/{pid}/ns/ipc") == memory
            if is_own and file.read().strip().startswith(name):
                return pid
    return ""


if __name__ == "__main__":
    period, hal_file, rows_ahead, joints, timeout = sys.argv[2:]
    main_guarded(
        LinuxCNCDevice(float(period), hal_file, int(rows_ahead), int(joints), float(timeout))
    )
