"""Timing: one file per method, one entry point."""

from armcontour.timing.explanation import Binding, Explanation, Shortfall, explain
from armcontour.timing.fastest_configuration import trace_fastest
from armcontour.timing.planner import (
    METHODS,
    assigned_time,
    intervals_of,
    plan,
    refuse_endless,
    refuse_jerk,
    with_reserve,
)

__all__ = [
    "METHODS",
    "Binding",
    "Explanation",
    "Shortfall",
    "assigned_time",
    "explain",
    "intervals_of",
    "plan",
    "refuse_endless",
    "refuse_jerk",
    "trace_fastest",
    "with_reserve",
]
