"""Report of an identification as an HTML page: joints, motion and residuals."""

from __future__ import annotations

import numpy as np

from armcontour.control.identification import Identification
from armcontour.core.render import LINES, number
from armcontour.core.result import TABLE, Data
from armcontour.core.text import capitalise
from armcontour.report.figure import NO_ORIGIN, Curve, Figure, Plot, render_page
from armcontour.report.origin import Origin
from armcontour.report.section import Chapter, Front, Section, Tile, text_table, tiles

# Gap between successive logs in the figures [s].
APART = 1.0
# Height of each joint plot [px].
HEIGHT = 64
# Ends of the axis of residuals are these numbers times a power of ten, so that they are ticks.
ROUND = (1.0, 2.0, 5.0, 10.0)
# Smaller residuals are drawn as zero [rad or m].
SMALLEST_RESIDUAL = 1e-9
COMPUTED = "Everything on this page was computed from the logs."
SOURCE = "predicted from the other parts, where not fitted"
USE = (
    "Copy the key servo of servo.yaml to the job file. The job is then planned and compensated for "
    "these servos."
)


def render_identification(identification: Identification, origin: Origin = NO_ORIGIN) -> str:
    """Render the report of an identification as one self-contained HTML page.

    `origin`: what it was computed from, such as the files of the logs.
    """
    data = identification.to_data()
    chapter = Chapter(front=_front(identification, data), sections=_sections(identification, data))
    return render_page(data.title, chapter, source=COMPUTED, origin=origin)


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


def _largest_residual(identification: Identification, prismatic: bool) -> float:
    """Return the largest residual of all revolute or all prismatic joints [rad or m]."""
    largest = SMALLEST_RESIDUAL
    for joint in identification.joints:
        if joint.prismatic == prismatic:
            largest = max([largest, *(float(np.nanmax(np.abs(x))) for x in joint.rests)])
    return largest


def _round_up(value: float) -> float:
    """Return the next larger round number."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(next(x * power for x in ROUND if x * power >= value))


def _figure(identification: Identification) -> Figure:
    """Draw measured and predicted position, and residual, of each joint with a model.

    The residuals of all joints with the same unit have the same scale.
    """
    plots = list[Plot]()
    largest = {kind: _largest_residual(identification, kind) for kind in (False, True)}
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
        limit = _round_up(1e3 * largest[joint.prismatic])
        plots.append(
            Plot(label="", curves=tuple(curves[2:]), height=HEIGHT, limits=(-limit, limit))
        )
    columns = ("position [rad]", "residual [mrad]")
    return Figure(
        title="Positions and residuals of the joints", plots=tuple(plots), columns=columns
    )
