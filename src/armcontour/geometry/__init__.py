"""Path geometry, without robot and time: lines and arcs, nearest points, rounded corners."""

from armcontour.frames import angle_between
from armcontour.geometry.corner_curves import corner_error
from armcontour.geometry.nearest import Projection
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.path import Path
from armcontour.geometry.primitives import Arc, Demand, Line
from armcontour.geometry.rounding import (
    Corners,
    RoundedPath,
    count_full_stops,
    round_corners,
    round_with_parabolas,
)
from armcontour.geometry.segments import Segments
from armcontour.geometry.shaped import Outcome, ShapedPath, SmoothCurve
from armcontour.geometry.shaped_orientation import orient_shaped
from armcontour.geometry.tube import Proof, Tube

__all__ = [
    "Arc",
    "Corners",
    "Demand",
    "Line",
    "Orientation",
    "Outcome",
    "Path",
    "Projection",
    "Proof",
    "RoundedPath",
    "Segments",
    "ShapedPath",
    "SmoothCurve",
    "Tube",
    "angle_between",
    "corner_error",
    "count_full_stops",
    "orient_shaped",
    "round_corners",
    "round_with_parabolas",
]
