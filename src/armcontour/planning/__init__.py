"""Timing of joint paths: the entry point `plan`, with one file per method."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "explanation": "Binding Explanation Shortfall explain find_jerk_stops",
    "optimal_timing": "FASTEST Optimal intervals_of",
    "timing_options": "PlanOptions",
    "planner": "check_duration plan",
    "program_timing": "at_speed",
    "program_tracing": "Tracing trace_program turn_along",
    "shaping": "Shaped shape",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
