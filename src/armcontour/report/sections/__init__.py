"""Sections of the report: each function makes data for the template from a study."""

from armcontour.report.sections.batch import batch
from armcontour.report.sections.bindings import bindings
from armcontour.report.sections.certificate import certificate
from armcontour.report.sections.clearance import clearance
from armcontour.report.sections.joints import joints
from armcontour.report.sections.learning import learning
from armcontour.report.sections.motion import (
    accelerations,
    contour_error,
    time_stamps,
    tool_speed,
)
from armcontour.report.sections.overview import overview
from armcontour.report.sections.paths import joint_space, paths
from armcontour.report.sections.placement import placement
from armcontour.report.sections.program import program
from armcontour.report.sections.shaping import shaping
from armcontour.report.sections.space import space

__all__ = [
    "accelerations",
    "batch",
    "bindings",
    "certificate",
    "clearance",
    "contour_error",
    "joint_space",
    "joints",
    "learning",
    "overview",
    "paths",
    "placement",
    "program",
    "shaping",
    "space",
    "time_stamps",
    "tool_speed",
]
