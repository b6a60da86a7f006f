"""Timing of joint paths: the entry point `plan`, with one file per method."""

from __future__ import annotations

from typing import TYPE_CHECKING

from armcontour._lazy import load_lazily
from armcontour.timing.common import RESERVED, with_reserve
from armcontour.timing.explanation import (
    Binding,
    Explanation,
    Shortfall,
    explain,
    find_jerk_stops,
)
from armcontour.timing.options import (
    METHODS,
    Conventional,
    Optimal,
    Paper,
    PlanOptions,
    Shaped,
)
from armcontour.timing.planner import intervals_of, plan, refuse_endless
from armcontour.timing.program_timing import refuse_unkept_jerk
from armcontour.timing.program_tracing import (
    Tracing,
    trace_fastest,
    trace_program,
    turn_along,
)

if TYPE_CHECKING:
    from armcontour.timing.shaping import shape

# Few programs have corners of the shape free.
__getattr__ = load_lazily("armcontour.timing", {"shaping": ("shape",)})

__all__ = [
    "METHODS",
    "RESERVED",
    "Binding",
    "Conventional",
    "Explanation",
    "Optimal",
    "Paper",
    "PlanOptions",
    "Shaped",
    "Shortfall",
    "Tracing",
    "explain",
    "find_jerk_stops",
    "intervals_of",
    "plan",
    "refuse_endless",
    "refuse_unkept_jerk",
    "shape",
    "trace_fastest",
    "trace_program",
    "turn_along",
    "with_reserve",
]
