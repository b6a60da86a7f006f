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
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from armcontour._version import __version__
from armcontour.core import file_access
from armcontour.core.checks import FloatArray
from armcontour.core.guesses import Explained
from armcontour.core.render import VERDICTS, number
from armcontour.report.message_frame import MessageFrame
from armcontour.report.origin import Origin
from armcontour.report.style import MAX_POINTS, thin

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

    from armcontour.report.section import Chapter

# Significant digits of drawn values, so that their rounding is finer than a pixel.
DIGITS = 5
# Significant digits of drawn abscissae.
X_DIGITS = 7
# Height of a plot [px].
HEIGHT = 150
# Values whose digits say nothing to a reader, see `render.SIX_DECIMALS_BELOW`.
TINY = re.compile(r"(?<![\d.])-?0\.000\d{3}(?= [\w%])")
# Lengths and angles near TINY with more decimals than a page shows.
FINE = re.compile(r"(?<![\d.])-?0\.00\d{3,}(?= (?:mm|deg))")
# Decimals of these values on a page, so that they match a tiny value beside them.
DECIMALS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Picture(Explained):
    """A figure or a drawing of a report, which can also be a page of its own.

    Args:
        title: Title.
        half: True if it takes half the width of a wide page.
        frames: Data of the picture that are not figures.
    """

    # Template that renders the picture, with the id `key` of its element
    template: ClassVar[str]
    title: str
    half: bool = False
    frames: tuple[MessageFrame, ...] = ()

    def write_html(self, file: str | FilePath) -> None:
        """Write the picture as one self-contained page, atomically."""
        page = self._page()
        file_access.write_atomically(FilePath(file), lambda x: x.write_text(page, encoding="utf-8"))

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{escape(self._page())}" width="100%" height="560"></iframe>'

    def _page(self) -> str:
        from armcontour.report.section import Chapter, Front

        return render_page(self.title, Chapter(front=Front(parts=(self,))))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Curve:
    """A curve of a plot in the units of its axes; NaN is a gap.

    Args:
        x: Abscissae, (n,).
        y: Values, (n,).
        name: Entry in the legend; curves with one name share it.
        colour: Colour of the line.
        width: Width of the line [px].
        dash: Lengths of dashes and gaps [px]; empty for a solid line.
        marked: True to mark the points.
    """

    x: FloatArray
    y: FloatArray
    name: str
    colour: str
    width: float = 2.0
    dash: tuple[float, ...] = ()
    marked: bool = False


class Bar(NamedTuple):
    """An interval of time [s] in a row of a plot.

    Args:
        start: Start of the interval [s].
        end: End of the interval [s].
        row: Index of the row.
        kind: Entry in the legend.
        name: Text under the pointer.
        colour: Colour of the bar.
    """

    start: float
    end: float
    row: int
    kind: str
    name: str
    colour: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Plot:
    """A plot with curves, or with bars in rows.

    Args:
        label: Label of the vertical axis, with its unit.
        x_label: Label of the horizontal axis, with its unit.
        curves: The curves.
        bars: The bars.
        rows: Row names for bars.
        limits: Range of the vertical axis; None for that of the values.
        lines: Values at which horizontal lines are drawn.
        also: Factor to a second unit that is shown under the pointer, and the unit.
        logarithmic: True if the vertical axis is logarithmic.
        counts: True if the horizontal values are integers, such as run numbers.
        height: Height [px].
        max_points: Approximate maximum number of points per curve.
    """

    label: str
    x_label: str = "time [s]"
    curves: tuple[Curve, ...] = ()
    bars: tuple[Bar, ...] = ()
    rows: tuple[str, ...] = ()
    limits: tuple[float, float] | None = None
    lines: tuple[float, ...] = ()
    also: tuple[float, str] | None = None
    logarithmic: bool = False
    counts: bool = False
    height: int = HEIGHT
    max_points: int = MAX_POINTS


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure(Picture):
    """Plots in rows and columns, which share the pointer, the zoom and the legend.

    Args:
        plots: The plots, row by row.
        columns: Titles of the columns.
    """

    template: ClassVar[str] = "figure.html"
    plots: tuple[Plot, ...]
    columns: tuple[str, ...] = ("",)


