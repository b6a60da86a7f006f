"""The command `learn`: set-points for the next run, from the log of the last one."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, TypeVar

from armcontour.cli.console import Console, open_page, show_notes
from armcontour.cli.opening import open_job
from armcontour.cli.progress import search_progress
from armcontour.cli.quantities import read_window
from armcontour.core.progress import Progress, Step, subprogress

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions, LearnOptions
    from armcontour.control.learning import Recording
    from armcontour.core.checks import FloatArray
    from armcontour.files import ResultFolder
    from armcontour.jobs import Job, RunResult
    from armcontour.jobs.learning import JudgedStudy, LearningStudy
    from armcontour.motion import Log, SetPoints

Found = TypeVar("Found", "JudgedStudy", "LearningStudy")


def learn_file(file: FilePath, job_options: JobOptions, x: LearnOptions) -> None:
    """Learn a run of a job from a log, or judge it; print and write it.

    Args:
        file: A job file, or a drawing.
        job_options: Options that replace values of the job.
        x: Options of the command. The folder gets summary.json and, unless the log is only judged,
            the set-points of the next run and report.html.

    Raises:
        ArmContourError: An invalid job, or a log that is not of its set-points; then nothing is
            written.
    """
    _refuse_missing(x)
    window = read_window(x.start, x.end)
    if x.judge_only:
        judge = partial(_judge, file, job_options, x, window)
        _do(x, "judging", judge, _write_judged, _print_judged)
    else:
        learn = partial(_learn, file, job_options, x, window)
        _do(x, "learning", learn, _write, _print)


def _do(
    x: LearnOptions,
    what: str,
    work: Callable[[Progress], Found],
    write: Callable[[Found, ResultFolder], None],
    show: Callable[[Found, FilePath | None], None],
) -> None:
    """Do the work of the command, write what it found if there is a folder, and print it.

    Args:
        x: Options of the command.
        what: What is done, for the progress.
        work: Does it.
        write: Writes what was found.
        show: Prints what was found.
    """
    from armcontour.files import ResultFolder
    from armcontour.files.result_folder import data_json

    with nullcontext() if x.out is None else ResultFolder(x.out, force=x.force) as folder:
        with search_progress(what) as progress:
            found = work(progress)
        if folder is not None:
            write(found, folder)
    if x.as_json:
        print(data_json(found.to_data()), end="")
    else:
        show(found, x.out)
    if x.out is not None and x.open_report:
        open_page(x.out / "report.html")


def _refuse_missing(x: LearnOptions) -> None:
    """Refuse options without those that they need.

    Raises:
        InvalidInput: An option is missing.
    """
    from armcontour.core.errors import InvalidInput

    if x.out is None and (x.open_report or x.force):
        raise InvalidInput("--open and --force go with --out, the folder for the report.")
    if x.judge_only:
        if x.log is None:
            raise InvalidInput("--judge-only needs what the robot did, --log.")
        if x.open_report:
            raise InvalidInput("--judge-only writes no report that --open can show: leave it out.")
        return
    if x.set_points is None or x.log is None:
        raise InvalidInput(
            "learn needs what the robot executed and what it did, --set-points and --log."
        )
    if x.out is None:
        raise InvalidInput("learn needs --out, the folder for the set-points of the next run.")


def _learn(
    file: FilePath,
    job_options: JobOptions,
    x: LearnOptions,
    window: tuple[float, float],
    progress: Progress,
) -> LearningStudy:
    """Read the job, plan its run, and learn from the log of a robot."""
    from armcontour.jobs.learning import LearningStudy, learn_run, plan_run

    job = open_job(file, job_options, subprogress(progress, "reading"))
    plan = plan_run(job, x.run_name, progress=progress)
    set_points, log, tool = _read(job, plan, x, window, progress)
    progress(Step(("learning from the log",)))
    lesson = learn_run(job, plan, set_points, log, tool=tool)
    return LearningStudy(job=job, plan=plan, lesson=lesson)


def _judge(
    file: FilePath,
    job_options: JobOptions,
    x: LearnOptions,
    window: tuple[float, float],
    progress: Progress,
) -> JudgedStudy:
    """Read the job, plan its run, and judge the log of a robot."""
    from armcontour.jobs.learning import judge_log, plan_run

    job = open_job(file, job_options, subprogress(progress, "reading"))
    plan = plan_run(job, x.run_name, progress=progress)
    set_points, log, tool = _read(job, plan, x, window, progress)
    progress(Step(("judging the log",)))
    return judge_log(job, plan, set_points, log, tool=tool)


def _read(
    job: Job, plan: RunResult, x: LearnOptions, window: tuple[float, float], progress: Progress
) -> tuple[SetPoints, Log | Recording, tuple[FloatArray, FloatArray] | None]:
    """What the robot executed, its log, and positions of its tool if there are any."""
    from armcontour.files.log_file import read_run_log, read_tool_positions
    from armcontour.files.set_point_file import read_set_points

    assert x.log is not None
    progress(Step(("reading the log",)))
    set_points = (
        plan.set_points if x.set_points is None else read_set_points(x.set_points, job, plan)
    )
    log = read_run_log(
        x.log,
        job.arm.joint_names,
        window=window,
        unwrap=x.unwrap,
        columns=x.columns,
        topic=x.topic,
    )
    show_notes(log.notes)
    tool = None
    if x.tool_positions is not None:
        tool = read_tool_positions(x.tool_positions, job.program.dimension)
    return set_points, log, tool


def _write(found: LearningStudy, folder: ResultFolder) -> None:
    """Write what was learned."""
    import dataclasses

    from armcontour.cli.running import write_motions
    from armcontour.files.result_folder import data_json
    from armcontour.files.set_point_file import LESSON, write_lesson
    from armcontour.report import render_learning

    name = found.plan.run.name
    write_motions(
        folder, found.job, {name: dataclasses.replace(found.plan, set_points=found.lesson)}
    )
    folder.place(f"{name}/{LESSON}", partial(write_lesson, lesson=found.lesson))
    folder.write("report.html", render_learning(found))
    folder.write("summary.json", data_json(found.to_data([*folder.files, "summary.json"])))


def _print(found: LearningStudy, out: FilePath | None) -> None:
    """Print a table of the runs, whether to go on, and what was written."""
    console = Console()
    console.say(f"{found.job.title}, run {found.plan.run.name}: error of the tool")
    console.show(found.result)
    for note in found.job.arm.notes:
        console.say(f"Note: {note}")
    if out is None:
        return
    console.say(f"Set-points of the next run: {out / found.plan.run.name / 'set_points.csv'}")
    if not found.lesson.finished:
        console.say(f"Execute them, and give the log of that run with --set-points {out}.")
    console.say(f"Report: {(out / 'report.html').resolve().as_uri()}")


def _write_judged(study: JudgedStudy, folder: ResultFolder) -> None:
    """Write the summary of a judged run."""
    from armcontour.files.result_folder import data_json

    folder.write("summary.json", data_json(study.to_data([*folder.files, "summary.json"])))


def _print_judged(study: JudgedStudy, out: FilePath | None) -> None:
    """Print what the tool and the joints did by a log, and what was written."""
    console = Console()
    console.say(f"{study.job.title}, run {study.plan.run.name}: the robot by its log")
    console.show(study.result)
    for note in study.job.arm.notes:
        console.say(f"Note: {note}")
    if out is not None:
        console.say(f"Summary: {out / 'summary.json'}")
