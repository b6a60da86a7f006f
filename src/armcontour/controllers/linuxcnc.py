"""LinuxCNC's HAL as a controller: a streamer feeds a servo thread, and a sampler records it."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path as FilePath

import numpy as np

from armcontour.controllers.controller import Controller, FeederCommand
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused, InvalidInput
from armcontour.core.file_access import read_text
from armcontour.core.render import number
from armcontour.core.result import Row
from armcontour.core.text import count_noun
from armcontour.robot import Arm, Limits
from armcontour.robot.arm import unit_of
from armcontour.robot.servo import ServoModel

# Parent folder of the package, for PYTHONPATH of the system's Python.
SOURCE = FilePath(__file__).parents[2]
SYSTEM_PYTHON = "/usr/bin/python3"
RTAPI = "/usr/bin/rtapi_app"
# The real-time program refuses root, so for root it runs as this user (nobody).
NOBODY = 65534
# Parameters of servo models that simulated drives do not have.
UNSUPPORTED = "dead_time drive_cycle friction velocity_feedforward acceleration_feedforward".split()
HAL_FILE_HINT = "The page LinuxCNC of the documentation has a complete HAL file."
# Nets by which HAL stops the joints when armcontour fails: name of the signal and one of its pins.
# The feeder links its own pins to the first five.
SAFEGUARDS = {
    "armcontour-heartbeat": "armcontour-alive.in",
    "armcontour-timeout": "armcontour-alive.width",
    "armcontour-on": "armcontour-latch.reset",
    "armcontour-off": "armcontour-latch.fault-in",
    "armcontour-play": "armcontour-player.clk",
    "armcontour-empty": "armcontour-player.reset",
    "armcontour-playing": "streamer.0.enable",
    "armcontour-alive": "armcontour-latch.ok-in",
    "armcontour-enable": "armcontour-latch.ok-out",
}
# Time after which a thread that moves a machine counts as dead [s]: later, it would catch up on the
# missed cycles at once.
MACHINE_TIMEOUT = 0.1
# The same for simulated drives, whose time is that of the thread [s].
SIMULATED_TIMEOUT = 1.0
# Duration of the rows in this FIFO, against pauses of this machine [s].
FIFO_TIME = 0.3
# Default period of the thread of simulated drives [s].
DEFAULT_PERIOD = 1e-3
# Shortest period of a servo thread [s]: the feeder sends a row and reads a sample per period.
MIN_PERIOD = 0.25e-3
# Longest period of a servo thread [s]: the thread must see each edge of the heartbeat, which has
# one every 20 ms.
MAX_PERIOD = 10e-3
# Capacity of the FIFO from the feeder to the servo thread [rows].
STREAMER_DEPTH = 4000
# Capacity of the FIFO from the servo thread to the feeder [rows].
SAMPLER_DEPTH = 8000


class LinuxCNC(Controller):
    """LinuxCNC's HAL with the joints of a HAL file or with simulated drives.

    It needs the Debian package `linuxcnc-uspace`; no real-time kernel.

    Args:
        hal_file: HAL file of the machine. It loads a servo thread, whose period becomes the
            controller's cycle and is between 0.25 and 10 ms, a `streamer` with a float for the
            cycle number and one per joint, a `limit3` per joint, and a `sampler` with the cycle
            number, the commands and the measured positions [rad]. A joint's command is the signal
            with the joint's name, with `-` in place of spaces. The signal `armcontour-enable`
            enables the drives, which ignore their command before.
        drives: Servo of simulated drives, in place of a HAL file. HAL's `pid` computes position and
            velocity loops with the model's gains and integrators; two integrators turn its output
            into positions. The model, else the arm, limits the accelerations. If the model has a
            dead time of one cycle, `pid` uses `error-previous-target`, LinuxCNC's default.
        cycle: Period of the thread of simulated drives [s], between 0.25 and 10 ms, rounded to
            nanoseconds; by default 1 ms. A HAL file states its own period.

    Raises:
        InvalidInput: Neither a HAL file nor drives are given, or both; a cycle with a HAL file, or
            out of range.
        ControllerRefused: The HAL file has no thread with a suitable period for the streamer and
            the sampler.
    """

    name = "linuxcnc"
    clean_up = (RTAPI, "exit")

    @checks.explained
    def __init__(
        self,
        hal_file: str | FilePath | None = None,
        *,
        drives: ServoModel | None = None,
        cycle: float | None = None,
    ) -> None:
        super().__init__()
        if (hal_file is None) == (drives is None):
            raise InvalidInput("LinuxCNC needs either a HAL file or drives to simulate.")
        self.hal_file = None if hal_file is None else FilePath(hal_file)
        if self.hal_file is None:
            self.cycle = _simulated_cycle(cycle)
        else:
            if cycle is not None:
                raise InvalidInput(
                    "The period of the thread is stated by the HAL file. Remove the cycle, which "
                    "is only for simulated drives."
                )
            self.cycle = _file_cycle(self.hal_file)
        self.ahead = math.ceil(FIFO_TIME / self.cycle)
        self.drives = drives
        self.simulates = drives is not None

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare joints with the HAL file, or report the limits of the simulated drives."""
        if self.hal_file is not None:
            _check_file(self.hal_file, arm, self.ahead)
            return [Row("joints", list(arm.joint_names), "", "joints of the HAL file")]
        assert self.drives is not None
        accelerations = list(_accelerations(self.drives, arm))
        unit = unit_of(arm, "rad/s²")
        return [Row("drive_accelerations", accelerations, unit, "accelerations of the drives")]

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> FeederCommand:
        """Write or copy the HAL file, and return the command of the feeder with its environment."""
        if self.hal_file is None:
            assert self.drives is not None
            file = folder / "servo.hal"
            lines = simulated_drives(self.drives, arm, start, self.cycle)
            file.write_text("\n".join(lines) + "\n")
        else:
            file = FilePath(shutil.copy(self.hal_file, folder))
        if shutil.which("halcmd") is None:
            raise ControllerRefused(
                "LinuxCNC is not installed. Install it with: apt-get install "
                "--no-install-recommends linuxcnc-uspace"
            )
        environment = {"RTAPI_FIFO_PATH": str(folder / "rtapi"), "HOME": str(folder)}
        environment["PYTHONPATH"] = str(SOURCE)
        if os.geteuid() == 0:
            environment["RTAPI_UID"] = str(NOBODY)
            folder.chmod(0o711)
            os.chown(folder, NOBODY, NOBODY)
        # HAL uses one fixed address per machine, which other programs also use.
        own_memory = _own_ipc() if self.hal_file is None else []
        words = [*own_memory, SYSTEM_PYTHON, "-m", "armcontour.controllers.feeders.linuxcnc_feeder"]
        words += [*self._record_arguments(folder), str(file), str(self.ahead), str(arm.dof)]
        words.append(repr(SIMULATED_TIMEOUT if self.simulates else MACHINE_TIMEOUT))
        return words, environment


