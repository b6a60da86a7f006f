"""The nominal robot: drives with position and velocity loops that move an arm's bodies.

Compensation, learning, identification and certification use it. Plants, which judge their results,
do not.
"""

from armcontour.drives.drives import Drives
from armcontour.drives.response import Response, regular_times, respond_along
from armcontour.drives.simulation import Simulation, simulate

__all__ = [
    "Drives",
    "Response",
    "Simulation",
    "regular_times",
    "respond_along",
    "simulate",
]
