"""The command line: thin commands over the library; heavy imports are inside functions."""

from armcontour.cli.entry import main

__all__ = ["main"]
