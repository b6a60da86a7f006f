"""Compensation of the delay of servos: set-points with which the joints follow a trajectory."""

from armcontour.control.compensation.compensator import (
    METHODS,
    CompensationOptions,
    Inverse,
    InverseDynamics,
    NoCompensation,
    PolePlacement,
    compensate,
)
from armcontour.control.compensation.poles import fastest_poles

__all__ = [
    "METHODS",
    "CompensationOptions",
    "Inverse",
    "InverseDynamics",
    "NoCompensation",
    "PolePlacement",
    "compensate",
    "fastest_poles",
]
