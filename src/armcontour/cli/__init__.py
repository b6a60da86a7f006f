"""The command line: thin commands over the library, heavy imports only where they are needed."""

from armcontour.cli.entry import main

__all__ = ["main"]
