"""LinuxCNC's HAL with simulated drives; skipped where it is not installed.

Every motion takes its time, so there are few of them: `python -m soak playing` has many.
"""

import io
import json
import os
import pty
import shlex
import shutil
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from docs.pages import blocks, run_command
from soak.hal_drives import CYCLE, follow
from soak.hal_drives import LIMIT as ACCELERATION

import armcontour as ac
from armcontour.controllers import LinuxCNC, Motion, play
from armcontour.core.errors import ControllerRefused

needs_linuxcnc = pytest.mark.skipif(
    shutil.which("halcmd") is None, reason="needs the Debian package linuxcnc-uspace"
)
POINTS = [(0.350, 0.100), (0.410, 0.150), (0.350, 0.200)]
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
JOB = """
name: line
arm: pmk3s
path: {points: [[0.350, 0.100], [0.410, 0.150], [0.350, 0.200]]}
corners: {tolerance: 2 mm}
limits: {speed: 0.15 m/s, centripetal_acceleration: 0.09 m/s²}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {only: {cycle: 4 ms}}
"""
# Makes standard input the terminal of the process, so that Ctrl-C there interrupts it.
ON_TERMINAL = """
import fcntl, runpy, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
runpy.run_module("armcontour", run_name="__main__", alter_sys=True)
"""
PAGE = Path(__file__).parents[2] / "docs/guides/controllers/linuxcnc.md"
HAL = (PAGE.parents[3] / "examples/linuxcnc/machine.hal").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    file = tmp_path_factory.mktemp("job") / "job.yaml"
    file.write_text(JOB, encoding="utf-8")
    return ac.read_job(file)


@pytest.fixture(scope="module")
def planned(job):
    return ac.run(job).runs["only"]


def controller(**changes):
    return LinuxCNC(drives=SERVO.replace(**{"acceleration_limit": ACCELERATION, **changes}))


def commands(set_points, cycle=CYCLE):
    """Set-points at the thread's cycles by lines, and a rest."""
    t = np.arange(0, set_points.cycle * (len(set_points.q) - 1), cycle)
    times = np.arange(len(set_points.q)) * set_points.cycle
    q = np.column_stack([np.interp(t, times, x) for x in set_points.q.T])
    return np.concatenate([q, np.repeat(set_points.q[-1:], 300, axis=0)])


def undisturbed(play_once):
    """The record of a motion whose set-points came in time, unless other processes delay three."""
    for _ in range(3):
        record = play_once()
        if record.faithful:
            break
    return record


@needs_linuxcnc
def test_the_drives_move_as_in_the_simulation(job, planned):
    u = commands(planned.set_points)

    def play_once():
        with controller() as on:
            on.connect(job.arm, u[0])
            assert np.array_equal(on.position(), u[0])
            record = on.stream(Motion(q=u))
            assert np.abs(on.position() - u[-1]).max() < 1e-12
        return record

    record = undisturbed(play_once)
    assert record.faithful, record.notes
    assert record.stopped is None and np.array_equal(record.command[: len(u)], u)
    np.testing.assert_allclose(record.measured[: len(u)], follow(u), rtol=0, atol=1e-12)
    # HAL integrates by steps. That is the exact motion of other gains, half a cycle further on.
    factor = 1 + float(SERVO.kp) * CYCLE / 2
    servo = ac.ServoModel(
        kp=SERVO.kp / factor, kv=SERVO.kv * factor, interpolation="linear", drive_cycle=CYCLE
    )
    set_points = replace(planned.set_points, q=u, cycle=CYCLE)
    limits = job.arm.limits.replace(joint_acceleration=ACCELERATION)
    done = ac.simulate(set_points, ac.ServoPlant(job.arm, servo, limits))
    k = np.rint((done.t - done.t[0]) / CYCLE).astype(int)
    whole = (np.abs(done.t - done.t[0] - k * CYCLE) < 1e-9) & (k < len(u))
    expected = done.q[whole] + done.dq[whole] * CYCLE / 2
    tools = (job.arm.tool_position(x) for x in (record.measured[k[whole]], expected))
    assert np.linalg.norm(np.subtract(*tools), axis=1).max() < 1e-9  # 1e-6 mm


