"""Programs: contours in order, with rapids, dwells and events between them."""

from armcontour.core.lazy import lazy_names

_HOME = {
    "kerf": "cut_parts idle_parts",
    "moves": "Contour Dwell Event Move Program Rapid Wait contour_called",
    "preparation": "arrange_contours prepare set_limits",
    "process": "Analog ContourProcess LayerProcess Lead Leads Pierce Process Switch Tabs",
    "corner_rounding": "draw_with_arcs round_corners smooth_curvature",
    "armcontour.geometry.weave": "Weave",
}
__getattr__, __all__ = lazy_names(__name__, _HOME)
