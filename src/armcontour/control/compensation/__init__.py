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

__all__ = [
    "METHODS",
    "CompensationOptions",
    "Inverse",
    "InverseDynamics",
    "NoCompensation",
    "PolePlacement",
    "compensate",
]
