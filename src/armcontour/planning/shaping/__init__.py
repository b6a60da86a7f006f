"""Shaping: path and timing are optimized together, within a tolerance of an objective path."""

from armcontour.core.lazy import lazy_names

_HOME = {"shaper": "Shaped shape"}
__getattr__, __all__ = lazy_names(__name__, _HOME)
