"""Names, limits, colours and progress that all readers of drawings share."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

from armcontour.core.checks import LONGEST_NAME
from armcontour.core.file_access import SMALL
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.text import make_printable, show

# Largest file that is read [bytes]: the data structures made from it take many times its size.
LARGEST = SMALL
# Length of a name that is cut [characters]; a number is appended if two cut names are equal.
KEPT = LONGEST_NAME - 12
# How messages advise the user to choose "skip".
SKIP = "have it left out (unknown: skip, or --skip-unknown)"
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


Tell = Callable[[float], None]


def tell_share(progress: Progress | None, source: str) -> Tell:
    """A function that passes the share of a file that is read on to `progress`, by whole percents.

    Args:
        progress: Called with the steps; None ignores them.
        source: Name of the file.
    """
    if progress is None:
        return lambda share: None
    say, shown = subprogress(progress, source), -1

    def tell(share: float) -> None:
        nonlocal shown
        percent = int(100 * min(share, 1.0))
        if percent > shown:
            shown = percent
            say(Step((), percent / 100))

    return tell


@dataclass(slots=True)
class Labels:
    """Converts names of entities and layers to names that contours can have.

    A name that is too long is cut, and characters that are not printable become escapes: some CAD
    programs write such names, and the user cannot change them. Different names stay different.
    """

    _changed: dict[str, str] = field(default_factory=dict)
    _alike: Counter[str] = field(default_factory=Counter)

    def __call__(self, name: str) -> str:
        """The name of a contour or layer for a name in the drawing."""
        if len(name) <= LONGEST_NAME and name.isprintable():
            return name
        if name not in self._changed:
            self._changed[name] = self._fitted(name)
        return self._changed[name]

    def _fitted(self, name: str) -> str:
        """A printable, unique name of at most `LONGEST_NAME` characters."""
        plain = make_printable(name[: LONGEST_NAME + 1])
        short = len(name) <= LONGEST_NAME and len(plain) <= LONGEST_NAME
        first = plain if short else f"{plain[:KEPT]}..."
        self._alike[first] += 1
        count = self._alike[first]
        return first if count == 1 else f"{plain[:KEPT]}... ({count})"

    @property
    def notes(self) -> list[str]:
        """A sentence on the names that were changed; empty if none were."""
        if not self._changed:
            return []
        name, label = next(iter(self._changed.items()))
        return [
            f"Names that have more than {LONGEST_NAME} characters, or some that are not printable, "
            f"were changed ({len(self._changed)}), such as {show(name)} to '{label}'."
        ]


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
