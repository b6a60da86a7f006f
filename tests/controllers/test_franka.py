"""Franka's adapter: its checks, and its feeder with a double of libfranka."""

import enum
import importlib
import sys
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from tests.oracle.test_franka_limiter import (
    commands_changed,
    commands_of,
    fast_line,
    joint_line,
    recipes,
    square,
)

import armcontour as ac
from armcontour.controllers import Franka
from armcontour.controllers.feeders.feeder import DeviceError
from armcontour.controllers.franka import LOWER, UPPER, compare
from armcontour.core.errors import ControllerRefused

DEVICE = "armcontour.controllers.feeders.franka_feeder"
HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.785])


@pytest.fixture(scope="module")
def fr3():
    return ac.load_arm("fr3")


@pytest.fixture(scope="module")
def limits(fr3):
    return fr3.limits.replace(**recipes()["fr3"])


@pytest.mark.parametrize("move", [fast_line, square, joint_line])
def test_the_limiter_changes_no_accepted_set_point(fr3, limits, move):
    q = commands_of(move(fr3, limits))
    rows = Franka("127.0.0.1").check(fr3, limits, q)
    assert max(x.value for x in rows) <= 1 and commands_changed("fr3", q) == 0


def test_the_limiter_changes_refused_set_points():
    """Motions of one joint whose accelerations or jerks are 0.99 or 1.01 of the limit."""
    n = np.arange(400)
    for j in range(7):
        middle = (LOWER + UPPER) / 2
        for frequency in (3.0, 100.0):
            wave = (1 - np.cos(2 * np.pi * frequency * n * 1e-3))[:, None] * (np.arange(7) == j)
            start = np.minimum(n / 100, 1)[:, None] ** 5
            compared = compare(middle + 1e-3 * start * wave).values()
            use = max(float((values / most).max()) for values, most in compared)
            for share in (0.99, 1.01):
                q = middle + 1e-3 * share / use * start * wave
                changed = commands_changed("fr3", q)
                assert (changed > 0) == (share > 1), (j, frequency, share)


def test_the_velocity_limit_decreases_towards_the_ends_of_the_ranges(fr3, limits):
    q = np.repeat(HOME[None], 2000, axis=0)
    x = np.linspace(0, 1, 1000)
    q[:1000, 0] = 1.7 + 1.02 * x**3 * (10 - x * (15 - 6 * x))
    q[1000:, 0] = q[999, 0]
    with pytest.raises(ControllerRefused, match="velocity of joint 1 .* limit joint_velocity") as e:
        Franka("127.0.0.1").check(fr3, limits, q)
    assert e.value.joint == 0 and e.value.needed > e.value.allowed > 0.3


def test_motions_that_the_fci_does_not_support_are_refused(fr3, limits):
    robot = Franka("127.0.0.1")
    q = np.repeat(HOME[None], 20, axis=0)
    jump = q.copy()
    far = q.copy()
    jump[10:, 4] += 1e-4
    far[:, 3] = -0.1
    for changed, given, reason in (
        (limits.replace(joint_jerk=None), q, "jerk of joint 1 is unlimited"),
        (limits.replace(joint_jerk=[4750.0] * 6 + [6000.0]), q, "jerk of joint 7 is 6000"),
        (limits.replace(joint_acceleration=11.0), q, "acceleration of joint 1 is 11"),
        (limits, far, "Joint 4 is at -5.73 deg .* limit -8.7 deg"),
        (limits, jump, "joint 5 .* ms, but the limit .* increase"),
    ):
        with pytest.raises(ControllerRefused, match=reason):
            robot.check(fr3, changed, given)
    with pytest.raises(ControllerRefused, match="franka has 7 joints, but the arm UR5e has 6"):
        robot.check(ac.load_arm("ur5e"), limits, q[:, :6])


class Control:
    """A control whose states arrive at given milliseconds."""

    def __init__(self, times):
        self.times = iter(times)
        self.sent = []
        self.q_d = [0.0] * 7

    def readOnce(self):  # noqa: N802
        t = next(self.times)
        if t is None:
            raise Library.FrankaException("reflex | aborted")
        time = SimpleNamespace(to_sec=lambda: t * 1e-3)
        return SimpleNamespace(q=[0.0] * 7, q_d=self.q_d, time=time), None

    def writeOnce(self, command):  # noqa: N802
        self.sent.append((command.q[0], command.motion_finished))
        self.q_d = list(command.q)


