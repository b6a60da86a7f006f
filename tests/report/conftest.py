"""Every figure of these tests is one that plotly.py, which knows all names and values, accepts."""

from __future__ import annotations

import json
from collections.abc import Iterator

import plotly.graph_objects as go
import pytest

from armcontour.report.figure import Figure, to_json


@pytest.fixture(autouse=True, scope="module")
def accepted() -> Iterator[None]:
    """Have the first figure of every key checked: the check takes longer than the figure."""
    write, seen = Figure.to_html, set()

    def check_and_write(self: Figure, key: str) -> str:
        if key not in seen:
            seen.add(key)
            drawn = {"data": self.data, "layout": self.layout, "frames": self.frames}
            go.Figure(json.loads(to_json(drawn)))
        return write(self, key)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "to_html", check_and_write)
        yield