@needs_linuxcnc
def test_a_stop_and_a_following_error_both_end_at_rest_on_the_path(job):
    def play_once(on, **options):
        return play(job, on, execute=True, override=1.0, **options).record

    weak = controller(kp=15.0)
    asked = undisturbed(lambda: play_once(controller(), stop_requested=Later(3)))
    errs = undisturbed(lambda: play_once(weak, band=3e-3))
    for record, distance in ((asked, 5e-6), (errs, 2e-3)):
        assert record.faithful and record.stopped is not None, record.notes
        assert np.abs(np.diff(record.measured[-20:], axis=0)).max() < 1e-4 * CYCLE
        ends = (record.measured[-1], record.command[-1])
        assert np.abs(np.subtract(*ends)).max() < 1e-6
        tool = job.arm.tool_position(record.measured)
        path = ac.round_corners(ac.Path.polyline(POINTS), tolerance=2e-3)
        assert path.project(tool).distance.max() < distance
    assert any("from its predicted position" in x for x in errs.notes)


class Later:
    """False at first, then True: a stop that is requested during the motion."""

    def __init__(self, calls):
        self.calls = calls

    def __call__(self):
        self.calls -= 1
        return self.calls < 0


RAIL = """
name: seam
arm:
  name: ur5e
  rail: {axis: [0, 1, 0], upper: 1 m, velocity: 1 m/s, acceleration: 2 m/s^2}
path: {points: [[-0.5, 0, 0.3], [-0.5, 0.2, 0.3]], orientation: {axis: [0, 0, -1]}}
limits: {speed: 0.15 m/s}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {timing: {reserve: 50 %}}}
"""


@needs_linuxcnc
def test_a_rail_is_played(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "job.yaml"
    file.write_text(RAIL, encoding="utf-8")
    code, printed, _ = run_command(["play", "job.yaml", "--on", "linuxcnc"])
    assert code == 0 and "0 deg, 0 mm" in printed
    job = ac.read_job(file)

    def play_once():
        on = LinuxCNC(drives=SERVO.replace(acceleration_limit=2.0))
        return play(job, on, execute=True, override=0.5)

    for _ in range(3):
        played = play_once()
        if played.record.faithful:
            break
    assert played.kept, played.reason
    assert np.ptp(played.record.measured[:, 0]) > 0.05
    assert max(played.to_data()["difference.joints"].value) < 1e-3


@needs_linuxcnc
def test_a_wrong_start_and_swapped_joints_are_refused(job, planned, refuses):
    u = commands(planned.set_points)
    with controller() as on:
        on.connect(job.arm, u[0] + [0.0, 0.01])
        refuses(lambda: on.stream(Motion(q=u)), ControllerRefused, "Joint 2", joint=1, needed=0.01)
        refuses(lambda: on.stream(Motion(q=u[:, ::-1])), ControllerRefused, "Joint")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("net joint-1 ", "net joint-2 ", ["net joint-1 armcontour-limit-1.out,"]),
        ("pin.1 => armcontour", "pin.2 => armcontour", ["net armcontour-set-point-1 streamer"]),
        ("net armcontour-acceleration-2", "# ", ["net armcontour-acceleration-2"]),
        (".out => streamer.0.enable", ".out", ["net armcontour-playing streamer.0.enable"]),
        (" armcontour-limit-2.load", "", ["armcontour-limit-2.load"]),
        ("setp armcontour-alive.falling 1", "", ["setp armcontour-alive.falling 1"]),
        ("addf armcontour-limit-2 servo", "", ["addf armcontour-limit-2 servo"]),
        ("cfg=fff\n", "cfg=ffff\n", ["loadrt streamer cfg=fff,", "2 joints", "complete HAL"]),
        ("cfg=fffff\n", "cfg=ffffff\n", ["loadrt sampler cfg=fffff,"]),
        ("net armcontour-enable armcontour-latch.ok-out", "", ["armcontour-enable"]),
        ("period1=1000000", "period1=100000", ["100000 ns", "between 250000 and 10000000 ns"]),
        ("period1=1000000", "period1=20000000", ["20000000 ns", "between 250000 and 10000000"]),
        ("addf sampler.0 servo", "addf sampler.0 slow", ["sampler.0", "addf sampler.0 servo"]),
        ("addf streamer.0 servo", "", ["streamer.0", "addf streamer.0 servo"]),
        (
            "addf sampler.0 servo",
            "loadrt threads name2=slow period2=2000000\naddf sampler.0 slow",
            ["2000000 ns", "1000000 ns", "the same thread"],
        ),
        ("streamer depth=4000", "streamer depth=300", ["300 rows", "depth=4000"]),
    ],
)
def test_an_incomplete_or_different_hal_file_is_refused(job, tmp_path, refuses, old, new, words):
    """Before LinuxCNC is looked for."""
    file = tmp_path / "machine.hal"
    assert old in HAL
    file.write_text(HAL.replace(old, new), encoding="utf-8")
    q = np.zeros((2, 2))
    refuses(lambda: LinuxCNC(file).check(job.arm, job.arm.limits, q), ControllerRefused, *words)


