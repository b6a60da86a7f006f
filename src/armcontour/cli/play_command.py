"""The command `play`: moves a robot along the plan of a job, and records the motion."""

from __future__ import annotations

import shlex
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path as FilePath

import numpy as np
import typer

from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import ControllerOptions, Play
from armcontour.cli.console import ProgressDisplay, data_lines, print_lines
from armcontour.cli.inputs import open_job, read_option
from armcontour.cli.interruption import on_interrupt
from armcontour.cli.override_keys import HINT, OverrideKeys
from armcontour.controllers import Controller, Franka, LinuxCNC, Played, Ur, player
from armcontour.controllers.controller import UNFINISHED
from armcontour.controllers.path_back import check_configuration
from armcontour.controllers.unfinished import UnfinishedMotion, unfinished_place
from armcontour.core.checks import check_choice, raise_if
from armcontour.core.errors import ControllerLost, ControllerRefused, FileError, InvalidInput
from armcontour.core.quantities import AngularDistance, Interval
from armcontour.core.render import figure, number, plain
from armcontour.core.text import capitalise
from armcontour.files import ResultFolder
from armcontour.files.limits_and_servo_files import read_servo
from armcontour.files.log_file import log_head, log_text
from armcontour.files.set_point_reader import read_set_points
from armcontour.files.stop_file import (
    LOG,
    read_stopped_place,
    read_unfinished,
    unfinished_comment,
)
from armcontour.jobs import Job
from armcontour.jobs.job import choose_run
from armcontour.jobs.stopped_place import StoppedPlace

# Exit code: the motion was as simulated, or this was a dry run.
DONE = 0
# Exit code: the motion was stopped, or it differs from the simulation.
STOPPED = 1
# Comment in a record that remains because its command did not end.
UNFINISHED_NOTE = (
    "This record is incomplete: the command was ended or failed. It includes the motion to the "
    "start. In the column cycle, -1 and less is not the motion of the job."
)
DRY = "Dry run: the robot has not moved. Add --execute to move the robot."


def play(options: Play, folder: ResultFolder | None, progress: ProgressDisplay) -> Outcome:
    """Compare a run with a controller, and with --execute play it."""
    execute = options.execute
    if folder is not None and not execute:
        raise InvalidInput("--out also requires --execute, because only a motion has a log.")
    refuse_without_terminal(options)
    band = read_option("--band", options.band, AngularDistance)
    learned = options.set_points
    is_learned = learned is not None
    stop = read_stop(options)
    job = open_job(options.job, options, progress)
    name = options.run_name
    controller = controller_of(job, options)
    if isinstance(stop, UnfinishedMotion):
        stop = unfinished_place(
            job, controller, stop, run_name=name, learned=is_learned, progress=progress
        )
    if stop is not None:
        job = stop.resumed(job)
        name = name or stop.run
    speed = player.start_override(choose_run(job, name, "played"), learned=is_learned)
    job, plan = player.plan_kept(job, controller, name, is_learned, speed, progress)
    if stop is not None:
        check_configuration(plan, stop)
    ready = player.prepare_motion(
        job,
        plan,
        controller,
        set_points=None if learned is None else read_set_points(learned, job, plan),
        band=band,
        speed_factor=speed,
    )
    played = player.Player(controller, progress=progress).play(ready)
    end = [DRY]
    keys = OverrideKeys(speed)
    error = None
    if execute:
        with confirmed(played, keys.ended, progress), keys.listening():
            begin_record(controller, folder, played)
            print_lines(HINT, err=True)
            override = keys if is_learned else player.override_of_plan(plan, keys)
            try:
                of_keys = player.Player(
                    controller, True, keys.ended.is_set, progress, override, keys.pause_after
                )
                played = of_keys.play(ready)
            except ControllerLost as lost:
                error = lost
                played = player.lost_motion(played, lost)
                if played.record is None:
                    # The record of the feeder remains.
                    raise
        if not is_approach(played):
            played = player.judge_motion(played, band)
        end = write_log(folder, played)
    data = played.to_data()
    code = DONE if played.kept or not execute else STOPPED
    return Outcome(lines=[*data_lines(data), *end], page=plain(data), code=code, error=error)


def begin_record(controller: Controller, folder: ResultFolder | None, played: Played) -> None:
    """Let the feeder process write its record into the result folder, where it survives kills."""
    if folder is not None:
        arm = played.job.arm
        named = unfinished_comment(played.job, played.plan.run.name)
        comments = ("interpolation: linear", named, UNFINISHED_NOTE)
        head = log_head(comments, arm.chain.prismatic or (False,) * arm.dof)
        controller.record_file = folder.begin_record(UNFINISHED, f"{head},cycle\n")


