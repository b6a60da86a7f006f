"""Clearance: distances of an arm from itself and its cell, proven between samples."""

from armcontour.verification.clearance.clearance import (
    Cell,
    Clearance,
    PairClearance,
    cell_of,
    check_clearance,
)

__all__ = ["Cell", "Clearance", "PairClearance", "cell_of", "check_clearance"]
