"""The command `learn`: learns the set-points of the next run from logs, or from runs on a robot."""

from __future__ import annotations

import shlex
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath

from armcontour.cli import play_command as playing
from armcontour.cli.command_execution import REPORT, Outcome, report_line, write_summary
from armcontour.cli.commands import Learn
from armcontour.cli.console import ProgressDisplay, data_lines, print_lines
from armcontour.cli.inputs import (
    NEEDS_ON,
    OF_CONTROLLER,
    open_job,
    read_option,
    read_window,
    refuse_given,
)
from armcontour.cli.run_command import write_motions
from armcontour.controllers.player import Player
from armcontour.controllers.robot_learning import RobotLearning, learn_next, start_learning
from armcontour.core.checks import raise_if
from armcontour.core.errors import InvalidInput
from armcontour.core.progress import Step
from armcontour.core.quantities import AngularDistance, Reserve
from armcontour.core.render import plain
from armcontour.files import ResultFolder
from armcontour.files.lesson_file import LESSON, write_lesson
from armcontour.files.log_file import log_text, read_log, read_run_log
from armcontour.files.result_folder import kind_of, verify_file
from armcontour.files.set_point_reader import read_set_points
from armcontour.jobs import Job
from armcontour.jobs.run_learning import LearnedRun, learn_logs, plan_run
from armcontour.motion import Log
from armcontour.report import render_learning

# Kind of a result folder with runs on a robot; later runs can continue such a folder.
KIND = "learn --on"
# Name of the file with a run's log, by the run's number from 1.
LOG = "logs/run_{}.csv"
# File name of the log of a run in which the controller was lost, by number from 1.
LOST_LOG = "logs/run_{}_lost.csv"


def learn(options: Learn, folder: ResultFolder | None, progress: ProgressDisplay) -> Outcome:
    """Learn the set-points of the next run from a log; with --on, from runs on the robot."""
    if options.on is not None:
        return _learn_robot(options, progress)
    refuse_given(options, OF_CONTROLLER, NEEDS_ON)
    if options.set_points is None or not options.log:
        raise InvalidInput(
            "learn requires the executed set-points and the log. Specify them with --set-points "
            "and --log."
        )
    if folder is None:
        raise InvalidInput(
            "learn requires --out, the folder to which the set-points of the next run are written."
        )
    window = read_window(options.start, options.end)
    job = open_job(options.job, options, progress)
    plan = plan_run(job, options.run_name, progress=progress)
    progress(Step(("reading the log",)))
    set_points = read_set_points(options.set_points, job, plan)
    names = job.arm.joint_names
    logs = []
    for file in options.log:
        log = read_run_log(file, names, window=window, columns=options.columns, topic=options.topic)
        print_lines(*(f"Note: {x}" for x in log.notes), err=True)
        logs.append(log)
    lesson = learn_logs(job, plan, [logs], set_points=set_points, progress=progress)
    learned_run = LearnedRun(job=job, plan=plan, lesson=lesson)
    name = plan.run.name
    _write_learned_run(learned_run, folder)
    lines = [
        f"{job.title}, run {name}: error of the tool",
        *data_lines(learned_run.result),
        *(f"Note: {x}" for x in job.arm.notes),
        f"Set-points of the next run: {folder.folder / name / 'set_points.csv'}",
    ]
    if not lesson.finished:
        lines.append(
            "Next: execute these set-points, then use learn with the new log and --set-points "
            f"{folder.folder}."
        )
    return Outcome(lines=lines, page=plain(learned_run.to_data()))


