"""Shaping: the path and its timing found together, within a tolerance of an objective path."""

from armcontour.timing.shaping.shaper import Shaping, shape, start_of
from armcontour.timing.shaping.wishes import Wishes

__all__ = ["Shaping", "Wishes", "shape", "start_of"]