def _own_ipc() -> list[str]:
    """Return the prefix that runs a program with separate shared memory; empty if unavailable."""
    command = ["unshare", "--ipc", *(["--map-current-user"] if os.geteuid() else [])]
    failed = subprocess.run([*command, "true"], capture_output=True, check=False).returncode
    return [] if failed else command


def _simulated_cycle(cycle: float | None) -> float:
    """Return the period of a thread of simulated drives in whole nanoseconds [s].

    Raises:
        InvalidInput: The cycle is out of range.
    """
    if cycle is None:
        return DEFAULT_PERIOD
    cycle = checks.check_range("cycle", cycle, MIN_PERIOD, MAX_PERIOD, "s")
    return round(cycle * 1e9) * 1e-9


def _hal_lines(file: FilePath) -> str:
    """Read a HAL file without its comments, and with single spaces."""
    return re.sub(r"[ \t]+", " ", re.sub(r"#.*", "", read_text(file, "HAL file")))


def _file_cycle(file: FilePath) -> float:
    """Return the period of the thread that a HAL file gives the streamer and the sampler [s].

    Raises:
        ControllerRefused: They have no thread or different ones, or the period is out of range.
    """
    text = _hal_lines(file)
    threads = dict(re.findall(r"^ ?addf (streamer|sampler)\.0 (\S+)", text, re.M))
    periods = {x: _thread_period(text, threads.get(x)) for x in ("streamer", "sampler")}
    for component, period in periods.items():
        if not period:
            raise ControllerRefused(
                f"In {file.name}, the thread of {component}.0 has no period. {file.name} needs "
                f"lines such as loadrt threads name1=servo period1=1000000 and addf {component}.0 "
                f"servo. {HAL_FILE_HINT}"
            )
    period = periods["streamer"]
    if period != periods["sampler"]:
        raise ControllerRefused(
            f"In {file.name}, the thread of sampler.0 has a period of {periods['sampler']} ns, but "
            f"that of streamer.0 has {period} ns. Add both to the same thread."
        )
    if not MIN_PERIOD <= period * 1e-9 <= MAX_PERIOD:
        raise ControllerRefused(
            f"In {file.name}, the thread of streamer.0 has a period of {period} ns, but it must be "
            f"between {MIN_PERIOD * 1e9:.0f} and {MAX_PERIOD * 1e9:.0f} ns. Add streamer.0 and "
            "the components of armcontour to another thread."
        )
    return period * 1e-9


