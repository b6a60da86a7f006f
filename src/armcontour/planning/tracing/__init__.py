"""Tracing: the joint path along which an arm's tool follows a tool path."""

from armcontour.planning.tracing.joint_ranges import check_joint_range
from armcontour.planning.tracing.tracer import (
    Candidate,
    is_redundant,
    sketch_all,
    trace,
    trace_all,
    trace_between,
    trace_candidates,
    trace_rest,
    trace_to,
)

__all__ = [
    "Candidate",
    "check_joint_range",
    "is_redundant",
    "sketch_all",
    "trace",
    "trace_all",
    "trace_between",
    "trace_candidates",
    "trace_rest",
    "trace_to",
]
