"""Timing of joint paths: the entry point `plan`, with one file per method."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.timing.common import RESERVED, with_reserve
    from armcontour.timing.explanation import (
        Binding,
        Explanation,
        Shortfall,
        explain,
        find_jerk_stops,
    )
    from armcontour.timing.options import METHODS, Conventional, Optimal, Paper, PlanOptions, Shaped
    from armcontour.timing.planner import intervals_of, plan, refuse_endless
    from armcontour.timing.program_timing import refuse_unkept_jerk
    from armcontour.timing.program_tracing import Tracing, trace_fastest, trace_program, turn_along
    from armcontour.timing.shaping import shape
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "common": "RESERVED with_reserve",
            "explanation": "Binding Explanation Shortfall explain find_jerk_stops",
            "options": "METHODS Conventional Optimal Paper PlanOptions Shaped",
            "planner": "intervals_of plan refuse_endless",
            "program_timing": "refuse_unkept_jerk",
            "program_tracing": "Tracing trace_fastest trace_program turn_along",
            "shaping": "shape",
        },
    )
