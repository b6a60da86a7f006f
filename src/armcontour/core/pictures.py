"""Methods of results that show them as pictures, which the package `report` draws."""

from __future__ import annotations

from typing import Any

from armcontour.core.checks import explained
from armcontour.core.lazy import load_method


@explained
def plot(self: Any, kind: str = "path") -> Any:
    """Draw a result as in the report: a picture that notebooks show and that you can save.

        result.plot("error").write_html("error.html")

    Args:
        kind: "path", the path of the tool, the only kind of a path or a program; "joints",
            positions, velocities and accelerations with limits (of a job's result, those of its
            first run); "speed", the tool speed with the assigned velocity; "error", the contour
            error.

    Raises:
        InvalidInput: The kind is unknown, or the result has no data of it.
    """
    return load_method("draw_result")(self, kind)


def draw_as_html(value: Any) -> Any:
    """Show a result in a notebook: its picture and its rows, as HTML without scripts.

    Returns None if the result has no picture, so that the notebook shows its `repr`.
    """
    return load_method("result_as_html")(value)