def _thread_period(text: str, thread: str | None) -> int:
    """Return the period of a thread of a HAL file [ns]; 0 if the file does not load it."""
    numbers = {name: x for x, name in re.findall(r"\bname(\d)=(\S+)", text)}
    periods = {x: int(y) for x, y in re.findall(r"\bperiod(\d)=(\d+)", text)}
    base_period = periods.get("1", 0)
    # HAL rounds each period to a multiple of the first one.
    return round(periods.get(numbers.get(thread), 0) / max(base_period, 1)) * base_period


def _check_file(file: FilePath, arm: Arm, ahead: int) -> None:
    """Compare the joints and the FIFO of a HAL file with those of arm and feeder.

    `ahead`: number of rows that the FIFO must hold.

    Raises:
        ControllerRefused: They differ.
    """
    text = _hal_lines(file)
    dof = arm.dof
    for pattern, line in _required_lines(arm):
        if not re.search(rf"^ ?{pattern}", text, re.M):
            raise ControllerRefused(
                f"{file.name} has no line such as {line}, which the "
                f"{count_noun(dof, 'joint')} of {arm.name} need. {HAL_FILE_HINT}"
            )
    depth = re.search(r"^ ?loadrt streamer .*\bdepth=(\d+)", text, re.M)
    if depth is not None and int(depth[1]) <= ahead:
        raise ControllerRefused(
            f"In {file.name}, the streamer has a depth of {depth[1]} rows, but must hold more "
            f"than {ahead}, which are {number(FIFO_TIME, 's')}. Write depth={STREAMER_DEPTH}."
        )


def _required_lines(arm: Arm) -> Iterator[tuple[str, str]]:
    """Yield regular expressions with which lines of a HAL file must begin, and examples."""
    dof = arm.dof
    yield rf"loadrt streamer .*cfg=f{{{dof + 1}}}\b", f"loadrt streamer cfg={'f' * (dof + 1)}"
    yield rf"loadrt sampler .*cfg=f{{{2 * dof + 1}}}\b", f"loadrt sampler cfg={'f' * (2 * dof + 1)}"
    nets = dict(SAFEGUARDS)
    for j, name in enumerate(arm.joint_names, 1):
        limit = f"armcontour-limit-{j}"
        nets[f"armcontour-set-point-{j}"] = f"{limit}.in"
        nets[f"armcontour-acceleration-{j}"] = f"{limit}.maxa"
        nets[signal_name(name)] = f"{limit}.out"
        yield (
            _net_pattern(r"armcontour-disabled", f"{limit}.load"),
            (f"net armcontour-disabled armcontour-latch.fault-out => {limit}.load"),
        )
        yield (
            _net_pattern(f"armcontour-set-point-{j}", f"streamer.0.pin.{j}"),
            (f"net armcontour-set-point-{j} streamer.0.pin.{j} => {limit}.in"),
        )
    for name, pin in nets.items():
        yield _net_pattern(name, pin), f"net {name} {pin}"
    yield r"setp armcontour-player\.data 1\b", "setp armcontour-player.data 1"
    yield r"setp armcontour-alive\.falling 1\b", "setp armcontour-alive.falling 1"
    pins = ["streamer.0", "armcontour-player", "armcontour-alive", "armcontour-latch"]
    for function in (*pins, *(f"armcontour-limit-{j + 1}" for j in range(dof)), "sampler.0"):
        yield rf"addf {re.escape(function)} \S", f"addf {function} servo"


def _net_pattern(name: str, pin: str) -> str:
    """Return the regular expression of a line that links a pin to a signal."""
    return rf"net {re.escape(name)} (.* )?{re.escape(pin)}(?![\w.-])"


def signal_name(joint: str) -> str:
    """Return the name of the HAL signal with a joint's commanded position."""
    return re.sub(r"[^\w.-]", "-", joint)


def _accelerations(servo: ServoModel, arm: Arm) -> FloatArray:
    """Return the acceleration limits of simulated drives [rad/s²], (dof,)."""
    bounds = arm.limits.acceleration_bounds(arm.dof)
    lower, upper = servo.for_joints(arm.dof).saturate(*bounds)
    return np.minimum(-lower, upper)


