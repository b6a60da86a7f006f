"""HTML reports of results; no other package creates figures."""

from armcontour.report.report import render_demo as render_demo
from armcontour.report.report import render_learning as render_learning
from armcontour.report.report import render_placement as render_placement
from armcontour.report.report import render_report as render_report
from armcontour.report.report import write_report as write_report
