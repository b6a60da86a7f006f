"""The report of a study: the only package that plots."""

from armcontour.report.report import (
    render_batch,
    render_demo,
    render_learning,
    render_placement,
    render_report,
    write_report,
)

__all__ = [
    "render_batch",
    "render_demo",
    "render_learning",
    "render_placement",
    "render_report",
    "write_report",
]
