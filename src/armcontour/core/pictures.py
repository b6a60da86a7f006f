"""`Pictured`: results that the package `report` shows as pictures."""

from __future__ import annotations

from typing import Any

from armcontour.core.checks import explained
from armcontour.core.lazy import load_method


class Pictured:
    """Base of results with a picture, which notebooks show."""

    __slots__ = ()

    @explained
    def plot(self, kind: str = "path") -> Any:
        """Draw the result as in the report: a picture that notebooks show and that you can save.

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

    def _repr_html_(self) -> Any:
        """Show the result in a notebook: its picture and its rows, as HTML without scripts.

        Returns None if the result has no picture, so that the notebook shows its `repr`.
        """
        return load_method("result_as_html")(self)
