"""The command `identify`: identifies servos from logs, or from motions of a robot."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.command_execution import REPORT, Outcome
from armcontour.cli.commands import Identify
from armcontour.cli.console import ProgressDisplay, data_lines, print_lines
from armcontour.cli.inputs import (
    NEEDS_ON,
    OF_CONTROLLER,
    open_job,
    read_option,
    read_window,
    refuse_given,
)
from armcontour.control import identification
from armcontour.control.identification import Identification, ServoFit
from armcontour.core.checks import raise_if
from armcontour.core.quantities import Interval, Reserve
from armcontour.core.render import plain
from armcontour.core.result import Data, Row
from armcontour.files import ResultFolder
from armcontour.files.limits_and_servo_files import read_servo, servo_yaml
from armcontour.files.log_file import log_text, read_log
from armcontour.files.sources import recording_files
from armcontour.motion import Log
from armcontour.motion.log import arrange_joints
from armcontour.report.identification import render_identification
from armcontour.report.origin import Origin
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel

if TYPE_CHECKING:
    from armcontour.controllers.robot_identification import RobotIdentification

# Exit code: every joint has a valid model and the compensation is trusted.
DONE = 0
# Exit code: a joint has no valid model, or the compensation is not trusted.
DOUBTFUL = 1
# Exit code: the compensation is trusted for one program only. No error has this exit code.
PROVISIONAL = 9


def identify(options: Identify, folder: ResultFolder | None, progress: ProgressDisplay) -> Outcome:
    """Identify servos from logs; with --on, from motions."""
    fitting = ServoFit(
        model=options.model,
        interpolation=options.interpolation,
        drive_cycle=read_option("--drive-cycle", options.drive_cycle, Interval),
    )
    if options.on is not None:
        return _identify_robot(options, fitting, folder, progress)
    options_with_controller = (*OF_CONTROLLER, "run_name", "sets")
    refuse_given(options, options_with_controller, NEEDS_ON)
    arm = None
    if options.arm is not None:
        from armcontour.cli.check_command import named_arm

        arm = named_arm(options.arm)
    with recording_files() as sources:
        unseen = [_read(log, options, arm) for log in options.validate or []]
        samples = [_read(log, options, arm) for log in options.logs]
    fit = identification.identify(samples, replace(fitting, kinematics=arm), progress=progress)
    validated = [fit.predict(log) for log in unseen]
    printed = validated or [fit.predict(log) for log in fit.logs if arm is not None]
    predictions = (Row("predictions", [plain(x.to_data()) for x in validated]),) * bool(validated)
    origin = Origin(sources=sources)
    assumed = None
    if options.assumed is not None:
        assumed = read_servo(options.assumed, len(fit.joints))
    further = [x.to_data(arm) for x in printed]
    return _outcome(fit, folder, {}, further, origin, predictions, assumed)


def _identify_robot(
    options: Identify, fitting: ServoFit, folder: ResultFolder | None, progress: ProgressDisplay
) -> Outcome:
    """Identify the servos of a robot from motions that it executes."""
    # The adapters of controllers take as long to load as an identification takes.
    from armcontour.cli import play_command as playing
    from armcontour.controllers import robot_identification
    from armcontour.controllers.player import Player

    count = len(options.logs)
    raise_if(count != 1, f"--on requires exactly one job, but {count} files are given.")
    options_of_logs = ("arm", "validate", "assumed", "columns", "topic", "start", "end")
    refuse_given(options, options_of_logs, "applies only to logs. Remove it, or remove --on.")
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
    fitting = replace(fitting, kinematics=job.arm)
    stop = threading.Event()
    result = robot_identification.play_identification(
        motions, Player(controller, progress=progress), fitting
    )
    if options.execute:
        player = Player(controller, True, stop.is_set, progress)
        with playing.confirmed(result.played["run"], stop, progress):
            result = robot_identification.play_identification(motions, player, fitting)
    if result.fit is None or result.prediction is None:
        data = result.to_data()
        code = playing.STOPPED if result.stopped else playing.DONE
        end = "Stopped: nothing was identified." if result.stopped else playing.DRY
        logs = _write_lost(result, folder)
        return Outcome(
            lines=[*data_lines(data), *logs, end], page=plain(data), code=code, error=result.lost
        )
    further = [result.prediction.to_data(job.arm)]
    return _outcome(result.fit, folder, result.logs, further, Origin.of(job))


def _write_lost(result: RobotIdentification, folder: ResultFolder | None) -> list[str]:
    """Write the logs of all motions until a controller was lost, and return a line for each."""
    if folder is None or result.lost is None:
        return []
    lines = []
    for name, played in result.played.items():
        if played.record is not None:
            folder.write(f"{name}.csv", log_text(played.log))
            lines.append(f"Log: {folder.folder / name}.csv")
    return lines


def _read(log: FilePath, options: Identify, arm: Arm | None) -> Log:
    """Read a log with its joints in the order of an arm, and print its notes."""
    start, end = read_window(options.start, options.end)
    content = read_log(log, start=start, end=end, columns=options.columns, topic=options.topic)
    if arm is not None:
        content = arrange_joints(content, arm.joint_names)
    print_lines(*(f"Note: {x}" for x in content.notes), err=True)
    return content


def _outcome(
    fit: Identification,
    folder: ResultFolder | None,
    logs: Mapping[str, Log],
    further: Sequence[Data],
    origin: Origin,
    rows: tuple[Row, ...] = (),
    assumed: ServoModel | None = None,
) -> Outcome:
    """Write the servo, the logs and the report.

    `further`: further results to print; `origin`: that of the report; `rows`: further rows of the
    JSON output; `assumed`: servo of the joints that no log moves.
    """
    data = fit.to_data()
    servo = []
    if folder is not None:
        if any(y.written for y in fit.joints):
            folder.write("servo.yaml", servo_yaml(fit, assumed))
            servo = [f"Servo: {folder.folder / 'servo.yaml'}. Copy its key servo to a job file."]
            if fit.resting:
                servo.append(_describe_resting(fit, assumed))
        for name, log in logs.items():
            folder.write(f"{name}.csv", log_text(log))
        folder.write(REPORT, render_identification(fit, origin))
    lines = data_lines(data)
    for x in further:
        lines += data_lines(x)
    trusted = fit.trusted if assumed is None else fit.moving_trusted
    code = PROVISIONAL if fit.judgement.programs == 1 else DONE
    return Outcome(
        lines=[*lines, *servo],
        page=plain(replace(data, rows=(*data.rows, *rows))),
        code=code if trusted else DOUBTFUL,
    )


def _describe_resting(fit: Identification, assumed: ServoModel | None) -> str:
    """Write what the servo file has for the joints that no log moves."""
    names = ", ".join(fit.resting)
    if assumed is None:
        return f"No log moves {names}. To write assumed gains for them, add --assumed job.yaml."
    return f"No log moves {names}; the file has the assumed gains for them."
