"""Extensions of drawings and their readers, available without loading the readers."""

from __future__ import annotations

from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput

# Module and function of the reader for each extension.
READERS = {
    ".dxf": ("dxf", "read_dxf"),
    ".svg": ("svg", "read_svg"),
    **dict.fromkeys((".ngc", ".nc", ".gcode", ".tap", ".cnc"), ("gcode", "read_gcode")),
    ".csv": ("waypoint_table", "read_waypoints"),
}


def find_reader(file: str | FilePath) -> tuple[FilePath, str]:
    """The path and the extension of a file that has a reader."""
    if not isinstance(file, str | FilePath):
        raise InvalidInput(f"read_path needs the path of a file, not {type(file).__name__}.")
    location = FilePath(file)
    suffix = location.suffix.lower()
    if suffix == ".dwg":
        raise InvalidInput(f"{location.name} is a DWG file, which is not read: save it as DXF.")
    if suffix not in READERS:
        raise InvalidInput(
            f"{location.name} is no file that can be read as a path: its extension must be one of "
            f"{', '.join(READERS)}."
        )
    return location, suffix
