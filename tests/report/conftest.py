"""Every figure of these tests is one that plotly.py, which knows all names and values, accepts."""

import json
import re

import plotly.graph_objects as go
import pytest

from armcontour.report.figure import Figure, to_json


@pytest.fixture(autouse=True, scope="module")
def accepted():
    """Have the first figure of every key checked: the check takes longer than the figure."""
    write, checked = Figure.to_html, set()

    def check_and_write(self, key):
        if key not in checked:
            checked.add(key)
            drawn = {"data": self.data, "layout": self.layout}
            go.Figure(json.loads(to_json(drawn)))
        return write(self, key)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "to_html", check_and_write)
        yield


@pytest.fixture(scope="session")
def in_order():
    """Check that a page has these sections in this order, and loads nothing from elsewhere."""

    def check(page, keys):
        places = [page.index(f'<details id="{key}">') for key in keys.split()]
        assert places == sorted(places)
        assert not re.search(r"<(script|link|img|iframe)[^>]*(src|href)=", page)

    return check
