"""Tracing a tool path with an arm."""

from armcontour.tracing.tracer import trace

__all__ = ["trace"]
