"""Figures as plain data: what plotly.py, which checks and copies everything, makes of the same."""

import base64
import gzip
import json
import re

import numpy as np
import plotly.graph_objects as go
import plotly.io as pio
from plotly.offline import get_plotlyjs
from plotly.subplots import make_subplots as plots_of_plotly

from armcontour.report.figure import Node, make_subplots, make_trace, render_page, to_json
from armcontour.report.style import finish

PLACES = [
    {"rows": 6, "cols": 3, "shared_xaxes": True, "column_titles": ["a", "b", "c"],
     "vertical_spacing": 0.025, "horizontal_spacing": 0.06},
    {"rows": 3, "cols": 2, "shared_xaxes": True, "subplot_titles": list("abcde"),
     "vertical_spacing": 0.22 / 3, "horizontal_spacing": 0.09},
    {"rows": 2, "cols": 1, "shared_xaxes": True, "row_heights": [0.75, 0.25],
     "vertical_spacing": 0.05},
    {"rows": 2, "cols": 2, "subplot_titles": list("abc"), "vertical_spacing": 0.16},
]  # fmt: skip


def written(figure):
    """What a page gives to plotly.js: its key, data, layout, configuration, frames."""
    page = figure.to_html("key")
    found, at = [], page.index("draw(") + len("draw(")
    while page[at - 1] != ")":
        value, at = json.JSONDecoder().raw_decode(page, at)
        found.append(value)
        at += 1
    return found


def test_several_plots_are_where_plotly_puts_them():
    for options in PLACES:
        ours, theirs = make_subplots(**options), plots_of_plotly(**options)
        ours.add_trace(make_trace("bar", y=[1, 2]), row=2, col=1)
        theirs.add_trace(go.Bar(y=[1, 2]), row=2, col=1)
        for made in (ours, theirs):
            made.update_yaxes(title="y", row=2, col=1)
            made.update_xaxes(range=[0, 1])
            made.add_hline(y=3.0, line={"color": "#000000"}, row=2, col=1)
        finish(ours, title="several", height=300)
        finish(theirs.update_layout(template="plotly_white"), title="several", height=300)
        expected = json.loads(theirs.to_json())
        # The page has the title above the figure, and the template once.
        layout = {x: y for x, y in expected["layout"].items() if x not in ("title", "template")}
        assert written(ours)[1:3] == [expected["data"], layout], options
        assert ">several</figcaption>" in ours.to_html("key")


def test_a_page_has_plotly_packed_and_its_template_once():
    page = render_page("report.html", job=None, title="a", about="", source="", sections=[])
    packed = re.search(r'<script type="text/plain" id="plotly">(.*?)</script>', page)
    assert gzip.decompress(base64.b64decode(packed[1])).decode() == get_plotlyjs()
    assert len(page) < 0.45 * len(get_plotlyjs())
    (template,) = re.findall(r"const template = (.*);\n", page)
    assert json.loads(template) == pio.templates["plotly_white"].to_plotly_json()


def test_arrays_are_written_in_base64_and_cannot_end_a_script():
    for values in (np.array([1.5, np.nan], np.float32), np.arange(6.0).reshape(2, 3)):
        found = json.loads(to_json({"x": values}))["x"]
        back = np.frombuffer(base64.b64decode(found["bdata"]), found["dtype"])
        np.testing.assert_array_equal(back, values.ravel())
        assert found.get("shape") == (None if values.ndim == 1 else "2, 3")
    for whole, kind in (([3, -4], "i1"), ([200], "i2"), ([-40_000], "i4")):
        assert json.loads(to_json(np.array(whole)))["dtype"] == kind
    assert json.loads(to_json([np.float32(0.5), np.array([]), np.array(["a"])])) == [0.5, [], ["a"]]
    text = to_json(Node({"name": "</script><b>", "y": [1.0, np.nan, np.inf]}))
    assert not set("<>/") & set(text)
    assert json.loads(text) == {"name": "</script><b>", "y": [1.0, None, None]}
