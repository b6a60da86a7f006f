"""Programs: contours in order, with rapids, dwells and events between them."""

from armcontour.program.kerf import cut_parts
from armcontour.program.moves import Contour, Dwell, Event, Move, Program, Rapid, contour_called
from armcontour.program.preparing import arrange, prepare
from armcontour.program.process import (
    Analog,
    LayerProcess,
    Lead,
    Leads,
    Pierce,
    Process,
    Switch,
    Tabs,
    Weave,
)
from armcontour.program.rounding import draw_with_arcs, put_on_path, round_corners, smooth_curvature

__all__ = [
    "Analog",
    "Contour",
    "Dwell",
    "Event",
    "LayerProcess",
    "Lead",
    "Leads",
    "Move",
    "Pierce",
    "Process",
    "Program",
    "Rapid",
    "Switch",
    "Tabs",
    "Weave",
    "arrange",
    "contour_called",
    "cut_parts",
    "prepare",
    "put_on_path",
    "round_corners",
    "draw_with_arcs",
    "smooth_curvature",
]
