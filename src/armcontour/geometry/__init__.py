"""Path geometry, without robot and time: lines and arcs, nearest points, rounded corners."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "rounding.line_corners": "corner_error",
    "projection": "Projection",
    "orientation": "Orientation",
    "path": "Path",
    "primitives": "Arc Line SegmentLimits",
    "rounding.rounded_path": "Corners RoundedPath count_full_stops round_path",
    "segments": "Segments",
    "shaped_path": "ShapingOutcome ShapedPath SmoothCurve",
    "shaped_orientation": "orient_shaped",
    "tube": "Proof Tube",
    "armcontour.core.frames": "angle_between",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
