"""The section on a judged run: the contour error that a log shows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from armcontour.report.figure import Figure
from armcontour.report.section import Section, Table, Tile
from armcontour.report.style import EXECUTED_COLOUR, PLANNED_COLOUR, finish, line, thin

if TYPE_CHECKING:
    from armcontour.jobs.learning import JudgedStudy

# Smallest error on a logarithmic axis [mm].
SMALLEST_ERROR = 1e-6


def judged(study: JudgedStudy) -> Section:
    """Contour error over time, contour by contour, and errors of the joints.

    Args:
        study: The run.
    """
    run = study.judged.run
    profile = study.profile
    tiles = (
        Tile(
            label="contour error, largest",
            value=f"{profile.max * 1e3:.4g} mm",
            note=f"at t = {profile.t_max:.4g} s, s = {profile.s_max:.4g} m",
        ),
        Tile(label="contour error, RMS", value=f"{profile.rms * 1e3:.4g} mm", note="without noise"),
        Tile(
            label="off the plan at the same time, largest",
            value=f"{run.tool_max * 1e3:.4g} mm",
            note=f"RMS {run.tool_rms * 1e3:.4g} mm",
        ),
        Tile(
            label="begins in the log at",
            value=f"{-run.offset / run.rate:.4f} s",
            note=f"clock {(run.rate - 1) * 100:+.3f} %",
        ),
    )
    return Section(
        key="judged",
        title="The executed motion",
        text=(
            f"What {run.source} shows of the run {study.plan.run.name}: distances of the tool from "
            "the planned path. White noise of the measurement is taken out of the figures."
        ),
        tiles=((study.plan.run.name, tiles),),
        figures=(_over_time(study),),
        tables=(
            Table(header=CONTOURS, rows=tuple(tuple(x) for x in contour_rows(study))),
            Table(header=JOINTS, rows=tuple(tuple(x) for x in joint_rows(study))),
        ),
        notes=tuple(study.notes),
    )


CONTOURS = (
    *("contour", "RMS [mm]", "largest [mm]", "at t [s]", "at s [m]"),
    "path missed, largest [mm]",
)
JOINTS = ("joint", "RMS [mrad]", "largest [mrad]", "noise [mrad]")


def contour_rows(study: JudgedStudy) -> list[list[str]]:
    """Cells of a row for every contour."""
    return [
        [
            name,
            f"{error.rms * 1e3:.5f}",
            f"{error.max * 1e3:.5f}",
            f"{error.t_max:.3f}",
            f"{error.s_max:.4f}",
            f"{missed.max * 1e3:.5f}",
        ]
        for name, error, missed in study.contours
    ]


def joint_rows(study: JudgedStudy) -> list[list[str]]:
    """Cells of a row for every joint: its distance from the plan at the same time."""
    run = study.judged.run
    values = np.column_stack([run.joint_rms, run.joint_max, run.noise]) * 1e3
    names = study.job.arm.joint_names
    return [
        [name, *(f"{x:.4g}" for x in row)] for name, row in zip(names, values.tolist(), strict=True)
    ]


def _over_time(study: JudgedStudy) -> Any:
    """Figure of the contour error over time, as measured and without noise."""
    figure = Figure()
    for profile, name, colour, width in (
        (study.measured, "as measured", PLANNED_COLOUR, 1.0),
        (study.profile, "without noise", EXECUTED_COLOUR, 1.5),
    ):
        t, values, s = thin(profile.t, profile.values * 1e3, profile.s)
        curve = line(t, np.maximum(values, SMALLEST_ERROR), name, colour, width=width)
        curve.customdata = s.astype(np.float32)
        curve.hovertemplate = "%{y:.4f} mm at %{x:.3f} s, s = %{customdata:.4f} m<extra></extra>"
        figure.add_trace(curve)
    figure.update_xaxes(title="time [s]")
    figure.update_yaxes(title="contour error [mm]")
    return finish(figure, title="Contour error over time", height=460)
