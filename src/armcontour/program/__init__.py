"""Programs: contours in order, with rapids, dwells and events between them."""

from armcontour.program.moves import Contour, Dwell, Event, Move, Program, Rapid, contour_called
from armcontour.program.preparing import arrange, prepare
from armcontour.program.process import Analog, Lead, Leads, Process, Switch
from armcontour.program.rounding import round_corners

__all__ = [
    "Analog",
    "Contour",
    "Dwell",
    "Event",
    "Lead",
    "Leads",
    "Move",
    "Process",
    "Program",
    "Rapid",
    "Switch",
    "arrange",
    "contour_called",
    "prepare",
    "round_corners",
]
