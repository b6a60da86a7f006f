"""Tracing a tool path with an arm."""

from armcontour.tracing.tracer import trace, traces

__all__ = ["trace", "traces"]
