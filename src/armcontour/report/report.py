"""Reports of results as self-contained HTML pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.core import file_access
from armcontour.core.fields import checked
from armcontour.core.render import number
from armcontour.core.text import count_noun
from armcontour.jobs import Job, JobResult, RunResult
from armcontour.motion import Execution, Trajectory
from armcontour.report import sections
from armcontour.report.figure import render_page
from armcontour.report.section import Chapter, Front, Section, TextTable
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


def render_report(job_result: JobResult, *, certificate: Certificate | None = None) -> str:
    """Render the report of a job, or of its certificate, as one self-contained HTML page."""
    source = OF_SIMULATION if job_result.simulated else OF_PLAN
    folded = sections_of(job_result, () if certificate is None else certificate.warnings)
    if certificate is None:
        return _page(job_result.job, sections.front(job_result), folded, source=source)
    # Sections that other pages lack are imported only here, for a fast start.
    from armcontour.report.sections.certificate_section import certified, section_of

    front = certified(job_result, certificate)
    # The section on contours is omitted, because the certificate has its own table of contours.
    others = [x for x in folded if x.key != "contours"]
    return _page(job_result.job, front, [section_of(certificate), *others], source=source)


def render_demo(job_results: Sequence[JobResult]) -> str:
    """Render the results of several jobs with different names as one self-contained HTML page."""
    chapters = []
    for job_result in job_results:
        folded = [replace(y, key=f"{job_result.job.name}-{y.key}") for y in sections_of(job_result)]
        title = f"{job_result.job.title}: {describe(job_result.job)}"
        chapters.append(Chapter(front=sections.front(job_result), sections=folded, title=title))
    about = "Two jobs, planned, compensated and executed on simulated servos with assumed gains."
    return render_page("armcontour demo", *chapters, about=about, source=OF_SIMULATION)


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


def render_placement(placement: Placement) -> str:
    """Render the report of a placement as one self-contained HTML page."""
    from armcontour.report.sections.placement_section import placed

    return _page(placement.job, placed(placement), [], source=OF_PLAN)


def render_table(
    title: str, about: str, header: Sequence[str], rows: Sequence[Sequence[str]]
) -> str:
    """Render a table of texts as one self-contained HTML page."""
    table = TextTable(header=tuple(header), rows=tuple(map(tuple, rows)))
    chapter = Chapter(front=Front(tables=(table,)))
    return render_page(title, chapter, about=about)


def render_learning(learned_run: LearnedRun) -> str:
    """Render the report of learning as one self-contained HTML page."""
    from armcontour.report.sections.learning import learned, learning

    return _page(learned_run.job, learned(learned_run), [learning(learned_run)], source=OF_LOGS)


def _page(job: Job, front: Front, folded: Sequence[Section], *, source: str) -> str:
    """Render the first screen and the sections of a job as one HTML page."""
    chapter = Chapter(front=front, sections=folded)
    return render_page(job.title, chapter, about=describe(job), source=source)


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
