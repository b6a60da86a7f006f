"""Tracing: the joint path along which an arm's tool follows a tool path."""

from armcontour.planning.tracing.joint_ranges import check_joint_range
from armcontour.planning.tracing.tracer import (
    hold_still,
    sketch_all,
    trace,
    trace_all,
    trace_between,
    trace_rest,
    trace_to,
)

__all__ = [
    "check_joint_range",
    "hold_still",
    "sketch_all",
    "trace",
    "trace_all",
    "trace_between",
    "trace_rest",
    "trace_to",
]
