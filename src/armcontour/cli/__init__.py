"""The command line: commands that call the library; slow imports are inside functions."""

from armcontour.cli.entry import main

__all__ = ["main"]
