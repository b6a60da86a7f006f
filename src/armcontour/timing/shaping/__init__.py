"""Shaping: the path and its timing found together, within a tolerance of an objective path."""

from armcontour.timing.shaping.shaper import shape

__all__ = ["shape"]
