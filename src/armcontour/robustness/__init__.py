"""Robustness: contour errors of taught data on robots that differ from the model."""

from armcontour.robustness.box import Box
from armcontour.robustness.monte_carlo import Spread, jitter_of, spread, worst_corner

__all__ = ["Box", "Spread", "jitter_of", "spread", "worst_corner"]
