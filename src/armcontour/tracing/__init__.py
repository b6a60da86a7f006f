"""Tracing a tool path with an arm."""

from armcontour.tracing.ranges import refuse_out_of_range
from armcontour.tracing.tracer import trace, trace_all

__all__ = ["refuse_out_of_range", "trace", "trace_all"]
