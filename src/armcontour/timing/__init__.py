"""Timing: one file per method, one door to them."""

from armcontour.timing.choosing import trace_fastest
from armcontour.timing.explanation import Binding, Explanation, Shortfall, explain
from armcontour.timing.planner import METHODS, plan, refuse_jerk
from armcontour.tracing import refuse_out_of_range

__all__ = [
    "METHODS",
    "Binding",
    "Explanation",
    "Shortfall",
    "explain",
    "plan",
    "refuse_jerk",
    "refuse_out_of_range",
    "trace_fastest",
]
