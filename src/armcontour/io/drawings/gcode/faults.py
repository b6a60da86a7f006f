"""What is wrong with a line."""

from __future__ import annotations


class Fault(Exception):
    """What is wrong with a line, as the second half of a sentence that names the line."""
