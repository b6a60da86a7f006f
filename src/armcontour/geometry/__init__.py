"""Path geometry, without robot and time: lines and arcs, nearest points, rounded corners."""

from typing import TYPE_CHECKING

from armcontour._lazy import lazy_names

if TYPE_CHECKING:
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
else:
    __getattr__, __all__ = lazy_names(
        __name__,
        {
            "corner_curves": "corner_error",
            "nearest": "Projection",
            "orientation": "Orientation",
            "path": "Path",
            "primitives": "Arc Demand Line",
            "rounding": "Corners RoundedPath count_full_stops round_corners round_with_parabolas",
            "segments": "Segments",
            "shaped": "Outcome ShapedPath SmoothCurve",
            "shaped_orientation": "orient_shaped",
            "tube": "Proof Tube",
            "armcontour.frames": "angle_between",
        },
    )
