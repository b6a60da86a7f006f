"""Compensation of the servos' delay: taught data that makes joints follow a trajectory."""

from armcontour.compensation.compensator import METHODS, compensate, set_point_count

__all__ = ["METHODS", "compensate", "set_point_count"]
