"""Feeder for Universal Robots: a program on the controller reads rows from RTDE registers.

Registers 24 to 47 are those that UR reserves for external RTDE clients. They hold four rows, so the
program has the next rows if this process comes late. It needs the standard library only.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress

from armcontour.controllers.feeders.feeder import (
    REST_RECORD_EVERY,
    DeviceError,
    Feeder,
    Row,
    Sample,
    main,
)

# Port of the controller for the Real-Time Data Exchange (RTDE).
RTDE_PORT = 30004
# Port of the controller that receives the program.
SCRIPT_PORT = 30002
# Type of RTDE packages with registers or the state.
DATA_PACKAGE = "U"
# Number of joints.
DOF = 6
# Number of rows that the input registers hold.
SLOTS = 4
# First double register that holds rows; inputs and outputs have the same numbers.
FIRST_REGISTER = 24
# Cycle of the controller [s].
CYCLE = 2e-3
# Timeout of an answer [s].
ANSWER_TIMEOUT = 2.0
# Maximum number of packages until the program runs.
MAX_START_PACKAGES = 2500
# States of a robot that plays a motion, from the RTDE guide:
RUNNING = 7  # Robot mode.
NORMAL = 1  # Safety mode.
PLAYING = 2  # Runtime state.
# Names of the other safety modes.
MODES = {2: "reduced", 3: "protective stop", 5: "safeguard stop", 6: "emergency stop"}
MODES |= {4: "recovery", 7: "emergency stop", 8: "violation", 9: "fault"}
SIZES = {"DOUBLE": "d", "VECTOR6D": "6d", "INT32": "i", "UINT32": "I"}
OUTPUTS = [
    *("timestamp", "target_q", "actual_q", "robot_mode", "safety_mode", "runtime_state"),
    *("target_speed_fraction", "output_int_register_24", "output_int_register_25"),
    *(f"output_double_register_{FIRST_REGISTER + j}" for j in range(DOF)),
]
# Indices of the outputs in an unpacked package, in which a vector has one value per joint.
TIMESTAMP = 0
TARGET_POSITIONS = slice(1, 7)
MEASURED_POSITIONS = slice(7, 13)
ROBOT_MODE = 13
SAFETY_MODE = 14
RUNTIME_STATE = 15
SPEED_FRACTION = 16
MOTION_CYCLE = 17
PROGRAM = 18
PROGRAM_ROW = slice(19, 25)
# Difference from 1 up to which the fraction of the speed slider counts as 100 %.
SPEED_SLIDER_ROUNDING = 1e-6
INPUTS = [
    *("input_int_register_24", "input_int_register_25", "input_int_register_26"),
    *(f"input_double_register_{FIRST_REGISTER + i}" for i in range(SLOTS * DOF)),
]
# The program counts the cycles k of a motion. If the next row is missing, it stops the joints and
# ends, because a row that comes late would make them jump to the speed of the motion. Input
# register 24 is the number of the newest row, or -1 between motions. Input register 25 is 0 to end
# the program, register 26 is 1 if the newest row is the last one of the motion. Outputs are k, the
# program's number (negative if a row was missing), and the row. Without inputs for 0.1 s the
# controller ends the program.
URSCRIPT = """\
def armcontour():
  q = get_target_joint_positions()
  k = -1
  ended = 0
  rtde_set_watchdog("input_int_register_24", 10, "stop")
  while read_input_integer_register(25) != 0:
    newest = read_input_integer_register(24)
    if newest < 0:
      k = -1
    elif k < newest:
      k = k + 1
      slot = 24 + 6 * (k % 4)
      q = [read_input_float_register(slot), read_input_float_register(slot + 1), \
read_input_float_register(slot + 2), read_input_float_register(slot + 3), \
read_input_float_register(slot + 4), read_input_float_register(slot + 5)]
    elif k >= 0 and read_input_integer_register(26) == 0:
      ended = -PROGRAM_NUMBER
      break
    end
    write_output_integer_register(24, k)
    write_output_float_register(24, q[0])
    write_output_float_register(25, q[1])
    write_output_float_register(26, q[2])
    write_output_float_register(27, q[3])
    write_output_float_register(28, q[4])
    write_output_float_register(29, q[5])
    write_output_integer_register(25, PROGRAM_NUMBER)
    servoj(q, 0, 0, 0.002, LOOKAHEAD, GAIN)
  end
  write_output_integer_register(25, ended)
  stopj(4.0)
