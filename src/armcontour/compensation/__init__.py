"""Compensation of the servos' delay: taught data that makes joints follow a trajectory."""

from armcontour.compensation.compensator import METHODS, compensate

__all__ = ["METHODS", "compensate"]
