"""Figures of reports as plain data for uPlot, and the page that contains them."""

from __future__ import annotations

import base64
import gzip
import json
import pkgutil
import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from html import escape
from pathlib import Path as FilePath
from typing import Any, NamedTuple

import numpy as np

from armcontour._version import __version__
from armcontour.core import file_access
from armcontour.core.checks import FloatArray
from armcontour.core.render import VERDICTS, number
from armcontour.report.message_frame import MessageFrame

# Significant digits of drawn values, which are finer than a pixel, and of their abscissae.
DIGITS, X_DIGITS = 5, 7
# Minimum width of one of several columns of plots, and height of a plot [px].
LEAST_WIDTH, HEIGHT = 260, 150
# Values whose digits say nothing to a reader, see `render.FINE`.
TINY = re.compile(r"(?<![\d.])-?0\.000\d{3}(?= [\w%])")
# Text that the page shows if a figure is wider than the page.
HINT = (
    '<p class="hint" aria-hidden="true">The figure continues to the right. Scroll it, or use the '
    "arrow keys.</p>"
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture:
    """A figure or a drawing of a report, which can also be a page of its own."""

    title: str
    # True for half of the width of a wide page
    half: bool = False
    # Data of the picture that are no figures
    frames: tuple[MessageFrame, ...] = ()

    def to_html(self, key: str) -> str:
        """Render the picture for a page with the data of its figures; `key`: id of its element."""
        raise NotImplementedError

    def write_html(self, file: str | FilePath) -> None:
        """Write the picture as one self-contained page, atomically."""
        page = self._page()
        file_access.write_atomically(FilePath(file), lambda x: x.write_text(page, encoding="utf-8"))

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self._page())}" width="100%" height="560"></iframe>'

    def _page(self) -> str:
        from armcontour.report.section import Chapter, Front

        chapter = Chapter(front=Front(parts=(self,)))
        return render_page(title=self.title, about="", source="", chapters=[chapter])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A curve of a plot in the units of its axes; NaN is a gap."""

    x: FloatArray
    y: FloatArray
    name: str
    colour: str
    # Width of the line [px], and lengths of its dashes and gaps [px]
    width: float = 2.0
    dash: tuple[float, ...] = ()
    # True to mark the points
    marked: bool = False


class Bar(NamedTuple):
    """An interval of time [s] in a row of a plot."""

    start: float
    end: float
    row: int
    # Kind, which is its entry in the legend, and text under the pointer
    kind: str
    name: str
    colour: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """A plot with curves, or with bars in rows."""

    # Label of the vertical axis, and of the horizontal one, with their units
    label: str
    x_label: str = "time [s]"
    curves: tuple[Curve, ...] = ()
    bars: tuple[Bar, ...] = ()
    # Names of the rows of bars
    rows: tuple[str, ...] = ()
    # Range of the vertical axis; None for that of the values
    limits: tuple[float, float] | None = None
    # Values at which horizontal lines are drawn
    lines: tuple[float, ...] = ()
    # Factor to a second unit that is shown under the pointer, and the unit
    also: tuple[float, str] | None = None
    logarithmic: bool = False
    # True if the horizontal values are integers, such as run numbers
    counts: bool = False
    # Height [px]
    height: int = HEIGHT


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure(Picture):
    """Plots in rows and columns, which share the pointer, the zoom and the legend."""

    plots: tuple[Plot, ...]
    # Titles of the columns
    columns: tuple[str, ...] = ("",)

    def to_html(self, key: str) -> str:
        """Render title and place of the figure; the page has its data by its key."""
        count = len(self.columns)
        least = LEAST_WIDTH * count if count > 1 else 0
        titles = "".join(f"<b>{escape(x)}</b>" for x in self.columns if x)
        return (
            f'<figure class="plotted{" half" * self.half}">'
            f'<figcaption id="{key}-title">{escape(self.title)}</figcaption>'
            f'<div class="scroll" role="group" aria-labelledby="{key}-title">'
            f'<div id="{key}" class="plots" '
            f'style="--columns:{count};min-width:{least}px">{titles}</div></div>'
            f'{HINT}<ul class="keys"></ul><noscript><p class="trouble">This figure needs '
            "JavaScript.</p></noscript></figure>"
        )


def render_page(**values: Any) -> str:
    """Render the template with values to a self-contained HTML page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    pictures: dict[str, Picture] = {}

    def place(picture: Picture, key: str) -> Markup:
        pictures[f"figure-{key}"] = picture
        return Markup(picture.to_html(f"figure-{key}"))

    environment = Environment(
        loader=PackageLoader("armcontour.report"), autoescape=True, undefined=StrictUndefined
    )
    environment.filters["number"] = number
    environment.globals["figure"] = place
    # The data are packed after the template has placed the figures.
    environment.globals["packed"] = lambda: _packed(pictures)
    page = environment.get_template("report.html").render(
        version=__version__,
        verdicts=VERDICTS,
        uplot_css=Markup(_static("vendor/uplot.css").decode()),
        **values,
    )
    return TINY.sub("&lt; 0.001", page)


