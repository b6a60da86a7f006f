"""The commands `identify` and `learn` with `--on`: motions on a robot, logs and results."""

from __future__ import annotations

import dataclasses
import threading
from contextlib import suppress
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import print_json, print_lines, print_report, show_data
from armcontour.cli.inputs import open_job, read_option
from armcontour.cli.interrupts import on_interrupt
from armcontour.cli.options import JobOptions
from armcontour.cli.play_command import (
    DONE,
    DRY,
    STOPPED,
    confirm,
    controller_of,
    refuse_without_terminal,
)
from armcontour.cli.progress_bars import show_progress

if TYPE_CHECKING:
    from armcontour.cli.options import IdentifyOptions, LearnOptions
    from armcontour.controllers import RobotIdentification, RobotLearning
    from armcontour.controllers.player import Player
    from armcontour.files import ResultFolder
    from armcontour.jobs import Job
    from armcontour.jobs.run_learning import LearningStudy
    from armcontour.motion import Log

# Kind of a result folder with runs on a robot; later runs can continue such a folder.
KIND = "learn --on"
# File name of the log of a run, by number from 1.
LOG = "logs/run_{}.csv"


def identify_robot(
    file: FilePath, options: IdentifyOptions, fit_options: dict[str, Any]
) -> RobotIdentification:
    """Play the motions of an identification and identify servos; a dry run without --execute."""
    from armcontour.control.identification import ServoFit
    from armcontour.controllers.player import Player
    from armcontour.controllers.robot_identification import (
        play_identification,
        prepare_identification,
    )
    from armcontour.core.checks import raise_if
    from armcontour.core.quantities import Reserve

    raise_if(
        options.execute and options.out is None,
        "--execute requires --out, the folder for servo.yaml and the logs.",
    )
    refuse_without_terminal(options)
    assert options.on is not None
    reserve, stop = read_option("--reserve", options.reserve, Reserve), threading.Event()
    assert reserve is not None
    job_options = JobOptions(keys={}, sets=options.sets)
    with show_progress("identifying") as progress:
        job = open_job(file, job_options, progress)
        controller = controller_of(job, options.on, options)
        motions = prepare_identification(job, controller, options.run_name, reserve, progress)
        fit = ServoFit(model=options.model, kinematics=job.arm, **fit_options)
        result = play_identification(motions, Player(controller, progress=progress), fit)
    if not options.execute:
        return result
    confirm(result.played["run"])
    with show_progress("identifying") as progress, on_interrupt(stop.set):
        return play_identification(motions, Player(controller, True, stop.is_set, progress), fit)


def learn_robot(file: FilePath, job_options: JobOptions, options: LearnOptions) -> int:
    """Play runs and learn after each; write the folder after each run, and return the exit code."""
    from armcontour.controllers.player import Player
    from armcontour.controllers.robot_learning import learn_next, start_learning
    from armcontour.core.checks import raise_if
    from armcontour.core.quantities import AngularDistance, Reserve

    raise_if(
        options.execute and options.out is None,
        "--execute requires --out, the folder for logs, set-points and report.",
    )
    refuse_without_terminal(options)
    reserve = read_option("--reserve", options.reserve, Reserve)
    band = read_option("--band", options.band, AngularDistance)
    assert options.on is not None and reserve is not None
    stop = threading.Event()
    with show_progress("learning") as progress:
        job = open_job(file, job_options, progress)
        controller = controller_of(job, options.on, options)
        logs = _earlier_logs(options.out, job) if options.out and not options.force else []
        player = Player(controller, progress=progress)
        result = start_learning(job, player, options.run_name, reserve, logs)
        go_on = result.continues(options.runs)
        dry = learn_next(result, player).played if options.execute and go_on else None
    if dry is not None:
        confirm(dry)
    with show_progress("learning") as progress, on_interrupt(stop.set):
        player = Player(controller, options.execute, stop.is_set, progress)
        while result.continues(options.runs):
            result = _run_next(result, player, band, options)
    if options.as_json:
        print_json(result.to_data())
    else:
        _print_learning(result, file, options)
    return STOPPED if result.stopped else DONE


class _NothingLearned(Exception):
    """Raised inside a result folder's context to leave the folder unchanged."""


def _run_next(
    result: RobotLearning, player: Player, band: float | None, options: LearnOptions
) -> RobotLearning:
    """Play one run, learn from it, and write the folder."""
    from armcontour.controllers.robot_learning import learn_next
    from armcontour.files import ResultFolder

    if not options.execute or options.out is None:
        return learn_next(result, player, band)
    with suppress(_NothingLearned):
        # `ResultFolder` checks that the folder is writable before the robot moves.
        with ResultFolder(options.out, force=options.force, replaces=KIND) as folder:
            result = learn_next(result, player, band)
            if result.lesson is None:
                raise _NothingLearned
            _write(result, folder)
    return result


def _earlier_logs(out: FilePath, job: Job) -> list[Log]:
    """Logs of earlier runs in a folder, in order; empty if the folder has another kind."""
    from armcontour.files.log_file import read_log
    from armcontour.files.result_folder import kind_of, verify_file

    logs: list[Log] = []
    while kind_of(out) == KIND and (out / LOG.format(len(logs) + 1)).exists():
        log = read_log(verify_file(out, LOG.format(len(logs) + 1)))
        source = f"run {len(logs) + 1}"
        logs.append(dataclasses.replace(log, source=source, joint_names=job.arm.joint_names))
    return logs


def _write(result: RobotLearning, folder: ResultFolder) -> None:
    """Write logs, learned set-points, summary and report."""
    from armcontour.files.log_file import log_text

    for k, log in enumerate(result.logs, 1):
        folder.write(LOG.format(k), log_text(log))
    assert result.study is not None
    write_study(result.study, folder)


def write_study(study: LearningStudy, folder: ResultFolder) -> None:
    """Write the set-points of the next run, the report and the summary."""
    from armcontour.cli.run_command import write_motions
    from armcontour.files.result_folder import data_json
    from armcontour.files.set_point_file import LESSON, write_lesson
    from armcontour.report import render_learning

    name = study.plan.run.name
    write_motions(
        folder, study.job, {name: dataclasses.replace(study.plan, set_points=study.lesson)}
    )
    folder.place(f"{name}/{LESSON}", partial(write_lesson, lesson=study.lesson))
    folder.write("report.html", render_learning(study))
    folder.write("summary.json", data_json(study.to_data([*folder.files, "summary.json"])))


def _print_learning(result: RobotLearning, file: FilePath, options: LearnOptions) -> None:
    """Print the results of the runs, and the command that plays the best set-points."""
    if result.study is None:
        show_data(result.to_data())
        print_lines(DRY if not options.execute else "Stopped before anything was learned.")
        return
    show_data(result.study.result)
    if not options.execute:
        print_lines(DRY)
    elif result.ended:
        print_lines(f"Ended: {result.ended}.")
    if options.out is None:
        return
    run = result.plan.run
    robot = "".join(
        f" --{name} {value}"
        for name in ("address", "hal", "drives")
        if (value := getattr(options, name)) is not None
    )
    print_lines(f"Set-points of the best run: {options.out / run.name / 'set_points.csv'}")
    reserve = f"runs.{run.name}.timing.reserve='{run.timing.reserve * 100:g} %'"
    print_lines(
        f"Play them: armcontour play {file} --on {options.on}{robot} --speed-factor '100 %' "
        f"--run {run.name} --set {reserve} --set-points {options.out}"
    )
    print_report(options.out)
