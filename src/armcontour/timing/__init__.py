"""Timing of joint paths: the entry point `plan`, with one file per method."""

from armcontour.timing.explanation import (
    Binding,
    Explanation,
    Shortfall,
    explain,
    find_jerk_stops,
)
from armcontour.timing.fastest_configuration import trace_fastest
from armcontour.timing.methods import METHODS, PLANNING_METHODS, refuse_unkept_jerk
from armcontour.timing.planner import (
    RESERVED,
    assigned_time,
    intervals_of,
    plan,
    refuse_endless,
    trace_and_plan,
    with_reserve,
)
from armcontour.timing.program_tracing import Tracing, choose_start, trace_program, turn_along
from armcontour.timing.shaping import shape

__all__ = [
    "METHODS",
    "PLANNING_METHODS",
    "RESERVED",
    "Binding",
    "Explanation",
    "Shortfall",
    "Tracing",
    "assigned_time",
    "choose_start",
    "explain",
    "find_jerk_stops",
    "intervals_of",
    "plan",
    "refuse_endless",
    "refuse_unkept_jerk",
    "shape",
    "trace_and_plan",
    "trace_fastest",
    "trace_program",
    "turn_along",
    "with_reserve",
]
