"""Timing of joint paths: the entry point `plan`, with one file per method."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "stop_in_play": "stop",
    "explanation": "Binding Explanation Shortfall explain find_jerk_stops",
    "timing_options": "Conventional METHODS Optimal Paper PlanOptions Shaped",
    "planner": "check_duration intervals_of plan",
    "program_timing": "at_speed check_jerk_support",
    "program_tracing": "Tracing trace_program turn_along",
    "shaping": "shape",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
