"""The command `identify` with `--on`: servos from motions that a robot executes."""

from __future__ import annotations

import threading
from dataclasses import replace

from armcontour.cli import play_command as playing
from armcontour.cli.commands import Identify
from armcontour.cli.console import ProgressDisplay, data_lines
from armcontour.cli.execution import Outcome
from armcontour.cli.inputs import open_job, read_option, refuse_given
from armcontour.control.identification import ServoFit
from armcontour.controllers import RobotIdentification, robot_identification
from armcontour.controllers.player import Player
from armcontour.core.checks import raise_if
from armcontour.core.quantities import Reserve
from armcontour.core.render import plain
from armcontour.files import ResultFolder


def identify_robot(
    options: Identify, fitting: ServoFit, folder: ResultFolder | None, progress: ProgressDisplay
) -> Outcome | RobotIdentification:
    """Identify the servos of a robot from motions that it executes.

    Returns an outcome without servos after a dry run or a stop.
    """
    count = len(options.logs)
    raise_if(count != 1, f"--on requires exactly one job, but {count} files are given.")
    of_logs = ("arm", "validate", "columns", "start", "end")
    refuse_given(options, of_logs, "applies only to logs. Remove it, or remove --on.")
    raise_if(
        options.execute and folder is None,
        "--execute requires --out, the folder for servo.yaml and the logs.",
    )
    playing.refuse_without_terminal(options)
    reserve = read_option("--reserve", options.reserve, Reserve)
    job = open_job(options.logs[0], options, progress)
    controller = playing.controller_of(job, options)
    motions = robot_identification.prepare_identification(
        job, controller, options.run_name, reserve, progress
    )
    fitting, stop = replace(fitting, kinematics=job.arm), threading.Event()
    result = robot_identification.play_identification(
        motions, Player(controller, progress=progress), fitting
    )
    if options.execute:
        player = Player(controller, True, stop.is_set, progress)
        with playing.confirmed(result.played["run"], stop, progress):
            result = robot_identification.play_identification(motions, player, fitting)
    if result.fit is None:
        data, code = result.to_data(), playing.STOPPED if result.stopped else playing.DONE
        end = "Stopped: nothing was identified." if result.stopped else playing.DRY
        return Outcome(lines=[*data_lines(data), end], page=plain(data), code=code)
    return result
