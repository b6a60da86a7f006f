"""Feeder for Franka's control interface: one row in each cycle of 1 ms."""

from __future__ import annotations

import ipaddress
import sys
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress

import pylibfranka
from pylibfranka import FrankaException, JointPositions, RealtimeConfig, RobotMode, RobotState

from armcontour.controllers.feeders.feeder import REST_RECORD_EVERY, DeviceError, Row, Sample, main

# Cycle [s].
CYCLE = 1e-3
# Tolerance between the desired positions of a state and the row sent in the previous cycle [rad].
ROW_TOLERANCE = 1e-6
# The motion from the held position to the first row takes this number of cycles.
ALIGNING_CYCLES = 500
# Maximum length of this motion, for each joint [rad].
MAX_ALIGNING_DISTANCE = 2e-3
# Maximum number of cycles without an answer in a motion. The robot continues its motion for so many
# cycles, then it stops; later, the next row would be a jump.
MAX_UNANSWERED = 20


@contextmanager
def reported() -> Iterator[None]:
    """Report libfranka's errors in this context as failures of the controller."""
    try:
        yield
    except FrankaException as error:
        raise DeviceError(str(error)) from None


class FrankaDevice:
    """A robot with the Franka Control Interface (FCI).

    The robot's clock says which row is due: where states were lost, rows are skipped. From the
    first motion on it controls the robot, which holds its position between motions.

    Args:
        address: Address of the robot.
    """

    def __init__(self, address: str) -> None:
        self.address = address
        self.control: pylibfranka.ActiveControlBase | None = None
        self.clock = self.due = 0
        self.answered = True
        # Cycle of the motion that the next answer sends, and the last one that the robot has
        # confirmed.
        self.k = -1
        self.confirmed = -1
        # Row that the next answer sends, and row of the last answer.
        self.row: Row = ()
        self.sent: Row = ()
        # Rows from the held position to row 0, which are sent first.
        self.approach_rows: deque[tuple[int, Row]] = deque()
        # Sample of the last answer, which the next state confirms.
        self.unconfirmed: Sample | None = None
        self.confirmed_samples: list[Sample] = []

    @reported()
    def connect(self) -> Row:
        """Connect; return the joint positions [rad]."""
        realtime = RealtimeConfig.kIgnore if self._is_here() else RealtimeConfig.kEnforce
        self.robot = pylibfranka.Robot(self.address, realtime)
        state = self.robot.read_once()
        if state.robot_mode != RobotMode.Idle:
            raise DeviceError(f"the robot is not idle, but in mode {state.robot_mode.name}")
        return tuple(state.q)

    @reported()
    def start(self) -> None:
        """Start the control of joint positions."""
        self.confirmed = -1
        if self.control is not None:
            return
        mode = pylibfranka.ControllerMode.JointImpedance
        self.control = self.robot.start_joint_position_control(mode)
        # libfranka's examples since version 0.15 start like this.
        self._read()
        self.row = self.sent = tuple(self.state.q)

    def take_limits(self, rows: Sequence[Row], new: bool) -> float:
        """Return 0: the robot stops by its reflex when answers are missing."""
        return 0.0

    def missed(self, all_sent: bool) -> int | None:
        """Return None: if rows are missing, the robot ends the control by an error."""
        return None

    def room(self) -> int:
        """Count the rows that are due by the robot's clock; only the last one is sent."""
        if self.approach_rows or self.answered:
            return 0
        return 1 if self.k < 0 else self.due

    def write(self, k: int, row: Row) -> None:
        """Set the row of the next answer."""
        self.due -= 1
        if k == 0:
            self._align(row)
        self.k = k
        self.row = row

    def is_done(self) -> bool:
        """Return whether the robot has confirmed the last row."""
        return not self.approach_rows and self.confirmed == self.k

    def exchange(self) -> Iterable[Sample]:
        """Answer the robot's state, and return the samples that the robot has confirmed."""
        if self.control is not None and not self.answered:
            k, self.sent = (
                self.approach_rows.popleft() if self.approach_rows else (self.k, self.row)
            )
            self._answer(finished=False)
            if k >= 0 or self.clock % REST_RECORD_EVERY == 0:
                self.unconfirmed = (self.clock, k, self.sent, tuple(self.state.q))
        confirmed = self.confirmed_samples
        self.confirmed_samples = []
        return confirmed

    def finish(self) -> None:
        """Hold the last row."""
        self.k = -1

    def wait(self) -> None:
        """Wait for the next state."""
        self._read()
        if self.control is None and self.clock % REST_RECORD_EVERY == 0:
            q = tuple(self.state.q)
            self.confirmed_samples.append((self.clock, -1, q, q))

    def close(self) -> None:
        """End the control at the last row."""
        if self.control is None:
            return
        # The robot may have ended the control.
        with suppress(DeviceError):
            if self.answered:
                self._read()
            self._answer(finished=True)

    def _align(self, row: Row) -> None:
        """Plan the motion from the held position to row 0, its last row."""
        distance = max(abs(a - b) for a, b in zip(self.row, row, strict=True))
        if distance > MAX_ALIGNING_DISTANCE:
            raise DeviceError(f"the robot is {distance:.4f} rad from the first set-point")
        for i in range(1, ALIGNING_CYCLES if distance else 1):
            x = i / ALIGNING_CYCLES
            w = x**3 * (10 - x * (15 - 6 * x))
            between = (a + w * (b - a) for a, b in zip(self.row, row, strict=True))
            self.approach_rows.append((-1, tuple(between)))
        self.approach_rows.append((0, row))

    def _is_here(self) -> bool:
        """Return whether the address is on this machine, so the robot is simulated."""
        try:
            return ipaddress.ip_address(self.address).is_loopback
        except ValueError:
            return self.address == "localhost"

    @reported()
    def _read(self) -> None:
        """Read a state, which confirms the row of the previous cycle."""
        if self.control is None:
            self.state: RobotState = self.robot.read_once()
        else:
            self.state, _ = self.control.readOnce()
        clock = round(self.state.time.to_sec() / CYCLE)
        self.due = clock - self.clock
        self.clock = clock
        self.answered = False
        if self.control is not None and self.k >= 0 and self.due > MAX_UNANSWERED:
            raise DeviceError(f"the feeder has not answered for {self.due} cycles")
        if self.unconfirmed is not None:
            number, k, row, measured = self.unconfirmed
            used = tuple(self.state.q_d)
            if max(abs(a - b) for a, b in zip(row, used, strict=True)) > ROW_TOLERANCE:
                row = used
            self.confirmed_samples.append((number, k, row, measured))
            self.unconfirmed = None
            self.confirmed = k

    @reported()
    def _answer(self, *, finished: bool) -> None:
        """Answer a state with the row of this cycle, or with the last row again."""
        assert self.control is not None
        command = JointPositions(list(self.sent))
        command.motion_finished = finished
        self.control.writeOnce(command)
        self.answered = True


if __name__ == "__main__":
    main(FrankaDevice(sys.argv[3]))
