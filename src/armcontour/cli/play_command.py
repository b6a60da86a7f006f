"""The command `play`: move a robot along the plan of a job, and record it."""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path as FilePath
from types import MappingProxyType
from typing import TYPE_CHECKING

import typer

from armcontour.cli.console import Console
from armcontour.cli.inputs import open_job, read_option
from armcontour.cli.interrupts import on_interrupt
from armcontour.cli.progress_bars import search_progress
from armcontour.core.progress import subprogress

if TYPE_CHECKING:
    from armcontour.cli.options import ControllerOptions, JobOptions, PlayOptions
    from armcontour.controllers import Controller, Played
    from armcontour.files import ResultFolder
    from armcontour.jobs import Job

# Exit codes: played to its end, or a dry run; stopped on the path.
DONE, STOPPED = 0, 1
DRY = "Dry run: nothing moved. With --execute the robot moves."
# Options of a controller by their fields.
OF_CONTROLLER = {x: f"--{x}" for x in ("execute", "drives", "hal", "address")}


def play_file(file: FilePath, job_options: JobOptions, options: PlayOptions) -> int:
    """Play a run of a job, print and write the record, and return the exit code."""
    from armcontour.controllers.player import Player, check_speed, plan_played, play_planned
    from armcontour.core.errors import InvalidInput
    from armcontour.core.quantities import AngularDistance, Factor
    from armcontour.files import ResultFolder
    from armcontour.files.result_folder import data_json
    from armcontour.files.set_point_file import read_set_points

    if options.out is not None and not options.execute:
        raise InvalidInput("--out is for the log of a motion: add --execute, or remove --out.")
    refuse_without_terminal(options)
    speed_factor = read_option("--speed-factor", options.speed_factor, Factor)
    band = read_option("--band", options.band, AngularDistance)
    assert speed_factor is not None
    check_speed(speed_factor, learned=options.set_points is not None)
    stop = threading.Event()
    with (
        nullcontext()
        if options.out is None
        else ResultFolder(options.out, force=options.force) as folder
    ):
        with search_progress("playing") as progress:
            job = open_job(file, job_options, subprogress(progress, "reading"))
            controller = controller_of(job, options.on, options)
            job, plan = plan_played(job, options.run_name, speed_factor, progress=progress)
            set_points = None
            if options.set_points is not None:
                set_points = read_set_points(options.set_points, job, plan)
        if options.execute:
            confirm(job, controller)
        with on_interrupt(stop.set), search_progress("playing") as progress:
            played = play_planned(
                Player(controller, options.execute, stop.is_set, progress),
                job,
                plan,
                speed_factor=speed_factor,
                band=band,
                set_points=set_points,
            )
        if folder is not None:
            _write(played, folder)
    if options.as_json:
        print(data_json(played.to_data()), end="")
    else:
        _print(played, options)
    if played.record is None:
        return STOPPED if options.execute else DONE
    return DONE if played.record.stopped is None else STOPPED


def controller_of(job: Job, name: str, options: ControllerOptions) -> Controller:
    """The controller of a name, with a simulated robot as the job describes it where possible."""
    from armcontour.controllers import Franka, LinuxCNC, Ur
    from armcontour.core.errors import InvalidInput
    from armcontour.files.robot_file import read_servo

    if name not in ("linuxcnc", "franka", "ur"):
        raise InvalidInput(f"There is no controller {name}: --on takes linuxcnc, franka or ur.")
    if options.hal is not None and name != "linuxcnc":
        raise InvalidInput(f"--hal is for linuxcnc, and --on is {name}.")
    if name != "linuxcnc":
        if options.address is None:
            raise InvalidInput(f"--on {name} needs the address of the robot: add --address.")
        if options.drives is not None:
            raise InvalidInput("--drives is for the simulated joints of linuxcnc: remove it.")
        if name == "ur":
            return Ur(options.address)
        return Franka(options.address, model="panda" if job.arm.name == "Panda" else "fr3")
    if options.address is not None:
        raise InvalidInput("--address is for franka and ur: linuxcnc runs on this machine.")
    if options.hal is None:
        servo = job.plant_servo
        if options.drives is not None:
            servo = read_servo(options.drives, job.arm.dof)
        return LinuxCNC.simulated(servo, job.arm)
    if options.drives is not None:
        raise InvalidInput("--drives is for simulated joints: remove it or --hal.")
    return LinuxCNC(options.hal)


def refuse_without_controller(
    options: ControllerOptions, others: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Reject options of a controller without --on; `others` are options of a command by field."""
    from armcontour.core.checks import raise_if

    for name, option in {**OF_CONTROLLER, **others}.items():
        message = f"{option} goes with --on: name a controller too."
        raise_if(bool(getattr(options, name)), message)


def refuse_without_terminal(options: ControllerOptions) -> None:
    """Refuse to move a robot without a terminal on which the user confirms it."""
    from armcontour.core.errors import ControllerRefused

    if options.execute and not sys.stdin.isatty():
        raise ControllerRefused(
            "--execute asks on a terminal before a robot moves, but there is none; nothing moves."
        )


def confirm(job: Job, controller: Controller) -> None:
    """Let the user type the name of the arm."""
    from armcontour.core.errors import ControllerRefused

    name = job.arm.name
    answer = typer.prompt(
        f"{name} will move on {controller.name}. Type {name} to go on", default=""
    )
    if answer.strip() != name:
        raise ControllerRefused(f"{answer.strip()!r} is not {name}; nothing moves.")


def _write(played: Played, folder: ResultFolder) -> None:
    """Write the log and the summary."""
    from armcontour.files.log_file import log_text
    from armcontour.files.result_folder import data_json

    if played.record is not None:
        folder.write("log.csv", log_text(played.log))
    folder.write("summary.json", data_json(played.to_data()))


def _print(played: Played, options: PlayOptions) -> None:
    """Print what moved or would move."""
    console = Console()
    console.show(played.to_data())
    if not options.execute:
        console.print(DRY)
    elif played.record is None:
        console.print("Stopped before the motion.")
    elif options.out is not None:
        console.print(f"Log: {options.out / 'log.csv'}")