@pytest.mark.parametrize(
    ("periods", "cycle"),
    [
        ("name1=servo period1=500000", 0.5e-3),
        ("name1=servo period1=833333", 0.833333e-3),
        ("name1=servo period1=4000000", 4e-3),
        # HAL makes a multiple of the first period of it.
        ("name1=base period1=300000 name2=servo period2=1000000", 0.9e-3),
    ],
)
def test_the_cycle_is_the_period_of_the_thread_of_the_hal_file(job, tmp_path, periods, cycle):
    file = tmp_path / "machine.hal"
    file.write_text(HAL.replace("name1=servo period1=1000000", periods), encoding="utf-8")
    on = LinuxCNC(file)
    assert on.cycle == pytest.approx(cycle, rel=1e-12)
    assert on.check(job.arm, job.arm.limits, np.zeros((2, 2)))


def test_periods_of_simulated_drives_are_checked(tmp_path, refuses):
    assert LinuxCNC(drives=SERVO).cycle == 1e-3
    assert LinuxCNC(drives=SERVO, cycle=1 / 1200).cycle == pytest.approx(833333e-9, rel=1e-12)
    for cycle in (0.2e-3, 11e-3, -1.0, np.nan):
        refuses(lambda cycle=cycle: LinuxCNC(drives=SERVO, cycle=cycle), ac.InvalidInput, "cycle")
    file = tmp_path / "machine.hal"
    file.write_text(HAL, encoding="utf-8")
    refuses(lambda: LinuxCNC(file, cycle=1e-3), ac.InvalidInput, "HAL file", "cycle")


@needs_linuxcnc
@pytest.mark.parametrize("cycle", [0.5e-3, 833333e-9, 2e-3, 4e-3])
def test_simulated_drives_move_with_other_periods(job, planned, cycle):
    """A motion, and one that is stopped on its path."""
    u = commands(planned.set_points, cycle)

    def play_once():
        with LinuxCNC(drives=SERVO.replace(acceleration_limit=ACCELERATION), cycle=cycle) as on:
            on.connect(job.arm, u[0])
            return on.stream(Motion(q=u))

    record = undisturbed(play_once)
    assert record.faithful, record.notes
    assert record.stopped is None and np.array_equal(record.command[: len(u)], u)
    assert record.t[: len(u)] == pytest.approx(np.arange(len(u)) * cycle, abs=1e-9)
    np.testing.assert_allclose(record.measured[: len(u)], follow(u, cycle), rtol=0, atol=1e-12)

    def stop_once():
        on = LinuxCNC(drives=SERVO.replace(acceleration_limit=ACCELERATION), cycle=cycle)
        return play(job, on, execute=True, override=1.0, stop_requested=Later(3)).record

    stopped = undisturbed(stop_once)
    assert stopped.faithful and stopped.stopped is not None, stopped.notes
    assert np.abs(stopped.measured[-1] - stopped.command[-1]).max() < 1e-6
    path = ac.round_corners(ac.Path.polyline(POINTS), tolerance=2e-3)
    tool = job.arm.tool_position(stopped.command)
    assert path.project(tool[-1:]).distance.max() < 5e-6


