"""Figures for plotly.js as plain data, without the slow validation of plotly.py."""

from __future__ import annotations

import base64
import json
import pkgutil
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from typing import Any

import numpy as np

from armcontour._version import __version__
from armcontour.core.render import VERDICTS, number

# Array types that plotly.js reads from base64, by name of the numpy type.
TYPES = {"int8": "i1", "int16": "i2", "int32": "i4", "float32": "f4", "float64": "f8"}
# Characters that could end the script element of a page, and their escapes in JSON.
UNSAFE = {"<": "\\u003c", ">": "\\u003e", "/": "\\u002f"}
# Options of plotly.js. The tools for selection are removed, because they have no effect.
CONFIG = {"displaylogo": False, "modeBarButtonsToRemove": ["select2d", "lasso2d"]}
# Minimum width of a plot if a figure has several columns [px].
LEAST_WIDTH = 260
# Text that the page shows if a figure is wider than the page.
HINT = (
    '<p class="hint" aria-hidden="true">The figure continues to the right. Scroll it, or use the '
    "arrow keys.</p>"
)


class Node(dict[str, Any]):
    """A part of a figure: a dict whose keys are also attributes; a missing attribute is None."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__()
        self.merge(values)

    def __getattr__(self, name: str) -> Any:
        return self.get(name)

    def __setattr__(self, name: str, value: Any) -> None:
        self.merge({name: value})

    def merge(self, values: Mapping[str, Any]) -> None:
        """Set values; None is ignored, and mappings are merged with existing mappings."""
        for name, value in values.items():
            if value is None:
                continue
            if name == "title" and isinstance(value, str):
                value = {"text": value}
            if isinstance(value, Mapping):
                if name not in self:
                    self[name] = Node({})
                self[name].merge(value)
            elif isinstance(value, list | tuple):
                self[name] = [Node(x) if isinstance(x, Mapping) else x for x in value]
            else:
                self[name] = value


def make_trace(kind: str, **values: Any) -> Node:
    """Create a trace of plotly.js of a kind such as "scatter" or "bar"."""
    return Node({"type": kind, **values})


class Figure:
    """Traces and layout of a figure.

    `axes` has the names of the x and y axis of each plot, by row and column from 1; the default is
    one plot. `least`: minimum width [px]; a narrower page scrolls the figure.
    """

    def __init__(
        self,
        *data: Node,
        axes: Mapping[tuple[int, int], tuple[str, str]] | None = None,
        least: int = 0,
    ) -> None:
        self.data = list(data)
        # Width in sixths of the section.
        self.span = 6
        self._least = least
        self.layout = Node({"shapes": [], "annotations": []})
        self._axes = {(1, 1): ("xaxis", "yaxis")} if axes is None else axes

    def add_trace(self, added: Node, row: int | None = None, col: int | None = None) -> None:
        """Add a trace, by default to the first plot."""
        if row is not None and col is not None:
            x, y = self._axes[row, col]
            added.merge({"xaxis": _short(x), "yaxis": _short(y)})
        self.data.append(added)

    def add_hline(self, y: float, line: Mapping[str, Any], row: int = 1, col: int = 1) -> None:
        """Add a horizontal line across a plot."""
        x_name, y_name = map(_short, self._axes[row, col])
        place = {"x0": 0, "x1": 1, "xref": f"{x_name} domain", "y0": y, "y1": y, "yref": y_name}
        self.layout["shapes"].append(Node({"type": "line", "line": line, **place}))

    def update_layout(self, **values: Any) -> None:
        """Merge values into the layout."""
        self.layout.merge(values)

    def update_xaxes(self, row: int | None = None, col: int | None = None, **values: Any) -> None:
        """Merge values into the x axes of all plots, or of one row, column or plot."""
        self._update_axes(0, row, col, values)

    def update_yaxes(self, row: int | None = None, col: int | None = None, **values: Any) -> None:
        """Merge values into the y axes of all plots, or of one row, column or plot."""
        self._update_axes(1, row, col, values)

    def _update_axes(
        self, index: int, row: int | None, col: int | None, values: Mapping[str, Any]
    ) -> None:
        for place, names in self._axes.items():
            if row in (None, place[0]) and col in (None, place[1]):
                self.layout.merge({names[index]: values})

    def to_html(self, key: str) -> str:
        """Render the figure and its title as HTML for `render_page`; `key` is the element's id."""
        layout = {name: x for name, x in self.layout.items() if name != "title" and x != []}
        title = self.layout.title.text
        saved = {**CONFIG, "toImageButtonOptions": {"filename": title}}
        arguments = ",".join(map(to_json, (key, self.data, layout, saved)))
        size = f"height:{layout['height']}px;min-width:{self._least}px"
        label = f'aria-labelledby="{key}-title"'
        return (
            f'<figure style="--span: {self.span}">'
            f'<figcaption class="plotly-title" id="{key}-title">{escape(title)}</figcaption>'
            f'<div class="scroll" role="group" {label}>'
            f'<div id="{key}" class="plotly-graph-div" style="{size}"></div></div>'
            f"{HINT}<script>draw({arguments});</script></figure>"
        )


