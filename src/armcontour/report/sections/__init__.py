"""The sections of the report: each turns a study into data that the template shows."""

from armcontour.report.sections.bindings import bindings
from armcontour.report.sections.motion import (
    accelerations,
    contour_error,
    time_stamps,
    tool_speed,
)
from armcontour.report.sections.overview import overview
from armcontour.report.sections.paths import joint_space, paths
from armcontour.report.sections.published import published

__all__ = [
    "accelerations",
    "bindings",
    "contour_error",
    "joint_space",
    "overview",
    "paths",
    "published",
    "time_stamps",
    "tool_speed",
]