@needs_linuxcnc
def test_the_thread_period_is_an_option_of_commands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "job.yaml").write_text(JOB, encoding="utf-8")
    (tmp_path / "machine.hal").write_text(HAL, encoding="utf-8")
    words = ["play", "job.yaml", "--on", "linuxcnc", "--thread-period"]
    code, printed, errors = run_command([*words, "2 ms"])
    assert code == 0, errors
    assert "Dry run" in printed
    for wrong in (["2"], ["20 ms"], ["2 ms", "--hal", "machine.hal"]):
        code, _, errors = run_command([*words, *wrong])
        assert code == 2 and ("period" in errors or "cycle" in errors)


@pytest.mark.parametrize("name", ["play", "identify", "learn"])
def test_without_a_terminal_nothing_is_executed(tmp_path, monkeypatch, name):
    """A text that has the name of the arm is no terminal."""
    (tmp_path / "job.yaml").write_text(JOB, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO("PMK-3s\n"))
    words = [name, "job.yaml", "--on", "linuxcnc", "--execute", "--out", "out"]
    code, _, errors = run_command(words)
    assert code == 10
    assert "terminal" in errors and "has not moved" in errors
    assert not (tmp_path / "out").exists()


class Terminal:
    """The command `play` on a terminal, which plays the job with the result folder `out`."""

    def __init__(self, folder, speed):
        words = ["play", "job.yaml", "--on", "linuxcnc", "--execute", "--speed-factor", speed]
        (folder / "job.yaml").write_text(JOB, encoding="utf-8")
        self.own, other = pty.openpty()
        self.process = subprocess.Popen(
            [sys.executable, "-c", ON_TERMINAL, *words, "--out", "out"],
            cwd=folder,
            stdin=other,
            stdout=other,
            stderr=other,
            start_new_session=True,
        )
        os.close(other)

    def wait_for(self, word):
        """Read until a word is printed."""
        printed = b""
        while word not in printed:
            printed += os.read(self.own, 1000)

    def press(self, keys):
        os.write(self.own, keys)

    def end(self):
        """Read until the command ends; returns its exit code and what it has printed."""
        printed = b""
        with suppress(OSError):  # the other end is closed
            while data := os.read(self.own, 1000):
                printed += data
        os.close(self.own)
        return self.process.wait(), printed


@needs_linuxcnc
@pytest.mark.parametrize("key", [b"\x03", b"q"])
def test_ctrl_c_and_q_on_a_terminal_stop(tmp_path, key):
    terminal = Terminal(tmp_path, "100 %")
    terminal.wait_for(b"Type PMK-3s")
    terminal.press(b"PMK-3s\n")
    terminal.wait_for(b"playing")
    terminal.press(key)
    code, printed = terminal.end()
    assert code == 1, printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["completed"] in (False, None)


@needs_linuxcnc
def test_keys_of_the_terminal_pause_and_change_the_speed(tmp_path):
    terminal = Terminal(tmp_path, "25 %")
    terminal.wait_for(b"Type PMK-3s")
    terminal.press(b"PMK-3s\n")
    terminal.wait_for(b"playing: 25 %")
    terminal.press(b" ")
    # The line is shown anew ten times per second.
    for _ in range(15):
        terminal.wait_for(b"paused")
    terminal.press(b"r")
    terminal.wait_for(b"left")
    terminal.press(b"+")
    terminal.wait_for(b"playing: 50 %")
    code, printed = terminal.end()
    assert code == 0, printed
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["kept"] and summary["completed"]
    assert summary["override"]["paused"] > 0.5
    log = ac.read_log(tmp_path / "out" / "log.csv")
    rate = np.diff(log.plan_time) / np.diff(log.t)
    assert 0.45 < np.quantile(rate, 0.95) < 1.01 and rate.min() < 1e-6


