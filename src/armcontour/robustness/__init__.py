"""Robustness: contour errors of taught data on robots that differ from the model."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.robustness.box import Box
    from armcontour.robustness.monte_carlo import Spread, jitter_of, spread, worst_corner
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "box": "Box",
            "monte_carlo": "Spread jitter_of spread worst_corner",
        },
    )
