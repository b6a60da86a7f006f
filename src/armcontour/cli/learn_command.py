"""The command `learn`: learns the set-points of the next run from the log of the last run."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import print_json, print_lines, print_report, show_data
from armcontour.cli.inputs import open_job, read_window
from armcontour.cli.options import JobOptions, JobOrDrawing, LearnOptions
from armcontour.cli.program import ROBOT, command
from armcontour.cli.progress_bars import show_progress
from armcontour.cli.robot_commands import learn_robot, write_study
from armcontour.core.progress import Progress, Step

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearningStudy


@command(ROBOT, "learn job.yaml --set-points result --log robot.csv --out next")
def learn(job: JobOrDrawing, options: LearnOptions, job_options: JobOptions) -> int:
    """Learn the set-points of the next run from logs; with --on, from runs on the robot."""
    if options.on is not None:
        return learn_robot(job, job_options, options)
    from armcontour.files import ResultFolder

    _refuse_missing(options)
    window = read_window(options.start, options.end)
    assert options.out is not None
    with ResultFolder(options.out, force=options.force) as folder:
        with show_progress("learning") as progress:
            study = _learn_from_log(job, job_options, options, window, progress)
        write_study(study, folder)
    if options.as_json:
        print_json(study.to_data())
    else:
        _print_study(study, options.out)
    return 0


def _refuse_missing(options: LearnOptions) -> None:
    """Raise InvalidInput if required options are missing."""
    from armcontour.cli.play_command import refuse_without_controller
    from armcontour.core.errors import InvalidInput

    refuse_without_controller(options)
    if options.set_points is None or options.log is None:
        raise InvalidInput(
            "learn requires the executed set-points and the log. Specify them with --set-points "
            "and --log."
        )
    if options.out is None:
        raise InvalidInput(
            "learn requires --out, the folder to which the set-points of the next run are written."
        )


def _learn_from_log(
    file: FilePath,
    job_options: JobOptions,
    options: LearnOptions,
    window: tuple[float, float],
    progress: Progress,
) -> LearningStudy:
    """Read the job, plan its run, and learn from the log."""
    from armcontour.files.log_file import read_run_log
    from armcontour.files.set_point_file import read_set_points
    from armcontour.jobs.run_learning import LearningStudy, learn_logs, plan_run

    job = open_job(file, job_options, progress)
    plan = plan_run(job, options.run_name, progress=progress)
    assert options.log is not None and options.set_points is not None
    progress(Step(("reading the log",)))
    set_points = read_set_points(options.set_points, job, plan)
    log = read_run_log(
        options.log,
        job.arm.joint_names,
        window=window,
        columns=options.columns,
    )
    print_lines(*(f"Note: {x}" for x in log.notes), err=True)
    lesson = learn_logs(job, plan, [log], set_points=set_points, progress=progress)
    return LearningStudy(job=job, plan=plan, lesson=lesson)


def _print_study(study: LearningStudy, out: FilePath) -> None:
    """Print the errors of the runs, the next step, and the written files."""
    name = study.plan.run.name
    print_lines(f"{study.job.title}, run {name}: error of the tool")
    show_data(study.result)
    print_lines(*(f"Note: {x}" for x in study.job.arm.notes))
    print_lines(f"Set-points of the next run: {out / name / 'set_points.csv'}")
    if not study.lesson.finished:
        print_lines(
            "Next: execute these set-points, then use learn with the new log and --set-points "
            f"{out}."
        )
    print_report(out)
