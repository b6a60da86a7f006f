"""Shaping: the path and its timing found together, within a tolerance of an objective path."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.timing.shaping.shaper import Shaping, shape
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "shaper": "Shaping shape",
        },
    )
