"""Modes of a machine that hold until another word changes them."""

from __future__ import annotations

import dataclasses
import math

from armcontour.io.drawings.gcode import codes

MILLIMETRE, INCH = 1e-3, 0.0254


@dataclasses.dataclass(slots=True)
class Modes:
    """What is in force.

    Attributes:
        unit: Length of the program's unit [m].
        stated: Whether the file or the reading said the unit.
        plane: Code of the plane of arcs and cycles.
        absolute: Whether coordinates are absolute (G90).
        arc_absolute: Whether centres of arcs are absolute (G90.1).
        motion: Code of the motion in force, None after G80.
        tolerance: Largest corner error [m], NaN for none of its own.
        return_to_r: Whether cycles return to R (G99) and not to their first height (G98).
        inverse_time: Whether F is one over the minutes of a move (G93) and not per minute (G94).
        feed: F [m/s], under G93 [1/min]; None where none is in force.
        feed_given: Whether the file has given an F.
    """

    unit: float
    stated: bool
    plane: int = codes.XY
    absolute: bool = True
    arc_absolute: bool = False
    motion: int | None = None
    tolerance: float = math.nan
    return_to_r: bool = False
    inverse_time: bool = False
    feed: float | None = None
    feed_given: bool = False

    @property
    def inch(self) -> bool:
        """Whether tolerances of programs in inches hold."""
        return self.unit == INCH
