"""Render the report of a study: its sections in order, as one HTML page without other files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath
from typing import TYPE_CHECKING

from armcontour import _checks, _staging
from armcontour.core.fields import checked
from armcontour.evaluation import Evaluation
from armcontour.jobs import Job, RunResult, Study
from armcontour.motion import Execution, Trajectory
from armcontour.report import sections
from armcontour.report.figure import render_page
from armcontour.report.results import study_of
from armcontour.report.section import Section
from armcontour.report.sections.batch import BatchView

if TYPE_CHECKING:
    from armcontour.certification import Certificate
    from armcontour.jobs.learning import LearningStudy
    from armcontour.placement import Placement

# Where the figures of a page come from.
OF_SIMULATION = "Everything on this page was computed from the job; the servo is simulated."
OF_PLAN = "Everything on this page was computed from the plan."
OF_LOGS = "Everything on this page was computed from the job and from logs of its robot."


def render_report(study: Study, *, certificate: Certificate | None = None) -> str:
    """Render the report of a study as one HTML page without other files.

    Args:
        study: The study.
        certificate: Certificate of the only run, for the first section.
    """
    source = OF_SIMULATION if study.simulated else OF_PLAN
    return _page(study.job, _sections(study, certificate), source=source)


def render_demo(studies: Sequence[Study]) -> str:
    """Render the most important sections of several studies as one HTML page without other files.

    Args:
        studies: The studies, each with a job name of its own.
    """
    shown = (
        sections.overview,
        sections.program,
        sections.paths,
        sections.space,
        sections.tool_speed,
        sections.contour_error,
        sections.clearance,
    )
    found = []
    for study in studies:
        job = study.job
        parts = [x for x in (section(study) for section in shown) if x is not None]
        parts[0] = replace(parts[0], title=job.title)
        found += [replace(x, key=f"{job.name}-{x.key}") for x in parts]
    about = "Two jobs, planned, compensated and executed on simulated servos with assumed gains."
    return _page(None, found, title="armcontour demo", about=about)


def _sections(study: Study, certificate: Certificate | None) -> list[Section]:
    """The sections that have content for a study."""
    found = [
        *([] if certificate is None else [sections.certificate(certificate)]),
        sections.overview(study),
        sections.program(study),
        sections.paths(study),
        sections.space(study),
        sections.shaping(study),
        sections.joint_space(study),
        sections.tool_speed(study),
        sections.bindings(study),
        sections.joints(study),
        sections.accelerations(study),
        sections.contour_error(study),
        sections.clearance(study),
        sections.time_stamps(study),
    ]
    return [x for x in found if x is not None]


def render_placement(placement: Placement) -> str:
    """Render the report of a placement as one HTML page without other files.

    Args:
        placement: The placement.
    """
    source = "Everything on this page was computed from the job."
    return _page(placement.job, [sections.placement(placement)], source=source)


def render_batch(view: BatchView) -> str:
    """Render the results of a batch as one HTML page without other files.

    Args:
        view: What is shown of it.
    """
    section = sections.batch(view)
    return _page(None, [section], title=view.name, about=view.about)


def render_learning(study: LearningStudy) -> str:
    """Render the report of learning as one HTML page without other files.

    Args:
        study: The runs, and what was learned from them.
    """
    return _page(study.job, [sections.learning(study)], source=OF_LOGS)


def _page(
    job: Job | None,
    found: Sequence[Section],
    *,
    title: str | None = None,
    about: str = "",
    source: str = OF_SIMULATION,
) -> str:
    """Render sections as one HTML page, of a job or with another title."""
    return render_page(
        "report.html",
        job=job,
        title=title if job is None else job.title,
        about=about,
        source="" if job is None else source,
        sections=found,
    )


@checked
def write_report(
    study: Study | RunResult | Evaluation | Execution | Trajectory, file: str | FilePath
) -> None:
    """Write the report of a result to an HTML file, completely or not at all.

        write_report(evaluate(executed, path), "report.html")
        write_report(planned, "plan.html")

    Args:
        study: A study, the result of a run, an evaluation, an execution or a trajectory; the report
            has the sections that the result fills.
        file: The HTML file; an existing file is replaced.

    Raises:
        InvalidInput: No such result, it does not know its arm, or the file cannot be written.
    """
    place = _checks.read_place("write_report", file)
    page = render_report(study_of(study))
    try:
        _staging.put_in_place(place, lambda x: x.write_text(page, encoding="utf-8"))
    except OSError as error:
        raise _staging.unwritable(f"the report {place}", error) from None
