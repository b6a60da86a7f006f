"""Sections of the report: functions that create sections and first screens from results."""

from armcontour.report.sections.contours import contours as contours
from armcontour.report.sections.front import all_figures as all_figures
from armcontour.report.sections.front import front as front
from armcontour.report.sections.front import notes as notes
from armcontour.report.sections.joints import joints as joints
from armcontour.report.sections.motion import over_time as over_time
from armcontour.report.sections.path_section import paths as paths
