"""Colours in drawings and models as `#rrggbb`."""

from __future__ import annotations

import re

# CSS colour names that drawings for lasers and plotters use; other names are used as written.
CSS_COLORS = {
    "black": "#000000",
    "white": "#ffffff",
    "red": "#ff0000",
    "lime": "#00ff00",
    "green": "#008000",
    "blue": "#0000ff",
    "yellow": "#ffff00",
    "cyan": "#00ffff",
    "aqua": "#00ffff",
    "magenta": "#ff00ff",
    "fuchsia": "#ff00ff",
    "orange": "#ffa500",
    "purple": "#800080",
    "gray": "#808080",
    "grey": "#808080",
    "silver": "#c0c0c0",
    "navy": "#000080",
    "maroon": "#800000",
}
_SHORT = re.compile(r"#([0-9a-f])([0-9a-f])([0-9a-f])")
_RGB = re.compile(r"rgb\(\s*([\d.]+)(%?)[\s,]+([\d.]+)%?[\s,]+([\d.]+)%?\s*\)")


def color_of(text: str) -> str:
    """Convert a colour (name, #rgb, #rrggbb, rgb(r, g, b)) to `#rrggbb`; else to lower case."""
    plain = text.strip().lower()
    if short := _SHORT.fullmatch(plain):
        return "#" + "".join(2 * x for x in short.groups())
    if parts := _RGB.fullmatch(plain):
        factor = 2.55 if parts[2] else 1.0
        return hex_of(*(min(round(float(parts[k]) * factor), 255) for k in (1, 3, 4)))
    return CSS_COLORS.get(plain, plain)


def hex_of(red: int, green: int, blue: int) -> str:
    """Return the colour `#rrggbb` with components from 0 to 255."""
    return f"#{red:02x}{green:02x}{blue:02x}"
