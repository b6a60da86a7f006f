"""The nominal robot: drives with position and velocity loops that move an arm's bodies.

Compensation, learning, identification and certification use it. Plants, which judge their results,
do not.
"""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
    from armcontour.drives.drives import Drives
    from armcontour.drives.response import Response, regular_times, respond_along
    from armcontour.drives.simulation import Simulation, simulate
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "drives": "Drives",
            "response": "Response regular_times respond_along",
            "simulation": "Simulation simulate",
        },
    )
