"""Tracing: the joint path along which an arm's tool follows a tool path."""

from armcontour.planning.tracing.ranges import refuse_out_of_range
from armcontour.planning.tracing.tracer import sketch_all, trace, trace_all

__all__ = ["refuse_out_of_range", "sketch_all", "trace", "trace_all"]