def simulated_drives(servo: ServoModel, arm: Arm, start: FloatArray, cycle: float) -> Iterator[str]:
    """Write a HAL file with a servo and a double integrator per joint.

    Raises:
        InvalidInput: The servo has other parameters than kp, kv, ki and a dead time of one cycle.
    """
    dof = arm.dof
    limits = _accelerations(servo, arm)
    servo = servo.for_joints(dof)
    late = bool(np.isclose(servo.dead_time, cycle).all())
    servo = servo.replace(dead_time=0.0) if late else servo
    other = [x for x in UNSUPPORTED if np.any(getattr(servo, x))]
    if servo.kv is None or not np.isfinite(servo.kv).all() or other:
        raise InvalidInput(
            "LinuxCNC's simulated drives have only kp, kv and ki. Set plant or --drives "
            f"to a servo of order second without {', '.join(other or UNSUPPORTED)}."
        )
    names = [signal_name(x) for x in arm.joint_names]
    joints = range(dof)

    def each(prefix: str) -> str:
        return ",".join(f"{prefix}{j}" for j in joints)

    yield f"loadrt threads name1=servo period1={round(cycle * 1e9)}"
    yield f"loadrt streamer depth={STREAMER_DEPTH} cfg={'f' * (dof + 1)}"
    yield f"loadrt sampler depth={SAMPLER_DEPTH} cfg={'f' * (2 * dof + 1)}"
    yield f"loadrt pid names={each('p')},{each('v')}"
    yield f"loadrt integ names={each('iv')},{each('iq')}"
    yield f"loadrt sum2 names={each('q')}"
    yield from _safeguards(dof)
    yield "net cycle streamer.0.pin.0 => sampler.0.pin.0"
    for j in joints:
        yield f"setp p{j}.Pgain {servo.kp[j]:.15g}"
        yield f"setp v{j}.Pgain {servo.kv[j]:.15g}"
        yield f"setp v{j}.Igain {servo.kv[j] * servo.ki[j]:.15g}"
        if np.isfinite(limits[j]):
            yield f"setp v{j}.maxoutput {limits[j]:.15g}"
        for loop in "pv":
            yield f"net armcontour-enable => {loop}{j}.enable"
            yield f"setp {loop}{j}.error-previous-target {int(late)}"
        yield f"setp q{j}.offset {start[j]:.17g}"
        limit = f"armcontour-limit-{j + 1}"
        yield f"net {names[j]} {limit}.out => p{j}.command sampler.0.pin.{j + 1}"
        yield f"net w{j} p{j}.output => v{j}.command"
        yield f"net a{j} v{j}.output => iv{j}.in"
        yield f"net s{j} iv{j}.out => v{j}.feedback iq{j}.in"
        yield f"net x{j} iq{j}.out => q{j}.in0"
        yield f"net m{j} q{j}.out => p{j}.feedback sampler.0.pin.{dof + j + 1}"
    order = ["streamer.0", "armcontour-player", "armcontour-alive", "armcontour-latch"]
    order += [f"armcontour-limit-{j + 1}" for j in joints]
    order += [*(f"q{j}" for j in joints), "sampler.0"]
    for loop in "pv":
        order += [f"{loop}{j}.do-pid-calcs" for j in joints]
    for integrator in ("iv", "iq"):
        order += [f"{integrator}{j}" for j in joints]
    yield from (f"addf {x} servo" for x in order)


def _safeguards(dof: int) -> Iterator[str]:
    """Write the lines by which HAL stops the joints when the feeder fails."""
    numbers = range(1, dof + 1)
    limits = [f"armcontour-limit-{j}" for j in numbers]
    yield "loadrt flipflop names=armcontour-player"
    yield "setp armcontour-player.data 1"
    yield "net armcontour-play => armcontour-player.clk"
    yield "net armcontour-empty streamer.0.empty => armcontour-player.reset"
    yield "net armcontour-playing armcontour-player.out => streamer.0.enable"
    yield f"loadrt limit3 names={','.join(limits)}"
    for j, limit in zip(numbers, limits, strict=True):
        yield f"net armcontour-set-point-{j} streamer.0.pin.{j} => {limit}.in"
        yield f"net armcontour-acceleration-{j} => {limit}.maxa"
    yield "loadrt oneshot names=armcontour-alive"
    yield "setp armcontour-alive.falling 1"
    yield "net armcontour-heartbeat => armcontour-alive.in"
    yield "net armcontour-timeout => armcontour-alive.width"
    yield "loadrt estop_latch names=armcontour-latch"
    yield "net armcontour-on => armcontour-latch.reset"
    yield "net armcontour-off => armcontour-latch.fault-in"
    yield "net armcontour-alive armcontour-alive.out => armcontour-latch.ok-in"
    yield "net armcontour-enable armcontour-latch.ok-out"
    loads = " ".join(f"{x}.load" for x in limits)
    yield f"net armcontour-disabled armcontour-latch.fault-out => {loads}"