end
"""


class UrDevice:
    """A robot from Universal Robots.

    Its program holds the newest rows in registers (slots), one per cycle.

    Args:
        address: Address of the robot.
        lookahead: Look-ahead time of `servoj` [s], as text.
        gain: Gain of `servoj`, as text.
    """

    def __init__(self, address: str, lookahead: str, gain: str) -> None:
        self.address = address
        self.script = URSCRIPT.replace("LOOKAHEAD", lookahead).replace("GAIN", gain)
        self.number = int.from_bytes(os.urandom(3)) + 1
        self.running = False
        self.fresh = False
        self.slots: list[Row] = [(0.0,) * DOF] * SLOTS
        self.newest = -1
        self.k = -1
        # Whether the newest row is the last one of the motion.
        self.is_last = False
        # First cycle without a row, after which the program has ended, and whether it still runs.
        self.end: int | None = None
        self.stopping = False
        self.received = b""
        self.complete: list[Sample] = []

    def connect(self) -> Row:
        """Connect; return the commanded joint positions [rad]."""
        self.rtde = self._open(RTDE_PORT)
        # Request protocol version 2, set up the recipes of outputs and inputs, and start.
        if self._ask("V", struct.pack(">H", 2)) != b"\x01":
            raise DeviceError("the controller does not support version 2 of the RTDE protocol")
        outputs = self._ask("O", struct.pack(">d", 1 / CYCLE) + ",".join(OUTPUTS).encode())
        self.layout = struct.Struct(">B" + self._types(OUTPUTS, outputs))
        inputs = self._ask("I", ",".join(INPUTS).encode())
        self.inputs = struct.Struct(">B" + self._types(INPUTS, inputs))
        self.recipe = inputs[0]
        if self._ask("S", b"") != b"\x01":
            raise DeviceError("the controller has refused to send its state")
        self.wait()
        mode = self.state[ROBOT_MODE]
        safety = self.state[SAFETY_MODE]
        if mode != RUNNING:
            raise DeviceError(f"the robot is not running, but in mode {mode}")
        if safety != NORMAL:
            raise DeviceError(f"the robot's safety mode is {MODES.get(safety, safety)}")
        self._check_speed()
        return tuple(self.state[TARGET_POSITIONS])

    @property
    def speed_percent(self) -> float:
        """Position of the speed slider in the last package [%]; exactly 100 up to rounding."""
        fraction = float(self.state[SPEED_FRACTION])
        return 100.0 if abs(fraction - 1) <= SPEED_SLIDER_ROUNDING else 100 * fraction

    def _check_speed(self) -> None:
        """Refuse a speed slider that is not at 100 %."""
        percent = self.speed_percent
        if percent != 100.0:
            raise DeviceError(f"the speed slider is at {percent:.3g} %. Set it to 100 %")

    def start(self) -> None:
        """Start the program, which holds the position."""
        self._check_speed()
        self.is_last = False
        if self.running:
            return
        self.end = None
        self.newest = -1
        self._send_inputs(1)
        text = self.script.replace("PROGRAM_NUMBER", str(self.number))
        with self._open(SCRIPT_PORT) as script:
            script.sendall(text.encode())
            # Closing the socket with unread data could make the controller discard the program.
            script.shutdown(socket.SHUT_WR)
            for _ in range(MAX_START_PACKAGES):
                while select.select([script], [], [], 0)[0] and script.recv(1 << 16):
                    pass
                self.wait()
                self._send_inputs(1)
                if self.state[PROGRAM] == self.number:
                    break
            else:
                raise DeviceError("its program does not start. Set the robot to remote control")
        self.running = True

    def take_limits(self, rows: Sequence[Row], new: bool) -> float:
        """Return 0: the program has stopped by `stopj` before its connection ends."""
        return 0.0

    def missed(self, all_sent: bool) -> int | None:
        """Return the first cycle without a row, at which the program stopped the joints."""
        self.is_last = all_sent
        return self.end

    def room(self) -> int:
        """Return how many rows fit into the registers."""
        if self.end is not None:
            return 0
        if self.newest < 0 <= self.k:
            return 0
        return self.k + SLOTS - self.newest

    def write(self, k: int, row: Row) -> None:
        """Write a row to its registers."""
        self.slots[k % SLOTS] = row
        self.newest = k

    def is_done(self) -> bool:
        """Return whether the program has used the newest row, or has stopped and ended."""
        return self.k == self.newest if self.end is None else not self.stopping

    def exchange(self) -> Iterable[Sample]:
        """Send the registers once per cycle, and return the new samples."""
        if self.running and self.fresh:
            self._send_inputs(1)
            self.fresh = False
        complete = self.complete
        self.complete = []
        return complete

    def finish(self) -> None:
        """Hold the last row."""
        self.newest = -1

    def wait(self) -> None:
        """Wait for a package with the controller's state, and process all that have arrived."""
        waiting = True
        while waiting or self._has_package() or select.select([self.rtde], [], [], 0)[0]:
            kind, data = self._receive()
            if kind == DATA_PACKAGE:
                self._take(data)
                waiting = False

    def close(self) -> None:
        """End the program, and disconnect."""
        if not hasattr(self, "rtde"):
            return
        with suppress(DeviceError, OSError):
            if self.running or self.stopping:
                self.running = False
                self._send_inputs(0)
                for _ in range(REST_RECORD_EVERY):
                    self.wait()
                    if self.state[PROGRAM] != self.number:
                        break
        self.rtde.close()

    def _open(self, port: int) -> socket.socket:
        """Connect to a port of the controller."""
        try:
            opened = socket.create_connection((self.address, port), ANSWER_TIMEOUT)
        except OSError as error:
            raise DeviceError(f"{self.address}, port {port}: {error}") from None
        opened.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return opened

    def _send(self, kind: str, data: bytes) -> None:
        self.rtde.sendall(struct.pack(">HB", len(data) + 3, ord(kind)) + data)

    def _ask(self, kind: str, data: bytes) -> bytes:
        """Send a request; return the data of the answer."""
        self._send(kind, data)
        while True:
            answered, answer = self._receive()
            if answered == kind:
                return answer

    def _has_package(self) -> bool:
        """Return whether a whole package was received."""
        data = self.received
        return len(data) >= 3 and len(data) >= int.from_bytes(data[:2], "big")

    def _receive(self) -> tuple[str, bytes]:
        """Receive the next package; return its type and data."""
        while not self._has_package():
            data = self.rtde.recv(1 << 16)
            if not data:
                raise DeviceError("the controller ended the connection")
            self.received += data
        size, kind = struct.unpack_from(">HB", self.received)
        data = self.received[3:size]
        self.received = self.received[size:]
        return chr(kind), data

    def _types(self, names: Sequence[str], answer: bytes) -> str:
        """Return the format of an accepted recipe for `struct`."""
        types = answer[1:].decode().split(",")
        for name, kind in zip(names, types, strict=True):
            if kind not in SIZES:
                reason = "is used by another client" if kind == "IN_USE" else f"is {kind}"
                raise DeviceError(f"{name} {reason}")
        return "".join(SIZES[x] for x in types)

    def _send_inputs(self, run: int) -> None:
        """Send the registers."""
        values = [x for row in self.slots for x in row]
        registers = (self.newest, run, int(self.is_last))
        self._send(DATA_PACKAGE, self.inputs.pack(self.recipe, *registers, *values))

    def _take(self, data: bytes) -> None:
        """Process a package with the controller's state."""
        # After the number of the recipe: timestamp, target_q, actual_q and the other outputs.
        self.state = self.layout.unpack(data)[1:]
        self.fresh = True
        clock = round(self.state[TIMESTAMP] / CYCLE)
        runtime = self.state[RUNTIME_STATE]
        number = self.state[PROGRAM]
        measured = tuple(self.state[MEASURED_POSITIONS])
        if self.running and number == -self.number:
            self.end = self.state[MOTION_CYCLE] + 1
            self.running = False
            self.stopping = True
        if self.stopping:
            self.stopping = runtime == PLAYING
            # The registers still have the row before.
            self.complete.append((clock, self.k, tuple(self.state[TARGET_POSITIONS]), measured))
        elif self.running:
            if runtime != PLAYING or number != self.number:
                safety = self.state[SAFETY_MODE]
                raise DeviceError(
                    f"its program ended: safety mode {MODES.get(safety, 'normal')}, runtime state "
                    f"{runtime}"
                )
            self.k = self.state[MOTION_CYCLE]
            if self.k >= 0 or clock % REST_RECORD_EVERY == 0:
                self.complete.append((clock, self.k, tuple(self.state[PROGRAM_ROW]), measured))
        elif clock % REST_RECORD_EVERY == 0:
            self.complete.append((clock, -1, tuple(self.state[TARGET_POSITIONS]), measured))


class UrFeeder(Feeder):
    """A feeder that stops the motion on the path if the speed slider is moved.

    At less than 100 %, each `servoj` takes longer than a cycle, so the motion no longer has the
    timing for which it was planned and compensated.
    """

    device: UrDevice
    # Position of the slider in the package before [%].
    percent = 100.0

    def report(self) -> None:
        """Report the samples; end the motion with its rows if the slider was moved."""
        super().report()
        percent = self.device.speed_percent if self.playing else 100.0
        if percent not in (100.0, self.percent):
            self.send_line("C", f"{percent:.3g}")
            self.more = False
        self.percent = percent


if __name__ == "__main__":
    main(UrDevice(*sys.argv[3:6]), UrFeeder)
