"""The report of a study: the only room that plots."""

from armcontour.report.report import render_report, write_report

__all__ = ["render_report", "write_report"]
