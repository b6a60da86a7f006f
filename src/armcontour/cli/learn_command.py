"""The command `learn`: learns the set-points of the next run from the log of the last run."""

from __future__ import annotations

from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.cli.console import print_lines, show_data
from armcontour.cli.inputs import open_job, read_window
from armcontour.cli.progress_bars import show_progress
from armcontour.core.progress import Progress, Step, subprogress

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions, LearnOptions
    from armcontour.files import ResultFolder
    from armcontour.jobs.run_learning import LearningStudy


def learn_file(file: FilePath, job_options: JobOptions, options: LearnOptions) -> None:
    """Learn a run of a job from a log; print and write the result."""
    from armcontour.files import ResultFolder
    from armcontour.files.result_folder import data_json

    _refuse_missing(options)
    window = read_window(options.start, options.end)
    assert options.out is not None
    with ResultFolder(options.out, force=options.force) as folder:
        with show_progress("learning") as progress:
            study = _learn_from_log(file, job_options, options, window, progress)
        write_study(study, folder)
    if options.as_json:
        print(data_json(study.to_data()), end="")
    else:
        _print_study(study, options.out)


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

    job = open_job(file, job_options, subprogress(progress, "reading"))
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


def write_study(study: LearningStudy, folder: ResultFolder) -> None:
    """Write the set-points of the next run, the report and the summary."""
    import dataclasses

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
    print_lines(f"Report: {(out / 'report.html').resolve().as_uri()}")
