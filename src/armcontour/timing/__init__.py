"""Timing of joint paths: the entry point `plan`, with one file per method."""

from armcontour.timing.common import RESERVED, with_reserve
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
    assigned_time,
    intervals_of,
    plan,
    refuse_endless,
    trace_and_plan,
)
from armcontour.timing.program_tracing import Tracing, trace_program, turn_along
from armcontour.timing.shaping import shape, start_of

__all__ = [
    "METHODS",
    "PLANNING_METHODS",
    "RESERVED",
    "Binding",
    "Explanation",
    "Shortfall",
    "Tracing",
    "assigned_time",
    "explain",
    "find_jerk_stops",
    "intervals_of",
    "plan",
    "refuse_endless",
    "refuse_unkept_jerk",
    "shape",
    "start_of",
    "trace_and_plan",
    "trace_fastest",
    "trace_program",
    "turn_along",
    "with_reserve",
]
