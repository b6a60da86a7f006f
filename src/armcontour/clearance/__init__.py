"""Clearance: how far an arm stays from itself and from its cell, proven between samples."""

from armcontour.clearance.clearance import Cell, CellOnce, Clearance, PairClearance, check_clearance

__all__ = ["Cell", "CellOnce", "Clearance", "PairClearance", "check_clearance"]
