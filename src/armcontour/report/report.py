"""Reports of results as self-contained HTML pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.core import file_access
from armcontour.core.fields import checked
from armcontour.core.render import number
from armcontour.core.source_file import SourceFile
from armcontour.core.text import count_noun
from armcontour.jobs import Job, JobResult, RunResult
from armcontour.motion import Execution, Trajectory
from armcontour.report import sections
from armcontour.report.figure import render_page
from armcontour.report.origin import Origin
from armcontour.report.section import Chapter, Front, Section
from armcontour.report.single_results import job_result_of
from armcontour.verification import Evaluation

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearnedRun
    from armcontour.studies.certification import Certificate
    from armcontour.studies.placement import Placement

# Sentences about the data from which a page was computed.
OF_SIMULATION = "Everything on this page was computed from the job; the servo is simulated."
OF_PLAN = "Everything on this page was computed from the job and its plan."
OF_LOGS = "Everything on this page was computed from the job and from logs of its robot."


def render_report(
    job_result: JobResult,
    *,
    certificate: Certificate | None = None,
    set_points: SourceFile | None = None,
) -> str:
    """Render the report of a job, or of its certificate, as one self-contained HTML page.

    `set_points`: name and fingerprint of the file with the certified set-points.
    """
    source = OF_SIMULATION if job_result.simulated else OF_PLAN
    folded = sections_of(job_result, () if certificate is None else certificate.warnings)
    job = job_result.job
    if certificate is None:
        return _page(job, sections.front(job_result), folded, source=source)
    # Sections that other pages lack are imported only here, for a fast start.
    from armcontour.report.sections.certificate_section import certified, section_of

    front = certified(job_result, certificate, set_points)
    # The section on contours is omitted, because the certificate has its own table of contours.
    others = [x for x in folded if x.key != "contours"]
    sections_below = [section_of(certificate), *others]
    title = f"Certificate: {job.title}"
    return _page(job, front, sections_below, source=source, title=title)


def render_demo(job_results: Sequence[JobResult]) -> str:
    """Render the results of several jobs with different names as one self-contained HTML page."""
    chapters = []
    for job_result in job_results:
        folded = [replace(y, key=f"{job_result.job.name}-{y.key}") for y in sections_of(job_result)]
        title = f"{job_result.job.title}: {describe(job_result.job)}"
        chapters.append(Chapter(front=sections.front(job_result), sections=folded, title=title))
    about = "Two jobs, planned, compensated and executed on simulated servos with assumed gains."
    sources = chain.from_iterable(x.job.sources for x in job_results)
    origin = Origin(job=", ".join(x.job.name for x in job_results), sources=tuple(sources))
    return render_page(
        "armcontour demo", *chapters, about=about, source=OF_SIMULATION, origin=origin
    )


def sections_of(job_result: JobResult, warnings: Sequence[str] = ()) -> list[Section]:
    """Make the sections of a job result that have contents; `warnings` are a certificate's."""
    folded = [
        sections.notes(job_result, warnings),
        sections.all_figures(job_result),
        sections.contours(job_result),
        sections.over_time(job_result),
        sections.paths(job_result),
        sections.joints(job_result),
    ]
    return [x for x in folded if x is not None]


def render_placement(placement: Placement, plan: RunResult | None = None) -> str:
    """Render the report of a placement as one self-contained HTML page.

    `plan`: plan at the best place, which is drawn; None without one.
    """
    from armcontour.report.sections.placement_section import placed

    title = f"Places: {placement.job.title}"
    return _page(placement.job, placed(placement, plan), [], source=OF_PLAN, title=title)


def render_learning(learned_run: LearnedRun) -> str:
    """Render the report of learning as one self-contained HTML page."""
    from armcontour.report.sections.learning import learned, learning

    job = learned_run.job
    title = f"Learning: {job.title}"
    return _page(job, learned(learned_run), [learning(learned_run)], source=OF_LOGS, title=title)


def _page(
    job: Job, front: Front, folded: Sequence[Section], *, source: str, title: str = ""
) -> str:
    """Render the first screen and the sections of a job as one HTML page.

    `title`: title of the page; by default that of the job.
    """
    chapter = Chapter(front=front, sections=folded)
    origin = Origin.of(job)
    return render_page(
        title or job.title, chapter, about=describe(job), source=source, origin=origin
    )


def describe(job: Job) -> str:
    """Describe arm, path and servo of a job in one line."""
    count = len(job.program.contours)
    servo = job.servo
    parts = [
        job.arm.name,
        f"{count_noun(count, 'contour')}",
        f"{number(job.program.length, 'm')} as drawn",
    ]
    if servo.order != "unknown":
        parts.append(f"servo {servo.describe(job.arm.chain.prismatic)}")
    return " · ".join(parts)


@checked
def write_report(
    result: JobResult | RunResult | Evaluation | Execution | Trajectory, file: str | FilePath
) -> None:
    """Write the report of a result to an HTML file, atomically.

        write_report(evaluate(executed, path), "report.html")
        write_report(planned, "plan.html")

    >>> ac.write_report(ac.run(ac.read_job("job.yaml")), "report.html")

    Args:
        result: The result of a job or of a run, an evaluation, an execution or a trajectory; the
            report has the sections that apply to it.
        file: The HTML file; an existing file is replaced.

    Raises:
        InvalidInput: An unsupported result, a result without its arm, or an unwritable file.
    """
    place = FilePath(file)
    page = render_report(job_result_of(result))
    file_access.write_atomically(place, lambda x: x.write_text(page, encoding="utf-8"))
