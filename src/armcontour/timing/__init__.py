"""Timing: one file per method, one door to them."""

from armcontour.timing.planner import METHODS, plan

__all__ = ["METHODS", "plan"]
