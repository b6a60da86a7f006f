"""Which files are drawings, by their endings: known before anything is loaded that reads them."""

from __future__ import annotations

from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput

# Module and function of the reader for each extension.
READERS = {
    ".dxf": ("dxf", "read_dxf"),
    ".svg": ("svg", "read_svg"),
    **dict.fromkeys((".ngc", ".nc", ".gcode", ".tap", ".cnc"), ("gcode", "read_gcode")),
    ".csv": ("waypoints", "read_waypoints"),
}


def find_reader(file: str | FilePath) -> tuple[FilePath, str]:
    """The path and the extension of a file that has a reader.

    Args:
        file: The file.

    Raises:
        InvalidInput: The argument is not the path of a file, or no reader has the extension.
    """
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
