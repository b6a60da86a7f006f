"""LinuxCNC's HAL as a controller: a streamer feeds a servo thread, and a sampler records it."""

from __future__ import annotations

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
SEE = "The page LinuxCNC of the documentation has a complete HAL file."
# Signal of a HAL file that enables the drives after the measured position has been commanded.
ENABLE = "armcontour-enable"
# Capacity of the FIFO from the feeder to the servo thread [rows].
STREAMER_DEPTH = 4000
# Capacity of the FIFO from the servo thread to the feeder [rows].
SAMPLER_DEPTH = 8000


class LinuxCNC(Controller):
    """LinuxCNC's HAL with the joints of a HAL file or with simulated drives.

    It needs the Debian package `linuxcnc-uspace`; no real-time kernel.

    Args:
        hal_file: HAL file of the machine. It loads a servo thread of the cycle, a `streamer` with a
            float for the cycle number and one per joint, and a `sampler` with the same and the
            measured positions [rad]. The signal of the command of a joint has the joint's name,
            with `-` in place of spaces; the signal `armcontour-enable` enables the drives, which
            ignore their command before.
        drives: Servo of simulated drives in place of a HAL file: position and velocity loops by
            HAL's `pid`, which integrate to positions, with gains and integrators of the model, and
            the acceleration limits of the model or of the arm. A dead time of one cycle is `pid`
            with `error-previous-target`, LinuxCNC's default.
    """

    name = "linuxcnc"
    # The FIFO holds 0.3 s, against pauses of this machine.
    ahead = 300
    clean_up = (RTAPI, "exit")

    @checks.explained
    def __init__(
        self, hal_file: str | FilePath | None = None, *, drives: ServoModel | None = None
    ) -> None:
        super().__init__()
        if (hal_file is None) == (drives is None):
            raise InvalidInput("LinuxCNC needs either a HAL file or drives to simulate.")
        self.hal_file = None if hal_file is None else FilePath(hal_file)
        self.drives = drives
        self.simulates = drives is not None

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare joints with the HAL file, or report the limits of the simulated drives."""
        if self.hal_file is not None:
            _check_file(self.hal_file, arm, round(self.cycle * 1e9))
            return [Row("joints", list(arm.joint_names), "", "joints of the HAL file")]
        assert self.drives is not None
        accelerations = list(_accelerations(self.drives, arm))
        unit = unit_of(arm, "rad/s²")
        return [Row("drive_accelerations", accelerations, unit, "accelerations of the drives")]

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> FeederCommand:
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
        apart = _own_ipc() if self.hal_file is None else []
        words = [*apart, SYSTEM_PYTHON, "-m", "armcontour.controllers.feeders.linuxcnc_feeder"]
        words += [str(folder / "samples.txt"), str(file), str(self.ahead), str(arm.dof)]
        return words, environment


def _own_ipc() -> list[str]:
    """Prefix that runs a program with separate shared memory; empty if unavailable."""
    command = ["unshare", "--ipc", *(["--map-current-user"] if os.geteuid() else [])]
    failed = subprocess.run([*command, "true"], capture_output=True, check=False).returncode
    return [] if failed else command


def _check_file(file: FilePath, arm: Arm, period: int) -> None:
    """Compare the joints and the period [ns] of a HAL file with those of an arm and of `play`.

    Raises:
        ControllerRefused: They differ.
    """
    text = re.sub(r"[ \t]+", " ", re.sub(r"#.*", "", read_text(file, "HAL file")))
    dof = arm.dof
    joints = [signal_name(x) for x in arm.joint_names]
    lines = {
        rf"loadrt streamer .*cfg=f{{{dof + 1}}}": f"loadrt streamer cfg={'f' * (dof + 1)}",
        rf"loadrt sampler .*cfg=f{{{2 * dof + 1}}}": f"loadrt sampler cfg={'f' * (2 * dof + 1)}",
    }
    for j, name in enumerate(joints, 1):
        pin = f"streamer.0.pin.{j}"
        lines[rf"net {re.escape(name)} .*\b{re.escape(pin)}"] = f"net {name} {pin}"
    # The drives are enabled once their measured position is commanded.
    lines[rf"net {ENABLE} .*\w"] = f"net {ENABLE} => and the pins that enable the drives"
    for pattern, line in lines.items():
        if not re.search(rf"^ ?{pattern}\b", text, re.M):
            raise ControllerRefused(
                f"{file.name} has no line such as {line}, which the "
                f"{count_noun(dof, 'joint')} of {arm.name} need. {SEE}"
            )
    numbers = {name: x for x, name in re.findall(r"\bname(\d)=(\S+)", text)}
    periods = {x: int(y) for x, y in re.findall(r"\bperiod(\d)=(\d+)", text)}
    threads = dict(re.findall(r"^ ?addf (streamer|sampler)\.0 (\S+)", text, re.M))
    for component in ("streamer", "sampler"):
        # HAL rounds each period to a multiple of the first one.
        first, written = (periods.get(x, 0) for x in ("1", numbers.get(threads.get(component))))
        actual = round(written / max(first, 1)) * first
        if actual != period:
            stated = f"a period of {actual} ns, a multiple of period1" if actual else "no period"
            raise ControllerRefused(
                f"In {file.name}, the thread of {component}.0 has {stated}, but set-points are "
                f"sent every {period} ns, as in loadrt threads name1=servo period1={period} and "
                f"addf {component}.0 servo."
            )


def signal_name(joint: str) -> str:
    """Name of the HAL signal with the commanded position of a joint."""
    return re.sub(r"[^\w.-]", "-", joint)


def _accelerations(servo: ServoModel, arm: Arm) -> FloatArray:
    """Acceleration limits of simulated drives [rad/s²], (dof,)."""
    bounds = arm.limits.acceleration_bounds(arm.dof)
    lower, upper = servo.for_joints(arm.dof).saturate(*bounds)
    return np.minimum(-lower, upper)


def simulated_drives(servo: ServoModel, arm: Arm, start: FloatArray, cycle: float) -> Iterator[str]:
    """Text of a HAL file with a servo and a double integrator per joint."""
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
    yield f"newsig {ENABLE} bit"
    yield "net cycle streamer.0.pin.0 => sampler.0.pin.0"
    for j in joints:
        yield f"setp p{j}.Pgain {servo.kp[j]:.15g}"
        yield f"setp v{j}.Pgain {servo.kv[j]:.15g}"
        yield f"setp v{j}.Igain {servo.kv[j] * servo.ki[j]:.15g}"
        if np.isfinite(limits[j]):
            yield f"setp v{j}.maxoutput {limits[j]:.15g}"
        for loop in "pv":
            yield f"net {ENABLE} {loop}{j}.enable"
            yield f"setp {loop}{j}.error-previous-target {int(late)}"
        yield f"setp q{j}.offset {start[j]:.17g}"
        yield f"net {names[j]} streamer.0.pin.{j + 1} => p{j}.command sampler.0.pin.{j + 1}"
        yield f"net w{j} p{j}.output => v{j}.command"
        yield f"net a{j} v{j}.output => iv{j}.in"
        yield f"net s{j} iv{j}.out => v{j}.feedback iq{j}.in"
        yield f"net x{j} iq{j}.out => q{j}.in0"
        yield f"net m{j} q{j}.out => p{j}.feedback sampler.0.pin.{dof + j + 1}"
    order = ["streamer.0", *(f"q{j}" for j in joints), "sampler.0"]
    for loop in "pv":
        order += [f"{loop}{j}.do-pid-calcs" for j in joints]
    for integrator in ("iv", "iq"):
        order += [f"{integrator}{j}" for j in joints]
    yield from (f"addf {x} servo" for x in order)
