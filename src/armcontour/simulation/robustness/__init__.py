"""Robustness: contour errors of set-points on robots that differ from the nominal model."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "uncertainty": "Uncertainty",
    "monte_carlo": "MonteCarloResult jitter_of spread worst_corner",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
