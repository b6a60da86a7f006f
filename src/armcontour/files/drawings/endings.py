"""Extensions of files and the names of their readers, without importing the readers."""

from __future__ import annotations

from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput

# Extensions of job files.
YAML = (".yaml", ".yml")
# Module and function of the reader for each extension.
READERS = {
    ".dxf": ("dxf", "read_dxf"),
    ".svg": ("svg", "read_svg"),
    **dict.fromkeys((".ngc", ".nc", ".gcode", ".tap", ".cnc"), ("gcode", "read_gcode")),
    ".csv": ("waypoint_table", "read_waypoints"),
}


def find_reader(file: str | FilePath) -> tuple[FilePath, str]:
    """The path and the lower-case extension of a file, which must have a reader."""
    if not isinstance(file, str | FilePath):
        raise InvalidInput(
            f"The argument file must be the path of a file, but is of type {type(file).__name__}."
        )
    location = FilePath(file)
    suffix = location.suffix.lower()
    if suffix == ".dwg":
        raise InvalidInput(
            f"{location.name} is a DWG file, which is not supported: save it as DXF."
        )
    if suffix not in READERS:
        raise InvalidInput(
            f"{location.name} cannot be read as a path: its extension must be one of "
            f"{', '.join(READERS)}."
        )
    return location, suffix
