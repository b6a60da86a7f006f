"""Sections of the report: each function makes data for the template from a study."""

from armcontour.report.sections.batch import batch, counted
from armcontour.report.sections.certificate import certificate, certified
from armcontour.report.sections.clearance import clearance
from armcontour.report.sections.contours import contours
from armcontour.report.sections.front import all_figures, front, notes
from armcontour.report.sections.joints import joints
from armcontour.report.sections.learning import learned, learning
from armcontour.report.sections.motion import over_time, time_stamps
from armcontour.report.sections.path import paths
from armcontour.report.sections.placement import placed, placement
from armcontour.report.sections.shaping import shaping

__all__ = [
    "all_figures",
    "batch",
    "certificate",
    "certified",
    "clearance",
    "contours",
    "counted",
    "front",
    "joints",
    "learned",
    "learning",
    "notes",
    "over_time",
    "paths",
    "placed",
    "placement",
    "shaping",
    "time_stamps",
]
