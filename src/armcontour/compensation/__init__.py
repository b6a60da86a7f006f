"""Compensation of the servos' delay: taught data that makes joints follow a trajectory."""

from armcontour.compensation.compensator import (
    METHODS,
    compensate,
    compensate_quietly,
)
from armcontour.compensation.doubts import doubt_gains, doubt_interval

__all__ = [
    "METHODS",
    "compensate",
    "compensate_quietly",
    "doubt_gains",
    "doubt_interval",
]