def _packed(pictures: Mapping[str, Picture]) -> dict[str, str]:
    """Packed data of pictures and the code that draws them, by name."""
    figures = {key: x for key, x in pictures.items() if isinstance(x, Figure)}
    frames = {
        f"{key}-{frame.kind}": pack(frame.pack())
        for key, x in pictures.items()
        for frame in x.frames
    }
    found = {"figures": pack(to_json(figures).encode())} if figures else {}
    code = UPLOT * bool(figures) + VIEWER * bool(frames)
    return {**found, **frames, **{FilePath(x).stem: _code(x) for x in code}}


# Modules that draw figures, and those that draw arms.
UPLOT = ("vendor/uplot.js",)
VIEWER = ("vendor/three.js", "kinematics.js", "message_frame.js", "viewer.js")


@cache
def _code(name: str) -> str:
    return pack(_static(name))


def _static(name: str) -> bytes:
    """Content of a file of the folder `static`, whose part `vendor` is created by `make vendor`."""
    content = pkgutil.get_data("armcontour.report", f"static/{name}")
    assert content is not None
    return content


def pack(content: bytes) -> str:
    """Compress bytes to text that is valid in a script element."""
    return base64.b64encode(gzip.compress(content, mtime=0)).decode()


def to_json(figures: Mapping[str, Figure]) -> str:
    """Encode figures as JSON; each array of abscissae is contained once per plot."""
    plain = {
        key: {"columns": len(x.columns), "plots": [_plain_plot(y) for y in x.plots]}
        for key, x in figures.items()
    }
    return json.dumps(plain, separators=(",", ":"))


def _plain_plot(plot: Plot) -> dict[str, Any]:
    """Plot as plain data: curves refer to their arrays of abscissae by index."""
    arrays, curves = list[FloatArray](), []
    for curve in plot.curves:
        same = (k for k, x in enumerate(arrays) if np.array_equal(x, curve.x))
        index = next(same, len(arrays))
        if index == len(arrays):
            arrays.append(curve.x)
        look = {"name": curve.name, "colour": curve.colour, "width": curve.width}
        look |= {"dash": curve.dash, "marked": curve.marked}
        curves.append({**look, "x": index, "y": _rounded(curve.y, DIGITS)})
    names = {x.name for x in fields(plot)} - {"curves"}
    values = {x: getattr(plot, x) for x in sorted(names)}
    return {**values, "x": [_rounded(x, X_DIGITS) for x in arrays], "curves": curves}


def _rounded(values: FloatArray, digits: int) -> list[float | None]:
    """Values rounded to significant digits; None for NaN and infinity, which JSON lacks."""
    finite = np.isfinite(values).tolist()
    listed = np.asarray(values, dtype=np.float64).tolist()
    return [
        float(f"{x:.{digits}g}") if known else None for x, known in zip(listed, finite, strict=True)
    ]
