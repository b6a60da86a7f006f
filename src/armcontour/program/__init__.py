"""Programs: several contours in order, and what comes between them."""

from armcontour.program.moves import Contour, Dwell, Event, Move, Program, Rapid

__all__ = ["Contour", "Dwell", "Event", "Move", "Program", "Rapid"]