class Library(ModuleType):
    """Stands for pylibfranka."""

    class FrankaException(Exception):
        """Any error."""

    class ActiveControlBase:
        """A control."""

    class RobotState:
        """A state."""

    class JointPositions:
        """A command."""

        def __init__(self, q):
            self.q = q
            self.motion_finished = False

    RealtimeConfig = enum.Enum("RealtimeConfig", "kEnforce kIgnore")
    RobotMode = enum.Enum("RobotMode", "Idle Reflex")
    ControllerMode = enum.Enum("ControllerMode", "JointImpedance")

    def Robot(self, address, realtime):  # noqa: N802
        self.realtime = realtime
        state = SimpleNamespace(robot_mode=self.mode, q=[0.0] * 7)
        return SimpleNamespace(
            read_once=lambda: state,
            start_joint_position_control=lambda mode: self.control,
            stop=lambda: None,
        )


@pytest.fixture
def library(monkeypatch):
    """The device's module with a stand-in for pylibfranka."""
    library = Library("pylibfranka")
    library.mode = Library.RobotMode.Idle
    monkeypatch.setitem(sys.modules, "pylibfranka", library)
    monkeypatch.delitem(sys.modules, DEVICE, raising=False)
    library.device = importlib.import_module(DEVICE).FrankaDevice
    yield library
    sys.modules.pop(DEVICE)


def feed(device, rows, cycles):
    """Play rows as the feeder's loop does; returns the samples."""
    sent = 0
    samples = []
    device.start()
    for _ in range(cycles):
        for _ in range(min(device.room(), len(rows) - sent)):
            device.write(sent, rows[sent])
            sent += 1
        if sent == len(rows) and device.is_done():
            device.finish()
            break
        samples += device.exchange()
        device.wait()
    return samples + list(device.exchange())


def test_the_clock_of_the_robot_determines_the_set_point(library):
    # Two states are lost before 7 ms, at rest no state is.
    library.control = Control([0, 1, 2, 3, 4, 7, *range(8, 40)])
    device = library.device("127.0.0.1")
    assert device.connect() == (0.0,) * 7
    rows = [(1e-6 * k * k,) * 7 for k in range(11)]
    samples = feed(device, rows, 30)
    played = {k: number for number, k, _, _ in samples if k >= 0}
    assert [*played] == [0, 1, 2, 3, 4, 7, 8, 9, 10]
    assert all(number == k for k, number in played.items())
    assert all(command == rows[k] for _, k, command, _ in samples)
    device.close()
    assert library.control.sent[-1] == (rows[-1][0], True)
    assert not any(finished for _, finished in library.control.sent[:-1])


def test_the_arm_moves_smoothly_to_the_start_and_holds_between_motions(library):
    library.control = Control(range(2000))
    device = library.device("127.0.0.1")
    device.connect()
    feed(device, [(1e-3,) * 7] * 3, 600)
    q = np.array([x for x, _ in library.control.sent])
    assert len(q) > 500 and q[0] < 1e-9 and q[-1] == 1e-3
    jerk = np.diff(np.concatenate([np.zeros(3), q]), 3) / 1e-9
    assert np.abs(jerk).max() < 1
    before = len(library.control.sent)
    for _ in range(5):
        device.wait()
        device.exchange()
    assert [x for x, _ in library.control.sent[before:]] == [1e-3] * 5
    with pytest.raises(DeviceError, match="0.0090 rad from the first set-point"):
        feed(device, [(1e-2,) * 7], 10)


def test_a_reflex_is_an_error_and_a_robot_in_reflex_mode_is_refused(library):
    library.control = Control([0, 1, 2, None])
    device = library.device("127.0.0.1")
    device.connect()
    with pytest.raises(DeviceError, match="reflex"):
        feed(device, [(0.0,) * 7] * 9, 30)
    library.mode = Library.RobotMode.Reflex
    with pytest.raises(DeviceError, match="not idle, but in mode Reflex"):
        device.connect()


@pytest.mark.parametrize(
    ("address", "enforced"),
    [
        ("127.3.4.5", False),
        ("::1", False),
        ("localhost", False),
        ("192.0.2.7", True),
        ("fr3", True),
    ],
)
def test_real_time_is_enforced_except_on_loopback(library, address, enforced):
    library.device(address).connect()
    assert (library.realtime == Library.RealtimeConfig.kEnforce) == enforced
