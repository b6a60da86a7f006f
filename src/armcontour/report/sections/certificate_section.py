"""Report of a certificate: parts of the error, derating and cost."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.render import figure
from armcontour.core.result import Table
from armcontour.core.text import capitalise
from armcontour.report.figure import Curve, Figure, Plot
from armcontour.report.moving_arm import draw_arm
from armcontour.report.plan_drawing import draw_plan
from armcontour.report.section import Front, Section, Tile, side_by_side, text_table, tiles
from armcontour.report.sections.contours import MAX_ROWS
from armcontour.report.style import RUN_COLOURS

if TYPE_CHECKING:
    from armcontour.core.source_file import SourceFile
    from armcontour.jobs import JobResult, RunResult
    from armcontour.report.plan_drawing import Drawing
    from armcontour.studies.certification import Certificate


# Name of the value of the smallest distance between two bodies.
CLEARANCE = "clearance.low"


def certified(
    job_result: JobResult, certificate: Certificate, set_points: SourceFile | None = None
) -> Front:
    """Make the first screen of a certificate's report.

    `set_points`: name and fingerprint of the file with the certified set-points.
    """
    data = certificate.to_data()
    model = capitalise(certificate.model)
    rows = {x.name: x for x in data.shown()}
    deviation = rows["off_drawing"]
    verdict = data["kept"]
    doubts = [x for x in data.warnings if x not in certificate.result.path.notes]
    sentences = [
        ("Valid for", f"{model}."),
        ("What the certificate costs", f"{figure(rows['cost'])}, {rows['cost'].note}."),
        ("Weakest point", (*doubts, *data.notes, "None known.")[0]),
    ]  # fmt: skip
    if set_points is not None:
        words = f"{set_points.name} with SHA-256 {set_points.fingerprint}…"
        sentences.append(("Certified set-points", words))
    sentences.append(("", data.not_proven))
    shown = next(iter(job_result.runs.values()))
    drawing = draw_plan(shown, job_result.job)
    words = "Certified" if verdict.value else "Not certified"
    return Front(
        verdict=f"{words}, {verdict.holds}: {figure(deviation)} {deviation.label}; {verdict.note}.",
        good=verdict.value,
        tiles=(*tiles(data, places=drawing.places), *_clearance_tile(shown, drawing)),
        drawing=drawing,
        arm=draw_arm(shown, job_result.job),
        sentences=tuple(sentences),
    )


def _clearance_tile(shown: RunResult, drawing: Drawing) -> tuple[Tile, ...]:
    """Return the tile with the smallest distance of the plan; none if it is unknown."""
    row = next((x for x in shown.to_data().shown() if x.name == CLEARANCE), None)
    if row is None:
        return ()
    place = drawing.places.get(CLEARANCE, "")
    return (Tile(label=row.label, value=figure(row), note=row.note, place=place),)


def section_of(result: Certificate) -> Section:
    """Make the section with a certificate's error budget, derating and cost."""
    data = result.to_data()
    has_contours = len(result.contours) > 1
    contours = sorted(result.contours, key=lambda x: x.budget.left)
    table = Table.from_results("contours", [x.to_data() for x in contours[:MAX_ROWS]])
    return Section(
        key="certificate",
        title="Certificate",
        summary="parts of the error, derating, and the plan without a certificate",
        text=OF_PROGRAMS if has_contours else "",
        parts=(
            _derating(result),
            *side_by_side(result.comparison, caption="Compared"),
            *side_by_side({result.result.run.name: data}, caption="Figures"),
            *([text_table(table, "Contours, the least left first")] if has_contours else []),
        ),
        notes=data.notes,
    )


# Minimum range of the usable-limits axis [%].
LEAST_RANGE = 1.0
OF_PROGRAMS = (
    "Every contour is certified where the process is on, in the execution of the whole program. "
    "Rapids are only planned within the joint limits."
)


def _derating(certificate: Certificate) -> Figure:
    """Draw the usable fraction of each joint acceleration limit along all contours."""
    starts = np.cumsum([0.0, *(x.path.length for x in certificate.contours)])
    deratings = [x.derating for x in certificate.contours]
    curves = []
    # The curves have a gap (NaN) after each contour.
    places = [
        np.append(start + (x.cells[:-1] + x.cells[1:]) / 2, start + x.cells[-1])
        for start, x in zip(starts[:-1], deratings, strict=True)
    ]
    s = np.concatenate(places)
    for j in range(certificate.job.arm.dof):
        shares = [np.append(x.share[:, j], np.nan) for x in deratings]
        y = np.concatenate(shares) * 100
        colour = RUN_COLOURS[j % len(RUN_COLOURS)]
        curves.append(Curve(x=s, y=y, name=f"joint {j + 1}", colour=colour, width=1.5))
    least = 100 * min(float(x.share.min()) for x in deratings)
    plot = Plot(
        label="usable [%]",
        x_label="arc length" + " of the contours" * (len(deratings) > 1) + " [m]",
        curves=tuple(curves),
        # The range has a minimum size, so that rounding errors do not fill the height.
        limits=(min(least, 100 - LEAST_RANGE) - 0.2, 100.2),
    )
    return Figure(title="Usable share of the acceleration limits", plots=(plot,), half=True)
