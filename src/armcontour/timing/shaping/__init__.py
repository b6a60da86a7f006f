"""Shaping: the path and its timing found together, within a tolerance of an objective path.

Names are loaded at first use: few programs have corners of the shape free.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from armcontour._lazy import load_lazily

if TYPE_CHECKING:
    from armcontour.timing.shaping.shaper import Shaping, shape

_HOME = {"shaper": ("Shaping", "shape")}
__getattr__ = load_lazily("armcontour.timing.shaping", _HOME)

__all__ = ["Shaping", "shape"]
