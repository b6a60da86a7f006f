"""The command `play`: moves a robot along the plan of a job, and records the motion."""

from __future__ import annotations

import sys
import threading
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

import typer

from armcontour.cli.console import print_json, print_lines, result_folder, show_data
from armcontour.cli.inputs import open_job, read_option
from armcontour.cli.interrupts import on_interrupt
from armcontour.cli.options import ControllerOptions, JobOptions, JobOrDrawing, PlayOptions
from armcontour.cli.program import ROBOT, command
from armcontour.cli.progress_bars import show_progress
from armcontour.core.errors import ControllerRefused, InvalidInput

if TYPE_CHECKING:
    from armcontour.controllers import Controller, Played
    from armcontour.files import ResultFolder
    from armcontour.jobs import Job

# Exit codes. DONE: the motion was as simulated, or dry run. STOPPED: it was stopped or differs.
DONE, STOPPED = 0, 1
DRY = "Dry run: the robot has not moved. Add --execute to move the robot."
# Options that require --on, by field of `ControllerOptions`.
OF_CONTROLLER = {x: f"--{x}" for x in ("execute", "drives", "hal", "address")}


@command(ROBOT, "play job.yaml --on linuxcnc --speed-factor '50 %' --execute --out played")
def play(job: JobOrDrawing, options: PlayOptions, job_options: JobOptions) -> int:
    """Play a run on a robot controller and record it; the robot moves only with --execute."""
    from armcontour.controllers.player import (
        Player,
        SpeedFactor,
        judge_motion,
        plan_kept,
        prepare_motion,
    )
    from armcontour.core.quantities import AngularDistance
    from armcontour.files.set_point_file import read_set_points

    if options.out is not None and not options.execute:
        raise InvalidInput("--out requires --execute too, because only a motion has a log.")
    refuse_without_terminal(options)
    speed_factor = read_option("--speed-factor", options.speed_factor, SpeedFactor)
    band = read_option("--band", options.band, AngularDistance)
    assert speed_factor is not None
    stop = threading.Event()
    with result_folder(options) as folder:
        with show_progress("playing") as progress:
            opened = open_job(job, job_options, progress)
            controller = controller_of(opened, options.on, options)
            opened, plan = plan_kept(
                opened,
                options.run_name,
                speed_factor,
                learned=options.set_points is not None,
                progress=progress,
            )
            set_points = None
            if options.set_points is not None:
                set_points = read_set_points(options.set_points, opened, plan)
            ready = prepare_motion(
                opened,
                plan,
                controller,
                set_points=set_points,
                speed_factor=speed_factor,
                band=band,
            )
            played = Player(controller, progress=progress).play(ready)
        if options.execute:
            confirm(played)
            with on_interrupt(stop.set), show_progress("playing") as progress:
                played = Player(controller, True, stop.is_set, progress).play(ready)
            played = judge_motion(played, controller.cycle, band)
        if folder is not None:
            _write(played, folder)
    if options.as_json:
        print_json(played.to_data())
    else:
        show_data(played.to_data())
        _print_end(played, options)
    return DONE if played.kept or not options.execute else STOPPED


def controller_of(job: Job, name: str, options: ControllerOptions) -> Controller:
    """Controller with the name of `--on`; joints of linuxcnc are simulated without `--hal`."""
    from armcontour.controllers import Franka, LinuxCNC, Ur
    from armcontour.core.checks import check_choice, raise_if
    from armcontour.files.robot_file import read_servo

    check_choice("--on", name, ("linuxcnc", "franka", "ur"))
    hal, address, drives = options.hal, options.address, options.drives
    if name == "linuxcnc":
        raise_if(address is not None, "--address is only allowed with --on franka or ur.")
        raise_if(None not in (hal, drives), "--drives is only allowed without --hal.")
        if hal is not None:
            return LinuxCNC(hal)
        servo = job.plant_servo if drives is None else read_servo(drives, job.arm.dof)
        return LinuxCNC(drives=servo)
    raise_if(hal is not None, f"--hal is only allowed with --on linuxcnc, but --on is {name}.")
    raise_if(drives is not None, "--drives is only allowed with --on linuxcnc.")
    if address is None:
        raise InvalidInput(f"--on {name} requires the robot's address. Specify it with --address.")
    if name == "ur":
        return Ur(address)
    return Franka(address)


def refuse_without_controller(
    options: ControllerOptions, others: Mapping[str, str] = MappingProxyType({})
) -> None:
    """Raise InvalidInput for options that require --on; `others`: further such options by field."""
    from armcontour.core.checks import raise_if

    for name, option in {**OF_CONTROLLER, **others}.items():
        message = f"{option} requires --on. Specify a controller with --on too."
        raise_if(bool(getattr(options, name)), message)


def refuse_without_terminal(options: ControllerOptions) -> None:
    """Raise ControllerRefused if a robot is to move but no terminal exists for the confirmation."""
    if options.execute and not sys.stdin.isatty():
        raise ControllerRefused(
            "--execute requires a terminal on which the motion is confirmed, but the input is not "
            "a terminal. The robot has not moved."
        )


def confirm(dry: Played) -> None:
    """Raise ControllerRefused unless the user confirms the motion by typing the arm's name."""
    from armcontour.core.render import number

    name = dry.job.arm.name
    answer = typer.prompt(
        f"{name} will move on {dry.controller}, first by up to {number(dry.distance, 'rad')} to "
        f"the start. Type {name} to continue",
        default="",
    )
    if answer.strip() != name:
        raise ControllerRefused(
            f"The confirmation must be {name}, but is {answer.strip()!r}. The robot has not moved."
        )


def _write(played: Played, folder: ResultFolder) -> None:
    """Write the log and the summary of a played run."""
    from armcontour.files.log_file import log_text
    from armcontour.files.result_folder import data_json

    if played.record is not None:
        folder.write("log.csv", log_text(played.log))
    folder.write("summary.json", data_json(played.to_data()))


def _print_end(played: Played, options: PlayOptions) -> None:
    """Print whether the robot moved, and the file of the log."""
    if not options.execute:
        print_lines(DRY)
    elif played.record is None and not played.approach:
        print_lines("Stopped before the motion.")
    elif options.out is not None:
        print_lines(f"Log: {options.out / 'log.csv'}")
