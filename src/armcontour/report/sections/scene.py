"""Figures in space: equal axes, views from several sides, buttons."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.report.figure import make_trace
from armcontour.report.style import finish

# Shortest side of a scene, as a share of the longest side.
FLATTEST = 0.4
# Longest side of a scene in units of plotly; it fits in every view.
SCENE = 1.45
# Height of a row of buttons, and width of a letter of their labels [pixels].
ROW = 38
LETTER = 8
# Position of the eye and upward direction of every view.
VIEWS = {
    "oblique": ((1.1, -1.5, 0.9), (0, 0, 1)),
    "top": ((0, 0, 2), (0, 1, 0)),
    "front": ((0, -2, 0), (0, 0, 1)),
    "side": ((2, 0, 0), (0, 0, 1)),
}


def line_in_space(points: FloatArray, name: str, colour: str, **look: Any) -> Any:
    """A curve in space from points in mm, rounded to 0.1 µm."""
    line = {"color": colour, "width": look.pop("width", 4), "dash": look.pop("dash", "solid")}
    x, y, z = np.round(points, 4).astype(np.float32).T
    hover = "x %{x:.3f} mm<br>y %{y:.3f} mm<br>z %{z:.3f} mm"
    return make_trace(
        "scatter3d", x=x, y=y, z=z, name=name, mode="lines", line=line, hovertemplate=hover, **look
    )


def in_space(figure: Any, *, title: str, height: int, rows: int = 1) -> None:
    """Set the layout of a figure in space: equal axes, a legend at the left, rows of buttons."""
    finish(figure, title=title, height=height)
    axis = {
        "nticks": 6,
        "backgroundcolor": "#FAFAFA",
        "gridcolor": "#DDDDDD",
        "zerolinecolor": "#DDDDDD",
    }
    figure.update_layout(
        scene={
            "aspectmode": "manual",
            "camera": _camera("oblique"),
            **{f"{x}axis": {"title": {"text": f"{x} [mm]"}, **axis} for x in "xyz"},
        },
        legend={
            "orientation": "v",
            "x": 0,
            "xref": "paper",
            "xanchor": "left",
            "yref": "paper",
            "y": 1,
            "yanchor": "top",
            "bgcolor": "rgba(255,255,255,0.8)",
        },
        margin={"l": 10, "r": 10, "t": 12 + ROW * rows, "b": 10},
    )


def _roomy(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corner of a box around points, with no side much shorter than the longest."""
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    size = high - low
    more = np.maximum(FLATTEST * float(size.max()) - size, 0.0) / 2
    return low - more, high + more


def box(points: FloatArray) -> dict[str, Any]:
    """Layout of a scene that contains all points, with equal scales."""
    low, high = _roomy(points)
    edge = 0.03 * float((high - low).max())
    size = high - low + 2 * edge
    ratio = size / float(size.max()) * SCENE
    found: dict[str, Any] = {
        f"scene.{x}axis.range": [float(low[i] - edge), float(high[i] + edge)]
        for i, x in enumerate("xyz")
    }
    return {**found, "scene.aspectratio": dict(zip("xyz", ratio.tolist(), strict=True))}


def _camera(view: str) -> dict[str, Any]:
    """Camera of a view."""
    (x, y, z), (a, b, c) = VIEWS[view]
    return {
        "eye": {"x": x, "y": y, "z": z},
        "up": {"x": a, "y": b, "z": c},
        "center": {"x": 0, "y": 0, "z": 0},
        # Parallel projection: equal lengths look equal.
        "projection": {"type": "orthographic"},
    }


def view_buttons(row: int = 0) -> dict[str, Any]:
    """A row of buttons that change the view, after the label "view"."""
    found = []
    for name, (eye, _) in VIEWS.items():
        # An axis along the line of sight is hidden: its labels would overlap.
        args: dict[str, Any] = {
            f"scene.{axis}axis.visible": np.count_nonzero(eye) > 1 or not eye[i]
            for i, axis in enumerate("xyz")
        }
        args["scene.camera"] = _camera(name)
        found.append({"label": name, "method": "relayout", "args": [args]})
    return buttons(found, row=row, label="view")


def buttons(found: list[dict[str, Any]], *, row: int = 0, label: str = "") -> dict[str, Any]:
    """A row of buttons above a scene.

    Places are in pixels, so that rows fit narrow screens.

    Args:
        found: The buttons.
        row: Number of rows below this one.
        label: The text of `row_label` before the buttons.
    """
    return {
        "type": "buttons",
        "direction": "right",
        "buttons": found,
        "x": 0,
        "xanchor": "left",
        "y": 1,
        "yanchor": "bottom",
        "pad": {"t": 0, "b": 6 + ROW * row, "l": LETTER * len(label)},
        "bgcolor": "#FFFFFF",
        "font": {"size": 12},
    }


def row_label(text: str, row: int = 0) -> dict[str, Any]:
    """A label before a row of buttons."""
    return {
        "text": text,
        "x": 0,
        "xref": "paper",
        "xanchor": "left",
        "y": 1,
        "yref": "paper",
        "yanchor": "bottom",
        "yshift": 14 + ROW * row,
        "showarrow": False,
        "font": {"size": 12},
    }