def make_subplots(
    rows: int,
    cols: int,
    *,
    vertical_spacing: float,
    row_heights: Sequence[float] | None = None,
    column_titles: Sequence[str] = (),
) -> Figure:
    """Create a figure with a grid of plots; `vertical_spacing` is a share of the height."""
    start, end = _spans([1.0] * cols, 0.2 / cols)
    # Vertical positions of plotly.js count from the bottom, so the rows are reversed.
    heights = list(row_heights or [1.0] * rows)[::-1]
    bottom, top = (x[::-1] for x in _spans(heights, vertical_spacing))
    places = [(r, c) for r in range(rows) for c in range(cols)]
    names = ["" if k == 0 else f"{k + 1}" for k in range(len(places))]
    figure = Figure(
        axes={
            (r + 1, c + 1): (f"xaxis{name}", f"yaxis{name}")
            for (r, c), name in zip(places, names, strict=True)
        },
        least=LEAST_WIDTH * cols if cols > 1 else 0,
    )
    for (r, c), name in zip(places, names, strict=True):
        figure.update_layout(
            **{
                f"xaxis{name}": {"anchor": f"y{name}", "domain": [start[c], end[c]]},
                f"yaxis{name}": {"anchor": f"x{name}", "domain": [bottom[r], top[r]]},
            }
        )
        if r + 1 < rows:
            last = f"x{names[(rows - 1) * cols + c]}"
            figure.update_xaxes(r + 1, c + 1, matches=last, showticklabels=False)
    figure.layout["annotations"] += [
        Node(_title(text, (start[c] + end[c]) / 2, max(top)))
        for c, text in enumerate(column_titles)
    ]
    return figure


def _spans(sizes: Sequence[float], space: float) -> tuple[list[float], list[float]]:
    """Divide the interval from 0 to 1 in proportion to `sizes`, with a space between the parts.

    Returns the starts and the ends of the parts.
    """
    free = 1.0 - space * (len(sizes) - 1)
    lengths = [free * x / sum(sizes) for x in sizes]
    starts = [sum(lengths[:k]) + k * space for k in range(len(sizes))]
    return starts, [start + x for start, x in zip(starts, lengths, strict=True)]


def _title(text: str, x: float, y: float) -> dict[str, Any]:
    """Annotation of plotly.js with a title above a plot."""
    return {
        "text": text,
        "x": x,
        "xanchor": "center",
        "xref": "paper",
        "y": y,
        "yanchor": "bottom",
        "yref": "paper",
        "showarrow": False,
        "font": {"size": 16},
    }


def _short(axis: str) -> str:
    """Name of an axis in a trace, such as "x2" for "xaxis2"."""
    return axis.replace("axis", "")


def render_page(**values: Any) -> str:
    """Render the template with values to a self-contained HTML page."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("armcontour.report"), autoescape=True, undefined=StrictUndefined
    )
    environment.filters["number"] = number
    environment.globals["figure"] = lambda x, key: Markup(x.to_html(f"figure-{key}"))
    return environment.get_template("report.html").render(
        version=__version__,
        verdicts=VERDICTS,
        plotly=Markup(base64.b64encode(_vendored("plotly.js.gz")).decode()),
        template=Markup(to_json(json.loads(_vendored("plotly_white.json")))),
        **values,
    )


@cache
def _vendored(name: str) -> bytes:
    """Content of a file in the folder `vendor`, which `make vendor` creates."""
    content = pkgutil.get_data("armcontour.report", f"vendor/{name}")
    assert content is not None
    return content


def to_json(value: Any) -> str:
    """Encode a value as JSON for a script element of a page; NaN and infinity become null."""
    text = json.dumps(value, default=_plain, separators=(",", ":"))
    if "NaN" in text or "Infinity" in text:
        text = json.dumps(json.loads(text, parse_constant=lambda x: None), separators=(",", ":"))
    for character, safe in UNSAFE.items():
        text = text.replace(character, safe)
    return text


def _plain(value: Any) -> Any:
    """Convert a numpy array or number to a value that JSON supports."""
    if isinstance(value, np.ndarray) and value.size:
        if value.dtype == np.int64:
            # plotly.js does not support 64-bit integers, so the smallest sufficient type is used.
            value = value.astype(np.min_scalar_type(-1 - int(np.abs(value).max())))
        kind = TYPES.get(str(value.dtype))
        if kind is not None:
            coded = {"dtype": kind, "bdata": base64.b64encode(value.tobytes()).decode()}
            if value.ndim > 1:
                coded["shape"] = ", ".join(map(str, value.shape))
            return coded
    return value.tolist()
