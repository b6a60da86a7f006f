"""Compensation of the servo's delay: one file per method, one door to them."""

from armcontour.compensation.compensator import METHODS, compensate

__all__ = ["METHODS", "compensate"]
