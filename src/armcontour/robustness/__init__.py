"""Robustness: contour errors of taught data on robots that differ from the model.

Names are loaded at first use: every job has a box of uncertainty, and few need more.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from armcontour._lazy import load_lazily

if TYPE_CHECKING:
    from armcontour.robustness.box import Box
    from armcontour.robustness.monte_carlo import Spread, jitter_of, spread, worst_corner

_HOME = {
    "box": ("Box",),
    "monte_carlo": ("Spread", "jitter_of", "spread", "worst_corner"),
}
__getattr__ = load_lazily("armcontour.robustness", _HOME)

__all__ = ["Box", "Spread", "jitter_of", "spread", "worst_corner"]
