"""Compensation of the servo's delay: one file per method, one entry point."""

from armcontour.compensation.compensator import METHODS, compensate, set_point_count

__all__ = ["METHODS", "compensate", "set_point_count"]
