"""Reader for G-code (RS274/NGC as in the LinuxCNC manual); it returns a `Program`."""

from armcontour.files.drawings.gcode.reader import read_gcode

__all__ = ["read_gcode"]
