"""Report of an identification as an HTML page: joints, motion and residuals."""

from __future__ import annotations

import numpy as np

from armcontour.control.identification import Identification
from armcontour.core.render import LINES, number
from armcontour.core.result import TABLE, Data
from armcontour.core.text import capitalise
from armcontour.report.figure import Curve, Figure, Plot, render_page
from armcontour.report.section import Chapter, Front, Section, Tile, text_table, tiles

# Gap between successive logs in the figures [s].
APART = 1.0
# Height of each joint plot [px].
HEIGHT = 56
SOURCE = "predicted from the other parts, where not fitted"
USE = (
    "Copy the key servo of servo.yaml to the job file. The job is then planned and compensated for "
    "these servos."
)


def render_identification(identification: Identification) -> str:
    """Render the report of an identification as one self-contained HTML page."""
    data = identification.to_data()
    chapter = Chapter(front=_front(identification, data), sections=_sections(identification, data))
    return render_page(
        data.title, chapter, source="Everything on this page was computed from the logs."
    )


def _front(result: Identification, data: Data) -> Front:
    """Make the first screen: the verdict, the parameters, their use, and the weakest point."""
    trusted = data["judgement.trusted"]
    left = f"compensation leaves {number(result.judgement.ratio, '1')} of the contour error"
    words = [trusted.label if trusted.value else f"not {trusted.label}", trusted.note or left]
    determined = [x.determined for x in result.joints]
    known = f"{sum(determined)} of {len(determined)}"
    sentences = [("Weakest point", x) for x in [*data.warnings, *data.notes][:1]]
    if any(x.written for x in result.joints):
        sentences.insert(0, ("Use in a job", USE))
    shown = [x for x in data.tables if x.level <= TABLE]
    return Front(
        verdict=capitalise(": ".join(filter(None, words))) + ".",
        good=bool(trusted.value),
        doubtful=not trusted.value or result.judgement.programs < 2,
        tiles=(*tiles(data), Tile(label="joints with all parameters determined", value=known)),
        tables=tuple(text_table(x, "Identified servos, with 95 % intervals") for x in shown[1:]),
        sentences=tuple(sentences),
    )


def _sections(identification: Identification, data: Data) -> list[Section]:
    """Make the sections on motion and residuals, and on the joints' errors and notes."""
    joints = next(x for x in data.tables if x.level <= TABLE)
    of_joints = list[str]()
    for joint in identification.joints:
        of_joint = joint.to_data()
        of_joints += [f"{of_joint.title}: {x}" for x in of_joint.notes if x not in data.notes]
    motion = Section(
        key="motion",
        title="Motion and residuals",
        summary="measured and predicted position of each joint, and their difference",
        parts=(_figure(identification),),
        opened=True,
    )
    errors = Section(
        key="errors",
        title="Errors",
        summary="tracking and contour error left, as parts of those without compensation",
        parts=(text_table(joints, "Errors on motion that was not fitted"),),
        notes=(*data.notes, *of_joints),
    )
    return [motion, errors] if any(x.rests for x in identification.joints) else [errors]


def _figure(identification: Identification) -> Figure:
    """Draw measured and predicted position, and residual, of each joint with a model."""
    plots = list[Plot]()
    for j, joint in enumerate(identification.joints):
        if not joint.rests:
            continue
        start = 0.0
        parts = []
        for log, residual in zip(identification.logs, joint.rests, strict=True):
            t = log.t - log.t[0] + start
            parts.append(np.stack([t, log.measured[:, j], residual], axis=1))
            # The curves have a gap between the logs.
            parts.append(np.array([[t[-1] + APART / 2, np.nan, np.nan]]))
            start = t[-1] + APART
        t, measured, residuals = np.concatenate(parts).T
        curves = [
            Curve(x=t, y=y, name=name, colour=colour, width=1.2)
            for name, y, colour in (
                ("measured", measured, LINES["executed"]),
                (SOURCE, measured - residuals, LINES["planned"]),
                ("residual", residuals * 1e3, LINES["allowed"]),
            )
        ]
        label = f"joint {j + 1}{' [m, mm]' * joint.prismatic}"
        plots.append(Plot(label=label, curves=tuple(curves[:2]), height=HEIGHT))
        plots.append(Plot(label="", curves=tuple(curves[2:]), height=HEIGHT))
    columns = ("position [rad]", "residual [mrad]")
    return Figure(
        title="Positions and residuals of the joints", plots=tuple(plots), columns=columns
    )
