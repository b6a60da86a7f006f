"""Memory of the machine."""

from __future__ import annotations

import os


def machine_memory() -> float | None:
    """Memory of the machine [bytes]; None where the system does not tell it."""
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, OSError, ValueError):
        return None
