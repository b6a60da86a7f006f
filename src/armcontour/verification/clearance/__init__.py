"""Clearance: how far an arm stays from itself and from its cell, proven between samples."""

from armcontour.verification.clearance.clearance import (
    Cell,
    Clearance,
    PairClearance,
    cell_of,
    check_clearance,
)

__all__ = ["Cell", "Clearance", "PairClearance", "cell_of", "check_clearance"]