def is_approach(played: Played) -> bool:
    """Return whether the connection was lost during the approach to the start.

    An approach gets no verdict.
    """
    record = played.record
    if record is None or played.approach_speed is None:
        return False
    distances = np.abs(record.command[0] - played.motion.q[0])
    return not player.is_at_start(played.job.arm, distances)


def write_log(folder: ResultFolder | None, played: Played) -> list[str]:
    """Write the log of a motion; return lines that say where it is, and how to continue.

    Raises:
        FileError: It cannot be written to the folder; the message says where it is instead.
    """
    if folder is None or played.record is None:
        return []
    text = log_text(played.log)
    try:
        folder.write(LOG, text)
    except FileError as error:
        with suppress(OSError):
            file = FilePath(tempfile.mkdtemp(prefix="armcontour-log-")) / LOG
            file.write_text(text, encoding="utf-8")
            raise FileError(f"{error} The log of the motion is in {file}.") from None
        raise
    lines = [f"Log: {folder.folder / LOG}"]
    if played.stopped_at is not None and played.stopped_at.resume_at is not None:
        lines.append(
            "To continue where the motion was stopped, repeat the command with "
            f"--resume {shlex.quote(str(folder.folder))}, and with another folder for --out."
        )
    return lines


def read_stop(options: Play) -> StoppedPlace | UnfinishedMotion | None:
    """Return the stop that --resume names, or the record of a command that did not end.

    Raises:
        InvalidInput: --resume-at also states a place, or the folder has no stopped motion.
    """
    if options.resume is None:
        return None
    sets = options.sets or ()
    raise_if(
        options.keys.get("resume_at") is not None
        or any(x.startswith("process.resume_at") for x in sets),
        "--resume and --resume-at both state where the job goes on. Remove one of them.",
    )
    return read_unfinished(options.resume) or read_stopped_place(options.resume)


def controller_of(job: Job, options: ControllerOptions) -> Controller:
    """Make the controller that `--on` names; without `--hal`, linuxcnc simulates the joints."""
    name = check_choice("--on", str(options.on), ("linuxcnc", "franka", "ur"))
    hal = options.hal
    address = options.address
    drives = options.drives
    period = options.thread_period
    if name == "linuxcnc":
        raise_if(address is not None, "--address is only allowed with --on franka or ur.")
        raise_if(None not in (hal, drives), "--drives is only allowed without --hal.")
        raise_if(None not in (hal, period), "--thread-period is only allowed without --hal.")
        if hal is not None:
            return LinuxCNC(hal)
        servo = job.plant_servo if drives is None else read_servo(drives, job.arm.dof)
        return LinuxCNC(drives=servo, cycle=read_option("--thread-period", period, Interval))
    raise_if(hal is not None, f"--hal is only allowed with --on linuxcnc, but --on is {name}.")
    raise_if(drives is not None, "--drives is only allowed with --on linuxcnc.")
    raise_if(period is not None, "--thread-period is only allowed with --on linuxcnc.")
    if address is None:
        raise InvalidInput(f"--on {name} requires the robot's address. Specify it with --address.")
    if name == "ur":
        return Ur(address, job.export.servoj)
    return Franka(address)


def refuse_without_terminal(options: ControllerOptions) -> None:
    """Raise ControllerRefused if a robot is to move but no terminal exists for the confirmation."""
    if options.execute and not sys.stdin.isatty():
        raise ControllerRefused(
            "--execute requires a terminal on which the motion is confirmed, but the input is not "
            "a terminal. The robot has not moved."
        )


@contextmanager
def confirmed(dry: Played, stop: threading.Event, progress: ProgressDisplay) -> Iterator[None]:
    """Context of a motion, which a signal stops, after the user has typed the name of the arm."""
    arm = dry.job.arm
    name = arm.name
    distances = np.zeros(arm.dof) if dry.distances is None else dry.distances
    distance = figure(player.largest_distance(distances, arm))
    speed = ""
    if dry.approach_speed is not None:
        speed = f", with the tool at up to {number(dry.approach_speed, 'm/s')}"
    outputs = f" {capitalise(dry.outputs_note)}" if dry.outputs_note else ""
    progress.hide()
    answer = typer.prompt(
        f"{name} will move on {dry.controller}, first by up to {distance} to "
        f"the start{speed}.{outputs} Type {name} to continue",
        default="",
    )
    if answer.strip() != name:
        raise ControllerRefused(
            f"The confirmation must be {name}, but is {answer.strip()!r}. The robot has not moved."
        )
    with on_interrupt(stop.set):
        yield
