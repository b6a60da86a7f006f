"""Colours of drawings, under the names by which contours are chosen."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection

from armcontour.errors import InvalidInput

# Names of CSS that drawings for lasers and plotters use; another name stands for itself.
NAMED = {
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
    """A colour as `#rrggbb`, from a name, #rgb, #rrggbb or rgb(r, g, b); other text in lower case.

    Args:
        text: A colour of a drawing or of a user.
    """
    plain = text.strip().lower()
    if short := _SHORT.fullmatch(plain):
        return "#" + "".join(2 * x for x in short.groups())
    if parts := _RGB.fullmatch(plain):
        factor = 2.55 if parts[2] else 1.0
        return hex_of(*(min(round(float(parts[k]) * factor), 255) for k in (1, 3, 4)))
    return NAMED.get(plain, plain)


def hex_of(red: int, green: int, blue: int) -> str:
    """A colour as `#rrggbb`, from its parts from 0 to 255."""
    return f"#{red:02x}{green:02x}{blue:02x}"


def color_set(colors: Collection[str | int] | None) -> frozenset[str] | None:
    """The colours that a user chooses; None for all colours.

    Raises:
        InvalidInput: The colours are no list of names and numbers.
    """
    if colors is None:
        return None
    if isinstance(colors, str) or not isinstance(colors, Collection) or not colors:
        raise InvalidInput(
            'colors must be a list of colours, such as ["red", "#00ff00"]; for DXF also numbers of '
            "AutoCAD's colours, such as [1, 3]."
        )
    return frozenset(color_of(str(x)) for x in colors)


def count_names(counter: Counter[str]) -> str:
    """The numbers and names of a counter, such as `2 TEXT, 1 HATCH`."""
    return ", ".join(f"{n} {name}" for name, n in sorted(counter.items()))
