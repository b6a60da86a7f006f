"""Render the report of a study: its sections in order, as one HTML page without other files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour.core import checks, staging
from armcontour.core.fields import checked
from armcontour.core.render import number
from armcontour.core.text import count_noun
from armcontour.jobs import Job, JobResult, RunResult
from armcontour.motion import Execution, Trajectory
from armcontour.report import sections
from armcontour.report.figure import render_page
from armcontour.report.results import study_of
from armcontour.report.section import Chapter, Front, Section
from armcontour.report.sections.batch import BatchView
from armcontour.verification import Evaluation

if TYPE_CHECKING:
    from armcontour.jobs.run_learning import LearningStudy
    from armcontour.studies.certification import Certificate
    from armcontour.studies.placement import Placement

# Where the figures of a page come from.
OF_SIMULATION = "Everything on this page was computed from the job; the servo is simulated."
OF_PLAN = "Everything on this page was computed from the job and its plan."
OF_LOGS = "Everything on this page was computed from the job and from logs of its robot."


def render_report(study: JobResult, *, certificate: Certificate | None = None) -> str:
    """Render the report of a study as one HTML page without other files.

    Args:
        study: The study.
        certificate: Certificate of the only run, for the first section.
    """
    source = OF_SIMULATION if study.simulated else OF_PLAN
    found = sections_of(study, () if certificate is None else certificate.warnings)
    if certificate is None:
        return _page(study.job, sections.front(study), found, source=source)
    front = sections.certified(study, certificate)
    # Its contours are in the table of the certificate.
    others = [x for x in found if x.key != "contours"]
    return _page(study.job, front, [sections.certificate(certificate), *others], source=source)


def render_demo(studies: Sequence[JobResult]) -> str:
    """Render several studies as one HTML page without other files.

    Args:
        studies: The studies, each with a job name of its own.
    """
    chapters = []
    for x in studies:
        own = [replace(y, key=f"{x.job.name}-{y.key}") for y in sections_of(x)]
        title = f"{x.job.title}: {describe(x.job)}"
        chapters.append(Chapter(front=sections.front(x), sections=own, title=title))
    about = "Two jobs, planned, compensated and executed on simulated servos with assumed gains."
    return render_page(
        title="armcontour demo", about=about, chapters=chapters, source=OF_SIMULATION
    )


def sections_of(study: JobResult, warnings: Sequence[str] = ()) -> list[Section]:
    """The folded sections that have content for a study; of a certificate with its warnings."""
    found = [
        sections.notes(study, warnings),
        sections.all_figures(study),
        sections.contours(study),
        sections.over_time(study),
        sections.paths(study),
        sections.shaping(study),
        sections.joints(study),
        sections.clearance(study),
        sections.time_stamps(study),
    ]
    return [x for x in found if x is not None]


def render_placement(placement: Placement) -> str:
    """Render the report of a placement as one HTML page without other files.

    Args:
        placement: The placement.
    """
    front, section = sections.placed(placement), sections.placement(placement)
    return _page(placement.job, front, [section], source=OF_PLAN)


def render_batch(view: BatchView) -> str:
    """Render the results of a batch as one HTML page without other files.

    Args:
        view: What is shown of it.
    """
    section = sections.batch(view)
    chapter = Chapter(front=sections.counted(view), sections=[] if section is None else [section])
    return render_page(title=view.name, about=view.about, chapters=[chapter], source="")


def render_learning(study: LearningStudy) -> str:
    """Render the report of learning as one HTML page without other files.

    Args:
        study: The runs, and what was learned from them.
    """
    front, section = sections.learned(study), sections.learning(study)
    return _page(study.job, front, [section], source=OF_LOGS)


def _page(job: Job, front: Front, found: Sequence[Section], *, source: str) -> str:
    """Render the first screen of a job and its sections as one HTML page."""
    chapter = Chapter(front=front, sections=found)
    return render_page(title=job.title, about=describe(job), chapters=[chapter], source=source)


def describe(job: Job) -> str:
    """The arm, the path and the servo of a job in a line."""
    count, servo = len(job.program.contours), job.servo
    parts = [
        job.arm.name,
        f"{count_noun(count, 'contour')}",
        f"{number(job.program.length, 'm')} as drawn",
    ]
    if servo.order != "unknown":
        parts.append(f"servo {servo}")
    return " · ".join(parts)


@checked
def write_report(
    study: JobResult | RunResult | Evaluation | Execution | Trajectory, file: str | FilePath
) -> None:
    """Write the report of a result to an HTML file, completely or not at all.

        write_report(evaluate(executed, path), "report.html")
        write_report(planned, "plan.html")

    >>> ac.write_report(ac.run(ac.read_job("job.yaml")), "report.html")

    Args:
        study: A study, the result of a run, an evaluation, an execution or a trajectory; the report
            has the sections that the result fills.
        file: The HTML file; an existing file is replaced.

    Raises:
        InvalidInput: No such result, it does not know its arm, or the file cannot be written.
    """
    place = checks.read_place("write_report", file)
    page = render_report(study_of(study))
    try:
        staging.write_atomically(place, lambda x: x.write_text(page, encoding="utf-8"))
    except OSError as error:
        raise staging.unwritable(f"the report {place}", error) from None