# A separate HAL, for HAL files of a machine.
APART = ["unshare", "--ipc", sys.executable]
needs_own_hal = pytest.mark.skipif(
    os.geteuid() != 0, reason="needs a HAL apart from that of the machine"
)


def text_on_page(word):
    """Return the text of the page's first block whose file or last word is this one."""
    for block in blocks(PAGE):
        if word in (block.marks.get("file"), block.text.split(" ")[-1]):
            return block.text
    raise LookupError(word)


LINE = text_on_page("line.yaml")
COMMANDS = text_on_page("identified\n")
# Plays the job of the page without compensation at full speed, and prints what happened.
OWN_FILE = """
import json, sys
from dataclasses import replace
import armcontour as ac
from armcontour.control.compensation import NoCompensation
from armcontour.controllers import LinuxCNC, play

job = ac.read_job("line.yaml")
job = replace(job, runs=(replace(job.runs[0], compensation=NoCompensation()),))
try:
    played = play(job, LinuxCNC(sys.argv[1]), execute=True, override=1.0)
    print(json.dumps([played.kept, *played.record.notes]))
except ac.ArmContourError as error:
    print(json.dumps([type(error).__name__, str(error)]))
"""


def play_own_file(folder, text):
    """Verdict or class of the error, and its notes or message."""
    (folder / "line.yaml").write_text(LINE, encoding="utf-8")
    (folder / "machine.hal").write_text(text, encoding="utf-8")
    words = [*APART, "-c", OWN_FILE, "machine.hal"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    return json.loads(done.stdout)


# Connects twice at the same time, and prints why the second connection is refused.
TWICE = """
import armcontour as ac
from armcontour.controllers import LinuxCNC

arm = ac.read_job("line.yaml").arm
with LinuxCNC("machine.hal") as first:
    first.connect(arm, [0.0, 0.0])
    try:
        LinuxCNC("machine.hal").connect(arm, [0.0, 0.0])
    except ac.ArmContourError as error:
        print(type(error).__name__, error)
    # The first one is still connected.
    print(len(first.position()))
"""


@needs_linuxcnc
@needs_own_hal
def test_a_second_player_is_told_that_the_first_one_runs(tmp_path):
    (tmp_path / "line.yaml").write_text(LINE, encoding="utf-8")
    (tmp_path / "machine.hal").write_text(HAL, encoding="utf-8")
    words = [*APART, "-c", TWICE]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    refused, count = done.stdout.splitlines()
    assert refused.startswith("ControllerRefused") and count == "2"
    assert "another armcontour command" in refused and "kill" not in refused


@needs_linuxcnc
@needs_own_hal
def test_commands_of_the_guide_run_and_hal_errors_name_file_and_line(tmp_path):
    (tmp_path / "line.yaml").write_text(LINE, encoding="utf-8")
    (tmp_path / "machine.hal").write_text(HAL, encoding="utf-8")
    (line,) = (x for x in COMMANDS.splitlines() if "--execute" not in x)
    words = [*APART, "-m", *shlex.split(line)]

    def run():
        return subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)

    done = run()
    assert done.returncode == 0, done.stderr
    assert "joint 1, joint 2" in done.stdout and "2.36 deg" in done.stdout
    wrong = HAL.replace("setp pid-1.Pgain", "setp pid-1.Again")
    (tmp_path / "machine.hal").write_text(wrong, encoding="utf-8")
    done = run()
    number = wrong.splitlines().index("setp pid-1.Again 25") + 1
    assert done.returncode == 10
    assert f"reached: machine.hal:{number}: " in done.stderr and "pid-1.Again" in done.stderr
