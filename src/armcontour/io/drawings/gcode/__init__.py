"""G-code (RS274/NGC as the LinuxCNC manual has it), read into a `Program`."""

from armcontour.io.drawings.gcode.reader import read_gcode

__all__ = ["read_gcode"]
