"""YAML without its traps, as job files and what goes with them are read."""

from armcontour._yaml import load

__all__ = ["load"]