def _learn_robot(options: Learn, progress: ProgressDisplay) -> Outcome:
    """Play runs and learn after each; the folder is written after each run."""
    out = options.out
    raise_if(
        options.execute and out is None,
        "--execute requires --out, the folder for logs, set-points and report.",
    )
    playing.refuse_without_terminal(options)
    reserve = read_option("--reserve", options.reserve, Reserve)
    band = read_option("--band", options.band, AngularDistance)
    job = open_job(options.job, options, progress)
    logs = _earlier_logs(out, job) if out is not None and not options.force else []
    player = Player(playing.controller_of(job, options), progress=progress)
    result = start_learning(job, player, options.run_name, reserve, logs)
    if result.continues(options.runs):
        rehearsed = learn_next(result, player, band)
        stop = threading.Event()
        if out is None or not options.execute or rehearsed.played is None:
            result = rehearsed
        else:
            player = replace(player, execute=True, stop_requested=stop.is_set)
            with playing.confirmed(rehearsed.played, stop, progress):
                while result.continues(options.runs):
                    # `ResultFolder` checks that the folder is writable before the robot moves.
                    with ResultFolder(out, force=options.force, replaces=KIND) as folder:
                        result = learn_next(result, player, band)
                        _write_lost(result, folder)
                        if result.learned_run is not None:
                            _write_runs(result, result.learned_run, folder)
    code = playing.STOPPED if result.stopped else playing.DONE
    return Outcome(
        lines=_robot_lines(result, options),
        page=plain(result.to_data()),
        code=code,
        error=result.lost,
    )


def _earlier_logs(out: FilePath, job: Job) -> list[Log]:
    """Return the logs of earlier runs in a folder, in order; none if it has another kind."""
    logs: list[Log] = []
    while kind_of(out) == KIND and (out / LOG.format(len(logs) + 1)).exists():
        log = read_log(verify_file(out, LOG.format(len(logs) + 1)))
        source = f"run {len(logs) + 1}"
        logs.append(replace(log, source=source, joint_names=job.arm.joint_names))
    return logs


def _write_runs(result: RobotLearning, learned_run: LearnedRun, folder: ResultFolder) -> None:
    """Write logs, learned set-points, report and summary."""
    for k, log in enumerate(result.logs, 1):
        folder.write(LOG.format(k), log_text(log))
    _write_learned_run(learned_run, folder)
    write_summary(folder, plain(learned_run.to_data()))


def _write_lost(result: RobotLearning, folder: ResultFolder) -> None:
    """Write the log of the run in which the controller was lost, if there is one."""
    if result.lost_log is not None:
        folder.write(_lost_log_name(result), log_text(result.lost_log))


def _lost_log_name(result: RobotLearning) -> str:
    """Return the file name of the log of the run in which the controller was lost."""
    return LOST_LOG.format(len(result.logs) + 1)


def _write_learned_run(learned_run: LearnedRun, folder: ResultFolder) -> None:
    """Write the set-points of the next run and the report."""
    name = learned_run.plan.run.name
    write_motions(
        folder, learned_run.job, {name: replace(learned_run.plan, set_points=learned_run.lesson)}
    )
    folder.write_with(f"{name}/{LESSON}", partial(write_lesson, lesson=learned_run.lesson))
    folder.write(REPORT, render_learning(learned_run))


def _robot_lines(result: RobotLearning, options: Learn) -> list[str]:
    """Return the results of the runs, and the command that plays the best set-points."""
    lost = []
    if options.out is not None and result.lost_log is not None:
        lost = [f"Log: {options.out / _lost_log_name(result)}"]
    if result.learned_run is None:
        end = playing.DRY if not options.execute else "Stopped before anything was learned."
        return [*data_lines(result.to_data()), *lost, end]
    lines = [*data_lines(result.learned_run.result), *lost]
    if not options.execute:
        lines.append(playing.DRY)
    elif result.ended:
        lines.append(f"Ended: {result.ended}.")
    if options.out is None:
        return lines
    run = result.plan.run
    robot = ""
    for name in ("address", "hal", "drives", "thread_period"):
        value = getattr(options, name)
        if value is not None:
            robot += f" --{name.replace('_', '-')} {shlex.quote(str(value))}"
    reserve = f"runs.{run.name}.timing.reserve='{run.timing.reserve * 100:g} %'"
    return [
        *lines,
        f"Set-points of the best run: {options.out / run.name / 'set_points.csv'}",
        f"Play them: armcontour play {options.job} --on {options.on}{robot} --speed-factor '100 %' "
        f"--run {run.name} --set {reserve} --set-points {options.out}",
        report_line(options.out),
    ]
