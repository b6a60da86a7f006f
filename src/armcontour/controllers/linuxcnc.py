"""LinuxCNC's HAL as a controller: a streamer feeds a servo thread, a sampler records it."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path as FilePath

import numpy as np

from armcontour.controllers.controller import Command, Controller
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused, InvalidInput
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel

# Parent folder of the package, for the Python of the system.
SOURCE = FilePath(__file__).parents[2]
SYSTEM_PYTHON = "/usr/bin/python3"
# The real-time program refuses root; it then runs as this user, nobody.
NOBODY = 65534
# Dry friction of simulated joints grows with their speed by this factor until its size [1/s].
SLIDING = 500.0
# Rows of the FIFOs between the feeder and the thread.
STREAMER_DEPTH, SAMPLER_DEPTH = 4000, 8000


@checks.explain_calls
class LinuxCNC(Controller):
    """LinuxCNC's HAL, with the joints of a HAL file, or with simulated drives.

    It needs the Debian package `linuxcnc-uspace`; no real-time kernel.

    Args:
        hal_file: HAL file of the machine. It loads a servo thread of the cycle, a `streamer` with a
            float for the cycle number and one per joint, and a `sampler` with the same and the
            measured positions [rad]. By default joints are simulated.
        servo: Simulated drives: position and velocity loops by HAL's `pid`, which integrate to
            positions; gains, integrators and dry friction of the model are used.
        accelerations: Largest acceleration of the simulated drives [rad/s²], one or one per joint.
        late: True for `pid` with `error-previous-target`, LinuxCNC's default, with which a loop
            compares the measured position with the command of the cycle before.
        cycle: Cycle of the servo thread [s].
        ahead: Time that the FIFO holds, against pauses of this machine [s].
    """

    name = "linuxcnc"

    def __init__(
        self,
        hal_file: str | FilePath | None = None,
        *,
        servo: ServoModel | None = None,
        accelerations: float | FloatArray = np.inf,
        late: bool = False,
        cycle: float = 1e-3,
        ahead: float = 0.3,
    ) -> None:
        super().__init__()
        self.hal_file = None if hal_file is None else FilePath(hal_file)
        if (self.hal_file is None) == (servo is None):
            raise InvalidInput("LinuxCNC needs a HAL file, or a servo to simulate; give one.")
        # Threads of a HAL file write to drives as soon as they run.
        self.observes = self.hal_file is None
        self.servo, self.accelerations, self.late = servo, accelerations, late
        self.cycle, self.ahead = cycle, round(ahead / cycle)

    @classmethod
    def simulated(cls, servo: ServoModel, arm: Arm) -> LinuxCNC:
        """LinuxCNC with simulated drives whose accelerations are limited as the servo's, or arm's.

        Args:
            servo: The drives; with a dead time of one cycle loops are `late`.
            arm: The arm.

        Raises:
            InvalidInput: Another dead time, or something else that these drives have not.
        """
        cycle = 1e-3
        model, bounds = servo.for_joints(arm.dof), arm.limits.acceleration_bounds(arm.dof)
        late = np.isclose(model.dead_time, cycle)
        has_feed = model.velocity_feedforward.any() or model.acceleration_feedforward.any()
        if not (late.all() or (model.dead_time == 0).all()) or has_feed:
            raise InvalidInput(
                "Simulated drives of LinuxCNC have a dead time of 0 or 1 ms, the same in all "
                "joints, and no feed-forward: describe them with the key plant of the job, or with "
                "--drives."
            )
        lower, upper = model.saturate(*bounds)
        return cls(
            servo=model,
            accelerations=np.minimum(-lower, upper),
            late=bool(late.all()),
            cycle=cycle,
        )

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> Command:
        if shutil.which("halcmd") is None:
            raise ControllerRefused(
                "LinuxCNC is not installed: apt-get install --no-install-recommends linuxcnc-uspace"
            )
        file = folder / "servo.hal"
        if self.hal_file is None:
            assert self.servo is not None
            lines = simulated_drives(
                self.servo.for_joints(arm.dof), start, self.accelerations, self.late, self.cycle
            )
            file.write_text("\n".join(lines) + "\n")
        else:
            shutil.copy(self.hal_file, file)
        environment = {"RTAPI_FIFO_PATH": str(folder / "rtapi"), "HOME": str(folder)}
        environment["PYTHONPATH"] = str(SOURCE)
        apart: list[str] = []
        if os.geteuid() == 0:
            environment["RTAPI_UID"] = str(NOBODY)
            folder.chmod(0o711)
            os.chown(folder, NOBODY, NOBODY)
            apart = ["unshare", "--ipc"]
        elif self.hal_file is None:
            apart = ["unshare", "--map-current-user", "--ipc"]
            if subprocess.run([*apart, "true"], capture_output=True, check=False).returncode:
                apart = []
        if self.hal_file is not None:
            # The HAL of a machine has one fixed address that other programs use, too.
            apart = []
        words = [*apart, SYSTEM_PYTHON, "-m", "armcontour.controllers.devices.linuxcnc"]
        words += [str(folder / "samples.txt"), str(file), str(self.ahead)]
        return Command([*words, *map(repr, start.tolist())], environment)


def simulated_drives(
    servo: ServoModel,
    start: FloatArray,
    accelerations: float | FloatArray,
    late: bool,
    cycle: float,
) -> Iterator[str]:
    """Lines of a HAL file with a servo and a double integrator per joint."""
    if servo.kv is None:
        raise InvalidInput("LinuxCNC simulates servos of order second.")
    dof = len(start)
    limits = np.broadcast_to(np.asarray(accelerations, dtype=float), dof)
    joints = range(dof)

    def names(prefix: str) -> str:
        return ",".join(f"{prefix}{j}" for j in joints)

    yield f"loadrt threads name1=servo period1={round(cycle * 1e9)}"
    yield f"loadrt streamer depth={STREAMER_DEPTH} cfg={'f' * (dof + 1)}"
    yield f"loadrt sampler depth={SAMPLER_DEPTH} cfg={'f' * (2 * dof + 1)}"
    yield f"loadrt pid names={names('p')},{names('v')}"
    yield f"loadrt integ names={names('iv')},{names('iq')}"
    yield f"loadrt sum2 names={names('q')},{names('a')}"
    yield f"loadrt scale names={names('fs')}"
    yield f"loadrt limit1 names={names('fl')}"
    yield "net cycle streamer.0.pin.0 => sampler.0.pin.0"
    for j in joints:
        yield f"setp p{j}.Pgain {servo.kp[j]:.15g}"
        yield f"setp v{j}.Pgain {servo.kv[j]:.15g}"
        yield f"setp v{j}.Igain {servo.kv[j] * servo.ki[j]:.15g}"
        yield f"setp a{j}.gain1 -1"
        # Dry friction, which is the same as a position error.
        friction = servo.kp[j] * servo.kv[j] * servo.friction[j]
        yield f"setp fs{j}.gain {SLIDING:g}"
        yield f"setp fl{j}.min {-friction:.15g}"
        yield f"setp fl{j}.max {friction:.15g}"
        if np.isfinite(limits[j]):
            yield f"setp v{j}.maxoutput {limits[j]:.15g}"
        for loop in "pv":
            yield f"setp {loop}{j}.enable 1"
            yield f"setp {loop}{j}.error-previous-target {int(late)}"
        yield f"setp q{j}.offset {start[j]:.17g}"
        yield f"net u{j} streamer.0.pin.{j + 1} => p{j}.command sampler.0.pin.{j + 1}"
        yield f"net w{j} p{j}.output => v{j}.command"
        yield f"net d{j} v{j}.output => a{j}.in0"
        yield f"net s{j} iv{j}.out => v{j}.feedback iq{j}.in fs{j}.in"
        yield f"net r{j} fs{j}.out => fl{j}.in"
        yield f"net f{j} fl{j}.out => a{j}.in1"
        yield f"net a{j} a{j}.out => iv{j}.in"
        yield f"net x{j} iq{j}.out => q{j}.in0"
        yield f"net m{j} q{j}.out => p{j}.feedback sampler.0.pin.{dof + j + 1}"
    order = ["streamer.0", *(f"q{j}" for j in joints), "sampler.0"]
    order += [f"{loop}{j}.do-pid-calcs" for loop in "pv" for j in joints]
    order += [f"{prefix}{j}" for prefix in ("fs", "fl", "a", "iv", "iq") for j in joints]
    yield from (f"addf {x} servo" for x in order)