NO_ORIGIN = Origin()


def render_page(
    title: str,
    *chapters: Chapter,
    about: str = "",
    source: str = "",
    origin: Origin = NO_ORIGIN,
) -> str:
    """Render a self-contained HTML page.

    Args:
        title: Title of the page.
        *chapters: The chapters.
        about: Line below the title.
        source: Line at the end.
        origin: What the page was computed from.
    """
    pictures: dict[str, Picture] = {}

    def place(picture: Picture, key: str) -> Markup:
        pictures[f"figure-{key}"] = picture
        return render(picture.template, picture=picture, key=f"figure-{key}")

    return render(
        "report.html",
        version=__version__,
        verdicts=VERDICTS,
        words={x["word"]: name.replace(" ", "-") for name, x in VERDICTS.items()},
        uplot_css=_static("vendor/uplot.css").decode(),
        figure=place,
        # The data are packed after the template has placed the figures.
        packed=lambda: _packed(pictures),
        title=title,
        chapters=chapters,
        about=about,
        source=source,
        origin=origin,
        date=origin.date,
    )


def render(template: str, **values: Any) -> Markup:
    """Render a template with values."""
    from markupsafe import Markup

    return Markup(_environment().get_template(template).render(**values))


@cache
def _environment() -> Environment:
    """Return the environment of jinja2 with the templates of reports."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("armcontour.report"),
        autoescape=True,
        finalize=_without_noise,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters["number"] = number
    return environment


def _without_noise(value: Any) -> Any:
    """Return a value to display; in texts, numbers with many decimals are shortened."""
    if type(value) is not str:
        return value
    without_tiny = TINY.sub("< 0.001", value)
    return FINE.sub(lambda x: f"{float(x[0]):.{DECIMALS}f}", without_tiny)


def _packed(pictures: Mapping[str, Picture]) -> dict[str, str]:
    """Pack the data of pictures and the code that draws them, by name."""
    figures = {key: x for key, x in pictures.items() if isinstance(x, Figure)}
    frames = {}
    for key, picture in pictures.items():
        for frame in picture.frames:
            frames[f"{key}-{frame.kind}"] = pack(frame.pack())
    found = {"figures": pack(to_json(figures).encode())} if figures else {}
    code = UPLOT * bool(figures) + VIEWER * bool(frames)
    return {**found, **frames, **{FilePath(x).stem: _code(x) for x in code}}


# Modules that draw figures.
UPLOT = ("vendor/uplot.js",)
# Modules that draw arms.
VIEWER = ("vendor/three.js", "framing.js", "kinematics.js", "message_frame.js", "viewer.js")


@cache
def _code(name: str) -> str:
    return pack(_static(name))


def _static(name: str) -> bytes:
    """Read a file in the folder `static`, whose part `vendor` `make vendor` creates."""
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
    arrays = list[FloatArray]()
    curves = []
    for curve in plot.curves:
        x, y = thin(curve.x, curve.y, plot.max_points)
        same = (k for k, array in enumerate(arrays) if np.array_equal(array, x))
        index = next(same, len(arrays))
        if index == len(arrays):
            arrays.append(x)
        look = {"name": curve.name, "colour": curve.colour, "width": curve.width}
        look |= {"dash": curve.dash, "marked": curve.marked}
        curves.append({**look, "x": index, "y": _rounded(y, DIGITS)})
    names = {x.name for x in fields(plot)} - {"curves", "max_points"}
    values = {x: getattr(plot, x) for x in sorted(names)}
    return {**values, "x": [_rounded(x, X_DIGITS) for x in arrays], "curves": curves}


def _rounded(values: FloatArray, digits: int) -> list[float | None]:
    """Round values to significant digits; NaN and infinity, which JSON lacks, become None."""
    finite = np.isfinite(values).tolist()
    listed = np.asarray(values, dtype=np.float64).tolist()
    return [
        float(f"{x:.{digits}g}") if known else None for x, known in zip(listed, finite, strict=True)
    ]
